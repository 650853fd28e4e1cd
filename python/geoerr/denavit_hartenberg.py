"""Machines written as Denavit–Hartenberg rows: from the rows to the order of the axes.

Rows go from the work to the tool, each `Rz(θ) Tz(d) Tx(a) Rx(α)`. A row may be a joint: its axis adds to `d` or
to `a`. The frame before the first row is the work's, and its axes are the machine's. From the rows follow

- the structural code: joints before the row that ends at the base carry the work, the others the tool;
- the tool point at x = y = z = 0, which becomes the machine's tool offset: at x = y = z = 0 all carriage
  origins are at the work's origin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeoerrError, InputFileError

Floats = npt.NDArray[np.float64]

# A joint may lean by so much: 1e-9 of a metre's travel is a nanometre, far above the rounding of sines of degrees.
_PARALLEL = 1e-9
_NUMBERS = {"theta": "theta_deg", "d": "d_mm", "a": "a_mm", "alpha": "alpha_deg"}
_KEYS = (*_NUMBERS, "joint", "variable", "sign", "base")
# What the keys that are no numbers may be.
_CHOICES: dict[str, tuple[tuple[Any, ...], str]] = {
    "joint": (("x", "y", "z"), "axes are x, y and z; leave it out in a row that stands still"),
    "variable": (("d", "a"), "an axis adds to d (along z) or to a (along x)"),
    "sign": ((1, -1), "write 1 where the coordinate adds, -1 where it subtracts"),
    "base": ((True, False), "write base = true in the row that ends at the base"),
}
_ROW_HINT = "write e.g. theta = -90.0, d = 0.0, a = 100.0, alpha = 180.0, in degrees and millimetres"


@dataclass(frozen=True)
class DhRow:
    """One row: `Rz(θ) Tz(d) Tx(a) Rx(α)`.

    Attributes
    ----------
    theta_deg, d_mm, a_mm, alpha_deg
        The four numbers.
    joint
        Axis that moves this row; None for a fixed one.
    variable
        Which number the axis adds to: `d` (along z) or `a` (along x).
    sign
        1 or -1: whether the axis's coordinate adds or subtracts.
    is_base
        Whether the frame at the end of this row stands on the machine's base.

    Raises
    ------
    GeoerrError
        for a joint, variable or sign that is none.
    """

    theta_deg: float = 0.0
    d_mm: float = 0.0
    a_mm: float = 0.0
    alpha_deg: float = 0.0
    joint: str | None = None
    variable: Literal["d", "a"] = "d"
    sign: Literal[1, -1] = 1
    is_base: bool = False

    def __post_init__(self) -> None:
        """Refuse words that are none here, and not where the rows are used."""
        for key in ("joint", "variable", "sign"):
            value, (allowed, remedy) = getattr(self, key), _CHOICES[key]
            if value not in allowed and not (key == "joint" and value is None):
                raise GeoerrError(f"{key} cannot be {value!r}\nhint: {remedy}")

    def transform(self, q_mm: float = 0.0, d_error_mm: float = 0.0, a_error_mm: float = 0.0) -> Floats:
        """Frame after the row in the frame before it, (4, 4); `q_mm` is its joint's coordinate."""
        moved = self.sign * q_mm if self.joint is not None else 0.0
        d = self.d_mm + d_error_mm + (moved if self.variable == "d" else 0.0)
        a = self.a_mm + a_error_mm + (moved if self.variable == "a" else 0.0)
        (ct, st), (ca, sa) = _cos_sin(self.theta_deg), _cos_sin(self.alpha_deg)
        return np.array(
            [
                [ct, -st * ca, st * sa, a * ct],
                [st, ct * ca, -ct * sa, a * st],
                [0.0, sa, ca, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )

    def to_document(self) -> dict[str, Any]:
        """Give the row as `[[dh]]` has it."""
        document: dict[str, Any] = {key: getattr(self, name) for key, name in _NUMBERS.items()}
        if self.joint is not None:
            document["joint"] = self.joint
            document["variable"] = self.variable
            document["sign"] = self.sign
        if self.is_base:
            document["base"] = True
        return document


def _cos_sin(degrees: float) -> tuple[float, float]:
    """Cosine and sine, exact at the quarter turns that machines are made of."""
    quarters, rest = divmod(degrees, 90.0)
    if rest == 0.0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters % 4)]
    return math.cos(math.radians(degrees)), math.sin(math.radians(degrees))


def tool_from_work(
    rows: Sequence[DhRow],
    q_mm: Mapping[str, float] | None = None,
    errors_mm: Mapping[int, tuple[float, float]] | None = None,
) -> Floats:
    """Tool frame in the work's frame, (4, 4): the product of all rows.

    Parameters
    ----------
    rows
        From work to tool.
    q_mm
        Axis to coordinate; 0 where absent.
    errors_mm
        Row (from 0) to what is added to its `d` and to its `a`.
    """
    product: Floats = np.eye(4)
    for index, row in enumerate(rows):
        d_error, a_error = (errors_mm or {}).get(index, (0.0, 0.0))
        product = product @ row.transform((q_mm or {}).get(row.joint or "", 0.0), d_error, a_error)
    return product


@dataclass(frozen=True)
class DhStructure:
    """What rows say about a machine: its structural code, and the tool point at x = y = z = 0 seen from the work."""

    chain: str
    tool_offset_mm: tuple[float, float, float]


def structure_of(rows: Sequence[DhRow], path: str | Path = "D-H rows") -> DhStructure:
    """Derive the structural code and the constant offsets from rows.

    Raises
    ------
    InputFileError
        for an axis without a row or with two, two bases, or an axis that does not move the tool along its own
        positive direction. `path` and the row (counted from 1) are named.
    """
    order = ""
    base: int | None = None
    frame: Floats = np.eye(4)
    joints: dict[str, int] = {}
    for number, row in enumerate(rows, start=1):
        if row.joint is not None:
            if row.joint in joints:
                raise InputFileError(
                    path,
                    f"axis {row.joint} moves rows {joints[row.joint]} and {number}",
                    column=f"dh[{number}].joint",
                    remedy="each of x, y and z moves one row",
                )
            joints[row.joint] = number
            _check_direction(frame, row, row.joint, f"dh[{number}]", path)
            order += row.joint.upper()
        frame = frame @ row.transform()
        if row.is_base:
            if base is not None:
                raise InputFileError(
                    path,
                    "a second row ends at the base",
                    column=f"dh[{number}].base",
                    remedy="say base = true in one row only",
                )
            base = len(order)
    missing = [axis for axis in "xyz" if axis not in joints]
    if missing:
        raise InputFileError(
            path,
            f"no row is moved by {missing[0]}",
            column="dh",
            remedy=f'say joint = "{missing[0]}" in the row that it moves',
        )
    x, y, z = (float(number) for number in frame[:3, 3])
    place = base or 0
    return DhStructure(f"w{order[:place]}b{order[place:]}t", (x, y, z))


def _check_direction(frame: Floats, row: DhRow, axis: str, place: str, path: str | Path) -> None:
    """Refuse a joint that does not move the tool along its own axis; `frame` is the one before the row."""
    cosine, sine = _cos_sin(row.theta_deg)
    along = row.sign * (frame[:3, 2] if row.variable == "d" else frame[:3, :3] @ np.array([cosine, sine, 0.0]))
    expected = np.eye(3)["xyz".index(axis)]
    if np.abs(along - expected).max() <= _PARALLEL:
        return
    if np.abs(along + expected).max() <= _PARALLEL:
        raise InputFileError(
            path,
            f"a growing {axis} moves the tool towards -{axis} of the work",
            column=f"{place}.sign",
            remedy=f"write sign = {-row.sign}: positive moves take the tool towards + of the work",
        )
    direction = ", ".join(f"{component:.6g}" for component in along)
    raise InputFileError(
        path,
        f"{axis} moves along ({direction}) of the work's frame, which is not its axis {axis}",
        column=f"{place}.joint",
        remedy='check theta and alpha of the rows before it, and variable = "d" (along z) or "a" (along x)',
    )


def rows_from_document(value: Any, path: str | Path) -> tuple[DhRow, ...]:
    """Read and check the `[[dh]]` tables.

    Raises
    ------
    InputFileError
        naming the row (counted from 1), the key and the remedy.
    """
    if not isinstance(value, list) or not value:
        raise InputFileError(path, "is not a list of tables", column="dh", remedy="write each row as [[dh]]")
    return tuple(_row_from_document(table, number, path) for number, table in enumerate(value, start=1))


def _row_from_document(table: Any, number: int, path: str | Path) -> DhRow:
    place = f"dh[{number}]"
    if not isinstance(table, dict):
        raise InputFileError(path, "is not a table", column=place, remedy="write each row as [[dh]]")
    unknown = [key for key in table if key not in _KEYS]
    if unknown:
        raise InputFileError(
            path, "unknown key", column=f"{place}.{unknown[0]}", remedy="a row has " + ", ".join(_KEYS)
        )
    numbers = {name: _number(table, key, place, path) for key, name in _NUMBERS.items()}
    for key, (allowed, remedy) in _CHOICES.items():
        entry = table.get(key, allowed[0])
        # A truth value is no number, though Python takes true for 1.
        if entry not in allowed or isinstance(entry, bool) != isinstance(allowed[0], bool):
            raise InputFileError(path, f"{entry!r} is not allowed", column=f"{place}.{key}", remedy=remedy)
    return DhRow(
        **numbers,
        joint=table.get("joint"),
        variable=table.get("variable", "d"),
        sign=1 if table.get("sign", 1) == 1 else -1,
        is_base=bool(table.get("base", False)),
    )


def _number(table: dict[str, Any], key: str, place: str, path: str | Path) -> float:
    if key not in table:
        raise InputFileError(path, "is missing", column=f"{place}.{key}", remedy=_ROW_HINT)
    entry = table[key]
    if isinstance(entry, bool) or not isinstance(entry, int | float) or not math.isfinite(entry):
        raise InputFileError(path, f"{entry!r} is not a number", column=f"{place}.{key}", remedy=_ROW_HINT)
    return float(entry)
