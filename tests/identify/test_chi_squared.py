"""The tail of the chi-squared distribution against SciPy."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from geoerr.identify.chi_squared import chi_squared_p_value


@given(st.floats(1.0, 5000.0), st.floats(-8.0, 12.0))
def test_agrees_with_scipy(dof: float, deviations: float) -> None:
    value = max(dof + deviations * math.sqrt(2.0 * dof), 0.0)
    expected = float(chi2.sf(value, dof))
    assert chi_squared_p_value(value, dof) == pytest.approx(expected, rel=1e-9, abs=1e-13)


def test_ends() -> None:
    assert chi_squared_p_value(0.0, 3.0) == 1.0
    assert chi_squared_p_value(1e4, 3.0) == 0.0
    assert math.isnan(chi_squared_p_value(1.0, 0.0))
