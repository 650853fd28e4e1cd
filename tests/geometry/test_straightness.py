"""Straightness from Python: SciPy's rules, mpmath, the gauge, propagation, refusals."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson, cumulative_trapezoid, quad
from scipy.interpolate import interp1d

from geoerr.errors import GeoerrError, GeometryError, ShapeError
from geoerr.geometry import integrate_straightness, remove_line

Array = npt.NDArray[np.float64]
SPACINGS = {
    "even": np.linspace(0.0, 400.0, 41),
    "uneven": np.cumsum(np.random.default_rng(2).uniform(2.0, 20.0, 38)) - 150.0,
    "three": np.array([0.0, 10.0, 35.0]),
    "two": np.array([3.0, 8.0]),
}


def angles(position_mm: Array, n_functions: int) -> Array:
    return 50e-6 * np.random.default_rng(4).standard_normal((n_functions, len(position_mm)))


@pytest.mark.parametrize("spacing", SPACINGS)
def test_agrees_with_scipy(spacing: str) -> None:
    position = SPACINGS[spacing]
    angle = angles(position, 5)
    trapezoid = cumulative_trapezoid(angle, position, initial=0.0)
    found = integrate_straightness(position, angle)
    # Sums up to 1e-2 mm of some forty terms, rounded otherwise.
    np.testing.assert_allclose(found, remove_line(position, trapezoid), rtol=0.0, atol=1e-16)
    if len(position) > 2:
        simpson = cumulative_simpson(angle, x=position, initial=0.0)
        found = integrate_straightness(position, angle, "simpson")
        np.testing.assert_allclose(found, remove_line(position, simpson), rtol=0.0, atol=1e-16)


def fifty_digits(position: Array, values: Array) -> list[mp.mpf]:
    """Give the gauge by its definition: integrals of the interpolant's pieces and the 2x2 normal equations."""
    with mp.workdps(50):
        x, f = [mp.mpf(v) for v in position.tolist()], [mp.mpf(v) for v in values.tolist()]
        moments = [mp.mpf(0)] * 3
        right = [mp.mpf(0)] * 2
        for k in range(len(x) - 1):
            slope = (f[k + 1] - f[k]) / (x[k + 1] - x[k])
            constant = f[k] - slope * x[k]
            powers = [(x[k + 1] ** n - x[k] ** n) / n for n in (1, 2, 3)]
            moments = [m + p for m, p in zip(moments, powers, strict=True)]
            right[0] += constant * powers[0] + slope * powers[1]
            right[1] += constant * powers[1] + slope * powers[2]
        (s0, s1, s2), (r0, r1) = moments, right
        slope = (s0 * r1 - s1 * r0) / (s0 * s2 - s1 * s1)
        return [value - f[0] - slope * (at - x[0]) for value, at in zip(f, x, strict=True)]


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_removed_line_matches_fifty_digits(spacing: str, offset: float) -> None:
    position = SPACINGS[spacing]
    values = angles(position, 1)[0] + offset * 1e-3
    exact = [float(value) for value in fifty_digits(position, values)]
    # Each value is rounded when the first is taken off it, and the slope's sum once for each of forty terms.
    atol = 10.0 * np.finfo(float).eps * np.abs(values - values[0]).max()
    np.testing.assert_allclose(remove_line(position, values), exact, rtol=0.0, atol=atol)


@pytest.mark.parametrize("spacing", SPACINGS)
def test_trapezoid_matches_fifty_digits(spacing: str) -> None:
    position = SPACINGS[spacing]
    angle = angles(position, 1)[0]
    with mp.workdps(50):
        x, f = [mp.mpf(v) for v in position.tolist()], [mp.mpf(v) for v in angle.tolist()]
        integral = [mp.mpf(0)]
        for k in range(len(x) - 1):
            integral.append(integral[-1] + (f[k] + f[k + 1]) * (x[k + 1] - x[k]) / 2)
    rounded = np.array([float(value) for value in integral])
    exact = [float(value) for value in fifty_digits(position, rounded)]
    atol = 40.0 * np.finfo(float).eps * np.abs(rounded).max()
    np.testing.assert_allclose(integrate_straightness(position, angle), exact, rtol=0.0, atol=atol)


def test_gauge_is_of_the_range_and_not_of_the_samples() -> None:
    """Samples crowd at one end: the samples' own line would have another slope."""
    position = np.concatenate([np.linspace(0.0, 20.0, 40), [200.0, 400.0]])
    values = np.sin(position / 90.0)
    removed = remove_line(position, values)
    table = interp1d(position, removed)
    moment = quad(lambda x: (x - 200.0) * table(x), 0.0, 400.0, points=position[1:-1], limit=200)[0]
    assert abs(moment) < 1e-8
    assert removed[0] == 0.0
    assert abs(np.polyfit(position, removed, 1)[0]) > 1e-4
    # A grid of n points counts the ends' halves of a step too much: 6 |f| / (n L) of slope.
    uniform = np.linspace(0.0, 400.0, 100_001)
    grid_error = 6.0 * np.abs(removed).max() / (100_001 * 400.0)
    assert abs(np.polyfit(uniform, table(uniform), 1)[0]) < grid_error


def test_identity_gives_the_operator_for_propagation() -> None:
    """The covariance of straightness through the operator equals that of simulated angles."""
    position = SPACINGS["uneven"]
    sigma_rad = np.random.default_rng(8).uniform(5e-6, 2e-5, len(position))
    operator = integrate_straightness(position, np.eye(len(position)))
    noise = np.random.default_rng(9).standard_normal((20_000, len(position))) * sigma_rad
    simulated = integrate_straightness(position, noise)
    np.testing.assert_allclose(noise @ operator, simulated, rtol=0.0, atol=1e-16)
    stated = np.sqrt((sigma_rad[:, None] ** 2 * operator**2).sum(axis=0))
    # A sample's standard deviation differs by 1/sqrt(2 n): five of those.
    np.testing.assert_allclose(simulated.std(axis=0)[1:], stated[1:], rtol=5.0 / np.sqrt(2 * 20_000))
    assert stated[0] == 0.0


@settings(max_examples=200)
@given(
    steps=st.lists(st.floats(0.5, 50.0), min_size=1, max_size=30),
    constant=st.floats(-1e-3, 1e-3),
    slope=st.floats(-1e-5, 1e-5),
    rule=st.sampled_from(["trapezoid", "simpson"]),
)
def test_a_constant_angle_is_squareness_and_a_linear_one_a_parabola(
    steps: list[float], constant: float, slope: float, rule: str
) -> None:
    position = np.concatenate([[0.0], np.cumsum(steps)])
    angle = constant + slope * position
    found = integrate_straightness(position, angle, rule)
    parabola = remove_line(position, 0.5 * slope * position**2)
    # Integrals up to 1.5 mm and 20 mm, Simpson weights up to a hundred steps.
    np.testing.assert_allclose(found, parabola, rtol=0.0, atol=1e-12)


def test_one_function_or_many() -> None:
    position = SPACINGS["even"]
    angle = angles(position, 3)
    many = integrate_straightness(position, angle)
    assert many.shape == angle.shape
    one = integrate_straightness(position, angle[1])
    assert one.shape == position.shape
    np.testing.assert_array_equal(many[1], one)
    angle[0, 7] = np.nan
    spoiled = integrate_straightness(position, angle)
    assert np.isnan(spoiled[0]).all()
    np.testing.assert_array_equal(spoiled[1:], many[1:])
    assert integrate_straightness(position, np.empty((0, len(position)))).shape == (0, len(position))
    # As what is masked does.
    masked = np.ma.masked_invalid(angle)
    masked.data[0, 7] = 0.0
    np.testing.assert_array_equal(integrate_straightness(position, masked), spoiled)


def test_same_bytes_for_any_number_of_threads() -> None:
    position = SPACINGS["uneven"]
    angle = angles(position, 3000)
    results = [integrate_straightness(position, angle, "simpson", threads=n).tobytes() for n in (1, 2, 8, 0)]
    assert len(set(results)) == 1


def test_refusals_name_argument_and_index() -> None:
    values = np.zeros(3)
    with pytest.raises(GeometryError, match="position 2 is 1 mm after 2 mm: positions must rise"):
        integrate_straightness([0.0, 2.0, 1.0], values)
    with pytest.raises(GeometryError, match="position 1 is 0 mm after 0 mm"):
        remove_line([0.0, 0.0, 1.0], values)
    with pytest.raises(GeometryError, match="position 0 is NaN, not a finite number"):
        remove_line([np.nan, 0.0, 1.0], values)
    with pytest.raises(ShapeError, match=r"angle_rad must have shape .* n = 2 positions, got \(3,\)"):
        integrate_straightness([0.0, 1.0], values)
    with pytest.raises(ShapeError, match=r"position_mm must have shape \(n,\), got \(1, 3\)"):
        remove_line([[0.0, 1.0, 2.0]], values)
    with pytest.raises(ShapeError, match="1 positions: a range needs at least two"):
        remove_line([0.0], [1.0])
    with pytest.raises(GeoerrError, match=r"^rule cannot be 'cubic'\nhint: write one of 'trapezoid', 'simpson'$"):
        integrate_straightness([0.0, 1.0, 2.0], values, "cubic")  # type: ignore[arg-type]  # a rule that is none
