"""What the measuring adds: white noise, heavy tails, outliers, offsets of passes, slow drift."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from validation.hidden_effects.chain import Array


@dataclass(frozen=True)
class Noise:
    """A kind of noise; everything is in the measuring frame.

    Attributes
    ----------
    white_um
        Standard deviation of the independent part along x, y, z (z = depth): this alone is what the table states.
    tail_dof
        Degrees of freedom of Student's t, scaled to that standard deviation; 0 = Gauss.
    gross_share, moderate_share
        Shares of rows with one component off by 0.5 to 5 mm, and by 50 to 200 µm.
    pass_offset_um
        Standard deviation of each pass's own offset, each component.
    drift_um, drift_time_share
        Stationary standard deviation of a wandering offset within a session (Ornstein–Uhlenbeck), each component, and
        its correlation time as a share of the session.
    """

    white_um: tuple[float, float, float] = (10.0, 10.0, 10.0)
    tail_dof: int = 0
    gross_share: float = 0.0
    moderate_share: float = 0.0
    pass_offset_um: float = 0.0
    drift_um: float = 0.0
    drift_time_share: float = 0.2


_PLAIN = Noise()
NOISES: dict[str, Noise] = {
    "gauss-3": Noise(white_um=(3.0, 3.0, 3.0)),
    "gauss-10": _PLAIN,
    "gauss-30": Noise(white_um=(30.0, 30.0, 30.0)),
    "heavy-tails": replace(_PLAIN, tail_dof=4),
    "outliers": replace(_PLAIN, gross_share=0.003, moderate_share=0.01),
    "unequal-depth": Noise(white_um=(10.0, 10.0, 15.0)),
    "offsets-3": replace(_PLAIN, pass_offset_um=3.0),
    "offsets-8": replace(_PLAIN, pass_offset_um=8.0),
    "drift-2": replace(_PLAIN, drift_um=2.0),
    "offsets-3+drift-2": replace(_PLAIN, pass_offset_um=3.0, drift_um=2.0),
    "everything": Noise((10.0, 10.0, 15.0), 4, 0.003, 0.01, 3.0, 2.0),
}


@dataclass(frozen=True)
class DrawnNoise:
    """Noise of n rows (mm): `total_mm` (n, 3), its correlated part, the stated deviations, and who is an outlier."""

    total_mm: Array
    correlated_mm: Array
    stated_mm: Array
    is_outlier: npt.NDArray[np.bool_]


def draw_noise(
    rng: np.random.Generator,
    noise: Noise,
    pass_number: npt.NDArray[np.int64],
    session: npt.NDArray[np.int64],
    t_s: Array,
) -> DrawnNoise:
    """Draw the noise of rows in order of time within each session; rows of one time share the drift."""
    n_rows = len(t_s)
    sigma_mm = 1e-3 * np.asarray(noise.white_um)
    if noise.tail_dof:
        white = rng.standard_t(noise.tail_dof, (n_rows, 3)) * np.sqrt((noise.tail_dof - 2) / noise.tail_dof)
    else:
        white = rng.standard_normal((n_rows, 3))
    offsets = rng.standard_normal((pass_number.max() + 1, 3))[pass_number]
    correlated = 1e-3 * noise.pass_offset_um * offsets
    correlated += 1e-3 * noise.drift_um * _wandering(rng, session, t_s, noise.drift_time_share)
    off = np.zeros((n_rows, 3))
    kind = rng.random(n_rows)
    size = np.where(kind < noise.gross_share, rng.uniform(0.5, 5.0, n_rows), rng.uniform(0.05, 0.2, n_rows))
    is_outlier = kind < noise.gross_share + noise.moderate_share
    off[np.arange(n_rows), rng.integers(0, 3, n_rows)] = is_outlier * size * rng.choice([-1.0, 1.0], n_rows)
    return DrawnNoise(sigma_mm * white + correlated + off, correlated, np.tile(sigma_mm, (n_rows, 1)), is_outlier)


def _wandering(rng: np.random.Generator, session: npt.NDArray[np.int64], t_s: Array, share: float) -> Array:
    """Ornstein–Uhlenbeck of unit variance, exact between any two times."""
    result = np.zeros((len(t_s), 3))
    for one in np.unique(session):
        rows = np.flatnonzero(session == one)
        times, back = np.unique(t_s[rows], return_inverse=True)
        tau = share * max(times[-1] - times[0], 1e-9)
        keep = np.exp(-np.diff(times) / tau)
        kicks = rng.standard_normal((len(times), 3))
        kicks[1:] *= np.sqrt(1.0 - keep**2)[:, None]
        path = kicks.copy()
        for row, factor in enumerate(keep):
            path[row + 1] += factor * path[row]
        result[rows] = path[back]
    return result
