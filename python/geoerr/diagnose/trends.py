"""What the residual follows: its mean over each variable of the data, in bins, the largest trend first.

Where the cameras saw a target follows from where the machine was: trends over pixels come after all others.

A table to look at, not a test: `diagnose` says what is beyond chance over all that was tried.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.components import Component, components_of
from geoerr.fit import Fitted, Sightings
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s, variable_columns
from geoerr.machine import AXES
from geoerr.observations import PIXELS

# A variable of at most so many values has a bin for each, another this many with as many rows in each.
MOST_VALUES = 12
BINS = 10
# Columns that are measured, or say how well, or where a row stands in its file; directions come as d_x, d_y, d_z.
_NO_VARIABLES = {
    *("mx", "my", "mz", "sx", "sy", "sz", "cxx", "cxy", "cxz", "cyy", "cyz", "czz"),
    *("r", "sr", "measured", "s_measured"),
    *("file_row", "dir_x", "dir_y", "dir_z"),
}
# Values nearer than this share of the span are one.
_ALIKE = 1e-9
# Bins of more rows are made anew for each model: of twenty variables they are 64 MB.
_MOST_KEPT = 200_000


@dataclass(frozen=True)
class Bin:
    """Rows whose variable lies from `low` to `high`: mean of a residual, its standard error and its rms, µm.

    The standard error counts rows of one pass as what they have in common, where the bin holds several passes; never
    less than that of independent rows. NaN of a single row. What turns its sign within the bin is in the rms alone.
    """

    low: float
    high: float
    n: int
    mean_um: float
    std_error_um: float
    rms_um: float

    @property
    def spread_um(self) -> float:
        """Root mean square about the mean."""
        return math.sqrt(max(self.rms_um**2 - self.mean_um**2, 0.0))


@dataclass(frozen=True)
class Trend:
    """The mean of one component of the residual over one variable.

    Attributes
    ----------
    variable
        A column, or `d_x` (direction), `s_x` (travel since the last reversal), `v_x` (speed), `row` (number of the
        row in its session, where there is no time).
    component
        `x`, `y`, `z` or `radius`.
    bins
        In the order of the variable.
    worth_um
        How much the means differ, as a root mean square over the rows and beyond what their standard errors would
        make of nothing: √(Σ n_b ((m_b − m)² − s_b²) / N), 0 where that is negative.
    """

    variable: str
    component: str
    bins: tuple[Bin, ...]
    worth_um: float


def variables_of(fitted: Fitted) -> dict[str, Numbers]:
    """Give every variable (n,) that takes more than one value: positions, offsets, directions, time, covariates."""
    sightings = fitted.sightings
    found: dict[str, Numbers] = {
        name: sightings.numbers(name) for name in sightings.covariate_columns if name not in _NO_VARIABLES
    }
    rows = times_s(sightings)
    if "t" not in found and not any(np.array_equal(values, rows) for values in found.values()):
        found["row"] = rows
    moved = [axis for index, axis in enumerate(AXES) if np.ptp(sightings.commanded_mm[:, index]) > 0.0]
    names = [f"{name}_{axis}" for name in ("d", "s", "v") for axis in moved]
    found |= dict(zip(names, variable_columns(sightings, names), strict=True))
    return {name: values for name, values in found.items() if _varies(values[fitted.solved.used])}


def trends_of(fitted: Fitted) -> tuple[Trend, ...]:
    """Give all trends, the largest first, those over pixels behind all others."""
    components = components_of(fitted)
    trends = []
    for name, values in variables_of(fitted).items():
        binned: _Binned | None = None
        for component in components:
            known = np.isfinite(values) & component.is_known
            # Components are known in the same rows as a rule: to sort them into bins is most of the work.
            if binned is None or not np.array_equal(binned.known, known):
                binned = _binned(fitted.sightings, name, values, known)
            trends.append(binned.trend(name, component))
    kept = [trend for trend in trends if len(trend.bins) > 1]
    return tuple(sorted(kept, key=lambda trend: (trend.variable in PIXELS, -trend.worth_um)))


def _binned(sightings: Sightings, name: str, values: Numbers, known: np.ndarray) -> _Binned:
    """Bin the rows that are known (n,) by a variable: of one model as of the next, as long as the same rows count."""

    def work_out(_: Sightings | None = None) -> _Binned:
        return _Binned.of(values, known, sightings.pass_number)

    if len(sightings) > _MOST_KEPT:
        return work_out()
    kept = sightings.once(f"bins of {name}", work_out)
    return kept if np.array_equal(kept.known, known) else work_out()


def trend_of(sightings: Sightings, name: str, values: Numbers, component: Component) -> Trend:
    """Bin one component (n,) over one variable (n,); rows that lack either are left out."""
    known = np.isfinite(values) & component.is_known
    return _Binned.of(values, known, sightings.pass_number).trend(name, component)


@dataclass(frozen=True, eq=False)
class _Binned:
    """The rows of each bin of a variable, in their order, among those that are known (n,)."""

    known: np.ndarray
    spans: list[tuple[float, float]]
    rows: list[np.ndarray]
    passes: list[np.ndarray]

    @classmethod
    def of(cls, values: Numbers, known: np.ndarray, pass_number: np.ndarray) -> _Binned:
        number, spans = bins_of(values[known])
        order = np.flatnonzero(known)[np.argsort(number, kind="stable")]
        ends = np.cumsum(np.bincount(number, minlength=len(spans)))
        # Of no row that is known there is no bin, and one split.
        rows = np.split(order, ends[:-1])[: len(spans)]
        return cls(known, spans, rows, [_without_gaps(pass_number[own]) for own in rows])

    def trend(self, name: str, component: Component) -> Trend:
        binned = zip(self.spans, self.rows, self.passes, strict=True)
        bins = tuple(_bin(low, high, component.residual_um[rows], own) for (low, high), rows, own in binned)
        return Trend(name, component.name, bins, _worth_um(bins))


def _without_gaps(numbers: np.ndarray) -> np.ndarray:
    """Give whole numbers (n,) new ones from 0 on in the same order, with none left out."""
    return np.asarray((np.cumsum(np.bincount(numbers) > 0) - 1)[numbers])


def bins_of(values: Numbers) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Cut values (n,) into bins: the bin of each, (n,), and from where to where each bin's values reach."""
    if not values.size:
        return np.zeros(0, dtype=np.int64), []
    ordered = np.sort(values)
    is_new = np.concatenate(([True], np.diff(ordered) > _ALIKE * max(float(np.ptp(ordered)), 1e-300)))
    distinct = ordered[is_new]
    is_few = len(distinct) <= MOST_VALUES
    edges = distinct if is_few else np.unique(np.quantile(ordered, np.arange(BINS) / BINS))
    number = np.maximum(np.searchsorted(edges, values, side="right") - 1, 0)
    counts = np.bincount(number)
    number = (np.cumsum(counts > 0) - 1)[number]
    # Bins follow one another as their values do.
    ends = np.cumsum(counts[counts > 0])
    spans = list(zip(ordered[np.concatenate(([0], ends[:-1]))].tolist(), ordered[ends - 1].tolist(), strict=True))
    return number, spans


def _bin(low: float, high: float, residual_um: Numbers, own_pass: np.ndarray) -> Bin:
    """Sum up the rows of a bin; `own_pass` (n,) numbers the passes that it has."""
    n = len(residual_um)
    mean = float(residual_um.mean())
    rms = math.sqrt(float(residual_um @ residual_um) / n)
    deviation = residual_um - mean
    if n < 2:
        return Bin(low, high, n, mean, math.nan, rms)
    variance = float(deviation @ deviation) / (n - 1) / n
    sums = np.bincount(own_pass, weights=deviation)
    if len(sums) > 1:
        variance = max(variance, len(sums) / (len(sums) - 1) * float(sums @ sums) / n**2)
    return Bin(low, high, n, mean, math.sqrt(variance), rms)


def _worth_um(bins: tuple[Bin, ...]) -> float:
    n = np.array([one.n for one in bins], dtype=np.float64)
    mean_um = np.array([one.mean_um for one in bins])
    error_um = np.array([one.std_error_um for one in bins])
    whole = float((n * mean_um).sum() / max(n.sum(), 1.0))
    # A bin of one row tells nothing of its own error: it counts as explained by chance.
    squares = np.where(np.isfinite(error_um), (mean_um - whole) ** 2 - error_um**2, 0.0)
    return math.sqrt(max(float((n * squares).sum()) / max(float(n.sum()), 1.0), 0.0))


def _varies(values: Numbers) -> bool:
    known = values[np.isfinite(values)]
    return bool(known.size and np.ptp(known) > 0.0)
