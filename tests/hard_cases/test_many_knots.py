"""A wave of two harmonics that many knots follow: beside either alone they would win, and it would have no name."""

import numpy as np
import pytest
from hidden_machine import LENGTH_MM, Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms
from geoerr.terms import BasisSpec

# Two knots a wave of 36 mm do not follow it; eight, which are tried, follow its second harmonic, too.
MANY = BasisSpec("bspline", "x", knots_mm=tuple(np.linspace(0.0, LENGTH_MM, 22).tolist()), degree=3)


def test_knots_that_follow_two_harmonics_are_held_against_both() -> None:
    """Against one of them they would win, and the wave would be taken for a smooth error."""
    rng = np.random.default_rng(5)
    moved = motion(rng, Plan())
    turns = 2.0 * np.pi * moved.q[:, 0] / 36.0
    hidden = np.outer(16.0 * np.sin(turns) + 8.0 * np.cos(2.0 * turns), [1.0, 0.0, 0.0])
    observations = measure(rng, moved, Noise(white=(3.0, 3.0, 4.0)), hidden)
    options = FitOptions(bases={"EXX": MANY}, threads=1)
    diagnosis = diagnose(fit_terms(machine(), [observations], options=options), threads=1)
    assert diagnosis.unknown is None
    assert [str(one.reference) for one in diagnosis.found] == ["periodic:x"]
    period = next(one for one in diagnosis.found[0].parameters if one.name == "P")
    assert period.value == pytest.approx(36.0, abs=4.0 * period.std)
