"""The models of a session: each with what was done to get it, from which, and how large its errors are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from geoerr.diagnose import Comparison
from geoerr.fit import digest_of, figures_document
from geoerr.model import Model
from geoerr.workbench.inputs import InputFile
from geoerr.workbench.told import Told

# Name to value; None of what is not computable.
Figures: TypeAlias = Mapping[str, float | None]


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
    rows
        Digest of the rows that it was compared with: an effect may need a column that is empty in some.
    """

    name: str
    model: Model
    parent: int | None
    figures: Figures = field(default_factory=dict)
    rows: str = ""

    def compared(self, comparison: Comparison) -> Step:
        """Give the same with its figures."""
        return replace(self, figures=figures_of_comparison(comparison), rows=rows_of(comparison))

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


def rows_of(comparison: Comparison) -> str:
    """Give the digest of the rows that take part; nothing of lengths, which all models have."""
    return "" if comparison.fitted is None else digest_of(comparison.fitted.sightings)


def figures_of_comparison(comparison: Comparison) -> Figures:
    """Give the figures that a step remembers."""
    if comparison.fitted is None:
        return {"rmse_um": comparison.rmse_um}
    kept = ("rmse_um", "held_out_rmse_um", "noise_floor_um", "noise_um")
    figures = figures_document(comparison.fitted)
    return {name: figures[name] for name in kept}


def lineage(steps: Sequence[Step], number: int) -> tuple[int, ...]:
    """Give the numbers of the steps that led to one, itself last."""
    found = [number]
    while (parent := steps[found[-1]].parent) is not None:
        found.append(parent)
    return tuple(reversed(found))
