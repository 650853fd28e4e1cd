"""Which terms of a model are not worth correcting: there a correction adds more uncertainty than it takes error away.

A correction û = e + ε of an error e leaves −ε of it: it pays where |e|² > E|ε|². Terms that were fitted together are
uncertain together: a scale and a thermal growth may each be poorly known, and their sum well. With c_a the terms'
contributions, G_ab = mean c_a·c_b and M_ab = mean tr Cov(c_a, c_b), a correction by all terms leaves a mean square of
Σ M; leaving out a set L and correcting by the others, K, leaves

    Σ_LL G + Σ_KK M,

if what is left out is as large as it looks. The set is taken for which that is least: by taking terms out one after
the other from all of them, and by putting them in from none. Two things keep it from doing harm by chance, for among
many sets there are always some whose noise happens to cancel: what is left out counts as large as it looks, although
its own noise E|ε|² makes it look larger; and a term that alone can be told from 0 (|û|² > 2 E|ε|², as Akaike's
criterion has it) is never left out. One term by itself goes where its correction is smaller than its own standard
uncertainty.

Means are over the measured volume and both directions of approach, not over one program: two programs for one part
are corrected alike. Verified in tests/model/test_worth.py by drawing estimates and counting the mean square that is
left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.model.arrays import Numbers
from geoerr.model.conditions import OF_MOTION, Conditions
from geoerr.model.model import Model

_N_PLACES = 256
# Two states of motion, alternating from place to place: after a long stroke at rest, and early in a quick one.
_MOTION = {"d": (1.0, -1.0), "s": (100.0, 1.0), "v": (0.0, -20.0), "feed": (600.0, 1200.0)}
# A correction whose square is below this many of its variances cannot be told from none.
_TOLD_FROM_0 = 2.0
# Differences of mean squares below this share of them are rounding.
_ROUNDING = 1e-9
_UM_PER_MM = 1e3


@dataclass(frozen=True)
class UncertainTerm:
    """A term that is not worth correcting, beside its root mean square over the measured volume.

    Attributes
    ----------
    id
        Of the term.
    rms_um
        Of its contribution to the predicted error.
    std_um
        Of that contribution's standard uncertainty.
    """

    id: str
    rms_um: float
    std_um: float

    def __str__(self) -> str:
        """Give it as a list names it."""
        return f"{self.id} ({self.rms_um:.3g} ± {self.std_um:.3g} µm)"


def spread_places(spans: Sequence[tuple[float, float]], n_places: int = _N_PLACES) -> Numbers:
    """Give places (n, 3) spread evenly over a box, no two with a coordinate in common: no wave hides between them."""
    # Roots of x⁴ = x + 1: the sequence that fills a cube most evenly (Roberts 2018).
    ratio = 1.2207440846057596
    share = (0.5 + np.arange(1, n_places + 1)[:, None] * ratio ** -np.arange(1.0, 4.0)) % 1.0
    low, high = np.array(spans).T
    return np.asarray(low + share * (high - low))


def both_motions(n_places: int) -> dict[str, Numbers]:
    """Give the conditions of motion for places (n,): the two states in turn, on the move."""
    turn = np.arange(n_places) % 2
    states = {name: _MOTION[name if name in _MOTION else name.partition("_")[0]] for name in OF_MOTION}
    return {name: np.array(state)[turn] for name, state in states.items()} | {"moving": np.ones(n_places)}


def uncertain_terms(model: Model, at: Conditions | None = None, *, threads: int = 0) -> tuple[UncertainTerm, ...]:
    """Name the terms of the machine that are better left out of a correction, in the model's order.

    Parameters
    ----------
    model
        A fitted model; one without a record, or without values, has none.
    at
        Conditions of the correction; direction, travel, speed and feed may be left out.
    threads
        0 = all cores.
    """
    spans = model.measured_box_mm
    if model.record is None or not model.machine_terms or any(low > high for low, high in spans):
        return ()
    places = spread_places(spans)
    conditions = {**both_motions(len(places)), **(at or {})}
    moments = model.contribution_moments_mm2(places, at=conditions, threads=threads)
    left_out = _left_out(*moments)
    return tuple(
        UncertainTerm(
            term.id,
            _UM_PER_MM * float(np.sqrt(moments[0][number, number])),
            _UM_PER_MM * float(np.sqrt(moments[1][number, number])),
        )
        for number, term in enumerate(model.machine_terms)
        if left_out[number]
    )


def well_known(
    model: Model, at: Conditions | None = None, *, threads: int = 0
) -> tuple[Model, tuple[UncertainTerm, ...], dict[str, npt.ArrayLike | str]]:
    """Give the model without its uncertain terms, these terms, and the conditions that the rest still follows."""
    uncertain = uncertain_terms(model, at, threads=threads)
    rest = model.without_terms(term.id for term in uncertain)
    return rest, uncertain, {name: value for name, value in (at or {}).items() if name in rest.conditions}


def left_mm2(products: Numbers, covariance: Numbers, out: npt.NDArray[np.bool_]) -> float:
    """Give the mean square that is left where the terms `out` (k,) stay, if these are as large as they look."""
    kept = ~out
    return float(products[np.ix_(out, out)].sum() + covariance[np.ix_(kept, kept)].sum())


def _left_out(products: Numbers, covariance: Numbers) -> npt.NDArray[np.bool_]:
    """Tell which terms (k,) to leave out."""
    can_go = np.diagonal(products) < _TOLD_FROM_0 * np.diagonal(covariance)
    rounding = _ROUNDING * float(np.trace(products) + np.trace(covariance))

    def left(out: npt.NDArray[np.bool_]) -> float:
        return left_mm2(products, covariance, out)

    def descended(out: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Move one term after the other to the other side, each once, while that helps."""
        movable = can_go.copy()
        while True:
            trials = [out ^ (np.arange(len(out)) == number) for number in np.flatnonzero(movable)]
            values = [left(trial) for trial in trials]
            if not values or min(values) >= left(out) - rounding:
                return out
            chosen = trials[int(np.argmin(values))]
            movable &= chosen == out
            out = chosen

    taken_out, put_in = descended(np.zeros(len(can_go), dtype=bool)), descended(can_go)
    return put_in if left(put_in) < left(taken_out) - rounding else taken_out
