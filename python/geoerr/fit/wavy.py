"""Errors of an axis whose knots follow a wave: what repeats along an axis is an effect's, not the guideway's.

The freedom of an error is chosen by the data, and many knots can follow a few waves. Whether fewer knots and one wave
would do is told by the fit itself, as in `geoerr.fit.knots`: with f the estimate at places along the axis and V its
covariance,

    χ²(B) = min_α (f − B α)ᵀ V⁺ (f − B α),   score = χ² + ln n · (free numbers)   (Schwarz)

for the knots as they are, for few knots, and for few knots with a wave of any period that the many could follow: one
of a single frequency, or with its second harmonic, as screws, belts and encoders have it. Of a large wave many knots
make something that is only nearly one, so that a wave that does nearly all of what few knots leave is enough, too.

What few knots leave of a large smooth error goes up and down with the knots, and looks like a wave. But it falls with
every knot more, where a wave stays until there are two knots to each turn: what still falls is no wave.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set

import numpy as np

from geoerr import _core
from geoerr.bases import basis_of, spline_over
from geoerr.fit.classic import on_basis, positions_by_axis
from geoerr.fit.fitted import Fitted
from geoerr.fit.knots import determined_values, misfit
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers
from geoerr.model.compile import core_part, start_values
from geoerr.terms import BasisSpec, Term

# Functions of a smooth error: eight pieces follow two waves over an axis. A basis with not many more is smooth, too.
_SMOOTH, _NOT_SMOOTH = 11, 14
# As few follow no five waves.
_FEWEST = 8
# So many waves over an axis are no smooth error of it, however many knots follow them.
MANY_WAVES = 5.0
# Between two that are tried a wave turns by an eighth.
_STEP = 0.125
# Twice the logarithm of the evidence by which a wave has to be the better description.
_CLEARLY = 6.0
# Of what few knots leave, a wave that leaves less than this does nearly all.
_NEARLY_ALL = 0.2
# Share of a wave's square that knots that follow it do at least: with two knots to a turn they do four tenths.
_FOLLOWED = 1.0 / 3.0
# With two functions more, what is left falls by more than this: so it does of a smooth error not yet followed.
# Of waves of five turns and more it falls 1.9 times at most, of whatever phase.
_STILL_FALLS = 3.0


def without_waves(fitted: Fitted) -> tuple[Term, ...] | None:
    """Give a fit's terms with few knots where those and a wave say the same as many; None where no error is so."""
    positions = positions_by_axis(fitted.sightings.commanded_mm, SAME_POSITION_MM)
    price = math.log(max(int(fitted.sightings.is_measured[fitted.solved.used].sum()), 2))
    terms: list[Term] = []
    for term, own in zip(fitted.terms, fitted.compiled.coefficient_slices, strict=True):
        basis = _many_knots(term)
        if basis is not None:
            plain = _few_knots(basis.axis, positions)
            if _is_wave(fitted, term, own, basis, plain, positions[basis.axis], price):
                term = on_basis(term, plain)
        terms.append(term)
    return None if tuple(terms) == tuple(fitted.terms) else tuple(terms)


def with_few_knots_along(fitted: Fitted, terms: Sequence[Term]) -> tuple[Term, ...]:
    """Give terms with few knots in all errors of an axis, where one of these has fewer than it has in a fit.

    Errors of one axis go together where targets and the other axes hardly move: what follows a wave then is all of
    them, and of none alone a wave would do as much.
    """
    changed = (before for before, one in zip(fitted.terms, terms, strict=True) if one != before)
    axes = {basis.axis for before in changed if (basis := _many_knots(before)) is not None}
    positions = positions_by_axis(fitted.sightings.commanded_mm, SAME_POSITION_MM)
    return tuple(
        on_basis(one, _few_knots(basis.axis, positions))
        if (basis := _many_knots(one)) is not None and basis.axis in axes
        else one
        for one in terms
    )


def _few_knots(axis: str, positions_mm: Mapping[str, Numbers]) -> BasisSpec:
    return spline_over(axis, positions_mm[axis], _SMOOTH)


def may_be_followed(own: Term, effect: Term) -> bool:
    """Tell whether an error of an axis has many knots and acts where an effect of its position alone does."""
    basis = _many_knots(own)
    return basis is not None and set(effect.variables) == {basis.axis} and bool({*own.channels} & {*effect.channels})


def follows_waves(own: Term, n_waves: float, positions_mm: Mapping[str, Numbers]) -> bool:
    """Tell whether the knots of an error of an axis follow so many waves over its positions.

    Where these are few, a wave of any period is one that they follow; where they are many, only a long one.

    Parameters
    ----------
    positions_mm
        Distinct positions of each axis.
    """
    basis = _many_knots(own)
    if basis is None:
        return False
    return _follow(basis, positions_mm[basis.axis], _wave(positions_mm[basis.axis], n_waves, (1,)))


def _follow(basis: BasisSpec, places_mm: Numbers, wave: Numbers) -> bool:
    """Tell whether functions follow a good part of a wave, (n,) or (n, k), at places."""
    columns = basis_of(basis).evaluate(places_mm)
    left = wave - columns @ np.linalg.lstsq(columns, wave, rcond=None)[0]
    return float((left**2).sum()) < (1.0 - _FOLLOWED) * float((wave**2).sum())


def beside_waves(
    own: Term, rich: BasisSpec, effects: Sequence[Term], positions_mm: Mapping[str, Numbers]
) -> BasisSpec:
    """Give a basis of an error of an axis with so few functions that they do not follow what effects do along it.

    What both can do is the effect's: beside it many knots say the same again, and neither is known. Where the fewest
    follow an effect, too, it is as smooth as the error, and nothing is to be had by fewer.

    Parameters
    ----------
    rich
        The richest one that is asked for.
    effects
        Terms with values.
    positions_mm
        Distinct positions of each axis.
    """
    places, channels = positions_mm[rich.axis], {*own.channels}
    for effect in effects:
        if set(effect.variables) == {rich.axis} and channels & {*effect.channels}:
            for along in _along(effect, channels, places):
                rich = _not_following(rich, places, along)
    return rich


def _not_following(rich: BasisSpec, places_mm: Numbers, along: Numbers) -> BasisSpec:
    """Give the richest spline that does not follow a function of places, (n,); `rich` where the fewest follow it."""
    for count in range(rich.n_functions, _FEWEST - 1, -1):
        basis = rich if count == rich.n_functions else spline_over(rich.axis, places_mm, count)
        if not _follow(basis, places_mm, along):
            return basis
    return rich


def _along(effect: Term, channels: Set[str], places_mm: Numbers) -> Iterator[Numbers]:
    """Give what an effect of the position of one axis does at places on some channels, (n,) each."""
    theta, phi = start_values([effect])
    for part in effect.parts:
        if part.channel in channels and part.expression is not None:
            _, _, _, formula, coefficients, inner = core_part(effect, part, effect.variables)
            assert isinstance(formula, _core.Expression)
            first = np.zeros(1, dtype=np.int64)
            columns = formula.coefficient_columns(places_mm[None, :], phi[inner], first, None, 1)
            yield np.asarray(columns @ theta[coefficients])


def _many_knots(term: Term) -> BasisSpec | None:
    """Give the basis of an error with clearly more knots than a smooth one; None for another kind of term."""
    basis = term.parts[0].basis
    if term.kind != "classic" or len(term.parts) != 1 or basis is None or basis.kind != "bspline":
        return None
    return None if basis.n_functions < _NOT_SMOOTH else basis


def _is_wave(
    fitted: Fitted, term: Term, own: slice, basis: BasisSpec, plain: BasisSpec, positions_mm: Numbers, price: float
) -> bool:
    values = np.array([parameter.value for parameter in term.coefficients])
    null_space = fitted.null_space[own]
    known = determined_values(basis, values, fitted.covariance[own, own], null_space, positions_mm)
    if known is None:
        return False
    places, design, whiten, target = known

    def by(columns: Numbers) -> tuple[float, int]:
        # What the knots cannot follow exactly is to be compared as they would follow it.
        return misfit(whiten @ (design @ np.linalg.lstsq(design, columns, rcond=None)[0]), target)

    def by_splines(count: int) -> float:
        return by(basis_of(spline_over(basis.axis, positions_mm, count)).evaluate(places))[0]

    smooth = basis_of(plain).evaluate(places)
    alone, rank = by(smooth)
    counts = _counts(basis)
    if not len(counts) or _still_falls(by_splines, plain):
        return False

    def is_enough(multiples: tuple[int, ...]) -> bool:
        waves = (_wave(places, count, multiples) for count in counts)
        best, rank_with = min(by(np.concatenate([smooth, wave], axis=1)) for wave in waves)
        # A period is one number more.
        with_wave = best + price * (rank_with + 1) + 2.0 * math.log(len(counts))
        is_as_good = with_wave + _CLEARLY < price * len(target) or best < _NEARLY_ALL * alone
        return is_as_good and with_wave + _CLEARLY < alone + price * rank

    return is_enough((1,)) or is_enough((1, 2))


def _still_falls(left_by: Callable[[int], float], plain: BasisSpec) -> bool:
    """Tell whether what few functions leave would fall with every one more; odd and even numbers of them together."""
    few, more = (left_by(count - 1) + left_by(count) for count in (plain.n_functions, plain.n_functions + 2))
    return few > _STILL_FALLS * more


def _counts(basis: BasisSpec) -> Numbers:
    """Give every number of waves over the axis that is many, and that the knots could follow."""
    return np.arange(MANY_WAVES, 0.5 * (basis.n_functions - 3) + 1.0, _STEP)


def _wave(places_mm: Numbers, count: float, multiples: tuple[int, ...]) -> Numbers:
    """Give cosine and sine (n, 2 · multiples) of so many waves over the places, and of multiples of it."""
    turns = (places_mm - places_mm[0]) / np.ptp(places_mm)
    phases = [2.0 * np.pi * count * multiple * turns for multiple in multiples]
    return np.stack([wave(phase) for phase in phases for wave in (np.cos, np.sin)], axis=1)
