"""Short runs with nothing hidden: how often does a diagnosis name something? Ten passes of eleven places along X.

    python validation/short_runs.py > validation/short_runs.md

Noise of 1 µm from row to row, and besides it offsets of passes, a random walk over the run, or both. With blocks of
24 rows instead (`--rows-of-a-block 24`) the walk is faster than the noise model can follow.
"""

from __future__ import annotations

import argparse

import numpy as np
from laser_run import MACHINE, draw_laser_run

import geoerr.fit.noise_model as noise_of_diagnosis
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.fit import FitOptions, fit_terms

KINDS_UM = {"offsets of passes, 5 µm": (5.0, 0.0), "random walk, 5 µm": (0.0, 5.0), "both": (5.0, 5.0)}
N_REPEATS, N_PLACES = 5, 11


def diagnosed(seed: int, offset_um: float, walk_um: float) -> Diagnosis:
    rng = np.random.default_rng(seed)
    run = draw_laser_run(rng, n_repeats=N_REPEATS, n_places=N_PLACES, uneven_mm=20.0)
    n = len(run.x_mm)
    error_um = 0.08 * run.x_mm + offset_um * np.repeat(rng.normal(size=2 * N_REPEATS), N_PLACES)
    error_um += walk_um * np.cumsum(rng.normal(size=n)) / np.sqrt(n) + rng.normal(size=n)
    options = FitOptions(components="12", threads=1)
    return diagnose(fit_terms(MACHINE, [run.observed(error_um)], options=options), threads=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--rows-of-a-block", type=int)
    arguments = parser.parse_args()
    if arguments.rows_of_a_block:
        noise_of_diagnosis._LEAST_ROWS = arguments.rows_of_a_block
    print("# Short runs, nothing hidden\n\nMade by `python validation/short_runs.py`, which says what it does.\n")
    print("| besides 1 µm from row to row | runs | something named or unknown | p below 0.05 |")
    print("| --- | --- | --- | --- |")
    for name, (offset_um, walk_um) in KINDS_UM.items():
        found = [diagnosed(seed, offset_um, walk_um) for seed in range(arguments.seeds)]
        alarms = sum(one.verdict != "nothing-missing" for one in found)
        low = sum((one.p_value or 1.0) < 0.05 for one in found)
        print(f"| {name} | {len(found)} | {alarms} | {low} |", flush=True)


if __name__ == "__main__":
    main()
