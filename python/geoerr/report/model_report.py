"""Everything that the report of a model shows: computed by the rooms that it belongs to, here it is only gathered.

A part that the model or the measurements cannot support is left out, with what would be needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from geoerr.budget import Budget, UncertaintyMap, uncertainty_budget, uncertainty_map
from geoerr.column_names import is_temperature
from geoerr.diagnose import Comparison, Diagnosis, compare, diagnose
from geoerr.diagnose.circles import CircleDiagnosis, diagnose_circles
from geoerr.diagnose.stages import Stage, stages_of
from geoerr.diagnose.steps import OnStep
from geoerr.diagnose.straight_lines import StraightLine, straight_lines
from geoerr.effects import Effect
from geoerr.error_functions import ErrorFunctions
from geoerr.errors import GeoerrError
from geoerr.fit import FitResult
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.conditions import REFERENCE
from geoerr.model.in_model import in_order, needed_by
from geoerr.model.program_conditions import (
    approach_conditions,
    needed_conditions,
    refuse_unneeded,
    without_waves_in_time,
)
from geoerr.observations import CircularTest, MeasuredTable, Observations, place_numbers
from geoerr.report.page import Progress
from geoerr.summaries import by_reason
from geoerr.verify.ballbar import (
    CircularTestResult,
    circle_of_first_run,
    feed_of_first_run,
    middle_circle,
    run_circular_test,
    usable_range_mm,
    with_feed,
)
from geoerr.verify.circle import PLANES
from geoerr.verify.circle_motion import followed_on_circle
from geoerr.verify.positioning import (
    PositioningTest,
    axis_line_mm,
    diagonals_mm,
    positioning_test,
    predict_positioning,
    why_no_test,
)

MACHINE = "The machine"
DATA = "The measurements"
ERRORS = "The 21 errors"
FIELD = "Error over the volume"
CIRCLES = "Circular tests (ISO 230-4)"
POSITIONING = "Positioning of each axis (ISO 230-2)"
DIAGONALS = "Space diagonals (ISO 230-6)"
COMPARISON = "The model against the measurements"
DIAGNOSIS = "What is missing"
STORY = "How the error fell"
BUDGET = "Uncertainty"
NOT_DETERMINED = "What is not determined"

_NO_MEASUREMENTS = "no measurements are given beside the model"
_NO_ERRORS = "this is the machine without any errors: fit a model to measurements"
_NO_VALUES = "some of the model's parameters have no value yet: fit it to measurements"

_T = TypeVar("_T")
Stated = dict[str, float | str]


@dataclass(frozen=True)
class LeftOut:
    """A part of the report that is not there, and why: what it would need."""

    section: str
    why: str


@dataclass(frozen=True, eq=False)
class MeasuredLine:
    """A line of the measurements that was run both ways, and its figures.

    Attributes
    ----------
    line, test
        The readings and their figures; as the standard has it, all readings are in them.
    without_alone
        Figures without the readings that stand alone, most likely mistakes; None where no reading does, or too few
        targets are left.
    """

    line: StraightLine
    test: PositioningTest
    without_alone: PositioningTest | None = None

    @property
    def ends_mm(self) -> tuple[Numbers, Numbers]:
        """First and last target of the figures, axis positions; the line may have readings beyond them."""
        way = self.line.end_mm - self.line.start_mm
        unit = way / np.linalg.norm(way)
        first, last = (self.line.start_mm + place * unit for place in self.test.position_mm[[0, -1]])
        return first, last

    @property
    def n_alone(self) -> int:
        """Readings in the figures that stand alone: at targets that were reached from both sides."""
        target, sense = place_numbers(self.line.position_mm), self.line.direction
        in_figures = np.isin(target, target[sense > 0.0]) & np.isin(target, target[sense < 0.0]) & (sense != 0.0)
        return int((self.line.is_alone & in_figures).sum())


@dataclass(frozen=True, eq=False)
class ModelReport:
    """What a report of a model shows.

    Attributes
    ----------
    model
        The model.
    at
        Conditions of all predictions; `assumed` names those that nobody stated.
    errors
        The 21 errors as tables, of those that the model has; None of a machine without errors.
    has_field
        Whether the error over the volume can be predicted.
    circles
        A circle in each plane, then those of measured circular tests.
    measured_lines
        Lines of the measurements along one axis, run both ways.
    measured_diagonals
        The same along several axes at once.
    predicted_lines
        For each axis the model's, through the middle of the volume.
    diagonals
        The model's four space diagonals.
    comparison, diagnosis
        By the measurements.
    stages
        How the error fell, by the model's own history.
    budget, volume
        Uncertainty at the corners, the centre and the worst place, and over the volume.
    left_out
        What is not there, and why.
    """

    model: Model
    at: Stated
    assumed: tuple[str, ...]
    errors: ErrorFunctions | None
    has_field: bool
    circles: tuple[CircularTestResult, ...]
    measured_lines: tuple[MeasuredLine, ...]
    measured_diagonals: tuple[MeasuredLine, ...]
    predicted_lines: dict[str, PositioningTest]
    diagonals: dict[str, PositioningTest]
    comparison: Comparison | None
    diagnosis: Diagnosis | CircleDiagnosis | None
    stages: tuple[Stage, ...]
    budget: Budget | None
    volume: UncertaintyMap | None
    left_out: tuple[LeftOut, ...]

    @cached_property
    def comparison_document(self) -> dict[str, Any]:
        """Figures of the comparison; empty where there is none."""
        return {} if self.comparison is None else self.comparison.to_document()

    @property
    def predicted_by(self) -> Model:
        """The model without waves in time: they are at no place but at a moment."""
        return without_waves_in_time(self.model)

    @property
    def prediction_conditions(self) -> Stated:
        """What a prediction at a place is given: the conditions, and that it was reached from below, at rest."""
        return _at_a_place(self.predicted_by, self.at)

    @property
    def not_in_model(self) -> tuple[str, ...]:
        """Names of what the model does not have, and every prediction takes as 0; none where it has no errors."""
        return () if self.model.is_nominal else self.model.not_in_model

    @property
    def not_determined(self) -> tuple[str, ...]:
        """Names of what the model's data do not determine, and every prediction takes as 0."""
        return () if self.errors is None else tuple(item.name for item in self.errors.not_determined)

    @property
    def left_out_by_reason(self) -> dict[str, tuple[str, ...]]:
        """What is not there, by the reason."""
        return by_reason((one.section, one.why) for one in self.left_out)

    @property
    def diagonal_systematic_um(self) -> float | None:
        """E_d of ISO 230-6: the largest systematic deviation of the four diagonals."""
        return max((one.systematic_um for one in self.diagonals.values()), default=None)

    @property
    def diagonal_reversal_um(self) -> float | None:
        """B_d of ISO 230-6: the largest reversal of the four diagonals."""
        return max((one.reversal_um for one in self.diagonals.values()), default=None)

    def to_document(self) -> dict[str, Any]:
        """Give the figures as plain values, for `--json`."""
        return {
            "machine": self.model.machine.to_document(),
            "conditions": dict(self.at),
            "iso_230_2": {
                "measured": [_line_document(one) for one in self.measured_lines],
                "predicted": {axis: one.to_document() for axis, one in self.predicted_lines.items()},
            },
            "iso_230_4": [
                {name: value for name, value in one.to_document().items() if name not in ("trace", "set_aside")}
                for one in self.circles
            ],
            "iso_230_6": {
                "E_d_um": self.diagonal_systematic_um,
                "B_d_um": self.diagonal_reversal_um,
                "measured": [_line_document(one) for one in self.measured_diagonals],
                "predicted": {name: one.to_document() for name, one in self.diagonals.items()},
            },
            "comparison": self.comparison_document or None,
            "diagnosis": None if self.diagnosis is None else self.diagnosis.to_document(),
            "budget": None if self.budget is None else self.budget.to_document(),
            "history": [{"name": stage.name, **stage.figures} for stage in self.stages],
            "left_out": [{"section": one.section, "why": one.why} for one in self.left_out],
        }


def model_report(
    model: Model,
    *tables: MeasuredTable,
    at: Stated | None = None,
    search: bool = True,
    diagnosis: Diagnosis | CircleDiagnosis | None = None,
    effects: Sequence[Effect] = (),
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    progress: Progress | None = None,
    on_step: OnStep | None = None,
    threads: int = 0,
) -> ModelReport:
    """Gather what the report of a model shows.

    Parameters
    ----------
    model
        Fitted, of tables, or nominal.
    tables
        Measured points, circular tests, lengths; none for the model alone.
    at
        Conditions of the predictions. A temperature that is not stated is the machine's reference temperature.
    search
        Whether to look for what the model lacks: it takes longer than all the rest.
    diagnosis
        What was found already: then nothing is searched.
    effects
        A user's own, for the search.
    rig_sensitivity, rig_covariance
        The calibration's uncertainty, as for `geoerr.compare`.
    progress
        Called with the steps done and their number.
    on_step
        Called with what comes next, in words.

    Raises
    ------
    GeoerrError
        for a stated condition that the model does not follow, and measurements that cannot be compared with it.
    """
    refuse_unneeded(at, followed_on_circle(model))
    given = dict(at or {})
    assumed = tuple(name for name in needed_conditions(model) if is_temperature(name) and name not in given)
    stated = {**given, **dict.fromkeys(assumed, REFERENCE)}
    steps = _Steps(progress, on_step)
    steps.say("the model and the measurements are compared")
    parts = _Parts()
    points = [table for table in tables if isinstance(table, Observations)]
    circles = [table for table in tables if isinstance(table, CircularTest)]
    comparison = None
    if tables:
        comparison = compare(
            model, *tables, rig_sensitivity=rig_sensitivity, rig_covariance=rig_covariance, threads=threads
        )
    steps.done()

    def look() -> Diagnosis | CircleDiagnosis:
        if len(circles) == len(tables):
            return diagnose_circles(
                model, *circles, effects=effects, progress=steps.search, on_step=on_step, threads=threads
            )
        return diagnose(
            model,
            *tables,
            effects=effects,
            rig_sensitivity=rig_sensitivity,
            rig_covariance=rig_covariance,
            progress=steps.search,
            on_step=on_step,
            threads=threads,
        )

    if diagnosis is None:
        why = _no_search(tables, search)
        diagnosis = parts.tried(DIAGNOSIS, look, unless=why)
    steps.say("measured lines")
    straight = straight_lines(model.machine, *points, threads=threads)
    lines = tuple(one for line in straight if (one := _measured_line(line)) is not None)
    along_one, along_several = (
        tuple(one for one in lines if (len(one.line.moving) > 1) == is_several) for is_several in (False, True)
    )
    _lack_tests(parts, straight)
    steps.done()
    at_places = without_waves_in_time(model)
    steps.say("the 21 errors, circles, lines and diagonals as the model predicts them")
    errors, has_field, circular, predicted, diagonals = _predictions(parts, at_places, circles, stated)
    for section, is_there in ((POSITIONING, predicted or along_one), (DIAGONALS, diagonals or along_several)):
        if is_there:
            parts.drop(section)
    steps.done()
    steps.say("the uncertainty budget")
    budget, volume = _budget(parts, at_places, comparison, stated)
    stages = () if model.record is None else stages_of(model.record.history)
    if not stages:
        parts.lack(STORY, "the model has no history: `geoerr add` and `geoerr remove` write it")
    if comparison is None:
        parts.lack(COMPARISON, _NO_MEASUREMENTS)
        if model.record is None:
            parts.lack(DATA, _NO_MEASUREMENTS)
    steps.done()
    return ModelReport(
        model,
        stated,
        assumed,
        errors,
        has_field,
        circular,
        along_one,
        along_several,
        predicted,
        diagonals,
        comparison,
        diagnosis,
        stages,
        budget,
        volume,
        parts.left_out,
    )


def _measured_line(line: StraightLine) -> MeasuredLine | None:
    """Sum up a line with all its readings, and without those that stand alone; None where it is no test."""
    test = _test_of(line, np.ones(len(line.direction), dtype=bool))
    if test is None:
        return None
    found = MeasuredLine(line, test)
    return replace(found, without_alone=_test_of(line, ~line.is_alone)) if found.n_alone else found


def _lack_tests(parts: _Parts, lines: Sequence[StraightLine]) -> None:
    """Say why measured lines are no test, where no prediction stands for them."""
    for section, is_several in ((POSITIONING, False), (DIAGONALS, True)):
        whys: dict[str, list[str]] = {}
        for line in lines:
            if (len(line.moving) > 1) == is_several:
                whys.setdefault(why_no_test(line.position_mm, line.direction), []).append(line.moving.upper())
        if whys:
            parts.lack(section, "; ".join(f"{_lines_along(axes)}: {why}" for why, axes in whys.items()))


def _lines_along(axes: Sequence[str]) -> str:
    many = "lines" if len(axes) > 1 else "a line"
    return f"{many} along {', '.join(dict.fromkeys(axes))} {'were' if len(axes) > 1 else 'was'} measured"


def _test_of(line: StraightLine, kept: npt.NDArray[np.bool_]) -> PositioningTest | None:
    return positioning_test(line.position_mm[kept], line.deviation_um[kept], line.direction[kept])


def _no_search(tables: Sequence[Any], search: bool) -> str | None:
    """Say why nothing is searched; None where it is."""
    if not tables:
        return _NO_MEASUREMENTS
    return None if search else "the search was not wanted"


class _Steps:
    """Counts what is done: the comparison, the steps of the search, lines, predictions, the budget."""

    _OWN = 4

    def __init__(self, progress: Progress | None, on_step: OnStep | None) -> None:
        self._tell = progress or (lambda done, total: None)
        self.say = on_step or (lambda what: None)
        self._done = 0
        self._searched = 0

    def done(self) -> None:
        self._done += 1
        self._tell(self._done + self._searched, self._OWN + self._searched)

    def search(self, done: int, total: int) -> None:
        self._searched = total
        self._tell(self._done + done, self._OWN + total)


class _Parts:
    """What is left out, in the order in which it was found."""

    def __init__(self) -> None:
        self._lacking: dict[str, str] = {}

    def lack(self, section: str, why: str) -> None:
        self._lacking.setdefault(section, why)

    def drop(self, section: str) -> None:
        self._lacking.pop(section, None)

    def refused(self, section: str, error: GeoerrError) -> None:
        problem, _, hint = str(error).partition("\nhint: ")
        self.lack(section, f"{problem}; {hint}" if hint else problem)

    def tried(self, section: str, make: Callable[[], _T], *, unless: str | None = None) -> _T | None:
        """Make something, unless there is a reason not to; what refuses it is why the section is left out."""
        if unless is not None:
            self.lack(section, unless)
            return None
        try:
            return make()
        except GeoerrError as error:
            self.refused(section, error)
            return None

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        return tuple(LeftOut(*item) for item in self._lacking.items())


def _predictions(
    parts: _Parts, model: Model, measured: Sequence[CircularTest], stated: Stated
) -> tuple[
    ErrorFunctions | None,
    bool,
    tuple[CircularTestResult, ...],
    dict[str, PositioningTest],
    dict[str, PositioningTest],
]:
    """Predict all that the model can say of the machine under these conditions."""
    constants = _followed(model, stated)
    if not model.has_values or model.is_nominal:
        why = _NO_ERRORS if model.has_values else _NO_VALUES
        for section in (ERRORS, FIELD, POSITIONING, DIAGONALS):
            parts.lack(section, why)
        if not model.has_values or not measured:
            parts.lack(CIRCLES, why)
            return None, False, (), {}, {}
        return None, False, _circles(parts, model, (), measured, stated), {}, {}
    tables = _without_absent(model.error_functions(at=constants), model.not_in_model)
    if not (tables.functions or tables.squareness):
        parts.lack(ERRORS, "the model has neither functions of one axis nor squareness")
    open_of_all = unknown_needed(model, tables, "".join(AXES))
    known = [axis for axis in AXES if unknown_needed(model, tables, axis) is None]
    planes = [plane for plane in PLANES if unknown_needed(model, tables, plane.lower()) is None]
    if not planes and not measured:
        parts.lack(CIRCLES, open_of_all or "")
    circles = _circles(parts, model, planes, measured, stated)
    if open_of_all is not None:
        parts.lack(FIELD, open_of_all)
        parts.lack(DIAGONALS, open_of_all)
        if not known:
            parts.lack(POSITIONING, open_of_all)
    try:
        low, high = usable_range_mm(model)
        model.error_mm([(low + high) / 2.0], at=_at_a_place(model, stated))
    except GeoerrError as error:
        for section in (FIELD, POSITIONING, DIAGONALS):
            parts.refused(section, error)
        return tables, False, circles, {}, {}
    lines = {axis: predict_positioning(model, *axis_line_mm(model, axis), at=constants) for axis in known}
    ends = diagonals_mm(model) if open_of_all is None else {}
    diagonals = {name: predict_positioning(model, *of, at=constants) for name, of in ends.items()}
    return tables, open_of_all is None, circles, lines, diagonals


def _without_absent(tables: ErrorFunctions, absent: Sequence[str]) -> ErrorFunctions:
    """Leave out tables that nothing in the model stands for: 0 by conditions that stand still, and not as known."""
    functions = {
        name: function
        for name, function in tables.functions.items()
        if name not in absent or bool(np.any(function.value))
    }
    return replace(tables, functions=functions)


def unknown_needed(model: Model, tables: ErrorFunctions | None, axes: str) -> str | None:
    """Say why a figure of these axes is not stated: what it is about is not determined, or not in the model.

    The one rule for lines, circles, diagonals and the field; None where the figure can be stated.

    Parameters
    ----------
    model
        Whose prediction it is.
    tables
        Its errors; they name what the data do not determine.
    axes
        Those that move.
    """
    needed = needed_by(axes)
    opened = {item.name for item in tables.not_determined} if tables is not None else set()
    whys = {
        "the model's data do not determine": in_order(needed & opened),
        "the model does not have": in_order(needed & set(model.not_in_model)),
    }
    said = [f"{why} {', '.join(names)}" for why, names in whys.items() if names]
    return f"{' and '.join(said)}, and what is unknown is not 0" if said else None


def _circles(
    parts: _Parts, model: Model, planes: Sequence[str], measured: Sequence[CircularTest], stated: Stated
) -> tuple[CircularTestResult, ...]:
    def run() -> tuple[CircularTestResult, ...]:
        feed_mm_min = feed_of_first_run(model, measured[0], stated) if measured else None
        at = with_feed(stated, feed_mm_min)
        own = [run_circular_test(model, middle_circle(model, plane), at=at) for plane in planes]
        seen = [run_circular_test(model, circle_of_first_run(one), measured=one, at=stated) for one in measured]
        return (*own, *seen)

    return parts.tried(CIRCLES, run) or ()


def _budget(
    parts: _Parts, model: Model, comparison: Comparison | None, stated: Stated
) -> tuple[Budget | None, UncertaintyMap | None]:
    """Make the budget: by the fit behind the comparison where these are its own data, else by the record alone."""
    subject: FitResult | Model = model
    # Without its waves in time a model is not the one that was compared.
    if comparison is not None and comparison.model is model and comparison.freedom == "own":
        subject = model if comparison.fitted is None else FitResult(model, comparison.fitted)
    budget = parts.tried(BUDGET, lambda: uncertainty_budget(subject, at=_at_a_place(model, stated)))
    return budget, None if budget is None else parts.tried(BUDGET, lambda: uncertainty_map(budget))


def _followed(model: Model, stated: Stated) -> Stated:
    """Give the stated conditions that the model follows."""
    return {name: value for name, value in stated.items() if name in model.conditions}


def _at_a_place(model: Model, stated: Stated) -> Stated:
    """Give what a prediction at a place is given: as reached from below, at rest, but for what is stated."""
    return {**approach_conditions(model), **_followed(model, stated)}


def _line_document(one: MeasuredLine) -> dict[str, Any]:
    line = one.line
    return {
        "session": line.session,
        "line": line.line,
        "target": line.target,
        "axes": line.moving,
        "start_mm": line.start_mm.tolist(),
        "end_mm": line.end_mm.tolist(),
        "offset_mm": line.offset_mm.tolist(),
        **one.test.to_document(),
        "n_alone": one.n_alone,
        "without_alone": None if one.without_alone is None else one.without_alone.to_document(),
    }


def thinned(lines: Sequence[MeasuredLine], most: int) -> tuple[MeasuredLine, ...]:
    """Give about as many lines of each axis, those with most targets, in the order in which they were measured."""
    by_axes: dict[str, list[int]] = {}
    for place in np.argsort([-len(one.test.position_mm) for one in lines], kind="stable").tolist():
        by_axes.setdefault(lines[place].line.moving, []).append(place)
    kept = [place for places in by_axes.values() for place in places[: max(most // len(by_axes), 1)]]
    return tuple(lines[place] for place in sorted(kept))
