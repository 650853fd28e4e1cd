"""The story of a model's errors, effect by effect, as its history holds it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from geoerr.model import HistoryEntry

# By so much do figures differ of one model that is fitted to the same rows again.
_SAME = 1e-3


@dataclass(frozen=True)
class Stage:
    """One model of a story.

    Attributes
    ----------
    name
        What was done to get it.
    figures
        `rmse_um`, `held_out_rmse_um`, `noise_floor_um`, `noise_um`; NaN or absent where not computable.
    """

    name: str
    figures: Mapping[str, float | None]

    def figure(self, name: str) -> float | None:
        """Give a figure; None where it is not computable."""
        value = self.figures.get(name)
        return value if value is not None and math.isfinite(value) else None

    @property
    def noise_um(self) -> float | None:
        """The noise: what repeats scatter, else what is stated."""
        floor = self.figure("noise_floor_um")
        return floor if floor is not None else self.figure("noise_um")

    def is_of_the_rows_of(self, other: Stage) -> bool:
        """Tell whether these are the figures of one model on the same rows, by the figures that both have."""
        pairs = ((self.figure(key), other.figure(key)) for key in ("rmse_um", "held_out_rmse_um"))
        return all(math.isclose(one, two, rel_tol=_SAME) for one, two in pairs if one is not None and two is not None)


def stages_of(history: Sequence[HistoryEntry]) -> tuple[Stage, ...]:
    """Tell the story that a model's own history holds; none where nothing was added or removed.

    An effect that needs a column leaves out the rows in which it is empty: the model before it is told once more on
    the rows that are left, since fewer rows are no fall of the error.
    """
    stages = [Stage("at first", history[0].figures_before)] if history else []
    for entry in history:
        before = Stage("the same on other rows", entry.figures_before)
        if not stages[-1].is_of_the_rows_of(before):
            stages.append(before)
        stages.append(Stage(f"{'+' if entry.action == 'added' else '−'} {entry.reference}", entry.figures_after))
    return tuple(stages)
