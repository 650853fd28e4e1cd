"""What a function was called with, told apart where it is not what that function takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from geoerr.errors import ShapeError
from geoerr.machine import Machine
from geoerr.model.model import Model

if TYPE_CHECKING:
    from geoerr.observations import MeasuredTable

Table = TypeVar("Table", bound="MeasuredTable")

# Tables by the names of their classes: who reads none loads no library for them.
_READ_BY = {
    "Observations": "read_observations",
    "CircularTest": "read_circular_test",
    "Lengths": "read_lengths",
}
_FILE = "measured.csv"


def check_model(model: object, others: Sequence[object], call: str) -> None:
    """Refuse what is no model.

    Parameters
    ----------
    others
        The other arguments: a model among them says that the order is another.
    call
        How the function is called, with `model` in it.

    Raises
    ------
    ShapeError
        with what was given, and what to write.
    """
    if isinstance(model, Model):
        return
    if any(isinstance(other, Model) for other in others):
        remedy = f"the model comes {_place('model', call)}: {call}"
    elif isinstance(model, Machine):
        remedy = f"Model(machine) is a machine without errors: {call.replace('model', 'Model(machine)')}"
    elif isinstance(getattr(model, "model", None), Model):
        remedy = f"it has one, .model: {call.replace('model', 'result.model')}"
    elif isinstance(model, str | Path):
        remedy = f"read the file: {call.replace('model', f'load_model({str(model)!r})')}"
    else:
        remedy = f"{call}, with a model of load_model or of a fit, or Model(machine)"
    raise ShapeError(f"{kind_of(model)} was given where the model is needed\nhint: {remedy}")


def check_machine(machine: object, others: Sequence[object], call: str, *, or_model: bool = False) -> None:
    """Refuse what is no machine, or neither a machine nor a model; parameters as for `check_model`.

    Raises
    ------
    ShapeError
        with what was given, and what to write.
    """
    if isinstance(machine, Machine) or (or_model and isinstance(machine, Model)):
        return
    if any(isinstance(other, Machine | Model) for other in others):
        remedy = f"the machine comes {_place('machine', call)}: {call}"
    elif isinstance(machine, Model):
        remedy = f"it has one, .machine: {call.replace('machine', 'model.machine')}"
    elif isinstance(machine, str | Path):
        remedy = f"read the file: {call.replace('machine', f'read_machine({str(machine)!r})')}"
    else:
        model = ", or a model" if or_model else ""
        remedy = f"{call}, with a machine of read_machine or Machine.from_chain{model}"
    raise ShapeError(f"{kind_of(machine)} was given where the machine is needed\nhint: {remedy}")


def check_tables(tables: Sequence[object], call: str, *kinds: type[object]) -> None:
    """Refuse what is no table of measurements of these kinds.

    Parameters
    ----------
    call
        How the function is called, with `observations` in it, or `tests` of circles.

    Raises
    ------
    ShapeError
        with what was given, and what to write.
    """
    if not tables:
        reader = _READ_BY[kinds[0].__name__]
        raise ShapeError(f"no measurements were given\nhint: {_with(call, f'{reader}({_FILE!r})')}")
    for table in tables:
        if not isinstance(table, kinds):
            remedy = _remedy(table, call, kinds)
            raise ShapeError(f"{kind_of(table)} was given where measurements are needed\nhint: {remedy}")


def _remedy(table: object, call: str, kinds: tuple[type[object], ...]) -> str:
    readers = [_READ_BY[kind.__name__] for kind in kinds]
    takes_points = "read_observations" in readers
    if isinstance(table, str | Path):
        return f"read the file: {readers[0]}({str(table)!r})"
    if (isinstance(table, Mapping) or type(table).__name__ == "DataFrame") and takes_points:
        return "make observations of its columns: observations_from_columns(columns)"
    if isinstance(table, list | tuple):
        return f"give tables one by one, with a star before the list: {_with(call, '*tables')}"
    if isinstance(table, Machine | Model):
        first = "model" if "model" in call.partition("(")[2] else "machine"
        return f"the {first} comes once: {call}"
    made = [*readers, *(["observations_from_columns"] if takes_points else [])]
    return f"give what {', '.join(made[:-1])} or {made[-1]} makes" if len(made) > 1 else f"give what {made[0]} makes"


def _with(call: str, tables: str) -> str:
    return call.replace("observations", tables).replace("tests", tables)


def one_or_several(tables: Table | Sequence[Table]) -> list[Table]:
    """Give a table, or several, as a list; what is neither stays in it, to be refused."""
    if isinstance(tables, list | tuple):
        return list(tables)
    return [cast("Table", tables)]


def kind_of(value: object) -> str:
    """Name the type of a value, with its library where that is another."""
    library = type(value).__module__.partition(".")[0]
    name = type(value).__name__
    return f"a value of type {name if library in ('builtins', 'geoerr', 'pathlib') else f'{library} {name}'}"


def _place(name: str, call: str) -> str:
    return "first" if call.partition("(")[2].startswith(name) else "second"
