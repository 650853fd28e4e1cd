"""geoerr: why a three-axis machine is not where it should be; prove it, and correct it.

The names below are the public face; each is loaded when it is first used, so that correcting a program needs no
OpenCV and measuring no plots.

>>> import geoerr
>>> machine = geoerr.read_machine("machine.toml")                   # doctest: +SKIP
>>> result = geoerr.fit_model(machine, geoerr.read_observations("observations.csv"))  # doctest: +SKIP
>>> result.model.error_mm([[200.0, 150.0, 80.0]])                   # doctest: +SKIP
>>> print(result.model.report())                                    # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from geoerr._core import __version__

if TYPE_CHECKING:
    from geoerr.budget import budget_text, uncertainty_budget, uncertainty_map
    from geoerr.compensate.program import CompensationOptions, compensate_program
    from geoerr.diagnose import Comparison, Diagnosis, add_effect, common_rows, compare
    from geoerr.dobariya import dobariya_vmc
    from geoerr.effects import catalogue, load_effects
    from geoerr.equations import error_equations
    from geoerr.error_functions import ErrorFunctions, read_errors, write_errors
    from geoerr.errors import GeoerrError
    from geoerr.farm import Recipe, run_farm
    from geoerr.fit import FitOptions, FitResult, fit_model
    from geoerr.geometry import fit_line, fit_lines, integrate_straightness, triangulate, triangulate_points
    from geoerr.identify.joint import identify_joint
    from geoerr.identify.nine_line import analyze_nine_lines, identify_nine_line
    from geoerr.machine import Machine, read_machine
    from geoerr.model import Model, load_model, write_model
    from geoerr.observations import (
        CircularTest,
        Observations,
        observations_from_columns,
        read_circular_test,
        read_lengths,
        read_observations,
        write_observations,
    )
    from geoerr.report.model_page import write_model_report
    from geoerr.states import States, identify_states
    from geoerr.verify.ballbar import circle_of_first_run, circle_to_test, run_circular_test
    from geoerr.verify.path import compare_paths
    from geoerr.verify.path_trace import trace_paths
    from geoerr.vision.calibrate import calibrate, calibrate_from_corners
    from geoerr.vision.measure import measure
    from geoerr.vision.rig import Rig, read_rig, write_rig
    from geoerr.vision.sensitivity import rig_sensitivity
    from geoerr.vision.session import read_session

_HOMES = {
    "add_effect": "geoerr.diagnose",
    "analyze_nine_lines": "geoerr.identify.nine_line",
    "budget_text": "geoerr.budget",
    "calibrate": "geoerr.vision.calibrate",
    "calibrate_from_corners": "geoerr.vision.calibrate",
    "catalogue": "geoerr.effects",
    "circle_of_first_run": "geoerr.verify.ballbar",
    "circle_to_test": "geoerr.verify.ballbar",
    "CircularTest": "geoerr.observations",
    "common_rows": "geoerr.diagnose",
    "compare": "geoerr.diagnose",
    "compare_paths": "geoerr.verify.path",
    "Comparison": "geoerr.diagnose",
    "compensate_program": "geoerr.compensate.program",
    "CompensationOptions": "geoerr.compensate.program",
    "Diagnosis": "geoerr.diagnose",
    "dobariya_vmc": "geoerr.dobariya",
    "error_equations": "geoerr.equations",
    "ErrorFunctions": "geoerr.error_functions",
    "fit_line": "geoerr.geometry",
    "fit_lines": "geoerr.geometry",
    "fit_model": "geoerr.fit",
    "FitOptions": "geoerr.fit",
    "FitResult": "geoerr.fit",
    "GeoerrError": "geoerr.errors",
    "identify_joint": "geoerr.identify.joint",
    "identify_nine_line": "geoerr.identify.nine_line",
    "identify_states": "geoerr.states",
    "integrate_straightness": "geoerr.geometry",
    "load_effects": "geoerr.effects",
    "load_model": "geoerr.model",
    "Machine": "geoerr.machine",
    "measure": "geoerr.vision.measure",
    "Model": "geoerr.model",
    "Observations": "geoerr.observations",
    "observations_from_columns": "geoerr.observations",
    "read_circular_test": "geoerr.observations",
    "read_errors": "geoerr.error_functions",
    "read_lengths": "geoerr.observations",
    "read_machine": "geoerr.machine",
    "read_observations": "geoerr.observations",
    "read_rig": "geoerr.vision.rig",
    "read_session": "geoerr.vision.session",
    "Recipe": "geoerr.farm",
    "Rig": "geoerr.vision.rig",
    "rig_sensitivity": "geoerr.vision.sensitivity",
    "run_circular_test": "geoerr.verify.ballbar",
    "run_farm": "geoerr.farm",
    "States": "geoerr.states",
    "trace_paths": "geoerr.verify.path_trace",
    "triangulate": "geoerr.geometry",
    "triangulate_points": "geoerr.geometry",
    "uncertainty_budget": "geoerr.budget",
    "uncertainty_map": "geoerr.budget",
    "write_errors": "geoerr.error_functions",
    "write_model": "geoerr.model",
    "write_model_report": "geoerr.report.model_page",
    "write_observations": "geoerr.observations",
    "write_rig": "geoerr.vision.rig",
}

__all__ = [
    "CircularTest",
    "Comparison",
    "CompensationOptions",
    "Diagnosis",
    "ErrorFunctions",
    "FitOptions",
    "FitResult",
    "GeoerrError",
    "Machine",
    "Model",
    "Observations",
    "Recipe",
    "Rig",
    "States",
    "__version__",
    "add_effect",
    "analyze_nine_lines",
    "budget_text",
    "calibrate",
    "calibrate_from_corners",
    "catalogue",
    "circle_of_first_run",
    "circle_to_test",
    "common_rows",
    "compare",
    "compare_paths",
    "compensate_program",
    "dobariya_vmc",
    "error_equations",
    "fit_line",
    "fit_lines",
    "fit_model",
    "identify_joint",
    "identify_nine_line",
    "identify_states",
    "integrate_straightness",
    "load_effects",
    "load_model",
    "measure",
    "observations_from_columns",
    "read_circular_test",
    "read_errors",
    "read_lengths",
    "read_machine",
    "read_observations",
    "read_rig",
    "read_session",
    "rig_sensitivity",
    "run_circular_test",
    "run_farm",
    "trace_paths",
    "triangulate",
    "triangulate_points",
    "uncertainty_budget",
    "uncertainty_map",
    "write_errors",
    "write_model",
    "write_model_report",
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
