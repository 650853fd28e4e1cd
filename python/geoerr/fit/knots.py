"""How much freedom each error function needs: chosen by the data, and stated.

A rich basis is fitted first. Its estimate and covariance at the measured positions hold all that the data say about
the function, so that every coarser basis is judged without another fit: with V the covariance of the rich estimate f,

    χ²(coarser) = min_α (f − B α)ᵀ V⁺ (f − B α),   score = χ² + 2 · (free coefficients)   (Akaike, known variance)

The gauge is part of every candidate. The basis taken is two steps richer than the one of least score.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geoerr.bases import basis_of, candidate_bases, spline_over
from geoerr.fit.aliases import Determined, simplified
from geoerr.fit.classic import is_straightness
from geoerr.fit.sightings import Numbers
from geoerr.terms import BasisSpec, Term

Family = Literal["splines", "elements"]

# Positions at which functions are compared, for each function of the rich basis: more add nothing.
_PLACES_OF_A_FUNCTION = 4
# Steps beyond the best score. Where the score is least, what a basis cannot follow is about as large as its standard
# error, and intervals hold the truth in 87 % of cases instead of 95; two coefficients more make them honest for a
# tenth of the certainty (validation/joint.md).
_BEYOND_THE_BEST = 2
# Eigenvalues of V, and singular values, below this share of the largest are directions of the gauge, or round-off.
_RANK = 1e-10


@dataclass(frozen=True)
class Candidate:
    """A basis with its score: free coefficients, χ² against the rich estimate, and both together."""

    n_free: int
    chi_squared: float
    score: float


@dataclass(frozen=True)
class KnotChoice:
    """The basis chosen for one function.

    Attributes
    ----------
    name
        ISO name.
    basis
        What was chosen.
    n_free
        Its free coefficients, the gauge taken off.
    candidates
        All that were judged, fewest coefficients first.
    """

    name: str
    basis: BasisSpec
    n_free: float
    candidates: tuple[Candidate, ...]


def choose_bases(
    undecided: Sequence[Term],
    fitted: Sequence[Term],
    covariance: Numbers,
    null_space: Numbers,
    positions_mm: Mapping[str, Numbers],
    family: Family = "splines",
    ladder: Ladder | None = None,
) -> tuple[KnotChoice, ...]:
    """Choose a basis for each undecided function from the fit with rich ones.

    Parameters
    ----------
    undecided
        Terms whose bases are to be chosen.
    fitted
        All terms of the rich fit, with values.
    covariance, null_space
        Of its parameters.
    positions_mm
        Distinct positions of each axis.
    family
        `splines`: polynomials and cubic splines. `elements`: two-node linear and three-node quadratic elements
        (Dobariya §4), the kind and the number for each function.
    ladder
        Of these positions, where there is one already.
    """
    ladder = ladder or Ladder(positions_mm)
    wanted: dict[str, list[BasisSpec]] = {}
    for term in undecided:
        basis = term.parts[0].basis
        if basis is not None:
            places = positions_mm[basis.axis]
            wanted[term.id] = (
                ladder.splines(term.id, basis) if family == "splines" else _elements(term.id, basis, places)
            )
    values = np.zeros(len(covariance))
    coefficients = [parameter.value for term in fitted for parameter in term.coefficients]
    values[: len(coefficients)] = coefficients
    # Of functions that are not told apart one stands for all of them.
    known = simplified(
        fitted,
        {name: bases[0] for name, bases in wanted.items()},
        positions_mm,
        Determined(values, covariance, null_space),
    )
    beyond = _BEYOND_THE_BEST if family == "splines" else 0
    choices = []
    first = 0
    for term in fitted:
        own = slice(first, first + len(term.coefficients))
        first = own.stop
        basis = term.parts[0].basis
        if term.id in known.simple:
            choices.append(KnotChoice(term.id, wanted[term.id][0], 0, ()))
        elif term.id in wanted and basis is not None:
            block, loose = known.covariance[own, own], known.null_space[own]
            places = positions_mm[basis.axis]
            choices.append(
                _choose(term.id, basis, known.values[own], block, loose, places, wanted[term.id], beyond, ladder)
            )
    return tuple(choices)


def _choose(
    name: str,
    rich: BasisSpec,
    coefficients: Numbers,
    covariance: Numbers,
    null_space: Numbers,
    positions_mm: Numbers,
    bases: Sequence[BasisSpec],
    beyond: int,
    ladder: Ladder,
) -> KnotChoice:
    known = determined_values(rich, coefficients, covariance, null_space, positions_mm)
    if known is None:
        # Nothing is known of the function: the simplest one is enough to say so.
        return KnotChoice(name, bases[0], 0, ())
    places, _, whiten, target = known
    candidates = []
    for spec in bases:
        columns = ladder.columns(name, spec, places)
        chi_squared, rank = misfit(whiten @ columns, target)
        candidates.append(Candidate(rank, chi_squared, chi_squared + 2.0 * rank))
    best = int(np.argmin([candidate.score for candidate in candidates]))
    best = min(best + beyond, len(candidates) - 1)
    return KnotChoice(name, bases[best], candidates[best].n_free, tuple(candidates))


def misfit(columns: Numbers, target: Numbers) -> tuple[float, int]:
    """Give χ² of a target (m,) against whitened columns (m, k), and their rank."""
    solution, _, rank, _ = np.linalg.lstsq(columns, target, rcond=_RANK)
    left = target - columns @ solution
    return float(left @ left), int(rank)


def determined_values(
    basis: BasisSpec, coefficients: Numbers, covariance: Numbers, null_space: Numbers, positions_mm: Numbers
) -> tuple[Numbers, Numbers, Numbers, Numbers] | None:
    """Give what the data determine of a function: places (n,), functions there (n, k), W (m, n), and W f (m,).

    W whitens values at the places by their covariance; None where nothing is known.
    """
    places = _places(positions_mm, _PLACES_OF_A_FUNCTION * basis.n_functions)
    # What the data do not determine of the function says nothing of its shape.
    determined = np.eye(len(coefficients)) - _onto(null_space)
    design = basis_of(basis).evaluate(places) @ determined
    # There are more places than functions: values at them differ along no other directions than the functions'.
    along, functions = np.linalg.qr(design)
    spread, direction = np.linalg.eigh(functions @ covariance @ functions.T)
    keep = spread > _RANK * max(float(spread[-1]), 0.0)
    if not keep.any():
        return None
    whiten = (along @ direction[:, keep]).T / np.sqrt(spread[keep])[:, None]
    return places, design, whiten, whiten @ (design @ coefficients)


def _onto(directions: Numbers) -> Numbers:
    """Give the projection (k, k) onto what columns (k, d) span."""
    if not directions.size or not np.abs(directions).max() > 0.0:
        return np.zeros((len(directions), len(directions)))
    left, size, _ = np.linalg.svd(directions, full_matrices=False)
    kept = left[:, size > _RANK * size[0]]
    return np.asarray(kept @ kept.T)


def _places(positions_mm: Numbers, most: int) -> Numbers:
    if len(positions_mm) <= most:
        return positions_mm
    return np.asarray(np.quantile(positions_mm, np.linspace(0.0, 1.0, most)))


class Ladder:
    """The bases that `choose_bases` chooses from, made once: functions of one axis share them."""

    def __init__(self, positions_mm: Mapping[str, Numbers]) -> None:
        self._positions_mm = positions_mm
        self._found: dict[tuple[str, int], BasisSpec] = {}
        self._columns: dict[tuple[bool, int, BasisSpec], Numbers] = {}

    def splines(self, name: str, rich: BasisSpec) -> list[BasisSpec]:
        """List polynomials, then cubic splines of growing number, up to the rich basis of a function of that name."""
        places = self._positions_mm[rich.axis]
        low, high = float(places[0]), float(places[-1])
        lowest = 2 if is_straightness(name) else 1
        highest = min(3, rich.n_functions - 1)
        bases = [
            BasisSpec("polynomial", rich.axis, degree=degree, low_mm=low, high_mm=high)
            for degree in range(min(lowest, highest), highest + 1)
        ]
        return [*bases, *(self._spline(rich.axis, count) for count in range(5, rich.n_functions)), rich]

    def _spline(self, axis: str, count: int) -> BasisSpec:
        if (axis, count) not in self._found:
            self._found[axis, count] = spline_over(axis, self._positions_mm[axis], count)
        return self._found[axis, count]

    def columns(self, name: str, spec: BasisSpec, places_mm: Numbers) -> Numbers:
        """Give the functions (n, k) of a basis at places, restricted to the gauge of a function of that name."""
        key = (is_straightness(name), len(places_mm), spec)
        if key not in self._columns:
            self._columns[key] = _gauged_columns(name, spec, places_mm)
        return self._columns[key]


def _elements(name: str, rich: BasisSpec, positions_mm: Numbers) -> list[BasisSpec]:
    """List two- and three-node elements, fewest nodes first; straightness has no line, so two nodes hold nothing."""
    least = 3 if is_straightness(name) else 2
    found = candidate_bases(rich.axis, positions_mm, most_functions=min(rich.n_functions, len(positions_mm)))
    return [spec for spec in found if spec.n_functions >= least] or [rich]


def _gauged_columns(name: str, spec: BasisSpec, places_mm: Numbers) -> Numbers:
    """Give the functions (n, k) at places, restricted to the gauge."""
    basis = basis_of(spec)
    functionals = [basis.value_row(basis.range[0])]
    if is_straightness(name):
        functionals.append(basis.slope_row())
    constraint = np.array(functionals)
    _, _, directions = np.linalg.svd(constraint)
    free = directions[len(functionals) :].T
    return np.asarray(basis.evaluate(places_mm) @ free)
