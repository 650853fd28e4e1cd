"""What was found first stands in for what is found later, and is dropped again where nothing of it is left."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose import diagnose
from geoerr.fit import FitOptions, fit_terms
from geoerr.observations import Observations

COLD_C, FIXED_MM = 20.0, 200.0
GROWTH_PER_K = 8e-6
BED, FRAME, BETWEEN = (f"thermal-expansion:y@temp_{name}" for name in ("bed", "frame", "gantry"))


def grown_by_two_temperatures() -> Observations:
    """Y grows with the bed and with the frame; a thermometer between them reads their mean, and draughts of 3 K."""
    plan = Plan(n_sessions=2, n_lines=20, n_points=10, seconds=8.0)
    rng = np.random.default_rng(2)
    moved = motion(rng, plan)
    turns = 2.0 * np.pi * moved.t / moved.t[-1]
    moved.bed, moved.frame = 35.0 + 12.0 * np.sin(1.7 * turns), 30.0 + 12.0 * np.cos(2.6 * turns)
    plan.columns["temp_gantry"] = 0.5 * (moved.bed + moved.frame) + 3.0 * np.sin(5.3 * turns)
    warmth = moved.bed - COLD_C + moved.frame - COLD_C
    hidden = np.zeros_like(moved.q)
    hidden[:, 1] = 1e3 * GROWTH_PER_K * warmth * (moved.q[:, 1] - FIXED_MM)
    return measure(rng, moved, Noise(white=(2.5, 2.5, 2.5)), hidden, plan)


def beside(step: str) -> list[str]:
    """What was in the model when a round began, from what is told of it."""
    return step.partition(", beside ")[2].replace(" and ", ", ").split(", ")


def test_the_mean_of_two_temperatures_is_found_first_and_dropped_beside_both() -> None:
    fitted = fit_terms(machine(), [grown_by_two_temperatures()], options=FitOptions(threads=1))
    steps: list[str] = []
    diagnosis = diagnose(fitted, on_step=steps.append, threads=1)
    rounds = [beside(step) for step in steps if "without a name" in step]
    # What explains most by itself is found first, and then what it lacks; beside both it is in the model no more.
    first, second, last = rounds[-3:]
    assert first == [BETWEEN]
    assert second in ([BETWEEN, BED], [BETWEEN, FRAME])
    assert set(last) == {BED, FRAME}
    assert diagnosis.verdict == "missing"
    assert {str(one.reference) for one in diagnosis.found} == {BED, FRAME}
    assert BETWEEN not in diagnosis.sentence
    for one in diagnosis.found:
        alpha = one.term.coefficients[0]
        assert alpha.value == pytest.approx(GROWTH_PER_K, abs=4.0 * alpha.std)
        assert alpha.std < 0.06 * GROWTH_PER_K
