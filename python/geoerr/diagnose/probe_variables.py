"""What structure without a name may follow (positions, directions, motion, conditions, time), and functions of each.

| kind | functions |
|---|---|
| position, time | Legendre polynomials over the range |
| few values | all functions of its levels |
| condition | Legendre polynomials of its ranks, which bunch less than its values; of these too where the two differ |
| temperature | besides, what a joint that slips makes of it: the distance to a play that it drags along |
| acceleration | besides, its sign: what is loose lies against one stop or the other |

Source of the play: Brokate & Sprekels, Hysteresis and Phase Transitions (1996), after Prandtl and Ishlinskii.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geoerr.diagnose.gaps import read_columns
from geoerr.distributions import ranks_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.noise import NOT_CONDITIONS
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import times_s, variable_columns
from geoerr.machine import AXES
from geoerr.terms import RAW_VARIABLES, is_motion

Kind = Literal["position", "direction", "condition", "time"]
MOST_DEGREES = 8
# A variable of at most so many values is a list of cases, not a curve.
_FEW_VALUES = 4
# Two variables whose ranks agree so far are one.
_SAME = 0.98
# Values whose ranks are a straight line of them, so far, need no functions of their own beside another variable, and
# none at all. What is cycled is at 0.993: parabolas of its ranks are none of its values.
_EVEN, _QUITE_EVEN = 0.95, 0.999
# Widths of plays, as shares of a temperature's range: neighbours' memories correlate by 0.8 on cycles of the range.
PLAYS = (0.05, 0.15, 0.4)


@dataclass(frozen=True, eq=False)
class Variable:
    """A variable with its functions.

    Attributes
    ----------
    name
        As a report has it.
    values : (n,)
        NaN where it has none.
    by_rank : (k, n)
        Functions of rising degree without a constant, orthogonal over an even spread of ranks (positions and times:
        of values); 0 where there is no value.
    other_ways : tuple of (k, n)
        The same of values, where these are another matter; the sign of an acceleration.
    alone : (k, n) or None
        The same of values, where these are nearly their ranks: told apart where nothing else varies.
    memory : (m, n)
        Of a temperature, its distance to plays of rising width.
    from_lowest : (n,) or None
        A condition from its lowest value (temperatures begin cold, loads at none), a direction as it is; None of
        motion along an axis, which is no condition.
    n_levels
        Number of different values.
    """

    name: str
    kind: Kind
    values: Numbers
    by_rank: Numbers
    other_ways: tuple[Numbers, ...]
    alone: Numbers | None
    memory: Numbers
    from_lowest: Numbers | None
    n_levels: int


def variables_of(fitted: Fitted) -> list[Variable]:
    """Give every variable that varies; of those that agree the first."""
    sightings = fitted.sightings
    found: list[Variable] = []
    ranks: list[Numbers] = []
    for name, kind, values in _named(sightings):
        known = np.isfinite(values)
        if known.sum() < 2 or np.ptp(values[known]) <= 1e-9 * max(float(np.abs(values[known]).max()), 1e-300):
            continue
        rank = ranks_of(np.where(known, values, np.median(values[known])))
        rank = (rank - rank.mean()) / rank.std()
        if any(abs(float(rank @ other)) > _SAME * len(rank) for other in ranks):
            continue
        ranks.append(rank)
        found.append(_variable(sightings, name, kind, values, known))
    return found


def _named(sightings: Sightings) -> list[tuple[str, Kind, Numbers]]:
    columns = set(sightings.covariate_columns)
    names = [*AXES, *(f"d_{axis}" for axis in AXES), *(f"s_{axis}" for axis in AXES)]
    if "moving" in columns and columns & {"feed", "t"}:
        names += [f"{name}_{axis}" for name in ("v", "a") for axis in AXES]
    values = dict(zip(names, variable_columns(sightings, names), strict=True))
    conditions = [name for name in sightings.covariate_columns if name not in NOT_CONDITIONS]
    values |= dict(zip(conditions, read_columns(sightings, conditions), strict=True))
    values["t"] = times_s(sightings)
    return [(name, _kind(name), own) for name, own in values.items()]


def _kind(name: str) -> Kind:
    if name in AXES:
        return "position"
    if name == "t":
        return "time"
    return "direction" if is_motion(name, "d") else "condition"


def _variable(sightings: Sightings, name: str, kind: Kind, values: Numbers, known: np.ndarray) -> Variable:
    own = values[known]
    levels, place = np.unique(own, return_inverse=True)
    n_levels = len(levels)
    other_ways: list[Numbers] = []
    alone = None
    if n_levels <= _FEW_VALUES:
        by_rank = _polynomials(place.ravel().astype(np.float64), known, n_levels - 1)
    elif kind != "condition":
        by_rank = _polynomials(own, known, MOST_DEGREES)
    else:
        rank = ranks_of(own)
        by_rank = _polynomials(rank, known, min(MOST_DEGREES, n_levels - 1))
        alike = float(np.corrcoef(rank, own)[0, 1])
        if alike < _EVEN:
            other_ways.append(_polynomials(own, known, 3))
        elif alike < _QUITE_EVEN:
            alone = _polynomials(own, known, 3)
        if is_motion(name, "a"):
            other_ways.append(np.sign(np.where(known, values, 0.0))[None])
    is_remembered = name.startswith("temp") and known.all() and n_levels > _FEW_VALUES
    widths = PLAYS if is_remembered else ()
    memory = np.array([_off_play(sightings, values, share) for share in widths]).reshape(-1, len(values))
    from_lowest = None
    if kind == "direction":
        from_lowest = np.where(known, values, 0.0)
    elif kind == "condition" and name not in RAW_VARIABLES and name != "moving":
        from_lowest = np.where(known, (values - own.min()) / np.ptp(own), 0.0)
    return Variable(name, kind, values, by_rank, tuple(other_ways), alone, memory, from_lowest, n_levels)


def _polynomials(values: Numbers, known: np.ndarray, most: int) -> Numbers:
    u = 2.0 * (values - values.min()) / np.ptp(values) - 1.0
    result = np.zeros((most, len(known)))
    result[:, known] = np.polynomial.legendre.legvander(u, most).T[1:]
    return result


def _off_play(sightings: Sightings, values: Numbers, share: float) -> Numbers:
    """Give how far a temperature (n,) is from the play that it drags along, in units of the play, from −1 to 1.

    The play stands in the middle when a session begins.
    """
    width = share * float(np.ptp(values))
    play: list[float] = []
    for rows in sightings.rows_of_sessions:
        own = values[rows]
        held = float(own[0])
        for low, high in zip((own - width).tolist(), (own + width).tolist(), strict=True):
            if held < low:
                held = low
            elif held > high:
                held = high
            play.append(held)
    return np.asarray((values - np.array(play)) / width)
