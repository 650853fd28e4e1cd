"""What a fit was called with, told apart where it is not what a fit takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from geoerr.errors import ShapeError
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import CircularTest, Lengths, Observations


def check_machine(machine: object, tables: Sequence[object]) -> None:
    """Refuse what is neither a machine nor a model.

    Raises
    ------
    ShapeError
        with what was given, and what to write.
    """
    if isinstance(machine, Machine | Model):
        return
    if any(isinstance(table, Machine | Model) for table in tables):
        remedy = "the machine comes first: fit_model(machine, observations)"
    elif isinstance(machine, str | Path):
        remedy = f"read the file: fit_model(read_machine({str(machine)!r}), observations)"
    else:
        remedy = "fit_model(machine, observations), with a machine of read_machine or Machine.from_chain, or a model"
    raise ShapeError(f"{_kind(machine)} was given where the machine is needed\nhint: {remedy}")


def check_tables(tables: Sequence[object]) -> None:
    """Refuse what is neither measured points nor a circular test.

    Raises
    ------
    ShapeError
        with what was given, and what to write.
    """
    if not tables:
        raise ShapeError(
            "no measurements were given\nhint: fit_model(machine, read_observations('observations.csv'))"
        )
    for table in tables:
        if not isinstance(table, Observations | CircularTest):
            raise ShapeError(f"{_kind(table)} was given where measurements are needed\nhint: {_remedy(table)}")


def _remedy(table: object) -> str:
    if isinstance(table, str | Path):
        return f"read the file: read_observations({str(table)!r})"
    if isinstance(table, Mapping | pl.DataFrame):
        return "make observations of its columns: observations_from_columns(columns)"
    if isinstance(table, list | tuple):
        return "give tables one by one, with a star before the list: fit_model(machine, *tables)"
    if isinstance(table, Machine | Model):
        return "the machine comes first, once: fit_model(machine, observations)"
    if isinstance(table, Lengths):
        return "no model is fitted to lengths: give measured points or circular tests"
    return "give what read_observations, read_circular_test or observations_from_columns makes"


def _kind(value: object) -> str:
    """Name the type of a value, with its library where that is another."""
    library = type(value).__module__.partition(".")[0]
    name = type(value).__name__
    return f"a value of type {name if library in ('builtins', 'geoerr', 'pathlib') else f'{library} {name}'}"
