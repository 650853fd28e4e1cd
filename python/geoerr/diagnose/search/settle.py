"""A candidate looked at closely: inner parameters refined, values with standard errors, worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.candidates import Formulas, Shapes, is_free
from geoerr.diagnose.scan import Scanner, estimate, off_model
from geoerr.diagnose.search.judged import Judged
from geoerr.diagnose.space import Space
from geoerr.diagnose.where import rms_um
from geoerr.fit.sightings import Numbers
from geoerr.terms import Parameter, Term

# Refinement of an inner parameter: points between two trials, so many times.
_REFINED, _REFINEMENTS = 17, 3


@dataclass(frozen=True, eq=False)
class Settled:
    """A candidate with its inner parameters refined: values, standard errors, columns.

    Attributes
    ----------
    term
        With values and standard errors.
    shapes
        At one trial.
    gain
        Fall of the sum of squares.
    raw : (n, 3, k)
        Columns in units of the stated uncertainties: coefficients, then inner derivatives.
    displacement : (n, 3)
        What it explains, whitened, off the model.
    visible_um
        Root mean square of what it explains beyond the model.
    """

    term: Term | None
    shapes: Shapes
    gain: float
    raw: Numbers
    displacement: Numbers
    visible_um: float


def settle(space: Space, scanner: Scanner, judged: Judged, *, refinements: int = _REFINEMENTS) -> Settled:
    """Refine the inner parameters of a candidate, and give its values with standard errors."""
    shapes = judged.shapes
    if shapes.term is None:
        raw = scanner.raw_columns(shapes, judged.trial)
        coefficients, _, gain = estimate(space, raw)
        displacement = off_model(space, raw) @ coefficients
        return Settled(
            None, shapes, float(gain), raw, displacement, rms_um(space, space.noise.unwhiten(displacement))
        )
    term = shapes.term
    formulas = Formulas(scanner.functions, term)
    inner = list(shapes.trials[judged.trial])
    single = replace(shapes, columns=formulas.columns, n_coefficients=len(term.coefficients), corners=({},))
    free = [place for place, one in enumerate(term.inner) if is_free(one)]

    def at(trials: Sequence[Sequence[float]]) -> Shapes:
        codes = np.array([formulas.codes(trial) for trial in trials], dtype=np.int64)
        return replace(single, trials=tuple(tuple(trial) for trial in trials), codes=codes)

    bounds = {place: _neighbours(shapes, judged.trial, place) for place in free}
    for _ in range(refinements):
        for place in free:
            low, high = bounds[place]
            if not low < high:
                continue
            points = _between(term.inner[place], low, high)
            trials = [[*inner[:place], value, *inner[place + 1 :]] for value in points]
            best = int(np.argmax(scanner.gains(at(trials))))
            inner[place] = points[best]
            bounds[place] = (points[max(best - 1, 0)], points[min(best + 1, len(points) - 1)])
    single = at([inner])
    raw = scanner.raw_columns(single, 0)
    coefficients, _, gain = estimate(space, raw)
    parts = [raw]
    for place in free:
        low, high = _range(term.inner[place])
        step = 1e-4 * (abs(inner[place]) if term.inner[place].spacing == "log" else high - low)
        sides = at([[*inner[:place], inner[place] + sign * step, *inner[place + 1 :]] for sign in (1.0, -1.0)])
        up, down = (scanner.raw_columns(sides, side) @ coefficients for side in (0, 1))
        parts.append(((up - down) / (2.0 * step))[:, :, None])
    joined = np.concatenate(parts, axis=2)
    beyond = off_model(space, joined).reshape(-1, joined.shape[2])
    size = np.sqrt(np.maximum((beyond**2).sum(axis=0), 1e-300))
    covariance = np.linalg.pinv(beyond.T @ beyond / np.outer(size, size), rcond=1e-9) / np.outer(size, size)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    k = len(coefficients)
    inner_std = np.zeros(len(inner))
    inner_std[free] = std[k:]
    valued = term.with_values(
        coefficients.tolist(), inner, coefficients_std=std[:k].tolist(), inner_std=inner_std.tolist()
    )
    displacement = (beyond[:, :k] @ coefficients).reshape(space.residual.shape)
    return Settled(
        valued, single, float(gain), joined, displacement, rms_um(space, space.noise.unwhiten(displacement))
    )


def _range(parameter: Parameter) -> tuple[float, float]:
    assert parameter.low is not None
    assert parameter.high is not None
    return parameter.low, parameter.high


def _neighbours(shapes: Shapes, trial: int, place: int) -> tuple[float, float]:
    """Give the trial values on both sides of one; the whole range of a parameter that was not tried."""
    assert shapes.term is not None
    tried = sorted({values[place] for values in shapes.trials})
    if len(tried) == 1:
        return _range(shapes.term.inner[place])
    at = tried.index(shapes.trials[trial][place])
    return tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]


def _between(parameter: Parameter, low: float, high: float) -> list[float]:
    spaced = np.geomspace if parameter.spacing == "log" else np.linspace
    return [float(value) for value in spaced(low, high, _REFINED)]
