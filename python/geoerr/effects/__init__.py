"""The catalogue of physical effects as data, and its loader.

An effect is a paragraph of a `.toml` file (README.md in this folder); built-in and user-written ones have one form
and one path through the code.

>>> from geoerr.effects import catalogue
>>> effect, reference = catalogue().resolve("thermal-expansion:x@temp_bed")
>>> effect.title
'Thermal expansion of the drive'
"""

from __future__ import annotations

from geoerr.effects.collection import Catalogue, catalogue, load_catalogue, load_effects
from geoerr.effects.description import Description, FormSpec, ParameterSpec, PartSpec, Rival, Twin
from geoerr.effects.effect import Effect, PlacedEffect
from geoerr.effects.plausible import plausible_match, plausible_what, plausible_words

__all__ = [
    "Catalogue",
    "Description",
    "Effect",
    "FormSpec",
    "ParameterSpec",
    "PartSpec",
    "PlacedEffect",
    "Rival",
    "Twin",
    "catalogue",
    "load_catalogue",
    "load_effects",
    "plausible_match",
    "plausible_what",
    "plausible_words",
]
