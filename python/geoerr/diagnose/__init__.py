"""Where a model fails: any model held against any measurements."""

from geoerr.diagnose.comparison import Comparison, Freedom, common_rows, compare
from geoerr.diagnose.components import Component
from geoerr.diagnose.document import comparison_document, document_of
from geoerr.diagnose.lengths import LengthComparison
from geoerr.diagnose.parts import Part
from geoerr.diagnose.regions import Region
from geoerr.diagnose.set_up import SetUp
from geoerr.diagnose.trends import Bin, Trend

__all__ = [
    "Bin",
    "Comparison",
    "Component",
    "Freedom",
    "LengthComparison",
    "Part",
    "Region",
    "SetUp",
    "Trend",
    "common_rows",
    "compare",
    "comparison_document",
    "document_of",
]
