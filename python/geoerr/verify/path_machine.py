"""The machine that runs programs which are compared: where it puts the tool, by the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geoerr import _core
from geoerr.model import Model
from geoerr.model.conditions import Conditions
from geoerr.model.program_conditions import program_conditions, without_waves_in_time

Numbers = npt.NDArray[np.float64]
_AT_TOOL_MM = np.zeros((1, 3))
_AT_REST = np.zeros((1, 10))


class ProgramMachine:
    """A machine under the conditions of a program.

    Attributes
    ----------
    follows_motion
        Whether its errors depend on how a place is come to.
    windups
        Axis and length of each wind-up, as of `Past`.
    """

    def __init__(self, model: Model, at: Conditions | None, threads: int) -> None:
        model = without_waves_in_time(model)
        self._compiled = model.compiled_at(program_conditions(model, at))
        self._threads = threads
        terms = self._compiled if isinstance(self._compiled, _core.TermMachine) else None
        self.follows_motion = terms is not None and bool(terms.motion_names)
        self.windups: Sequence[tuple[int, float]] = [] if terms is None else terms.windups

    def error_mm(self, q_mm: Numbers, motion: Numbers | None) -> Numbers:
        """Give actual minus nominal position of the tool point, (n, 3), at commands (n, 3).

        `motion` (n or 1, 10 + wind-ups) is how they are come to; None where that makes no difference.
        """
        if isinstance(self._compiled, _core.TermMachine):
            motion = _AT_REST if motion is None else motion
            return self._compiled.error_mm(q_mm, _AT_TOOL_MM, self._threads, motion)
        return self._compiled.error_mm(q_mm, _AT_TOOL_MM, self._threads)
