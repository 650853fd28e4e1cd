"""What the data do not determine, in words: which error, from what it cannot be told, and what to measure.

An error is *tied to* another where no direction of the null space moves the first and leaves the second: then only a
measurement that holds the other can tell it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count

import numpy as np

from geoerr.bases import basis_of
from geoerr.error_functions import LI_SQUARENESS, NotDetermined, is_angular
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.machine import AXES, Machine
from geoerr.observations import CARRIERS
from geoerr.summaries import listed as listed_words
from geoerr.terms import SQUARENESS_CHANNELS, Parameter, Term

# Entries of a null vector (largest 1) below this are round-off.
_NOTHING = 1e-9
_MOST_NAMED = 6
_FRAME = "the pose of the measuring frame"
_ISO_OF_LI = {li: iso for iso, (li, _) in LI_SQUARENESS.items()}
# Places of targets nearer to one line than this share of their extent have no lever about it.
_ON_A_LINE = 1e-3


def iso_name(term_id: str) -> str:
    """Give the name of a term as errors.json has it: S_xy is EC0Y."""
    return _ISO_OF_LI.get(term_id, term_id)


@dataclass(frozen=True, eq=False)
class Undetermined:
    """What some unknowns of a fit are not determined by, found when it is asked for: a fit that is tried needs none.

    Attributes
    ----------
    terms
        All terms, in the order of their unknowns: the coefficients of all, then the free inner parameters of all.
    is_determined : (n,)
        For every unknown.
    null_space : (n, k)
        Directions in which unknowns can change without any measurement noticing, each with largest entry 1.
    sightings
        The data.
    first_frame_column
        Where the unknowns of frames and of targets' places begin.
    never_moved
        Axes whose position is one and the same in all rows.
    wanted
        Names that a model of these components would have.
    machine
        Tells which body an axis carries, and so which targets are wanting.
    """

    terms: Sequence[Term]
    is_determined: np.ndarray
    null_space: Numbers
    sightings: Sightings
    first_frame_column: int
    never_moved: Sequence[str]
    wanted: Sequence[str]
    machine: Machine | None = None

    @property
    def names(self) -> list[str]:
        """Names of the terms of which some unknown is not determined, and of those that no row could tell."""
        return [*self._never_there, *(iso_name(term.id) for term, _ in self._open)]

    @cached_property
    def reasons(self) -> tuple[NotDetermined, ...]:
        """The same with the reason and the remedy."""
        listed = [NotDetermined(name, f"the {name[2].lower()} axis never moved") for name in self._never_there]
        blocks = _blocks(self.terms, self.is_determined, self.null_space, self.first_frame_column)
        words = _Words(self.sightings, self.machine, self.never_moved)
        without = {name: _directions_without(rows) for name, rows in blocks.items()}
        for term, own in self._open:
            name = iso_name(term.id)
            is_line = is_a_line(term, blocks[name])
            open_part = "only its part in proportion to the position is open: " if is_line else ""
            combined = _combined(term, self.is_determined[own], self.null_space[own])
            listed.append(NotDetermined(name, open_part + words.why(term, _tied_to(name, blocks, without), combined)))
        return tuple(listed)

    @property
    def _never_there(self) -> list[str]:
        there = {term.id for term in self.terms}
        return [iso_name(one) for one in self.wanted if one not in there and one[2].lower() in self.never_moved]

    @property
    def _open(self) -> list[tuple[Term, np.ndarray]]:
        """The terms with an open unknown, and where theirs are."""
        own = zip(self.terms, _columns_of(self.terms), strict=True)
        return [(term, columns) for term, columns in own if not self.is_determined[columns].all()]


def _columns_of(terms: Sequence[Term]) -> list[np.ndarray]:
    """Give the columns of each term's unknowns: of its coefficients, then of its free inner parameters."""
    coefficients, inner = count(), count(sum(len(term.coefficients) for term in terms))
    return [
        np.array(
            [*(next(coefficients) for _ in term.coefficients), *(next(inner) for _ in _free(term))], dtype=np.intp
        )
        for term in terms
    ]


def _free(term: Term) -> list[Parameter]:
    return [parameter for parameter in term.inner if not parameter.is_fixed]


def _blocks(
    terms: Sequence[Term], is_determined: np.ndarray, null_space: Numbers, first_frame_column: int
) -> dict[str, Numbers]:
    """Give the rows of the null space by term; those of frames and places together."""
    rows = {
        iso_name(term.id): null_space[own]
        for term, own in zip(terms, _columns_of(terms), strict=True)
        if not is_determined[own].all() or np.abs(null_space[own]).max(initial=0.0) > _NOTHING
    }
    frames = null_space[first_frame_column:]
    return rows | ({_FRAME: frames} if np.abs(frames).max(initial=0.0) > _NOTHING else {})


def _directions_without(rows: Numbers) -> Numbers:
    """Give the combinations (k, m) of null vectors that leave these rows at rest."""
    if rows.shape[0] > rows.shape[1]:
        # The triangle has the same null space, and no left vectors for hundreds of rows.
        rows = np.linalg.qr(rows).R
    _, size, directions = np.linalg.svd(rows, full_matrices=True)
    return np.asarray(directions[int((size > _NOTHING).sum()) :].T)


def _tied_to(name: str, blocks: dict[str, Numbers], without: dict[str, Numbers]) -> list[str]:
    """Name what always moves with a term; where nothing does always, whatever can; nothing where it moves alone.

    `without` are the combinations (k, m) of null vectors that leave each block at rest.
    """
    own = blocks[name]
    others = {other: rows for other, rows in blocks.items() if other != name}

    def moves(combinations: Numbers) -> bool:
        return bool(np.abs(own @ combinations).max(initial=0.0) > _NOTHING)

    if not others or moves(_directions_without(np.vstack(list(others.values())))):
        return []
    tied = [other for other in others if not moves(without[other])]
    if tied:
        return tied
    # Whatever it can move with when all else is held.
    held = {other: [rows for third, rows in others.items() if third != other] for other in others}
    return [other for other, rest in held.items() if moves(_directions_without(np.vstack([own[:0], *rest])))] or list(
        others
    )


def _combined(term: Term, is_determined: np.ndarray, null_space: Numbers) -> list[str]:
    """Name the open numbers of an effect of which combinations are determined; none where no combination is."""
    if term.kind == "classic":
        return []
    is_open = ~is_determined
    names = [one.name for one in (*term.coefficients, *_free(term))]
    n_free = int((np.linalg.svd(null_space[is_open], compute_uv=False) > _NOTHING).sum())
    return [name for name, own in zip(names, is_open, strict=True) if own] if n_free < is_open.sum() else []


def is_a_line(term: Term, rows: Numbers) -> bool:
    """Tell whether a function is known but for a multiple of its position, by its rows (n, k) of the null space."""
    spec = term.parts[0].basis
    if term.kind != "classic" or spec is None or spec.n_functions < 3:
        return False
    basis = basis_of(spec)
    position = np.linspace(*basis.range, 4 * spec.n_functions)
    curves = basis.evaluate(position) @ rows
    design = np.column_stack([np.ones_like(position), position - position[0]])
    bent = curves - design @ np.linalg.lstsq(design, curves, rcond=None)[0]
    return bool(np.abs(bent).max(initial=0.0) <= _NOTHING)


@dataclass(frozen=True, eq=False)
class _Words:
    """Finds in the data what is wanting."""

    sightings: Sightings
    machine: Machine | None
    never_moved: Sequence[str]

    def why(self, term: Term, others: Sequence[str], combined: Sequence[str]) -> str:
        if term.kind == "classic" and term.id in SQUARENESS_CHANNELS:
            remedy = self._of_squareness(term.id)
        elif term.kind == "classic" and is_angular(term.id):
            remedy = self._of_angles(term.id[2].lower())
        else:
            turning = [name for name in others if name[0] == "E" and name[1] in "ABC" and len(name) == 3]
            remedy = self._of_angles(turning[0][2].lower()) if term.kind == "classic" and turning else None
        if not others and combined:
            return f"only a combination of {listed_words(combined)} is determined"
        if not others:
            return "no measured point responds to it" + ("" if remedy is None else f": {remedy}")
        named = ", ".join(others[:_MOST_NAMED])
        more = f" and {len(others) - _MOST_NAMED} more" if len(others) > _MOST_NAMED else ""
        text = f"these measurements cannot tell it from {named}{more}"
        return text if remedy is None else f"{text}: {remedy}"

    def _of_squareness(self, channel: str) -> str | None:
        pair = channel[-2:]
        still = [axis for axis in pair if axis in self.never_moved]
        if still:
            return f"the {' and the '.join(still)} axis never moved"
        moving = [{axis for axis in pair if self._moves(rows, axis)} for rows in self._sessions()]
        if any(len(axes) == 2 for axes in moving):
            return None
        return (
            f"the measuring frame moved between {pair[0]} and {pair[1]}; {channel} needs one frame (session) for both"
        )

    def _of_angles(self, axis: str) -> str | None:
        """Say which targets are wanting on the body that an axis carries."""
        if self.machine is None:
            return None
        body = self.machine.side(axis)
        shown = np.isin(self.sightings.carrier, [CARRIERS.index(body), CARRIERS.index("relative")])
        is_relative = bool((self.sightings.carrier[shown] == CARRIERS.index("relative")).all())
        what, where = ("tool point", "") if is_relative else ("target", f" on the {body}")
        rows_of = [rows & shown for rows in self._sessions() if self._moves(rows & shown, axis)]
        if not rows_of:
            return f"no target on the {body} was seen while {axis} moved; put three there that are not on one line"
        extent = _dimensions(self.sightings.offset_mm[np.logical_or.reduce(rows_of)])
        if extent == 0:
            return f"there is one {what}{where}; add two more, not on one line with it"
        if extent == 1:
            return f"the {what}s{where} lie on one line; add one beside it"
        if max(_dimensions(self.sightings.offset_mm[rows]) for rows in rows_of) < 2:
            return f"the {what}s{where} were seen from different frames; see three, not on one line, from one frame"
        return None

    def _sessions(self) -> list[np.ndarray]:
        return [self.sightings.session == number for number in range(len(self.sightings.sessions))]

    def _moves(self, rows: np.ndarray, axis: str) -> bool:
        return bool(self.sightings.axes_moved(rows)[AXES.index(axis)])


def _dimensions(places_mm: Numbers) -> int:
    """Count the dimensions (0 to 3) that places (n, 3) extend in."""
    size = np.linalg.svd(places_mm - places_mm.mean(axis=0), compute_uv=False)
    return int((size > max(_ON_A_LINE * float(size[0]), SAME_POSITION_MM)).sum())
