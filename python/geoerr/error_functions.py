"""The 21 geometric errors as tables (`errors.json`).

Names are ISO 230-1: `E`, direction (X Y Z translation, A B C rotation about x y z), moving axis;
Li's δ_yx is EYX, his ε_zx is ECX. Errors are actual minus nominal of the tool as seen from the work,
for every axis, whichever side carries it; translations are those of the carriage origin (l = 0).
Between table positions a function is the straight line between its neighbours; outside the table it
keeps its end value.

Squareness has ISO signs here: S_xy = +EC0Y, S_xz = −EB0Z, S_yz = +EA0Z, where S is the included angle of the
two axes' positive directions minus 90° (Li §4.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from geoerr.drawing import drawn
from geoerr.errors import InputFileError
from geoerr.files import check_written, read_json, write_json
from geoerr.machine import AXES, Machine, machine_from_document
from geoerr.summaries import number_text, sentences_html, summary_html, table_html

if TYPE_CHECKING:
    import plotly.graph_objects as go

SCHEMA = "geoerr-errors/1"

TRANSLATIONS = ("X", "Y", "Z")
ROTATIONS = ("A", "B", "C")
LINEAR_AND_ANGULAR: tuple[str, ...] = tuple(
    f"E{direction}{axis.upper()}" for axis in AXES for direction in TRANSLATIONS + ROTATIONS
)
SQUARENESS = ("EC0Y", "EB0Z", "EA0Z")
ALL_NAMES = LINEAR_AND_ANGULAR + SQUARENESS

# Sign that turns an ISO squareness into Li's S (included angle minus 90°).
LI_SQUARENESS: Mapping[str, tuple[str, float]] = {
    "EC0Y": ("S_xy", 1.0),
    "EB0Z": ("S_xz", -1.0),
    "EA0Z": ("S_yz", 1.0),
}
LI_NAMES: Mapping[str, str] = {
    **{
        f"E{direction}{axis.upper()}": f"{symbol}_{'xyz'[index]}{axis}"
        for axis in AXES
        for symbol, directions in (("δ", TRANSLATIONS), ("ε", ROTATIONS))
        for index, direction in enumerate(directions)
    },
    "EC0Y": "S_xy",
    "EB0Z": "−S_xz",
    "EA0Z": "S_yz",
}

_MICRO = 1e6
_UM_PER_MM = 1e3


def is_angular(name: str) -> bool:
    """Tell whether an ISO name is a rotation (table in µrad) rather than a translation (µm)."""
    return name[1] in ROTATIONS


@dataclass(frozen=True, eq=False)
class ErrorFunction:
    """One error of one axis as a table.

    Attributes
    ----------
    position_mm : (n,)
        Commanded positions of the moving axis, strictly increasing.
    value : (n,)
        mm for a translation, rad for a rotation.
    std : (n,) or None
        Standard uncertainty in the same unit; None where nothing is known of it.
    """

    position_mm: npt.NDArray[np.float64]
    value: npt.NDArray[np.float64]
    std: npt.NDArray[np.float64] | None = None

    def at(self, position_mm: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Interpolate by straight lines; the end values hold outside the table."""
        return np.interp(np.asarray(position_mm, dtype=np.float64), self.position_mm, self.value)


@dataclass(frozen=True)
class Squareness:
    """One squareness in ISO sign, with its standard uncertainty (None: unknown)."""

    value_rad: float
    std_rad: float | None = None


@dataclass(frozen=True)
class NotDetermined:
    """One of the 21 that the data cannot see, and why."""

    name: str
    why: str


@dataclass(frozen=True)
class ErrorFunctions:
    """The 21 errors of one machine, as far as they are determined.

    Attributes
    ----------
    machine
        The machine they belong to.
    functions
        ISO name to table, for the determined ones of the 18.
    squareness
        ISO name to value, for the determined ones of the 3.
    method
        How they were found: `nine-line`, `truth`, ...
    not_determined
        What is absent from the two and why. It is not zero: it is unknown.
    alternatives
        Other estimates of the same functions by name, e.g. `straightness-integrated`.
    notes
        Sentences for the reader.
    data_digest
        SHA-256 of the measurements that they were found from (`geoerr.fit.digest_of`); empty where nobody wrote it.
    extra
        Further keys of the file, kept when it is written again (`hidden` of a truth.json).
    """

    machine: Machine
    functions: dict[str, ErrorFunction]
    squareness: dict[str, Squareness]
    method: str
    not_determined: tuple[NotDetermined, ...] = ()
    alternatives: dict[str, dict[str, ErrorFunction | Squareness]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    data_digest: str = ""
    extra: dict[str, Any] = field(default_factory=dict)

    def to_document(self) -> dict[str, Any]:
        """Give the content of errors.json as plain values, in µm and µrad."""
        document: dict[str, Any] = {
            "schema": SCHEMA,
            "machine": self.machine.to_document(),
            "method": self.method,
            "errors": _tables_to_document({**self.functions, **self.squareness}),
            "alternatives": {name: _tables_to_document(tables) for name, tables in self.alternatives.items()},
            "not_determined": [{"name": item.name, "why": item.why} for item in self.not_determined],
        }
        if self.notes:
            document["notes"] = list(self.notes)
        if self.data_digest:
            document["data"] = {"digest": self.data_digest}
        return {**document, **self.extra}

    def plot_errors(self, truth: ErrorFunctions | None = None) -> go.Figure:
        """Draw the 21 errors with their 95 % bands, beside the truth of a simulation where there is one."""
        return drawn("error_curves", self, truth)

    def plot_nine_lines(self) -> go.Figure:
        """Draw ΔL of Li's nine lines, as these errors make it."""
        return drawn("nine_lines", self)

    def _repr_html_(self) -> str:
        """Show the size of each error, and what is not determined, for a notebook."""
        rows = []
        for name in LINEAR_AND_ANGULAR:
            found = self.functions.get(name)
            unit, factor = ("µrad", _MICRO) if is_angular(name) else ("µm", _UM_PER_MM)
            if found is not None:
                rows.append((name, LI_NAMES[name], f"{number_text(float(np.ptp(found.value)) * factor, 1)} {unit}"))
        for name in SQUARENESS:
            one = self.squareness.get(name)
            if one is not None:
                rows.append((name, LI_NAMES[name], f"{number_text(one.value_rad * _MICRO, 1)} µrad"))
        unknown = [(item.name, item.why) for item in self.not_determined]
        return summary_html(
            "The 21 errors",
            sentences_html(f"{self.machine.name}, {self.machine.chain}; method {self.method}"),
            table_html(("error", "Li", "peak to peak, or squareness"), rows),
            table_html(("not determined", "why"), unknown),
        )


def write_errors(path: str | Path, errors: ErrorFunctions) -> None:
    """Write errors.json, whole or not at all."""
    check_written(path, errors, ErrorFunctions, "write_errors(path, errors)")
    write_json(path, errors.to_document())


def read_errors(path: str | Path) -> ErrorFunctions:
    """Read and check errors.json; every refusal names the key and the place in its table."""
    return errors_from_document(read_json(path), path)


def errors_from_document(document: Any, path: str | Path) -> ErrorFunctions:
    """Check the content of an errors.json.

    Raises
    ------
    InputFileError
        for a missing or malformed part; `path` is named in the message.
    """
    if not isinstance(document, dict) or not isinstance(document.get("errors"), dict):
        raise InputFileError(
            path,
            "the key 'errors' is missing",
            column="errors",
            remedy="give an errors.json as written by `geoerr identify`",
        )
    schema = document.get("schema", SCHEMA)
    if schema != SCHEMA:
        raise InputFileError(
            path,
            f"schema {schema!r} is not known to this version, which reads {SCHEMA!r}",
            column="schema",
            remedy="update geoerr, or write the file again with this version",
        )
    machine = machine_from_document(document.get("machine"), path)
    functions, squareness = _read_tables(document["errors"], "errors", path)
    alternatives: dict[str, dict[str, ErrorFunction | Squareness]] = {}
    for name, tables in _as_dict(document.get("alternatives", {}), "alternatives", path).items():
        other_functions, other_squareness = _read_tables(
            _as_dict(tables, f"alternatives.{name}", path), f"alternatives.{name}", path
        )
        alternatives[name] = {**other_functions, **other_squareness}
    known = {"schema", "machine", "method", "errors", "alternatives", "not_determined", "notes", "data"}
    return ErrorFunctions(
        machine=machine,
        functions=functions,
        squareness=squareness,
        method=str(document.get("method", "unknown")),
        not_determined=_read_not_determined(document.get("not_determined", []), path),
        alternatives=alternatives,
        notes=tuple(str(note) for note in document.get("notes", [])),
        data_digest=_read_digest(_as_dict(document.get("data", {}), "data", path), path),
        extra={key: value for key, value in document.items() if key not in known},
    )


def _read_digest(data: dict[str, Any], path: str | Path) -> str:
    digest = data.get("digest", "")
    if not isinstance(digest, str):
        raise InputFileError(
            path, f"{digest!r} is no digest", column="data.digest", remedy="leave `data` out, or identify again"
        )
    return digest


def _tables_to_document(tables: Mapping[str, ErrorFunction | Squareness]) -> dict[str, Any]:
    document: dict[str, Any] = {}
    for name in ALL_NAMES:
        table = tables.get(name)
        if isinstance(table, Squareness):
            document[name] = {
                "value_urad": table.value_rad * _MICRO,
                "std_urad": None if table.std_rad is None else table.std_rad * _MICRO,
            }
        elif table is not None:
            unit, factor = _unit(name)
            document[name] = {
                "position_mm": table.position_mm.tolist(),
                f"value_{unit}": (table.value * factor).tolist(),
                f"std_{unit}": None if table.std is None else (table.std * factor).tolist(),
            }
    return document


def _unit(name: str) -> tuple[str, float]:
    return ("urad", _MICRO) if is_angular(name) else ("um", _UM_PER_MM)


def _read_tables(
    tables: dict[str, Any], where: str, path: str | Path
) -> tuple[dict[str, ErrorFunction], dict[str, Squareness]]:
    functions: dict[str, ErrorFunction] = {}
    squareness: dict[str, Squareness] = {}
    for name, table in tables.items():
        place = f"{where}.{name}"
        if name not in ALL_NAMES:
            raise InputFileError(
                path,
                f"{name!r} is not one of the 21 errors",
                column=place,
                remedy=f"ISO 230-1 names: {', '.join(ALL_NAMES[:6])}, ... {', '.join(SQUARENESS)}",
            )
        content = _as_dict(table, place, path)
        if name in SQUARENESS:
            value = _numbers([content.get("value_urad")], f"{place}.value_urad", path)
            std = content.get("std_urad")
            checked = None if std is None else float(_numbers([std], f"{place}.std_urad", path)[0]) / _MICRO
            squareness[name] = Squareness(float(value[0]) / _MICRO, checked)
        else:
            functions[name] = _read_function(content, name, place, path)
    return functions, squareness


def _read_function(content: dict[str, Any], name: str, place: str, path: str | Path) -> ErrorFunction:
    unit, factor = _unit(name)
    position = _numbers(content.get("position_mm"), f"{place}.position_mm", path)
    value = _numbers(content.get(f"value_{unit}"), f"{place}.value_{unit}", path)
    if len(position) < 1 or len(position) != len(value):
        raise InputFileError(
            path,
            f"{len(position)} positions and {len(value)} values",
            column=place,
            remedy="give one value for each position, and at least one",
        )
    falling = np.flatnonzero(np.diff(position) <= 0)
    if falling.size:
        raise InputFileError(
            path,
            f"entry {falling[0] + 2} ({position[falling[0] + 1]}) does not lie above the one before it",
            column=f"{place}.position_mm",
            remedy="sort the table by position and merge repeated positions",
        )
    std_content = content.get(f"std_{unit}")
    std = None
    if std_content is not None:
        std = _numbers(std_content, f"{place}.std_{unit}", path) / factor
        if len(std) != len(value) or bool((std < 0).any()):
            raise InputFileError(
                path, "is not one uncertainty of at least 0 for each value", column=f"{place}.std_{unit}"
            )
    return ErrorFunction(position, value / factor, std)


def _read_not_determined(content: Any, path: str | Path) -> tuple[NotDetermined, ...]:
    if not isinstance(content, list):
        raise InputFileError(path, "is not a list", column="not_determined")
    items = []
    for entry in content:
        item = _as_dict(entry, "not_determined", path)
        items.append(NotDetermined(str(item.get("name", "")), str(item.get("why", ""))))
    return tuple(items)


def _as_dict(content: Any, place: str, path: str | Path) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise InputFileError(path, "is not a table of keys and values", column=place)
    return content


def _numbers(content: Any, place: str, path: str | Path) -> npt.NDArray[np.float64]:
    if not isinstance(content, list):
        raise InputFileError(path, "the list of numbers is missing", column=place)
    for index, item in enumerate(content, start=1):
        if isinstance(item, bool) or not isinstance(item, int | float) or not np.isfinite(item):
            raise InputFileError(path, f"entry {index} is {item!r}, a finite number is needed", column=place)
    return np.array(content, dtype=np.float64)
