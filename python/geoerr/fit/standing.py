"""Rows that were taken before an axis had moved: from which side it came there nobody knows, but it stands still.

Nine lines one after the other begin so: along the first one the second axis has not moved yet. What depends on its
direction of approach is one unknown amount in all rows until it moves. Were these rows left out, a play of the second
axis would take all errors of the first away; they stay, and the amount is one more unknown of the session for each
number of the effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import Rows, variable_columns
from geoerr.machine import AXES
from geoerr.terms import Term

# What nobody knows of an axis that has not moved, and is settled: it stands there for long.
_SETTLED = {"s": 1e9, "t_rev": 1e9}


@dataclass(frozen=True, eq=False)
class Standing:
    """Rows of one session until one axis moves for the first time, and the terms that ask how it came there.

    Attributes
    ----------
    axis
        The axis, `x`, `y` or `z`.
    rows : (n,)
        The rows.
    terms
        The terms.
    is_all
        Whether the axis stands still for the whole session: how the device stands then holds what they do.
    """

    axis: str
    rows: Rows
    terms: tuple[Term, ...]
    is_all: bool

    def came(self, direction: float, names: Sequence[str], variables: Numbers) -> Numbers:
        """Give variables (k, n) as if the axis had come there in a direction, long ago."""
        result = variables.copy()
        for name, value in {"d": direction, **_SETTLED}.items():
            if (full := f"{name}_{self.axis}") in names:
                result[names.index(full), self.rows] = value
        return result


def standing(
    sightings: Sightings, names: Sequence[str], variables: Numbers, terms: Sequence[Term]
) -> Iterator[Standing]:
    """Find them, session by session, for axes that something asks about.

    Parameters
    ----------
    names, variables
        Of all terms, and (k, n) as `variable_columns` gives them.
    """
    starts = sightings.sequences.tolist()
    # Lengths come in no order: of the first of them nobody knows that the machine stood there.
    of_lengths = sightings.of_kind("lengths")
    for number, axis in enumerate(AXES):
        own = {f"{name}_{axis}" for name in ("d", *_SETTLED)}
        asking = tuple(term for term in terms if own & set(term.variables))
        if f"d_{axis}" not in names:
            continue
        direction, place = variables[names.index(f"d_{axis}")], sightings.commanded_mm[:, number]
        for start, end in zip(starts, [*starts[1:], len(sightings)], strict=True):
            unknown = np.isnan(direction[start:end]) & ~of_lengths[start:end]
            stands = unknown & (place[start:end] == place[start])
            n_rows = int(np.logical_and.accumulate(stands).sum())
            if n_rows:
                rows = np.zeros(len(sightings), dtype=bool)
                rows[start : start + n_rows] = True
                yield Standing(axis, rows, asking, n_rows == end - start)


def known_variables(sightings: Sightings, names: Sequence[str], terms: Sequence[Term]) -> Numbers:
    """Give the named variables as (k, n), the direction of an axis as 0 where it stands and has not moved yet.

    Raises
    ------
    GeoerrError
        for a covariate that is no column of the data.
    """
    variables = variable_columns(sightings, names)
    return midway(list(standing(sightings, names, variables, terms)), names, variables)


def midway(still: Sequence[Standing], names: Sequence[str], variables: Numbers) -> Numbers:
    """Give variables (k, n) with a direction of 0 where an axis stands and has not moved yet."""
    for one in still:
        variables = one.came(0.0, names, variables)
    return variables
