"""What `geoerr doctor` looks at: the installation, and files that other verbs would be given."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from geoerr import __version__
from geoerr.cli.options import install_command
from geoerr.errors import GeoerrError, InputFileError
from geoerr.installation import python_and_platform, version_of
from geoerr.summaries import counted

State = Literal["ok", "note", "wrong"]

# Distribution, as pyproject.toml requires it, to the module that it brings.
LIBRARIES = {
    "numpy": "numpy",
    "opencv-python-headless": "cv2",
    "plotly": "plotly",
    "polars": "polars",
    "reportlab": "reportlab",
    "rich": "rich",
    "scipy": "scipy",
    "tomli-w": "tomli_w",
    "typer": "typer",
}
# Extra of geoerr to what it brings, and what for.
EXTRAS = {
    "workbench": ("dash", "dash", "geoerr workbench"),
    "cluster": ("distributed", "distributed", "geoerr farm --scheduler"),
}
_TABLES = (".csv", ".parquet")
# Half of a nanometre: what a command may be off from the exact inverse.
_SELF_TEST_MM = 5e-7


@dataclass(frozen=True)
class Check:
    """One thing that was looked at: how it is, and what to do where it is not as it should be."""

    name: str
    state: State
    text: str
    hint: str | None = None

    def to_document(self) -> dict[str, Any]:
        """Give it as plain values, for `--json`."""
        return {"name": self.name, "state": self.state, "text": self.text, "hint": self.hint}


def installation_checks() -> Iterator[Check]:
    """Look at what geoerr runs on."""
    yield Check("geoerr", "ok", f"{__version__}, in {Path(__file__).parents[1]}")
    yield Check("python", "ok", python_and_platform())
    try:
        yield _core()
    except ImportError as error:
        # What it is made of is looked at below, with what to do.
        yield Check("core", "wrong", f"cannot be loaded: {error}", f"install geoerr again: {install_command()}")
    yield _threads()
    for distribution, module in LIBRARIES.items():
        yield _library(distribution, module)
    for extra, (distribution, module, purpose) in EXTRAS.items():
        yield _extra(extra, distribution, module, purpose)


def _core() -> Check:
    """Let the core predict and invert a machine whose errors are known by hand: 100 µm/m along X, Y 1 mrad askew."""
    import numpy as np

    from geoerr.error_functions import ErrorFunction, ErrorFunctions, Squareness
    from geoerr.machine import Machine
    from geoerr.model import Model

    machine = Machine.from_chain("wbXYZt", travel_mm=(200.0, 200.0, 200.0))
    positioning = ErrorFunction(np.array([0.0, 200.0]), np.array([0.0, 0.02]))
    model = Model(
        machine, ErrorFunctions(machine, {"EXX": positioning}, {"EC0Y": Squareness(1e-3)}, method="by hand")
    )
    wanted_mm = [[100.0, 0.0, 50.0], [150.0, 100.0, 0.0]]
    along_x_mm = float(model.error_mm(wanted_mm)[0, 0])
    reached_mm = model.tool_from_work(model.commands_for(wanted_mm))
    left_mm = float(abs(reached_mm - wanted_mm).max())
    # 100 µm/m over 100 mm.
    if abs(along_x_mm - 0.01) > _SELF_TEST_MM or left_mm > _SELF_TEST_MM:
        text = f"computes wrongly: {1e3 * along_x_mm:.4f} µm for 10, {1e6 * left_mm:.2f} nm left after correction"
        return Check("core", "wrong", text, f"install geoerr again: {install_command()}")
    return Check("core", "ok", "predicts and corrects a known machine to a nanometre")


def _threads() -> Check:
    asked = os.environ.get("RAYON_NUM_THREADS")
    said = "" if asked is None else f"; RAYON_NUM_THREADS={asked} is what --threads 0 takes"
    return Check("threads", "ok", f"{_cores()} cores to use{said}")


def _cores() -> int:
    # Linux can give a process fewer cores than there are.
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _library(distribution: str, module: str) -> Check:
    needed = _least(distribution)
    try:
        importlib.import_module(module)
    except ImportError as error:
        return Check(distribution, "wrong", f"cannot be loaded: {error}", f"pip install '{distribution}{needed}'")
    version = version_of(distribution, module)
    if needed and _numbers(version) < _numbers(needed):
        return Check(
            distribution, "wrong", f"{version}, {needed} is needed", f"pip install --upgrade '{distribution}{needed}'"
        )
    return Check(distribution, "ok", version)


def _extra(extra: str, distribution: str, module: str, purpose: str) -> Check:
    try:
        importlib.import_module(module)
    except ImportError as error:
        absent = isinstance(error, ModuleNotFoundError) and error.name == module
        text = f"not installed: no `{purpose}`" if absent else f"cannot be loaded: {error}"
        return Check(distribution, "note" if absent else "wrong", text, install_command(extra))
    return Check(distribution, "ok", f"{version_of(distribution, module)}, for `{purpose}`")


def _least(distribution: str) -> str:
    """Give what geoerr's own metadata asks for, as `>=2.0`; nothing where it is not installed as a distribution."""
    try:
        required = metadata.requires("geoerr") or []
    except metadata.PackageNotFoundError:
        return ""
    found = (re.fullmatch(rf"{re.escape(distribution)}\s*(>=[\d.]+)", text) for text in required)
    return next((match[1] for match in found if match), "")


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", version)[:3])


def file_check(path: Path) -> Check:
    """Read a file as the verb would that it is for, and say what it is."""
    try:
        if path.is_dir():
            return _session(path)
        text, notes = _measurements(path) if _is_table(path) else (_reader(path)(path), ())
        return Check(str(path), "note" if notes else "ok", "; ".join((text, *notes)))
    except GeoerrError as error:
        problem, _, hint = str(error).partition("\nhint: ")
        return Check(str(path), "wrong", problem.removeprefix(f"{path}: "), hint or None)


def _is_table(path: Path) -> bool:
    """Tell whether a file would be read as measurements; one that is absent is, unless its name says otherwise."""
    suffix = path.suffix.lower()
    return suffix in _TABLES or not (path.exists() or suffix in (".toml", ".json"))


def _reader(path: Path) -> Callable[[Path], str]:
    if path.suffix.lower() == ".toml":
        return _described
    if path.suffix.lower() == ".json":
        return _model_or_rig
    raise InputFileError(
        path,
        "is of no kind that is known here",
        remedy="give a .toml, a .json, a .csv, a .parquet or a session folder; programs are for `geoerr verify path`",
    )


def _session(path: Path) -> Check:
    """Say what a session's folder holds, and what is wrong with its pictures."""
    from geoerr.vision.session import read_session
    from geoerr.vision.session_pictures import findings

    session = read_session(path)
    found = findings(session)
    frames = 0 if session.frames is None else len(session.frames)
    parts = [
        f"{len(session.calibration_pairs)} calibration pairs",
        f"{len(session.targets)} targets",
        f"{frames} frames",
    ]
    texts = [f"session: {', '.join(parts)}", *(one.text for one in found)]
    if session.set_aside:
        first = session.set_aside[0]
        texts.append(f"{counted(len(session.set_aside), 'row')} of frames.csv set aside, the first: {first}")
    is_noted = len(texts) > 1
    is_wrong = any(one.is_wrong for one in found)
    # Most pressing first.
    hints = [one.remedy for one in sorted(found, key=lambda one: not one.is_wrong) if one.remedy]
    state: State = "wrong" if is_wrong else "note" if is_noted else "ok"
    return Check(str(path), state, "; ".join(texts), hints[0] if hints else None)


def _described(path: Path) -> str:
    from geoerr.effects import load_effects
    from geoerr.files import read_toml
    from geoerr.machine import read_machine

    if "effect" in read_toml(path):
        return f"own effects: {', '.join(effect.id for effect in load_effects(path))}"
    machine = read_machine(path)
    ranges = ", ".join(
        f"{name} {axis.range_mm[0]:g} to {axis.range_mm[1]:g} mm" for name, axis in machine.axes.items()
    )
    return f"machine {machine.name!r}: {machine.chain}, {ranges}"


def _model_or_rig(path: Path) -> str:
    from geoerr.files import read_json
    from geoerr.model import load_model

    document = read_json(path)
    if isinstance(document, dict) and "K_left" in document:
        return _rig(path)
    model = load_model(path)
    conditions = f"; depends on {', '.join(model.conditions)}" if model.conditions else ""
    if not model.terms:
        return f"the errors of {model.machine.name!r}"
    return f"model of {model.machine.name!r}: {len(model.terms)} terms{conditions}"


def _rig(path: Path) -> str:
    from geoerr.vision.rig import read_rig

    rig = read_rig(path)
    width, height = rig.image_size
    known = "without covariance: --rig will refuse it" if rig.covariance is None else "with covariance"
    return f"camera pair, {width} × {height} px, {rig.baseline_mm:.1f} mm apart, {known}"


def _measurements(path: Path) -> tuple[str, tuple[str, ...]]:
    """Say what a table holds, and what a fit would not read of it."""
    import numpy as np

    from geoerr.fit.columns import unread_columns, unused_uncertainties
    from geoerr.measurements import read_measurements

    measured = read_measurements([path])
    tables = {
        "measured points": [] if measured.points is None else [measured.points.frame.height],
        "points of circles": [test.frame.height for test in measured.circles],
        "lengths": [table.frame.height for table in measured.lengths],
    }
    text = ", ".join(f"{sum(rows)} {what}" for what, rows in tables.items() if rows)
    aside = len(measured.set_aside)
    rows = "row" if aside == 1 else "rows"
    text += f", {aside} {rows} set aside: {measured.set_aside[0]}" if aside else ""
    notes = [note for table in measured.tables for note in unread_columns(table.frame.columns)]
    if measured.points is not None:
        unused = unused_uncertainties(measured.points, np.isfinite(measured.points.measured_mm))
        notes += [] if unused is None else [unused]
    return text, tuple(notes)
