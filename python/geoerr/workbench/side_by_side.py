"""Models side by side: an effect that needs a column leaves out rows, and what is better on fewer rows is not better.

So the models that the page tells of beside each other are compared on the rows that all of them have.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from geoerr.diagnose import common_rows, compare
from geoerr.diagnose.stages import Stage, stages_of
from geoerr.errors import GeoerrError
from geoerr.measurements import Measurements
from geoerr.model import Model
from geoerr.workbench.calibration import Calibration
from geoerr.workbench.history import Figures, Step, figures_of_comparison, lineage, rows_of
from geoerr.workbench.job import Advance


@dataclass(frozen=True, eq=False)
class SideBySide:
    """The figures of models on the rows that all of them have.

    Attributes
    ----------
    rows
        Digest of these rows.
    n_rows, n_measured
        How many they are, of how many; 0 where nothing had to be computed, since each model has the same rows.
    figures
        Number of a step to its figures on these rows; where they are not here they are the step's own.
    """

    rows: str = ""
    n_rows: int = 0
    n_measured: int = 0
    figures: Mapping[int, Figures] = field(default_factory=dict)

    def of(self, steps: Sequence[Step], number: int) -> Figures:
        """Give a step's figures; none of one that has not been compared on these rows."""
        own = steps[number].figures if self.is_of(steps[number]) else {}
        return self.figures.get(number, own)

    def is_of(self, step: Step) -> bool:
        """Tell whether these are a step's own rows."""
        return step.rows == self.rows

    @property
    def words(self) -> str:
        """Say which rows these are, where it is not all that each model has; else nothing."""
        if not self.figures:
            return ""
        return f"On the {self.n_rows:,} of {self.n_measured:,} rows that all of them have."


def numbers_told(steps: Sequence[Step], current: int, reference: int) -> set[int]:
    """Give the numbers of the models of which the page tells how the error fell, and the reference among them."""
    return {*lineage(steps, current), reference} if steps else set()


def if_alike(steps: Sequence[Step], current: int, reference: int) -> SideBySide | None:
    """Give what takes no time: models that have the same rows; None where they have not."""
    rows = {steps[number].rows for number in numbers_told(steps, current, reference)}
    return SideBySide(next(iter(rows), "")) if len(rows) <= 1 else None


def side_by_side(
    steps: Sequence[Step],
    current: int,
    reference: int,
    data: Measurements | None,
    calibration: Calibration,
    threads: int,
    advance: Advance,
) -> SideBySide:
    """Compare the models that the page tells of on their common rows, as adding an effect does."""
    known = if_alike(steps, current, reference)
    if known is not None or data is None:
        return known or SideBySide()
    advance.say("the models on the rows that all of them have")
    numbers = sorted(numbers_told(steps, current, reference))
    rows = _common(data, (steps[number].model for number in numbers))
    digest, figures = "", dict[int, Figures]()
    for number in numbers:
        try:
            compared = compare(steps[number].model, *data.tables, rows=rows, threads=threads, **vars(calibration))
        except GeoerrError:
            # Nothing can be compared there: a dash stands for it.
            figures[number] = {}
            continue
        digest, figures[number] = rows_of(compared), figures_of_comparison(compared)
    return SideBySide(digest, int(rows.sum()), len(rows), figures)


def story(steps: Sequence[Step], number: int, beside: SideBySide) -> tuple[Stage, ...]:
    """Tell how the error fell on the way to a step, on the rows that all have who are told of beside each other.

    A model that came with a history begins with that, where it is of the same rows. Names begin with the numbers that
    the page has for the steps, whichever of them are on the way.
    """
    numbers = lineage(steps, number)
    record = steps[numbers[0]].model.record
    earlier = () if record is None else stages_of(record.history)
    if earlier and not earlier[-1].is_of_the_rows_of(Stage("", beside.of(steps, numbers[0]))):
        earlier = ()
    before = (Stage(f"before {one}. {stage.name}", stage.figures) for one, stage in enumerate(earlier[:-1], start=1))
    own = ((one, beside.of(steps, one)) for one in numbers)
    return (*before, *(Stage(f"{one + 1}. {steps[one].name}", figures) for one, figures in own if figures))


def _common(data: Measurements, models: Iterable[Model]) -> np.ndarray:
    """Tell which rows (n,) all models have, but for those that these data cannot be compared with at all."""
    rows = common_rows((), *data.tables)
    for model in models:
        try:
            rows = rows & common_rows([model], *data.tables)
        except GeoerrError:
            continue
    return rows
