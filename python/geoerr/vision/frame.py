"""One frame, a picture from each camera, to the corners of the targets that both show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geoerr.errors import InputFileError
from geoerr.vision.images import read_grey
from geoerr.vision.marker_fit import MarkerFit, MarkerFitError
from geoerr.vision.markers import Found, find_markers, refine_marker
from geoerr.vision.rig import Rig
from geoerr.vision.session import Target

GreyImage = npt.NDArray[np.uint8]
CAMERAS = ("left", "right")


@dataclass(frozen=True)
class Missed:
    """A target, or a whole frame, that gave no observation.

    Attributes
    ----------
    row
        Index of the frame.
    frame
        Its left picture, as frames.csv names it.
    camera
        `left`, `right` or `both`.
    target
        Name, or None where all targets of the frame are meant.
    why
        The reason.
    """

    row: int
    frame: str
    camera: str
    target: str | None
    why: str


@dataclass(frozen=True)
class SeenTarget:
    """One target in both pictures of a frame; `target` is its index in the session."""

    row: int
    target: int
    left: MarkerFit
    right: MarkerFit


@dataclass(frozen=True)
class FrameResult:
    """What one frame gave.

    Attributes
    ----------
    seen
        Targets that both pictures show.
    missed
        Targets that they do not, or pictures that cannot be used.
    readable
        Whether both pictures could be used.
    n_found
        Targets found in either picture.
    """

    seen: tuple[SeenTarget, ...]
    missed: tuple[Missed, ...]
    readable: bool
    n_found: int


@dataclass(frozen=True)
class FrameReader:
    """Reads frames of one session with one rig; holds nothing that changes, so that threads may share it."""

    directory: Path
    rig: Rig
    targets: tuple[Target, ...]

    def read(self, row: int, left: str, right: str) -> FrameResult:
        """Read both pictures of one frame."""
        pictures, missed = self._pictures(row, (left, right))
        if missed:
            return FrameResult((), tuple(missed), False, 0)
        found = tuple(find_markers(picture, self._keys) for picture in pictures)
        seen = []
        for index, target in enumerate(self.targets):
            whys = tuple(_why_not(view, (target.dictionary, target.id)) for view in found)
            reasons = list(_by_camera(whys))
            fits: list[MarkerFit] = []
            if not reasons:
                fits, reasons = self._fits(pictures, found, target)
            missed += [Missed(row, left, camera, target.name, why) for camera, why in reasons]
            if not reasons:
                seen.append(SeenTarget(row, index, fits[0], fits[1]))
        n_found = sum(len(view.corners_px) + len(view.repeated) for view in found)
        return FrameResult(tuple(seen), tuple(missed), True, n_found)

    @property
    def _keys(self) -> list[tuple[str, int]]:
        return [(target.dictionary, target.id) for target in self.targets]

    def _pictures(self, row: int, names: Sequence[str]) -> tuple[list[GreyImage], list[Missed]]:
        pictures: list[GreyImage] = []
        missed: list[Missed] = []
        for camera, name in zip(CAMERAS, names, strict=True):
            try:
                picture = read_grey(self.directory / name)
            except InputFileError as error:
                missed.append(Missed(row, names[0], camera, None, f"{name}: {error.problem}"))
                continue
            size = (picture.shape[1], picture.shape[0])
            if size != self.rig.image_size:
                why = f"{name}: {size[0]} × {size[1]} px, the rig's pictures are {_times(self.rig.image_size)} px"
                missed.append(Missed(row, names[0], camera, None, why))
            pictures.append(picture)
        return pictures, missed

    def _fits(
        self, pictures: Sequence[GreyImage], found: Sequence[Found], target: Target
    ) -> tuple[list[MarkerFit], list[tuple[str, str]]]:
        fits: list[MarkerFit] = []
        reasons: list[tuple[str, str]] = []
        key = (target.dictionary, target.id)
        lenses = (self.rig.left, self.rig.right)
        for camera, lens, picture, view in zip(CAMERAS, lenses, pictures, found, strict=True):
            try:
                fits.append(refine_marker(picture, lens, key, view.corners_px[key]))
            except MarkerFitError as error:
                reasons.append((camera, str(error)))
        return fits, reasons


def _why_not(found: Found, key: tuple[str, int]) -> str:
    if key in found.repeated:
        return "seen more than once in one picture: which one is meant cannot be known"
    return "" if key in found.corners_px else "not found in the picture"


def _by_camera(whys: Sequence[str]) -> Iterator[tuple[str, str]]:
    if whys[0] and whys[0] == whys[1]:
        yield "both", whys[0]
        return
    yield from ((camera, why) for camera, why in zip(CAMERAS, whys, strict=True) if why)


def _times(size: tuple[int, int]) -> str:
    return f"{size[0]} × {size[1]}"
