"""Bases of the error functions: built from their description, and chosen by evidence."""

from geoerr.bases.build import basis_of

__all__ = ["basis_of"]
