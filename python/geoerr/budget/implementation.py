"""What carrying out a correction leaves behind: the inverse's tolerance, chords, digits and the controller's step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geoerr.budget.source import Source
from geoerr.errors import GeometryError


@dataclass(frozen=True)
class Implementation:
    """How a corrected program is made and carried out; the defaults are those of `geoerr compensate`.

    Attributes
    ----------
    newton_tolerance_mm
        The inverse stops where less than this remains.
    tolerance_mm
        Largest distance of the tool from the programmed move between the ends of its pieces (chord tolerance).
    digits
        Digits behind the point of an axis word in millimetres; None: not rounded.
    controller_step_mm
        Smallest step of an axis (a microstep, an encoder count); None: not known, and not counted.
    """

    newton_tolerance_mm: float = 1e-6
    tolerance_mm: float = 0.005
    digits: int | None = 4
    controller_step_mm: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no length."""
        for name in ("newton_tolerance_mm", "tolerance_mm", "controller_step_mm"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value >= 0.0):
                raise GeometryError(f"{name} is {value!r}, not a length in mm\nhint: write 0 where there is none")

    def sources(self) -> Iterator[Source]:
        """Give the sources that every compensated part has, all of type B with bounds and nothing else known.

        A distance that is at most `a`, in any direction, counts as uniform between 0 and `a`: its mean square is
        a²/3, a ninth of a² for each component. A number rounded to steps of `s` is off by a uniform ± s/2.
        """
        for name, what, limit_mm in (
            ("newton", "what the inverse leaves (Newton)", self.newton_tolerance_mm),
            ("chord", "bent moves in straight pieces (chord)", self.tolerance_mm),
        ):
            yield Source(
                name,
                what,
                "B",
                "ball",
                float(limit_mm) / np.sqrt(3.0) * 1e3,
                "µm",
                everywhere_mm=np.eye(3) * float(limit_mm) / 3.0,
                is_of_part=True,
            )
        steps = (
            ("rounding", "digits of the program", None if self.digits is None else 10.0**-self.digits),
            ("controller", "the controller's step", self.controller_step_mm),
        )
        for name, what, step_mm in steps:
            if step_mm is not None:
                std_mm = step_mm / np.sqrt(12.0)
                yield Source(
                    name,
                    what,
                    "B",
                    "rectangular",
                    std_mm * 1e3,
                    "µm",
                    everywhere_mm=np.eye(3) * std_mm,
                    is_of_part=True,
                )
