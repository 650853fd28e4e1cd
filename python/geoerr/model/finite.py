"""Where a formula gives no number: it divides by zero, or leaves what a root or a logarithm is defined for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from geoerr.errors import GeoerrError
from geoerr.machine import AXES
from geoerr.model.arrays import Numbers
from geoerr.model.compile import compile_terms
from geoerr.model.model import Model
from geoerr.model.worth import both_motions, spread_places
from geoerr.terms import Term

# Along an axis a pole lies between two places; each look is at the neighbours of the largest value, this much closer.
_N_ALONG_AXIS = 201
_N_CLOSER_LOOKS = 6
# What grows a millionfold while it is looked at more closely has no largest value.
_GROWTH_OF_A_POLE = 1e6
# Formulas without these are finite wherever their values can be computed at all.
_MAY_HAVE_POLES = ("/", "tan", "log", "^", "**")


def refuse_not_finite(model: Model, at: Mapping[str, float]) -> None:
    """Refuse conditions under which a term of the machine gives no finite number in the whole measured volume.

    Parameters
    ----------
    model
        The model.
    at
        One number for each condition that it follows; of motion two states are looked at, whatever is stated.

    Raises
    ------
    GeoerrError
        naming term and conditions.
    """
    for term in _by_formula(model):
        if not _is_finite_at(model, term, spread_places(model.measured_box_mm), at).any():
            raise GeoerrError(
                f"{term.id} gives no finite number{_under(model, term, at)}\n"
                "hint: there its formula divides by zero, or leaves what a root or a logarithm is defined for: state "
                "another condition, correct the formula, or take the effect out with `geoerr remove`"
            )


def not_finite_notes(model: Model, at: Mapping[str, float]) -> tuple[str, ...]:
    """Say of each term that has them where in the measured volume it gives no finite number, or has a pole."""
    notes = []
    box_mm = model.measured_box_mm
    places = spread_places(box_mm)
    for term in _by_formula(model):
        without = ~_is_finite_at(model, term, places, at)
        if without.any():
            place = ", ".join(f"{coordinate:.4g}" for coordinate in places[np.argmax(without)])
            notes.append(
                f"{term.id} gives no finite number in {without.mean():.0%} of the measured volume, as at ({place}) mm"
            )
        elif (pole := _pole(model, term, box_mm, at)) is not None:
            notes.append(
                f"{term.id} has no finite number at {pole}, and grows without limit near it: its formula divides by "
                "zero there"
            )
    return tuple(notes)


def _by_formula(model: Model) -> tuple[Term, ...]:
    return tuple(term for term in model.machine_terms if any(part.expression is not None for part in term.parts))


def _moved_mm(model: Model, term: Term, places: Numbers, at: Mapping[str, float]) -> Numbers:
    """Give what a term alone moves at places (n, 3) in mm: (n, 3)."""
    alone = Model(model.machine, None, (term,))
    names = alone.conditions
    conditions: dict[str, npt.ArrayLike] = {**both_motions(len(places)), **at}
    return alone.contributions(places, at={name: conditions[name] for name in names if name in conditions})[term.id]


def _is_finite_at(model: Model, term: Term, places: Numbers, at: Mapping[str, float]) -> npt.NDArray[np.bool_]:
    return np.asarray(np.isfinite(_moved_mm(model, term, places, at)).all(axis=1))


def _under(model: Model, term: Term, at: Mapping[str, float]) -> str:
    names = compile_terms(model.machine, (term,)).variables
    stated = ", ".join(f"{name} = {at[name]:g}" for name in names if name in at)
    return f" at {stated}" if stated else " anywhere in the measured volume"


def _pole(model: Model, term: Term, box_mm: tuple[tuple[float, float], ...], at: Mapping[str, float]) -> str | None:
    """Name a coordinate at which a term grows without limit, along the axes through the middle of a box."""
    if not any(sign in (part.expression or "") for part in term.parts for sign in _MAY_HAVE_POLES):
        return None
    for index, axis in enumerate(AXES):
        coordinate_mm = _pole_along(model, term, np.mean(box_mm, axis=1), index, box_mm[index], at)
        if coordinate_mm is not None:
            return f"{axis} = {coordinate_mm:.6g} mm"
    return None


def _pole_along(
    model: Model, term: Term, middle_mm: Numbers, index: int, span_mm: tuple[float, float], at: Mapping[str, float]
) -> float | None:
    low, high = span_mm
    first_mm, largest_at = 0.0, low
    for look in range(_N_CLOSER_LOOKS):
        places = np.tile(middle_mm, (_N_ALONG_AXIS, 1))
        places[:, index] = np.linspace(low, high, _N_ALONG_AXIS)
        moved_mm = np.abs(_moved_mm(model, term, places, at)).max(axis=1)
        largest = int(np.argmax(np.where(np.isnan(moved_mm), np.inf, moved_mm)))
        largest_at = float(places[largest, index])
        if not np.isfinite(moved_mm[largest]):
            return largest_at
        if look == 0:
            first_mm = float(moved_mm[largest])
        elif moved_mm[largest] > _GROWTH_OF_A_POLE * first_mm > 0.0:
            return largest_at
        low, high = float(places[max(largest - 1, 0), index]), float(places[min(largest + 1, len(places) - 1), index])
    return None
