"""A wave that is asked for beside the 21 errors: their many knots follow it, and what they leave is another one."""

from __future__ import annotations

import numpy as np
import pytest

import geoerr
from geoerr.errors import InputFileError
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (300.0, 300.0, 300.0))
STD_MM = 2e-3
PERIOD_MM = 40.0


def lines_with_a_wave(seed: int, *, step_mm: float, amplitude_mm: float, lost_motion_mm: float = 0.0) -> Observations:
    """Lines of four targets along each axis, there and back and twice, on a machine with a scale error and a wave."""
    rng = np.random.default_rng(seed)
    ends = [(0, (0.0, 50.0, 40.0)), (0, (0.0, 250.0, 200.0)), (1, (50.0, 0.0, 40.0)), (1, (250.0, 0.0, 200.0))]
    ends += [(2, (50.0, 40.0, 0.0)), (2, (250.0, 200.0, 0.0))]
    rows, lines, direction = [], [], np.ones(3)
    for repeat in range(2):
        for number, (axis, base) in enumerate(ends):
            for way in (1, -1):
                direction[axis] = way
                for place in np.arange(0.0, 300.0 + step_mm / 2.0, step_mm)[::way]:
                    q = np.array(base)
                    q[axis] = place
                    wave = amplitude_mm * np.sin(2.0 * np.pi * q[0] / PERIOD_MM)
                    moved = q + np.array([2e-4 * q[0] + wave - 0.5 * lost_motion_mm * direction[0], 0.0, 1e-4 * q[2]])
                    for offset in ((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (0.0, 100.0, 0.0), (0.0, 0.0, 100.0)):
                        seen = moved + offset + STD_MM * rng.normal(size=3)
                        rows.append((*q, *offset, *seen, *direction, float(repeat)))
                        lines.append(f"L{number}")
    names = ("x", "y", "z", "tx", "ty", "tz", "mx", "my", "mz", "dir_x", "dir_y", "dir_z", "repeat")
    columns: dict[str, object] = dict(zip(names, np.array(rows).T, strict=True))
    columns |= {"line": lines, "carrier": ["tool"] * len(rows)}
    return observations_from_columns(columns | {f"s{axis}": np.full(len(rows), STD_MM) for axis in "xyz"})


def is_found(result: geoerr.FitResult, amplitude_mm: float) -> None:
    size, period = (result.model.parameter(f"periodic:x.{name}") for name in ("A", "P"))
    assert abs(size.value - amplitude_mm) < 5.0 * size.std < 0.1 * amplitude_mm
    assert abs(period.value - PERIOD_MM) < 5.0 * period.std < 0.02 * PERIOD_MM


@pytest.mark.parametrize("seed", range(4))
def test_it_is_found_at_once_as_when_it_is_added_later(seed: int) -> None:
    # 31 places: 24 knots follow four places a turn nearly, and what they leave has other periods.
    observations = lines_with_a_wave(seed, step_mm=10.0, amplitude_mm=0.02)
    at_once = geoerr.fit_model(MACHINE, observations, effects=["periodic:x"])
    is_found(at_once, 0.02)
    later = geoerr.add_effect(geoerr.fit_model(MACHINE, observations).model, observations, reference="periodic:x")
    is_found(later.result, 0.02)
    between = np.column_stack([np.linspace(3.0, 297.0, 99), np.full(99, 50.0), np.full(99, 40.0)])
    along = at_once.model.error_mm(between)[:, 0] - later.result.model.error_mm(between)[:, 0]
    assert np.ptp(along) < 2e-3


@pytest.mark.parametrize("effects", [["periodic:x"], ["periodic:x", "backlash:x"]])
def test_a_wave_with_a_harmonic_is_told_at_the_likeliest_of_its_periods(effects: list[str]) -> None:
    # Beside play that the model lacks, or not: steps of 5 mm see 40 mm and 5.7, 4.4, ... 1.7 alike.
    observations = lines_with_a_wave(0, step_mm=5.0, amplitude_mm=0.01, lost_motion_mm=0.02)
    period = geoerr.fit_model(MACHINE, observations, effects=effects).model.parameter("periodic:x.P")
    assert period.value == pytest.approx(PERIOD_MM, rel=0.03)


@pytest.mark.parametrize("reference", ["scale:x", "squareness:xy"])
def test_an_error_that_the_model_has_is_not_added_again(reference: str) -> None:
    observations = lines_with_a_wave(1, step_mm=50.0, amplitude_mm=0.0)
    model = geoerr.fit_model(MACHINE, observations).model
    with pytest.raises(InputFileError, match="is in the model already, among its errors of axes"):
        geoerr.add_effect(model, observations, reference=reference)
    with pytest.raises(InputFileError, match="is in the model already, among its errors of axes"):
        geoerr.fit_model(model, observations, effects=[reference])
