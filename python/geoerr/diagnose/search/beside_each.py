"""What candidates gain in the noise beside each: where noise had learnt what one does, it forgives another too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.settle import Settled, resettle
from geoerr.diagnose.space import Space
from geoerr.diagnose.ties import z_by_pieces
from geoerr.fit.noise_model import NoiseModel
from geoerr.fit.sightings import Numbers

# Noise and inner parameters are estimated one after the other so many times.
_TIMES = 2


def vuong(space: Space, first: Numbers, second: Numbers) -> float:
    """Give Vuong's statistic by pass: how surely the first displacement (n, 3) is the better of two."""
    own, others = (((space.residual - one) ** 2).sum(axis=1) for one in (first, second))
    return z_by_pieces(own, others, space.pass_number, space.n_passes)


class BesideEach:
    """Compares candidates by the likelihood, the noise estimated anew beside each.

    The noise of a look was estimated beside what was found before: scatter, offsets of passes and a drift hold what
    is yet to be named. In units of so much noise half of an effect is hardly less than all of it.

    Parameters
    ----------
    added
        Columns (n, 3, k) of what was found before.
    """

    def __init__(self, bench: Bench, added: Sequence[Numbers]) -> None:
        self.bench, self.added = bench, tuple(added)
        self._best: tuple[Settled, _Anew] | None = None

    def behind(self, best: Settled, other: Settled) -> tuple[float, float]:
        """Give by how much less twice the logarithm of the likelihood rises with another, and Vuong's statistic.

        The latter by passes, both estimated in the noise beside the best.
        """
        first, second = self._of_best(best), self._anew(other)
        space = self.bench.space_to_estimate_in(first.noise, self.added)
        scanner = self.bench.scanner(space, n_draws=0)
        own, others = (resettle(space, scanner, one.settled).displacement for one in (first, second))
        return first.twice_log_likelihood - second.twice_log_likelihood, vuong(space, own, others)

    def behind_with(self, best: Settled, columns: Numbers) -> float:
        """Give by how much less twice the logarithm of the likelihood rises with columns (n, 3, k)."""
        return self._of_best(best).twice_log_likelihood - 2.0 * self._noise(columns).log_likelihood

    def _of_best(self, best: Settled) -> _Anew:
        if self._best is None or self._best[0] is not best:
            self._best = best, self._anew(best)
        return self._best[1]

    def _anew(self, settled: Settled) -> _Anew:
        """Estimate noise and inner parameters in turn: those that fit into much noise do not fit beside it."""
        found = [_Anew(settled, self._noise(settled.of_coefficients))]
        assert settled.term is not None
        for _ in range(_TIMES if any(one.std > 0.0 for one in settled.term.inner) else 0):
            space = self.bench.space_to_estimate_in(found[-1].noise, self.added)
            again = resettle(space, self.bench.scanner(space, n_draws=0), found[-1].settled)
            found.append(_Anew(again, self._noise(again.of_coefficients)))
        return max(found, key=lambda one: one.twice_log_likelihood)

    def _noise(self, columns: Numbers) -> NoiseModel:
        return self.bench.sums([*self.added, columns]).fit(restricted=False, start=self.bench.noise)


@dataclass(frozen=True, eq=False)
class _Anew:
    """A candidate, and the noise that was estimated beside it."""

    settled: Settled
    noise: NoiseModel

    @property
    def twice_log_likelihood(self) -> float:
        return 2.0 * self.noise.log_likelihood
