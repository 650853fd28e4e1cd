"""How a predicted error follows the parameters, and the conditions that it is predicted for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.errors import GeoerrError
from geoerr.model import Model, compile_terms, start_values
from geoerr.model.arrays import Numbers, contiguous, offsets
from geoerr.model.conditions import Conditions, constants_of, variables_of
from geoerr.terms import Term

# Rows whose derivatives by some hundred parameters are held at a time: a few megabytes.
_BLOCK_ROWS = 1024


def owners_of(terms: Sequence[Term]) -> list[Term]:
    """Give the term of every parameter in the record's order: coefficients of all terms, then inner ones of all."""
    return [term for term in terms for _ in term.coefficients] + [term for term in terms for _ in term.inner]


class Predictor:
    """Predicts the error of the tool against the work, and its derivatives, for the terms that move a machine.

    Parameters
    ----------
    model
        A fitted model.
    offset_mm : (3,)
        From the machine's tool point to the point that is meant.
    at
        Conditions by name, one number each (or `reference`).
    """

    def __init__(self, model: Model, offset_mm: npt.ArrayLike | None, at: Conditions | None) -> None:
        self.model = model
        self.terms = model.machine_terms
        self.offset_mm = np.array(offsets(offset_mm, 1)[0])
        self.at = constants_of(model.machine, at)
        self.n_parameters = len(owners_of(model.terms))
        self.places = [place for place, term in enumerate(owners_of(model.terms)) if not term.is_rig]
        self._compiled = compile_terms(model.machine, self.terms)

    def error_mm(
        self, q_mm: Numbers, parameters: Numbers | None = None, *, at: Mapping[str, float] | None = None
    ) -> Numbers:
        """Give the error (n, 3) by the exact chain; with other parameters (m,) or other conditions, if given."""
        coefficients, inner = start_values(self.terms)
        if parameters is not None:
            own = parameters[self.places]
            coefficients, inner = contiguous(own[: len(coefficients)]), contiguous(own[len(coefficients) :])
        return self._compiled.core.displacements(*self._rows(q_mm, at), None, coefficients, inner, 0)

    def by_parameter(self, q_mm: Numbers) -> Numbers:
        """Differentiate the error by all parameters in the record's order, (n, 3, m): first order at each place."""
        values = start_values(self.terms)
        result = np.zeros((len(q_mm), 3, self.n_parameters))
        for first in range(0, len(q_mm), _BLOCK_ROWS):
            block = slice(first, first + _BLOCK_ROWS)
            rows = self._rows(q_mm[block], None)
            result[block, :, self.places] = self._compiled.core.columns(*rows, None, *values, 0)
        return result

    def by_condition(self, q_mm: Numbers, name: str, std: float) -> Numbers:
        """Give how far the error moves with one standard uncertainty of a condition, (n, 3): half of ± one."""
        if name not in self.at:
            given = ", ".join(self.at) or "none"
            raise GeoerrError(
                f"an uncertainty is stated for the condition {name}, and no value\nhint: given are {given}"
            )
        above, below = (self.error_mm(q_mm, at={name: self.at[name] + sign * std}) for sign in (1.0, -1.0))
        return np.asarray(0.5 * (above - below))

    def _rows(
        self, q_mm: Numbers, at: Mapping[str, float] | None
    ) -> tuple[npt.NDArray[np.uint8], Numbers, Numbers, Numbers, npt.NDArray[np.int64]]:
        rows = contiguous(q_mm)
        offset = contiguous(np.broadcast_to(self.offset_mm, rows.shape))
        conditions = {**self.at, **(at or {})}
        variables = variables_of(self._compiled.variables, self.model.machine, rows, offset, conditions)
        carriers = np.full(len(rows), _core.CARRIERS.index("relative"), dtype=np.uint8)
        return carriers, rows, offset, variables, np.arange(len(rows), dtype=np.int64)
