"""The mean of states that leave different directions open, against least squares of all that they tell."""

from __future__ import annotations

import numpy as np
import pytest
from test_open_in_one_state import bed_machine, with_one_bed_target
from validation.hot_and_cold import observe

from geoerr.fit import FitOptions, fit_terms
from geoerr.states.common import estimate_of
from geoerr.states.mean import mean_of
from geoerr.terms import BasisSpec


def test_what_one_state_leaves_open_is_what_the_other_says() -> None:
    """Angles of y keep the cold state's values; what both tell is between them, and surer than in either."""
    hot = bed_machine(5)
    # The same machine twice, with noise of its own.
    cold, warm = (observe(hot, degc, 5) for degc in (20.0, 20.01))
    ranges = {axis: hot.machine.axes[axis].range_mm for axis in "xyz"}
    bases = {
        f"E{kind}{axis.upper()}": BasisSpec("polynomial", axis, degree=3, low_mm=low, high_mm=high)
        for axis, (low, high) in ranges.items()
        for kind in "XYZABC"
    }
    options = FitOptions(bases=bases, threads=1)
    fits = [fit_terms(hot.machine, [one], options=options) for one in (cold, with_one_bed_target(warm))]
    estimates = [estimate_of(fitted) for fitted in fits]
    mean = mean_of(fits, estimates)
    # Both are told in turn, so that the mean leaves nothing open, in either order.
    assert not mean.null_space.shape[1]
    turned = mean_of(fits[::-1], estimates[::-1])
    assert turned.values == pytest.approx(mean.values, rel=1e-6, abs=1e-12)
    place = {term.id: slice(4 * number, 4 * number + 4) for number, term in enumerate(fits[0].terms[:18])}
    std = np.sqrt(np.diag(mean.covariance))
    alone = np.sqrt(np.diag(estimates[0].covariance))
    for name in ("EAY", "EBY", "ECY"):
        own = place[name]
        assert (np.abs(mean.values[own] - estimates[0].parameters[own]) <= 3.0 * alone[own] + 1e-12).all()
        assert (std[own] <= 1.0001 * alone[own] + 1e-15).all()
    for name in ("EXX", "EZZ"):
        own = place[name]
        assert (std[own][1:] < 0.8 * alone[own][1:]).all()
    # Twice the same state is that state, with half its variance; what it leaves open stays open.
    twice = mean_of([fits[1]] * 2, [estimates[1]] * 2)
    told = np.flatnonzero(np.abs(twice.null_space).max(axis=1) < 1e-9)
    assert twice.null_space.shape[1] == fits[1].null_space.shape[1] > 0
    assert twice.values[told] == pytest.approx(estimates[1].parameters[told], rel=1e-6, abs=1e-12)
    assert np.diag(twice.covariance)[told] == pytest.approx(
        0.5 * np.diag(estimates[1].covariance)[told], rel=1e-5, abs=1e-18
    )
