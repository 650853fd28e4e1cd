"""Terms to the core: the one place where bases and formulas as data become bases and formulas that compute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from geoerr import _core
from geoerr.bases import basis_of
from geoerr.errors import ExpressionError, GeometryError, ShapeError
from geoerr.machine import AXES, Machine
from geoerr.model.arrays import Numbers
from geoerr.terms import Part, Term

# Stands in the list of variables for one that a formula does not use: no name, so that no formula means it.
_UNUSED = "-"


@dataclass(frozen=True, eq=False)
class Compiled:
    """Terms as the core computes them.

    Attributes
    ----------
    core
        The machine with its terms; coefficients of all terms stand one after the other, so do inner parameters.
    variables
        Raw variables and covariates of all formulas: the order of the core's `variables` (k, n).
    coefficient_slices, inner_slices
        For each term its place among the coefficients, and among the inner parameters.
    needs_order
        Whether some formula is a recursion along rows (`lag`, `windup`), so that their order counts.
    """

    core: _core.VolumetricModel
    variables: tuple[str, ...]
    coefficient_slices: tuple[slice, ...]
    inner_slices: tuple[slice, ...]
    needs_order: bool

    @property
    def n_coefficients(self) -> int:
        """Number of coefficients of all terms."""
        return self.coefficient_slices[-1].stop if self.coefficient_slices else 0

    @property
    def n_inner(self) -> int:
        """Number of inner parameters of all terms."""
        return self.inner_slices[-1].stop if self.inner_slices else 0


def compile_terms(machine: Machine, terms: Sequence[Term]) -> Compiled:
    """Compile terms for a machine.

    Raises
    ------
    ShapeError
        where two terms have one id, naming it.
    ExpressionError
        where a formula cannot be read, naming the term and marking the place.
    GeometryError, ShapeError
        where a basis cannot be made, naming the term.
    """
    ids = [term.id for term in terms]
    twice = next((name for name in ids if ids.count(name) > 1), None)
    if twice is not None:
        raise ShapeError(f"the model has two terms {twice}\nhint: take one of them out with without({twice!r})")
    variables = tuple(
        dict.fromkeys(
            name
            for term in terms
            for part in term.parts
            if part.expression is not None
            for name in part.names
            if not _is_parameter(term, name)
        )
    )
    parts = [[core_part(term, part, variables) for part in term.parts] for term in terms]
    counts = [(len(term.coefficients), len(term.inner)) for term in terms]
    core_terms = [(*count, own) for count, own in zip(counts, parts, strict=True)]
    return Compiled(
        core=_core.VolumetricModel(machine.chain, machine.tool_offset_mm, core_terms),
        variables=variables,
        coefficient_slices=slices_of([coefficients for coefficients, _ in counts]),
        inner_slices=slices_of([inner for _, inner in counts]),
        needs_order=any(
            isinstance(part[3], _core.Expression) and part[3].needs_order for own in parts for part in own
        ),
    )


def start_values(terms: Sequence[Term]) -> tuple[Numbers, Numbers]:
    """Give coefficients and inner parameters of all terms in the core's order, as a fit starts from them.

    A coefficient that is not known is 0, an inner parameter the middle of its range, in its own spacing.
    """
    coefficients = [0.0 if np.isnan(p.value) else p.value for term in terms for p in term.coefficients]
    inner = [p.middle for term in terms for p in term.inner]
    return np.array(coefficients, dtype=np.float64), np.array(inner, dtype=np.float64)


CorePart: TypeAlias = tuple[str, float, int, _core.Basis | _core.Expression, list[int], list[int]]


def core_part(term: Term, part: Part, variables: Sequence[str]) -> CorePart:
    """Compile one part: channel, factor, axis of a basis (else -1), shape, places of coefficients and inner ones.

    Parameters
    ----------
    term, part
        The part and the term whose parameters it uses.
    variables
        The formula's variables will be in this order; those that it does not use may be among them.
    """
    try:
        if part.basis is not None:
            places = list(range(len(term.coefficients)))
            return part.channel, part.factor, AXES.index(part.basis.axis), basis_of(part.basis), places, []
        used = set(part.names)
        coefficients = [place for place, p in enumerate(term.coefficients) if p.name in used]
        inner = [place for place, p in enumerate(term.inner) if p.name in used]
        expression = _core.Expression(
            part.expression or "",
            [name if name in used and not _is_parameter(term, name) else _UNUSED for name in variables],
            [term.coefficients[place].name for place in coefficients],
            [term.inner[place].name for place in inner],
            dict(part.definitions),
        )
    except ExpressionError as error:
        where = f"term {term.id}, on {part.channel}: {error}"
        raise ExpressionError(where, error.text, error.start, error.end) from error
    except (ShapeError, GeometryError) as error:
        raise type(error)(f"term {term.id}, on {part.channel}: {error}") from error
    return part.channel, part.factor, -1, expression, coefficients, inner


def _is_parameter(term: Term, name: str) -> bool:
    return any(parameter.name == name for parameter in term.coefficients + term.inner)


def slices_of(counts: Sequence[int]) -> tuple[slice, ...]:
    """Give the places of runs of these lengths, one after the other."""
    ends = np.cumsum(counts, dtype=np.int64).tolist()
    return tuple(slice(end - count, end) for count, end in zip(counts, ends, strict=True))
