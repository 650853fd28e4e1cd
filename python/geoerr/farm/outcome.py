"""What became of each machine of a farm: results and failures alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# What a note begins with that is more than a note.
WARNING = "warning: "
# What is said of a program in which no move was corrected; a warning among its notes says why.
NOTHING_CORRECTED = "nothing was corrected"


@dataclass(frozen=True)
class Outcome:
    """What became of one step with one machine.

    Attributes
    ----------
    machine
        Name of its folder.
    step
        One of `geoerr.farm.STEPS`, or `read` where the folder could not be used.
    program
        The program that was corrected, as its folder names it; None with other steps.
    files
        What was written, below the output's folder.
    says
        The result in a sentence, `nothing was corrected` of a program in which no move was; empty where it failed.
    error
        Why it failed: file, place and remedy; None where it did not.
    notes
        What to know of a corrected program, as `geoerr compensate` tells it: warnings first.
    """

    machine: str
    step: str
    program: str | None = None
    files: tuple[str, ...] = ()
    says: str = ""
    error: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def has_nothing_corrected(self) -> bool:
        """Whether it is a program in which no move was corrected: it is among the results as it was."""
        return self.step == "compensate" and self.says == NOTHING_CORRECTED

    def to_document(self) -> dict[str, Any]:
        """Give it as plain values, for `--json`."""
        return {**vars(self), "files": list(self.files), "notes": list(self.notes)}


@dataclass(frozen=True)
class Farm:
    """What became of a farm.

    Attributes
    ----------
    outcomes
        Of each machine, step and program: in the order of the input, whoever was ready first.
    """

    outcomes: tuple[Outcome, ...]

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """What failed."""
        return tuple(one for one in self.outcomes if one.error is not None)

    @property
    def by_machine(self) -> dict[str, tuple[Outcome, ...]]:
        """The outcomes of each machine."""
        found: dict[str, list[Outcome]] = {}
        for one in self.outcomes:
            found.setdefault(one.machine, []).append(one)
        return {name: tuple(outcomes) for name, outcomes in found.items()}

    def to_document(self) -> dict[str, Any]:
        """Give it as plain values, for `--json`."""
        return {
            "machines": len(self.by_machine),
            "machines_with_failures": len({one.machine for one in self.failures}),
            "outcomes": [one.to_document() for one in self.outcomes],
        }


@dataclass(frozen=True)
class StepResult:
    """What a worker hands back of a step.

    Attributes
    ----------
    step, program, says, error, notes
        As an `Outcome` has them.
    files
        What it made, by name: as bytes, for it may have no disk in common with the caller.
    parts
        What it wrote itself, by name: the file's name among those of its job's staging; None where what is among the
        results already is the same.
    is_not_seen
        Whether nothing was done, for the worker does not see the files that the job names.
    """

    step: str
    program: str | None = None
    files: Mapping[str, bytes] = field(default_factory=dict)
    says: str = ""
    error: str | None = None
    notes: tuple[str, ...] = ()
    parts: Mapping[str, str | None] = field(default_factory=dict)
    is_not_seen: bool = False
