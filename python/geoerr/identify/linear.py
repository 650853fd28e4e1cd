"""Quantities that depend on the measured points linearly to first order, and carry that dependence with them.

An estimate is a chain of linear steps: projection, least squares, difference, integral, gauge. Each step is applied
to the value and to its derivative by the measured positions alike, so that at the end the uncertainty of every number
is one product with the covariance of the points (`geoerr.identify.uncertainty`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Linear:
    """Values and their derivatives by the measured positions.

    Attributes
    ----------
    value : (n,)
        mm, rad or rad·mm⁻¹ as the quantity has it.
    rows : (k,)
        Rows of the observations that it depends on, increasing.
    operator : (n, k, 3)
        Derivative of each value by the measured position (mm, measuring frame) of each of these rows.
    """

    value: Numbers
    rows: Indices
    operator: Numbers

    def __len__(self) -> int:
        return len(self.value)

    def __add__(self, other: Linear) -> Linear:
        rows = np.union1d(self.rows, other.rows)
        return Linear(self.value + other.value, rows, self._spread(rows) + other._spread(rows))

    def __sub__(self, other: Linear) -> Linear:
        return self + other.transformed(-np.eye(len(other)))

    def __getitem__(self, index: Indices | slice) -> Linear:
        return Linear(self.value[index], self.rows, self.operator[index])

    def transformed(self, matrix: Numbers) -> Linear:
        """Apply a matrix (m, n) to the values."""
        return Linear(matrix @ self.value, self.rows, np.tensordot(matrix, self.operator, axes=1))

    def with_value(self, value: Numbers) -> Linear:
        """Keep the derivative and state the values otherwise (where they are known beyond first order)."""
        return Linear(value, self.rows, self.operator)

    def _spread(self, rows: Indices) -> Numbers:
        if len(rows) == len(self.rows):
            return self.operator
        spread = np.zeros((len(self.value), len(rows), 3))
        spread[:, np.searchsorted(rows, self.rows)] = self.operator
        return spread


def zeros(n_values: int) -> Linear:
    """Give n values that are 0 and depend on nothing."""
    return Linear(np.zeros(n_values), np.zeros(0, dtype=np.intp), np.zeros((n_values, 0, 3)))


def stacked(parts: Sequence[Linear]) -> Linear:
    """Put several quantities below each other."""
    rows = np.unique(np.concatenate([part.rows for part in parts]))
    return Linear(
        np.concatenate([part.value for part in parts]),
        rows,
        np.concatenate([part._spread(rows) for part in parts]),
    )


def from_rows(value: Numbers, rows: Indices, operator: Numbers) -> Linear:
    """Make a quantity from rows in any order (each at most once)."""
    order = np.argsort(rows)
    return Linear(value, rows[order], operator[:, order])


@dataclass(frozen=True)
class Curve:
    """An error function known at some of the nodes of its axis.

    Attributes
    ----------
    nodes : (k,)
        Which nodes of the axis's grid.
    position_mm : (k,)
        Where they are, increasing.
    linear : Linear
        The k values.
    """

    nodes: Indices
    position_mm: Numbers
    linear: Linear

    def at(self, position_mm: Numbers) -> Linear:
        """Interpolate by straight lines; the end values hold outside."""
        return self.linear.transformed(interpolation(self.position_mm, position_mm))

    def on(self, nodes: Indices) -> Curve:
        """Keep the given nodes of the grid, those that the curve has."""
        kept = np.flatnonzero(np.isin(self.nodes, nodes))
        return Curve(self.nodes[kept], self.position_mm[kept], self.linear[kept])

    def from_first(self) -> Curve:
        """Make the first value 0 (the gauge of positioning and angles)."""
        difference = np.eye(len(self.nodes))
        difference[:, 0] -= 1.0
        return self.transformed(difference)

    def transformed(self, matrix: Numbers) -> Curve:
        """Apply a (k, k) matrix to the values."""
        return Curve(self.nodes, self.position_mm, self.linear.transformed(matrix))

    def minus(self, other: Curve, factor: float) -> Curve:
        """Give this − factor·other on the nodes that both have."""
        both = np.intersect1d(self.nodes, other.nodes)
        mine, its = self.on(both), other.on(both)
        return Curve(both, mine.position_mm, mine.linear - its.linear.transformed(factor * np.eye(len(both))))


def interpolation(nodes_mm: Numbers, position_mm: Numbers) -> Numbers:
    """Give the matrix (m, k) of interpolation by straight lines; the end values hold outside."""
    matrix = np.zeros((len(position_mm), len(nodes_mm)))
    if len(nodes_mm) == 1:
        matrix[:] = 1.0
        return matrix
    place = np.clip(position_mm, nodes_mm[0], nodes_mm[-1])
    left = np.clip(np.searchsorted(nodes_mm, place, side="right") - 1, 0, len(nodes_mm) - 2)
    share = (place - nodes_mm[left]) / (nodes_mm[left + 1] - nodes_mm[left])
    each = np.arange(len(position_mm))
    matrix[each, left] = 1.0 - share
    matrix[each, left + 1] += share
    return matrix
