"""What may be missing, as groups of columns: every offered effect in all forms, closed under shifts of its origin.

An inner parameter in which a formula is affine (a fixed point, a reference) needs no trial values: the columns at
both ends of its range span those at all others. Of every other one there are trial values so close that neighbours
are alike.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from geoerr.diagnose.classic import lacking_classics
from geoerr.diagnose.faded import has_heights, shows_at, wanting_words
from geoerr.diagnose.functions import CompiledPart, Functions
from geoerr.diagnose.steady import judge_about_means
from geoerr.effects.collection import Catalogue
from geoerr.effects.covariates import columns_wanting, temperature_choices
from geoerr.effects.description import FormSpec
from geoerr.effects.effect import DEFAULT_TIME_RANGE_S, Effect
from geoerr.errors import InputFileError
from geoerr.fit.fitted import Fitted
from geoerr.fit.jumps import Gaps, is_jump_in_time
from geoerr.fit.periods import is_wave, periods_to_try, place_of_period
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers
from geoerr.fit.variables import clock_span_s
from geoerr.machine import AXES
from geoerr.terms import (
    CLOCK_NAME,
    JOINT_CHANNELS,
    PLACE_NAMES,
    RIG_CHANNELS,
    EffectReference,
    Parameter,
    Term,
    names_in,
)

# Trial values of each inner parameter that is not affine, by how many of them a formula has.
_TRIALS = {1: 8, 2: 5}
_FEWEST_TRIALS = 4
# Of a lag behind a temperature: each not quite twice as long as the one before.
_LAGS = 12
# Of the moment of a jump: so many for each session, evenly, and no more than that in all; towards both its ends
# others, each so many times as far from the end as the one before.
_MOMENTS, _MOST_MOMENTS, _TOWARDS_AN_END = 32, 128, 1.6
# Two neighbouring trials with a smaller cosine get one between them: what lies between has 0.8 of its gain.
_ALIKE = 0.6
_DEEPEST = 14
# Times that the span is halved in which an effect fades from sight.
_HALVINGS = 12
_MOST_TRIALS = 4000
# A machine that changed between sessions is measured in a few; where each line is a session of its own nothing tells.
_MOST_SESSIONS = 24
_ROWS_TO_COMPARE = 300
# A formula is affine in a parameter where the middle is the mean of the ends to this share.
_AFFINE = 1e-9
# Columns whose part off the others is below this share of them are inside already.
_INSIDE = 1e-9


# Channels of the rig that do nothing but with the place of a point: at one place they are translations.
_OF_PLACE = tuple(channel for channel in RIG_CHANNELS if not channel.startswith(("rig-t", "motion-")))


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
    codes : (n_trials, n_columns)
        The function of each column (`Functions`).
    """

    term: Term | None
    channels: tuple[tuple[str, float], ...]
    columns: tuple[tuple[int, int], ...]
    n_coefficients: int
    corners: tuple[dict[int, float], ...]
    trials: tuple[tuple[float, ...], ...]
    codes: np.ndarray


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect for an axis and a covariate, with every way to write it.

    Attributes
    ----------
    reference, effect
        What it is.
    shapes
        Of every form that finds it.
    refined
        Terms of forms that say more than those: a second harmonic, a second time constant. The plain form finds what
        they describe; which it is to be is asked once it was found.
    """

    reference: EffectReference
    effect: Effect
    shapes: tuple[Shapes, ...]
    refined: tuple[Term, ...] = ()

    @property
    def n_trials(self) -> int:
        """Number of ways to write it, over forms, lags and trial values."""
        return sum(len(one.trials) for one in self.shapes)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its terms in every form, those that find it first."""
        return (*(one.term for one in self.shapes if one.term is not None), *self.refined)


def candidates_of(
    fitted: Fitted, known: Catalogue, present: Sequence[str] = ()
) -> tuple[list[Candidate], list[tuple[str, str]], Functions]:
    """Give every candidate that the data can carry; the effects that are not offered, and why; the functions.

    Parameters
    ----------
    present
        Channels of classic errors that the model has besides those of the fit.
    """
    sightings = fitted.sightings
    columns = [*sightings.covariate_columns]
    is_circular = "circle" in sightings.frames
    taken = {term.id for term in fitted.terms}
    offered: list[tuple[EffectReference, Effect, list[Term], list[Term]]] = [
        (reference, effect, [term], []) for reference, effect, term in lacking_classics(fitted, known, present)
    ]
    lacking = {effect.id for _, effect, *_ in offered}
    not_offered: list[tuple[str, str]] = []
    still = _still_axes(fitted)
    time_range_s = clock_span_s(sightings) or DEFAULT_TIME_RANGE_S
    for effect in known:
        if effect.is_smooth:
            if effect.id not in lacking:
                not_offered.append((effect.id, "is in the model already"))
            continue
        why = _why_not(effect, fitted, columns, is_circular)
        if why is not None:
            not_offered.append((effect.id, why))
            continue
        n_before = len(offered)
        references = effect.candidates(
            fitted.machine, columns, n_sessions=sightings.n_set_ups, is_circular=is_circular
        )
        for reference in references:
            if str(reference) in taken or not has_its_first(effect, reference, taken):
                continue
            terms, refined = (
                [term for term in own if not _stands_still(fitted, term, still)]
                for own in _terms(effect, reference, fitted, columns, time_range_s)
            )
            if terms:
                offered.append((reference, effect, terms, refined))
        if (
            references
            and effect.again is None
            and len(offered) == n_before
            and not any(str(one) in taken for one in references)
        ):
            not_offered.append((effect.id, "wanting: rows at more than one position of its axis"))
    all_terms = [term for *_, terms, refined in offered for term in (*terms, *refined)]
    functions = Functions(fitted, all_terms)
    judge_about_means(fitted, functions, all_terms)
    found, faded = _laid_out(functions, offered, fitted.solved.used)
    return found, [*not_offered, *faded], functions


def has_its_first(effect: Effect, reference: EffectReference, taken: Collection[str]) -> bool:
    """Tell whether an effect is none that stands only beside another, or that one is in the model."""
    return effect.again is None or str(replace(reference, effect=effect.again)) in taken


def _laid_out(
    functions: Functions, offered: Sequence[tuple[EffectReference, Effect, list[Term], list[Term]]], used: np.ndarray
) -> tuple[list[Candidate], list[tuple[str, str]]]:
    """Give candidates with their shapes; those of which the rows show nothing apart, and what is wanting."""
    before = LaidOut()
    found: list[Candidate] = []
    faded: list[tuple[EffectReference, str]] = []
    for reference, effect, terms, refined in offered:
        laid_out = [_shown(functions, term, before, used) for term in terms]
        shapes = tuple(one for one in laid_out if one is not None)
        if shapes:
            found.append(Candidate(reference, effect, shapes, tuple(refined)))
        else:
            faded.append((reference, wanting_words(terms[0])))
    shown = {one.effect.id for one in found}
    names = {(one.effect if one.effect not in shown else str(one)): why for one, why in faded}
    return found, list(names.items())


def _shown(functions: Functions, term: Term, before: LaidOut, used: np.ndarray) -> Shapes | None:
    """Lay out a term where the rows see something of it; None where they see nothing at any value that is tried."""
    formulas = Formulas(functions, term)
    middle = [parameter.middle for parameter in term.inner]
    if not has_heights(term) or formulas.is_jump or wave_along(formulas, term, middle) is not None:
        # Waves and jumps do not fade.
        return _shapes_of(formulas, term, before)
    few = None if formulas.needs_order else _few_rows(functions.n_rows)

    def shows(inner: Sequence[float]) -> bool:
        return shows_at(formulas.at, inner, few, used)

    free = [place for place, one in enumerate(term.inner) if is_free(one)]
    if len(free) == 1:
        # What refines its value later stays in the range that is shown, too.
        narrowed = _shown_range(
            term.inner[free[0]], lambda value: shows([*middle[: free[0]], value, *middle[free[0] + 1 :]])
        )
        if narrowed is None:
            return None
        inner = (*term.inner[: free[0]], narrowed, *term.inner[free[0] + 1 :])
        return _shapes_of(formulas, replace(term, inner=inner), before)
    shapes = _shapes_of(formulas, term, before)
    seen = np.array([shows(trial) for trial in shapes.trials])
    if not seen.any():
        return None
    trials = tuple(trial for trial, is_seen in zip(shapes.trials, seen, strict=True) if is_seen)
    return replace(shapes, trials=trials, codes=shapes.codes[seen])


def _shown_range(parameter: Parameter, shows: Callable[[float], bool]) -> Parameter | None:
    """Give a parameter with its range narrowed to where the rows show something; None where they show nothing."""
    values = _spaced(parameter, _TRIALS[1])
    seen = [number for number, value in enumerate(values) if shows(value)]
    if not seen:
        return None
    low, high = values[seen[0]], values[seen[-1]]
    if seen[0] > 0:
        low = _edge(parameter, values[seen[0] - 1], low, shows)
    if seen[-1] < len(values) - 1:
        high = _edge(parameter, values[seen[-1] + 1], high, shows)
    return replace(parameter, low=low, high=high)


def _edge(parameter: Parameter, unseen: float, seen: float, shows: Callable[[float], bool]) -> float:
    """Give the value nearest to one at which nothing shows at which something does."""
    for _ in range(_HALVINGS):
        between = float(np.sqrt(unseen) * np.sqrt(seen)) if parameter.spacing == "log" else 0.5 * (unseen + seen)
        unseen, seen = (unseen, between) if shows(between) else (between, seen)
    return seen


def _why_not(effect: Effect, fitted: Fitted, columns: Sequence[str], is_circular: bool) -> str | None:
    if effect.detector is not None:
        return "is found by a check of its own, not by a formula"
    if effect.offered_as is not None:
        return f"is offered as {effect.offered_as}"
    n_sessions = fitted.sightings.n_set_ups
    if effect.each_session and is_circular:
        return "wanting: points alone (each circular run is a session of its own, and would have its own)"
    if effect.each_session and n_sessions > _MOST_SESSIONS:
        return f"wanting: {_MOST_SESSIONS} sessions or fewer (of more, it would be a number for nearly every line)"
    return effect.wanting(columns, n_sessions=n_sessions, is_circular=is_circular)


def _still_axes(fitted: Fitted) -> set[str]:
    """Give the axes of which all rows are at one position."""
    commanded_mm = fitted.sightings.commanded_mm[fitted.solved.used]
    return {axis for index, axis in enumerate(AXES) if np.ptp(commanded_mm[:, index]) < SAME_POSITION_MM}


def _stands_still(fitted: Fitted, term: Term, still: set[str]) -> bool:
    """Tell whether all rows are at one position of an axis whose position the term is a function of.

    There it is a constant on one channel, which simpler effects are; so is an angle seen at one place only.
    """
    sightings, used = fitted.sightings, fitted.solved.used
    names = {name for part in term.parts for name in part.names}
    if still & names:
        return True
    if len(still) == len(AXES) and (names & set(PLACE_NAMES) or set(term.channels) & set(_OF_PLACE)):
        return True
    turns = all(channel in JOINT_CHANNELS and channel[1] in "ABC" for channel in term.channels)
    return turns and len(still) == len(AXES) and bool((np.ptp(sightings.offset_mm[used], axis=0) == 0.0).all())


def _terms(
    effect: Effect,
    reference: EffectReference,
    fitted: Fitted,
    columns: Sequence[str],
    time_range_s: tuple[float, float],
) -> tuple[list[Term], list[Term]]:
    """Give the term of every form of a candidate, lagged and not; those of forms that refine another one apart."""
    plain: list[Term] = []
    refined: list[Term] = []
    for form in effect.forms:
        result = refined if any(_refines(form, other) for other in effect.forms) else plain
        if columns_wanting(form, effect.parameter_names, columns) is not None:
            continue
        if reference.covariate not in (*temperature_choices(form, columns, is_ordered=True), *form.covariates):
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
                        time_range_s=time_range_s,
                        sessions=fitted.sightings.set_ups,
                    )
                )
            except InputFileError:
                # This form belongs to another covariate.
                continue
    return plain, refined


def _refines(form: FormSpec, other: FormSpec) -> bool:
    """Tell whether a form has all that another one has, and more: a harmonic, a second time constant."""
    own, others = ({name for part in one.parts for name in names_in(part.expression)} for one in (form, other))
    return form.covariates == other.covariates and others < own


class Formulas:
    """A term's formulas at the rows of the data."""

    def __init__(self, functions: Functions, term: Term) -> None:
        self.functions = functions
        self.parts: list[CompiledPart] = [one for part in term.parts for one in functions.parts(term, part)]
        self.channels = tuple((part.channel, part.factor) for part in self.parts)
        self.columns = tuple((number, place) for number, part in enumerate(self.parts) for place in part.coefficients)
        self.is_jump = is_jump_in_time(term)
        self.key = tuple((part.expression, part.inner, part.follows) for part in self.parts)

    @property
    def needs_order(self) -> bool:
        """Whether some formula is a recursion along rows."""
        return any(self.functions.needs_order(part) for part in self.parts)

    def is_recursion_in(self, place: int) -> bool:
        """Whether some formula is a recursion along rows that changes with this inner parameter."""
        return any(
            self.functions.expression(part).needs_order or (part.follows is not None and part.follows[1] == place)
            for part in self.parts
        )

    def is_lag(self, place: int) -> bool:
        """Whether this inner parameter is the lag behind a temperature."""
        return any(part.follows is not None and part.follows[1] == place for part in self.parts)

    def codes(self, inner: Sequence[float]) -> list[int]:
        """Give the function of each column."""
        return [code for part in self.parts for code in self.functions.formula(part, inner)]

    def at(self, inner: Sequence[float], rows: np.ndarray | None = None) -> Numbers:
        """Give all columns (n_columns, n); 0 where there is no value."""
        return np.concatenate([self.functions.evaluate(part, inner, rows) for part in self.parts])


@dataclass(frozen=True)
class LaidOut:
    """What alike formulas have in common: trial values, and which parameters are affine."""

    grids: dict[tuple[object, ...], list[float]] = field(default_factory=dict)
    affine: dict[tuple[object, ...], bool] = field(default_factory=dict)


def shapes_of(functions: Functions, term: Term, before: LaidOut | None = None) -> Shapes:
    """Lay out a term's columns at trial values of its inner parameters.

    Parameters
    ----------
    before
        Of formulas that were laid out before; those of this one are added.
    """
    return _shapes_of(Formulas(functions, term), term, LaidOut() if before is None else before)


def _shapes_of(formulas: Formulas, term: Term, before: LaidOut) -> Shapes:
    """Lay out a term whose formulas are known; they do not depend on the ranges of its inner parameters."""
    inner = term.inner
    middle = [parameter.middle for parameter in inner]
    rows = _few_rows(formulas.functions.n_rows)
    affine = []
    for place, parameter in enumerate(inner):
        # Whatever temperature the formula follows.
        alike = (
            tuple((part.expression, part.inner) for part in formulas.parts),
            place,
            parameter.low,
            parameter.high,
        )
        if alike not in before.affine:
            before.affine[alike] = _is_affine(formulas, inner, middle, place, rows)
        if before.affine[alike]:
            affine.append(place)
    free = [place for place, one in enumerate(inner) if place not in affine and is_free(one)]
    corners = [
        dict(zip(affine, values, strict=True))
        for values in itertools.product(*[inner[place].ends for place in affine])
    ]
    choices = []
    for place, parameter in enumerate(inner):
        if place not in free:
            choices.append([middle[place]])
            continue
        # A wave across an axis in two directions needs no other trials than one along it.
        key = (tuple(dict.fromkeys(formulas.key)), place, parameter.low, parameter.high, len(free))
        if key not in before.grids:
            wave = wave_along(formulas, term, middle) if free == [place] else None
            periods = None if wave is None else periods_to_try(wave[1], *parameter.ends)
            before.grids[key] = periods or _grid(formulas, inner, middle, place, len(free), rows)
        choices.append(before.grids[key])
    trials = tuple(tuple(values) for values in itertools.product(*choices))
    k = len(term.coefficients)
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
        trials,
        np.array(
            [
                [
                    code
                    for corner in corners
                    for code in formulas.codes([corner.get(place, value) for place, value in enumerate(trial)])
                ]
                for trial in trials
            ],
            dtype=np.int64,
        ),
    )


def is_free(parameter: Parameter) -> bool:
    """Tell whether an inner parameter's value is to be found."""
    return bool(np.isnan(parameter.value)) and not parameter.is_fixed


@cache
def _few_rows(n_rows: int) -> np.ndarray:
    if n_rows <= _ROWS_TO_COMPARE:
        return np.arange(n_rows)
    return np.sort(np.random.default_rng(n_rows).choice(n_rows, _ROWS_TO_COMPARE, replace=False))


def _is_affine(
    formulas: Formulas, inner: Sequence[Parameter], middle: Sequence[float], place: int, rows: np.ndarray
) -> bool:
    if not is_free(inner[place]) or inner[place].spacing == "log":
        return False
    low, high = inner[place].ends
    few = None if formulas.is_recursion_in(place) else rows
    at = [
        [*middle[:place], value, *middle[place + 1 :]]
        for value in (low, 0.5 * (low + high), high, 0.7 * low + 0.3 * high)
    ]
    first, mean, last, other = (formulas.at(values, few) for values in at)
    size = max(float(np.abs(first).max()), float(np.abs(last).max()), 1e-300)
    off = max(float(np.abs(mean - 0.5 * (first + last)).max()), float(np.abs(other - 0.7 * first - 0.3 * last).max()))
    return off < _AFFINE * size


def _spaced(parameter: Parameter, n: int) -> list[float]:
    low, high = parameter.ends
    return [float(value) for value in (np.geomspace if parameter.spacing == "log" else np.linspace)(low, high, n)]


def _grid(
    formulas: Formulas,
    inner: Sequence[Parameter],
    middle: Sequence[float],
    place: int,
    n_free: int,
    rows: np.ndarray,
) -> list[float]:
    """Give trial values: seeds, and between neighbours that are too different others."""
    parameter = inner[place]
    if n_free == 1 and formulas.is_jump:
        return _moments(formulas, parameter)
    n_seeds = _LAGS if n_free == 1 and formulas.is_lag(place) else _TRIALS.get(n_free, _FEWEST_TRIALS)
    seeds = _spaced(parameter, n_seeds)
    if n_free > 1 or formulas.needs_order:
        return seeds
    is_log = parameter.spacing == "log"

    def spaces(values: Sequence[float]) -> list[Numbers]:
        columns = np.stack([formulas.at([*middle[:place], value, *middle[place + 1 :]], rows) for value in values])
        return list(_spaces(columns, formulas.columns))

    found = dict(zip(seeds, spaces(seeds), strict=True))
    gaps = list(itertools.pairwise(sorted(found)))
    for _ in range(_DEEPEST):
        cosines = _cosines(*(np.stack([found[gap[end]] for gap in gaps]) for end in (0, 1)))
        wide = [gap for gap, cosine in zip(gaps, cosines, strict=True) if cosine < _ALIKE]
        wide = wide[: max(_MOST_TRIALS - len(found), 0)]
        if not wide:
            break
        between = [float(np.sqrt(a) * np.sqrt(b)) if is_log else 0.5 * (a + b) for a, b in wide]
        found |= dict(zip(between, spaces(between), strict=True))
        gaps = [half for (a, b), c in zip(wide, between, strict=True) for half in ((a, c), (c, b))]
    return sorted(found)


def wave_along(formulas: Formulas, term: Term, inner: Sequence[float]) -> tuple[int, Numbers] | None:
    """Give the place of a term's period and its variable (n,); None if it is no wave along one variable."""
    place = place_of_period(term)
    if place is None:
        return None
    functions = formulas.functions
    rows = _few_rows(functions.n_rows)
    values = functions.variables[functions.names.index(term.variables[0])]

    def columns_at(period: float) -> Numbers:
        return formulas.at([*inner[:place], period, *inner[place + 1 :]], rows)

    return (place, values) if is_wave(columns_at, values[rows], term.inner[place]) else None


def n_waves(functions: Functions, term: Term, inner: Sequence[float]) -> float:
    """Give the number of waves of a term over all that was measured; 0 of what is no wave."""
    wave = wave_along(Formulas(functions, term), term, inner)
    return 0.0 if wave is None else float(np.ptp(wave[1])) / inner[wave[0]]


def is_wave_in_some_form(functions: Functions, candidate: Candidate) -> bool:
    """Tell whether a candidate is a wave along one variable in one of its forms; another may be a sum of them."""
    return any(
        shapes.term is not None and n_waves(functions, shapes.term, shapes.trials[0]) > 0.0
        for shapes in candidate.shapes
    )


def n_waves_in_some_form(functions: Functions, candidate: Candidate, term: Term) -> float:
    """Give the number of waves of a candidate as it was settled: of a sum of harmonics those of the first."""
    place = place_of_period(term)
    if place is None or not is_wave_in_some_form(functions, candidate):
        return 0.0
    along = functions.variables[functions.names.index(term.variables[0])]
    return float(np.ptp(along)) / term.inner[place].value


def _moments(formulas: Formulas, parameter: Parameter) -> list[float]:
    """Give moments of a jump, midway between rows: evenly apart in number, and closer towards the ends of a session.

    As columns jumps of a later session are alike; beside a frame of each session they are not. Off its mean the
    correlation of two jumps at shares f < g of a session is the root of f(1 − g)/(g(1 − f)): near its ends it is the
    ratio of their distances from the end that counts.
    """
    functions = formulas.functions
    low, high = parameter.ends
    clock = functions.variables[functions.names.index(CLOCK_NAME)]
    ends = [*functions.starts[1:], len(clock)]
    sessions = [Gaps.of(clock[start:end]).middle for start, end in zip(functions.starts, ends, strict=True)]
    most = min(_MOMENTS, max(_MOST_MOMENTS // max(len(sessions), 1), 1))
    moments = [_towards_ends(middle, most) for middle in sessions if len(middle)]
    found = np.unique(np.concatenate(moments)) if moments else np.empty(0)
    found = found[(found >= low) & (found <= high)]
    return found.tolist() if len(found) else _spaced(parameter, 1)


def _towards_ends(middle: Numbers, most: int) -> Numbers:
    """Give of moments between rows so many evenly, and between them and both ends some in a geometric row."""
    last = len(middle) - 1
    evenly = np.linspace(0, last, min(most, last + 1))
    step = evenly[1] if len(evenly) > 1 else 1.0
    # The first lies one row from the end.
    n_closer = math.ceil(math.log(step + 1.0) / math.log(_TOWARDS_AN_END))
    closer = np.minimum(_TOWARDS_AN_END ** np.arange(n_closer) - 1.0, last)
    return np.asarray(middle[np.unique(np.concatenate([evenly, closer, last - closer]).round().astype(np.int64))])


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
