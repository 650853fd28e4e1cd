"""Error functions: derivative, integral and line against differences, SciPy and dense least squares."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from geoerr.simulate.curves import Polyline, draw_wave, fitted_line, from_zero, without_line
from geoerr.simulate.rotations import cross_matrix, looking_along, rotation, rotation_vector

TABLE = Polyline(np.array([0.0, 30.0, 100.0, 220.0, 400.0]), np.array([0.1, -0.3, 0.2, 0.25, -0.4]))


def curves():
    return [draw_wave(np.random.default_rng(seed), -50.0, 400.0, 0.3) for seed in range(3)] + [TABLE]


@pytest.mark.parametrize("curve", curves())
def test_slope_is_the_difference_quotient(curve):
    q = np.array([-20.0, 7.0, 61.0, 149.0, 333.0, 420.0])
    step = 1e-4
    assert np.allclose(curve.slope(q), (curve.at(q + step) - curve.at(q - step)) / (2 * step), atol=1e-9)


@pytest.mark.parametrize("curve", curves())
def test_integral_is_the_area(curve):
    for low, high in ((-80.0, 10.0), (0.0, 400.0), (17.0, 300.0), (380.0, 460.0)):
        area, _ = quad(
            lambda q: float(curve.at(np.array([q]))[0]), low, high, points=[0, 30, 100, 220, 400], limit=200
        )
        ends = curve.integral(np.array([low, high]))
        assert ends[1] - ends[0] == pytest.approx(area, abs=1e-9)


def test_a_drawn_curve_starts_at_zero_and_reaches_its_amplitude():
    curve = draw_wave(np.random.default_rng(9), 10.0, 250.0, 0.42)
    value = curve.at(np.linspace(10.0, 260.0, 401))
    assert value[0] == pytest.approx(0.0, abs=1e-15)
    assert np.abs(value).max() == pytest.approx(0.42, rel=1e-12)


def test_the_line_is_that_of_a_dense_uniform_grid():
    curve = curves()[0]
    # Midpoints: their sums differ from the integrals by 1/n² only.
    q = 20.0 + 280.0 * (np.arange(20_000) + 0.5) / 20_000
    slope, mean = np.polyfit(q - 160.0, curve.at(q), 1)
    found_mean, found_slope = fitted_line(curve.at, 20.0, 300.0)
    assert float(found_slope) == pytest.approx(slope, rel=1e-6)
    assert float(found_mean) == pytest.approx(mean, rel=1e-6)


def test_without_line_leaves_no_slope_and_starts_at_zero():
    straight = without_line(curves()[1].at, 0.0, 350.0)
    assert float(fitted_line(straight, 0.0, 350.0)[1]) == pytest.approx(0.0, abs=1e-16)
    assert straight(np.array([0.0]))[0] == 0.0
    assert from_zero(TABLE.at, 30.0)(np.array([30.0, 100.0])).tolist() == [0.0, 0.5]


vectors = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3).map(np.array)


@settings(max_examples=50)
@given(vectors)
def test_rotation_agrees_with_scipy_and_comes_back(vector):
    matrix = rotation(vector)
    assert np.allclose(matrix, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
    assert np.allclose(rotation_vector(matrix), vector, atol=1e-7 if np.linalg.norm(vector) > 2.5 else 1e-13)


def test_a_view_has_right_down_forward():
    turn = looking_along(np.array([0.0, 2.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert np.allclose(turn, np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))
    assert np.allclose(cross_matrix(np.array([1.0, 2, 3])) @ [4, 5, 6], np.cross([1, 2, 3], [4, 5, 6]))
