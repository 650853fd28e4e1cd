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
from geoerr.fit.elsewhere import off_between_places
from geoerr.fit.result import components_of_a_row
from geoerr.model import GROUPS, FitRecord, Model
from geoerr.model.arrays import Numbers
from geoerr.model.conditions import Conditions
from geoerr.model.fit_words import BETWEEN_PLACES, COUNTS_SHARED, PLACES_LEFT_OUT
from geoerr.summaries import p_words
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
    sources, silent = [*_of_noise(fitted, estimator), *_of_what_rows_share(fitted)], []
    calibration = calibration_source(estimator, rig, calibration_dof)
    if calibration is None:
        silent.append("calibration of the measuring device: the fit was not told of it")
    else:
        sources.append(calibration)
    smoothness = estimator.of_smoothness()
    if smoothness.shape[1]:
        what = "curvature of the functions where the points do not hold it"
        sources.append(Source("smoothness", what, "A", "normal", math.nan, "", by_parameter=smoothness))
    between = off_between_places(fitted)
    std_um = None if between is None else between.std_mm * _UM_PER_MM
    between_places = _between_places(std_um, 0 if between is None else between.n_places)
    for found in (_misfit_of_fit(fitted), between_places, repeatability_source(fitted)):
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
        known = {name: tables.functions[name] for name in GROUPS[group] if name in tables.functions}
        std = {name: np.asarray(function.std)[1:] for name, function in known.items() if function.std is not None}
        if std:
            is_angle = group in ("pitch-yaw", "roll")
            # A table that conditions alone make is exact where they are, and says nothing of the error's own.
            own = [values for name, values in std.items() if name not in model.not_in_model]
            size = float(np.median(np.concatenate(own))) if own else math.nan
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


def sources_of_record(record: FitRecord) -> tuple[list[Source], list[str]]:
    """Give the sources that a model file tells of, and sentences about what is not counted.

    The parameters' covariance is one source, for the file does not say what it is made of. Where the points scatter
    beyond what they state the excess is a source of its own: only that has the fit's degrees of freedom.
    """
    figures, counts_shared = record.figures, record.noise.get(COUNTS_SHARED, 0.0) > 0.0
    # What rows share has no factor: then all is one source, of the fit's degrees of freedom.
    scale = 1.0 if counts_shared else record.noise.get("scale", 1.0)
    dof, silent = max(figures.get("dof", math.nan), 1.0), []
    if "dof" not in figures and not ("scale" in record.noise and scale <= 1.0):
        dof = math.inf
        silent.append("degrees of freedom of the data: the model file does not hold them, and they count as infinite")
    root = root_of(record.covariance)
    is_stated = "scatter_um" not in record.noise
    is_as_stated = is_stated and "scale" in record.noise and not counts_shared
    sources = [_of_covariance(root / max(scale, 1.0), math.inf if is_as_stated else dof)]
    if scale > 1.0:
        beyond = math.sqrt(1.0 - 1.0 / scale**2)
        what = "scatter of the points beyond their stated covariances"
        sources.append(Source("scatter", what, "A", "normal", math.nan, "", dof, by_parameter=beyond * root))
    for found in (_misfit_of_record(record), _between_places_of_record(record)):
        if isinstance(found, Source):
            sources.append(found)
        else:
            silent.append(found)
    return sources, [*silent, "repeatability of the machine: a model file does not hold the data that would tell"]


def _of_covariance(root: Numbers, dof: float) -> Source:
    what = "measured points and calibration, as the record holds them"
    return Source("data", what, "A", "normal", math.nan, "", dof, by_parameter=root)


def _of_noise(fitted: Fitted, estimator: Estimator) -> Iterator[Source]:
    parts = estimator.of_noise()
    root = np.concatenate(parts, axis=1)
    shared = fitted.shared_noise
    if not fitted.sightings.is_stated:
        scatter = fitted.scale if shared is None else shared.mean_scatter
        root = scatter * root if shared is None else shared.scatter_root()
        std, dof = scatter * _UM_PER_MM, float(max(fitted.dof, 1))
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
    scatter = fitted.scale if shared is None else shared.mean_scatter
    if scatter > 1.0:
        beyond = math.sqrt(scatter**2 - 1.0)
        yield Source(
            "scatter",
            "scatter of the points beyond their stated covariances",
            "A",
            "normal",
            stage.std * beyond,
            stage.unit,
            float(max(fitted.dof, 1)),
            by_parameter=beyond * root if shared is None else shared.scatter_root(beyond=1.0),
        )


def _of_what_rows_share(fitted: Fitted) -> Iterator[Source]:
    if fitted.shared_noise is not None:
        what = "offsets of passes and drifts, which rows share"
        # As many offsets as passes, of which one in each session is the pose's.
        dof = float(max(fitted.sightings.n_passes - len(fitted.sightings.sessions), 1))
        yield Source("shared", what, "A", "normal", math.nan, "", dof, by_parameter=fitted.shared_noise.root)


def _misfit_of_fit(fitted: Fitted) -> Source | str:
    split = fitted.split
    dof = split.dof[0] - split.dof[1]
    return _misfit(split.lack_of_fit_um, split.lack_of_fit_p, dof, components_of_a_row(fitted))


def _misfit_of_record(record: FitRecord) -> Source | str:
    figures = record.figures
    size_um, p_value = (figures.get(name, math.nan) for name in ("lack_of_fit_um", "lack_of_fit_p"))
    if "lack_of_fit_p" not in figures:
        return "misfit of the model: the model file does not hold it"
    # A file that does not say how many components a row has may be of a device that sees one: all is along it.
    return _misfit(
        None if math.isnan(size_um) else size_um,
        None if math.isnan(p_value) else p_value,
        figures.get("lack_of_fit_dof", math.inf),
        figures.get("components_per_row", 1.0),
    )


def _misfit(size_um: float | None, p_value: float | None, dof: float, n_components: float) -> Source | str:
    """Give lack of fit as an error of every place: what is not in the model does not average out.

    It is a sum over the components that a row has, `n_components` in the mean. What a laser along one axis sees is
    all of that axis; the others are taken for as much, for nothing tells.
    """
    if size_um is None or p_value is None:
        return "misfit of the model: neither repeats nor stated uncertainties tell it from noise"
    if p_value > _SIGNIFICANCE:
        return f"misfit of the model: none is seen ({p_words(p_value)})"
    return Source(
        "misfit",
        "what the model does not hold (lack of fit)",
        "A",
        "normal",
        size_um,
        "µm",
        float(max(dof, 1)),
        everywhere_mm=np.eye(3) * size_um / _UM_PER_MM / math.sqrt(max(n_components, 1.0)),
    )


def _between_places_of_record(record: FitRecord) -> Source | str:
    figures = record.figures
    n_places = figures.get(PLACES_LEFT_OUT, math.nan)
    if math.isnan(n_places):
        return (
            "between the places that were measured: the model file does not hold how far off the model may be there"
        )
    std_um = np.array([figures.get(name, math.nan) for name in BETWEEN_PLACES])
    return _between_places(None if np.isnan(std_um).any() else std_um, int(n_places))


def _between_places(std_um: Numbers | None, n_places: int) -> Source | str:
    """Give what a model is off by between places of axes as an error of every place, (3,); None where nothing tells.

    So far it is missed at places that are left out: of a rough machine more than what its numbers are uncertain by.
    """
    if std_um is None:
        return (
            "between the places that were measured: no axis has places that were come to again and that the others "
            "tell to within what a row scatters, so that none can be left out to see how far off the model is there"
        )
    if not std_um.any():
        return "between the places that were measured: places that are left out are missed by no more than chance"
    return Source(
        "between places",
        "what the model is off by between the places that were measured",
        "A",
        "normal",
        float(np.linalg.norm(std_um)),
        "µm",
        float(max(n_places - 1, 1)),
        everywhere_mm=np.diag(std_um / _UM_PER_MM),
    )
