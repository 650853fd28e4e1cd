"""The model's own functions with more freedom: what they do as well is the model's, and no effect's.

The freedom of the errors of an axis was chosen by evidence before the search, from the noise as it was then known. A
slow wave along an axis may be no more than what too few splines left of a smooth function.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.bases import basis_of
from geoerr.diagnose.candidates import Formulas, wave_along
from geoerr.diagnose.probes import Probe
from geoerr.diagnose.scan import estimate
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import Judged, evidence_of, variables_of
from geoerr.diagnose.search.look import Round
from geoerr.fit.periods import alike_periods
from geoerr.fit.sightings import Numbers
from geoerr.fit.wavy import MANY_WAVES
from geoerr.machine import AXES
from geoerr.terms import BasisSpec, Term

# Intervals between knots are cut in so many parts; a single one, a polynomial's, in as many as follow a few waves.
_PARTS, _PARTS_OF_ONE = (2, 4), (2, 4, 8)
_CUBIC = 3
# Of what leaves a smaller share than this, the model does most already; what gains this share of it does as much.
_MOSTLY_OWN, _AS_MUCH = 0.25, 0.9
# A wave that does this share of what knots do is what they follow: 0.98 and more of large ones in development sets.
_NEARLY_ALL = 0.95
# Standard deviations of what many knots follow of the noise.
_UNLIKELY = 3.0
# A wave this many times as long as what was measured is a line there.
_LONGEST = 4.0


def finer_functions(
    bench: Bench, looked: Round, claim: Judged, as_found: Judged, found: Sequence[Term] = ()
) -> Numbers | None:
    """Give columns (n, 3, k) of errors of an axis with more knots, if they have more evidence than what is claimed.

    Of what the model does most already, it is enough that they do as much, and predict better. So it is of what gains
    less than the price at which they were not chosen: so much of a smooth error evidence leaves. Many waves along an
    axis, of which the model leaves more, are no smooth error, however many knots follow them, and what is left of one
    besides; unless the knots do much more: of a step, a bump or a table of an error the best wave is a part.

    Parameters
    ----------
    claim
        A candidate or probe; only what is a function of the position of one axis can be such an error.
    as_found
        The same in the plain form that found it: one wave.
    found
        Errors of an axis that the model lacked, and that were found: a cubic polynomial each, which is the beginning
        of one.
    """
    functions = _functions(bench, found, claim)
    if not functions:
        return None
    ways = [_asked(bench, looked, way) for way in _ways(functions, claim)]
    is_smooth = _n_waves(bench, as_found) < MANY_WAVES
    does_as_much = [one for one in ways if one.gain >= _AS_MUCH * claim.gain]
    # Twice the logarithm that Schwarz takes for the fewest knots that do as much.
    price = min((one.rank for one in does_as_much), default=0) * math.log(max(looked.space.n_numbers, 2))
    if claim.share < _MOSTLY_OWN or (is_smooth and claim.gain < price):
        # What a smooth error needs to be followed is what predicts it best (Akaike), as little as that may be.
        worth = [(0.5 * one.gain - one.rank - math.log(len(ways)), one.columns) for one in does_as_much]
        least = 0.0
    elif not is_smooth and claim.gain >= _NEARLY_ALL * max((one.gain for one in ways), default=0.0):
        # Knots that follow a large wave follow what is left of a smooth error, too: far more than chance, and little.
        return None
    else:
        # A curve of the position of one axis is such an error by another name, however few numbers it has.
        is_same = isinstance(claim.what, Probe) and bool(does_as_much)
        some = does_as_much if is_same else ways
        evidence = [evidence_of(looked.space, np.array(one.gain), np.array(one.rank), len(ways)) for one in some]
        worth = [(float(of_one), one.columns) for of_one, one in zip(evidence, some, strict=True)]
        least = 0.0 if is_same else max(claim.evidence, 0.0)
        if not is_smooth and (much_more := _do_much_more(ways, claim)) is not None:
            return much_more.columns
    most, columns = max(worth, key=lambda one: one[0], default=(-math.inf, None))
    return columns if most > least else None


@dataclass(frozen=True, eq=False)
class _Function:
    """An error of an axis, with more knots.

    Attributes
    ----------
    channels
        Those of its term.
    channel, factor
        Of its columns.
    finer
        Bases with more knots.
    without
        What stands beside them already: they are taken without it. None where that is in the model.
    """

    channels: frozenset[str]
    channel: str
    factor: float
    finer: tuple[BasisSpec, ...]
    without: BasisSpec | None = None


@dataclass(frozen=True, eq=False)
class _Way:
    """Columns (n, 3, k) of more knots: the directions that they add, and how far the sum of squares falls."""

    columns: Numbers
    rank: int
    gain: float


def _do_much_more(ways: Sequence[_Way], claim: Judged) -> _Way | None:
    """Give the knots that predict better than a wave by more than chance lets them; None where none do.

    Twice Akaike's score. Where a wave is all there is, knots follow it at best, and pay for what they follow of the
    noise.
    """
    by_wave = claim.gain - 2.0 * claim.rank - 2.0 * math.log(max(claim.what.n_trials, 1))
    best = max(ways, key=_predicted, default=None)
    return best if best is not None and _predicted(best) > by_wave else None


def _predicted(way: _Way) -> float:
    return way.gain - 2.0 * way.rank - _UNLIKELY * math.sqrt(2.0 * way.rank)


def _asked(bench: Bench, looked: Round, way: Sequence[tuple[_Function, BasisSpec]]) -> _Way:
    columns = np.concatenate([_columns(bench, function, finer) for function, finer in way], axis=2)
    _, root, gain = estimate(looked.space, columns)
    return _Way(columns, root.shape[1], float(gain))


def _functions(bench: Bench, found: Sequence[Term], claim: Judged) -> list[_Function]:
    """Give the functions of an axis that may do what is claimed: the model's, and those that were found."""
    names = variables_of(claim) if isinstance(claim.what, Probe) else set(_term_of(claim).variables)
    if not names <= set(AXES):
        return []
    if len(names) == 1:
        (axis,) = names
        return [*_of_model(bench, axis), *(one for term in found for one in _of_find(bench, term, axis))]
    # Over several axes there is a turn along one of them, which the others are the lever of.
    turning = [one for term in found for axis in names for one in _of_find(bench, term, axis)]
    return [one for one in turning if one.channel[1] in "ABC"] if isinstance(claim.what, Probe) else []


def _of_model(bench: Bench, axis: str) -> Iterator[_Function]:
    for term in bench.fitted.terms:
        part = term.parts[0]
        if len(term.parts) == 1 and part.basis is not None and part.basis.axis == axis:
            yield _Function(frozenset(term.channels), part.channel, part.factor, tuple(_finer(part.basis)))


def _of_find(bench: Bench, term: Term, axis: str) -> Iterator[_Function]:
    """Give what a find may have beyond its beginning: that has the name, and all of it would make it superfluous."""
    if term.axis != axis:
        return
    q_mm = bench.fitted.sightings.commanded_mm[bench.fitted.solved.used, AXES.index(axis)]
    beginning = BasisSpec("polynomial", axis, degree=_CUBIC, low_mm=float(q_mm.min()), high_mm=float(q_mm.max()))
    for part in term.parts:
        yield _Function(frozenset([part.channel]), part.channel, part.factor, tuple(_finer(beginning)), beginning)


def _ways(functions: Sequence[_Function], claim: Judged) -> Iterator[tuple[tuple[_Function, BasisSpec], ...]]:
    """Give functions with finer bases that may do what is claimed: each alone, and all that it acts on together."""
    channels = None if isinstance(claim.what, Probe) else set(_term_of(claim).channels)
    own = [one for one in functions if one.finer and (channels is None or channels & one.channels)]
    for one in own:
        for basis in one.finer:
            yield ((one, basis),)
    if channels is not None and len(own) > 1:
        for place in range(len(_PARTS)):
            yield tuple((one, one.finer[place]) for one in own)


def _n_waves(bench: Bench, claim: Judged) -> float:
    """Give the number of waves over the places that were measured; 0 of what is no wave.

    Of those that are one at places in even steps it is the fewest: ten places see five waves at most, and a smooth
    error with too few functions as one of any period.
    """
    if isinstance(claim.what, Probe):
        return 0.0
    term, inner = _term_of(claim), claim.shapes.trials[claim.trial]
    wave = wave_along(Formulas(bench.functions, term), term, inner)
    if wave is None:
        return 0.0
    place, along = wave
    span, period = float(np.ptp(along)), inner[place]
    return span / max([period, *alike_periods(along, period, period, _LONGEST * span)])


def _term_of(claim: Judged) -> Term:
    assert claim.shapes.term is not None
    return claim.shapes.term


def _finer(basis: BasisSpec) -> Iterator[BasisSpec]:
    if basis.kind == "polynomial":
        assert basis.low_mm is not None
        assert basis.high_mm is not None
        basis = BasisSpec("bspline", basis.axis, knots_mm=(basis.low_mm, basis.high_mm), degree=_CUBIC)
    knots = np.array(basis.knots_mm)
    for parts in (_PARTS_OF_ONE if len(knots) == 2 else _PARTS) if knots.size else ():
        places = np.arange(parts * (len(knots) - 1) + 1) / parts
        yield replace(basis, knots_mm=tuple(np.interp(places, np.arange(len(knots)), knots).tolist()))


def _columns(bench: Bench, function: _Function, basis: BasisSpec) -> Numbers:
    positions_mm = bench.fitted.sightings.commanded_mm[:, AXES.index(basis.axis)]
    values = basis_of(basis).evaluate(np.ascontiguousarray(positions_mm))
    if function.without is not None:
        held = basis_of(function.without).evaluate(np.ascontiguousarray(positions_mm))
        values = values - held @ np.linalg.lstsq(held, values, rcond=None)[0]
    return function.factor * bench.channels[function.channel][:, :, None] * values[:, None, :]
