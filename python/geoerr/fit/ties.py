"""Trial values that explain the same but for round-off: the first is taken, whichever processor adds up.

A wind-up over less than a stroke is the same for every length.
"""

from __future__ import annotations

import numpy as np

from geoerr.fit.sightings import Numbers

# Sums of some ten thousand products, added in another order, differ by less.
_ROUND_OFF = 1e-9


def first_best(gains: Numbers, n_coefficients: np.ndarray | None = None) -> int:
    """Give the place of the largest of (k,) gains; of those that are one but for round-off the simplest, or first.

    Parameters
    ----------
    n_coefficients : (k,)
        Coefficients of each: with as many as are needed a form says which of them acts, with more it does not.
    """
    alike = np.flatnonzero(gains >= gains.max() - _ROUND_OFF * abs(gains.max()))
    return int(alike[0] if n_coefficients is None else alike[np.argmin(n_coefficients[alike])])
