"""Random machines: one of the 24 chains, 18 smooth error functions and three squarenesses."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from validation.hidden_effects.chain import Array, Displacements, nothing

from geoerr.machine import Machine

CHAINS = tuple(
    f"w{''.join(order)[:place]}b{''.join(order)[place:]}t" for order in permutations("XYZ") for place in range(4)
)
TRANSLATION_UM = 25.0
ROTATION_URAD = 60.0
SQUARENESS_URAD = 300.0
# Half waves over the travel, amplitudes falling with their square: cubic splines of eight pieces hold the fourth to
# (π/2)⁴/384 = 1.6 % of its amplitude, which is below 0.1 µm.
_HALF_WAVES = np.arange(1, 5)


@dataclass(frozen=True)
class ErrorFunctions:
    """The machine's own errors.

    Attributes
    ----------
    waves_mm, waves_rad
        (3 moving axes, 3 directions, 4) amplitudes of cosines of 1 to 4 half waves over the travel.
    squareness_rad
        S_xy, S_xz, S_yz.
    """

    waves_mm: Array
    waves_rad: Array
    squareness_rad: Array

    def at(self, machine: Machine, q_mm: Array) -> Displacements:
        """Evaluate at (n, 3) positions."""
        moved = nothing(len(q_mm))
        for index, axis in enumerate("xyz"):
            low, high = machine.axes[axis].range_mm
            shape = np.cos(np.pi * np.outer((q_mm[:, index] - low) / (high - low), _HALF_WAVES))
            moved.delta_mm[:, index] = shape @ self.waves_mm[index].T
            moved.epsilon_rad[:, index] = shape @ self.waves_rad[index].T
        moved.squareness_rad[:] = self.squareness_rad
        return moved


def draw_machine(rng: np.random.Generator, chain: str | None) -> tuple[Machine, ErrorFunctions]:
    """Draw a machine; `chain` None draws that too. Each error function has the RMS of the module's constants."""
    chain = str(rng.choice(CHAINS)) if chain is None else chain
    travel = rng.uniform(220.0, 420.0, 3).round(0)
    low = np.where(rng.random(3) < 0.5, 0.0, -np.round(travel / 2))
    tool_offset = np.round([*rng.uniform(-30.0, 30.0, 2), rng.uniform(-120.0, -20.0)], 1)
    machine = Machine.from_chain(chain, travel, low_mm=low, tool_offset_mm=tool_offset, name=f"virtual {chain}")
    return machine, ErrorFunctions(
        waves_mm=_waves(rng, 1e-3 * TRANSLATION_UM),
        waves_rad=_waves(rng, 1e-6 * ROTATION_URAD),
        squareness_rad=1e-6 * SQUARENESS_URAD * rng.standard_normal(3),
    )


def _waves(rng: np.random.Generator, rms: float) -> Array:
    amplitudes = rng.standard_normal((3, 3, len(_HALF_WAVES))) / _HALF_WAVES**2
    # A cosine of whole half waves has mean square 1/2 and no mean.
    return rms * amplitudes / np.sqrt(0.5 * np.sum(amplitudes**2, axis=-1, keepdims=True))
