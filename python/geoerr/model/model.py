"""The model object: composition, prediction with uncertainty, and the inverse.

The kinematics are exact (full rotations, unit directions) and run in the core; here arrays are checked and names
and signs are translated. Signs and frames: errors are actual minus nominal of the tool as seen from the work.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.arguments import check_threads
from geoerr.bases import basis_of
from geoerr.drawing import drawn
from geoerr.effects import Effect, PlacedEffect, catalogue
from geoerr.error_functions import ALL_NAMES, ErrorFunctions
from geoerr.errors import GeoerrError, NotConvergedError, NotDeterminedError, ShapeError
from geoerr.machine import AXES, Machine
from geoerr.model.arrays import Numbers, contiguous, offsets, points
from geoerr.model.commands import STATUS, Commands
from geoerr.model.compile import Compiled, compile_terms, start_values
from geoerr.model.conditions import OF_POSITION, Conditions, bound_conditions, constants_of, variables_of
from geoerr.model.determined import Carrier, Determination, leaves_still
from geoerr.model.gauge import N_ENTRIES, MeanScale, mean_scales, tables_of_terms
from geoerr.model.in_model import in_order, names_in_model
from geoerr.model.leave_out import names_left_out, terms_without
from geoerr.model.parameters import (
    Correlation,
    correlations_of,
    find_parameter,
    parameter_names,
    with_independent,
)
from geoerr.model.record import FitRecord
from geoerr.model.report import report_of
from geoerr.model.summary import model_html
from geoerr.model.tables import squareness_of_li_rad, terms_of_errors
from geoerr.terms import JOINT_CHANNELS, SQUARENESS_CHANNELS, EffectReference, Parameter, Term

if TYPE_CHECKING:
    import plotly.graph_objects as go

# A machine as it is compiled: of tables, or of terms.
AnyMachine: TypeAlias = _core.MachineModel | _core.TermMachine

# Rows whose derivatives by some hundred parameters are held at a time: a few megabytes.
_BLOCK_ROWS = 1024
# Rows that are predicted at a time: enough for many threads, some ten megabytes of numbers on channels.
_PREDICTED_ROWS = 1 << 16

_CoreRows = tuple[npt.NDArray[np.uint8], Numbers, Numbers, Numbers, npt.NDArray[np.int64], None]


@dataclass(frozen=True, eq=False)
class Model:
    """A machine and its errors.

    Positions go in as (n, 3) in mm, and offsets as (3,) for all rows, (n, 3), or None for the point itself.
    Results do not depend on `threads` (0 = all cores). Where terms follow conditions (temperatures, direction of
    approach, ...), `at` maps their names to one number for all rows or (n,) numbers; a temperature may also be
    `"reference"`, the machine's reference temperature. Each row stands alone: histories are in their steady state.

    Attributes
    ----------
    machine
        The machine: its chain and tool offset.
    errors
        Its errors as tables, or None. An error that is not determined counts as 0.
    terms
        Its errors as terms: bases and formulas on channels; they add to the tables. A fitted model has terms only.
    record
        What the fit of the terms knows: covariance, what is not determined, data, history.

    Raises
    ------
    GeometryError
        where a table is not increasing or not finite, or no three axes have the squarenesses.
    ShapeError
        where two terms have one id, or the record is not about these terms.
    ExpressionError
        where a formula cannot be read, naming the term and marking the place.
    """

    machine: Machine
    errors: ErrorFunctions | None = None
    terms: tuple[Term, ...] = ()
    record: FitRecord | None = None

    def __post_init__(self) -> None:
        """Compile the model, so that bad errors are refused here and not at the first question."""
        if not isinstance(self.machine, Machine):
            raise ShapeError(
                f"machine: a value of type {type(self.machine).__name__} was given where a machine is needed\n"
                "hint: load_model(path) reads a file; Model takes what read_machine or Machine.from_chain gives"
            )
        object.__setattr__(self, "terms", tuple(self.terms))
        _ = (self._all, self._seen) if self.terms else self._core
        if self.record is not None:
            if self.errors is not None:
                raise ShapeError("a record is about terms: a fitted model has no tables besides")
            count = self._all.n_coefficients + self._all.n_inner
            if self.record.n_parameters != count:
                raise ShapeError(f"the record is about {self.record.n_parameters} parameters, the terms have {count}")

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by parts: the compiled machine stays behind and is made again."""
        return (Model, (self.machine, self.errors, self.terms, self.record))

    @cached_property
    def _core(self) -> _core.MachineModel:
        """The compiled machine of a model without terms."""
        functions = {} if self.errors is None else self.errors.functions
        tables = [
            (name, contiguous(function.position_mm), contiguous(function.value))
            for name, function in functions.items()
        ]
        return _core.MachineModel(
            self.machine.chain, self.machine.tool_offset_mm, squareness_of_li_rad(self.errors), tables
        )

    @cached_property
    def _all(self) -> Compiled:
        """All terms, as the record counts their parameters."""
        return compile_terms(self.machine, self.terms)

    @cached_property
    def _seen(self) -> Compiled:
        """What moves the machine: tables and terms, without the rig's."""
        return compile_terms(self.machine, self.all_machine_terms)

    @property
    def machine_terms(self) -> tuple[Term, ...]:
        """Terms that move the machine: predicted and compensated."""
        return tuple(term for term in self.terms if not term.is_rig)

    @property
    def rig_terms(self) -> tuple[Term, ...]:
        """Terms of the measuring rig: they explain measurements, and the machine does not have them."""
        return tuple(term for term in self.terms if term.is_rig)

    @cached_property
    def all_machine_terms(self) -> tuple[Term, ...]:
        """The tables as terms (polygons), then `machine_terms`."""
        return terms_of_errors(self.errors) + self.machine_terms

    @property
    def conditions(self) -> tuple[str, ...]:
        """Names that `at` has to give for a prediction."""
        return tuple(name for name in self._seen.variables if name not in OF_POSITION)

    @property
    def is_nominal(self) -> bool:
        """Tell whether the machine has no errors: every table, squareness and coefficient is absent or 0."""
        if not self.terms:
            return self._core.is_nominal
        has_only_terms_in_coefficients = all(
            part.basis is not None or any(p.name in part.names for p in term.coefficients)
            for term in self.machine_terms
            for part in term.parts
        )
        coefficients, _ = start_values(self.all_machine_terms)
        return self.has_values and has_only_terms_in_coefficients and not coefficients.any()

    @cached_property
    def not_in_model(self) -> tuple[str, ...]:
        """Names of the 21 errors that nothing in the model stands for, and that no data were asked for: taken as 0.

        What data were asked for and do not determine is named elsewhere, by the record or the tables.
        """
        told = () if self.errors is None else self.errors.not_determined
        told += () if self.record is None else self.record.not_determined
        known = names_in_model(self.machine, self.errors, self.machine_terms) | {item.name for item in told}
        return in_order(set(ALL_NAMES) - known)

    @property
    def measured_box_mm(self) -> tuple[tuple[float, float], ...]:
        """Give low and high end of each axis: where it stood, of `measured_range_mm`, else of the axis."""
        measured, stood = self.measured_range_mm, self.stood_mm
        still = {axis: (position, position) for axis, position in stood.items()}
        return tuple(still.get(axis) or measured[axis] or self.machine.axes[axis].range_mm for axis in AXES)

    @property
    def stood_mm(self) -> Mapping[str, float]:
        """Give where each axis stood that never moved in the data of the fit."""
        return {} if self.record is None else self.record.stood_mm

    @property
    def measured_range_mm(self) -> dict[str, tuple[float, float] | None]:
        """Give for each axis the range that all its error functions cover, None where there are none.

        A table with one entry is a constant and bounds nothing. Tables that do not overlap leave no range: the
        first number is then above the second, and nothing is inside. An axis without error functions has the range
        of the data that the model was fitted to.
        """
        ranges: dict[str, tuple[float, float] | None] = dict.fromkeys(AXES)
        for part in (part for term in self.all_machine_terms for part in term.parts):
            if part.basis is None or part.channel not in JOINT_CHANNELS:
                continue
            first, last = basis_of(part.basis).range
            low, high = ranges[part.basis.axis] or (-np.inf, np.inf)
            ranges[part.basis.axis] = (max(low, first), min(high, last))
        measured: Mapping[str, tuple[float, float]] = {} if self.record is None else self.record.range_mm
        return {axis: measured.get(axis) if span is None else span for axis, span in ranges.items()}

    def knots_mm(self, axis: str) -> Numbers:
        """Give the positions (k,) of `x`, `y` or `z` where some error function has a kink, increasing."""
        if not self.terms:
            return self._core.knots_mm(AXES.index(axis))
        bases = [part.basis for term in self.all_machine_terms for part in term.parts if part.basis is not None]
        kinks = [basis_of(basis).kinks() for basis in bases if basis.axis == axis]
        return np.unique(np.concatenate([np.empty(0), *kinks]))

    def nominal_mm(self, q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None = None) -> Numbers:
        """Give where `tool_from_work` would be without errors, (n, 3): q + (tool offset + offset)."""
        rows = points(q_mm, "q_mm")
        lever = np.asarray(self.machine.tool_offset_mm) + offsets(offset_mm, len(rows))
        return np.asarray(rows + lever)

    def tool_from_work(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        at: Conditions | None = None,
        threads: int = 0,
    ) -> Numbers:
        """Give the position of a point on the tool seen from the work, by the exact chain.

        Parameters
        ----------
        q_mm : (n, 3)
            Commanded axis positions.
        offset_mm : (3,) or (n, 3)
            From the machine's tool point to the point, base axes; None for the tool point itself.
        at
            Conditions by name, where terms follow some.

        Returns
        -------
        (n, 3)
            In mm; without errors exactly q + (tool offset + offset).

        Raises
        ------
        ShapeError
            where an array is not of this shape.
        GeoerrError
            naming conditions that are needed and not given, and parameters that have no value yet.

        Notes
        -----
        Li et al. 2023, Eqs. 6 to 8, with full rotations. Verified for all 24 chains against their first-order sums,
        against matrix products and against a second implementation with 40 digits.
        """
        check_threads(threads)
        rows = points(q_mm, "q_mm")
        if not self.terms:
            return self._core.tool_from_work(rows, offsets(offset_mm, len(rows)), threads)
        error_mm = self.displacement_mm(rows, offset_mm, at=at, threads=threads)
        return self.nominal_mm(rows, offset_mm) + error_mm

    def error_mm(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        at: Conditions | None = None,
        threads: int = 0,
    ) -> Numbers:
        """Give actual minus nominal position of the same point, (n, 3), with all its digits."""
        check_threads(threads)
        rows = points(q_mm, "q_mm")
        if not self.terms:
            return self._core.error_mm(rows, offsets(offset_mm, len(rows)), threads)
        return self.displacement_mm(rows, offset_mm, at=at, threads=threads)

    def tool_from_base(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        at: Conditions | None = None,
        threads: int = 0,
    ) -> Numbers:
        """Give the position of a point on the tool in the base frame, (n, 3): what a camera on the floor sees.

        `offset_mm` as for `tool_from_work`. Only the axes on the tool side move the point.
        """
        check_threads(threads)
        rows = points(q_mm, "q_mm")
        if not self.terms:
            return self._core.tool_from_base(rows, offsets(offset_mm, len(rows)), threads)
        moved = rows * [float(axis in self.machine.tool_axes) for axis in AXES]
        nominal = moved + (np.asarray(self.machine.tool_offset_mm) + offsets(offset_mm, len(rows)))
        return np.asarray(nominal + self.displacement_mm(rows, offset_mm, carrier="tool", at=at, threads=threads))

    def work_from_base(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        at: Conditions | None = None,
        threads: int = 0,
    ) -> Numbers:
        """Give the position of a point on the work in the base frame, (n, 3): what a camera on the floor sees.

        `offset_mm` counts from the base origin, at x = y = z = 0. Only the axes on the work side move the point.
        """
        check_threads(threads)
        rows = points(q_mm, "q_mm")
        if not self.terms:
            return self._core.work_from_base(rows, offsets(offset_mm, len(rows)), threads)
        moved = rows * [float(axis in self.machine.work_axes) for axis in AXES]
        nominal = offsets(offset_mm, len(rows)) - moved
        return np.asarray(nominal + self.displacement_mm(rows, offset_mm, carrier="work", at=at, threads=threads))

    def displacement_mm(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        carrier: Carrier = "relative",
        at: Conditions | None = None,
        threads: int = 0,
    ) -> Numbers:
        """Give actual minus nominal position of a target, (n, 3), by the exact chain and without the rig.

        Parameters
        ----------
        q_mm, offset_mm, at
            As for `tool_from_work`; on `work` the offset counts from the base origin.
        carrier
            What the target is fixed to: `tool`, `work` or `base`, seen from the floor, or `relative`, the tool seen
            from the work.
        """
        check_threads(threads)
        values = self._values
        blocks = self._rows(q_mm, offset_mm, carrier, at, _PREDICTED_ROWS)
        return np.concatenate([self._seen.core.displacements(*rows, *values, threads) for rows in blocks])

    def compiled_at(self, conditions: Mapping[str, float]) -> AnyMachine:
        """Give the compiled machine with conditions put in, as the inverse and the G-code binding take it.

        Directions, travels, speeds and feed may be left out where each move tells them.

        Raises
        ------
        GeoerrError
            naming conditions that are needed and not given, and parameters that have no value yet.
        """
        if not self.terms:
            return self._core
        return _core.TermMachine(self._seen.core, *self._values, self._seen.variables, dict(conditions))

    def jacobian(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        at: Conditions | None = None,
        threads: int = 0,
    ) -> Numbers:
        """Give d tool_from_work / d q, (n, 3, 3): row by component, column by axis; right-hand at a kink.

        Conditions are held; only direction, travel and speed may differ from row to row.
        """
        check_threads(threads)
        rows = points(q_mm, "q_mm")
        offset = offsets(offset_mm, len(rows))
        if not self.terms:
            return self._core.jacobian(rows, offset, threads)
        conditions, motion = bound_conditions(self.conditions, self.machine, at, len(rows))
        return _terms(self.compiled_at(conditions)).jacobian(rows, offset, threads, motion)

    def commands_for(
        self,
        p_mm: npt.ArrayLike,
        tolerance_mm: float = 1e-6,
        threads: int = 0,
        *,
        at: Conditions | None = None,
    ) -> Numbers:
        """Give the commands that put the tool point where it should be: the inverse of `tool_from_work`.

        Parameters
        ----------
        p_mm : (n, 3)
            Wanted positions of the tool point seen from the work. For a program's axis positions q these are
            `nominal_mm(q)`: the same numbers where the machine has no tool offset.
        tolerance_mm
            Largest distance that may remain, by the model.
        at
            Conditions by name, where terms follow some. They are held while a command is searched; only direction,
            travel and speed may differ from row to row.

        Returns
        -------
        (n, 3)
            Axis positions to command.

        Raises
        ------
        NotConvergedError
            naming the first row without a command (`try_commands_for` does the other rows).
        ShapeError
            where the array is not of this shape.
        GeometryError
            where the tolerance is not a positive number.

        Notes
        -----
        Li et al. 2023, Eqs. 24 to 27, iterated.
        """
        commands = self.try_commands_for(p_mm, tolerance_mm, threads, at=at)
        failed = np.flatnonzero(~commands.is_converged)
        if failed.size:
            row = failed[0]
            what = STATUS[commands.status[row]]
            left = "" if what == "not finite" else f", {commands.remaining_mm[row]:.3g} mm remain"
            others = f" (and {failed.size - 1} more)" if failed.size > 1 else ""
            hint = "check the errors for tables that change by more than a fifth of a millimetre a millimetre"
            if not np.isfinite(points(p_mm, "p_mm")[row]).all():
                hint = "give finite numbers in p_mm, or leave the row out"
            raise NotConvergedError(
                f"no command puts the tool at position {row + 1}{others}: {what}{left}\nhint: {hint}"
            )
        return commands.command_mm

    def try_commands_for(
        self,
        p_mm: npt.ArrayLike,
        tolerance_mm: float = 1e-6,
        threads: int = 0,
        *,
        at: Conditions | None = None,
    ) -> Commands:
        """Do the same, row by row: a row without a command is NaN, has its status, and disturbs no other."""
        check_threads(threads)
        targets = points(p_mm, "p_mm") - np.asarray(self.machine.tool_offset_mm)
        if not self.terms:
            return Commands(*self._core.commands_for(targets, tolerance_mm, threads))
        conditions, motion = bound_conditions(self.conditions, self.machine, at, len(targets))
        compiled = _terms(self.compiled_at(conditions))
        return Commands(*compiled.commands_for(targets, tolerance_mm, threads, motion))

    def prediction_covariance_mm2(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        carrier: Carrier = "relative",
        at: Conditions | None = None,
        threads: int = 0,
    ) -> Numbers:
        """Give the covariance of the predicted displacement, (n, 3, 3): J C Jᵀ, J first order at each row.

        Row and column of a component that the data do not determine are NaN: see `is_determined_at`. Symmetric and
        positive semidefinite: what rounding leaves below 0, where the error is 0 by convention, is 0. A row
        whose place or conditions are not finite is NaN, and disturbs no other.

        Raises
        ------
        NotDeterminedError
            where the model has no record of a fit, and so no covariance.
        """
        record = self._record_of_machine
        rows, offset = _with_offsets(q_mm, offset_mm)
        covariances, still, is_finite = [np.empty((0, 3, 3))], [], []
        for columns, own in self._finite_columns(rows, offset, carrier, at, threads):
            covariances.append((columns @ record.covariance) @ columns.transpose(0, 2, 1))
            still.append(leaves_still(columns, record.null_space))
            is_finite.append(own)
        result = _without_negative(np.concatenate(covariances))
        is_open = ~self._determination.of_rows(still, is_finite, rows, offset, carrier, at, threads)
        result[is_open[:, :, None] | is_open[:, None, :]] = np.nan
        return result

    def is_determined_at(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        carrier: Carrier = "relative",
        at: Conditions | None = None,
        threads: int = 0,
    ) -> npt.NDArray[np.bool_]:
        """Tell for each component whether the data determine the displacement, (n, 3).

        It is determined where no direction of the null space moves the point along it. A direction that moves all
        points as one rigid body is the set-up of the work: where that stands no measurement of the machine tells, and
        every part is set up anew. It does not count. Away from where an axis stood that never moved in the data,
        nothing is determined that the errors of this axis move. Nothing is in a row whose place or conditions are not
        finite.

        Raises
        ------
        NotDeterminedError
            where the model has no record of a fit.
        """
        null_space = self._record_of_machine.null_space
        rows, offset = _with_offsets(q_mm, offset_mm)
        still, is_finite = [], []
        for columns, own in self._finite_columns(rows, offset, carrier, at, threads):
            still.append(leaves_still(columns, null_space))
            is_finite.append(own)
        return self._determination.of_rows(still, is_finite, rows, offset, carrier, at, threads)

    def contributions(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        carrier: Carrier = "relative",
        at: Conditions | None = None,
        threads: int = 0,
    ) -> dict[str, Numbers]:
        """Give what each term of the machine adds to the displacement, by id, (n, 3) in mm each.

        First order: the channel's Jacobian times the channel's value. Their sum is the first-order prediction; what
        `displacement_mm` has beyond it are products of errors (squareness of 5 mrad times an angle of 1 mrad over
        400 mm is 2 µm).
        """
        check_threads(threads)
        self._refuse_unknown()
        blocks = [
            self._contributions_of(rows, threads)
            for rows in self._rows(q_mm, offset_mm, carrier, at, _PREDICTED_ROWS)
        ]
        return {term.id: np.concatenate([block[term.id] for block in blocks]) for term in self.all_machine_terms}

    def _contributions_of(self, rows: _CoreRows, threads: int) -> dict[str, Numbers]:
        carriers, q_mm, offset_mm, variables, starts, t_s = rows
        tool_mm = self.machine.tool_offset_mm
        columns = _core.channel_columns(self.machine.chain, carriers, q_mm, offset_mm, tool_mm, threads)
        columns = columns[:, :_N_MACHINE_CHANNELS]
        contributions = {}
        for term in self.all_machine_terms:
            compiled = compile_terms(self.machine, (term,))
            places = [self._seen.variables.index(name) for name in compiled.variables]
            own = np.ascontiguousarray(variables[places])
            values = compiled.core.channel_values(
                carriers, q_mm, offset_mm, own, starts, t_s, *start_values((term,)), threads
            )
            contributions[term.id] = np.einsum("nc,ncb->nb", values[:, :_N_MACHINE_CHANNELS], columns)
        return contributions

    def contribution_moments_mm2(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None = None,
        *,
        at: Conditions | None = None,
        threads: int = 0,
    ) -> tuple[Numbers, Numbers]:
        """Give means over rows of what the k terms of the machine contribute to the error: sizes and uncertainties.

        Returns
        -------
        products : (k, k)
            Mean of c_a · c_b, c_a the contribution of term a, mm².
        covariance : (k, k)
            Mean of tr Cov(c_a, c_b), mm². Its sum is the mean variance of the error, as far as the data determine it.

        Raises
        ------
        NotDeterminedError
            where the model has no record of a fit.
        """
        record = self._record_of_machine
        rows, offset = _with_offsets(q_mm, offset_mm)
        contributions = self.contributions(rows, offset, at=at, threads=threads)
        each = np.array([values.ravel() for values in contributions.values()])
        square = np.zeros_like(record.covariance)
        for columns in self._columns(rows, offset, "relative", at, threads):
            by_component = columns.reshape(-1, columns.shape[2])
            square += by_component.T @ by_component
        owner = np.zeros((len(self.machine_terms), record.n_parameters))
        for number, slices in enumerate(zip(self._seen.coefficient_slices, self._seen.inner_slices, strict=True)):
            own, own_inner = slices
            owner[number, own] = 1.0
            owner[
                number, self._seen.n_coefficients + own_inner.start : self._seen.n_coefficients + own_inner.stop
            ] = 1.0
        n_rows = max(len(rows), 1)
        return each @ each.T / n_rows, owner @ (square * record.covariance) @ owner.T / n_rows

    def error_functions(
        self, positions: int | Mapping[str, npt.ArrayLike] | None = None, *, at: Conditions | None = None
    ) -> ErrorFunctions:
        """Give the errors as tables in errors.json's gauge, with uncertainties where the model has a record.

        Parameters
        ----------
        positions
            Number of entries, uniform over the measured range; or for each axis its positions. None: the tables that
            the model was made of, or 41 entries.
        at
            Conditions that stand still, one number each: effects that follow only these are in the tables.

        Returns
        -------
        ErrorFunctions
            Of every term that is a function of its own axis only (the 18 functions) or constant (squareness). Terms
            that follow another axis, or conditions that are not given, are not in tables, and named in its notes.

        Raises
        ------
        ShapeError
            for positions that are neither a number of entries nor rising positions of axes.
        """
        if not self.terms and self.errors is not None and positions is None:
            return self.errors
        self._refuse_unknown()
        record = None if self.record is None else self._record_of_machine
        return tables_of_terms(
            self.machine,
            self.all_machine_terms,
            record,
            self.measured_range_mm,
            N_ENTRIES if positions is None else positions,
            constants_of(self.machine, at),
        )

    def mean_scales(self) -> dict[str, MeanScale]:
        """Give for each axis the slope of its positioning's least-squares line over the measured range."""
        self._refuse_unknown()
        record = None if self.record is None else self._record_of_machine
        return mean_scales(self.machine, self.all_machine_terms, record, self.measured_range_mm)

    def __add__(self, other: Term | Effect | PlacedEffect | EffectReference | str) -> Model:
        """Give the model with one more term, or effect.

        `model + "thermal-expansion:x@temp_bed"` (of the catalogue), `model + own.at("x", "temp_bed")` (of any file),
        and `model + own` where the effect has only one place to act in, are models whose new parameters have no
        values yet. A record is kept where the term says how uncertain it is (it counts as independent of the fit),
        and dropped where it does not: a term that is yet to be fitted.

        Raises
        ------
        InputFileError
            for a reference that names no effect, and an effect without axis or covariate where it could have several,
            naming them.
        """
        if isinstance(other, str | EffectReference):
            effect, reference = catalogue().resolve(other)
            other = PlacedEffect(effect, reference)
        elif isinstance(other, Effect):
            other = other.at()
        terms = other.terms(self.machine) if isinstance(other, PlacedEffect) else (other,)
        result = self
        for term in terms:
            if not isinstance(term, Term):
                return NotImplemented
            record = result.record
            if record is not None:
                record = with_independent(record, result._all.n_coefficients, term)
            result = Model(self.machine, self.errors, (*result.terms, term), record)
        return result

    def without(self, names: str | Iterable[str]) -> Model:
        """Give the model with some errors taken out (set to 0), for asking what they matter.

        Parameters
        ----------
        names
            One or more: ids of terms (`thermal-expansion:x@temp_bed`), ids of effects (all their terms), ISO names
            (`ECX`, `EC0Y`) and groups: `positioning`, `straightness`, `angular`, `pitch-yaw`, `roll`, `squareness`.
            ISO names and groups mean the 21 classic errors, not effects that act in the same place.

        Raises
        ------
        GeoerrError
            for a name that is none of these.
        """
        wanted = (names,) if isinstance(names, str) else tuple(names)
        if not wanted:
            return self
        out, left_out_terms = names_left_out(wanted, self.terms)
        errors = self.errors
        if errors is not None:
            errors = dataclasses.replace(
                errors,
                functions={name: f for name, f in errors.functions.items() if name not in out},
                squareness={name: s for name, s in errors.squareness.items() if name not in out},
            )
        if errors is None and not self.terms:
            return self
        kept, terms = terms_without(self.terms, out, left_out_terms)
        record = None if self.record is None else self.record.selected(self._places(kept))
        return Model(self.machine, errors, terms, record)

    def without_terms(self, ids: Iterable[str]) -> Model:
        """Give the model without terms of these ids, each whole; nothing else changes."""
        out = frozenset(ids)
        if out.isdisjoint(term.id for term in self.terms):
            return self
        kept = {number: None for number, term in enumerate(self.terms) if term.id not in out}
        record = None if self.record is None else self.record.selected(self._places(kept))
        return Model(self.machine, self.errors, tuple(self.terms[number] for number in kept), record)

    def parameter(self, name: str) -> Parameter:
        """Give one parameter: value, uncertainty, unit, plausible values.

        Parameters
        ----------
        name
            Term and parameter, `thermal-expansion:x@temp_bed.alpha`.

        Raises
        ------
        GeoerrError
            where there is no such term or parameter, naming those that there are.
        """
        return find_parameter(self.all_machine_terms + self.rig_terms, name)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters of the terms in the record's order: coefficients, then inner parameters."""
        return parameter_names(self.terms)

    def correlations(self, minimum: float = 0.8) -> tuple[Correlation, ...]:
        """Give pairs of parameters of different terms, or of one formula, that are correlated, strongest first.

        Coefficients of one basis are neighbours on one curve: their correlation says nothing, and is left out, like
        that of parameters that the data do not determine.

        Parameters
        ----------
        minimum
            Smallest size of a correlation to give.

        Raises
        ------
        NotDeterminedError
            where the model has no record of a fit.
        """
        return correlations_of(self._checked_record(), self.terms, minimum)

    def report(self) -> str:
        """Give the model in words and numbers, at most 100 columns wide: what is known, and what is not."""
        return report_of(self)

    def plot_errors(self, truth: ErrorFunctions | None = None, *, at: Conditions | None = None) -> go.Figure:
        """Draw the 21 errors with their 95 % bands, beside the truth of a simulation where there is one."""
        return drawn("model_errors", self, truth, at)

    def plot_field(self, *, at: Conditions | None = None) -> go.Figure:
        """Draw where the machine puts the points of a grid over its volume, errors magnified."""
        return drawn("model_field", self, at)

    def plot_difference(self, reference: Model, *, at: Conditions | None = None) -> go.Figure:
        """Draw what this model says of the volume beyond another one of the same machine, magnified."""
        return drawn("model_difference", self, reference, at)

    def plot_circles(self, *, at: Conditions | None = None) -> go.Figure:
        """Draw a circle in each plane, both ways round (ISO 230-4), about the middle of the volume."""
        return drawn("model_circles", self, at)

    def plot_positioning(self, *, at: Conditions | None = None) -> go.Figure:
        """Draw the positioning of each axis through the middle of the volume, both ways (ISO 230-2)."""
        return drawn("model_positioning", self, at)

    def plot_diagonals(self, *, at: Conditions | None = None) -> go.Figure:
        """Draw the deviation along the four space diagonals, both ways (ISO 230-6)."""
        return drawn("model_diagonals", self, at)

    def plot_fall(self) -> go.Figure:
        """Draw how the error fell with each effect that was added, by the model's own history."""
        return drawn("model_fall", self)

    def _repr_html_(self) -> str:
        """Show what it is made of and how well it is known, for a notebook."""
        return model_html(self)

    def _rows(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None,
        carrier: Carrier,
        at: Conditions | None,
        n_at_once: int,
    ) -> Iterator[_CoreRows]:
        """Give rows as the core takes them, block by block (one of none for none); each is a sequence of its own."""
        rows = points(q_mm, "q_mm")
        if carrier not in _core.CARRIERS:
            raise GeoerrError(f"{carrier!r} carries no target\nhint: carriers are {', '.join(_core.CARRIERS)}")
        offset = contiguous(np.broadcast_to(offsets(offset_mm, len(rows)), rows.shape))
        variables = variables_of(self._seen.variables, self.machine, rows, offset, at, carrier=carrier)
        for first in range(0, max(len(rows), 1), n_at_once):
            block = slice(first, first + n_at_once)
            n_rows = len(rows[block])
            carriers = np.full(n_rows, _core.CARRIERS.index(carrier), dtype=np.uint8)
            own = np.ascontiguousarray(variables[:, block])
            yield carriers, rows[block], offset[block], own, np.arange(n_rows, dtype=np.int64), None

    def _columns(
        self,
        q_mm: npt.ArrayLike,
        offset_mm: npt.ArrayLike | None,
        carrier: Carrier,
        at: Conditions | None,
        threads: int,
    ) -> Iterator[Numbers]:
        """Give d displacement / d parameters of the machine's terms, (n, 3, m), in blocks of rows."""
        check_threads(threads)
        values = self._values
        for rows in self._rows(q_mm, offset_mm, carrier, at, _BLOCK_ROWS):
            yield self._seen.core.columns(*rows, *values, threads)

    def _finite_columns(
        self, rows: Numbers, offset: Numbers, carrier: Carrier, at: Conditions | None, threads: int
    ) -> Iterator[tuple[Numbers, npt.NDArray[np.bool_]]]:
        """Give `_columns`, 0 in rows that are not finite, and which rows of the block are, (n,)."""
        is_finite = np.asarray(np.isfinite(np.hstack([rows, offset])).all(axis=1))
        for number, columns in enumerate(self._columns(rows, offset, carrier, at, threads)):
            first = number * _BLOCK_ROWS
            own = np.isfinite(columns).all(axis=(1, 2)) & is_finite[first : first + len(columns)]
            columns[~own] = 0.0
            yield columns, own

    @property
    def _values(self) -> tuple[Numbers, Numbers]:
        """Coefficients and inner parameters of what moves the machine."""
        self._refuse_unknown()
        return start_values(self.all_machine_terms)

    @property
    def has_values(self) -> bool:
        """Tell whether every parameter of the machine's terms has a value: whether the model can predict."""
        return not self._unknown()

    def _unknown(self) -> list[str]:
        return [
            f"{term.id}.{parameter.name}"
            for term in self.machine_terms
            for parameter in term.coefficients + term.inner
            if np.isnan(parameter.value)
        ]

    def _refuse_unknown(self) -> None:
        unknown = self._unknown()
        if unknown:
            more = f" and {len(unknown) - 3} more" if len(unknown) > 3 else ""
            raise GeoerrError(
                f"{', '.join(unknown[:3])}{more}: no value yet\n"
                "hint: fit the model to measurements, or leave the term out"
            )

    def _checked_record(self) -> FitRecord:
        if self.record is None:
            raise NotDeterminedError(
                "the model has no covariance of its parameters: it was not fitted here\n"
                "hint: fit it to measurements with `geoerr fit`"
            )
        return self.record

    @cached_property
    def _record_of_machine(self) -> FitRecord:
        """The record of the machine's terms, in their order."""
        places = [place for place, term in enumerate(self.terms) if not term.is_rig]
        return self._checked_record().selected(self._places({place: None for place in places}))

    @property
    def _determination(self) -> Determination:
        return Determination(
            self.machine, self._record_of_machine, self._columns, self.measured_box_mm, self.stood_mm
        )

    def _places(self, kept: Mapping[int, object]) -> list[int]:
        """Give the places, in the record's order, of the parameters of some terms (by number)."""
        coefficients = [place for number in kept for place in _range(self._all.coefficient_slices[number])]
        first = self._all.n_coefficients
        return coefficients + [first + place for number in kept for place in _range(self._all.inner_slices[number])]


_N_MACHINE_CHANNELS = len(JOINT_CHANNELS) + len(SQUARENESS_CHANNELS) + 9


def _terms(compiled: AnyMachine) -> _core.TermMachine:
    assert isinstance(compiled, _core.TermMachine)
    return compiled


def _range(places: slice) -> range:
    return range(places.start, places.stop)


def _with_offsets(q_mm: npt.ArrayLike, offset_mm: npt.ArrayLike | None) -> tuple[Numbers, Numbers]:
    rows = points(q_mm, "q_mm")
    return rows, np.broadcast_to(offsets(offset_mm, len(rows)), rows.shape)


def _without_negative(covariances: Numbers) -> Numbers:
    """Give covariances (n, 3, 3) symmetric, and those with a negative variance in some direction with 0 in it."""
    symmetric = np.asarray(0.5 * (covariances + covariances.transpose(0, 2, 1)))
    # One that overflows has no eigenvalues, and would leave the others without.
    is_negative = np.asarray(np.isfinite(symmetric).all(axis=(1, 2)))
    is_negative[is_negative] = np.linalg.eigvalsh(symmetric[is_negative]).min(axis=1, initial=0.0) < 0.0
    variance, axes = np.linalg.eigh(symmetric[is_negative])
    root = axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :]
    symmetric[is_negative] = root @ root.transpose(0, 2, 1)
    return symmetric
