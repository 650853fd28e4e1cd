"""The richest bases with which every state still determines what it can.

A state tells an error, or it does not; how many functions the error is given decides it only where there are more of
them than the state has places for. So the errors that few functions leave open are open in that state, and those that
only rich bases leave open get fewer functions, one error by itself: the others keep theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from geoerr.fit import Fitted
from geoerr.fit.classic import BENT, MOST_FUNCTIONS, rich_basis, tells_noise
from geoerr.fit.run_away import run_away
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.terms import BasisSpec

# Functions for each position, at most: fewer are tried where some state cannot tell them apart.
_SHARES = (1.0, 0.7, 0.45)
# As few functions as bend, and one less: what these leave open, the state does not tell.
_FEW = (BENT, BENT - 1)
_LOWEST = len(_SHARES) + len(_FEW) - 1


def richest(
    fit: Callable[[Mapping[str, BasisSpec]], list[Fitted]],
    names: Sequence[str],
    sightings: Sequence[Sightings],
    places_mm: Mapping[str, Numbers],
) -> tuple[dict[str, BasisSpec], list[Fitted]]:
    """Give the richest bases that leave no state more open than few functions do, and the states' fits with them.

    Parameters
    ----------
    fit
        Fits every state with these bases, by ISO name.
    names
        Functions that have a basis to be chosen.
    sightings
        Of each state.
    places_mm
        Positions of each axis that all states support.
    """

    def at(level: Mapping[str, int]) -> tuple[dict[str, BasisSpec], list[Fitted], set[tuple[int, str]]]:
        bases = _bases(level, sightings, places_mm)
        fits = fit(bases)
        return bases, fits, _open(fits, names)

    level = dict.fromkeys(names, 0)
    bases, fits, is_open = at(level)
    if not is_open or not bases:
        return bases, fits
    few = min(
        (at(dict.fromkeys(names, low)) for low in range(len(_SHARES), _LOWEST + 1)), key=lambda one: len(one[2])
    )
    while len(is_open) > len(few[2]):
        lower = {name for _, name in is_open - few[2] if level.get(name, _LOWEST) < _LOWEST}
        if not lower:
            return few[:2]
        level = {name: own + (name in lower) for name, own in level.items()}
        bases, fits, is_open = at(level)
    return bases, fits


def _bases(
    level: Mapping[str, int], sightings: Sequence[Sightings], places_mm: Mapping[str, Numbers]
) -> dict[str, BasisSpec]:
    is_stated = all(one.is_stated for one in sightings)
    found = {}
    for name, own in level.items():
        places = places_mm[name[2].lower()]
        is_few = own >= len(_SHARES)
        most = (
            _FEW[own - len(_SHARES)] if is_few else min(max(round(_SHARES[own] * len(places)), BENT), MOST_FUNCTIONS)
        )
        is_noise_told = all(tells_noise(one, list(level), places_mm, most) for one in sightings)
        basis = rich_basis(name[2].lower(), places, is_stated=is_stated, is_noise_told=is_noise_told, most=most)
        if basis is not None:
            found[name] = basis
    return found


def _open(fits: Sequence[Fitted], names: Sequence[str]) -> set[tuple[int, str]]:
    """Name the functions that a state, by its number, does not determine, or hardly."""
    return {
        (number, name)
        for number, fitted in enumerate(fits)
        for name in {*fitted.undetermined.names, *run_away(fitted)}.intersection(names)
    }
