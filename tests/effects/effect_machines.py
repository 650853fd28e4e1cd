"""Machines for tests: every order of three axes and every place of the base."""

from __future__ import annotations

from itertools import permutations

from geoerr.machine import Axis, Machine

CHAINS = tuple(
    "w" + "".join(order[:place]) + "b" + "".join(order[place:]) + "t"
    for order in permutations("XYZ")
    for place in range(4)
)


def machine(chain: str = "wZbXYt", low: float = 0.0, reference_degc: float = 20.0) -> Machine:
    """A machine whose axes have different lengths and start at `low`."""
    lengths = {"x": 400.0, "y": 300.0, "z": 250.0}
    axes = {name: Axis((low, low + length)) for name, length in lengths.items()}
    return Machine("test", chain, axes, reference_temperature_degc=reference_degc)
