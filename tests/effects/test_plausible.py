from __future__ import annotations

import math

import pytest
from effect_machines import machine

from geoerr.effects import catalogue, plausible_match, plausible_words
from geoerr.terms import Parameter

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
    assert plausible_words(ALPHA, 11.8e-6, 4e-7) == "plausible: steel has 1.15e-05 1/K"
    assert plausible_words(ALPHA, 14.2e-6, 1e-7) == "not a known value; the nearest is 1.15e-05 1/K (steel)"
    assert plausible_words(ALPHA, 11.8e-6, 4e-6) == "too uncertain to compare with known values"
    assert plausible_words(Parameter("b", "mm", 0.01, 0.001)) is None
