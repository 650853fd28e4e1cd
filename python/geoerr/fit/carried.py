"""Targets that move where their carrier stands still, or the other way round: a carrier or a chain is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.errors import GeometryError
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.start import moving_targets, nominal_mm
from geoerr.machine import AXES, Machine
from geoerr.observations import CARRIERS

# Steps of one axis alone, of a millimetre and more: no error of a machine, nor any noise, is half of that.
_LEAST_STEP_MM = 1.0
_FEWEST_STEPS = 3
# Shares of a step up to which a target stands, and within which of the whole it goes along.
_STANDS, _GOES_ALONG = 0.3, 0.3
# Steps of several axes at once: so many, each axis with so much of a share in them that is its own; less than this of
# their squared lengths is left unexplained in the middle.
_FEWEST_TOGETHER, _LEAST_SHARE, _EXPLAINED = 12, 0.05, 0.05

_HINT = (
    "hint: `carrier` says what a target is fixed to, as the floor sees it (tool where the column is absent); relative"
    " is the tool as the work sees it, by a probe or on a part; check it, and the machine's chain"
)


def refuse_other_carriers(sightings: Sightings, machine: Machine) -> None:
    """Refuse targets that do the opposite of what their carrier does when an axis moves.

    Lengths of steps do not depend on how a device stands, so that one axis of three is seen where a frame that was
    fitted to all of them is turned by it.

    Raises
    ------
    GeometryError
        where most of such steps of an axis contradict the carrier, or steps of several axes at once do.
    """
    nominal = nominal_mm(machine, sightings)
    steps = _steps_of_one_axis(nominal, sightings)
    # Where nothing goes along at all another unit says more, or another file: that is not for here to say.
    something_goes = bool((~steps.should_stand & ~steps.contradicts).any())
    for axis in range(3):
        for carrier in np.unique(steps.carrier):
            own = (steps.axis == axis) & (steps.carrier == carrier) & (steps.should_stand | something_goes)
            if int(own.sum()) >= _FEWEST_STEPS and steps.contradicts[own].mean() > 0.5:
                raise GeometryError(_words(machine, sightings, steps, own))
    _refuse_together(machine, sightings, nominal)


def _refuse_together(machine: Machine, sightings: Sightings, nominal: Numbers) -> None:
    """Refuse carriers that steps of several axes at once contradict, as scattered points have them.

    A target goes along with an axis or does not, g = 1 or 0, so that the square of its step is sum g d^2 over the
    axes' steps d, however the device stands: three unknowns, by least squares over all steps.
    """
    first, second = _complete_steps(sightings)
    squares = (sightings.commanded_mm[second] - sightings.commanded_mm[first]) ** 2
    whole = squares.sum(axis=1)
    expected, seen = (
        ((places[second] - places[first]) ** 2).sum(axis=1) / np.maximum(whole, 1e-300)
        for places in (nominal, sightings.measured_mm)
    )
    shares = squares / np.maximum(whole, 1e-300)[:, None]
    for carrier in np.unique(sightings.carrier[first]):
        own = (sightings.carrier[first] == carrier) & (whole >= _LEAST_STEP_MM**2)
        if int(own.sum()) < _FEWEST_TOGETHER or np.linalg.eigvalsh(shares[own].T @ shares[own] / own.sum())[0] < (
            _LEAST_SHARE**2
        ):
            continue
        goes, ought = (np.linalg.lstsq(shares[own], values[own], rcond=None)[0] for values in (seen, expected))
        nearest = np.round(goes)
        is_told = (
            bool(np.isin(nearest, (0.0, 1.0)).all() and nearest.any())
            and float(np.abs(goes - nearest).max()) < _GOES_ALONG
            and float(np.median(np.abs(seen[own] - shares[own] @ nearest))) < _EXPLAINED
        )
        wrong = np.flatnonzero(nearest != np.round(ought))
        if is_told and len(wrong):
            raise GeometryError(_words_together(machine, CARRIERS[carrier], int(wrong[0]), bool(nearest[wrong[0]])))


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps (k,) of one axis alone: the row that each led to, axis, carrier, what the target ought to do, and did."""

    row: np.ndarray
    axis: np.ndarray
    carrier: np.ndarray
    should_stand: np.ndarray
    contradicts: np.ndarray


def _complete_steps(sightings: Sightings) -> tuple[np.ndarray, np.ndarray]:
    """Give rows of one target that follow each other, both measured in all three components, (k,) each."""
    rows = sightings.once("moving_targets", moving_targets)
    none = np.zeros(0, dtype=np.int64)
    first = np.concatenate([none, *(own[:-1] for own in rows)])
    second = np.concatenate([none, *(own[1:] for own in rows)])
    complete = np.asarray(sightings.is_measured.all(axis=1))
    both = complete[first] & complete[second]
    return first[both], second[both]


def _steps_of_one_axis(points_mm: Numbers, sightings: Sightings) -> _Steps:
    first, second = _complete_steps(sightings)
    step_mm = np.abs(sightings.commanded_mm[second] - sightings.commanded_mm[first])
    is_alone = (step_mm > SAME_POSITION_MM).sum(axis=1) == 1
    told = is_alone & (step_mm.max(axis=1, initial=0.0) >= _LEAST_STEP_MM)
    first, second, step_mm = first[told], second[told], step_mm[told]
    expected, seen = (
        np.linalg.norm(places[second] - places[first], axis=1) / step_mm.max(axis=1, initial=0.0)
        for places in (points_mm, sightings.measured_mm)
    )
    should_stand = np.asarray(expected < 0.5)
    contradicts = np.where(should_stand, np.abs(seen - 1.0) < _GOES_ALONG, seen < _STANDS)
    return _Steps(second, step_mm.argmax(axis=1), sightings.carrier[first], should_stand, contradicts)


def _words_together(machine: Machine, carrier: str, axis: int, goes: bool) -> str:
    did, does = ("move along with", "stands still") if goes else ("do not move with", "goes along")
    return (
        f"targets with carrier {carrier} {did} {AXES[axis].upper()}, by steps of several axes at once, where on a "
        f"machine {machine.chain} one on the {carrier} {does}\n{_HINT}"
    )


def _words(machine: Machine, sightings: Sightings, steps: _Steps, own: np.ndarray) -> str:
    wrong = np.flatnonzero(own & steps.contradicts)
    carrier, row = CARRIERS[steps.carrier[wrong[0]]], int(sightings.source_row[steps.row[wrong[0]]])
    did, does = ("moved with it", "stands still") if steps.should_stand[wrong[0]] else ("stood still", "goes along")
    return (
        f"when {AXES[steps.axis[wrong[0]]].upper()} moved, targets with carrier {carrier} {did}, where on a machine "
        f"{machine.chain} one on the {carrier} {does}: {len(wrong)} of {int(own.sum())} steps, the first to row "
        f"{row + 1} of the measurements\n{_HINT}"
    )
