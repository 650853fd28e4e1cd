"""Gauss-Newton over the exact transforms, with gross outliers found and left out.

Residuals come from the exact chain. The columns are first order at the nominal machine, so that one triangle serves
all iterations of a linear model; where inner parameters are free the columns are made anew. What the data do not
determine is found by rank, never hidden by a ridge.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.fit.free_directions import held_smallest
from geoerr.fit.gross_rows import Neighbours, gross_limit, robust_scale
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import first_frame_column, planes_of_circles
from geoerr.fit.triangles import Known, Triangles, holding

# A correction smaller than this share of its standard error changes no digit that anybody reads.
_SETTLED = 1e-4
# So is the next one, where this is no longer than so many times that, and so many times shorter than the one before:
# with one triangle each is the same share of the one before it.
_TENFOLD = 10.0
# And where a hundred times what that share of it would be is negligible: of the first two steps it says little more
# than the order of magnitude.
_HUNDREDFOLD = 100.0
# While gross rows are looked for: smaller ones make no row gross.
_NEARLY_SETTLED = 0.03
# After a correction of so little of its standard error, steps with the triangle that there is lead near the minimum.
_NEAR = 0.3
# While each is so much shorter than the one before.
_SHORTER = 0.3
# Columns that were made so near to the minimum, in standard errors of what they follow, are those of the minimum; and
# those with which every step is so much shorter than the one before: that is how far their products are off.
_OF_THE_MINIMUM, _ALIKE = 0.03, 0.01
# After so short a step a triangle that is wanted in any case is made: it is that of the minimum, and the steps that
# are left are its own.
_NEAR_THE_END = 0.01
_MAX_STEPS = 40
# As many steps cost as much as a triangle.
_STEPS_WITH_ANOTHER = 4
_MAX_ROUNDS = 12
# What is left of exact data, mm: a tenth of a nanometre.
_LEAST_LEFT = 1e-7
# Share of the numbers that must be left over beyond the unknowns: below it medians of residuals tell no scale.
_LEAST_LEFT_OVER = 0.15
# First order is not exact: a linear model's sum of squares may rise by rounding and by that, but never by more.
_LINEAR_RISE = 1e-2
# An inner parameter this near to an end of its range, as a share of it, is at the end.
_AT_AN_END = 1e-9
# Huber's constant: 95 % efficient for Gaussian noise.
_HUBER = 1.345
_HUBER_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class Ranges:
    """From where to where each free inner parameter may go.

    Beyond its range a formula need not mean anything: a lag below 0 grows without bound.

    Attributes
    ----------
    inner : (k,)
        Its number among all inner parameters.
    column : (k,)
        Its column.
    low, high : (k,)
        Ends of its range.
    is_followed : (n_columns,)
        Unknowns that the columns depend on: these, and the sizes of what follows them.
    """

    inner: np.ndarray
    column: np.ndarray
    low: Numbers
    high: Numbers
    is_followed: np.ndarray

    def leaving(self, state: _core.FitState, step: Numbers) -> np.ndarray:
        """Tell which are at an end and would step beyond it, (k,)."""
        (is_low, is_high), own = self._at_ends(state), step[self.column]
        return np.asarray((is_low & (own < 0.0)) | (is_high & (own > 0.0)))

    def lost(self, state: _core.FitState, solution: _core.FitSolution) -> np.ndarray:
        """Tell which are at an end where nothing tells them, (k,): rounding would decide which way they step."""
        return np.asarray(np.any(self._at_ends(state), axis=0) & ~np.asarray(solution.is_determined)[self.column])

    def share_inside(self, state: _core.FitState, step: Numbers) -> float:
        """Give the share of a step, at most 1, that ends where the first of them meets its end."""
        value, own = self._values(state), step[self.column]
        room = np.where(own > 0.0, self.high - value, value - self.low)
        moves = own != 0.0
        return float(np.min(room[moves] / np.abs(own[moves]), initial=1.0))

    def _at_ends(self, state: _core.FitState) -> tuple[np.ndarray, np.ndarray]:
        value, near = self._values(state), _AT_AN_END * (self.high - self.low)
        return value - self.low <= near, self.high - value <= near

    def _values(self, state: _core.FitState) -> Numbers:
        return np.asarray(np.clip(state.inner[self.inner], self.low, self.high))


@dataclass(frozen=True, eq=False)
class Solved:
    """A solved problem.

    Attributes
    ----------
    state
        All unknowns.
    solution
        Rank, null space and unscaled covariance of the last triangle.
    triangle
        R of the whitened design with outliers left out.
    row_scale : (n,)
        What each row counts in it.
    design_state
        Where that design was made: what is worked out with the solution has to have the same one.
    residual_mm : (n, 3)
        Measured minus predicted, in the measuring frame.
    whitened : (n, 3)
        The same in standard deviations.
    used : (n,)
        False for the outliers.
    scale
        Robust standard deviation of the whitened residuals.
    converged, steps
        Whether the last correction was negligible, and how many were made.
    """

    state: _core.FitState
    solution: _core.FitSolution
    triangle: _core.FitTriangle
    row_scale: Numbers
    design_state: _core.FitState
    residual_mm: Numbers
    whitened: Numbers
    used: np.ndarray
    scale: float
    converged: bool
    steps: int

    @property
    def chi_squared(self) -> float:
        """Sum of squares of the whitened residuals of the rows that count."""
        return float((self.whitened[self.used] ** 2).sum())


def solve(
    problem: _core.FitProblem,
    sightings: Sightings,
    start: _core.FitState,
    gauge: Numbers,
    *,
    prior: Numbers | None = None,
    robust: bool = True,
    is_linear: bool = True,
    inner_ranges: Ranges | None = None,
    one_step: bool = False,
    used: np.ndarray | None = None,
    limits: Numbers | None = None,
    known: Known | None = None,
    threads: int = 0,
) -> Solved:
    """Fit all unknowns.

    Parameters
    ----------
    problem
        Model and measurements.
    start
        First unknowns.
    gauge : (k, n_columns)
        Rows C with C x = 0 for every correction x.
    prior : (p, n_columns)
        Rows P with P u = 0 ± 1 for all unknowns u but frames: what is known of them besides the measurements.
    robust
        Whether gross outliers are found and left out.
    is_linear
        Whether no inner parameter is free.
    inner_ranges
        Of the inner parameters that are free: no step leaves them.
    one_step
        Whether to stay first order: one step from the start, residuals by the same columns.
    used : (n,) or None
        Rows that take part, where that is known; no other is then looked for.
    limits : (n_columns,) or None
        What is absurd for each unknown: along directions that the data leave free it stays smallest beside that.
    known
        A triangle that has columns of the one at the start.
    """
    limits = np.full(problem.n_columns, np.inf) if limits is None else limits
    n_numbers = sightings.is_measured.sum(axis=1)
    first_frame = first_frame_column(problem, sightings)
    gauge = np.vstack([gauge, planes_of_circles(sightings, first_frame, problem.n_columns)])
    robust = robust and used is None
    used = np.ones(len(sightings), dtype=bool) if used is None else used
    scale_of_rows = used.astype(np.float64)
    rounds = _HUBER_ROUNDS + _MAX_ROUNDS if robust else 1
    state, found, of_all = start, None, None
    neighbours: Neighbours | None = None
    earlier: set[bytes] = set()
    for number in range(rounds):
        if one_step:
            found = _first_order(problem, start, scale_of_rows, gauge, prior, limits, known, threads)
        else:
            found = _gauss_newton(
                problem,
                state,
                scale_of_rows,
                gauge,
                prior,
                is_linear,
                inner_ranges,
                limits,
                threads,
                is_stated=sightings.is_stated,
                of_all=of_all,
                known=known if number == 0 else None,
            )
        if robust and is_linear and not one_step and number == 0:
            of_all = found
        state = found.state
        distance = np.sqrt((found.whitened**2).sum(axis=1))
        sigma = robust_scale(distance, n_numbers)
        if not robust or _is_interpolated(found, n_numbers):
            break
        if sightings.is_stated:
            # Residuals are smaller than the noise by the unknowns that were fitted; nothing is gross that is not so
            # against what is stated.
            sigma = max(sigma, 1.0)
        limit = gross_limit(n_numbers) * sigma
        if number < _HUBER_ROUNDS:
            if number == 0 and not (distance > limit).any():
                # Nothing stands out: no weights are needed.
                break
            knee = _HUBER * np.sqrt(n_numbers) * sigma
            scale_of_rows = np.sqrt(np.minimum(1.0, knee / np.maximum(distance, 1e-300)))
            continue
        neighbours = neighbours or Neighbours(sightings)
        # A length has no neighbours that would tell a mistake from what the model lacks.
        is_far = (distance > limit) & ~sightings.of_kind("lengths")
        now = ~neighbours.mistakes(found.whitened, n_numbers, is_far)
        # Rows at the limit may come and go by turns for ever.
        are_found = now.tobytes() in earlier
        earlier.add(now.tobytes())
        if are_found and of_all is None:
            break
        if are_found or number == rounds - 2:
            # The rows are found, or one round is left: from here on the triangle is theirs.
            of_all = None
        used = now
        scale_of_rows = used.astype(np.float64)
    assert found is not None
    distance = np.sqrt((found.whitened**2).sum(axis=1))
    return Solved(
        found.state,
        found.solution,
        found.triangle,
        found.row_scale,
        found.design_state,
        found.residual_mm,
        found.whitened,
        used,
        robust_scale(distance[used], n_numbers[used]),
        found.converged,
        found.steps,
    )


def _is_interpolated(found: _Iterated, n_numbers: np.ndarray) -> bool:
    """Tell whether too little is left over to tell a gross row by: an interpolation leaves 0 but for a few."""
    total = int(n_numbers.sum())
    return total - found.solution.rank < _LEAST_LEFT_OVER * total


@dataclass(frozen=True, eq=False)
class _Iterated:
    state: _core.FitState
    solution: _core.FitSolution
    triangle: _core.FitTriangle
    row_scale: Numbers
    design_state: _core.FitState
    residual_mm: Numbers
    whitened: Numbers
    converged: bool
    steps: int


def _gauss_newton(
    problem: _core.FitProblem,
    start: _core.FitState,
    row_scale: Numbers,
    gauge: Numbers,
    prior: Numbers | None,
    is_linear: bool,
    ranges: Ranges | None,
    limits: Numbers,
    threads: int,
    *,
    is_stated: bool,
    of_all: _Iterated | None = None,
    known: Known | None = None,
) -> _Iterated:
    """Iterate to a minimum.

    Parameters
    ----------
    is_stated
        Whether whitened residuals have unit variance; otherwise their scatter is what is left.
    of_all
        What was found with every row counting in full. Its triangle serves for weights below 1 too: steps are shorter
        than Newton's, none goes beyond the minimum along it, and they cost no triangle (Huber & Dutter 1974). Where
        that takes many of them one of its own is cheaper.
    known
        A triangle that has columns of the one at the start.
    """
    state = design_state = start
    residual = problem.residuals(state, threads)
    triangles = Triangles(problem, row_scale, gauge, prior, threads)
    if of_all is None:
        triangle, made_at = triangles.at(state, known)
        unheld, made_with = triangle.solve(None, threads), row_scale
    else:
        triangle, unheld = of_all.triangle, of_all.solution
        made_at, made_with = of_all.design_state, of_all.row_scale
    solution = unheld
    converged, steps = False, 0
    # Of standard errors: the last step; the same of what the columns follow, and its most.
    moved = followed = 0.0
    most_followed = _NEAR
    since, is_there = _StepsSince(), True
    follows = np.ones(problem.n_columns, dtype=bool) if ranges is None else ranges.is_followed
    settled = _SETTLED if of_all is None else _NEARLY_SETTLED
    cost = _cost(problem, residual, row_scale, _held(problem, state, prior))
    while not converged and steps < _MAX_STEPS:
        if not is_linear:
            is_nearly_there = moved < max(settled, _NEAR_THE_END) and not is_there
            if is_nearly_there or followed > most_followed:
                is_followed = None if ranges is None else ranges.is_followed
                triangle, made_at = triangles.near((triangle, made_at), state, is_followed)
                unheld, since = triangle.solve(None, threads), _StepsSince()
            # In the frames that the triangle has: with others steps overshoot where a calibration's unknowns are
            # large, and go to and fro about the minimum.
            design_state = state.in_frames_of(made_at)
        elif of_all is not None and steps == _STEPS_WITH_ANOTHER:
            (triangle, made_at), made_with = triangles.at(state), row_scale
            solution = unheld = triangle.solve(None, threads)
        gradient = problem.gradient(design_state, residual, row_scale, threads)
        if prior is not None:
            gradient -= prior.T @ _held(problem, state, prior)
        solution, step = _step_inside(triangle, unheld, gradient, state, ranges, limits, threads)
        spread = solution.spread
        shares = np.abs(step) / np.where(spread > 0.0, spread, np.inf)
        longest = factor = 1.0 if ranges is None else ranges.share_inside(state, step)
        while True:
            trial = problem.corrected(state, factor * step)
            trial_residual = problem.residuals(trial, threads)
            trial_cost = _cost(problem, trial_residual, row_scale, _held(problem, trial, prior))
            # A linear model's full step fails only where nothing holds it; another's is halved until it helps.
            most = cost * (1.0 + (_LINEAR_RISE if is_linear else 1e-9))
            if trial_cost <= most or factor < 1e-6 * longest:
                break
            factor *= 0.5
        if not np.isfinite(trial_cost):
            # Nowhere along the step there are residuals: what was found before stands, as not settled.
            break
        state, residual, cost = trial, trial_residual, trial_cost
        steps += 1
        # Without a stated noise the unit of standard errors is what is left.
        unit = 1.0 if is_stated else _left_over(cost, problem, row_scale, solution)
        shares /= unit
        before, moved = moved, factor * float(shares.max(initial=0.0))
        # Of the first step nothing was expected.
        most_followed = min(_NEAR, _SHORTER * followed) or _NEAR
        followed = factor * float(shares[follows].max(initial=0.0))
        since.lengths.append(followed)
        # A step cut short by the end of a range is not small: the next one goes on along the end. The triangle is to
        # be that of the minimum.
        is_there = is_linear or since.are_at_the_minimum
        converged = _is_settled(moved, before, settled) and is_there and (factor < longest or longest == 1.0)
    whitened = problem.whitened(residual)
    return _Iterated(state, solution, triangle, made_with, made_at, residual, whitened, converged, steps)


def _is_settled(moved: float, before: float, settled: float) -> bool:
    """Tell whether a step, or the one that would come next by how fast they shorten, is negligible."""
    is_short = moved < _TENFOLD * _SETTLED and _TENFOLD * moved < before
    return moved < settled or is_short or _HUNDREDFOLD * moved * moved < _SETTLED * before


class _StepsSince:
    """Steps since a triangle was made, in standard errors of what its columns follow."""

    def __init__(self) -> None:
        self.lengths: list[float] = []

    @property
    def are_at_the_minimum(self) -> bool:
        """Whether the triangle is, for all that anybody reads, that of where they lead."""
        # Of two steps that are nothing one is as long as the other by chance.
        shares = [later / earlier for earlier, later in itertools.pairwise(self.lengths) if earlier > _SETTLED]
        return sum(self.lengths) <= _OF_THE_MINIMUM or max(shares, default=np.inf) <= _ALIKE


def _step_inside(
    triangle: _core.FitTriangle,
    solution: _core.FitSolution,
    gradient: Numbers,
    state: _core.FitState,
    ranges: Ranges | None,
    limits: Numbers,
    threads: int,
) -> tuple[_core.FitSolution, Numbers]:
    """Give the step in which inner parameters at an end of their range that would leave it stay, and its solution."""
    step = held_smallest(solution.step(gradient), solution.null_space, limits)
    if ranges is None:
        return solution, step
    stays = np.zeros(len(ranges.column), dtype=bool)
    leaving = ranges.lost(state, solution) | ranges.leaving(state, step)
    while leaving.any():
        stays |= leaving
        solution = triangle.solve(holding(ranges.column[stays], len(step)), threads)
        step = held_smallest(solution.step(gradient), solution.null_space, limits)
        step[ranges.column[stays]] = 0.0
        leaving = ranges.leaving(state, step) & ~stays
    return solution, step


def _first_order(
    problem: _core.FitProblem,
    start: _core.FitState,
    row_scale: Numbers,
    gauge: Numbers,
    prior: Numbers | None,
    limits: Numbers,
    known: Known | None,
    threads: int,
) -> _Iterated:
    residual = problem.residuals(start, threads)
    triangle, _ = Triangles(problem, row_scale, gauge, prior, threads).at(start, known)
    solution = triangle.solve(None, threads)
    gradient = problem.gradient(start, residual, row_scale, threads)
    if prior is not None:
        gradient -= prior.T @ _held(problem, start, prior)
    step = held_smallest(solution.step(gradient), solution.null_space, limits)
    left = residual - problem.first_order_mm(start, step, threads)
    state, whitened = problem.corrected(start, step), problem.whitened(left)
    return _Iterated(state, solution, triangle, row_scale, start, left, whitened, converged=True, steps=1)


def _held(problem: _core.FitProblem, state: _core.FitState, prior: Numbers | None) -> Numbers:
    """Give the residuals of what is known besides the measurements; inner parameters and frames have none."""
    if prior is None:
        return np.zeros(0)
    unknowns = np.zeros(problem.n_columns)
    unknowns[: len(state.coefficients)] = state.coefficients
    unknowns[problem.first_shared_column :] = state.shared
    return np.asarray(prior @ unknowns)


def _left_over(cost: float, problem: _core.FitProblem, row_scale: Numbers, solution: _core.FitSolution) -> float:
    """Give the scatter of what is left; of what is interpolated, or exact, the least that is told.

    Components that were not measured count, too: it is rather too small, and steps go on for longer.
    """
    n_numbers = 3 * int((row_scale > 0.0).sum())
    return max(math.sqrt(cost / max(n_numbers - solution.rank, 1)), _LEAST_LEFT)


def _cost(problem: _core.FitProblem, residual: Numbers, row_scale: Numbers, held: Numbers) -> float:
    whitened = problem.whitened(residual) * row_scale[:, None]
    return float((whitened**2).sum()) + float(held @ held)
