"""Where inner parameters (periods, lags, decays, places) start: the value that explains most of what is left.

The fit so far is projected out once; every trial value then costs one product. Gauss-Newton goes on from the best.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr import _core
from geoerr.fit.fitted import Fitted
from geoerr.fit.held_out import projected_rows
from geoerr.fit.sightings import Numbers
from geoerr.fit.start import KINDS
from geoerr.fit.variables import times_s, variable_columns
from geoerr.model.compile import compile_terms
from geoerr.terms import Parameter, Term

# Trial values of one inner parameter; of several, each has fewer.
_TRIALS = {1: 48, 2: 16, 3: 8}
# Columns whose part beyond the fit is below this share of them are inside it already.
_INSIDE = 1e-6


def has_unknown_inner(term: Term) -> bool:
    """Tell whether a term has an inner parameter without a value."""
    return any(np.isnan(parameter.value) for parameter in term.inner)


def started(fitted: Fitted, term: Term, *, threads: int = 0) -> Term:
    """Give the term with inner parameters at the trial values that explain most of the fit's residual."""
    sightings, solved = fitted.sightings, fitted.solved
    scale = solved.used.astype(np.float64)
    spread = projected_rows(fitted.problem, solved.state, solved.solution.covariance_root, scale, threads)
    spread = spread.reshape(3 * len(sightings), -1)
    residual = (solved.whitened * scale[:, None]).ravel()
    columns_at = _Columns(fitted, term, threads)
    best, best_gain = None, -np.inf
    for trial in itertools.product(*(_trials(p, len(term.inner)) for p in term.inner)):
        columns = columns_at(trial)
        beyond = columns - spread @ (spread.T @ columns)
        gain = _gain(columns, beyond, residual)
        if gain > best_gain:
            best, best_gain = trial, gain
    assert best is not None
    return replace(term, inner=tuple(replace(p, value=v) for p, v in zip(term.inner, best, strict=True)))


def _gain(columns: Numbers, beyond: Numbers, residual: Numbers) -> float:
    """Give the fall of the sum of squares on adding the columns."""
    gram = beyond.T @ beyond
    size = np.maximum((columns**2).sum(axis=0), 1e-300)
    value, vector = np.linalg.eigh(gram / np.sqrt(np.outer(size, size)))
    along = vector.T @ ((beyond.T @ residual) / np.sqrt(size))
    keep = value > _INSIDE
    return float((along[keep] ** 2 / value[keep]).sum())


def _trials(parameter: Parameter, n_parameters: int) -> Sequence[float]:
    if not np.isnan(parameter.value):
        return [parameter.value]
    assert parameter.low is not None
    assert parameter.high is not None
    count = _TRIALS.get(n_parameters, 5)
    space = np.geomspace if parameter.spacing == "log" else np.linspace
    # The ends of a range are its least likely values.
    edges = space(parameter.low, parameter.high, count + 1)
    middle = np.sqrt(edges[1:] * edges[:-1]) if parameter.spacing == "log" else 0.5 * (edges[1:] + edges[:-1])
    return [float(value) for value in middle]


class _Columns:
    """Whitened columns of one term at trial values of its inner parameters."""

    def __init__(self, fitted: Fitted, term: Term, threads: int) -> None:
        self.fitted, self.term, self.threads = fitted, term, threads
        self.compiled = compile_terms(fitted.machine, (term,))
        variables = variable_columns(fitted.sightings, self.compiled.variables)
        self.known = np.isfinite(variables).all(axis=0)
        self.variables = np.ascontiguousarray(np.nan_to_num(variables))
        self.scale = (self.known & fitted.solved.used).astype(np.float64)

    def __call__(self, inner: Sequence[float]) -> Numbers:
        sightings, state = self.fitted.sightings, self.fitted.solved.state
        kinds = np.array([KINDS[kind] for kind in sightings.frames], dtype=np.uint8)
        pivots = np.zeros((len(sightings.sessions), 3))
        problem = _core.FitProblem(
            self.compiled.core,
            sightings.carrier,
            np.ascontiguousarray(sightings.commanded_mm),
            np.ascontiguousarray(sightings.offset_mm),
            self.variables,
            sightings.starts,
            times_s(sightings) if self.compiled.needs_order else None,
            np.ascontiguousarray(sightings.measured_mm),
            np.ascontiguousarray(sightings.whitening),
            sightings.session,
            (kinds, state.rotations, state.translations_mm, state.excess_mm, pivots),
            np.zeros(self.compiled.n_coefficients),
            np.asarray(inner, dtype=np.float64),
            [],
            None,
        )
        design = problem.design(problem.start, self.scale, 0, len(sightings), self.threads)
        return np.asarray(design[:, : self.compiled.n_coefficients])
