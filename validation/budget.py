"""Does the uncertainty budget hold? Errors predicted, and parts compensated, against the true machine.

    python validation/budget.py              # writes validation/budget.md

Virtual machines with 21 errors each (`geoerr.simulate`, whose kinematics share no code with the fit) are seen by a
camera pair of Li's Table 2: nine lines, twice, by plates on both bodies. The rig is calibrated from the corners of a
board, so that its errors are real ones; pixels, stops of the axes and board corners are drawn. The same data give the
budget. The true error at 26 places of the volume is then compared with the prediction, and the place where a
compensated command really ends with the programmed one. Twice: with the freedom of each function chosen by the data,
as `fit` does, and with splines of nine knots each, which leaves nothing to choose.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from geoerr.budget import (
    Budget,
    Implementation,
    Propagated,
    budget_text,
    propagate_distributions,
    refit_with_noise,
    uncertainty_budget,
)
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.files import write_text
from geoerr.fit import FitOptions, fit_terms, result_of
from geoerr.observations import Observations, observations_from_columns
from geoerr.simulate.boards import board_sheets
from geoerr.simulate.machine import VirtualMachine
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.scene import Scene
from geoerr.terms import BasisSpec
from geoerr.vision.calibrate import calibrate_from_corners
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import points_from_pixels, project_to_both, sensitivity_of_points

HERE = Path(__file__).parent
CHAINS = ("wZbXYt", "wbXYZt", "wXYbZt", "wYbZXt")
SETTING = NineLines(n_points=21, repeats=2, both_directions=False)
NOISE_PX = 0.01
BOARD_NOISE_PX = 0.02
REPEATABILITY_UM = 3.0
# Drawn once more for every place of a part: no chords, nothing finer than the program's digits.
CARRIED_OUT = Implementation(tolerance_mm=0.0, digits=4)
_ROUNDS = 4
N_KNOTS = 9
CHOSEN, GIVEN = "freedom chosen by the data", f"{N_KNOTS} knots each"


@dataclass(frozen=True)
class Outcome:
    """One machine: errors of prediction and part (n, 4) with their U, in µm: x, y, z and the length."""

    prediction: tuple[np.ndarray, np.ndarray, np.ndarray]
    part: tuple[np.ndarray, np.ndarray, np.ndarray]
    shares: dict[str, float]


def scene_of(seed: int) -> Scene:
    """Draw a machine and its cameras."""
    plan = nine_line_plan(replace(SETTING, seed=seed, chain=CHAINS[seed % len(CHAINS)]))
    return Scene(replace(plan, repeatability_um=REPEATABILITY_UM))


def calibrated(scene: Scene, rng: np.random.Generator) -> Rig:
    """Calibrate the scene's cameras from board corners with noise."""
    plan = scene.plan
    assert plan.board is not None
    sheets = board_sheets(plan.board, scene.rig, np.array(plan.rig.up), "plan", rng)
    corners = plan.board.board.corners_mm
    seen: dict[str, list[np.ndarray]] = {"left": [], "right": []}
    for sheet in sheets:
        for name, camera in scene.rig.cameras.items():
            pixels = camera.project(sheet.place_mm(corners))
            pixels[~camera.sees(pixels)] = np.nan
            seen[name].append(pixels + BOARD_NOISE_PX * rng.standard_normal(pixels.shape))
    size = scene.rig.left.size_px
    return calibrate_from_corners([corners] * len(sheets), seen["left"], seen["right"], size).rig


def observed(scene: Scene, rig: Rig, rng: np.random.Generator) -> Observations:
    """See every target's centre with pixel noise, and triangulate it by the calibrated rig."""
    moments, targets = scene.moments, scene.plan.targets
    places = np.array([scene.corners_mm(row).mean(axis=1) for row in range(len(scene))])
    n_rows, n_targets = places.shape[:2]
    pixels = np.concatenate([camera.project(places.reshape(-1, 3)) for camera in scene.rig.cameras.values()], axis=1)
    pixels += NOISE_PX * rng.standard_normal(pixels.shape)
    points = points_from_pixels(rig, pixels)
    by_point = project_to_both(rig, points).by_point
    covariance = np.linalg.inv(by_point.transpose(0, 2, 1) @ by_point) * NOISE_PX**2
    row = np.repeat(np.arange(n_rows), n_targets)
    columns: dict[str, object] = {
        "line": [moments.line[number] for number in row],
        "repeat": np.array([moments.repeat[number] for number in row], dtype=np.float64),
        "carrier": [target.carrier for target in targets] * n_rows,
        "target": [str(target.id) for target in targets] * n_rows,
    }
    offset = np.tile(np.array([target.offset_mm for target in targets]), (n_rows, 1))
    for number, axis in enumerate("xyz"):
        columns[axis] = moments.q_mm[row, number]
        columns[f"t{axis}"] = offset[:, number]
        columns[f"m{axis}"] = points[:, number]
    for name, (i, j) in {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}.items():
        columns[f"c{name}"] = covariance[:, i, j]
    return observations_from_columns(columns)


def places_of(scene: Scene) -> np.ndarray:
    """Give the corners, the middles of edges and faces, and the centre; not the origin, where the error is 0."""
    ends = [scene.plan.machine.axes[axis].range_mm for axis in "xyz"]
    grid = np.meshgrid(*(np.linspace(low, high, 3) for low, high in ends), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 3)[1:]


def budgets_of(scene: Scene, rng: np.random.Generator, kinds: tuple[str, ...] = (CHOSEN, GIVEN)) -> dict[str, Budget]:
    """Calibrate, measure, fit, and make the budgets."""
    rig = calibrated(scene, rng)
    observations = observed(scene, rig, rng)
    options = {CHOSEN: FitOptions(threads=1), GIVEN: FitOptions(threads=1, bases=given_bases(scene))}
    budgets = {}
    for kind in kinds:
        fitted = fit_terms(
            scene.plan.machine,
            (observations,),
            options=options[kind],
            rig_sensitivity=sensitivity_of_points(rig, observations.measured_mm),
            rig_covariance=rig.covariance,
        )
        budgets[kind] = uncertainty_budget(result_of(fitted), places_of(scene), rig=rig, implementation=CARRIED_OUT)
    return budgets


def given_bases(scene: Scene) -> dict[str, BasisSpec]:
    """Give all 18 functions cubic splines with the same number of knots."""
    bases = {}
    for name in LINEAR_AND_ANGULAR:
        axis = name[2].lower()
        knots = np.linspace(*scene.plan.machine.axes[axis].range_mm, N_KNOTS)
        bases[name] = BasisSpec("bspline", axis, knots_mm=tuple(knots.tolist()), degree=3)
    return bases


def compared(seed: int) -> dict[str, Outcome]:
    """Hold one machine's budgets against its true errors."""
    scene, rng = scene_of(seed), np.random.default_rng([seed, 30])
    budgets = budgets_of(scene, rng)
    return {kind: outcome(scene, budget, np.random.default_rng([seed, 31])) for kind, budget in budgets.items()}


def outcome(scene: Scene, budget: Budget, rng: np.random.Generator) -> Outcome:
    """Hold one budget against the truth."""
    machine = VirtualMachine(scene.plan.machine, scene.gauged.errors)
    places, predictor = budget.q_mm, budget.predictor
    no_offset = np.zeros(3)
    predicted = predictor.error_mm(places) - (machine.tool_from_work(places, no_offset) - places)
    command = places
    for _ in range(_ROUNDS):
        command = places - predictor.error_mm(command)
    stops = np.round(command, 4) + REPEATABILITY_UM * 1e-3 * rng.standard_normal(places.shape)
    part = machine.tool_from_work(stops, no_offset) - places
    shares = {one.name: float(np.mean(one.share)) for one in budget.contributions("part")}
    return Outcome(_held(budget, predicted, "prediction"), _held(budget, part, "part"), shares)


def _held(budget: Budget, error_mm: np.ndarray, of: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    error = np.column_stack([error_mm, np.linalg.norm(error_mm, axis=1)]) * 1e3
    std = np.column_stack([budget.standard_um(of), budget.standard_length_um(of)])  # type: ignore[arg-type]
    wide = np.column_stack([budget.expanded_um(of), budget.expanded_length_um(of)])  # type: ignore[arg-type]
    return error, std, wide


def table(outcomes: list[dict[str, Outcome]]) -> list[str]:
    """Give the lines of the table of coverage."""
    lines = [
        "| | | true error, rms | stated u, rms | ratio | within U, components | within U, length |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind in (GIVEN, CHOSEN):
        for name, what in (("prediction", "predicted error"), ("part", "compensated part")):
            rows = [getattr(outcome[kind], name) for outcome in outcomes]
            error = math.sqrt(np.mean([row[0][:, 3] ** 2 for row in rows]))
            std = math.sqrt(np.mean([row[1][:, 3] ** 2 for row in rows]))
            inside = np.array([np.abs(row[0]) <= row[2] for row in rows])
            by_component, by_length = inside[:, :, :3].mean(axis=(1, 2)), inside[:, :, 3].mean(axis=1)
            lines.append(
                f"| {kind} | {what} | {error:.2f} µm | {std:.2f} µm | {error / std:.2f} | {_share(by_component)} "
                f"| {_share(by_length)} |"
            )
    return lines


def _share(by_machine: np.ndarray) -> str:
    spread = 200.0 * float(np.std(by_machine, ddof=1)) / math.sqrt(len(by_machine))
    return f"{100 * by_machine.mean():.1f} ± {spread:.1f} %"


def monte_carlo(budget: Budget, n_refits: int) -> list[str]:
    """Give the lines that compare propagation, Supplement 1 and exact refits for one machine."""
    chosen = budget.at_places(budget.q_mm[[-1, 12, 17, 7]])
    drawn = {of: propagate_distributions(chosen, of, seed=1, n_digits=2) for of in ("prediction", "part")}  # type: ignore[arg-type]
    refits = refit_with_noise(chosen, n_trials=n_refits, seed=1)
    lines = [
        "| place, mm | quantity | u, propagated | u, Supplement 1 | length below, propagated | Supplement 1 "
        "| u, exact refits | ratio |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row, name in enumerate(chosen.place_names):
        for of, found in drawn.items():
            std = chosen.standard_length_um(of)[row]  # type: ignore[arg-type]
            wide = chosen.expanded_length_um(of)[row]  # type: ignore[arg-type]
            refit = "| |"
            if of == "prediction":
                ratio, half = refits.ratio[row, 3], refits.ratio_half_width[row, 3]
                refit = f"{refits.std_um[row, 3]:.2f} | {ratio:.3f} ± {half:.3f} |"
            drawn_std, drawn_wide = found.std_um[row, 3], found.high_um[row, 3]
            lines.append(f"| {name} | {of} | {std:.2f} | {drawn_std:.2f} | {wide:.2f} | {drawn_wide:.2f} | {refit}")
    return [
        *lines,
        "",
        *(_agreement(of, found) for of, found in drawn.items()),
        "",
        f"Refits: {n_refits}, of what noise and calibration do; the ratio is to what is propagated for these.",
    ]


def _agreement(of: str, found: Propagated) -> str:
    """Say how many trials it took, and how far propagation and Supplement 1 are apart."""
    known = np.isfinite(found.difference_um)
    worst = float((found.difference_um[known] / found.tolerance_um[known]).max())
    stopped = "until" if found.is_stable else "and not yet so many that"
    return (
        f"- {of}: {found.n_trials:,} trials, {stopped} two digits of every u and of every end of an interval were "
        f"stable (Supplement 1, 7.9). Ends of intervals differ from propagation's by {worst:.2f} of half of the "
        "second digit at most (8.1: by 1)."
    )


def main() -> None:
    """Run the study and write its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--refits", type=int, default=500)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="seeds worked on at once")
    parser.add_argument("--output", type=Path, default=HERE / "budget.md")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    outcomes = []
    with ProcessPoolExecutor(arguments.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        for seed, outcome in zip(seeds, pool.map(compared, seeds), strict=True):
            outcomes.append(outcome)
            print(f"seed {seed} done", flush=True)
    first = seeds[0]
    budget = budgets_of(scene_of(first), np.random.default_rng([first, 30]), (GIVEN,))[GIVEN]
    given = [outcome[GIVEN] for outcome in outcomes]
    names = list(dict.fromkeys(name for outcome in given for name in outcome.shares))
    shares = {name: np.mean([outcome.shares.get(name, 0.0) for outcome in given]) for name in names}
    lines = [
        "# Does the uncertainty budget hold?",
        "",
        f"`python validation/budget.py --seeds {arguments.seeds} --first {arguments.first}`: {arguments.seeds} "
        f"virtual machines of {len(CHAINS)} chains, nine lines twice with {SETTING.n_points} points, {NOISE_PX} px "
        f"in each coordinate of both pictures, {BOARD_NOISE_PX} px in those of the calibration board, axes that stop "
        f"within {REPEATABILITY_UM:g} µm (standard deviation). 26 places of each volume; ± is twice the "
        "standard error over machines, since places of one machine share their errors.",
        "",
        *table(outcomes),
        "",
        f"The {REPEATABILITY_UM:g} µm of the stops are seen only where they stand out of the noise of the pictures; "
        "where they do not, a part's budget says that repeatability is not counted, and is too small by it.",
        "",
        "What a compensated part's variance consists of, mean over machines and places: "
        + ", ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items())
        + ".",
        "",
        f"## Propagation against Monte-Carlo, machine {first}",
        "",
        *monte_carlo(budget, arguments.refits),
        "",
        f"## The whole budget of machine {first}",
        "",
        "```",
        budget_text(budget.at_places(budget.q_mm[[8, 1, 12, 25]])).rstrip(),
        "```",
    ]
    write_text(arguments.output, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
