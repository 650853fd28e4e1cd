"""Knots stand so that a spline is between positions no wilder than the values that tell it."""

import itertools

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scipy.interpolate import CubicSpline

from geoerr.bases import basis_of, places_for_knots, spline_over
from geoerr.bases.knots import swing_of

MOST = 24
# Lines at tenths of the travel, a diagonal that begins a hundredth inside, and what stood still.
BESIDE_A_DIAGONAL = np.unique(np.round([*np.linspace(0.0, 1.0, 11), *np.linspace(0.013, 0.987, 11), 0.07, 0.52], 6))


@pytest.mark.parametrize("count", [5, 8, 11, 16, 24])
def test_a_function_for_each_place_is_the_interpolating_spline(count: int) -> None:
    """Second implementation: SciPy's not-a-knot spline, which even places have by the same knots."""
    places = np.linspace(-30.0, 270.0, count)
    values = np.random.default_rng(count).normal(size=count)
    basis = basis_of(spline_over("x", places, count))
    asked = np.linspace(-30.0, 270.0, 301)
    found = basis.evaluate(asked) @ np.linalg.solve(basis.evaluate(places), values)
    assert np.allclose(found, CubicSpline(places, values)(asked), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("count", range(4, 41))
def test_even_places_are_all_followed(count: int) -> None:
    places = np.linspace(0.0, 300.0, count)
    assert np.array_equal(places_for_knots(places, MOST), places)
    for n_functions in range(4, min(count, MOST) + 1):
        assert swing_of(spline_over("x", places, n_functions), places) < 4.0


def test_positions_side_by_side_are_one_place() -> None:
    """A function for each of them swings: 1 µm that is wrong at one is hundreds in the gap beside it."""
    count = len(BESIDE_A_DIAGONAL)
    assert swing_of(spline_over("x", BESIDE_A_DIAGONAL, count), BESIDE_A_DIAGONAL) > 20.0
    places = places_for_knots(BESIDE_A_DIAGONAL, MOST)
    assert 10 <= len(places) <= 14
    assert swing_of(spline_over("x", places, len(places)), BESIDE_A_DIAGONAL) < 5.0


def test_places_that_are_scattered_about_a_few_are_these() -> None:
    rng = np.random.default_rng(3)
    scattered = np.sort((np.linspace(0.0, 300.0, 11)[:, None] + rng.normal(size=(11, 9))).ravel())
    assert len(places_for_knots(scattered, MOST)) == 11


def test_a_part_that_is_measured_finely_keeps_its_places() -> None:
    """A screw that is worn where it works: of 26 places in its first 50 mm three were left, and 9 µm went unseen."""
    worn = np.concatenate([np.arange(0.0, 51.0, 2.0), np.arange(100.0, 401.0, 50.0)])
    places = places_for_knots(worn, MOST)
    assert (places <= 50.0).sum() >= 10
    for count in range(5, min(len(places), MOST) + 1):
        assert swing_of(spline_over("x", places, count), worn) < 5.0


@pytest.mark.parametrize("gap_mm", [50.0, 100.0])
def test_a_gap_in_the_plan_leaves_the_rest_its_places(gap_mm: float) -> None:
    step = np.arange(0.0, 101.0, 10.0)
    both = np.concatenate([step, 100.0 + gap_mm + step])
    places = places_for_knots(both, MOST)
    assert len(places) >= 8
    # In proportion to the gap, beyond four of those of 10 mm, and up to twice.
    allowed = min(max(5.0 * gap_mm / 40.0, 5.0), 10.0)
    assert swing_of(spline_over("x", places, len(places)), both) <= allowed


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("count", [6, 9, 14, 24, 40])
def test_any_positions_have_calm_splines(count: int, seed: int) -> None:
    own = np.sort(np.random.default_rng(seed).uniform(0.0, 300.0, count))
    places = places_for_knots(own, MOST)
    for n_functions in range(5, min(len(places), MOST) + 1):
        # Gaps of any width, and of fewer functions than the most some swing a little more.
        assert swing_of(spline_over("x", places, n_functions), own) < 12.0


def test_swing_is_the_largest_that_errors_of_one_make() -> None:
    """By what it means: of all values ±1 at positions, those that push a place farthest."""
    places = np.array([0.0, 1.0, 10.0, 20.0, 31.0, 40.0])
    spec = spline_over("x", places, 5)
    basis = basis_of(spec)
    asked = np.unique(np.concatenate([np.linspace(low, high, 5) for low, high in itertools.pairwise(places)]))
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * len(places))).reshape(len(places), -1)
    coefficients = np.linalg.lstsq(basis.evaluate(places), signs, rcond=None)[0]
    assert swing_of(spec, places) == pytest.approx(np.abs(basis.evaluate(asked) @ coefficients).max(), rel=1e-12)


@given(
    st.lists(st.floats(0.0, 1000.0, allow_nan=False), min_size=3, max_size=60, unique=True),
    st.integers(5, MOST),
)
def test_places_are_some_of_the_positions(positions: list[float], most: int) -> None:
    """Both ends stay, the order too, and what is told by them is told by the positions."""
    own = np.unique(np.round(positions, 3))
    if len(own) < 3:
        return
    places = places_for_knots(own, most)
    assert places[0] == own[0]
    assert places[-1] == own[-1]
    assert (np.diff(places) > 0.0).all()
    assert np.isin(places, own).all()
    if len(places) > 4:
        spec = spline_over("x", places, min(len(places), most))
        assert np.linalg.matrix_rank(basis_of(spec).evaluate(own)) == spec.n_functions
