"""Waves in time as the search sees them: the best of each channel, in the metric of the noise.

No smooth probe sees them. The chance that some frequency has a surprise above s is no more than e^-s; the best wave
of each channel is made into columns, and judged as every other probe is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.null import surprise
from geoerr.diagnose.space import Channels, Space
from geoerr.fit.sightings import Numbers
from geoerr.fit.waves_in_time import Wave, WavesInTime


@dataclass(frozen=True, eq=False)
class Hum:
    """The best wave on a channel.

    Attributes
    ----------
    channel
        Where it acts.
    wave
        Its frequency and columns.
    surprise
        −ln of the chance of such a gain, trials counted.
    n_trials
        Number of frequencies that were looked at.
    """

    channel: str
    wave: Wave
    surprise: float
    n_trials: int


def hums_of(waves: WavesInTime, channels: Sequence[str], space: Space, directions: Channels) -> Iterator[Hum]:
    """Give the best wave of each channel that it moves."""
    n_trials = len(waves.frequencies)
    for channel in channels:
        wave = waves.best(*_seen(space, directions[channel]))
        if wave is not None:
            found = float(surprise(np.array([wave.gain]), wave.rank, n_trials)[0])
            yield Hum(channel, wave, found, n_trials)


def _seen(space: Space, direction: Numbers) -> tuple[Numbers, Numbers]:
    """Give y and w of a channel, (n,).

    The residual has lost what the model takes of noise: y is put up by as much.
    """
    free = max(space.n_numbers - space.basis.shape[2], 1)
    y = np.einsum("nc,nc->n", direction, space.residual_back) * math.sqrt(space.n_numbers / free)
    return y, direction**2 @ space.noise.sigma**-2.0
