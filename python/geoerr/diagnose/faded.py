"""What has faded where the first row stands: trial values at which the rows see next to nothing of an effect.

The coefficient of a decay is its height where it begins. Rows that lie many time constants behind it see a tiny share
of that height, and any structure in them makes the height absurd: nothing was measured of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# Rows that see less than this share of the height of an effect do not see it: three time constants after it began
# a decay is over.
_LEAST_SHARE = 0.05
# Coefficients in these units are heights: their columns are numbers, 1 where the whole height shows.
_HEIGHTS = ("mm", "rad")
# What a formula may fade with, and which rows would show it.
_WHERE = {
    "t_rev": "sooner after a reversal",
    "s": "closer to a reversal",
    "v": "at a lower speed",
    "d": "whose direction of approach is known",
}

# Columns (k, n) at values of the inner parameters, of some rows or of all.
ColumnsAt = Callable[[Sequence[float], np.ndarray | None], Numbers]


def has_heights(term: Term) -> bool:
    """Tell whether all coefficients of a term are heights: lengths or angles that a row may see a share of."""
    return all(one.unit in _HEIGHTS for one in term.coefficients)


def shows_at(at: ColumnsAt, inner: Sequence[float], few: np.ndarray | None, used: np.ndarray) -> bool:
    """Tell whether some row shows a share of some height at these values of the inner parameters.

    Parameters
    ----------
    few
        Rows that are looked at first; None where a formula has a value of all rows only.
    used : (n,)
        Rows that count.
    """
    if few is not None and _largest(at(inner, few), used[few]) >= _LEAST_SHARE:
        return True
    # A few rows may miss the one that shows it.
    return _largest(at(inner, None), used) >= _LEAST_SHARE


def wanting_words(term: Term) -> str:
    """Say which rows would show an effect that has faded at all of them."""
    names = {name[:-2] if name[-2:] in ("_x", "_y", "_z") else name for name in term.variables}
    where = next((words for name, words in _WHERE.items() if name in names), "where it has not faded")
    return f"wanting: rows {where}: none of these shows a twentieth of its height"


def _largest(columns: Numbers, used: np.ndarray) -> float:
    return float(np.abs(columns[:, used]).max(initial=0.0))
