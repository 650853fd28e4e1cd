"""What a fit is called with by mistake, and what it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from virtual_machine import machine_of

import geoerr
from geoerr.errors import GeoerrError

MACHINE = machine_of("wZbXYt")
COLUMNS = {name: np.arange(4.0) for name in ("x", "y", "z", "mx", "my", "mz")}
POINTS = geoerr.observations_from_columns(COLUMNS)


@pytest.mark.parametrize(
    ("arguments", "given", "remedy"),
    [
        (
            (MACHINE, pl.DataFrame(COLUMNS)),
            "polars DataFrame was given where measurements",
            "observations_from_columns",
        ),
        ((MACHINE, COLUMNS), "dict was given where measurements", "observations_from_columns"),
        ((MACHINE, "points.csv"), "str was given where measurements", r"read_observations\('points.csv'\)"),
        ((MACHINE, Path("points.csv")), "was given where measurements", r"read_observations\('points.csv'\)"),
        ((MACHINE, [POINTS, POINTS]), "list was given where measurements", r"fit_model\(machine, \*tables\)"),
        ((MACHINE, POINTS, MACHINE), "Machine was given where measurements", "the machine comes first"),
        ((MACHINE, np.zeros((4, 6))), "numpy ndarray was given where measurements", "observations_from_columns"),
        ((MACHINE, None), "NoneType was given where measurements", "read_observations"),
        ((MACHINE,), "no measurements were given", "read_observations"),
        ((POINTS, MACHINE), "Observations was given where the machine", "the machine comes first"),
        (("machine.toml", POINTS), "str was given where the machine", r"read_machine\('machine.toml'\)"),
        (({}, POINTS), "dict was given where the machine", "Machine.from_chain"),
    ],
)
def test_what_is_no_machine_or_no_measurements_is_told_with_what_to_write(
    arguments: tuple[object, ...], given: str, remedy: str
) -> None:
    with pytest.raises(GeoerrError, match=f"{given}.*\nhint: .*{remedy}"):
        geoerr.fit_model(*arguments)  # type: ignore[arg-type]  # the point of the test
