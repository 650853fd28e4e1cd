"""The joint fit: all observations at once, all terms at once, weighed by their covariances.

1. Rows become arrays with their whitening (`sightings`); every session's device gets a first pose (`start`).
2. The richest bases that the positions support are fitted; each function's own freedom is then chosen by evidence
   (`knots`), and the model with those is fitted again (`solve`): Gauss-Newton on exact residuals, gross outliers out.
3. Rank says what the data do not determine (`undetermined`), repeats say what is noise (`noise`), passes left out say
   what the model is worth where it has not looked (`held_out`).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from geoerr import _core
from geoerr.arguments import check_choice, check_threads
from geoerr.distributions import chi_squared_sf
from geoerr.errors import GeometryError
from geoerr.fit.begun import known_columns, known_sums
from geoerr.fit.beside_effects import with_effects
from geoerr.fit.calibration import CalibrationUnknowns, calibration_unknowns
from geoerr.fit.classic import (
    Components,
    classic_terms,
    gauge_rows,
    knot_places_by_axis,
    names_of,
    positions_by_axis,
    rich_bases,
)
from geoerr.fit.fitted import BegunSums, Fitted
from geoerr.fit.free_directions import concerned, held_smallest, limits_of
from geoerr.fit.inner import has_unknown_inner
from geoerr.fit.joined import sightings_of, within_the_machine
from geoerr.fit.jumps import jump_errors
from geoerr.fit.knots import Family, KnotChoice, choose_bases
from geoerr.fit.lengths import is_told, middles_of_lengths
from geoerr.fit.noise import is_static
from geoerr.fit.overfitted import with_fewer
from geoerr.fit.rich import determined_bases
from geoerr.fit.rolls import Rolls, held_rolls, levers, turned
from geoerr.fit.run_away import run_away
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.smoothness import Smoothness, choose_smoothness, prior_rows
from geoerr.fit.solve import Ranges, Solved, solve
from geoerr.fit.standing import Standing, known_variables, midway, standing
from geoerr.fit.start import Frames, nominal_mm, refuse_strangers, start_frames, target_places
from geoerr.fit.triangles import holding
from geoerr.fit.turns import turned_in_plane
from geoerr.fit.undetermined import Undetermined, is_a_line
from geoerr.fit.variables import complete_rows_of, times_s, variable_columns, why_lacking, with_rows
from geoerr.machine import AXES, Machine
from geoerr.model.compile import Compiled, compile_terms, start_values
from geoerr.observations import MeasuredTable
from geoerr.summaries import counted, place_of_row
from geoerr.terms import BasisSpec, Term

Freedom = Literal["knots", "smooth", "elements"]

# Rolls of half a radian settle in ten rounds or so.
_MOST_ROLLS = 30
# A formula's values below this, in mm and rad, are what is left of sums that cancel.
_ROUND_OFF = 1e-9
# Less probable than this, scatter beyond the stated uncertainties is not chance, and they are scaled (Birge).
_SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes
    ----------
    components
        `21` (Li), `12` (Dobariya: no angles) or `none`.
    follows_tangent
        Whether straightness is held to be the integral of the angle (Li Eq. 19).
    bases
        Bases by ISO name; what is not named is chosen by the data.
    freedom
        How functions whose bases are not named are held: `knots` (few splines, their number by evidence; a model
        that is to be tested must not lean on a prior), `smooth` (as many splines as positions, curvature by
        evidence: the least error, for tables) or `elements` (1-D linear or quadratic elements by evidence, Dobariya
        §4; what they cannot follow is not in their standard errors).
    is_robust
        Whether gross outliers are found and left out.
    threads
        0 = all cores.
    """

    components: Components = "21"
    follows_tangent: bool = False
    bases: Mapping[str, BasisSpec] | None = None
    freedom: Freedom = "knots"
    is_robust: bool = True
    threads: int = 0

    def __post_init__(self) -> None:
        """Refuse what a type checker would: the model would be another one, without a word."""
        check_threads(self.threads)
        check_choice("components", self.components, get_args(Components))
        check_choice("freedom", self.freedom, get_args(Freedom))


def fit_terms(
    machine: Machine,
    tables: Sequence[MeasuredTable],
    *,
    effects: Sequence[Term] = (),
    options: FitOptions | None = None,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    sightings: Sightings | None = None,
) -> Fitted:
    """Fit the classic errors and any effects to all observations at once.

    Parameters
    ----------
    machine
        Chain, ranges and tool offset.
    tables
        Measured points, circular tests and lengths.
    effects
        Terms beyond the classic ones, built-in or a user's own.
    rig_sensitivity : (n, 3, p), rig_covariance : (p, p)
        How the calibration moves the points of the first table, and its covariance: fitted along, as unknowns that
        the calibration holds.
    sightings
        The tables joined (`sightings_of`), where that was done before.

    Raises
    ------
    GeometryError
        where nothing can be fitted.

    Notes
    -----
    `docs/theory/model.md`. Verified in tests/fit: standard errors by Monte-Carlo, rank by Li's nine lines,
    `validation/joint.py` against the nine-line arithmetic.
    """
    options = options or FitOptions()
    sightings = within_the_machine(sightings_of(*tables), machine) if sightings is None else sightings
    positions = knot_places_by_axis(sightings)
    shared = calibration_unknowns(tables, sightings, rig_sensitivity, rig_covariance)
    given = dict(options.bases or {})
    rich = {**rich_bases(sightings, names_of(options.components), positions), **given}
    posed = Posed(machine, sightings, shared, options)
    choices: tuple[KnotChoice, ...] = ()
    known = tuple(effect for effect in effects if not has_unknown_inner(effect))

    def classic_on(bases: Mapping[str, BasisSpec]) -> tuple[Term, ...]:
        return classic_terms(machine, options.components, {**rich, **bases}, follows_tangent=options.follows_tangent)

    def fit_on(bases: Mapping[str, BasisSpec]) -> Fitted:
        nonlocal posed
        posed, fitted = posed.rolled_fit((*classic_on(bases), *known))
        return fitted

    found, fitted = determined_bases(
        fit_on,
        {name: basis for name, basis in rich.items() if name not in given},
        sightings,
        positions,
    )
    if (options.components != "none" or effects) and not math.isfinite(fitted.scale):
        n_numbers = counted(int(is_told(sightings).sum()), "number")
        what, columns = ("length", "s_measured") if sightings.has_lengths_only else ("row", "sx, sy and sz")
        raise GeometryError(
            f"{n_numbers} in {counted(fitted.figures.n, what)} leave nothing over beside what they are to tell\n"
            f"hint: measure more positions, or state the uncertainties of these in {columns} (mm)"
        )
    rich = {**rich, **found}
    undecided = [term for term in classic_on(found) if term.id in rich and term.id not in given]
    # Where something is hardly determined its value runs away, and drags along its products with others. To choose
    # by, the first step is enough: at that order what is not seen has no effect.
    one_step = bool(undecided) and bool(run_away(fitted))
    if one_step:
        fitted = posed.fit((*classic_on(found), *known), one_step=True)
    unknown = [effect for effect in effects if has_unknown_inner(effect)]
    can_follow = undecided if options.freedom != "smooth" else ()
    fitted = with_effects(fitted, can_follow, unknown, positions, one_step=one_step, threads=options.threads)
    if undecided and options.freedom == "smooth" and math.isfinite(fitted.scale):
        smoothness = choose_smoothness(undecided, fitted.terms, fitted.covariance_by_scatter, fitted.null_space)
        # Rows of the whitened system: where the noise is not stated, its unit is the scale that was found.
        smooth = posed.fit(fitted.terms, [replace(one, rows=one.rows * fitted.scatter) for one in smoothness])
        # What is determined is for the data to say, not for a prior.
        return replace(
            smooth,
            null_space=fitted.null_space,
            undetermined=fitted.undetermined,
            choices=tuple(KnotChoice(one.name, one.basis, one.n_free, ()) for one in smoothness),
        )
    if undecided:
        family: Family = "elements" if options.freedom == "elements" else "splines"
        open_ids = {term.id for term in undecided}
        undecided = [term for term in fitted.terms if term.id in open_ids]
        choices = choose_bases(
            undecided, fitted.terms, fitted.covariance_by_scatter, fitted.null_space, positions, family
        )
        begun = _with_starts(effects, fitted.terms)

        def fit_with(bases: Mapping[str, BasisSpec]) -> Fitted:
            return posed.fit((*classic_on(bases), *begun))

        fitted = fit_with({choice.name: choice.basis for choice in choices})
        fitted, choices = with_fewer(fitted, choices, positions, fit_with)
    return replace(fitted, choices=choices)


def refit(fitted: Fitted, terms: Sequence[Term]) -> Fitted:
    """Fit other terms to the same data, bases as they are; for adding and removing effects."""
    return replace(fitted.again(tuple(terms)), choices=fitted.choices)


def _with_starts(effects: Sequence[Term], fitted: Sequence[Term]) -> list[Term]:
    """Let inner parameters start where the rich fit left them."""
    by_id = {term.id: term for term in fitted}
    return [effect.with_values(inner=[parameter.value for parameter in by_id[effect.id].inner]) for effect in effects]


@dataclass(frozen=True, eq=False)
class Given:
    """What is known of every row before anything is fitted.

    Attributes
    ----------
    displacement_mm : (n, 3)
        Actual minus nominal position of the row's point, in the axes of its carrier's chain.
    falsified_mm : (n, 3)
        What the rig adds to the measurement, in the measuring frame (of a circle: to the radius).
    is_used : (n,)
        Rows that take part.
    """

    displacement_mm: Numbers
    falsified_mm: Numbers
    is_used: np.ndarray

    def select(self, kept: np.ndarray) -> Given:
        """Give the rows where `kept` (n,) is true."""
        return Given(self.displacement_mm[kept], self.falsified_mm[kept], self.is_used[kept])


class Posed:
    """The data with everything that does not depend on the terms: frames, reference targets, shared unknowns.

    `given`, where it is set, is what is known of the rows: terms that are fitted come on top of it.
    """

    def __init__(
        self, machine: Machine, sightings: Sightings, shared: CalibrationUnknowns | None, options: FitOptions
    ) -> None:
        self.machine = machine
        self.options = options
        nominal = nominal_mm(machine, sightings)
        static = is_static(sightings)
        frames, turns = turned_in_plane(start_frames(nominal, sightings, static), nominal, sightings, static)
        self.frames: Frames = frames
        refuse_strangers(nominal, sightings, static, frames)
        places, offsets = target_places(sightings, static, self.frames)
        is_as_stated = np.array_equal(offsets, sightings.offset_mm)
        # What is known of the rows stays known where no target is placed anew.
        self.sightings = sightings if is_as_stated else replace(sightings, offset_mm=offsets)
        parts = (None if shared is None else shared.derivative, places, turns, middles_of_lengths(sightings))
        derivative = [part for part in parts if part is not None]
        # Of many rows and targets it is hundreds of megabytes.
        whole = np.concatenate(derivative, axis=2) if len(derivative) > 1 else next(iter(derivative), None)
        self.shared = None if whole is None else np.ascontiguousarray(whole)
        self.n_held = 0 if shared is None else shared.n_held
        self.given: Given | None = None
        # Sessions whose rolls about their one line are the last of the shared unknowns.
        self.rolls = np.zeros(0, dtype=np.int64)

    def fit(
        self,
        terms: tuple[Term, ...],
        smoothness: Sequence[Smoothness] = (),
        *,
        one_step: bool = False,
        used: np.ndarray | None = None,
        around: _core.FitState | None = None,
        known_fit: Fitted | None = None,
    ) -> Fitted:
        """Fit these terms, with what is known of the smoothness of some.

        Parameters
        ----------
        one_step
            Stay first order.
        used
            Rows (n,) that take part, where that is known: no gross ones are then looked for.
        around
            Stay first order about the values that the terms have and the frames of this state, whatever frames would
            follow what the terms lack.
        known_fit
            Another fit to the same data: what its triangle has of this one's is not made again.
        """
        if not one_step and around is None:
            return self.rolled_fit(terms, smoothness, used=used, known_fit=known_fit)[1]
        return self._fit(terms, smoothness, one_step=one_step, used=used, around=around, known_fit=known_fit)[1]

    def rolled_fit(
        self,
        terms: tuple[Term, ...],
        smoothness: Sequence[Smoothness] = (),
        *,
        used: np.ndarray | None = None,
        known_fit: Fitted | None = None,
    ) -> tuple[Posed, Fitted]:
        """Fit, and give the data that took part, too, with devices that saw one line turned about it as was found."""
        first = posed, fitted = self._fit(terms, smoothness, used=used, known_fit=known_fit)
        if self.given is not None or not self.frames.along.any():
            return first
        rolls = Rolls(posed.frames.along, posed.rolls)
        for _ in range(_MOST_ROLLS):
            angles = rolls.angles_rad(posed.rolls, *posed._found_rolls(fitted))
            if angles is None:
                break
            if not len(rolls.sessions) and not len(self.rolls):
                # These terms tell none: what was found without them stands.
                return first
            posed, fitted = posed._rolled(fitted, angles, rolls.sessions)._fit(fitted.terms, smoothness, used=used)
        else:
            fitted = replace(fitted, solved=replace(fitted.solved, converged=False))
        return posed, fitted

    def _found_rolls(self, fitted: Fitted) -> tuple[Numbers, Numbers]:
        """Give the rolls of the sessions that have one for an unknown (k,), rad, and their standard errors."""
        places = slice(self._n_other_shared, self._n_other_shared + len(self.rolls))
        solution, first = fitted.solved.solution, fitted.problem.first_shared_column
        spread = solution.spread[first:][places] * fitted.unit
        is_determined = np.asarray(solution.is_determined)[first:][places]
        return np.asarray(fitted.solved.state.shared)[places], np.where(is_determined, spread, np.inf)

    def _rolled(self, fitted: Fitted, angles_rad: Numbers, sessions: np.ndarray) -> Posed:
        """Turn devices about their one line, and have what is left of the rolls of some sessions for unknowns."""
        shared = fitted.shared
        beside_mm = np.zeros((len(self.sightings), 3)) if shared is None else shared @ fitted.solved.state.shared
        derivative, seen = levers(self.frames, self.sightings, fitted.solved, beside_mm, angles_rad, sessions)
        other = copy.copy(self)
        other.frames = turned(self.frames, angles_rad)
        own = None if self.shared is None or not self._n_other_shared else self.shared[:, :, : self._n_other_shared]
        other.shared = beside(own, derivative)
        other.rolls = seen
        return other

    @property
    def _n_other_shared(self) -> int:
        """Number of shared unknowns of the data before those of rolls."""
        return (0 if self.shared is None else self.shared.shape[2]) - len(self.rolls)

    def _fit(
        self,
        terms: tuple[Term, ...],
        smoothness: Sequence[Smoothness],
        *,
        one_step: bool = False,
        used: np.ndarray | None = None,
        around: _core.FitState | None = None,
        known_fit: Fitted | None = None,
    ) -> tuple[Posed, Fitted]:
        """Fit with the devices' rolls to first order; and give the data that took part."""
        sightings, options = self.sightings, self.options
        compiled = compile_terms(self.machine, terms)
        shown = variable_columns(sightings, compiled.variables)
        still = list(standing(sightings, compiled.variables, shown, terms))
        variables = midway(still, compiled.variables, shown)
        known = complete_rows_of(sightings, compiled.variables, variables, terms)
        amounts = self.amounts(still, compiled.variables, shown)[known]
        sightings, variables, own_shared, given = _complete_rows(
            sightings, known, compiled.variables, variables, self.shared, self.given
        )
        shared = beside(own_shared, amounts)
        used = given.is_used if given is not None else None if used is None else used[known]
        if not len(sightings):
            raise GeometryError("no row has all the covariates that the model needs")
        free = [
            place for place, parameter in enumerate(p for term in terms for p in term.inner) if not parameter.is_fixed
        ]
        # What follows inner parameters begins where it is known to be: an inner parameter of an effect of size 0 does
        # nothing.
        at = None if around is None and not free else start_values(terms)[0]
        posed = self._in_frames(around)
        problem = posed._problem(compiled, terms, sightings, variables, shared, given, free, at, known_fit)
        n_model = compiled.n_coefficients + len(free)
        rows = gauge_rows(terms)
        gauge = np.zeros((len(rows), problem.n_columns))
        gauge[:, : compiled.n_coefficients] = rows
        prior = self._prior(terms, smoothness, problem)
        mm_per_unit = self._mm_per_unit(terms, compiled, problem, sightings)
        nothing = np.flatnonzero((mm_per_unit > 0.0) & (mm_per_unit < _ROUND_OFF)).tolist()
        limits = limits_of(terms, mm_per_unit, problem.n_columns)
        # A machine that is known moves points off their lines, and frames roll by that.
        held = held_rolls(self.frames, sightings, problem) if self.given is None else np.zeros((0, problem.n_columns))
        gauge = np.vstack([gauge, holding(nothing, problem.n_columns), held])
        start, known_triangle = problem.start, None
        if known_fit is not None and around is None:
            known_triangle = known_columns(known_fit, terms, compiled, problem, sightings, shared)
            # It is that of its frames; to first order they are as good as those of a machine without errors.
            start = start if known_triangle is None else start.in_frames_of(known_fit.solved.design_state)
        solved = solve(
            problem,
            sightings,
            start,
            gauge,
            prior=prior,
            robust=options.is_robust,
            is_linear=not free,
            inner_ranges=_ranges(terms, free, compiled, problem.n_columns),
            one_step=one_step or around is not None,
            used=used,
            limits=limits,
            known=known_triangle,
            threads=options.threads,
        )
        if around is not None:
            solved = replace(solved, state=problem.start)
        begun_sums = None
        if known_fit is not None and known_triangle is not None:
            begun_sums = known_sums(known_fit, known_triangle, solved)
        on_these = self._on(sightings, own_shared, given)
        return on_these, self._summary(
            terms,
            compiled,
            problem,
            solved,
            sightings,
            free,
            n_model,
            shared,
            prior,
            on_these.fit,
            nothing,
            limits,
            begun_sums,
        )

    def amounts(self, still: Sequence[Standing], names: Sequence[str], variables: Numbers) -> Numbers:
        """Give the derivative (n, 3, p) of measured points by what effects do unseen where an axis never moved.

        `names` and `variables` (k, n) are as rows show them.
        """
        n_rows = len(self.sightings)
        # Where two axes never moved, what one does is told with the other midway.
        variables = midway(still, names, variables)
        found = [np.zeros((n_rows, 3, 0))]
        for one in (one for one in still if not one.is_all):
            there, back = (
                self._moved_by(one.terms, names, one.came(direction, names, variables))[one.rows]
                for direction in (1.0, -1.0)
            )
            across = 0.5 * (there - back)
            shows = (across != 0.0).any(axis=(0, 1))
            found.append(np.zeros((n_rows, 3, int(shows.sum()))))
            found[-1][one.rows] = across[:, :, shows]
        return np.concatenate(found, axis=2)

    def _moved_by(self, terms: Sequence[Term], names: Sequence[str], variables: Numbers) -> Numbers:
        """Give how one unit of each coefficient of some terms moves measured points, (n, 3, m)."""
        own = compile_terms(self.machine, terms)
        columns = np.ascontiguousarray(variables[[names.index(name) for name in own.variables]])
        problem = self._problem(own, terms, self.sightings, columns, None, None, [])
        units = np.eye(own.n_coefficients, problem.n_columns)
        moved = [problem.first_order_mm(problem.start, unit, self.options.threads) for unit in units]
        return np.stack(moved, axis=2)

    def _mm_per_unit(
        self, terms: Sequence[Term], compiled: Compiled, problem: _core.FitProblem, sightings: Sightings
    ) -> Numbers:
        """Give how far one unit of each coefficient of a formula moves points at most, (n_coefficients,).

        Infinite for the classic errors, of which it is not asked: splines, and constants, which show everywhere.

        A wave whose period divides the step moves none but by round-off: as a column of length 1 it would be
        determined, and absurd.

        Raises
        ------
        GeometryError
            where a formula gives no number at some row, naming the term and the row.
        """
        largest = np.full(compiled.n_coefficients, np.inf)
        own = [
            np.arange(place.start, place.stop)
            for term, place in zip(terms, compiled.coefficient_slices, strict=True)
            if term.kind != "classic"
        ]
        if not own:
            return largest
        places = np.concatenate(own)
        found, bad = problem.largest_entries(problem.start, places, self.options.threads)
        if bad is not None:
            raise _not_finite(terms, compiled, sightings, *bad)
        assert found is not None
        largest[places] = found / float(sightings.whitening.max(initial=1e-300))
        return largest

    def _in_frames(self, state: _core.FitState | None) -> Posed:
        """Give the same in the frames of a state; None leaves them as they are."""
        if state is None:
            return self
        other = copy.copy(self)
        other.frames = replace(
            self.frames,
            rotations=state.rotations,
            translations_mm=state.translations_mm,
            excess_mm=state.excess_mm,
        )
        return other

    def _on(self, sightings: Sightings, shared: Numbers | None, given: Given | None) -> Posed:
        """Give the same with these rows only, so that what is compared is compared on the same rows."""
        if len(sightings) == len(self.sightings):
            return self
        other = copy.copy(self)
        other.sightings, other.shared, other.given = sightings, shared, given
        return other

    def problem_of(self, terms: tuple[Term, ...], free: Sequence[int] = ()) -> _core.FitProblem:
        """Pose the problem that starts from the values that the terms have; for rows that lack no covariate.

        `free` are the places of the inner parameters that have columns.
        """
        compiled = compile_terms(self.machine, terms)
        variables = known_variables(self.sightings, compiled.variables, terms)
        values, _ = start_values(terms)
        return self._problem(compiled, terms, self.sightings, variables, self.shared, self.given, free, values)

    def _prior(
        self, terms: Sequence[Term], smoothness: Sequence[Smoothness], problem: _core.FitProblem
    ) -> Numbers | None:
        """Give the rows of what is known besides the measurements: the calibration, and curvatures."""
        calibration = np.zeros((self.n_held, problem.n_columns))
        first = problem.first_shared_column
        calibration[:, first : first + self.n_held] = np.eye(self.n_held)
        rows = np.concatenate(
            [calibration, prior_rows(terms, {one.name: one for one in smoothness}, problem.n_columns)]
        )
        return rows if len(rows) else None

    def _problem(
        self,
        compiled: Compiled,
        terms: Sequence[Term],
        sightings: Sightings,
        variables: Numbers,
        shared: Numbers | None,
        given: Given | None,
        free: Sequence[int],
        values: Numbers | None = None,
        known_fit: Fitted | None = None,
    ) -> _core.FitProblem:
        frames = self.frames
        offset_mm, measured_mm = sightings.offset_mm, sightings.measured_mm
        if given is not None:
            # Of a machine without errors, a point that is displaced is one that sits elsewhere.
            offset_mm, measured_mm = offset_mm + given.displacement_mm, measured_mm - given.falsified_mm
        inner = np.array([p.value for term in terms for p in term.inner], dtype=np.float64)
        return _core.FitProblem(
            compiled.core,
            sightings.carrier,
            np.ascontiguousarray(sightings.commanded_mm),
            np.ascontiguousarray(offset_mm),
            np.ascontiguousarray(variables),
            sightings.sequences,
            times_s(sightings) if compiled.needs_order else None,
            np.ascontiguousarray(measured_mm),
            np.ascontiguousarray(sightings.whitening),
            sightings.session,
            (frames.kinds, frames.rotations, frames.translations_mm, frames.excess_mm, frames.pivots_mm),
            np.zeros(compiled.n_coefficients) if values is None else values,
            inner,
            list(free),
            shared,
            None if known_fit is None else known_fit.problem,
            sightings.length,
        )

    def _summary(
        self,
        terms: tuple[Term, ...],
        compiled: Compiled,
        problem: _core.FitProblem,
        solved: Solved,
        sightings: Sightings,
        free: Sequence[int],
        n_model: int,
        shared: Numbers | None,
        prior: Numbers | None,
        fit_of_terms: Callable[..., Fitted],
        nothing: Sequence[int],
        limits: Numbers,
        begun_sums: BegunSums | None,
    ) -> Fitted:
        n_numbers = int(sightings.is_measured[solved.used].sum())
        # Rows of a prior take their share of the unknowns; what the data do is left.
        held = 0.0 if prior is None else float(((prior @ solved.solution.covariance_root) ** 2).sum())
        dof = n_numbers - (solved.solution.rank - held)
        scale = _scale(solved, sightings, dof)
        places = [*range(compiled.n_coefficients), *(compiled.n_coefficients + place for place in free)]
        covariance = np.zeros((compiled.n_coefficients + compiled.n_inner,) * 2)
        null_space = np.zeros((len(covariance), solved.solution.null_space.shape[1]))
        root = held_smallest(solved.solution.covariance_root_of_first(n_model), solved.solution.null_space, limits)
        covariance[np.ix_(places, places)] = root @ root.T * scale**2
        jumps = jump_errors(problem, solved, terms, sightings, free, scale, threads=self.options.threads)
        for place, error in jumps.items():
            # By no derivative: a prediction has none by the moment of a jump.
            at = compiled.n_coefficients + place
            covariance[at, :] = covariance[:, at] = 0.0
            covariance[at, at] = error**2
        std = np.sqrt(np.diagonal(covariance)[: compiled.n_coefficients])
        directions, is_determined = concerned(
            solved.solution.null_space, np.asarray(solved.solution.is_determined), terms, limits, std
        )
        null_space[places] = directions[:n_model]
        touches = np.abs(null_space).max(axis=0, initial=0.0) > 0.0
        positions = positions_by_axis(sightings.commanded_mm, SAME_POSITION_MM)
        is_determined[list(nothing)] = False
        is_determined[[compiled.n_coefficients + free.index(place) for place in jumps]] = True
        is_open = np.zeros(len(covariance), dtype=bool)
        is_open[places] = ~is_determined[:n_model]
        return Fitted(
            machine=self.machine,
            terms=_with_values(terms, compiled, solved, covariance, is_open, null_space),
            sightings=sightings,
            compiled=compiled,
            problem=problem,
            solved=solved,
            covariance=covariance,
            root=root,
            limits=limits,
            null_space=null_space[:, touches],
            undetermined=Undetermined(
                terms,
                is_determined,
                directions,
                sightings,
                n_model,
                [axis for axis in AXES if len(positions[axis]) < 2],
                names_of(self.options.components),
                self.machine,
            ),
            scale=scale,
            dof=dof,
            shared=shared,
            fit_of_terms=fit_of_terms,
            prior=prior,
            threads=self.options.threads,
            begun_sums=begun_sums,
        )


def _ranges(terms: Sequence[Term], free: Sequence[int], compiled: Compiled, n_columns: int) -> Ranges | None:
    """Give the ranges of the inner parameters that have columns."""
    if not free:
        return None
    inner = [parameter for term in terms for parameter in term.inner]
    ends = np.array([[inner[place].low, inner[place].high] for place in free], dtype=np.float64)
    column = compiled.n_coefficients + np.arange(len(free))
    is_followed = np.zeros(n_columns, dtype=bool)
    is_followed[column] = True
    for term, own in zip(terms, compiled.coefficient_slices, strict=True):
        is_followed[own] = any(not parameter.is_fixed for parameter in term.inner)
    return Ranges(np.array(free), column, ends[:, 0], ends[:, 1], is_followed)


def _not_finite(
    terms: Sequence[Term], compiled: Compiled, sightings: Sightings, row: int, column: int
) -> GeometryError:
    term = next(one for one, own in zip(terms, compiled.coefficient_slices, strict=True) if column < own.stop)
    place = place_of_row(float(sightings.numbers("file_row")[row]), row)
    at = ", ".join(f"{value:g}" for value in sightings.commanded_mm[row])
    formula = next((part.expression for part in term.parts if part.expression), "")
    return GeometryError(
        f"{term.id} gives no finite number at ({at}) mm, {place}\n"
        f"hint: its formula must hold wherever the machine was measured: {formula}"
    )


def beside(shared: Numbers | None, amounts: Numbers) -> Numbers | None:
    """Give the derivative by all unknowns that rows share; what the calibration holds comes first."""
    if amounts.shape[2] == 0:
        return shared
    return np.ascontiguousarray(amounts if shared is None else np.concatenate([shared, amounts], axis=2))


def _complete_rows(
    sightings: Sightings,
    known: np.ndarray,
    names: Sequence[str],
    variables: Numbers,
    shared: Numbers | None,
    given: Given | None,
) -> tuple[Sightings, Numbers, Numbers | None, Given | None]:
    """Leave out, counted, the rows that lack a covariate that the model needs."""
    if known.all():
        return sightings, variables, shared, given
    return (
        with_rows(sightings, known, why_lacking(names, variables, known)),
        variables[:, known],
        None if shared is None else shared[known],
        None if given is None else given.select(known),
    )


def _scale(solved: Solved, sightings: Sightings, dof: float) -> float:
    """Give what standard uncertainties are multiplied by: Birge's ratio where the scatter exceeds what is stated."""
    if dof <= 0:
        return 1.0 if sightings.is_stated else math.nan
    ratio = solved.chi_squared / dof
    if not sightings.is_stated:
        return math.sqrt(ratio)
    is_more = ratio > 1.0 and float(chi_squared_sf(solved.chi_squared, dof)) < _SIGNIFICANCE
    return math.sqrt(ratio) if is_more else 1.0


def _with_values(
    terms: Sequence[Term],
    compiled: Compiled,
    solved: Solved,
    covariance: Numbers,
    is_open: np.ndarray,
    null_space: Numbers,
) -> tuple[Term, ...]:
    """Give terms their values and standard errors; a parameter that is not determined has no error.

    Its value is the smallest of those that explain as much: with an error as small it would pass for a result. Of an
    error of an axis that is known but for a line the rest is a result.
    """
    theta, phi = solved.state.coefficients, solved.state.inner
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    std_of_open = np.where(is_open, np.nan, std)
    result, first, first_inner = [], 0, 0
    for term in terms:
        own = slice(first, first + len(term.coefficients))
        own_inner = slice(first_inner, first_inner + len(term.inner))
        after = slice(compiled.n_coefficients + own_inner.start, compiled.n_coefficients + own_inner.stop)
        errors = std_of_open
        if is_open[own].any() and is_a_line(term, null_space[own]):
            errors = std
        result.append(
            term.with_values(
                theta[own].tolist(),
                phi[own_inner].tolist(),
                coefficients_std=errors[own].tolist(),
                inner_std=errors[after].tolist(),
            )
        )
        first, first_inner = own.stop, own_inner.stop
    return tuple(result)
