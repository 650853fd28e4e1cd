"""What measuring a session gives, and how it is written."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from geoerr.observations import Observations, write_observations
from geoerr.vision.consistency import Agreement, MeasuredSize
from geoerr.vision.frame import Missed


@dataclass(frozen=True)
class Measured:
    """What measuring a session gave.

    Attributes
    ----------
    observations
        One row for each target seen in a frame, in the order of frames.
    missed
        Frames and targets without an observation, with the reason.
    n_frames
        Frames that were looked at.
    agreement
        Whether the corners scatter as they should; covariances carry `birge_ratio²` where it is above 1.
    sizes
        Measured side of each target.
    n_local_corners
        Observations whose corners come from a local detector, because the picture could not be fitted.
    names_session
        Whether frames.csv names sessions; if not, the written table does not either.
    notes
        What the user should know, in words.
    """

    observations: Observations
    missed: tuple[Missed, ...]
    n_frames: int
    agreement: Agreement
    sizes: tuple[MeasuredSize, ...]
    n_local_corners: int
    names_session: bool
    notes: tuple[str, ...] = field(default=())

    def to_document(self) -> dict[str, Any]:
        """Give the content of `measure --json`."""
        return {
            "frames": self.n_frames,
            "observations": len(self.observations),
            "missed": [
                {"frame": item.frame, "camera": item.camera, "target": item.target, "why": item.why}
                for item in self.missed
            ],
            "birge_ratio": self.agreement.birge_ratio,
            "rig_shift_sigmas": self.agreement.rig_shift_sigmas,
            "local_corners": self.n_local_corners,
            "targets": [
                {
                    "target": size.target,
                    "observations": size.n,
                    "given_mm": size.given_mm,
                    "measured_mm": size.measured_mm,
                    "std_mm": size.std_mm,
                }
                for size in self.sizes
            ],
            "notes": list(self.notes),
        }


def write_measured(path: str | Path, measured: Measured) -> None:
    """Write the observations, whole or not at all.

    A session name that frames.csv does not give is not written: two files without one are two sessions.
    """
    observations = measured.observations
    if not measured.names_session:
        observations = replace(observations, frame=observations.frame.drop("session"))
    write_observations(path, observations)
