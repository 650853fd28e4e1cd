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
from geoerr.terms import Parameter, Term

# Trial values over the whole range of one inner parameter, and of each of several; and near the value that was found,
# in standard errors.
_COARSE = {1: 11, 2: 7}
_NEAR = (-2.5, -1.0, 1.0, 2.5)
_MOST_TRIALS = 30
# A formula is affine in a parameter where the middle is the mean of the ends to this share.
_AFFINE = 1e-9
_ROWS = 200


@dataclass(frozen=True, eq=False)
class Family:
    """The trials of one candidate.

    Attributes
    ----------
    name
        As references are written.
    terms
        Copies of the term, inner parameters fixed; `n_corners` of them, one after the other, are one trial.
    n_corners
        Ends of affine parameters.
    is_spread : (n_trials,)
        Whether a trial belongs to the even spread over the range, or is the value that was found (the first).
    """

    name: str
    terms: tuple[Term, ...]
    n_corners: int
    is_spread: np.ndarray

    @property
    def n_trials(self) -> int:
        """Number of trials."""
        return len(self.is_spread)

    @property
    def width(self) -> int:
        """Columns of a trial."""
        return self.n_corners * len(self.terms[0].coefficients)


def family_of(machine: Machine, term: Term, number: int, sightings: Sightings, poses: Poses) -> Family:
    """Spread trial values around the values that a term has, and over the ranges of its inner parameters."""
    inner = [_valued(parameter) for parameter in term.inner]
    values = [parameter.value for parameter in inner]
    affine = [place for place, one in enumerate(inner) if not one.is_fixed] if inner else []
    if affine:
        affine = _affine(machine, term, inner, affine, sightings, poses)
    free = [place for place, one in enumerate(inner) if place not in affine and not one.is_fixed]
    trials, is_spread = [list(values)], [True]
    for place in free:
        coarse, near = _values(inner[place], len(free))
        for value in (*coarse, *near):
            trials.append([*values[:place], value, *values[place + 1 :]])
            is_spread.append(value in coarse)
    trials, is_spread = trials[:_MOST_TRIALS], is_spread[:_MOST_TRIALS]
    corners = list(itertools.product(*[_ends(inner[place]) for place in affine]))
    copies: list[Term] = []
    for trial in trials:
        for corner in corners:
            at = list(trial)
            for place, value in zip(affine, corner, strict=True):
                at[place] = value
            copies.append(_fixed(term, at, f"c{number}-{len(copies)}"))
    return Family(term.id, tuple(copies), len(corners), np.array(is_spread))


def _ends(parameter: Parameter) -> tuple[float, float]:
    assert parameter.low is not None
    assert parameter.high is not None
    return parameter.low, parameter.high


def _valued(parameter: Parameter) -> Parameter:
    """Give a parameter that has a value: the middle of its range, in its own spacing, where it has none."""
    if not np.isnan(parameter.value):
        return parameter
    low, high = _ends(parameter)
    middle = np.sqrt(low) * np.sqrt(high) if parameter.spacing == "log" else 0.5 * (low + high)
    return replace(parameter, value=float(middle))


def _values(parameter: Parameter, n_free: int) -> tuple[list[float], list[float]]:
    (low, high), at, std = _ends(parameter), parameter.value, parameter.std
    spread = np.geomspace if parameter.spacing == "log" else np.linspace
    coarse = [float(value) for value in spread(low, high, _COARSE.get(n_free, _COARSE[2]))]
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
        low, high = _ends(inner[place])
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
