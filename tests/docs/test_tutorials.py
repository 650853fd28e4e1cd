"""The tutorials run, and what they claim is so."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@cache
def _maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_tutorials", DOCS / "make_tutorials.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def _made(name: str) -> tuple[str, dict[str, Any]]:
    """Run a page once for all tests, to its end where there are real data."""
    page = (DOCS / "tutorials" / name).read_text(encoding="utf-8")
    made: tuple[str, dict[str, Any]] = _maker().run_page(page, with_real_data=_maker().has_real_data())
    return made


def _run(name: str) -> dict[str, Any]:
    return _made(name)[1]


def test_what_it_prints_is_what_stands_there() -> None:
    page = (DOCS / "tutorials" / "what_is_missing.md").read_text(encoding="utf-8")
    assert not _maker().differences(page, _made("what_is_missing.md")[0])


def test_the_error_falls_three_times_to_the_noise() -> None:
    names = _run("what_is_missing.md")
    held = [one[2] for one in names["fall"]]
    assert len(held) == 4
    assert held == sorted(held, reverse=True)
    # What is left beyond the noise is what 60 numbers of the model cost, and no more.
    excess = [max(one**2 - names["floor_um"] ** 2, 0.0) ** 0.5 for one in held]
    assert excess[-1] < 0.2 * excess[0]
    assert held[-1] < 1.15 * names["floor_um"]
    alpha = names["model"].parameter("thermal-expansion:y@temp_bed.alpha")
    play = names["model"].parameter("backlash:x.b")
    assert abs(alpha.value - 11.5e-6) < 4.0 * alpha.std
    assert abs(play.value - 0.014) < 4.0 * play.std
    assert names["after"].verdict == "nothing-missing"


def test_numbers_done_again_are_those_that_were_said() -> None:
    names = _run("what_is_missing.md")
    found = names["diagnosis"].found
    assert names["after_um"] == pytest.approx(found[-1].held_out_rmse_after_um, rel=1e-6)
    assert names["p_value"] == pytest.approx(found[0].p_value, rel=1e-6)
    assert names["evidence"] == pytest.approx(found[-1].evidence, rel=1e-6)
    assert names["correlation"] == pytest.approx(names["alias"].correlation, rel=1e-6)
    assert names["worths_um"] == pytest.approx([one.worth_um for one in found], rel=1e-3)
    assert names["unknown_p"] == pytest.approx(names["unknown"].p_value, rel=1e-6)
    assert names["nothing_p"] == pytest.approx(names["offset"].p_value, rel=1e-6)
    assert 2.0 * names["asked_p"] == pytest.approx(names["offset"].found[0].p_value, rel=1e-6)
    held = names["held"].found[0]
    assert (names["value"][0], names["held_um"]) == pytest.approx((held.parameters[0].value, held.worth_um), rel=1e-3)
    assert names["std"] == pytest.approx([one.std for one in names["growth"].parameters], rel=1e-3)
    assert names["overall_p"] == pytest.approx(names["after"].p_value, rel=1e-6)
    where = names["growth"].where
    assert (names["most"], names["on_line"][names["most"]]) == (where.line, pytest.approx(where.line_um, rel=1e-6))
    assert max(names["thirds"]) == pytest.approx(where.spans[0].rms_um, rel=1e-6)
    between = names["between"]
    assert (names["passes_um"], names["rows_um"]) == pytest.approx((between.worth_um, between.rows_um), rel=1e-6)
    assert names["unknown_um"] == pytest.approx(names["unknown"].worth_um, rel=1e-3)
    assert names["curve_um"] == pytest.approx(names["unknown"].curve.value_um, abs=0.01)
    assert names["minutes"] == pytest.approx(names["advice"].minutes, rel=1e-6)


def test_all_three_are_named() -> None:
    names = _run("what_is_missing.md")
    assert {str(one.reference) for one in names["diagnosis"].found} == {
        *("angular:x", "thermal-expansion:y@temp_bed", "backlash:x")
    }


@pytest.mark.real_data
@pytest.mark.usefixtures("real_data")
def test_the_bed_tells_what_the_frame_does_not() -> None:
    """Trained while heating: the error on cooling, frame alone and with the bed, as known of these data."""
    forward = _run("what_is_missing.md")["forward"]
    assert forward["frame"] == pytest.approx(123.0, abs=2.0)
    assert forward["frame, bed"] < 18.5
    assert forward["both lagged"] < 4.6
    # What fits the heating half best is not what predicts the cooling half.
    assert forward["frame, bed lagged"] > 0.95 * forward["frame, bed"]
    assert forward["frame lagged, bed"] < 0.5 * forward["frame, bed"]
    assert forward["all four lagged"] > 5.0 * forward["both lagged"]
