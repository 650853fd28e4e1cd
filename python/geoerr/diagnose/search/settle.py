"""A candidate looked at closely: inner parameters refined, values with standard errors, worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.candidates import Formulas, Shapes, is_free
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.scan import Scanner, Seen, seen
from geoerr.diagnose.search.inner import InnerSearch, around, neighbours, standard_errors
from geoerr.diagnose.search.judged import Judged
from geoerr.diagnose.space import Space
from geoerr.diagnose.where import rms_um
from geoerr.fit.sightings import Numbers
from geoerr.terms import Term

# Inner parameters are refined one after the other so many times.
_REFINEMENTS = 3


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
    moved : (n, 3)
        The same for `visible_um`: beside a model that is given what no frame can take over, for its numbers are held,
        however unsure they are. Of what has no name it is `displacement`: its numbers are as unsure as the model.
    visible_um
        Root mean square of `moved`.
    space
        In which it was estimated.
    """

    term: Term | None
    shapes: Shapes
    gain: float
    raw: Numbers
    displacement: Numbers
    moved: Numbers
    visible_um: float
    space: Space

    @property
    def of_coefficients(self) -> Numbers:
        """Columns (n, 3, k) of coefficients alone: those of inner derivatives would be more freedom than it has."""
        assert self.term is not None
        return self.raw[:, :, : len(self.term.coefficients)]


def settle(space: Space, scanner: Scanner, judged: Judged, *, refinements: int = _REFINEMENTS) -> Settled:
    """Refine the inner parameters of a candidate, and give its values with standard errors."""
    shapes = judged.shapes
    if shapes.term is None:
        raw = scanner.raw_columns(shapes, judged.trial)
        own = seen(space, raw)
        coefficients, gain = own.estimate(space)
        displacement = own.beyond(space, coefficients).reshape(space.residual.shape)
        visible_um = _visible_um(space, displacement)
        return Settled(None, shapes, float(gain), raw, displacement, displacement, visible_um, space)
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
    start = shapes_at(scanner.functions, term, inner)
    return _settled(space, scanner, start, list(inner), dict(bounds), _REFINEMENTS)


def shapes_at(functions: Functions, term: Term, inner: Sequence[float]) -> Shapes:
    """Give a term's columns at these inner values alone."""
    formulas = Formulas(functions, term)
    codes = np.array([formulas.codes(inner)], dtype=np.int64)
    n_coefficients = len(term.coefficients)
    return Shapes(term, formulas.channels, formulas.columns, n_coefficients, ({},), (tuple(inner),), codes)


def settle_at(space: Space, scanner: Scanner, settled: Settled, place: int, value: float) -> Settled:
    """Estimate an effect again with an inner parameter near another value of the same certainty, in frequency."""
    assert settled.term is not None
    parameter = settled.term.inner[place]
    inner = list(settled.shapes.trials[0])
    inner[place] = value
    bounds = {place: around(parameter, value, parameter.std * (value / parameter.value) ** 2)}
    return _settled(space, scanner, settled.shapes, inner, bounds, _REFINEMENTS)


def explained_share(settled: Settled, columns: Seen) -> float:
    """Give the share, as a cosine, of what an effect explains that these columns could have explained."""
    flat = settled.displacement.reshape(-1)
    size = float(np.linalg.norm(flat))
    if not size > 0.0:
        return 0.0
    # Rounding may leave a cosine above 1.
    return min(float(np.linalg.norm(columns.root.T @ (columns.whitened.T @ flat))) / size, 1.0)


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
    they were found: a coefficient is not surer than the inner parameter that it trades with allows, nor than other
    inner values that explain as much.
    """
    term = single.term
    assert term is not None
    formulas = Formulas(scanner.functions, term)

    def at(trials: Sequence[Sequence[float]]) -> Shapes:
        codes = np.array([formulas.codes(trial) for trial in trials], dtype=np.int64)
        return replace(single, trials=tuple(tuple(trial) for trial in trials), codes=codes)

    search = InnerSearch(space, scanner, term, at)
    found, others = search.best(inner, bounds, refinements)
    k = len(found.coefficients)
    std = standard_errors(search.free, found, others)
    for place, error in search.jump_errors(found).items():
        std[k + place] = error
    own = found.seen.first(k)
    std[:k][own.is_open] = np.nan
    valued = term.with_values(
        found.coefficients.tolist(), found.inner, coefficients_std=std[:k].tolist(), inner_std=std[k:].tolist()
    )
    displacement = own.beyond(space, found.coefficients).reshape(space.residual.shape)
    moved = own.beyond_free(space, found.coefficients).reshape(space.residual.shape)
    visible_um = _visible_um(space, moved)
    return Settled(valued, at([found.inner]), found.gain, found.raw, displacement, moved, visible_um, space)


def _visible_um(space: Space, moved: Numbers) -> float:
    return rms_um(space, space.noise.unwhiten(moved))
