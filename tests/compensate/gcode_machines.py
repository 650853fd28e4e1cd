"""Machines of a printer's and of a mill's size, with errors as large as Li's, for the tests of programs."""

from __future__ import annotations

import numpy as np

from geoerr.error_functions import LINEAR_AND_ANGULAR, ErrorFunction, ErrorFunctions, Squareness, is_angular
from geoerr.machine import Axis, Machine
from geoerr.model import Model

# Li et al. 2023, section 4.3, in ISO signs.
LI_SQUARENESS_RAD = {"EC0Y": -5.05e-3, "EB0Z": -1.24e-3, "EA0Z": 3.84e-3}


def printer(chain: str = "wZbXYt", *, low_mm=(-10.0, -10.0, -1.0), high_mm=400.0) -> Model:
    """All 21 errors: bows and sines of up to a millimetre and two milliradians, 0 at the low end of each axis.

    Vertical straightness is a fifth of that: a bed that is out by more than a nozzle can follow is no printer.
    """
    machine = Machine(
        name="printer",
        chain=chain,
        axes={name: Axis((low, high_mm)) for name, low in zip("xyz", low_mm, strict=True)},
        tool_offset_mm=(0.0, 5.0, -30.0),
    )
    functions = {}
    for number, name in enumerate(LINEAR_AND_ANGULAR):
        low, high = machine.axes[name[2].lower()].range_mm
        position_mm = np.linspace(low, high, 42)
        u = (position_mm - low) / (high - low)
        size = 1e-3 if is_angular(name) else 0.1 if name[1] == "Z" else 0.5
        wave = np.sin(2 * np.pi * (0.5 + 0.175 * number) * u) + 4 * u * (1 - u)
        functions[name] = ErrorFunction(position_mm, size * wave)
    squareness = {name: Squareness(value) for name, value in LI_SQUARENESS_RAD.items()}
    return Model(machine, ErrorFunctions(machine, functions, squareness, method="truth"))


def mill(half_mm: float = 3000.0) -> Model:
    """A machine large enough for programs in inches, 0.3 mm and 1 mrad out, in waves of 400 to 750 mm."""
    machine = Machine("mill", "wbXYZt", {name: Axis((-half_mm, half_mm)) for name in "xyz"})
    position_mm = np.linspace(-half_mm, half_mm, 301)
    functions = {
        name: ErrorFunction(
            position_mm,
            (1e-3 if is_angular(name) else 0.3) * np.sin(2 * np.pi * position_mm / (400.0 + 20.0 * number)),
        )
        for number, name in enumerate(LINEAR_AND_ANGULAR)
    }
    return Model(machine, ErrorFunctions(machine, functions, {"EC0Y": Squareness(-5.05e-3)}, method="truth"))


def leaning() -> Model:
    """Squareness of X and Y alone: 5 µm a millimetre."""
    machine = Machine("leaning", "wbXYZt", {name: Axis((-10.0, 400.0)) for name in "xyz"})
    return Model(machine, ErrorFunctions(machine, {}, {"EC0Y": Squareness(-5e-3)}, method="truth"))


def nominal() -> Model:
    """A machine without errors."""
    return Model(
        Machine("nominal", "wZbXYt", {name: Axis((-10.0, 400.0)) for name in "xyz"}, tool_offset_mm=(1, 2, 3))
    )
