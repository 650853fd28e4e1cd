"""Whether the difference of a cold and a hot machine is told honestly, and a left-out temperature predicted.

    python validation/hot_and_cold.py                  # the study; writes validation/hot_and_cold.md
    python validation/hot_and_cold.py --example DIR    # one machine's files at 20, 60, 90 and 120 °C, for the guide

Machines of random chain and random errors (`hidden_effects`: kinematics, errors and noise that share no code with
geoerr's) are run through one program of nine lines at each temperature, with cameras and targets set up anew. What
heat does is known: each axis grows like its metal, guideways bow, carriages tilt, axes lean, some in proportion to
the temperature, some with a tenth more of its square.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import polars as pl
from validation.hidden_effects.chain import RELATIVE, TOOL, WORK, Array, Displacements, places_mm, sides
from validation.hidden_effects.machines import ErrorFunctions, draw_machine
from validation.hidden_effects.noise import NOISES, draw_noise

from geoerr.files import write_text
from geoerr.machine import Axis, Machine, write_machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns, write_observations
from geoerr.states import States, identify_states
from geoerr.terms import Term

HERE = Path(__file__).parent
TEMPERATURES_DEGC = (20.0, 60.0, 90.0, 120.0)
KINDS = ("gauss-10", "heavy-tails", "outliers", "unequal-depth", "offsets-3", "offsets-8", "drift-2")
N_POINTS = 13
# A printer as Li's: wZbXYt, 328 × 334 × 372 mm; screws of steel, stainless steel and aluminium.
EXAMPLE_SEED = 26
COVERAGE_95 = 1.959964
# Aluminium, steel, stainless steel, per kelvin.
METALS = {"aluminium": 23.4e-6, "steel": 11.5e-6, "stainless steel": 17.0e-6}
# Largest bow (middle of the travel), tilt (its end) and lean at 100 K; this share of those that could be are there.
BOW_MM, TILT_RAD, LEAN_RAD, SHARE = 0.03, 100e-6, 200e-6, 0.4


@dataclass(frozen=True)
class Heat:
    """What a kelvin does.

    Attributes
    ----------
    expansion
        (3,) of each axis, 1/K, from its low end.
    bow_mm, tilt_rad
        (3 moving axes, 3 directions) per kelvin: 4 u (1 − u) across, and u about, u from 0 to 1 over the travel.
    lean_rad
        (3,) of S_xy, S_xz, S_yz.
    square
        T counts as T + square · T² / 100 K.
    """

    expansion: Array
    bow_mm: Array
    tilt_rad: Array
    lean_rad: Array
    square: float = 0.0

    def degrees(self, temperature_degc: float) -> float:
        """Give T as it counts."""
        above = temperature_degc - 20.0
        return above + self.square * above**2 / 100.0

    def at(self, machine: Machine, q_mm: Array, temperature_degc: float, moved: Displacements) -> Displacements:
        """Add what heat does to a cold machine's errors."""
        heat = self.degrees(temperature_degc)
        for index, axis in enumerate("xyz"):
            low, high = machine.axes[axis].range_mm
            u = ((q_mm[:, index] - low) / (high - low))[:, None]
            moved.delta_mm[:, index] += heat * 4.0 * u * (1.0 - u) * self.bow_mm[index]
            moved.delta_mm[:, index, index] += heat * self.expansion[index] * (q_mm[:, index] - low)
            moved.epsilon_rad[:, index] += heat * u * self.tilt_rad[index]
        moved.squareness_rad[:] += heat * self.lean_rad
        return moved


NO_HEAT = Heat(np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3))


def draw_heat(rng: np.random.Generator, square: float = 0.0) -> Heat:
    """Draw metals, and which bows, tilts and leans there are."""
    bow = rng.uniform(-1.0, 1.0, (3, 3)) * (rng.random((3, 3)) < SHARE) * (1.0 - np.eye(3))
    tilt = rng.uniform(-1.0, 1.0, (3, 3)) * (rng.random((3, 3)) < SHARE)
    lean = rng.uniform(-1.0, 1.0, 3) * (rng.random(3) < SHARE)
    metals = rng.choice(list(METALS.values()), 3)
    return Heat(metals, BOW_MM / 100.0 * bow, TILT_RAD / 100.0 * tilt, LEAN_RAD / 100.0 * lean, square)


@dataclass(frozen=True)
class Hot:
    """A machine, its errors when cold, and what heat does to it."""

    machine: Machine
    cold: ErrorFunctions
    heat: Heat

    def moved(self, q_mm: Array, temperature_degc: float) -> Displacements:
        """Give all errors at positions (n, 3)."""
        return self.heat.at(self.machine, q_mm, temperature_degc, self.cold.at(self.machine, q_mm))

    def volume_mm(self, q_mm: Array, temperature_degc: float) -> Array:
        """Give where the tool point is, seen from the work (n, 3)."""
        arm = np.tile(np.asarray(self.machine.tool_offset_mm), (len(q_mm), 1))
        carrier = np.full(len(q_mm), RELATIVE)
        return places_mm(self.machine.chain, carrier, q_mm, arm, self.moved(q_mm, temperature_degc))

    def difference(self, name: str, position_mm: Array, first_degc: float, second_degc: float) -> Array:
        """Give how one of the 21 differs, in its gauge: what heat does was drawn so that it is in it."""
        heat = self.heat.degrees(second_degc) - self.heat.degrees(first_degc)
        if name[1] in "ABC" and name[2] == "0":
            pair, sign = {"EC0Y": (0, 1.0), "EB0Z": (1, -1.0), "EA0Z": (2, 1.0)}[name]
            return np.array([sign * heat * self.heat.lean_rad[pair]])
        index = "XYZ".index(name[2])
        low, high = self.machine.axes["xyz"[index]].range_mm
        u = (position_mm - low) / (high - low)
        if name[1] in "ABC":
            return heat * u * self.heat.tilt_rad[index, "ABC".index(name[1])]
        direction = "XYZ".index(name[1])
        along = heat * self.heat.expansion[index] * (position_mm - low) if direction == index else 0.0
        return along + heat * 4.0 * u * (1.0 - u) * self.heat.bow_mm[index, direction]


def draw_hot(seed: int, heat: Heat | None = None, *, square: float = 0.0) -> Hot:
    """Draw a machine; `heat` None draws that too."""
    rng = np.random.default_rng([seed, 1])
    machine, cold = draw_machine(rng, None)
    return Hot(machine, cold, draw_heat(rng, square) if heat is None else heat)


def observe(hot: Hot, temperature_degc: float, seed: int, noise: str = "gauss-10") -> Observations:
    """Run the program at one temperature: the same at each, cameras and targets set up anew."""
    machine = hot.machine
    program, rng = np.random.default_rng([seed, 2]), np.random.default_rng([seed, 3, round(100 * temperature_degc)])
    limits = np.array([machine.axes[axis].range_mm for axis in "xyz"])
    q_mm, pass_number, lines = [], [], []
    for axis in range(3):
        for place in range(3):
            share = program.random(3) * (0.1 if place == 0 else 1.0)
            start = limits[:, 0] + share * (limits[:, 1] - limits[:, 0])
            there = np.linspace(*limits[axis], N_POINTS)
            # At the turn it stands still: one point, of the way there.
            for along in (there, there[-2::-1]):
                way_mm = np.tile(start, (len(along), 1))
                way_mm[:, axis] = along
                pass_number += [len(q_mm)] * len(along)
                lines += [f"{'XYZ'[axis]}{place + 1}"] * len(along)
                q_mm.append(way_mm)
    moments = np.concatenate(q_mm)
    tool_axes, work_axes = sides(machine.chain)
    arms_mm = np.array([[0.0, 0.0, 0.0], [150.0, 0.0, -60.0], [0.0, 120.0, 80.0]])
    targets = [
        (body, name, number)
        for body, name, axes in ((TOOL, "tool", tool_axes), (WORK, "work", work_axes))
        if axes
        for number in range(len(arms_mm))
    ]
    n_targets = len(targets)
    q = np.repeat(moments, n_targets, axis=0)
    body = np.tile([one for one, _, _ in targets], len(moments))
    stated = np.tile([arms_mm[number] for _, _, number in targets], (len(moments), 1))
    glued = np.tile(rng.uniform(-0.5, 0.5, (n_targets, 3)), (len(moments), 1))
    on_tool = (body == TOOL)[:, None] * np.asarray(machine.tool_offset_mm)
    seen = places_mm(machine.chain, body, q, stated + glued + on_tool, hot.moved(q, temperature_degc))
    turn = turned(np.array([0.9, -0.4, 0.3])) @ turned(rng.normal(0.0, 0.02, 3))
    passes, moment = np.repeat(pass_number, n_targets), np.repeat(np.arange(len(moments)), n_targets)
    drawn = draw_noise(rng, NOISES[noise], passes, np.zeros(len(q), dtype=np.int64), 2.0 * moment)
    seen = seen @ turn.T + rng.uniform(-300.0, 300.0, 3) + drawn.total_mm
    columns: dict[str, Array | list[str]] = dict(zip("xyz", q.T, strict=True))
    columns |= dict(zip(("tx", "ty", "tz"), stated.T, strict=True))
    columns |= dict(zip(("mx", "my", "mz"), seen.T, strict=True))
    columns |= dict(zip(("sx", "sy", "sz"), drawn.stated_mm.T, strict=True))
    columns |= {
        "line": [lines[one] for one in moment],
        "repeat": 0.0 * passes,
        "carrier": [name for _ in moments for _, name, _ in targets],
        "target": [f"{name}{number}" for _ in moments for _, name, number in targets],
        "t": 2.0 * moment,
    }
    return observations_from_columns(columns)


def turned(vector_rad: Array) -> Array:
    """Make a rotation matrix from a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector_rad))
    x, y, z = vector_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def states_of(hot: Hot, seed: int, temperatures: Iterable[float], noise: str = "gauss-10") -> States:
    """Measure and identify."""
    tables = {temperature: observe(hot, temperature, seed, noise) for temperature in temperatures}
    return identify_states(tables, hot.machine, threads=1)


def without_rigid(places_mm: Array, vectors_mm: Array) -> Array:
    """Take the shift and small turn off vectors (n, 3) that fit them best."""
    x, y, z = (places_mm - places_mm.mean(axis=0)).T
    zero, one = np.zeros(len(x)), np.ones(len(x))
    columns = np.stack(
        [
            np.stack([one, zero, zero], axis=1),
            np.stack([zero, one, zero], axis=1),
            np.stack([zero, zero, one], axis=1),
            np.stack([zero, -z, y], axis=1),
            np.stack([z, zero, -x], axis=1),
            np.stack([-y, x, zero], axis=1),
        ],
        axis=2,
    ).reshape(-1, 6)
    flat = vectors_mm.ravel()
    return (flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]).reshape(-1, 3)


def alarms(seed: int, noise: str) -> list[bool]:
    """Nothing differs: which of the four tests say that something does, at 5 %."""
    difference = states_of(draw_hot(seed, NO_HEAT), seed, (20.0, 120.0), noise).difference(20.0, 120.0)
    volume = difference.volume(4)
    return [
        difference.p_value < 0.05,
        any(one.is_beyond.any() for one in difference.by_name.values()),
        volume.p_value < 0.05,
        bool(volume.is_beyond.any()),
    ]


# One thing that heat does in 100 K, and the sizes that are tried.
ONE_THING = {
    "expansion of x over its travel, µm": ("expansion", (10.0, 20.0, 40.0)),
    "bow of x upwards, µm": ("bow", (5.0, 10.0, 20.0)),
    "roll of y over its travel, µrad": ("tilt", (50.0, 100.0, 200.0)),
    "squareness of x and z, µrad": ("lean", (50.0, 100.0, 200.0)),
}
ACTS = {0.0: "in proportion", 0.1: "with a tenth of its square"}


def detected(seed: int, what: str, size: float) -> list[bool]:
    """One thing differs: whether the whole, the volume, its own function says so, and no other function does."""
    hot = draw_hot(seed, NO_HEAT)
    along_x = 1e-5 * size / hot.machine.axes["x"].length_mm
    name, heat = {
        "expansion": ("EXX", replace(NO_HEAT, expansion=np.array([along_x, 0, 0]))),
        "bow": ("EZX", replace(NO_HEAT, bow_mm=np.array([[0, 0, 1e-5 * size], [0, 0, 0], [0, 0, 0]]))),
        "tilt": ("EBY", replace(NO_HEAT, tilt_rad=np.array([[0, 0, 0], [0, 1e-8 * size, 0], [0, 0, 0]]))),
        "lean": ("EB0Z", replace(NO_HEAT, lean_rad=np.array([0, 1e-8 * size, 0]))),
    }[what]
    difference = states_of(replace(hot, heat=heat), seed, (20.0, 120.0)).difference(20.0, 120.0)
    named = [one for one, found in difference.by_name.items() if found.p_value < 0.05]
    return [difference.p_value < 0.05, bool(difference.volume(4).is_beyond.any()), name in named, named == [name]]


@dataclass(frozen=True)
class LeftOut:
    """One temperature predicted from the others: mean squares in µm², and how often intervals held.

    Attributes
    ----------
    predicted_off, own_off
        Error over the volume against the truth, of the prediction and of the state's own fit.
    seen, by_chance
        Measured minus predicted over the volume, and what noise has of it.
    points_predicted, points_own
        Measured points minus predicted and minus fitted ones.
    coverage
        Share of the tables' values inside 95 %.
    """

    predicted_off: float
    own_off: float
    seen: float
    by_chance: float
    points_predicted: float
    points_own: float
    coverage: float


@dataclass(frozen=True)
class Truth:
    """How often intervals held the truth, for one machine: shares of values, and whether the whole band did."""

    functions: float
    band: bool
    volume: float
    left_out: dict[float, LeftOut]


def coverage(seed: int, square: float) -> Truth:
    """Measure a machine at four temperatures; compare differences and left-out temperatures with the truth."""
    hot = draw_hot(seed, square=square)
    states = states_of(hot, seed, TEMPERATURES_DEGC)
    difference = states.difference(20.0, 120.0)
    inside, in_band = [], []
    for name, found in difference.by_name.items():
        off = np.abs(found.value - hot.difference(name, found.position_mm, 20.0, 120.0))
        counts = found.std > 0.0
        inside.append(off[counts] <= COVERAGE_95 * found.std[counts])
        in_band.append(bool((off[counts] <= found.half_width[counts]).all()))
    volume = difference.volume(4)
    places = volume.position_mm
    true = without_rigid(places, hot.volume_mm(places, 120.0) - hot.volume_mm(places, 20.0))
    std = volume.std_mm
    left_out = {}
    for one in states.left_out:
        temperature = one.temperature_degc
        predicted = one.fit.functions.with_values(one.difference.before.parameters)
        left_out[temperature] = LeftOut(
            mean_square_um2(hot, predicted, places, temperature),
            mean_square_um2(hot, states[temperature].fitted.terms, places, temperature),
            one.rms_um**2,
            one.rms_by_chance_um**2,
            one.predicted_rmse_um**2,
            one.own_rmse_um**2,
            one.coverage,
        )
    return Truth(
        float(np.concatenate(inside).mean()),
        all(in_band),
        float((np.abs(volume.difference_mm - true) <= COVERAGE_95 * std).mean()),
        left_out,
    )


def mean_square_um2(hot: Hot, terms: Sequence[Term], places_mm: Array, temperature_degc: float) -> float:
    """Give how far a model is off over the volume, set-up of the work aside: mean squared length."""
    true_mm = hot.volume_mm(places_mm, temperature_degc)
    found_mm = Model(hot.machine, terms=tuple(terms)).tool_from_work(places_mm)
    return float(1e6 * (without_rigid(places_mm, found_mm - true_mm) ** 2).sum(axis=1).mean())


def share(found: Sequence[bool] | Array) -> str:
    """Write a share with its standard error."""
    rate, count = float(np.mean(found)), len(found)
    return f"{100.0 * rate:.1f} ± {100.0 * math.sqrt(max(rate * (1.0 - rate), 0.25 / count) / count):.1f} %"


def mean(values: Sequence[float]) -> str:
    """Write a mean share with its standard error."""
    return f"{100.0 * np.mean(values):.1f} ± {100.0 * np.std(values, ddof=1) / math.sqrt(len(values)):.1f} %"


def alarm_table(seeds: range, pool: ProcessPoolExecutor) -> list[str]:
    """Nothing differs: how often each test says that something does."""
    lines = [
        "| noise | whole, all functions | a band of some function | whole, volume | some place of the volume |",
        "| --- | --- | --- | --- | --- |",
    ]
    for noise in KINDS:
        found = np.array(list(pool.map(alarms, seeds, [noise] * len(seeds))))
        lines.append(f"| {noise} | " + " | ".join(share(column) for column in found.T) + " |")
        print(lines[-1], flush=True)
    return lines


def power_table(seeds: range, pool: ProcessPoolExecutor) -> list[str]:
    """One thing differs: how often that is seen."""
    lines = [
        "| what heat does | size | whole, all functions | some place of the volume | its own function | it alone |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for title, (what, sizes) in ONE_THING.items():
        for size in sizes:
            found = np.array(list(pool.map(detected, seeds, [what] * len(seeds), [size] * len(seeds))))
            lines.append(f"| {title} | {size:g} | " + " | ".join(share(column) for column in found.T) + " |")
            print(lines[-1], flush=True)
    return lines


def truth_tables(seeds: range, pool: ProcessPoolExecutor) -> list[str]:
    """Much differs: whether intervals hold the truth, and what a left-out temperature's prediction is worth."""
    found = {square: list(pool.map(coverage, seeds, [square] * len(seeds))) for square in (0.0, 0.1)}
    lines = [
        "| heat acts | values of functions inside 95 % | whole band holds (95 %) | values over the volume |",
        "| --- | --- | --- | --- |",
    ]
    for square, truths in found.items():
        columns = [
            mean([one.functions for one in truths]),
            share([one.band for one in truths]),
            mean([one.volume for one in truths]),
        ]
        lines.append(f"| {ACTS[square]} | " + " | ".join(columns) + " |")
    lines += [
        "",
        "Left out by turns, µm rms: error of the prediction over the volume against the truth, beside that of the "
        "state's own fit; measured minus predicted, beside what noise makes of it; points measured minus predicted, "
        "beside the state's own fit; and the share of table values inside 95 %.",
        "",
        "| heat acts | left out | | truth: predicted | own fit | seen | by chance | points: predicted | own fit "
        "| inside |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for square, truths in found.items():
        for temperature in TEMPERATURES_DEGC:
            ones = [truth.left_out[temperature] for truth in truths]
            kind = "extrapolated" if temperature in (20.0, 120.0) else "interpolated"
            names = ("predicted_off", "own_off", "seen", "by_chance", "points_predicted", "points_own")
            numbers = [f"{math.sqrt(np.mean([getattr(one, name) for one in ones])):.1f}" for name in names]
            inside = mean([one.coverage for one in ones])
            lines.append(f"| {ACTS[square]} | {temperature:g} °C | {kind} | {' | '.join(numbers)} | {inside} |")
    print("\n".join(lines), flush=True)
    return lines


def write_example(folder: Path, seed: int) -> None:
    """Write one machine's files, as a user would have them."""
    hot = draw_hot(seed)
    metal = {value: name for name, value in METALS.items()}
    axes = {
        axis: Axis(one.range_mm, metal[float(hot.heat.expansion["xyz".index(axis)])])
        for axis, one in hot.machine.axes.items()
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_machine(folder / "machine.toml", replace(hot.machine, axes=axes))
    for temperature in TEMPERATURES_DEGC:
        # Each file is a session of its own, as the verbs know it that read them together.
        frame = observe(hot, temperature, seed).frame.drop("session").with_columns(temp=pl.lit(temperature))
        write_observations(folder / f"at-{temperature:g}.csv", Observations(frame))


def main() -> None:
    """Run the study and write its tables, or the files of one machine."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200, help="machines for each kind of noise")
    parser.add_argument("--first", type=int, default=1001, help="first seed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="machines worked on at once")
    parser.add_argument("--output", type=Path, default=HERE / "hot_and_cold.md")
    parser.add_argument("--example", type=Path, metavar="DIR", help="write one machine's files here instead")
    arguments = parser.parse_args()
    if arguments.example is not None:
        write_example(arguments.example, EXAMPLE_SEED)
        return
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    fewer = range(arguments.first, arguments.first + max(arguments.seeds // 5, 1))
    with ProcessPoolExecutor(arguments.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        lines = [
            "# Hot and cold",
            "",
            f"`python validation/hot_and_cold.py --seeds {arguments.seeds} --first {arguments.first}`: random "
            f"machines of all chains, nine lines there and back with {N_POINTS} points, three targets on each body "
            "that moves, 10 µm noise (15 in depth where unequal). ± is one standard error.",
            "",
            "## Much differs",
            "",
            f"{len(fewer)} machines at {', '.join(f'{one:g}' for one in TEMPERATURES_DEGC)} °C; difference of the "
            "last and the first.",
            "",
            *truth_tables(fewer, pool),
            "",
            "## One thing differs",
            "",
            f"{len(fewer)} machines at 20 and 120 °C, tests at 5 %; of its own function corrected for looking at all "
            "21.",
            "",
            *power_table(fewer, pool),
            "",
            "## Nothing differs",
            "",
            f"{len(seeds)} machines for each kind of noise (`hidden_effects/noise.py`; the tables state the white "
            "part only), 20 and 120 °C, tests at 5 %.",
            "",
            *alarm_table(seeds, pool),
        ]
    write_text(arguments.output, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
