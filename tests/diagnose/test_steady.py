"""A machine that is kept warm: its temperature hardly changes, and what follows it is named as that of a cold one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hidden_machine import Motion, Noise, Numbers, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.result import result_of
from geoerr.observations import Observations, observations_from_columns

# Kelvins of the thermometer of a chamber that is kept at one temperature, for one of a bed that is heated.
CHANGES = 0.1


def growth(moved: Motion) -> Numbers:
    return np.outer(11.5e-6 * CHANGES * (moved.bed - 20.0) * moved.q[:, 1] * 1e3, [0.0, 1.0, 0.0])


def drift(moved: Motion) -> Numbers:
    return np.outer(5.0 * CHANGES * (moved.bed - 20.0), [0.0, 0.0, 1.0])


def tilt(moved: Motion) -> Numbers:
    """A frame that leans by the difference of two temperatures."""
    return np.outer(2e-6 * CHANGES * (moved.bed - moved.frame) * moved.q[:, 1] * 1e3 * 10.0, [1.0, 0.0, 0.0])


HIDDEN = {
    "thermal-expansion:y@temp_bed": growth,
    "thermal-drift:z@temp_bed": drift,
    "frame-tilt-thermal:xy@temp_bed-temp_frame": tilt,
}


def observed(name: str, bed_c: float, frame_c: float) -> Observations:
    """Give the same measurements with thermometers that show these temperatures where the machine was at 20."""
    rng = np.random.default_rng(3)
    moved = motion(rng, Plan(n_sessions=2))
    seen = measure(rng, moved, Noise(white=(2.0, 2.0, 2.0)), HIDDEN[name](moved))
    shown = seen.frame.with_columns(
        temp_bed=bed_c + CHANGES * (moved.bed - 20.0), temp_frame=frame_c + CHANGES * (moved.frame - 20.0)
    )
    return replace(seen, frame=shown)


@cache
def told(name: str, bed_c: float, frame_c: float) -> Diagnosis:
    observations = observed(name, bed_c, frame_c)
    fitted = fit_terms(machine(), [observations], options=FitOptions(threads=1))
    return diagnose(result_of(fitted).model, observations, threads=1)


@pytest.mark.parametrize("name", HIDDEN)
@pytest.mark.parametrize(("bed_c", "frame_c"), [(120.0, 70.0), (-60.0, 20.0)])
def test_the_answer_does_not_depend_on_how_warm_the_machine_is(name: str, bed_c: float, frame_c: float) -> None:
    """What it grew by before it was measured is its scale, its squareness and its place, which the model has."""
    cold, warm = told(name, 20.0, 20.0), told(name, bed_c, frame_c)
    assert str(cold.found[0].reference) == name
    assert [str(one.reference) for one in warm.found] == [str(one.reference) for one in cold.found]
    for one, other in zip(cold.found, warm.found, strict=True):
        assert other.worth_um == pytest.approx(one.worth_um, rel=1e-3)
        assert other.p_value == pytest.approx(one.p_value, rel=0.05)
        values, others = (
            {value.name: value for value in found.term.coefficients} for found in (one, other) if found.term
        )
        for key, value in values.items():
            assert others[key].value == pytest.approx(value.value, rel=1e-3)
            assert others[key].std == pytest.approx(value.std, rel=1e-2)


def test_a_model_without_a_scale_has_nothing_of_the_growth() -> None:
    """A rigid body grew by a hundred kelvins and a few: all of it is what its temperature did."""
    rng = np.random.default_rng(4)
    moved = motion(rng, Plan(n_sessions=1))
    warm_c = 120.0 + CHANGES * (moved.bed - 20.0)
    point = moved.q + np.outer(11.5e-6 * (warm_c - 20.0) * moved.q[:, 1], [0.0, 1.0, 0.0])
    measured = point + 2e-3 * rng.normal(size=point.shape)
    columns: dict[str, object] = {**moved.seen_from_the_tool, "t": moved.t, "temp_bed": warm_c}
    for index, name in enumerate("xyz"):
        columns |= {name: moved.q[:, index], f"t{name}": np.zeros(len(point)), f"m{name}": measured[:, index]}
    observations = observations_from_columns(columns)
    fitted = fit_terms(machine(), [observations], options=FitOptions(components="none", threads=1))
    found = diagnose(result_of(fitted).model, observations, threads=1).found
    assert [str(one.reference) for one in found] == ["thermal-expansion:y@temp_bed"]
    assert found[0].term is not None
    (alpha,) = found[0].term.coefficients
    assert abs(alpha.value - 11.5e-6) < 4.0 * alpha.std
    assert alpha.std < 0.02e-6, "of four kelvins it would be known twenty times less well"
