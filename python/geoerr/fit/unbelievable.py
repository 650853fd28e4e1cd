"""Rows whose stated uncertainty no measurement can have: 0, below it, or a covariance that is none."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.fit.columns import stated_rows
from geoerr.fit.sightings import Numbers
from geoerr.observations import COVARIANCE, STANDARD_UNCERTAINTY, Observations
from geoerr.summaries import counted, place_of_row

# A standard uncertainty below a tenth of a nanometre is a slip, not a measurement, and would outweigh all others.
LEAST_STD_MM = 1e-7
NOT_POSITIVE = "its covariance is not positive"
# Of a covariance the elements that are variances.
_VARIANCES = ("cxx", "cyy", "czz")


def unbelievable_rows(covariance_mm2: Numbers | None, is_measured: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Tell which rows have a covariance that no measurement can have, (n,); one that is not stated is no obstacle."""
    if covariance_mm2 is None:
        return np.zeros(len(is_measured), dtype=bool)
    needed = is_measured[:, :, None] & is_measured[:, None, :]
    padded = np.where(needed & np.isfinite(covariance_mm2), covariance_mm2, 0.0)
    padded = padded + np.eye(3) * (~is_measured)[:, None, :]
    is_positive = np.linalg.eigvalsh(padded)[:, 0] >= LEAST_STD_MM**2
    return np.asarray(stated_rows(covariance_mm2, is_measured) & ~is_positive)


def stated_std_mm(frame: pl.DataFrame, column: str, what: str) -> tuple[Numbers, bool, tuple[str, ...]]:
    """Give the standard uncertainty of each row that states one number, (n,); whether all state it; and a note.

    `what` names the numbers, in the plural.
    """
    if column not in frame.columns:
        return np.full(frame.height, np.nan), False, ()
    std_mm = frame[column].cast(pl.Float64, strict=False).to_numpy().astype(np.float64)
    is_known = np.isfinite(std_mm) & (std_mm >= LEAST_STD_MM)
    if is_known.all() or not np.isfinite(std_mm).any():
        return std_mm, bool(is_known.all()), ()
    lacking = int((~is_known).sum())
    note = (
        f"the uncertainty {column} is lacking, or too small to be one, in {lacking} of {frame.height} {what}: it is "
        "not used in the others either"
    )
    return std_mm, False, (note,)


def place_of_unbelievable(observations: Observations, rows: npt.NDArray[np.bool_]) -> Iterator[str]:
    """Name the first of these rows, its column and what stands there."""
    first = int(np.argmax(rows))
    place = place_of_row(float(observations.numbers("file_row")[first, 0]), first)
    cells = {
        name: float(observations.numbers(name)[first, 0])
        for name in (*STANDARD_UNCERTAINTY, *_VARIANCES)
        if name in observations.frame.columns
    }
    wrong = next((f"{name} {value:g} there" for name, value in cells.items() if value <= 0.0), None)
    has, takes = ("has", "takes") if rows.sum() == 1 else ("have", "take")
    yield (
        f"{counted(int(rows.sum()), 'row')}, the first in {place}, {has} no uncertainty that a measurement can have "
        f"and {takes} no part: "
        f"{wrong or ', '.join(COVARIANCE) + ' there are no covariance'}; a standard uncertainty is above 0 mm"
    )
