"""Is an error of an axis that is finer than a model's functions given a name? It should have none: nothing repeats.

    python validation/fine_errors.py                 # all machines; writes validation/fine_errors.md
    python validation/fine_errors.py --machines 1    # a look, one machine a row, to standard output

A machine of 400 mm moves there and back along its axes and diagonals, 24 places a line drawn anew, four sessions of
twenty lines, and is seen with white noise; or 21 or 41 uneven places of each axis are drawn once, and the lines of
three sessions come back to them: what is between these no pass has seen, held out or not. Along each axis it is off
by one curve, drawn for the axis; nothing else is wrong with it. A name is *false*; structure without a name is no
mistake, since a fit's few functions do leave some, and few places cannot tell it from a wave. To see that names are
not lost altogether, a wave of a screw is hidden on one axis of the last rows, alone and beside such errors.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np
import numpy.typing as npt
from numpy.polynomial import Chebyshev

from geoerr.diagnose import diagnose
from geoerr.files import write_text
from geoerr.fit import fit_model
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import Observations, observations_from_columns

Numbers = npt.NDArray[np.float64]
Curve = Callable[[Numbers], Numbers]

HERE = Path(__file__).parent
LENGTH_MM = 400.0
MACHINE = Machine("fine", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in AXES}, tool_offset_mm=(0.0, 0.0, 0.0))
N_LINES, N_PLACES = 20, 24
# Sessions of lines whose places are drawn anew, and of those that come back to so many.
N_SESSIONS, N_SESSIONS_OF_SAME = 4, 3
SAME_PLACES = (21, 41)
SIZE_UM = 30.0
NOISES_UM = (2.0, 10.0)
WAVE_MM, WAVE_UM = 5.0, 4.0
_SEED = 230


def step(rng: np.random.Generator) -> Curve:
    """Up within a few millimetres: where two lengths of a scale meet."""
    middle_mm = rng.uniform(80.0, 320.0)
    return lambda q: SIZE_UM * np.tanh((q - middle_mm) / 4.0)


def bump(rng: np.random.Generator) -> Curve:
    """Up and down again: a worn or a dirty place."""
    middle_mm, width_mm = rng.uniform(80.0, 320.0), rng.uniform(10.0, 40.0)
    return lambda q: SIZE_UM * np.exp(-0.5 * ((q - middle_mm) / width_mm) ** 2)


def kink(rng: np.random.Generator) -> Curve:
    """Another slope from some place on: a rail in two pieces."""
    middle_mm = rng.uniform(80.0, 320.0)
    return lambda q: SIZE_UM * np.abs(q - middle_mm) / 200.0


def table(rng: np.random.Generator) -> Curve:
    """Straight between 21 places that wander: what a table of corrections leaves."""
    places_mm, values = np.linspace(0.0, LENGTH_MM, 21), np.cumsum(rng.normal(size=21))
    values -= values.mean()
    values *= SIZE_UM / np.abs(values).max()
    return lambda q: np.interp(q, places_mm, values)


def polynomial(rng: np.random.Generator) -> Curve:
    """Smooth and large: degree 12, a hundred times 1 µm."""
    return Chebyshev(100.0 * rng.normal(size=13) / np.arange(1, 14), [0.0, LENGTH_MM])


def nothing(_: np.random.Generator) -> Curve:
    """None."""
    return np.zeros_like


def screw(q: Numbers) -> Numbers:
    """Give a wave of 4 µm each 5 mm."""
    return np.asarray(WAVE_UM * np.sin(2.0 * np.pi * q / WAVE_MM))


KINDS = {one.__name__: one for one in (step, bump, kink, table, polynomial)}


def line_anew(rng: np.random.Generator, moves: Numbers) -> Numbers:
    """Draw the places (n, 3) of a line."""
    low, high, parked = rng.uniform(5.0, 60.0, 3), rng.uniform(340.0, 395.0, 3), rng.uniform(20.0, 380.0, 3)
    along = np.sort(rng.uniform(0.0, 1.0, N_PLACES))[:, None]
    share = np.where(moves > 0.0, along, 1.0 - along)
    return np.asarray(np.where(moves == 0.0, parked, low + (high - low) * share))


def line_through(rng: np.random.Generator, moves: Numbers, places_mm: Numbers) -> Numbers:
    """Give the same places (n, 3) as all other lines, on an axis that stands one of them."""
    parked = places_mm[rng.integers(0, len(places_mm), 3), np.arange(3)]
    return np.asarray(np.where(moves == 0.0, parked, np.where(moves > 0.0, places_mm, places_mm[::-1])))


def measured(
    rng: np.random.Generator, curves: list[Curve], noise_um: float, n_same: int | None = None
) -> Observations:
    """Measure a machine that is off by a curve along each axis, at places drawn anew or so many that are the same."""
    same_mm = None if n_same is None else np.sort(rng.uniform(5.0, LENGTH_MM - 5.0, (n_same, 3)), axis=0)
    q, line, session, direction = [], [], [], []
    for number in range(N_LINES * (N_SESSIONS if n_same is None else N_SESSIONS_OF_SAME)):
        kind = number // 2 % 5
        moves = np.eye(3)[kind] if kind < 3 else np.array([1.0, 1.0 if kind == 3 else -1.0, 1.0])
        moves = moves if number % 2 == 0 else -moves
        own = line_anew(rng, moves) if same_mm is None else line_through(rng, moves, same_mm)
        q.append(own)
        direction.append(np.tile(np.where(moves == 0.0, 1.0, moves), (len(own), 1)))
        line += [f"L{number}"] * len(own)
        session += [f"s{number // N_LINES}"] * len(own)
    places, signs = np.concatenate(q), np.concatenate(direction)
    error_um = np.stack([curve(column) for curve, column in zip(curves, places.T, strict=True)], axis=1)
    seen = places + 1e-3 * (error_um + noise_um * rng.normal(size=places.shape))
    columns: dict[str, npt.NDArray[np.float64] | list[str]] = {"line": line, "session": session}
    columns["carrier"] = ["relative"] * len(places)
    for index, axis in enumerate(AXES):
        columns |= {axis: places[:, index], f"m{axis}": seen[:, index], f"dir_{axis}": signs[:, index]}
        columns |= {f"t{axis}": np.zeros(len(places)), f"s{axis}": np.full(len(places), 1e-3 * noise_um)}
    return observations_from_columns(columns)


@dataclass(frozen=True)
class Set:
    """One machine: the kind of its errors, whether a screw's wave is on X, noise in µm, places, and its number."""

    kind: str
    has_wave: bool
    noise_um: float
    n_same: int | None
    number: int


@dataclass(frozen=True)
class Named:
    """What was found on a machine: references with their worth in µm, and whether something has no name."""

    names: tuple[tuple[str, float], ...]
    is_unknown: bool


def named(one: Set) -> Named:
    """Diagnose one machine."""
    kinds = [*KINDS, nothing.__name__]
    seed = [_SEED, kinds.index(one.kind), one.has_wave, int(one.noise_um), one.number]
    rng = np.random.default_rng(seed if one.n_same is None else [*seed, one.n_same])
    draw = KINDS.get(one.kind, nothing)
    curves = [draw(rng) for _ in AXES]
    if one.has_wave:
        plain = curves[0]
        curves[0] = lambda q: plain(q) + screw(q)
    diagnosis = diagnose(fit_model(MACHINE, measured(rng, curves, one.noise_um, one.n_same)).fitted, threads=1)
    found = tuple((str(finding.reference), float(finding.worth_um)) for finding in diagnosis.found)
    return Named(found, diagnosis.unknown is not None)


def rows_of(n_machines: int) -> Iterator[list[Set]]:
    """Give the machines of each row."""
    kinds = [*((kind, False) for kind in KINDS), ("nothing", True), *((kind, True) for kind in KINDS)]
    for n_same in (None, *SAME_PLACES):
        for kind, has_wave in kinds:
            for noise_um in NOISES_UM:
                yield [Set(kind, has_wave, noise_um, n_same, number) for number in range(n_machines)]


def row_text(sets: list[Set], found: list[Named]) -> str:
    """Give one row: how many have a false name, what these are worth, how many have the wave's."""
    first = sets[0]
    wave = {"periodic:x"} if first.has_wave else set()
    false = [[worth for name, worth in one.names if name not in wave] for one in found]
    worths = [worth for own in false for worth in own]
    largest = f"{max(worths):.1f}" if worths else "–"
    right = f"{sum(wave <= {name for name, _ in one.names} for one in found)}/{len(found)}" if wave else "–"
    unknown = sum(one.is_unknown for one in found)
    what = f"{first.kind}, and a wave on x" if first.has_wave else first.kind
    n_false = f"{sum(map(bool, false))}/{len(found)}"
    places = "new" if first.n_same is None else str(first.n_same)
    return f"| {places} | {what} | {first.noise_um:g} | {n_false} | {largest} | {right} | {unknown}/{len(found)} |"


def main() -> None:
    """Make the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=8, help="machines of each row")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    lines = [
        "# Errors finer than a model's functions",
        "",
        "Written by `python validation/fine_errors.py`, whose head says what the machines are. Worth in µm rms.",
        "",
        "| places | along each axis | noise, µm | with a false name | largest worth | wave named | no name |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    counts: dict[int | None, tuple[int, int]] = {}
    with ProcessPoolExecutor(arguments.jobs) as pool:
        rows = list(rows_of(arguments.machines))
        results = pool.map(named, [one for sets in rows for one in sets])
        for sets in rows:
            found = [next(results) for _ in sets]
            lines.append(row_text(sets, found))
            print(lines[-1], flush=True)
            if not sets[0].has_wave:
                n_false, n_in_all = counts.get(sets[0].n_same, (0, 0))
                counts[sets[0].n_same] = n_false + sum(bool(one.names) for one in found), n_in_all + len(found)
    shares = {n_same: f"{n_false}/{n_in_all}" for n_same, (n_false, n_in_all) in counts.items()}
    of_same = ", ".join(f"{shares[n_same]} of those at {n_same} places" for n_same in SAME_PLACES)
    lines += ["", f"Without a wave, {shares[None]} have a false name where places are drawn anew; {of_same}."]
    print(lines[-1])
    if arguments.machines == parser.get_default("machines"):
        write_text(HERE / "fine_errors.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
