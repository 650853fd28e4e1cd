"""Do the stated 95 % intervals hold the truth 95 % of the time? From pictures, for many virtual machines.

    python validation/coverage.py            # 20 seeds, both carriages; writes validation/coverage.md

Each seed draws its own 21 errors, takes its own calibration and machine pictures (Li's Table 2 cameras: distortion,
blur, noise, 8 bit) and goes through calibrate, measure and identify as a user would. Every table position of every
function counts once, except the first, which is 0 by convention. The second carriage is 150 mm long: it breaks
Li's assumption that a carriage follows its guideway's tangent, and only the integrated straightness should suffer.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import tempfile
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

# As the command line does: its matrices are small, and pools of threads for them take the cores from the pictures.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from geoerr.error_functions import ErrorFunction, ErrorFunctions, Squareness
from geoerr.files import write_text
from geoerr.identify import NineLineResult, analyze_nine_lines
from geoerr.observations import Observations
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.session import simulate_session
from geoerr.vision.calibrate import calibrate
from geoerr.vision.measure import measure
from geoerr.vision.sensitivity import rig_sensitivity
from geoerr.vision.session import read_session

HERE = Path(__file__).parent
CARRIAGES = {"follows the tangent": "tangent", "150 mm long": "length"}
CARRIAGE_LENGTH_MM = 150.0
SETTING = NineLines(n_points=15, repeats=1, both_directions=False, board_views=20)
COVERAGE_95 = 1.959964

KINDS = {
    "positioning": ("EXX", "EYY", "EZZ"),
    "straightness": ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"),
    "pitch and yaw": ("EBX", "ECX", "EAY", "ECY", "EAZ", "EBZ"),
    "roll": ("EAX", "EBY", "ECZ"),
    "squareness": ("EC0Y", "EB0Z", "EA0Z"),
}
INTEGRATED = "straightness, integrated"


def identified(seed: int, carriage: str) -> tuple[NineLineResult, ErrorFunctions]:
    """Go from a seed to the identified errors and the truth, through pictures on disk."""
    setting = replace(SETTING, seed=seed, carriage=carriage, carriage_length_mm=CARRIAGE_LENGTH_MM)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session"
        truth = simulate_session(nine_line_plan(setting), path, threads=1)
        session = read_session(path)
        rig = calibrate(session, threads=1).rig
        observations: Observations = measure(session, rig, threads=1).observations
    result = analyze_nine_lines(
        observations,
        truth.errors.machine,
        rig_sensitivity=rig_sensitivity(rig, observations),
        rig_covariance=rig.covariance,
    )
    return result, truth.errors


def deviations(found: ErrorFunction | Squareness, true: ErrorFunction | Squareness) -> tuple[np.ndarray, np.ndarray]:
    """Give error (mm or rad) and stated standard uncertainty of each counted value."""
    if isinstance(found, Squareness) and isinstance(true, Squareness):
        return np.array([found.value_rad - true.value_rad]), np.array([found.std_rad])
    assert isinstance(found, ErrorFunction)
    assert isinstance(true, ErrorFunction)
    assert found.std is not None
    counts = found.std > 0.0
    return (found.value - true.at(found.position_mm))[counts], found.std[counts]


class Tally:
    """Errors and standard uncertainties of one kind, pooled."""

    def __init__(self) -> None:
        self.errors: list[np.ndarray] = []
        self.stds: list[np.ndarray] = []
        self.shares: list[float] = []

    def add(self, error: np.ndarray, std: np.ndarray) -> None:
        """Take in the values of one function of one seed."""
        self.errors.append(error)
        self.stds.append(std)
        self.shares.append(float(np.mean(np.abs(error) <= COVERAGE_95 * std)))

    def row(self, kind: str, unit: str, factor: float) -> str:
        """Give the line of the table; the band is two standard errors of the share over functions and seeds."""
        error, std = np.concatenate(self.errors), np.concatenate(self.stds)
        share = 100.0 * float(np.mean(np.abs(error) <= COVERAGE_95 * std))
        spread = 200.0 * float(np.std(self.shares, ddof=1)) / math.sqrt(len(self.shares))
        rms = factor * float(np.sqrt(np.mean(error**2)))
        stated = factor * float(np.sqrt(np.mean(std**2)))
        z_rms = float(np.sqrt(np.mean((error / std) ** 2)))
        return (
            f"| {kind} | {len(error)} | {rms:.2f} {unit} | {stated:.2f} {unit} | {z_rms:.2f} "
            f"| {share:.1f} ± {spread:.1f} % |"
        )


def study(carriage: str, seeds: range, pool: ProcessPoolExecutor) -> list[str]:
    """Run all seeds for one kind of carriage; give the lines of its table."""
    tallies: dict[str, Tally] = defaultdict(Tally)
    verdicts: list[bool] = []
    for seed, (result, truth) in zip(seeds, pool.map(identified, seeds, [carriage] * len(seeds)), strict=True):
        errors = result.errors
        tables = {**errors.functions, **errors.squareness}
        true_tables = {**truth.functions, **truth.squareness}
        for kind, names in KINDS.items():
            for name in names:
                tallies[kind].add(*deviations(tables[name], true_tables[name]))
        for name, table in errors.alternatives["straightness-integrated"].items():
            tallies[INTEGRATED].add(*deviations(table, true_tables[name]))
        verdicts += [verdict.p_value is not None and verdict.p_value < 0.01 for verdict in result.tangent]
        print(f"{carriage}: seed {seed} done", flush=True)
    lines = [
        "| kind | values | rms error | stated | rms of error / stated | truth within 95 % |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for kind in (*KINDS, INTEGRATED):
        is_length = kind == "positioning" or kind.startswith("straightness")
        lines.append(tallies[kind].row(kind, "µm" if is_length else "µrad", 1e3 if is_length else 1e6))
    said = f"{sum(verdicts)} of {len(verdicts)}"
    lines += ["", f"geoerr says of {said} straightnesses that the carriage does not follow the tangent (p < 0.01)."]
    return lines


def main() -> None:
    """Run the study and write its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="seeds worked on at once")
    parser.add_argument("--output", type=Path, default=HERE / "coverage.md")
    arguments = parser.parse_args()
    seeds = range(1, arguments.seeds + 1)
    lines = [
        "# Coverage of the stated 95 % intervals, from pictures",
        "",
        f"`python validation/coverage.py --seeds {arguments.seeds}`: {arguments.seeds} virtual machines, "
        f"{SETTING.n_points} points a line, calibration and pictures of its own for each.",
    ]
    with ProcessPoolExecutor(arguments.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        for title, carriage in CARRIAGES.items():
            lines += ["", f"## Carriage {title}", "", *study(carriage, seeds, pool)]
    write_text(arguments.output, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
