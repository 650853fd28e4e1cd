"""Chi-squared, F and Student's t against `scipy.stats`, to the last digits and at the ends."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from geoerr import distributions
from geoerr.diagnose.circles.bench import Null as NullOfCircles
from geoerr.diagnose.null import Null
from geoerr.distributions import never_zero
from geoerr.model.fit_words import lack_of_fit_words
from geoerr.summaries import p_text, p_words

VALUES = np.array([-1.0, 0.0, 1e-9, 0.3, 1.0, 2.5, 40.0, 900.0, 1e5, np.inf, np.nan])
PROBABILITIES = np.array([0.0, 1e-12, 1e-4, 0.05, 0.5, 0.975, 1.0, np.nan])
DOFS = np.array([0.0, 0.5, 1.0, 2.0, 7.0, 150.0, 3e4])[:, None]
OTHER_DOFS = np.array([1.0, 4.0, 60.0, 1e9])[:, None, None]


def agree(own: np.ndarray, other: np.ndarray) -> None:
    np.testing.assert_allclose(own, other, rtol=1e-12)


def test_chi_squared() -> None:
    agree(distributions.chi_squared_sf(VALUES, DOFS), stats.chi2.sf(VALUES, DOFS))
    agree(distributions.chi_squared_isf(PROBABILITIES, DOFS), stats.chi2.isf(PROBABILITIES, DOFS))
    agree(distributions.chi_squared_ppf(PROBABILITIES, DOFS), stats.chi2.ppf(PROBABILITIES, DOFS))


def test_f() -> None:
    agree(distributions.f_sf(VALUES, DOFS, OTHER_DOFS), stats.f.sf(VALUES, DOFS, OTHER_DOFS))
    agree(distributions.f_isf(PROBABILITIES, DOFS, OTHER_DOFS), stats.f.isf(PROBABILITIES, DOFS, OTHER_DOFS))


def test_student() -> None:
    dofs = np.array([0.0, 1.0, 3.5, 80.0, np.inf])[:, None]
    between = PROBABILITIES[1:-2]
    agree(distributions.student_isf(between, dofs), stats.t.isf(between, dofs))


@pytest.mark.parametrize("dof", [0.5, 3.0, 400.0])
def test_logarithms(dof: float) -> None:
    values = VALUES[1:-2]
    agree(distributions.chi_squared_log_sf(values, dof), stats.chi2.logsf(values, dof))
    agree(distributions.f_log_sf(values, dof, 9.0), stats.f.logsf(values, dof, 9.0))


def test_ranks() -> None:
    values = np.random.default_rng(3).integers(0, 9, 40)
    agree(distributions.ranks_of(values), stats.rankdata(values))


def test_nothing_loads_what_takes_as_long_as_a_fit() -> None:
    code = "import geoerr.diagnose, geoerr.farm.job, sys; print({'scipy.stats', 'scipy.optimize'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_no_probability_is_told_as_0() -> None:
    assert never_zero(0.0) > 0.0
    assert never_zero(0.25) == 0.25
    assert p_text(never_zero(0.0)) == p_text(0.0) == "< 1e-300"
    assert p_words(0.0, 1) == "p < 1e-300"
    assert (p_text(4.4e-131, 1), p_words(0.034)) == ("4e-131", "p = 0.034")
    # Of a search: far beyond what any draw of noise shows.
    for null in (Null(np.linspace(1.0, 8.0, 119)), NullOfCircles(np.linspace(1.0, 8.0, 119))):
        assert 0.0 < null.p_value(5e4) < 1e-300
    # Of a fit: a residual a million times the noise.
    assert "(p < 1e-300)" in lack_of_fit_words(0.0, 12.0, is_from_repeats=True)
