"""Li's nine-line method (Li §4.3): from observations to the 21 errors, with uncertainties and what is not determined.

1. Lines are recognised by the axis that moves and by its lever on the target (`passes`, `places`).
2. Distances along the lines give positioning, pitch and yaw: Eqs. 17 and 18 (`along`).
3. Lines 1 to 3 give each session's base frame (`frames`).
4. Positions across the lines give straightness directly and roll linearly (`transverse`); Eqs. 20 to 22 by name
   (`roll`).
5. Angles integrated give straightness the other way: Eq. 19 (`straightness`).
6. Everything is referred to the carriage origin, in the gauge of `docs/theory/gauge.md` (`axis`).
7. Directions of lines 1 to 3 in one session give squareness (`squareness`).

8. What these first-order equations neglect is found with the exact kinematics and taken off (`second_order`).

Every step is linear in the points to first order and carries its operator along; uncertainties are propagated through
it (`uncertainty`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from geoerr.arguments import check_choice
from geoerr.error_functions import ErrorFunctions
from geoerr.errors import GeometryError
from geoerr.fit import digest_of, sightings_of
from geoerr.fit.calibration import checked_calibration
from geoerr.identify.along import FittedPass
from geoerr.identify.assemble import assemble
from geoerr.identify.fitting import fit_passes
from geoerr.identify.frames import SessionFrame, session_frames
from geoerr.identify.linear import Numbers
from geoerr.identify.lone_rows import lone_rows
from geoerr.identify.measurements import Measurements, measurements_of
from geoerr.identify.offsets import offset_doubts
from geoerr.identify.passes import FoundPasses, find_passes
from geoerr.identify.places import Places, number_lines
from geoerr.identify.reasons import Findings
from geoerr.identify.second_order import corrected_functions, corrected_squareness, exact_points
from geoerr.identify.stages import Stages, run_stages
from geoerr.identify.straightness import TangentVerdict
from geoerr.identify.uncertainty import AxisScatter, Noise, axis_scatter, covariance_from_repeats, scaled
from geoerr.machine import AXES, Machine
from geoerr.model.called import check_machine, check_tables
from geoerr.observations import Observations

StraightnessMethod = Literal["direct", "integrated"]
RollMethod = Literal["linear", "li"]

_UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class FoundLine:
    """One line as it was recognised.

    Attributes
    ----------
    number
        Li's number, None for a further line.
    axis
        Moving axis.
    place_mm
        Lever of the axis on the target.
    n_points, n_passes
        Rows, and passes (one session, line, repeat and target each).
    sessions, carriers, targets
        Labels that occur.
    rms_mm
        Root mean square distance of its points from its passes' fitted lines.
    position_mm, deviation_mm : (k,)
        Commanded positions, and ΔL there (Li Fig. 9), the mean of its passes; 0 at the first position.
    """

    number: int | None
    axis: str
    place_mm: tuple[float, float, float]
    n_points: int
    n_passes: int
    sessions: tuple[str, ...]
    carriers: tuple[str, ...]
    targets: tuple[str, ...]
    rms_mm: float
    position_mm: Numbers
    deviation_mm: Numbers


@dataclass(frozen=True)
class NineLineResult:
    """The 21 errors with everything that speaks for or against them.

    Attributes
    ----------
    errors
        The error functions.
    lines
        What was recognised.
    missing_lines
        Li's numbers of lines that are not in the data.
    tangent
        Direct against integrated straightness, one verdict a function that has both.
    scatter
        Redundancy and scatter by axis.
    left_out
        Reason to number of rows that took no part.
    """

    errors: ErrorFunctions
    lines: tuple[FoundLine, ...]
    missing_lines: tuple[int, ...]
    tangent: tuple[TangentVerdict, ...]
    scatter: tuple[AxisScatter, ...]
    left_out: dict[str, int]

    def to_document(self) -> dict[str, Any]:
        """Give the diagnostics as plain values, for `--json`; lengths in µm."""
        return {
            "lines": [
                {
                    "number": line.number,
                    "axis": line.axis,
                    "lever_mm": list(line.place_mm),
                    "points": line.n_points,
                    "passes": line.n_passes,
                    "sessions": list(line.sessions),
                    "carriers": list(line.carriers),
                    "targets": list(line.targets),
                    "rms_um": line.rms_mm * _UM_PER_MM,
                }
                for line in self.lines
            ],
            "missing_lines": list(self.missing_lines),
            "straightness": [
                {
                    "name": verdict.name,
                    "rms_um": verdict.rms_mm * _UM_PER_MM,
                    "p_value": verdict.p_value,
                    "follows_tangent": verdict.follows,
                }
                for verdict in self.tangent
            ],
            "scatter": [
                {
                    "axis": one.axis,
                    "dof": one.dof,
                    "rms_um": None if one.rms_mm is None else one.rms_mm * _UM_PER_MM,
                    "chi_squared_per_dof": one.chi_squared_per_dof,
                    "p_value": one.p_value,
                    "birge_ratio": one.birge_ratio,
                }
                for one in self.scatter
            ],
            "left_out": self.left_out,
        }


def identify_nine_line(
    observations: Observations,
    machine: Machine,
    *,
    straightness: StraightnessMethod = "direct",
    roll: RollMethod = "linear",
    rig_sensitivity: npt.ArrayLike | None = None,
    rig_covariance: npt.ArrayLike | None = None,
    first_order: bool = False,
) -> ErrorFunctions:
    """Identify the 21 errors by Li's nine-line method; `analyze_nine_lines` gives the diagnostics too.

    Parameters
    ----------
    observations
        Measured target points.
    machine
        Chain, ranges and tool offset.
    straightness
        Which straightness is in `functions`: `direct` from the points or `integrated` from the angles (Eq. 19). The
        other is under `alternatives`, as `straightness-integrated` or `straightness-direct`.
    roll
        `linear`, or `li` for Eqs. 20 to 22; the other is under `alternatives`, as `roll-li` or `roll-linear`.
    rig_sensitivity : (n, 3, p), optional
        Derivative of each row's measured position by the calibration's parameters; NaN where it is unknown.
    rig_covariance : (p, p), optional
        Covariance of these parameters.
    first_order
        Leave Li's equations as they are printed, to first order. Otherwise what they neglect is found with the exact
        kinematics and taken off (`geoerr.identify.second_order`).

    Returns
    -------
    ErrorFunctions
        In the gauge of `docs/theory/gauge.md`, at the carriage origin; `not_determined` names the rest and why.

    Raises
    ------
    GeometryError
        if no line is recognised, or directions of travel are left-handed.
    ShapeError
        if the calibration's arrays do not fit the rows.
    GeoerrError
        for a straightness or roll that is none.
    """
    return analyze_nine_lines(
        observations,
        machine,
        straightness=straightness,
        roll=roll,
        rig_sensitivity=rig_sensitivity,
        rig_covariance=rig_covariance,
        first_order=first_order,
    ).errors


def analyze_nine_lines(
    observations: Observations,
    machine: Machine,
    *,
    straightness: StraightnessMethod = "direct",
    roll: RollMethod = "linear",
    rig_sensitivity: npt.ArrayLike | None = None,
    rig_covariance: npt.ArrayLike | None = None,
    first_order: bool = False,
) -> NineLineResult:
    """Identify the 21 errors and keep the diagnostics; arguments as for `identify_nine_line`."""
    check_choice("straightness", straightness, get_args(StraightnessMethod))
    check_choice("roll", roll, get_args(RollMethod))
    check_machine(machine, [observations], "identify_nine_line(observations, machine)")
    check_tables([observations], "identify_nine_line(observations, machine)", Observations)
    data = measurements_of(observations)
    rig = checked_calibration(rig_sensitivity, rig_covariance, len(data.measured_mm))
    # A row without pixels is no part of what the calibration moves.
    rig = None if rig is None else (np.nan_to_num(rig[0]), rig[1])
    found = find_passes(data, machine)
    passes, refused = fit_passes(found.passes, data)
    if not passes:
        raise GeometryError(_nothing_found(found, refused))
    places, frames, stages = _arithmetic(passes, data, machine)
    noise, scatter, noise_notes = _noise(data, passes, stages, rig)
    findings = Findings(machine, found, passes, places, frames, stages.functions)
    told, digest = _told_of(observations)
    doubts = [*offset_doubts(passes, data, frames, machine), *lone_rows(passes, data, observations)]
    notes = [*refused, *doubts, *stages.notes, *dict.fromkeys((*data.notes, *told)), *noise_notes]
    if first_order:
        errors, tangent = assemble(findings, data, stages, noise, straightness, roll, notes)
    else:
        first, _ = assemble(findings, data, stages, noise, "direct", "linear", notes)
        exact = exact_points(data, first, frames)
        passes_again, _ = fit_passes(found.passes, exact)
        places_again, frames_again, stages_again = _arithmetic(passes_again, exact, machine)
        findings_again = Findings(machine, found, passes_again, places_again, frames_again, stages_again.functions)
        again, _ = assemble(findings_again, exact, stages_again, noise, "direct", "linear", notes)
        stages = replace(stages, functions=corrected_functions(stages.functions, stages_again.functions))
        findings = replace(findings, axes=stages.functions)
        errors, tangent = assemble(findings, data, stages, noise, straightness, roll, notes)
        errors = replace(errors, squareness=corrected_squareness(first.squareness, again.squareness))
    return NineLineResult(
        errors=replace(errors, data_digest=digest),
        lines=_found_lines(places, passes, data),
        missing_lines=tuple(sorted(number for numbers in places.missing.values() for number in numbers)),
        tangent=tangent,
        scatter=tuple(scatter.values()),
        left_out=dict(found.left_out),
    )


def _told_of(observations: Observations) -> tuple[tuple[str, ...], str]:
    """Give what a fit of these data would note of them, and their digest; nothing of such as none is fitted to."""
    try:
        sightings = sightings_of(observations)
    except GeometryError:
        return (), ""
    return sightings.notes, digest_of(sightings)


def _arithmetic(
    passes: Sequence[FittedPass], data: Measurements, machine: Machine
) -> tuple[Places, dict[str, SessionFrame], Stages]:
    places = number_lines([one.source for one in passes], machine)
    frames = session_frames(data, [one.source for one in passes], [one.direction for one in passes], places, machine)
    return places, frames, run_stages(passes, data, frames, places, machine)


def _nothing_found(found: FoundPasses, refused: Sequence[str]) -> str:
    reasons = [f"{count} rows: {why}" for why, count in found.left_out.items()] + list(refused)
    return (
        "no line of points is in the observations"
        + "".join(f"\n  {reason}" for reason in reasons)
        + ("\nhint: move one axis at a time, to two positions or more; `carrier` says what the target is fixed to")
    )


def _noise(
    data: Measurements, passes: Sequence[FittedPass], stages: Stages, rig: tuple[Numbers, Numbers] | None
) -> tuple[Noise, dict[str, AxisScatter], list[str]]:
    """Settle the covariance of the points: stated and scaled where the data contradict it, or from repeats."""
    sources = [one.source for one in passes]
    is_stated = data.covariance_mm2 is not None
    scatter = {}
    for axis, along in stages.along.items():
        transverse = stages.transverse[axis]
        parts = [stage.scatter for stage in (along, transverse) if stage is not None]
        scatter[axis] = axis_scatter(axis, parts, is_stated)
    notes = []
    if data.covariance_mm2 is not None:
        rows = scaled(data.covariance_mm2, sources, scatter)
        for axis, one in scatter.items():
            if one.birge_ratio > 1.0:
                notes.append(
                    f"points along {axis.upper()} scatter {one.birge_ratio:.2f} times as much as their stated "
                    "uncertainty: uncertainties were multiplied by that (Birge ratio)"
                )
    else:
        estimated, dof = covariance_from_repeats(data, sources)
        if estimated is None:
            notes.append(
                "no uncertainties: the observations state none, and too few points were visited again to tell"
            )
            return Noise(None), scatter, notes
        rows = estimated
        notes.append(f"the observations state no uncertainty: it was taken from repeats ({dof} degrees of freedom)")
    if rig is None:
        if data.is_of_cameras:
            notes.append("the calibration's uncertainty is not included")
        return Noise(rows), scatter, notes
    return Noise(rows, *rig), scatter, notes


def _found_lines(places: Places, passes: Sequence[FittedPass], data: Measurements) -> tuple[FoundLine, ...]:
    lines = []
    for line in sorted(places.lines, key=lambda one: (one.axis, one.number or 10)):
        members = [passes[number] for number in line.passes]
        n_points = sum(len(one.source.rows) for one in members)
        square = sum(len(one.source.rows) * one.rms_mm**2 for one in members)
        position_mm, deviation_mm = _travel(members, data)
        lines.append(
            FoundLine(
                number=line.number,
                axis=line.axis,
                place_mm=(float(line.place_mm[0]), float(line.place_mm[1]), float(line.place_mm[2])),
                n_points=n_points,
                n_passes=len(members),
                sessions=tuple(dict.fromkeys(one.source.session for one in members)),
                carriers=tuple(dict.fromkeys(one.source.carrier for one in members)),
                targets=tuple(dict.fromkeys(one.source.target for one in members)),
                rms_mm=float(np.sqrt(square / n_points)),
                position_mm=position_mm,
                deviation_mm=deviation_mm,
            )
        )
    return tuple(lines)


def _travel(members: Sequence[FittedPass], data: Measurements) -> tuple[Numbers, Numbers]:
    """Give ΔL of a line's passes at each commanded position, each pass counted from its smallest position."""
    positions, deviations = [], []
    for one in members:
        q_mm = data.commanded_mm[one.source.rows, AXES.index(one.source.axis)]
        deviation_mm = one.along_mm - q_mm
        positions.append(q_mm)
        deviations.append(deviation_mm - deviation_mm[np.argmin(q_mm)])
    position_mm, entry = np.unique(np.concatenate(positions), return_inverse=True)
    mean = np.bincount(entry, np.concatenate(deviations)) / np.bincount(entry)
    return position_mm, mean - mean[0]
