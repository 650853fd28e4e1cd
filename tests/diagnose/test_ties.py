"""What is tied: only what explains it about as well; and what was found later is tied as what was found first is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion
from test_diagnose_circles import MODEL, R_MM, circular
from validation.laser_run import LENGTH_MM, MACHINE, laser_run

from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.circles import diagnose_circles
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.ties import LEAST_DIFFERENCE, MOST_DIFFERENCE, is_as_good, z_by_noise, z_by_pieces
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, Fitted, fit_terms, refit
from geoerr.observations import Observations, observations_from_columns

GROWTH_PER_K, FIXED_MM = 17e-6, LENGTH_MM
PLAY_UM, DRIFT_UM_K = 60.0, 1.5
TWINS = {"thermal-drift:z@temp_bed", "thermal-drift:work-z@temp_bed"}


def _warming_run(seed: int = 0) -> Observations:
    """Run along X while a temperature wanders and the axis grows from its end at `FIXED_MM`."""
    rng = np.random.default_rng(seed)
    run = laser_run(np.sort(rng.uniform(0.0, LENGTH_MM, 90)), 3)
    n = len(run.x_mm)
    t_s = 20.0 * np.arange(n)
    temp_degc = 20.0 + t_s / 4000.0 + 3.0 * np.sin(t_s / 2500.0)
    grown_mm = GROWTH_PER_K * (temp_degc - 20.0) * (run.x_mm - FIXED_MM)
    return observations_from_columns(
        {
            "line": ["x"] * n,
            "repeat": run.repeat,
            "carrier": ["relative"] * n,
            "x": run.x_mm,
            "y": np.full(n, 200.0),
            "z": np.full(n, 100.0),
            **dict.fromkeys(("tx", "ty", "tz"), np.zeros(n)),
            "mx": run.x_mm + grown_mm + 1e-3 * rng.normal(size=n),
            "t": t_s,
            "temp": temp_degc + 0.05 * rng.normal(size=n),
        }
    )


@cache
def _fitted() -> Fitted:
    return fit_terms(MACHINE, [_warming_run()], options=FitOptions(components="12", threads=1))


def test_what_follows_an_effect_in_part_is_not_tied_with_it() -> None:
    """Noise that was estimated beside nothing is as large as the effect: in units of it all of it is hardly more."""
    diagnosis = diagnose(_fitted(), threads=1)
    names = {str(one.reference): one for one in diagnosis.candidates}
    first, other = diagnosis.found[0], names["thermal-bending:x@temp"]
    assert str(first.reference) == "thermal-expansion:x@temp"
    # It could do most of it, and helps little.
    assert first.aliases[0].reference == other.reference
    assert first.aliases[0].correlation > 0.8
    assert other.held_out_rmse_after_um > 3.0 * first.held_out_rmse_after_um
    assert [one.reference for one in diagnosis.tied] == [first.reference]
    assert diagnosis.verdict == "missing"


def test_that_only_a_combination_is_determined_is_said() -> None:
    """One component tells a bow in y from one in z in no way; their sum it follows."""
    term = catalogue()["thermal-bending"].term("x", "temp", MACHINE)
    fitted = refit(_fitted(), [*_fitted().terms, term])
    why = next(one.why for one in fitted.not_determined if one.name == term.id)
    assert why == "only a combination of kappa_y and kappa_z is determined"


@cache
def _two_effects() -> Diagnosis:
    """Play of Y, and a drift of Z that follows the bed: seen from the work, of the tool's body or of the work's."""
    rng = np.random.default_rng(5)
    moved = motion(rng, Plan(n_sessions=3, n_lines=20, n_points=16))
    hidden = np.zeros((len(moved.t), 3))
    hidden[:, 1] = -0.5 * PLAY_UM * moved.d[:, 1]
    hidden[:, 2] = DRIFT_UM_K * (moved.bed - 20.0)
    seen = measure(
        rng, moved, Noise(white=(4.0, 4.0, 4.0)), hidden, Plan(columns={"carrier": ["relative"] * len(moved.t)})
    )
    return diagnose(fit_terms(machine(), [seen], options=FitOptions(threads=1)), threads=1)


def test_a_later_find_is_tied_with_its_twin() -> None:
    diagnosis = _two_effects()
    assert [one.reference.effect for one in diagnosis.found[:2]] == ["backlash", "thermal-drift"]
    later = diagnosis.found[1]
    rivals = diagnosis.tied_with(later)
    assert {str(one.reference) for one in (later, *rivals)} >= TWINS
    assert diagnosis.tied_with(diagnosis.found[0]) == ()
    assert (diagnosis.verdict, later.tied, diagnosis.found[0].tied) == ("ambiguous", True, False)
    document = diagnosis.to_document()["found"][1]
    assert document["tied"]
    assert document["separate_by"]["text"]
    axes = {one["axis"] for one in document["aliases"] if one["tied"]}
    assert axes | {later.reference.axis} >= {"z", "work-z"}
    twin = next(one for one in rivals if str(one.reference) in TWINS)
    assert twin.worth_um == pytest.approx(later.worth_um, rel=1e-6)
    assert twin.separate_by == later.separate_by
    text = " ".join(" ".join(diagnosis_lines(diagnosis, "geoerr add m.json o.csv", "")).split())
    assert "Effects are missing, and these data cannot tell all of them: backlash" in text
    assert f"these data cannot tell it from: {twin.reference}" in text


def test_a_twin_of_a_later_find_is_worth_what_that_is() -> None:
    """It was a candidate in the first look, too; and beside its twin nothing of it is left."""
    diagnosis = _two_effects()
    later = diagnosis.found[1]
    (twin,) = [one for one in diagnosis.candidates if str(one.reference) in TWINS - {str(later.reference)}]
    assert twin.worth_um == pytest.approx(later.worth_um, rel=1e-6)
    assert twin.left_because == f"looks the same as {later.reference}"


def _play_that_winds_up(theta: np.ndarray, sense: int, feed: float) -> np.ndarray:
    """Y loses 12 µm when it turns round, and within 0.3 mm 16 more."""
    from_the_middle = R_MM * np.abs(np.sin(theta))
    moves = np.sign(sense * np.cos(theta))
    travelled = np.where(moves * np.sin(theta) < 0.0, R_MM - from_the_middle, R_MM + from_the_middle)
    along_y = -moves * (6.0 + 8.0 * (1.0 - np.exp(-travelled / 0.3)))
    return np.asarray(along_y * np.sin(theta))


def test_what_says_the_same_on_a_circle_is_worth_as_much() -> None:
    """When the first was found alone it did a part of what the others do; its rivals are judged beside them."""
    diagnosis = diagnose_circles(MODEL, circular(_play_that_winds_up, senses=(1,), feeds=(1000.0,)))
    assert [str(one.reference) for one in diagnosis.found] == ["backlash:y", "reversal-windup:y"]
    wider = next(one for one in diagnosis.candidates if str(one.reference) == "backlash-position:y")
    assert wider.worth_um == pytest.approx(diagnosis.found[0].worth_um, rel=0.02)


def test_odds_decide_and_not_likeness() -> None:
    assert is_as_good(0.6, LEAST_DIFFERENCE - 0.1, 9.0)
    assert not is_as_good(0.4, 0.0, 0.0)
    assert is_as_good(0.98, MOST_DIFFERENCE - 0.1, 1.0)
    assert not is_as_good(0.98, MOST_DIFFERENCE - 0.1, 2.0)
    assert not is_as_good(0.98, MOST_DIFFERENCE + 0.1, 0.0)


def test_a_difference_is_measured_by_how_far_noise_lets_it_scatter() -> None:
    """Of a thousand draws in which neither is the better, the statistic has unit variance."""
    rng = np.random.default_rng(2)
    first, second = rng.normal(size=(2, 400))
    middle = 0.5 * (first + second)
    drawn = [z_by_noise(first, second, middle + rng.normal(size=400)) for _ in range(1000)]
    assert np.mean(drawn) == pytest.approx(0.0, abs=0.1)
    assert np.std(drawn) == pytest.approx(1.0, abs=0.08)
    piece = np.arange(400) // 10
    by_pieces = [
        z_by_pieces((seen - first) ** 2, (seen - second) ** 2, piece, 40)
        for seen in middle + rng.normal(size=(1000, 400))
    ]
    assert np.std(by_pieces) == pytest.approx(1.0, abs=0.15)
