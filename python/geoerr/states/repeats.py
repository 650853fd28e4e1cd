"""Sessions of one temperature held against each other, as two states are: a machine that did not come back.

Cold before the heat and cold after it are one state only if nothing has moved for good in between. Their mean is
neither, and is as certain as if it were both.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from geoerr.errors import GeometryError
from geoerr.fit import FitOptions
from geoerr.machine import Machine
from geoerr.observations import Observations
from geoerr.states.chance import holm
from geoerr.states.common import CommonBases, functions_of
from geoerr.states.difference import Difference
from geoerr.states.state_fit import StateFit, fit_state
from geoerr.states.weights import Weights
from geoerr.summaries import listed, p_words

# Less probable than this, sessions of one temperature are not of one machine.
_SIGNIFICANCE = 0.01
# Temperatures of sessions are named where they differ by more.
_SAME_DEGC = 0.1


@dataclass(frozen=True, eq=False)
class Repeat:
    """Two sessions of one temperature.

    Attributes
    ----------
    temperature_degc
        Of the state.
    difference
        The later session minus the first one.
    mean_degc
        What the column of temperature says of both, on average.
    p_value
        That two sessions of one machine differ as much, corrected for the number of sessions compared (Holm).
    """

    temperature_degc: float
    difference: Difference
    mean_degc: tuple[float, float]
    p_value: float

    @property
    def contradicts(self) -> bool:
        """Whether the sessions differ by more than chance."""
        return self.p_value < _SIGNIFICANCE

    def to_document(self) -> dict[str, Any]:
        """Give plain values, for `--json`."""
        return {
            "temperature_degc": self.temperature_degc,
            "first": self.difference.first,
            "second": self.difference.second,
            "mean_degc": list(self.mean_degc),
            "p_value": self.p_value,
            "beyond_chance": self._beyond,
        }

    @property
    def _beyond(self) -> list[str]:
        return [name for name, one in self.difference.by_name.items() if one.p_value < _SIGNIFICANCE]

    @property
    def sentence(self) -> str:
        """Say whether they agree."""
        first, second = self.difference.first, self.difference.second
        p_value = p_words(self.p_value)
        if not self.contradicts:
            return (
                f"{first} and {second}, both {self.temperature_degc:g} °C, agree: chance does as much with {p_value}"
            )
        where = f", most of all in {listed(self._beyond)}" if self._beyond else ""
        means = self.mean_degc
        warmth = (
            f"; they were at {means[0]:.1f} and {means[1]:.1f} °C" if abs(means[1] - means[0]) > _SAME_DEGC else ""
        )
        return (
            f"{first} and {second}, both {self.temperature_degc:g} °C, contradict each other{where}: chance does as "
            f"much with {p_value}{warmth}; the state is their mean, and its uncertainty does not count this: leave "
            "one of them out, or find what has moved"
        )


def repeats_of(
    machine: Machine,
    tables: Mapping[float, Observations],
    files: Mapping[float, Sequence[Sequence[str]]],
    common: CommonBases,
    covariate: str,
    options: FitOptions,
    weights: Weights,
) -> tuple[Repeat, ...]:
    """Hold every later session of each temperature against the first one.

    Sessions that determine no error both, or cannot be fitted alone, are parts of one measurement.

    Parameters
    ----------
    tables
        Temperature to its rows, sessions named by `session_name`.
    files
        Temperature to the files of each table that was given for it.
    """
    found: list[tuple[float, Difference, tuple[float, float]]] = []
    for (temperature, table), state in zip(tables.items(), common.by_state, strict=True):
        sessions = _sessions(table, files[temperature])
        fits = {} if len(sessions) < 2 else _fits(machine, sessions, options, weights)
        for later in list(fits)[1:]:
            first = next(iter(fits))
            functions = functions_of(machine, {name: fits[name].fitted for name in (first, later)}, state)
            if functions.names:
                estimates = fits[first].estimate, fits[later].estimate
                difference = Difference(first, later, functions, *estimates, options.threads)
                means = _mean_degc(sessions[first], covariate), _mean_degc(sessions[later], covariate)
                found.append((temperature, difference, means))
    corrected = holm([difference.p_value for _, difference, _ in found])
    return tuple(Repeat(*one, p_value) for one, p_value in zip(found, corrected, strict=True))


def session_name(temperature_degc: float, number: int) -> pl.Expr:
    """Name a session of a joined table: by state, number of the table that was given for it, and its own name."""
    return pl.format("{}/{}/{}", pl.lit(f"{temperature_degc:g}"), pl.lit(number), pl.col("session"))


def _sessions(table: Observations, files: Sequence[Sequence[str]]) -> dict[str, Observations]:
    """Give each session's rows by its name in words, in the order in which they were given."""
    names = np.array(table.texts("session"))
    keys = {name: name.split("/", 2)[1:] for name in dict.fromkeys(names.tolist())}
    n_of_table = Counter(number for number, _ in keys.values())
    found: dict[str, Observations] = {}
    for name, (number, session) in keys.items():
        words = ", ".join(files[int(number)])
        if n_of_table[number] > 1:
            words += f", session {session}"
        if words in found:
            words += f" (table {int(number) + 1})"
        found[words] = table.select(names == name)
    return found


def _fits(
    machine: Machine, sessions: Mapping[str, Observations], options: FitOptions, weights: Weights
) -> dict[str, StateFit]:
    fits = {}
    for name, own in sessions.items():
        try:
            fit = fit_state(machine, own, options, weights)
        except GeometryError:
            continue
        if fit.fitted.dof > 0 and math.isfinite(fit.fitted.scale):
            fits[name] = fit
    return fits


def _mean_degc(table: Observations, covariate: str) -> float:
    return float(np.nanmean(table.numbers(covariate)[:, 0]))
