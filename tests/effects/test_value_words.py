"""Values in words: numbers as people read them, and what physics says of them."""

from __future__ import annotations

import math

import pytest

from geoerr.effects.plausible import plausible_what, plausible_words
from geoerr.effects.values import value_words
from geoerr.terms import Parameter, Plausible, UsualSpan

STEEL = (Plausible(11.5e-6, "steel"), Plausible(23.4e-6, "aluminium"))
PLAY = (UsualSpan(0.02, 0.3, "a belt drive"),)


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        (Parameter("alpha", "1/K", 11.8e-6, 0.4e-6), "alpha = 11.80 ± 0.40 ×10⁻⁶/K"),
        (Parameter("b", "mm", 0.0312, 0.0021), "b = 31.2 ± 2.1 µm"),
        (Parameter("c", "rad", -2e-5, 3e-6), "c = −20.0 ± 3.0 µrad"),
        (Parameter("kappa", "1/(mm*K)", 3.5e-8, 2e-9), "kappa = 35.0 ± 2.0 ×10⁻⁹/(mm·K)"),
        (Parameter("tau", "s", 94.2, 1.3, (), 10.0, 10_800.0, "log"), "tau = 94.2 ± 1.3 s"),
        # A place is in mm: inner parameters are read as they are.
        (Parameter("q_fixed", "mm", 197.0, 12.0, (), 0.0, 400.0), "q_fixed = 197 ± 12 mm"),
        # The end of a range is a bound, whatever its linear error.
        (Parameter("tau", "s", 10_800.0, 9_000.0, (), 10.0, 10_800.0, "log"), "tau = 10800 s"),
        (Parameter("k", "", math.nan, math.nan), "k = nan"),
    ],
)
def test_values(parameter: Parameter, text: str) -> None:
    assert value_words(parameter) == text


@pytest.mark.parametrize(
    ("value", "std", "sign", "words"),
    [
        (11.8e-6, 0.4e-6, 0, "plausible: steel has 11.5"),
        (60e-6, 1e-6, 0, "no known value: the nearest is 23.4, aluminium"),
        (230e-6, 1e-6, 0, "no known value: the nearest is 23.4, aluminium"),
        (-11.8e-6, 0.4e-6, 0, "no known value: the nearest is 11.5, steel"),
        (
            990e-6,
            18e-6,
            0,
            "not plausible: 42 times what aluminium has (23.4); something else does this",
        ),
        (11.8e-6, 9e-6, 0, "too uncertain to compare with known values"),
        (-11.8e-6, 0.4e-6, 1, "not physical: it cannot be negative"),
        (-11.8e-6, 9e-6, 1, "too uncertain to compare with known values"),
    ],
)
def test_what_physics_says(value: float, std: float, sign: int, words: str) -> None:
    assert plausible_words(Parameter("alpha", "1/K", value, std, STEEL, sign=sign)) == words


def test_beside_a_bound_a_value_is_not_compared() -> None:
    """Where the fixed point is outside the axis the expansion comes out 25 standard errors too large."""
    alpha = Parameter("alpha", "1/K", 20.99e-6, 0.16e-6, STEEL)
    inside, at_end = (Parameter("q_fixed", "mm", value, 1.0, (), 0.0, 250.0) for value in (120.0, 250.0))
    assert plausible_words(alpha, [inside]) == "no known value: the nearest is 23.4, aluminium"
    words = "not to be compared with known values: q_fixed is at the end of its range"
    assert plausible_words(alpha, [at_end]) == words
    assert plausible_words(at_end, [at_end]) is None


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        (Parameter("b", "mm", 0.0312, 0.0021, PLAY), "usual: a belt drive has 20 to 300 µm"),
        (Parameter("b", "mm", -0.0012, 0.0021, PLAY), "unusually small: a belt drive has 20 to 300 µm"),
        (
            Parameter("b", "mm", 0.1, 0.7, PLAY),
            "too uncertain to tell whether it is usual: a belt drive has 20 to 300 µm",
        ),
        (Parameter("b", "mm", 0.1, math.nan, PLAY), None),
        (
            Parameter("k", "1/mm^2", 3e-8, 1e-9, (UsualSpan(0.0, 2e-7, "a beam"),)),
            "usual: a beam has up to 200 ×10⁻⁹/mm²",
        ),
        # The end of a range is a bound.
        (Parameter("tau", "s", 5.0, 0.1, PLAY, 5.0, 50.0, "log"), None),
        (Parameter("tau", "s", 7.0, 0.1, PLAY, 5.0, 50.0, "log"), "unusually large: a belt drive has 0.02 to 0.3 s"),
    ],
)
def test_what_is_usual(parameter: Parameter, words: str | None) -> None:
    assert plausible_words(parameter) == words


def test_values_of_one_effect_have_one_power_of_ten() -> None:
    """`1000 ± 1000 ×10⁻¹²` stood beside `−24.4 ± 1.3 ×10⁻⁹`."""
    kappa_y, kappa_z = (
        Parameter(name, "1/(K*mm)", value, std)
        for name, value, std in (("kappa_y", 1.0e-9, 1.02e-9), ("kappa_z", -24.4e-9, 1.3e-9))
    )
    both = (kappa_y, kappa_z, Parameter("tau", "s", 300.0, 10.0, low=10.0, high=1e6))
    first, second = (value_words(one, both) for one in both[:2])
    assert first.startswith("kappa_y = 1 ± 1 ×10⁻⁹")
    assert second.startswith("kappa_z = −24.4 ± 1.3 ×10⁻⁹")
    # What is measured in another unit has a power of its own.
    assert value_words(both[2], both) == "tau = 300 ± 10 s"


AT_AN_END = (Parameter("q_fixed", "mm", 250.0, 1.0, (), 0.0, 250.0),)


@pytest.mark.parametrize(
    ("parameter", "inner", "what"),
    [
        (Parameter("alpha", "1/K", 11.6e-6, 0.1e-6, STEEL), (), "steel"),
        # As the words do, a document compares nothing beside a bound, with a wrong sign, or of a bound.
        (Parameter("alpha", "1/K", 11.6e-6, 0.1e-6, STEEL), AT_AN_END, None),
        (Parameter("b", "mm", -0.1, 0.01, PLAY), (), "a belt drive"),
        (Parameter("b", "mm", -0.1, 0.01, PLAY, sign=1), (), None),
        (Parameter("tau", "s", 0.05, 0.01, PLAY, 0.05, 50.0, "log"), (), None),
    ],
)
def test_a_document_names_what_the_words_do(
    parameter: Parameter, inner: tuple[Parameter, ...], what: str | None
) -> None:
    assert plausible_what(parameter, inner) == what
    words = plausible_words(parameter, inner)
    assert (words is not None and words.startswith(("plausible", "usual"))) == (what is not None)
