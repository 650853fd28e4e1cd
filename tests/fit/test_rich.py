"""More data take nothing away: poses beside the lines, positions that were rounded twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fit_scenes import COVARIANCE_MM2, cubic_truth, fitted, lost, replaced
from virtual_machine import AXES, camera, machine_of, nine_lines, observe

from geoerr.fit import FitOptions, fit_model
from geoerr.fit.classic import positions_by_axis
from geoerr.fit.fit import Freedom

MACHINE = machine_of("wZbXYt")


@pytest.mark.parametrize("freedom", ["knots", "smooth"])
@pytest.mark.parametrize("n_poses", [1, 12])
def test_poses_beside_the_lines_leave_no_function_open(freedom: Freedom, n_poses: int) -> None:
    rng = np.random.default_rng(3)
    truth, lines = cubic_truth(rng), nine_lines(MACHINE)
    beside = [
        replace(move, parked_mm=tuple(place), q_mm=place[[AXES.index(move.axis)]], line=f"pose {number}")
        for number, place in enumerate(rng.uniform(20.0, 380.0, (n_poses, 3)))
        for move in [lines[number % len(lines)]]
    ]
    own = camera(rng)
    plain, more = (
        observe(MACHINE, truth, moves, {"0": own}, covariance_mm2=COVARIANCE_MM2, rng=np.random.default_rng(5))
        for moves in (lines, [*lines, *beside])
    )
    alone, together = (fitted(MACHINE, seen, bases=None, freedom=freedom) for seen in (plain, more))
    assert len(lost(alone)) == 0
    assert len(lost(together)) == 0


@pytest.mark.parametrize("step_mm", [1e-5, 1e-3, 0.02])
def test_positions_rounded_up_and_down_are_one_place(step_mm: float) -> None:
    rng = np.random.default_rng(4)
    truth, own = cubic_truth(rng), camera(rng)
    moves = [move for repeat in (0, 1) for move in nine_lines(MACHINE, repeat=repeat)]
    noise = np.random.default_rng(6)
    seen = observe(MACHINE, truth, moves, {"0": own}, covariance_mm2=COVARIANCE_MM2, rng=noise)
    # What was commanded is written in two ways; what was measured is the same.
    moved = seen.commanded_mm + step_mm * (seen.numbers("repeat") > 0.5)
    twice = replaced(seen, **dict(zip("xyz", moved.T, strict=True)))
    places_mm = rng.uniform(0.0, 400.0, (50, 3))
    models = [fit_model(MACHINE, table, options=FitOptions(threads=1)).model for table in (seen, twice)]
    assert [len(model.error_functions().not_determined) for model in models] == [0, 0]
    plain_mm, twice_mm = (model.error_mm(places_mm) for model in models)
    # A shift of commands is one of the errors, and moves knots by as little.
    assert np.abs(twice_mm - plain_mm).max() < 2.0 * step_mm + 0.005


def test_ends_stay_and_neighbours_that_are_near_beside_the_others_are_one() -> None:
    even = np.linspace(0.0, 400.0, 13)
    both = np.concatenate([np.round(even, 3), np.round(even - 4e-4, 3)])
    found = positions_by_axis(np.column_stack([both, both, np.zeros(26)]), 1e-5)
    assert found["x"] == pytest.approx(even, abs=2e-3)
    assert (found["x"][0], found["x"][-1]) == (both.min(), both.max())
    assert len(found["z"]) == 1
