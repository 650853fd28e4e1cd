"""The richest bases that data determine: a function for each position, or fewer where those leave more open.

Nine lines determine a spline through every position. One picture beside them has positions of its own, and
splines for them that nothing else tells: with these every function of the axis would be open, in what nobody asks
for. Where a laser was at thirty places of an axis and a ball plate at five, one function of it has the laser's
places, and the others have the plate's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from geoerr.error_functions import ROTATIONS, TRANSLATIONS
from geoerr.fit.classic import BENT, MOST_FUNCTIONS, rich_bases
from geoerr.fit.fitted import Fitted
from geoerr.fit.run_away import run_away
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.machine import AXES
from geoerr.terms import BasisSpec

# Positions that fewer rows show than this share of what rows show of the middle one are passed over first.
_HARDLY_SEEN = 0.5
# As few functions are tried: lines of four places that cross at a fifth leave a function for each of five open.
_FEW = (BENT, BENT - 1)


def determined_bases(
    fit: Callable[[Mapping[str, BasisSpec]], Fitted],
    rich: Mapping[str, BasisSpec],
    sightings: Sightings,
    positions_mm: Mapping[str, Numbers],
) -> tuple[dict[str, BasisSpec], Fitted]:
    """Give the richest bases that leave no more functions open than few functions do, and the fit with them.

    Parameters
    ----------
    fit
        Fits the model with these bases.
    rich
        Bases by ISO name, as positions support them.
    positions_mm
        Distinct positions of each axis.
    """
    fitted = fit(rich)
    if not _n_open(fitted, rich):
        return dict(rich), fitted
    few, with_few = dict(rich), fitted
    for count in _FEW:
        fewer = rich_bases(sightings, list(rich), positions_mm, count)
        with_fewer = fit(fewer)
        if _n_open(with_fewer, rich) < _n_open(with_few, rich):
            few, with_few = fewer, with_fewer
        if not _n_open(with_few, rich):
            break
    least = _n_open(with_few, rich)
    if least >= _n_open(fitted, rich):
        return dict(rich), fitted
    for bases in _between(rich, sightings, positions_mm):
        found = fit(bases)
        if _n_open(found, rich) <= least:
            return _richer_by_itself(fit, rich, bases, found)
    return _richer_by_itself(fit, rich, few, with_few)


def _richer_by_itself(
    fit: Callable[[Mapping[str, BasisSpec]], Fitted],
    rich: Mapping[str, BasisSpec],
    bases: dict[str, BasisSpec],
    fitted: Fitted,
) -> tuple[dict[str, BasisSpec], Fitted]:
    """Give functions the richest bases where they alone, or with those of their kind and axis, leave no more open."""
    least = _n_open(fitted, rich)
    for axis in AXES:
        for kind in (TRANSLATIONS, ROTATIONS):
            alike = [
                name for name in rich if name[1] in kind and rich[name].axis == axis and bases[name] != rich[name]
            ]
            if not alike:
                continue
            for some in (alike, *([name] for name in alike if len(alike) > 1)):
                richer = {**bases, **{name: rich[name] for name in some}}
                found = fit(richer)
                if _n_open(found, rich) <= least:
                    bases, fitted = richer, found
                    if some is alike:
                        break
    return bases, fitted


def _n_open(fitted: Fitted, names: Mapping[str, BasisSpec]) -> int:
    """Count the functions that nothing determines, or hardly anything."""
    return len({*fitted.undetermined.names, *run_away(fitted)} & set(names))


def _between(
    rich: Mapping[str, BasisSpec], sightings: Sightings, positions_mm: Mapping[str, Numbers]
) -> Iterator[dict[str, BasisSpec]]:
    """Give bases of less and less freedom.

    One function fewer than positions where an axis has few; then without positions that few rows show, and a quarter
    less each time.
    """
    fewer = rich_bases(sightings, list(rich), positions_mm, BENT - 1)
    yield {name: fewer[name] if len(positions_mm[basis.axis]) <= BENT else basis for name, basis in rich.items()}
    often = {
        axis: _often_seen(sightings.commanded_mm[:, AXES.index(axis)], own) for axis, own in positions_mm.items()
    }
    yield rich_bases(sightings, list(rich), often)
    most = 3 * min(MOST_FUNCTIONS, max(len(own) for own in often.values())) // 4
    while most > BENT:
        yield rich_bases(sightings, list(rich), often, most)
        most = 3 * most // 4


def _often_seen(commanded_mm: Numbers, positions_mm: Numbers) -> Numbers:
    """Leave out positions (k,) that few rows show; both ends stay."""
    if len(positions_mm) < 3:
        return positions_mm
    middles = 0.5 * (positions_mm[1:] + positions_mm[:-1])
    count = np.bincount(np.searchsorted(middles, commanded_mm), minlength=len(positions_mm))
    kept = count >= _HARDLY_SEEN * float(np.median(count))
    kept[[0, -1]] = True
    return positions_mm[kept]
