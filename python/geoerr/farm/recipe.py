"""What is to be done with every machine of a farm."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from geoerr.compensate.program import CompensationOptions
from geoerr.errors import GeoerrError
from geoerr.fit import Components

Step = Literal["measure", "identify", "fit", "diagnose", "compensate"]
STEPS: tuple[Step, ...] = get_args(Step)


@dataclass(frozen=True)
class Recipe:
    """What is to be done with every machine; what a folder has nothing for is left out.

    Attributes
    ----------
    steps
        `measure` makes observations of a session's pictures, `identify` the 21 errors of points, `fit` the model,
        `diagnose` says what the model lacks, `compensate` corrects each program.
    components, effects
        What is fitted: as `geoerr.fit_model` has them. Effects are references (`"backlash:x"`).
    at
        Conditions of the programs, by name.
    options
        How programs are corrected.
    """

    steps: tuple[Step, ...] = STEPS
    components: Components = "21"
    effects: tuple[str, ...] = ()
    at: Mapping[str, float | str] = field(default_factory=dict)
    options: CompensationOptions = field(default_factory=CompensationOptions)

    def __post_init__(self) -> None:
        """Refuse a step that there is not: it would be left out in silence."""
        unknown = [step for step in self.steps if step not in STEPS]
        if unknown:
            raise GeoerrError(f"there is no step {unknown[0]!r}\nhint: the steps are {', '.join(STEPS)}")


# What each step writes, but `compensate`: that has the program's name.
_RESULTS: Mapping[Step, tuple[str, ...]] = {
    "measure": ("observations.csv", "rig.json"),
    "identify": ("errors.json",),
    "fit": ("model.json",),
    "diagnose": ("diagnosis.json",),
    "compensate": (),
}


def results_of(steps: Iterable[Step], given: Collection[str], program: str | None = None) -> list[str]:
    """Name the files that steps write; a rig that is `given` is not made."""
    names = [name for step in steps for name in _RESULTS[step] if not (name == "rig.json" and name in given)]
    return names if program is None else [*names, program]
