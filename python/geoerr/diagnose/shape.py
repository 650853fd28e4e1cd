"""What a curve without a name looks like, in words: rising, turning, odd, even, where it is largest."""

from __future__ import annotations

import itertools

import numpy as np

from geoerr.fit.empirical import Curve
from geoerr.fit.sightings import Numbers
from geoerr.summaries import listed
from geoerr.terms import is_motion

# A rise against the trend that is smaller than this share of the whole, or than so many standard errors, is none.
_RIPPLE, _RIPPLE_STD = 0.05, 2.0
# Share of the sum of squares that makes a curve odd, even or a product.
_NEARLY_ALL = 0.9
_SOME = 1.0 - _NEARLY_ALL
_STRAIGHT = 0.97
# The curve has no more degrees than these data have evidence of: what does it need not be a line.
_AS_A_LINE = " (in a straight line, as far as these data tell)"
_MOST_TURNS = 3
# Of more places at which a shape turns round the rest is counted.
_MOST_PLACES = 6


def shape_words(curve: Curve) -> str:
    """Say what a curve over one, two or three variables looks like, or a wave in time."""
    if curve.period is not None:
        return _wave(curve.period.value, curve.period.unit, curve.value_um)
    if len(curve.variables) == 1:
        return _one(curve.variables[0], curve.at[0], curve.value_um, curve.std_um)
    return _two(curve) if len(curve.variables) == 2 else _three(curve)


def _wave(period: float, unit: str, value_um: Numbers) -> str:
    """Say how often a wave turns, and how far it goes."""
    often = f"once in {period:.4g} {unit}" if period > 1.0 else f"{1.0 / period:.3f} times a second"
    return f"goes up and down {often}, by ±{0.5 * float(np.ptp(value_um)):.1f} µm"


def _one(name: str, at: Numbers, value_um: Numbers, std_um: Numbers) -> str:
    swing = float(np.ptp(value_um))
    if is_motion(name, "d") and len(at) == 2:
        up = _signed(float(value_um[1] - value_um[0]))
        return f"flips by {swing:.1f} µm with the direction of {name[2:]} ({up} µm on the way up)"
    ways = _ways(value_um, std_um)
    end = f"{_place(at[0])} to {_place(at[-1])}"
    texts = [f"{_course(name, at, value_um, ways)}, {swing:.1f} µm in all ({name} {end})"]
    if len(ways) > 1:
        texts += _symmetry(at, value_um, len(ways))
    return ", ".join(texts)


def _ways(value_um: Numbers, std_um: Numbers) -> list[tuple[int, int, int]]:
    """Cut a curve into rises (+1) and falls (−1) that are more than ripples: sign, first and last place."""
    least = _least(float(np.ptp(value_um)), std_um)
    turns = [0]
    for place in range(1, len(value_um)):
        # Keep the extreme of the way that is being gone, and turn where it is left by more than a ripple.
        if len(turns) < 2:
            if abs(value_um[place] - value_um[turns[0]]) > least:
                turns.append(place)
            continue
        way = np.sign(value_um[turns[-1]] - value_um[turns[-2]])
        step = value_um[place] - value_um[turns[-1]]
        if step * way > 0.0:
            turns[-1] = place
        elif abs(step) > least:
            turns.append(place)
    return [(int(np.sign(value_um[b] - value_um[a])), a, b) for a, b in itertools.pairwise(turns)]


def _least(whole_um: float, std_um: Numbers) -> float:
    """Give the smallest change that is more than a ripple of what changes by so much as a whole."""
    return max(_RIPPLE * whole_um, _RIPPLE_STD * float(np.median(std_um)))


def _course(name: str, at: Numbers, value_um: Numbers, ways: list[tuple[int, int, int]]) -> str:
    if not ways:
        return f"hardly changes with {name}"
    if len(ways) == 1:
        verb = "rises" if ways[0][0] > 0 else "falls"
        if len(at) == 2:
            return f"{verb} with {name}"
        straight = abs(float(np.corrcoef(at, value_um)[0, 1]))
        return f"{verb} with {name}{_bend(at, value_um) if straight < _STRAIGHT else _AS_A_LINE}"
    if len(ways) <= _MOST_TURNS:
        verbs = ["rises" if sign > 0 else "falls" for sign, _, _ in ways]
        places = [_place(at[last]) for _, _, last in ways[:-1]]
        return f"{', then '.join(verbs)} with {name} (turning at {listed(places)})"
    return f"goes up and down with {len(ways) - 1} turns over {name}"


def _bend(at: Numbers, value_um: Numbers) -> str:
    """Say in which half most of the change lies."""
    middle = float(np.interp(0.5 * (at[0] + at[-1]), at, value_um))
    first, second = abs(middle - value_um[0]), abs(value_um[-1] - middle)
    if max(first, second) < 2.0 * min(first, second):
        return ""
    return ", most of it at low values" if first > second else ", most of it at high values"


def _symmetry(at: Numbers, value_um: Numbers, n_ways: int) -> list[str]:
    """Say whether the curve is odd or even about the middle of its range, where its rises and falls do not deny it.

    An odd curve has an odd number of them, an even one an even number: one that falls a little, then rises far, would
    be said to be opposite on both sides of where it does not turn.
    """
    mirrored = np.interp(at[0] + at[-1] - at, at, value_um)
    odd, even = 0.5 * (value_um - mirrored), 0.5 * (value_um + mirrored)
    even = even - even.mean()
    whole = float(odd @ odd + even @ even)
    if len(at) < 4 or whole == 0.0:
        return []
    if n_ways % 2 == 0 and float(even @ even) > _NEARLY_ALL * whole:
        return ["alike on both sides of the middle (even)"]
    if n_ways % 2 == 1 and float(odd @ odd) > _NEARLY_ALL * whole:
        return ["opposite on both sides of the middle (odd)"]
    return []


def _two(curve: Curve) -> str:
    """Say what a surface is along its first variable, how that changes over the whole range of the second, and both.

    What changes along the first is one shape whose size follows the second, or it is told where the second begins, in
    the middle and where it ends.
    """
    first, second = curve.variables
    value_um, std_um = curve.value_um, curve.std_um
    # A corner where nothing was measured is large and uncertain.
    sure_um = np.abs(value_um) - _RIPPLE_STD * std_um
    column, row = (int(place) for place in np.unravel_index(int(np.argmax(sure_um)), value_um.shape))
    largest = f"the curve itself is largest ({_signed(value_um[column, row])} µm) at "
    largest += f"{first} = {_place(curve.at[0][column])}, {second} = {_place(curve.at[1][row])}"
    alone = value_um.mean(axis=0)
    left, size, right = np.linalg.svd(value_um - alone, full_matrices=False)
    whole = float((size**2).sum())
    if size[0] ** 2 > _NEARLY_ALL * max(whole, 1e-300):
        text = _of_one_shape(curve, left[:, 0], size[0] * right[0])
        beside = float(np.sum((alone - alone.mean()) ** 2)) * len(value_um)
        # Of one curve times another what the second does alone is a part of the product.
        no_product = float((np.linalg.svd(value_um, compute_uv=False)[1:] ** 2).sum())
        if beside > _SOME * whole and no_product > _SOME * beside:
            text += f", and beside that {_course(second, curve.at[1], alone, _ways(alone, std_um))}"
    else:
        text = _of_several_shapes(curve)
    return f"{text}; {largest}"


def _of_one_shape(curve: Curve, shape: Numbers, factor: Numbers) -> str:
    """Say what a shape (m,) along the first variable is, and where a factor (k,) over the second turns it round."""
    (first, second), (along, over) = curve.variables, curve.at
    swing_um = factor * float(np.ptp(shape))
    most_um = float(np.abs(swing_um).max())
    told = np.flatnonzero(np.abs(swing_um) > _least(most_um, curve.std_um))
    if not len(told):
        return f"hardly changes with {first}"
    turned = [(a, b) for a, b in itertools.pairwise(told) if swing_um[a] * swing_um[b] < 0.0]
    before = told[told <= turned[0][0]] if turned else told
    peak = int(before[np.argmax(np.abs(swing_um[before]))])
    course = _course(first, along, shape * factor[peak], _ways(shape * factor[peak], curve.std_um))
    if turned:
        first_turned = np.array(turned[:_MOST_PLACES])
        (before_um, after_um), (low, high) = swing_um[first_turned.T], over[first_turned.T]
        where = listed([_place(one) for one in low + (high - low) * before_um / (before_um - after_um)])
        more = f" and {len(turned) - _MOST_PLACES} times more" if len(turned) > _MOST_PLACES else ""
        return f"{course} at {second} = {_place(over[peak])}, and turns round at {second} = {where}{more}"
    gone = np.flatnonzero(np.abs(swing_um) <= _RIPPLE * most_um)
    if len(gone):
        # Of places beside each other the one where least is left.
        beside = np.split(gone, np.flatnonzero(np.diff(gone) > 1) + 1)
        least = [own[np.argmin(np.abs(swing_um[own]))] for own in beside]
        where = listed([_place(over[one]) for one in least])
        return f"{course} at {second} = {_place(over[peak])}, and vanishes at {second} = {where}"
    growth = float(swing_um[-1] / swing_um[0])
    ends = [_place(one) for one in over[[0, -1]]]
    more = f", {growth:.2g} times as much at {second} = {ends[1]} as at {ends[0]}" if not 0.67 < growth < 1.5 else ""
    return f"{course}{more}"


def _of_several_shapes(curve: Curve) -> str:
    """Say what a surface is along its first variable where the second begins, in the middle, and where it ends."""
    (first, second), (along, over) = curve.variables, curve.at
    texts = []
    for place in (0, len(over) // 2, len(over) - 1):
        own = curve.value_um[:, place]
        texts.append(f"{_course(first, along, own, _ways(own, curve.std_um))} at {second} = {_place(over[place])}")
    return ", ".join(texts)


def _three(curve: Curve) -> str:
    """Say what the surface over two variables is where it is largest along the third, and how it changes along it."""
    along = curve.cut_along
    name, at = curve.variables[along], curve.at[along]
    largest = curve.largest_cut
    other = 0 if largest >= len(at) - 1 - largest else len(at) - 1
    first, second = (curve.cut(place).value_um for place in (largest, other))
    is_turned = float(((first - first.mean()) * (second - second.mean())).sum()) < 0.0
    share = float(np.ptp(second)) / max(float(np.ptp(first)), 1e-9)
    places = [f"{name} = {_place(at[place])}" for place in (largest, other)]
    change = f"{'upside down and ' if is_turned else ''}{share:.2g} times as large at {places[1]}"
    return f"{_two(curve.cut(largest))}; so at {places[0]}, {change}"


def _place(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def _signed(value: float) -> str:
    return f"{value:+.1f}".replace("-", "−")
