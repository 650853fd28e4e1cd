"""Values of joint and squareness channels along the axes, with their exact derivatives by all parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.model.arrays import Numbers
from geoerr.model.compile import core_part, slices_of, start_values
from geoerr.terms import JOINT_CHANNELS, SQUARENESS_CHANNELS, Part, Term


@dataclass(frozen=True)
class Rows:
    """Functionals of the parameters: their value (n,) now, and their derivative (n, m)."""

    value: Numbers
    by_parameter: Numbers

    def minus(self, value: Numbers, by_parameter: Numbers) -> Rows:
        """Subtract from both."""
        return Rows(self.value - value, self.by_parameter - by_parameter)


def tabular_terms(terms: Sequence[Term], constants: Mapping[str, float]) -> list[Term]:
    """Give the terms whose every part is a function of its joint's own position, or a constant squareness.

    Parameters
    ----------
    constants
        Conditions that stand still: name to value.
    """
    return [term for term in terms if all(_is_tabular(term, part, constants) for part in term.parts)]


def _is_tabular(term: Term, part: Part, constants: Mapping[str, float]) -> bool:
    parameters = {parameter.name for parameter in term.coefficients + term.inner}
    names = {name for name in part.names if name not in parameters and name not in constants}
    if part.channel in JOINT_CHANNELS:
        return names <= {part.channel[2].lower()}
    return part.channel in SQUARENESS_CHANNELS and not names


def functionals(
    terms: Sequence[Term],
    tabular: Sequence[Term],
    position_mm: Mapping[str, Numbers],
    constants: Mapping[str, float],
) -> tuple[dict[str, Rows], dict[str, Rows]]:
    """Give every joint channel along its own axis, and every squareness as one row, in the gauge of the terms.

    Parameters
    ----------
    terms
        Their parameters in the core's order are the columns: coefficients of all, then inner parameters of all.
    tabular
        Those of them that are summed.
    position_mm
        Axis to its positions (n,).
    constants
        Conditions that stand still: name to value.
    """
    coefficient_slices = slices_of([len(term.coefficients) for term in terms])
    inner_slices = slices_of([len(term.inner) for term in terms])
    first_inner = sum(len(term.coefficients) for term in terms)
    n_parameters = first_inner + sum(len(term.inner) for term in terms)
    joints: dict[str, Rows] = {}
    squareness: dict[str, Rows] = {}
    for term, coefficients, inner in zip(terms, coefficient_slices, inner_slices, strict=True):
        if term not in tabular:
            continue
        places = [*range(coefficients.start, coefficients.stop)]
        places += [first_inner + place for place in range(inner.start, inner.stop)]
        for part in term.parts:
            is_joint = part.channel in JOINT_CHANNELS
            axis = part.channel[2].lower()
            along_mm = position_mm[axis] if is_joint else np.zeros(1)
            own = _of_part(term, part, axis, along_mm, constants)
            by_parameter = np.zeros((len(own.value), n_parameters))
            by_parameter[:, places] = own.by_parameter
            found = joints if is_joint else squareness
            before = found.get(part.channel)
            rows = Rows(own.value, by_parameter)
            found[part.channel] = rows if before is None else before.minus(-rows.value, -rows.by_parameter)
    return joints, squareness


def _of_part(term: Term, part: Part, axis: str, along_mm: Numbers, constants: Mapping[str, float]) -> Rows:
    """Give a part along its own axis, by its term's own parameters."""
    theta, phi = start_values((term,))
    by_parameter = np.zeros((len(along_mm), len(theta) + len(phi)))
    _, factor, _, shape, coefficients, inner = core_part(term, part, (axis, *constants))
    if isinstance(shape, _core.Basis):
        functions = shape.evaluate(along_mm)
        by_parameter[:, coefficients] = factor * functions
        return Rows(factor * (functions @ theta), by_parameter)
    columns = np.array([along_mm, *(np.full(len(along_mm), value) for value in constants.values())])
    starts = np.arange(len(along_mm), dtype=np.int64)
    own_theta, own_phi = theta[coefficients], phi[inner]
    by_parameter[:, coefficients] = factor * shape.coefficient_columns(columns, own_phi, starts, None, 1)
    behind = [len(theta) + place for place in inner]
    by_parameter[:, behind] = factor * shape.inner_derivatives(columns, own_theta, own_phi, starts, None, 1)
    return Rows(factor * shape.evaluate(columns, own_theta, own_phi, starts, None, 1), by_parameter)
