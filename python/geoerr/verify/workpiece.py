"""The workpiece: relative positioning errors of measured points, before and after compensation (Li §5.4, Table 4).

Relative positioning error = error of a point against the first point of its line. The paper prints four RMSE without
saying which is which; here every group has its own before, after and ratio.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.errors import InputFileError
from geoerr.model import Model
from geoerr.observations import (
    MEASURED,
    Lengths,
    Observations,
    kind_of,
    observations_from_columns,
    read_lengths,
    read_observations,
)
from geoerr.summaries import counted
from geoerr.tables import RowProblem, read_raw
from geoerr.verify.ballbar import usable_range_mm
from geoerr.verify.remaining import compensate_positions

Numbers = npt.NDArray[np.float64]

_UM_PER_MM = 1e3
_NO_GROUP = "all points"
# Nominal positions of two files are the same to their digits.
_SAME_MM = 1e-3
# Of what the nominal points span, or of a nominal length: what is off by more in the middle is in another unit, of
# other axes or of another part. Inches are off by half of it.
_STRANGE = 0.3
# A turn that takes away this share of what is off is how the part lay, not what the machine did.
_MOSTLY_TURNED = 0.5


@dataclass(frozen=True, eq=False)
class RelativeErrors:
    """Relative positioning errors of one measured workpiece.

    Attributes
    ----------
    kind
        `points` (three components against the first point of the line) or `lengths` (measured minus nominal length).
    group : n texts
        Group of each error.
    error_mm : (n, 3) or (n, 1)
        The errors; NaN where a component was not measured. First points of lines are 0 by definition and left out.
    nominal_mm : (n, 3) or (n, 6)
        Nominal position of each point, or both nominal ends of each length.
    components
        What was measured of points: `mx`, `my`, `mz`; none of lengths.
    first_points
        Line to nominal position (mm) of the point that its errors refer to; empty for lengths.
    set_aside
        Rows that could not be used.
    notes
        Sentences for the reader.
    sources
        Files that they were read from.
    """

    kind: str
    group: tuple[str, ...]
    error_mm: Numbers
    nominal_mm: Numbers
    components: tuple[str, ...]
    first_points: dict[str, tuple[float, float, float]]
    set_aside: tuple[RowProblem, ...] = ()
    notes: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()

    def of_group(self, name: str | None) -> GroupFigures | None:
        """Give the figures of a group, of all errors together where None; None where there is no such error."""
        return self.of_rows(np.array([name is None or group == name for group in self.group], dtype=bool))

    def of_rows(self, mask: npt.NDArray[np.bool_]) -> GroupFigures | None:
        """Give the figures of some errors, by a mask (n,); None where there is none."""
        if not mask.any():
            return None
        errors = self.error_mm[mask]
        # As all error figures: the sum over components of each one's own mean square.
        squares = [
            float(np.mean(column[np.isfinite(column)] ** 2)) for column in errors.T if np.isfinite(column).any()
        ]
        lengths = np.sqrt(np.nansum(errors**2, axis=1))
        return GroupFigures(int(mask.sum()), len(squares), float(np.sqrt(sum(squares))), float(lengths.max()))


@dataclass(frozen=True)
class GroupFigures:
    """`n` errors with `n_components` measured components: their RMSE and the largest, in mm."""

    n: int
    n_components: int
    rmse_mm: float
    largest_mm: float

    def to_document(self) -> dict[str, Any]:
        """Give the figures in mm and µm."""
        return {
            "n": self.n,
            "n_components": self.n_components,
            "rmse_mm": self.rmse_mm,
            "rmse_um": self.rmse_mm * _UM_PER_MM,
            "largest_um": self.largest_mm * _UM_PER_MM,
        }


@dataclass(frozen=True)
class GroupComparison:
    """One row of the table: a group before and after; None where the file has no such group.

    `ratio` is RMSE after over RMSE before, of what both files measured; None where that is nothing, or was 0 before.
    """

    name: str
    before: GroupFigures | None
    after: GroupFigures | None
    ratio: float | None

    def to_document(self) -> dict[str, Any]:
        """Give the row as plain values."""
        return {
            "group": self.name,
            "before": None if self.before is None else self.before.to_document(),
            "after": None if self.after is None else self.after.to_document(),
            "ratio": self.ratio,
        }


@dataclass(frozen=True)
class WorkpieceResult:
    """Two workpieces compared: by group, and all groups together."""

    kind: str
    groups: tuple[GroupComparison, ...]
    total: GroupComparison
    notes: tuple[str, ...]
    set_aside: tuple[RowProblem, ...]

    def to_document(self) -> dict[str, Any]:
        """Give the comparison as plain values."""
        return {
            "kind": self.kind,
            "groups": [group.to_document() for group in self.groups],
            "all": self.total.to_document(),
            "notes": list(self.notes),
            "set_aside": [str(problem) for problem in self.set_aside],
        }


def compare_workpieces(before: RelativeErrors, after: RelativeErrors) -> WorkpieceResult:
    """Compare the workpieces made before and after compensation, as in Li's Table 4.

    Raises
    ------
    InputFileError
        if one holds points and the other lengths.
    """
    if before.kind != after.kind:
        names = [one.sources[0] if one.sources else other for one, other in ((before, "BEFORE"), (after, "AFTER"))]
        raise InputFileError(
            names[1],
            f"holds {after.kind}, and {names[0]} holds {before.kind}",
            remedy="measure both workpieces in the same way",
        )
    names = list(dict.fromkeys([*before.group, *after.group]))
    named = [_compared(before, after, name) for name in names]
    groups = tuple(group for group, _ in named)
    total, of_total = _compared(before, after, None)
    notes = [*before.notes, *after.notes]
    if before.components != after.components:
        notes.append(
            f"{' '.join(before.components)} were measured before, {' '.join(after.components)} after: with all three "
            "the workpiece is turned onto its nominal points first, and errors of more components are larger"
        )
    for group, note in named:
        notes += note
        if group.before is None or group.after is None:
            notes.append(f"group {group.name!r} is in one of the two files only and has no ratio")
        elif group.before.n != group.after.n:
            notes.append(f"group {group.name!r} has {group.before.n} errors before and {group.after.n} after")
    notes += of_total
    for line in sorted(set(before.first_points) & set(after.first_points)):
        if not np.allclose(before.first_points[line], after.first_points[line], rtol=0.0, atol=1e-6):
            notes.append(f"line {line!r} starts from different points before and after: its errors do not compare")
    return WorkpieceResult(
        kind=before.kind,
        groups=groups,
        total=total,
        notes=tuple(dict.fromkeys(notes)),
        set_aside=(*before.set_aside, *after.set_aside),
    )


def _compared(before: RelativeErrors, after: RelativeErrors, name: str | None) -> tuple[GroupComparison, list[str]]:
    """Compare a group, or all where None, and say so where its ratio is not that of the figures beside it."""
    first, second = before.of_group(name), after.of_group(name)
    row, ratio = "all" if name is None else name, None
    both = [_in_both(one, other, name) for one, other in ((before, after), (after, before))]
    common, kept = before.of_rows(both[0]), after.of_rows(both[1])
    if common is not None and kept is not None and common.rmse_mm > 0.0:
        ratio = kept.rmse_mm / common.rmse_mm
    group = GroupComparison(row, first, second, ratio)
    if first is None or second is None or (common, kept) == (first, second):
        return group, []
    what = f"{'the whole' if name is None else f'group {name!r}'} has other nominal {before.kind} before than after"
    if common is None or kept is None:
        return group, [f"{what}: none is in both files, and there is no ratio"]
    return group, [
        f"{what}: the ratio is that of what both files have, {counted(common.n, 'error')} before and {kept.n} after"
    ]


def _in_both(one: RelativeErrors, other: RelativeErrors, name: str | None) -> npt.NDArray[np.bool_]:
    """Tell which errors of one file, in a group or in all where None, the other has as well, (n,).

    What is measured of a point depends on its line: of all points, those are the same that are of one group. A length
    is itself in any group.
    """
    if name is None and one.kind == "points":
        masks = [_in_both(one, other, group) for group in dict.fromkeys(one.group)]
        return np.asarray(np.any(masks, axis=0), dtype=np.bool_)
    mine, others = (np.array([name in (None, group) for group in of.group], dtype=bool) for of in (one, other))
    there_mm = np.unique(_either_way(other.nominal_mm[others]), axis=0)
    mine[mine] = [bool((np.abs(there_mm - at_mm) <= _SAME_MM).all(axis=1).any()) for at_mm in one.nominal_mm[mine]]
    return mine


def _either_way(nominal_mm: Numbers) -> Numbers:
    """Give points (n, 3) as they are, and both ends of lengths (n, 6) in both orders: a length has no direction."""
    if nominal_mm.shape[1] == 3:
        return nominal_mm
    return np.concatenate([nominal_mm, np.roll(nominal_mm, 3, axis=1)])


def read_relative_errors(path: str | Path) -> RelativeErrors:
    """Read a measured workpiece: points with `carrier` = `relative`, or lengths.

    Raises
    ------
    InputFileError
        if the file is neither, or no row of it can be used.
    """
    if str(path) == "-":
        raise InputFileError(path, "a workpiece is not read from standard input", remedy="name a file")
    if kind_of(read_raw(path).columns) == "lengths":
        return errors_of_lengths(read_lengths(path))
    return errors_of_points(read_observations(path))


def errors_of_lengths(lengths: Lengths) -> RelativeErrors:
    """Give measured minus nominal length of each feature."""
    frame = lengths.frame
    ends = frame.select("x1", "y1", "z1", "x2", "y2", "z2").to_numpy().astype(np.float64)
    nominal = np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1)
    error = frame["measured"].to_numpy().astype(np.float64) - nominal
    _refuse_strangers(
        lengths.sources,
        "measured",
        np.abs(error),
        float(np.median(nominal)),
        "the measured lengths",
        "the nominal ones",
    )
    return RelativeErrors(
        kind="lengths",
        group=_groups(frame),
        error_mm=error[:, None],
        nominal_mm=ends,
        components=(),
        first_points={},
        set_aside=lengths.set_aside,
        sources=tuple(map(str, lengths.sources)),
    )


def errors_of_points(observations: Observations) -> RelativeErrors:
    """Give the error of each point against the first point of its line, in base axes.

    `x y z` are the positions that the program names before compensation, in both workpieces. Where all three
    components were measured, each session's measuring frame is turned onto the nominal points first (least squares
    over the whole workpiece); where one is missing throughout it is parallel to the base already. A line is the rows
    of one session, line and repetition.

    Raises
    ------
    InputFileError
        if no row is `relative`, or no line has a second point.
    """
    path = observations.sources[0] if observations.sources else "-"
    frame = observations.frame
    problems = list(observations.set_aside)
    usable = np.ones(frame.height, dtype=bool)
    rows = frame["file_row"].to_list()
    for index, carrier in enumerate(observations.texts("carrier")):
        if carrier != "relative":
            usable[index] = False
            problem = f"{carrier!r} is not a point of a workpiece: its carrier is 'relative'"
            problems.append(RowProblem(path, rows[index], "carrier", problem))
    if not usable.any():
        raise InputFileError(
            path,
            "no row is measured on a workpiece",
            row=rows[0],
            column="carrier",
            remedy="give the column carrier with the value relative",
        )
    measured = observations.measured_mm
    components = np.flatnonzero(np.isfinite(measured[usable]).any(axis=0))
    if not components.size:
        raise InputFileError(path, "no row has a measured position", row=rows[0], column=" ".join(MEASURED))
    names = [MEASURED[component] for component in components]
    for index in np.flatnonzero(usable & ~np.isfinite(measured[:, components]).all(axis=1)).tolist():
        usable[index] = False
        problems.append(RowProblem(path, rows[index], " ".join(names), "not all were measured"))
    kept = observations.select(usable)
    if not len(kept):
        raise InputFileError(path, "no row has all components measured", row=rows[0], column=" ".join(names))
    errors, off_mm, first_points, is_first = _relative_to_first(kept)
    nominal = kept.commanded_mm + kept.target_offset_mm
    _refuse_strangers(
        observations.sources,
        " ".join(names),
        np.linalg.norm(off_mm[:, components], axis=1),
        float(np.ptp(nominal, axis=0).max()),
        "the measured points",
        "the nominal ones",
    )
    if is_first.all():
        raise InputFileError(
            path,
            "no line has a second point",
            column="line",
            remedy="give all points of one printed line the same name in the column line",
        )
    notes = []
    started_late = {problem.row for problem in problems} & _first_rows(frame)
    if started_late:
        notes.append(
            f"{path}: the first point of {len(started_late)} line(s) cannot be used; "
            "the errors of these lines refer to the next point"
        )
    if len(components) == 2:
        notes += _lay_turned(path, kept, nominal[:, components], kept.measured_mm[:, components])
    group = _groups(kept.frame)
    return RelativeErrors(
        kind="points",
        group=tuple(name for name, first in zip(group, is_first, strict=True) if not first),
        error_mm=errors[~is_first][:, components],
        nominal_mm=kept.commanded_mm[~is_first],
        components=tuple(names),
        first_points=first_points,
        set_aside=tuple(sorted(problems, key=lambda problem: problem.row)),
        notes=tuple(notes),
        sources=tuple(map(str, observations.sources)),
    )


def _refuse_strangers(
    sources: Sequence[str], column: str, off_mm: Numbers, span_mm: float, what: str, others: str
) -> None:
    """Refuse numbers in another unit, of other axes, or of another part: half of them are off by too much."""
    middle = float(np.median(off_mm)) if len(off_mm) else 0.0
    if middle > _STRANGE * span_mm > 0.0:
        raise InputFileError(
            sources[0] if sources else "-",
            f"{what} do not follow {others}: half of them are off by more than {middle:.4g} mm over {span_mm:.4g} mm",
            column=column,
            remedy="check that they are in mm, along the axes that their columns name, and of this program",
        )


def _lay_turned(path: str, kept: Observations, nominal: Numbers, measured: Numbers) -> Iterable[str]:
    """Say of each session with two components how far the part lay turned, where that is most of what is off."""
    sessions = np.asarray(kept.texts("session"))
    for session in dict.fromkeys(sessions.tolist()):
        rows = sessions == session
        ideal, seen = (one[rows] - one[rows].mean(axis=0) for one in (nominal, measured))
        turn = np.arctan2((ideal[:, 0] * seen[:, 1] - ideal[:, 1] * seen[:, 0]).sum(), (ideal * seen).sum())
        back = seen @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        before, after = (float(np.sqrt(((one - ideal) ** 2).sum(axis=1).mean())) for one in (seen, back))
        if after < _MOSTLY_TURNED * before:
            which = "" if len(set(sessions.tolist())) == 1 else f" of session {session!r}"
            yield (
                f"{path}: two components are taken to be along the machine's axes; points{which} turned by "
                f"{1e3 * turn:+.3g} mrad would be off by {_UM_PER_MM * after:.3g} µm and not by "
                f"{_UM_PER_MM * before:.3g}: align the part where it is measured, or measure all three"
            )


@dataclass(frozen=True, eq=False)
class Pattern:
    """A pattern of printed lines: `position_mm` (n, 3), and line and group of each point."""

    position_mm: Numbers
    line: tuple[str, ...]
    group: tuple[str, ...]


def li_pattern(model: Model, n_lines: int = 5, n_points: int = 9, margin_mm: float = 20.0) -> Pattern:
    """Lay Li's kind of pattern over the usable range: horizontal lines along X, vertical ones along Y (Li Fig. 15).

    Parameters
    ----------
    model
        Its machine's and its measured range bound the pattern; Z stands at 0 or at the low end of that range.
    n_lines, n_points
        Lines of each group, points of each line.
    margin_mm
        Kept free all round, so that compensated commands stay inside; less where the range is short.
    """
    low, high = usable_range_mm(model)
    margin = min(margin_mm, float((high - low)[:2].min()) / 4.0)
    level = 0.0 if low[2] <= 0.0 <= high[2] else float(low[2])
    start, end = low + margin, high - margin
    positions: list[tuple[float, float, float]] = []
    line: list[str] = []
    group: list[str] = []
    for number, y in enumerate(np.linspace(start[1], end[1], n_lines), start=1):
        for x in np.linspace(start[0], end[0], n_points):
            positions.append((float(x), float(y), level))
            line.append(f"h{number}")
            group.append("horizontal")
    for number, x in enumerate(np.linspace(start[0], end[0], n_lines), start=1):
        for y in np.linspace(start[1], end[1], n_points):
            positions.append((float(x), float(y), level))
            line.append(f"v{number}")
            group.append("vertical")
    return Pattern(np.array(positions), tuple(line), tuple(group))


def predict_workpiece(
    model: Model, pattern: Pattern, *, compensated: bool, truth: Model | None = None
) -> Observations:
    """Predict what a measuring machine would find on a workpiece, as observations (`carrier` = `relative`).

    Parameters
    ----------
    model
        The model that computes compensated commands.
    pattern
        Nominal points.
    compensated
        Whether the program was compensated.
    truth
        The machine that makes the part (a simulation's truth); `model` where None.
    """
    machine = model if truth is None else truth
    if compensated:
        error = compensate_positions(model, pattern.position_mm, truth=truth).error_mm
    else:
        error = machine.error_mm(pattern.position_mm)
    measured = pattern.position_mm + error
    n_points = len(pattern.line)
    columns: dict[str, Numbers | list[str]] = {
        "line": list(pattern.line),
        "group": list(pattern.group),
        "carrier": ["relative"] * n_points,
    }
    for number, name in enumerate("xyz"):
        columns[name] = np.ascontiguousarray(pattern.position_mm[:, number])
        columns[f"m{name}"] = np.ascontiguousarray(measured[:, number])
    return observations_from_columns(columns, "predicted workpiece")


def _relative_to_first(
    observations: Observations,
) -> tuple[Numbers, Numbers, dict[str, tuple[float, float, float]], npt.NDArray[np.bool_]]:
    """Give errors against the first point of each line, and against the middle of the session, (n, 3) each."""
    nominal = observations.commanded_mm + observations.target_offset_mm
    measured = observations.measured_mm
    errors, off_mm = np.full(nominal.shape, np.nan), np.full(nominal.shape, np.nan)
    is_first = np.zeros(len(observations), dtype=bool)
    first_points: dict[str, tuple[float, float, float]] = {}
    sessions = np.asarray(observations.texts("session"))
    for session in dict.fromkeys(sessions.tolist()):
        of_session = np.flatnonzero(sessions == session)
        in_base = _in_base_axes(nominal[of_session], measured[of_session])
        error = in_base - nominal[of_session]
        off_mm[of_session] = error - error.mean(axis=0)
        for line, of_line in _lines(observations.frame[of_session]):
            errors[of_session[of_line]] = error[of_line] - error[of_line[0]]
            is_first[of_session[of_line[0]]] = True
            first = nominal[of_session[of_line[0]]]
            first_points[line] = (float(first[0]), float(first[1]), float(first[2]))
    return errors, off_mm, first_points, is_first


def _lines(frame: pl.DataFrame) -> Iterable[tuple[str, npt.NDArray[np.intp]]]:
    names = [
        f"{line}, repeat {repeat}" if repeat else str(line)
        for line, repeat in zip(frame["line"].to_list(), frame["repeat"].to_list(), strict=True)
    ]
    for name in dict.fromkeys(names):
        yield name, np.array([index for index, other in enumerate(names) if other == name], dtype=np.intp)


def _first_rows(frame: pl.DataFrame) -> set[int]:
    return set(frame.group_by("session", "line", "repeat", maintain_order=True).first()["file_row"].to_list())


def _in_base_axes(nominal_mm: Numbers, measured_mm: Numbers) -> Numbers:
    """Turn measured points (n, 3) onto nominal ones (Kabsch); a frame with a component missing is parallel already.

    Points on one straight line leave the turn about it open; lengths of errors, all that is reported, do not feel it.
    """
    if not np.isfinite(measured_mm).all():
        return measured_mm
    centred_nominal = nominal_mm - nominal_mm.mean(axis=0)
    u, _, vt = np.linalg.svd((measured_mm - measured_mm.mean(axis=0)).T @ centred_nominal)
    sign = np.sign(np.linalg.det(vt.T @ u.T))
    base_from_measuring = vt.T @ np.diag([1.0, 1.0, sign]) @ u.T
    return np.asarray(measured_mm @ base_from_measuring.T)


def _groups(frame: pl.DataFrame) -> tuple[str, ...]:
    if "group" not in frame.columns:
        return (_NO_GROUP,) * frame.height
    return tuple(name or "without group" for name in frame["group"].cast(pl.String).to_list())
