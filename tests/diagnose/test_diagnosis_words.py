"""A diagnosis in words: how sure, where, and of what shape."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.diagnose.shape import shape_words
from geoerr.diagnose.where import where_of
from geoerr.diagnose.words import counted_words, sure_words
from geoerr.fit import sightings_of
from geoerr.fit.empirical import Curve
from geoerr.observations import observations_from_columns

# The curve's degrees are those that data have evidence of: what they follow need not be a line.
A_LINE = " (in a straight line, as far as these data tell)"


def test_how_sure() -> None:
    assert sure_words(2.3e-7) == "certain as can be: chance does as much in one search of 4.3 million (p = 2.3e-07)"
    assert sure_words(0.0) == "certain as can be: chance does as much in fewer than one search of a billion"
    assert sure_words(0.43).startswith("not beyond chance: chance does as much in 43 of 100")
    assert sure_words(1.0).endswith("in every search")
    assert [counted_words(count) for count in (16.7, 450.0, 4320.0, 2.34e6, 1.61e8)] == [
        *("20", "450", "4,300", "2.3 million", "160 million")
    ]


def curve(function: object, at: np.ndarray, name: str = "feed", std_um: float = 0.2) -> Curve:
    value_um = np.array([function(one) for one in at])  # type: ignore[operator]
    return Curve("x", (name,), (at,), value_um, np.full(len(at), std_um))


AT = np.linspace(-1.0, 1.0, 41)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (lambda u: 10.0 * u, f"rises with feed{A_LINE}, 20.0 µm in all"),
        (lambda u: -10.0 * u, f"falls with feed{A_LINE}"),
        (lambda u: 10.0 * np.exp(3.0 * u), "rises with feed, most of it at high values"),
        (lambda u: 10.0 * u**2, "alike on both sides of the middle (even)"),
        (lambda u: 10.0 * u**2, "falls, then rises with feed (turning at 0)"),
        (lambda u: 10.0 * np.sin(3.0 * np.pi * u), "goes up and down with 6 turns over feed"),
        # Five and a half of its periods, of which the ends are large: what turns beyond its error is counted.
        (lambda u: 3.0 * np.sin(5.5 * np.pi * u) + 20.0 * u**81, "goes up and down with 12 turns over feed"),
        (lambda u: 10.0 * np.sin(np.pi * u), "opposite on both sides of the middle (odd)"),
        (lambda u: 0.0 * u, "hardly changes with feed"),
    ],
)
def test_shapes(shape: object, words: str) -> None:
    text = shape_words(curve(shape, AT))
    # A ripple within its own error is none.
    wavy = shape_words(curve(lambda u: shape(u) + 0.05 * np.sin(40.0 * u), AT))  # type: ignore[operator]
    assert words in text
    assert text.split(",")[0] == wavy.split(",")[0]


def test_what_turns_once_is_not_said_to_be_odd() -> None:
    # More than nine tenths of its sum of squares are odd about the middle; it does not fall there before it rises.
    words = shape_words(curve(lambda u: 10.0 * np.sin(0.65 * np.pi * u + 0.2), AT))
    assert "rises, then falls with feed (turning at 0.65), 20.0 µm in all" in words
    assert "(odd)" not in words


def test_the_shape_of_a_direction_and_of_two_variables() -> None:
    flips = curve(lambda d: -3.0 * d, np.array([-1.0, 1.0]), "d_x")
    assert shape_words(flips) == "flips by 6.0 µm with the direction of x (−6.0 µm on the way up)"
    at = np.linspace(0.0, 1.0, 9)
    product = Curve("z", ("feed", "z"), (at, at), 10.0 * np.outer(at, 2.0 * at - 1.0), np.full((9, 9), 0.1))
    words = shape_words(product)
    assert words.startswith(
        f"falls with feed{A_LINE} at z = 0, and turns round at z = 0.5; the curve itself is largest"
    )
    assert "largest (−10.0 µm) at feed = 1, z = 0" in words
    steeper = Curve("z", ("feed", "z"), (at, at), 10.0 * np.outer(at, 1.0 + at), np.full((9, 9), 0.1))
    assert "2 times as much at z = 1 as at 0" in shape_words(steeper)


AT_X = np.linspace(0.0, 400.0, 17)


@pytest.mark.parametrize(
    ("along", "words"),
    [
        # At both ends of x it rises; between them it turns its sign at 84, 169, 254 and 339.
        (
            np.sin(2.0 * np.pi * (AT_X + 1.0) / 170.0),
            f"rises with feed{A_LINE} at x = 50, and turns round at x = 84.23, 168.6, 254.3 and 338.9",
        ),
        (
            AT_X * (400.0 - AT_X) / 4e4,
            f"rises with feed{A_LINE} at x = 200, and vanishes at x = 0 and 400",
        ),
        (
            (AT_X / 200.0 - 1.0) ** 2,
            f"rises with feed{A_LINE} at x = 0, and vanishes at x = 200",
        ),
        (
            1.0 + AT_X / 400.0,
            f"rises with feed{A_LINE}, 2 times as much at x = 400 as at 0",
        ),
        (np.ones(17), f"rises with feed{A_LINE}; the curve itself is largest"),
    ],
)
def test_a_surface_is_told_over_the_whole_range_of_its_second_variable(along: np.ndarray, words: str) -> None:
    value_um = 10.0 * np.outer(AT[::2], along)
    std_um = np.full(value_um.shape, 0.1)
    text = shape_words(Curve("y", ("feed", "x"), (AT[::2], AT_X), value_um, std_um))
    assert text.startswith(words)
    # The sum of two curves is said to be one.
    text = shape_words(Curve("y", ("feed", "x"), (AT[::2], AT_X), value_um + 0.05 * AT_X, std_um))
    assert f", and beside that rises with x{A_LINE}; the curve itself is largest" in text
    # An uncertain corner is not where it is largest.
    value_um[0, -1], std_um[0, -1] = 90.0, 50.0
    assert "at feed = −1, x = 400" not in shape_words(Curve("y", ("feed", "x"), (AT[::2], AT_X), value_um, std_um))


def test_a_surface_of_several_shapes_is_told_in_the_middle_too() -> None:
    value_um = 10.0 * np.sin(0.5 * np.pi * AT[::2, None] + np.pi * AT_X / 400.0)
    text = shape_words(Curve("y", ("feed", "x"), (AT[::2], AT_X), value_um, np.full(value_um.shape, 0.1)))
    middle = "rises, then falls with feed (turning at 0) at x = 200"
    assert text.startswith(f"rises with feed{A_LINE} at x = 0, {middle}, falls with feed")


def test_where_an_effect_is_largest() -> None:
    """Growth of y from its low end while the bed warms: by hand."""
    y, bed = (values.ravel() for values in np.meshgrid(np.linspace(0.0, 300.0, 7), [20.0, 40.0, 60.0]))
    n = len(y)
    columns: dict[str, object] = {"y": y, "temp_bed": bed, "x": np.zeros(n), "z": np.zeros(n)}
    columns |= {"mx": np.zeros(n), "my": y, "mz": np.zeros(n), "line": [f"T{one:.0f}" for one in bed]}
    sightings = sightings_of(observations_from_columns(columns))
    moved_um = np.zeros((n, 3))
    moved_um[:, 1] = 1e3 * 11.5e-6 * (bed - 20.0) * y
    where = where_of(sightings, moved_um, np.ones(n, dtype=bool), ["y", "temp_bed"])
    assert where.line == "T60"
    assert where.line_um == pytest.approx(np.sqrt((moved_um[bed == 60.0, 1] ** 2).mean()))
    assert where.largest_um == pytest.approx(11.5e-3 * 40.0 * 300.0)
    assert where.at_mm == (0.0, 300.0, 0.0)
    assert {span.variable: span.part for span in where.spans} == {"y": "high", "temp_bed": "high"}
    assert "at the high end of y" in where.words()
    same = where_of(sightings, np.ones((n, 3)), np.ones(n, dtype=bool), ["y", "temp_bed"])
    assert same.words().startswith("much the same everywhere; largest 1.7 µm")
