"""A small virtual machine for these tests: exact rotations, and nothing shared with the code under test.

A carriage's transform is [R(ε), q·â' + δ] on the tool side and [R(−ε), −q·â' − δ] on the work side, R the rotation by
the vector ε; each side is the product of its axes from the base outwards. Directions â': X the datum, Y in the XY
plane, included angles 90° + S exactly.

Errors are tables at the measured positions, in the gauge of docs/theory/gauge.md by construction: angles and
positioning are 0 at the first point; straightness has no least-squares slope (of the straight lines between its
points) and is 0 at the first point.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numpy.polynomial import Polynomial

from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

Numbers = npt.NDArray[np.float64]
AXES = "xyz"
TRANSLATION, ROTATION = "XYZ", "ABC"
LENGTH_MM = 400.0


def machine_of(chain: str, tool_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Machine:
    return Machine("test", chain, {axis: Axis((0.0, LENGTH_MM)) for axis in AXES}, tool_offset_mm=tool_offset_mm)


def rotation(vector: Numbers) -> Numbers:
    """Rodrigues' formula for one rotation vector."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def slope_of_polyline(q: Numbers, value: Numbers) -> float:
    """Least-squares slope of the straight lines between points, by Gauss quadrature of each (exact for cubics)."""
    middle, half = (q[1:] + q[:-1]) / 2.0, np.diff(q) / 2.0
    at = np.stack([middle - half / np.sqrt(3.0), middle + half / np.sqrt(3.0)])
    weight = np.stack([half, half])
    x = at - (q[0] + q[-1]) / 2.0
    return float(np.sum(weight * x * np.interp(at, q, value)) / np.sum(weight * x * x))


def gauged(q: Numbers, value: Numbers) -> Numbers:
    straight = value - slope_of_polyline(q, value) * q
    return straight - straight[0]


@dataclass
class Truth:
    """Errors as tables at `q_mm` of each axis, S in rad (included angle minus 90°)."""

    q_mm: dict[str, Numbers]
    tables: dict[str, Numbers]
    s_rad: dict[str, float] = field(default_factory=lambda: {"xy": 0.0, "xz": 0.0, "yz": 0.0})

    def three(self, letters: str, axis: str, q: float) -> Numbers:
        grid = self.q_mm[axis]
        return np.array([np.interp(q, grid, self.tables[f"E{letter}{axis.upper()}"]) for letter in letters])

    def directions(self) -> dict[str, Numbers]:
        s_xy, s_xz, s_yz = (np.sin(self.s_rad[pair]) for pair in ("xy", "xz", "yz"))
        y = np.array([-s_xy, np.sqrt(1.0 - s_xy**2), 0.0])
        z_y = (-s_yz - s_xy * s_xz) / y[1]
        z = np.array([-s_xz, z_y, np.sqrt(1.0 - s_xz**2 - z_y**2)])
        return {"x": np.array([1.0, 0.0, 0.0]), "y": y, "z": z}

    def iso(self) -> dict[str, float]:
        return {"EC0Y": self.s_rad["xy"], "EB0Z": -self.s_rad["xz"], "EA0Z": self.s_rad["yz"]}


def draw_truth(
    rng: np.random.Generator,
    chain: str,
    *,
    n_points: int = 9,
    follows_tangent: bool = True,
    angle_rad: float = 100e-6,
    delta_mm: float = 0.03,
    s_rad: float = 1e-3,
    q_mm: dict[str, Numbers] | None = None,
) -> Truth:
    """Angles are parabolas, so that straightness by the tangent is a cubic and Simpson's rule is exact."""
    grids = q_mm or {axis: np.linspace(0.0, LENGTH_MM, n_points) for axis in AXES}
    machine = machine_of(chain)
    tables: dict[str, Numbers] = {}
    for index, axis in enumerate(AXES):
        q = grids[axis]
        u = (q - q[0]) / (q[-1] - q[0])
        angles = {direction: Polynomial([0.0, *rng.uniform(-1.0, 1.0, 2)]) for direction in range(3)}
        for direction, shape in angles.items():
            tables[f"E{ROTATION[direction]}{axis.upper()}"] = angle_rad * shape(u)
        tables[f"E{TRANSLATION[index]}{axis.upper()}"] = delta_mm * Polynomial([0.0, *rng.uniform(-1, 1, 3)])(u)
        side = 1.0 if machine.side(axis) == "tool" else -1.0
        for component in ((index + 1) % 3, (index + 2) % 3):
            turn = 3 - index - component
            sign = side * (1.0 if component == (index + 1) % 3 else -1.0)
            height = sign * angle_rad * (q[-1] - q[0]) * angles[turn].integ()(u)
            if not follows_tangent:
                height = delta_mm * Polynomial(rng.uniform(-1.0, 1.0, 5))(2.0 * u - 1.0)
            tables[f"E{TRANSLATION[component]}{axis.upper()}"] = gauged(q, height)
    s = dict(zip(("xy", "xz", "yz"), rng.uniform(-s_rad, s_rad, 3), strict=True))
    return Truth(grids, tables, s)


def place(machine: Machine, truth: Truth, carrier: str, q: Numbers, offset: Numbers) -> Numbers:
    """Place of one target: in the base frame, for `relative` in the work's."""
    tool_point = np.asarray(machine.tool_offset_mm)
    if carrier == "base":
        return offset
    if carrier == "tool":
        return _carried(truth, machine.tool_axes, 1.0, q, tool_point + offset)
    if carrier == "work":
        return _carried(truth, machine.work_axes, -1.0, q, offset)
    tool = _carried(truth, machine.tool_axes, 1.0, q, tool_point + offset)
    origin = _carried(truth, machine.work_axes, -1.0, q, np.zeros(3))
    columns = [_carried(truth, machine.work_axes, -1.0, q, unit) - origin for unit in np.eye(3)]
    return np.column_stack(columns).T @ (tool - origin)


def _carried(truth: Truth, axes: str, sign: float, q: Numbers, point: Numbers) -> Numbers:
    directions = truth.directions()
    for axis in reversed(axes):
        own = float(q[AXES.index(axis)])
        step = sign * (own * directions[axis] + truth.three(TRANSLATION, axis, own))
        point = step + rotation(sign * truth.three(ROTATION, axis, own)) @ point
    return point


@dataclass
class Camera:
    """A measuring frame: measured = turn · place + shift."""

    turn: Numbers
    shift_mm: Numbers


def camera(rng: np.random.Generator) -> Camera:
    return Camera(rotation(rng.uniform(-2.0, 2.0, 3)), rng.uniform(-500.0, 500.0, 3))


@dataclass
class Move:
    """One axis moved with some targets in view."""

    axis: str
    carrier: str
    targets: dict[str, tuple[float, float, float]]
    parked_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    session: str = "0"
    repeat: int = 0
    q_mm: Numbers | None = None
    line: str = ""


FIXTURE = {"A": (0.0, 0.0, 0.0), "B": (150.0, 150.0, 0.0), "C": (0.0, 0.0, 200.0)}
BED = {"D": (0.0, 0.0, 0.0), "E": (0.0, 200.0, 0.0), "F": (200.0, 0.0, 0.0)}


def nine_lines(machine: Machine, **changes: object) -> list[Move]:
    """Nine lines of a floor camera: three targets in view of each move, on whichever body the axis moves."""
    moves = []
    for axis in AXES:
        carrier = machine.side(axis)
        targets = dict(BED if axis == "z" else FIXTURE)
        moves.append(Move(axis, carrier, targets, line=axis, **changes))  # type: ignore[arg-type]
    return moves


def li_nine_lines(machine: Machine) -> list[Move]:
    """Li's lines to the letter: one target, offset 200 mm, on lines 5 and 7 150 mm."""
    offsets = {
        "x": {"1": (0, 0, 0), "4": (0, 0, 200), "5": (0, 150, 0)},
        "y": {"2": (0, 0, 0), "6": (0, 0, 200), "7": (150, 0, 0)},
        "z": {"3": (0, 0, 0), "8": (0, 200, 0), "9": (200, 0, 0)},
    }
    return [
        Move(axis, machine.side(axis), {f"T{number}": offset}, line=f"line {number}")  # type: ignore[dict-item]
        for axis, targets in offsets.items()
        for number, offset in targets.items()
    ]


def observe(
    machine: Machine,
    truth: Truth,
    moves: list[Move],
    cameras: dict[str, Camera],
    *,
    covariance_mm2: Numbers | None = None,
    rng: np.random.Generator | None = None,
    order: Numbers | None = None,
    is_stated: bool = True,
) -> Observations:
    """Measure, one row a target and position; with `rng`, noise of `covariance_mm2` (3, 3), which is stated."""
    columns: dict[str, list[object]] = {name: [] for name in _COLUMNS}
    for move in moves:
        grid = truth.q_mm[move.axis] if move.q_mm is None else move.q_mm
        for position in grid:
            q = np.array(move.parked_mm)
            q[AXES.index(move.axis)] = position
            for name, offset in move.targets.items():
                at = place(machine, truth, move.carrier, q, np.array(offset))
                seen = cameras[move.session].turn @ at + cameras[move.session].shift_mm
                values = (move.line, move.session, move.repeat, move.carrier, name, *q, *offset, *seen)
                for column, value in zip(_COLUMNS, values, strict=True):
                    columns[column].append(value)
    if rng is not None and covariance_mm2 is not None:
        noise = rng.multivariate_normal(np.zeros(3), covariance_mm2, size=len(columns["x"]))
        for index, name in enumerate(("mx", "my", "mz")):
            columns[name] = list(np.asarray(columns[name]) + noise[:, index])
    if covariance_mm2 is not None and is_stated:
        for name, (i, j) in {
            "cxx": (0, 0),
            "cxy": (0, 1),
            "cxz": (0, 2),
            "cyy": (1, 1),
            "cyz": (1, 2),
            "czz": (2, 2),
        }.items():
            columns[name] = [covariance_mm2[i, j]] * len(columns["x"])
    if order is not None:
        columns = {name: [values[int(row)] for row in order] for name, values in columns.items()}
    texts = {"line", "session", "carrier", "target"}
    return observations_from_columns(
        {
            name: [str(v) for v in values] if name in texts else np.asarray(values, dtype=np.float64)
            for name, values in columns.items()
        }
    )


_COLUMNS = ("line", "session", "repeat", "carrier", "target", "x", "y", "z", "tx", "ty", "tz", "mx", "my", "mz")
