"""A machine that stands still while it warms up: what is looked for, told, and not advised."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.diagnose import diagnose
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbZYXt", (350.0, 350.0, 340.0))


def drifting(temperature: str) -> Observations:
    """Give the height of a place that a warming bed moves, with a temperature of that name."""
    n, rng = 240, np.random.default_rng(4)
    t_s = 60.0 * np.arange(n)
    bed_degc = 22.0 + 60.0 * (1.0 - np.exp(-t_s / 1500.0)) * np.exp(-t_s / 9000.0)
    place = {"x": np.full(n, 175.0), "y": np.full(n, 175.0), "z": np.zeros(n)}
    seen = {"mx": [None] * n, "my": [None] * n, "mz": 0.002 * rng.normal(size=n) - 0.004 * (bed_degc - 22.0)}
    return observations_from_columns(
        {"line": ["home"] * n, "carrier": ["relative"] * n, **place, **seen, "t": t_s, temperature: bed_degc}
    )


@pytest.mark.parametrize("name", ["temp_größe", "temp bed", "temp_bed(C)"])
def test_a_column_that_no_formula_can_name_is_told_and_stops_nothing(name: str) -> None:
    diagnosis = diagnose(Model(MACHINE), drifting(name))
    assert any(repr(name) in note and "rename" in note for note in diagnosis.notes)
    assert diagnosis.verdict != "nothing-missing"
    assert not any(name in str(one.reference) for one in diagnosis.candidates)


def test_what_looks_alike_at_one_place_is_told_though_no_axis_may_move() -> None:
    diagnosis = diagnose(Model(MACHINE), drifting("temp_bed"))
    # Head or work: no plan of motions on a machine that never moves would tell, and the search says what it can.
    assert diagnosis.verdict == "ambiguous"
    tied = [one for one in diagnosis.candidates if one.separate_by is not None]
    assert {str(one.reference) for one in tied} >= {"thermal-drift:z@temp_bed", "thermal-drift:work-z@temp_bed"}
