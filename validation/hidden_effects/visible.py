"""What of a displacement nothing else can absorb: the generator's own projection.

A displacement of n rows in base axes is projected, every component of every row weighing the same, off

- **base**: 18 joint channels, each a clamped cubic B-spline of ten functions over the axis's range, and three
  squarenesses, with levers to first order;
- **poses**: for each session six numbers of a free measuring frame, and three of every target's place but one: a
  plate sits where it was stuck, and a static marker anywhere;
- **offsets**: three numbers for each pass (session, line, repeat, way);
- **drift**: for each session and component a clamped cubic B-spline in time of eight functions.

What is left is *visible*; its RMS over all rows, by component, is what `generate` scales. The length over the three
components, `√Σ_b mean r_b²`, is the figure that a strength names. Offsets and drift are free here, of any size,
whether or not the noise has them: a diagnosis does not know it either. A smaller projection, base and poses only,
tells what a diagnosis could have that knows that nothing drifts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from validation.hidden_effects.chain import Array, levers
from validation.hidden_effects.log import Log, arms_mm
from validation.hidden_effects.plans import Integers

N_SPLINES = 10
N_DRIFT = 8
# Directions of less than this share of the largest are what rounding leaves of a dependent column.
_RANK_TOLERANCE = 1e-9


def spline_columns(u: Array, low: float, high: float, count: int) -> Array:
    """Clamped cubic B-splines over a range, (n, count)."""
    inner = np.linspace(low, high, count - 2)
    knots = np.concatenate([[low] * 3, inner, [high] * 3])
    return np.asarray(BSpline.design_matrix(np.clip(u, low, high), knots, 3).toarray())


def base_columns(log: Log) -> Array:
    """Columns (n, 3, k) of the 18 channels' splines and the squarenesses, base axes."""
    sign, lever = levers(log.machine.chain, log.carrier, log.q_mm, arms_mm(log.machine, log.plan))
    n_rows, q = log.n_rows, log.q_mm
    columns = np.zeros((n_rows, 3, 3 * 6 * N_SPLINES + 3))
    at = 0
    for axis in range(3):
        shape = sign[:, axis, None] * spline_columns(q[:, axis], *log.range_mm(axis), N_SPLINES)
        for b in range(3):
            columns[:, b, at : at + N_SPLINES] = shape
            at += N_SPLINES
        for b in range(3):
            turned = np.cross(np.eye(3)[b], lever[:, axis])
            # In mm: an angle counts by what it does 100 mm away.
            for component in range(3):
                if component != b:
                    columns[:, component, at : at + N_SPLINES] = 0.01 * turned[:, component, None] * shape
            at += N_SPLINES
    y, z = sign[:, 1] * q[:, 1], sign[:, 2] * q[:, 2]
    columns[:, 0, at], columns[:, 0, at + 1], columns[:, 1, at + 2] = -0.01 * y, -0.01 * z, -0.01 * z
    return columns


def pose_columns(log: Log) -> Array:
    """Give columns (n, 3, k) of each session's measuring frame, and of the place of every target seen in it."""
    session = log.session
    targets = log.carrier * (1 + log.plan.rows.target.max()) + log.plan.rows.target
    columns = []
    for one in range(int(session.max()) + 1):
        mine = session == one
        place = np.where(mine[:, None], 0.01 * (log.nominal_mm - log.nominal_mm[mine].mean(axis=0)), 0.0)
        groups = [mine] + [mine & (targets == target) for target in np.unique(targets[mine])[1:]]
        columns += [group[:, None] * np.eye(3)[b] for group in groups for b in range(3)]
        columns += [np.cross(np.eye(3)[b], place) for b in range(3)]
    return np.stack(columns, axis=2)


@dataclass(frozen=True)
class Offsets:
    """Offsets of passes and drift, alike in the three components: means by group, then an orthonormal basis."""

    group: Integers
    counts: Array
    drift: tuple[tuple[Integers, Array], ...]

    def removed(self, values: Array) -> Array:
        """Give (n, ...) values without them."""
        flat = values.reshape(len(values), -1)
        flat = flat - _sums(self.group, flat, len(self.counts))[self.group] / self.counts[self.group, None]
        for rows, basis in self.drift:
            flat[rows] -= basis @ (basis.T @ flat[rows])
        return flat.reshape(values.shape)


def _sums(group: Integers, flat: Array, n_groups: int) -> Array:
    order = np.argsort(group, kind="stable")
    first = np.searchsorted(group[order], np.arange(n_groups))
    return np.add.reduceat(flat[order], first, axis=0)


def offsets_of(log: Log) -> Offsets:
    """Prepare the offsets of passes and each session's drift."""
    group, session, t = np.unique(log.pass_number, return_inverse=True)[1], log.session, log.t_s
    counts = np.bincount(group).astype(float)
    plain = Offsets(group, counts, ())
    drift = []
    for one in np.unique(session):
        rows = np.flatnonzero(session == one)
        smooth = np.zeros((len(t), N_DRIFT))
        smooth[rows] = spline_columns(t[rows], t[rows].min(), t[rows].max(), N_DRIFT)
        left, size, _ = np.linalg.svd(plain.removed(smooth)[rows], full_matrices=False)
        drift.append((rows, left[:, size > 1e-8 * max(size[0], 1.0)]))
    return Offsets(group, counts, tuple(drift))


class Projection:
    """Projects displacements off base and poses and, with `with_offsets`, off offsets and drift."""

    def __init__(self, log: Log, *, with_offsets: bool, base: Array | None = None) -> None:
        self._offsets = offsets_of(log) if with_offsets else None
        columns = base_columns(log) if base is None else base
        columns = self._without_offsets(np.concatenate([columns, pose_columns(log)], axis=2))
        flat = columns.reshape(-1, columns.shape[2])
        size = np.sqrt(np.einsum("ij,ij->j", flat, flat))
        self._columns = flat[:, size > 1e-9 * size.max()] / size[size > 1e-9 * size.max()]
        values, vectors = np.linalg.eigh(self._columns.T @ self._columns)
        keep = values > _RANK_TOLERANCE * values[-1]
        self._inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
        self.rank = int(keep.sum())
        self.n_offsets = (
            0
            if self._offsets is None
            else 3 * (len(self._offsets.counts) + sum(basis.shape[1] for _, basis in self._offsets.drift))
        )

    def _without_offsets(self, values: Array) -> Array:
        return values if self._offsets is None else self._offsets.removed(values)

    def __call__(self, displacement_mm: Array) -> Array:
        """Give what is left of (n, 3) displacements (or (n, 3, k)), base axes."""
        left = self._without_offsets(displacement_mm)
        flat = left.reshape(3 * len(left), -1)
        # Twice: the normal equations lose digits, the second round brings them back.
        for _ in range(2):
            flat = flat - self._columns @ (self._inverse @ (self._columns.T @ flat))
        return flat.reshape(left.shape)


def rms_um(left_mm: Array) -> Array:
    """RMS by component (3,) in µm, over all rows."""
    return np.asarray(1e3 * np.sqrt(np.mean(left_mm**2, axis=0)))
