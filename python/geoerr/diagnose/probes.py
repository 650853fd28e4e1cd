"""Probes: smooth functions of one variable or two on each axis, for structure that no effect of the catalogue has.

A probe names variables, not causes. It is judged like a candidate, against the same noise and the same kind of null.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import stats

from geoerr.diagnose.candidates import Shapes
from geoerr.diagnose.functions import Functions
from geoerr.fit.fitted import Fitted
from geoerr.fit.noise import _NOT_CONDITIONS
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s, variable_columns
from geoerr.machine import AXES
from geoerr.observations import CARRIERS

# Degrees of the functions of one variable, and of two (each alone and their products): the low ones cost less.
_ONE = (3, 8)
_TWO = (1, 2)
# Of two positions: what no rigid body does is often a pattern over a plane.
_TWO_POSITIONS = (1, 2, 4)
# A variable of at most so many values is a list of cases, not a curve.
_FEW_VALUES = 4
# Two variables whose ranks agree so far are one.
_SAME = 0.98


@dataclass(frozen=True, eq=False)
class Probe:
    """A smooth dependence of one component of the error on one variable or two.

    Attributes
    ----------
    component
        Axis of the base along which it acts.
    depends_on
        Names of its variables, sorted.
    shapes
        Of rising freedom.
    """

    component: str
    depends_on: tuple[str, ...]
    shapes: tuple[Shapes, ...]

    @property
    def n_trials(self) -> int:
        """Number of ways to write it."""
        return len(self.shapes)


def probes_of(fitted: Fitted, functions: Functions) -> list[Probe]:
    """Give all probes that the data can carry; their functions are added to `functions`."""
    codes = {
        name: [functions.given(one) for one in _functions(values)] for name, values in _variables(fitted).items()
    }
    groups: list[tuple[tuple[str, ...], list[list[int]]]] = [
        ((name,), _different([own[:degree] for degree in _ONE])) for name, own in codes.items()
    ]
    for first, second in itertools.combinations(codes, 2):
        degrees = _TWO_POSITIONS if {first, second} <= set(AXES) else _TWO
        one, two = codes[first][: max(degrees)], codes[second][: max(degrees)]
        product = [[functions.product(a, b) for b in two] for a in one]
        columns = [
            [*one[:degree], *two[:degree], *(code for row in product[:degree] for code in row[:degree])]
            for degree in degrees
        ]
        groups.append(((first, second), _different(columns)))
    return [
        Probe(axis, tuple(sorted(names)), tuple(_shapes(f"{body}-{axis}", own) for own in columns))
        for body in _bodies(fitted)
        for axis in AXES
        for names, columns in groups
    ]


def _bodies(fitted: Fitted) -> list[str]:
    """Give the bodies whose displacement was seen: what one does, targets on the other do not show."""
    seen = {CARRIERS[number] for number in np.unique(fitted.sightings.carrier[fitted.solved.used])}
    return [body for body in ("tool", "work") if body in seen] or ["tool"]


def _different(columns: list[list[int]]) -> list[list[int]]:
    return [own for number, own in enumerate(columns) if number == 0 or len(own) > len(columns[number - 1])]


def _shapes(channel: str, codes: list[int]) -> Shapes:
    n = len(codes)
    columns = tuple((0, k) for k in range(n))
    return Shapes(None, ((channel, 1.0),), columns, n, ({},), ((),), np.array([codes], dtype=np.int64))


def _variables(fitted: Fitted) -> dict[str, Numbers]:
    """Give every variable that varies, NaN where it has no value; of those that agree the first."""
    sightings = fitted.sightings
    names = [*AXES, *(f"d_{axis}" for axis in AXES), *(f"s_{axis}" for axis in AXES)]
    columns = set(sightings.covariate_columns)
    if "moving" in columns and columns & {"feed", "t"}:
        names += [f"v_{axis}" for axis in AXES]
    found = dict(zip(names, variable_columns(sightings, names), strict=True))
    found |= {name: sightings.numbers(name) for name in sightings.covariate_columns if name not in _NOT_CONDITIONS}
    found["t"] = times_s(sightings)
    kept: dict[str, Numbers] = {}
    ranks: list[Numbers] = []
    for name, values in found.items():
        known = np.isfinite(values)
        if known.sum() < 2 or np.ptp(values[known]) <= 1e-9 * max(float(np.abs(values[known]).max()), 1e-300):
            continue
        filled = np.where(known, values, np.median(values[known]))
        rank = stats.rankdata(filled)
        rank = (rank - rank.mean()) / rank.std()
        if any(abs(float(rank @ other)) > _SAME * len(rank) for other in ranks):
            continue
        ranks.append(rank)
        # Travel, speed and covariates bunch: their ranks are spread evenly.
        kept[name] = np.full(len(values), np.nan)
        kept[name][known] = values[known] if name in AXES or name == "t" else stats.rankdata(values[known])
    return kept


def _functions(values: Numbers) -> Numbers:
    """Give functions without a constant, orthogonal over an even spread, (k, n); 0 where there is no value."""
    known = np.isfinite(values)
    levels, place = np.unique(values[known], return_inverse=True)
    most = len(levels) - 1 if len(levels) <= _FEW_VALUES else min(max(_ONE), len(levels) - 1)
    own = place.ravel().astype(np.float64) if len(levels) <= _FEW_VALUES else values[known]
    u = 2.0 * (own - own.min()) / np.ptp(own) - 1.0
    result = np.zeros((most, len(values)))
    result[:, known] = np.polynomial.legendre.legvander(u, most).T[1:]
    return result
