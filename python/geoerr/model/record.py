"""The record of a fit: covariance, what the data do not determine, and where the numbers come from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from geoerr.error_functions import NotDetermined
from geoerr.errors import ShapeError
from geoerr.machine import AXES
from geoerr.model.arrays import Numbers, as_numbers
from geoerr.model.summary import history_html, record_html
from geoerr.terms import Parameter

# Rounding of a product of some thousand terms; a negative variance beyond it was put there.
_NEGATIVE = 1e-8
_UNDERFLOW = 1e-150
# A direction of the null space has length 1 to this; what is left of one beside the others is none below this.
_UNIT = 1e-6
# Entries of a direction of length 1 below this are rounding: a parameter that has no part in it.
_ROUNDING = 1e-13
# More parameters than any model of three axes; what is quadratic in them stays within memory.
MAX_PARAMETERS = 3000


@dataclass(frozen=True)
class HistoryEntry:
    """One effect that was added or removed, with the errors before and after.

    Attributes
    ----------
    action
        `added` or `removed`.
    reference
        The term's id, `thermal-expansion:x@temp_bed`.
    title
        In words.
    figures_before, figures_after
        Name (with its unit) to number; NaN where a figure is not computable.
    parameters
        The term's parameters as found.
    """

    reference: str
    title: str
    figures_before: Mapping[str, float] = field(default_factory=dict)
    figures_after: Mapping[str, float] = field(default_factory=dict)
    parameters: tuple[Parameter, ...] = ()
    action: Literal["added", "removed"] = "added"

    def __post_init__(self) -> None:
        """Refuse what a file could not hold."""
        _check_texts(self.reference, self.title)
        _require(self.action in ("added", "removed"), f"{self.action!r} is neither 'added' nor 'removed'")
        _check_numbers("figures_before", self.figures_before)
        _check_numbers("figures_after", self.figures_after)

    def _repr_html_(self) -> str:
        """Show the step with the error before and after, for a notebook."""
        return history_html((self,))


@dataclass(frozen=True, eq=False)
class FitRecord:
    """What a fit knows besides the values. m parameters: the coefficients of all terms, then all inner parameters.

    Attributes
    ----------
    covariance : (m, m)
        Of all parameters, in their units. A parameter that was held fixed has none.
    null_space : (m, k)
        Directions of parameters that the data do not determine, each of length 1; k may be 0. Best sparse (an echelon
        form): parameters that do not mix then do not meet in a direction.
    not_determined
        The same in words, by name (ISO names, or ids of terms).
    data_digest
        SHA-256 of the data, in hexadecimal; "" where there were none.
    n_rows, n_outliers
        Rows that took part, and rows that the fit named as outliers.
    range_mm
        Axis to the commanded range of the data, for axes that moved.
    stood_mm
        Axis to its position in all the data, for axes that never moved: of what they do elsewhere nothing is known.
    has_settled
        Whether the fit came to rest. Numbers of one that did not are wherever it stopped, and not to be used.
    covariate_spans
        Covariate to its smallest and largest value in the data.
    sessions
        Of a model in which something changes from session to session: names of the data's sessions, in their order,
        and the number by which its terms know each.
    noise, figures
        Name (with its unit) to number: `floor_um`, `stated_um` ...; `rmse_um`, `held_out_rmse_um` ... NaN where a
        number is not computable.
    history
        Effects added and removed, in order.

    Raises
    ------
    ShapeError
        for shapes that do not fit, numbers that are not finite, or a covariance that none can be: not symmetric, or
        with a negative variance in some direction.
    """

    covariance: Numbers
    null_space: Numbers
    not_determined: tuple[NotDetermined, ...] = ()
    data_digest: str = ""
    n_rows: int = 0
    n_outliers: int = 0
    range_mm: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    covariate_spans: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    history: tuple[HistoryEntry, ...] = ()
    stood_mm: Mapping[str, float] = field(default_factory=dict)
    has_settled: bool = True
    sessions: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check everything, and make the covariance symmetric to the last bit."""
        covariance = as_numbers(self.covariance, "covariance")
        object.__setattr__(self, "covariance", _checked_covariance(covariance))
        object.__setattr__(self, "null_space", _checked_null_space(self.null_space, len(covariance)))
        _check_texts(self.data_digest, *(text for item in self.not_determined for text in (item.name, item.why)))
        for name in ("n_rows", "n_outliers"):
            count = getattr(self, name)
            is_count = isinstance(count, int) and not isinstance(count, bool) and 0 <= count < 2**53
            _require(is_count, f"{name} is {count!r}, not a number of rows")
        _require(set(self.range_mm) <= set(AXES), f"range_mm has axes {', '.join(self.range_mm)}")
        for name in ("range_mm", "covariate_spans"):
            for key, span in getattr(self, name).items():
                good = len(span) == 2 and all(map(math.isfinite, span)) and span[0] <= span[1]
                _require(good, f"{name} of {key} is {span!r}, not from low to high")
        for name, number in self.sessions.items():
            is_number = isinstance(number, int) and not isinstance(number, bool) and 0 <= number < 2**53
            _require(is_number, f"sessions: {number!r} is no number of session {name!r}")
        _check_texts(*self.sessions)
        _check_numbers("noise", self.noise)
        _check_numbers("figures", self.figures)
        _check_numbers("stood_mm", self.stood_mm)
        stands = set(self.stood_mm) <= set(AXES) and not any(map(math.isnan, self.stood_mm.values()))
        _require(stands, f"stood_mm is {dict(self.stood_mm)!r}, not positions of axes")

    def _repr_html_(self) -> str:
        """Show data, figures, what is not determined and the history, for a notebook."""
        return record_html(self)

    @property
    def n_parameters(self) -> int:
        """Number of parameters m."""
        return len(self.covariance)

    @property
    def std(self) -> Numbers:
        """Standard uncertainties of the parameters, (m,)."""
        return np.sqrt(np.diagonal(self.covariance))

    def selected(self, places: Sequence[int] | Numbers) -> FitRecord:
        """Give the record of some of the parameters, in the given order.

        What remains keeps its covariance. A direction that the data do not determine keeps its part in these
        parameters; parts that vanish, or that follow from others, are dropped.
        """
        index = np.asarray(places, dtype=np.int64)
        return replace(
            self,
            covariance=self.covariance[np.ix_(index, index)],
            null_space=_independent(self.null_space[index]),
        )


def _checked_covariance(covariance: Numbers) -> Numbers:
    size = len(covariance)
    _require(covariance.shape == (size, size), f"covariance is {covariance.shape}, not square")
    _require(size <= MAX_PARAMETERS, f"{size} parameters are more than {MAX_PARAMETERS}")
    _require(bool(np.isfinite(covariance).all()), "covariance has a number that is not finite")
    variance = np.diagonal(covariance)
    _require(bool((variance >= 0.0).all()), "covariance has a negative variance")
    std = np.sqrt(variance)
    # Compared without units: each parameter over its own standard uncertainty.
    scale = np.divide(1.0, std, out=np.zeros(size), where=std > 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        correlation = covariance * scale[:, None] * scale[None, :]
    _require(bool(np.isfinite(correlation).all()), "a covariance is far beyond its variances")
    is_sure = std == 0.0
    # The variance of a parameter whose root is below 1e-162 is 0 in double precision; its covariances may not be.
    nothing = _UNDERFLOW * std
    none_beside = (np.abs(covariance[is_sure]) <= nothing).all() and (
        np.abs(covariance[:, is_sure].T) <= nothing
    ).all()
    _require(bool(none_beside), "a covariance without its variance")
    covariance = np.where(is_sure[:, None] | is_sure[None, :], 0.0, covariance)
    _require(bool((np.abs(correlation - correlation.T) <= _NEGATIVE).all()), "covariance is not symmetric")
    if size:
        least = float(np.linalg.eigvalsh(correlation)[0])
        _require(least >= -_NEGATIVE * size, "covariance is not positive semidefinite")
    upper = np.triu(covariance)
    symmetric = upper + np.triu(covariance, 1).T
    symmetric.flags.writeable = False
    return symmetric


def _checked_null_space(null_space: Numbers, n_parameters: int) -> Numbers:
    directions = as_numbers(null_space, "null_space")
    fits = directions.ndim == 2 and len(directions) == n_parameters and directions.shape[1] <= n_parameters
    _require(fits, f"null_space is {directions.shape}, not ({n_parameters}, k)")
    _require(bool(np.isfinite(directions).all()), "null_space has a number that is not finite")
    lengths = np.linalg.norm(directions, axis=0)
    _require(bool((np.abs(lengths - 1.0) <= _UNIT).all()), "null_space has a direction whose length is not 1")
    directions = np.where(np.abs(directions) <= _ROUNDING, 0.0, directions)
    directions.flags.writeable = False
    return directions


def _independent(directions: Numbers) -> Numbers:
    """Give the columns (m, k) that do not follow from those before, each of length 1: zeros stay zeros."""
    kept: list[Numbers] = []
    orthonormal = np.zeros((len(directions), 0))
    for column in directions.T:
        length = np.linalg.norm(column)
        if length == 0.0:
            continue
        unit = column / length
        rest = unit - orthonormal @ (orthonormal.T @ unit)
        size = np.linalg.norm(rest)
        if size > _UNIT:
            kept.append(unit)
            orthonormal = np.column_stack([orthonormal, rest / size])
    return np.array(kept, dtype=np.float64).reshape(len(kept), len(directions)).T


def _check_numbers(name: str, numbers: Mapping[str, float]) -> None:
    for key, value in numbers.items():
        _check_texts(key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and not math.isinf(value)
        _require(is_number, f"{name}.{key} is {value!r}, not a number")


def _check_texts(*texts: str) -> None:
    for text in texts:
        _require(isinstance(text, str), f"{text!r} is not a text")


def _require(condition: bool, problem: str) -> None:
    if not condition:
        raise ShapeError(problem)
