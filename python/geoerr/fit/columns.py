"""What is said of a table's columns that a fit cannot use as they are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from geoerr.column_names import looks_like_temperature
from geoerr.fit.sightings import Numbers
from geoerr.observations import (
    CIRCLE_COLUMNS,
    COVARIANCE,
    LENGTH_COLUMNS,
    POINT_COLUMNS,
    STANDARD_UNCERTAINTY,
    Observations,
)
from geoerr.spelling import meant
from geoerr.summaries import counted, listed
from geoerr.terms import CLOCK_NAME, PLACE_NAMES, RAW_VARIABLES

# Places of the components that each element of a covariance belongs to, in the order of `COVARIANCE`.
_OF_COVARIANCE = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
# Variables of formulas that geoerr works out itself, whatever column has their name.
_KNOWN = frozenset({*POINT_COLUMNS.columns, *CIRCLE_COLUMNS.columns, *LENGTH_COLUMNS.columns})
_WORKED_OUT = RAW_VARIABLES - _KNOWN
# Of names of so many letters one that agrees this well is a slip; a short one may be anybody's.
_LONG_ENOUGH, _SLIP = 5, 0.85
_LONG = frozenset(name for name in _KNOWN if len(name) >= _LONG_ENOUGH)
_OF_AXES = {
    "d": "the direction of travel",
    "s": "the travel since the last reversal",
    "t_rev": "the time since the last reversal",
    "v": "the speed",
    "a": "the acceleration",
    "mean_v": "the mean speed",
}
_OF_ALL = dict.fromkeys(PLACE_NAMES, "the place on the work") | {CLOCK_NAME: "the time with all sessions end to end"}


def unread_columns(names: Iterable[str]) -> Iterator[str]:
    """Say of columns whose names are geoerr's own that they are not read, and of those that nearly are, too."""
    for name in names:
        if name in _WORKED_OUT:
            kind, _, axis = name.rpartition("_")
            meaning = _OF_ALL.get(name) or _OF_AXES[kind]
            remedy = f"did you mean dir_{axis}?" if kind == "d" else "rename it if an effect is to follow it"
            yield f"the column {name} is not read: the name is geoerr's own, for {meaning}; {remedy}"
        elif name not in _KNOWN and (word := _nearly(name)):
            yield f"the column {name!r} is one of your own; did you mean {word}? That is what would be read"
        elif looks_like_temperature(name):
            yield (
                f"the column {name!r} is one of your own; if it is a temperature, name it temp_{_as_name(name)}: "
                "effects of temperature follow temp and temp_... alone"
            )


def _as_name(name: str) -> str:
    return re.sub(r"\W+", "_", name.lower())


def _nearly(name: str) -> str | None:
    """Give the column of geoerr's that is a slip, or capitals, blanks and underscores, away; None where none is."""
    twin = meant(name.replace(" ", ""), _KNOWN, cutoff=1.0)
    return twin or (meant(name, _LONG, cutoff=_SLIP) if len(name) >= _LONG_ENOUGH else None)


def stated_rows(covariance_mm2: Numbers | None, is_measured: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Tell which rows state every element of the covariance of what they measured, (n,)."""
    if covariance_mm2 is None:
        return np.zeros(len(is_measured), dtype=bool)
    needed = is_measured[:, :, None] & is_measured[:, None, :]
    return np.asarray((np.isfinite(covariance_mm2) | ~needed).all(axis=(1, 2)))


def mean_covariance(filled_mm2: Numbers, needed: npt.NDArray[np.bool_]) -> Numbers:
    """Give the mean covariance (3, 3) of rows that state theirs, of what each measured.

    A component that none of them measured (a camera beside lasers along x and y alone) has the mean of the others.

    Parameters
    ----------
    filled_mm2 : (n, 3, 3)
        Their covariances, 0 where not measured.
    needed : (n, 3, 3)
        Which elements are of what was measured.
    """
    counts = needed.sum(axis=0)
    mean = filled_mm2.sum(axis=0) / np.maximum(counts, 1)
    nobody = np.diagonal(counts) == 0
    if nobody.any() and not nobody.all():
        mean[nobody, nobody] = np.diagonal(mean)[~nobody].mean()
    return np.asarray(mean)


def unused_uncertainties(observations: Observations, is_measured: npt.NDArray[np.bool_]) -> str | None:
    """Say why no row has an uncertainty though there are columns for it; None where some has, or there are none.

    Parameters
    ----------
    is_measured
        Which components of the rows were measured, (n, 3).
    """
    if (stated_rows(observations.covariance_mm2, is_measured) & is_measured.any(axis=1)).any():
        return None
    columns = observations.frame.columns
    has_deviations = any(name in columns for name in STANDARD_UNCERTAINTY)
    is_covariance = all(name in columns for name in COVARIANCE) or not has_deviations
    names: Sequence[str] = COVARIANCE if is_covariance else STANDARD_UNCERTAINTY
    if not any(name in columns for name in names):
        return None
    needed = [
        bool((is_measured[:, one] & is_measured[:, other]).any())
        for one, other in _OF_COVARIANCE
        if is_covariance or one == other
    ]
    stated = [name for name in names if np.isfinite(observations.numbers(name)).any()]
    lacking = [name for name, is_needed in zip(names, needed, strict=True) if is_needed and name not in stated]
    if not stated:
        return "no row states the uncertainty of its position: the columns are empty"
    if not lacking:
        return (
            f"{_are(stated)} stated, but in no row for all that it measured: none of them is used; state them in "
            "every row"
        )
    said = f"{_are(stated)} stated and {_are(lacking)} not: none of them is used"
    if is_covariance:
        return f"{said}; state all six elements of the covariance, or {listed(STANDARD_UNCERTAINTY)} in their place"
    return f"{said}; state {listed(lacking)}, or leave {listed([f'm{name[1]}' for name in lacking])} out"


def lacking_rows(count: int) -> str:
    """Say how many rows state no uncertainty beside others that do."""
    return (
        f"{counted(count, 'row')} {'states' if count == 1 else 'state'} no uncertainty, or not that of every "
        "component that was measured: given the mean of the others"
    )


def _are(names: Sequence[str]) -> str:
    return f"{listed(names)} {'is' if len(names) == 1 else 'are'}"
