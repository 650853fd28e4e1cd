"""The machine: its chain of axes, their ranges, its tool offset (`machine.toml`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from geoerr.errors import InputFileError
from geoerr.files import read_toml, write_text

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
    extra
        Keys of the file that geoerr does not know; kept when the file is written again.
    """

    name: str
    chain: str
    axes: dict[str, Axis]
    reference_temperature_degc: float = 20.0
    tool_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def work_axes(self) -> str:
        """Axes on the work side, from the base outwards, in lower case."""
        return self.chain[1 : self.chain.index("b")].lower()[::-1]

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
        return {
            "machine": {
                "name": self.name,
                "chain": self.chain,
                "reference_temperature": self.reference_temperature_degc,
                "tool_offset": list(self.tool_offset_mm),
            },
            "axes": axes,
            **self.extra,
        }


def read_machine(path: str | Path) -> Machine:
    """Read and check `machine.toml`; every refusal names the key and the remedy."""
    return machine_from_document(read_toml(path), path)


def write_machine(path: str | Path, machine: Machine) -> None:
    """Write `machine.toml`, whole or not at all."""
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
        raise InputFileError(path, "the table [machine] is missing", column="machine")
    chain = _checked_chain(head, path)
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
    offset = head.get("tool_offset", [0.0, 0.0, 0.0])
    numbers = _finite_numbers(offset, 3)
    if numbers is None:
        raise InputFileError(
            path,
            f"{offset!r} is not three numbers",
            column="machine.tool_offset",
            remedy="write millimetres as [0.0, 0.0, 0.0]",
        )
    temperature = head.get("reference_temperature", 20.0)
    if _finite_numbers([temperature], 1) is None:
        raise InputFileError(
            path, f"{temperature!r} is not a temperature in °C", column="machine.reference_temperature"
        )
    name = head.get("name", "machine")
    if not isinstance(name, str):
        raise InputFileError(path, f"{name!r} is not a text", column="machine.name")
    return Machine(
        name=name,
        chain=chain,
        axes=axes,
        reference_temperature_degc=float(temperature),
        tool_offset_mm=(numbers[0], numbers[1], numbers[2]),
        extra={key: value for key, value in document.items() if key not in ("machine", "axes")},
    )


_RANGE_HINT = "write e.g. [axes.x] range = [0.0, 400.0], in millimetres"
_CHAIN_HINT = "work to tool with b for the base and each of X, Y, Z once, for example wZbXYt"


def _checked_chain(head: dict[str, Any], path: str | Path) -> str:
    chain = head.get("chain")
    if not isinstance(chain, str):
        raise InputFileError(path, "the structural code is missing", column="machine.chain", remedy=_CHAIN_HINT)
    well_formed = chain.startswith("w") and chain.endswith("t") and sorted(chain[1:-1]) == sorted("XYZb")
    if not well_formed:
        raise InputFileError(path, f"{chain!r} is not a structural code", column="machine.chain", remedy=_CHAIN_HINT)
    return chain


def _checked_axis(table: Any, name: str, path: str | Path) -> Axis:
    column = f"axes.{name}.range"
    if not isinstance(table, dict) or "range" not in table:
        raise InputFileError(path, "the range is missing", column=column, remedy=_RANGE_HINT)
    limits = _finite_numbers(table["range"], 2)
    if limits is None or not limits[0] < limits[1]:
        raise InputFileError(
            path, f"{table['range']!r} is not a range from low to high", column=column, remedy=_RANGE_HINT
        )
    material = table.get("material")
    if material is not None and not isinstance(material, str):
        raise InputFileError(path, f"{material!r} is not a text", column=f"axes.{name}.material")
    return Axis(range_mm=(limits[0], limits[1]), material=material)


def _finite_numbers(value: Any, count: int) -> list[float] | None:
    if not isinstance(value, list) or len(value) != count:
        return None
    if any(isinstance(item, bool) or not isinstance(item, int | float) for item in value):
        return None
    numbers = [float(item) for item in value]
    return numbers if all(math.isfinite(item) for item in numbers) else None
