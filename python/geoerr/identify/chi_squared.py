"""The chi-squared distribution's upper tail, for tests of scatter and of disagreement."""

from __future__ import annotations

import math

_TINY = 1e-300
_EPSILON = 1e-15
_MAX_TERMS = 100_000


def chi_squared_p_value(value: float, dof: float) -> float:
    """Give the probability that a chi-squared variable with `dof` degrees of freedom exceeds `value`.

    Q(dof/2, value/2), the regularized upper incomplete gamma function: its power series below dof/2 + 1, its
    continued fraction (modified Lentz) above. Against SciPy: tests/identify/test_chi_squared.py.
    """
    if dof <= 0.0:
        return math.nan
    if value <= 0.0:
        return 1.0
    shape, x = dof / 2.0, value / 2.0
    scale = math.exp(shape * math.log(x) - x - math.lgamma(shape))
    if x < shape + 1.0:
        return max(0.0, 1.0 - scale * _lower_series(shape, x))
    return scale * _upper_fraction(shape, x)


def _lower_series(shape: float, x: float) -> float:
    term = total = 1.0 / shape
    for index in range(1, _MAX_TERMS):
        term *= x / (shape + index)
        total += term
        if term < total * _EPSILON:
            break
    return total


def _upper_fraction(shape: float, x: float) -> float:
    b = x + 1.0 - shape
    c = 1.0 / _TINY
    d = 1.0 / b
    product = d
    for index in range(1, _MAX_TERMS):
        a = -index * (index - shape)
        b += 2.0
        d = 1.0 / _away_from_zero(a * d + b)
        c = _away_from_zero(b + a / c)
        product *= d * c
        if abs(d * c - 1.0) < _EPSILON:
            break
    return product


def _away_from_zero(value: float) -> float:
    return value if abs(value) > _TINY else _TINY
