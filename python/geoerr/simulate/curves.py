"""Error functions of one coordinate that can be evaluated, differentiated and integrated exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from geoerr.simulate.rotations import Array

# A function of one axis coordinate: (n,) mm to (n,) mm or rad.
Function: TypeAlias = Callable[[Array], Array]

# Composite Gauss-Legendre: 64 panels of 8 nodes integrate a wave of 10 turns to machine precision.
_N_PANELS = 64
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Curve(Protocol):
    """A function of one axis coordinate (mm) with its derivative and an antiderivative."""

    def at(self, q_mm: Array) -> Array:
        """Give the value at (n,) positions."""

    def slope(self, q_mm: Array) -> Array:
        """Give the derivative by q."""

    def integral(self, q_mm: Array) -> Array:
        """Give an antiderivative."""


@dataclass(frozen=True)
class Wave:
    """A polynomial and a few sinusoids of p = (q − low) / length: smooth, and known at every q.

    Attributes
    ----------
    low_mm, length_mm
        What p counts from and in.
    powers
        (k,) coefficients of 1, p, p², ...
    amplitudes, turns, phases_rad
        (m,) each: amplitude · sin(2π · turns · p + phase).
    """

    low_mm: float
    length_mm: float
    powers: Array
    amplitudes: Array
    turns: Array
    phases_rad: Array

    def _place(self, q_mm: Array) -> tuple[Array, Array]:
        p = (np.asarray(q_mm, dtype=np.float64) - self.low_mm) / self.length_mm
        return p, 2.0 * np.pi * self.turns * p[..., None] + self.phases_rad

    def at(self, q_mm: Array) -> Array:
        """Give the value at (n,) positions."""
        p, angle = self._place(q_mm)
        return np.asarray(np.polynomial.polynomial.polyval(p, self.powers) + np.sin(angle) @ self.amplitudes)

    def slope(self, q_mm: Array) -> Array:
        """Give the derivative by q."""
        p, angle = self._place(q_mm)
        polynomial = np.polynomial.polynomial.polyval(p, np.polynomial.polynomial.polyder(self.powers))
        waves = np.cos(angle) @ (2.0 * np.pi * self.turns * self.amplitudes)
        return np.asarray((polynomial + waves) / self.length_mm)

    def integral(self, q_mm: Array) -> Array:
        """Give an antiderivative."""
        p, angle = self._place(q_mm)
        polynomial = np.polynomial.polynomial.polyval(p, np.polynomial.polynomial.polyint(self.powers))
        waves = np.cos(angle) @ (self.amplitudes / (2.0 * np.pi * self.turns))
        return np.asarray((polynomial - waves) * self.length_mm)


@dataclass(frozen=True)
class Polyline:
    """A table: straight lines between its points, the end values outside (as errors.json is read).

    Attributes
    ----------
    position_mm, value
        (n,) each, positions strictly ascending.
    """

    position_mm: Array
    value: Array

    def at(self, q_mm: Array) -> Array:
        """Give the value at (n,) positions."""
        return np.interp(np.asarray(q_mm, dtype=np.float64), self.position_mm, self.value)

    def slope(self, q_mm: Array) -> Array:
        """Give the derivative by q; 0 outside, the right-hand one at a table position."""
        steps = np.diff(self.value) / np.diff(self.position_mm)
        padded = np.concatenate(([0.0], steps, [0.0]))
        return np.asarray(padded[np.searchsorted(self.position_mm, q_mm, side="right")])

    def integral(self, q_mm: Array) -> Array:
        """Give an antiderivative."""
        q = np.asarray(q_mm, dtype=np.float64)
        areas = np.diff(self.position_mm) * 0.5 * (self.value[1:] + self.value[:-1])
        before = np.concatenate(([0.0], np.cumsum(areas)))
        index = np.clip(np.searchsorted(self.position_mm, q, side="right") - 1, 0, len(self.position_mm) - 1)
        # Left of the table `index` is 0 and the step is negative, with the end value on both sides.
        step = q - self.position_mm[index]
        return np.asarray(before[index] + step * 0.5 * (self.value[index] + self.at(q)))


def draw_wave(rng: np.random.Generator, low_mm: float, length_mm: float, amplitude: float) -> Wave:
    """Draw a smooth curve that is 0 at the low end and whose largest value over the length is `amplitude`.

    Parabola, cubic and three waves of 0.5 to 2.5 turns, the quicker ones smaller; a linear part too.
    """
    powers = np.concatenate(([0.0], rng.normal(0.0, 1.0, 3)))
    turns = np.sort(rng.uniform(0.5, 2.5, 3))
    amplitudes = rng.normal(0.0, 0.4, 3) / turns
    wave = Wave(low_mm, length_mm, powers, amplitudes, turns, rng.uniform(0.0, 2.0 * np.pi, 3))
    q_mm = np.linspace(low_mm, low_mm + length_mm, 401)
    value = wave.at(q_mm)
    largest = float(np.abs(value - value[0]).max())
    factor = amplitude / largest
    powers = powers.copy()
    powers[0] = -value[0]
    return Wave(low_mm, length_mm, powers * factor, amplitudes * factor, turns, wave.phases_rad)


def fitted_line(function: Callable[[Array], Array], low_mm: float, high_mm: float) -> tuple[Array, Array]:
    """Give the least-squares line of a function over a uniform, continuous range.

    Parameters
    ----------
    function
        (n,) mm to (n,) or (n, k).
    low_mm, high_mm
        The range.

    Returns
    -------
    mean, per_mm
        Value at the middle of the range, and slope; scalars or (k,).
    """
    edges = np.linspace(low_mm, high_mm, _N_PANELS + 1)
    half = 0.5 * np.diff(edges)
    q_mm = (0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * _NODES).ravel()
    weights = (half[:, None] * _WEIGHTS).ravel()
    length_mm = high_mm - low_mm
    value = function(q_mm)
    arm_mm = q_mm - 0.5 * (low_mm + high_mm)
    mean = np.tensordot(weights, value, axes=1) / length_mm
    per_mm = np.tensordot(weights * arm_mm, value, axes=1) * (12.0 / length_mm**3)
    return np.asarray(mean), np.asarray(per_mm)


def table_slope(position_mm: Array, value: Array) -> Array:
    """Give the least-squares slope, over a uniform range, of the polygon through a table's entries.

    Parameters
    ----------
    position_mm
        (n,) increasing.
    value
        (n,) or (n, k).

    Returns
    -------
    ndarray
        Slope per mm, scalar or (k,): ∫ (q − middle) f dq · 12 / L³, each side of the polygon by Simpson's rule, which
        is exact for the product of two lines.
    """
    length_mm = position_mm[-1] - position_mm[0]
    arm_mm = position_mm - 0.5 * (position_mm[0] + position_mm[-1])
    step_mm = np.diff(position_mm)
    ends = np.multiply.outer(arm_mm, np.ones(value.shape[1:])) * value
    middle = 0.25 * np.multiply.outer(arm_mm[1:] + arm_mm[:-1], np.ones(value.shape[1:])) * (value[1:] + value[:-1])
    moment = np.tensordot(step_mm / 6.0, ends[:-1] + 4.0 * middle + ends[1:], axes=1)
    return np.asarray(moment * (12.0 / length_mm**3))


def from_zero(function: Function, low_mm: float) -> Function:
    """Give the function minus its value at `low_mm`."""
    start = function(np.array([low_mm]))[0]
    return lambda q_mm: np.asarray(function(q_mm) - start)


def without_line(function: Function, low_mm: float, high_mm: float) -> Function:
    """Give the function without its least-squares slope over the range, then 0 at `low_mm`."""
    _, per_mm = fitted_line(function, low_mm, high_mm)
    return from_zero(lambda q_mm: np.asarray(function(q_mm) - per_mm * q_mm), low_mm)
