"""A fit: what was found, and everything that can be asked of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoerr import _core
from geoerr.distributions import chi_squared_ppf
from geoerr.error_functions import NotDetermined
from geoerr.fit.covariance_parts import SharedNoise
from geoerr.fit.figures import ErrorFigures, figures_of
from geoerr.fit.free_directions import held_smallest
from geoerr.fit.held_out import HeldOut, folds_of, leave_out
from geoerr.fit.knots import KnotChoice
from geoerr.fit.lengths import told_in_base_axes
from geoerr.fit.noise import Repeats, repeats_of
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.solve import Solved
from geoerr.fit.split import Split, split_of
from geoerr.fit.undetermined import Undetermined
from geoerr.fit.worked_out import KeepsWorkedOut
from geoerr.machine import Machine
from geoerr.model.compile import Compiled
from geoerr.terms import Term

# Points scatter less than is stated where chance seldom has them scatter so little, and by more than what setting
# gross rows aside takes off. What fits more closely yet has no noise to be measured by, and a note says so.
_SELDOM = 0.01
_LESS, _LEAST = 0.8, 0.01


@dataclass(frozen=True, eq=False)
class Outlier:
    """A row that was left out because nothing like it occurs by chance: place and residual (base axes)."""

    row: int
    line: str
    commanded_mm: tuple[float, float, float]
    residual_um: tuple[float, float, float]


@dataclass(eq=False)
class BegunSums:
    """Sums over folds of another fit to begin at, and where this one's columns are in them: until they are taken."""

    sums: tuple[_core.FitSums, np.ndarray] | None = None

    def take(self) -> tuple[_core.FitSums, np.ndarray] | None:
        """Give them, and hold them no longer: each is megabytes, and fits follow one another."""
        sums, self.sums = self.sums, None
        return sums


@dataclass(frozen=True, eq=False)
class Fitted(KeepsWorkedOut):
    """A fit with everything that can be asked of it; arrays are in the order of `sightings`.

    Attributes
    ----------
    machine, terms
        The model: terms hold their values and standard errors.
    sightings
        The data.
    compiled, problem, solved
        The core's objects, for whoever asks further (candidates, predictions).
    covariance
        Of all parameters (coefficients of all terms, then inner), scaled.
    root
        (k, rank) of the model's unknowns R with R Rᵀ their unscaled covariance; along free directions the smallest.
    limits
        (n_columns,) what is absurd for each unknown.
    null_space
        (m, k) over the same parameters: directions that the data do not determine.
    undetermined
        The same, to be put in words.
    scale
        What the stated standard uncertainties were multiplied by; the standard deviation in mm where none are stated.
    dof
        Degrees of freedom of the residual.
    shared
        (n, 3, p) derivative of measured points by unknowns that rows share, or None.
    prior
        (r, n_columns) rows P with P u = 0 ± 1 that were known besides the measurements, or None: the calibration's
        (on shared unknowns) and curvatures (on coefficients).
    fit_of_terms
        Fits terms to the same data: `Posed.fit`.
    choices
        How each function's basis was chosen.
    begun_sums
        Of the fit that this one began at.
    shared_noise
        What rows share, where they do and it is counted in `covariance` (`with_shared_noise`); else None.
    """

    machine: Machine
    terms: tuple[Term, ...]
    sightings: Sightings
    compiled: Compiled
    problem: _core.FitProblem
    solved: Solved
    covariance: Numbers
    root: Numbers
    limits: Numbers
    null_space: Numbers
    undetermined: Undetermined
    scale: float
    dof: float
    shared: Numbers | None
    fit_of_terms: Callable[..., Fitted]
    choices: tuple[KnotChoice, ...] = ()
    prior: Numbers | None = None
    threads: int = 0
    begun_sums: BegunSums | None = None
    shared_noise: SharedNoise | None = None

    def again(
        self,
        terms: tuple[Term, ...],
        *,
        one_step: bool = False,
        used: np.ndarray | None = None,
        around: _core.FitState | None = None,
    ) -> Fitted:
        """Fit other terms to the same data; keywords are those of `Posed.fit`."""
        return self.fit_of_terms(terms, one_step=one_step, used=used, around=around, known_fit=self)

    @property
    def root_of_all(self) -> Numbers:
        """`root` of all unknowns, (n_columns, rank): of many sessions mostly zeros, and as large as their square."""
        solution = self.solved.solution
        return held_smallest(solution.covariance_root, solution.null_space, self.limits)

    @property
    def not_determined(self) -> tuple[NotDetermined, ...]:
        """What the data do not determine, with the reason and the remedy."""
        return self.undetermined.reasons

    @property
    def unit(self) -> float:
        """Size of one standard deviation among the whitened residuals; 1 where nothing tells their scatter."""
        return self.scale if math.isfinite(self.scale) and self.scale > 0.0 else 1.0

    @property
    def places_of_unknowns(self) -> list[int]:
        """Where the model's unknowns, in the order of their columns, stand among all parameters; others are fixed."""
        first = self.compiled.n_coefficients
        inner = [parameter for term in self.terms for parameter in term.inner]
        return [*range(first), *(first + place for place, one in enumerate(inner) if not one.is_fixed)]

    @property
    def state_of_columns(self) -> _core.FitState:
        """Where the columns are to be made: of a linear model at the nominal machine, as the fit took them."""
        is_linear = len(self.places_of_unknowns) == self.compiled.n_coefficients
        return self.problem.start if is_linear else self.solved.state

    @cached_property
    def residual_mm(self) -> Numbers:
        """Measured minus predicted in base axes, (n, 3); radii, and lengths at second ends, in the first one."""
        return told_in_base_axes(self.sightings, self.problem, self.solved.state, self.solved.residual_mm)

    @cached_property
    def figures(self) -> ErrorFigures:
        """How large the residuals are."""
        return figures_of(self.sightings, self.residual_mm, self.solved.used)

    @cached_property
    def held_out(self) -> HeldOut:
        """How far the fit is off where it did not see the data."""
        return self.leave_out(folds_of(self.sightings))

    def leave_out(self, fold: np.ndarray) -> HeldOut:
        """Predict every fold, numbered by row (n,), from the others."""
        return leave_out(
            self.problem,
            self.solved.state,
            self.solved.design_state,
            self.solved.solution,
            self.sightings,
            self.solved.residual_mm,
            self.solved.used,
            fold,
            shared=self.shared,
            known=None if self.begun_sums is None else self.begun_sums.take(),
            threads=self.threads,
        )

    @property
    def held_out_if_known(self) -> HeldOut | None:
        """`held_out`, where somebody asked for it already."""
        known: HeldOut | None = self.__dict__.get("held_out")
        return known

    @cached_property
    def repeats(self) -> Repeats:
        """What repeated rows say of the noise."""
        return repeats_of(self.sightings, self.residual_mm, self.solved.used)

    @cached_property
    def split(self) -> Split:
        """The residual in parts."""
        return split_of(self.sightings, self.solved, self.residual_mm, self.repeats, self.dof)

    @cached_property
    def outliers(self) -> tuple[Outlier, ...]:
        """Rows that were left out."""
        sightings = self.sightings
        lines = sightings.texts("line") if "line" in sightings.table.columns else [""] * len(sightings)
        return tuple(
            Outlier(int(row), lines[row], _three(sightings.commanded_mm[row]), _three(1e3 * self.residual_mm[row]))
            for row in np.flatnonzero(~self.solved.used)
        )

    @property
    def share_of_stated(self) -> float:
        """How far points scatter as a share of what is stated; NaN where nothing is stated or left over."""
        is_told = self.sightings.is_stated and self.dof > 0
        return math.sqrt(self.solved.chi_squared / self.dof) if is_told else math.nan

    @cached_property
    def scatter(self) -> float:
        """Size of one standard deviation among the whitened residuals as they scatter; 1 where nothing tells it.

        It is `unit` but where points scatter less than is stated, for certain: what errors can follow is told from
        scatter, whatever else a stated uncertainty is of.
        """
        if not self.share_of_stated < 1.0:
            return self.unit
        most = math.sqrt(self.solved.chi_squared / float(chi_squared_ppf(_SELDOM, self.dof)))
        return most if _LEAST < most < _LESS else self.unit

    @property
    def covariance_by_scatter(self) -> Numbers:
        """`covariance` by how points scatter; to be asked for before it counts what they share."""
        return self.covariance * (self.scatter / self.unit) ** 2

    @property
    def n_parameters(self) -> int:
        """Number of parameters of the model: coefficients and inner."""
        return self.compiled.n_coefficients + self.compiled.n_inner

    @property
    def n_determined(self) -> int:
        """Number of them that the data determine: the rank, less what belongs to frames, places and calibration.

        Gauges and what is held take some of them away, and so do directions that no measurement notices.
        """
        directions = self.solved.solution.null_space
        n_model = self.undetermined.first_frame_column
        n_others = self.problem.n_columns - n_model
        n_open_others = directions.shape[1] - np.linalg.matrix_rank(directions[:n_model])
        return int(self.solved.solution.rank - n_others + n_open_others)

    @property
    def expected_held_out_um(self) -> float | None:
        """Held-out error of a right model: √(noise² + mean trace of the prediction's covariance)."""
        if self.split.noise_um is None:
            return None
        prediction_um2 = self.held_out.prediction_variance_mm2 * self.scale**2 * 1e6
        return math.sqrt(self.split.noise_um**2 + prediction_um2)


def _three(values: Numbers) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
