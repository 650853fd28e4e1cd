"""From observations to error functions: nine lines (Li et al. 2023)."""

from geoerr.identify.nine_line import FoundLine, NineLineResult, analyze_nine_lines, identify_nine_line
from geoerr.identify.straightness import TangentVerdict
from geoerr.identify.uncertainty import AxisScatter

__all__ = [
    "AxisScatter",
    "FoundLine",
    "NineLineResult",
    "TangentVerdict",
    "analyze_nine_lines",
    "identify_nine_line",
]
