"""A program that was dropped on the page: corrected by the model, and its path before and after."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geoerr.compensate.program import CompensationOptions, CompensationResult, compensate_program
from geoerr.errors import GeoerrError, InputFileError
from geoerr.model import Model
from geoerr.model.program_conditions import needed_conditions, without_waves_in_time
from geoerr.model.sessions import last_session
from geoerr.model.worth import well_known
from geoerr.terms import SESSION_NAME
from geoerr.verify.path_trace import PathTrace, trace_paths
from geoerr.workbench.typed import typed_number

Numbers = npt.NDArray[np.float64]
_ZERO = "the program's zero"
_WITHOUT_MOVES = "nothing was corrected: the program has no moves"
_NOWHERE = (
    "nothing was corrected: where the program starts is not known, so neither is where its moves end; begin it "
    "with a move to X, Y and Z in absolute positions (G90)"
)
_NO_SUCH_MOVES = "nothing was corrected: none of its moves is of a kind that is corrected"
_WITHOUT_ERRORS = "nothing was corrected: this is a machine without errors; fit the 21 errors first"
_NOTHING_TO_CORRECT = "nothing was corrected: what the model says along this path rounds to nothing or is uncertain"


@dataclass(frozen=True, eq=False)
class CorrectedProgram:
    """A program before and after.

    Attributes
    ----------
    name
        Of the program that was dropped.
    content
        The corrected one.
    result, trace
        What was done to it, and how far the tool is from the programmed path.
    model_name
        The step whose model corrected it.
    conditions
        At which it was corrected: name to value.
    assumed
        Names of those that nobody typed: the middle of the data's span.
    left_because
        Why nothing of it was changed; empty where something was.
    """

    name: str
    content: bytes
    result: CompensationResult
    trace: PathTrace
    model_name: str
    conditions: Mapping[str, float]
    assumed: tuple[str, ...]
    left_because: str = ""

    @property
    def corrected_name(self) -> str:
        """Name for the download."""
        path = Path(self.name)
        return f"{path.stem}-corrected{path.suffix}"

    @property
    def has_path(self) -> bool:
        """Whether there is any path to follow: a move that begins and ends at places that are known."""
        return self.trace.result.moves_compared > 0


@dataclass(frozen=True)
class Wish:
    """What a person wants of a correction.

    Attributes
    ----------
    conditions, work_offset
        As typed: name to value, and the program's zero in machine coordinates, empty where it is not told.
    holds_outside
        Whether functions hold their last values beyond the measured range, where formulas go on.
    passes_unsupported
        Whether lines that are not corrected are passed through.
    """

    conditions: Mapping[str, str]
    work_offset: str = ""
    holds_outside: bool = False
    passes_unsupported: bool = False


def correct(model: Model, model_name: str, name: str, content: bytes, wish: Wish) -> CorrectedProgram:
    """Correct a program, and follow both paths.

    Raises
    ------
    GeoerrError
        as `compensate_program`, and for numbers that cannot be read.
    """
    conditions = conditions_of(model, wish.conditions)
    at: dict[str, npt.ArrayLike | str] = {**conditions}
    offset = work_offset_mm(wish.work_offset) if wish.work_offset.strip() else None
    options = CompensationOptions(
        work_offset_mm=offset,
        on_unsupported="pass" if wish.passes_unsupported else "refuse",
        outside_measured="hold" if wish.holds_outside else "refuse",
    )
    with tempfile.TemporaryDirectory() as folder:
        # Messages name the program as the person does.
        before, after = Path(folder) / name, Path(folder) / f"corrected-{name}"
        before.write_bytes(content)
        try:
            result = compensate_program(model, before, after, options, at=at)
        except GeoerrError as error:
            raise GeoerrError(str(error).replace(f"{folder}/", "")) from error
        known, _, rest = well_known(without_waves_in_time(model), at)
        trace = trace_paths(known, before, after, at=rest, work_offset_mm=offset)
        corrected = after.read_bytes()
    left_because = "" if corrected != content else _left_because(model, result)
    assumed = tuple(one for one in conditions if typed_number(one, wish.conditions.get(one)) is None)
    return CorrectedProgram(name, corrected, result, trace, model_name, conditions, assumed, left_because)


def _left_because(model: Model, result: CompensationResult) -> str:
    """Say why a program came out as it went in."""
    if result.moves_in == 0:
        return _WITHOUT_MOVES
    if model.is_nominal:
        return _WITHOUT_ERRORS
    if result.moves_corrected > 0:
        return _NOTHING_TO_CORRECT
    return _NOWHERE if result.untouched_position_unknown else _NO_SUCH_MOVES


def conditions_of(model: Model, typed: Mapping[str, str]) -> dict[str, float]:
    """Read the conditions that a model needs from what was typed; an empty field is the middle of the data's span.

    Raises
    ------
    InputFileError
        for what is no number.
    """
    found = {}
    for name in needed_conditions(model):
        value = typed_number(name, typed.get(name))
        value = default_condition(model, name) if value is None else value
        if value is not None:
            found[name] = value
    return found


def default_condition(model: Model, name: str) -> float | None:
    """Give the middle of what a condition was while the data were measured; None where that is not known.

    Of sessions it is the last: the machine is as it was then.
    """
    spans = {} if model.record is None else model.record.covariate_spans
    if name not in spans:
        return None
    return last_session(model) if name == SESSION_NAME else float(f"{0.5 * sum(spans[name]):.4g}")


def work_offset_mm(text: str) -> tuple[float, float, float]:
    """Read `x, y, z` in mm.

    Raises
    ------
    InputFileError
        for anything else.
    """
    # A comma with a space behind it stands between numbers, and one without may be a decimal comma.
    tidy = re.sub(r"\s+(?=[,;])", "", text.strip())
    parts = re.split(r"[;,]?\s+|;", tidy)
    numbers = [typed_number(_ZERO, part) for part in (parts if len(parts) == 3 else tidy.split(","))]
    known = [number for number in numbers if number is not None]
    if len(known) != 3 or len(numbers) != 3:
        raise InputFileError(_ZERO, f"{text!r} is not three numbers", remedy="write x, y, z in mm: 0, 0, 0")
    x, y, z = known
    return x, y, z
