"""All sources of a fit's uncertainty, each once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from geoerr.budget.calibration import calibration_source, point_in_pixels
from geoerr.budget.estimator import Estimator, root_of
from geoerr.budget.repeatability import repeatability_source
from geoerr.budget.source import Piece, Source
from geoerr.fit import Fitted
from geoerr.model import GROUPS, Model
from geoerr.model.arrays import Numbers
from geoerr.model.conditions import Conditions
from geoerr.vision.rig import Rig

# Less probable than this, what the residual has beyond the noise is not chance (as for the fit's own scale).
_SIGNIFICANCE = 0.01
_UM_PER_MM = 1e3
_URAD = 1e6
_N_ENTRIES = 21


@dataclass(frozen=True, eq=False)
class Stage:
    """One stage of the way from the picture to the parameters: what is uncertain there, and by how much."""

    name: str
    what: str
    std: float
    unit: str


def sources_of_fit(
    fitted: Fitted, estimator: Estimator, rig: Rig | None, calibration_dof: float
) -> tuple[list[Source], list[str]]:
    """Give the sources that the data tell of, and sentences about what is not counted."""
    sources, silent = list(_of_noise(fitted, estimator)), []
    calibration = calibration_source(estimator, rig, calibration_dof)
    if calibration is None:
        silent.append("calibration of the measuring device: the fit was not told of it")
    else:
        sources.append(calibration)
    smoothness = estimator.of_smoothness()
    if smoothness.shape[1]:
        what = "curvature of the functions where the points do not hold it"
        sources.append(Source("smoothness", what, "A", "normal", math.nan, "", by_parameter=smoothness))
    for found in (_misfit(fitted), repeatability_source(fitted)):
        if isinstance(found, Source):
            sources.append(found)
        else:
            silent.append(found)
    return sources, silent


def stages_of_parameters(model: Model, at: Conditions) -> list[Stage]:
    """Give the standard uncertainties of the errors as tables, by groups: medians over the measured range."""
    tables = model.error_functions(_N_ENTRIES, at=at)
    stages = []
    for group in ("positioning", "straightness", "pitch-yaw", "roll"):
        known = [tables.functions[name] for name in GROUPS[group] if name in tables.functions]
        std = [np.asarray(function.std)[1:] for function in known if function.std is not None]
        if std:
            is_angle = group in ("pitch-yaw", "roll")
            size = float(np.median(np.concatenate(std)))
            stages.append(
                Stage("parameters", group, size * (_URAD if is_angle else _UM_PER_MM), "µrad" if is_angle else "µm")
            )
    squareness = [one.std_rad for one in tables.squareness.values() if one.std_rad is not None]
    if squareness:
        stages.append(Stage("parameters", "squareness", float(np.median(squareness)) * _URAD, "µrad"))
    stages += [
        Stage("parameters", f"{term.id}: {parameter.label}", parameter.std, parameter.unit)
        for term in model.machine_terms
        if term.kind != "classic"
        for parameter in (*term.coefficients, *term.inner)
    ]
    return stages


def stages_of(fitted: Fitted, rig: Rig | None) -> list[Stage]:
    """Give the stages before the parameters: corner (with a rig) and point; medians over the rows."""
    sightings = fitted.sightings
    if not sightings.is_stated:
        return [
            Stage("point", "scatter of a measured component about the model", fitted.scale * _UM_PER_MM, "µm"),
        ]
    rows = fitted.solved.used & sightings.is_measured.all(axis=1)
    stages = []
    covariance = covariances_mm2(fitted)
    if rig is not None and rows.any():
        px = point_in_pixels(rig, sightings.measured_mm[rows], covariance[rows])
        stages.append(Stage("corner", "one picture coordinate of a target", float(np.median(px)), "px"))
    size_um = np.sqrt(np.trace(covariance[fitted.solved.used], axis1=1, axis2=2)) * _UM_PER_MM
    return [*stages, Stage("point", "a measured point (length)", float(np.median(size_um)), "µm")]


def covariances_mm2(fitted: Fitted) -> Numbers:
    """Give the stated covariances of the measured points (n, 3, 3), 0 in what was not measured."""
    inverse = fitted.sightings.unwhitening
    return np.asarray(inverse @ inverse.transpose(0, 2, 1))


def conditions_of(at_std: Mapping[str, float]) -> Iterator[Source]:
    """Give a source for every condition that is not known exactly."""
    for name, std in at_std.items():
        yield Source(
            f"condition {name}",
            f"{name} at which the prediction is asked for",
            "B",
            "normal",
            float(std),
            "°C" if name == "temp" or name.startswith("temp_") else "",
            condition=(name, float(std)),
        )


def source_of_record(covariance: Numbers) -> Source:
    """Give the parameters' covariance as one source: a model file does not say what it is made of."""
    what = "measured points and calibration, as the record holds them"
    return Source("data", what, "A", "normal", math.nan, "", by_parameter=root_of(covariance))


def _of_noise(fitted: Fitted, estimator: Estimator) -> Iterator[Source]:
    parts = estimator.of_noise()
    root = np.concatenate(parts, axis=1)
    if not fitted.sightings.is_stated:
        root, std, dof = fitted.scale * root, fitted.scale * _UM_PER_MM, float(max(fitted.dof, 1))
        yield Source("data", "scatter of the measured points", "A", "normal", std, "µm", dof, by_parameter=root)
        return
    stage = stages_of(fitted, None)[-1]
    pieces = {}
    if parts[1].shape[1]:
        is_first = np.arange(root.shape[1]) < parts[0].shape[1]
        pieces = {
            "places of targets known": Piece(root * is_first, math.nan, ""),
            "with their unknown places": Piece(root * ~is_first, math.nan, ""),
        }
    what = "noise of the pictures, by the points' stated covariances"
    yield Source("pixels", what, "A", "normal", stage.std, stage.unit, by_parameter=root, pieces=pieces)
    if fitted.scale > 1.0:
        beyond = math.sqrt(fitted.scale**2 - 1.0)
        yield Source(
            "scatter",
            "scatter of the points beyond their stated covariances",
            "A",
            "normal",
            stage.std * beyond,
            stage.unit,
            float(max(fitted.dof, 1)),
            by_parameter=beyond * root,
        )


def _components_of_a_row(fitted: Fitted) -> float:
    """Give how many components a row has in the mean: a lack of fit is a sum over those that were measured.

    What a laser along one axis sees is all of that axis; the others are taken for as much, for nothing tells.
    """
    return float(fitted.sightings.is_measured[fitted.solved.used].sum(axis=1).mean())


def _misfit(fitted: Fitted) -> Source | str:
    """Give lack of fit as an error of every place: what is not in the model does not average out."""
    split = fitted.split
    if split.lack_of_fit_um is None or split.lack_of_fit_p is None:
        return "misfit of the model: neither repeats nor stated uncertainties tell it from noise"
    if split.lack_of_fit_p > _SIGNIFICANCE:
        return f"misfit of the model: none is seen (p = {split.lack_of_fit_p:.2g})"
    dof = float(max(split.dof[0] - split.dof[1], 1))
    return Source(
        "misfit",
        "what the model does not hold (lack of fit)",
        "A",
        "normal",
        split.lack_of_fit_um,
        "µm",
        dof,
        everywhere_mm=np.eye(3) * split.lack_of_fit_um / _UM_PER_MM / math.sqrt(_components_of_a_row(fitted)),
    )
