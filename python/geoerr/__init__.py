"""geoerr: why a three-axis machine is not where it should be; prove it, and correct it."""

from geoerr._core import __version__

__all__ = ["__version__"]
