"""The models of a session: each with what was done to get it, from which, and how large its errors are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from geoerr.diagnose import Comparison
from geoerr.fit import figures_document
from geoerr.model import Model
from geoerr.report.figures import Stage, stages_of
from geoerr.workbench.inputs import InputFile
from geoerr.workbench.told import Told


@dataclass(frozen=True, eq=False)
class Step:
    """One model.

    Attributes
    ----------
    name
        What was done.
    model
        The result.
    parent
        Number of the step that it came from; None of the first.
    figures
        As `figures_document` gives them; empty until it was compared.
    """

    name: str
    model: Model
    parent: int | None
    figures: Mapping[str, float | None]

    @property
    def effects(self) -> tuple[tuple[str, str], ...]:
        """Reference and title of every effect beyond the classic errors."""
        return tuple((term.id, term.title) for term in self.model.terms if term.kind != "classic")

    @property
    def n_classic(self) -> int:
        """Number of the classic errors in the model."""
        return sum(term.kind == "classic" for term in self.model.all_machine_terms)


@dataclass(frozen=True, eq=False)
class Chapter:
    """Files, and the models that were made of them: a session has one, and keeps those before another machine came.

    Attributes
    ----------
    files
        What was given.
    steps, current, reference
        The models, which of them was looked at, and which the others were compared with.
    told
        What was said to be missing in the one that was looked at.
    """

    files: tuple[InputFile, ...]
    steps: tuple[Step, ...]
    current: int
    reference: int
    told: Told | None = None

    @property
    def title(self) -> str:
        """The machine, and the model that was looked at."""
        step = self.steps[self.current]
        return f"{step.model.machine.name or 'machine'} · {self.current + 1}. {step.name}"


def figures_of_step(comparison: Comparison) -> dict[str, float | None]:
    """Give the figures that a step remembers."""
    if comparison.fitted is None:
        return {"rmse_um": comparison.rmse_um}
    kept = ("rmse_um", "held_out_rmse_um", "noise_floor_um", "noise_um")
    figures = figures_document(comparison.fitted)
    return {name: figures[name] for name in kept}


def lineage(steps: list[Step], number: int) -> tuple[int, ...]:
    """Give the numbers of the steps that led to one, itself last."""
    found = [number]
    while (parent := steps[found[-1]].parent) is not None:
        found.append(parent)
    return tuple(reversed(found))


def story(steps: list[Step], number: int) -> tuple[Stage, ...]:
    """Tell how the error fell on the way to a step: a model that came with a history begins with that.

    Names begin with the numbers that the page has for the steps, whichever of them are on the way.
    """
    numbers = lineage(steps, number)
    first = steps[numbers[0]].model.record
    earlier = () if first is None else stages_of(first.history)[:-1]
    before = (Stage(f"before {one}. {stage.name}", stage.figures) for one, stage in enumerate(earlier, start=1))
    own = (Stage(f"{one + 1}. {steps[one].name}", steps[one].figures) for one in numbers if steps[one].figures)
    return (*before, *own)
