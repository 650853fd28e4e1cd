"""Views of the board by both cameras, and the rules by which corners and views are set aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.vision.bundle import Sightings

Array = npt.NDArray[np.float64]

LEAST_VIEWS = 3
"""With fewer views of a plane, a camera with five numbers and distortion is not determined (Zhang 2000, §3.1)."""

DISAGREEMENT = 1.5
"""Residuals together this many times above each camera's own: the cameras do not see one board at one moment."""

# A corner this far off its view's scatter is a wrong corner: one in 300,000 of normal ones is.
_WILD_SIGMAS = 5.0
_MOST_WILD = 0.25
# A view this far above the others: in deviations of the views' rms, and as a multiple of their median.
_FAR_DEVIATIONS = 6.0
_FAR_FACTOR = 2.0
# And no better than a corner detector: cornerSubPix leaves 0.02 px in each coordinate, 0.03 px as a distance. A view
# that comes below is a good one, however much better the others are. On clean pictures these come to 0.01 px, and a
# board that is twice as far away or a little out of focus to 0.02: its corners say so themselves (`std_px`), and are
# weighed by it. What is wrong with a view, a board that moved or a page that is bent, shows beyond.
_FAR_LEAST_PX = 0.03
# Median of |(u, v)| for normal u, v of unit deviation (Rayleigh), and normal deviation over median deviation.
_RAYLEIGH_MEDIAN = 1.17741
_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class SeenCorners:
    """Board corners in one picture: board_mm (n, 3), pixel (n, 2), std_px (n,) of one pixel coordinate."""

    board_mm: Array
    pixel: Array
    std_px: Array


@dataclass(frozen=True)
class BoardView:
    """The board seen by both cameras at one moment.

    Attributes
    ----------
    name
        Name of the pair.
    left, right
        What each camera saw; not necessarily the same corners.
    right_renumbered
        Other `board_mm` (n, 3) for the right picture, under which the board looks the same.
    """

    name: str
    left: SeenCorners
    right: SeenCorners
    right_renumbered: tuple[Array, ...] = ()

    def side(self, camera: int) -> SeenCorners:
        """Give what camera 0 (left) or 1 (right) saw."""
        return self.right if camera else self.left


def sightings_of(views: Sequence[BoardView], camera: int) -> Sightings:
    """Put one camera's corners of all views in one table; all count alike."""
    sides = [view.side(camera) for view in views]
    numbers = np.concatenate([np.full(len(side.pixel), number) for number, side in enumerate(sides)])
    return Sightings(
        numbers.astype(np.int64),
        np.concatenate([side.board_mm for side in sides]),
        np.concatenate([side.pixel for side in sides]),
        np.ones(len(numbers)),
    )


def repeated_views(views: Sequence[BoardView]) -> dict[int, str]:
    """Tell which views have a picture that an earlier one has, and why they say nothing more.

    Noise is never the same twice: corners that are the same to the last digit are of one picture, whatever it is
    called, and would count as another look at the board.
    """
    seen: dict[bytes, str] = {}
    why: dict[int, str] = {}
    for number, view in enumerate(views):
        own = {"left": view.left.pixel.tobytes(), "right": view.right.pixel.tobytes()}
        again = [f"the {side} picture is the {seen[key]} again" for side, key in own.items() if key in seen]
        if own["left"] == own["right"]:
            why[number] = "left and right are one picture"
        elif again:
            why[number] = "; ".join(again)
        else:
            seen |= {key: f"{side} one of {view.name}" for side, key in own.items()}
    return why


def view_rms(sightings: Sequence[Sightings], residuals: Sequence[Array], n_views: int) -> Array:
    """Root mean square distance (px) of the corners that take part, for each view over the given cameras."""
    total, count = np.zeros(n_views), np.zeros(n_views)
    for seen, residual in zip(sightings, residuals, strict=True):
        takes_part = seen.weight > 0.0
        square = np.where(takes_part, np.sum(residual * residual, axis=1), 0.0)
        total += np.bincount(seen.view, square, n_views)
        count += np.bincount(seen.view, takes_part.astype(np.float64), n_views)
    return np.asarray(np.sqrt(total / np.maximum(count, 1.0)))


def total_rms(sightings: Sequence[Sightings], residuals: Sequence[Array]) -> float:
    """Root mean square distance (px) of all corners that take part: OpenCV's reprojection error."""
    square = sum(
        float(np.sum(residual[seen.weight > 0.0] ** 2)) for seen, residual in zip(sightings, residuals, strict=True)
    )
    count = sum(int(np.count_nonzero(seen.weight)) for seen in sightings)
    return float(np.sqrt(square / max(count, 1)))


def without_wild_corners(seen: Sightings, residual: Array, base_weight: Array, n_views: int) -> Sightings:
    """Set aside single corners that are far off their view's scatter, judged anew from all corners.

    A view in which many are wild is left whole: then the view itself is in question.
    """
    off = np.linalg.norm(residual, axis=1) * np.sqrt(base_weight)
    overall = float(np.median(off)) / _RAYLEIGH_MEDIAN
    weight = base_weight.copy()
    for rows in seen.rows_of_views(n_views):
        if rows.stop == rows.start:
            continue
        scatter = max(float(np.median(off[rows])) / _RAYLEIGH_MEDIAN, overall)
        is_wild = off[rows] > _WILD_SIGMAS * scatter
        if 0.0 < is_wild.mean() <= _MOST_WILD:
            weight[rows] = np.where(is_wild, 0.0, base_weight[rows])
    return Sightings(seen.view, seen.board_mm, seen.pixel, weight)


def far_view(rms_px: Array) -> int | None:
    """Give the view that is worst, if it is far above the others, and above what good corners are worth."""
    middle = float(np.median(rms_px))
    spread = _MAD_TO_SIGMA * float(np.median(np.abs(rms_px - middle)))
    worst = int(np.argmax(rms_px))
    limit_px = max(middle + _FAR_DEVIATIONS * spread, _FAR_FACTOR * middle, _FAR_LEAST_PX)
    return worst if rms_px[worst] > limit_px else None


def corner_weights(views: Sequence[BoardView], sightings: Sequence[Sightings], sigma_px: float) -> list[Array]:
    """Weights from each corner's own uncertainty and from what is common to all.

    What scatters more than the corners' own uncertainty explains (a board that is not flat, a lens that is not
    quite the model) is the same for all corners: `variance = own² + common²`, with the sum's mean as it is seen.

    Parameters
    ----------
    views, sightings
        The same views.
    sigma_px
        Deviation of one pixel coordinate as the residuals have it.
    """
    own = [np.concatenate([view.side(camera).std_px for view in views]) ** 2 for camera in range(len(sightings))]
    everything = np.concatenate(own)
    # Never below a quarter of the usual uncertainty: no corner is so good that it outweighs its view.
    common = max(sigma_px**2 - float(everything.mean()), float(np.median(everything)) / 16.0, 1e-12)
    mean = float(np.mean(everything + common))
    return [mean / (square + common) for square in own]
