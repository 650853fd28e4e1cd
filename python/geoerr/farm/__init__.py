"""Many machines in one call: each a folder, worked on by any executor, with the same bytes from all of them."""

from geoerr.farm.folders import FarmFolder
from geoerr.farm.outcome import Farm, Outcome
from geoerr.farm.recipe import STEPS, Recipe, Step
from geoerr.farm.run import run_farm

__all__ = ["STEPS", "Farm", "FarmFolder", "Outcome", "Recipe", "Step", "run_farm"]
