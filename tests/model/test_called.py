"""What functions are called with by mistake, and what they say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from virtual_machine import machine_of

import geoerr
from geoerr.diagnose import diagnose
from geoerr.diagnose.circles import diagnose_circles
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
        ((MACHINE, POINTS, MACHINE), "Machine was given where measurements", "the machine comes once"),
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


MODEL = geoerr.Model(MACHINE)


@pytest.mark.parametrize(
    ("call", "given", "remedy"),
    [
        (lambda: geoerr.compare(POINTS, MODEL), "Observations .* the model", r"comes first: compare\(model, obs"),
        (lambda: geoerr.compare(MACHINE, POINTS), "Machine .* the model", r"compare\(Model\(machine\), obs"),
        (lambda: geoerr.compare("a.json", POINTS), "str .* the model", r"compare\(load_model\('a.json'\), obs"),
        (lambda: geoerr.compare(MODEL, "a.csv"), "str .* measurements", r"read_observations\('a.csv'\)"),
        (lambda: geoerr.compare(MODEL), "no measurements", r"compare\(model, read_observations\('measured.csv'\)\)"),
        (lambda: diagnose(POINTS, MODEL), "Observations .* the model", r"comes first: diagnose\(model, obs"),
        (lambda: diagnose(MODEL, MODEL), "Model .* measurements", r"the model comes once: diagnose\(model, obs"),
        (lambda: diagnose_circles(MODEL, POINTS), "Observations .* measurements", "what read_circular_test makes"),
        (lambda: diagnose_circles(MODEL), "no measurements", r"\(model, read_circular_test\('measured.csv'\)\)"),
        (
            lambda: geoerr.add_effect(POINTS, MODEL, reference="backlash:x"),
            "Observations .* the model",
            r"add_effect\(model, observations, reference='backlash:x'\)",
        ),
        (
            lambda: geoerr.add_effect(MODEL, POINTS, reference=None),  # type: ignore[arg-type]  # None is no name
            "reference: a value of type NoneType",
            r"ID\[:AXIS\]",
        ),
        (
            lambda: geoerr.add_effect(MODEL, POINTS, reference="backlash:x", known=MODEL),  # type: ignore[arg-type]  # a model is no fit
            "known: a value of type Model",
            "the fit of these measurements",
        ),
        (lambda: geoerr.uncertainty_budget(None), "NoneType .* the model", "a model of load_model or of a fit"),
        (
            lambda: geoerr.uncertainty_map(MODEL),
            "Model .* a budget",
            r"uncertainty_map\(uncertainty_budget\(model\)\)",
        ),
        (lambda: geoerr.identify_joint(MACHINE, POINTS), "Observations .* the machine", "the machine comes second"),
        (lambda: geoerr.identify_joint("a.csv", MACHINE), "str .* measurements", r"read_observations\('a.csv'\)"),
        (lambda: geoerr.identify_nine_line(POINTS, MODEL), "Model .* the machine", r"it has one, \.machine"),
        (lambda: geoerr.identify_states(MACHINE, {20.0: POINTS}), "dict .* the machine", "comes second"),
        (lambda: geoerr.identify_states(POINTS, MACHINE), "Observations .* tables by temperature", r"\{20.0: cold"),
        (lambda: geoerr.compensate_program("a.gcode", "b.gcode", MODEL), "str .* the model", "the model comes first"),
        (lambda: geoerr.run_circular_test(MACHINE, None), "Machine .* the model", r"Model\(machine\)"),
        (lambda: geoerr.write_model_report("a.html", MODEL, "a.csv"), "str .* measurements", "read_observations"),
    ],
)
def test_what_is_exchanged_or_not_yet_read_is_told_with_what_to_write(
    call: Callable[[], object], given: str, remedy: str
) -> None:
    with pytest.raises(GeoerrError, match=f"{given}.*\nhint: .*{remedy}"):
        call()
