"""What to simulate: the plan (.toml), read and checked.

A plan with nearly every key there is; most may be left out (`[rig]` must say where it stands and looks)::

    seed = 0
    machine = "machine.toml"                 # beside the plan; or [machine] and [axes.*] here, as in that file
    seconds_per_frame = 4.0
    [rig]                                    # Li's Table 2 unless said otherwise
    image_size_px = [2448, 2048]
    pixel_um = 3.45
    focal_mm = 8.0
    middle_mm = [-395.0, -395.0, 430.0]      # halfway between the cameras, base frame
    look_at_mm = [140.0, 140.0, -100.0]
    baseline_mm = 300.0
    converging = 1.0                         # 0: parallel axes, 1: they cross at look_at_mm
    blur_px = 0.8
    left = { distortion = [-0.1, 0.12, 0.0003, -0.0002, -0.02] }     # also focal_px, centre_px, turn_mrad
    [noise]
    grey = 1.5
    repeatability_um = 0.0
    [board]                                  # a session's [board], and
    type = "charuco"
    squares = [14, 10]
    square_mm = 25.0
    marker_mm = 18.0
    dictionary = "DICT_5X5_100"
    views = 24
    depth_mm = [600.0, 1150.0]
    [[targets]]
    id = 0
    size_mm = 54.0
    carrier = "tool"                         # tool, work or base
    offset_mm = [0.0, 0.0, 0.0]
    roll_deg = 6.0                           # plates look at the cameras unless facing_mm says where else
    [errors]                                 # largest sizes to draw, 0 where absent; [errors.x] for one axis
    carriage = "tangent"                     # or "free" (with straightness_um) or "length" (carriage_length_mm)
    positioning_um = 300.0
    pitch_yaw_urad = 500.0
    roll_urad = 400.0
    squareness_mrad = { EC0Y = -5.05, EB0Z = -1.24, EA0Z = 3.84 }
    tables = { EZZ = { position_mm = [0.0, 400.0], value_um = [0.0, 80.0] } }    # or an errors.json, squareness too
    [[passes]]
    axis = "x"
    count = 21                               # from start to stop (the axis's range), or step, or positions
    at = { z = 400.0 }
    repeats = 1
    both_directions = true
    [covariates.temp_bed]                    # or t_s = [...], value = [...]; or value = 20.0
    start = 20.0
    end = 60.0
    tau_s = 600.0
    [[hidden]]
    effect = "thermal-expansion"
    axis = "x"
    covariate = "temp_bed"
    parameters = { alpha = 11.5e-6, q_fixed = 0.0 }
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from geoerr.error_functions import LINEAR_AND_ANGULAR, SQUARENESS, is_angular
from geoerr.errors import DetectionError, InputFileError
from geoerr.files import read_json, read_toml, write_text
from geoerr.machine import AXES, Machine, machine_from_document, read_machine
from geoerr.observations import POINT_COLUMNS
from geoerr.simulate.curves import Polyline
from geoerr.simulate.effects import HiddenEffect, read_hidden
from geoerr.simulate.entries import Entries
from geoerr.simulate.guideway import AxisPlan, ErrorPlan
from geoerr.simulate.moments import CovariatePlan, PassPlan
from geoerr.simulate.render import Light
from geoerr.vision.patterns import (
    Board,
    charuco_layout,
    chessboard_layout,
    dictionary_named,
    looks_of_marker,
    marker_bits,
)

CARRIERS = ("tool", "work", "base")
_CARRIAGES = ("tangent", "free", "length")
_AMPLITUDES = ("positioning_um", "straightness_um", "pitch_yaw_urad", "roll_urad")
# Li's Table 2.
# A step that divides a way, but for the digits that it is written with.
_OFF_STEP = 1e-6
_LI_SIZE_PX = [2448.0, 2048.0]
_LI_PIXEL_UM = 3.45
_LI_FOCAL_MM = 8.0
_PLAN_HINT = (
    "a plan says in [rig] where the cameras stand and look (middle_mm, look_at_mm); a machine.toml is no plan, but a"
    ' plan may name it: machine = "machine.toml"'
)
_LEAST_SIDE_PX = 16
# The largest sensors of industrial cameras have about 250 million; a picture of more only fills the memory.
_MOST_PIXELS = 300_000_000
# Pictures have 8 bits: what is brighter than white comes out as white, with no edge to find.
_WHITE = 255.0
# What a covariate of a plan may be called of the columns that observations have: the two that nothing else gives.
_GIVEN_BY_COVARIATES = ("feed", "temp")
_RESERVED_COLUMNS = {"left", "right", *POINT_COLUMNS.columns} - {*_GIVEN_BY_COVARIATES}
# Keys of each table, for words that are misspelled.
_PLAN_KEYS = (
    *("seed", "machine", "axes", "seconds_per_frame", "rig", "light", "noise"),
    *("board", "targets", "errors", "passes", "covariates", "hidden"),
)
_RIG_KEYS = (
    *("image_size_px", "pixel_um", "focal_mm", "middle_mm", "look_at_mm", "up"),
    *("baseline_mm", "converging", "blur_px", "left", "right"),
)
_LENS_KEYS = ("focal_px", "centre_px", "distortion", "turn_mrad")
_LIGHT_KEYS = ("white_grey", "black_grey", "background_grey", "shading", "vignetting")
_NOISE_KEYS = ("grey", "repeatability_um")
_BOARD_KEYS = (
    *("type", "squares", "square_mm", "marker_mm", "dictionary", "legacy_pattern"),
    *("margin_mm", "views", "depth_mm", "max_tilt_deg", "least_seen"),
)
_TARGET_KEYS = ("id", "dictionary", "size_mm", "carrier", "offset_mm", "margin_mm", "roll_deg", "facing_mm")
_AXIS_KEYS = (*_AMPLITUDES, "carriage", "carriage_length_mm")
_ERROR_KEYS = (*_AXIS_KEYS, "squareness_mrad", "tables", *AXES)
_PASS_KEYS = (
    *("axis", "positions", "start", "stop", "count", "step"),
    *("at", "line", "repeats", "both_directions"),
)
_COVARIATE_KEYS = ("value", "t_s", "start", "end", "tau_s")


@dataclass(frozen=True)
class LensPlan:
    """One camera's own: focal lengths, principal point, distortion k1 k2 p1 p2 k3, and a small extra turn."""

    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    turn_mrad: tuple[float, float, float]


@dataclass(frozen=True)
class RigPlan:
    """The camera pair.

    Attributes
    ----------
    size_px
        Width, height of both pictures.
    middle_mm, look_at_mm, up
        Halfway between the cameras, the point they look at, and what is up in the pictures; base frame.
    baseline_mm
        Distance of the cameras.
    converging
        0 = parallel optical axes, 1 = they cross at `look_at_mm`.
    left, right
        The two lenses.
    """

    size_px: tuple[int, int]
    middle_mm: tuple[float, float, float]
    look_at_mm: tuple[float, float, float]
    up: tuple[float, float, float]
    baseline_mm: float
    converging: float
    left: LensPlan
    right: LensPlan


@dataclass(frozen=True)
class BoardPlan:
    """The calibration board and how it is shown; `document` is the `[board]` of the session."""

    board: Board
    document: dict[str, Any]
    margin_mm: float
    views: int
    depth_mm: tuple[float, float]
    max_tilt_deg: float
    least_seen: float


@dataclass(frozen=True)
class TargetPlan:
    """One marker plate; `offset_mm` on the tool counts from the tool point, else from the base origin."""

    id: int
    dictionary: str
    size_mm: float
    carrier: str
    offset_mm: tuple[float, float, float]
    margin_mm: float
    roll_deg: float
    facing_mm: tuple[float, float, float] | None

    @property
    def name(self) -> str:
        """Give a name for messages."""
        return f"target {self.id} ({self.dictionary})"


@dataclass(frozen=True)
class Plan:
    """A checked plan; `document` is what it was made from and is what `write_plan` writes."""

    seed: int
    machine: Machine
    rig: RigPlan
    light: Light
    board: BoardPlan | None
    targets: tuple[TargetPlan, ...]
    errors: ErrorPlan
    passes: tuple[PassPlan, ...]
    hidden: tuple[HiddenEffect, ...]
    covariates: dict[str, CovariatePlan]
    seconds_per_frame: float
    repeatability_um: float
    document: dict[str, Any] = field(repr=False)
    path: str = "-"


def read_plan(path: str | Path) -> Plan:
    """Read and check a plan; every refusal names the file, the key and the remedy."""
    return plan_from_document(read_toml(path), path)


def write_plan(path: str | Path, plan: Plan) -> None:
    """Write a plan as TOML, whole or not at all."""
    write_text(path, tomli_w.dumps(plan.document))


def plan_from_document(document: dict[str, Any], path: str | Path) -> Plan:
    """Check the content of a plan.

    Parameters
    ----------
    document
        As read from TOML. `machine` is the name of a machine.toml beside the plan, or the table itself, with `axes`
        beside it as in machine.toml.
    path
        The plan's file, for messages and to find files beside it.

    Raises
    ------
    InputFileError
        for a missing, malformed or contradictory entry.
    """
    top = Entries(document, path).only(_PLAN_KEYS)
    machine = _machine(top)
    if "rig" not in document:
        raise top.refuse("rig", "is missing", _PLAN_HINT)
    rig = _rig(top.table("rig"))
    covariates = _covariates(top.table("covariates"))
    noise = top.table("noise").only(_NOISE_KEYS)
    targets = tuple(_target(entry) for entry in top.tables("targets"))
    _refuse_twins(targets, path)
    passes = tuple(_pass(entry, machine) for entry in top.tables("passes"))
    return Plan(
        seed=top.whole("seed", 0),
        machine=machine,
        rig=rig,
        light=_light(top.table("light"), top.table("rig"), noise),
        board=_board(top.table("board")) if "board" in document else None,
        targets=targets,
        errors=_errors(top.table("errors")),
        passes=passes,
        hidden=tuple(read_hidden(entry, tuple(covariates)) for entry in top.tables("hidden")),
        covariates=covariates,
        seconds_per_frame=_seconds_per_frame(top, passes),
        repeatability_um=noise.number("repeatability_um", 0.0, low=0.0),
        document=document,
        path=str(path),
    )


def _machine(top: Entries) -> Machine:
    given = top.content.get("machine")
    if isinstance(given, str):
        return read_machine(Path(top.path).parent / given)
    if given is None:
        raise top.refuse("machine", "is missing", 'name a file (machine = "machine.toml") or write [machine] here')
    parts = {"machine": given, **({"axes": top.content["axes"]} if "axes" in top.content else {})}
    return machine_from_document(parts, top.path)


def _rig(entry: Entries) -> RigPlan:
    width, height = _image_size(entry.only(_RIG_KEYS))
    pixel_um = entry.number("pixel_um", _LI_PIXEL_UM, above=0.0)
    focal_px = entry.number("focal_mm", _LI_FOCAL_MM, above=0.0) / (pixel_um * 1e-3)
    middle, look_at = entry.numbers("middle_mm", 3), entry.numbers("look_at_mm", 3)
    up = entry.numbers("up", 3, [0.0, 0.0, 1.0])
    if np.linalg.norm(np.cross(np.subtract(look_at, middle), up)) == 0.0:
        raise entry.refuse("up", "lies along the viewing direction", "choose another up or look_at_mm")

    def lens(name: str) -> LensPlan:
        own = entry.table(name).only(_LENS_KEYS)
        focal = own.numbers("focal_px", 2, [focal_px, focal_px])
        if min(focal) <= 0.0:
            raise own.refuse("focal_px", f"{focal} are not two positive numbers")
        centre = own.numbers("centre_px", 2, [0.5 * (width - 1), 0.5 * (height - 1)])
        k1, k2, p1, p2, k3 = own.numbers("distortion", 5, [0.0] * 5)
        turn = own.numbers("turn_mrad", 3, [0.0] * 3)
        return LensPlan(
            (focal[0], focal[1]), (centre[0], centre[1]), (k1, k2, p1, p2, k3), (turn[0], turn[1], turn[2])
        )

    return RigPlan(
        size_px=(width, height),
        middle_mm=_triple(middle),
        look_at_mm=_triple(look_at),
        up=_triple(up),
        baseline_mm=entry.number("baseline_mm", 300.0, above=0.0),
        converging=entry.number("converging", 1.0),
        left=lens("left"),
        right=lens("right"),
    )


def _image_size(entry: Entries) -> tuple[int, int]:
    size = entry.numbers("image_size_px", 2, _LI_SIZE_PX)
    if any(side != int(side) or side < _LEAST_SIDE_PX for side in size):
        raise entry.refuse("image_size_px", f"{size} are not two whole numbers of at least {_LEAST_SIDE_PX}")
    width, height = (int(side) for side in size)
    if width * height > _MOST_PIXELS:
        raise entry.refuse(
            "image_size_px",
            f"{width} × {height} px are {width * height / 1e6:.0f} megapixels, more than {_MOST_PIXELS / 1e6:.0f}",
            "write width and height of a camera's picture in px, such as [2448, 2048]",
        )
    return width, height


def _triple(numbers: list[float]) -> tuple[float, float, float]:
    return numbers[0], numbers[1], numbers[2]


def _light(entry: Entries, rig: Entries, noise: Entries) -> Light:
    usual = Light()
    entry.only(_LIGHT_KEYS)
    return Light(
        white_grey=entry.number("white_grey", usual.white_grey, low=0.0, high=_WHITE),
        black_grey=entry.number("black_grey", usual.black_grey, low=0.0, high=_WHITE),
        background_grey=entry.number("background_grey", usual.background_grey, low=0.0, high=_WHITE),
        shading=entry.number("shading", usual.shading),
        vignetting=entry.number("vignetting", usual.vignetting),
        blur_px=rig.number("blur_px", usual.blur_px, above=0.0),
        noise_grey=noise.number("grey", usual.noise_grey, low=0.0),
    )


def _board(entry: Entries) -> BoardPlan:
    kind = entry.only(_BOARD_KEYS).text("type", "charuco", ("charuco", "chessboard"))
    squares = entry.numbers("squares", 2)
    if any(count != int(count) or count < 2 for count in squares):
        raise entry.refuse("squares", f"{squares} is not two whole numbers above 1", "count squares, not corners")
    columns, rows = (int(count) for count in squares)
    square_mm = entry.number("square_mm", above=0.0)
    document: dict[str, Any] = {"type": kind, "squares": [columns, rows], "square_mm": square_mm}
    try:
        if kind == "charuco":
            document["marker_mm"] = entry.number("marker_mm", above=0.0)
            document["dictionary"] = _dictionary(entry.text("dictionary"))
            is_legacy = entry.flag("legacy_pattern", False)
            board = charuco_layout(
                (columns, rows), square_mm, document["marker_mm"], document["dictionary"], is_legacy
            )
            if is_legacy:
                document["legacy_pattern"] = True
        else:
            board = chessboard_layout((columns, rows), square_mm)
    except DetectionError as error:
        raise entry.refuse("squares", str(error)) from error
    near_mm, far_mm = entry.numbers("depth_mm", 2)
    if not 0.0 < near_mm <= far_mm:
        raise entry.refuse("depth_mm", f"[{near_mm}, {far_mm}] is not a nearest and a farthest distance")
    return BoardPlan(
        board=board,
        document=document,
        margin_mm=entry.number("margin_mm", 0.5 * square_mm, low=0.0),
        views=entry.whole("views", 24, low=1),
        depth_mm=(near_mm, far_mm),
        max_tilt_deg=entry.number("max_tilt_deg", 40.0, low=0.0),
        # A chessboard is found whole or not at all.
        least_seen=entry.number("least_seen", 0.7, low=0.0) if kind == "charuco" else 1.0,
    )


def _dictionary(given: str) -> str:
    """Give the usual name of a dictionary; one that there is not stays as it is, to be refused where it is used."""
    return dictionary_named(given) or given


def _target(entry: Entries) -> TargetPlan:
    entry.only(_TARGET_KEYS)
    identity, dictionary = entry.whole("id"), _dictionary(entry.text("dictionary", "DICT_4X4_50"))
    try:
        marker_bits(dictionary, identity)
    except DetectionError as error:
        raise entry.refuse("id", str(error)) from error
    size_mm = entry.number("size_mm", above=0.0)
    return TargetPlan(
        id=identity,
        dictionary=dictionary,
        size_mm=size_mm,
        carrier=entry.text("carrier", "tool", CARRIERS),
        offset_mm=_triple(entry.numbers("offset_mm", 3)),
        margin_mm=entry.number("margin_mm", size_mm / 8.0, low=0.0),
        roll_deg=entry.number("roll_deg", 0.0),
        facing_mm=_triple(entry.numbers("facing_mm", 3)) if "facing_mm" in entry.content else None,
    )


def _refuse_twins(targets: tuple[TargetPlan, ...], path: str | Path) -> None:
    seen: set[bytes] = set()
    for number, target in enumerate(targets, start=1):
        looks = looks_of_marker(target.dictionary, target.id)
        if looks in seen:
            raise InputFileError(
                path,
                f"{target.dictionary} marker {target.id} is there twice",
                column=f"targets[{number}].id",
                remedy="give every target a marker of its own",
            )
        seen.add(looks)


def _errors(entry: Entries) -> ErrorPlan:
    entry.only(_ERROR_KEYS)
    axes = {}
    for axis in AXES:
        of_axis = entry.table(axis).only(_AXIS_KEYS)
        own = Entries({**entry.content, **of_axis.content}, entry.path, entry.key(axis))
        carriage = own.text("carriage", "tangent", _CARRIAGES)
        axes[axis] = AxisPlan(
            **{name: own.number(name, 0.0) for name in _AMPLITUDES},
            carriage=carriage,
            carriage_length_mm=own.number("carriage_length_mm", above=0.0) if carriage == "length" else 0.0,
        )
    squareness = entry.table("squareness_mrad")
    for name in squareness.content:
        if name not in SQUARENESS:
            raise squareness.refuse(
                name, f"{name!r} is not a squareness", f"one of {', '.join(SQUARENESS)}, ISO signs"
            )
    tables = _tables(entry)
    of_tables = [name for name in tables.content if name in SQUARENESS]
    for name in of_tables:
        if name in squareness.content:
            raise squareness.refuse(
                name,
                f"is given by {tables.key(name)} of {tables.path}, too",
                "keep one of the two: they are not added",
            )
    stated = {name: squareness.number(name, 0.0) * 1e-3 for name in SQUARENESS}
    return ErrorPlan(
        axes=axes,
        squareness_rad=stated | {name: tables.table(name).number("value_urad") * 1e-6 for name in of_tables},
        tables={name: _table(tables, name) for name in tables.content if name not in SQUARENESS},
    )


def _tables(entry: Entries) -> Entries:
    """Give `[errors.tables]`, in the form of errors.json, or those of `tables = "errors.json"`."""
    if not isinstance(entry.content.get("tables"), str):
        return entry.table("tables")
    path = Path(entry.path).parent / entry.content["tables"]
    content = read_json(path)
    if not isinstance(content, dict) or "errors" not in content:
        raise InputFileError(path, "has no errors", column="errors", remedy="name an errors.json or a truth.json")
    return Entries(content, path).table("errors")


def _table(tables: Entries, name: str) -> Polyline:
    if name not in LINEAR_AND_ANGULAR:
        known = ", ".join((*LINEAR_AND_ANGULAR, *SQUARENESS))
        raise tables.refuse(name, f"{name!r} is not an error function", f"one of {known}")
    entry = tables.table(name)
    column, factor = ("value_urad", 1e-6) if is_angular(name) else ("value_um", 1e-3)
    position_mm, value = entry.numbers("position_mm"), entry.numbers(column)
    if len(position_mm) != len(value) or len(value) < 2 or min(np.diff(position_mm)) <= 0.0:
        raise entry.refuse(column, "needs two or more ascending positions and one value for each")
    return Polyline(np.array(position_mm), np.array(value) * factor)


def _count(entry: Entries, start_mm: float, stop_mm: float) -> int:
    """Give how many positions there are from start to stop: as stated, or by the step, which has to fit."""
    if "step" not in entry.content:
        return entry.whole("count", low=1)
    if "count" in entry.content:
        raise entry.refuse("step", "stands beside count", "keep one of the two")
    step_mm = entry.number("step", above=0.0)
    n_steps = abs(stop_mm - start_mm) / step_mm
    if abs(n_steps - round(n_steps)) > _OFF_STEP * max(n_steps, 1.0):
        raise entry.refuse(
            "step",
            f"{step_mm:g} mm does not divide the {abs(stop_mm - start_mm):g} mm from start to stop",
            "change one of them, or write count or positions",
        )
    return round(n_steps) + 1


def _pass(entry: Entries, machine: Machine) -> PassPlan:
    entry.only(_PASS_KEYS)
    axis = entry.text("axis", None, AXES)
    low_mm, high_mm = machine.axes[axis].range_mm
    if "positions" in entry.content:
        positions = entry.numbers("positions")
    else:
        start, stop = entry.number("start", low_mm), entry.number("stop", high_mm)
        positions = [float(value) for value in np.linspace(start, stop, _count(entry, start, stop))]
    if not positions:
        raise entry.refuse("positions", "is empty")
    others = entry.table("at").only(AXES)
    at_mm = {
        name: others.number(name, min(max(0.0, machine.axes[name].range_mm[0]), machine.axes[name].range_mm[1]))
        for name in AXES
        if name != axis
    }
    for name, values in {axis: positions, **{name: [value] for name, value in at_mm.items()}}.items():
        low_mm, high_mm = machine.axes[name].range_mm
        outside = [value for value in values if not low_mm <= value <= high_mm]
        if outside:
            raise entry.refuse(
                "positions" if name == axis else f"at.{name}",
                f"{outside[0]:g} mm is outside the range {low_mm:g} to {high_mm:g} mm of axis {name}",
                "change the pass or the machine's range",
            )
    return PassPlan(
        line=entry.text("line", axis.upper()),
        axis=axis,
        positions_mm=tuple(positions),
        at_mm=at_mm,
        repeats=entry.whole("repeats", 1, low=1),
        both_directions=entry.flag("both_directions", False),
    )


def _seconds_per_frame(top: Entries, passes: tuple[PassPlan, ...]) -> float:
    seconds = top.number("seconds_per_frame", 4.0, above=0.0)
    n_frames = sum(len(one.positions_mm) * one.repeats * (1 + one.both_directions) for one in passes)
    if not math.isfinite(seconds * n_frames):
        raise top.refuse(
            "seconds_per_frame",
            f"{seconds!r} s for each of {n_frames} frames is no finite time",
            "write the seconds from one picture to the next, such as 4.0",
        )
    return seconds


def _covariates(entry: Entries) -> dict[str, CovariatePlan]:
    """Read the columns that a plan adds; one that frames.csv has of its own, or cannot have, would go under."""
    for name in entry.content:
        if name in _RESERVED_COLUMNS:
            raise entry.refuse(
                name,
                "this column is what the passes, the session or measuring gives; a covariate cannot be it",
                "give the column a name of its own",
            )
    return {name: _covariate(entry.table(name).only(_COVARIATE_KEYS)) for name in entry.content}


def _covariate(entry: Entries) -> CovariatePlan:
    if "tau_s" in entry.content:
        values = (entry.number("start"), entry.number("end"))
        return CovariatePlan((0.0, 0.0), values, entry.number("tau_s", above=0.0))
    if "t_s" in entry.content:
        t_s, value = entry.numbers("t_s"), entry.numbers("value")
        if len(t_s) != len(value) or not t_s or (len(t_s) > 1 and min(np.diff(t_s)) <= 0.0):
            raise entry.refuse("t_s", "needs ascending times and one value for each")
        return CovariatePlan(tuple(t_s), tuple(value))
    return CovariatePlan((0.0,), (entry.number("value"),))
