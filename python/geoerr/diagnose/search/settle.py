"""A candidate looked at closely: inner parameters refined, values with standard errors, worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.candidates import Formulas, Shapes, is_free
from geoerr.diagnose.scan import Scanner, estimate, not_determined, off_model
from geoerr.diagnose.search.judged import Judged
from geoerr.diagnose.space import Space
from geoerr.diagnose.where import rms_um
from geoerr.fit.sightings import Numbers
from geoerr.terms import Parameter, Term

# Refinement of an inner parameter: points between two trials, so many times.
_REFINED, _REFINEMENTS = 17, 3
# Steps along a valley between inner parameters, shares of a step that are tried, and a gain that is none.
_MOST_STEPS, _SHARES, _NO_MORE = 12, (1.0, 0.5, 0.25, 0.125), 1e-3
# Standard errors around a value within which it is looked for again.
_REACH = 4.0

# Coefficients (k,), their gain, and columns with derivatives by free inner parameters: as measured (n, 3, k + free),
# and whitened off the model (3 n, k + free).
Derived = tuple[Numbers, float, Numbers, Numbers]


@dataclass(frozen=True, eq=False)
class Settled:
    """A candidate with its inner parameters refined: values, standard errors, columns.

    Attributes
    ----------
    term
        With values and standard errors; NaN where the model can take a coefficient over.
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
    space
        In which it was estimated.
    """

    term: Term | None
    shapes: Shapes
    gain: float
    raw: Numbers
    displacement: Numbers
    visible_um: float
    space: Space


def settle(space: Space, scanner: Scanner, judged: Judged, *, refinements: int = _REFINEMENTS) -> Settled:
    """Refine the inner parameters of a candidate, and give its values with standard errors."""
    shapes = judged.shapes
    if shapes.term is None:
        raw = scanner.raw_columns(shapes, judged.trial)
        coefficients, _, gain = estimate(space, raw)
        displacement = off_model(space, raw) @ coefficients
        return Settled(None, shapes, float(gain), raw, displacement, _visible_um(space, displacement), space)
    bounds = {
        place: neighbours(shapes, judged.trial, place)
        for place, one in enumerate(shapes.term.inner)
        if is_free(one) and not judged.is_settled
    }
    formulas = Formulas(scanner.functions, shapes.term)
    single = replace(shapes, columns=formulas.columns, n_coefficients=len(shapes.term.coefficients), corners=({},))
    return _settled(space, scanner, single, list(shapes.trials[judged.trial]), bounds, refinements)


def resettle(space: Space, scanner: Scanner, settled: Settled) -> Settled:
    """Give an effect as it is estimated in another space: beside other effects its values and their errors differ.

    Inner parameters are looked for within a few standard errors of where they are; one without standard error stays.
    """
    term = settled.term
    assert term is not None
    bounds = {place: around(one, one.value, one.std) for place, one in enumerate(term.inner) if one.std > 0.0}
    inner = list(settled.shapes.trials[0])
    return _settled(space, scanner, settled.shapes, inner, bounds, _REFINEMENTS)


def settle_as(
    space: Space,
    scanner: Scanner,
    term: Term,
    inner: Sequence[float],
    bounds: dict[int, tuple[float, float]],
) -> Settled:
    """Estimate a term from a start, its inner parameters between bounds by place."""
    formulas = Formulas(scanner.functions, term)
    n_coefficients, codes = len(term.coefficients), np.array([formulas.codes(inner)], dtype=np.int64)
    start = Shapes(term, formulas.channels, formulas.columns, n_coefficients, ({},), (tuple(inner),), codes)
    return _settled(space, scanner, start, list(inner), dict(bounds), _REFINEMENTS)


def settle_at(space: Space, scanner: Scanner, settled: Settled, place: int, value: float) -> Settled:
    """Estimate an effect again with an inner parameter near another value of the same certainty, in frequency."""
    assert settled.term is not None
    parameter = settled.term.inner[place]
    inner = list(settled.shapes.trials[0])
    inner[place] = value
    bounds = {place: around(parameter, value, parameter.std * (value / parameter.value) ** 2)}
    return _settled(space, scanner, settled.shapes, inner, bounds, _REFINEMENTS)


def _settled(
    space: Space,
    scanner: Scanner,
    single: Shapes,
    inner: list[float],
    bounds: dict[int, tuple[float, float]],
    refinements: int,
) -> Settled:
    """Refine inner parameters one after the other between their bounds, by place; then estimate all values together.

    Standard errors are those of coefficients and free inner parameters at once, the latter by their derivatives where
    they were found: a coefficient is not surer than the inner parameter that it trades with allows.
    """
    term = single.term
    assert term is not None
    formulas = Formulas(scanner.functions, term)

    def at(trials: Sequence[Sequence[float]]) -> Shapes:
        codes = np.array([formulas.codes(trial) for trial in trials], dtype=np.int64)
        return replace(single, trials=tuple(tuple(trial) for trial in trials), codes=codes)

    for _ in range(refinements):
        for place, (low, high) in bounds.items():
            if not low < high:
                continue
            points = _between(term.inner[place], low, high)
            trials = [[*inner[:place], value, *inner[place + 1 :]] for value in points]
            best = int(np.argmax(scanner.exact(at(trials)).gain))
            inner[place] = points[best]
            bounds[place] = (points[max(best - 1, 0)], points[min(best + 1, len(points) - 1)])
    found = _with_derivatives(space, scanner, term, at, inner)
    if refinements and len(bounds) > 1:
        inner, found = _along_valley(space, scanner, term, at, inner, found)
    shapes = at([inner])
    coefficients, gain, joined, beyond = found
    free = [place for place, one in enumerate(term.inner) if is_free(one)]
    size = np.sqrt(np.maximum((beyond**2).sum(axis=0), 1e-300))
    covariance = np.linalg.pinv(beyond.T @ beyond / np.outer(size, size), rcond=1e-9) / np.outer(size, size)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    k = len(coefficients)
    std[:k][not_determined(space, joined[:, :, :k])] = np.nan
    inner_std = np.zeros(len(inner))
    inner_std[free] = std[k:]
    valued = term.with_values(
        coefficients.tolist(), inner, coefficients_std=std[:k].tolist(), inner_std=inner_std.tolist()
    )
    displacement = (beyond[:, :k] @ coefficients).reshape(space.residual.shape)
    return Settled(valued, shapes, float(gain), joined, displacement, _visible_um(space, displacement), space)


def _with_derivatives(
    space: Space,
    scanner: Scanner,
    term: Term,
    at: Callable[[Sequence[Sequence[float]]], Shapes],
    inner: Sequence[float],
) -> Derived:
    """Estimate a term at inner values, and give it with its derivatives by those that are free."""
    raw = scanner.raw_columns(at([inner]), 0)
    coefficients, _, gain = estimate(space, raw)
    parts = [raw]
    for place, one in enumerate(term.inner):
        if not is_free(one):
            continue
        low, high = _range(one)
        step = 1e-4 * (abs(inner[place]) if one.spacing == "log" else high - low)
        sides = at([[*inner[:place], inner[place] + sign * step, *inner[place + 1 :]] for sign in (1.0, -1.0)])
        up, down = (scanner.raw_columns(sides, side) @ coefficients for side in (0, 1))
        parts.append(((up - down) / (2.0 * step))[:, :, None])
    joined = np.concatenate(parts, axis=2)
    return coefficients, float(gain), joined, off_model(space, joined).reshape(-1, joined.shape[2])


def _along_valley(
    space: Space,
    scanner: Scanner,
    term: Term,
    at: Callable[[Sequence[Sequence[float]]], Shapes],
    inner: Sequence[float],
    found: Derived,
) -> tuple[list[float], Derived]:
    """Follow all inner parameters together to where the gain is largest (Gauss & Newton, the step halved if need be).

    One after the other they stop in a valley that runs between them.
    """
    best = list(inner)
    free = [place for place, one in enumerate(term.inner) if is_free(one)]
    for _ in range(_MOST_STEPS):
        coefficients, gain, _, beyond = found
        size = np.sqrt(np.maximum((beyond**2).sum(axis=0), 1e-300))
        step = np.linalg.lstsq(beyond / size, space.residual.reshape(-1), rcond=1e-6)[0] / size
        trials = []
        for share in _SHARES:
            trial = list(best)
            for place, one in zip(free, step[len(coefficients) :], strict=True):
                low, high = _range(term.inner[place])
                trial[place] = float(np.clip(best[place] + share * one, low, high))
            trials.append(trial)
        gains = scanner.exact(at(trials)).gain
        most = int(np.argmax(gains))
        if gains[most] <= gain + _NO_MORE:
            break
        best = trials[most]
        found = _with_derivatives(space, scanner, term, at, best)
    return best, found


def _visible_um(space: Space, displacement: Numbers) -> float:
    return rms_um(space, space.noise.unwhiten(displacement))


def _range(parameter: Parameter) -> tuple[float, float]:
    assert parameter.low is not None
    assert parameter.high is not None
    return parameter.low, parameter.high


def around(parameter: Parameter, value: float, std: float) -> tuple[float, float]:
    """Give the bounds within a few standard errors of a value, inside the parameter's range."""
    low, high = _range(parameter)
    return max(low, value - _REACH * std), min(high, value + _REACH * std)


def neighbours(shapes: Shapes, trial: int, place: int) -> tuple[float, float]:
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
