"""Plans for Li's nine lines: three runs, along X, Y and Z, with a fixture of plates on each body.

A line is an axis that moves and a target's offset on its carrier: with plates at the origin and at x₀, y₀, z₀, the
run along X draws lines 1, 4 and 5, that along Y lines 2, 6 and 7, that along Z lines 3, 8 and 9 (Li §4.3). Both
bodies' plates are seen in every picture. The builder places the cameras as near as the view allows and refuses an
arrangement in which a plate leaves the picture or hides another.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geoerr.errors import GeoerrError, InputFileError
from geoerr.machine import AXES, Machine, machine_from_document
from geoerr.simulate.plan import Plan, plan_from_document
from geoerr.simulate.rotations import Array, looking_along
from geoerr.simulate.scene import Scene, build_rig
from geoerr.simulate.visibility import look_around

# Li's Table 3, mrad: S_xy = +EC0Y, S_xz = −EB0Z, S_yz = +EA0Z.
_LI_SQUARENESS_MRAD = {"EC0Y": -5.05, "EB0Z": -1.24, "EA0Z": 3.84}
# Small faults of assembly, so that nothing about the pair is round: distortion k1 k2 p1 p2 k3 of two like lenses.
_LEFT_LENS = {
    "distortion": [-0.098, 0.121, 3.1e-4, -2.2e-4, -0.021],
    "off_px": [6.3, -4.1],
    "turn_mrad": [0.0, 0.0, 0.0],
}
_RIGHT_LENS = {
    "distortion": [-0.101, 0.127, -1.7e-4, 2.9e-4, -0.024],
    "off_px": [-3.8, 7.2],
    "turn_mrad": [4.0, -3.0, 9.0],
}
_LI_WIDTH_PX, _LI_PIXEL_UM = 2448, 3.45
# Viewing directions to try, from the cameras to the scene: obliquely, so that all three axes are seen alike.
_SLANTS = ((1.0, 1.0, 1.0), (1.0, 1.2, 1.3), (1.0, 1.0, 0.7), (1.0, 1.0, 1.5), (1.0, 0.6, 0.8), (0.6, 1.0, 0.8))
_MARGIN_SHARE = 0.012


@dataclass(frozen=True)
class NineLines:
    """What a nine-line plan is made from.

    Attributes
    ----------
    seed
        Of everything random.
    chain
        Structural code, work to tool.
    travel_mm
        Length of the X, Y and Z axis; ranges start at 0.
    offsets_mm
        x₀, y₀, z₀: how far the outer plates stand from the origin plate of their fixture.
    marker_mm, plate_margin_mm
        Side of a marker, and the white margin around it.
    n_points
        Points of a line.
    repeats, both_directions
        How often each run is made, and whether it goes back too.
    carriage, carriage_length_mm
        How carriages ride on their guideways: `tangent`, `free` or `length`.
    positioning_um, straightness_um, pitch_yaw_urad, roll_urad
        Largest errors to draw; `straightness_um` for a free carriage.
    squareness_mrad
        ISO names and signs.
    baseline_mm, image_size_px, blur_px, noise_grey
        Of the cameras; fewer pixels are larger pixels, so that the view stays.
    board_views
        Views of the calibration board.
    """

    seed: int = 1
    chain: str = "wZbXYt"
    travel_mm: tuple[float, float, float] = (400.0, 400.0, 400.0)
    offsets_mm: tuple[float, float, float] = (200.0, 200.0, 200.0)
    marker_mm: float = 54.0
    plate_margin_mm: float = 6.0
    n_points: int = 21
    repeats: int = 1
    both_directions: bool = True
    carriage: str = "tangent"
    carriage_length_mm: float = 120.0
    positioning_um: float = 300.0
    straightness_um: float = 60.0
    pitch_yaw_urad: float = 500.0
    roll_urad: float = 400.0
    squareness_mrad: tuple[float, float, float] = (
        _LI_SQUARENESS_MRAD["EC0Y"],
        _LI_SQUARENESS_MRAD["EB0Z"],
        _LI_SQUARENESS_MRAD["EA0Z"],
    )
    baseline_mm: float = 300.0
    image_size_px: tuple[int, int] = (2448, 2048)
    blur_px: float = 0.8
    noise_grey: float = 1.5
    board_views: int = 24


def nine_line_plan(
    setting: NineLines | None = None,
    *,
    hidden: Sequence[dict[str, Any]] = (),
    covariates: dict[str, Any] | None = None,
) -> Plan:
    """Make a nine-line plan in which every plate is seen in every picture.

    Parameters
    ----------
    setting
        What to make it from; the defaults are those of the demo.
    hidden, covariates
        `[[hidden]]` and `[covariates]` of the plan, as in TOML.

    Raises
    ------
    InputFileError
        if no arrangement of cameras and parking positions shows all plates free of each other, or an entry is wrong.
    """
    setting = setting or NineLines()
    machine = machine_from_document(_machine_document(setting), _NAME)
    refusal: GeoerrError | None = None
    for direction, parking in itertools.product(_directions(machine), _parkings(machine)):
        document = _document(setting, machine, direction, parking)
        document |= {"hidden": list(hidden)} if hidden else {}
        document |= {"covariates": covariates} if covariates else {}
        plan = plan_from_document(document, _NAME)
        try:
            return _checked(plan, setting)
        except InputFileError as error:
            refusal = refusal or error
    raise InputFileError(
        _NAME,
        f"no arrangement shows every plate: {refusal.problem if isinstance(refusal, InputFileError) else refusal}",
        remedy="take smaller plates (marker_mm), shorter travels or other offsets",
    )


_NAME = "nine-line plan"


def _directions(machine: Machine) -> list[Array]:
    """List viewing directions: from above, then from below; X and Y plates recede as their axis moves."""
    x, y = (1.0 if machine.side(axis) == "tool" else -1.0 for axis in "xy")
    return [np.array([x, y, z]) * slant for z in (-1.0, 1.0) for slant in _SLANTS]


def _checked(plan: Plan, setting: NineLines) -> Plan:
    missing = look_around(Scene(plan), _margin_px(setting))
    if missing:
        first = missing[0]
        raise InputFileError(
            plan.path,
            f"{first.target} is not seen by the {first.camera} camera in frame {first.row + 1}: {first.why}",
            column="rig",
        )
    return plan


def _margin_px(setting: NineLines) -> float:
    return _MARGIN_SHARE * setting.image_size_px[0]


def _machine_document(setting: NineLines) -> dict[str, Any]:
    return {
        "machine": {"name": "virtual machine", "chain": setting.chain, "reference_temperature": 20.0},
        "axes": {axis: {"range": [0.0, float(travel)]} for axis, travel in zip(AXES, setting.travel_mm, strict=True)},
    }


def _parkings(machine: Machine) -> list[dict[str, float]]:
    """List where the axes of one body may wait while the other moves: anywhere but where the fixtures meet."""
    ends = {axis: machine.axes[axis].range_mm for axis in AXES}
    if not machine.tool_axes or not machine.work_axes:
        return [{axis: ends[axis][0] for axis in AXES}]
    choices = []
    for side_axes in (machine.tool_axes, machine.work_axes):
        first, others = side_axes[0], side_axes[1:]
        choices.append(
            [
                {first: ends[first][1], **{axis: ends[axis][0] for axis in others}},
                {first: 0.5 * sum(ends[first]), **{axis: ends[axis][0] for axis in others}},
                {axis: ends[axis][1] for axis in side_axes},
            ]
        )
    return [{**tool, **work} for tool, work in itertools.product(*choices)]


def _document(setting: NineLines, machine: Machine, direction: Array, parking: dict[str, float]) -> dict[str, Any]:
    passes = []
    for axis in AXES:
        at = {
            other: 0.0 if machine.side(other) == machine.side(axis) else parking[other]
            for other in AXES
            if other != axis
        }
        passes.append(
            {
                "line": axis.upper(),
                "axis": axis,
                "count": setting.n_points,
                "at": at,
                "repeats": setting.repeats,
                "both_directions": setting.both_directions,
            }
        )
    width = setting.image_size_px[0]
    rig = {
        "image_size_px": list(setting.image_size_px),
        "pixel_um": _LI_PIXEL_UM * _LI_WIDTH_PX / width,
        "focal_mm": 8.0,
        "baseline_mm": setting.baseline_mm,
        "converging": 0.9,
        "blur_px": setting.blur_px,
        "left": _lens(_LEFT_LENS, setting),
        "right": _lens(_RIGHT_LENS, setting),
    }
    document: dict[str, Any] = {
        "seed": setting.seed,
        **_machine_document(setting),
        "rig": {**rig, "middle_mm": [0.0, 0.0, 0.0], "look_at_mm": [1.0, 1.0, -1.0]},
        "targets": _targets(setting, machine),
        "errors": _errors(setting),
        "passes": passes,
        "noise": {"grey": setting.noise_grey},
    }
    places_mm = _places_mm(plan_from_document(document, _NAME))
    middle_mm, look_at_mm = _nearest_view(document, setting, places_mm, direction)
    document["rig"] |= {"middle_mm": _rounded(middle_mm), "look_at_mm": _rounded(look_at_mm)}
    document["board"] = _board(setting, np.linalg.norm(places_mm - middle_mm, axis=1))
    return document


def _rounded(place_mm: Array) -> list[float]:
    return [round(float(value), 1) for value in place_mm]


def _lens(lens: dict[str, list[float]], setting: NineLines) -> dict[str, list[float]]:
    scale = setting.image_size_px[0] / _LI_WIDTH_PX
    centre = [0.5 * (side - 1) + scale * off for side, off in zip(setting.image_size_px, lens["off_px"], strict=True)]
    return {"distortion": lens["distortion"], "centre_px": centre, "turn_mrad": lens["turn_mrad"]}


def _targets(setting: NineLines, machine: Machine) -> list[dict[str, Any]]:
    """Give each body that moves a plate at its origin, and one on each axis across which one of its axes moves."""
    targets: list[dict[str, Any]] = []
    for carrier, side_axes in (("tool", machine.tool_axes), ("work", machine.work_axes)):
        arms = [axis for axis in AXES if any(axis != moving for moving in side_axes)]
        for arm in ["", *arms] if side_axes else []:
            offset = [value if axis == arm else 0.0 for axis, value in zip(AXES, setting.offsets_mm, strict=True)]
            number = len(targets)
            targets.append(
                {
                    "id": number,
                    "dictionary": "DICT_4X4_50",
                    "size_mm": setting.marker_mm,
                    "margin_mm": setting.plate_margin_mm,
                    "carrier": carrier,
                    "offset_mm": offset,
                    # Edges along the pixel rows would put every point of an edge at the same place of its pixel.
                    "roll_deg": 6.0 + 3.0 * number,
                }
            )
    return targets


def _errors(setting: NineLines) -> dict[str, Any]:
    errors: dict[str, Any] = {
        "carriage": setting.carriage,
        "positioning_um": setting.positioning_um,
        "straightness_um": setting.straightness_um,
        "pitch_yaw_urad": setting.pitch_yaw_urad,
        "roll_urad": setting.roll_urad,
        "squareness_mrad": dict(zip(_LI_SQUARENESS_MRAD, setting.squareness_mrad, strict=True)),
    }
    if setting.carriage == "length":
        errors["carriage_length_mm"] = setting.carriage_length_mm
    return errors


def _board(setting: NineLines, distances_mm: Array) -> dict[str, Any]:
    near_mm, far_mm = float(distances_mm.min()), float(distances_mm.max())
    return {
        "type": "charuco",
        "squares": [14, 10],
        "square_mm": 25.0,
        "marker_mm": 18.0,
        "dictionary": "DICT_5X5_100",
        "views": setting.board_views,
        "depth_mm": [round(near_mm), round(far_mm)],
    }


def _places_mm(plan: Plan) -> Array:
    """Give all places of all plates on a perfect machine (n, 3): the ends of every pass are enough for the view."""
    places = []
    machine = plan.machine
    for item in plan.passes:
        for position in (item.positions_mm[0], item.positions_mm[-1]):
            q_mm = {**item.at_mm, item.axis: position}
            for target in plan.targets:
                side_axes, sign = (machine.tool_axes, 1.0) if target.carrier == "tool" else (machine.work_axes, -1.0)
                moved = [sign * q_mm[axis] if axis in side_axes else 0.0 for axis in AXES]
                places.append(np.array(target.offset_mm) + moved)
    return np.array(places)


def _nearest_view(
    document: dict[str, Any], setting: NineLines, places_mm: Array, direction: Array
) -> tuple[Array, Array]:
    """Find the smallest distance from which both cameras see all places, and the point to look at.

    Bisection on the distance, the picture centred anew three times. Plates count as spheres around their middles.
    """
    lens = plan_from_document(document, _NAME).rig
    forward = direction / np.linalg.norm(direction)
    radius_mm = np.sqrt(0.5) * (setting.marker_mm + 2.0 * setting.plate_margin_mm)
    look_at_mm = 0.5 * (places_mm.min(axis=0) + places_mm.max(axis=0))
    largest_mm = 8.0 * float(np.ptp(places_mm, axis=0).max() + setting.baseline_mm)

    def box(distance_mm: float) -> tuple[bool, Array]:
        middle_mm = look_at_mm - distance_mm * forward
        rig = build_rig(replace(lens, middle_mm=tuple(middle_mm), look_at_mm=tuple(look_at_mm)))
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        fits = True
        for camera in rig.cameras.values():
            depth_mm = camera.in_camera_mm(places_mm)[:, 2]
            pixels = camera.project(places_mm)
            if not np.isfinite(pixels).all():
                return False, np.zeros(2)
            reach = (radius_mm * camera.focal_px[0] / depth_mm)[:, None]
            size = np.array(camera.size_px)
            fits &= bool((np.minimum(pixels - reach, size - 1 - pixels - reach) >= _margin_px(setting)).all())
            off = (pixels - 0.5 * size) / camera.focal_px
            low, high = np.minimum(low, off.min(axis=0)), np.maximum(high, off.max(axis=0))
        return fits, 0.5 * (low + high)

    distance_mm = largest_mm
    for _ in range(4):
        _, centre = box(distance_mm)
        stand = looking_along(forward, np.array(lens.up))
        # The optical axes cross in the middle of what is to be seen.
        deeper_mm = float(((places_mm - look_at_mm) @ forward).mean())
        look_at_mm = look_at_mm + deeper_mm * forward
        distance_mm += deeper_mm
        look_at_mm = look_at_mm + distance_mm * (stand[:, 0] * centre[0] + stand[:, 1] * centre[1])
        low_mm, distance_mm = 0.5 * setting.baseline_mm, largest_mm
        while distance_mm - low_mm > 0.5:
            tried = 0.5 * (low_mm + distance_mm)
            if box(tried)[0]:
                distance_mm = tried
            else:
                low_mm = tried
    return look_at_mm - distance_mm * forward, look_at_mm
