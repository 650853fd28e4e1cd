"""Whether a correction is worth having: its size beside its own standard uncertainty, where a program works."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from geoerr.model import Model
from geoerr.model.conditions import OF_MOTION

# Places along each axis: smooth functions of three axes are well met by five.
_N_PLACES = 5
# Any direction, a long stroke, at rest: what of the correction follows these is usually its smaller part.
_APPROACH = {"d": 1.0, "s": 100.0, "v": 0.0}

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Benefit:
    """Correction and its uncertainty over the box of a program's moves.

    Attributes
    ----------
    rms_um
        Root mean square of the correction's length.
    std_um
        Root mean square of its standard uncertainty, square root of the trace of its covariance.
    share_not_determined
        Share of the places where the data of the fit do not determine the correction; what is not determined is not
        in `std_um`.
    """

    rms_um: float
    std_um: float
    share_not_determined: float

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know, in sentences."""
        notes = []
        if self.std_um > self.rms_um > 0.0:
            notes.append(
                f"the correction is typically {self.rms_um:.3g} µm, less than its own standard uncertainty of "
                f"{self.std_um:.3g} µm: it may do more harm than good"
            )
        if self.share_not_determined > 0.0:
            notes.append(
                f"the data do not determine the correction in {self.share_not_determined:.0%} of the program's box: "
                "what is not determined counts as 0"
            )
        return tuple(notes)


def benefit_of(model: Model, box_mm: Box, at: dict[str, float], threads: int = 0) -> Benefit | None:
    """Compare a correction with its uncertainty over a box; None where the model has no record of a fit."""
    if model.record is None or not model.machine_terms or not np.isfinite(box_mm).all():
        return None
    places = np.array(list(itertools.product(*(np.linspace(low, high, _N_PLACES) for low, high in box_mm))))
    approach = {name: _APPROACH.get(name.partition("_")[0], 0.0) for name in OF_MOTION}
    conditions = {**approach, "moving": 1.0, **at}
    error_mm = model.error_mm(places, at=conditions, threads=threads)
    covariance = model.prediction_covariance_mm2(places, at=conditions, threads=threads)
    is_determined = model.is_determined_at(places, at=conditions, threads=threads)
    return Benefit(
        rms_um=1e3 * float(np.sqrt(np.mean(np.sum(error_mm**2, axis=1)))),
        std_um=1e3 * float(np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2)))),
        share_not_determined=float(np.mean(~is_determined.all(axis=1))),
    )
