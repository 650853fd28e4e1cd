from __future__ import annotations

import math
from dataclasses import replace

import pytest
from effect_machines import machine

from geoerr.effects import Effect, catalogue, plausible_match, plausible_what, plausible_words
from geoerr.errors import ShapeError
from geoerr.fit.periods import likeliest
from geoerr.terms import Parameter, Plausible, UsualSpan

ALPHA = catalogue()["thermal-expansion"].term("x", "temp", machine()).coefficients[0]


@pytest.mark.parametrize(
    ("value", "std", "what"),
    [
        (11.8e-6, 4e-7, "steel"),
        (11.5e-6, 1e-9, "steel"),
        (23.0e-6, 1e-7, "aluminium"),
        (16.6e-6, 2e-7, "stainless steel"),
        (1.3e-6, 1e-7, "Invar"),
        (14.0e-6, 1e-7, None),
        (-11.5e-6, 4e-7, None),
        (14.0e-6, 7e-6, None),
        (0.0, 1e-6, None),
        (math.nan, 1e-6, None),
        (11.5e-6, math.nan, None),
    ],
)
def test_materials_are_recognised_by_their_expansion(value: float, std: float, what: str | None) -> None:
    match = plausible_match(ALPHA, value, std)
    assert (None if match is None else match.what) == what


def test_a_period_has_to_be_the_screw_s_own() -> None:
    effect = catalogue()["periodic"]
    period = next(spec for spec in effect.inner if spec.name == "P")
    parameter = Parameter("P", period.unit, 8.003, 0.001, period.plausible)
    match = plausible_match(parameter)
    assert match is not None
    assert "8 mm lead" in match.what
    assert plausible_match(parameter, 8.3, 0.01) is None


def test_the_words_say_which_and_how_far() -> None:
    assert plausible_words(replace(ALPHA, value=11.8e-6, std=4e-7)) == "plausible: steel has 11.5"
    assert plausible_words(replace(ALPHA, value=14.2e-6, std=1e-7)) == "no known value: the nearest is 11.5, steel"
    assert plausible_words(replace(ALPHA, value=11.8e-6, std=4e-6)) == "too uncertain to compare with known values"
    assert plausible_words(Parameter("b", "mm", 0.01, 0.001)) is None


SCREW = UsualSpan(0.002, 0.02, "a ball screw of a mill")
BELT = UsualSpan(0.03, 0.2, "a belt drive", "somebody's measurement")
PLAY = Parameter("b", "mm", plausible=(SCREW, BELT))


@pytest.mark.parametrize(
    ("value", "std", "words", "what"),
    [
        (0.012, 0.0004, "usual: a ball screw of a mill has 2 to 20 µm", "a ball screw of a mill"),
        (-0.012, 0.0004, "usual: a ball screw of a mill has 2 to 20 µm", "a ball screw of a mill"),
        (0.02, 0.0, "usual: a ball screw of a mill has 2 to 20 µm", "a ball screw of a mill"),
        (0.1, 0.01, "usual: a belt drive has 30 to 200 µm", "a belt drive"),
        # Two standard deviations reach an end, or they do not.
        (0.21, 0.0051, "usual: a belt drive has 30 to 200 µm", "a belt drive"),
        (0.21, 0.0049, "unusually large: a belt drive has 30 to 200 µm", None),
        (0.001, 0.00051, "usual: a ball screw of a mill has 2 to 20 µm", "a ball screw of a mill"),
        (0.001, 0.00049, "unusually small: a ball screw of a mill has 2 to 20 µm", None),
        (0.0, 0.0, "unusually small: a ball screw of a mill has 2 to 20 µm", None),
        (0.022, 0.0005, "unusual: a ball screw of a mill has 2 to 20 µm", None),
        # Nearer to the one than to the other, in times.
        (0.024, 0.0025, "usual: a ball screw of a mill has 2 to 20 µm", "a ball screw of a mill"),
        # A value that may be smaller or larger than all of them says nothing.
        (0.1, 0.5, "too uncertain to tell whether it is usual: a belt drive has 30 to 200 µm", None),
        (math.nan, 0.1, None, None),
        (0.01, math.nan, None, None),
    ],
)
def test_a_span_holds_sizes_within_their_uncertainty(
    value: float, std: float, words: str | None, what: str | None
) -> None:
    assert plausible_words(replace(PLAY, value=value, std=std)) == words
    assert plausible_what(replace(PLAY, value=value, std=std)) == what


def test_a_span_from_0_has_nothing_too_small() -> None:
    play = Parameter("b", "mm", 0.0, 1e-6, (UsualSpan(0.0, 0.015, "a ball bushing on its shaft"),))
    assert plausible_words(play) == "usual: a ball bushing on its shaft has up to 15 µm"
    large = replace(play, value=0.02, std=0.001)
    assert plausible_words(large) == "unusually large: a ball bushing on its shaft has up to 15 µm"


def test_a_value_of_physics_comes_before_a_span() -> None:
    alpha = replace(ALPHA, plausible=(*ALPHA.plausible, UsualSpan(1e-6, 30e-6, "a metal")))
    assert plausible_words(replace(alpha, value=11.8e-6, std=4e-7)) == "plausible: steel has 11.5"
    assert plausible_words(replace(alpha, value=14.2e-6, std=1e-7)) == "usual: a metal has 1 to 30 ×10⁻⁶/K"


def test_only_values_of_physics_choose_a_period() -> None:
    spans = (UsualSpan(1.0, 100.0, "anything that turns"),)
    assert plausible_match(Parameter("P", "mm", 8.0, 0.001, spans, 0.5, 200.0, "log")) is None
    period = Parameter(
        "P", "mm", 8.0, 0.001, (Plausible(5.0, "a screw of 5 mm lead", 0.01), *spans), 0.5, 200.0, "log"
    )
    assert likeliest(period, (8.0, 5.0, 4.0)) == 5.0
    assert likeliest(replace(period, plausible=spans), (8.0, 5.0, 4.0)) == 8.0


@pytest.mark.parametrize(("low", "high"), [(0.2, 0.1), (0.1, 0.1), (-0.1, 0.1), (0.1, math.inf), (math.nan, 0.1)])
def test_what_is_no_span_of_sizes_is_refused(low: float, high: float) -> None:
    with pytest.raises(ShapeError, match="is not a span of sizes from 0 up"):
        UsualSpan(low, high, "a belt drive")


@pytest.mark.parametrize("effect", catalogue(), ids=lambda effect: effect.id)
def test_every_entry_says_what_is_usual_or_why_nothing_is(effect: Effect) -> None:
    searched = [spec for spec in effect.inner if isinstance(spec.range, tuple) and spec.range[0] < spec.range[1]]
    for spec in (*effect.coefficients, *searched):
        assert bool(spec.plausible) != bool(spec.any_size), spec.name
        for item in spec.plausible:
            assert not isinstance(item, UsualSpan) or item.source, f"{spec.name}: who says so"
    assert bool(effect.any_size) == (not effect.coefficients)


@pytest.mark.parametrize(("value_mm", "std_mm"), [(-0.043, 0.0055), (-0.005, 0.0005)])
def test_play_that_is_negative_is_not_of_a_usual_size(value_mm: float, std_mm: float) -> None:
    """Over-compensation, says the cause: no screw has it."""
    play = replace(catalogue()["backlash"].term("x", None, machine()).coefficients[0], value=value_mm, std=std_mm)
    words = plausible_words(play)
    assert words is not None
    assert words.startswith("not what is usual: it is negative, where a ")
    assert plausible_what(play) is None
    # As far as 0 it may be play all the same.
    near = plausible_words(replace(play, std=abs(value_mm)))
    assert near is not None
    assert near.startswith(("usual", "too uncertain"))
    usual = plausible_words(replace(play, value=-value_mm))
    assert usual is not None
    assert usual.startswith("usual: ")


def test_a_span_keeps_its_sign_in_a_file() -> None:
    span = UsualSpan(0.02, 0.3, "a belt drive", "its maker", 1)
    play = Parameter("b", "mm", 0.1, 0.01, (span,))
    document = play.to_document()
    assert document["plausible"] == [
        {"low": 0.02, "high": 0.3, "what": "a belt drive", "source": "its maker", "sign": "positive"}
    ]
    assert Parameter.from_document(document, "model.json", "here") == play
