"""From the description of a basis to the core's functions."""

from __future__ import annotations

from typing import assert_never

import numpy as np

from geoerr import _core
from geoerr.terms import BasisSpec


def basis_of(spec: BasisSpec) -> _core.Basis:
    """Build the functions that a specification describes.

    Polynomials are Legendre polynomials of `(2q − low − high)/(high − low)`, Fourier functions
    `1, cos ωq, sin ωq, cos 2ωq, ...` with `ω = 2π/period`; coefficients of elements are values at the nodes. Outside
    its range a function keeps its end value.

    Raises
    ------
    GeometryError
        for positions that do not rise, and degrees, orders or periods beyond what is exact to rounding.
    ShapeError
        for too few or too many positions.
    """
    basis = _plain(spec)
    return _core.Basis.tangent_integral(basis) if spec.is_tangent_integral else basis


def _plain(spec: BasisSpec) -> _core.Basis:
    knots = np.array(spec.knots_mm, dtype=np.float64)
    match spec.kind:
        case "bspline":
            assert spec.degree is not None
            return _core.Basis.bspline(knots, spec.degree)
        case "polynomial":
            assert spec.low_mm is not None
            assert spec.high_mm is not None
            assert spec.degree is not None
            return _core.Basis.polynomial(spec.low_mm, spec.high_mm, spec.degree)
        case "fourier":
            assert spec.low_mm is not None
            assert spec.high_mm is not None
            assert spec.period_mm is not None
            assert spec.order is not None
            return _core.Basis.fourier(spec.low_mm, spec.high_mm, spec.period_mm, spec.order)
        case "linear":
            return _core.Basis.linear_elements(knots)
        case "quadratic":
            return _core.Basis.quadratic_elements(knots)
        case _:
            assert_never(spec.kind)
