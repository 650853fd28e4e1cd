"""Which basis the data support: as few functions as explain them, and how sure that is.

With errors of covariance Σ, a basis B (n, k) fitted by generalized least squares leaves χ². Candidates are scored by

    AICc = χ²/ĉ + 2K + 2K(K+1)/(n−K−1)          (expected error of prediction)
    BIC  = χ²/ĉ + k ln n                        (probability of being the true one)
    LOO  = −2 Σ ln p(y_i | all other y)         (each value predicted from the others, in closed form)

ĉ is 1, or χ²/dof of the richest candidate where that is larger: data that scatter more than they say must not buy
functions for it. K is k, and one more where ĉ is found from the data. Scores that differ by less than 2 do not tell
candidates apart; of those the one with the fewest functions is chosen. Where two of the same size fit equally (three
positions: a parabola, or two straight lines) the smoother is, as guideways bow more often than they break.

Sources: Burnham & Anderson, *Model Selection and Multimodel Inference*, 2002, §2.4, §2.5 and §2.6; leave-one-out in
closed form for correlated errors: Dubrule, *Mathematical Geology* 15, 1983. Elements for each axis: Dobariya §4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from geoerr.bases.build import basis_of
from geoerr.bases.candidates import in_words
from geoerr.errors import GeometryError, NotDeterminedError, ShapeError
from geoerr.terms import BasisSpec

Numbers = npt.NDArray[np.float64]
Criterion = Literal["aicc", "bic", "loo"]

# Scores that differ by less do not tell candidates apart (Burnham & Anderson, §2.6).
SAME_SCORE = 2.0
# Singular values and eigenvalues below this part of the largest are round-off.
_ROUND_OFF = 1e-10
# ĉ is taken from a candidate with this many degrees of freedom at least, and this part of the values: its own
# standard uncertainty is √(2/dof).
_LEAST_DOF = 3
_LEAST_DOF_PART = 0.5


@dataclass(frozen=True)
class Score:
    """What one candidate is worth.

    Attributes
    ----------
    spec
        The candidate.
    n_functions
        Functions that the data determine: all of them, less those that are free by convention.
    chi_squared, dof
        Of the weighted residual.
    aicc, bic, loo
        The three scores, smaller is better; infinite where a score does not exist (too few values; a value that no
        other predicts), NaN where it is not asked for.
    delta
        Of the criterion, to the best candidate.
    delta_std
        Standard uncertainty of `delta` by the scatter of the values' own contributions (`loo` only, else NaN).
    weight
        Akaike weight `exp(−delta/2)`, of all candidates' sum.
    why_not
        Why the candidate could not be used; empty where it could.
    """

    spec: BasisSpec
    n_functions: int
    chi_squared: float
    dof: int
    aicc: float
    bic: float
    loo: float
    delta: float = math.nan
    delta_std: float = math.nan
    weight: float = 0.0
    why_not: str = ""


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen basis, its fit, and what spoke for it.

    Attributes
    ----------
    spec
        The chosen basis.
    coefficients : (k,)
        Its coefficients, in the unit of the values; of what is free by convention, the smallest.
    covariance : (k, k)
        Theirs, with the stated covariance of the values times `scale`.
    table
        All candidates, as given.
    criterion
        By which was chosen.
    scale
        ĉ, see above.
    why
        In words.
    """

    spec: BasisSpec
    coefficients: Numbers
    covariance: Numbers
    table: tuple[Score, ...]
    criterion: Criterion
    scale: float
    why: str


@dataclass(frozen=True, eq=False)
class _Whitened:
    """Values (n,) and candidates' columns (n, k) with errors of covariance 1.

    `sizes` says how large the columns' numbers were before what is free was taken off: what is left of a column that
    is free as a whole is round-off of this size. Without `whitener` (n, n) there is no LOO.
    """

    values: Numbers
    columns: tuple[Numbers, ...]
    sizes: tuple[float, ...]
    whitener: Numbers | None
    n_free: int


def choose_basis(
    position_mm: npt.ArrayLike,
    value: npt.ArrayLike,
    uncertainty: npt.ArrayLike,
    candidates: Sequence[BasisSpec],
    *,
    criterion: Criterion = "aicc",
    trusts_uncertainty: bool = False,
) -> Choice:
    """Choose a basis for measured values of one function.

    Parameters
    ----------
    position_mm : (n,)
        Axis positions.
    value : (n,)
        Measured values, mm or rad.
    uncertainty : (n,) or (n, n)
        Standard uncertainties, or the covariance of the values.
    candidates
        For example `candidate_bases(...)`.
    criterion
        `aicc` (prediction), `bic` (sparing), `loo` (each value predicted from the others).
    trusts_uncertainty
        Whether ĉ is 1 whatever the values' scatter.

    Raises
    ------
    ShapeError
        for arrays that do not fit each other, and no candidates.
    GeometryError
        for values that are not finite, and a covariance that is not positive definite.
    NotDeterminedError
        where the values determine no candidate.
    """
    position, values = _vector(position_mm, "position_mm"), _vector(value, "value")
    if len(position) != len(values):
        raise ShapeError(f"{len(position)} positions and {len(values)} values")
    whitener = _whitener(np.asarray(uncertainty, dtype=np.float64), len(values))
    rows = [basis_of(spec).evaluate(position) for spec in candidates]
    problem = _Whitened(whitener @ values, *_columns(whitener, rows), whitener, 0)
    return _choose(problem, candidates, criterion, trusts_uncertainty)


def choose_coarser_basis(
    rich: BasisSpec,
    coefficients: npt.ArrayLike,
    covariance: npt.ArrayLike,
    position_mm: npt.ArrayLike,
    candidates: Sequence[BasisSpec],
    *,
    undetermined: npt.ArrayLike | None = None,
    criterion: Literal["aicc", "bic"] = "aicc",
) -> Choice:
    """Choose a basis for a function that was fitted with a richer one.

    The fit stands for the data: a candidate with coefficients α costs `(θ̂ − Tα)ᵀ C⁺ (θ̂ − Tα)`, where Tα is the
    function of the rich basis that comes nearest to the candidate's at the positions of the data (for a candidate
    inside the rich basis, the same function). The number of values is the rank of C. What the rich basis cannot show,
    such as the corners of elements inside a cubic's cell, is not held against a candidate.

    Parameters
    ----------
    rich
        The rich basis.
    coefficients : (k,)
        θ̂.
    covariance : (k, k)
        C; where the data leave m combinations free and a convention settles them, its rank is k − m.
    position_mm : (n,)
        Distinct positions of the data; at least k of them.
    candidates
        For example `candidate_bases(...)`.
    undetermined : (k, m), optional
        The free combinations, as coefficients of the rich basis: the constant (ones, for splines), the line.
        They cost nothing. Without it those that C does not hold, as for a fit of least norm.
    criterion
        `aicc` or `bic`.

    Raises
    ------
    ShapeError
        for arrays that do not fit each other, and as many free combinations as C does not lack.
    GeometryError
        for numbers that are not finite, and a covariance that is not one.
    NotDeterminedError
        where C determines no candidate.
    """
    theta, positions = _vector(coefficients, "coefficients"), _vector(position_mm, "position_mm")
    rich_rows = basis_of(rich).evaluate(positions)
    n_rich = rich_rows.shape[1]
    matrix = np.asarray(covariance, dtype=np.float64)
    if len(theta) != n_rich or matrix.shape != (n_rich, n_rich):
        raise ShapeError(
            f"the rich basis has {n_rich} functions: {len(theta)} coefficients, covariance {matrix.shape}"
        )
    if np.linalg.matrix_rank(rich_rows) < n_rich:
        raise ShapeError(
            f"{len(np.unique(positions))} positions do not determine the rich basis's {n_rich} functions"
        )
    whitener, n_free = _partial_whitener(matrix, undetermined)
    inverse = np.linalg.pinv(rich_rows)
    fitted = [inverse @ basis_of(spec).evaluate(positions) for spec in candidates]
    problem = _Whitened(whitener @ theta, *_columns(whitener, fitted), None, n_free)
    return _choose(problem, candidates, criterion, True)


def _columns(whitener: Numbers, rows: Sequence[Numbers]) -> tuple[tuple[Numbers, ...], tuple[float, ...]]:
    sizes = [float(np.linalg.norm(whitener, 2) * np.linalg.norm(matrix, 2)) for matrix in rows]
    return tuple(whitener @ matrix for matrix in rows), tuple(sizes)


def _vector(numbers: npt.ArrayLike, name: str) -> Numbers:
    vector = np.ascontiguousarray(numbers, dtype=np.float64)
    if vector.ndim != 1:
        raise ShapeError(f"{name} has shape {vector.shape}, (n,) is needed")
    bad = np.flatnonzero(~np.isfinite(vector))
    if bad.size:
        raise GeometryError(f"{name} {bad[0]} is {vector[bad[0]]}, a finite number is needed")
    return vector


def _whitener(uncertainty: Numbers, n_values: int) -> Numbers:
    """Give W with WᵀW = Σ⁻¹."""
    if uncertainty.shape == (n_values,):
        if not (np.isfinite(uncertainty) & (uncertainty > 0.0)).all():
            raise GeometryError("a standard uncertainty is not a finite number above 0")
        return np.diag(1.0 / uncertainty)
    if uncertainty.shape != (n_values, n_values):
        raise ShapeError(
            f"uncertainty has shape {uncertainty.shape}, ({n_values},) or ({n_values}, {n_values}) is needed"
        )
    # Scaled to correlations, so that only what is certain relative to its neighbours counts as singular.
    std = np.sqrt(np.where(np.diag(uncertainty) > 0.0, np.diag(uncertainty), np.nan))
    eigenvalues, vectors = _eigen(uncertainty / np.outer(std, std))
    if eigenvalues[0] < _ROUND_OFF * eigenvalues[-1]:
        raise GeometryError(
            "the covariance of the values is not positive definite\n"
            "hint: leave out values that convention makes exact, such as the first, which is 0"
        )
    return np.asarray((vectors / np.sqrt(eigenvalues)).T / std)


def _partial_whitener(covariance: Numbers, undetermined: npt.ArrayLike | None) -> tuple[Numbers, int]:
    """Give W (r, k) with WᵀW = C⁺ on what is determined, free combinations taken off first; and their number."""
    eigenvalues, vectors = _eigen(covariance)
    if eigenvalues[-1] <= 0.0 or eigenvalues[0] < -1e-6 * eigenvalues[-1]:
        raise GeometryError("the covariance of the coefficients is not positive semidefinite, or 0")
    held = eigenvalues > _ROUND_OFF * eigenvalues[-1]
    whitener = (vectors[:, held] / np.sqrt(eigenvalues[held])).T
    fixed = vectors[:, ~held]
    if undetermined is None:
        return np.asarray(whitener), fixed.shape[1]
    free = np.asarray(undetermined, dtype=np.float64)
    if free.shape != fixed.shape:
        raise ShapeError(
            f"undetermined has shape {free.shape}, but the covariance of {len(covariance)} coefficients has rank "
            f"{int(held.sum())}: {fixed.shape} is needed"
        )
    if not free.size:
        return np.asarray(whitener), 0
    meeting = fixed.T @ free
    if np.linalg.cond(meeting) > 1.0 / _ROUND_OFF:
        raise GeometryError("the covariance is not that of a fit in which the undetermined combinations are settled")
    # Along the free combinations into the span of the covariance: the convention applied to any coefficients.
    projector = np.eye(len(covariance)) - free @ np.linalg.solve(meeting, fixed.T)
    return np.asarray(whitener @ projector), free.shape[1]


def _eigen(matrix: Numbers) -> tuple[Numbers, Numbers]:
    if not np.isfinite(matrix).all():
        raise GeometryError("the covariance is not finite with variances above 0")
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-9 * float(np.abs(matrix).max(initial=0.0))):
        raise GeometryError("the covariance is not symmetric")
    eigenvalues, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return eigenvalues, vectors


@dataclass(frozen=True, eq=False)
class _Fit:
    rank: int
    left: Numbers
    chi_squared: float
    coefficients: Numbers
    inverse: Numbers
    why_not: str


def _fit(columns: Numbers, size: float, values: Numbers, n_free: int) -> _Fit:
    left, singular, right = np.linalg.svd(columns, full_matrices=False)
    held = singular > _ROUND_OFF * size
    left, singular, right = left[:, held], singular[held], right[held]
    rank = int(held.sum())
    along = left.T @ values
    residual = values - left @ along
    missing = columns.shape[1] - n_free - rank
    why_not = f"the data do not determine {missing} of its functions" if missing > 0 else ""
    inverse = (right.T / singular**2) @ right
    return _Fit(rank, left, float(residual @ residual), right.T @ (along / singular), inverse, why_not)


def _choose(
    problem: _Whitened, candidates: Sequence[BasisSpec], criterion: Criterion, trusts_uncertainty: bool
) -> Choice:
    if not candidates:
        raise ShapeError("no candidates to choose among")
    if not all(np.isfinite(columns).all() for columns in problem.columns):
        raise GeometryError("a candidate is not finite at the positions")
    fits = [
        _fit(columns, size, problem.values, problem.n_free)
        for columns, size in zip(problem.columns, problem.sizes, strict=True)
    ]
    n_values = len(problem.values)
    scale = 1.0 if trusts_uncertainty else _scale(fits, n_values)
    pointwise = [_leave_one_out(problem, fit, scale) for fit in fits]
    scores = [
        _score(spec, fit, n_values, scale, 0 if trusts_uncertainty else 1, float(losses.sum()))
        for spec, fit, losses in zip(candidates, fits, pointwise, strict=True)
    ]
    marks = np.array([getattr(score, criterion) if not score.why_not else math.inf for score in scores])
    if not np.isfinite(marks).any():
        raise NotDeterminedError(
            f"{n_values} values determine none of the {len(candidates)} candidates\nhint: offer smaller bases"
        )
    best = int(np.argmin(marks))
    deltas = marks - marks[best]
    weights = np.exp(-0.5 * deltas) / np.exp(-0.5 * deltas).sum()
    table = tuple(
        Score(
            **{
                **vars(score),
                "delta": float(deltas[place]),
                "delta_std": _difference_std(losses, pointwise[best]) if criterion == "loo" else math.nan,
                "weight": float(weights[place]),
            }
        )
        for place, (score, losses) in enumerate(zip(scores, pointwise, strict=True))
    )
    close = [place for place in range(len(table)) if deltas[place] <= SAME_SCORE]
    chosen = min(close, key=lambda place: _preference(table[place], float(deltas[place])))
    fit = fits[chosen]
    return Choice(
        spec=candidates[chosen],
        coefficients=fit.coefficients,
        covariance=scale * fit.inverse,
        table=table,
        criterion=criterion,
        scale=scale,
        why=_why(table, chosen, best, criterion, scale),
    )


def _preference(score: Score, delta: float) -> tuple[int, float, int]:
    # Rounded, so that round-off does not settle a tie.
    return score.n_functions, round(delta, 6), len(basis_of(score.spec).kinks())


def _scale(fits: Sequence[_Fit], n_values: int) -> float:
    """Give ĉ from the richest candidate that leaves enough degrees of freedom to tell."""
    least = max(_LEAST_DOF, _LEAST_DOF_PART * n_values)
    able = [fit for fit in fits if not fit.why_not and n_values - fit.rank >= least]
    if not able:
        return 1.0
    richest = max(able, key=lambda fit: (fit.rank, -fit.chi_squared))
    return max(1.0, richest.chi_squared / (n_values - richest.rank))


def _leave_one_out(problem: _Whitened, fit: _Fit, scale: float) -> Numbers:
    """Give −2 ln p(y_i | all other y) (n,).

    With Q = Wᵀ(1 − UUᵀ)W, U a basis of the columns, y_i misses its prediction by (Qy)_i/Q_ii, of variance 1/Q_ii.
    """
    if problem.whitener is None:
        return np.full(len(problem.values), math.nan)
    residual = problem.values - fit.left @ (fit.left.T @ problem.values)
    rest = problem.whitener - fit.left @ (fit.left.T @ problem.whitener)
    precision = (rest**2).sum(axis=0)
    known = precision > _ROUND_OFF * (problem.whitener**2).sum(axis=0)
    precision = np.where(known, precision, 1.0)
    losses = (rest.T @ residual) ** 2 / (precision * scale) + np.log(2.0 * math.pi * scale / precision)
    return np.where(known, losses, math.inf)


def _score(spec: BasisSpec, fit: _Fit, n_values: int, scale: float, n_scales: int, loo: float) -> Score:
    misfit = fit.chi_squared / scale
    counted = fit.rank + n_scales
    left = n_values - counted - 1
    aicc = misfit + 2.0 * counted * (1.0 + (counted + 1.0) / left) if left > 0 else math.inf
    bic = misfit + fit.rank * math.log(n_values)
    return Score(spec, fit.rank, fit.chi_squared, n_values - fit.rank, aicc, bic, loo, why_not=fit.why_not)


def _difference_std(losses: Numbers, best: Numbers) -> float:
    if not (np.isfinite(losses).all() and len(losses) > 1):
        return math.nan
    return float(np.sqrt(len(losses)) * np.std(losses - best, ddof=1))


def _why(table: Sequence[Score], chosen: int, best: int, criterion: Criterion, scale: float) -> str:
    names = {"aicc": "AICc", "bic": "BIC", "loo": "leave-one-out score"}
    name, mine = names[criterion], table[chosen]
    text = f"{in_words(mine.spec)}: "
    if chosen == best:
        text += f"smallest {name}"
    elif mine.n_functions == table[best].n_functions:
        text += f"{name} equal to that of {in_words(table[best].spec)}, and smoother"
    else:
        text += f"{name} only {mine.delta:.1f} above that of {in_words(table[best].spec)}, with fewer functions"
    others = [score for place, score in enumerate(table) if place not in (chosen, best) and not score.why_not]
    if others:
        other = min(others, key=lambda score: score.delta)
        text += f"; next {in_words(other.spec)}, {other.delta:.1f} above the best"
        rivals = sum(score.delta <= SAME_SCORE for score in others)
        if rivals:
            text += f"; {rivals} of the others within {SAME_SCORE:g}, which the data do not tell apart"
    if scale > 1.0:
        text += f"; the values scatter {math.sqrt(scale):.1f} times as much as stated, which is allowed for"
    return text
