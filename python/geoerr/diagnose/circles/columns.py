"""What one unit of each coefficient of a cause does to the measured radius, row by row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr import _core
from geoerr.diagnose.circles.runs import UM_PER_MM, Runs
from geoerr.fit.given import with_terms
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s, variable_columns
from geoerr.model.compile import compile_terms, core_part
from geoerr.terms import Parameter, Part, Term


class Radii:
    """The circle's readout: channels and formulas to columns of the radius."""

    def __init__(self, runs: Runs) -> None:
        self.runs = runs
        self._channels: dict[str, Numbers] = {}
        self._formulas: dict[str, _Formulas] = {}

    def columns_um(self, term: Term, inner: Sequence[float]) -> Numbers:
        """Give µm of radius for a unit of each coefficient, (n, k), at these inner parameters."""
        key = f"{term.id} {[part.expression for part in term.parts]}"
        if key not in self._formulas:
            self._formulas[key] = _Formulas(self.runs, term)
        formulas = self._formulas[key]
        result = np.zeros((len(self.runs), len(term.coefficients)))
        for channel, factor, places, values in formulas.at(inner):
            result[:, places] += self.runs.averages_of(factor * self._channel(channel)[:, None] * values)
        return result

    def by_run(self, columns: Numbers) -> Numbers:
        """Give columns (n, k) for each run apart, (n, k·m)."""
        result = np.zeros((len(columns), columns.shape[1] * self.runs.n_runs))
        k = columns.shape[1]
        for number, own in enumerate(self.runs.slices):
            result[own, k * number : k * (number + 1)] = columns[own]
        return result

    def _channel(self, name: str) -> Numbers:
        """Give µm of radius for a unit on a channel at the members of the rows, (m,)."""
        if name not in self._channels and name == "rig-scale":
            # A bar whose length changes: the radius that it shows is in proportion.
            radius_mm = self.runs.radius_mm[self.runs.run]
            self._channels[name] = UM_PER_MM * np.repeat(radius_mm, self.runs.counts)
        if name not in self._channels:
            fitted = self.runs.fitted
            n = len(fitted.sightings)
            unit = Term(
                id="unit",
                title="",
                kind="effect",
                effect="unit",
                axis=None,
                covariate=None,
                parts=(Part(name, "u"),),
                coefficients=(Parameter("u", ""),),
                source="user",
            )
            problem = with_terms(fitted.machine, fitted, (unit,))
            design = problem.design(problem.start, np.ones(n), 0, n, fitted.threads)
            raw = design[:, 0].reshape(n, 3)[:, 0] / fitted.sightings.whitening[:, 0, 0]
            self._channels[name] = UM_PER_MM * raw[self.runs.members]
        return self._channels[name]


class _Formulas:
    """A term's formulas at the members of the runs' rows."""

    def __init__(self, runs: Runs, term: Term) -> None:
        fitted = runs.fitted
        compiled = compile_terms(fitted.machine, (term,))
        variables = variable_columns(fitted.sightings, compiled.variables)
        self.members = runs.members
        self.starts = fitted.sightings.sequences
        self.times = None
        if compiled.needs_order:
            self.variables, self.times = np.ascontiguousarray(variables), times_s(fitted.sightings)
        else:
            self.variables = np.ascontiguousarray(variables[:, runs.members])
            self.starts = np.zeros(0, dtype=np.int64)
        self.parts: list[tuple[str, float, _core.Expression, list[int], list[int]]] = []
        for part in term.parts:
            channel, factor, _, shape, coefficients, inner = core_part(term, part, compiled.variables)
            assert isinstance(shape, _core.Expression)
            self.parts.append((channel, factor, shape, coefficients, inner))

    def at(self, inner: Sequence[float]) -> list[tuple[str, float, list[int], Numbers]]:
        """Give channel, factor, places of the coefficients and values (n, k) of each part."""
        found = []
        for channel, factor, shape, coefficients, places in self.parts:
            own = np.array([inner[place] for place in places], dtype=np.float64)
            values = shape.coefficient_columns(self.variables, own, self.starts, self.times, 1)
            if self.times is not None:
                values = values[self.members]
            found.append((channel, factor, coefficients, np.nan_to_num(values, posinf=0.0, neginf=0.0)))
        return found
