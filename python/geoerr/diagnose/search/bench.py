"""What a search works on: a fit, the effects added so far, and the space that they leave."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from geoerr.diagnose.functions import Functions
from geoerr.diagnose.held_out_after import HeldOutAfter
from geoerr.diagnose.null import N_DRAWS
from geoerr.diagnose.scan import Scanner
from geoerr.diagnose.space import (
    Channels,
    Doubt,
    Space,
    beyond,
    doubt_that_counts,
    freedom_of,
    noise_sums,
    scatter_of,
    whitened_space,
)
from geoerr.fit import has_covariates
from geoerr.fit.fitted import Fitted
from geoerr.fit.noise_model import NoiseModel, NoiseSums
from geoerr.fit.sightings import Numbers
from geoerr.fit.waves_in_time import WavesInTime
from geoerr.terms import Term


class Bench:
    """A fit, the effects added so far, and the space that they leave.

    `explained` (n, 3) is what an earlier search explained of the fit's residual, as `whitened_space` takes it;
    `left_out` (n,) tells rows that do not count, besides those that the fit does not use; `doubt` (n, 3, k) how far a
    model that is given may be off (`own_doubt`); `n_searches` in how many searches chance may be seen (`Null`).
    """

    def __init__(
        self,
        fitted: Fitted,
        functions: Functions,
        *,
        names: Sequence[str],
        explained: Numbers | None = None,
        left_out: np.ndarray | None = None,
        doubt: Numbers | None = None,
        n_searches: int = 1,
        threads: int = 0,
    ) -> None:
        self.fitted, self.functions, self.names, self.threads = fitted, functions, tuple(names), threads
        self.explained, self.doubt, self.n_searches = explained, doubt, n_searches
        solved = fitted.solved
        used = solved.used if left_out is None else solved.used & ~left_out
        self.rows = (fitted.sightings.is_measured & used[:, None]).astype(np.float64)
        self.base = freedom_of(fitted, used, threads=threads)
        self.channels = Channels(fitted, self.rows, threads=threads)
        self.channels.need(self.names)
        self.noise: NoiseModel | None = None
        self._last_sums: tuple[tuple[Numbers, ...], NoiseSums] | None = None
        self._of_last_look: Scanner | None = None
        self.waves = WavesInTime(fitted.sightings)

    def without(self, left_out: np.ndarray) -> Bench:
        """Give the same on fewer rows: `left_out` (n,) tells which no longer count; the held-out error is of all."""
        bench = Bench(
            self.fitted,
            self.functions,
            names=self.names,
            explained=self.explained,
            left_out=left_out | ~self.rows.any(axis=1),
            doubt=self.doubt,
            n_searches=self.n_searches,
            threads=self.threads,
        )
        bench.noise, bench.held_out = self.noise, self.held_out
        return bench

    def lacks(self, term: Term) -> np.ndarray:
        """Tell which rows count, and have not what a term needs, (n,): what it does there nobody can say."""
        known = has_covariates(self.fitted.machine, self.fitted.sightings, [term])
        return np.asarray(self.rows.any(axis=1) & ~known)

    def scanner(self, space: Space, *, n_draws: int = N_DRAWS) -> Scanner:
        """Give a space in the form in which the core multiplies it."""
        return Scanner(space, self.channels, self.functions, names=self.names, n_draws=n_draws, threads=self.threads)

    def scanner_of_look(self, space: Space) -> Scanner:
        """Give the same for a look; the scene that the look before it kept is let go."""
        if self._of_last_look is not None:
            self._of_last_look.let_go()
        self._of_last_look = self.scanner(space)
        return self._of_last_look

    def let_go(self) -> None:
        """Let go of what is kept because it may be asked for again."""
        self._last_sums = None
        for name in ("held_out", "_base_sums"):
            self.__dict__.pop(name, None)

    @cached_property
    def held_out(self) -> HeldOutAfter:
        """The held-out error with more in the model."""
        return HeldOutAfter(self.fitted, self.base, self.rows)

    @cached_property
    def _base_sums(self) -> NoiseSums:
        return noise_sums(self.fitted, self.rows, self._taken, threads=self.threads)

    @cached_property
    def _own_doubt(self) -> Numbers | None:
        """What of the doubt is seen in the rows that count."""
        if self.doubt is None:
            return None
        scatter = scatter_of(self.fitted, self.rows)
        columns = doubt_that_counts(self.doubt * self.rows[:, :, None], self.base, scatter)
        return columns if columns.shape[2] else None

    @cached_property
    def _taken(self) -> Numbers:
        """What the noise is estimated beside: all that is free, and all that a given model may be off by."""
        if self._own_doubt is None:
            return self.base
        new = beyond(*(one.reshape(-1, one.shape[2]) for one in (self.base, self._own_doubt)))
        return np.concatenate([self.base, new.reshape(*self.rows.shape, -1)], axis=2)

    def _doubt_beside(self, added: Sequence[Numbers]) -> Doubt | None:
        return (
            None if self._own_doubt is None else Doubt(self._own_doubt, np.concatenate([self.base, *added], axis=2))
        )

    def sums(self, added: Sequence[Numbers]) -> NoiseSums:
        """Give what the likelihood of the noise depends on, with the model and what was added in its basis."""
        if not added:
            return self._base_sums
        if self._last_sums is None or not _are_the_same(self._last_sums[0], added):
            self._last_sums = tuple(added), self._sums_with(added)
        return self._last_sums[1]

    def _sums_with(self, added: Sequence[Numbers]) -> NoiseSums:
        columns = np.concatenate(added, axis=2)
        new = beyond(*(one.reshape(-1, one.shape[2]) for one in (self._taken, columns)))
        return self._base_sums.with_columns(new.reshape(*self.rows.shape, -1))

    def space(self, added: Sequence[Numbers]) -> Space:
        """Give the space that the model and what was added leave, the noise estimated anew."""
        sums = self.sums(added)
        self.noise = sums.fit(start=self.noise)
        return self.space_in(self.noise, added)

    def space_in(self, noise: NoiseModel, added: Sequence[Numbers]) -> Space:
        """Give the space that the model and what was added leave, in this noise."""
        doubt = self._doubt_beside(added)
        return whitened_space(self.fitted, noise, self.rows, self.sums(added), explained=self.explained, doubt=doubt)

    def space_to_estimate_in(self, noise: NoiseModel, added: Sequence[Numbers]) -> Space:
        """Give the space that the model and what was added leave, in this noise, as it was measured."""
        doubt = self._doubt_beside(added)
        return whitened_space(self.fitted, noise, self.rows, self.sums(added), is_winsorised=False, doubt=doubt)


def _are_the_same(first: Sequence[Numbers], second: Sequence[Numbers]) -> bool:
    return len(first) == len(second) and all(a is b for a, b in zip(first, second, strict=True))
