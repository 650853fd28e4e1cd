"""The model: where a machine with its errors really puts the tool, how sure that is, and what to command instead.

A model is a machine with its errors as tables (`errors.json`), as terms (`model.json`: channels and expressions, with
the record of their fit), or none.
"""

from geoerr.model.commands import Commands
from geoerr.model.compile import Compiled, compile_terms, start_values
from geoerr.model.conditions import REFERENCE
from geoerr.model.gauge import MeanScale
from geoerr.model.groups import GROUPS, POSITIONING, ROLL
from geoerr.model.load import load_model, write_model
from geoerr.model.model import Model
from geoerr.model.parameters import Correlation
from geoerr.model.record import FitRecord, HistoryEntry
from geoerr.model.tables import squareness_of_li_rad

__all__ = [
    "GROUPS",
    "POSITIONING",
    "REFERENCE",
    "ROLL",
    "Commands",
    "Compiled",
    "Correlation",
    "FitRecord",
    "HistoryEntry",
    "MeanScale",
    "Model",
    "compile_terms",
    "load_model",
    "squareness_of_li_rad",
    "start_values",
    "write_model",
]
