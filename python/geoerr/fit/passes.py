"""Passes: what was run in one go, along one line in one direction, so that it shares what slowly changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geoerr.fit.sightings import SAME_POSITION_MM, Integers, Numbers

# Makes one number of the directions −1, 0 and 1 of three axes.
_SENSES = np.array([1, 3, 9], dtype=np.int64)


def passes_of(
    session: Integers, lines: Sequence[str], repeat: Numbers, commanded_mm: Numbers, directions: npt.NDArray[np.int8]
) -> Integers:
    """Give every row its pass: rows of one session, line, repeat and direction of the axes that move in it."""
    if not len(session):
        return np.zeros(0, dtype=np.int64)
    group = named_runs(session, lines, repeat)
    # Groups one after another, the rows of each in their order.
    order = np.argsort(group, kind="stable")
    own = group[order]
    starts = np.flatnonzero(np.diff(own, prepend=-1))
    commanded = commanded_mm[order]
    moves = (np.maximum.reduceat(commanded, starts) - np.minimum.reduceat(commanded, starts))[own] > SAME_POSITION_MM
    sense = np.where(moves, _with_first_direction(directions[order], commanded, starts), 0)
    _, first, of_key = np.unique(3**3 * own + sense @ _SENSES, return_index=True, return_inverse=True)
    # Numbered as they come.
    numbers = np.empty(len(group), dtype=np.int64)
    numbers[order] = np.argsort(np.argsort(first))[of_key]
    return numbers


def named_runs(session: Integers, lines: Sequence[str], repeat: Numbers) -> Integers:
    """Give every row its run as the file names it: rows of one session, line and repeat, whichever way they went.

    A row alone is no run: it says nothing of how rows of one scatter. Where every row has a repeat, or a line, of its
    own, that column does not part them.
    """
    rounds = np.nan_to_num(repeat).tolist()
    columns = (session.tolist(), list(lines), rounds)
    for fewer in (columns, (columns[0], rounds), columns[:2]):
        group = _grouped(*fewer)
        if int(group.max(initial=-1)) + 1 < len(group):
            return group
    return _grouped(columns[0])


def _grouped(*columns: Sequence[object]) -> Integers:
    """Give rows of columns (n,) numbers: alike the same, as they come."""
    number_of: dict[tuple[object, ...], int] = {}
    return np.array([number_of.setdefault(key, len(number_of)) for key in zip(*columns, strict=True)], dtype=np.int64)


def _with_first_direction(
    directions: npt.NDArray[np.int8], commanded_mm: Numbers, starts: Integers
) -> npt.NDArray[np.int8]:
    """Give each row the direction of travel within its line: of the step towards it, at first of the next one.

    A row at rest belongs to the step before it; to the one after it where the file says that it turned.

    Parameters
    ----------
    starts
        The first row of each line.
    """
    n = len(commanded_mm)
    row = np.arange(n)
    lengths = np.diff(starts, append=n)
    first, end = np.repeat(starts, lengths), np.repeat(starts + lengths, lengths)
    step = np.zeros((n, 3), dtype=np.int8)
    step[1:] = np.sign(np.round(np.diff(commanded_mm, axis=0) / SAME_POSITION_MM))
    # No step leads from one line to another.
    step[starts] = 0
    result = np.zeros_like(directions)
    for axis in range(3):
        is_step = step[:, axis] != 0
        last = np.maximum.accumulate(np.where(is_step, row, -1))
        following = np.append(np.minimum.accumulate(np.where(is_step, row, n)[::-1])[::-1], n)
        # Rows up to the first step belong to it, and those after the last one to that.
        has_last, has_next = last >= first, following[1:] < end
        before = np.where(has_last, last, following[:-1])
        after = np.where(has_next, following[1:], last)
        moves_at_all = has_last | (following[:-1] < end)
        before, after = (step[np.clip(place, 0, n - 1), axis] for place in (before, after))
        is_at_rest = (row > first) & ~is_step
        has_turned = is_at_rest & (directions[:, axis] == after)
        result[:, axis] = np.where(moves_at_all, np.where(has_turned, after, before), directions[:, axis])
    return result
