"""What a drift or offsets of passes can swallow: judged with the noise estimated anew under each of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.candidates import Candidate
from geoerr.diagnose.null import surprise
from geoerr.diagnose.probes import Probe
from geoerr.diagnose.search.asked_for import AskedFor
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import Judged, evidence_of, freedom_of, reference_of, scanned_best
from geoerr.diagnose.search.look import Round
from geoerr.diagnose.search.settle import Settled, settle
from geoerr.diagnose.space import Space
from geoerr.distributions import f_log_sf
from geoerr.fit.noise_model import NoiseModel, NoiseSums, without_drift
from geoerr.fit.sightings import Numbers
from geoerr.terms import is_motion

# Functions of time, which a drift can swallow, are judged with the drift estimated anew: so many of the best, and
# such as would be a surprise if nothing drifted.
_MOST_LIKE_DRIFT, _LEAST_SURPRISE = 4, 8.0
# Logarithm of the evidence that a function of time needs beside a drift that is estimated anew: of drifts alone the
# largest was 10.
_LEAST_BESIDE_DRIFT = 12.5
# Two fits of the noise are so far apart in it that say the same.
_AS_MUCH = 0.5
# That was of so many functions of time; with more of them chance has more to choose from.
_FEW_LIKE_DRIFT = 10.0
# A drift that moves the mean of a block, or offsets that move that of a pass, by less than this share of its scatter
# (variances) hide nothing.
_STRONG = 1.0
# How an axis moves, which a pass at one feed shares from its first row to its last: direction and speed.
_OF_MOTION = ("d", "v", "mean_v")
# What a plan that goes both ways is made to show (ISO 230-2), and so is asked for by itself.
_ASKED_FOR = "backlash"
# An exponent beyond which a ratio of likelihoods says no more by being larger.
_CERTAIN = 600.0


def beside_drift(bench: Bench, looked: Round, added: Sequence[Numbers]) -> Round:
    """Judge functions of time by the likelihood with the noise estimated anew under each of them.

    A drift that was estimated without a jump has learnt the jump, and leaves nothing of it. So has one that is strong
    what follows a temperature, and so have offsets of few passes what changes with direction or speed alone.
    There what the plan was made to show is no find of a search: it is asked for by itself, at half the level, and the
    search has the other half.
    """
    drifts = drifts_far(looked.space, looked.space.noise)
    is_offset = _offset_to_scatter(looked.space) > _STRONG
    like = [
        one
        for one in looked.candidates
        if _is_of_time(one.what) or (drifts and _is_slow(one.what)) or (is_offset and _is_of_motion(one.what))
    ]
    if not like:
        return looked
    asked = [one for one in like if _is_asked_for(one.what)] if is_offset else []
    asked_for = {id(one.what): _not_seen(one, looked.space.n_passes, bench.n_searches * len(asked)) for one in asked}
    if asked:
        looked = _at_half_the_level(looked, tuple(asked_for.values()))
    least = _LEAST_BESIDE_DRIFT + math.log(max(len(like) / _FEW_LIKE_DRIFT, 1.0))
    sums = bench.sums(added)
    calm_noise = without_drift(looked.space.noise, without_offsets=is_offset)
    calm = bench.space_in(calm_noise, added)
    scanner = bench.scanner(calm, n_draws=0)
    tops = scanned_best(scanner, [one.what for one in like])
    clear = sorted((one for one, _ in tops if one and one.surprise > _LEAST_SURPRISE), key=lambda one: -one.evidence)
    judged = {id(one.what): one for one in looked.candidates}

    def enough(one: Judged) -> float:
        of_passes = is_offset and _is_of_motion(one.what)
        return max(judged[id(one.what)].evidence, 0.0 if of_passes else least)

    # Without a drift more is seen of each than beside one: what is not enough there, or less than the best, is not
    # looked at further.
    most = looked.candidates[0].evidence
    clear = [one for one in clear[:_MOST_LIKE_DRIFT] if one.evidence > max(most, enough(one))]
    if not clear:
        return looked
    without = _log_likelihood(sums, bench)
    for one in clear:
        # A drift forgives no jump at the wrong moment: the time is found first.
        columns = scanner.raw_columns(settle(calm, scanner, one).shapes, 0)
        noise = bench.sums([*added, columns]).fit(restricted=False, start=bench.noise)
        gain = max(2.0 * (noise.log_likelihood - without), 0.0)
        found = float(surprise(np.array([gain]), one.rank, one.what.n_trials)[0])
        if is_offset and _is_of_motion(one.what):
            found = min(found, _surprise_of_passes(gain, one.rank, looked.space.n_passes, one.what.n_trials))
        p_value = looked.p_value_of(found)
        if id(one.what) in asked_for:
            question = replace(asked_for[id(one.what)], gain=gain, rank=one.rank, surprise=found)
            asked_for[id(one.what)] = question
            p_value = min(p_value, question.p_value)
        n_ways = len(one.what.shapes) * len(one.shapes.trials)
        evidence = float(evidence_of(looked.space, np.array([gain]), np.array([one.rank]), n_ways)[0])
        if evidence > enough(one):
            judged[id(one.what)] = replace(
                one, gain=gain, surprise=found, evidence=evidence, p_value=p_value, noise=noise
            )
    candidates = _simplest_first(sorted(judged.values(), key=lambda one: -one.evidence))
    return replace(looked, candidates=candidates, asked_for=tuple(asked_for.values()))


def is_beside_drift(bench: Bench, space: Space, added: Sequence[Numbers], judged: Judged, settled: Settled) -> bool:
    """Tell whether the likelihood speaks for what was found beside these, the noise anew with and without it.

    As clearly as a function of time has to be spoken for to be found.
    """
    columns = settled.raw[:, :, : judged.rank]
    with_it = _log_likelihood(bench.sums([*added, columns]), bench)
    gain = np.array([2.0 * (with_it - _log_likelihood(bench.sums(added), bench))])
    evidence = evidence_of(space, gain, np.array([judged.rank]), judged.what.n_trials)
    return float(evidence[0]) > _LEAST_BESIDE_DRIFT


def _log_likelihood(sums: NoiseSums, bench: Bench) -> float:
    return sums.fit(restricted=False, start=bench.noise).log_likelihood


def _not_seen(one: Judged, n_passes: int, n_questions: int) -> AskedFor:
    return AskedFor(reference_of(one), 0.0, one.rank, n_passes, one.what.n_trials, 0.0, n_questions)


def _at_half_the_level(looked: Round, asked_for: tuple[AskedFor, ...]) -> Round:
    candidates, probes = (
        tuple(replace(one, p_value=min(2.0 * one.p_value, 1.0)) for one in judged)
        for judged in (looked.candidates, looked.probes)
    )
    return replace(looked, candidates=candidates, probes=probes, asked_for=asked_for)


def _simplest_first(candidates: list[Judged]) -> tuple[Judged, ...]:
    """Put the one with the least freedom first, of those that have as much evidence as the first."""
    near = [one for one in candidates if one.evidence > candidates[0].evidence - _AS_MUCH]
    first = min(near, key=freedom_of)
    return first, *(one for one in candidates if one is not first)


def _surprise_of_passes(gain: float, rank: int, n_passes: int, n_trials: int) -> float:
    """Give −ln of the chance of so large a ratio of likelihoods where each pass is one number, less ln of the trials.

    The ratio is that of two sums of squares over passes, whose chance is Fisher's: few passes say little, however far
    the ratio goes.
    """
    left = n_passes - 1 - rank
    if left < 1:
        return 0.0
    ratio = math.expm1(min(gain / n_passes, _CERTAIN)) * left / rank
    return float(-f_log_sf(ratio, rank, left)) - math.log(n_trials)


def drifts_far(space: Space, noise: NoiseModel) -> bool:
    """Tell whether some component drifts so far, beside the scatter of a block's mean, as to hide something."""
    return float((noise.drift**2 * space.rows.sum(axis=0)).max()) / len(noise.blocks) > _STRONG


def _offset_to_scatter(space: Space) -> float:
    """Give the variance of an offset over that of the mean of white noise over a pass, of the worst component."""
    return float((space.noise.offset**2 * space.rows.sum(axis=0)).max()) / max(space.n_passes, 1)


def _is_slow(what: Candidate | Probe) -> bool:
    """Tell of what follows a temperature, or is another in each session: temperatures differ from one to the next."""
    return isinstance(what, Candidate) and (what.reference.covariate is not None or what.effect.each_session)


def _is_of_motion(what: Candidate | Probe) -> bool:
    terms = [shapes.term for shapes in what.shapes if shapes.term is not None]
    return any(is_motion(name, *_OF_MOTION) for term in terms for name in term.variables)


def _is_asked_for(what: Candidate | Probe) -> bool:
    return isinstance(what, Candidate) and what.effect.id == _ASKED_FOR


def _is_of_time(what: Candidate | Probe) -> bool:
    return any(shapes.term is not None and shapes.term.is_of_time for shapes in what.shapes)
