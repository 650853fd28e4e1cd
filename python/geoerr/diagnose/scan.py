"""How much each candidate explains beyond a model, exactly and without refits, and pass by pass.

| symbol | code | what |
|---|---|---|
| D_p | `Channels` | whitened displacement of each row by one unit on the channel of part p |
| f_p | `Shapes.values` | columns of the formula of part p: all that a trial value changes |
| Q, r | `Space` | what the model is free to do, and what it leaves, in the metric of the noise |
| V^(-1/2) = σ⁻¹(I + U (T − I) Uᵀ) | `NoiseModel` | the whitening |

With the columns B = Σ_p D_p f_p of a candidate and b = UᵀB the information beyond the model is
BᵀV⁻¹B − (QᵀV^(-1/2)B)ᵀ(…) = Σ f_p (D_p·D_q) f_q − bᵀb + (T b)ᵀ(T b) − …; the gain, by which the sum of squares
falls on adding B and refitting everything, is sᵀ I⁻¹ s with the scores s = Bᵀ V^(-T/2) r.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from geoerr.diagnose.candidates import Shapes
from geoerr.diagnose.space import Channels, Space
from geoerr.fit.sightings import Numbers

# Directions of which the model leaves a smaller share are the model's own: nothing can be said of them.
OWNED = 0.002
# Directions of a group of columns below this share of the largest are no directions of their own.
_DEPENDENT = 1e-8
# Numbers of one block of trials: 32 MB.
_BLOCK = 4_000_000


@dataclass(frozen=True, eq=False)
class Scanned:
    """A group of columns at all its trials.

    Attributes
    ----------
    gain : (n_trials,)
        Fall of the sum of squares.
    rank : (n_trials,)
        Directions that the model does not own.
    by_pass : (n_trials, k, n_passes)
        Scores of each pass that the model did not see, in orthonormal directions; 0 beyond the rank.
    estimate : (n_trials, k), root : (n_trials, k, k)
        Coefficients, and F with their covariance F Fᵀ.
    share : (n_trials,)
        What the model leaves of the candidate's information, of its best direction.
    share_of_level : (n_trials,)
        What the noise leaves of the candidate's information: near 0 for what looks like drift.
    """

    gain: Numbers
    rank: np.ndarray
    by_pass: Numbers
    estimate: Numbers
    root: Numbers
    share: Numbers
    share_of_level: Numbers


class Scanner:
    """Sums over rows that no candidate changes, made once for each channel."""

    def __init__(self, space: Space, channels: Channels) -> None:
        self.space, self.channels = space, channels
        noise = space.noise
        n_blocks = len(noise.blocks)
        self.n_blocks = n_blocks
        self._known: dict[str, tuple[Numbers, Numbers, Numbers, Numbers]] = {}
        unseen = space.unseen
        n_passes = space.n_passes
        member = sparse.csr_array(
            (np.ones(len(unseen)), (space.pass_number, np.arange(len(unseen)))), shape=(n_passes, len(unseen))
        )
        self.member = member
        r = space.basis.shape[2]
        self.pass_inside = np.zeros((n_passes, r))
        for c in range(3):
            self.pass_inside += member @ (space.basis[:, c] * unseen[:, c, None])
        # What a pass's scores owe to blocks before it: (T − I)ᵀ Uᵀ r̃, a column for each pass.
        carried = np.zeros((3 * n_blocks, n_passes))
        blocks = np.arange(n_blocks)
        for c in range(3):
            own = np.zeros((n_blocks, n_passes))
            own[blocks, noise.blocks.pass_number] = noise.unit[c].T @ unseen[:, c]
            carried[c * n_blocks : (c + 1) * n_blocks] = noise.less_one(c, own, transposed=True)
        self.carried = np.ascontiguousarray(carried.T)

    def _sums(self, channel: str) -> tuple[Numbers, Numbers, Numbers, Numbers]:
        """Give the direction over σ (n, 3), its products with Q (n, r), r (n,) and the unseen residual (n,)."""
        if channel not in self._known:
            space = self.space
            raw = self.channels[channel]
            inside = np.einsum("nc,ncr->nr", raw, space.basis_back)
            pull = (raw * space.residual_back).sum(axis=1)
            scaled = raw / space.noise.sigma
            self._known[channel] = (scaled, inside, pull, (scaled * space.unseen).sum(axis=1))
        return self._known[channel]

    def scan(self, shapes: Shapes, values: Numbers | None = None) -> Scanned:
        """Scan a group at all its trials, or at other values (n_trials, n_columns, n_sets)."""
        values = shapes.values if values is None else values
        step = max(_BLOCK // max(values.shape[1] * values.shape[2], 1), 1)
        parts = [self._scan(shapes, values[at : at + step]) for at in range(0, len(values), step)]
        return Scanned(
            *(np.concatenate([getattr(one, name) for one in parts]) for name in Scanned.__dataclass_fields__)
        )

    def _scan(self, shapes: Shapes, values: Numbers) -> Scanned:
        space = self.space
        n_trials, _, n_sets = values.shape
        k, r, n_passes = shapes.n_coefficients, space.basis.shape[2], space.n_passes
        place, n = shapes.place, len(shapes.place)
        to_sets = sparse.csr_array((np.ones(n), (place, np.arange(n))), shape=(n_sets, n))
        sums = [self._sums(channel) for channel, _ in shapes.channels]
        factors = [factor for _, factor in shapes.channels]
        inside_sets = [factor * (to_sets @ own[1]) for factor, own in zip(factors, sums, strict=True)]
        pull_sets = [factor * np.bincount(place, own[2], n_sets) for factor, own in zip(factors, sums, strict=True)]
        pass_sets, block_sets = [], []
        for factor, own in zip(factors, sums, strict=True):
            pass_sets.append(
                sparse.csr_array((factor * own[3], (space.pass_number, place)), shape=(n_passes, n_sets))
            )
            rows = np.concatenate([c * self.n_blocks + space.noise.blocks.block for c in range(3)])
            weights = np.concatenate([factor * own[0][:, c] * space.noise.unit[c].data for c in range(3)])
            block_sets.append(
                sparse.csr_array((weights, (rows, np.tile(place, 3))), shape=(3 * self.n_blocks, n_sets))
            )
        score = np.zeros((n_trials, k))
        raw = np.zeros((n_trials, k, k))
        inside = np.zeros((n_trials, k, r))
        level = np.zeros((n_trials, k, 3 * self.n_blocks))
        by_pass = np.zeros((n_trials, k, n_passes))
        for column, (part, coefficient) in enumerate(shapes.columns):
            f = np.ascontiguousarray(values[:, column])
            score[:, coefficient] += f @ pull_sets[part]
            inside[:, coefficient] += f @ inside_sets[part]
            level[:, coefficient] += (block_sets[part] @ f.T).T
            by_pass[:, coefficient] += (pass_sets[part] @ f.T).T
        weights_of: dict[tuple[int, int], Numbers] = {}
        for a, (p, i) in enumerate(shapes.columns):
            for b, (q, j) in enumerate(shapes.columns[a:], start=a):
                if (p, q) not in weights_of:
                    product = factors[p] * factors[q] * (sums[p][0] * sums[q][0]).sum(axis=1)
                    weights_of[p, q] = np.asarray(np.bincount(place, product, n_sets), dtype=np.float64)
                both = np.einsum("tn,tn,n->t", values[:, a], values[:, b], weights_of[p, q], optimize=True)
                raw[:, i, j] += both
                if b > a:
                    raw[:, j, i] += both
        carried = level.reshape(-1, 3, self.n_blocks)
        after = np.empty_like(carried)
        for c in range(3):
            after[:, c] = carried[:, c] + space.noise.less_one(c, np.ascontiguousarray(carried[:, c].T)).T
        after = after.reshape(level.shape)
        noisy = raw - level @ level.transpose(0, 2, 1) + after @ after.transpose(0, 2, 1)
        by_pass += level @ self.carried.T - inside @ self.pass_inside.T
        beyond = noisy - inside @ inside.transpose(0, 2, 1)
        return _judged(raw, noisy, beyond, score, by_pass)


def _judged(raw: Numbers, noisy: Numbers, beyond: Numbers, score: Numbers, by_pass: Numbers) -> Scanned:
    """Take the directions that the model does not own, and what they gain."""
    k = raw.shape[1]
    size = np.sqrt(np.maximum(np.einsum("tkk->tk", noisy), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    value, vector = np.linalg.eigh(noisy / (size[:, :, None] * size[:, None, :]))
    kept = value > _DEPENDENT * k
    # Columns that make the candidate's own information the unit.
    unit = vector / size[:, :, None] * np.where(kept, 1.0 / np.sqrt(np.maximum(value, 1e-300)), 0.0)[:, None, :]
    share, turn = np.linalg.eigh(unit.transpose(0, 2, 1) @ beyond @ unit)
    seen = share > OWNED
    root = unit @ turn * np.where(seen, 1.0 / np.sqrt(np.maximum(share, 1e-300)), 0.0)[:, None, :]
    along = np.einsum("tki,tk->ti", root, score)
    gain = (along**2).sum(axis=1)
    trace_raw = np.einsum("tkk->t", raw / (size[:, :, None] * size[:, None, :]))
    return Scanned(
        gain=gain,
        rank=seen.sum(axis=1),
        by_pass=root.transpose(0, 2, 1) @ by_pass,
        estimate=np.einsum("tki,ti->tk", root, along),
        root=root,
        share=np.where(seen.any(axis=1), share[:, -1], 0.0),
        share_of_level=k / np.maximum(trace_raw, 1e-300),
    )


def columns_of(space: Space, channels: Channels, shapes: Shapes, values: Numbers) -> Numbers:
    """Give a group's columns at one trial's values (n_columns, n_sets), whitened, off the model: (n, 3, k)."""
    raw = raw_columns(channels, shapes, values)
    whitened = space.noise.whiten(raw)
    basis = space.basis.reshape(-1, space.basis.shape[2])
    flat = whitened.reshape(len(basis), -1)
    return np.asarray((flat - basis @ (basis.T @ flat)).reshape(raw.shape))


def raw_columns(channels: Channels, shapes: Shapes, values: Numbers) -> Numbers:
    """Give a group's columns in units of the stated uncertainties, (n, 3, k)."""
    result = np.zeros((len(shapes.place), 3, shapes.n_coefficients))
    for (part, coefficient), column in zip(shapes.columns, values, strict=True):
        channel, factor = shapes.channels[part]
        result[:, :, coefficient] += factor * channels[channel] * column[shapes.place][:, None]
    return result


def all_channels(groups: Sequence[Shapes]) -> list[str]:
    """Give every channel that some group uses."""
    return list(dict.fromkeys(channel for one in groups for channel, _ in one.channels))
