"""Where the size of the residual depends on a variable: an error that turns its sign within the bins of a trend.

Of sin(x)·(T − T₀) every bin of T has the mean 0. Sizes tell: of what a row is off, over what noise alone would leave
there. Rows of one run (`runs`) share an offset and are not independent, and a variable that changes between runs only
is as good as one number a run. So runs are counted (`sizes`), in three looks:

- from run to run, the sizes of what rows are off their bins, their runs and a lean over the volume, fitted together:
  no offset is in them, and not what the measuring frame leans by offsets;
- the same along runs. Along a line where a row is tells when it was measured, and what drifts is farthest off the
  mean of its run at both ends: there of what rows are off their bins alone. What grows along lines beneath larger
  offsets is not told;
- from run to run, the sizes of what rows are off the runs that are next to theirs in the variable: what a run has in
  common, an offset or sin(x) of a run along y, is in them.

False alarms and what is told: `validation/spread_trends.md`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.components import UM_PER_MM, Component, components_of
from geoerr.diagnose.runs import Runs, runs_of
from geoerr.diagnose.sizes import chance_between_runs, chance_within_runs, means_of_runs, off_neighbours
from geoerr.diagnose.trends import bins_of, trend_of, variables_of
from geoerr.distributions import never_zero
from geoerr.fit import Fitted
from geoerr.fit.lengths import told_in_base_axes
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers
from geoerr.machine import AXES
from geoerr.observations import PIXELS

# Seldom by chance over all that is looked at.
_SELDOM = 0.01
# Of what the fit follows nearly whole, squares tell rounding.
_LEAST_SHARE = 0.05
# What is left of exact data is rounding.
_LEAST_UM = 1e-4
# Directions of bins and lean below this share of the largest are none of their own.
_DEPENDENT = 1e-9
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
    is_within_runs
        Whether they are about what each run has besides: offsets of runs are not in them.
    """

    variable: str
    component: str
    p_value: float
    least_um: float
    most_um: float
    is_within_runs: bool = False

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
    runs = runs_of(fitted.sightings)
    found = [
        _spread_trend(fitted, runs, name, values, component, variances)
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
    fitted: Fitted, runs: Runs, name: str, values: Numbers, component: Component, variance: Numbers
) -> SpreadTrend | None:
    """Test one component over one variable by itself; None where too few rows or runs tell anything."""
    known = np.isfinite(values) & component.is_known
    known &= variance > _LEAST_SHARE * float(np.median(variance[known])) if known.any() else known
    number, spans = bins_of(values[known])
    if len(spans) < 2:
        return None
    off = _Off.of(component.residual_um[known], number, runs.of_rows(known), fitted.sightings.commanded_mm[known])
    if not off.rows.size:
        return None
    noise_um = UM_PER_MM * np.sqrt(variance[known][off.rows])
    place = 2.0 * off.number / (len(spans) - 1) - 1.0
    within, of_runs = off.chances(noise_um, np.stack([place, place**2][: len(spans) - 1], axis=1))
    chances = [one for one in (*within, of_runs) if one is not None]
    if not chances:
        return None
    is_within_runs = of_runs is None or min(chances) < of_runs
    if is_within_runs:
        spreads = off.spreads_um
    else:
        spreads = [one.spread_um for one in trend_of(fitted.sightings, name, values, component).bins if one.n > 1]
    p_value = never_zero(min(len(chances) * min(chances), 1.0))
    return SpreadTrend(name, component.name, p_value, min(spreads), max(spreads), is_within_runs)


@dataclass(frozen=True, eq=False)
class _Off:
    """How far rows are off, of those that are neither alone in their bin nor in their run.

    Attributes
    ----------
    rows : (n,)
        Which of the rows they are.
    number : (n,)
        Bin of each.
    runs
        Run of each.
    both_um : (n,)
        How far it is off bin, run and lean, fitted together, as large as noise is, whatever these have taken of it.
    bins_um : (n,)
        How far off bin and lean alone.
    """

    rows: np.ndarray
    number: np.ndarray
    runs: Runs
    both_um: Numbers
    bins_um: Numbers

    @classmethod
    def of(cls, values_um: Numbers, number: np.ndarray, runs: Runs, at_mm: Numbers) -> _Off:
        """Fit values (n,) by their bins and runs, and a lean over the volume; `at_mm` (n, 3) is where they are.

        Offsets of runs let the measuring frame lean, and runs along the lean would be wider than others.
        """
        run = np.unique(runs.number, return_inverse=True)[1]
        span_mm = np.ptp(at_mm, axis=0)
        # Of an axis that stands still only rounding would be left.
        moved = span_mm > SAME_POSITION_MM
        lean = (at_mm - at_mm.mean(axis=0))[:, moved] / span_mm[moved]
        columns = np.column_stack([np.eye(int(number.max()) + 1)[number], lean])
        within = columns - means_of_runs(columns, run)[run]
        solve = np.linalg.pinv(within.T @ within, rcond=_DEPENDENT, hermitian=True)
        off_runs = values_um - means_of_runs(values_um[:, None], run)[run, 0]
        effect = solve @ (within.T @ off_runs)
        left = 1.0 - 1.0 / np.bincount(run)[run] - ((within @ solve) * within).sum(axis=1)
        rows = np.flatnonzero(left > _LEAST_SHARE)
        both_um = (off_runs - within @ effect)[rows] / np.sqrt(left[rows])
        bins_um = values_um - columns @ effect
        return cls(rows, number[rows], runs.of_rows(rows), both_um, (bins_um - bins_um.mean())[rows])

    def chances(self, noise_um: Numbers, places: Numbers) -> tuple[tuple[float | None, float | None], float | None]:
        """Give how rarely chance does as much within runs, from run to run and along them, and to whole runs."""
        run, level = self.runs.number, self.runs.level
        along_um = np.where(self.runs.is_scattered, self.both_um, self.bins_um)
        within = (
            chance_between_runs(np.abs(self.both_um) / noise_um, places, run, level),
            chance_within_runs(np.abs(along_um) / noise_um, places, run),
        )
        whole = level == 0
        of_runs = np.abs(off_neighbours(self.bins_um, places, run)) / noise_um
        return within, chance_between_runs(of_runs[whole], places[whole], run[whole], level[whole])

    @property
    def spreads_um(self) -> list[float]:
        """Root mean square in each bin of several rows."""
        count = np.bincount(self.number)
        squares = np.bincount(self.number, weights=self.both_um**2)
        return [math.sqrt(one) for one in (squares[count > 1] / count[count > 1])]


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
