"""The circular test (ISO 230-4): what a ball bar would draw, with and without compensation, or measured.

Li's circle has radius 100 mm and centre (212, 270) mm (Li §5.3). The whole model includes squareness; Li's Eq. 23
leaves it out and is there by name only. |S_xy| alone makes a circular deviation of |S_xy|·R.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.commanded_circle import far_from_radius, no_radius, on_their_circle, other_radius
from geoerr.drawing import drawn
from geoerr.errors import GeometryError, InputFileError, NotDeterminedError
from geoerr.machine import AXES, Machine
from geoerr.model import Model
from geoerr.model.called import check_model
from geoerr.model.conditions import Conditions
from geoerr.model.in_model import in_order
from geoerr.model.program_conditions import refuse_unneeded
from geoerr.observations import CircularTest
from geoerr.tables import RowProblem
from geoerr.verify.circle import (
    PLANES,
    CircleOfCommands,
    FittedCircle,
    SetUp,
    fit_circle,
    fit_set_up,
    plane_of,
    what_fits,
)
from geoerr.verify.circle_motion import conditions_on_circle, followed_on_circle
from geoerr.verify.circle_runs import FEWEST_ROWS, LEAST_ARC_RAD, runs_of
from geoerr.verify.remaining import compensate_positions

if TYPE_CHECKING:
    import plotly.graph_objects as go

Numbers = npt.NDArray[np.float64]

LI_CENTER_MM = (212.0, 270.0)
LI_RADIUS_MM = 100.0
_SENSE = {1: ", dir +1", -1: ", dir −1", 0: ""}
N_POINTS = 720

_UM_PER_MM = 1e3
# A commanded position farther from its run's circle than this share of the radius is not a point of the circle.
_OFF_CIRCLE = 1e-2
# Places that a circle takes.
_LEAST_OF_A_CIRCLE = 3
# Files have positions to a micrometre.
_DIGITS_MM = 1e-3
# What points five degrees apart leave of a circle at its sides, as a share of the radius.
_BETWEEN_POINTS = 1e-3
# Radius of a circle about the middle, as a share of the shorter edge.
_MIDDLE_SHARE = 0.45


@dataclass(frozen=True, eq=False)
class Trace:
    """One run round a circle.

    Attributes
    ----------
    circle
        The commanded circle.
    angle_rad : (n,)
        Commanded angle of each point about the commanded centre.
    points_mm : (n, 2)
        Actual positions in the plane, relative to the commanded centre.
    fitted
        Their least-squares circle.
    """

    circle: CircleOfCommands
    angle_rad: Numbers
    points_mm: Numbers
    fitted: FittedCircle

    @property
    def circular_deviation_mm(self) -> float:
        """G of ISO 230-4."""
        return self.fitted.circular_deviation_mm

    @property
    def radial_deviation_mm(self) -> Numbers:
        """Distance from the least-squares centre minus the least-squares radius, (n,)."""
        return self.fitted.deviation_mm

    @property
    def range_about_nominal_center_mm(self) -> float:
        """Largest minus smallest distance from the commanded centre (Li's text, without a fitted centre)."""
        return float(np.ptp(np.hypot(*self.points_mm.T)))

    def to_document(self) -> dict[str, Any]:
        """Give the figures of the trace in µm."""
        return {
            "circular_deviation_um": self.circular_deviation_mm * _UM_PER_MM,
            "range_about_nominal_center_um": self.range_about_nominal_center_mm * _UM_PER_MM,
            "center_offset_um": (self.fitted.center_mm * _UM_PER_MM).tolist(),
            "radius_deviation_um": (self.fitted.radius_mm - self.circle.radius_mm) * _UM_PER_MM,
        }


@dataclass(frozen=True)
class MeasuredRun:
    """One run of a measured circular test beside what the model predicts at the same commands.

    Attributes
    ----------
    name
        Line, session and repetition as the file names them.
    direction
        +1 counter-clockwise seen from + of the third axis, −1 clockwise, 0 unknown.
    measured
        The run: the measured radius at each commanded angle.
    predicted
        The model at the same commands.
    set_up
        Centre and constant of the radius that the mounting leaves free, and the difference without them.
    """

    name: str
    direction: int
    measured: Trace
    predicted: Trace
    set_up: SetUp

    @property
    def label(self) -> str:
        """Name with the sense of the run: two runs at one feed differ in nothing else."""
        return self.name + _SENSE[self.direction]

    def to_document(self) -> dict[str, Any]:
        """Give the comparison in µm."""
        return {
            "run": self.name,
            "dir": self.direction,
            "n": len(self.measured.angle_rad),
            "center_mm": list(self.measured.circle.center_mm),
            "radius_mm": self.measured.circle.radius_mm,
            "arc_deg": float(np.rad2deg(_covered_rad(self.measured.angle_rad))),
            "measured_circular_deviation_um": self.measured.circular_deviation_mm * _UM_PER_MM,
            "predicted_circular_deviation_um": self.predicted.circular_deviation_mm * _UM_PER_MM,
            "difference_rms_um": self.set_up.rms_mm * _UM_PER_MM,
            "set_up_center_um": (self.set_up.center_mm * _UM_PER_MM).tolist(),
            "set_up_radius_um": self.set_up.radius_offset_mm * _UM_PER_MM,
        }


@dataclass(frozen=True)
class CircularTestResult:
    """A circular test of a model.

    Attributes
    ----------
    before, after
        Counter-clockwise and clockwise trace without and with compensated commands. The two senses are the same path
        as long as the model has no term that depends on direction.
    eq23
        Li's Eq. 23 literally, counter-clockwise; None where it was not asked for.
    runs
        Measured runs compared with the model.
    assumed_zero
        Errors that the model's data do not determine or that are not in the model, and that are 0 in these figures.
    notes
        Sentences for the reader.
    set_aside
        Rows of the measured file that could not be used.
    is_predicted
        Whether the model itself carries out the commands, so that `after` proves nothing; else a known machine does.
    """

    before: tuple[Trace, Trace]
    after: tuple[Trace, Trace]
    eq23: Trace | None
    runs: tuple[MeasuredRun, ...]
    assumed_zero: tuple[str, ...]
    notes: tuple[str, ...]
    set_aside: tuple[RowProblem, ...] = ()
    is_predicted: bool = True

    def plot_circle(self) -> go.Figure:
        """Draw the deviation round the circle, before and after compensation, and what was measured."""
        return drawn("circular_test", self)

    def to_document(self) -> dict[str, Any]:
        """Give the result as plain values, lengths of the error in µm."""
        circle = self.before[0].circle
        return {
            "plane": circle.plane,
            "center_mm": list(circle.center_mm),
            "radius_mm": circle.radius_mm,
            "n_points": len(self.before[0].angle_rad),
            "before": {"ccw": self.before[0].to_document(), "cw": self.before[1].to_document()},
            "after": {"ccw": self.after[0].to_document(), "cw": self.after[1].to_document()},
            "eq23": None if self.eq23 is None else self.eq23.to_document(),
            "measured": [run.to_document() for run in self.runs],
            "trace": {
                "angle_deg": np.rad2deg(self.before[0].angle_rad).tolist(),
                "before_um": (self.before[0].radial_deviation_mm * _UM_PER_MM).tolist(),
                "after_um": (self.after[0].radial_deviation_mm * _UM_PER_MM).tolist(),
                "eq23_um": None if self.eq23 is None else (self.eq23.radial_deviation_mm * _UM_PER_MM).tolist(),
            },
            "assumed_zero": list(self.assumed_zero),
            "notes": list(self.notes),
            "set_aside": [str(problem) for problem in self.set_aside],
        }


def circle_to_test(
    model: Model,
    plane: str = "XY",
    center_mm: Sequence[float] | None = None,
    radius_mm: float | None = None,
) -> CircleOfCommands:
    """Choose the circle: Li's in the XY plane, the middle of the usable range in the others.

    Parameters
    ----------
    model
        Its machine's range, and the range that its errors were measured in, bound the circle.
    plane
        `XY`, `YZ` or `ZX`.
    center_mm
        Two numbers in the order of the plane's letters, or three with the level of the third axis last. Without a
        level the third axis stands at 0, or at the low end of what was measured where 0 lies outside.
    radius_mm
        100 mm where None.

    Raises
    ------
    GeometryError
        if the circle leaves the machine's or the measured range; the message says what would fit.
    """
    if plane not in PLANES:
        raise GeometryError(f"{plane!r} is not a plane of the circular test\nhint: planes are {', '.join(PLANES)}")
    first, second, third = PLANES[plane]
    low, high = usable_range_mm(model)
    if center_mm is None:
        middle = (low + high) / 2.0
        center_mm = LI_CENTER_MM if plane == "XY" else (float(middle[first]), float(middle[second]))
    position = [0.0, 0.0, 0.0]
    position[first], position[second] = float(center_mm[0]), float(center_mm[1])
    if len(center_mm) == 3:
        position[third] = float(center_mm[2])
    elif not low[third] <= 0.0 <= high[third]:
        position[third] = float(low[third])
    circle = CircleOfCommands(
        plane, (position[0], position[1], position[2]), LI_RADIUS_MM if radius_mm is None else float(radius_mm)
    )
    if not circle.radius_mm > 0.0 or not np.isfinite([*circle.center_mm, circle.radius_mm]).all():
        raise GeometryError(f"a circle of radius {circle.radius_mm:g} mm cannot be run\nhint: give a radius above 0")
    refusal = _refusal(model, circle)
    if refusal is not None:
        raise GeometryError(f"{refusal[0]}\nhint: {refusal[1]}")
    return circle


def middle_circle(model: Model, plane: str) -> CircleOfCommands:
    """Choose a circle about the middle of the usable range, as large as a usual bar where that fits.

    Raises
    ------
    GeometryError
        where there is no room for any.
    """
    low, high = usable_range_mm(model)
    order = list(PLANES[plane])
    room_mm = max(float((high - low)[order[:2]].min()), 0.0)
    middle = ((low + high) / 2.0)[order]
    # To a whole tenth of a millimetre, as somebody would program it.
    radius_mm = min(float(np.floor(10.0 * _MIDDLE_SHARE * room_mm) / 10.0), LI_RADIUS_MM)
    return circle_to_test(model, plane, middle.tolist(), radius_mm)


def usable_range_mm(model: Model) -> tuple[Numbers, Numbers]:
    """Give the box (low (3,), high (3,)) that is inside the machine's range and inside the measured one."""
    machine_low, machine_high = _machine_range_mm(model.machine)
    measured_low, measured_high = _measured_range_mm(model)
    return np.maximum(machine_low, measured_low), np.minimum(machine_high, measured_high)


def predict_trace(
    model: Model,
    circle: CircleOfCommands,
    *,
    clockwise: bool = False,
    n_points: int = N_POINTS,
    at: Conditions | None = None,
) -> Trace:
    """Predict the path of the tool, seen from the work, for a commanded circle (whole model, squareness included).

    Conditions that terms follow are in `at`; direction and travel follow from the sense, speeds from `feed`.
    """
    positions = circle.positions_mm(n_points, clockwise=clockwise)
    conditions = conditions_on_circle(model, circle, positions, -1 if clockwise else 1, at)
    return _trace(circle, positions, positions + model.error_mm(positions, at=conditions))


def predict_compensated_trace(
    model: Model,
    circle: CircleOfCommands,
    *,
    truth: Model | None = None,
    clockwise: bool = False,
    n_points: int = N_POINTS,
    at: Conditions | None = None,
) -> Trace:
    """Predict the path when the circle's commands are compensated by `model` and carried out by `truth`."""
    positions = circle.positions_mm(n_points, clockwise=clockwise)
    sense = -1 if clockwise else 1
    compensated = compensate_positions(
        model,
        positions,
        truth=truth,
        at=conditions_on_circle(model, circle, positions, sense, at),
        truth_at=None if truth is None else conditions_on_circle(truth, circle, positions, sense, at),
    )
    return _trace(circle, positions, positions + compensated.error_mm)


def li_eq23_trace(model: Model, circle: CircleOfCommands, *, n_points: int = N_POINTS) -> Trace:
    """Reproduce Li's Eq. 23 literally: ``x' = x + δ_xx + δ_xy − y ε_zx, y' = y + δ_yx + δ_yy``, without squareness.

    Raises
    ------
    GeometryError
        if the circle does not lie in the XY plane, or if Y does not ride on X on the tool side, for then the arm of
        ε_zx is another.
    NotDeterminedError
        if one of the five functions is not determined.
    """
    if circle.plane != "XY":
        raise GeometryError(f"Li's Eq. 23 is for the XY plane, not for {circle.plane}\nhint: leave --eq23 out")
    tool_axes = model.machine.tool_axes
    if not ("x" in tool_axes and "y" in tool_axes and tool_axes.index("x") < tool_axes.index("y")):
        raise GeometryError(
            f"Li's Eq. 23 holds where Y rides on X on the tool side, which it does not on {model.machine.chain}"
            "\nhint: leave --eq23 out; the whole model knows every chain"
        )
    unknown = {item.name: item.why for item in model.error_functions().not_determined}
    for name in ("EXX", "EXY", "ECX", "EYX", "EYY"):
        if name in unknown:
            raise NotDeterminedError(f"Li's Eq. 23 needs {name}, which is not determined: {unknown[name]}")
    positions = circle.positions_mm(n_points)
    x, y, _ = positions.T
    moved = positions.copy()
    moved[:, 0] += _at(model, "EXX", x) + _at(model, "EXY", y) - y * _at(model, "ECX", x)
    moved[:, 1] += _at(model, "EYX", x) + _at(model, "EYY", y)
    return _trace(circle, positions, moved)


def run_circular_test(
    model: Model,
    circle: CircleOfCommands,
    *,
    truth: Model | None = None,
    with_eq23: bool = False,
    measured: CircularTest | None = None,
    at: Conditions | None = None,
) -> CircularTestResult:
    """Run the whole circular test of a model.

    Parameters
    ----------
    model
        The model to test; it also computes the compensated commands.
    circle
        From `circle_to_test`, or `circle_of_first_run` of a measured test.
    truth
        The machine that makes the errors, for a simulation: before and after are then its own. `model` where None.
    with_eq23
        Reproduce Li's Eq. 23 beside the whole model.
    measured
        A measured circular test to compare with.
    at
        Conditions that terms follow, by name; `feed` in mm/min where they follow speeds. Where it is not stated
        measured runs are predicted at their own, and the rest at that of the first.

    Raises
    ------
    GeoerrError
        for conditions that are needed and not given, or given and not needed.
    GeometryError, NotDeterminedError
        from `li_eq23_trace`.
    InputFileError
        if no run of the measured test can be used.
    """
    check_model(model, (circle,), "run_circular_test(model, circle)")
    machine = model if truth is None else truth
    refuse_unneeded(at, followed_on_circle(model, machine))
    runs: tuple[MeasuredRun, ...] = ()
    set_aside: tuple[RowProblem, ...] = ()
    notes = []
    if measured is not None:
        runs, set_aside = compare_with_measured(model, measured, at=at)
        feed_mm_min = feed_of_first_run(model, measured, at)
        at = with_feed(at, feed_mm_min)
        notes += [f"{run.name}: {told}" for run in runs if (told := _other_radius_of(run)) is not None]
        if feed_mm_min is not None:
            notes.append(f"before and after are at the feed of the first measured run, {feed_mm_min:g} mm/min")
    positions = circle.positions_mm(N_POINTS)
    conditions = conditions_on_circle(model, circle, positions, 1, at)
    out_of_range = compensate_positions(model, positions, at=conditions).out_of_range(model.machine)
    if out_of_range:
        notes.append(
            f"compensated commands leave the range of {', '.join(out_of_range)}: "
            "a machine with soft limits would stop there"
        )
    absent = () if model.record is None else model.not_in_model
    assumed_zero = in_order({*absent, *(item.name for item in model.error_functions().not_determined)})
    return CircularTestResult(
        before=(predict_trace(machine, circle, at=at), predict_trace(machine, circle, clockwise=True, at=at)),
        after=(
            predict_compensated_trace(model, circle, truth=truth, at=at),
            predict_compensated_trace(model, circle, truth=truth, clockwise=True, at=at),
        ),
        eq23=li_eq23_trace(model, circle) if with_eq23 else None,
        runs=runs,
        assumed_zero=assumed_zero,
        notes=tuple(notes),
        set_aside=set_aside,
        is_predicted=truth is None,
    )


def compare_with_measured(
    model: Model, measured: CircularTest, *, at: Conditions | None = None
) -> tuple[tuple[MeasuredRun, ...], tuple[RowProblem, ...]]:
    """Compare each run of a measured circular test with the model at the same commands.

    A run is the rows of one session, line, repetition, direction and feed; centre and mean radius of its set-up are
    free. A model that follows speeds has those of the run's feed, where none is stated.

    Returns
    -------
    runs, set_aside
        The comparison of each run, and the rows that could not be used, with the reason.

    Raises
    ------
    InputFileError
        if no run can be used, a run leaves the machine's or the measured range, or `r` is not a radius.
    """
    path = measured.sources[0] if measured.sources else "-"
    runs: list[MeasuredRun] = []
    problems = list(measured.set_aside)
    for name, frame in runs_of(measured.frame):
        run, found = _compare_run(model, name, frame, path, at)
        problems.extend(found)
        if run is not None:
            runs.append(run)
    if not runs:
        last = problems[-1]
        raise InputFileError(path, f"no run can be used: {last.problem}", row=last.row, column=last.column)
    return tuple(runs), tuple(sorted(problems, key=lambda problem: problem.row))


def _other_radius_of(run: MeasuredRun) -> str | None:
    """Say that a run was measured on another circle than the commanded one; None where it was on that."""
    radius_mm = run.measured.circle.radius_mm
    return other_radius(np.array([radius_mm + run.set_up.radius_offset_mm]), radius_mm)


def circle_of_first_run(measured: CircularTest) -> CircleOfCommands:
    """Give the commanded circle of the first run of a measured test.

    Raises
    ------
    InputFileError
        if its commanded positions are not on a circle in a plane of the machine.
    """
    path = measured.sources[0] if measured.sources else "-"
    _, frame = next(iter(runs_of(measured.frame)))
    return _commanded_circle(frame, path)[0]


def feed_of_first_run(model: Model, measured: CircularTest, at: Conditions | None) -> float | None:
    """Give the feed of the first run, mm/min, where the model follows speeds and none is stated; else None."""
    _, frame = next(iter(runs_of(measured.frame)))
    return _feed_of(frame, model, at)


def with_feed(at: Conditions | None, feed_mm_min: float | None) -> Conditions | None:
    """Give conditions with a feed; as they are where that is None."""
    return at if feed_mm_min is None else {**({} if at is None else at), "feed": feed_mm_min}


def _feed_of(frame: pl.DataFrame, model: Model, at: Conditions | None) -> float | None:
    is_stated = at is not None and "feed" in at
    if is_stated or "feed" not in followed_on_circle(model):
        return None
    is_measured = "feed" in frame.columns and frame["feed"].null_count() == 0
    return float(frame["feed"].cast(pl.Float64).to_numpy()[0]) if is_measured else None


def _trace(circle: CircleOfCommands, commanded_mm: Numbers, actual_mm: Numbers) -> Trace:
    nominal = circle.in_plane(commanded_mm)
    points = circle.in_plane(actual_mm)
    return Trace(circle, np.arctan2(nominal[:, 1], nominal[:, 0]), points, fit_circle(points))


def _at(model: Model, name: str, position_mm: Numbers) -> Numbers:
    function = model.error_functions().functions.get(name)
    return np.zeros(len(position_mm)) if function is None else function.at(position_mm)


def _machine_range_mm(machine: Machine) -> tuple[Numbers, Numbers]:
    limits = np.array([machine.axes[name].range_mm for name in AXES], dtype=np.float64)
    return limits[:, 0], limits[:, 1]


def _measured_range_mm(model: Model) -> tuple[Numbers, Numbers]:
    """Give the box that the errors were measured in; infinite along an axis without tables."""
    limits = np.array([model.measured_range_mm[name] or (-np.inf, np.inf) for name in AXES], dtype=np.float64)
    return limits[:, 0], limits[:, 1]


def _ranges(model: Model) -> tuple[tuple[Numbers, Numbers, str], ...]:
    return (
        (*_machine_range_mm(model.machine), "the machine's range"),
        (*_measured_range_mm(model), "the range in which its errors were measured"),
    )


def _refusal(model: Model, circle: CircleOfCommands) -> tuple[str, str] | None:
    (low, high, what), (measured_low, measured_high, measured) = _ranges(model)
    # Errors that were measured at points of this very circle were measured on it.
    beside_mm = _BETWEEN_POINTS * circle.radius_mm
    problem = circle.leaves(low, high, what) or circle.leaves(measured_low, measured_high, measured, beside_mm)
    return None if problem is None else (problem, what_fits(circle, *usable_range_mm(model)))


def _point_outside(model: Model, commanded_mm: Numbers) -> tuple[int, str, str] | None:
    """Give number, axis and reason of the first point of a run that leaves a range: it is predicted nowhere else."""
    for low, high, what in _ranges(model):
        outside = np.argwhere((commanded_mm < low - _DIGITS_MM) | (commanded_mm > high + _DIGITS_MM))
        if len(outside):
            place, axis = map(int, outside[0])
            at = f"{AXES[axis]} = {commanded_mm[place, axis]:g} mm"
            return place, AXES[axis], f"{at} is outside {what}, {low[axis]:g} to {high[axis]:g} mm"
    return None


def _compare_run(
    model: Model, name: str, frame: pl.DataFrame, path: str, at: Conditions | None
) -> tuple[MeasuredRun | None, list[RowProblem]]:
    circle, commanded, radius, rows, problems = _checked_run(frame, path)
    if circle is None:
        return None, problems
    outside = _point_outside(model, commanded)
    if outside is not None:
        place, axis, why = outside
        raise InputFileError(
            path, f"{name}: {why}", row=rows[place], column=axis, remedy="measure, or verify, inside the range"
        )
    nominal = circle.in_plane(commanded)
    angle = np.arctan2(nominal[:, 1], nominal[:, 0])
    covered = _covered_rad(angle)
    if covered < LEAST_ARC_RAD:
        problem = f"{name} covers {np.rad2deg(covered):.0f}° of the circle, at least 90° are needed"
        return None, [*problems, RowProblem(path, rows[0], "x y z", problem)]
    at = with_feed(at, _feed_of(frame, model, at))
    conditions = conditions_on_circle(model, circle, commanded, _direction(frame, angle) or 1, at)
    actual = commanded + model.error_mm(commanded, at=conditions)
    predicted = _trace(circle, commanded, actual)
    third = circle.axes[2]
    set_up = fit_set_up(predicted.points_mm, actual[:, third], radius)
    # A bar measures from where it stands, which is not the commanded centre: laid at the commanded angle a radius
    # from elsewhere would make two lobes of e²/R out of a circle.
    arm = predicted.points_mm - set_up.center_mm
    points = set_up.center_mm + arm * (radius / np.hypot(*arm.T))[:, None]
    measured = Trace(circle, angle, points, fit_circle(points))
    return (
        MeasuredRun(
            name=name,
            direction=_direction(frame, angle),
            measured=measured,
            predicted=predicted,
            set_up=set_up,
        ),
        problems,
    )


def _checked_run(
    frame: pl.DataFrame, path: str
) -> tuple[CircleOfCommands | None, Numbers, Numbers, list[int], list[RowProblem]]:
    problems: list[RowProblem] = []
    rows = frame["file_row"].to_list()
    radius = frame["r"].to_numpy().astype(np.float64)
    commanded = frame.select("x", "y", "z").to_numpy().astype(np.float64)
    if len(frame) < FEWEST_ROWS:
        problem = f"{len(frame)} points; centre and radius of the set-up alone take three"
        return None, commanded, radius, rows, [RowProblem(path, rows[0], "r", problem)]
    circle, off = _commanded_circle(frame, path)
    for index in np.flatnonzero(off):
        problem = f"the commanded position is not on the run's circle of radius {circle.radius_mm:.6g} mm"
        problems.append(RowProblem(path, rows[index], "x y z", problem))
    remedy = no_radius(radius, circle.radius_mm)
    if remedy is not None:
        raise InputFileError(
            path,
            f"the median is {np.median(radius):g} mm on a circle of radius {circle.radius_mm:.6g} mm",
            row=rows[0],
            column="r",
            remedy=remedy,
        )
    mistaken = far_from_radius(radius, circle.radius_mm)
    problems += [
        RowProblem(path, rows[index], "r", f"{radius[index]:g} mm on a circle of radius {circle.radius_mm:.6g} mm")
        for index in np.flatnonzero(mistaken & ~off)
    ]
    keep = ~off & ~mistaken
    kept_rows = [row for row, good in zip(rows, keep, strict=True) if good]
    return circle, on_their_circle(commanded[keep]), radius[keep], kept_rows, problems


def _commanded_circle(frame: pl.DataFrame, path: str) -> tuple[CircleOfCommands, npt.NDArray[np.bool_]]:
    commanded = frame.select("x", "y", "z").to_numpy().astype(np.float64)
    row = int(frame["file_row"][0])
    span = np.ptp(commanded, axis=0)
    plane = plane_of(commanded)
    first, second, third = PLANES[plane]
    if span[third] > _OFF_CIRCLE * span[[first, second]].max():
        raise InputFileError(
            path,
            f"all three axes move (by {span[0]:g}, {span[1]:g}, {span[2]:g} mm)",
            row=row,
            column="x y z",
            remedy="a circular test lies in the XY, YZ or ZX plane",
        )
    in_plane = commanded[:, [first, second]]
    if len(np.unique(in_plane, axis=0)) < _LEAST_OF_A_CIRCLE:
        raise InputFileError(path, "fewer than three places, which a circle takes", row=row, column="x y z")
    off = np.zeros(len(frame), dtype=bool)
    try:
        fitted = fit_circle(in_plane)
        # One stray row pulls the circle; a second fit without the strays judges all rows.
        stray = np.abs(fitted.deviation_mm) > 3.0 * float(np.median(np.abs(fitted.deviation_mm)))
        if (~stray).sum() > max(len(frame) / 2, _LEAST_OF_A_CIRCLE - 1):
            fitted = fit_circle(in_plane[~stray])
        off = np.abs(np.hypot(*(in_plane - fitted.center_mm).T) - fitted.radius_mm) > _OFF_CIRCLE * fitted.radius_mm
        if off.sum() >= len(frame) / 2:
            raise GeometryError("most commanded positions are on no common circle")
        fitted = fit_circle(in_plane[~off])
    except GeometryError as error:
        raise InputFileError(
            path,
            str(error),
            row=row,
            column="x y z",
            remedy="x y z are the commanded positions along the circle, r the measured radius",
        ) from error
    center = np.zeros(3)
    center[[first, second]] = fitted.center_mm
    center[third] = float(np.median(commanded[:, third]))
    # Programs are written to the micrometre; the fit's last digits are round-off.
    rounded = np.round(center, 6)
    return (
        CircleOfCommands(
            plane, (float(rounded[0]), float(rounded[1]), float(rounded[2])), round(fitted.radius_mm, 6)
        ),
        off,
    )


def _direction(frame: pl.DataFrame, angle_rad: Numbers) -> int:
    if "dir" in frame.columns and frame["dir"][0] is not None:
        return int(np.sign(frame["dir"][0]))
    turns = np.angle(np.exp(1j * np.diff(angle_rad)))
    return int(np.sign(turns.sum()))


def _covered_rad(angle_rad: Numbers) -> float:
    """Give the arc that the angles cover: the whole turn without its widest gap, but a closed run is a whole turn."""
    ordered = np.sort(np.mod(angle_rad, 2.0 * np.pi))
    gaps = np.diff(np.append(ordered, ordered[0] + 2.0 * np.pi))
    widest = float(gaps.max())
    usual = 2.0 * float(np.median(gaps))
    return 2.0 * np.pi if widest <= max(usual, 2.0 * np.pi / 8.0) else 2.0 * np.pi - widest
