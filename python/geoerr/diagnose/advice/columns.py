"""What terms do to rows, whether measured or planned: whitened columns from the core."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr import _core
from geoerr.diagnose.gaps import read_columns
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.start import KINDS
from geoerr.fit.variables import times_s
from geoerr.machine import Machine
from geoerr.model.compile import Compiled, compile_terms, start_values
from geoerr.terms import CLOCK_NAME, SESSION_NAME, Term


@dataclass(frozen=True, eq=False)
class Poses:
    """How each session's device stands.

    Attributes
    ----------
    kinds : (s,) uint8
        `KINDS`.
    rotations : (s, 3, 3), translations_mm : (s, 3)
        measured_from_base; of a circle its centre.
    excess_mm : (s,)
        What a circular device adds to every radius.
    """

    kinds: np.ndarray
    rotations: Numbers
    translations_mm: Numbers
    excess_mm: Numbers


def poses_of(fitted: Fitted) -> Poses:
    """Give the poses that a fit found."""
    state = fitted.solved.state
    kinds = np.array([KINDS[kind] for kind in fitted.sightings.frames], dtype=np.uint8)
    return Poses(kinds, state.rotations, state.translations_mm, state.excess_mm)


class Terms:
    """Terms compiled once, for columns on any rows.

    Attributes
    ----------
    n_columns
        Coefficients of all terms, and behind them the inner parameters that are free.
    """

    def __init__(self, machine: Machine, terms: Sequence[Term], *, with_inner: bool) -> None:
        self.terms = tuple(terms)
        self.compiled: Compiled = compile_terms(machine, self.terms)
        self.coefficients, self.inner = start_values(self.terms)
        parameters = [parameter for term in self.terms for parameter in term.inner]
        self.free = [n for n, parameter in enumerate(parameters) if with_inner and not parameter.is_fixed]
        self.n_columns = self.compiled.n_coefficients + len(self.free)

    def columns(
        self,
        sightings: Sightings,
        poses: Poses,
        *,
        scale: Numbers | None = None,
        shared: Numbers | None = None,
        clock_from_s: float = 0.0,
        as_in_session: int | None = None,
        threads: int = 1,
    ) -> Numbers:
        """Give the whitened columns (n, 3, n_columns + frames + shared).

        Where some term's covariate is unknown all terms have 0: they are compared on the rows that they share.

        Parameters
        ----------
        clock_from_s
            When these rows begin on the clock of all sessions.
        as_in_session
            What changes from session to session is as in that one in all rows; None where each has its own.
        """
        variables = read_columns(sightings, self.compiled.variables)
        if CLOCK_NAME in self.compiled.variables:
            variables[self.compiled.variables.index(CLOCK_NAME)] += clock_from_s
        if as_in_session is not None and SESSION_NAME in self.compiled.variables:
            variables[self.compiled.variables.index(SESSION_NAME)] = as_in_session
        known = np.isfinite(variables)
        n = len(sightings)
        problem = _core.FitProblem(
            self.compiled.core,
            sightings.carrier,
            np.ascontiguousarray(sightings.commanded_mm),
            np.ascontiguousarray(sightings.offset_mm),
            np.ascontiguousarray(np.nan_to_num(variables)),
            sightings.sequences,
            times_s(sightings) if self.compiled.needs_order else None,
            np.ascontiguousarray(sightings.measured_mm),
            np.ascontiguousarray(sightings.whitening),
            sightings.session,
            (
                poses.kinds,
                np.ascontiguousarray(poses.rotations),
                np.ascontiguousarray(poses.translations_mm),
                poses.excess_mm,
                _pivots(sightings, len(poses.kinds)),
            ),
            self.coefficients,
            self.inner,
            self.free,
            shared,
            length=sightings.length,
        )
        scale = np.ones(n) if scale is None else scale
        design = problem.design(problem.start, scale, 0, n, threads)
        result = design.reshape(n, 3, design.shape[1])
        if not known.all():
            result[~known.all(axis=0), :, : self.n_columns] = 0.0
        return result


def _pivots(sightings: Sightings, n_sessions: int) -> Numbers:
    """Give the middle of each session's commanded positions, (s, 3)."""
    count = np.maximum(np.bincount(sightings.session, minlength=n_sessions), 1)
    return np.column_stack(
        [np.bincount(sightings.session, sightings.commanded_mm[:, c], n_sessions) / count for c in range(3)]
    )
