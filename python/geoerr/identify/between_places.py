"""What an angle does between the places where it was measured, as far as it bears on the integral of it.

Straightness by integration is as good as the angle is known all along the axis. Whether its places are near enough to
each other the data say themselves: a place that is left out is predicted from its neighbours by a cubic. Where that
fails beyond the noise, the curve between places is not known, and neither is its integral.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.distributions import chi_squared_sf
from geoerr.geometry import remove_line
from geoerr.identify.distance import squared_distance
from geoerr.identify.linear import Numbers

# Below this probability of such misses by chance the places are too far apart.
_SIGNIFICANCE = 0.01
# Neighbours that a place is predicted from.
_NEIGHBOURS = 4
# Mean of a parabola that is 0 at both ends of an interval and 1 in its middle.
_MEAN_OF_A_BUMP = 2.0 / 3.0


def integral_covariance(
    position_mm: Numbers, angles_rad: Sequence[Numbers], covariances: Sequence[Numbers | None]
) -> Numbers:
    """Give the covariance of a straightness by integration that is due to what its angle does between places.

    Each interval's mean may be off by what places that were left out are off by, independently of the others'. All
    angles of an axis count together: one of them may lie on a parabola by chance, though its carriage does not.

    Parameters
    ----------
    position_mm : (n,)
        Places, rising.
    angles_rad
        The angles of one axis there, (n,) each.
    covariances
        Their covariances, (n, n) each; None where nothing is known.

    Returns
    -------
    (n, n)
        mm², with the least-squares line taken off as from the integral; 0 where places are near enough.

    Notes
    -----
    Verified in tests/identify/test_between_places.py: 0 for curves that the places resolve, about right for those
    that they do not.
    """
    miss_rad = _miss_rad(position_mm, angles_rad, covariances)
    bump_mm = _MEAN_OF_A_BUMP * miss_rad * np.diff(position_mm)
    steps = np.tril(np.ones((len(position_mm), len(bump_mm))), -1) * bump_mm
    own = without_line(position_mm) @ steps
    return np.asarray(own @ own.T)


def without_line(position_mm: Numbers) -> Numbers:
    """Give the matrix (n, n) that takes the least-squares line off values, and makes the first of them 0."""
    return np.asarray(remove_line(position_mm, np.eye(len(position_mm))).T)


def _miss_rad(position_mm: Numbers, angles_rad: Sequence[Numbers], covariances: Sequence[Numbers | None]) -> float:
    """Give how far places that are left out lie off their neighbours' cubic, rms, less what the noise explains."""
    if len(position_mm) < 3 or not angles_rad:
        return 0.0
    left_out = _left_out(position_mm)
    square = expected = chi_squared = 0.0
    n_missed = dof = 0
    for angle, covariance in zip(angles_rad, covariances, strict=True):
        if covariance is None or not np.isfinite(covariance).all():
            continue
        miss = left_out @ angle
        own = left_out @ covariance @ left_out.T
        more, rank = squared_distance(miss, own)
        chi_squared, dof = chi_squared + more, dof + rank
        n_missed += len(miss)
        square += float(miss @ miss)
        expected += float(np.trace(own))
    if dof == 0 or chi_squared_sf(chi_squared, dof) >= _SIGNIFICANCE:
        return 0.0
    return float(np.sqrt(max(square - expected, 0.0) / n_missed))


def _left_out(position_mm: Numbers) -> Numbers:
    """Give the matrix (n − 2, n) of inner values minus what a polynomial through their neighbours has there."""
    n = len(position_mm)
    matrix = np.zeros((n - 2, n))
    for row, place in enumerate(range(1, n - 1)):
        others = np.delete(np.arange(n), place)
        # One on either side at least, so that none is an extrapolation.
        first = min(max(place - _NEIGHBOURS // 2, 0), max(n - 1 - _NEIGHBOURS, 0))
        own = others[first : first + _NEIGHBOURS]
        matrix[row, place] = 1.0
        for one in own:
            rest = own[own != one]
            away = (position_mm[place] - position_mm[rest]) / (position_mm[one] - position_mm[rest])
            matrix[row, one] = -float(np.prod(away))
    return matrix
