"""Figures: one function a figure, each gives a `plotly.graph_objects.Figure`."""

from geoerr.diagnose.labels import value_label, variable_label, variable_unit
from geoerr.report.figures.calibration import CalibrationView, calibration_quality, calibration_views
from geoerr.report.figures.circle import circle, circular_test, predicted_circles
from geoerr.report.figures.diagnosis import circle_causes, diagnosis_bars, unknown_curve
from geoerr.report.figures.error_curves import error_curves
from geoerr.report.figures.error_field import error_field
from geoerr.report.figures.fall import diagnosis_fall, error_fall
from geoerr.report.figures.measurement import measurement_residuals
from geoerr.report.figures.nine_lines import LineCurve, lines_of_errors, nine_lines
from geoerr.report.figures.of_model import (
    model_circles,
    model_diagonals,
    model_difference,
    model_errors,
    model_fall,
    model_field,
    model_positioning,
)
from geoerr.report.figures.path import path_error, path_places
from geoerr.report.figures.positioning import positioning_curves
from geoerr.report.figures.regions import residual_of_regions
from geoerr.report.figures.residuals import (
    residual_against,
    residual_by_region,
    residual_directions,
    residual_histogram,
    residual_in_volume,
    residual_over,
    residual_vectors,
)
from geoerr.report.figures.states import difference_curves, difference_map, state_curves
from geoerr.report.figures.uncertainty import budget_slices, uncertainty_slices

__all__ = [
    "CalibrationView",
    "LineCurve",
    "budget_slices",
    "calibration_quality",
    "calibration_views",
    "circle",
    "circle_causes",
    "circular_test",
    "diagnosis_bars",
    "diagnosis_fall",
    "difference_curves",
    "difference_map",
    "error_curves",
    "error_fall",
    "error_field",
    "lines_of_errors",
    "measurement_residuals",
    "model_circles",
    "model_diagonals",
    "model_difference",
    "model_errors",
    "model_fall",
    "model_field",
    "model_positioning",
    "nine_lines",
    "path_error",
    "path_places",
    "positioning_curves",
    "predicted_circles",
    "residual_against",
    "residual_by_region",
    "residual_directions",
    "residual_histogram",
    "residual_in_volume",
    "residual_of_regions",
    "residual_over",
    "residual_vectors",
    "state_curves",
    "uncertainty_slices",
    "unknown_curve",
    "value_label",
    "variable_label",
    "variable_unit",
]
