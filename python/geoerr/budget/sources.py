"""All sources of a fit's uncertainty, each once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from geoerr.budget.calibration import calibration_source, point_in_pixels
from geoerr.budget.estimator import Estimator, root_of
from geoerr.budget.source import Source
from geoerr.fit import Fitted
from geoerr.fit.noise import repeats_of
from geoerr.model.arrays import Numbers
from geoerr.observations import CARRIERS
from geoerr.vision.rig import Rig

# Scatter beyond what is stated, and misfit beyond the noise, count where chance makes so much less often than this:
# below it their estimates are the root of a difference that is as often negative.
SIGNIFICANCE = 0.05
_UM_PER_MM = 1e3


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
    for found in (_misfit(fitted), _repeatability(fitted)):
        if isinstance(found, Source):
            sources.append(found)
        else:
            silent.append(found)
    return sources, silent


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
    inverse = np.linalg.pinv(fitted.sightings.whitening)
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
    root = estimator.of_noise()
    if not fitted.sightings.is_stated:
        yield Source(
            "data",
            "scatter of the measured points (nothing stated)",
            "A",
            "normal",
            fitted.scale * _UM_PER_MM,
            "µm",
            float(max(fitted.dof, 1)),
            by_parameter=fitted.scale * root,
        )
        return
    stage = stages_of(fitted, None)[-1]
    yield Source(
        "pixels",
        "noise of the pictures, by the points' stated covariances",
        "A",
        "normal",
        stage.std,
        stage.unit,
        by_parameter=root,
    )
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


def _misfit(fitted: Fitted) -> Source | str:
    """Give lack of fit as an error of every place: what is not in the model does not average out."""
    split = fitted.split
    if split.lack_of_fit_um is None or split.lack_of_fit_p is None:
        return "misfit of the model: neither repeats nor stated uncertainties tell it from noise"
    if split.lack_of_fit_p > SIGNIFICANCE:
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
        everywhere_mm=np.eye(3) * split.lack_of_fit_um / _UM_PER_MM / math.sqrt(3.0),
    )


def _repeatability(fitted: Fitted) -> Source | str:
    """Give what repeats scatter beyond the stated noise, tool and work added: the machine does not come back better.

    The degrees of freedom are those of a difference of which one member is known: ν (s²/v)² (Welch, Satterthwaite).
    """
    sightings, nothing = fitted.sightings, "repeatability of the machine: no row was measured again"
    stated = np.zeros((len(sightings), 3))
    if sightings.is_stated:
        inverse = np.linalg.pinv(sightings.whitening)
        for column in np.moveaxis(inverse, 2, 0):
            in_base = fitted.problem.in_base_axes(fitted.solved.state, np.ascontiguousarray(column))
            stated += in_base**2
    variance, doubt, n_seen = np.zeros(3), np.zeros(3), 0
    is_circle = np.array([kind == "circle" for kind in sightings.frames])[sightings.session]
    bodies = ("relative",) if (sightings.carrier == CARRIERS.index("relative")).any() else ("tool", "work")
    for body in bodies:
        rows = fitted.solved.used & (sightings.carrier == CARRIERS.index(body)) & ~is_circle
        repeats = repeats_of(sightings, fitted.residual_mm, rows)
        for component in np.flatnonzero(repeats.dof > 0):
            n_seen += 1
            seen = rows & sightings.is_measured[:, component]
            again = seen & (np.bincount(repeats.group[seen], minlength=len(seen))[repeats.group] > 1)
            noise, dof = float(stated[again, component].mean()), float(repeats.dof[component])
            total = float(repeats.variance_mm2[component])
            if noise > 0.0 and stats.chi2.sf(dof * total / noise, dof) > SIGNIFICANCE:
                continue
            variance[component] += total - noise
            doubt[component] += total**2 / dof
    if not n_seen:
        return nothing
    if not variance.any():
        return "repeatability of the machine: repeats scatter no more than their stated noise"
    return Source(
        "repeatability",
        "what the machine does not repeat" + ("" if sightings.is_stated else " (with the noise of measuring)"),
        "A",
        "normal",
        math.sqrt(float(variance.sum())) * _UM_PER_MM,
        "µm",
        float(variance.sum() ** 2 / doubt.sum()),
        everywhere_mm=np.diag(np.sqrt(variance)),
        is_of_part=True,
    )
