"""What is no unevenness along an axis has no name; an uneven wave, and a special case, keep their own."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hidden_machine import LENGTH_MM, Motion, Noise, Numbers, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.search.uneven import most_uneven
from geoerr.fit import FitOptions, fit_terms

REFERENCE_DEGC = 20.0


def diagnosed(hidden: Callable[[Motion], Numbers], seed: int) -> Diagnosis:
    rng = np.random.default_rng(seed)
    moved = motion(rng, Plan())
    observations = measure(rng, moved, Noise(offset=3.0), hidden(moved))
    return diagnose(fit_terms(machine(), [observations], options=FitOptions(threads=1)), threads=1)


def along_x(size_um: Numbers) -> Numbers:
    return np.outer(size_um, [1.0, 0.0, 0.0])


def wave_across(moved: Motion) -> Numbers:
    """Play that changes its sign along Y and back: no play of X, and no racking."""
    return along_x(-0.5 * 30.0 * moved.d[:, 0] * np.sin(2.0 * np.pi * moved.q[:, 1] / LENGTH_MM))


def squared(moved: Motion) -> Numbers:
    """A column that leans with the square of a temperature; the height is its lever."""
    warm = (moved.bed - REFERENCE_DEGC) / 30.0
    return along_x(200.0 * warm**2 * moved.q[:, 2] / LENGTH_MM)


def yaw_on_reversal(moved: Motion) -> Numbers:
    """X's carriage turns about z alone when it turns back; how far Y is out is the lever."""
    return along_x(-1e3 * 40e-6 * moved.d[:, 0] * moved.q[:, 1])


def worn_screw(moved: Motion) -> Numbers:
    """A wave of 8 mm that is larger where the gantry is far out."""
    size = 12.0 * (1.0 + 0.5 * (2.0 * moved.q[:, 1] / LENGTH_MM - 1.0))
    return along_x(size * np.sin(2.0 * np.pi * moved.q[:, 0] / 8.0 + 0.7))


@pytest.mark.parametrize(("hidden", "depends_on"), [(wave_across, {"d_x", "y"}), (squared, {"temp_bed"})])
def test_what_is_no_unevenness_has_no_name(hidden: Callable[[Motion], Numbers], depends_on: set[str]) -> None:
    found = diagnosed(hidden, 3)
    assert not found.found
    assert found.unknown is not None
    assert set(found.unknown.depends_on) == depends_on


def test_what_is_left_of_an_uneven_wave_is_told() -> None:
    found = diagnosed(worn_screw, 5)
    assert [str(one.reference) for one in found.found] == ["periodic:x"]
    assert found.unknown is not None
    assert (found.unknown.component, set(found.unknown.depends_on)) == ("x", {"x", "y"})


def test_a_tilt_about_one_axis_is_no_racking() -> None:
    """A gantry's racking can be as much, in one number more: it would grow with the place across."""
    found = diagnosed(yaw_on_reversal, 4)
    assert [str(one.reference) for one in found.found] == ["angular-reversal:x"]
    assert {one.name: one.value for one in found.found[0].term.coefficients} == {"c_z": pytest.approx(40e-6, rel=0.1)}
    racking = next(one for one in found.candidates if str(one.reference) == "gantry-racking:x")
    assert not racking.tied
    assert racking.aliases[0].correlation == pytest.approx(1.0, abs=1e-3)


def test_an_effect_that_explains_nothing_is_uneven_nowhere() -> None:
    searched = diagnosed(yaw_on_reversal, 4).searched
    settled = searched.found[0].settled
    assert settled.term is not None
    assert most_uneven(settled.space, settled) is not None
    nothing = replace(settled, term=settled.term.with_values([0.0], [], coefficients_std=[np.nan]))
    assert most_uneven(settled.space, nothing) is None
