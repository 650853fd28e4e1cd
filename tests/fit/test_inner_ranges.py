"""Inner parameters stay inside their ranges: beyond them a formula need not mean anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geoerr.effects import catalogue
from geoerr.effects.effect import LAG_RANGE_S
from geoerr.fit import FitOptions, Fitted, fit_terms, refit, solve
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns
from geoerr.terms import Term

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
STD_MM = 1e-3
N = 240
T_S = 30.0 * np.arange(N)
SENSOR = 20.0 + 30.0 * (1.0 - np.exp(-T_S / 1500.0)) * (T_S < 3600.0) + 8.0 * np.sin(T_S / 400.0)


def at_once() -> np.ndarray:
    return SENSOR - 20.0


def summed_up() -> np.ndarray:
    """A body so slow that it only sums up what flows into it."""
    return np.cumsum(SENSOR - 20.0) * 30.0 / 40_000.0


def measured(growth: np.ndarray) -> Observations:
    rng = np.random.default_rng(5)
    seen = np.zeros((N, 3))
    seen[:, 2] = 2e-3 * growth
    seen += rng.normal(0.0, STD_MM, seen.shape)
    columns: dict[str, object] = {"t": T_S, "temp_bed": SENSOR, "carrier": ["relative"] * N}
    columns |= {name: np.zeros(N) for name in "xyz"}
    columns |= {f"m{name}": seen[:, number] for number, name in enumerate("xyz")}
    columns |= {f"s{name}": np.full(N, STD_MM) for name in "xyz"}
    return observations_from_columns(columns)


def lagged(start_s: float | None = None) -> Term:
    term = catalogue()["thermal-drift"].term("z", "temp_bed", MACHINE, lagged=True)
    return term if start_s is None else term.with_values(inner=[start_s])


def fitted(observations: Observations, *terms: Term) -> Fitted:
    return fit_terms(MACHINE, [observations], effects=terms, options=FitOptions(components="none", threads=1))


@pytest.mark.parametrize(
    ("growth", "end_s", "start_s"),
    [
        (at_once, LAG_RANGE_S[0], None),
        (at_once, LAG_RANGE_S[0], 20.0),
        (summed_up, LAG_RANGE_S[1], None),
        (summed_up, LAG_RANGE_S[1], 5000.0),
    ],
)
def test_a_lag_that_would_leave_its_range_ends_at_the_end(
    growth: Callable[[], np.ndarray], end_s: float, start_s: float | None
) -> None:
    """And all else is as if it were known to be that."""
    result = fitted(measured(growth()), lagged(start_s))
    term = result.terms[0]
    assert result.solved.converged
    assert term.inner[0].value == pytest.approx(end_s, rel=1e-9)
    fixed = replace(term, inner=(replace(term.inner[0], low=end_s, high=end_s, value=end_s),))
    known = refit(result, [fixed])
    assert term.coefficients[0].value == pytest.approx(known.terms[0].coefficients[0].value, rel=1e-6)
    assert term.coefficients[0].std == pytest.approx(known.terms[0].coefficients[0].std, rel=1e-6)
    assert result.held_out.residual_mm == pytest.approx(known.held_out.residual_mm, abs=1e-9, nan_ok=True)


def test_a_lag_inside_its_range_is_found_from_either_side() -> None:
    truth_s = 300.0
    follows = np.zeros(N)
    keep = np.exp(-30.0 / truth_s)
    for row in range(1, N):
        # Exact for a sensor that rises in straight lines from row to row.
        slope = (SENSOR[row] - SENSOR[row - 1]) / 30.0
        start, end = SENSOR[row - 1] - 20.0, SENSOR[row] - 20.0
        follows[row] = end - slope * truth_s + (follows[row - 1] - start + slope * truth_s) * keep
    observations = measured(follows)
    for start_s in (None, 100.0, 1000.0):
        result = fitted(observations, lagged(start_s))
        lag = result.terms[0].inner[0]
        assert result.solved.converged
        assert abs(lag.value - truth_s) < 5.0 * lag.std


def test_a_model_that_nothing_holds_does_not_run_away() -> None:
    """One point, seen by cameras whose scale is said to follow a temperature: no residual and no figure is lost."""
    observations = measured(at_once())
    scale = catalogue()["rig-scale-thermal"].term(None, "temp_bed", MACHINE, lagged=True)
    known = replace(scale, inner=(replace(scale.inner[0], value=600.0, low=600.0, high=600.0),))
    bending = catalogue()["thermal-bending"].term("x", "temp_bed", MACHINE)
    result = fitted(observations, bending, known)
    assert np.isfinite(result.solved.chi_squared)
    assert result.held_out.figures is not None


def test_where_no_step_has_residuals_what_was_before_stands_unsettled(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def lost(*arguments: Any) -> float:
        calls.append(arguments)
        return float("nan") if len(calls) > 1 else cost(*arguments)

    cost = solve._cost
    monkeypatch.setattr(solve, "_cost", lost)
    result = fitted(measured(at_once()), lagged(20.0))
    assert len(calls) > 2
    assert not result.solved.converged
    assert result.terms[0].inner[0].value == pytest.approx(20.0)
    assert np.isfinite(result.solved.residual_mm).all()
