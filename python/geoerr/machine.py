"""The machine: its chain of axes, their ranges, its tool offset (`machine.toml`)."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from geoerr.denavit_hartenberg import DhRow, rows_from_document, structure_of
from geoerr.errors import GeometryError, InputFileError
from geoerr.files import check_written, read_toml, write_text
from geoerr.spelling import slip_in
from geoerr.summaries import facts_html, span_text, summary_html, table_html

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Axis:
    """One linear axis: `range_mm` (low, high) of its commanded coordinate; `material` of its scale or screw."""

    range_mm: tuple[float, float]
    material: str | None = None

    @property
    def length_mm(self) -> float:
        """Travel of the axis."""
        return self.range_mm[1] - self.range_mm[0]


@dataclass(frozen=True)
class Machine:
    """A three-axis machine.

    A machine that nobody listed is one line: `Machine.from_chain("wYbZXt", travel_mm=(400, 300, 250))`, or
    `Machine.from_dh(rows, travel_mm=...)` from Denavit–Hartenberg rows.

    Attributes
    ----------
    name
        Free text.
    chain
        Structural code from work to tool, `b` the base: Li's printer is `wZbXYt`.
    axes
        `x`, `y`, `z` to `Axis`.
    reference_temperature_degc
        Temperature at which lengths are true (ISO 1: 20 °C).
    tool_offset_mm
        Carriage origin to tool point, base axes.
    dh
        The D-H rows that the machine was given as, work to tool; `chain` and `tool_offset_mm` follow from them.
    extra
        Keys of the file that geoerr does not know; kept when the file is written again.
    """

    name: str
    chain: str
    axes: dict[str, Axis]
    reference_temperature_degc: float = 20.0
    tool_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    extra: dict[str, Any] = field(default_factory=dict)
    dh: tuple[DhRow, ...] = ()

    @classmethod
    def from_chain(
        cls,
        chain: str,
        travel_mm: Sequence[float],
        *,
        low_mm: Sequence[float] = (0.0, 0.0, 0.0),
        tool_offset_mm: Sequence[float] = (0.0, 0.0, 0.0),
        name: str = "machine",
    ) -> Machine:
        """Make a machine from its structural code.

        Parameters
        ----------
        chain
            Work to tool, `b` the base: `wbXYZt` is a gantry mill, `wXYbZt` a knee mill; any of the 24 orders.
        travel_mm, low_mm
            Length of travel and lowest coordinate of x, y, z.
        tool_offset_mm
            Carriage origin to tool point.
        name
            Free text.

        Raises
        ------
        GeometryError
            for what is no structural code, or a travel that is not positive.
        """
        return cls(
            name=name,
            chain=checked_chain(chain),
            axes=_axes_of_travel(travel_mm, low_mm),
            tool_offset_mm=_three(tool_offset_mm, "tool_offset_mm"),
        )

    @classmethod
    def from_dh(
        cls,
        rows: Sequence[DhRow],
        travel_mm: Sequence[float],
        *,
        low_mm: Sequence[float] = (0.0, 0.0, 0.0),
        name: str = "machine",
    ) -> Machine:
        """Make a machine from Denavit–Hartenberg rows, work to tool (`geoerr.denavit_hartenberg`).

        `travel_mm`, `low_mm`, `name` as in `from_chain`.

        Raises
        ------
        InputFileError
            for rows that are not a machine of three axes: the row is named.
        GeometryError
            for a travel that is not positive.
        """
        structure = structure_of(rows)
        axes = _axes_of_travel(travel_mm, low_mm)
        return cls(name, structure.chain, axes, tool_offset_mm=structure.tool_offset_mm, dh=tuple(rows))

    def _repr_html_(self) -> str:
        """Show its order of axes and their ranges, for a notebook."""
        rows = [
            (name, span_text(*axis.range_mm), f"{axis.length_mm:g}", axis.material or "–")
            for name, axis in self.axes.items()
        ]
        offset = ", ".join(f"{value:g}" for value in self.tool_offset_mm)
        facts = {
            "axes, work to tool": self.chain,
            "tool offset, mm": offset,
            "reference temperature": f"{self.reference_temperature_degc:g} °C",
        }
        table = table_html(("axis", "range, mm", "travel, mm", "material"), rows)
        return summary_html(self.name, facts_html(facts), table)

    @property
    def work_axes(self) -> str:
        """Axes on the work side, from the base outwards, in lower case."""
        return self.chain[1 : self.chain.index("b")].lower()[::-1]

    @property
    def ranges_mm(self) -> dict[str, tuple[float, float]]:
        """Axis to its range."""
        return {name: axis.range_mm for name, axis in self.axes.items()}

    @property
    def tool_axes(self) -> str:
        """Axes on the tool side, from the base outwards, in lower case."""
        return self.chain[self.chain.index("b") + 1 : -1].lower()

    def side(self, axis: str) -> str:
        """`tool` or `work`: the side of the base that carries `axis`."""
        return "tool" if axis in self.tool_axes else "work"

    def to_document(self) -> dict[str, Any]:
        """Give the content of `machine.toml` as plain values, for TOML and for errors.json."""
        axes: dict[str, Any] = {}
        for name in AXES:
            axis = self.axes[name]
            axes[name] = {"range": list(axis.range_mm)}
            if axis.material is not None:
                axes[name]["material"] = axis.material
        head: dict[str, Any] = {"name": self.name}
        if not self.dh:
            head["chain"] = self.chain
        head["reference_temperature"] = self.reference_temperature_degc
        if not self.dh:
            head["tool_offset"] = list(self.tool_offset_mm)
        rows = {"dh": [row.to_document() for row in self.dh]} if self.dh else {}
        return {"machine": head, "axes": axes, **rows, **self.extra}


def read_machine(path: str | Path) -> Machine:
    """Read and check `machine.toml`; every refusal names the key and the remedy."""
    return machine_from_document(read_toml(path), path)


def write_machine(path: str | Path, machine: Machine) -> None:
    """Write `machine.toml`, whole or not at all."""
    check_written(path, machine, Machine, "write_machine(path, machine)")
    write_text(path, tomli_w.dumps(machine.to_document()))


def machine_from_document(document: Any, path: str | Path) -> Machine:
    """Check the content of a `machine.toml` (or of the `machine` key of errors.json).

    Raises
    ------
    InputFileError
        for a missing or malformed key; `path` is named in the message.
    """
    if not isinstance(document, dict):
        raise InputFileError(path, "holds no machine description", column="machine")
    head = document.get("machine")
    if not isinstance(head, dict):
        raise InputFileError(
            path,
            "the table [machine] is missing",
            column="machine",
            remedy='write [machine] with its structural code, for example chain = "wZbXYt"',
        )
    _refuse_slips(head, _KEYS, "machine", path)
    rows = rows_from_document(document["dh"], path) if "dh" in document else ()
    axes_document = document.get("axes")
    if not isinstance(axes_document, dict):
        raise InputFileError(
            path, "the tables [axes.x], [axes.y], [axes.z] are missing", column="axes", remedy=_RANGE_HINT
        )
    axes = {name: _checked_axis(axes_document.get(name), name, path) for name in AXES}
    unknown = sorted(set(axes_document) - set(AXES))
    if unknown:
        raise InputFileError(
            path, f"unknown axis {unknown[0]!r}", column=f"axes.{unknown[0]}", remedy="axes are x, y and z"
        )
    chain, tool_offset_mm = _checked_structure(head, rows, path)
    temperature = head.get("reference_temperature", 20.0)
    if _finite_numbers([temperature], 1) is None:
        raise InputFileError(
            path,
            f"{temperature!r} is not a temperature in °C",
            column="machine.reference_temperature",
            remedy="write a number, such as 20.0",
        )
    name = head.get("name", "machine")
    if not isinstance(name, str):
        raise InputFileError(path, f"{name!r} is not a text", column="machine.name", remedy=_TEXT_HINT)
    return Machine(
        name=name,
        chain=chain,
        axes=axes,
        reference_temperature_degc=float(temperature),
        tool_offset_mm=tool_offset_mm,
        extra={key: value for key, value in document.items() if key not in ("machine", "axes", "dh")},
        dh=rows,
    )


_KEYS = ("name", "chain", "reference_temperature", "tool_offset")
_AXIS_KEYS = ("range", "material")
_RANGE_HINT = "write e.g. [axes.x] range = [0.0, 400.0], in millimetres"
_TEXT_HINT = "write it in quotes"
_CHAIN_HINT = "work to tool with b for the base and each of X, Y, Z once, for example wZbXYt"


def _is_chain(chain: str) -> bool:
    return chain.startswith("w") and chain.endswith("t") and sorted(chain[1:-1]) == sorted("XYZb")


def checked_chain(chain: str) -> str:
    """Give a structural code back as it is.

    Raises
    ------
    GeometryError
        for a text that is none.
    """
    if not isinstance(chain, str) or not _is_chain(chain):
        raise GeometryError(f"{chain!r} is not a structural code: {_CHAIN_HINT}")
    return chain


def _checked_structure(
    head: dict[str, Any], rows: tuple[DhRow, ...], path: str | Path
) -> tuple[str, tuple[float, float, float]]:
    """Structural code and tool offset: as written, or as the D-H rows have them."""
    chain, offset = head.get("chain"), head.get("tool_offset", [0.0, 0.0, 0.0])
    numbers = _finite_numbers(offset, 3)
    if numbers is None:
        raise InputFileError(
            path,
            f"{offset!r} is not three numbers",
            column="machine.tool_offset",
            remedy="write millimetres as [0.0, 0.0, 0.0]",
        )
    if not rows:
        if chain is None:
            raise InputFileError(
                path,
                "the structural code is missing",
                column="machine.chain",
                remedy=_CHAIN_HINT + "; or give [[dh]] rows",
            )
        if not isinstance(chain, str) or not _is_chain(chain):
            raise InputFileError(
                path, f"{chain!r} is not a structural code", column="machine.chain", remedy=_CHAIN_HINT
            )
        return chain, (numbers[0], numbers[1], numbers[2])
    structure = structure_of(rows, path)
    if chain not in (None, structure.chain):
        raise InputFileError(
            path,
            f"{chain!r}, but the rows of [[dh]] are {structure.chain}",
            column="machine.chain",
            remedy="leave chain out, or say base = true in the row that ends at the base",
        )
    if any(numbers):
        raise InputFileError(
            path,
            "a tool offset beside [[dh]] rows, which end at the tool point",
            column="machine.tool_offset",
            remedy="leave tool_offset out and add it to the last rows",
        )
    return structure.chain, structure.tool_offset_mm


def _axes_of_travel(travel_mm: Sequence[float], low_mm: Sequence[float]) -> dict[str, Axis]:
    travel, low = _three(travel_mm, "travel_mm"), _three(low_mm, "low_mm")
    if min(travel) <= 0.0:
        raise GeometryError(f"travel_mm is {travel}: each axis needs a positive length of travel")
    return {name: Axis((at, at + length)) for name, at, length in zip(AXES, low, travel, strict=True)}


def _three(numbers: Sequence[float], name: str) -> tuple[float, float, float]:
    checked = [float(number) for number in numbers]
    if len(checked) != 3 or not all(math.isfinite(number) for number in checked):
        raise GeometryError(f"{name} is {tuple(numbers)}: it must be three numbers, for x, y and z")
    return checked[0], checked[1], checked[2]


def _checked_axis(table: Any, name: str, path: str | Path) -> Axis:
    column = f"axes.{name}.range"
    if not isinstance(table, dict) or "range" not in table:
        raise InputFileError(path, "the range is missing", column=column, remedy=_RANGE_HINT)
    _refuse_slips(table, _AXIS_KEYS, f"axes.{name}", path)
    limits = _finite_numbers(table["range"], 2)
    if limits is None or not limits[0] < limits[1]:
        raise InputFileError(
            path, f"{table['range']!r} is not a range from low to high", column=column, remedy=_RANGE_HINT
        )
    material = table.get("material")
    if material is not None and not isinstance(material, str):
        raise InputFileError(path, f"{material!r} is not a text", column=f"axes.{name}.material", remedy=_TEXT_HINT)
    return Axis(range_mm=(limits[0], limits[1]), material=material)


def _refuse_slips(table: dict[str, Any], known: Collection[str], place: str, path: str | Path) -> None:
    """Refuse a key that is an absent one misspelled, which would count for nothing; others are the user's own."""
    slip = slip_in(table, known)
    if slip is not None:
        key, word = slip
        raise InputFileError(
            path,
            f"is no key of this table (did you mean {word}?)",
            column=f"{place}.{key}",
            remedy="correct the spelling",
        )


def _finite_numbers(value: Any, count: int) -> list[float] | None:
    if not isinstance(value, list) or len(value) != count:
        return None
    if any(isinstance(item, bool) or not isinstance(item, int | float) for item in value):
        return None
    numbers = [float(item) for item in value]
    return numbers if all(math.isfinite(item) for item in numbers) else None
