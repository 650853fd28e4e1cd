"""A virtual stereo pair: exact projection with lens distortion, and the exact way back.

Camera axes and the order of distortion coefficients (k1, k2, p1, p2, k3) are OpenCV's; pixel centres lie at whole
numbers. The code is the simulator's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeometryError
from geoerr.simulate.rotations import Array, rotation

_NEWTON_STEPS = 20
# Convergence is quadratic: after a step of 1e-6 the remaining error is of the order of 1e-12.
_LAST_STEP = 1e-6


@dataclass(frozen=True)
class Camera:
    """A pinhole with Brown-Conrady distortion, placed in the base frame.

    Attributes
    ----------
    size_px
        Width, height.
    focal_px, centre_px
        (fx, fy) and (cx, cy).
    distortion
        k1, k2, p1, p2, k3.
    camera_from_base
        (3, 3) rotation.
    centre_mm
        Centre of projection in the base frame.
    """

    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    camera_from_base: Array
    centre_mm: Array

    @property
    def matrix(self) -> Array:
        """Give K."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def in_camera_mm(self, points_mm: Array) -> Array:
        """Turn base coordinates (..., 3) into camera coordinates."""
        return np.asarray((points_mm - self.centre_mm) @ self.camera_from_base.T)

    def project(self, points_mm: Array) -> Array:
        """Project points (..., 3) of the base frame to pixels (..., 2); NaN behind the camera or beyond the lens."""
        place = self.in_camera_mm(points_mm)
        depth = place[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            ideal = place[..., :2] / depth[..., None]
        seen = (depth > 0) & (np.sum(ideal * ideal, axis=-1) < self._largest_radius**2)
        ideal = np.where(seen[..., None], ideal, np.nan)
        bent, _ = distort(ideal[..., 0], ideal[..., 1], self.distortion)
        return np.asarray(np.stack(bent, axis=-1) * np.asarray(self.focal_px) + np.asarray(self.centre_px))

    def ideal(self, u_px: Array, v_px: Array, start: tuple[Array, Array] | None = None) -> tuple[Array, Array, Array]:
        """Undistort pixels: ideal x, y (...) and the derivative of (x, y) by (u, v), (2, 2, ...).

        `start` is a guess of x and y; within 1e-6 it makes one step enough.
        Newton's method on the distortion itself, to the last digits; the derivative is good to 1e-6.

        Raises
        ------
        GeometryError
            where it does not converge: beyond the part of the picture in which the distortion is one to one.
        """
        fx, fy = self.focal_px
        bent_x = (u_px - self.centre_px[0]) / fx
        bent_y = (v_px - self.centre_px[1]) / fy
        x, y = (bent_x, bent_y) if start is None else start
        for _ in range(_NEWTON_STEPS):
            (at_x, at_y), (xx, xy, yy) = distort(x, y, self.distortion)
            scale = 1.0 / (xx * yy - xy * xy)
            off_x, off_y = bent_x - at_x, bent_y - at_y
            step_x = scale * (yy * off_x - xy * off_y)
            step_y = scale * (xx * off_y - xy * off_x)
            x, y = x + step_x, y + step_y
            if max(np.abs(step_x).max(), np.abs(step_y).max()) < _LAST_STEP:
                break
        # Beyond the fold of the polynomial are other roots: turned inside out, or on the far side of the centre.
        folded = np.min(scale) <= 0.0 or np.min(x * bent_x + y * bent_y) < -_LAST_STEP
        if folded or not max(np.abs(step_x).max(), np.abs(step_y).max()) < _LAST_STEP:
            raise GeometryError(
                "the lens distortion cannot be undone within the picture"
                "\nhint: choose smaller distortion coefficients"
            )
        derivative = np.empty((2, 2, *np.shape(x)))
        derivative[0, 0], derivative[0, 1] = scale * yy / fx, -scale * xy / fy
        derivative[1, 0], derivative[1, 1] = -scale * xy / fx, scale * xx / fy
        return x, y, derivative

    def sees(self, pixels: Array, margin_px: float = 0.0) -> npt.NDArray[np.bool_]:
        """Tell whether pixels (..., 2) lie in the picture, at least `margin_px` from its edge."""
        width, height = self.size_px
        u, v = pixels[..., 0], pixels[..., 1]
        inside = (u >= margin_px) & (v >= margin_px) & (u <= width - 1 - margin_px) & (v <= height - 1 - margin_px)
        return np.asarray(inside)

    def moved(self, shift_mm: Array, turn_rad: Array, about_mm: Array) -> Camera:
        """Give the camera after its stand has turned about a point and shifted (base axes)."""
        turn = rotation(turn_rad)
        return replace(
            self,
            camera_from_base=self.camera_from_base @ turn.T,
            centre_mm=about_mm + turn @ (self.centre_mm - about_mm) + shift_mm,
        )

    @cached_property
    def _largest_radius(self) -> float:
        """Give the ideal radius up to which points are projected: a little beyond the picture's farthest corner.

        Far outside the field of view the distortion polynomial folds back and would put things into the picture that
        no lens shows.
        """
        width, height = self.size_px
        u, v = np.meshgrid([0.0, width - 1.0], [0.0, height - 1.0])
        x, y, _ = self.ideal(u, v)
        radii = np.linspace(1.0, 1.2, 21) * np.sqrt((x * x + y * y).max())
        k1, k2, _, _, k3 = self.distortion
        rr = radii * radii
        growing = 1.0 + rr * (3.0 * k1 + rr * (5.0 * k2 + rr * 7.0 * k3)) > 0.0
        return float(radii[np.flatnonzero(np.logical_and.accumulate(growing))[-1]])


def distort(
    x: Array, y: Array, distortion: tuple[float, float, float, float, float]
) -> tuple[tuple[Array, Array], tuple[Array, Array, Array]]:
    """Distort ideal coordinates (Brown-Conrady).

    Returns
    -------
    bent
        Distorted x and y.
    derivative
        d(bent x)/dx, d(bent x)/dy = d(bent y)/dx, d(bent y)/dy: the distortion is the gradient of a potential.
    """
    k1, k2, p1, p2, k3 = distortion
    xx, yy, xy = x * x, y * y, x * y
    rr = xx + yy
    radial = 1.0 + rr * (k1 + rr * (k2 + rr * k3))
    twice_by_rr = 2.0 * k1 + rr * (4.0 * k2 + 6.0 * k3 * rr)
    bent_x = x * radial + 2.0 * p1 * xy + p2 * (rr + 2.0 * xx)
    bent_y = y * radial + p1 * (rr + 2.0 * yy) + 2.0 * p2 * xy
    tangential = 2.0 * (p1 * y + p2 * x)
    derivative = (
        radial + xx * twice_by_rr + tangential + 4.0 * p2 * x,
        xy * twice_by_rr + 2.0 * (p1 * x + p2 * y),
        radial + yy * twice_by_rr + tangential + 4.0 * p1 * y,
    )
    return (bent_x, bent_y), derivative


@dataclass(frozen=True)
class StereoPair:
    """Two cameras on one stand."""

    left: Camera
    right: Camera

    @property
    def middle_mm(self) -> Array:
        """Give the point halfway between the two centres of projection, base frame."""
        return np.asarray(0.5 * (self.left.centre_mm + self.right.centre_mm))

    @property
    def cameras(self) -> dict[str, Camera]:
        """Give both under their names."""
        return {"left": self.left, "right": self.right}

    @property
    def right_from_left(self) -> tuple[Array, Array]:
        """Give R (3, 3) and t in mm (3,): a point in the right camera's frame is R p + t."""
        turn = self.right.camera_from_base @ self.left.camera_from_base.T
        return turn, self.right.camera_from_base @ (self.left.centre_mm - self.right.centre_mm)

    def moved(self, shift_mm: Array, turn_rad: Array) -> StereoPair:
        """Give the pair after its stand has turned about the left camera's centre and shifted (base axes)."""
        about_mm = self.left.centre_mm
        return StereoPair(
            self.left.moved(shift_mm, turn_rad, about_mm), self.right.moved(shift_mm, turn_rad, about_mm)
        )
