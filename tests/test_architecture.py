"""The rules of DESIGN.md about who may use what, held by reading the imports."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import geoerr
from geoerr.report import figures

PACKAGE = Path(geoerr.__file__).parent

# Room to the rooms of geoerr that it may import (besides itself). A room is a file or folder of the package.
BASE = {
    *("arguments", "column_names", "drawing", "errors", "files", "not_numbers", "quoted_cells", "spelling"),
    *("summaries", "tables"),
}
CORE = {"_core", "geometry"}
TABLES = BASE | {"denavit_hartenberg", "dobariya", "machine", "observations", "error_functions"}
MODEL = TABLES | CORE | {"commanded_circle", "distributions", "terms", "bases", "effects", "model"}
WORK = {"vision", "fit", "diagnose", "identify", "states", "budget", "compensate", "verify", "simulate"}
ALLOWED: dict[str, set[str]] = {
    "arguments": {"errors"},
    "column_names": set(),
    "drawing": set(),
    "errors": set(),
    "commanded_circle": set(),
    "distributions": set(),
    "installation": set(),
    "not_numbers": set(),
    "spelling": set(),
    "summaries": set(),
    "files": {"errors"},
    "quoted_cells": {"errors"},
    "tables": BASE,
    "denavit_hartenberg": {"errors"},
    "dobariya": {"denavit_hartenberg", "errors"},
    "machine": BASE | {"denavit_hartenberg"},
    "equations": {"errors", "machine"},
    "terms": BASE | {"machine"},
    "bases": CORE | {"errors", "terms"},
    "effects": TABLES | CORE | {"terms"},
    "observations": BASE,
    "measurements": BASE | {"observations"},
    "error_functions": BASE | {"machine"},
    "geometry": CORE | {"arguments", "errors"},
    "model": TABLES | CORE | {"terms", "bases", "effects"},
    "vision": TABLES | CORE | {"distributions"},
    "fit": MODEL,
    "identify": MODEL | {"fit"},
    "states": MODEL | {"fit"},
    "diagnose": MODEL | {"fit"},
    "budget": MODEL | {"fit", "vision", "identify"},
    "compensate": MODEL,
    "verify": MODEL,
    "simulate": TABLES | {"vision.patterns", "vision.images"},
    "farm": MODEL | {"vision", "fit", "identify", "diagnose", "compensate", "measurements"},
    "report": MODEL | WORK | {"installation"},
    "demo": MODEL | WORK | {"report"},
    "workbench": MODEL | WORK | {"measurements", "report"},
    "__main__": {"cli"},
    "cli": MODEL | WORK | {"installation", "measurements", "report", "demo", "workbench", "farm"},
}


def imported_modules(path: Path) -> set[str]:
    modules: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return modules


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def sources() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if room_of(path) != "__init__"]


def test_every_room_has_a_rule() -> None:
    assert {room_of(path) for path in sources()} <= set(ALLOWED)


def test_imports_go_one_way() -> None:
    offences = []
    for path in sources():
        room = room_of(path)
        for module in imported_modules(path):
            if not module.startswith("geoerr."):
                continue
            inner = module.removeprefix("geoerr.")
            if inner == "__version__" or inner.split(".")[0] == room:
                continue
            if not any(inner == rule or inner.startswith(f"{rule}.") for rule in ALLOWED[room]):
                offences.append(f"{path.relative_to(PACKAGE)} imports {module}")
    assert not offences


def drawn_names(path: Path) -> list[tuple[str, str]]:
    """Give method and figure of every `drawn(...)` in a file."""
    return [
        (function.name, call.args[0].value)
        for function in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(function, ast.FunctionDef)
        for call in ast.walk(function)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "drawn"
        if isinstance(call.args[0], ast.Constant)
    ]


def test_objects_draw_themselves_by_figures_that_there_are() -> None:
    """The door to the figures is for `plot_...` methods, and every name behind it is a figure of `report`."""
    named = [(path, *one) for path in sources() for one in drawn_names(path)]
    assert len(named) > 20
    for path, method, figure in named:
        assert method.startswith("plot_"), f"{path}: {method}"
        assert figure in figures.__all__, f"{path}: {figure}"
    users = {path for path in sources() if "geoerr.drawing.drawn" in imported_modules(path)}
    assert users == {path for path, *_ in named}


def test_opencv_lives_in_vision_only() -> None:
    users = {room_of(path) for path in sources() if "cv2" in imported_modules(path)}
    assert users <= {"vision"}


def test_the_core_knows_nothing_of_python() -> None:
    root = PACKAGE.parents[1] / "crates" / "geoerr-core" / "Cargo.toml"
    if root.is_file():
        assert not {"pyo3", "numpy", "opencv"} & set(root.read_text(encoding="utf-8").replace(".", " ").split())


@pytest.mark.parametrize(
    ("library", "room"), [("faer", "geoerr-core/src/least_squares/"), ("rustfft", "geoerr-fourier/")]
)
def test_a_library_of_the_core_lives_in_one_room(library: str, room: str) -> None:
    root = PACKAGE.parents[1] / "crates"
    users = {
        path.relative_to(root).as_posix()
        for path in root.rglob("*.rs")
        if re.search(rf"\b{library}\s*::", path.read_text(encoding="utf-8"))
    }
    assert all(user.startswith(room) for user in users)
    if root.is_dir():
        assert users


def test_dash_lives_in_the_workbench_only() -> None:
    users = {
        room_of(path)
        for path in sources()
        if any(name.split(".")[0] in ("dash", "flask", "werkzeug") for name in imported_modules(path))
    }
    assert users == {"workbench"}


def test_dask_is_met_by_the_command_line_only() -> None:
    """The farm asks for `submit` and knows no engine by its name."""
    users = {
        path.relative_to(PACKAGE).as_posix()
        for path in sources()
        if any(name.split(".")[0] in ("dask", "distributed") for name in imported_modules(path))
    }
    assert users == {"cli/farm.py"}
