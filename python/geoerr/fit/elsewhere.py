"""How far a fit is off where nothing was measured: whole lines left out by turns, and whole places of an axis.

A pass that is left out is predicted from others at the same places: what a model does between these no such figure
shows, and no uncertainty of its numbers holds it. A line that is left out with all its passes, or a place of an axis
with all rows at it, is predicted from what was measured around it. That is further away than what lies between, so
that it is rather too large. What the others hardly tell (the only line along an axis, the outermost places) shows
nothing but that, and is left aside.

Verified in tests/fit/test_elsewhere.py against errors that were put in, at places that were not measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from geoerr.distributions import chi_squared_sf
from geoerr.fit.classic import positions_by_axis
from geoerr.fit.figures import figures_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.held_out import HeldOut
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.machine import AXES
from geoerr.observations import CARRIERS
from geoerr.summaries import listed

# Fewer lines or places stand for nothing between them; so many lines are left out by turns, as passes are; axes with
# more places are dense enough.
_FEWEST, _MOST_FOLDS, _MOST_PLACES = 5, 20, 100
# Passes that come to a place in the mean, and passes of a line: with fewer the passes that are left out show it.
_OFTEN = 1.5
# What is missed at other places stands out from what is missed at the same ones by this factor.
_STANDS_OUT = 1.25
# Less probable than this, what is missed at places that are left out is not chance.
_CHANCE = 0.01
_UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Residuals of lines or places that the fit did not see.

    Attributes
    ----------
    fitted
        The fit.
    residual_mm : (n, 3)
        In base axes; NaN where not computable.
    is_told : (n,)
        Rows that the others tell to within what a row scatters.
    fold : (n,)
        The line or place of each row.
    expected_mm2 : (n,)
        What the uncertainty of the others' prediction makes of the square of a residual.
    """

    fitted: Fitted
    residual_mm: Numbers
    is_told: np.ndarray
    fold: np.ndarray
    expected_mm2: Numbers

    def um(self, rows: np.ndarray | None = None) -> float | None:
        """Give the error over the rows that the others tell, or over others (n,); None where there is none."""
        return _headline_um(self.fitted, self.residual_mm, self.is_told if rows is None else rows)

    @property
    def same_places_um(self) -> float | None:
        """The error over the same rows with passes left out, which leave others at the same places."""
        return _headline_um(self.fitted, self.fitted.held_out.residual_mm, self.is_told)

    @property
    def stands_out(self) -> bool:
        """Whether what is missed here is clearly more than what is missed at places that were seen."""
        missed_um, same_um = self.um(), self.same_places_um
        return missed_um is not None and same_um is not None and missed_um > _STANDS_OUT * same_um

    @cached_property
    def shift_mm(self) -> Numbers:
        """By how much a place's own rows shift what is predicted there, by place, (n_places, 3).

        What a residual is here less what it is with its pass left out, in the mean over the place's rows: their own
        noise is in both, and so is what the model lacks at all places.
        """
        return self._by_place((self.residual_mm - self.fitted.held_out.residual_mm)[self.is_told])

    @cached_property
    def expected_shift_mm2(self) -> Numbers:
        """What chance makes of the square of a shift, of all components, (n_places,)."""
        return self._by_place(self.expected_mm2[self.is_told, None])[:, 0]

    def off_mm2(self, level: float) -> Numbers:
        """Give the mean square of the shifts beyond chance, by component (3,); zeros where chance does as much."""
        square_mm2 = (self.shift_mm**2).mean(axis=0)
        times = float(square_mm2.sum()) / max(float(self.expected_shift_mm2.mean()), np.finfo(float).tiny)
        n_places = len(self.shift_mm)
        # Of the components of a place one may be all that is off, and neighbours share rows: one number a place.
        if chi_squared_sf(n_places * times, n_places) >= level:
            return np.zeros(3)
        return np.asarray((1.0 - 1.0 / times) * square_mm2)

    def _by_place(self, values: Numbers) -> Numbers:
        _, of_place = np.unique(self.fold[self.is_told], return_inverse=True)
        sums = np.stack([np.bincount(of_place, column) for column in values.T], axis=1)
        return np.asarray(sums / np.bincount(of_place)[:, None])


@dataclass(frozen=True, eq=False)
class Between:
    """By how much a model may be off between the places that were measured.

    Attributes
    ----------
    std_mm : (3,)
        Of the error's x, y, z.
    n_places
        How many places tell it: of the axes along which it is off, where it is along any.
    """

    std_mm: Numbers
    n_places: int


def lines_left_out(fitted: Fitted) -> LeftOut | None:
    """Leave every line out with all its passes; None where lines are few, or were run once each."""
    sightings = fitted.sightings
    line = _lines_of(sightings)
    n_lines = int(line.max(initial=-1)) + 1
    if n_lines < _FEWEST or sightings.n_passes < _OFTEN * n_lines or not _are_points(sightings):
        return None
    return _left_out(fitted, line % _MOST_FOLDS, np.ones(len(line), dtype=bool))


def places_left_out(fitted: Fitted, axis: str) -> LeftOut | None:
    """Leave every place of an axis out with all rows at it; None where places are few, dense, or seen once each."""
    return fitted.once(f"places of {axis} left out", partial(_places_left_out, axis=axis))


def _places_left_out(fitted: Fitted, axis: str) -> LeftOut | None:
    sightings = fitted.sightings
    along_mm = sightings.commanded_mm[:, AXES.index(axis)]
    places_mm = positions_by_axis(sightings.commanded_mm, SAME_POSITION_MM)[axis]
    if not _FEWEST <= len(places_mm) <= _MOST_PLACES or not _are_points(sightings):
        return None
    place = np.abs(along_mm[:, None] - places_mm).argmin(axis=1)
    visits = len(np.unique(np.stack([place, sightings.pass_number]), axis=1).T)
    if visits < _OFTEN * len(places_mm):
        return None
    return _left_out(fitted, place, (place > 0) & (place < len(places_mm) - 1))


def beyond_the_lines_um(before: Fitted, after: Fitted) -> tuple[float, float] | None:
    """Give the errors of two fits to the same rows with whole lines left out, where others tell the first."""
    first, second = lines_left_out(before), lines_left_out(after)
    if first is None or second is None:
        return None
    rows = first.is_told & np.isfinite(second.residual_mm).all(axis=1)
    missed_um = first.um(rows), second.um(rows)
    return None if missed_um[0] is None or missed_um[1] is None else (missed_um[0], missed_um[1])


def beyond_the_lines_words(missed_um: tuple[float, float]) -> str:
    """Say what `beyond_the_lines_um` gives, and what to do where what was added does harm there."""
    before_um, after_um = missed_um
    text = f"with whole lines left out {before_um:.1f} → {after_um:.1f} µm"
    if after_um <= before_um:
        return text
    return f"{text}: where no line was measured it does harm; measure more lines before a program is corrected by it"


def beyond_the_lines_document(missed_um: tuple[float, float] | None) -> dict[str, float] | None:
    """Give what `beyond_the_lines_um` gives as `--json` has it."""
    return None if missed_um is None else {"before": missed_um[0], "after": missed_um[1]}


def between_the_places(fitted: Fitted) -> Iterator[str]:
    """Say by how much places of axes are missed that are left out, where that is far, and what to do."""
    each = {axis: left_out for axis in AXES if (left_out := places_left_out(fitted, axis)) is not None}
    missed = [
        f"{left_out.um():.1f} µm for {left_out.same_places_um:.1f} along {axis}"
        for axis, left_out in each.items()
        if left_out.stands_out
    ]
    if missed:
        yield (
            "with all rows at a place left out the model misses it by more than with passes left out, "
            f"{listed(missed)}: so far it may be off between its places, which `geoerr budget` counts and no ± of "
            "its numbers holds; measure at places in between"
        )


def off_between_places(fitted: Fitted) -> Between | None:
    """Give what a model is off by between places, where it is more than chance; zeros where it is not.

    None where nothing tells: of no axis are there places that were seen more than once and that others tell. Places
    that are left out have neighbours twice as far away as what lies between two; what the model lacks at its places,
    too, is not in it. Tests hold it to half and twice the truth, of machines with steps, bumps, tables and steep
    polynomials.
    """
    each = [left_out for axis in AXES if (left_out := places_left_out(fitted, axis)) is not None]
    if not each:
        return None
    off_mm2 = np.stack([left_out.off_mm2(_CHANCE / len(each)) for left_out in each])
    n_places, is_off = np.array([len(left_out.shift_mm) for left_out in each]), off_mm2.any(axis=1)
    # Along the others nothing was found that has a size.
    return Between(np.sqrt(off_mm2.sum(axis=0)), int(n_places[is_off].sum() if is_off.any() else n_places.sum()))


def _left_out(fitted: Fitted, fold: np.ndarray, counts: np.ndarray) -> LeftOut | None:
    if fitted.split.noise_um is None or fitted.held_out.figures is None:
        return None
    used = fitted.solved.used
    held = fitted.leave_out(fold)
    expected_mm2 = _expected_mm2(fitted, held, fold)
    n_folds = len(np.unique(fold[used]))
    is_told = used & (_UM_PER_MM * np.sqrt(expected_mm2) < fitted.split.noise_um)
    # A marker on the base stands where no axis moves it.
    is_told &= counts & (fitted.sightings.carrier != CARRIERS.index("base"))
    is_told &= np.isfinite(held.residual_mm).all(axis=1)
    is_told &= np.isfinite(fitted.held_out.residual_mm).all(axis=1)
    if n_folds < _FEWEST or not is_told.any():
        return None
    return LeftOut(fitted, held.residual_mm, is_told, fold, expected_mm2)


def _expected_mm2(fitted: Fitted, held: HeldOut, fold: np.ndarray) -> Numbers:
    """Give what the uncertainty of a prediction makes of the square of a residual, (n,): the mean of its fold."""
    used = fitted.solved.used
    _, of_row = np.unique(fold[used], return_inverse=True)
    expected_mm2 = np.full(len(fold), np.nan)
    expected_mm2[used] = fitted.scale**2 * held.variance_of_fold_mm2[of_row]
    return expected_mm2


def _headline_um(fitted: Fitted, residual_mm: Numbers, rows: np.ndarray) -> float | None:
    if not rows.any():
        return None
    um = figures_of(fitted.sightings, np.nan_to_num(residual_mm), rows).headline_um
    return um if um is not None and math.isfinite(um) else None


def _are_points(sightings: Sightings) -> bool:
    """Tell whether all rows are points: a circle has no lines, and of a length both ends are one number."""
    return not {"circle", "lengths"} & {*sightings.frames}


def _lines_of(sightings: Sightings) -> np.ndarray:
    """Give rows (n,) the number of their line: passes of one name, or at the same places, there and back."""
    names = sightings.texts("line") if "line" in sightings.table.columns else [""] * len(sightings)
    number_of: dict[object, int] = {}
    line = np.zeros(len(sightings), dtype=np.int64)
    order = np.argsort(sightings.pass_number, kind="stable")
    starts = np.flatnonzero(np.diff(sightings.pass_number[order], prepend=-1))
    for number, rows in enumerate(np.split(order, starts[1:])):
        line[rows] = number
        places = np.unique(np.rint(sightings.commanded_mm[rows] / SAME_POSITION_MM), axis=0).tobytes()
        for key in (places, names[rows[0]]):
            if key and key in number_of:
                # Two lines that were apart until now are one where a pass is of both.
                line[line == number_of[key]] = number
                number_of = {one: number if known == number_of[key] else known for one, known in number_of.items()}
            elif key:
                number_of[key] = number
    return np.asarray(np.unique(line, return_inverse=True)[1])
