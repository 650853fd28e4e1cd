"""Where the size of the residual depends on a variable: an error that turns its sign within the bins of a trend.

Of sin(x)·(T − T₀) every bin of T has the mean 0. Its squares tell: with u the square of what a row is off from the
mean of its bin, over what noise alone would leave there, and ū its mean, each pass p and class c have

    g_pc = Σ (1_c − n_c / N) (u − ū)   over the rows of the pass,    Q = (Σ_p g_p)' (Σ_p g_p g_p')⁻¹ (Σ_p g_p).

Passes are independent, rows of one pass are not: of k + 1 classes Q is χ²(k) where nothing depends on the variable.
The score test with sums of passes; it is never more than the number of passes, so that few of them tell nothing.
Verified by `test_of_noise_alone_no_size_follows_anything`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.components import Component, components_of
from geoerr.diagnose.trends import bins_of, trend_of, variables_of
from geoerr.distributions import chi_squared_sf
from geoerr.fit import Fitted
from geoerr.fit.lengths import told_in_base_axes
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES
from geoerr.observations import PIXELS

# Seldom by chance over all that is looked at.
_SELDOM = 0.01
# So many passes a class: fewer classes of few passes.
_PASSES_A_CLASS = 4
# Of what the fit follows nearly whole, squares tell rounding.
_LEAST_SHARE = 0.05
# What is left of exact data is rounding.
_LEAST_UM = 1e-4
_BLOCK_ROWS = 2048


@dataclass(frozen=True)
class SpreadTrend:
    """How the spread of one component of the residual differs over one variable.

    Attributes
    ----------
    variable, component
        As of a `Trend`.
    p_value
        That it differs as much by chance, over all variables and components that were looked at.
    least_um, most_um
        The smallest and the largest root mean square of a bin about its mean.
    """

    variable: str
    component: str
    p_value: float
    least_um: float
    most_um: float

    @property
    def stands_out(self) -> bool:
        """Whether chance would seldom do as much."""
        return self.p_value < _SELDOM


def spread_trends_of(fitted: Fitted) -> tuple[SpreadTrend, ...]:
    """Give them all, the surest first, those over pixels behind all others."""
    components = [one for one in components_of(fitted) if _rms(one.residual_um[one.is_known]) > _LEAST_UM]
    if not components:
        return ()
    variance = _variance_of_noise(fitted)
    own = [variance[:, AXES.index(one.name) if one.name in AXES else 0] for one in components]
    found = [
        _spread_trend(fitted, name, values, component, variances)
        for name, values in variables_of(fitted).items()
        for component, variances in zip(components, own, strict=True)
    ]
    told = [one for one in found if one is not None]
    corrected = [replace(one, p_value=min(len(told) * one.p_value, 1.0)) for one in told]
    return tuple(sorted(corrected, key=lambda one: (one.variable in PIXELS, one.p_value)))


def spreads_to_tell(found: Sequence[SpreadTrend], least_um: float) -> list[SpreadTrend]:
    """Give those beyond chance that differ by at least so much: the surest component of each variable.

    Of variables that part the rows alike the first is told.
    """
    told: dict[str, SpreadTrend] = {}
    for one in found:
        is_known = any(replace(other, variable=one.variable) == one for other in told.values())
        if one.stands_out and one.most_um - one.least_um >= least_um and not is_known:
            told.setdefault(one.variable, one)
    return list(told.values())


def _spread_trend(
    fitted: Fitted, name: str, values: Numbers, component: Component, variance: Numbers
) -> SpreadTrend | None:
    """Test one component over one variable by itself; None where too few rows or passes tell anything."""
    known = np.isfinite(values) & component.is_known
    known &= variance > _LEAST_SHARE * float(np.median(variance[known])) if known.any() else known
    number, spans = bins_of(values[known])
    if len(spans) < 2:
        return None
    counts = np.bincount(number)
    residual_um = component.residual_um[known]
    deviation = residual_um - (np.bincount(number, weights=residual_um) / counts)[number]
    several = counts[number] > 1
    squares = deviation**2 / variance[known] * (counts / np.maximum(counts - 1, 1))[number]
    own_pass = np.unique(fitted.sightings.pass_number[known], return_inverse=True)[1]
    p_value = _chance(squares[several], number[several], own_pass[several])
    if p_value is None:
        return None
    spreads = [one.spread_um for one in trend_of(fitted.sightings, name, values, component).bins if one.n > 1]
    return SpreadTrend(name, component.name, p_value, min(spreads), max(spreads))


def _chance(squares: Numbers, number: np.ndarray, own_pass: np.ndarray) -> float | None:
    """Give how rarely squares (n,) differ as much from bin to bin, numbered (n,), by chance; None: too few passes."""
    passes = np.unique(own_pass)
    n_bins = int(number.max(initial=0)) + 1
    n_classes = min(n_bins, max(2, len(passes) // _PASSES_A_CLASS))
    dof = n_classes - 1
    if len(passes) <= dof or n_bins < 2:
        return None
    # Neighbouring bins are one class; what is in the last is not in the others.
    in_class = np.eye(n_classes)[number * n_classes // n_bins][:, :-1]
    rows = (in_class - in_class.mean(axis=0)) * (squares - squares.mean())[:, None]
    scores = np.zeros((int(passes.max()) + 1, dof))
    np.add.at(scores, own_pass, rows)
    total = scores.sum(axis=0)
    return float(chi_squared_sf(total @ np.linalg.pinv(scores.T @ scores, hermitian=True) @ total, dof))


def _variance_of_noise(fitted: Fitted) -> Numbers:
    """Give what noise alone would leave of each component in base axes, (n, 3): what is stated, less what is fitted.

    With the whitened columns of a row A and the covariance C of what was fitted it is W⁻¹ (I − A C Aᵀ) W⁻ᵀ; in the
    unit of the scatter, which is one for all rows.
    """
    sightings, solved = fitted.sightings, fitted.solved
    root, used = np.asarray(solved.solution.covariance_root), solved.used.astype(np.float64)
    left = np.empty((len(sightings), 3, 3))
    for first in range(0, len(sightings), _BLOCK_ROWS):
        last = min(first + _BLOCK_ROWS, len(sightings))
        design = fitted.problem.design(solved.state, used, first, last, fitted.threads)
        fitted_part = (design @ root).reshape(last - first, 3, -1)
        value, vector = np.linalg.eigh(np.eye(3) - np.einsum("nik,njk->nij", fitted_part, fitted_part))
        left[first:last] = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    columns = sightings.unwhitening @ left
    told = [told_in_base_axes(sightings, fitted.problem, solved.state, columns[:, :, one]) for one in range(3)]
    return np.asarray((np.stack(told) ** 2).sum(axis=0))


def _rms(values: Numbers) -> float:
    return math.sqrt(float(values @ values) / max(len(values), 1))
