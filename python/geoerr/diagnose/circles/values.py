"""Values: all causes at once, with standard errors, what each does to the radius, and how far others could do it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.circles.bench import Judged
from geoerr.diagnose.circles.causes import Suspect
from geoerr.diagnose.circles.found import Found, Rival
from geoerr.diagnose.circles.noise import orthonormal
from geoerr.diagnose.circles.state import State
from geoerr.diagnose.ties import TOO_ALIKE, is_as_good, z_by_noise
from geoerr.effects.values import is_at_an_end
from geoerr.fit.sightings import Numbers

CAUTION_OF_VALUES = 1.0


def joint(state: State, found: Sequence[Found]) -> tuple[Numbers, Numbers]:
    """Give all numbers of all causes at once, and their covariance.

    Causes are judged with all doubt about the noise counted against them; values come with the noise as it is.
    """
    state.use(state.noise_beside(found, np.zeros((state.n, 0)), CAUTION_OF_VALUES))
    parts, n_values = [], 0
    for one in found:
        parts.append(one.columns)
    basis, _ = state.context([])
    values = _solved(state, parts, basis)[0] if parts else np.zeros(0)
    with_inner, estimate = [], []
    for one in found:
        own = values[n_values : n_values + one.columns.shape[1]]
        n_values += one.columns.shape[1]
        with_inner.append(one.columns)
        estimate.append(own)
        slopes = _slopes(state, one, own)
        if slopes.shape[1]:
            with_inner.append(slopes)
            estimate.append(np.array(one.inner))
    if not with_inner:
        return np.zeros(0), np.zeros((0, 0))
    return np.concatenate(estimate), _solved(state, with_inner, basis)[1]


def _slopes(state: State, one: Found, values: Numbers) -> Numbers:
    """Give the derivatives of a cause's trace by its inner parameters, (n, n_inner); 0 for a fixed one."""
    slopes = np.zeros((state.n, len(one.inner)))
    for number, parameter in enumerate(one.way.term.inner):
        low, high = parameter.low or 0.0, parameter.high or 0.0
        if low == high or is_at_an_end(replace(parameter, value=one.inner[number])):
            # A bound has no error: those of the others hold for it alone.
            continue
        step = 1e-4 * (abs(one.inner[number]) if parameter.spacing == "log" else high - low)
        if parameter.name == "P":
            step = 1e-3 * one.inner[number] ** 2 / float(state.runs.radius_mm.max())
        sides = []
        for sign in (1.0, -1.0):
            inner = [*one.inner[:number], one.inner[number] + sign * step, *one.inner[number + 1 :]]
            sides.append(state.columns(one.judged.group, one.way, inner) @ values)
        slopes[:, number] = (sides[0] - sides[1]) / (2.0 * step)
    return slopes


def _solved(state: State, parts: Sequence[Numbers], basis: Numbers) -> tuple[Numbers, Numbers]:
    white = state.noise.whiten(np.concatenate(parts, axis=1))
    beyond = white - basis @ (basis.T @ white)
    size = np.sqrt((beyond**2).sum(axis=0))
    # What moves nothing (the moment of a jump, between two rows) is as uncertain as the rows are apart: told as 0.
    scale = np.where(size > 0.0, size, np.inf)
    inverse = np.linalg.pinv(beyond.T @ beyond / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    covariance = inverse / np.outer(scale, scale)
    return covariance @ (beyond.T @ state.signal), covariance


def traces_of(state: State, found: Sequence[Found], estimate: Numbers) -> Numbers:
    """Give what each cause does to the radius, µm, off the set-up, (n, n_found)."""
    traces, first = np.zeros((state.n, len(found))), 0
    for place, one in enumerate(found):
        k = one.columns.shape[1]
        own = one.columns @ estimate[first : first + k]
        traces[:, place] = own - state.plain(own)
        first += k + len(one.inner)
    return traces


def rivals_of(state: State, found: Sequence[Found], place: int) -> tuple[Rival, ...]:
    """Look at every other suspect in the place of a found cause."""
    one = found[place]
    others = [*found[:place], *found[place + 1 :]]
    basis, left = state.context(others)
    white = state.noise.whiten(one.columns)
    beyond = white - basis @ (basis.T @ white)
    own = orthonormal(beyond)
    explained = own @ (own.T @ left)
    gain, size = float(explained @ explained), float(np.linalg.norm(explained))
    evidence = state.evidence(one, others)[0]
    taken = {other.number for other in found}
    rivals = []
    for judged in state.bench.judge(basis, left, state.n):
        if judged.what in taken or size == 0.0:
            continue
        suspect = state.suspects[judged.what]
        group, trial = judged.group, judged.trial
        columns = group.columns[:, group.k * trial : group.k * (trial + 1)]
        if group.by_run:
            columns = state.radii.by_run(columns)
        theirs = state.noise.whiten(columns)
        theirs = orthonormal(theirs - basis @ (basis.T @ theirs))
        # Of unit vectors; rounding may leave it above 1.
        correlation = min(float(np.linalg.norm(theirs.T @ explained)) / size, 1.0)
        # In twice the logarithm of the evidence: what has more freedom has to earn it. Few runs are repeated, so that
        # it is the noise, estimated beside all causes, that tells how far their difference scatters.
        difference = 2.0 * (evidence - judged.evidence)
        z = z_by_noise(explained, theirs @ (theirs.T @ left), left)
        is_too_alike = correlation > TOO_ALIKE and judged.rank <= own.shape[1]
        tied = (is_too_alike or is_as_good(correlation, difference, z)) and not _holds(suspect, one.suspect)
        if tied and correlation > TOO_ALIKE and not one.inner and _is_at_an_end(suspect, judged):
            # What no run of these ends is the same in more numbers: no rival, unless it spares another cause.
            tied = _spares_one(state, others, columns)
        rivals.append(Rival(suspect, judged, correlation, gain - judged.gain, tied))
    return tuple(sorted(rivals, key=lambda rival: -rival.judged.evidence))


def sizes_of(state: State, found: Sequence[Found]) -> list[float]:
    """Give the root mean square of each cause's trace off the set-up, all causes estimated together."""
    if not found:
        return []
    values = _solved(state, [one.columns for one in found], state.base_q)[0]
    sizes, first = [], 0
    for one in found:
        k = one.columns.shape[1]
        trace = one.columns @ values[first : first + k]
        sizes.append(float(np.sqrt(np.mean((trace - state.plain(trace)) ** 2))))
        first += k
    return sizes


def _is_at_an_end(suspect: Suspect, judged: Judged) -> bool:
    way = suspect.ways[judged.group.way]
    values = zip(way.term.inner, way.trials[judged.trial], strict=True)
    return any(is_at_an_end(replace(parameter, value=value)) for parameter, value in values)


def _spares_one(state: State, others: Sequence[Found], columns: Numbers) -> bool:
    """Tell whether one of the other causes is superfluous beside columns (n, k)."""
    white = state.noise.whiten(columns)
    for place, one in enumerate(others):
        basis, _ = state.context([*others[:place], *others[place + 1 :]])
        basis = orthonormal(np.concatenate([basis, white], axis=1))
        left = state.signal - basis @ (basis.T @ state.signal)
        if 0.5 * state.gain(state.white(one), basis, left) <= state.penalty(one):
            return True
    return False


def _holds(wider: Suspect, special: Suspect) -> bool:
    """Tell whether one is a special case of the other: what needs more to explain the same is no rival."""
    return special.reference.effect in wider.effect.contains and special.reference.axis == wider.reference.axis
