"""Outlines of the black parts of a pattern, so that neighbouring black cells print without a seam between them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.vision.patterns import Pattern

# Right, down, left, up, as steps (row, column); a turn to the right is the next one.
_STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))
# At a corner where two black cells touch, the turn to the right stays with the same cell: no outline crosses itself.
_TURNS = (1, 0, 3)


def black_outlines(pattern: Pattern) -> list[npt.NDArray[np.float64]]:
    """Trace the edges between black and white, with black on the right as one walks.

    Parameters
    ----------
    pattern
        Cells; outside them everything is white.

    Returns
    -------
    list of ndarray
        (n, 2) corners (u, v) in mm of each closed outline, the first not repeated at the end; corners only, nothing
        in the middle of a straight edge. Outer edges run clockwise as one looks at the pattern, holes the other way.
    """
    black = np.pad(pattern.white == 0, 1)
    edges = _edges(black)
    outlines = []
    for start in sorted(edges):
        if start not in edges:
            continue
        corners = []
        row, column, heading = start
        before = None
        while (row, column, heading) in edges:
            edges.remove((row, column, heading))
            if heading != before:
                corners.append((column, row))
            before = heading
            row, column = row + _STEPS[heading][0], column + _STEPS[heading][1]
            turns = ((heading + turn) % 4 for turn in _TURNS)
            heading = next((turn for turn in turns if (row, column, turn) in edges), heading)
        indices = np.array(corners)
        outlines.append(np.stack([pattern.u_edges_mm[indices[:, 0]], pattern.v_edges_mm[indices[:, 1]]], axis=1))
    return outlines


def _edges(black: npt.NDArray[np.bool_]) -> set[tuple[int, int, int]]:
    """Give every edge as (row, column, heading) of the grid point where it starts."""
    inside = black[1:-1, 1:-1]
    # Which neighbour is white, and where an edge along that side starts, relative to the cell's upper left point.
    sides = (
        (black[:-2, 1:-1], (0, 0)),
        (black[1:-1, 2:], (0, 1)),
        (black[2:, 1:-1], (1, 1)),
        (black[1:-1, :-2], (1, 0)),
    )
    edges = set()
    for heading, (neighbour, (down, right)) in enumerate(sides):
        for row, column in np.argwhere(inside & ~neighbour):
            edges.add((int(row) + down, int(column) + right, heading))
    return edges
