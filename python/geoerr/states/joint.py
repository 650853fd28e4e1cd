r"""How the errors follow temperature: one function of T for each error, found from the states' estimates alone.

Prediction at a temperature, with an uncertainty that counts the noise, the choice (what was passed over because it is
small may be there: `evidence`), and, where the states show more than the shapes can follow, that (Birge's ratio).

Source: generalised least squares of summary statistics (meta-regression); the criterion is Akaike's with a penalty
for having searched (Foster and George 1994, risk inflation), here Bonferroni's. Verified: tests/states, against a fit
of all observations at once and by what is found in noise, and validation/hot_and_cold.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.distributions import chi_squared_isf
from geoerr.error_functions import ErrorFunctions, is_angular
from geoerr.fit.sightings import Numbers
from geoerr.states.chance import Test, tail
from geoerr.states.evidence import UNIT_K, Space, System, search, size_passed_over
from geoerr.states.functions import Estimate, Functions
from geoerr.states.shapes import Shape, shapes_of

# How often something is found where nothing follows temperature.
_FALSE_ALARMS = 0.05
# Less probable than this, what the model misses is not chance, and its uncertainties are scaled (Birge).
_SIGNIFICANCE = 0.01


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
    scale
        What uncertainties were multiplied by because of that, 1 where it is chance.
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

    @property
    def std_of_choice(self) -> Numbers:
        """Standard deviation (k,) that shapes which were not taken, and may be there, add to each coefficient."""
        return np.asarray(np.linalg.norm(self.taken_for[self.basis.shape[1] :], axis=1))

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
        covariance = by @ self.covariance @ by.T
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
        or more, for two cannot tell it from T.

    Raises
    ------
    GeometryError
        where the states share no determined error.
    """
    temperatures = sorted(estimates)
    space = Space.of(functions, [estimates[one] for one in temperatures])
    candidates = shapes_of(functions, with_squares=len(temperatures) >= 3)
    if shapes is not None:
        candidates = tuple(shape for shape in candidates if shape.key in set(shapes))
    if len(temperatures) < 2:
        candidates = ()
    heat = (np.array(temperatures) - reference_degc) / UNIT_K
    system = System.of(space, [estimates[one] for one in temperatures], heat, candidates)
    chosen = search(system, candidates, price_of(candidates)) if shapes is None else list(range(len(candidates)))
    return _fitted(functions, space, system, candidates, chosen, temperatures, reference_degc, estimates)


def price_of(shapes: Sequence[Shape]) -> float:
    """Give what a shape has to gain in χ² to be taken, for so many are looked at.

    Where nothing follows temperature the search begins with a shape that needs no other, one of each error: the best
    of these is beyond the price in one of twenty searches (Bonferroni), as the table of differences judges its 21
    functions. Shapes that need another pay for both, or are looked at beside what was found.
    """
    beginnings = sum(not shape.needs for shape in shapes)
    return float(chi_squared_isf(_FALSE_ALARMS / max(beginnings, 1), 1))


def _fitted(
    functions: Functions,
    space: Space,
    system: System,
    shapes: Sequence[Shape],
    chosen: Sequence[int],
    temperatures: Sequence[float],
    reference_degc: float,
    estimates: Mapping[float, Estimate],
) -> TemperatureFit:
    found, covariance = system.solve(chosen)
    others = [place for place in range(len(shapes)) if place not in chosen]
    passed = np.zeros(0)
    if others:
        taken = {
            shapes[place].key: abs(float(value))
            for place, value in zip(chosen, found[len(system.right) :], strict=True)
        }
        units = np.array([_unit(functions, shapes[one], taken) for one in others])
        passed = size_passed_over(system, chosen, others, units)
    index = np.array(chosen, dtype=np.int64)
    r = len(system.right)
    rank = (system.n_states - 1) * r - len(index)
    dof = min(estimate.dof for estimate in estimates.values())
    misfit = tail(max(system.chi_squared - system.gain(list(chosen)), 0.0), rank, dof)
    scale = math.sqrt(misfit.chi_squared / rank) if misfit.p_value < _SIGNIFICANCE else 1.0
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
    )


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
