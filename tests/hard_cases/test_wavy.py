"""A few waves that many knots could follow are named, and added with few knots; what is smooth keeps its knots."""

import numpy as np
import pytest
from hidden_machine import LENGTH_MM, Noise, Plan, machine, measure, motion
from numpy.polynomial import Chebyshev

from geoerr.bases import basis_of, spline_over
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.change import add_effect
from geoerr.diagnose.notes import notes_of
from geoerr.fit import FitOptions, fit_model
from geoerr.fit.classic import on_basis
from geoerr.fit.wavy import _still_falls, follows_waves, without_waves
from geoerr.observations import Observations

PERIOD_MM = LENGTH_MM / 6.3


def observed(wave_um: float, *, second_um: float = 0.0, period_mm: float = PERIOD_MM) -> Observations:
    rng = np.random.default_rng(8)
    moved = motion(rng, Plan())
    phase = 2.0 * np.pi * moved.q[:, 0] / period_mm
    wave = wave_um * np.sin(phase + 0.4) + second_um * np.sin(2.0 * phase - 1.1)
    hidden = np.outer(wave, [1.0, 0.0, 0.0])
    hidden[:, 0] += 15.0 * np.sin(2.0 * np.pi * moved.q[:, 0] / (0.75 * LENGTH_MM) + 1.0)
    return measure(rng, moved, Noise(white=(3.0, 3.0, 4.0)), hidden)


def test_what_is_smooth_keeps_its_knots() -> None:
    result = fit_model(machine(), observed(0.0), options=FitOptions(threads=1))
    assert without_waves(result.fitted) is None


@pytest.mark.parametrize("seed", range(4))
def test_what_few_knots_leave_of_a_large_smooth_error_is_no_wave(seed: int) -> None:
    """Of polynomials of a hundred micrometres few knots leave some that go up and down."""
    rng = np.random.default_rng(seed)
    moved = motion(rng, Plan())
    errors = [Chebyshev(100.0 * rng.normal(size=13) / np.arange(1, 14), [0.0, LENGTH_MM]) for _ in range(3)]
    hidden = np.stack([error(q) for error, q in zip(errors, moved.q.T, strict=True)], axis=1)
    observations = measure(rng, moved, Noise(white=(1.0, 1.0, 1.0)), hidden)
    result = fit_model(machine(), observations, options=FitOptions(threads=1))
    assert without_waves(result.fitted) is None


@pytest.mark.parametrize("turns", [5.0, 5.5, 6.0, 8.0])
def test_a_wave_stays_until_there_are_two_knots_to_a_turn(turns: float) -> None:
    """What the bound between the two stands on."""
    q = np.sort(np.random.default_rng(0).uniform(5.0, 395.0, 200))
    for phase in np.linspace(0.0, np.pi, 7):
        wave = np.cos(2.0 * np.pi * turns * (q - q[0]) / np.ptp(q) + phase)

        def left_by(count: int, wave: np.ndarray = wave) -> float:
            columns = basis_of(spline_over("x", q, count)).evaluate(q)
            return float(((wave - columns @ np.linalg.lstsq(columns, wave, rcond=None)[0]) ** 2).sum())

        assert not _still_falls(left_by, spline_over("x", q, 11))


def test_waves_that_knots_follow_are_named_and_added_with_few_knots() -> None:
    observations = observed(8.0)
    result = fit_model(machine(), observations, options=FitOptions(threads=1))
    knots = {term.id: len(term.coefficients) for term in result.fitted.terms}
    plain = without_waves(result.fitted)
    assert plain is not None
    fewer = {term.id: len(term.coefficients) for term in plain if len(term.coefficients) < knots[term.id]}
    assert set(fewer) == {"EXX"}
    found = diagnose(result.fitted, threads=1).found
    assert [str(one.reference) for one in found] == ["periodic:x"]
    change = add_effect(result.model, observations, reference="periodic:x", threads=1)
    (added,) = [term for term in change.after.terms if term.id == "periodic:x"]
    for period in (*found[0].term.inner, *added.inner):
        assert period.value == pytest.approx(PERIOD_MM, abs=4.0 * period.std)
        assert period.std < 0.01 * PERIOD_MM
    assert {term.id: len(term.coefficients) for term in change.after.terms}["EXX"] == fewer["EXX"]


def test_knots_follow_long_waves_and_of_few_places_any() -> None:
    fitted = fit_model(machine(), observed(8.0), options=FitOptions(threads=1)).fitted
    (own,) = [term for term in fitted.terms if term.id == "EXX"]
    for n_places, is_followed in ((200, {5.0: True, 10.0: True, 30.0: False, 150.0: False}), (26, {150.3: True})):
        places = np.sort(np.random.default_rng(0).uniform(0.0, LENGTH_MM, n_places))
        many = on_basis(own, spline_over("x", places, 24))
        for count, expected in is_followed.items():
            assert follows_waves(many, count, {"x": places}) == expected


def test_a_large_wave_with_a_second_harmonic_is_named_at_its_period() -> None:
    """Few knots and a wave of one frequency would not do; with its second harmonic they do."""
    observations = observed(80.0, second_um=40.0)
    found = diagnose(fit_model(machine(), observations, options=FitOptions(threads=1)).fitted, threads=1).found
    assert [str(one.reference) for one in found] == ["periodic:x"]
    assert {parameter.name for parameter in found[0].term.coefficients} == {"A", "B", "A2", "B2"}
    (period,) = found[0].term.inner
    assert period.value == pytest.approx(PERIOD_MM, abs=4.0 * period.std)


def test_a_wave_that_even_few_knots_follow_is_no_silence() -> None:
    """Five turns and a half are half followed by eleven functions, and no wave is named beside them."""
    observations = observed(80.0, second_um=40.0, period_mm=LENGTH_MM / 5.5)
    fitted = fit_model(machine(), observations, options=FitOptions(threads=1)).fitted
    (said,) = notes_of(fitted, None, has_found=False)
    assert "held-out rows are off by" in said
    assert notes_of(fitted, None, has_found=True) == ()


def test_nothing_is_said_of_held_out_rows_where_nothing_is_hidden() -> None:
    fitted = fit_model(machine(), observed(0.0), options=FitOptions(threads=1)).fitted
    assert notes_of(fitted, None, has_found=False) == ()
