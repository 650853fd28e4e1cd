"""One component along one axis, there and back a few times, as a laser interferometer sees it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from geoerr.diagnose.diagnosis import Diagnosis, diagnose
from geoerr.fit import FitOptions, fit_terms
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine("bench", "wbXYZt", {axis: Axis((0.0, 400.0)) for axis in AXES}, tool_offset_mm=(0.0, 0.0, 0.0))
PLAY_UM, WAVE_UM, PERIOD_MM, NOISE_UM = 9.0, 3.0, 5.0, 0.3
N_REPEATS, N_PLACES = 5, 55


@cache
def _run() -> Observations:
    rng = np.random.default_rng(3)
    there = np.linspace(0.0, 400.0, N_PLACES) + np.append(rng.uniform(0.0, 5.0, N_PLACES - 1), 0.0)
    x = np.tile(np.concatenate([there, there[::-1]]), N_REPEATS)
    d = np.tile(np.repeat([1.0, -1.0], N_PLACES), N_REPEATS)
    error_um = 0.08 * x + WAVE_UM * np.sin(2.0 * np.pi * x / PERIOD_MM) - 0.5 * PLAY_UM * d
    n = len(x)
    return observations_from_columns(
        {
            "line": ["x"] * n,
            "repeat": np.repeat(np.arange(N_REPEATS, dtype=np.float64), 2 * N_PLACES),
            "carrier": ["relative"] * n,
            "x": x,
            "y": np.full(n, 200.0),
            "z": np.full(n, 100.0),
            **{f"t{axis}": np.zeros(n) for axis in AXES},
            "dir_x": d,
            "mx": x + 1e-3 * (error_um + NOISE_UM * rng.normal(size=n)),
        }
    )


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
