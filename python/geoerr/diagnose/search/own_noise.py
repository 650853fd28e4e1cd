"""A large effect estimated in the noise that it leaves, and not in the drift that had learnt it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.beside_drift import drifts_far
from geoerr.diagnose.search.best_form import beside_others
from geoerr.diagnose.search.judged import Judged
from geoerr.diagnose.search.settle import Settled
from geoerr.fit.noise_model import NoiseModel
from geoerr.fit.sightings import Numbers

# A drift has learnt an effect if no more than this share of it is left beside that.
_LEARNT = 0.7
_MOST_TIMES = 4


def in_own_noise(bench: Bench, judged: Judged, settled: Settled, others: Sequence[Numbers]) -> Settled:
    """Give an effect as it is estimated in the noise beside it, where a strong drift had learnt it; else as it is.

    Of three millimetres of warming up half a per cent in a time constant is a micrometre, and a strong drift forgives
    that: beside the effect it is gone, and what the time constant leaves would look like something else. So would
    what is left by a lag that the drift had made of an effect without one: it goes.
    """
    term = settled.term
    if term is None or not any(one.std > 0.0 for one in term.inner):
        return settled
    noise, found = settled.space.noise, settled
    for _ in range(_MOST_TIMES):
        if not drifts_far(settled.space, noise):
            break
        own = bench.sums([*others, found.raw]).fit(start=noise)
        if not _is_learnt(noise, own):
            break
        space = bench.space_to_estimate_in(own, others)
        found, noise = beside_others(space, bench.scanner(space, n_draws=0), judged, found), own
    return found


def _is_learnt(before: NoiseModel, beside: NoiseModel) -> bool:
    return bool(np.max(before.sigma * before.drift) * _LEARNT > np.max(beside.sigma * beside.drift))
