"""A second implementation of the scan: dense NumPy, whitening written out, one group at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.diagnose.scan import raw_columns
from geoerr.diagnose.space import Channels, Space
from geoerr.fit.owned import OWNED

Numbers = npt.NDArray[np.float64]


@dataclass
class Judged:
    gain: float
    rank: int
    share: float
    of_draws: Numbers


def judge(space: Space, channels: Channels, shapes: object, values: Numbers, draws: Numbers) -> Judged:
    """Judge columns of functions (n_columns, n), with draws of noise (n_draws, n, 3)."""
    raw = raw_columns(channels, shapes, values)  # type: ignore[arg-type]
    basis = space.basis.reshape(-1, space.basis.shape[2])
    columns = space.noise.whiten(raw).reshape(len(basis), -1)
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-6 * s[0]] if s[0] > 0.0 else u[:, :0]
    own, share, _ = np.linalg.svd(u - basis @ (basis.T @ u), full_matrices=False)
    own = own[:, share**2 > OWNED]
    residual = space.residual.reshape(-1)
    gain = float(((own.T @ residual) ** 2).sum())
    of_draws = ((draws.reshape(len(draws), -1) @ own) ** 2).sum(axis=1)
    return Judged(gain, own.shape[1], float((share**2).max(initial=0.0)), of_draws)
