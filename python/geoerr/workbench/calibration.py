"""The calibration's uncertainty as the page gives it to every fit and diagnosis: what `--rig` is for the verbs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geoerr.fit.result import CALIBRATION_UNKNOWNS
from geoerr.fit.sightings import Numbers
from geoerr.measurements import Measurements
from geoerr.model import Model
from geoerr.vision.sensitivity import calibration_of_points
from geoerr.workbench.inputs import InputFile


@dataclass(frozen=True, eq=False)
class Calibration:
    """How the calibration moves the points, (n, 3, p), and its covariance (p, p); None where it is not given."""

    rig_sensitivity: Numbers | None = None
    rig_covariance: Numbers | None = None

    @property
    def is_given(self) -> bool:
        """Whether it takes part."""
        return self.rig_sensitivity is not None


def calibration_of(files: Sequence[InputFile], measured: Measurements | None) -> Calibration:
    """Read the rig among the files, where there are points that its cameras saw.

    Raises
    ------
    InputFileError
        for a rig that states no covariance.
    GeometryError
        for points without pixels.
    """
    rigs = [one for one in files if one.kind == "rig"]
    if not rigs or measured is None or measured.points is None:
        return Calibration()
    return Calibration(*calibration_of_points(rigs[-1].path, measured.points))


def calibration_words(
    files: Sequence[InputFile], measured: Measurements | None, calibration: Calibration, model: Model | None
) -> tuple[str, ...]:
    """Say what is lost where the calibration takes no part."""
    told = []
    points = None if measured is None else measured.points
    has_rig = any(one.kind == "rig" for one in files)
    if has_rig and measured is not None and not calibration.is_given:
        told.append("the rig takes no part: these measurements are no cameras'")
    if not has_rig and points is not None and points.is_of_cameras:
        told.append("the calibration's uncertainty is not included: add the rig (rig.json)")
    fitted_with = 0.0 if model is None or model.record is None else model.record.noise.get(CALIBRATION_UNKNOWNS, 0.0)
    if fitted_with > 0.0 and points is not None and not calibration.is_given:
        told.append("the model was fitted with its calibration's uncertainty; it is lost here without the rig")
    return tuple(told)
