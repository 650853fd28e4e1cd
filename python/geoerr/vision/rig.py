"""The camera pair: two cameras, where the right one stands, how well all that is known (`rig.json`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr.errors import InputFileError
from geoerr.files import check_written, read_json, write_json
from geoerr.summaries import facts_html, number_words, summary_html, table_html
from geoerr.vision.camera import (
    DISTORTION_COUNTS,
    DISTORTION_NAMES,
    INTRINSIC_NAMES,
    Camera,
    camera_from_parameters,
    parameters_of,
)
from geoerr.vision.rotation import nearest_rotation, rotation_from_vector

Array = npt.NDArray[np.float64]

POSE_NAMES = ("rotation_x_rad", "rotation_y_rad", "rotation_z_rad", "t_x_mm", "t_y_mm", "t_z_mm")
_CALIBRATE_HINT = "`geoerr calibrate SESSION -o rig.json` writes a whole one"
_RIG_HINT = (
    "a rig is two cameras and their places, in the JSON file that `geoerr calibrate SESSION -o rig.json` writes"
)
# A rotation typed with six decimals is within this of orthogonal; anything further is not a rotation.
_ROTATION_TOLERANCE = 1e-5
_ROUNDED_ROTATION = 1e-12
# What rounding leaves of symmetry, and of an eigenvalue that is 0, in parts of the largest.
_ROUNDED_COVARIANCE = 1e-9


@dataclass(frozen=True, eq=False)
class RightFromLeft:
    """The right camera's place: `p_right = R @ p_left + t_mm`.

    Attributes
    ----------
    R
        (3, 3) rotation.
    t_mm
        (3,)
    """

    R: Array
    t_mm: Array


@dataclass(frozen=True, eq=False)
class Rig:
    """A calibrated pair of cameras. The measuring frame is the left camera's: x right, y down, z away.

    Attributes
    ----------
    K_left, K_right
        (3, 3) camera matrices, px.
    dist_left, dist_right
        Distortion coefficients in OpenCV's order, 4, 5, 8 or 12 of them.
    right_from_left
        Pose of the left frame as the right camera sees it.
    image_size
        (width, height), px; of both cameras.
    covariance
        (p, p) of `parameter_names`, or None where nobody has stated it.
    """

    K_left: Array
    dist_left: Array
    K_right: Array
    dist_right: Array
    right_from_left: RightFromLeft
    image_size: tuple[int, int]
    covariance: Array | None = None

    def _repr_html_(self) -> str:
        """Show both cameras, with standard uncertainties where they are known, for a notebook."""
        known = self.standard_uncertainties() or {}
        rows = []
        for side, camera in (("left", self.left), ("right", self.right)):
            for name, value in zip(_camera_names(camera.distortion), parameters_of(camera), strict=True):
                std = known.get(f"{side}_{name}")
                rows.append((f"{side} {name}", number_words(value), "–" if std is None else number_words(std)))
        facts = {
            "pictures, px": " × ".join(str(count) for count in self.image_size),
            "baseline, mm": number_words(self.baseline_mm),
            "uncertainty": "not stated" if self.covariance is None else "stated",
        }
        return summary_html("Camera pair", facts_html(facts), table_html(("", "value", "±"), rows))

    @property
    def left(self) -> Camera:
        """The left camera."""
        return Camera(self.K_left, self.dist_left)

    @property
    def right(self) -> Camera:
        """The right camera."""
        return Camera(self.K_right, self.dist_right)

    @property
    def baseline_mm(self) -> float:
        """Distance of the two cameras' centres."""
        return float(np.linalg.norm(self.right_from_left.t_mm))

    @property
    def projection_left_px(self) -> Array:
        """(3, 4) `K_left [I 0]`: undistorted pixels from the left frame."""
        return self.K_left @ np.eye(3, 4)

    @property
    def projection_right_px(self) -> Array:
        """(3, 4) `K_right [R t]`: undistorted pixels from the left frame."""
        pose = self.right_from_left
        return self.K_right @ np.column_stack([pose.R, pose.t_mm])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the rows of `covariance`.

        `rotation_*_rad` are a small turn about the right camera's axes after `R`:
        `R_true = exp([rotation]×) R`.
        """
        left = ("left_" + name for name in _camera_names(self.dist_left))
        right = ("right_" + name for name in _camera_names(self.dist_right))
        return (*left, *right, *POSE_NAMES)

    def standard_uncertainties(self) -> dict[str, float] | None:
        """Square roots of the covariance's diagonal by name."""
        if self.covariance is None:
            return None
        deviations = np.sqrt(np.diag(self.covariance))
        return dict(zip(self.parameter_names, (float(value) for value in deviations), strict=True))

    def changed_by(self, change: Array) -> Rig:
        """Give the rig with its parameters (in the order of `parameter_names`) changed by small amounts."""
        n_left = 4 + len(self.dist_left)
        n_right = 4 + len(self.dist_right)
        left = camera_from_parameters(parameters_of(self.left) + change[:n_left])
        right = camera_from_parameters(parameters_of(self.right) + change[n_left : n_left + n_right])
        turn, shift = change[n_left + n_right :][:3], change[n_left + n_right :][3:]
        pose = self.right_from_left
        return Rig(
            left.matrix_px,
            left.distortion,
            right.matrix_px,
            right.distortion,
            RightFromLeft(rotation_from_vector(turn) @ pose.R, pose.t_mm + shift),
            self.image_size,
            self.covariance,
        )

    def to_document(self) -> dict[str, Any]:
        """Give the content of `rig.json`."""
        covariance = None
        if self.covariance is not None:
            covariance = {"parameters": list(self.parameter_names), "matrix": self.covariance.tolist()}
        return {
            "schema": 1,
            "K_left": self.K_left.tolist(),
            "dist_left": self.dist_left.tolist(),
            "K_right": self.K_right.tolist(),
            "dist_right": self.dist_right.tolist(),
            "right_from_left": {
                "R": self.right_from_left.R.tolist(),
                "t_mm": self.right_from_left.t_mm.tolist(),
            },
            "image_size": list(self.image_size),
            "covariance": covariance,
        }


def _camera_names(distortion: Array) -> tuple[str, ...]:
    return (*INTRINSIC_NAMES, *DISTORTION_NAMES[: len(distortion)])


def write_rig(path: str | Path, rig: Rig) -> None:
    """Write `rig.json`, whole or not at all."""
    check_written(path, rig, Rig, "write_rig(path, rig)")
    write_json(path, rig.to_document())


def read_rig(path: str | Path) -> Rig:
    """Read and check `rig.json`; every refusal names the key and the remedy."""
    try:
        document = read_json(path)
    except InputFileError as error:
        if not Path(path).exists():
            raise
        raise InputFileError(path, error.problem, row=error.row, remedy=_RIG_HINT) from error
    return rig_from_document(document, path)


def rig_from_document(document: Any, path: str | Path) -> Rig:
    """Check the content of a `rig.json`.

    Raises
    ------
    InputFileError
        for a missing or malformed key; `path` is named in the message.
    """
    if not isinstance(document, dict):
        raise InputFileError(path, "holds no rig", remedy=_RIG_HINT)
    matrices = {key: _camera_matrix(document, key, path) for key in ("K_left", "K_right")}
    distortions = {key: _distortion(document, key, path) for key in ("dist_left", "dist_right")}
    size = document.get("image_size")
    if (
        not isinstance(size, list)
        or len(size) != 2
        or not all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in size)
    ):
        raise InputFileError(
            path, f"{size!r} is not a picture size", column="image_size", remedy="write [width, height] in px"
        )
    rig = Rig(
        matrices["K_left"],
        distortions["dist_left"],
        matrices["K_right"],
        distortions["dist_right"],
        _pose(document.get("right_from_left"), path),
        (size[0], size[1]),
    )
    covariance = _covariance(document.get("covariance"), rig.parameter_names, path)
    return Rig(
        rig.K_left,
        rig.dist_left,
        rig.K_right,
        rig.dist_right,
        rig.right_from_left,
        rig.image_size,
        covariance,
    )


def _numbers(value: Any, shape: tuple[int, ...] | None, path: str | Path, column: str) -> Array:
    """Finite numbers of the given shape, or a refusal that names the key."""
    if value is None:
        raise InputFileError(path, "is missing", column=column, remedy=_CALIBRATE_HINT)
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputFileError(path, "is not a table of numbers", column=column) from error
    if shape is not None and numbers.shape != shape:
        raise InputFileError(path, f"has shape {numbers.shape}, {shape} is needed", column=column)
    if not np.isfinite(numbers).all():
        raise InputFileError(path, "holds a number that is not finite", column=column)
    return numbers


def _camera_matrix(document: dict[str, Any], key: str, path: str | Path) -> Array:
    matrix = _numbers(document.get(key), (3, 3), path, key)
    well_formed = (
        matrix[0, 0] > 0.0
        and matrix[1, 1] > 0.0
        and matrix[0, 1] == 0.0
        and matrix[1, 0] == 0.0
        and np.array_equal(matrix[2], [0.0, 0.0, 1.0])
    )
    if not well_formed:
        raise InputFileError(
            path, "is not a camera matrix", column=key, remedy="[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in px"
        )
    return matrix


def _distortion(document: dict[str, Any], key: str, path: str | Path) -> Array:
    numbers = np.ravel(_numbers(document.get(key), None, path, key))
    if len(numbers) == 14 and not numbers[12:].any():
        # OpenCV's longest form with a sensor that is not tilted.
        numbers = numbers[:12]
    if len(numbers) not in DISTORTION_COUNTS:
        raise InputFileError(
            path,
            f"{len(numbers)} distortion coefficients are not supported",
            column=key,
            remedy="OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]; a tilted sensor is not modelled",
        )
    return numbers


def _pose(table: Any, path: str | Path) -> RightFromLeft:
    if not isinstance(table, dict):
        raise InputFileError(path, "is missing", column="right_from_left", remedy=_CALIBRATE_HINT)
    rotation = _numbers(table.get("R"), (3, 3), path, "right_from_left.R")
    orthogonal = np.abs(rotation @ rotation.T - np.eye(3)).max() < _ROTATION_TOLERANCE
    if not orthogonal or np.linalg.det(rotation) < 0.0:
        raise InputFileError(path, "is not a rotation matrix", column="right_from_left.R")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROUNDED_ROTATION:
        rotation = nearest_rotation(rotation)
    shift = _numbers(table.get("t_mm"), (3,), path, "right_from_left.t_mm")
    if not math.hypot(*shift) > 0.0:
        raise InputFileError(
            path,
            "both cameras stand at one place",
            column="right_from_left.t_mm",
            remedy="depth needs a distance between the cameras",
        )
    return RightFromLeft(rotation, shift)


def _covariance(table: Any, names: tuple[str, ...], path: str | Path) -> Array | None:
    if table is None:
        return None
    if not isinstance(table, dict) or table.get("parameters") != list(names):
        raise InputFileError(
            path,
            "does not name this rig's parameters in their order",
            column="covariance.parameters",
            remedy="write " + ", ".join(names) + "; or null where it is not known",
        )
    matrix = _numbers(table.get("matrix"), (len(names), len(names)), path, "covariance.matrix")
    why = _why_no_covariance(matrix, names)
    if why:
        raise InputFileError(
            path,
            f"is not a covariance: {why}",
            column="covariance.matrix",
            remedy=f"{_CALIBRATE_HINT}; or write null where it is not known",
        )
    return matrix


def _why_no_covariance(matrix: Array, names: tuple[str, ...]) -> str:
    """Say why no errors have this covariance; '' for one that some have.

    Eigenvalues are those of the correlations, so that parameters of different units weigh alike.
    """
    variances = np.diag(matrix)
    if (variances < 0.0).any():
        return f"the variance of {names[int(np.argmin(variances))]} is negative"
    scale = np.sqrt(np.outer(variances, variances))
    if (np.abs(matrix - matrix.T) > _ROUNDED_COVARIANCE * scale + 1e-300).any():
        return "it is not symmetric"
    beyond = np.abs(matrix) > (1.0 + _ROUNDED_COVARIANCE) * scale + 1e-300
    if beyond.any():
        first, second = np.argwhere(beyond)[0]
        return f"{names[first]} and {names[second]} are correlated by more than 1"
    deviations = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    values = np.linalg.eigvalsh(matrix / np.outer(deviations, deviations))
    if values[0] < -_ROUNDED_COVARIANCE * values[-1]:
        return f"its correlations have a negative eigenvalue ({values[0]:.2g})"
    return ""
