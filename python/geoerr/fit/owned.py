"""What is a fit's own: columns of which it leaves next to nothing, so that nothing can be said of them."""

from __future__ import annotations

import numpy as np

from geoerr.fit.sightings import Numbers

# Of the square of a column; the core has the same.
OWNED = 0.002


def are_owned(squares: Numbers, inside: Numbers) -> np.ndarray:
    """Tell of columns (..., k) whether a fit leaves a smaller share of each than of anything that it shows.

    Parameters
    ----------
    squares : (..., k)
        Sums of squares of the columns.
    inside : (..., k, r)
        Their products with orthonormal columns of what the fit is free to do.
    """
    return np.asarray(squares - np.einsum("...kr,...kr->...k", inside, inside) <= OWNED * squares)
