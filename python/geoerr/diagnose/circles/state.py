"""Everything that the search weighs by: the noise, what is looked for in its metric, gains and evidence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.diagnose.circles.bench import Bench, Group, groups_of
from geoerr.diagnose.circles.causes import Suspect, Way
from geoerr.diagnose.circles.columns import Radii
from geoerr.diagnose.circles.found import Found
from geoerr.diagnose.circles.noise import CAUTION, Noise, blocks_of, fit_noise, orthonormal, scatter_um
from geoerr.diagnose.circles.probes import probes_of
from geoerr.diagnose.circles.runs import Runs
from geoerr.diagnose.space import doubt_that_counts
from geoerr.fit.owned import OWNED
from geoerr.fit.sightings import Numbers

# Family-wise: one half for names, the other for probes.
ALPHA = 0.05
# Ways with more trials than this are waves and jumps.
FEW_TRIALS = 20
# Trials that stand for a cause in the estimate of the noise.
_SHAPES_OF_A_CAUSE = 3


class State:
    """Runs, suspects and probes in the metric of one noise model.

    `noise`, `base` (the set-up, whitened), `base_q` (orthonormal) and `signal` change with `weigh` and `use`.
    """

    def __init__(self, runs: Runs, suspects: Sequence[Suspect]) -> None:
        self.runs, self.suspects, self.probes = runs, tuple(suspects), probes_of(runs)
        self.n = len(runs)
        self.radii = Radii(runs)
        self.groups = groups_of(self.radii, self.suspects)
        self.probe_groups = groups_of(self.radii, self.probes)
        self.n_trials = {number: one.n_trials for number, one in enumerate(self.suspects)}
        self.n_probes = {number: one.n_trials for number, one in enumerate(self.probes)}
        self.blocks = blocks_of(runs)
        self.set_up = orthonormal(runs.set_up_columns)
        self.doubt = _doubt_that_counts(runs, self.set_up)
        self.weigh([])

    def weigh(self, found: Sequence[Found]) -> None:
        """Estimate the noise anew, and bring everything into its metric."""
        shapes = [self.set_up, *(one.columns for one in found)]
        for group in self.groups:
            if group.by_run or group.n_trials > FEW_TRIALS:
                # Waves and jumps are many; what of them is there is added when it is found.
                continue
            some = np.unique(np.linspace(0, group.n_trials - 1, _SHAPES_OF_A_CAUSE).astype(np.int64))
            shapes += [group.columns[:, group.k * trial : group.k * (trial + 1)] for trial in some]
        self.shapes = np.concatenate(shapes, axis=1)
        self.use(self._fitted_noise(self.shapes, CAUTION))
        slices = self.runs.slices
        self.bench = Bench(self.groups, self.n_trials, self.noise, slices)
        self.probe_bench = Bench(self.probe_groups, self.n_probes, self.noise, slices)

    def noise_beside(self, found: Sequence[Found], structure: Numbers, caution: float = CAUTION) -> Noise:
        """Estimate the noise beside causes and columns (n, k) of structure without a name."""
        shapes = np.concatenate([self.shapes, structure, *(one.columns for one in found)], axis=1)
        return self._fitted_noise(shapes, caution)

    def _fitted_noise(self, shapes: Numbers, caution: float) -> Noise:
        """Estimate the noise beside shapes (n, k) and what a given model may be off by, and put that beside it."""
        shapes = np.concatenate([shapes, self.doubt], axis=1)
        return fit_noise(self.runs, self.blocks, self.runs.signal_um, shapes, caution).with_doubt(self.doubt)

    def use(self, noise: Noise) -> None:
        """Bring signal and set-up into the metric of a noise."""
        self.noise = noise
        self.base = noise.whiten(self.set_up)
        self.base_q = orthonormal(self.base)
        self.signal = noise.whiten(self.runs.signal_um)
        # With the cause itself, so that no other takes its place in memory.
        self.known: dict[int, tuple[Found, Numbers]] = {}

    def context(self, found: Sequence[Found]) -> tuple[Numbers, Numbers]:
        """Give the orthonormal basis of set-up and causes, and what they leave, whitened."""
        basis = orthonormal(np.concatenate([self.base, *(self.white(one) for one in found)], axis=1))
        return basis, self.signal - basis @ (basis.T @ self.signal)

    def white(self, one: Found) -> Numbers:
        """Give a cause's columns, whitened, (n, k)."""
        if id(one) not in self.known:
            self.known[id(one)] = (one, self.noise.whiten(one.columns))
        return self.known[id(one)][1]

    def columns(self, group: Group, way: Way, inner: Sequence[float]) -> Numbers:
        """Give the columns of a way at inner parameters between its trials, (n, k)."""
        columns = self.radii.columns_um(way.term, inner)[:, list(group.seen)]
        return self.radii.by_run(columns) if group.by_run else columns

    def gain(self, white: Numbers, basis: Numbers, left: Numbers) -> float:
        """Give the fall of the sum of squares by whitened columns (n, k) beyond a basis that leaves `left`."""
        beyond = white - basis @ (basis.T @ white)
        size = np.linalg.norm(beyond, axis=0)
        kept = size**2 > OWNED * np.maximum(np.linalg.norm(white, axis=0) ** 2, 1e-300)
        if not kept.any():
            return 0.0
        own = orthonormal(beyond[:, kept])
        return float(((own.T @ left) ** 2).sum())

    def evidence(self, one: Found, others: Sequence[Found]) -> tuple[float, float]:
        """Give a cause's evidence and gain with the others in the model."""
        basis, left = self.context(others)
        gain = self.gain(self.white(one), basis, left)
        return 0.5 * gain - self.penalty(one), gain

    def penalty(self, one: Found) -> float:
        """Give what a cause's freedom costs (Schwarz), trial values counted."""
        return float(0.5 * one.columns.shape[1] * np.log(self.n) + np.log(one.n_trials))

    def plain(self, values: Numbers) -> Numbers:
        """Give what the set-up takes of values (n,), every row alike."""
        return np.asarray(self.set_up @ (self.set_up.T @ values))


def _doubt_that_counts(runs: Runs, set_up: Numbers) -> Numbers:
    """Give the directions (n, m) of a given model's doubt that are seen beside set-up and scatter, µm."""
    if not runs.doubt_um.shape[1]:
        return runs.doubt_um
    return doubt_that_counts(runs.doubt_um[:, None], set_up[:, None], scatter_um(runs))[:, 0]
