"""Marker plates in one picture: found, told apart, their corners fitted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from geoerr.vision.camera import Camera
from geoerr.vision.marker_fit import MarkerFit, MarkerFitError, NotThisMarkerError, fit_marker
from geoerr.vision.patterns import dictionary_names, marker_bits, opencv_dictionary

Array = npt.NDArray[np.float64]
GreyImage = npt.NDArray[np.uint8]

# Pictures larger than this are searched at half their size first: four times faster, and the search
# only has to come within a few pixels.
_HALVE_ABOVE_PX = 1200
# There corners are up to three pixels off. A marker whose modules are smaller than this is looked at again in full: a
# corner detector with a window of its modules, or a fit, does not find the way from so far.
_SMALL_MODULE_PX = 10.0
# What is looked at around it, in its sides: where a cutting ends just behind a plate's edge, OpenCV misses markers.
_AROUND = 1.0
# What a local corner detector is good for on a marker's corners, where it is pulled inwards.
_LOCAL_CORNER_SIGMA_PX = 0.3
_WINDOW_MODULES = 0.3

# A marker is read in so many pixels a module, the middle half of each; OpenCV's detector corrects as many wrong bits.
_READ_PX, _CORRECTED = 8, 0.6

MarkerKey = tuple[str, int]
"""Dictionary and id."""


@dataclass(frozen=True)
class Found:
    """Markers of one picture: corners (4, 2) to a pixel or so, and those that were there more than once."""

    corners_px: dict[MarkerKey, Array]
    repeated: frozenset[MarkerKey]


def find_markers(picture: GreyImage, wanted: Iterable[MarkerKey]) -> Found:
    """Find the wanted markers; full resolution is searched only for what half of it does not show."""
    by_dictionary: dict[str, set[int]] = {}
    for dictionary, identity in wanted:
        by_dictionary.setdefault(dictionary, set()).add(identity)
    corners: dict[MarkerKey, Array] = {}
    repeated: set[MarkerKey] = set()
    half: GreyImage | None = None
    for dictionary, identities in by_dictionary.items():
        seen: dict[int, list[Array]] = {}
        if max(picture.shape) > _HALVE_ABOVE_PX:
            if half is None:
                half = np.asarray(
                    cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8
                )
            # Pixel (0, 0) of the half picture covers pixels 0 and 1: its centre is at 0.5.
            seen = {
                identity: [_in_full(picture, (dictionary, identity), 2.0 * place + 0.5) for place in places]
                for identity, places in _detect(half, dictionary).items()
                if identity in identities
            }
        if not identities <= set(seen):
            seen = _merged(seen, _detect(picture, dictionary))
        for identity in sorted(identities & set(seen)):
            if len(seen[identity]) > 1:
                repeated.add((dictionary, identity))
            else:
                corners[dictionary, identity] = seen[identity][0]
    return Found(corners, frozenset(repeated))


def _in_full(picture: GreyImage, marker: MarkerKey, corners_px: Array) -> Array:
    """Give the corners as full resolution shows them, of a small marker that half of it showed."""
    dictionary, identity = marker
    side_px = float(np.linalg.norm(corners_px - np.roll(corners_px, 1, axis=0), axis=1).mean())
    if side_px >= _SMALL_MODULE_PX * len(_pattern(dictionary, identity)):
        return corners_px
    low = np.maximum(np.floor(corners_px.min(axis=0) - _AROUND * side_px), 0.0).astype(np.int64)
    high = np.ceil(corners_px.max(axis=0) + _AROUND * side_px).astype(np.int64)
    around = np.ascontiguousarray(picture[low[1] : high[1] + 1, low[0] : high[0] + 1])
    again = [place + low for place in _detect(around, dictionary).get(identity, ())]
    # A marker out of focus may be found in half the picture only.
    return min(again, key=lambda place: float(np.linalg.norm(place - corners_px)), default=corners_px)


def _merged(coarse: dict[int, list[Array]], fine: dict[int, list[Array]]) -> dict[int, list[Array]]:
    """Take what full resolution shows, and what only the half picture did (a marker out of focus)."""
    return {**coarse, **fine}


def _detect(picture: GreyImage, dictionary: str) -> dict[int, list[Array]]:
    corners, identities, _ = _detector(dictionary).detectMarkers(picture)
    result: dict[int, list[Array]] = {}
    if identities is not None:
        for place, identity in zip(corners, np.ravel(identities), strict=True):
            result.setdefault(int(identity), []).append(np.asarray(place, dtype=np.float64).reshape(4, 2))
    return result


def _detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return cv2.aruco.ArucoDetector(opencv_dictionary(dictionary), parameters)


def reads_as(picture: GreyImage, marker: MarkerKey, corners_px: Array) -> bool:
    """Tell whether the marker at some corners (4, 2), to a fifth of a module, is this one, and this way round.

    The bits are read as OpenCV's detector reads those of a square that it has found, so that nothing is taken for a
    marker that a search would call another: ids of a dictionary may differ in three modules, which a fit of the whole
    picture would count as dirt.
    """
    dictionary, identity = marker
    n_modules = len(_pattern(dictionary, identity))
    side = _READ_PX * n_modules
    square = np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=np.float32) - 0.5
    to_square = cv2.getPerspectiveTransform(corners_px.astype(np.float32), square)
    flat = np.asarray(cv2.warpPerspective(picture, to_square, (side, side), flags=cv2.INTER_LINEAR), dtype=np.uint8)
    _, white = cv2.threshold(flat, 127, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    edge = _READ_PX // 4
    cells = np.asarray(white).reshape(n_modules, _READ_PX, n_modules, _READ_PX)[:, edge:-edge, :, edge:-edge]
    bits = np.ascontiguousarray(cells.mean(axis=(1, 3)) > 0.5, dtype=np.uint8)
    is_known, read, turned = opencv_dictionary(dictionary).identify(bits[1:-1, 1:-1].copy(), _CORRECTED)
    return bool(is_known) and (int(read), int(turned)) == (identity, 0)


@lru_cache(maxsize=4096)
def _pattern(dictionary: str, identity: int) -> npt.NDArray[np.bool_]:
    return marker_bits(dictionary, identity).astype(bool)


def refine_marker(picture: GreyImage, camera: Camera, marker: MarkerKey, corners_px: Array) -> MarkerFit:
    """Fit a found marker; where the fit has no answer, take a local detector's corners and say why.

    Raises
    ------
    MarkerFitError
        where there is no answer at all: something else than this marker, beyond what the lens model reaches, or a
        corner that the local detector does not find either.
    """
    pattern = _pattern(*marker)
    start, is_found = _local_corners(picture, corners_px, len(pattern))
    try:
        return fit_marker(picture, camera, pattern, start)
    except NotThisMarkerError:
        raise
    except MarkerFitError as error:
        if not is_found.all():
            raise MarkerFitError(f"{error}, and a corner detector does not find its corners") from error
        rays = camera.normalised_from_pixel(start)
        if not np.isfinite(rays).all():
            raise
        return MarkerFit(
            camera.undistorted_pixel_from_normalised(rays),
            np.eye(8) * _LOCAL_CORNER_SIGMA_PX**2,
            "corner",
            float("nan"),
            float("nan"),
            (float("nan"), float("nan")),
            float("nan"),
            float("nan"),
            str(error),
        )


def _local_corners(picture: GreyImage, corners_px: Array, n_modules: int) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Corners (4, 2) of a local detector, and whether it found each (4,): one that it did not stays as it was."""
    module_px = np.linalg.norm(corners_px - np.roll(corners_px, 1, axis=0), axis=1).mean() / n_modules
    half_window = int(np.clip(round(_WINDOW_MODULES * module_px), 2, 7))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
    points = corners_px.astype(np.float32)
    # Refined in place: a copy is given, for the comparison below.
    refined = cv2.cornerSubPix(
        picture, points.reshape(-1, 1, 2).copy(), (half_window, half_window), (-1, -1), criteria
    )
    moved = np.asarray(refined, dtype=np.float64).reshape(4, 2)
    far = np.linalg.norm(moved - corners_px, axis=1) > 0.5 * module_px
    # OpenCV gives a start back to the last digit where no corner is within its window.
    is_found = ~far & (moved != points).any(axis=1)
    return np.where(is_found[:, None], moved, corners_px), is_found


def seen_in_a_mirror(picture: GreyImage, wanted: Iterable[MarkerKey]) -> int:
    """Count the wanted markers that the picture shows as a mirror would: those that a camera's setting flips."""
    return len(find_markers(np.ascontiguousarray(picture[:, ::-1]), wanted).corners_px)


def dictionaries_seen(picture: GreyImage) -> dict[str, list[int]]:
    """Search for markers of every known dictionary: names to ids, most markers first.

    Smaller dictionaries are part of larger ones, so several names may fit; of a family the smallest comes first.
    """
    seen: dict[str, list[int]] = {}
    for name in dictionary_names():
        identities = sorted(_detect(picture, name))
        if identities:
            seen[name] = identities
    return dict(sorted(seen.items(), key=lambda item: (-len(item[1]), _size(item[0]), item[0])))


def _size(dictionary: str) -> int:
    return int(opencv_dictionary(dictionary).bytesList.shape[0])
