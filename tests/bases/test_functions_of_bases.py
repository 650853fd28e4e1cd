"""Bases from Python: SciPy's B-splines, NumPy's Legendre series, quadrature, descriptions, refusals."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Legendre
from scipy.integrate import quad
from scipy.interpolate import BSpline

from geoerr import _core
from geoerr.bases import basis_of
from geoerr.errors import GeometryError, ShapeError
from geoerr.terms import BasisSpec

Array = npt.NDArray[np.float64]


def scipy_splines(knots: Array, degree: int) -> list[BSpline]:
    clamped = np.concatenate(([knots[0]] * degree, knots, [knots[-1]] * degree))
    n = len(clamped) - degree - 1
    return [BSpline(clamped, np.eye(n)[j], degree) for j in range(n)]


@st.composite
def knot_vectors(draw: st.DrawFn) -> tuple[Array, int]:
    degree = draw(st.integers(0, 4))
    steps = draw(st.lists(st.floats(0.5, 60.0), min_size=1, max_size=10))
    knots = np.concatenate(([0.0], np.cumsum(steps))) + draw(st.floats(-300.0, 300.0))
    repeats = np.ones(len(knots), dtype=int)
    if len(knots) > 2:
        repeats[1:-1] = draw(
            st.lists(st.integers(1, max(degree, 1)), min_size=len(knots) - 2, max_size=len(knots) - 2)
        )
    return np.repeat(knots, repeats), degree


@given(knot_vectors())
@settings(max_examples=150)
def test_splines_agree_with_scipy(case: tuple[Array, int]) -> None:
    knots, degree = case
    basis = _core.Basis.bspline(knots, degree)
    theirs = scipy_splines(knots, degree)
    assert len(basis) == len(theirs)
    # Not at knots: there SciPy takes values and slopes of splines that jump from one side or the other.
    inside = knots[0] + (knots[-1] - knots[0]) * np.linspace(0.001, 0.998, 41)
    inside = inside[np.abs(inside[:, None] - knots).min(axis=1) > 1e-9]
    values = np.array([spline(inside) for spline in theirs]).T
    np.testing.assert_allclose(basis.evaluate(inside), values, rtol=0.0, atol=1e-14)
    if degree:
        slopes = np.array([spline.derivative()(inside) for spline in theirs]).T
        # Slopes up to degree over the shortest cell, 0.5 mm.
        np.testing.assert_allclose(basis.derivative(inside), slopes, rtol=0.0, atol=1e-13)
    integrals = np.array([spline.antiderivative()(inside) - spline.antiderivative()(knots[0]) for spline in theirs]).T
    # Areas up to 240 mm.
    np.testing.assert_allclose(basis.integral(inside), integrals, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("degree", range(13))
def test_polynomials_agree_with_numpy(degree: int) -> None:
    basis = _core.Basis.polynomial(-120.0, 310.0, degree)
    q = np.linspace(-120.0, 310.0, 73)
    theirs = [Legendre.basis(n, domain=[-120.0, 310.0]) for n in range(degree + 1)]
    # NumPy maps the ends to 1 but for one rounding, where P'_n = n(n+1)/2 is up to 78, P''_n up to 3003.
    epsilon = np.finfo(np.float64).eps
    values = np.array([p(q) for p in theirs]).T
    np.testing.assert_allclose(basis.evaluate(q), values, rtol=0.0, atol=78.0 * epsilon)
    slopes = np.array([p.deriv()(q) for p in theirs]).T
    np.testing.assert_allclose(basis.derivative(q), slopes, rtol=0.0, atol=3003.0 * epsilon / 215.0)
    integrals = np.array([p.integ(lbnd=-120.0)(q) for p in theirs]).T
    np.testing.assert_allclose(basis.integral(q), integrals, rtol=0.0, atol=3e-13)


def test_waves_by_their_definition() -> None:
    basis = _core.Basis.fourier(20.0, 150.0, 47.0, 3)
    q = np.linspace(20.0, 150.0, 57)
    angles = [2.0 * np.pi * k * q / 47.0 for k in (1, 2, 3)]
    expected = np.column_stack([np.ones_like(q), *(f(a) for a in angles for f in (np.cos, np.sin))])
    # Arguments up to 60 rad carry a rounding of 1e-14.
    np.testing.assert_allclose(basis.evaluate(q), expected, rtol=0.0, atol=2e-14)


SPECS = [
    BasisSpec("bspline", "x", knots_mm=(0.0, 30.0, 200.0, 260.0, 400.0), degree=3),
    BasisSpec("polynomial", "x", degree=5, low_mm=-50.0, high_mm=350.0),
    BasisSpec("fourier", "x", low_mm=10.0, high_mm=210.0, period_mm=300.0, order=2),
    BasisSpec("linear", "x", knots_mm=(0.0, 55.0, 400.0)),
    BasisSpec("quadratic", "x", knots_mm=(0.0, 50.0, 120.0, 200.0, 400.0)),
]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.kind)
def test_tangent_integrals_by_quadrature(spec: BasisSpec) -> None:
    """Li Eq. 19 the long way: SciPy's integrals, and the line by the 2x2 normal equations."""
    angle = basis_of(spec)
    fields = {name: getattr(spec, name) for name in BasisSpec.__dataclass_fields__}
    straightness = basis_of(BasisSpec(**{**fields, "is_tangent_integral": True}))
    low, high = angle.range
    assert straightness.range == (low, high)
    assert len(straightness) == len(angle) == spec.n_functions
    middle = 0.5 * (low + high)
    breaks = list(angle.kinks()) + list(spec.knots_mm)

    def one(j: int, q: float) -> float:
        return float(angle.value_row(q)[j])

    def integral(j: int, q: float) -> float:
        inner = sorted({b for b in breaks if low < b < q})
        return float(sum(quad(lambda s: one(j, s), a, b)[0] for a, b in zip([low, *inner], [*inner, q], strict=True)))

    for j in range(len(angle)):
        # ∫(q − m)F = ∫ (q' − m) ∫ f, by SciPy from the integral's values at Gauss points of every piece.
        ends = sorted({low, high, *breaks})
        moment = 0.0
        for a, b in itertools.pairwise(ends):
            place, share = np.polynomial.legendre.leggauss(12)
            q = 0.5 * (a + b) + 0.5 * (b - a) * place
            moment += 0.5 * (b - a) * float(share @ [(at - middle) * integral(j, at) for at in q])
        slope = 12.0 * moment / (high - low) ** 3
        for q in (low, 0.3 * low + 0.7 * high, high):
            expected = integral(j, q) - slope * (q - low)
            assert straightness.value_row(q)[j] == pytest.approx(expected, abs=1e-10 * (high - low))


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.kind)
def test_curves_and_shapes(spec: BasisSpec) -> None:
    basis = basis_of(spec)
    coefficients = np.random.default_rng(3).standard_normal(len(basis))
    q = np.linspace(-100.0, 500.0, 77)
    curve = basis.curve(coefficients)
    assert basis.evaluate(q).shape == basis.derivative(q).shape == basis.integral(q).shape == (77, len(basis))
    np.testing.assert_allclose(curve.evaluate(q), basis.evaluate(q) @ coefficients, rtol=0.0, atol=1e-12)
    both = curve.plus(_core.Curve.constant(2.0))
    np.testing.assert_allclose(both.evaluate(q), curve.evaluate(q) + 2.0, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(both.kinks(), basis.kinks())
    away = q[np.abs(q[:, None] - basis.kinks()).min(axis=1) > 1e-9]
    np.testing.assert_allclose(curve.derivative(away), basis.derivative(away) @ coefficients, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(basis.value_row(33.0), basis.evaluate(np.array([33.0]))[0])
    assert basis.evaluate(np.array([])).shape == (0, len(basis))
    assert np.isnan(basis.evaluate(np.array([np.nan, 1.0]))).all(axis=1).tolist() == [True, False]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.kind)
def test_rows_are_the_line_over_a_fine_grid(spec: BasisSpec) -> None:
    basis = basis_of(spec)
    low, high = basis.range
    grid = low + (high - low) * (np.arange(20_000) + 0.5) / 20_000
    slope, mean = np.polyfit(grid - 0.5 * (low + high), basis.evaluate(grid), 1)
    # The midpoint rule's own error, of second order in 1/20000.
    np.testing.assert_allclose(basis.mean_row(), mean, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(basis.slope_row() * (high - low), slope * (high - low), rtol=0.0, atol=1e-7)


REFUSED = [
    (lambda: _core.Basis.linear_elements(np.array([0.0, 2.0, 1.0])), GeometryError, "node 2 is 1 mm after 2 mm"),
    (lambda: _core.Basis.linear_elements(np.array([0.0])), ShapeError, "1 nodes: at least 2"),
    (lambda: _core.Basis.linear_elements(np.arange(5000.0)), ShapeError, "5000 functions: at most 4096"),
    (lambda: _core.Basis.quadratic_elements(np.arange(4.0)), ShapeError, "4 nodes: three-node elements"),
    (lambda: _core.Basis.bspline(np.array([0.0, np.nan, 1.0]), 3), GeometryError, "knot 1 is NaN"),
    (lambda: _core.Basis.bspline(np.array([0.0, 1.0]), 5), GeometryError, "degree 5: at most 4"),
    (lambda: _core.Basis.bspline(np.array([0.0, 0.0, 1.0]), 2), GeometryError, "repeated 2 times: at most 1"),
    (lambda: _core.Basis.bspline(np.zeros(8)[::2], 2), ShapeError, "C-contiguous"),
    (lambda: _core.Basis.fourier(0.0, 400.0, 1e6, 1), GeometryError, "a period of 1000000 mm"),
    (lambda: basis_of(SPECS[0]).curve(np.zeros(3)), ShapeError, "3 coefficients: 7 are needed"),
    (lambda: basis_of(SPECS[3]).curve(np.array([0.0, np.inf, 0.0])), GeometryError, "coefficient 1 is inf"),
    (
        lambda: _core.Basis.tangent_integral(_core.Basis.tangent_integral(basis_of(SPECS[3]))),
        GeometryError,
        "a tangent integral of a tangent integral",
    ),
    (lambda: _core.Hexahedra(np.arange(2.0), np.arange(2.0), np.zeros(1)), ShapeError, "1 grid lines"),
]


@pytest.mark.parametrize(("make", "kind", "message"), REFUSED)
def test_what_does_not_fit_is_refused(make: object, kind: type[Exception], message: str) -> None:
    assert callable(make)
    with pytest.raises(kind, match=message):
        make()
