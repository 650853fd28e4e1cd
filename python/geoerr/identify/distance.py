"""How far values are from 0, by their covariance."""

from __future__ import annotations

import numpy as np

from geoerr.identify.linear import Numbers

# Eigenvalues of a covariance below this share of the largest are the gauge's, or round-off.
_RANK_TOLERANCE = 1e-9


def squared_distance(values: Numbers, covariance: Numbers) -> tuple[float, int]:
    """Give χ² of values (n,) with their covariance (n, n), and on how many degrees of freedom: its rank."""
    spread, direction = np.linalg.eigh(covariance)
    kept = spread > _RANK_TOLERANCE * max(float(spread[-1]), 0.0)
    return float(((direction[:, kept].T @ values) ** 2 / spread[kept]).sum()), int(kept.sum())
