"""Whether what is added lags is weighed against the noise, and not against what it does itself."""

import numpy as np
import polars as pl
import pytest

from geoerr.cli.fit_text import quality_in_words
from geoerr.fit import FitOptions, fit_model
from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

LENGTH_MM, PER_K, TAU_S, NOISE_MM = 500.0, 11.5e-6, 60.0, 5e-4
MACHINE = Machine("mill", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in "xyz"})


def run(tau_s: float, begin_s: float = 0.0) -> Observations:
    """A laser along x, there and back four times, while the room warms by 4 K and the screw follows.

    The room has been warming for `begin_s` at the first row.
    """
    rng = np.random.default_rng(2)
    there = np.linspace(0.0, LENGTH_MM, 26)
    x = np.tile(np.concatenate([there, there[::-1]]), 4)
    t = 6.0 * np.arange(len(x))
    fine = np.arange(0.0, begin_s + t[-1] + 6.0, 0.1)
    # A room that warms, and whose thermostat swings.
    warmer = 4.0 * (1.0 - np.exp(-fine / 600.0)) + 0.15 * np.sin(2.0 * np.pi * fine / 200.0)
    late = warmer.copy()
    for step in range(1, len(fine) if tau_s else 0):
        late[step] = late[step - 1] + 0.1 / tau_s * (warmer[step - 1] - late[step - 1])
    seen = slice(round(10.0 * begin_s), None, 60)
    warmer, late = warmer[seen][: len(x)], late[seen][: len(x)]
    measured = x + PER_K * late * (x - 50.0) + NOISE_MM * rng.normal(size=len(x))
    columns: dict[str, object] = {
        "carrier": ["relative"] * len(x),
        "t": t,
        "temp": 20.0 + warmer,
        "x": x,
        "mx": measured,
    }
    columns |= {"y": np.full(len(x), 200.0), "z": np.full(len(x), 100.0), "repeat": np.repeat(np.arange(4), 52)}
    return observations_from_columns(columns)


def test_a_lag_of_what_is_large_is_taken_and_none_where_none_is() -> None:
    """Six micrometres of growth, taken for noise, hid that a swing of a sixth of a kelvin came a minute late."""
    effect, options = "thermal-expansion:x@temp", FitOptions(components="12", threads=1)
    late = fit_model(MACHINE, run(TAU_S), effects=effect, options=options).model
    tau, alpha = (late.parameter(f"{effect}.{name}") for name in ("tau", "alpha"))
    assert abs(tau.value - TAU_S) < 4.0 * tau.std < TAU_S
    assert abs(alpha.value - PER_K) < 4.0 * alpha.std
    at_once = fit_model(MACHINE, run(0.0), effects=effect, options=options).model
    assert [one.name for term in at_once.terms if term.id == effect for one in term.inner] == ["q_fixed"]
    plain = at_once.parameter(f"{effect}.alpha")
    assert abs(plain.value - PER_K) < 4.0 * plain.std


@pytest.mark.parametrize("tau_s", [0.0, TAU_S])
def test_a_thermometer_that_was_silent_says_nothing_of_that_time(tau_s: float) -> None:
    """Rows without a temperature counted as rows without growth: a lag of three hours, and the other sign."""
    whole = run(tau_s)
    silent = pl.col("t").is_between(400.0, 700.0)
    gap = Observations(whole.frame.with_columns(temp=pl.when(silent).then(None).otherwise(pl.col("temp"))))
    effect, options = "thermal-expansion:x@temp", FitOptions(components="12", threads=1)
    found = fit_model(MACHINE, gap, effects=effect, options=options).model
    alpha = found.parameter(f"{effect}.alpha")
    assert abs(alpha.value - PER_K) < 4.0 * alpha.std < 0.2 * PER_K
    has_lag = "tau" in [one.name for term in found.terms if term.id == effect for one in term.inner]
    assert has_lag is (tau_s > 0.0)
    if has_lag:
        tau = found.parameter(f"{effect}.tau")
        assert abs(tau.value - tau_s) < 4.0 * tau.std


@pytest.mark.parametrize(("begin_s", "is_told"), [(0.0, False), (200.0, True)])
def test_a_measurement_that_begins_while_it_warms_says_so(begin_s: float, is_told: bool) -> None:
    """A lag counts as settled at the first row, as it is before the heater is switched on."""
    effect, options = "thermal-expansion:x@temp", FitOptions(components="12", threads=1)
    fitted = fit_model(MACHINE, run(150.0, begin_s), effects=effect, options=options).fitted
    assert any(one.name == "tau" for term in fitted.terms for one in term.inner)
    said = [sentence for sentence in quality_in_words(fitted) if "counts as settled" in sentence]
    assert bool(said) is is_told
    if is_told:
        # By what is missing, and not by the noise: more than its standard error says.
        alpha = next(one for term in fitted.terms if term.id == effect for one in term.coefficients)
        assert abs(alpha.value - PER_K) > 4.0 * alpha.std
