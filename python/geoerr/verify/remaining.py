"""What is left of the error when a machine gets compensated commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.machine import AXES, Machine
from geoerr.model import Model
from geoerr.model.conditions import Conditions

Numbers = npt.NDArray[np.float64]

# A tenth of a nanometre in the commands: far below what any printed program or measurement resolves.
COMMAND_TOLERANCE_MM = 1e-7


@dataclass(frozen=True, eq=False)
class Compensated:
    """Compensated commands and the error that the machine still makes with them.

    Attributes
    ----------
    commands_mm : (n, 3)
        Axis positions to command so that the model's tool is where it should be.
    error_mm : (n, 3)
        Actual minus wanted position of the tool seen from the work, under these commands.
    """

    commands_mm: Numbers
    error_mm: Numbers

    def out_of_range(self, machine: Machine) -> tuple[str, ...]:
        """Name the axes that some command sends past the end of their range."""
        return tuple(
            name
            for column, name in enumerate(AXES)
            if self.commands_mm[:, column].min() < machine.axes[name].range_mm[0] - COMMAND_TOLERANCE_MM
            or self.commands_mm[:, column].max() > machine.axes[name].range_mm[1] + COMMAND_TOLERANCE_MM
        )


def compensate_positions(
    model: Model,
    positions_mm: npt.ArrayLike,
    *,
    truth: Model | None = None,
    at: Conditions | None = None,
    truth_at: Conditions | None = None,
    tolerance_mm: float = COMMAND_TOLERANCE_MM,
) -> Compensated:
    """Compensate positions by one model and see what another makes of the commands.

    Parameters
    ----------
    model
        The model that computes the commands (Li Eq. 27, iterated).
    positions_mm : (n, 3)
        Wanted axis positions: those of the program before compensation.
    truth
        The machine that carries the commands out (a simulation's truth); `model` itself where None, and then what
        is left is the tolerance of the iteration, not an estimate of the machine's error.
    at, truth_at
        Conditions that the terms of each follow, by name.
    tolerance_mm
        Where the iteration may stop.

    Raises
    ------
    NotConvergedError
        if the iteration does not reach the tolerance.
    """
    positions = np.ascontiguousarray(positions_mm, dtype=np.float64)
    commands = model.commands_for(model.nominal_mm(positions), tolerance_mm, at=at)
    machine, conditions = (model, at) if truth is None else (truth, truth_at)
    return Compensated(commands, machine.tool_from_work(commands, at=conditions) - machine.nominal_mm(positions))
