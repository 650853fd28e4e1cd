"""Geometry of measurement on NumPy arrays: triangulation, lines, straightness.

Thin faces of the compiled core. Inputs are brought to contiguous double precision once (arrays that are so
already are not copied) and checked by shape; the interpreter is released while the core works, so do not write
to the inputs from another thread meanwhile. Results are bitwise the same for any number of `threads` (0 = all cores).

One bad row or line never spoils the batch: it becomes NaN and its status says why. What is masked in a masked array
is NaN, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.arguments import check_choice, check_threads
from geoerr.errors import GeometryError, ShapeError

Rule = Literal["trapezoid", "simpson"]
FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_DOUBLE: np.dtype[Any] = np.dtype(np.float64)


class TriangulationStatus(IntEnum):
    """Whether a row has a point, and if not, why."""

    OK = 0
    NOT_FINITE = 1
    """a pixel or covariance is not finite, or so large that the arithmetic overflows"""
    RAYS_PARALLEL = 2
    """the two rays meet at less than 1 µrad"""
    BEHIND_CAMERA = 3
    """the best point lies behind a camera"""
    BAD_COVARIANCE = 4
    """a pixel covariance is not positive definite"""


class LineStatus(IntEnum):
    """Whether a line could be fitted, and if not, why."""

    OK = 0
    NOT_FINITE = 1
    """a coordinate or covariance is not finite, or so large that the arithmetic overflows"""
    TOO_FEW_POINTS = 2
    """fewer than two points"""
    COINCIDENT = 3
    """all points are one point"""
    NO_DIRECTION = 4
    """the points spread equally in two directions"""


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Points with their uncertainty; row i belongs to row i of the pixels.

    Attributes
    ----------
    points_mm : (n, 3)
        Points in the frame of the projection matrices (of the left camera where that is `K [I 0]`); NaN where
        refused.
    covariance_mm2 : (n, 3, 3)
        Their covariance for the pixel noise as given: first order, which holds while the noise is small against
        the parallax.
    reprojection_px : (n,)
        Root mean square over the two views of the distance from measured to reprojected pixel. With independent
        noise of σ in u and v its expected square is σ²/2: four numbers, three unknowns.
    status : (n,) uint8
        `TriangulationStatus`.
    """

    points_mm: FloatArray
    covariance_mm2: FloatArray
    reprojection_px: FloatArray
    status: npt.NDArray[np.uint8]

    @property
    def is_ok(self) -> BoolArray:
        """(n,) True where there is a point."""
        return np.equal(self.status, TriangulationStatus.OK)


@dataclass(frozen=True, eq=False)
class TriangulatedPoints:
    """Points alone: the attributes of `Triangulated` without its uncertainty."""

    points_mm: FloatArray
    status: npt.NDArray[np.uint8]

    @property
    def is_ok(self) -> BoolArray:
        """(n,) True where there is a point."""
        return np.equal(self.status, TriangulationStatus.OK)


@dataclass(frozen=True, eq=False)
class FittedLines:
    """Lines by total least squares; entry i belongs to line i, except in `along_mm`.

    Attributes
    ----------
    centroid_mm : (m, 3)
        Centroid of the points, which is on the line; NaN where refused.
    direction : (m, 3)
        Unit vector from the first point towards the last.
    rms_mm : (m,)
        Root mean square distance of the points from the line.
    direction_covariance : (m, 3, 3)
        Covariance of the unit vector (rank 2, across the line; rad²). NaN for two points without given covariances;
        (0, 3, 3) where it was not wanted.
    along_mm : (n,)
        For every point of every line, the distance along its line from the line's first point; (0,) where it was not
        wanted.
    status : (m,) uint8
        `LineStatus`.
    """

    centroid_mm: FloatArray
    direction: FloatArray
    rms_mm: FloatArray
    direction_covariance: FloatArray
    along_mm: FloatArray
    status: npt.NDArray[np.uint8]

    @property
    def is_ok(self) -> BoolArray:
        """(m,) True where there is a line."""
        return np.equal(self.status, LineStatus.OK)


@dataclass(frozen=True, eq=False)
class FittedLine:
    """One line: the attributes of `FittedLines` for a single one (`rms_mm` a number, the others one axis less)."""

    centroid_mm: FloatArray
    direction: FloatArray
    rms_mm: float
    direction_covariance: FloatArray
    along_mm: FloatArray


def triangulate(
    projection_left: npt.ArrayLike,
    projection_right: npt.ArrayLike,
    uv_left_px: npt.ArrayLike,
    uv_right_px: npt.ArrayLike,
    *,
    cov_left_px2: npt.ArrayLike | None = None,
    cov_right_px2: npt.ArrayLike | None = None,
    sigma_px: float = 1.0,
    reweightings: int = 2,
    threads: int = 0,
) -> Triangulated:
    """Triangulate points seen by two cameras, by least squares of their pixels.

    Parameters
    ----------
    projection_left, projection_right : (3, 4)
        Projection matrices, mm to px, of one common frame; scale and sign mean nothing.
    uv_left_px, uv_right_px : (n, 2)
        *Undistorted* pixel coordinates; row i of both is the same point.
    cov_left_px2, cov_right_px2 : (n, 2, 2), optional
        Covariance of each pixel. A view without has `sigma_px` squared in u and v.
    sigma_px
        Standard deviation of u and of v where no covariances are given.
    reweightings
        0: least squares of Li's rows as printed. 1 or more: Gauss-Newton steps on the pixel residuals from there;
        two reach the pixel minimum to a thousandth of the point's own standard deviation or better.
    threads
        Number of threads, 0 for all cores.

    Returns
    -------
    Triangulated
        Points, covariances, reprojection errors and status.

    Raises
    ------
    ShapeError
        if an array has the wrong shape, the numbers of rows differ, or `threads` is no number of threads.
    GeometryError
        if a projection matrix is not finite or has no finite centre, if the two centres coincide, or if `sigma_px` is
        not positive.

    Notes
    -----
    Li et al. 2023, Eqs. 3-5 (Eq. 3 prints a wrong superscript in row 2). Checked against 50-digit references,
    where the error is that of QR or smaller on a 2 mm baseline too, OpenCV, and Monte-Carlo covariances.
    """
    check_threads(threads)
    if reweightings < 0:
        raise GeometryError(f"reweightings is {reweightings}: it cannot be negative")
    return Triangulated(
        *_core.triangulate(
            _array(projection_left, "projection_left", (3, 4)),
            _array(projection_right, "projection_right", (3, 4)),
            _array(uv_left_px, "uv_left_px", (None, 2)),
            _array(uv_right_px, "uv_right_px", (None, 2)),
            None if cov_left_px2 is None else _array(cov_left_px2, "cov_left_px2", (None, 2, 2)),
            None if cov_right_px2 is None else _array(cov_right_px2, "cov_right_px2", (None, 2, 2)),
            float(sigma_px),
            reweightings,
            threads,
        )
    )


def triangulate_points(
    projection_left: npt.ArrayLike,
    projection_right: npt.ArrayLike,
    uv_left_px: npt.ArrayLike,
    uv_right_px: npt.ArrayLike,
    *,
    threads: int = 0,
) -> TriangulatedPoints:
    """Triangulate points without their uncertainty, several times as fast as `triangulate`.

    Equal noise in all pixels, and Li's rows as printed: the points of `triangulate` with `reweightings=0`.

    Parameters
    ----------
    projection_left, projection_right : (3, 4)
        Projection matrices, mm to px, of one common frame; scale and sign mean nothing.
    uv_left_px, uv_right_px : (n, 2)
        *Undistorted* pixel coordinates; row i of both is the same point. Where both are float32 they are taken as
        they are, and lose nothing but their own rounding.
    threads
        Number of threads, 0 for all cores.

    Returns
    -------
    TriangulatedPoints
        Points and status.

    Raises
    ------
    ShapeError
        if an array has the wrong shape, the numbers of rows differ, or `threads` is no number of threads.
    GeometryError
        if a projection matrix is not finite or has no finite centre, or if the two centres coincide.
    """
    check_threads(threads)
    given_left = np.asarray(unmasked(uv_left_px, "uv_left_px"))
    given_right = np.asarray(unmasked(uv_right_px, "uv_right_px"))
    is_single = given_left.dtype == given_right.dtype == np.float32
    dtype = np.dtype(np.float32 if is_single else np.float64)
    return TriangulatedPoints(
        *_core.triangulate_points(
            _array(projection_left, "projection_left", (3, 4)),
            _array(projection_right, "projection_right", (3, 4)),
            _array(given_left, "uv_left_px", (None, 2), dtype),
            _array(given_right, "uv_right_px", (None, 2), dtype),
            threads,
        )
    )


def fit_lines(
    points_mm: npt.ArrayLike,
    starts: npt.ArrayLike,
    *,
    covariance_mm2: npt.ArrayLike | None = None,
    along: bool = True,
    direction_covariance: bool = True,
    threads: int = 0,
) -> FittedLines:
    """Fit a line to each run of points by total least squares.

    Parameters
    ----------
    points_mm : (n, 3)
        Points of all lines, one line after another, each in the order of travel.
    starts : (m,) of int
        Index of the first point of each line; the first is 0.
    covariance_mm2 : (n, 3, 3), optional
        Covariance of each point, for the direction's covariance (the fit itself is unweighted). Without, the
        residuals of each line tell the noise: equal in all directions, variance `Σ d² / (2 n - 4)`.
    along
        Whether the distances of the points along their lines are wanted: they are a fifth of the time.
    direction_covariance
        Whether the covariances of the directions are wanted: they are a sixth of the time.
    threads
        Number of threads, 0 for all cores.

    Returns
    -------
    FittedLines
        Lines; those with fewer than two points, one place or no direction are NaN, see `status`.

    Raises
    ------
    ShapeError
        if an array has the wrong shape, the starts do not cut the points into consecutive runs, or `threads` is no
        number of threads.

    Notes
    -----
    Centroid and first eigenvector of the centred scatter matrix, corrected by one step from the points themselves;
    residuals are summed as vectors. Li et al. 2023, §4.3. Checked against 50-digit references, SVD, and
    Monte-Carlo covariances.
    """
    check_threads(threads)
    points = _array(points_mm, "points_mm", (None, 3))
    given = np.asarray(unmasked(starts, "starts"))
    if given.ndim != 1 or (given.size > 0 and not np.issubdtype(given.dtype, np.integer)):
        raise ShapeError(f"starts must be whole numbers of shape (m,), got {given.dtype} of {given.shape}")
    covariance = None if covariance_mm2 is None else _array(covariance_mm2, "covariance_mm2", (None, 3, 3))
    first = np.ascontiguousarray(given, np.int64)
    return FittedLines(*_core.fit_lines(points, first, covariance, along, direction_covariance, threads))


def fit_line(points_mm: npt.ArrayLike, *, covariance_mm2: npt.ArrayLike | None = None) -> FittedLine:
    """Fit one line by total least squares; see `fit_lines`.

    Parameters
    ----------
    points_mm : (n, 3)
        Points in the order of travel.
    covariance_mm2 : (n, 3, 3), optional
        Covariance of each point.

    Returns
    -------
    FittedLine
        The line.

    Raises
    ------
    ShapeError
        if an array has the wrong shape.
    GeometryError
        if no line can be fitted: fewer than two points, all in one place, spread equally, or not finite.
    """
    lines = fit_lines(points_mm, [0], covariance_mm2=covariance_mm2)
    status = LineStatus(int(lines.status[0]))
    if status != LineStatus.OK:
        raise GeometryError(f"no line fits {len(lines.along_mm)} points: {_WHY_NO_LINE[status]}")
    return FittedLine(
        centroid_mm=lines.centroid_mm[0],
        direction=lines.direction[0],
        rms_mm=float(lines.rms_mm[0]),
        direction_covariance=lines.direction_covariance[0],
        along_mm=lines.along_mm,
    )


_WHY_NO_LINE = {
    LineStatus.NOT_FINITE: "a coordinate or covariance is not finite or far too large",
    LineStatus.TOO_FEW_POINTS: "two are needed",
    LineStatus.COINCIDENT: "they are all in one place",
    LineStatus.NO_DIRECTION: "they spread equally in two directions",
}


def integrate_straightness(
    position_mm: npt.ArrayLike,
    angle_rad: npt.ArrayLike,
    rule: Rule = "trapezoid",
    *,
    threads: int = 0,
) -> FloatArray:
    """Integrate angles along their own axis and take the least-squares line off (see `remove_line`).

    Parameters
    ----------
    position_mm : (n,)
        Rising positions, at any spacing.
    angle_rad : (n,) or (k, n)
        One function, or k of them. The result is linear in them: push `numpy.eye(n)` through to have the operator,
        whose rows are the results of unit values.
    rule
        `trapezoid`: exact where the angle is the straight line between its samples, as error functions are here.
        `simpson`: parabolas through three neighbours, exact for parabolas on any spacing (the rule of SciPy's
        `cumulative_simpson`).
    threads
        Number of threads, 0 for all cores.

    Returns
    -------
    (n,) or (k, n)
        Straightness in mm, 0 at the first position. A function with a value that is not finite is NaN throughout.

    Raises
    ------
    ShapeError
        for arrays that do not fit, fewer than two positions, or what is no number of threads.
    GeometryError
        for positions that are not finite or do not rise; the message names the index.
    GeoerrError
        for a rule that is none.

    Notes
    -----
    Li et al. 2023, Eq. 19. Which angle makes which straightness with which sign depends on the side that carries
    the axis and is the caller's matter.
    """
    check_choice("rule", rule, get_args(Rule))
    check_threads(threads)
    positions, functions = _functions(position_mm, angle_rad, "angle_rad")
    return _core.integrate_straightness(positions, functions.ravel(), rule, threads).reshape(functions.shape)


def rigid_columns(points_mm: FloatArray) -> FloatArray:
    """Give how a shift and a small turn about the origin move points (n, 3): (3n, 6)."""
    turned = np.cross(np.eye(3)[None, :, :], points_mm[:, None, :]).transpose(0, 2, 1)
    shift = np.broadcast_to(np.eye(3), turned.shape)
    return np.asarray(np.concatenate([shift, turned], axis=2).reshape(3 * len(points_mm), 6))


def remove_line(position_mm: npt.ArrayLike, values: npt.ArrayLike, *, threads: int = 0) -> FloatArray:
    """Take the least-squares line off functions of position: geoerr's gauge of straightness.

    The line is that over the *range*, not over the samples: a table stands for its piecewise-linear interpolant,
    and its continuous least-squares line `min ∫ (f - a - b x)² dx` is computed in closed form. This is the limit of a
    fine uniform grid and does not depend on how the samples are spaced. The slope goes first, then the first value,
    so the result is 0 at the first position.

    Parameters
    ----------
    position_mm : (n,)
        Rising positions, at any spacing.
    values : (n,) or (k, n)
        One function or k of them, in any unit.
    threads
        Number of threads, 0 for all cores.

    Returns
    -------
    (n,) or (k, n)
        Values without their line. A function with a value that is not finite is NaN throughout.

    Raises
    ------
    ShapeError
        for arrays that do not fit, fewer than two positions, or what is no number of threads.
    GeometryError
        for positions that are not finite or do not rise; the message names the index.
    """
    check_threads(threads)
    positions, functions = _functions(position_mm, values, "values")
    return _core.remove_line(positions, functions.ravel(), threads).reshape(functions.shape)


def unmasked(values: npt.ArrayLike, name: str) -> npt.ArrayLike:
    """Give a masked array as one with NaN where it is masked, and anything else as it is.

    NumPy forgets the mask where it makes numbers of such an array, and what is beneath would count as measured.

    Raises
    ------
    ShapeError
        naming the argument, for masked whole numbers: they have no NaN.
    """
    if not isinstance(values, np.ma.MaskedArray):
        return values
    if not np.ma.is_masked(values):
        return np.asarray(values.data)
    if not np.issubdtype(values.dtype, np.floating):
        raise ShapeError(
            f"{name} is a masked array of {values.dtype}, which has no number for what is missing\n"
            "hint: give an array of floats with NaN there, or leave these rows out"
        )
    return np.asarray(values.filled(np.nan))


def _functions(position_mm: npt.ArrayLike, values: npt.ArrayLike, name: str) -> tuple[FloatArray, FloatArray]:
    """Positions (n,) and functions (n,) or (k, n) of them, contiguous."""
    positions = _array(position_mm, "position_mm", (None,))
    functions = np.ascontiguousarray(unmasked(values, name), dtype=np.float64)
    if functions.ndim not in (1, 2) or functions.shape[-1] != len(positions):
        raise ShapeError(
            f"{name} must have shape (n,) or (k, n) with n = {len(positions)} positions, got {functions.shape}"
        )
    return positions, functions


def _array(
    values: npt.ArrayLike, name: str, shape: tuple[int | None, ...], dtype: np.dtype[Any] = _DOUBLE
) -> FloatArray:
    """Bring an argument to contiguous numbers of a shape in which None is any number."""
    array = np.ascontiguousarray(unmasked(values, name), dtype=dtype)
    fits = array.ndim == len(shape) and all(
        wanted is None or wanted == found for wanted, found in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("n" if size is None else str(size) for size in shape)
        raise ShapeError(f"{name} must have shape ({wanted}{',' if len(shape) == 1 else ''}), got {array.shape}")
    return array
