"""A measured length in the working volume against what the calibrated rig sees.

The board's square is what a calibration takes its scale from; a length measured by other means is the only witness
against it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geoerr.vision.consistency import agreement
from geoerr.vision.frame import FrameReader, FrameResult
from geoerr.vision.plate import SeenPlates, locate_plates
from geoerr.vision.rig import Rig
from geoerr.vision.sensitivity import sensitivity_of_points
from geoerr.vision.session import ScaleBar

# Corners that miss each other by more than this, and by more than so many times what is stated of them, are not of
# one moment and one rig: nothing that they say is a length.
_APART_PX = 0.1
_MOST_SCATTER = 10.0


@dataclass(frozen=True)
class ScaleBarResult:
    """One scale bar as seen.

    Attributes
    ----------
    left, right
        The pictures.
    targets
        Names of the two targets.
    length_mm, std_mm
        As given.
    seen_mm, seen_std_mm
        As the rig sees it; the uncertainty holds the pictures' noise, enlarged where corners scatter more than that,
        and the rig's covariance. None where not seen.
    why
        '' or why it was not seen.
    """

    left: str
    right: str
    targets: tuple[str, str]
    length_mm: float
    std_mm: float
    seen_mm: float | None
    seen_std_mm: float | None
    why: str = ""

    @property
    def difference_um(self) -> float | None:
        """Seen minus given."""
        return None if self.seen_mm is None else 1e3 * (self.seen_mm - self.length_mm)

    @property
    def difference_ppm(self) -> float | None:
        """Seen over given, minus 1."""
        return None if self.seen_mm is None else 1e6 * (self.seen_mm / self.length_mm - 1.0)

    @property
    def sigmas(self) -> float | None:
        """Difference over the standard uncertainty of both together."""
        if self.seen_mm is None or self.seen_std_mm is None:
            return None
        return (self.seen_mm - self.length_mm) / math.hypot(self.std_mm, self.seen_std_mm)

    def to_document(self) -> dict[str, Any]:
        """Give the form that `calibrate --json` prints."""
        return {
            "left": self.left,
            "right": self.right,
            "targets": list(self.targets),
            "length_mm": self.length_mm,
            "std_mm": self.std_mm,
            "seen_mm": self.seen_mm,
            "seen_std_mm": self.seen_std_mm,
            "difference_um": self.difference_um,
            "difference_ppm": self.difference_ppm,
            "sigmas": self.sigmas,
            "why": self.why or None,
        }


def check_scale_bars(directory: Path, bars: Sequence[ScaleBar], rig: Rig) -> tuple[ScaleBarResult, ...]:
    """Measure every scale bar with the rig; one that cannot be seen is listed with the reason.

    Parameters
    ----------
    directory
        The session's folder.
    bars
        What was measured by other means.
    rig
        With its covariance, which is part of the stated uncertainty.
    """
    return tuple(_check(directory, bar, rig) for bar in bars)


def _check(directory: Path, bar: ScaleBar, rig: Rig) -> ScaleBarResult:
    names = (bar.targets[0].name, bar.targets[1].name)
    given = (bar.left, bar.right, names, bar.length_mm, bar.std_mm)
    frame = FrameReader(directory, rig, bar.targets).read(0, bar.left, bar.right)
    if len(frame.seen) < 2:
        return ScaleBarResult(*given, None, None, _why_unseen(frame))
    plates = locate_plates(
        rig,
        SeenPlates(
            np.stack([item.left.corners_px for item in frame.seen]),
            np.stack([item.left.covariance_px2 for item in frame.seen]),
            np.stack([item.right.corners_px for item in frame.seen]),
            np.stack([item.right.covariance_px2 for item in frame.seen]),
        ),
    )
    if any(plates.why):
        return ScaleBarResult(
            *given, None, None, "; ".join(f"{n}: {why}" for n, why in zip(names, plates.why, strict=True) if why)
        )
    scatter = agreement(plates.whitened_residual, plates.whitened_by_rig, rig).birge_ratio
    apart_px = float(plates.reprojection_px.max())
    if apart_px > _APART_PX and scatter > _MOST_SCATTER:
        why = (
            f"its two pictures miss each other by {apart_px:.2f} px: they are of two moments, or not of this rig; "
            "name a left and a right picture taken at once"
        )
        return ScaleBarResult(*given, None, None, why)
    apart = plates.centre_mm[1] - plates.centre_mm[0]
    seen_mm = float(np.linalg.norm(apart))
    along = apart / seen_mm
    variance = float(along @ plates.covariance_mm2.sum(axis=0) @ along) * max(1.0, scatter**2)
    if rig.covariance is not None:
        # An error of calibration moves both ends: only its difference changes the length.
        ends = sensitivity_of_points(rig, plates.centre_mm)
        by_rig = along @ (ends[1] - ends[0])
        variance += float(by_rig @ rig.covariance @ by_rig)
    return ScaleBarResult(*given, seen_mm, math.sqrt(variance))


def _why_unseen(frame: FrameResult) -> str:
    reasons = [f"{item.camera}: {item.target + ' ' if item.target else ''}{item.why}" for item in frame.missed]
    return "; ".join(reasons)
