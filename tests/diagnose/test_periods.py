"""Periods that places in even steps cannot tell apart are told together, and uneven steps tell them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from validation.laser_run import MACHINE, laser_run

from geoerr.cli.change_text import change_text
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.change import Change, add_effect
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.findings import Finding
from geoerr.fit import FitOptions, fit_model, fit_terms
from geoerr.fit.inner import other_periods
from geoerr.fit.periods import alike_periods, periods_to_try

PULLEY_MM, STEP_MM, N_REPEATS = 40.0, 10.0, 5


def _diagnosed(places_mm: np.ndarray) -> Diagnosis:
    rng = np.random.default_rng(7)
    run = laser_run(places_mm, N_REPEATS)
    error_um = 3.0 * np.sin(2.0 * np.pi * run.x_mm / PULLEY_MM) + 0.3 * rng.normal(size=len(run.x_mm))
    options = FitOptions(components="12", threads=1)
    return diagnose(fit_terms(MACHINE, [run.observed(error_um)], options=options), threads=1)


def test_a_pulley_seen_in_even_steps_is_told_with_what_it_may_be() -> None:
    found = _diagnosed(np.arange(0.0, 400.1, STEP_MM)).found
    assert [str(one.reference) for one in found] == ["periodic:x"]
    period = next(one for one in found[0].parameters if one.name == "P")
    assert period.value == pytest.approx(PULLEY_MM, abs=4.0 * period.std)
    # A cycle a step more or less is the same: 1/40 ± 1/10, and so on.
    others = found[0].alike["P"]
    for cycles in (1, 2, 3):
        for sign in (1.0, -1.0):
            same = 1.0 / abs(cycles / STEP_MM + sign / period.value)
            assert min(abs(one - same) for one in others) < 0.01 * same
    assert "uneven steps" in found[0].words()
    assert found[0].to_document()["parameters"]["P"]["alike"] == list(others)


def test_uneven_steps_tell_it() -> None:
    rng = np.random.default_rng(11)
    inner = np.arange(STEP_MM, 399.9, STEP_MM)
    found = _diagnosed(np.concatenate([[0.0], inner + rng.uniform(-4.0, 4.0, len(inner)), [400.0]])).found
    assert [str(one.reference) for one in found] == ["periodic:x"]
    period = next(one for one in found[0].parameters if one.name == "P")
    assert period.value == pytest.approx(PULLEY_MM, abs=4.0 * period.std)
    assert not found[0].alike
    assert "alike" not in found[0].to_document()["parameters"]["P"]


@given(step=st.floats(2.0, 30.0), period=st.floats(1.0, 150.0), start=st.floats(-200.0, 200.0))
def test_what_is_alike_is_the_same_wave_at_the_places(step: float, period: float, start: float) -> None:
    places = start + step * np.arange(31)
    wave = np.exp(2j * np.pi * places / period)
    for other in alike_periods(places, period, 0.5, 200.0):
        same = np.exp(2j * np.pi * places / other)
        # The same but for a phase, or turning the other way.
        assert max(abs(np.vdot(wave, same)), abs(np.vdot(wave.conj(), same))) > 0.95 * len(places)


@given(low=st.floats(0.5, 5.0), ratio=st.floats(2.0, 100.0), span=st.floats(10.0, 999.0))
def test_no_period_is_far_from_one_that_is_tried(low: float, ratio: float, span: float) -> None:
    high = low * ratio
    tried = 1.0 / np.array(periods_to_try(np.array([0.0, span]), low, high))
    # Within a quarter of a cycle over the range, wherever it lies.
    wanted = 1.0 / np.geomspace(low, high, 200)
    near = np.abs(tried[None, :] - wanted[:, None]).min(axis=1) * span
    assert near.max() <= 0.5 + 1e-6


def _added(places_mm: np.ndarray) -> Change:
    rng = np.random.default_rng(7)
    run = laser_run(places_mm, N_REPEATS)
    error_um = 3.0 * np.sin(2.0 * np.pi * run.x_mm / PULLEY_MM) + 0.3 * rng.normal(size=len(run.x_mm))
    observed = run.observed(error_um)
    model = fit_model(MACHINE, observed, options=FitOptions(components="12", threads=1)).model
    return add_effect(model, observed, reference="periodic:x", threads=1)


def test_a_wave_that_is_added_without_its_period_has_the_one_that_a_diagnosis_tells() -> None:
    """Any of forty periods explains the same: it was 0.889 mm."""
    change = _added(np.arange(0.0, 400.1, STEP_MM))
    period = change.after.terms[-1].inner[0]
    assert period.value == pytest.approx(PULLEY_MM, abs=4.0 * period.std)
    told = other_periods(change.after, change.after.terms[-1])["P"]
    assert told[:3] == pytest.approx([13.33, 8.0, 5.714], rel=1e-3)
    text = " ".join(" ".join(change_text(change)).split())
    assert "or 13.3" in text
    assert "which are the same at these places: measure in uneven steps" in text


def test_a_wave_that_is_added_in_uneven_steps_has_no_other_period() -> None:
    rng = np.random.default_rng(11)
    inner = np.arange(STEP_MM, 399.9, STEP_MM)
    change = _added(np.concatenate([[0.0], inner + rng.uniform(-4.0, 4.0, len(inner)), [400.0]]))
    period = change.after.terms[-1].inner[0]
    assert period.value == pytest.approx(PULLEY_MM, abs=4.0 * period.std)
    assert not other_periods(change.after, change.after.terms[-1])
    assert "which are the same" not in " ".join(change_text(change))
    # What is no wave has no period.
    assert not other_periods(change.after, change.after.terms[0])


def _of_few_places(seed: int, step_mm: float, n_places: int, uneven_mm: float) -> Diagnosis:
    """Diagnose a laser's run of a machine with a wave of 2 µm each 5 mm."""
    rng = np.random.default_rng(seed)
    places_mm = 10.0 + step_mm * np.arange(n_places) + rng.uniform(-uneven_mm, uneven_mm, n_places)
    run = laser_run(places_mm, N_REPEATS)
    error_um = 2.0 * np.sin(2.0 * np.pi * run.x_mm / 5.0) + 0.5 * rng.normal(size=len(run.x_mm))
    options = FitOptions(components="12", threads=1)
    return diagnose(fit_terms(MACHINE, [run.observed(error_um)], options=options), threads=1)


def _is_the_wave(found: Finding) -> bool:
    period = next(one for one in found.parameters if one.name == "P")
    return str(found.reference) == "periodic:x" and abs(period.value - 5.0) < 0.02


def test_periods_that_explain_few_places_as_well_are_told() -> None:
    """At places in nearly even steps a wave has images that few of them tell from it."""
    n_told = 0
    for seed in range(4):
        diagnosis = _of_few_places(seed, 15.8, 24, 1.0)
        for found in diagnosis.found:
            assert _is_the_wave(found)
            others = found.as_good.get("P", ())
            if others:
                assert "explain so few places as well: measure at more" in found.words()
                assert diagnosis.to_document()["found"][0]["parameters"]["P"]["as_good"] == list(others)
            n_told += bool(others)
    assert n_told >= 2


def test_a_wave_that_few_places_cannot_tell_has_no_name() -> None:
    """At sixteen uneven places 6 µm of 0.779 mm beside a cubic were as good as 2 µm of 10 mm, and certain."""
    named, nameless = 0, 0
    for seed in range(8):
        diagnosis = _of_few_places(seed, 25.0, 16, 7.5)
        for found in diagnosis.found:
            assert _is_the_wave(found)
            named += 1
        if diagnosis.unknown is not None:
            assert diagnosis.verdict == "unknown"
            assert diagnosis.unknown.depends_on == ("x",)
            assert any("measure x at places between these" in note for note in diagnosis.notes)
            nameless += 1
    assert named >= 3
    assert nameless >= 3
