"""One machine measured at several temperatures: each state's errors, how they differ, one model for all."""

from geoerr.states.chance import Test
from geoerr.states.difference import Difference, FunctionDifference
from geoerr.states.joint import TemperatureFit
from geoerr.states.left_out import LeftOut
from geoerr.states.repeats import Repeat
from geoerr.states.shapes import Shape
from geoerr.states.states import State, States, identify_states
from geoerr.states.temperature_model import TemperatureModel
from geoerr.states.volume import VolumeDifference

__all__ = [
    "Difference",
    "FunctionDifference",
    "LeftOut",
    "Repeat",
    "Shape",
    "State",
    "States",
    "TemperatureFit",
    "TemperatureModel",
    "Test",
    "VolumeDifference",
    "identify_states",
]
