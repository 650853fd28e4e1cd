"""An error of an axis whose freedom was too small is no effect; a wave that its splines cannot follow is one."""

import numpy as np
import pytest
from hidden_machine import LENGTH_MM, Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.fit import FitOptions, fit_terms
from geoerr.terms import BasisSpec

# Three intervals: what is smooth over a third of the axis is met to some micrometres.
COARSE = BasisSpec("bspline", "x", knots_mm=tuple(np.linspace(0.0, LENGTH_MM, 4).tolist()), degree=3)


CUBIC = BasisSpec("polynomial", "x", degree=3, low_mm=0.0, high_mm=LENGTH_MM)


def diagnosed(wave_um: float, basis: BasisSpec = COARSE) -> Diagnosis:
    rng = np.random.default_rng(4)
    moved = motion(rng, Plan())
    hidden = np.outer(wave_um * np.sin(2.0 * np.pi * moved.q[:, 0] / 20.0), [1.0, 0.0, 0.0])
    # An error of X that three intervals follow to 1 µm and six to a tenth of that.
    hidden[:, 0] += 15.0 * np.sin(2.0 * np.pi * moved.q[:, 0] / (0.75 * LENGTH_MM) + 1.0)
    observations = measure(rng, moved, Noise(white=(3.0, 3.0, 4.0)), hidden)
    return diagnose(
        fit_terms(machine(), [observations], options=FitOptions(bases={"EXX": basis}, threads=1)), threads=1
    )


@pytest.mark.parametrize("basis", [COARSE, CUBIC], ids=["splines", "polynomial"])
def test_too_few_functions_are_no_wave(basis: BasisSpec) -> None:
    found = diagnosed(0.0, basis)
    assert found.verdict == "nothing-missing"
    assert found.p_value == pytest.approx(found.searched.first.p_value)
    assert found.p_value > 0.01


def test_a_wave_that_no_spline_follows_is_named() -> None:
    diagnosis = diagnosed(4.0)
    found = diagnosis.found
    assert diagnosis.unknown is None
    assert [str(one.reference) for one in found] == ["periodic:x"]
    period = next(one for one in found[0].parameters if one.name == "P")
    assert period.value == pytest.approx(20.0, abs=4.0 * period.std)


def test_a_yaw_that_the_model_lacked_has_more_than_its_beginning() -> None:
    """A cubic is the beginning of an error of an axis: what it leaves is the rest of it, and takes no name away."""
    rng = np.random.default_rng(3)
    moved = motion(rng, Plan(n_sessions=2))
    x_mm, y_mm, _ = moved.q.T
    middle = np.exp(-(((x_mm - 200.0) / 150.0) ** 2))
    yaw = 30e-6 * np.sin(2.0 * np.pi * 3.2 * x_mm / LENGTH_MM) * middle
    hidden = np.outer(-1e3 * yaw * (y_mm - 200.0), [1.0, 0.0, 0.0])
    observations = measure(rng, moved, Noise(white=(3.0, 3.0, 3.0)), hidden)
    fitted = fit_terms(machine(), [observations], options=FitOptions(components="12", threads=1))
    diagnosis = diagnose(fitted, threads=1)
    assert {str(one.reference) for one in diagnosis.found} == {"angular:x", "angular:y"}
    assert diagnosis.unknown is None
