"""The 21 errors as linear functions of common parameters: what makes two states comparable number by number.

Every state is fitted with the same bases, so that its errors at the common positions are `R θ` with one R for all
of them. The gauge (DESIGN.md) is part of R: what two sessions cannot agree on, where the work stands and how the tool
is tilted, is not in the tables, and a difference of tables is a difference of the machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from geoerr.error_functions import (
    ALL_NAMES,
    LI_SQUARENESS,
    ErrorFunction,
    ErrorFunctions,
    NotDetermined,
    Squareness,
    is_angular,
)
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES, Machine
from geoerr.model.compile import Compiled, compile_terms
from geoerr.model.functionals import Rows
from geoerr.model.gauge import gauged_rows
from geoerr.states.chance import Spread
from geoerr.terms import Term

_RANK = 1e-10
# Standard deviations below this share of the largest of their unit are zeros of the gauge or of the rigid motion.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters of the common terms, and how well they are known.

    Attributes
    ----------
    parameters : (m,)
        Coefficients of all terms.
    covariance : (m, m)
        Of these.
    dof
        Degrees of freedom of the noise's scale; infinite where that is stated.
    part : (m, k)
        Root of the part of the covariance that stems from offsets of passes.
    part_dof
        Degrees of freedom that told their size; infinite where there are none.
    """

    parameters: Numbers
    covariance: Numbers
    dof: float
    part: Numbers | None = None
    part_dof: float = math.inf

    @cached_property
    def spread(self) -> Spread:
        """Root of the covariance, and how well it is known."""
        part = np.zeros((len(self.parameters), 0)) if self.part is None else self.part
        return Spread(root_of(self.covariance), part, self.part_dof, self.dof)

    @property
    def root(self) -> Numbers:
        """F (m, k) with F Fᵀ the covariance."""
        return self.spread.root

    def minus(self, other: Estimate, places: Mapping[str, slice]) -> Estimate:
        """Give the difference of two that know nothing of each other.

        Parameters
        ----------
        places
            ISO name of each function to the place of its parameters.
        """
        covariance = self.covariance + other.covariance
        part = np.hstack([self.spread.part, other.spread.part])
        # Two estimated sizes count as one, of the degrees of freedom that the sum of two such variances has.
        std = without_rounding(np.sqrt(np.maximum(np.diag(covariance), 0.0)), places)
        known = std > 0.0
        sizes = [float(((one.spread.part[known] / std[known, None]) ** 2).sum()) for one in (self, other)]
        wide = sum(size**2 / one.part_dof for size, one in zip(sizes, (self, other), strict=True))
        part_dof = sum(sizes) ** 2 / wide if wide > 0.0 else math.inf
        return Estimate(self.parameters - other.parameters, covariance, min(self.dof, other.dof), part, part_dof)


@dataclass(frozen=True, eq=False)
class Functions:
    """The errors that all states determine.

    Attributes
    ----------
    machine
        The machine.
    terms
        Common terms; their values say nothing.
    position_mm
        Axis to the positions of its tables.
    rows
        ISO name to R (n, m): the function at its positions, or a squareness, is R θ.
    not_determined
        The others of the 21, with the reason.
    loose : (m, k)
        Directions of the parameters that some state does not determine.
    """

    machine: Machine
    terms: tuple[Term, ...]
    position_mm: Mapping[str, Numbers]
    rows: Mapping[str, Numbers]
    not_determined: tuple[NotDetermined, ...]
    loose: Numbers

    @cached_property
    def compiled(self) -> Compiled:
        """The terms as the core computes them."""
        return compile_terms(self.machine, self.terms)

    @property
    def names(self) -> tuple[str, ...]:
        """ISO names of the determined ones, in the order of the 21."""
        return tuple(self.rows)

    @cached_property
    def stacked(self) -> Numbers:
        """All rows, one function under the other."""
        return np.concatenate([np.zeros((0, self.compiled.n_coefficients)), *self.rows.values()])

    @cached_property
    def spans(self) -> dict[str, slice]:
        """ISO name to its place in `stacked`."""
        ends = np.cumsum([0, *(len(own) for own in self.rows.values())]).tolist()
        return {name: slice(low, high) for name, low, high in zip(self.rows, ends, ends[1:], strict=False)}

    @property
    def range_mm(self) -> dict[str, tuple[float, float]]:
        """Give the range of each axis over which states are compared."""
        return {axis: (float(places[0]), float(places[-1])) for axis, places in self.position_mm.items()}

    @cached_property
    def own(self) -> dict[str, slice]:
        """Term id to its place among the parameters."""
        return dict(zip((term.id for term in self.terms), self.compiled.coefficient_slices, strict=True))

    @cached_property
    def places(self) -> dict[str, slice]:
        """ISO name of what all states determine to its term's place among the parameters."""
        return {name: self.own[term_id_of(name)] for name in self.names}

    @cached_property
    def determined(self) -> Numbers:
        """Tell which parameters belong to errors that all states determine, (m,) of 0 and 1."""
        mask = np.zeros(self.compiled.n_coefficients)
        for own in self.places.values():
            mask[own] = 1.0
        return mask

    @property
    def with_determined_only(self) -> Functions:
        """Give the same for estimates that leave parameters of errors that are not determined at 0."""
        return replace(self, loose=np.diag(1.0 - self.determined)[:, self.determined == 0.0])

    def tables(self, estimate: Estimate, method: str, notes: tuple[str, ...] = ()) -> ErrorFunctions:
        """Give an estimate as tables with standard uncertainties."""
        functions, squareness = {}, {}
        for name, rows in self.rows.items():
            value, std = rows @ estimate.parameters, np.linalg.norm(rows @ estimate.root, axis=1)
            if name in LI_SQUARENESS:
                squareness[name] = Squareness(float(value[0]), float(std[0]))
            else:
                functions[name] = ErrorFunction(self.position_mm[name[2].lower()], value, std)
        return ErrorFunctions(
            self.machine, functions, squareness, method, not_determined=self.not_determined, notes=notes
        )

    def with_values(self, parameters: Numbers) -> tuple[Term, ...]:
        """Give the terms with these values."""
        return with_values(self.terms, parameters)


def with_values(terms: Sequence[Term], parameters: Numbers) -> tuple[Term, ...]:
    """Give terms with coefficients (m,), in the order of theirs."""
    ends = np.cumsum([len(term.coefficients) for term in terms])
    return tuple(
        term.with_values(own.tolist()) for term, own in zip(terms, np.split(parameters, ends[:-1]), strict=True)
    )


def term_id_of(name: str) -> str:
    """Give the term that an ISO name belongs to: a squareness has its channel's."""
    return LI_SQUARENESS[name][0] if name in LI_SQUARENESS else name


def gauged(machine: Machine, terms: tuple[Term, ...], position_mm: Mapping[str, Numbers]) -> dict[str, Rows]:
    """Give the 21 at positions, in the order of their names."""
    found = gauged_rows(machine, terms, position_mm, {})
    return {name: found[name] for name in ALL_NAMES if name in found}


def root_of(covariance: Numbers) -> Numbers:
    """Give F (m, k) with F Fᵀ the covariance, its parameters compared without units."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.divide(1.0, std, out=np.zeros_like(std), where=std > 0.0)
    value, vector = np.linalg.eigh(covariance * scale[:, None] * scale)
    kept = value > _RANK * max(float(value[-1]), 0.0) if len(value) else np.zeros(0, dtype=bool)
    return np.asarray(std[:, None] * vector[:, kept] * np.sqrt(value[kept]))


def above_rounding(std: Numbers) -> npt.NDArray[np.bool_]:
    """Tell which numbers of one unit are not held at 0: rounding has no size that could be compared."""
    return np.asarray(std > _ROUNDING * std.max(initial=0.0))


def without_rounding(std: Numbers, places: Mapping[str, slice]) -> Numbers:
    """Give standard deviations with 0 for what the gauge holds at 0.

    Parameters
    ----------
    std : (n,)
        Of numbers of several functions.
    places
        ISO name of each function to the place of its numbers; what belongs to none is 0.
    """
    held = np.zeros_like(std)
    # By unit, not by function: straightness of two positions is nothing but zeros.
    for angular in (False, True):
        alike = np.zeros(len(std), dtype=bool)
        for own in (own for name, own in places.items() if is_angular(name) == angular):
            alike[own] = True
        held[alike] = std[alike] * above_rounding(std[alike])
    return held


def grid_mm(range_mm: Mapping[str, tuple[float, float]], n_points: int) -> Numbers:
    """Give a grid (n³, 3) over a range, x slowest."""
    lines = [np.linspace(*range_mm[axis], n_points) for axis in AXES]
    return np.stack([places.ravel() for places in np.meshgrid(*lines, indexing="ij")], axis=1)
