"""Machines to test with: all 24 chains, drawn errors."""

from __future__ import annotations

import itertools

import numpy as np

from geoerr.error_functions import (
    LINEAR_AND_ANGULAR,
    SQUARENESS,
    ErrorFunction,
    ErrorFunctions,
    Squareness,
    is_angular,
)
from geoerr.machine import Axis, Machine

CHAINS = tuple(
    f"w{''.join(order[:base])}b{''.join(order[base:])}t"
    for order in itertools.permutations("XYZ")
    for base in range(4)
)


def machine(chain: str = "wZbXYt", tool_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Machine:
    axes = {axis: Axis((0.0, 400.0)) for axis in "xyz"}
    return Machine("test", chain, axes, tool_offset_mm=tool_offset_mm)


def drawn_errors(of: Machine, seed: int = 0) -> ErrorFunctions:
    """0.3 mm, 1 mrad, 5 mrad of squareness; tables of different length."""
    generator = np.random.default_rng(seed)
    functions = {}
    for index, name in enumerate(LINEAR_AND_ANGULAR):
        n = 2 + index % 5
        position = np.linspace(-20.0, 420.0, n) + generator.uniform(-15.0, 15.0, n)
        size = 1e-3 if is_angular(name) else 0.3
        functions[name] = ErrorFunction(position, generator.uniform(-size, size, n))
    squareness = {name: Squareness(generator.uniform(-5e-3, 5e-3)) for name in SQUARENESS}
    return ErrorFunctions(of, functions, squareness, "drawn")
