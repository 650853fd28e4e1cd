"""Machines with chosen errors, for the tests of this folder."""

from __future__ import annotations

import numpy as np

from geoerr.error_functions import ErrorFunction, ErrorFunctions, NotDetermined, Squareness
from geoerr.machine import Axis, Machine
from geoerr.model import Model

POSITION_MM = np.linspace(0.0, 400.0, 41)


def machine(chain: str = "wZbXYt", high: float = 400.0, tool_offset_mm=(0.0, 0.0, 0.0)) -> Machine:
    return Machine(
        name="test",
        chain=chain,
        axes={name: Axis((0.0, high)) for name in "xyz"},
        tool_offset_mm=tool_offset_mm,
    )


def table(function, position_mm=POSITION_MM) -> ErrorFunction:
    return ErrorFunction(position_mm, np.array([float(function(q)) for q in position_mm]))


def model(
    functions=None, squareness_rad=None, chain="wZbXYt", not_determined=(), position_mm=POSITION_MM, **more
) -> Model:
    the_machine = machine(chain, **more)
    errors = ErrorFunctions(
        machine=the_machine,
        functions={name: table(f, position_mm) for name, f in (functions or {}).items()},
        squareness={name: Squareness(value) for name, value in (squareness_rad or {}).items()},
        method="truth",
        not_determined=tuple(NotDetermined(name, "for the test") for name in not_determined),
    )
    return Model(the_machine, errors)


def wavy(scale: float = 1.0, **more) -> Model:
    """A machine with all 21 errors of about a printer's size."""
    functions = {}
    for number, axis in enumerate("XYZ"):
        for index, direction in enumerate("XYZABC"):
            amplitude = (0.05 if direction in "XYZ" else 2e-4) * scale
            period = 180.0 + 37.0 * index + 61.0 * number

            def function(q, amplitude=amplitude, period=period, phase=index):
                return amplitude * (np.sin(2 * np.pi * q / period + phase) - np.sin(phase))

            functions[f"E{direction}{axis}"] = function
    return model(functions, {"EC0Y": -5.05e-3 * scale, "EB0Z": -1.24e-3 * scale, "EA0Z": 3.84e-3 * scale}, **more)
