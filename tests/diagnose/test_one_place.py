"""A machine that stands still while it warms up: what is looked for, told, and not advised."""

from __future__ import annotations

import numpy as np

from geoerr.diagnose import diagnose
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import observations_from_columns

MACHINE = Machine.from_chain("wbZYXt", (350.0, 350.0, 340.0))


def test_what_looks_alike_at_one_place_is_told_though_no_axis_may_move() -> None:
    n, rng = 240, np.random.default_rng(4)
    t_s = 60.0 * np.arange(n)
    bed_degc = 22.0 + 60.0 * (1.0 - np.exp(-t_s / 1500.0)) * np.exp(-t_s / 9000.0)
    place = {"x": np.full(n, 175.0), "y": np.full(n, 175.0), "z": np.zeros(n)}
    seen = {"mx": [None] * n, "my": [None] * n, "mz": 0.002 * rng.normal(size=n) - 0.004 * (bed_degc - 22.0)}
    columns = {"line": ["home"] * n, "carrier": ["relative"] * n, **place, **seen, "t": t_s, "temp_bed": bed_degc}
    diagnosis = diagnose(Model(MACHINE), observations_from_columns(columns))
    # Head or work: no plan of motions on a machine that never moves would tell, and the search says what it can.
    assert diagnosis.verdict == "ambiguous"
    tied = [one for one in diagnosis.candidates if one.separate_by is not None]
    assert {str(one.reference) for one in tied} >= {"thermal-drift:z@temp_bed", "thermal-drift:work-z@temp_bed"}
