"""The circle fit against SciPy, against circles known exactly, and its refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from geoerr.errors import GeometryError, ShapeError
from geoerr.verify.circle import PLANES, CircleOfCommands, fit_circle, fit_set_up, what_fits


def points_on_circle(center, radius, start, arc, n):
    angle = np.linspace(start, start + arc, n, endpoint=False)
    return np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def scipy_circle(points, start):
    """The same problem for a general solver: three free parameters, finite differences."""

    def residual(parameters):
        return np.hypot(points[:, 0] - parameters[0], points[:, 1] - parameters[1]) - parameters[2]

    return least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, jac="3-point").x


@settings(max_examples=60)
@given(
    center=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    radius=st.floats(1, 1000),
    start=st.floats(0, 6.28),
    arc=st.floats(0.8, 2 * np.pi),
    n=st.integers(5, 200),
)
def test_an_exact_circle_is_found(center, radius, start, arc, n):
    fitted = fit_circle(points_on_circle(center, radius, start, arc, n))
    # Round-off of coordinates up to 1500 mm is 2e-13 mm; an arc of 0.8 rad magnifies it by about 12/0.8² = 19.
    bound = 1e-9 * max(radius, 1.0)
    np.testing.assert_allclose(fitted.center_mm, center, atol=bound)
    assert fitted.radius_mm == pytest.approx(radius, abs=bound)
    assert fitted.circular_deviation_mm < bound


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), arc=st.floats(1.5, 2 * np.pi), noise=st.floats(1e-4, 3.0))
def test_it_is_the_least_squares_circle_of_scipy(seed, arc, noise):
    rng = np.random.default_rng(seed)
    points = points_on_circle((212.0, 270.0), 100.0, 0.3, arc, 90) + rng.normal(scale=noise, size=(90, 2))
    fitted = fit_circle(points)
    expected = scipy_circle(points, [212.0, 270.0, 100.0])
    # A solver that compares costs in doubles stops within √(machine epsilon) of the noise from the minimum.
    np.testing.assert_allclose([*fitted.center_mm, fitted.radius_mm], expected, atol=1e-5 * max(noise, 1e-3))
    distance = np.hypot(*(points - expected[:2]).T)
    assert fitted.circular_deviation_mm == pytest.approx(np.ptp(distance), abs=4e-5 * max(noise, 1e-3))


def test_the_gradient_vanishes_at_the_fit():
    rng = np.random.default_rng(3)
    points = points_on_circle((10.0, -4.0), 30.0, 0.0, 4.0, 50) + rng.normal(scale=0.5, size=(50, 2))
    fitted = fit_circle(points)
    toward = (points - fitted.center_mm) / np.hypot(*(points - fitted.center_mm).T)[:, None]
    np.testing.assert_allclose(fitted.deviation_mm @ toward, 0.0, atol=1e-9)
    assert fitted.deviation_mm.sum() == pytest.approx(0.0, abs=1e-9)


def test_an_ellipse_has_the_deviation_of_its_half_axes():
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    points = np.column_stack([100.3 * np.cos(angle), 99.8 * np.sin(angle)])
    assert fit_circle(points).circular_deviation_mm == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize(
    ("points", "error", "words"),
    [
        (np.zeros((2, 2)), ShapeError, "at least three points"),
        (np.zeros((5, 3)), ShapeError, r"\(5, 3\)"),
        (np.array([[0, 0], [1, 1], [np.nan, 0]]), ShapeError, "point 2"),
        (np.column_stack([np.arange(9.0), 2 * np.arange(9.0)]), GeometryError, "straight line"),
        (np.ones((9, 2)), GeometryError, "straight line"),
    ],
)
def test_what_is_no_circle_is_refused(points, error, words):
    with pytest.raises(error, match=words):
        fit_circle(points)


def test_set_up_takes_away_centre_and_constant_and_nothing_else():
    path = points_on_circle((0.0, 0.0), 100.0, 0.0, 2 * np.pi, 120)
    ellipse = path * (1.0 + 2e-3 * np.cos(2 * np.arctan2(path[:, 1], path[:, 0])))[:, None]
    height = 0.5 * np.sin(np.linspace(0, 4 * np.pi, 120, endpoint=False))
    centre = np.array([0.7, -0.4])
    wave = 5e-3 * np.cos(7 * np.arctan2(path[:, 1], path[:, 0]))
    radius = np.sqrt(((ellipse - centre) ** 2).sum(axis=1) + (height - height.mean()) ** 2) + 0.25
    exact = fit_set_up(ellipse, height, radius)
    np.testing.assert_allclose(exact.center_mm, centre, atol=1e-9)
    assert exact.radius_offset_mm == pytest.approx(0.25, abs=1e-9)
    assert exact.rms_mm < 1e-9
    # A wave of 7 lobes has no part that a centre (1 lobe) or a constant could take, to first order in 0.7/100.
    assert fit_set_up(ellipse, height, radius + wave).rms_mm == pytest.approx(5e-3 / np.sqrt(2), rel=1e-2)


@pytest.mark.parametrize("plane", PLANES)
def test_counter_clockwise_is_seen_from_plus_of_the_third_axis(plane):
    circle = CircleOfCommands(plane, (10.0, 20.0, 30.0), 5.0)
    for clockwise, sign in ((False, 1.0), (True, -1.0)):
        arms = circle.positions_mm(16, clockwise=clockwise) - np.array(circle.center_mm)
        normal = np.cross(arms[0], arms[1])
        assert np.sign(normal[circle.axes[2]]) == sign
        assert np.count_nonzero(np.abs(normal) > 1e-9) == 1
        np.testing.assert_allclose(np.linalg.norm(arms, axis=1), 5.0, atol=1e-12)


def test_both_senses_start_at_the_same_point_and_visit_the_same_points():
    circle = CircleOfCommands("XY", (212.0, 270.0, 0.0), 100.0)
    forward, backward = circle.positions_mm(36), circle.positions_mm(36, clockwise=True)
    np.testing.assert_allclose(forward[0], backward[0])
    np.testing.assert_allclose(forward[1:], backward[1:][::-1], atol=1e-9)


def test_a_circle_that_touches_the_range_fits():
    circle = CircleOfCommands("XY", (100.0, 100.0, 0.0), 100.0)
    assert circle.leaves(np.zeros(3), np.full(3, 200.0), "the range") is None


@pytest.mark.parametrize("plane", PLANES)
@given(
    center=st.tuples(*[st.floats(-50, 450)] * 3),
    radius=st.floats(1, 400),
    high=st.tuples(*[st.floats(100, 500)] * 3),
)
@settings(max_examples=60)
def test_what_a_refusal_says_would_fit_does_fit(plane, center, radius, high):
    low, high = np.zeros(3), np.array(high)
    circle = CircleOfCommands(plane, center, radius)
    problem = circle.leaves(low, high, "the range")
    first, second, third = circle.axes
    reach = np.zeros(3)
    reach[[first, second]] = radius
    inside = bool((np.array(center) - reach >= low).all() and (np.array(center) + reach <= high).all())
    if problem is None:
        assert (np.array(center) - reach >= low - 1e-6).all()
        assert (np.array(center) + reach <= high + 1e-6).all()
        return
    assert not inside
    for offer in what_fits(circle, low, high).removeprefix("would fit: ").split(", or "):
        _, where, _, size = offer.split(" ")
        numbers = [float(number) for number in where.split(",")]
        position = np.array(center)
        position[[first, second]] = numbers[:2]
        if len(numbers) == 3:
            # A level is an end of the range, printed with nine digits.
            position[third] = np.clip(numbers[2], low[third], high[third])
        assert CircleOfCommands(plane, tuple(position), float(size)).leaves(low, high, "the range") is None
