"""Fits with known noise and a known calibration: a small machine, seen by a camera pair."""

from __future__ import annotations

import numpy as np
import polars as pl
from fit_scenes import COVARIANCE_MM2, CUBICS, ROOT_MM, cubic_truth, measured_again
from virtual_machine import Camera, machine_of, nine_lines, observe, rotation

from geoerr.fit import FitOptions, FitResult, fit_terms, result_of
from geoerr.machine import Machine
from geoerr.observations import Observations
from geoerr.vision.rig import Rig, RightFromLeft
from geoerr.vision.sensitivity import project_to_both, sensitivity_of_points

NOISE_PX = 0.01
CHAIN = "wZbXYt"


def rig_of() -> Rig:
    """Li's Table 2 in size, with a covariance whose groups are correlated."""
    matrix = np.array([[2319.0, 0.0, 1223.0], [0.0, 2319.0, 1023.0], [0.0, 0.0, 1.0]])
    lens = np.array([-0.098, 0.121, 3.1e-4, -2.2e-4, -0.021])
    pose = RightFromLeft(rotation(np.array([0.004, 0.28, 0.009])), np.array([-297.0, -2.8, 42.4]))
    camera = [0.05, 0.05, 0.08, 0.08, 2e-5, 8e-5, 3e-6, 3e-6, 1e-4]
    size = np.array([*camera, *camera, 2e-5, 3e-5, 1e-5, 0.02, 0.01, 0.03])
    rng = np.random.default_rng(4)
    mixed = np.eye(24) + 0.2 * rng.normal(size=(24, 24)) / np.sqrt(24.0)
    root = mixed * size[:, None]
    return Rig(matrix, lens, matrix, lens, pose, (2448, 2048), root @ root.T)


def camera_before() -> Camera:
    """The left camera, 2.2 m before the middle of both bodies' travel."""
    turn = rotation(np.array([0.5, 0.3, 0.1]))
    return Camera(turn, np.array([0.0, 0.0, 2200.0]) - turn @ np.array([200.0, 200.0, 0.0]))


def fit_of_nine_lines(*, with_rig: bool = False, told: bool = True, seed: int = 0) -> tuple[FitResult, Rig | None]:
    """Nine lines of the small machine with noise; with a rig, of 0.01 px in every picture coordinate."""
    machine, rng = machine_of(CHAIN), np.random.default_rng(seed)
    observations = observe(
        machine, cubic_truth(rng), nine_lines(machine), {"0": camera_before()}, covariance_mm2=COVARIANCE_MM2
    )
    if not with_rig:
        return fitted(
            machine, measured_again(observations, rng.normal(size=(observations.frame.height, 3)) @ ROOT_MM.T)
        ), None
    rig, true = rig_of(), observations.measured_mm
    by_point = project_to_both(rig, true).by_point
    covariance = np.linalg.inv(by_point.transpose(0, 2, 1) @ by_point) * NOISE_PX**2
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=true.shape))
    seen = with_covariances(measured_again(observations, noise), covariance)
    told_of = (
        {"rig_sensitivity": sensitivity_of_points(rig, seen.measured_mm), "rig_covariance": rig.covariance}
        if told
        else {}
    )
    return fitted(machine, seen, **told_of), rig


def with_covariances(observations: Observations, covariance_mm2: np.ndarray) -> Observations:
    pairs = {"cxx": (0, 0), "cxy": (0, 1), "cxz": (0, 2), "cyy": (1, 1), "cyz": (1, 2), "czz": (2, 2)}
    columns = {name: pl.Series(covariance_mm2[:, i, j]) for name, (i, j) in pairs.items()}
    return Observations(observations.frame.with_columns(**columns), observations.sources)


def fitted(machine: Machine, observations: Observations, **more: object) -> FitResult:
    options = FitOptions(bases=CUBICS, threads=1)
    return result_of(fit_terms(machine, (observations,), options=options, **more))  # type: ignore[arg-type]
