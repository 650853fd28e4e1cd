"""What a diagnosis costs: candidates laid out, the space of a fit, the ranking, one search; and adding a find.

    python benches/python/diagnosis.py [--points 10000] [--threads 1 2] [--repeats 7] [--peers]

The data are points like those of `joint_fit.py`, with passes, directions, feeds, times and three
temperatures. Nothing is hidden in them, but where something is added. `ranking` is one look at everything: all
candidates of the catalogue on all axes, covariates and inner parameters, all probes, and the largest of every draw
of noise. `search` is a whole search; on such data it is one look. `add` puts what a search found into the model, on
the bases that the search had, as the workbench does: the refit, and the held-out error before and after. The median
of the repeats counts, wall and processor seconds: the latter where others use the machine too. At the end, how much
memory it took.

Accuracy: of a ranking, gains in single precision beside whitening, products and directions written out in NumPy, for
some of the candidates; of an add, coefficients beside `scipy.optimize.least_squares` on the same residuals and
columns, and what was hidden. `--peers` also asks LassoLarsIC, OMP, stepwise BIC and lmfit, as
`validation/hidden_effects/peers.py` does: residual and columns are handed to them, at fewer trial values, without
chance; two minutes and several gigabytes.
"""

from __future__ import annotations

import argparse
import resource
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
from joint_fit import LENGTH_MM, OFFSETS_MM, STD_MM, by_scipy, difference, timed

from geoerr.diagnose.candidates import Candidate, Shapes, candidates_of
from geoerr.diagnose.change import add_terms
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.probe_variables import variables_of
from geoerr.diagnose.probes import probes_of
from geoerr.diagnose.scan import Scanner, all_channels
from geoerr.diagnose.search import Bench, look, search
from geoerr.diagnose.space import Space
from geoerr.diagnose.whole_search import searched_whole
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, Fitted, fit_terms, result_of
from geoerr.fit.owned import OWNED
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import Observations, observations_from_columns

ROWS_OF_A_PASS = 40
SECONDS = 4.0
FEEDS_MM_MIN = (300.0, 1000.0, 3000.0, 6000.0)
# What is added: what hides it.
HIDDEN = {"backlash:x": {"play_mm": 0.01}, "thermal-expansion:y@temp_bed": {"growth_per_k": 11.5e-6}}
MACHINE = Machine("bench", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in AXES}, tool_offset_mm=(0.0, 0.0, 0.0))
KNOWN = catalogue()
# What a lag behind a temperature is described as.
LAG = "lag behind the temperature"
# What the value that was hidden is called in the model, and how it is told: unit and size.
VALUES = {"backlash:x": ("b", "mm", 0.01), "thermal-expansion:y@temp_bed": ("alpha", "/K", 11.5e-6)}
# Groups of columns whose gain is made in NumPy too.
N_IN_NUMPY = 40
# SciPy takes 3 s for 10,000 points.
PEER_UP_TO = 10_000


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


def row(n_points: int, threads: int, step: str, seconds: tuple[float, float], accuracy: str = "") -> None:
    """Print a row."""
    print(f"| {n_points} | {threads} | {step} | {seconds[0]:.4f} | {seconds[1]:.4f} | {accuracy} |", flush=True)


def gain_in_numpy(space: Space, raw: npt.NDArray[np.float64]) -> float:
    """Give by how much the sum of squares falls with columns (n, 3, k), one step after the other in NumPy."""
    basis = space.basis.reshape(-1, space.basis.shape[2])
    columns = space.noise.whiten(raw).reshape(len(basis), -1)
    apart, size, _ = np.linalg.svd(columns, full_matrices=False)
    apart = apart[:, size > 1e-6 * max(size[0], 1e-300)]
    own, share, _ = np.linalg.svd(apart - basis @ (basis.T @ apart), full_matrices=False)
    return float(((own[:, share**2 > OWNED].T @ space.residual.reshape(-1)) ** 2).sum())


def off_numpy(scanner: Scanner, shapes: Sequence[Shapes]) -> float:
    """Give the largest difference from NumPy's gain, of some groups at their best; relative for gains above 1."""
    some = shapes[:: max(len(shapes) // N_IN_NUMPY, 1)]
    off = []
    for one, scanned in zip(some, scanner.scan(some), strict=True):
        best = int(np.argmax(scanned.gain))
        expected = gain_in_numpy(scanner.space, scanner.raw_columns(one, best))
        off.append(abs(float(scanned.gain[best]) - expected) / max(expected, 1.0))
    return max(off)


def n_lags(candidates: Sequence[Candidate]) -> int:
    """Give the number of lags at which a candidate follows a temperature, at most."""
    lags = [
        len({trial[place] for trial in shapes.trials})
        for what in candidates
        for shapes in what.shapes
        for place, parameter in enumerate(shapes.term.inner if shapes.term is not None else ())
        if parameter.what == LAG
    ]
    return max(lags, default=0)


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
    n_ways = sum(len(one.trials) for one in shapes)
    told(f"candidates laid out: {len(candidates)}, {n_ways} ways, {n_lags(candidates)} lags", seconds)
    bench = Bench(fitted, functions, names=all_channels(shapes), threads=threads)
    space, seconds = timed(lambda: bench.space([]), repeats)
    told("noise fitted, space whitened", seconds)
    _, seconds = timed(lambda: look(bench, space, candidates, []), repeats)
    named = [one for what in candidates for one in what.shapes]
    told(
        "ranking of names, with what chance finds",
        seconds,
        f"gains within {off_numpy(bench.scanner(space), named):.0e}",
    )
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
    change, seconds = timed(add, repeats)
    symbol, unit, hidden = VALUES[name]
    value = change.result.model.parameter(f"{name}.{symbol}")
    accuracy = f"{value.value:.5g} ± {value.std:.1g} {unit}, {hidden:g} hidden"
    if threads > 1 or n_points > PEER_UP_TO:
        row(n_points, threads, f"add {name}", seconds, accuracy)
        return
    coefficients, of_scipy = timed(lambda: by_scipy(change.after), 1)
    off = f"; coefficients within {difference(change.after, coefficients):.0e} std of SciPy's"
    row(n_points, threads, f"add {name}", seconds, accuracy + off)
    row(n_points, threads, f"peer of add {name}: scipy least_squares", of_scipy)


def print_peers(n_points: int) -> None:
    """Print what general-purpose tools take to name something, columns and residual given."""
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from validation.hidden_effects.peers import PEERS, problem_of

    bench, candidates = laid_out(n_points, 1)
    looked = look(bench, bench.space([]), candidates, [])
    problem = problem_of(looked, bench.fitted, with_noise_model=True)
    for name, ask in PEERS.items():
        with warnings.catch_warnings():
            # Paths that end early, fits that stop at their number of calls.
            warnings.simplefilter("ignore")
            try:
                said, seconds = timed(partial(ask, problem), 1)
            except ImportError:
                print(f"{name} is not installed.", file=sys.stderr)
                continue
        wrongly = "right, nothing is hidden" if said is None else f"wrong, names {said}"
        row(n_points, 1, f"peer of the ranking: {name}", seconds, wrongly)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[10_000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument(
        "--peers", action="store_true", help="general-purpose tools too, of the smallest number of points"
    )
    arguments = parser.parse_args()
    print("| points | threads | step | wall s | CPU s | accuracy |\n| --- | --- | --- | --- | --- | --- |")
    for n_points in arguments.points:
        for threads in arguments.threads:
            print_ranking(n_points, threads, arguments.repeats)
            print_search(n_points, threads)
            for name in HIDDEN:
                print_add(n_points, threads, arguments.repeats, name)
    # In kilobytes; before the peers.
    most_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    if arguments.peers:
        print_peers(min(arguments.points))
    print(f"\nMemory, at most, without peers: {most_gb:.1f} GB, of {max(arguments.points):,} points.")


if __name__ == "__main__":
    main()
