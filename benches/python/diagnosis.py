"""What a diagnosis costs: candidates laid out, the space of a fit, the ranking, one search; and adding a find.

    python benches/python/diagnosis.py [--points 10000] [--threads 1 2] [--repeats 7]

The data are points like those of `joint_fit.py`, with passes, directions, feeds, times and three
temperatures. Nothing is hidden in them, but where something is added. `ranking` is one look at everything: all
candidates of the catalogue on all axes, covariates and inner parameters, all probes, and the largest of every draw
of noise. `search` is a whole search; on such data it is one look. `add` puts what a search found into the model, on
the bases that the search had, as the workbench does: the refit, and the held-out error before and after. The median
of the repeats counts, wall and processor seconds: the latter where others use the machine too. At the end, how much
memory it took.
"""

from __future__ import annotations

import argparse
import resource
from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
from joint_fit import LENGTH_MM, OFFSETS_MM, STD_MM, timed

from geoerr.diagnose.candidates import Candidate, candidates_of
from geoerr.diagnose.change import add_terms
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.probe_variables import variables_of
from geoerr.diagnose.probes import probes_of
from geoerr.diagnose.scan import all_channels
from geoerr.diagnose.search import Bench, look, search
from geoerr.diagnose.whole_search import searched_whole
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, Fitted, fit_terms, result_of
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import Observations, observations_from_columns

ROWS_OF_A_PASS = 40
SECONDS = 4.0
FEEDS_MM_MIN = (300.0, 1000.0, 3000.0, 6000.0)
# What is added: what hides it.
HIDDEN = {"backlash:x": {"play_mm": 0.01}, "thermal-expansion:y@temp_bed": {"growth_per_k": 11.5e-6}}
MACHINE = Machine("bench", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in AXES}, tool_offset_mm=(0.0, 0.0, 0.0))
KNOWN = catalogue()


def measured(
    n_points: int, rng: np.random.Generator, *, play_mm: float = 0.0, growth_per_k: float = 0.0
) -> Observations:
    """Lines there and back over the volume, in five sessions, while three temperatures rise in their own time."""
    row = np.arange(n_points)
    line = row // ROWS_OF_A_PASS
    start, end = rng.uniform(0.0, LENGTH_MM, (2, line.max() + 1, 3))
    share = rng.uniform(0.0, 1.0, n_points)
    share = np.sort(share.reshape(-1, ROWS_OF_A_PASS), axis=1).ravel() if n_points % ROWS_OF_A_PASS == 0 else share
    q = start[line] + (end - start)[line] * share[:, None]
    offset = OFFSETS_MM[rng.integers(0, len(OFFSETS_MM), n_points)]
    session = row * 5 // n_points
    t = (row - np.searchsorted(session, session)) * SECONDS
    seen = q + STD_MM * rng.normal(size=q.shape)
    columns: dict[str, npt.NDArray[np.float64] | list[str]] = {
        "carrier": ["relative"] * n_points,
        "session": [f"s{number}" for number in session],
        "line": [f"line-{number}" for number in line],
        "t": t,
        "feed": np.array(FEEDS_MM_MIN)[line % len(FEEDS_MM_MIN)],
        "moving": (line % 2).astype(np.float64),
    }
    for number, name in enumerate(("temp_bed", "temp_frame", "temp_room")):
        columns[name] = 20.0 + 30.0 / (number + 1) * (1.0 - np.exp(-(t + 600.0 * session) / (900.0 * (1 + number))))
    seen[:, 0] -= 0.5 * play_mm * np.sign(end - start)[line, 0]
    seen[:, 1] += growth_per_k * (np.asarray(columns["temp_bed"]) - 20.0) * q[:, 1]
    for axis, name in enumerate("xyz"):
        columns |= {name: q[:, axis], f"t{name}": offset[:, axis], f"m{name}": (seen + offset)[:, axis]}
        columns |= {f"dir_{name}": np.sign(end - start)[line, axis], f"s{name}": np.full(n_points, STD_MM)}
    return observations_from_columns(columns)


def row(n_points: int, threads: int, step: str, seconds: tuple[float, float]) -> None:
    """Print a row."""
    print(f"| {n_points} | {threads} | {step} | {seconds[0]:.3f} | {seconds[1]:.3f} |", flush=True)


def fitted_to(n_points: int, threads: int) -> Fitted:
    """Fit a model to points in which nothing is hidden."""
    table = measured(n_points, np.random.default_rng(1))
    return fit_terms(MACHINE, [table], options=FitOptions(threads=threads))


def laid_out(n_points: int, threads: int) -> tuple[Bench, Sequence[Candidate]]:
    """Lay out what a ranking of names is done with, and all that it ranks."""
    fitted = fitted_to(n_points, threads)
    candidates, _, functions = candidates_of(fitted, KNOWN)
    shapes = [shape for candidate in candidates for shape in candidate.shapes]
    return Bench(fitted, functions, names=all_channels(shapes), threads=threads), candidates


def print_ranking(n_points: int, threads: int, repeats: int) -> None:
    """Print what a ranking and its parts cost."""
    fitted = fitted_to(n_points, threads)
    told = partial(row, n_points, threads)
    (candidates, _, functions), seconds = timed(lambda: candidates_of(fitted, KNOWN), repeats)
    probes = probes_of(fitted, functions, variables_of(fitted))
    shapes = [one for what in [*candidates, *probes] for one in what.shapes]
    told(f"candidates laid out: {len(candidates)}, {sum(len(one.trials) for one in shapes)} ways", seconds)
    bench = Bench(fitted, functions, names=all_channels(shapes), threads=threads)
    space, seconds = timed(lambda: bench.space([]), repeats)
    told("noise fitted, space whitened", seconds)
    told("ranking of names, with what chance finds", timed(lambda: look(bench, space, candidates, []), repeats)[1])
    _, seconds = timed(lambda: look(bench, space, candidates, probes), repeats)
    told("ranking of names and of what has no name, with what chance finds", seconds)


def print_search(n_points: int, threads: int) -> None:
    """Print what a whole search costs."""
    fitted = fitted_to(n_points, threads)
    row(n_points, threads, "search", timed(lambda: search(fitted, Offers(KNOWN), threads=threads), 1)[1])


def print_add(n_points: int, threads: int, repeats: int, name: str) -> None:
    """Print what it costs to add what is hidden, once it is found."""
    table = measured(n_points, np.random.default_rng(1), **HIDDEN[name])
    fitted = fit_terms(MACHINE, [table], options=FitOptions(threads=threads))
    beside, searched = searched_whole(fitted, KNOWN, threads=threads)
    found = searched.found[0].at_last.term
    assert found is not None
    if found.id != name:
        raise SystemExit(f"{found.id} was found, {name} is hidden")
    model = result_of(fitted).model
    add = partial(
        add_terms, model, [table], [found], name, found.title, known=fitted, searched=beside, threads=threads
    )
    row(n_points, threads, f"add {name}", timed(add, repeats)[1])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[10_000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()
    print("| points | threads | step | wall s | CPU s |\n| --- | --- | --- | --- | --- |")
    for n_points in arguments.points:
        for threads in arguments.threads:
            print_ranking(n_points, threads, arguments.repeats)
            print_search(n_points, threads)
            for name in HIDDEN:
                print_add(n_points, threads, arguments.repeats, name)
    # In kilobytes.
    most_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"\nMemory, at most: {most_gb:.1f} GB, of {max(arguments.points):,} points.")


if __name__ == "__main__":
    main()
