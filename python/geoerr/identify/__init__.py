"""From observations to error functions: nine lines (Li et al. 2023)."""

from geoerr.identify.nine_line import FoundLine, NineLineResult, analyze_nine_lines, identify_nine_line

__all__ = ["FoundLine", "NineLineResult", "analyze_nine_lines", "identify_nine_line"]
