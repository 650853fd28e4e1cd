"""The uncertainty budget: what each stage contributes to a predicted error and to a compensated part."""

from geoerr.budget.budget import Budget, Contribution, uncertainty_budget
from geoerr.budget.implementation import Implementation
from geoerr.budget.monte_carlo import Propagated, propagate_distributions
from geoerr.budget.refits import refit_with_noise
from geoerr.budget.source import Piece, Source
from geoerr.budget.sources import Stage
from geoerr.budget.text import budget_text
from geoerr.budget.volume import UncertaintyMap, uncertainty_map

__all__ = [
    "Budget",
    "Contribution",
    "Implementation",
    "Piece",
    "Propagated",
    "Source",
    "Stage",
    "UncertaintyMap",
    "budget_text",
    "propagate_distributions",
    "refit_with_noise",
    "uncertainty_budget",
    "uncertainty_map",
]
