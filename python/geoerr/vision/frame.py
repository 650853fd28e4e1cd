"""One frame, a picture from each camera, to the corners of the targets that both show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from geoerr.errors import InputFileError
from geoerr.vision.images import read_grey
from geoerr.vision.marker_fit import MarkerFit, MarkerFitError
from geoerr.vision.markers import Found, find_markers, reads_as, refine_marker
from geoerr.vision.repeats import digest_of
from geoerr.vision.rig import Rig
from geoerr.vision.session import Target

Array = npt.NDArray[np.float64]
GreyImage = npt.NDArray[np.uint8]
# A corner nearer to the picture's end than a corner detector's window is searched for.
_MARGIN_PX = 8.0
_SLASH_HINT = "write / between folders, as in frames/left/0001.png: every system reads that"
CAMERAS = ("left", "right")
NOT_FOUND = "not found in the picture"
TWICE = "seen more than once in one picture: which one is meant cannot be known"
"""Why a target that is not there, or not once, gives no observation."""

OWN_MARKER = "give every plate a marker of its own: print another id for one of them, or cover what mirrors it"
"""What helps where a target is seen twice."""


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
    remedy
        What the user can do about it, where that is known.
    """

    row: int
    frame: str
    camera: str
    target: str | None
    why: str
    remedy: str | None = None


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
    repeated
        Targets, by index, that a picture shows more than once.
    digest
        Of both pictures, see `repeats`; None where they could not be used.
    """

    seen: tuple[SeenTarget, ...]
    missed: tuple[Missed, ...]
    readable: bool
    n_found: int
    repeated: frozenset[int] = frozenset()
    digest: int | None = None


class Places(Protocol):
    """Tells where targets should be."""

    def corners_px(self, row: int, target: int) -> tuple[Array, Array] | None:
        """Give distorted pixels (4, 2) of a target's corners in either picture of a frame; None where unknown."""


@dataclass(frozen=True)
class FrameReader:
    """Reads frames of one session with one rig; holds nothing that changes, so that threads may share it.

    A target is fitted where it is expected and its id is read; a picture is searched for those that are not there.
    """

    directory: Path
    rig: Rig
    targets: tuple[Target, ...]
    expected: Places | None = None

    def read(self, row: int, left: str, right: str) -> FrameResult:
        """Read both pictures of one frame."""
        pictures, missed = self._pictures(row, (left, right))
        if missed:
            return FrameResult((), tuple(missed), False, 0)
        seen = {index: SeenTarget(row, index, *fits) for index, fits in self._where_expected(row, pictures)}
        n_expected = len(seen)
        wanted = {index: target for index, target in enumerate(self.targets) if index not in seen}
        found = self._found(pictures, wanted) if wanted else ()
        for index, target in wanted.items():
            whys = tuple(_why_not(view, target.marker) for view in found)
            reasons = list(_by_camera(whys))
            fits: list[MarkerFit] = []
            if not reasons:
                fits, reasons = self._fits(pictures, found, target)
            missed += [
                Missed(row, left, camera, target.name, why, OWN_MARKER if why == TWICE else None)
                for camera, why in reasons
            ]
            if not reasons:
                seen[index] = SeenTarget(row, index, fits[0], fits[1])
        n_found = 2 * n_expected + sum(len(view.corners_px) + len(view.repeated) for view in found)
        repeated = frozenset(
            index for index, target in wanted.items() if any(target.marker in view.repeated for view in found)
        )
        in_order = tuple(seen[index] for index in sorted(seen))
        return FrameResult(in_order, tuple(missed), True, n_found, repeated, digest_of(*pictures))

    def _where_expected(
        self, row: int, pictures: Sequence[GreyImage]
    ) -> Iterator[tuple[int, tuple[MarkerFit, MarkerFit]]]:
        """Fit targets where they should be, both pictures of each; those that are elsewhere are left out."""
        for index, target in enumerate(self.targets if self.expected is not None else ()):
            assert self.expected is not None
            places = self.expected.corners_px(row, index)
            if places is None or not all(map(_is_inside, pictures, places)):
                continue
            key = target.marker
            if not all(map(reads_as, pictures, (key, key), places)):
                continue
            lenses = (self.rig.left, self.rig.right)
            try:
                left, right = map(refine_marker, pictures, lenses, (key, key), places)
            except MarkerFitError:
                continue
            if left.method == right.method == "photometric":
                yield index, (left, right)

    @staticmethod
    def _found(pictures: Sequence[GreyImage], wanted: Mapping[int, Target]) -> tuple[Found, ...]:
        keys = [target.marker for target in wanted.values()]
        return tuple(find_markers(picture, keys) for picture in pictures)

    def _pictures(self, row: int, names: Sequence[str]) -> tuple[list[GreyImage], list[Missed]]:
        pictures: list[GreyImage] = []
        missed: list[Missed] = []
        for camera, name in zip(CAMERAS, names, strict=True):
            try:
                picture = read_grey(self.directory / name)
            except InputFileError as error:
                remedy = remedy_for(self.directory, name, error)
                missed.append(Missed(row, names[0], camera, None, f"{name}: {error.problem}", remedy))
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
        key = target.marker
        lenses = (self.rig.left, self.rig.right)
        for camera, lens, picture, view in zip(CAMERAS, lenses, pictures, found, strict=True):
            try:
                fits.append(refine_marker(picture, lens, key, view.corners_px[key]))
            except MarkerFitError as error:
                reasons.append((camera, str(error)))
        return fits, reasons


def remedy_for(directory: Path, name: str, error: InputFileError) -> str | None:
    """Say what helps where a picture cannot be read; its name may be written as Windows writes folders."""
    with_slashes = name.replace("\\", "/")
    return _SLASH_HINT if with_slashes != name and (directory / with_slashes).is_file() else error.remedy


def _is_inside(picture: GreyImage, corners_px: Array) -> bool:
    size = np.array([picture.shape[1], picture.shape[0]])
    return bool(((corners_px > _MARGIN_PX) & (corners_px < size - 1 - _MARGIN_PX)).all())


def _why_not(found: Found, key: tuple[str, int]) -> str:
    if key in found.repeated:
        return TWICE
    return "" if key in found.corners_px else NOT_FOUND


def _by_camera(whys: Sequence[str]) -> Iterator[tuple[str, str]]:
    if whys[0] and whys[0] == whys[1]:
        yield "both", whys[0]
        return
    yield from ((camera, why) for camera, why in zip(CAMERAS, whys, strict=True) if why)


def _times(size: tuple[int, int]) -> str:
    return f"{size[0]} × {size[1]}"
