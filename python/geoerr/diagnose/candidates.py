"""What may be missing, as groups of columns: every offered effect in all forms, closed under shifts of its origin.

An inner parameter in which a formula is affine (a fixed point, a reference) needs no trial values: the columns at
both ends of its range span those at all others. Of every other one there are trial values so close that neighbours
are alike.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.effects.collection import Catalogue
from geoerr.effects.covariates import columns_wanting, temperature_choices
from geoerr.effects.effect import Effect
from geoerr.errors import InputFileError
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s, variable_columns
from geoerr.model.compile import compile_terms, core_part
from geoerr.terms import EffectReference, Parameter, Term

# Trial values before any are put in between, for so many inner parameters that are not affine.
_SEEDS = {1: 9, 2: 5}
_FEWEST_SEEDS = 3
# Two neighbouring trials with a smaller cosine get one between them: what lies between has 0.95 of its gain.
_ALIKE = 0.8
_DEEPEST = 9
_MOST_TRIALS = {1: 600, 2: 150}
_ROWS_TO_COMPARE = 300
# A formula is affine in a parameter where the middle is the mean of the ends to this share.
_AFFINE = 1e-9
# Columns whose part off the others is below this share of them are inside already.
_INSIDE = 1e-9


@dataclass(frozen=True, eq=False)
class Shapes:
    """The columns of one term at trial values of its inner parameters.

    Attributes
    ----------
    term
        The term, values unknown; None of a probe.
    channels
        Channel of each part, with its factor.
    columns
        Part and coefficient of each column of the formulas; coefficients of all corners one after the other.
    n_coefficients
        Coefficients of the group: those of the term, times the corners of affine parameters.
    corners
        Values of the affine parameters (by place) at each corner.
    trials
        Values of all inner parameters at each trial; affine ones at their middle.
    place : (n,)
        Number of each row's set of variables: rows of one set have one value.
    values : (n_trials, n_columns, n_sets)
        The formulas.
    """

    term: Term | None
    channels: tuple[tuple[str, float], ...]
    columns: tuple[tuple[int, int], ...]
    n_coefficients: int
    corners: tuple[dict[int, float], ...]
    trials: tuple[tuple[float, ...], ...]
    place: np.ndarray
    values: Numbers


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect for an axis and a covariate, with every way to write it."""

    reference: EffectReference
    effect: Effect
    shapes: tuple[Shapes, ...]

    @property
    def n_trials(self) -> int:
        """Number of ways to write it, over forms, lags and trial values."""
        return sum(len(one.trials) for one in self.shapes)


def candidates_of(
    fitted: Fitted, known: Catalogue, present: Sequence[str] = ()
) -> tuple[list[Candidate], list[tuple[str, str]]]:
    """Give every candidate that the data can carry, and the effects that are not offered, with the reason.

    Parameters
    ----------
    present
        Ids of terms that the model has besides those of the fit.
    """
    sightings = fitted.sightings
    columns = [*sightings.covariate_columns]
    is_circular = "circle" in sightings.frames
    taken = {term.id for term in fitted.terms} | set(present)
    found: list[Candidate] = []
    not_offered: list[tuple[str, str]] = []
    for effect in known:
        why = _why_not(effect, fitted, columns, is_circular)
        if why is not None:
            not_offered.append((effect.id, why))
            continue
        references = effect.candidates(
            fitted.machine, columns, n_sessions=len(sightings.sessions), is_circular=is_circular
        )
        for reference in references:
            if str(reference) in taken:
                continue
            shapes = [shapes_of(fitted, term) for term in _terms(effect, reference, fitted, columns)]
            if shapes:
                found.append(Candidate(reference, effect, tuple(shapes)))
    return found, not_offered


def _why_not(effect: Effect, fitted: Fitted, columns: Sequence[str], is_circular: bool) -> str | None:
    if effect.detector is not None:
        return "is found by a check of its own, not by a formula"
    if effect.offered_as is not None:
        return f"is offered as {effect.offered_as}"
    if effect.is_smooth:
        return "consists of the smooth functions of the rigid-body model: fit with all components"
    return effect.wanting(columns, n_sessions=len(fitted.sightings.sessions), is_circular=is_circular)


def _terms(effect: Effect, reference: EffectReference, fitted: Fitted, columns: Sequence[str]) -> list[Term]:
    """Give the term of every form of a candidate, lagged and not."""
    sightings = fitted.sightings
    times = times_s(sightings)
    span = (float(times.min()), float(times.max()))
    result = []
    for form in effect.forms:
        if columns_wanting(form, effect.parameter_names, columns) is not None:
            continue
        if reference.covariate not in (*temperature_choices(form, columns), *form.covariates):
            continue
        for lagged in (False, True):
            if lagged and (reference.covariate is None or "t" not in columns):
                continue
            try:
                result.append(
                    effect.term(
                        reference.axis,
                        reference.covariate,
                        fitted.machine,
                        lagged=lagged,
                        form=form.name,
                        time_range_s=span,
                        n_sessions=len(sightings.sessions),
                    )
                )
            except InputFileError:
                # This form belongs to another covariate.
                continue
    return result


class Formulas:
    """A term's formulas at the rows of the data."""

    def __init__(self, fitted: Fitted, term: Term) -> None:
        sightings = fitted.sightings
        compiled = compile_terms(fitted.machine, (term,))
        variables = variable_columns(sightings, compiled.variables)
        self.known = np.isfinite(variables).all(axis=0)
        variables = np.nan_to_num(variables)
        self.times = times_s(sightings) if compiled.needs_order else None
        self.starts = sightings.starts
        if compiled.needs_order:
            self.variables, self.place = np.ascontiguousarray(variables), np.arange(len(sightings))
        else:
            self.variables, self.place = _sets(variables)
            self.starts = np.zeros(0, dtype=np.int64)
        self.parts: list[tuple[_core.Expression | _core.Basis, int, list[int], list[int]]] = []
        channels, columns = [], []
        for number, part in enumerate(term.parts):
            channel, factor, axis, shape, coefficients, inner = core_part(term, part, compiled.variables)
            channels.append((channel, factor))
            self.parts.append((shape, axis, coefficients, inner))
            columns += [(number, place) for place in coefficients]
        self.channels, self.columns = tuple(channels), tuple(columns)

        self.kept: np.ndarray | None = None

    def some(self, rows: np.ndarray) -> Formulas:
        """Give the formulas at some of the sets; one that is a recursion along rows is evaluated at all."""
        result = copy(self)
        if self.times is None:
            result.variables = np.ascontiguousarray(self.variables[:, rows])
        else:
            result.kept = rows
        return result

    def at(self, inner: Sequence[float]) -> Numbers:
        """Give all columns (n_columns, n_sets); 0 where there is no value."""
        blocks = []
        for shape, _, _, places in self.parts:
            assert isinstance(shape, _core.Expression)
            own = np.array([inner[place] for place in places], dtype=np.float64)
            blocks.append(shape.coefficient_columns(self.variables, own, self.starts, self.times, 1).T)
        values = np.concatenate(blocks)
        if self.kept is not None:
            values = values[:, self.kept]
        return values if np.isfinite(values.sum()) else np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


def _sets(variables: Numbers) -> tuple[Numbers, np.ndarray]:
    """Give the different columns of the variables (k, m), and the number of each row's (n,)."""
    if not len(variables):
        return np.zeros((0, 1)), np.zeros(variables.shape[1], dtype=np.int64)
    if len(variables) == 1:
        values, place = np.unique(variables[0], return_inverse=True)
        return values[None, :], place.ravel()
    # One number a row first: whole rows compare slowly.
    codes = np.zeros(variables.shape[1], dtype=np.int64)
    for row in variables:
        _, own = np.unique(row, return_inverse=True)
        _, codes = np.unique(codes * (int(own.max()) + 1) + own.ravel(), return_inverse=True)
    _, first, place = np.unique(codes, return_index=True, return_inverse=True)
    return np.ascontiguousarray(variables[:, first]), place.ravel()


def shapes_of(fitted: Fitted, term: Term) -> Shapes:
    """Evaluate a term at trial values of its inner parameters."""
    formulas = Formulas(fitted, term)
    inner = term.inner
    middle = [_middle(parameter) for parameter in inner]
    affine = [place for place in range(len(inner)) if _is_affine(formulas, inner, middle, place)]
    free = [
        place for place, one in enumerate(inner) if place not in affine and np.isnan(one.value) and not one.is_fixed
    ]
    corners = [
        dict(zip(affine, values, strict=True))
        for values in itertools.product(*[_ends(inner[place]) for place in affine])
    ]
    grids = [
        _grid(formulas, inner, middle, place, len(free)) if place in free else [middle[place]]
        for place in range(len(inner))
    ]
    most = _MOST_TRIALS.get(len(free), _MOST_TRIALS[2]) if free else 1
    while np.prod([len(grid) for grid in grids], dtype=np.float64) > most:
        longest = max(range(len(grids)), key=lambda place: len(grids[place]))
        grids[longest] = grids[longest][::2]
    trials = [tuple(values) for values in itertools.product(*grids)]
    values = np.stack(
        [
            np.concatenate(
                [formulas.at([corner.get(place, value) for place, value in enumerate(trial)]) for corner in corners]
            )
            for trial in trials
        ]
    )
    k = len(term.coefficients)
    # Rows that lack a covariate have no value: their set is the last, and 0.
    place = np.where(formulas.known, formulas.place, values.shape[2])
    values = np.concatenate([values, np.zeros((*values.shape[:2], 1))], axis=2)
    return Shapes(
        term,
        formulas.channels,
        tuple(
            (part, coefficient + k * corner)
            for corner in range(len(corners))
            for part, coefficient in formulas.columns
        ),
        k * len(corners),
        tuple(corners),
        tuple(trials),
        place,
        values,
    )


def _ends(parameter: Parameter) -> tuple[float, float]:
    assert parameter.low is not None
    assert parameter.high is not None
    return parameter.low, parameter.high


def _middle(parameter: Parameter) -> float:
    if not np.isnan(parameter.value):
        return parameter.value
    low, high = _ends(parameter)
    return float(np.sqrt(low) * np.sqrt(high)) if parameter.spacing == "log" else 0.5 * (low + high)


def _is_affine(formulas: Formulas, inner: Sequence[Parameter], middle: Sequence[float], place: int) -> bool:
    if not np.isnan(inner[place].value) or inner[place].is_fixed:
        return False
    low, high = _ends(inner[place])
    at = [
        [*middle[:place], value, *middle[place + 1 :]]
        for value in (low, 0.5 * (low + high), high, 0.7 * low + 0.3 * high)
    ]
    first, mean, last, other = (formulas.at(values) for values in at)
    size = max(float(np.abs(first).max()), float(np.abs(last).max()), 1e-300)
    off = max(float(np.abs(mean - 0.5 * (first + last)).max()), float(np.abs(other - 0.7 * first - 0.3 * last).max()))
    return off < _AFFINE * size


def _grid(
    formulas: Formulas, inner: Sequence[Parameter], middle: Sequence[float], place: int, n_free: int
) -> list[float]:
    """Give trial values: seeds, and between neighbours that are too different others."""
    parameter = inner[place]
    low, high = _ends(parameter)
    is_log = parameter.spacing == "log"
    spaced = (np.geomspace if is_log else np.linspace)(low, high, _SEEDS.get(n_free, _FEWEST_SEEDS))
    seeds = [float(value) for value in spaced]
    n_sets = formulas.at(middle).shape[1]
    rows = np.arange(n_sets)
    if n_sets > _ROWS_TO_COMPARE:
        rows = np.sort(np.random.default_rng(n_sets).choice(n_sets, _ROWS_TO_COMPARE, replace=False))
    formulas = formulas.some(rows)

    def spaces(values: Sequence[float]) -> list[Numbers]:
        columns = np.stack([formulas.at([*middle[:place], value, *middle[place + 1 :]]) for value in values])
        return list(_spaces(columns, formulas.columns))

    found = dict(zip(seeds, spaces(seeds), strict=True))
    most = _MOST_TRIALS.get(n_free, _MOST_TRIALS[2])
    gaps = list(itertools.pairwise(sorted(found)))
    for _ in range(_DEEPEST):
        cosines = _cosines(*(np.stack([found[gap[end]] for gap in gaps]) for end in (0, 1)))
        wide = [gap for gap, cosine in zip(gaps, cosines, strict=True) if cosine < _ALIKE]
        wide = wide[: max(most - len(found), 0)]
        if not wide:
            break
        between = [float(np.sqrt(a) * np.sqrt(b)) if is_log else 0.5 * (a + b) for a, b in wide]
        found |= dict(zip(between, spaces(between), strict=True))
        gaps = [half for (a, b), c in zip(wide, between, strict=True) for half in ((a, c), (c, b))]
    return sorted(found)


def _spaces(values: Numbers, columns: Sequence[tuple[int, int]]) -> Numbers:
    """Give an orthonormal basis of what each trial's coefficients do, (n_trials, rows, k); 0 beyond the rank."""
    by_coefficient: dict[int, list[int]] = {}
    for number, (_, coefficient) in enumerate(columns):
        by_coefficient.setdefault(coefficient, []).append(number)
    longest = max(len(own) for own in by_coefficient.values())
    padded = np.zeros((len(values), len(by_coefficient), longest, values.shape[2]))
    for row, own in enumerate(by_coefficient.values()):
        padded[:, row, : len(own)] = values[:, own]
    stacked = padded.reshape(*padded.shape[:2], -1)
    gram = stacked @ stacked.transpose(0, 2, 1)
    size = np.sqrt(np.maximum(np.einsum("tkk->tk", gram), 1e-300))
    value, vector = np.linalg.eigh(gram / (size[:, :, None] * size[:, None, :]))
    scale = np.where(value > _INSIDE, 1.0 / np.sqrt(np.maximum(value, _INSIDE)), 0.0)
    return np.asarray(stacked.transpose(0, 2, 1) @ (vector / size[:, :, None] * scale[:, None, :]))


def _cosines(first: Numbers, second: Numbers) -> Numbers:
    """Give the smallest cosine between two spaces each: 0 where their dimensions differ, 1 where both have none."""
    n_first, n_second = ((np.abs(basis).max(axis=1) > 0.0).sum(axis=1) for basis in (first, second))
    cosines = np.linalg.svd(first.transpose(0, 2, 1) @ second, compute_uv=False)
    smallest = np.take_along_axis(cosines, np.maximum(n_first - 1, 0)[:, None], axis=1)[:, 0]
    return np.where(n_first != n_second, 0.0, np.where(n_first == 0, 1.0, smallest))
