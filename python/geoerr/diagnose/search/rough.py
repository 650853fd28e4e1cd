"""A wave along an axis, and a rough error of that axis which would pass for one.

Repeats say how well the error at a place is known, and held-out passes may see the same places again: neither knows
what is between them. Where a machine is off by something else at each of twenty places, one wave among the thousand
that are tried meets most of that by chance; and of a step, a bump or a table that the model's knots do not follow
some wave always does a part. So the wave is asked for beside errors that are as rough as the data make them.

| symbol | code | what |
|---|---|---|
| B | `_at_places` | whitened columns of an error of 1 mm at each place, or cell of places, off the model |
| C | `rough_covariances` | covariance of the errors at the places, of size 1 |
| W | `Settled.of_coefficients` | columns of the wave |
| τ² | `variance` | how rough: the errors' variance |
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.candidates import is_wave_in_some_form
from geoerr.diagnose.probes import Probe, bodies, shapes_on
from geoerr.diagnose.scan import seen
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import Judged, evidence_of
from geoerr.diagnose.search.look import Round
from geoerr.diagnose.search.settle import Settled
from geoerr.fit.classic import positions_by_axis
from geoerr.fit.owned import OWNED
from geoerr.fit.periods import place_of_period
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers
from geoerr.machine import AXES
from geoerr.terms import EffectReference

# A wave of fewer turns on the way of an axis bends no more often than errors of guideways do.
_FEWEST_TURNS = 2.0
# More places than these are taken together in as many cells, between whose middles an error runs straight.
_FEWEST_PLACES, _MOST_PLACES = 3, 100
# How rough errors may be, in units of what the data can see.
ROUGH_SIZES = np.geomspace(1e-3, 1e6, 73)
# Cosine between what a channel does and what a direction of the base does, if they are one.
_THE_SAME = 0.99


@dataclass(frozen=True, eq=False)
class RoughError:
    """A rough error of an axis that explains as much as a wave would.

    Attributes
    ----------
    axis, n_places
        Of which, and at how many places it was measured.
    wave, period_mm
        The wave.
    channels
        On which channels both act.
    judged
        The same as a probe, to be told as what has no name; None where places are many, so that the model's own
        function could follow it with more knots, or where it is no displacement along one axis.
    """

    axis: str
    n_places: int
    wave: EffectReference
    period_mm: float
    channels: tuple[str, ...]
    judged: Judged | None

    def is_of(self, claim: Judged, settled: Settled) -> bool:
        """Tell whether a candidate is a function of the position of the same axis on the same channels."""
        return (
            settled.term is not None
            and settled.term.variables == (self.axis,)
            and channels_of(claim) == self.channels
        )

    def words(self) -> str:
        """Say why the wave was not named, and what would tell."""
        return (
            f"at {self.n_places} places of {self.axis} a wave of {self.period_mm:.4g} mm ({self.wave}), the best of "
            "the many that were tried, is no likelier a cause of what the model leaves there than something else at "
            f"each place: measure {self.axis} at places between these, where a wave goes on"
        )


def rough_error(bench: Bench, looked: Round, claim: Judged, settled: Settled) -> tuple[RoughError, Numbers] | None:
    """Give the rough error that is as likely as a wave; None of what is no wave along an axis, or is likelier.

    Its columns (n, 3, k) are an error for each place, or cell of places, on each channel.

    Parameters
    ----------
    claim, settled
        A candidate, and its values. Where what is rough is not to be told as what has no name, functions of the model
        on the same channels have to be free: what a model that is held does not follow is missing in it.

    Notes
    -----
    With errors N(0, τ² C) at the places the data's covariance is S = 1 + τ² B C Bᵀ, and their evidence against noise
    alone is −½ ln det S + ½ rᵀ(1 − S⁻¹)r: a rough error has the largest of that over τ and C. Beside it the wave
    falls by G = rᵀS⁻¹W (WᵀS⁻¹W)⁻¹ WᵀS⁻¹r in k directions, and has the evidence of `of_directions` more, less ln n for
    the n that were tried: it is named where that is the larger one, 0 among the τ of both.
    """
    term = settled.term
    place = None if term is None else place_of_period(term)
    if term is None or place is None or isinstance(claim.what, Probe) or term.variables[0] not in AXES:
        return None
    if not is_wave_in_some_form(bench.functions, claim.what):
        return None
    axis = term.variables[0]
    places_mm = _places_mm(bench, axis)
    if len(places_mm) < _FEWEST_PLACES:
        return None
    is_few, is_free, cells_mm = len(places_mm) <= _MOST_PLACES, _is_free(bench, axis, claim), places_mm
    if not is_few:
        if not is_free:
            return None
        cells_mm = np.linspace(places_mm[0], places_mm[-1], _MOST_PLACES)
    at_places = _at_places(bench, axis, cells_mm)
    channels = [bench.channels[name] * factor for name, factor in claim.shapes.channels]
    columns = np.concatenate([own[:, :, None] * at_places[:, None, :] for own in channels], axis=2)
    own = seen(looked.space, np.concatenate([columns, settled.of_coefficients], axis=2))
    keep = _beyond_the_model(own.gram_beyond, own.gram, columns.shape[2])
    gram, score = keep.T @ own.gram_beyond @ keep, keep.T @ own.score(looked.space)
    rough, with_wave = -math.inf, -math.inf
    for covariance in rough_covariances(cells_mm, len(channels)):
        alone, beside = rough_evidence(gram, score, covariance)
        rough, with_wave = max(rough, alone), max(with_wave, beside)
    if rough <= 0.0 or with_wave - math.log(claim.what.n_trials) > rough:
        return None
    probe = _as_probe(bench, looked, claim, axis, at_places, channels) if is_few else None
    if probe is None and not is_free:
        return None
    wave, period_mm = claim.what.reference, term.inner[place].value
    return RoughError(axis, len(places_mm), wave, period_mm, channels_of(claim), probe), columns


def may_be_smooth(bench: Bench, claim: Judged, settled: Settled) -> bool:
    """Tell whether a wave makes too few turns to be told from a smooth error of its axis that no fit follows.

    A straightness that is another by now, beside a model that is held, bends as often; so does one that the model has
    no function for. Where its own functions are free they follow that.
    """
    term = settled.term
    place = None if term is None else place_of_period(term)
    if term is None or place is None or isinstance(claim.what, Probe) or term.variables[0] not in AXES:
        return False
    way_mm = float(np.ptp(_places_mm(bench, term.variables[0])))
    return way_mm < _FEWEST_TURNS * term.inner[place].value and not _is_free(bench, term.variables[0], claim)


def channels_of(claim: Judged) -> tuple[str, ...]:
    """Name the channels on which a candidate acts."""
    return tuple(channel for channel, _ in claim.shapes.channels)


def of_directions(gain: Numbers, rank: np.ndarray | int) -> Numbers:
    """Give the evidence of k directions that are off by something, as large as it is likeliest, against noise alone.

    With errors of variance v along each beside noise of 1 it is −k/2 ln(1 + v) + G/2 v/(1 + v), G the fall of the sum
    of squares; likeliest is 1 + v = G/k.
    """
    scale = np.maximum(gain / np.maximum(rank, 1), 1.0)
    return np.asarray(0.5 * (gain * (1.0 - 1.0 / scale) - rank * np.log(scale)))


def rough_evidence(gram: Numbers, score: Numbers, covariance: Numbers) -> tuple[float, float]:
    """Give the largest evidence of rough errors alone, and of a wave beside them, against noise alone.

    Parameters
    ----------
    gram : (n_places + k, n_places + k)
        Products of columns at places, then of the wave's, with each other.
    score : (n_places + k,)
        Their products with the residual.
    covariance : (n_places, n_places)
        Of the errors at places.
    """
    n_places = len(covariance)
    size, turn = np.linalg.eigh(covariance)
    root = turn * np.sqrt(np.maximum(size, 0.0))
    seen_size, turn = np.linalg.eigh(root.T @ gram[:n_places, :n_places] @ root)
    root, seen_size = root @ turn, np.maximum(seen_size, 0.0)
    along, across = root.T @ score[:n_places], root.T @ gram[:n_places, n_places:]
    variance = np.append(0.0, ROUGH_SIZES / max(float(seen_size.mean()), 1e-300))[:, None]
    shrunk = variance / (1.0 + variance * seen_size)
    alone = 0.5 * (shrunk * along**2 - np.log1p(variance * seen_size)).sum(axis=1)
    left = score[n_places:] - (shrunk * along) @ across
    inside = gram[n_places:, n_places:] - np.einsum("tk,ki,kj->tij", shrunk, across, across)
    share, turns = np.linalg.eigh(inside)
    is_own = share > OWNED * np.trace(gram[n_places:, n_places:])
    turned = np.einsum("tij,ti->tj", turns, left)
    gain = (np.where(is_own, turned, 0.0) ** 2 / np.where(is_own, share, 1.0)).sum(axis=1)
    beside = alone + of_directions(gain, is_own.sum(axis=1))
    return float(alone.max()), float(beside.max())


def _beyond_the_model(beyond: Numbers, whole: Numbers, k: int) -> Numbers:
    """Give what keeps of the first k columns what the model leaves, (n, n): directions that are its own are none."""
    size = np.sqrt(np.maximum(np.diag(whole)[:k], 1e-300))
    share, turn = np.linalg.eigh(beyond[:k, :k] / np.outer(size, size))
    left = turn[:, share > OWNED]
    keep = np.eye(len(whole))
    keep[:k, :k] = (left @ left.T) * np.outer(1.0 / size, size)
    return keep


def rough_covariances(cells_mm: Numbers, n_channels: int) -> Iterator[Numbers]:
    """Give covariances of errors that have nothing to do with each other, that wander, and whose slope wanders.

    The last two are Wiener's process and its integral, of which a cubic spline is the likeliest curve.
    """
    at = (cells_mm - cells_mm[0]) / (cells_mm[-1] - cells_mm[0])
    low, high = np.minimum.outer(at, at), np.maximum.outer(at, at)
    for one in (np.eye(len(at)), low, low**2 * (3.0 * high - low) / 6.0):
        yield np.kron(np.eye(n_channels), one)


def _is_free(bench: Bench, axis: str, claim: Judged) -> bool:
    """Tell whether the model has a function of its own, along the axis, on each channel of a claim."""
    free = {
        part.channel
        for term in bench.fitted.terms
        for part in term.parts
        if part.basis is not None and part.basis.axis == axis
    }
    return set(channels_of(claim)) <= free


def _places_mm(bench: Bench, axis: str) -> Numbers:
    counts = bench.rows.any(axis=1)
    return positions_by_axis(bench.fitted.sightings.commanded_mm[counts], SAME_POSITION_MM)[axis]


def _at_places(bench: Bench, axis: str, cells_mm: Numbers) -> Numbers:
    """Give what an error of 1 mm at each of some places is at each row, (n, n_places): straight between them."""
    along_mm = bench.fitted.sightings.commanded_mm[:, AXES.index(axis)]
    unit = np.eye(len(cells_mm))
    return np.stack([np.interp(along_mm, cells_mm, own) for own in unit], axis=1)


def _as_probe(
    bench: Bench, looked: Round, claim: Judged, axis: str, at_places: Numbers, channels: list[Numbers]
) -> Judged | None:
    """Give an error for each place as a probe along the axis of the base along which the wave acts."""
    alike = {
        (body, component): _cosine(channels[0], bench.channels[f"{body}-{component}"])
        for body in bodies(bench.fitted)
        for component in AXES
        if f"{body}-{component}" in bench.names
    }
    (body, component), most = max(alike.items(), key=lambda one: one[1], default=(("", ""), 0.0))
    if len(channels) > 1 or most < _THE_SAME:
        return None
    codes = [bench.functions.given(own) for own in np.ascontiguousarray(at_places.T)]
    shapes = shapes_on(f"{body}-{component}", [codes])
    probe = Probe(component, (axis,), (shapes,), len(AXES), "places")
    scanned = looked.scanner.exact(shapes)
    evidence = float(evidence_of(looked.space, scanned.gain, scanned.rank, probe.n_sets)[0])
    return Judged(
        probe,
        shapes,
        0,
        float(scanned.gain[0]),
        int(scanned.rank[0]),
        claim.surprise,
        evidence,
        claim.p_value,
        float(scanned.share[0]),
    )


def _cosine(one: Numbers, other: Numbers) -> float:
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return abs(float((one * other).sum())) / size if size > 0.0 else 0.0
