"""The model: where a machine with its errors really puts the tool, and what to command instead.

The kinematics are exact (full rotations, unit directions) and run in the core; here arrays are checked and names
and signs are translated. Signs and frames: errors are actual minus nominal of the tool as seen from the work.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.error_functions import (
    ALL_NAMES,
    LI_SQUARENESS,
    LINEAR_AND_ANGULAR,
    SQUARENESS,
    ErrorFunctions,
    errors_from_document,
    is_angular,
)
from geoerr.errors import GeoerrError, InputFileError, NotConvergedError, ShapeError
from geoerr.files import read_json
from geoerr.machine import AXES, Machine, read_machine

Numbers = npt.NDArray[np.float64]

ROLL = ("EAX", "EBY", "ECZ")
POSITIONING = ("EXX", "EYY", "EZZ")
GROUPS: dict[str, tuple[str, ...]] = {
    "positioning": POSITIONING,
    "straightness": tuple(n for n in LINEAR_AND_ANGULAR if not is_angular(n) and n not in POSITIONING),
    "angular": tuple(n for n in LINEAR_AND_ANGULAR if is_angular(n)),
    "pitch-yaw": tuple(n for n in LINEAR_AND_ANGULAR if is_angular(n) and n not in ROLL),
    "roll": ROLL,
    "squareness": SQUARENESS,
}

_STATUS = ("converged", "not converged", "not finite")


@dataclass(frozen=True)
class Commands:
    """Commands for a batch of wanted positions; row i belongs to position i.

    Attributes
    ----------
    command_mm : (n, 3)
        Axis positions to command; NaN where none was found.
    remaining_mm : (n,)
        Distance from the wanted position by the model: of the best command found where the iteration did not
        converge, NaN where the position is not finite.
    status : (n,) uint8
        0 converged, 1 not converged, 2 not finite.
    """

    command_mm: Numbers
    remaining_mm: Numbers
    status: npt.NDArray[np.uint8]

    @property
    def is_converged(self) -> npt.NDArray[np.bool_]:
        """Tell for each row whether its command is within the tolerance, (n,)."""
        return np.asarray(self.status == 0)


@dataclass(frozen=True, eq=False)
class Model:
    """A machine and its errors.

    Positions go in as (n, 3) in mm, and offsets as (3,) for all rows, (n, 3), or None for the point itself.
    Results do not depend on `threads` (0 = all cores).

    Attributes
    ----------
    machine
        The machine: its chain and tool offset.
    errors
        Its errors; None for the nominal machine. An error that is not determined counts as 0.

    Raises
    ------
    GeometryError
        where a table is not increasing or not finite, or no three axes have the squarenesses.
    """

    machine: Machine
    errors: ErrorFunctions | None = None

    def __post_init__(self) -> None:
        """Compile the model, so that bad errors are refused here and not at the first question."""
        _ = self._core

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by parts: the compiled machine stays behind and is made again."""
        return (Model, (self.machine, self.errors))

    @cached_property
    def _core(self) -> _core.MachineModel:
        """The compiled machine, as the core and the G-code binding take it."""
        functions = {} if self.errors is None else self.errors.functions
        tables = [
            (name, _contiguous(function.position_mm), _contiguous(function.value))
            for name, function in functions.items()
        ]
        return _core.MachineModel(
            self.machine.chain, self.machine.tool_offset_mm, squareness_of_li_rad(self.errors), tables
        )

    @property
    def is_nominal(self) -> bool:
        """Tell whether the machine has no errors: every table and every squareness is absent or 0."""
        return self._core.is_nominal

    @property
    def measured_range_mm(self) -> dict[str, tuple[float, float] | None]:
        """Give for each axis the range that all its error functions cover, None where there are none.

        A table with one entry is a constant and bounds nothing. Tables that do not overlap leave no range: the
        first number is then above the second, and nothing is inside.
        """
        ranges: dict[str, tuple[float, float] | None] = dict.fromkeys(AXES)
        for name, function in ({} if self.errors is None else self.errors.functions).items():
            if len(function.position_mm) < 2:
                continue
            axis = name[2].lower()
            low, high = ranges[axis] or (-np.inf, np.inf)
            ranges[axis] = (
                max(low, float(function.position_mm[0])),
                min(high, float(function.position_mm[-1])),
            )
        return ranges

    def knots_mm(self, axis: str) -> Numbers:
        """Give the positions (k,) of `x`, `y` or `z` where some error function has a kink, increasing."""
        return self._core.knots_mm(AXES.index(axis))

    def nominal_mm(self, q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None = None) -> Numbers:
        """Give where `tool_from_work` would be without errors, (n, 3): q + (tool offset + offset)."""
        rows = _points(q_mm, "q_mm")
        lever = np.asarray(self.machine.tool_offset_mm) + _offsets(offset_mm, len(rows))
        return np.asarray(rows + lever)

    def tool_from_work(
        self, q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None = None, *, threads: int = 0
    ) -> Numbers:
        """Give the position of a point on the tool seen from the work, by the exact chain.

        Parameters
        ----------
        q_mm : (n, 3)
            Commanded axis positions.
        offset_mm : (3,) or (n, 3)
            From the machine's tool point to the point, base axes; None for the tool point itself.

        Returns
        -------
        (n, 3)
            In mm; without errors exactly q + (tool offset + offset).

        Raises
        ------
        ShapeError
            where an array is not of this shape.

        Notes
        -----
        Li et al. 2023, Eqs. 6 to 8, with full rotations. Verified for all 24 chains against their first-order sums,
        against matrix products and against a second implementation with 40 digits.
        """
        rows = _points(q_mm, "q_mm")
        return self._core.tool_from_work(rows, _offsets(offset_mm, len(rows)), threads)

    def error_mm(self, q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None = None, *, threads: int = 0) -> Numbers:
        """Give actual minus nominal position of the same point, (n, 3), with all its digits."""
        rows = _points(q_mm, "q_mm")
        return self._core.error_mm(rows, _offsets(offset_mm, len(rows)), threads)

    def tool_from_base(
        self, q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None = None, *, threads: int = 0
    ) -> Numbers:
        """Give the position of a point on the tool in the base frame, (n, 3): what a camera on the floor sees.

        `offset_mm` as for `tool_from_work`. Only the axes on the tool side move the point.
        """
        rows = _points(q_mm, "q_mm")
        return self._core.tool_from_base(rows, _offsets(offset_mm, len(rows)), threads)

    def work_from_base(
        self, q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None = None, *, threads: int = 0
    ) -> Numbers:
        """Give the position of a point on the work in the base frame, (n, 3): what a camera on the floor sees.

        `offset_mm` counts from the base origin, at x = y = z = 0. Only the axes on the work side move the point.
        """
        rows = _points(q_mm, "q_mm")
        return self._core.work_from_base(rows, _offsets(offset_mm, len(rows)), threads)

    def jacobian(self, q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None = None, *, threads: int = 0) -> Numbers:
        """Give d tool_from_work / d q, (n, 3, 3): row by component, column by axis; right-hand at a kink."""
        rows = _points(q_mm, "q_mm")
        return self._core.jacobian(rows, _offsets(offset_mm, len(rows)), threads)

    def commands_for(self, p_mm: npt.ArrayLike, tolerance_mm: float = 1e-6, threads: int = 0) -> Numbers:
        """Give the commands that put the tool point where it should be: the inverse of `tool_from_work`.

        Parameters
        ----------
        p_mm : (n, 3)
            Wanted positions of the tool point seen from the work. For a program's axis positions q these are
            `nominal_mm(q)`: the same numbers where the machine has no tool offset.
        tolerance_mm
            Largest distance that may remain, by the model.

        Returns
        -------
        (n, 3)
            Axis positions to command.

        Raises
        ------
        NotConvergedError
            naming the first row without a command (`try_commands_for` does the other rows).
        ShapeError
            where the array is not of this shape.
        GeometryError
            where the tolerance is not a positive number.

        Notes
        -----
        Li et al. 2023, Eqs. 24 to 27, iterated.
        """
        commands = self.try_commands_for(p_mm, tolerance_mm, threads)
        failed = np.flatnonzero(~commands.is_converged)
        if failed.size:
            row = failed[0]
            what = _STATUS[commands.status[row]]
            left = "" if what == "not finite" else f", {commands.remaining_mm[row]:.3g} mm remain"
            others = f" (and {failed.size - 1} more)" if failed.size > 1 else ""
            raise NotConvergedError(
                f"no command puts the tool at position {row + 1}{others}: {what}{left}\n"
                "hint: check the errors for tables that change by more than a fifth of a millimetre a millimetre"
            )
        return commands.command_mm

    def try_commands_for(self, p_mm: npt.ArrayLike, tolerance_mm: float = 1e-6, threads: int = 0) -> Commands:
        """Do the same, row by row: a row without a command is NaN, has its status, and disturbs no other."""
        targets = _points(p_mm, "p_mm") - np.asarray(self.machine.tool_offset_mm)
        return Commands(*self._core.commands_for(targets, tolerance_mm, threads))

    def without(self, names: Iterable[str]) -> Model:
        """Give the model with some errors taken out (set to 0), for asking what they matter.

        Parameters
        ----------
        names
            ISO names (`ECX`, `EC0Y`) and groups: `positioning`, `straightness`, `angular`, `pitch-yaw`, `roll`,
            `squareness`.

        Raises
        ------
        GeoerrError
            for a name that is neither.
        """
        out: set[str] = set()
        for name in names:
            if name not in GROUPS and name not in ALL_NAMES:
                raise GeoerrError(
                    f"{name!r} is neither one of the 21 errors nor a group of them\n"
                    f"hint: groups are {', '.join(GROUPS)}; errors are named like ECX or EC0Y"
                )
            out.update(GROUPS.get(name, (name,)))
        if self.errors is None:
            return self
        kept = dataclasses.replace(
            self.errors,
            functions={name: f for name, f in self.errors.functions.items() if name not in out},
            squareness={name: s for name, s in self.errors.squareness.items() if name not in out},
        )
        return Model(self.machine, kept)


def squareness_of_li_rad(errors: ErrorFunctions | None) -> tuple[float, float, float]:
    """Give (S_xy, S_xz, S_yz), included angles minus 90°, from the ISO signs of `errors`; absent ones are 0."""
    li = dict.fromkeys(("S_xy", "S_xz", "S_yz"), 0.0)
    for name, squareness in ({} if errors is None else errors.squareness).items():
        symbol, sign = LI_SQUARENESS[name]
        li[symbol] = sign * squareness.value_rad
    return li["S_xy"], li["S_xz"], li["S_yz"]


def load_model(path: str | Path) -> Model:
    """Read what a command takes as MODEL: errors.json, or machine.toml for the nominal machine.

    The suffix tells which; where it is neither `.json` nor `.toml`, the first character does (JSON begins with `{`).

    Raises
    ------
    InputFileError
        for a file that is neither, or not as it should be.
    """
    if not _is_json(Path(path)):
        return Model(read_machine(path))
    document = read_json(path)
    if _is_fitted_model(document):
        raise InputFileError(
            path,
            "is a model.json, which this version cannot read",
            remedy="this version reads errors.json (from `geoerr identify`) and machine.toml",
        )
    errors = errors_from_document(document, path)
    return Model(errors.machine, errors)


def _is_json(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix in (".json", ".toml"):
        return suffix == ".json"
    try:
        with path.open("rb") as stream:
            return stream.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
    except OSError:
        # The reader says what is wrong with the file.
        return False


def _is_fitted_model(document: Any) -> bool:
    """Tell a model.json by what only it has: channels with their expressions."""
    if not isinstance(document, dict):
        return False
    schema = document.get("schema")
    return "channels" in document or (isinstance(schema, str) and schema.startswith("geoerr-model"))


def _contiguous(values: npt.ArrayLike) -> Numbers:
    return np.ascontiguousarray(values, dtype=np.float64)


def _points(values: npt.ArrayLike, name: str) -> Numbers:
    points = _as_numbers(values, name)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"{name} must be (n, 3), not {points.shape}")
    return points


def _offsets(values: npt.ArrayLike | None, n_rows: int) -> Numbers:
    """One row for all, or one a row."""
    if values is None:
        return np.zeros((1, 3))
    offsets = _as_numbers(values, "offset_mm")
    if offsets.shape == (3,):
        return offsets.reshape(1, 3)
    if offsets.shape != (n_rows, 3):
        raise ShapeError(f"offset_mm must be (3,) or ({n_rows}, 3), not {offsets.shape}")
    return offsets


def _as_numbers(values: npt.ArrayLike, name: str) -> Numbers:
    try:
        return _contiguous(values)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} is not an array of numbers: {error}") from error
