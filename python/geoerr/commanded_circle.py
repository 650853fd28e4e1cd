"""The circle that points of a circular test were commanded on: files have the points rounded."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]

# Digits that files have: from a hundredth of a millimetre to a nanometre. Points on a coarser grid were meant so.
_STEPS_MM = tuple(10.0**-digits for digits in range(2, 7))
_COARSE_MM = (1.0, 0.1)
# A number is a multiple of a step where it is this near to one, in steps.
_MULTIPLE = 1e-6
# A rounded point is off by half the diagonal of a step's square at most; centre and radius are off by a little more.
_ROUNDED_OFF = 0.75
# Points that are off by less of a step lie on their circle: the ends of its diameters, say.
_LITTLE_OFF = 0.01
# Of the radius: what is off by more than half of it is another quantity or a mistake, not an error of a machine.
_OTHER_QUANTITY = 0.5
# A machine's radius is off by a thousandth at most, what a bar of a wrong length adds by more than this share.
_OTHER_CIRCLE = 0.01


def plane_of(points_mm: Numbers) -> tuple[int, int, int]:
    """Give the two axes of a circle's plane, in their order about the third, and the third: it moves least."""
    third = int(np.argmin(np.ptp(points_mm, axis=0)))
    return (third + 1) % 3, (third + 2) % 3, third


def circle_through(points_mm: Numbers) -> tuple[Numbers, float]:
    """Give centre (2,) and radius of commanded points (n, 2) on a circle (linear least squares, Kåsa)."""
    origin = points_mm.mean(axis=0)
    design = np.column_stack([2.0 * (points_mm - origin), np.ones(len(points_mm))])
    found = np.linalg.lstsq(design, ((points_mm - origin) ** 2).sum(axis=1), rcond=None)[0]
    centre = origin + found[:2]
    return centre, float(np.hypot(*(points_mm - centre).T).mean())


def no_radius(measured_mm: Numbers, radius_mm: float) -> str | None:
    """Say what to do where measured numbers (n,) are no radii of a commanded circle; None where they are."""
    middle = float(np.median(measured_mm))
    if middle < (1.0 - _OTHER_QUANTITY) * radius_mm:
        return "r is the measured radius in mm, not its deviation"
    if middle > (1.0 + _OTHER_QUANTITY) * radius_mm:
        return "r is the measured radius in mm, not the diameter"
    return None


def far_from_radius(measured_mm: Numbers, radius_mm: float) -> npt.NDArray[np.bool_]:
    """Tell which measured radii (n,) no machine can have made: far off the middle of their run."""
    return np.asarray(np.abs(measured_mm - np.median(measured_mm)) > _OTHER_QUANTITY * radius_mm)


def other_radius(measured_mm: Numbers, radius_mm: float) -> str | None:
    """Say that measured radii (n,) are of another circle than was commanded; None where they are of that."""
    middle = float(np.median(measured_mm))
    if abs(middle - radius_mm) <= _OTHER_CIRCLE * radius_mm:
        return None
    return (
        f"the measured radius is {middle:.6g} mm where the commanded circle has {radius_mm:.6g} mm: no machine is "
        "off by so much; a bar of another length than its file says, another circle, or another unit"
    )


def on_their_circle(points_mm: Numbers) -> Numbers:
    """Put points (n, 3) of one run back on the circle that they are off by no more than their digits.

    A radius of 100 mm that is read to a micrometre, at points that are written to a micrometre, would be half a
    micrometre off at each angle in its own way, the same in all runs: that looks like an error of the axes.
    """
    first, second, _ = plane_of(points_mm)
    plane = points_mm[:, [first, second]]
    step_mm = next((step for step in _STEPS_MM if _are_multiples(plane, step)), None)
    if step_mm is None or len(plane) < 3 or not _off_circle_mm(plane) <= _ROUNDED_OFF * step_mm:
        return points_mm
    centre, radius_mm = circle_through(plane)
    placed = points_mm.copy()
    distance_mm = np.hypot(*(plane - centre).T)
    placed[:, [first, second]] = centre + (plane - centre) * (radius_mm / distance_mm)[:, None]
    return placed


def coarse_step_mm(points_mm: Numbers) -> float | None:
    """Give the step, a tenth of a millimetre or a whole one, to which points (n, 3) of a circle were perhaps rounded.

    They stay where they are: a program may have been written so, and a machine goes where it is told. None where
    they are finer, or on their circle, or on none.
    """
    first, second, _ = plane_of(points_mm)
    plane = points_mm[:, [first, second]]
    step_mm = next((step for step in _COARSE_MM if _are_multiples(plane, step)), None)
    if step_mm is None or len(plane) < 3:
        return None
    return step_mm if _LITTLE_OFF * step_mm < _off_circle_mm(plane) <= _ROUNDED_OFF * step_mm else None


def _off_circle_mm(plane: Numbers) -> float:
    """Give how far points (n, 2) are off their circle at most."""
    centre, radius_mm = circle_through(plane)
    return float(np.abs(np.hypot(*(plane - centre).T) - radius_mm).max())


def _are_multiples(values: Numbers, step: float) -> bool:
    return bool((np.abs(values / step - np.round(values / step)) < _MULTIPLE).all())
