r"""What the states' estimates say about shapes of temperature: normal equations, the search, what it passes over.

With θ_s the parameters of state s and V_s their covariance, which hold all that the measurements say,

    θ_s = θ_0 + Σ_j β_j T_s^{p_j} w_j,      minimise Σ_s (θ_s − ...)ᵀ V_s⁺ (θ_s − ...)

w_j the shapes (`shapes`). θ_0 is free and eliminated once; after that a set of shapes costs one small system, and the
best set is looked for step by step: the shape that gains most is added, those that became superfluous are dropped,
until no step lowers χ² + c · (number of shapes).

What is not taken is not nothing: it is passed over because it is small. Its coefficients are held to be normal, of
one size τ for the shapes of T (as displacement in the volume) and one for those of T² (as a part of what was found of
T). Of T, τ is the largest that what is left of the data does not contradict; of T², where few functions tell it and
the largest would be far off, τ² is the mean by the likelihood, sizes on a scale of logarithms alike before (empirical
Bayes over functions). Without it, intervals beyond the measured temperatures are too short by a third to a half.

| symbol | code | what |
|---|---|---|
| z = Uᵀ(θ/d) | `Space` | coordinates in which no covariance is singular |
| G, g | `gram`, `pull` | normal equations of β with θ_0 eliminated |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from geoerr.errors import GeometryError
from geoerr.fit.sightings import Numbers
from geoerr.states.functions import Estimate, Functions, without_rounding
from geoerr.states.shapes import Shape

# T is counted in hundreds of kelvins inside, so that T and T² are numbers of one size.
UNIT_K = 100.0
_RANK = 1e-9
# Trial sizes of what is passed over: nothing, and from a ten-thousandth to all of a millimetre in 100 K, or of what
# was found of T.
_TRIALS = (0.0, *np.geomspace(1e-4, 1.0, 17).tolist())
# The largest size whose −2 log likelihood is within this of the best is taken: 1.4 standard errors. Small things that
# the search has passed over look smaller than they are.
_BENEFIT_OF_DOUBT = 2.0


@dataclass(frozen=True, eq=False)
class Space:
    """Coordinates z = Uᵀ (θ / d) of what all states determine."""

    scale: Numbers
    directions: Numbers

    @classmethod
    def of(cls, functions: Functions, estimates: Sequence[Estimate]) -> Space:
        """Make it for some estimates.

        Raises
        ------
        GeometryError
            where they share no determined error.
        """
        total = np.sum([one.covariance for one in estimates], axis=0)
        std = without_rounding(np.sqrt(np.diag(total)), functions.places)
        if not std.any():
            raise GeometryError("no error is determined in all states\nhint: measure all axes at every temperature")
        scale = np.where(std > 0.0, std, 1.0)
        mask = (std > 0.0) / scale
        value, vector = np.linalg.eigh(total * mask[:, None] * mask)
        return cls(scale, np.ascontiguousarray(vector[:, value > _RANK * value[-1]]))

    def into(self, parameters: Numbers) -> Numbers:
        """Give z of parameters (m,) or (m, k)."""
        return np.asarray(self.directions.T @ (parameters.T / self.scale).T)

    @property
    def out(self) -> Numbers:
        """θ = (this) z."""
        return np.asarray(self.scale[:, None] * self.directions)


@dataclass(frozen=True, eq=False)
class System:
    """Normal equations of θ_0 (in z) and β (in hundreds of kelvins), and what eliminating θ_0 leaves."""

    n_states: int
    shapes: Numbers
    powers: Numbers
    own: Numbers
    mixed: Numbers
    full: Numbers
    right: Numbers
    right_shapes: Numbers
    gram: Numbers
    pull: Numbers
    chi_squared: float

    @classmethod
    def of(cls, space: Space, estimates: Sequence[Estimate], heat: Numbers, shapes: Sequence[Shape]) -> System:
        """Sum over the states; `heat` (n,) are their T in hundreds of kelvins."""
        r, n = space.directions.shape[1], len(shapes)
        along = space.into(np.column_stack([np.zeros((len(space.scale), 0)), *(one.parameters for one in shapes)]))
        powers = np.array([one.power for one in shapes], dtype=np.float64)
        own, mixed, full = np.zeros((r, r)), np.zeros((r, n)), np.zeros((n, n))
        right, right_shapes, total = np.zeros(r), np.zeros(n), 0.0
        for estimate, hot in zip(estimates, heat, strict=True):
            inward = space.directions.T / space.scale
            weight = np.linalg.inv(inward @ estimate.covariance @ inward.T)
            z = space.into(estimate.parameters)
            columns = along * hot**powers
            own += weight
            mixed += weight @ columns
            full += columns.T @ weight @ columns
            right += weight @ z
            right_shapes += columns.T @ (weight @ z)
            total += float(z @ weight @ z)
        solved = np.linalg.solve(own, np.column_stack([mixed, right]))
        gram, pull = full - mixed.T @ solved[:, :n], right_shapes - mixed.T @ solved[:, n]
        chi_squared = total - float(right @ solved[:, n])
        return cls(len(heat), along, powers, own, mixed, full, right, right_shapes, gram, pull, chi_squared)

    def solve(self, places: Sequence[int]) -> tuple[Numbers, Numbers]:
        """Give θ_0 and the coefficients of these shapes (r + k,), and their covariance."""
        index = np.array(places, dtype=np.int64)
        normal = np.block(
            [
                [self.own, self.mixed[:, index]],
                [self.mixed[:, index].T, self.full[np.ix_(index, index)]],
            ]
        )
        size = np.sqrt(np.diag(normal))
        covariance = linalg.inv(normal / np.outer(size, size)) / np.outer(size, size)
        return covariance @ np.r_[self.right, self.right_shapes[index]], covariance

    def taken_for(self, places: Sequence[int], others: Sequence[int], covariance: Numbers) -> Numbers:
        """Give what a unit of each other shape adds to the solution for these places, (r + k, n)."""
        chosen, passed = np.array(places, dtype=np.int64), np.array(others, dtype=np.int64)
        return covariance @ np.vstack([self.mixed[:, passed], self.full[np.ix_(chosen, passed)]])

    def gain(self, places: Sequence[int]) -> float:
        """Give how much χ² these shapes explain together; −inf where the data cannot tell them apart."""
        if not places:
            return 0.0
        index = np.array(places)
        gram = self.gram[np.ix_(index, index)]
        size = np.sqrt(np.maximum(np.diag(gram), 0.0))
        if not (size > 0.0).all():
            return -math.inf
        value, vector = np.linalg.eigh(gram / np.outer(size, size))
        if value[0] < _RANK:
            return -math.inf
        along = vector.T @ (self.pull[index] / size)
        return float((along**2 / value).sum())


def search(system: System, shapes: Sequence[Shape], penalty: float) -> list[int]:
    """Give the places of the shapes that are worth their penalty."""
    place_of = {shape.key: place for place, shape in enumerate(shapes)}
    needs = [[place_of[key] for key in shape.needs if key in place_of] for shape in shapes]
    chosen: list[int] = []
    score = 0.0
    while True:
        steps = [sorted({*chosen, *_with_needs(place, needs)}) for place in range(len(shapes)) if place not in chosen]
        steps += [
            [one for one in chosen if one != place]
            for place in chosen
            if not any(place in needs[other] for other in chosen)
        ]
        best, best_score = None, score + 1e-9
        for step in steps:
            gained = system.gain(step) - penalty * len(step)
            if gained > best_score:
                best, best_score = step, gained
        if best is None:
            return chosen
        chosen, score = best, best_score


def _with_needs(place: int, needs: Sequence[Sequence[int]]) -> set[int]:
    found = {place}
    for other in needs[place]:
        found |= _with_needs(other, needs)
    return found


def size_passed_over(system: System, chosen: Sequence[int], others: Sequence[int], unit: Numbers) -> Numbers:
    """Give the standard deviation (n,) that the coefficients of the other shapes may have.

    Parameters
    ----------
    unit : (n,)
        Coefficient of each that its size is counted in.
    """
    taken, passed = np.array(chosen, dtype=np.int64), np.array(others, dtype=np.int64)
    gram, pull = system.gram[np.ix_(passed, passed)], system.pull[passed]
    if len(taken):
        between = np.linalg.solve(system.gram[np.ix_(taken, taken)], system.gram[np.ix_(taken, passed)])
        gram = gram - system.gram[np.ix_(passed, taken)] @ between
        pull = pull - between.T @ system.pull[taken]
    gram, pull = unit[:, None] * gram * unit, unit * pull
    value, vector = np.linalg.eigh(gram)
    gram = (vector * np.maximum(value, 0.0)) @ vector.T
    is_square = system.powers[passed] == 2.0
    trials = [(one, two) for one in _TRIALS for two in (_TRIALS if is_square.any() else (0.0,))]
    log_likelihood = np.array([_log_likelihood(gram, pull, np.where(is_square, two, one)) for one, two in trials])
    tried, likelihood = np.array(trials), np.exp(log_likelihood - log_likelihood.max())
    linear = tried[log_likelihood >= log_likelihood.max() - 0.5 * _BENEFIT_OF_DOUBT, 0].max()
    square = np.sqrt(likelihood @ tried[:, 1] ** 2 / likelihood.sum())
    return np.asarray(unit * np.where(is_square, square, linear))


def _log_likelihood(gram: Numbers, pull: Numbers, size: Numbers) -> float:
    factor = linalg.cholesky(np.eye(len(size)) + size[:, None] * gram * size, lower=True)
    explained = linalg.solve_triangular(factor, size * pull, lower=True)
    return float(0.5 * explained @ explained - np.log(np.diag(factor)).sum())
