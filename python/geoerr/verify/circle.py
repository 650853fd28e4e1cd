"""Circles: the least-squares circle of measured points, the circular deviation, where a circle fits.

The circular deviation G of ISO 230-4 is the largest minus the smallest distance of the path's points from the centre
of their least-squares circle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeometryError, ShapeError
from geoerr.machine import AXES

Numbers = npt.NDArray[np.float64]

# Axes of a plane in the order that makes "counter-clockwise seen from + of the third axis" a positive angle.
PLANES: dict[str, tuple[int, int, int]] = {"XY": (0, 1, 2), "YZ": (1, 2, 0), "ZX": (2, 0, 1)}

_MAX_ITERATIONS = 100
# A step this small against the radius is below the spacing of doubles in the squares that the fit compares.
_STEP_TOLERANCE = 1e-12
# A circle smaller than this about the user's own centre is not worth offering.
_LEAST_OFFERED_MM = 1.0


@dataclass(frozen=True, eq=False)
class FittedCircle:
    """The least-squares circle of points in a plane.

    Attributes
    ----------
    center_mm : (2,)
        Its centre.
    radius_mm
        Its radius: the mean distance of the points from the centre.
    deviation_mm : (n,)
        Distance of each point from the centre, minus the radius.
    """

    center_mm: Numbers
    radius_mm: float
    deviation_mm: Numbers

    @property
    def circular_deviation_mm(self) -> float:
        """G of ISO 230-4: largest minus smallest distance from the centre."""
        return float(np.ptp(self.deviation_mm))


def plane_of(positions_mm: Numbers) -> str:
    """Name the plane of positions (n, 3) on a circle: the third axis is the one that moves least."""
    third = int(np.argmin(np.ptp(positions_mm, axis=0)))
    return next(name for name, axes in PLANES.items() if axes[2] == third)


def fit_circle(points_mm: npt.ArrayLike) -> FittedCircle:
    """Fit the circle with the least sum of squared distances to points (geometric fit).

    Minimises ``Σ (|p_i − c| − R)²`` by Gauss–Newton with halved steps, from the algebraic (Kåsa) circle. R is
    eliminated: at the minimum it is the mean distance from c.

    Parameters
    ----------
    points_mm : (n, 2)
        Points in the plane of the circle, n ≥ 3.

    Raises
    ------
    ShapeError
        if the array is not (n, 2), has fewer than three points, or holds a value that is not finite.
    GeometryError
        if the points lie on a straight line or in one place.

    Notes
    -----
    Verified in ``tests/verify/test_circle.py`` against ``scipy.optimize.least_squares`` (whole circles and arcs) and
    against circles known exactly.
    """
    points = np.asarray(points_mm, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ShapeError(f"a circle needs at least three points as an (n, 2) array, not {points.shape}")
    if not np.isfinite(points).all():
        raise ShapeError(
            f"point {int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])} of the circle is not finite"
        )
    origin = points.mean(axis=0)
    scale = float(np.sqrt(((points - origin) ** 2).sum(axis=1).mean()))
    singular = np.linalg.svd(points - origin, compute_uv=False)
    if scale == 0.0 or singular[1] <= 1e-9 * singular[0]:
        raise GeometryError("the points of the circle lie on a straight line")
    unit = (points - origin) / scale
    center = _algebraic_center(unit)
    for _ in range(_MAX_ITERATIONS):
        step = _gauss_newton_step(unit, center)
        cost = _cost(unit, center)
        while _cost(unit, center + step) > cost and np.abs(step).max() > _STEP_TOLERANCE:
            step = step / 2.0
        center = center + step
        if np.abs(step).max() <= _STEP_TOLERANCE:
            break
    center_mm = origin + scale * center
    distance = np.hypot(*(points - center_mm).T)
    radius = float(distance.mean())
    return FittedCircle(center_mm, radius, distance - radius)


@dataclass(frozen=True, eq=False)
class SetUp:
    """What a ball bar's mounting leaves free in one run: where its base stands and its length.

    Attributes
    ----------
    center_mm : (2,)
        The base, in the plane of the circle.
    radius_offset_mm
        Constant part of the measured radius that the predicted path does not have.
    difference_mm : (n,)
        Measured minus predicted radius, with the set-up removed.
    """

    center_mm: Numbers
    radius_offset_mm: float
    difference_mm: Numbers

    @property
    def rms_mm(self) -> float:
        """Root mean square of the difference."""
        return float(np.sqrt(np.mean(self.difference_mm**2)))


def fit_set_up(predicted_mm: Numbers, height_mm: Numbers, measured_radius_mm: Numbers) -> SetUp:
    """Find the centre and the constant of the radius that bring a predicted path closest to measured radii.

    Minimises ``Σ (r_i − √(|p_i − c|² + h_i²) − r0)²`` over c and r0 by Gauss–Newton: a bar measures the distance in
    space, h being how far the path leaves its mean plane.

    Parameters
    ----------
    predicted_mm : (n, 2)
        Predicted tool positions in the plane of the circle.
    height_mm : (n,)
        Predicted positions along the third axis; their mean is removed.
    measured_radius_mm : (n,)
        Radii that the bar measured at the same commands.

    Raises
    ------
    GeometryError
        if the points do not determine a centre.
    """
    height = height_mm - height_mm.mean()
    center = fit_circle(predicted_mm).center_mm
    offset = 0.0
    for _ in range(_MAX_ITERATIONS):
        distance, toward = _distances(predicted_mm, height, center)
        residual = measured_radius_mm - distance - offset
        # d(residual)/d(center) = +toward, d(residual)/d(offset) = −1.
        columns = np.column_stack([toward, -np.ones(len(residual))])
        step = np.linalg.lstsq(columns, -residual, rcond=None)[0]
        center = center + step[:2]
        offset += float(step[2])
        if np.abs(step).max() <= _STEP_TOLERANCE * float(distance.mean()):
            break
    distance, _ = _distances(predicted_mm, height, center)
    residual = measured_radius_mm - distance
    offset = float(residual.mean())
    return SetUp(center, offset, residual - offset)


@dataclass(frozen=True)
class CircleOfCommands:
    """A commanded circle: `plane` (`XY`, `YZ`, `ZX`), its centre in machine coordinates (x, y, z), its radius."""

    plane: str
    center_mm: tuple[float, float, float]
    radius_mm: float

    @property
    def axes(self) -> tuple[int, int, int]:
        """Numbers of first and second axis of the plane, and of the axis that stands still."""
        return PLANES[self.plane]

    def positions_mm(self, n_points: int, *, clockwise: bool = False) -> Numbers:
        """Give commanded axis positions, (n_points, 3): one turn from angle 0, in equal steps, its end left out."""
        angle = np.arange(n_points) * (2.0 * np.pi / n_points)
        if clockwise:
            angle = -angle
        first, second, _ = self.axes
        positions = np.tile(np.asarray(self.center_mm, dtype=np.float64), (n_points, 1))
        positions[:, first] += self.radius_mm * np.cos(angle)
        positions[:, second] += self.radius_mm * np.sin(angle)
        return positions

    def in_plane(self, positions_mm: Numbers) -> Numbers:
        """Give the two coordinates in the plane, (n, 2), relative to the commanded centre."""
        first, second, _ = self.axes
        return np.asarray(positions_mm[:, [first, second]] - np.asarray(self.center_mm)[[first, second]])

    def leaves(self, low_mm: Numbers, high_mm: Numbers, what: str, beyond_mm: float = 0.0) -> str | None:
        """Say which axis's range the circle leaves; None where it lies inside.

        Parameters
        ----------
        low_mm, high_mm : (3,)
            The box; infinite where an axis is not bounded.
        what
            What the box is, for the message: "the machine's range".
        beyond_mm
            How far beyond the box it may go.
        """
        first, second, third = self.axes
        center = np.asarray(self.center_mm, dtype=np.float64)
        reach = np.zeros(3)
        reach[[first, second]] = self.radius_mm
        # A circle may touch the end of the range; doubles must not turn that into a refusal.
        slack = beyond_mm + 1e-9 * np.maximum(1.0, self.radius_mm)
        outside = (center - reach < low_mm - slack) | (center + reach > high_mm + slack)
        if not outside.any():
            return None
        axis = int(np.flatnonzero(outside)[0])
        span = (
            f"stands at {AXES[axis]} = {center[axis]:g} mm"
            if axis == third
            else f"needs {AXES[axis]} from {center[axis] - reach[axis]:g} to {center[axis] + reach[axis]:g} mm"
        )
        return f"the circle {span}, {what} is {low_mm[axis]:g} to {high_mm[axis]:g} mm"


def what_fits(circle: CircleOfCommands, low_mm: Numbers, high_mm: Numbers) -> str:
    """Give options for a circle like this one that lies in a box: about the same centre, and about the middle.

    Parameters
    ----------
    circle
        The one that does not fit.
    low_mm, high_mm : (3,)
        The box, finite.
    """
    first, second, third = circle.axes
    if (low_mm > high_mm).any() or (low_mm >= high_mm)[[first, second]].any():
        return "none fits into the part of the machine's range in which its errors were measured"
    level = float(np.clip(circle.center_mm[third], low_mm[third], high_mm[third]))
    at_level = "" if level == circle.center_mm[third] else f",{level:.9g}"
    here = np.asarray(circle.center_mm)[[first, second]]
    middle = ((low_mm + high_mm) / 2.0)[[first, second]]
    fits = []
    for center, least in ((here, _LEAST_OFFERED_MM), (middle, 0.0)):
        # Rounded first, so that what is printed is what fits.
        shown = np.round(center, 3)
        room = np.minimum(shown - low_mm[[first, second]], high_mm[[first, second]] - shown).min()
        radius = min(float(np.floor(1e3 * room + 1e-6) / 1e3), circle.radius_mm)
        if radius > least:
            fits.append(f"--center {shown[0]:.9g},{shown[1]:.9g}{at_level} --radius {radius:.9g}")
    return "would fit: " + ", or ".join(dict.fromkeys(fits))


def _algebraic_center(points: Numbers) -> Numbers:
    """Kåsa's circle: linear least squares of ``x² + y² = 2 a x + 2 b y + c``; a start for the geometric fit."""
    columns = np.column_stack([2.0 * points, np.ones(len(points))])
    return np.asarray(np.linalg.lstsq(columns, (points**2).sum(axis=1), rcond=None)[0][:2])


def _distances(points: Numbers, height: Numbers, center: Numbers) -> tuple[Numbers, Numbers]:
    difference = points - center
    distance = np.sqrt((difference**2).sum(axis=1) + height**2)
    # A point in the centre has no direction; it gives the fit none.
    toward = difference / np.where(distance > 0.0, distance, 1.0)[:, None]
    return distance, toward


def _gauss_newton_step(points: Numbers, center: Numbers) -> Numbers:
    distance, toward = _distances(points, np.zeros(len(points)), center)
    # Projecting the mean out of both sides eliminates the radius.
    columns = -(toward - toward.mean(axis=0))
    return np.asarray(np.linalg.lstsq(columns, -(distance - distance.mean()), rcond=None)[0])


def _cost(points: Numbers, center: Numbers) -> float:
    distance = np.hypot(*(points - center).T)
    return float(((distance - distance.mean()) ** 2).sum())
