"""A lag at two feeds: a pass at one feed has it from first to last row, as an offset that passes for noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine("test", "wbXYZt", {axis: Axis((0.0, 400.0)) for axis in AXES})
OFFSETS_MM = np.array([[0.0, 0.0, 0.0], [150.0, 0.0, 80.0], [0.0, 150.0, -60.0]])
LAG_S, NOISE_MM = 3e-4, 3e-3


def three_lines_at_two_feeds(seed: int) -> Observations:
    """X, Y, Z there and back, twice at each feed; the first picture of a way is taken at rest."""
    rng = np.random.default_rng(seed)
    rows: list[dict[str, Any]] = []
    error, t = [], 0.0
    for repeat in range(2):
        for feed in (1000.0, 6000.0):
            for axis, name in enumerate(AXES):
                for way in (1, -1):
                    for number, place in enumerate(np.linspace(20.0, 380.0, 13)[::way]):
                        q = np.zeros(3)
                        q[axis] = place
                        speed = way * feed / 60.0 if number and axis == 0 else 0.0
                        bent = 0.02 * np.sin(3.0 * q / 400.0) + 0.015 * np.cos(4.0 * np.roll(q, 1) / 400.0)
                        for target, offset in enumerate(OFFSETS_MM):
                            row = {"line": f"{name}{feed:.0f}", "repeat": repeat, "target": f"t{target}", "t": t}
                            row |= {"feed": feed, "moving": float(number > 0), "carrier": "relative"}
                            row |= {f"dir_{one}": float(way * (one == name)) for one in AXES}
                            row |= dict(zip(AXES, q, strict=True)) | dict(
                                zip(("tx", "ty", "tz"), offset, strict=True)
                            )
                            rows.append(row)
                            error.append(bent - [LAG_S * speed, 0.0, 0.0])
                        t += 2.0
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    place = np.array([[row[name] for name in AXES] for row in rows]) + np.tile(OFFSETS_MM, (len(rows) // 3, 1))
    seen = place + np.array(error) + NOISE_MM * rng.normal(size=place.shape)
    columns |= dict(zip(("mx", "my", "mz"), seen.T, strict=True))
    columns |= {name: [NOISE_MM] * len(rows) for name in ("sx", "sy", "sz")}
    return observations_from_columns(columns)


@pytest.mark.parametrize("seed", [1, 3])
def test_a_lag_at_two_feeds_is_no_stick_slip_with_play(seed: int) -> None:
    table = three_lines_at_two_feeds(seed)
    fitted = fit_terms(MACHINE, [table], options=FitOptions(threads=1))
    diagnosis = diagnose(fitted, threads=1)
    assert [str(one.reference) for one in diagnosis.found] == ["lag:x"]
    assert diagnosis.verdict == "missing"
    term = diagnosis.found[0].term
    assert term is not None
    (tau,) = term.coefficients
    assert tau.value == pytest.approx(LAG_S, abs=5.0 * tau.std)
    assert tau.std < 0.03 * LAG_S
