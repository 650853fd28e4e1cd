"""A second implementation of the kinematics with 40 digits: quaternions and points, no code of the first.

A carriage is a pose in the base: for each axis outwards the frame is moved and turned within the frame that carries
it. The work's pose is then taken off the tool point's place.
"""

from __future__ import annotations

import mpmath
import numpy as np
from mpmath import mp, mpf

from geoerr.error_functions import ErrorFunctions
from geoerr.machine import Machine

mp.dps = 40

Vector = list[mpf]
Quaternion = tuple[mpf, mpf, mpf, mpf]


def _product(p: Quaternion, q: Quaternion) -> Quaternion:
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def _turned(q: Quaternion, v: Vector) -> Vector:
    w, x, y, z = q
    return list(_product(_product(q, (mpf(0), v[0], v[1], v[2])), (w, -x, -y, -z))[1:])


def _quaternion(vector: Vector) -> Quaternion:
    angle = mpmath.sqrt(sum(c * c for c in vector))
    if angle == 0:
        return (mpf(1), mpf(0), mpf(0), mpf(0))
    s = mpmath.sin(angle / 2) / angle
    return (mpmath.cos(angle / 2), vector[0] * s, vector[1] * s, vector[2] * s)


class ExactMachine:
    """The machine of `errors` with arbitrary precision; `q` and offsets are sequences of three numbers."""

    def __init__(self, machine: Machine, errors: ErrorFunctions) -> None:
        self.machine = machine
        self.errors = errors
        ec, eb, ea = (mpf(errors.squareness[name].value_rad) for name in ("EC0Y", "EB0Z", "EA0Z"))
        # Included angles; ISO turns Z about y towards +x, which closes the angle of X and Z.
        cosines = [mpmath.cos(mpmath.pi / 2 + s) for s in (ec, -eb, ea)]
        y = [cosines[0], mpmath.sqrt(1 - cosines[0] ** 2), mpf(0)]
        z_y = (cosines[2] - cosines[1] * y[0]) / y[1]
        z = [cosines[1], z_y, mpmath.sqrt(1 - cosines[1] ** 2 - z_y**2)]
        self.directions = {"x": [mpf(1), mpf(0), mpf(0)], "y": y, "z": z}

    def _table(self, name: str, q: mpf) -> mpf:
        function = self.errors.functions[name]
        positions = [mpf(float(p)) for p in function.position_mm]
        values = [mpf(float(v)) for v in function.value]
        if q <= positions[0]:
            return values[0]
        for k in range(1, len(positions)):
            if q <= positions[k]:
                share = (q - positions[k - 1]) / (positions[k] - positions[k - 1])
                return values[k - 1] * (1 - share) + values[k] * share
        return values[-1]

    def _side(self, axes: str, sign: int, q: list[mpf]) -> tuple[Vector, Quaternion]:
        """Pose (origin, orientation) of the last carriage of a side in the base."""
        origin, orientation = [mpf(0)] * 3, _quaternion([mpf(0)] * 3)
        for axis in axes:
            at = q["xyz".index(axis)]
            delta = [self._table(f"E{d}{axis.upper()}", at) for d in "XYZ"]
            epsilon = [self._table(f"E{d}{axis.upper()}", at) for d in "ABC"]
            step = [sign * (at * a + d) for a, d in zip(self.directions[axis], delta, strict=True)]
            origin = [o + s for o, s in zip(origin, _turned(orientation, step), strict=True)]
            orientation = _product(orientation, _quaternion([sign * e for e in epsilon]))
        return origin, orientation

    def tool_from_base(self, q: list[mpf], offset: list[mpf]) -> Vector:
        origin, orientation = self._side(self.machine.tool_axes, 1, q)
        lever = [mpf(t) + o for t, o in zip(self.machine.tool_offset_mm, offset, strict=True)]
        return [o + p for o, p in zip(origin, _turned(orientation, lever), strict=True)]

    def work_from_base(self, q: list[mpf], offset: list[mpf]) -> Vector:
        origin, orientation = self._side(self.machine.work_axes, -1, q)
        return [o + p for o, p in zip(origin, _turned(orientation, offset), strict=True)]

    def tool_from_work(self, q: list[mpf], offset: list[mpf]) -> Vector:
        origin, (w, x, y, z) = self._side(self.machine.work_axes, -1, q)
        point = [p - o for p, o in zip(self.tool_from_base(q, offset), origin, strict=True)]
        return _turned((w, -x, -y, -z), point)

    def error(self, q: list[mpf], offset: list[mpf]) -> Vector:
        nominal = [a + mpf(t) + o for a, t, o in zip(q, self.machine.tool_offset_mm, offset, strict=True)]
        return [p - n for p, n in zip(self.tool_from_work(q, offset), nominal, strict=True)]

    def jacobian(self, q: list[mpf], offset: list[mpf]) -> list[list[mpf]]:
        """By central differences: with 40 digits and h = 1e-15 mm they are exact to 1e-24."""
        h = mpf("1e-15")
        columns = []
        for axis in range(3):
            plus, minus = list(q), list(q)
            plus[axis] += h
            minus[axis] -= h
            ends = zip(self.tool_from_work(plus, offset), self.tool_from_work(minus, offset), strict=True)
            columns.append([(p - m) / (2 * h) for p, m in ends])
        return [[columns[axis][row] for axis in range(3)] for row in range(3)]


def numbers(row: np.ndarray) -> list[mpf]:
    return [mpf(float(c)) for c in row]
