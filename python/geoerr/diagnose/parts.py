"""Error figures of parts of the data: a line, a direction of approach, a session, a body."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.components import Component, components_of
from geoerr.fit import Fitted
from geoerr.fit.figures import ErrorFigures, figures_of
from geoerr.fit.moved_targets import numbers_of_targets, times_moved
from geoerr.fit.sightings import Sightings
from geoerr.machine import AXES
from geoerr.observations import CARRIERS

# Where every row has another offset there are no targets to speak of.
_MOST_TARGETS = 64


@dataclass(frozen=True)
class Part:
    """Some of the rows.

    Attributes
    ----------
    name
        Of the line, session, ...
    figures
        Over the rows that take part.
    mean_um
        Component to its mean: what all rows of the part have in common.
    """

    name: str
    figures: ErrorFigures
    mean_um: dict[str, float]

    @property
    def rmse_um(self) -> float | None:
        """The figure of the positions, or of the radii where there are no positions."""
        return self.figures.headline_um


def by_text(fitted: Fitted, column: str) -> tuple[Part, ...]:
    """Part the rows by a column of texts, in the order in which its values occur; an absent column is one part ''."""
    sightings = fitted.sightings
    names = np.asarray(sightings.texts(column) if column in sightings.table.columns else [""] * len(sightings))
    return _parts(fitted, ((name, names == name) for name in dict.fromkeys(names.tolist())))


def by_session(fitted: Fitted) -> tuple[Part, ...]:
    """Part the rows by session (and circular run): each has its own pose of the measuring frame."""
    sightings = fitted.sightings
    return _parts(fitted, ((name, sightings.session == number) for number, name in enumerate(sightings.sessions)))


def by_carrier(fitted: Fitted) -> tuple[Part, ...]:
    """Part the rows by what carries the target."""
    return _parts(fitted, ((name, fitted.sightings.carrier == number) for number, name in enumerate(CARRIERS)))


def by_target(fitted: Fitted) -> tuple[Part, ...]:
    """Part the rows by target; one that moved has a part for each of its places. None where there are very many."""
    sightings = fitted.sightings
    numbers, moved = sightings.once("targets", numbers_of_targets), times_moved(sightings)
    if numbers.max(initial=0) >= _MOST_TARGETS:
        return ()
    pairs = dict.fromkeys(zip(numbers.tolist(), moved.tolist(), strict=True))
    named = []
    for number, times in pairs:
        rows = (numbers == number) & (moved == times)
        named.append((_name_of_target(sightings, int(np.argmax(rows)), times), rows))
    return _parts(fitted, named)


def _name_of_target(sightings: Sightings, row: int, times_moved: int) -> str:
    name = sightings.texts("target")[row] if "target" in sightings.table.columns else ""
    x, y, z = sightings.offset_mm[row]
    carrier = CARRIERS[sightings.carrier[row]]
    where = carrier if carrier == "base" else f"{carrier} ({x:g}, {y:g}, {z:g})"
    return ", ".join([one for one in (name, *["moved"] * times_moved, where) if one])


def by_direction(fitted: Fitted) -> tuple[Part, ...]:
    """Part the rows by the direction in which each axis last moved: `x+`, `x-`, `x unknown`; axes that moved only."""
    sightings = fitted.sightings
    named = []
    for index, axis in enumerate(AXES):
        sense = sightings.directions[:, index]
        if sense.any():
            named += [(f"{axis}+", sense > 0), (f"{axis}-", sense < 0), (f"{axis} unknown", sense == 0)]
    return _parts(fitted, named)


def _parts(fitted: Fitted, named: Iterable[tuple[str, np.ndarray]]) -> tuple[Part, ...]:
    components = components_of(fitted)
    used = fitted.solved.used
    return tuple(
        Part(name, figures_of(fitted.sightings, fitted.residual_mm, rows & used), means_of(components, rows))
        for name, rows in named
        if (rows & used).any()
    )


def means_of(components: Iterable[Component], rows: np.ndarray) -> dict[str, float]:
    """Give the mean of each component over some rows (n,), where it has any."""
    return {
        component.name: float(component.residual_um[rows & component.is_known].mean())
        for component in components
        if (rows & component.is_known).any()
    }
