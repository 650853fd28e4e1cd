"""A candidate as a family: trial values of its inner parameters, each with the columns that it has there.

An inner parameter in which the formula is affine (a fixed point) needs no trial values: columns at both ends of its
range span those at all others, as in the search.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.advice.columns import Poses, Terms
from geoerr.fit.sightings import Sightings
from geoerr.machine import Machine
from geoerr.summaries import listed
from geoerr.terms import Parameter, Term

# Trial values over the whole range of an inner parameter, as many as there is room for: all columns of a candidate
# together are about so many. And near the value that was found, in standard errors.
_COARSE = (5, 11)
_NEAR = (-2.5, -1.0, 1.0, 2.5)
_COLUMNS = 60
# A formula is affine in a parameter where the middle is the mean of the ends to this share.
_AFFINE = 1e-9
_ROWS = 200


@dataclass(frozen=True, eq=False)
class Family:
    """The trials of one candidate, in all its forms.

    Attributes
    ----------
    name
        As references are written.
    terms
        Copies of the terms, inner parameters fixed, as trials need them.
    trials
        For each trial the places of its copies among `terms`: one, or the corners of affine parameters.
    is_spread : (n_trials,)
        Whether a trial belongs to the even spread over the range, or is the value that was found (the first).
    """

    name: str
    terms: tuple[Term, ...]
    trials: tuple[tuple[int, ...], ...]
    is_spread: np.ndarray

    def columns(self) -> list[list[int]]:
        """Give for each trial its columns, counted from this family's first."""
        counts = [len(term.coefficients) for term in self.terms]
        ends = np.cumsum(counts).tolist()
        own = [range(end - count, end) for end, count in zip(ends, counts, strict=True)]
        return [[column for place in trial for column in own[place]] for trial in self.trials]


@dataclass(frozen=True)
class Company:
    """Effects that are one candidate: only together they do what is in question.

    Attributes
    ----------
    terms
        With the same inner parameters, as those of one kind along different axes.
    """

    terms: tuple[Term, ...]

    @property
    def id(self) -> str:
        """Their references."""
        return listed([term.id for term in self.terms])


def joined(families: Sequence[Family], name: str) -> Family:
    """Give families that act together as one: the first trial of each, then the second, coefficients of all free."""
    offsets = np.cumsum([0, *(len(one.terms) for one in families)]).tolist()
    trials = zip(*(one.trials for one in families), strict=False)
    together = tuple(
        tuple(offset + place for offset, trial in zip(offsets, own, strict=False) for place in trial)
        for own in trials
    )
    terms = tuple(term for one in families for term in one.terms)
    return Family(name, terms, together, families[0].is_spread[: len(together)])


def family_of(machine: Machine, forms: Sequence[Term], number: int, sightings: Sightings, poses: Poses) -> Family:
    """Spread trial values around the values that the first form has, and over the ranges of all forms.

    Parameters
    ----------
    forms
        Ways to write the candidate, the one that fits best first.
    number
        Of the candidate, for names that differ.
    """
    copies: list[Term] = []
    trials: list[tuple[int, ...]] = []
    is_spread: list[bool] = []
    for form in forms:
        inner = [_valued(parameter) for parameter in form.inner]
        free = [place for place, one in enumerate(inner) if not one.is_fixed]
        affine = _affine(machine, form, inner, free, sightings, poses) if free else []
        corners = list(itertools.product(*[inner[place].ends for place in affine]))
        searched = [place for place in free if place not in affine]
        width = len(form.coefficients) * len(corners) * max(len(searched), 1)
        room = _COLUMNS // (len(forms) * width) - len(_NEAR)
        own = _trials(inner, searched, int(np.clip(room, *_COARSE)))
        for trial, spread in own:
            first = len(copies)
            for corner in corners:
                at = list(trial)
                for place, value in zip(affine, corner, strict=True):
                    at[place] = value
                copies.append(_fixed(form, at, f"c{number}-{len(copies)}"))
            trials.append(tuple(range(first, len(copies))))
            is_spread.append(spread)
    return Family(forms[0].id, tuple(copies), tuple(trials), np.array(is_spread))


def _trials(inner: Sequence[Parameter], free: Sequence[int], n_coarse: int) -> list[tuple[list[float], bool]]:
    """Give values of all inner parameters at each trial, one free one at a time, and whether it is of the spread."""
    values = [parameter.value for parameter in inner]
    found = [(list(values), True)]
    for place in free:
        coarse, near = _values(inner[place], n_coarse)
        found += [([*values[:place], value, *values[place + 1 :]], True) for value in coarse]
        found += [([*values[:place], value, *values[place + 1 :]], False) for value in near]
    return found


def _valued(parameter: Parameter) -> Parameter:
    """Give a parameter that has a value: the middle of its range, in its own spacing, where it has none."""
    return replace(parameter, value=parameter.middle) if np.isnan(parameter.value) else parameter


def _values(parameter: Parameter, n_coarse: int) -> tuple[list[float], list[float]]:
    (low, high), at, std = parameter.ends, parameter.value, parameter.std
    spread = np.geomspace if parameter.spacing == "log" else np.linspace
    coarse = [float(value) for value in spread(low, high, n_coarse)]
    near = [at + step * std for step in _NEAR] if np.isfinite(std) and 0.0 < std < 0.5 * (high - low) else []
    return coarse, [value for value in near if low < value < high]


def _fixed(term: Term, inner: Sequence[float], name: str) -> Term:
    values = tuple(replace(parameter, value=float(value)) for parameter, value in zip(term.inner, inner, strict=True))
    return replace(term, id=name, inner=values)


def _affine(
    machine: Machine,
    term: Term,
    inner: Sequence[Parameter],
    places: Sequence[int],
    sightings: Sightings,
    poses: Poses,
) -> list[int]:
    """Give the parameters in which the columns are affine, by their values at some rows."""
    some = _some_rows(sightings)
    middle = [parameter.value for parameter in inner]
    copies: list[Term] = []
    shares = (0.0, 0.5, 1.0, 0.3)
    for place in places:
        low, high = inner[place].ends
        for share in shares:
            value = low + share * (high - low)
            copies.append(_fixed(term, [*middle[:place], value, *middle[place + 1 :]], f"a{len(copies)}"))
    columns = Terms(machine, copies, with_inner=False).columns(some, poses)
    k = len(term.coefficients)
    found = []
    for number, place in enumerate(places):
        at = columns[:, :, number * len(shares) * k : (number + 1) * len(shares) * k]
        first, mean, last, other = (at[:, :, part * k : (part + 1) * k] for part in range(len(shares)))
        size = max(float(np.abs(first).max()), float(np.abs(last).max()), 1e-300)
        off = max(
            float(np.abs(mean - 0.5 * (first + last)).max()), float(np.abs(other - 0.7 * first - 0.3 * last).max())
        )
        # Columns that are nothing are not affine in anything.
        if size > 1e-299 and off < _AFFINE * size:
            found.append(place)
    return found


def _some_rows(sightings: Sightings) -> Sightings:
    """Give rows spread evenly over the data: enough to see a formula's form."""
    step = max(len(sightings) // _ROWS, 1)
    return sightings.select(np.arange(len(sightings)) % step == 0, "not looked at")
