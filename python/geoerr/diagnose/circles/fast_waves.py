"""Waves that are too fast for averaged rows: where the rows themselves show one, it is tried beside the others.

A bar that is read 250 times a second shows a vibration of 30 Hz. Trial values down to its rows would be thousands,
each with columns of all rows; so the rows' own spectrum, of what they have beyond their averages, says which are
worth it. An average of rows has less of such a wave, and its columns have as much less (`Runs.averages_of`).

A line of the spectrum of white noise is exponential; of several runs, whose phases have nothing in common, gamma.
One counts that noise alone would show in one spectrum of ten thousand.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincc

from geoerr.diagnose.circles.runs import Runs
from geoerr.fit.sightings import Numbers

_CHANCE = 1e-4
_MOST_FOUND = 2
# Trial values around a line, as shares of the distance of two lines.
_AROUND = np.linspace(-1.0, 1.0, 9)
# Lines nearer than this belong together.
_SAME_LINE = 4
_MOST_LINES = 20_000


def fast_waves(
    runs: Runs, axis: str, along: Literal["place", "time"], ends: tuple[float, float], step: float
) -> list[float]:
    """Give numbers of waves a mm, or a second, that the rows show beyond their averages, with some around each.

    Parameters
    ----------
    runs
        Averaged; of others there are none.
    axis
        The axis that shakes.
    along
        Of places on that axis all runs see one and the same wave, of times each its own.
    ends, step
        Between which numbers is looked, and how closely; no further than half a wave a row.
    """
    whole = runs.whole
    if whole is None:
        return []
    number = "xyz".index(axis)
    beyond_um = whole.signal_um - np.repeat(runs.signal_um, runs.counts)
    variance = float(np.mean(beyond_um**2)) * len(whole) / max(len(whole) - len(runs), 1)
    spectra, sizes = [], []
    for of_run, own in enumerate(whole.slices):
        if axis not in whole.plane[of_run]:
            continue
        place_mm = whole.fitted.sightings.commanded_mm[whole.rows[own], number]
        seen = (place_mm - whole.centre_mm[of_run, number]) / whole.radius_mm[of_run]
        at = place_mm if along == "place" else whole.time_s[own]
        most = 0.5 / max(float(np.median(np.abs(np.diff(at)))), 1e-12)
        n = min(int((min(ends[1], most) - ends[0]) / step) + 1, _MOST_LINES)
        spectra.append(_spectrum(seen * beyond_um[own], at, ends[0], step, max(n, 0)))
        sizes.append(variance * float(seen @ seen))
    n = min((len(one) for one in spectra), default=0)
    if n < 2 or variance <= 0.0:
        return []
    sums = np.array([one[:n] for one in spectra])
    if along == "place":
        power, degrees = np.abs(sums.sum(axis=0)) ** 2 / sum(sizes), 1
    else:
        power, degrees = (np.abs(sums) ** 2 / np.array(sizes)[:, None]).sum(axis=0), len(sizes)
    found: list[float] = []
    for _ in range(_MOST_FOUND):
        line = int(np.argmax(power))
        if n * float(gammaincc(degrees, power[line])) > _CHANCE:
            break
        found += [ends[0] + step * (line + share) for share in _AROUND]
        power[max(line - _SAME_LINE, 0) : line + _SAME_LINE + 1] = 0.0
    return found


def _spectrum(values: Numbers, at: Numbers, first: float, step: float, n: int) -> npt.NDArray[np.complex128]:
    """Give Σ values·exp(−2πi f at) for n frequencies f from the first on, (n,)."""
    wave = values * np.exp(-2j * np.pi * first * at)
    turn = np.exp(-2j * np.pi * step * at)
    sums = np.empty(n, dtype=np.complex128)
    for line in range(n):
        sums[line] = wave.sum()
        wave *= turn
    return sums
