"""What geoerr runs on, as `geoerr doctor` tells it and reports repeat it. Never a machine's name."""

from __future__ import annotations

import importlib
import platform
from importlib import metadata

# What numbers are made with, beside the core: distribution to the module that it brings.
_NUMBERS_ARE_MADE_WITH = {"numpy": "numpy", "scipy": "scipy", "opencv-python-headless": "cv2"}


def python_and_platform() -> str:
    """Name the interpreter, the system and the kind of processor."""
    return f"{platform.python_version()} on {platform.system()} {platform.machine()}"


def version_of(distribution: str, module: str) -> str:
    """Give the version of a library that is installed.

    It may come as another distribution than the required one, as OpenCV with its contributed modules does; then it is
    loaded and asked.
    """
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return str(getattr(importlib.import_module(module), "__version__", "of unknown version"))


def versions() -> tuple[tuple[str, str], ...]:
    """Give, by name, the versions that the numbers of a result may depend on beside geoerr's own."""
    libraries = ((name, version_of(name, module)) for name, module in _NUMBERS_ARE_MADE_WITH.items())
    return (("Python", python_and_platform()), *libraries)
