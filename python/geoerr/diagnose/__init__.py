"""Where a model fails, which physical effect it lacks, and how the error falls when that is added."""

from geoerr.diagnose.answer import Answer, Verdict
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.change import Change, add_effect
from geoerr.diagnose.comparison import Comparison, Freedom, common_rows, compare
from geoerr.diagnose.components import Component
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.document import comparison_document, document_of
from geoerr.diagnose.findings import Alias, Finding, HeldOut, Separation, Unknown
from geoerr.diagnose.lengths import LengthComparison
from geoerr.diagnose.parts import Part
from geoerr.diagnose.regions import Region
from geoerr.diagnose.set_up import SetUp
from geoerr.diagnose.spread_trends import SpreadTrend
from geoerr.diagnose.trends import Bin, Trend
from geoerr.diagnose.where import Where

__all__ = [
    "Alias",
    "Answer",
    "Bin",
    "Change",
    "Comparison",
    "Component",
    "Diagnosis",
    "Finding",
    "Freedom",
    "HeldOut",
    "LengthComparison",
    "Part",
    "Region",
    "Separation",
    "SetUp",
    "SpreadTrend",
    "Trend",
    "Unknown",
    "Verdict",
    "Where",
    "add_effect",
    "common_rows",
    "compare",
    "comparison_document",
    "diagnose",
    "document_of",
]
