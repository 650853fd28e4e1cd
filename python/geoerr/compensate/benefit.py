"""Whether a correction is worth having: its size beside its own standard uncertainty, where a program works."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.error_functions import ErrorFunction, ErrorFunctions
from geoerr.model import Model
from geoerr.model.worth import both_motions, spread_places

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Benefit:
    """Correction and its uncertainty over the box of a program's moves.

    Attributes
    ----------
    rms_um
        Root mean square of the correction's length.
    determined_rms_um, std_um
        The same of what is determined of it, and of its standard uncertainty: each component's own mean. `std_um` is
        None where no component is determined anywhere.
    is_worth
        Whether the mean square of the correction, where it is determined, is above twice its variance: below, what it
        takes away is less than what it adds.
    share_not_determined
        Share of the places where the data of the fit do not determine all of the correction; what is not determined
        is not in `std_um`.
    """

    rms_um: float
    determined_rms_um: float
    std_um: float | None
    is_worth: bool
    share_not_determined: float

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know, in sentences."""
        notes = []
        if not self.is_worth and self.std_um is not None:
            where = " where the data determine it" if self.share_not_determined > 0.0 else ""
            notes.append(
                f"in the box of this program the correction is typically {self.determined_rms_um:.3g} µm{where}, "
                f"with a standard uncertainty of {self.std_um:.3g} µm: there it may do more harm than good"
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
    # A program goes to every place both ways.
    places = np.repeat(spread_places(box_mm), 2, axis=0)
    conditions: dict[str, npt.ArrayLike] = {**both_motions(len(places)), **at}
    error_mm = model.error_mm(places, at=conditions, threads=threads)
    covariance = model.prediction_covariance_mm2(places, at=conditions, threads=threads)
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    is_determined = np.isfinite(variance)
    squares = np.where(is_determined, error_mm**2, 0.0).sum(axis=0)
    variances = np.where(is_determined, variance, 0.0).sum(axis=0)
    count = np.maximum(is_determined.sum(axis=0), 1)
    mean_square, mean_variance = float((squares / count).sum()), float((variances / count).sum())
    return Benefit(
        rms_um=1e3 * float(np.sqrt(np.mean(np.sum(error_mm**2, axis=1)))),
        determined_rms_um=1e3 * float(np.sqrt(mean_square)),
        std_um=1e3 * float(np.sqrt(mean_variance)) if is_determined.any() else None,
        is_worth=mean_square >= 2.0 * mean_variance or not mean_square > 0.0,
        share_not_determined=float(np.mean(~is_determined.all(axis=1))),
    )


def uncertain_tables(errors: ErrorFunctions | None) -> tuple[str, ...]:
    """Name the errors of tables whose mean square is below twice their variance: worth less than nothing alone."""
    if errors is None:
        return ()
    names = [name for name, function in errors.functions.items() if _is_uncertain(function)]
    names += [
        name
        for name, one in errors.squareness.items()
        if one.std_rad is not None and 0.0 < one.value_rad**2 < 2.0 * one.std_rad**2
    ]
    return tuple(names)


def _is_uncertain(function: ErrorFunction) -> bool:
    if function.std is None:
        return False
    mean_square = float(np.mean(np.square(function.value)))
    return 0.0 < mean_square < 2.0 * float(np.mean(np.square(function.std)))
