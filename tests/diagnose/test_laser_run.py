"""Play and a wave in a run along one axis, there and back a few times, as a laser interferometer sees it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from validation.laser_run import MACHINE, draw_laser_run

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.fit import FitOptions, fit_terms
from geoerr.observations import Observations

PLAY_UM, WAVE_UM, PERIOD_MM, NOISE_UM = 9.0, 3.0, 5.0, 0.3
N_REPEATS, N_PLACES = 5, 55


@cache
def _run() -> Observations:
    rng = np.random.default_rng(3)
    run = draw_laser_run(rng, n_repeats=N_REPEATS, n_places=N_PLACES, uneven_mm=5.0)
    x = run.x_mm
    error_um = 0.08 * x + WAVE_UM * np.sin(2.0 * np.pi * x / PERIOD_MM) - 0.5 * PLAY_UM * run.direction
    return run.observed(error_um + NOISE_UM * rng.normal(size=len(x)))


@cache
def _diagnosis() -> Diagnosis:
    return diagnose(fit_terms(MACHINE, [_run()], options=FitOptions(components="12", threads=1)), threads=1)


@pytest.mark.parametrize(
    ("name", "parameter", "expected_um"),
    [("periodic:x", "A", WAVE_UM), ("backlash:x", "b", PLAY_UM)],
)
def test_play_of_ten_passes_is_no_offset_of_passes(name: str, parameter: str, expected_um: float) -> None:
    """Offsets as large as the play explain each pass for itself, but not that all of one sense agree to 0.05 µm."""
    found = {str(one.reference): one for one in _diagnosis().found}
    assert set(found) == {"periodic:x", "backlash:x"}
    value = next(one for one in found[name].parameters if one.name == parameter)
    assert abs(1e3 * value.value - expected_um) < 4.0 * 1e3 * value.std
    # Known as well as the noise allows that both leave, not the noise that one of them was found in.
    assert 1e3 * value.std < 3.0 * NOISE_UM / np.sqrt(N_REPEATS * N_PLACES)
