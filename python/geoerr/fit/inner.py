"""Where inner parameters (periods, lags, decays, places) start: the value that explains most of what is left.

Trial values lie so close that none in between is a stranger to both its neighbours (`_ALIKE`): a wave of 2 mm
over 400 mm is told from one that is a four-hundredth off. What a trial explains beyond the fit is exact and takes all
rows; Gauss-Newton goes on from the best. Of periods that are the same wave at the measured places (`periods`) it is
the likeliest.

| symbol | code | what |
|---|---|---|
| D_p | `directions` | whitened displacement of each row by one unit on the channel of part p |
| f_p | `shapes` | columns of the formula of part p: the only thing that a trial value changes |
| S | `spread` | orthonormal columns of the fit: its hat matrix is S Sᵀ |
| r | `residual` | what the fit leaves, whitened |

A candidate's columns are C = Σ_p D_p f_p. With CᵀC = Σ f_p (D_p·D_q) f_q, Sᵀ C = Σ (Sᵀ D_p) f_p, rᵀC = Σ (D_p·r) f_p
the sums over components, and over rows in which the formula has the same value, are made once for all trials.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr import _core
from geoerr.column_names import is_temperature
from geoerr.fit.fitted import Fitted
from geoerr.fit.jumps import Gaps, is_jump_in_time
from geoerr.fit.owned import OWNED, are_owned
from geoerr.fit.periods import alike_periods, is_wave, likeliest, place_of_period
from geoerr.fit.sightings import Numbers
from geoerr.fit.start import KINDS
from geoerr.fit.steady import ends_and_middle, is_steady
from geoerr.fit.ties import first_best
from geoerr.fit.variables import complete_rows_of, times_s, variable_columns
from geoerr.model.compile import Compiled, compile_terms, core_part
from geoerr.terms import Parameter, Part, Term

# Trial values of each of so many inner parameters before any are put in between.
_SEEDS = {1: 49, 2: 17, 3: 9}
_FEWEST_SEEDS = 5
# Combinations of trial values: beyond them the search is coarser than it should be.
_MOST_TRIALS = 8192
# Neighbours whose column spaces have a smaller cosine get a trial between them. For a wave it is sin(πu)/(πu) at
# frequencies u/span apart: 0.7 at u = 0.44, so that the truth is within 0.22/span, where 0.85 of its gain is left.
_ALIKE = 0.7
_DEEPEST = 16
# Rows by which neighbours are compared: a cosine by chance is 1/√512.
_ROWS_TO_COMPARE = 512
# Values that are tried between the neighbours of the best one.
_CLOSER = 17
_ROUNDS_CLOSER = 2
# A formula that is a straight line in its temperatures is one to this share of its largest value.
_LINEAR = 1e-9
# Moments of a jump that are tried at once; of more, every so manieth, and then all about the best.
_MOST_MOMENTS = 1024
# Multiples of its frequency that a wave may have and still be one wave: what places see alike of it, they do of all.
_HARMONICS = (1, 2, 3, 4)
# Numbers of one block of trials: 16 MB.
_BLOCK = 2_000_000


def has_unknown_inner(term: Term) -> bool:
    """Tell whether a term has an inner parameter without a value."""
    return any(np.isnan(parameter.value) for parameter in term.inner)


def started(fitted: Fitted, term: Term, *, one_step: bool = False, threads: int = 0) -> Term:
    """Give the term with inner parameters at the trial values that explain most of the fit's residual."""
    return best_start(where_known(fitted, [term], one_step=one_step), term, threads=threads)[0]


def where_known(fitted: Fitted, terms: Sequence[Term], *, one_step: bool = False) -> Fitted:
    """Give a fit of the rows that have what all of some terms need.

    Of the others nothing is known: counted as rows in which the terms are 0, those of a thermometer that was silent
    speak for a lag of hours.
    """
    known = fitted.solved.used.copy()
    for term in terms:
        names = compile_terms(fitted.machine, (term,)).variables
        known &= complete_rows_of(fitted.sightings, names, variable_columns(fitted.sightings, names), (term,))
    if not known.any() or np.array_equal(known, fitted.solved.used):
        return fitted
    return fitted.again(fitted.terms, one_step=one_step, used=known)


def best_start(fitted: Fitted, term: Term, *, threads: int = 0) -> tuple[Term, float]:
    """Give the same, and by how much the sum of squares falls when it is added to the fit.

    The fit is one of rows that have what the term needs (`where_known`).
    """
    candidate = _Candidate(fitted, term, threads)
    beyond = _Beyond(fitted, candidate, threads)
    moments = _moments(candidate, term)
    every = -(-len(moments) // _MOST_MOMENTS)
    trials: list[tuple[float, ...]] = (
        [(moment,) for moment in moments[::every]]
        if moments
        else list(itertools.product(*_grids(candidate, term.inner)))
    )
    gains = beyond.gains(trials)
    if every > 1:
        first = max(int(np.argmax(gains)) - 1, 0) * every
        trials = [(moment,) for moment in moments[first : first + 2 * every + 1]]
        gains = beyond.gains(trials)
    trials, gains = _closer(beyond, trials, gains)
    best = first_best(gains)
    gain = float(gains[best])
    inner = tuple(replace(p, value=v) for p, v in zip(term.inner, trials[best], strict=True))
    found = replace(term, inner=inner)
    return _at_likeliest_period(fitted, candidate, found, gain) if gain > 0.0 else found, gain


def other_periods(fitted: Fitted, term: Term) -> dict[str, list[float]]:
    """Give other values of a wave's period, by its name, that are the same at the measured places; none of others."""
    if place_of_period(term) is None:
        return {}
    wave = _wave_of(_Candidate(fitted, term, fitted.threads), term)
    others = [] if wave is None else _alike(*wave)
    return {wave[0].name: others} if wave is not None and others else {}


def n_trials(fitted: Fitted, term: Term) -> int:
    """Give how many values of its inner parameters a search tells apart; 1 of a term that has none to search for."""
    if all(one.is_fixed for one in term.inner):
        return 1
    unknown = replace(term, inner=tuple(one if one.is_fixed else replace(one, value=np.nan) for one in term.inner))
    candidate = _Candidate(fitted, unknown, fitted.threads)
    return len(_moments(candidate, unknown)) or math.prod(map(len, _grids(candidate, unknown.inner)))


def _at_likeliest_period(fitted: Fitted, candidate: _Candidate, term: Term, gain: float) -> Term:
    """Give a wave the likeliest of the periods that the places do not tell apart; leave any other term.

    The frequency of a wave that explains G of the sum of squares over a span L is known to √(12 σ²/G)/(2π L), the
    bound of Cramér and Rao for places in even steps; σ² is the variance of what is left.
    """
    wave = _wave_of(candidate, term)
    others = [] if wave is None else _alike(*wave)
    if wave is None or not others:
        return term
    period, values = wave
    left = max(fitted.scale**2 - gain / fitted.dof, 0.0) if fitted.dof > 0 else 0.0
    std = float(np.sqrt(12.0 * left / gain) / (2.0 * np.pi * np.ptp(values)))
    best = likeliest(replace(period, std=std * period.value**2), [period.value, *others])
    return replace(term, inner=tuple(replace(one, value=best) if one is period else one for one in term.inner))


def _wave_of(candidate: _Candidate, term: Term) -> tuple[Parameter, Numbers] | None:
    """Give a wave's period and its variable at the rows that show it, (n,); None of what is no wave."""
    place = place_of_period(term)
    if place is None:
        return None
    rows = np.flatnonzero(candidate.is_seen)
    values, at = candidate.variables[candidate.names.index(term.variables[0])][rows], candidate.rows(rows)
    inner = [one.value for one in term.inner]

    def columns_at(period: float) -> Numbers:
        return np.asarray(at.shapes([[*inner[:place], period, *inner[place + 1 :]]])[0])

    period = term.inner[place]
    return (period, values) if is_wave(columns_at, values, period, harmonics=_HARMONICS) else None


def _alike(period: Parameter, values: Numbers) -> list[float]:
    return alike_periods(values, period.value, *period.ends)


def _closer(
    beyond: _Beyond, trials: list[tuple[float, ...]], gains: Numbers
) -> tuple[list[tuple[float, ...]], Numbers]:
    """Look between the neighbours of the best trial: forms are compared by their best.

    Of several parameters at one after the other, twice: a fixed point between two trials would speak against a lag.
    """
    grids = [sorted(set(values)) for values in zip(*trials, strict=True)]
    varied = [place for place, values in enumerate(grids) if len(values) > 1]
    for place in varied * (1 if len(varied) == 1 else _ROUNDS_CLOSER):
        best = trials[first_best(gains)]
        low, high = _neighbours(grids[place], best[place])
        between = [(*best[:place], float(v), *best[place + 1 :]) for v in np.linspace(low, high, _CLOSER)]
        trials, gains = [*trials, *between], np.concatenate([gains, beyond.gains(between)])
    return trials, gains


def _neighbours(values: Sequence[float], value: float) -> tuple[float, float]:
    """Give the values before and behind one among those that were tried, or beside which it was found."""
    below = [one for one in values if one < value]
    above = [one for one in values if one > value]
    return (below[-1] if below else values[0]), (above[0] if above else values[-1])


class _Candidate:
    """A term's columns at trial values of its inner parameters, in parts."""

    def __init__(self, fitted: Fitted, term: Term, threads: int) -> None:
        sightings = fitted.sightings
        compiled = compile_terms(fitted.machine, (term,))
        variables = variable_columns(sightings, compiled.variables)
        known = complete_rows_of(sightings, compiled.variables, variables, (term,))
        self.names = list(compiled.variables)
        self.n_coefficients, self.inner = len(term.coefficients), term.inner
        self.needs_order = compiled.needs_order
        # What runs along the rows passes over those that lack something.
        self.variables = np.ascontiguousarray(variables if self.needs_order else np.nan_to_num(variables))
        self.starts = sightings.sequences
        self.times = times_s(sightings) if compiled.needs_order else None
        self.shapes: list[tuple[_core.Expression, list[int]]] = []
        # Part and coefficient of each column of the formulas.
        self.columns: list[tuple[int, int]] = []
        for number, part in enumerate(term.parts):
            _, _, _, shape, coefficients, inner = core_part(term, part, compiled.variables)
            assert isinstance(shape, _core.Expression)
            if not self.needs_order:
                shape = _by_variables(term, part, compiled.variables, coefficients)
            self.shapes.append((shape, inner))
            self.columns += [(number, coefficient) for coefficient in coefficients]
        self.directions = directions(fitted, term, (known & fitted.solved.used).astype(np.float64), threads)

    @property
    def is_seen(self) -> np.ndarray:
        """Rows at which it can show, (n,)."""
        return np.asarray(np.abs(self.directions).max(axis=(0, 2)) > 0.0)

    def rows(self, chosen: np.ndarray) -> _Rows:
        """Give some of the rows for evaluation: a formula that is a recursion along them needs all."""
        if self.needs_order:
            return _Rows(self, self.variables, self.starts, self.times, chosen)
        return _Rows(self, np.ascontiguousarray(self.variables[:, chosen]), np.zeros(0, dtype=np.int64), None, None)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows at which a candidate's formulas are evaluated."""

    candidate: _Candidate
    variables: Numbers
    starts: np.ndarray
    times: Numbers | None
    taken: np.ndarray | None

    def shapes(self, trials: Sequence[Sequence[float]]) -> Numbers:
        """Give the columns of all formulas at each trial, (n_trials, n_columns, n_rows); 0 for no value."""
        of_parts = self._in_order(trials) if self.candidate.needs_order else self._at_once(trials)
        values = np.concatenate(of_parts, axis=1)
        if not np.isfinite(values.sum()):
            values = np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)
        return values

    # A thread of its own for a formula: where linear algebra leaves a processor's vector units in wide mode, formulas
    # on the same thread take up to eight times as long.

    def _at_once(self, trials: Sequence[Sequence[float]]) -> list[Numbers]:
        """Evaluate all trials as if they were rows: a call costs more than five hundred rows."""
        n_rows = self.variables.shape[1]
        inner = np.repeat(np.array(trials, dtype=np.float64).T, n_rows, axis=1)
        variables = np.concatenate([np.tile(self.variables, (1, len(trials))), inner])
        parts = []
        for shape, _ in self.candidate.shapes:
            columns = shape.coefficient_columns(variables, np.zeros(0), self.starts, None, 1).T
            parts.append(columns.reshape(len(columns), len(trials), n_rows).transpose(1, 0, 2))
        return parts

    def _in_order(self, trials: Sequence[Sequence[float]]) -> list[Numbers]:
        parts = []
        for shape, places in self.candidate.shapes:
            inner = np.array(trials, dtype=np.float64)[:, places]
            columns = [
                shape.coefficient_columns(self.variables, np.ascontiguousarray(own), self.starts, self.times, 1).T
                for own in inner
            ]
            parts.append(np.stack([values[:, self.taken] for values in columns]))
        return parts


def _by_variables(term: Term, part: Part, variables: Sequence[str], coefficients: Sequence[int]) -> _core.Expression:
    """Compile a part's formula with the term's inner parameters as variables after the others."""
    used = set(part.names)
    return _core.Expression(
        part.expression or "",
        [name if name in used else "-" for name in (*variables, *(parameter.name for parameter in term.inner))],
        [term.coefficients[place].name for place in coefficients],
        [],
        dict(part.definitions),
    )


def directions(fitted: Fitted, term: Term, scale: Numbers, threads: int) -> Numbers:
    """Give the whitened displacement of each row by one unit on each part's channel, (n_parts, n, 3)."""
    unit = Parameter("u", "")
    parts = tuple(
        replace(
            term,
            id=f"part-{number}",
            coefficients=(unit,),
            inner=(),
            parts=(Part(part.channel, "u", factor=part.factor),),
        )
        for number, part in enumerate(term.parts)
    )
    compiled = compile_terms(fitted.machine, parts)
    problem = _problem(fitted, compiled)
    design = problem.design(problem.start, scale, 0, len(scale), threads)
    return np.ascontiguousarray(design[:, : len(parts)].reshape(len(scale), 3, len(parts)).transpose(2, 0, 1))


def _problem(fitted: Fitted, compiled: Compiled) -> _core.FitProblem:
    # As the solution has it: with frames that are another few steps on, what a fit can do leaves less than nothing of
    # columns that it nearly has, where a calibration's unknowns are large and nearly cancel.
    sightings, state = fitted.sightings, fitted.solved.design_state
    kinds = np.array([KINDS[kind] for kind in sightings.frames], dtype=np.uint8)
    pivots = np.zeros((len(sightings.sessions), 3))
    return _core.FitProblem(
        compiled.core,
        sightings.carrier,
        np.ascontiguousarray(sightings.commanded_mm),
        np.ascontiguousarray(sightings.offset_mm),
        np.zeros((0, len(sightings))),
        sightings.sequences,
        None,
        np.ascontiguousarray(sightings.measured_mm),
        np.ascontiguousarray(sightings.whitening),
        sightings.session,
        (kinds, state.rotations, state.translations_mm, state.excess_mm, pivots),
        np.zeros(compiled.n_coefficients),
        np.zeros(0),
        [],
        None,
        length=sightings.length,
    )


def _moments(candidate: _Candidate, term: Term) -> list[float]:
    """Give the moments of a jump on the clock that the rows can tell apart: midway between rows; none for others.

    A frame takes up what is behind a jump in all later sessions: jumps that are alike as columns are not beside it.
    """
    if not is_jump_in_time(term) or len(term.inner) != 1 or not np.isnan(term.inner[0].value):
        return []
    low, high = term.inner[0].low, term.inner[0].high
    assert low is not None
    assert high is not None
    middle = Gaps.of(candidate.variables[0, candidate.is_seen]).middle
    return [float(moment) for moment in middle if low <= moment <= high]


def _grids(candidate: _Candidate, inner: Sequence[Parameter]) -> list[list[float]]:
    """Give the trial values of each parameter, as many as the number of their combinations allows."""
    size = len(candidate.directions[0])
    rows = np.flatnonzero(candidate.is_seen)
    if len(rows) > _ROWS_TO_COMPARE:
        rows = np.sort(np.random.default_rng(size).choice(rows, _ROWS_TO_COMPARE, replace=False))
    n_unknown = sum(bool(np.isnan(parameter.value)) for parameter in inner)
    seeds = _SEEDS.get(n_unknown, _FEWEST_SEEDS)
    while True:
        grids = [_grid(candidate, rows, inner, place, seeds) for place in range(len(inner))]
        if seeds <= _FEWEST_SEEDS or np.prod([len(grid) for grid in grids], dtype=np.float64) <= _MOST_TRIALS:
            break
        seeds = max(seeds // 2, _FEWEST_SEEDS)
    while np.prod([len(grid) for grid in grids], dtype=np.float64) > _MOST_TRIALS:
        longest = max(range(len(grids)), key=lambda place: len(grids[place]))
        grids[longest] = grids[longest][::2]
    return grids


def _grid(
    candidate: _Candidate, rows: np.ndarray, inner: Sequence[Parameter], place: int, n_seeds: int
) -> list[float]:
    """Give trial values of one parameter: seeds, and between neighbours that are too different others."""
    parameter = inner[place]
    if not np.isnan(parameter.value):
        return [parameter.value]
    low, high = parameter.ends
    if parameter.is_fixed:
        return [low]
    is_log = parameter.spacing == "log"
    at = candidate.rows(rows)
    others = [one.middle for one in inner]

    root = _roots(candidate.directions[:, rows])

    def spaces(values: Sequence[float]) -> Numbers:
        trials = [[*others[:place], value, *others[place + 1 :]] for value in values]
        return _spaces(candidate, at.shapes(trials), root)

    values = [float(v) for v in (np.geomspace if is_log else np.linspace)(low, high, n_seeds)]
    found = dict(zip(values, spaces(values), strict=True))
    gaps = list(itertools.pairwise(values))
    for _ in range(_DEEPEST):
        cosines = _cosines(*(np.stack([found[gap[end]] for gap in gaps]) for end in (0, 1)))
        wide = [gap for gap, cosine in zip(gaps, cosines, strict=True) if cosine < _ALIKE]
        wide = wide[: max(_MOST_TRIALS - len(found), 0)]
        if not wide:
            break
        between = [float(np.sqrt(low) * np.sqrt(high)) if is_log else 0.5 * (low + high) for low, high in wide]
        found |= dict(zip(between, spaces(between), strict=True))
        gaps = [
            half
            for (low, high), middle in zip(wide, between, strict=True)
            for half in ((low, middle), (middle, high))
        ]
    return sorted(found)


def _roots(directions: Numbers) -> Numbers:
    """Give R (n, n_parts, n_parts) with R_i R_i the products of the parts' directions: lengths and angles only."""
    value, vector = np.linalg.eigh(np.einsum("pnc,qnc->npq", directions, directions))
    return np.asarray(np.einsum("npk,nk,nqk->npq", vector, np.sqrt(np.maximum(value, 0.0)), vector))


def _spaces(candidate: _Candidate, shapes: Numbers, root: Numbers) -> Numbers:
    """Give an orthonormal basis of the columns at each trial, (n_trials, rows, k); 0 for columns that are missing."""
    n_trials, n_parts = len(shapes), root.shape[1]
    by_component = np.zeros((n_trials, n_parts, len(root), candidate.n_coefficients))
    for number, (part, coefficient) in enumerate(candidate.columns):
        for component in range(n_parts):
            by_component[:, component, :, coefficient] += root[:, component, part] * shapes[:, number]
    columns = by_component.reshape(n_trials, -1, candidate.n_coefficients)
    gram = columns.transpose(0, 2, 1) @ columns
    size = np.sqrt(np.maximum(np.einsum("tkk->tk", gram), 1e-300))
    value, vector = np.linalg.eigh(gram / (size[:, :, None] * size[:, None, :]))
    scale = np.where(value > OWNED, 1.0 / np.sqrt(np.maximum(value, OWNED)), 0.0)
    return np.asarray(columns @ (vector / size[:, :, None] * scale[:, None, :]))


def _cosines(first: Numbers, second: Numbers) -> Numbers:
    """Give the smallest cosine between two spaces each: 0 where their dimensions differ, 1 where both have none."""
    n_first, n_second = ((np.abs(basis).max(axis=1) > 0.0).sum(axis=1) for basis in (first, second))
    cosines = np.linalg.svd(first.transpose(0, 2, 1) @ second, compute_uv=False)
    smallest = np.take_along_axis(cosines, np.maximum(n_first - 1, 0)[:, None], axis=1)[:, 0]
    return np.where(n_first != n_second, 0.0, np.where(n_first == 0, 1.0, smallest))


class _Beyond:
    """What a candidate explains beyond a fit: the sums that no trial value changes, made once."""

    def __init__(self, fitted: Fitted, candidate: _Candidate, threads: int) -> None:
        solved = fitted.solved
        scale = solved.used.astype(np.float64)
        spread = fitted.problem.times(solved.design_state, solved.solution.covariance_root, scale, threads)
        directions = candidate.directions
        weight = np.einsum("pnc,qnc->npq", directions, directions)
        pull = np.einsum("pnc,nc->np", directions, solved.whitened * scale[:, None])
        inside = np.stack([np.matmul(one[:, None, :], spread)[:, 0] for one in directions])
        if candidate.needs_order:
            self.rows = candidate.rows(np.arange(len(scale)))
        else:
            # Rows at which the formula has the same value count as one.
            _, first, place = np.unique(candidate.variables, axis=1, return_index=True, return_inverse=True)
            order, starts = np.argsort(place, kind="stable"), np.cumsum([0, *np.bincount(place)[:-1]])
            self.rows = candidate.rows(first)
            weight, pull = (np.add.reduceat(values[order], starts) for values in (weight, pull))
            inside = np.add.reduceat(inside[:, order], starts, axis=1)
        self.candidate = candidate
        self.weight, self.pull, self.inside = weight, pull, inside
        self.means = self._owned_means()

    def _owned_means(self) -> _Rows | None:
        """Give the rows with every temperature at its mean, where the columns are to be counted from there.

        Of a machine at 120 ± 3 °C a fit with a scale leaves a thousandth of α T (q − q₀), whatever q₀ is (`steady`).
        """
        rows, candidate = self.rows, self.candidate
        temperatures = [place for place, name in enumerate(candidate.names) if is_temperature(name)]
        if not temperatures or not candidate.is_seen.any():
            return None
        mean = np.nanmean(candidate.variables[:, candidate.is_seen][temperatures], axis=1, keepdims=True)
        values = rows.variables[temperatures]

        def at(degc: Numbers) -> _Rows:
            changed = rows.variables.copy()
            changed[temperatures] = degc
            return replace(rows, variables=changed)

        means = at(np.where(np.isnan(values), values, mean))
        trials = list(itertools.product(*map(ends_and_middle, candidate.inner)))
        whole, of_means = rows.shapes(trials), means.shapes(trials)
        changing = whole - of_means
        size, changes = (np.einsum("tkk->tk", self._gram(shapes)) for shapes in (whole, changing))
        if not is_steady(changes, size).any():
            return None
        twice = at(2.0 * values - mean).shapes(trials) - of_means
        if not np.allclose(twice, 2.0 * changing, rtol=0.0, atol=_LINEAR * np.abs(whole).max(initial=0.0)):
            return None
        squares = np.einsum("tkk->tk", self._gram(of_means))
        return means if are_owned(squares, self._inside(of_means)).all() else None

    def _shapes(self, trials: Sequence[Sequence[float]]) -> Numbers:
        shapes = self.rows.shapes(trials)
        return shapes if self.means is None else shapes - self.means.shapes(trials)

    def gains(self, trials: Sequence[Sequence[float]]) -> Numbers:
        """Give the fall of the sum of squares on adding the columns at each trial, (n_trials,)."""
        step = max(_BLOCK // (len(self.pull) * len(self.candidate.columns)), 1)
        return np.concatenate([self._gains(trials[at : at + step]) for at in range(0, len(trials), step)])

    def _gains(self, trials: Sequence[Sequence[float]]) -> Numbers:
        shapes = self._shapes(trials)
        along = np.zeros((len(trials), self.candidate.n_coefficients))
        for a, (p, i) in enumerate(self.candidate.columns):
            along[:, i] += shapes[:, a] @ self.pull[:, p]
        gram, inside = self._gram(shapes), self._inside(shapes)
        size = np.sqrt(np.maximum(np.einsum("tkk->tk", gram), 1e-300))
        beyond = gram - inside @ inside.transpose(0, 2, 1)
        value, vector = np.linalg.eigh(beyond / (size[:, :, None] * size[:, None, :]))
        along = np.einsum("tik,ti->tk", vector, along / size)
        return np.asarray((np.where(value > OWNED, along**2 / np.maximum(value, OWNED), 0.0)).sum(axis=1))

    def _gram(self, shapes: Numbers) -> Numbers:
        """Give the products of the columns of trials with each other, (n_trials, k, k)."""
        k = self.candidate.n_coefficients
        gram = np.zeros((len(shapes), k, k))
        for a, (p, i) in enumerate(self.candidate.columns):
            for b, (q, j) in enumerate(self.candidate.columns):
                gram[:, i, j] += np.einsum("tn,tn,n->t", shapes[:, a], shapes[:, b], self.weight[:, p, q])
        return gram

    def _inside(self, shapes: Numbers) -> Numbers:
        """Give the products of the columns of trials with those of the fit, (n_trials, k, n_columns)."""
        inside = np.zeros((len(shapes), self.candidate.n_coefficients, self.inside.shape[2]))
        for a, (p, i) in enumerate(self.candidate.columns):
            inside[:, i] += shapes[:, a] @ self.inside[p]
        return inside
