"""geoerr: why a three-axis machine is not where it should be; prove it, and correct it.

The names below are the public face; each is loaded when it is first used, so that correcting a program needs no
OpenCV and measuring no plots.

>>> import geoerr
>>> model = geoerr.load_model("errors.json")                        # doctest: +SKIP
>>> model.error_mm([[200.0, 150.0, 80.0]])                          # doctest: +SKIP
>>> geoerr.compensate_program(model, "part.gcode", "out.gcode")     # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from geoerr._core import __version__

if TYPE_CHECKING:
    from geoerr.compensate.program import CompensationOptions, compensate_program
    from geoerr.error_functions import ErrorFunctions, read_errors, write_errors
    from geoerr.errors import GeoerrError
    from geoerr.geometry import fit_line, fit_lines, integrate_straightness, triangulate
    from geoerr.identify.nine_line import analyze_nine_lines, identify_nine_line
    from geoerr.machine import Machine, read_machine
    from geoerr.model import Model, load_model
    from geoerr.observations import Observations, read_observations, write_observations
    from geoerr.verify.ballbar import run_circular_test
    from geoerr.verify.path import compare_paths
    from geoerr.vision.calibrate import calibrate, calibrate_from_corners
    from geoerr.vision.measure import measure
    from geoerr.vision.rig import Rig, read_rig, write_rig
    from geoerr.vision.sensitivity import rig_sensitivity
    from geoerr.vision.session import read_session

_HOMES = {
    "CompensationOptions": "geoerr.compensate.program",
    "ErrorFunctions": "geoerr.error_functions",
    "GeoerrError": "geoerr.errors",
    "Machine": "geoerr.machine",
    "Model": "geoerr.model",
    "Observations": "geoerr.observations",
    "Rig": "geoerr.vision.rig",
    "analyze_nine_lines": "geoerr.identify.nine_line",
    "calibrate": "geoerr.vision.calibrate",
    "calibrate_from_corners": "geoerr.vision.calibrate",
    "compare_paths": "geoerr.verify.path",
    "compensate_program": "geoerr.compensate.program",
    "fit_line": "geoerr.geometry",
    "fit_lines": "geoerr.geometry",
    "identify_nine_line": "geoerr.identify.nine_line",
    "integrate_straightness": "geoerr.geometry",
    "load_model": "geoerr.model",
    "measure": "geoerr.vision.measure",
    "read_errors": "geoerr.error_functions",
    "read_machine": "geoerr.machine",
    "read_observations": "geoerr.observations",
    "read_rig": "geoerr.vision.rig",
    "read_session": "geoerr.vision.session",
    "rig_sensitivity": "geoerr.vision.sensitivity",
    "run_circular_test": "geoerr.verify.ballbar",
    "triangulate": "geoerr.geometry",
    "write_errors": "geoerr.error_functions",
    "write_observations": "geoerr.observations",
    "write_rig": "geoerr.vision.rig",
}

__all__ = [
    "CompensationOptions",
    "ErrorFunctions",
    "GeoerrError",
    "Machine",
    "Model",
    "Observations",
    "Rig",
    "__version__",
    "analyze_nine_lines",
    "calibrate",
    "calibrate_from_corners",
    "compare_paths",
    "compensate_program",
    "fit_line",
    "fit_lines",
    "identify_nine_line",
    "integrate_straightness",
    "load_model",
    "measure",
    "read_errors",
    "read_machine",
    "read_observations",
    "read_rig",
    "read_session",
    "rig_sensitivity",
    "run_circular_test",
    "triangulate",
    "write_errors",
    "write_observations",
    "write_rig",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its home when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module 'geoerr' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
