"""How much each component scatters about a fit, where nothing is stated: what stereo cameras see worse in depth.

Sessions of states are rarely run so that rows repeat each other, and neighbours along a pass cannot tell the noise of
components apart (`geoerr.fit.scatter`). What a fit leaves can: of a component along axis c of the measuring frame

    s_c² = Σ (r − mean of its pass and body)² / (n_c − Σ h − number of these means),

h the leverage of each number (Huber, Robust Statistics, 1981, §7.2, for unequal variances: MINQUE's first step). One
scale for three components that scatter by 3, 3 and 10 µm makes tests of functions alarm in two of five cases.

Verified: tests/states/test_weights.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from geoerr.fit import FitOptions, Fitted, fit_terms, sightings_of
from geoerr.fit.scatter import are_apart
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.machine import Machine
from geoerr.observations import Observations
from geoerr.states.blocks import blocks_of
from geoerr.terms import BasisSpec

# Of fewer degrees of freedom a session has the scatter of its whole table.
_LEAST_DOF = 30.0
_UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class Weights:
    """What rows of sessions that state no uncertainty are weighed by.

    Attributes
    ----------
    std_mm
        Session to the standard deviations (3,) of its components; nothing where they are not apart.
    mean_mm
        Root mean square of these over all rows: a component of that size has the weight 1 in every state.
    notes
        Sentences for the reader.
    """

    std_mm: Mapping[str, Numbers] = field(default_factory=dict)
    mean_mm: float = 1.0
    notes: tuple[str, ...] = ()

    def sightings(self, tables: Sequence[Observations]) -> Sightings | None:
        """Give tables joined, with these weights; None where they have none."""
        if not self.std_mm:
            return None
        joined = sightings_of(*tables)
        unit_mm = 1.0 if joined.is_stated else self.mean_mm
        whitening = joined.whitening.copy()
        for number, session in enumerate(joined.sessions):
            if session in self.std_mm:
                rows = joined.session == number
                weight = np.where(joined.is_measured[rows], unit_mm / self.std_mm[session], 0.0)
                whitening[rows] = np.eye(3) * weight[:, None, :]
        return replace(joined, whitening=np.ascontiguousarray(whitening))


def weights_of(
    machine: Machine, tables: Mapping[float, Observations], bases: Mapping[str, BasisSpec], threads: int
) -> Weights:
    """Tell the scatter of the components of every state that states none, where they differ.

    Parameters
    ----------
    tables
        Temperature to rows, sessions of all of them called differently.
    bases
        Bases that are given, by ISO name.
    """
    std_mm: dict[str, Numbers] = {}
    told: list[tuple[Numbers, Numbers]] = []
    squares, texts = [np.zeros(0)], []
    for temperature, table in tables.items():
        if sightings_of(table).is_stated:
            continue
        fitted = fit_terms(machine, [table], options=FitOptions(bases=dict(bases), threads=threads))
        variance, dof = scatter_of_components(fitted)
        pooled = np.nansum(variance * dof, axis=0) / np.maximum(dof.sum(axis=0), 1.0)
        if not (dof.sum(axis=0) > _LEAST_DOF).all():
            return Weights()
        tells = (dof > _LEAST_DOF).all(axis=1, keepdims=True)
        variance = np.where(tells, variance, pooled)
        told.append((np.sqrt(variance), dof))
        sightings = fitted.sightings
        std_mm |= dict(zip(sightings.sessions, np.sqrt(variance), strict=True))
        squares.append(variance[sightings.session][sightings.is_measured])
        text = ", ".join(f"{_UM_PER_MM * one:.1f}" for one in np.sqrt(pooled))
        texts.append(f"{text} at {temperature:g} °C")
    if not any(are_apart(std.ravel(), dof.ravel()) for std, dof in told):
        return Weights()
    note = (
        "no uncertainty is stated (columns sx, sy, sz, mm): components are weighed by how they scatter about the "
        f"fit, µm along the measuring frame's x, y, z: {'; '.join(texts)}"
    )
    return Weights(std_mm, float(np.sqrt(np.concatenate(squares).mean())), (note,))


def scatter_of_components(fitted: Fitted) -> tuple[Numbers, Numbers]:
    """Give variance, mm², and degrees of freedom of components of sessions, (n_sessions, 3)."""
    sightings, solved = fitted.sightings, fitted.solved
    columns = fitted.problem.times(
        solved.state, solved.solution.covariance_root, solved.used.astype(np.float64), fitted.threads
    )
    leverage = np.asarray((columns**2).sum(axis=2))
    block = blocks_of(sightings, sightings.pass_number, by_carrier=True).of_row
    left_mm = np.einsum("nij,nj->ni", sightings.unwhitening, solved.whitened)
    variance, dof = np.full((len(sightings.sessions), 3), np.nan), np.zeros((len(sightings.sessions), 3))
    for number in range(len(sightings.sessions)):
        for component in range(3):
            rows = (sightings.session == number) & solved.used & sightings.is_measured[:, component]
            _, place, count = np.unique(block[rows], return_inverse=True, return_counts=True)
            value = left_mm[rows, component]
            beside = value - (np.bincount(place, weights=value, minlength=len(count)) / np.maximum(count, 1))[place]
            free = float(rows.sum()) - float(leverage[rows, component].sum()) - len(count)
            if free > 0.0:
                variance[number, component], dof[number, component] = float(beside @ beside) / free, free
    return variance, dof
