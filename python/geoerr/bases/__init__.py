"""Bases of the error functions: built from their description, and chosen by evidence."""

from geoerr.bases.build import basis_of
from geoerr.bases.candidates import candidate_bases, in_words
from geoerr.bases.choice import Choice, Score, choose_basis, choose_coarser_basis
from geoerr.bases.hexahedra import HexahedronFit, fit_hexahedra
from geoerr.bases.knots import places_for_knots, spline_over

__all__ = [
    "Choice",
    "HexahedronFit",
    "Score",
    "basis_of",
    "candidate_bases",
    "choose_basis",
    "choose_coarser_basis",
    "fit_hexahedra",
    "in_words",
    "places_for_knots",
    "spline_over",
]
