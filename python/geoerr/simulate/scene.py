"""The scene of a plan: machine, cameras and plates, and where everything is at each moment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoerr.machine import AXES
from geoerr.simulate.cameras import Camera, StereoPair
from geoerr.simulate.effects import disturbance_of
from geoerr.simulate.gauge import Gauged, to_gauge
from geoerr.simulate.guideway import build_errors
from geoerr.simulate.machine import Disturbance, VirtualMachine
from geoerr.simulate.moments import Moments, measured_positions, moments_of
from geoerr.simulate.plan import LensPlan, Plan, RigPlan, TargetPlan
from geoerr.simulate.render import Sheet
from geoerr.simulate.rotations import Array, looking_along, rotation
from geoerr.vision.patterns import Pattern, marker_pattern

# Random streams of a plan's seed, by what they are for: pictures have one each, so threads cannot matter.
# Entries of the tables of an axis that no pass moves.
_N_POSITIONS = 21
_STREAM_ERRORS, _STREAM_REPEATABILITY, STREAM_BOARD, STREAM_FRAMES, STREAM_CALIBRATION = range(5)


def seed_of(seed: int, *key: int) -> np.random.SeedSequence:
    """Give the random stream of one purpose (and one picture) of a plan's seed."""
    return np.random.SeedSequence(seed, spawn_key=key)


def build_rig(plan: RigPlan) -> StereoPair:
    """Place both cameras."""
    middle_mm, look_at_mm = np.array(plan.middle_mm), np.array(plan.look_at_mm)
    base_from_stand = looking_along(look_at_mm - middle_mm, np.array(plan.up))
    right_mm = 0.5 * plan.baseline_mm * base_from_stand[:, 0]
    # Both turn about the bar's upright only: one picture is not rolled against the other.
    up = -base_from_stand[:, 1]
    return StereoPair(
        _camera(plan, plan.left, middle_mm - right_mm, look_at_mm - (1.0 - plan.converging) * right_mm, up),
        _camera(plan, plan.right, middle_mm + right_mm, look_at_mm + (1.0 - plan.converging) * right_mm, up),
    )


def _camera(plan: RigPlan, lens: LensPlan, centre_mm: Array, look_at_mm: Array, up: Array) -> Camera:
    base_from_camera = looking_along(look_at_mm - centre_mm, up)
    return Camera(
        size_px=plan.size_px,
        focal_px=lens.focal_px,
        centre_px=lens.centre_px,
        distortion=lens.distortion,
        camera_from_base=rotation(np.array(lens.turn_mrad) * 1e-3) @ base_from_camera.T,
        centre_mm=centre_mm,
    )


@dataclass(frozen=True)
class Plate:
    """A target's plate: its pattern with margin, and its place on the carrier.

    Attributes
    ----------
    target
        What the plan says of it.
    pattern
        Marker and margin; the marker's upper left corner is u = v = 0.
    carrier_from_plate
        (3, 3); columns: u, v, away from the viewer.
    """

    target: TargetPlan
    pattern: Pattern
    carrier_from_plate: Array

    @property
    def corners_mm(self) -> Array:
        """Give the marker's corners (4, 2) on the plate: upper left, upper right, lower right, lower left."""
        size_mm = self.target.size_mm
        return np.array([[0.0, 0.0], [size_mm, 0.0], [size_mm, size_mm], [0.0, size_mm]])


class Scene:
    """Everything that a plan describes, ready to be looked at."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.rig = build_rig(plan.rig)
        self.machine = VirtualMachine(
            plan.machine, build_errors(plan.machine, plan.errors, seed_of(plan.seed, _STREAM_ERRORS))
        )
        self.moments: Moments = moments_of(plan.passes, plan.covariates, plan.machine, plan.seconds_per_frame)
        self.plates = tuple(self._plate(target) for target in plan.targets)

    def __len__(self) -> int:
        """Count the moments."""
        return len(self.moments)

    @cached_property
    def disturbance(self) -> Disturbance:
        """What hidden effects and the machine's scatter add at each moment."""
        total = disturbance_of(self.plan.hidden, self.moments, self.plan.machine)
        # Only the axis that was moved can have stopped elsewhere; a parked axis stays where it is.
        rng = np.random.default_rng(seed_of(self.plan.seed, _STREAM_REPEATABILITY))
        scatter_mm = rng.standard_normal(len(self)) * self.plan.repeatability_um * 1e-3
        moving = self.moments.moving_axis
        total.delta_mm[np.arange(len(self)), moving, moving] += scatter_mm
        return total

    @cached_property
    def positions_mm(self) -> dict[str, Array]:
        """Measured positions of each axis; an axis that no pass moves counts with its whole range."""
        positions = {}
        for index, axis in enumerate(AXES):
            measured = measured_positions(self.moments, index)
            whole = np.linspace(*self.plan.machine.axes[axis].range_mm, _N_POSITIONS)
            positions[axis] = measured if len(measured) > 1 else whole
        return positions

    @cached_property
    def gauged(self) -> Gauged:
        """The machine's errors in the gauge of the measured range."""
        return to_gauge(self.machine, self.positions_mm)

    def rig_at(self, row: int) -> StereoPair:
        """Give the camera pair at one moment; it stands still unless a hidden effect moves it."""
        shift_mm, turn_rad = self.disturbance.rig_mm[row], self.disturbance.rig_rad[row]
        return self.rig.moved(shift_mm, turn_rad) if shift_mm.any() or turn_rad.any() else self.rig

    @cached_property
    def _poses(self) -> dict[str, tuple[Array, Array]]:
        """Pose of each carrier at every moment: rotations (n, 3, 3) and origins (n, 3)."""
        return {
            carrier: self.machine.pose(carrier, self.moments.q_mm, self.disturbance)
            for carrier in ("tool", "work", "base")
        }

    def sheets(self, row: int) -> list[Sheet]:
        """Give all plates where they are at one moment, in the order of the plan's targets."""
        sheets = []
        for plate in self.plates:
            carrier = plate.target.carrier
            turned, origin_mm = (part[row] for part in self._poses[carrier])
            base_from_sheet = turned @ plate.carrier_from_plate
            arm_mm = self.machine.arms_mm(carrier, np.array(plate.target.offset_mm))
            half_mm = 0.5 * plate.target.size_mm
            corner_mm = origin_mm + turned @ arm_mm - base_from_sheet @ np.array([half_mm, half_mm, 0.0])
            sheets.append(Sheet(plate.pattern, base_from_sheet, corner_mm))
        return sheets

    def corners_mm(self, row: int) -> Array:
        """Give every target's marker corners (k, 4, 3) in the base frame at one moment."""
        pairs = zip(self.sheets(row), self.plates, strict=True)
        return np.array([sheet.place_mm(plate.corners_mm) for sheet, plate in pairs]).reshape(-1, 4, 3)

    def outlines_px(self, row: int) -> dict[str, tuple[Array, list[bool]]]:
        """Give, for each camera, the outlines of all plates (k, 4, 2) and whether their printed sides are seen."""
        sheets = self.sheets(row)
        outlines_mm = np.array([sheet.outline_mm for sheet in sheets])
        return {
            name: (camera.project(outlines_mm), [sheet.faces(camera) for sheet in sheets])
            for name, camera in self.rig_at(row).cameras.items()
        }

    def _plate(self, target: TargetPlan) -> Plate:
        pattern = marker_pattern(target.dictionary, target.id, target.size_mm).with_margin(target.margin_mm)
        facing_mm = self.rig.middle_mm if target.facing_mm is None else np.array(target.facing_mm)
        away = self._usual_place_mm(target) - facing_mm
        upright = looking_along(away, np.array(self.plan.rig.up))
        roll = rotation(np.array([0.0, 0.0, np.deg2rad(target.roll_deg)]))
        return Plate(target, pattern, upright @ roll)

    def _usual_place_mm(self, target: TargetPlan) -> Array:
        """Give the mean nominal place of a target over all moments, base frame."""
        place_mm = np.array(target.offset_mm)
        mean_mm = self.moments.q_mm.mean(axis=0) if len(self) else np.zeros(3)
        if target.carrier == "tool":
            place_mm = place_mm + np.array(self.plan.machine.tool_offset_mm)
        sides = {"tool": (self.plan.machine.tool_axes, 1.0), "work": (self.plan.machine.work_axes, -1.0)}
        axes, sign = sides.get(target.carrier, ("", 0.0))
        for axis in axes:
            index = AXES.index(axis)
            place_mm[index] += sign * mean_mm[index]
        return place_mm
