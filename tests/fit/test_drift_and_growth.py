"""A drift of the cameras beside growth of the machine: the noise may have learnt the drift, and forgives it then."""

from __future__ import annotations

import numpy as np
import pytest
from fit_scenes import cubic_truth, measured_again, seen, there_and_back
from virtual_machine import camera, machine_of

from geoerr.diagnose import diagnose
from geoerr.fit import fit_model
from geoerr.observations import Observations

MACHINE = machine_of("wYbXZt")
TARGETS = {
    "tool": ((0.0, 0.0, 0.0), (90.0, 0.0, 10.0), (20.0, 80.0, 0.0)),
    "work": ((30.0, 20.0, 0.0), (150.0, 40.0, 0.0), (60.0, 140.0, 5.0)),
}
ALPHA_PER_K, FIXED_MM, DRIFT_MM = 11.5e-6, 40.0, np.array([0.03, -0.02, 0.04])
SECONDS_A_PLACE, HEATING_S, WARMING_S = 12.0, 500.0, 900.0


def warming(seed: int, across_mm: float) -> Observations:
    """Lines along each axis, there and back, three times, while the bed heats up; depth is less certain fourfold."""
    rng = np.random.default_rng(seed)
    rows, columns = there_and_back(TARGETS, (160.0, 110.0, 90.0), 9, 3)
    n_targets = sum(map(len, TARGETS.values()))
    t_s = SECONDS_A_PLACE * (1.0 + np.arange(len(rows)) // n_targets)
    temp_bed = 20.0 + 35.0 * (1.0 - np.exp(-t_s / HEATING_S))
    view = camera(rng)
    truth, covariance = cubic_truth(rng), np.diag([1.0, 1.0, 16.0]) * across_mm**2
    right = seen(MACHINE, truth, view, rows, rng, covariance_mm2=covariance, t=t_s, temp_bed=temp_bed, **columns)
    # Y carries the work, towards −y.
    grown = np.zeros((len(rows), 3))
    on_work = np.array([carrier == "work" for carrier, _, _ in rows])
    y = np.array([q[1] for _, q, _ in rows])
    grown[on_work, 1] = -(ALPHA_PER_K * (temp_bed - 20.0) * (y - FIXED_MM))[on_work]
    drift = (1.0 - np.exp(-t_s / WARMING_S))[:, None] * DRIFT_MM
    return measured_again(right, grown @ view.turn.T + drift)


@pytest.mark.parametrize("across_mm", [0.006, 0.009])
def test_what_is_found_later_does_not_do_what_a_drift_of_the_cameras_does(across_mm: float) -> None:
    observations = warming(3, across_mm)
    found = diagnose(fit_model(MACHINE, observations).model, observations).found
    assert {str(one.reference) for one in found} == {"camera-drift", "thermal-expansion:y@temp_bed"}
