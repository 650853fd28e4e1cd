"""Effects a little off their formula: what it says, but more here and less there along an axis.

A guide that wears at one end, a sensor that reads the warm side: the formula is right in what it follows, and its
size is not the same everywhere. Something else that follows the same variable and a position is no such effect: a
product has another sign on the other side, or nothing in the middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from geoerr.diagnose.scan import estimate
from geoerr.diagnose.search.settle import Settled
from geoerr.diagnose.space import Space
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES

# Size along an axis is a polynomial of this degree.
_DEGREE = 3
# Root mean square by which its size may differ from its mean. What rises from nothing at one end differs by 0.58.
_A_LITTLE = 0.45


@dataclass(frozen=True, eq=False)
class Uneven:
    """An effect whose size is free to change along an axis.

    Attributes
    ----------
    axis
        The axis.
    share
        Root mean square of its size about the mean, over the mean, where it acts.
    raw : (n, 3, k)
        Columns of its unevenness alone, in units of the stated uncertainties: none has a part of its mean size.
    gain, rank
        Fall of the sum of squares by it and its unevenness, and its degrees of freedom.
    """

    axis: str
    share: float
    raw: Numbers
    gain: float
    rank: int


def most_uneven(space: Space, settled: Settled, *, is_added: bool = False) -> Uneven | None:
    """Let an effect be uneven along each axis in turn; give the one that explains most, of those a little uneven.

    Parameters
    ----------
    is_added
        Whether the effect at its mean size is the space's own already.
    """
    explained = explained_by(settled)
    if not explained.any():
        # The model can take all of it over: nothing of it is somewhere more than elsewhere.
        return None
    found = [
        _uneven(space, explained, axis, column, is_added=is_added)
        for axis, column in zip(AXES, space.fitted.sightings.commanded_mm.T, strict=True)
        if np.ptp(column) > 0.0
    ]
    return max((one for one in found if one.share <= _A_LITTLE), key=lambda one: one.gain, default=None)


def columns_along(explained: Numbers, column: Numbers) -> tuple[Numbers, Numbers]:
    """Give columns (n, 3, k) of something (n, 3) whose size is free to follow a column (n,), and its sizes (n, k)."""
    low, high = float(np.nanmin(column)), float(np.nanmax(column))
    along = np.nan_to_num(2.0 * (column - low) / (high - low) - 1.0)
    sizes = np.asarray(legendre.legvander(along, _DEGREE), dtype=np.float64)
    return explained[:, :, None] * sizes[:, None, :], sizes


def explained_by(settled: Settled) -> Numbers:
    """Give what an effect explains, (n, 3), in units of the stated uncertainties."""
    assert settled.term is not None
    return np.asarray(settled.of_coefficients @ [one.value for one in settled.term.coefficients])


def _uneven(space: Space, explained: Numbers, axis: str, column: Numbers, *, is_added: bool) -> Uneven:
    raw, sizes = columns_along(explained, column)
    coefficients, root, gain = estimate(space, raw)
    weights = (explained**2).sum(axis=1)
    means = np.average(sizes, axis=0, weights=weights)
    mean = 1.0 if is_added else float(means @ coefficients)
    about_mean = sizes[:, 1:] - means[1:]
    off = float(np.sqrt(np.average((about_mean @ coefficients[1:]) ** 2, weights=weights)))
    uneven = explained[:, :, None] * about_mean[:, None, :]
    return Uneven(axis, off / abs(mean) if mean else np.inf, uneven, float(gain), root.shape[1])
