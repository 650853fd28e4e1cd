"""An effect that a person writes as a formula: turned into the paragraph that the catalogue is made of."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from geoerr.effects import Effect, load_effects
from geoerr.effects.definitions import RESERVED_NAMES
from geoerr.errors import InputFileError
from geoerr.files import write_text
from geoerr.machine import AXES
from geoerr.terms import names_in

# Channel to what a person reads; the effects' README explains them all.
CHANNELS = {
    "along": "position along the axis (it goes too far or not far enough)",
    "across": "straightness (it moves sideways)",
    "angular": "angles of the axis (roll, pitch, yaw)",
    "tool": "the tool, in the direction of the axis",
    "work": "the work, in the direction of the axis",
}
_RANGE = re.compile(r"^\s*([A-Za-z_]\w*)\s*:\s*(\S+?)\s*\.\.\s*(\S+)\s*$")
_FILE = "your formula"
_HOLDS = "what may stand in a formula is listed under “What a formula may hold”"
_NUMBER = re.compile(r"inner\.(\w+)")
_NOT_LINEAR = "not linear in the coefficients"


@dataclass(frozen=True)
class OwnFormula:
    """What a person typed.

    Attributes
    ----------
    name
        Becomes the effect's id.
    channel, axis
        Where it acts.
    expression
        The formula; names that nothing else has are numbers to be found.
    searched
        `name: low..high`, with semicolons between: numbers inside a function, which have to be searched.
    """

    name: str
    channel: str
    axis: str
    expression: str
    searched: str = ""

    @property
    def effect_id(self) -> str:
        """The name as an id."""
        return "-".join(re.findall(r"[a-z0-9]+", self.name.lower())) or "own"

    @property
    def reference(self) -> str:
        """What `add` takes."""
        return f"{self.effect_id}:{self.axis}"


def own_effect(typed: OwnFormula, columns: Collection[str], folder: Path) -> Effect:
    """Make the effect, checked as any other.

    Parameters
    ----------
    typed
        What was typed.
    columns
        Columns of the data, which a formula may use.
    folder
        For the paragraph, which the reader of effects reads.

    Raises
    ------
    GeoerrError
        for a formula that cannot be read, or numbers that it does not have.
    """
    if not typed.expression.strip():
        raise InputFileError(
            _FILE, "is empty", remedy="for example c*(q - 200)^2, or c*sin(2*pi*q/P) with P searched"
        )
    inner = _searched(typed.searched)
    known = RESERVED_NAMES | set(columns)
    used = names_in(typed.expression)
    unknown = [name for name in used if name not in known and name not in inner]
    _refuse_temperatures([*unknown, *(name for name in used if name == "T")], columns)
    if not unknown:
        raise InputFileError(_FILE, "has no number to be found", remedy=f"for example c*({typed.expression})")
    table = {
        "id": typed.effect_id,
        "title": typed.name.strip() or "Own effect",
        "channel": typed.channel,
        "axes": list(AXES),
        "expression": typed.expression,
        "covariates": [name for name in used if name in columns and name not in RESERVED_NAMES],
        "coefficients": {name: {} for name in unknown},
        "inner": {name: {"range": list(span)} for name, span in inner.items()},
    }
    path = folder / _FILE
    write_text(path, tomli_w.dumps({"effect": [table]}))
    try:
        return load_effects(path)[0]
    except InputFileError as error:
        raise _by_the_fields(error, unknown) from error


def _refuse_temperatures(names: Collection[str], columns: Collection[str]) -> None:
    """Refuse what is written as a temperature and is none of the data: it would be a number to be found."""
    for name in names:
        if name == "T" or name.startswith("temp"):
            known = ", ".join(one for one in columns if one.startswith("temp"))
            remedy = f"write its column: {known}" if known else "these data have no temperatures"
            raise InputFileError(_FILE, f"{name} is no column of the data", remedy=remedy)


def _by_the_fields(error: InputFileError, numbers: Collection[str]) -> InputFileError:
    """Say of a formula what the reader of effects says, by the fields of the page, not by the keys of a file."""
    number = _NUMBER.search(error.column or "")
    if number is not None:
        is_range = error.problem.endswith("from low to high")
        remedy = f"write {number[1]}: low..high, for example {number[1]}: 1..20" if is_range else error.remedy
        return InputFileError(_FILE, error.problem, column=number[1], remedy=remedy)
    problem, *place = error.problem.split("\n", 1)
    remedy = _HOLDS
    if problem.startswith(_NOT_LINEAR):
        problem = problem.partition(" (")[0].replace(_NOT_LINEAR, "not linear in the numbers to be found")
        problem = problem.replace("coefficients", "two of them").replace("a coefficient", "one of them")
        names = ", ".join(numbers)
        remedy = f"such are names that no column has, here {names}: write a column, or search one between limits"
    return InputFileError(_FILE, "\n".join([problem, *place]), remedy=remedy)


def _searched(text: str) -> dict[str, tuple[float, float]]:
    found = {}
    for part in filter(str.strip, text.split(";")):
        match = _RANGE.match(part)
        try:
            if match is None:
                raise ValueError
            found[match[1]] = (float(match[2]), float(match[3]))
        except ValueError:
            raise InputFileError(
                _FILE, f"{part.strip()!r} is no range", remedy="write name: low..high, for example P: 1..20"
            ) from None
    return found
