"""How smooth each error function is: told by the data, and stated.

A function with as many splines as positions follows noise; one with few cannot follow the axis. Between the two
stands a prior on its curvature: `∫ f''(q)² dq` of the order of τ², whose τ the data choose. The rich fit gives f with
covariance V; the curvature's part z = D f of it is normal with covariance D V Dᵀ + τ², and τ is where that is most
likely (restricted maximum likelihood; lines are left free, so that neither scale nor squareness is pulled to 0).

The prior is a row of the least-squares problem like a measurement, and only what the rank analysis without it found
determined is reported as determined. Its intervals hold the truth on average over the axis (Nychka 1988).

Source: Wahba, *Spline Models for Observational Data*, 1990; Wood 2011 (restricted likelihood). Verified:
tests/fit/test_smoothness.py, validation/joint.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.bases import basis_of
from geoerr.fit.sightings import Numbers
from geoerr.terms import BasisSpec, Term

# Trial values of τ, from nothing but lines to no prior at all.
_TRIALS = 161
_DECADES = 8.0
# The roughest curve whose −2 log likelihood is within this of the best is taken: 1.4 standard errors of τ. A
# curvature lost in the noise has its best guess at 0 in half of the cases; an interval that believed it is too short.
_BENEFIT_OF_DOUBT = 2.0
# What the data do not determine has a variance beyond all others by this factor.
_UNKNOWN = 1e8
_HALF_GAUSS = 0.5 / np.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class Smoothness:
    """The curvature that the data found one function to have.

    Attributes
    ----------
    name
        ISO name.
    basis
        The splines that it is made of.
    rows : (r, k)
        Rows on its coefficients that hold the curvature: `rows · c` has unit variance.
    n_free
        Effective number of coefficients: 2 for a line.
    curvature
        τ: root of the expected ∫ f''² dq, in mm or rad over mm^1.5.
    """

    name: str
    basis: BasisSpec
    rows: Numbers
    n_free: float
    curvature: float


def curvature_rows(spec: BasisSpec) -> Numbers | None:
    """Give D (r, k) with |D c|² = ∫ f''(q)² dq for a cubic spline; None for other bases.

    f'' is a straight line in each piece, so that two Gauss points are exact; f' is a parabola, and a difference is.
    """
    if spec.kind != "bspline" or spec.degree != 3 or spec.is_tangent_integral:
        return None
    basis = basis_of(spec)
    knots = np.array(spec.knots_mm)
    length, middle = np.diff(knots), 0.5 * (knots[1:] + knots[:-1])
    rows = []
    for side in (-1.0, 1.0):
        at, step = middle + side * _HALF_GAUSS * length, 0.1 * length
        second = (basis.derivative(at + step) - basis.derivative(at - step)) / (2.0 * step)[:, None]
        rows.append(second * np.sqrt(0.5 * length)[:, None])
    return np.concatenate(rows)


def choose_smoothness(
    undecided: Sequence[Term], fitted: Sequence[Term], covariance: Numbers, null_space: Numbers
) -> tuple[Smoothness, ...]:
    """Find how smooth each undecided function is, from the fit with rich bases.

    Parameters
    ----------
    undecided
        Terms of functions whose smoothness is to be found.
    fitted
        All terms of the rich fit, with values.
    covariance, null_space
        Of its parameters.
    """
    wanted = {term.id for term in undecided}
    found, first = [], 0
    for term in fitted:
        own = slice(first, first + len(term.coefficients))
        first = own.stop
        spec = term.parts[0].basis
        if term.id not in wanted or spec is None:
            continue
        rows = curvature_rows(spec)
        if rows is None:
            continue
        values = np.array([parameter.value for parameter in term.coefficients])
        found.append(_of_function(term.id, spec, rows, values, covariance[own, own], null_space[own]))
    return tuple(found)


def _of_function(
    name: str, spec: BasisSpec, rows: Numbers, values: Numbers, covariance: Numbers, null_space: Numbers
) -> Smoothness:
    _, size, turned = np.linalg.svd(rows, full_matrices=False)
    # Two combinations are straight lines: they have no curvature.
    bent = size[: len(values) - 2, None] * turned[: len(values) - 2]
    spread = bent @ covariance @ bent.T
    largest = float(np.trace(spread)) or 1.0
    loose = bent @ null_space
    if loose.size and np.abs(loose).max() > 0.0:
        spread = spread + _UNKNOWN * largest * (loose @ loose.T) / float((loose**2).sum())
    variance, direction = np.linalg.eigh(spread)
    variance = np.maximum(variance, 1e-15 * float(variance[-1]))
    along = (direction.T @ (bent @ values)) ** 2
    known = variance < 0.01 * _UNKNOWN * largest
    if not known.any():
        return Smoothness(name, spec, bent / np.sqrt(largest), 2.0, float(np.sqrt(largest)))
    middle = float(np.median(variance[known]))
    trials = middle * 10.0 ** np.linspace(-_DECADES, _DECADES, _TRIALS)
    total = variance[known][None, :] + trials[:, None]
    unlikelihood = (np.log(total) + along[known][None, :] / total).sum(axis=1)
    chosen = float(trials[unlikelihood <= unlikelihood.min() + _BENEFIT_OF_DOUBT][-1])
    n_free = 2.0 + float((chosen / (variance[known] + chosen)).sum())
    return Smoothness(name, spec, bent / np.sqrt(chosen), n_free, float(np.sqrt(chosen)))


def prior_rows(terms: Sequence[Term], smoothness: Mapping[str, Smoothness], n_columns: int) -> Numbers:
    """Give the rows (r, n_columns) of the whitened system that hold the curvature of these terms' functions."""
    rows, first = [], 0
    for term in terms:
        own = slice(first, first + len(term.coefficients))
        first = own.stop
        if term.id in smoothness:
            block = np.zeros((len(smoothness[term.id].rows), n_columns))
            block[:, own] = smoothness[term.id].rows
            rows.append(block)
    return np.concatenate(rows) if rows else np.zeros((0, n_columns))
