"""Commanded points of a circular test: put back on the circle that files round them off."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from geoerr.commanded_circle import circle_through, coarse_step_mm, on_their_circle, plane_of

CENTRE_MM, RADIUS_MM = np.array([210.1234567, 50.0, 260.7654321]), 99.87654
ANGLE_RAD = np.linspace(0.1, 5.9, 181)


def circle_in_zx() -> npt.NDArray[np.float64]:
    """Give points in the plane of z and x: y stands still."""
    return CENTRE_MM + RADIUS_MM * np.column_stack([np.sin(ANGLE_RAD), 0.0 * ANGLE_RAD, np.cos(ANGLE_RAD)])


@pytest.mark.parametrize("digits", [2, 3, 4])
def test_rounded_points_come_back_to_a_fifth_of_what_their_radii_were_off(digits: int) -> None:
    exact = circle_in_zx()
    rounded = np.round(exact, digits)
    placed = on_their_circle(rounded)
    first, second, third = plane_of(rounded)
    assert (first, second, third) == (2, 0, 1)

    def radii_mm(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.hypot(*(points - CENTRE_MM)[:, [first, second]].T)

    off, still_off = (np.abs(radii_mm(points) - RADIUS_MM).max() for points in (rounded, placed))
    assert off > 0.5 * 10.0**-digits
    # Centre and radius of 181 points: a thirtieth of a step, and seldom three times that.
    assert still_off < 0.2 * off
    assert np.abs(placed - rounded).max() <= off + still_off


def test_points_that_no_rounding_explains_stay_where_they_are() -> None:
    exact = circle_in_zx()
    # Two digits more than they are off by: read from encoders, not rounded.
    read = np.round(exact, 5) + np.round(0.001 * np.sin(7.0 * ANGLE_RAD), 5)[:, None] * [1.0, 0.0, 0.0]
    for points in (exact, read, np.round(exact), np.round(exact[:2], 3)):
        assert np.array_equal(on_their_circle(points), points)


def test_centre_and_radius_are_those_of_the_points() -> None:
    centre_mm, radius_mm = circle_through(circle_in_zx()[:, [2, 0]])
    assert centre_mm == pytest.approx(CENTRE_MM[[2, 0]], abs=1e-9)
    assert radius_mm == pytest.approx(RADIUS_MM, abs=1e-9)


def test_a_coarse_grid_is_told_and_left_as_it_is() -> None:
    exact = circle_in_zx()
    for digits, step_mm in ((0, 1.0), (1, 0.1), (2, None), (6, None)):
        points = np.round(exact, digits)
        assert coarse_step_mm(points) == step_mm
        if step_mm is not None:
            assert np.array_equal(on_their_circle(points), points)
    assert coarse_step_mm(exact) is None
    # The ends of two diameters are whole numbers, and on the circle.
    ends = np.array([[300.0, 200.0, 0.0], [200.0, 300.0, 0.0], [100.0, 200.0, 0.0], [200.0, 100.0, 0.0]])
    assert coarse_step_mm(ends) is None
