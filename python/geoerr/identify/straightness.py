"""Straightness by integration (Li Eq. 19), its gauge, and whether a carriage follows its guideway's tangent.

A carriage that follows the tangent of its guideway has, on the tool side, dδ/dq = ε × â:

    δ_yx = +∫ε_zx dx, δ_zx = −∫ε_yx dx, δ_xy = −∫ε_zy dy, δ_zy = +∫ε_xy dy, δ_xz = +∫ε_yz dz, δ_yz = −∫ε_xz dz

and on the work side the opposite of each: errors are those of the tool seen from the work, so there both δ and ε are
minus the carriage's own, while it moves by −q. (The paper prints all six with plus and `dx` in every integral.) From
each the least-squares line is taken. The relation holds for the carriage's point on the guideway, l = 0.

The points show straightness directly, too. The difference of the two, against its uncertainty, tells whether the
assumption holds; where it does, the integral is several times more certain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoerr.distributions import chi_squared_sf, never_zero
from geoerr.error_functions import LI_NAMES
from geoerr.geometry import integrate_straightness
from geoerr.identify.between_places import without_line
from geoerr.identify.distance import squared_distance
from geoerr.identify.linear import Curve, Linear, Numbers
from geoerr.machine import AXES, Machine
from geoerr.summaries import p_words

# Below this probability of so large a disagreement by chance the assumption is rejected.
_SIGNIFICANCE = 0.01

_UM_PER_MM = 1e3


@dataclass(frozen=True)
class TangentVerdict:
    """Direct against integrated straightness of one function.

    Attributes
    ----------
    name
        ISO name.
    rms_mm
        Root mean square difference of the two over their common nodes.
    p_value
        Probability of so large a difference by chance if the carriage follows the tangent; None without
        uncertainties.
    follows
        Whether the assumption stands; None without uncertainties.
    """

    name: str
    rms_mm: float
    p_value: float | None
    follows: bool | None

    def in_words(self) -> str:
        """Say it in a sentence."""
        rms_um = self.rms_mm * _UM_PER_MM
        head = f"{self.name} ({LI_NAMES[self.name]}): direct and integrated differ by {rms_um:.1f} µm rms"
        if self.p_value is None:
            return f"{head}; without uncertainties this cannot be judged"
        if self.follows:
            return (
                f"{head} ({p_words(self.p_value)}): the carriage follows its guideway's tangent as far as can be told"
            )
        return f"{head} ({p_words(self.p_value, 1)}): the carriage does not follow its guideway's tangent"


def without_slope(curve: Curve) -> tuple[Curve, Linear]:
    """Put straightness into the gauge: no least-squares slope over the range, then 0 at the first point.

    Returns
    -------
    curve
        In the gauge.
    slope
        What was taken away, mm/mm, one value.
    """
    gauged = without_line(curve.position_mm)
    # The line that was removed from each unit vector, from its rise over the range.
    removed = np.eye(len(gauged)) - gauged
    slope = (removed[-1] - removed[0]) / (curve.position_mm[-1] - curve.position_mm[0])
    return curve.transformed(gauged), curve.linear.transformed(slope[None])


def integrated(machine: Machine, axis: str, component: int, angle: Curve) -> Curve:
    """Integrate the angle that belongs to a straightness (Eq. 19 with its signs); in the gauge.

    Parameters
    ----------
    component
        Direction (0, 1, 2) of the straightness.
    angle
        The angle about the third direction, `angle_of(axis, component)`.
    """
    index = AXES.index(axis)
    sign = 1.0 if component == (index + 1) % 3 else -1.0
    if machine.side(axis) == "work":
        sign = -sign
    operator: Numbers = integrate_straightness(angle.position_mm, np.eye(len(angle.nodes)), rule="simpson").T
    return angle.transformed(sign * operator)


def angle_of(axis: str, component: int) -> int:
    """Give the direction of the rotation that goes with a straightness: the third one."""
    return 3 - AXES.index(axis) - component


def compare(
    name: str,
    direct: Curve,
    by_integral: Curve,
    covariance_of: Callable[[Linear], Numbers | None],
    between_mm2: Numbers,
) -> TangentVerdict | None:
    """Test direct against integrated straightness; None where they have fewer than three nodes in common.

    χ² of the difference with its own covariance (both come from the same points) and that of what the angle does
    between the nodes of the integral (`integral_covariance`), on as many degrees of freedom as they have rank.
    """
    both = np.intersect1d(direct.nodes, by_integral.nodes)
    if len(both) < 3:
        return None
    # On common nodes both are put into the gauge again, so that a missing end does not count as a disagreement.
    difference = without_slope(direct.on(both))[0].minus(without_slope(by_integral.on(both))[0], 1.0).linear
    covariance = covariance_of(difference)
    if covariance is not None:
        in_both = np.isin(by_integral.nodes, both)
        gauge = without_line(by_integral.position_mm[in_both])
        covariance = covariance + gauge @ between_mm2[np.ix_(in_both, in_both)] @ gauge.T
    return judged(name, difference.value, covariance)


def judged(name: str, difference_mm: Numbers, covariance_mm2: Numbers | None) -> TangentVerdict:
    """Judge a difference (n,) of direct and integrated straightness by its covariance (n, n), where that is known."""
    rms = float(np.sqrt(np.mean(difference_mm**2)))
    if covariance_mm2 is None:
        return TangentVerdict(name, rms, None, None)
    chi_squared, dof = squared_distance(difference_mm, covariance_mm2)
    if dof == 0:
        return TangentVerdict(name, rms, None, None)
    p_value = never_zero(float(chi_squared_sf(chi_squared, dof)))
    return TangentVerdict(name, rms, p_value, p_value >= _SIGNIFICANCE)
