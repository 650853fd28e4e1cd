"""How much each candidate explains beyond a model, exactly and without refits.

The sums over rows are the core's (`geoerr_core::candidates`, whose head has the equations): in single precision for
the ranking of all candidates, with what chance alone finds beside it; in double precision for one candidate at a few
values of its inner parameters. The columns of a candidate that is looked at closely are made here.

| symbol | code | what |
|---|---|---|
| D_p | `Channels` | whitened displacement of each row by one unit on the channel of part p |
| f_p | `Functions` | columns of the formula of part p: all that a trial value changes |
| Q, r | `Space` | what the model is free to do, and what it leaves, in the metric of the noise |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoerr import _core
from geoerr.diagnose.candidates import Shapes
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.null import N_DRAWS
from geoerr.diagnose.space import Channels, NumbersOfDraws, Space, independent, lengths
from geoerr.fit.owned import OWNED
from geoerr.fit.sightings import Numbers

# Directions of a group of columns below this share of the largest are no directions of their own. The core's.
_DEPENDENT = 1e-8
# A coefficient has a part in a direction of unit length if it is more than this.
_A_PART = 0.05


@dataclass(frozen=True, eq=False)
class Scanned:
    """A group of columns at all its trials.

    Attributes
    ----------
    gain : (n_trials,)
        Fall of the sum of squares.
    rank : (n_trials,)
        Directions that the model does not own.
    share : (n_trials,)
        What the model leaves of the candidate's information, of its best direction.
    largest : (n_coefficients + 1, n_draws)
        By rank: the largest gain of each draw of noise over all trials of that rank; −1 for none.
    """

    gain: Numbers
    rank: np.ndarray
    share: Numbers
    largest: Numbers


class Scanner:
    """A space in the form in which the core multiplies it."""

    def __init__(
        self,
        space: Space,
        channels: Channels,
        functions: Functions,
        *,
        names: Sequence[str],
        n_draws: int = N_DRAWS,
        threads: int = 0,
    ) -> None:
        self.space, self.channels, self.functions, self.threads = space, channels, functions, threads
        channels.need(names)
        self.names = {name: number for number, name in enumerate(names)}
        self.directions = np.ascontiguousarray(
            np.stack([channels[name].T for name in names]) if names else np.zeros((0, 3, len(space.rows)))
        )
        self.n_draws = n_draws

    @cached_property
    def double(self) -> _core.CandidateScene:
        """Without draws, in double precision."""
        return self._scene(None)

    def __getstate__(self) -> dict[str, object]:
        """Pickle without what is made anew if need be."""
        return {name: value for name, value in self.__dict__.items() if name != "double"}

    def let_go(self) -> None:
        """Let go of what is kept to judge in double precision: it is made anew if need be."""
        self.__dict__.pop("double", None)

    def _scene(self, draws: NumbersOfDraws | None) -> _core.CandidateScene:
        space = self.space
        basis, residual = np.ascontiguousarray(space.basis), np.ascontiguousarray(space.residual)
        return _core.CandidateScene(basis, residual, draws, self.directions, space.noise.whitening, self.threads)

    def scan(self, shapes: Sequence[Shapes]) -> list[Scanned]:
        """Judge groups at all their trials in single precision, and draws of noise with them."""
        draws = self.space.draws(self.n_draws, threads=self.threads)
        # Not kept: of many rows it is hundreds of megabytes, and everything is judged in one call.
        return self._scanned(self._scene(np.ascontiguousarray(draws.transpose(1, 2, 0))), shapes)

    def exact(self, shapes: Shapes) -> Scanned:
        """Judge one group at all its trials in double precision, without draws."""
        return self._scanned(self.double, [shapes])[0]

    def _scanned(self, scene: _core.CandidateScene, shapes: Sequence[Shapes]) -> list[Scanned]:
        groups = [
            (
                one.codes,
                np.array([self.names[one.channels[part][0]] for part, _ in one.columns], dtype=np.int64),
                np.array([one.channels[part][1] for part, _ in one.columns], dtype=np.float64),
                np.array([coefficient for _, coefficient in one.columns], dtype=np.int64),
                one.n_coefficients,
            )
            for one in shapes
        ]
        return [Scanned(*found) for found in self.functions.scan(scene, groups, self.threads)]

    def raw_columns(self, shapes: Shapes, trial: int) -> Numbers:
        """Give a group's columns at one trial in units of the stated uncertainties, (n, 3, k)."""
        return raw_columns(self.channels, shapes, self.functions.values(shapes.codes[trial]))


@dataclass(frozen=True, eq=False)
class Seen:
    """Columns as a space sees them.

    Attributes
    ----------
    whitened : (3 n, k)
        In the metric of the noise.
    inside : (r, k)
        Their products with the model's basis.
    """

    whitened: Numbers
    inside: Numbers

    def beside(self, other: Seen) -> Seen:
        """Give the columns of both."""
        return Seen(np.hstack([self.whitened, other.whitened]), np.hstack([self.inside, other.inside]))

    @cached_property
    def gram(self) -> Numbers:
        """Products with each other, (k, k)."""
        return np.asarray(self.whitened.T @ self.whitened)

    @property
    def gram_beyond(self) -> Numbers:
        """Products with each other of what the model leaves of them, (k, k)."""
        return np.asarray(self.gram - self.inside.T @ self.inside)

    def score(self, space: Space) -> Numbers:
        """Give the products with the residual, (k,)."""
        return np.asarray(self.whitened.T @ space.residual.reshape(-1))

    @cached_property
    def root(self) -> Numbers:
        """F (k, m) with the covariance F Fᵀ of coefficients beside the model, without directions that it owns."""
        unit = independent(self.gram, _DEPENDENT * len(self.gram))
        owned = self.inside @ unit
        share, turn = np.linalg.eigh(np.eye(unit.shape[1]) - owned.T @ owned)
        is_seen = share > OWNED
        return np.asarray(unit @ turn[:, is_seen] / np.sqrt(share[is_seen]))

    @property
    def is_open(self) -> np.ndarray:
        """Whether the model can take over a coefficient (k,), in part at least: any will do."""
        size = lengths(self.gram)
        value, vector = np.linalg.eigh(self.gram_beyond / np.outer(size, size))
        # A direction is open as far as what is left of its columns is less than a share of what they are.
        whole = np.einsum("ij,ik,kj->j", vector, self.gram / np.outer(size, size), vector)
        is_open = value <= OWNED * np.maximum(whole, _DEPENDENT)
        return np.asarray((np.abs(vector[:, is_open]) > _A_PART).any(axis=1))

    def first(self, k: int) -> Seen:
        """Give the first columns."""
        return Seen(self.whitened[:, :k], self.inside[:, :k])

    def estimate(self, space: Space) -> tuple[Numbers, Numbers]:
        """Give the coefficients (k,) and the gain; directions that the model owns are left at 0."""
        along = self.root.T @ self.score(space)
        return self.root @ along, np.asarray((along**2).sum())

    def beyond(self, space: Space, coefficients: Numbers) -> Numbers:
        """Give what the model leaves of the columns times coefficients, (k,) or (k, m): (3 n,) or (3 n, m)."""
        basis = space.basis.reshape(len(self.whitened), -1)
        return np.asarray(self.whitened @ coefficients - basis @ (self.inside @ coefficients))

    def beyond_free(self, space: Space, coefficients: Numbers) -> Numbers:
        """As `beyond`, (3 n,), of what is free alone: what a given model may be off by takes nothing away."""
        taken = np.where(space.is_free, self.inside @ coefficients, 0.0)
        return np.asarray(self.whitened @ coefficients - space.basis.reshape(len(self.whitened), -1) @ taken)


def seen(space: Space, raw: Numbers) -> Seen:
    """Whiten columns (n, 3, k), and multiply them with the model's basis."""
    whitened = space.noise.whiten(raw).reshape(-1, raw.shape[2])
    basis = space.basis.reshape(len(whitened), -1)
    return Seen(whitened, _core.products_of_columns(basis, whitened, space.noise.threads).T)


def off_model(space: Space, raw: Numbers) -> Numbers:
    """Whiten columns (n, 3, k) and take off what the model can do."""
    return seen(space, raw).beyond(space, np.eye(raw.shape[2])).reshape(raw.shape)


def estimate(space: Space, raw: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Give the coefficients (k,) of columns (n, 3, k), F (k, m) with their covariance F Fᵀ, and the gain.

    Directions that the model owns are left at 0.
    """
    own = seen(space, raw)
    coefficients, gain = own.estimate(space)
    return coefficients, own.root, gain


def raw_columns(channels: Channels, shapes: Shapes, values: Numbers) -> Numbers:
    """Give columns of functions (n_columns, n) in units of the stated uncertainties, (n, 3, k)."""
    result = np.zeros((values.shape[1], 3, shapes.n_coefficients))
    for (part, coefficient), column in zip(shapes.columns, values, strict=True):
        channel, factor = shapes.channels[part]
        result[:, :, coefficient] += factor * channels[channel] * column[:, None]
    return result


def all_channels(groups: Sequence[Shapes]) -> list[str]:
    """Give every channel that some group uses."""
    return list(dict.fromkeys(channel for one in groups for channel, _ in one.channels))
