"""What every run finds again at a place is an error of the machine; what one run finds is a mistake."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.diagnose import compare
from geoerr.fit import fit_model
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 200.0))
TARGETS_MM = np.linspace(0.0, 400.0, 11)
N_RUNS = 5


def laser_run(
    extra_mm: np.ndarray, *, spread_mm: float = 0.0, has_repeat: bool = True, visits: int = 1
) -> tuple[Observations, np.ndarray]:
    """Run X five times both ways, noise 1 µm; `extra_mm` (5, 2, 11) is added, forwards and backwards.

    Returns the readings, and (n, 3) run, way and target of each.
    """
    rng = np.random.default_rng(4)
    which = np.array(
        [
            (run, way, target)
            for run in range(N_RUNS)
            for way in (0, 1)
            for target in range(11)[:: 1 - 2 * way]
            for _ in range(visits)
        ]
    )
    run, way, target = which.T
    sense = 1.0 - 2.0 * way
    x = TARGETS_MM[target] + rng.uniform(-spread_mm, spread_mm, len(run))
    columns = {"x": x, "y": 0.0 * x, "z": 0.0 * x, "dir_x": sense, "dir_y": 0.0 * x, "dir_z": 0.0 * x}
    columns["mx"] = x + 1e-3 * sense + extra_mm[run, way, target] + rng.normal(0.0, 1e-3, len(x))
    if has_repeat:
        columns["repeat"] = run.astype(np.float64)
    return observations_from_columns(columns | {"line": ["X"] * len(x)}), which


def set_aside(observations: Observations) -> tuple[list[int], list[int]]:
    """Rows that a fit, and a comparison with the machine without errors, leave out."""
    held = compare(Model(MACHINE), observations).points
    fitted = fit_model(MACHINE, observations, components="12").fitted
    return (
        np.flatnonzero(~fitted.solved.used).tolist(),
        np.flatnonzero(~held.solved.used).tolist(),
    )


@pytest.mark.parametrize("has_repeat", [True, False])
@pytest.mark.parametrize("spread_mm", [0.0, 1e-3])
def test_play_at_an_end_that_every_run_finds_is_kept(has_repeat: bool, spread_mm: float) -> None:
    extra = np.zeros((N_RUNS, 2, 11))
    extra[:, 0, 0] = 0.05
    observations, _ = laser_run(extra, spread_mm=spread_mm, has_repeat=has_repeat)
    assert set_aside(observations) == ([], [])


@pytest.mark.parametrize("target", [5, 10])
def test_a_target_that_is_off_in_every_run_is_kept(target: int) -> None:
    extra = np.zeros((N_RUNS, 2, 11))
    extra[:, :, target] = 0.1
    observations, _ = laser_run(extra)
    assert set_aside(observations) == ([], [])


def test_one_reading_that_its_sisters_speak_against_is_a_mistake() -> None:
    """Of both ways of a target one has it, in one run."""
    extra = np.zeros((N_RUNS, 2, 11))
    extra[2, 0, 4] = 0.1
    observations, which = laser_run(extra)
    (row,) = np.flatnonzero((which == [2, 0, 4]).all(axis=1)).tolist()
    assert set_aside(observations)[1] == [row]


def test_readings_of_one_visit_do_not_confirm_each_other() -> None:
    """A hand before the camera spoils both readings of a stop: in four other runs there was nothing."""
    extra = np.zeros((N_RUNS, 2, 11))
    extra[2, 0, 4] = 0.1
    observations, which = laser_run(extra, visits=2)
    rows = np.flatnonzero((which == [2, 0, 4]).all(axis=1)).tolist()
    assert set_aside(observations)[1] == rows
