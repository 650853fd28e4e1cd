"""What the inverse of a model gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.model.arrays import Numbers

STATUS = ("converged", "not converged", "not finite")


@dataclass(frozen=True, eq=False)
class Commands:
    """Commands for a batch of wanted positions; row i belongs to position i.

    Attributes
    ----------
    command_mm : (n, 3)
        Axis positions to command; NaN where none was found.
    remaining_mm : (n,)
        Distance from the wanted position by the model: of the best command found where the iteration did not
        converge, NaN where the position is not finite.
    status : (n,) uint8
        0 converged, 1 not converged, 2 not finite.
    """

    command_mm: Numbers
    remaining_mm: Numbers
    status: npt.NDArray[np.uint8]

    @property
    def is_converged(self) -> npt.NDArray[np.bool_]:
        """Tell for each row whether its command is within the tolerance, (n,)."""
        return np.asarray(self.status == 0)
