"""What does not come back from pass to pass: offsets and drift, which the search takes for noise, with their worth.

No formula stands for it, so that no search names it: what a pass shares is judged as noise, or every slow drift would
be an effect. Where it is larger than what single rows scatter it is the first thing to mend all the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geoerr.diagnose.marker import Rise, rises
from geoerr.diagnose.space import Space
from geoerr.diagnose.where import rms_um, unwhitened_um
from geoerr.diagnose.words import sure_words, um_words
from geoerr.distributions import ranks_of
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES

_SEED = 20_220_814
_N_SHUFFLES = 1999
# Passes of a session that can show a trend.
_FEWEST_PASSES = 5
# Orders of passes that rise or fall as much are as rare.
_SELDOM = 0.05


@dataclass(frozen=True)
class BetweenPasses:
    """What passes have in common beyond the model and what was found, and what rows scatter within them.

    Attributes
    ----------
    worth_um
        Root mean square of offsets and drift as the noise model predicts them, components summed as for errors.
    rows_um
        The same of what is left.
    component
        Along which it is largest.
    trend_p
        That passes in any other order would rise or fall with time as much, by their ranks; None: too few passes.
    trend_um
        How much the straight line through the passes' means rises in a session along `component`, on average.
    of_marker, of_machine
        How much static reference markers and the machine's targets rise so; None where none is in view.
    """

    worth_um: float
    rows_um: float
    component: str
    trend_p: float | None
    trend_um: float | None
    of_marker: Rise | None = None
    of_machine: Rise | None = None

    @property
    def stands_out(self) -> bool:
        """Whether it is larger than what rows scatter."""
        return self.worth_um > self.rows_um

    @property
    def rises(self) -> bool:
        """Whether it rises or falls with time, as passes in any other order seldom would."""
        return self.trend_p is not None and self.trend_p < _SELDOM

    @property
    def short_words(self) -> str:
        """Give it as what a verdict that found nothing counts as noise."""
        what = (self._whose() or "a drift over time") if self.rises else "what differs from pass to pass"
        return f"{what} ({um_words(self.worth_um)} rms) counts as noise"

    def words(self) -> str:
        """Say it, and what would tell where it comes from."""
        text = (
            f"from pass to pass the error differs by {um_words(self.worth_um)} rms, most along {self.component}; "
            f"within a pass rows scatter by {um_words(self.rows_um)}"
        )
        if self.trend_p is None or self.trend_um is None:
            return text
        if not self.rises:
            return f"{text}. It does not rise or fall with time: offsets of passes, not a drift"
        way = "rises" if self.trend_um > 0.0 else "falls"
        whose = self._whose() or "a drift of the machine or of the measuring device"
        return (
            f"{text}. It {way} with time, by {um_words(abs(self.trend_um))} in a session: {whose} "
            f"({sure_words(self.trend_p)}). {self._marker_words()}"
        )

    def _whose(self) -> str | None:
        """Give whose drift it is; None where that is not known."""
        if self.of_marker is None or self.of_machine is None:
            return None
        is_all = self.of_marker.is_that_of(self.of_machine)
        if self.of_marker.is_none:
            return None if is_all else "a drift of the machine"
        return f"a drift of the {'measuring device' if is_all else 'machine and of the measuring device'}"

    def _marker_words(self) -> str:
        if self.of_marker is None or self.of_machine is None:
            return "A fixed reference marker in the view tells which"
        moved = f"{um_words(abs(self.of_marker.um))} (± {um_words(self.of_marker.std_um)})"
        if self.of_marker.is_none and self.of_marker.is_that_of(self.of_machine):
            return f"The fixed marker does not tell which: it moved by {moved}; look at it more often"
        if self.of_marker.is_none:
            return f"The fixed marker stood still while it was measured, within {moved}"
        way = "rose" if self.of_marker.um > 0.0 else "fell"
        if self.of_marker.is_that_of(self.of_machine):
            return f"The fixed marker {way} with it, by {moved}: add camera-drift, and warm the cameras up next time"
        return f"The fixed marker {way} by {moved}: so much is the measuring device's, the rest is the machine's"

    def to_document(self) -> dict[str, Any]:
        """Give it for JSON."""
        return {
            "worth_um": self.worth_um,
            "within_passes_um": self.rows_um,
            "component": self.component,
            "trend_p_value": self.trend_p,
            "trend_um": self.trend_um,
            "marker_um": None if self.of_marker is None else self.of_marker.um,
            "marker_std_um": None if self.of_marker is None else self.of_marker.std_um,
            "stands_out": self.stands_out,
        }


def between_passes(space: Space) -> BetweenPasses:
    """Split what a space leaves into what its passes share and what is each row's own.

    Source: the best linear unbiased prediction, r − σ²V⁻¹r (Robinson, That BLUP is a good thing, Statistical Science
    6 (1991)). Verified in tests/diagnose on offsets that were put in.
    """
    own = space.noise.whiten_transposed(space.residual) * space.noise.sigma**2 * space.rows
    shared = space.noise.unwhiten(space.residual) * space.rows - own
    shared_um = unwhitened_um(space, shared)
    component = int(np.argmax((shared_um**2).sum(axis=0)))
    trend_p, trend_um = _trend(space, shared_um[:, component])
    left_um = unwhitened_um(space, space.noise.unwhiten(space.residual) * space.rows)[:, component]
    used = np.asarray(space.rows.any(axis=1))
    of_marker, of_machine = rises(space.fitted.sightings, used, left_um) or (None, None)
    worth_um = rms_um(space, shared), rms_um(space, own)
    return BetweenPasses(*worth_um, AXES[component], trend_p, trend_um, of_marker, of_machine)


def _trend(space: Space, shared_um: Numbers) -> tuple[float | None, float | None]:
    """Give the chance of such a trend in any other order of passes, and its rise in a session."""
    sightings = space.fitted.sightings
    used = np.flatnonzero(space.rows.any(axis=1))
    count = np.bincount(space.pass_number[used], minlength=space.n_passes)
    total = np.bincount(space.pass_number[used], weights=shared_um[used], minlength=space.n_passes)
    mean = total / np.maximum(count, 1)
    session = np.zeros(space.n_passes, dtype=np.int64)
    session[space.pass_number] = sightings.session
    first = np.full(space.n_passes, len(space.rows))
    np.minimum.at(first, space.pass_number, np.arange(len(space.rows)))
    ranks: list[Numbers] = []
    rises: list[float] = []
    for number in range(len(sightings.sessions)):
        own = np.flatnonzero((session == number) & (count > 0))
        own = own[np.argsort(first[own])]
        if len(own) < _FEWEST_PASSES or np.ptp(mean[own]) == 0.0:
            continue
        ranks.append(ranks_of(mean[own]))
        rises.append(float(np.polyfit(np.linspace(0.0, 1.0, len(own)), mean[own], 1)[0]))
    if not ranks:
        return None, None
    rng = np.random.default_rng(_SEED)
    found = abs(sum(_rising(one) for one in ranks))
    shuffled = np.array([abs(sum(_rising(rng.permutation(one)) for one in ranks)) for _ in range(_N_SHUFFLES)])
    return float((1 + (shuffled >= found).sum()) / (_N_SHUFFLES + 1)), float(np.mean(rises))


def _rising(ranks: Numbers) -> float:
    """Give Spearman's sum: ranks times their place, each from its middle."""
    return float((ranks - ranks.mean()) @ (np.arange(len(ranks)) - 0.5 * (len(ranks) - 1)))
