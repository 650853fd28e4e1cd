"""The study's own arithmetic: sets, rules, tables and bounds; what it finds is in its tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from validation.hidden_effects import again
from validation.hidden_effects.ambiguous import is_broken_but_for_twins
from validation.hidden_effects.bound import inner_bounds
from validation.hidden_effects.cases import study_seed
from validation.hidden_effects.formulas import compared
from validation.hidden_effects.generate import Hidden, generate
from validation.hidden_effects.judge import (
    alarmed,
    alike_to_first,
    depends_on,
    fall,
    found_both,
    further,
    inner_errors,
    is_alone_but_for_alike,
    named,
    outcome,
    unknown_outcome,
)
from validation.hidden_effects.noise import Noise
from validation.hidden_effects.record import finite, without_hidden
from validation.hidden_effects.sets import PARTS, USUAL_NUMBER, sets_of
from validation.hidden_effects.study import done
from validation.hidden_effects.tables import rate, read_lines, standing_out, tables
from validation.hidden_effects.visible import Projection


def finding(
    name: str, *, tied: bool = False, like: tuple[tuple[str, float], ...] = (), **more: Any
) -> dict[str, Any]:
    return {
        "name": name,
        "tied": tied,
        "like": [list(one) for one in like],
        "after_um": 17.4,
        "parameters": {},
    } | more


def line(truth: list[str | None], found: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    seen = {"visible_um": 8.0, "visible_off_um": 3.0}
    known = [
        {"kind": "k", "name": name, "variables": ["dir_x", "z"], "inner": [], "off_variable": "y"} | seen
        for name in truth
    ]
    return {
        "key": "single/k/4/0",
        "part": "single",
        "number": 0,
        "n_rows": 10_000,
        "cell": "k",
        "strength_um": 4.0,
        "plan": "mixed",
        "chain": "wbXYZt",
        "noise": "gauss-10",
        "failed": None,
        "truth": known,
        "found": found,
        "candidates": found[:1],
        "unknown": None,
        "verdict": "missing" if found else "nothing-missing",
        "p": 0.5,
        "before_um": 18.0,
        "oracle_um": 17.3,
        "seconds": {"fit": 0.4, "diagnose": 0.5},
        "cpu_seconds": {"fit": 0.4, "diagnose": 0.5},
    } | more


def test_naming_by_the_issue_s_rule() -> None:
    truth = ["backlash:x"]
    assert named(line(truth, [finding("backlash:x")])) == "alone"
    listed = [finding("backlash:x"), finding("lag:x", tied=True)]
    assert named(line(truth, listed[:1], candidates=listed)) == "tied"
    # What contains the first is alike, and no tie: a screw with wear has play.
    one = line(truth, [finding("backlash:x", like=(("backlash-position:x", 1.0),))])
    assert (named(one), alike_to_first(one)) == ("alone", {"backlash-position:x"})
    # Where another is first, a correlation of more than 0.95 ties, whatever the report says; so does the report.
    listed = [finding("lag:x"), finding("backlash:x", tied=True)]
    assert named(line(truth, listed[:1], candidates=listed)) == "second"
    assert named(line(truth, [finding("lag:x", like=(("backlash:x", 0.951),))])) == "second"
    assert named(line(truth, [finding("lag:x", like=(("backlash:x", 0.9),))])) == "wrong"
    assert named(line(truth, [])) == "silent"
    assert named(line(truth, [], unknown={"depends_on": ["x"]}, verdict="unknown")) == "unknown"
    assert named(line(truth, [], failed="ValueError: no")) == "failed"
    assert not alarmed(line([], []))
    assert further(line(truth, [finding("backlash:x"), finding("lag:x")])) == ["lag:x"]


def test_what_is_alike_is_one_set() -> None:
    """Which of the set comes first is chance's; what is tied beside it is not of the set."""
    truth, alike = ["drift:z"], (("drift:z", 0.97),)
    assert is_alone_but_for_alike(line(truth, [finding("drift:z")]))
    assert is_alone_but_for_alike(line(truth, [finding("drift:work-z", like=alike)]))
    assert not is_alone_but_for_alike(line(truth, [finding("drift:work-z", like=(("drift:z", 0.9),))]))
    both = [finding("drift:work-z", like=alike), finding("lag:z", tied=True)]
    assert not is_alone_but_for_alike(line(truth, both[:1], candidates=both))
    # Tied by the report, and not so alike: told as a tie, and not as one set.
    tied = [finding("drift:work-z", like=(("drift:z", 0.9),)), finding("drift:z", tied=True)]
    assert not is_alone_but_for_alike(line(truth, tied[:1], candidates=tied))
    assert not is_alone_but_for_alike(line(truth, []))


def test_both_of_a_pair_need_two_findings() -> None:
    truth = ["backlash:x", "warm-up:z"]
    both = [finding("warm-up:z"), finding("stick-slip:x", like=(("backlash:x", 0.97),))]
    assert found_both(line(truth, both))
    assert not found_both(line(truth, both[:1]))
    # One finding that is tied with both is one finding.
    assert not found_both(line(truth, [finding("warm-up:z", like=(("backlash:x", 0.99),)), finding("lag:y")]))


def test_variables_of_what_is_unknown() -> None:
    exact = line([None], [], unknown={"depends_on": ["z", "d_x"]})
    assert depends_on(exact) == ({"dir_x", "z"}, {"dir_x", "z"})
    assert unknown_outcome(exact) == "exact"
    assert unknown_outcome(line([None], [], unknown={"depends_on": ["z"]})) == "inexact"
    assert unknown_outcome(line([None], [finding("lag:x")])) == "named"
    assert unknown_outcome(line([None], [])) == "silent"


def test_parameters_are_near_by_their_size_or_their_bound() -> None:
    one = line(["periodic:x"], [finding("periodic:x", parameters={"P": [8.02, 0.01]})])
    one["truth"][0] |= {"inner": ["P"], "parameters": {"P": 8.0}, "bounds": {"P": 0.005}, "ranges": {}}
    ((_, error, _, _, near),) = inner_errors(one)
    assert (error, near) == (pytest.approx(0.02), False)
    one["truth"][0]["bounds"]["P"] = 0.011
    assert inner_errors(one)[0][4]
    place = line(
        ["thermal-expansion:x@temp"], [finding("thermal-expansion:x@temp", parameters={"q_fixed": [30.0, 5.0]})]
    )
    place["truth"][0] |= {
        "inner": ["q_fixed"],
        "parameters": {"q_fixed": 1.0},
        "bounds": {"q_fixed": 1.0},
        "ranges": {"x": [0.0, 300.0]},
    }
    assert inner_errors(place)[0][4]
    assert fall(one) == (18.0, 17.4, 17.3)


def test_sets_have_seeds_of_their_own() -> None:
    indices = [(one.part, one.index) for part in PARTS for one in sets_of(part)]
    assert len(set(indices)) == len(indices)
    assert sum(one.cell == "drift-2" for one in sets_of("nulls")) == USUAL_NUMBER["nulls"] >= 200
    cells = [(one.cell, one.strength_um) for one in sets_of("single")]
    assert min(cells.count(cell) for cell in set(cells)) >= 20
    assert all(first.kind != second.kind for one in sets_of("pairs") for first, second in [one.hidden])
    one = next(sets_of("nulls", 1))
    assert one.case(1000, is_study=True).seed >= study_seed(0) > one.case(1000, is_study=False).seed


def test_the_oracle_sees_what_was_there_without_the_effect() -> None:
    options = {"plan": "mixed", "n_rows": 1000, "noise": "everything"}
    hidden, plain = generate(4, hidden=["angular-reversal"], **options), generate(4, **options)
    # Second order in displacements of some ten micrometres.
    np.testing.assert_allclose(
        without_hidden(hidden).measured_mm, plain.observations.measured_mm, atol=1e-5, rtol=0.0
    )


@pytest.mark.parametrize("kind", ["cross-coupling", "step", "thermal-bending", "screw-heating-duty", "timing"])
def test_both_sides_mean_the_same_by_a_name(kind: str) -> None:
    """0.02 µm of noise in each component are 0.035; splines hold the machine's own waves to below 0.1."""
    found = compared(kind, "mixed", 900)
    assert found is not None
    assert found.left_um < 0.1
    assert np.allclose([*found.ratios.values()], 1.0, atol=0.03)


def test_the_bound_is_that_of_least_squares() -> None:
    """Gauss-Newton on the generator's own displacement, with noise: errors as the bound says."""
    case = generate(7, "wbXYZt", "mixed", Noise((1.0, 1.0, 1.0)), [Hidden("reversal-windup", "x")], 8.0, 1000)
    (bound,) = inner_bounds(case).values()
    log, true = case.log, case.truth[0].parameters
    projection = Projection(log, with_offsets=False)
    step = 1e-3 * true["lambda"]

    def moved(length: float) -> np.ndarray:
        from validation.hidden_effects.listed import wound_up

        motion = log.motion
        shape = wound_up(motion.direction[:, 0], motion.travel_mm[:, 0], log.plan.moments.session, length)[log.moment]
        result = np.zeros((log.n_rows, 3))
        # On the tool side alone, and no lever: what x gains moves every target of the tool.
        result[:, 0] = np.where(log.carrier == 0, shape, 0.0)
        return projection(result).ravel()

    slope = (moved(true["lambda"] + step) - moved(true["lambda"] - step)) / (2.0 * step)
    columns = np.stack([moved(true["lambda"]), true["b"] * slope], axis=1)
    covariance = np.linalg.inv(columns.T @ columns) * 1e-3**2
    # Angles of the other axes turn the axis by a thousandth.
    assert bound == pytest.approx(float(np.sqrt(covariance[1, 1])), rel=0.01)


def test_a_run_goes_on_where_it_was_cut(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    file.write_text(json.dumps({"key": "a"}) + "\n" + json.dumps({"key": "b"}) + "\n" + '{"key": "c", "pa')
    assert done(file) == {"a", "b"}
    assert [one["key"] for one in read_lines(file)] == ["a", "b"]
    assert done(tmp_path / "none.jsonl") == set()
    assert finite({"a": (float("nan"), np.float64(1.0))}) == {"a": [None, 1.0]}


def test_exact_intervals_and_what_stands_out() -> None:
    # Clopper–Pearson of 0 of 60: 1 − 0.025^(1/60) = 5.96 %.
    assert rate(0, 60) == "0/60 = 0.0 % (0.0–6.0)"
    lines = [
        line(
            [],
            [],
            plan="mixed" if number % 2 else "nine-lines",
            verdict="unknown" if number % 2 else "nothing-missing",
        )
        for number in range(40)
    ]
    assert "plan mixed: 20 of 20, others 0 of 20" in standing_out(lines, alarmed, "alarms")
    assert "no plan" in standing_out(lines, lambda _: False, "alarms")


def test_tables_hold_every_part() -> None:
    lines = [
        line([], [], part="nulls", cell="gauss-10", key="n"),
        line(["lag:x"], [finding("lag:x")]),
        line(["lag:x", "backlash:y"], [finding("lag:x"), finding("backlash:y")], part="pairs", key="p"),
        line(["lag:x"], [finding("lag:x")], part="off-formula", key="o", unknown={"depends_on": ["y", "v_x"]}),
        line([None], [], part="unlisted", key="u", unknown={"depends_on": ["z", "d_x"]}),
    ]
    text = tables(lines)
    assert "nulls 1 of 1800, single 1 of 3280, pairs 1 of 200" in text
    for title in ("Nothing hidden", "One effect", "Two at once", "30 %", "Not in the catalogue", "Held-out", "Time"):
        assert title in text
    assert "| 4 | 1 | 1/1 = 100.0 %" in text
    assert "86 %" in text


def test_rates_without_what_was_looked_at_leave_just_that_out() -> None:
    right, wrong = [finding("lag:x")], [finding("periodic:y")]
    lines = [line(["lag:x"], right, key=f"single/lag/4/{number}", cell="lag") for number in range(3)]
    lines.append(line(["lag:x"], wrong, key="single/lag/4/3", cell="lag"))
    lines += [line(["periodic:y"], wrong, key=f"single/periodic/4/{number}", cell="periodic") for number in range(5)]
    noise = {"part": "nulls", "cell": "gauss-10"}
    lines += [line([], [], key=f"nulls/gauss-10/0/{number}", number=number, **noise) for number in range(70, 80)]
    section = tables(lines).partition("nobody had looked at")[2]
    assert "| nothing hidden | 0/5 = 0.0 %" in section
    assert "| catalogue, 4 µm | 3/4 = 75.0 %" in section


def test_what_came_of_a_set_of_each_part() -> None:
    right, wrong = finding("backlash:x"), finding("periodic:y")
    assert outcome(line(["backlash:x"], [right])) == "alone"
    assert outcome(line(["backlash:x"], [wrong])) == "wrong"
    assert outcome(line([], [], part="nulls", verdict="nothing-missing")) == "quiet"
    assert outcome(line([], [wrong], part="nulls", verdict="missing")) == "alarm"
    assert outcome(line(["backlash:x", "periodic:y"], [right, wrong], part="pairs")) == "both"
    assert outcome(line(["backlash:x", "periodic:y"], [right], part="pairs")) == "not both"
    assert outcome(line([None], [wrong], part="unlisted")) == "named"
    assert outcome(line(["backlash:x"], [], failed="ValueError")) == "failed"


def test_a_larger_sample_takes_in_a_smaller_one() -> None:
    lines = [line([], [], key=f"nulls/gauss-3/0/{number}") for number in range(40)]
    lines += [line([], [], key="nulls/gauss-3/0/40", failed="not-carried")]
    small, all_of_them = again.sample(lines, 10), again.sample(lines, 100)
    assert small == all_of_them[:10]
    assert sorted(all_of_them) == sorted(one["key"] for one in lines[:40])
    assert small != [one["key"] for one in lines[:10]]


def test_the_sample_says_what_came_out_otherwise() -> None:
    before = [line(["backlash:x"], [finding("backlash:x")], key=f"single/backlash/4/{number}") for number in (0, 1)]
    now = [before[0], line(["backlash:x"], [finding("periodic:y")], key=before[1]["key"])]
    text = again.tables(before, now)
    assert "| single | 2 | 1/2 = 50.0 % (1.3–98.7) | 2/2 = 100.0 % (15.8–100.0) | 1/2 = 50.0 % (1.3–98.7) |" in text
    assert "| single/backlash/4/1 | alone | backlash:x" in text
    assert "single/backlash/4/0" not in text


def test_a_twin_is_like_what_it_says_otherwise_whatever_is_measured() -> None:
    drift = line(["thermal-drift:work-x@temp_bed"], [])

    def after(*alike: str, how: str = "alone") -> bool:
        return is_broken_but_for_twins(drift | {"advised": {"how": how, "alike": list(alike)}})

    assert after()
    assert after("thermal-expansion:x@temp_bed")
    # Of another axis, temperature or kind it is no twin.
    assert not after("thermal-expansion:y@temp_bed")
    assert not after("thermal-expansion:x@temp_frame")
    assert not after("thermal-expansion:x@temp_bed", "thermal-drift:x@temp_bed")
    assert not after(how="wrong")
