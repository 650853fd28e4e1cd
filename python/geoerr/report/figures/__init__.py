"""Figures: one function a figure, each gives a `plotly.graph_objects.Figure`."""

from geoerr.report.figures.circle import circle
from geoerr.report.figures.error_curves import error_curves
from geoerr.report.figures.error_field import error_field
from geoerr.report.figures.nine_lines import LineCurve, lines_of_errors, nine_lines

__all__ = ["LineCurve", "circle", "error_curves", "error_field", "lines_of_errors", "nine_lines"]
