"""The columns of the observations that identification needs, as arrays, with what each session's device measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.fit.columns import lacking_rows, mean_covariance, stated_rows, unused_uncertainties
from geoerr.fit.unbelievable import unbelievable_rows
from geoerr.identify.linear import Numbers
from geoerr.observations import Observations


@dataclass(frozen=True)
class Measurements:
    """Rows of observations as arrays; row i is row i of the table.

    Attributes
    ----------
    commanded_mm, offset_mm, measured_mm : (n, 3)
        Commanded axis positions, target offsets, measured positions (NaN where a component was not measured).
    covariance_mm2 : (n, 3, 3) or None
        Covariance of the measured positions; 0 in components that were not measured.
    session, line, carrier, target : (n,)
        Labels.
    repeat : (n,)
        Number of the repetition.
    is_parallel : dict
        Session to whether its device never measures all three components at once: its frame is then parallel to the
        base (`docs/reference/formats/observations.md`: nobody can tell how it is tilted).
    usable : (n,)
        Whether the row was measured as completely as its session's device measures.
    is_of_cameras
        Whether pixels stand beside the positions.
    notes
        What had to be filled in.
    """

    commanded_mm: Numbers
    offset_mm: Numbers
    measured_mm: Numbers
    covariance_mm2: Numbers | None
    session: npt.NDArray[np.str_]
    line: npt.NDArray[np.str_]
    carrier: npt.NDArray[np.str_]
    target: npt.NDArray[np.str_]
    repeat: npt.NDArray[np.int64]
    is_parallel: dict[str, bool]
    usable: npt.NDArray[np.bool_]
    is_of_cameras: bool
    notes: tuple[str, ...]


def measurements_of(observations: Observations) -> Measurements:
    """Take the arrays out of the table."""
    measured = observations.measured_mm
    session = np.asarray(observations.texts("session"), dtype=np.str_)
    is_complete = np.asarray(np.isfinite(measured).all(axis=1))
    is_parallel = {str(name): not bool(is_complete[session == name].any()) for name in np.unique(session)}
    parallel_rows = np.array([is_parallel[str(name)] for name in session], dtype=bool)
    usable = np.asarray(np.where(parallel_rows, np.isfinite(measured).any(axis=1), is_complete))
    disbelieved = usable & unbelievable_rows(observations.covariance_mm2, np.isfinite(measured))
    if not disbelieved[usable].all():
        usable &= ~disbelieved
    covariance, notes = _filled_covariance(observations, measured, usable)
    return Measurements(
        commanded_mm=observations.commanded_mm,
        offset_mm=observations.target_offset_mm,
        measured_mm=measured,
        covariance_mm2=covariance,
        session=session,
        line=np.asarray(observations.texts("line"), dtype=np.str_),
        carrier=np.asarray(observations.texts("carrier"), dtype=np.str_),
        target=np.asarray(observations.texts("target"), dtype=np.str_),
        repeat=observations.numbers("repeat")[:, 0].astype(np.int64),
        is_parallel=is_parallel,
        usable=usable,
        is_of_cameras=observations.is_of_cameras,
        notes=notes,
    )


def _filled_covariance(
    observations: Observations, measured: Numbers, usable: npt.NDArray[np.bool_]
) -> tuple[Numbers | None, tuple[str, ...]]:
    """Zero what belongs to unmeasured components; give rows without an uncertainty the mean of the others."""
    covariance, seen = observations.covariance_mm2, np.isfinite(measured)
    needed = seen[:, :, None] & seen[:, None, :]
    stated = stated_rows(covariance, seen) & usable
    if covariance is None or not stated.any():
        note = unused_uncertainties(observations, seen & usable[:, None])
        return None, () if note is None else (note,)
    filled = np.where(needed & np.isfinite(covariance), covariance, 0.0)
    lacking = usable & ~stated
    if not lacking.any():
        return filled, ()
    filled[lacking] = np.where(needed[lacking], mean_covariance(filled[stated], needed[stated]), 0.0)
    return filled, (lacking_rows(int(lacking.sum())),)
