"""Waves and lost steps, and a rough error of the circle which would pass for one.

A bump, a groove or a step at one place of the circle is the same in every run. Of some hundred waves along an axis
one always does a part of it, and of some hundred moments one lies where a run came by. So what was found among so
many is asked for beside an error of the radius that is as rough as the runs make it, and the same in all of them: the
question that a wave is asked among points (`geoerr.diagnose.search.rough`), with places of the angle for places of an
axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.diagnose.circles.found import Found
from geoerr.diagnose.circles.noise import orthonormal
from geoerr.diagnose.circles.probes import Probe
from geoerr.diagnose.circles.runs import Runs
from geoerr.diagnose.circles.state import FEW_TRIALS, State
from geoerr.diagnose.search.rough import ROUGH_SIZES, rough_covariances, rough_evidence
from geoerr.diagnose.ties import LEAST_DIFFERENCE
from geoerr.fit.sightings import Numbers

# Between the middles of so many cells of a turn an error runs straight.
_N_CELLS = 100
# Likelier than a rough error by odds that are something.
_LIKELIER = 0.5 * LEAST_DIFFERENCE


def without_rough(state: State, found: Sequence[Found]) -> tuple[list[Found], list[Found]]:
    """Give causes without waves and lost steps that are no likelier than a rough error; and those, unlikeliest first.

    What each run has for itself (a vibration) no error that is the same in all runs does.
    """
    kept, dropped = list(found), list[Found]()
    while True:
        more = [
            _more(state, one, kept) if one.n_trials > FEW_TRIALS and not one.judged.group.by_run else math.inf
            for one in kept
        ]
        if not more or min(more) > _LIKELIER:
            return kept, dropped
        dropped.append(kept.pop(int(np.argmin(more))))


def as_unknown(state: State, found: Sequence[Found], dropped: Sequence[Found]) -> tuple[Probe, float, Numbers]:
    """Give the likeliest rough error beside causes as structure without a name: what chance does not explain is told.

    Its probability is that of the name that it would have had, its µm in every row are those to expect.
    """
    places = _at_places(state.runs)
    basis, left = state.context(found)
    white = state.noise.whiten(places)
    white -= basis @ (basis.T @ white)
    likeliest, value = -math.inf, np.zeros(places.shape[1])
    for covariance in _covariances(state.runs):
        size, turn = np.linalg.eigh(covariance)
        root = turn * np.sqrt(np.maximum(size, 0.0))
        own, seen, back = np.linalg.svd(white @ root, full_matrices=False)
        along = own.T @ left
        for variance in ROUGH_SIZES / max(float(np.mean(seen**2)), 1e-300):
            share = variance * seen**2 / (1.0 + variance * seen**2)
            evidence = 0.5 * float((share * along**2 - np.log1p(variance * seen**2)).sum())
            if evidence > likeliest:
                likeliest = evidence
                value = root @ (back.T @ (share * along / np.maximum(seen, 1e-300)))
    trace = places @ value
    inside = orthonormal(np.concatenate([state.set_up, *(one.columns for one in found)], axis=1))
    what = Probe(tuple(sorted(state.runs.axes)), "r", ())
    return what, min(one.p_value for one in dropped), trace - inside @ (inside.T @ trace)


def _more(state: State, one: Found, found: Sequence[Found]) -> float:
    """Give the evidence that a cause beside a rough error has more than that alone, the others in the model."""
    basis, left = state.context([other for other in found if other is not one])
    columns = np.concatenate([state.noise.whiten(_at_places(state.runs)), state.white(one)], axis=1)
    columns -= basis @ (basis.T @ columns)
    gram, score = columns.T @ columns, columns.T @ left
    both = [rough_evidence(gram, score, covariance) for covariance in _covariances(state.runs)]
    alone, beside = (max(values) for values in zip(*both, strict=True))
    return float(beside - math.log(one.n_trials) - alone)


def _covariances(runs: Runs) -> Iterator[Numbers]:
    return rough_covariances(np.arange(_N_CELLS, dtype=np.float64), len(runs.planes))


def _at_places(runs: Runs) -> Numbers:
    """Give what an error of 1 µm in each cell of each plane's circle is at each row, (n, n_planes·n_cells)."""
    turn = 2.0 * np.pi
    cells = np.arange(_N_CELLS) * turn / _N_CELLS
    angle = np.mod(runs.angle_rad, turn)
    own = np.stack([np.interp(angle, cells, unit, period=turn) for unit in np.eye(_N_CELLS)], axis=1)
    plane = np.array(runs.plane)[runs.run]
    return np.concatenate([own * (plane == one)[:, None] for one in runs.planes], axis=1)
