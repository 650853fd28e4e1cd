r"""How the errors follow temperature: one function of T for each error, found from the states' estimates alone.

Prediction at a temperature, with an uncertainty that counts the noise, the choice (what was passed over because it is
small may be there: `evidence`), and, where the states show more than the shapes can follow, that: as a variance of
the functions that break the law (`law`), and what no single function shows by Birge's ratio.

Source: generalised least squares of summary statistics (meta-regression); the criterion is Akaike's with a penalty
for having searched (Foster and George 1994, risk inflation), here Bonferroni's. Verified: tests/states, against a fit
of all observations at once and by what is found in noise, and validation/hot_and_cold.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from geoerr.distributions import chi_squared_isf
from geoerr.error_functions import ErrorFunctions, is_angular
from geoerr.fit.sightings import Numbers
from geoerr.states.chance import Test, holm, tail
from geoerr.states.evidence import UNIT_K, Space, System, search, size_passed_over
from geoerr.states.functions import Estimate, Functions
from geoerr.states.law import beyond_the_law, own_variance, tests_by_function
from geoerr.states.shapes import Shape, shapes_of

# How often something is found where nothing follows temperature.
_FALSE_ALARMS = 0.05
# Less probable than this, what the model misses is not chance, and its uncertainties are scaled (Birge).
_SIGNIFICANCE = 0.01
# Standard deviation of T² as a share of T at 100 K, where two states cannot tell it: chosen, not measured. A fifth
# off proportion is within one, a third within two.
_SQUARE = 0.2
# How often the variance of functions that break the law is found anew.
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class TemperatureFit:
    """Errors as functions of temperature, with covariance.

    Attributes
    ----------
    functions
        What it is made of.
    reference_degc
        Where T = 0.
    temperatures_degc
        Of the states that it was found from.
    shapes
        What follows temperature, chosen by evidence.
    coefficients : (k,)
        Of these, in mm and rad per K or K².
    misfit
        What the states show beyond the model; all states follow it where its p-value is large.
    astray
        Functions that break the law, worst first, to the probability that chance does as much (Holm); where there are
        some, `misfit` is that of the model that takes them to follow it.
    misfit_covariance : (m + k, m + k)
        What that adds to the covariance of the parameters at a temperature that was not measured, and of the
        coefficients.
    scale
        What uncertainties were multiplied by because of what is left even so, 1 where it is chance.
    dof
        Degrees of freedom of the noise's scale; infinite where that is stated.
    passed_over
        Shapes that were not taken.
    passed_size : (n,)
        Standard deviation that their coefficients may have.
    """

    functions: Functions
    reference_degc: float
    temperatures_degc: tuple[float, ...]
    shapes: tuple[Shape, ...]
    at_reference: Numbers
    coefficients: Numbers
    misfit: Test
    scale: float
    dof: float
    covariance: Numbers
    basis: Numbers
    passed_over: tuple[Shape, ...]
    passed_size: Numbers
    taken_for: Numbers
    astray: Mapping[str, float]
    misfit_covariance: Numbers
    beside_law: Numbers

    @property
    def std_of_choice(self) -> Numbers:
        """Standard deviation (k,) that shapes which were not taken, and may be there, add to each coefficient.

        Of two states coefficients are what the law in proportion has, which is assumed.
        """
        is_told = [len(self.temperatures_degc) > 2 or shape.power == 1 for shape in self.passed_over]
        return np.asarray(np.linalg.norm(self.taken_for[self.basis.shape[1] :, is_told], axis=1))

    def at(self, temperature_degc: float) -> Estimate:
        """Predict the parameters at a temperature."""
        heat = temperature_degc - self.reference_degc
        powers = [heat**shape.power for shape in self.shapes]
        parameters = self.at_reference + sum(
            (
                power * value * shape.parameters
                for power, value, shape in zip(powers, self.coefficients, self.shapes, strict=True)
            ),
            start=np.zeros_like(self.at_reference),
        )
        moves = [power * shape.parameters for power, shape in zip(powers, self.shapes, strict=True)]
        by = np.column_stack([self.basis, *moves])
        covariance = by @ self.covariance @ by.T + self.beside_law
        if self.passed_over:
            missed = np.column_stack(
                [
                    heat**shape.power * size * shape.parameters
                    for shape, size in zip(self.passed_over, self.passed_size, strict=True)
                ]
            )
            missed = missed - by @ self.taken_for
            covariance = covariance + missed @ missed.T
        return Estimate(parameters, covariance, self.dof)

    def errors(self, temperature_degc: float) -> ErrorFunctions:
        """Give the 21 errors at a temperature, with standard uncertainties."""
        note = f"predicted at {temperature_degc:g} °C from {', '.join(f'{t:g}' for t in self.temperatures_degc)} °C"
        return self.functions.tables(self.at(temperature_degc), "temperature", (note,))

    def is_extrapolation(self, temperature_degc: float) -> bool:
        """Tell whether a temperature lies outside those of the states."""
        return not min(self.temperatures_degc) <= temperature_degc <= max(self.temperatures_degc)


def fit_temperature(
    functions: Functions,
    estimates: Mapping[float, Estimate],
    reference_degc: float,
    *,
    shapes: Sequence[tuple[str, int, int]] | None = None,
    may_be_square: bool = True,
) -> TemperatureFit:
    """Find how errors follow temperature.

    Parameters
    ----------
    estimates
        Temperature, °C, to the state's parameters. One state gives a model that follows nothing.
    reference_degc
        Where T = 0.
    shapes
        Keys (name, order, power) of the shapes to take; None lets the evidence choose. Of T² only with three states
        or more: two cannot tell it from T, and what follows T is held to do so in proportion to a fifth (`_SQUARE`).
    may_be_square
        Whether two states' uncertainties count that; not where the law in proportion is what is tested.

    Raises
    ------
    GeometryError
        where the states share no determined error.
    """
    temperatures = sorted(estimates)
    own = [estimates[one] for one in temperatures]
    candidates = shapes_of(functions, with_squares=len(temperatures) > 2 or may_be_square)
    if shapes is not None:
        candidates = tuple(shape for shape in candidates if shape.key in set(shapes))
    if len(temperatures) < 2:
        candidates = ()
    heat = (np.array(temperatures) - reference_degc) / UNIT_K
    law = _Law(functions, Space.of(functions, own), own, heat, candidates, is_given=shapes is not None)
    first = law.solved(np.zeros_like(own[0].covariance))
    found, astray, beside = first, dict[str, float](), np.zeros_like(own[0].covariance)
    # One after the other: what one function breaks leaks into those that its estimate hangs together with.
    while len(astray) < len(functions.names):
        name, p_value = found.most_astray(astray)
        if p_value >= _SIGNIFICANCE:
            break
        astray[name] = p_value
        # What was spread over others while this one was taken to follow the law comes back to it.
        for _ in range(_ROUNDS):
            powers = {one: len({shape.power for shape in found.shapes if shape.name == one}) for one in astray}
            beside = own_variance(functions, law.space, powers, found.left)
            found = law.solved(beside)
    return _fitted(law, found, first, astray, beside, temperatures, reference_degc)


@dataclass(frozen=True, eq=False)
class _Solved:
    """One choice of shapes with its solution; see `law`."""

    system: System
    chosen: list[int]
    shapes: tuple[Shape, ...]
    values: Numbers
    covariance: Numbers
    moves: list[Numbers]
    left: Numbers
    tests: Mapping[str, Test]

    def most_astray(self, known: Mapping[str, float]) -> tuple[str, float]:
        """Give the function that breaks the law most clearly beside those that are known, and its p-value."""
        corrected = dict(zip(self.tests, holm([one.p_value for one in self.tests.values()]), strict=True))
        others = {name: p_value for name, p_value in corrected.items() if name not in known}
        return min(others.items(), key=lambda item: (item[1], -self.tests[item[0]].chi_squared))


@dataclass(frozen=True, eq=False)
class _Law:
    """What is looked for: candidates, in estimates at temperatures, (n,) in hundreds of kelvins."""

    functions: Functions
    space: Space
    estimates: Sequence[Estimate]
    heat: Numbers
    candidates: Sequence[Shape]
    is_given: bool

    def solved(self, beside: Numbers) -> _Solved:
        """Choose and solve, each state off beside the law by a variance (m, m)."""
        wider = [replace(one, covariance=one.covariance + beside) for one in self.estimates]
        system = System.of(self.space, wider, self.heat, self.candidates)
        chosen = list(range(len(self.candidates)))
        if not self.is_given:
            linear = [one for one in self.candidates if one.power == 1]
            told = self.candidates if len(self.heat) > 2 else linear
            chosen = search(system, told, price_of(told))
        shapes = tuple(self.candidates[place] for place in chosen)
        values, covariance = system.solve(chosen)
        moves = [
            np.column_stack([self.space.out, *(hot**one.power * one.parameters for one in shapes)])
            for hot in self.heat
        ]
        left = beyond_the_law(self.space, wider, moves, values)
        tests = tests_by_function(self.functions, wider, moves, covariance, left)
        return _Solved(system, chosen, shapes, values, covariance, moves, left, tests)

    def without(self, solved: _Solved) -> Numbers:
        """Give the covariance that the same solution had if all states followed the law."""
        return System.of(self.space, self.estimates, self.heat, self.candidates).solve(solved.chosen)[1]


def price_of(shapes: Sequence[Shape]) -> float:
    """Give what a shape has to gain in χ² to be taken, for so many are looked at.

    Where nothing follows temperature the search begins with a shape that needs no other, one of each error: the best
    of these is beyond the price in one of twenty searches (Bonferroni), as the table of differences judges its 21
    functions. Shapes that need another pay for both, or are looked at beside what was found.
    """
    beginnings = sum(not shape.needs for shape in shapes)
    return float(chi_squared_isf(_FALSE_ALARMS / max(beginnings, 1), 1))


def _fitted(
    law: _Law,
    solved: _Solved,
    first: _Solved,
    astray: Mapping[str, float],
    beside: Numbers,
    temperatures: Sequence[float],
    reference_degc: float,
) -> TemperatureFit:
    functions, shapes, system, chosen = law.functions, law.candidates, solved.system, solved.chosen
    space, found, covariance = law.space, solved.values, solved.covariance
    others = [place for place in range(len(shapes)) if place not in chosen]
    passed = np.zeros(0)
    if others:
        taken = {
            shapes[place].key: abs(float(value))
            for place, value in zip(chosen, found[len(system.right) :], strict=True)
        }
        units = np.array([_unit(functions, shapes[one], taken) for one in others])
        is_told = np.array([system.n_states > 2 or shapes[one].power == 1 for one in others])
        told = [one for one, own in zip(others, is_told, strict=True) if own]
        passed = _SQUARE * units
        if told:
            passed[is_told] = size_passed_over(system, chosen, told, units[is_told])
    index = np.array(chosen, dtype=np.int64)
    r = len(system.right)
    dof = min(estimate.dof for estimate in law.estimates)
    misfit, rest = _misfit(first, dof), _misfit(solved, dof)
    scale = math.sqrt(rest.chi_squared / rest.rank) if rest.p_value < _SIGNIFICANCE else 1.0
    # From hundreds of kelvins to kelvins.
    units = np.r_[np.ones(r), UNIT_K ** -system.powers[index]]
    return TemperatureFit(
        functions=functions,
        reference_degc=reference_degc,
        temperatures_degc=tuple(temperatures),
        shapes=tuple(shapes[place] for place in chosen),
        at_reference=space.out @ found[:r],
        coefficients=found[r:] * units[r:],
        misfit=misfit,
        scale=scale,
        dof=dof,
        covariance=scale**2 * covariance * np.outer(units, units),
        basis=space.out,
        passed_over=tuple(shapes[place] for place in others),
        passed_size=passed * UNIT_K ** -system.powers[np.array(others, dtype=np.int64)],
        taken_for=units[:, None] * system.taken_for(chosen, others, covariance) * passed,
        astray=dict(astray),
        misfit_covariance=_of_misfit(law, solved, beside, units) if astray else np.zeros((0, 0)),
        beside_law=beside,
    )


def _misfit(solved: _Solved, dof: float) -> Test:
    """Test what all states show beyond the law."""
    system, chosen = solved.system, solved.chosen
    rank = (system.n_states - 1) * len(system.right) - len(chosen)
    return tail(max(system.chi_squared - system.gain(chosen), 0.0), rank, dof)


def _of_misfit(law: _Law, solved: _Solved, beside: Numbers, units: Numbers) -> Numbers:
    """Give what functions that break the law add to the covariance of parameters and coefficients (m + k, m + k)."""
    k = len(solved.chosen)
    out = linalg.block_diag(law.space.out, np.eye(k)) * units
    more = out @ (solved.covariance - law.without(solved)) @ out.T
    more[: len(beside), : len(beside)] += beside
    std = np.sqrt(np.maximum(np.diag(more), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    value, vector = np.linalg.eigh(more / np.outer(scale, scale))
    # Rounding of a difference may be of either sign.
    root = scale[:, None] * vector * np.sqrt(np.maximum(value, 0.0))
    return np.asarray(root @ root.T)


def _unit(functions: Functions, shape: Shape, taken: Mapping[tuple[str, int, int], float]) -> float:
    """Give the coefficient that sizes are counted in.

    Of T the one with which the shape moves some point by a millimetre in 100 K. Of T² what was found of T: an error
    that follows temperature may do so not quite in proportion; one that does not has no T² either.
    """
    if shape.power == 2:
        return taken.get((shape.name, shape.order, 1), 0.0)
    reach = float(np.abs(functions.rows[shape.name] @ shape.parameters).max())
    if is_angular(shape.name):
        reach *= float(np.mean([high - low for low, high in functions.range_mm.values()]))
    return 1.0 / reach if reach > 0.0 else 0.0
