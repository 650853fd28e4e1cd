"""Readings of a thermometer that are none count as empty, and are told; what a heater does is none of them."""

import numpy as np
import pytest

from geoerr.fit import FitOptions, fit_model
from geoerr.fit.joined import sightings_of
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (400.0, 400.0, 400.0))
PER_K, NOISE_MM = 23.4e-6, 5e-4


def run(readings: dict[int, float], *, switched: bool = False) -> Observations:
    """A laser along x while a bed warms from 20 to 60 °C, and a room that does nothing; some rows read otherwise."""
    rng = np.random.default_rng(7)
    x = np.tile(np.concatenate([np.linspace(0.0, 400.0, 21), np.linspace(400.0, 0.0, 21)]), 6)
    n = len(x)
    bed = 20.0 + 40.0 * (1.0 - np.exp(-np.arange(n) / 90.0))
    if switched:
        bed = np.where(np.arange(n) // 50 % 2 == 0, 20.0, 90.0)
    measured = x + PER_K * (bed - 20.0) * (x - 100.0) + NOISE_MM * rng.normal(size=n)
    told = bed.copy()
    for row, value in readings.items():
        told[row] = value
    columns: dict[str, object] = {"carrier": ["relative"] * n, "t": 5.0 * np.arange(n), "x": x, "mx": measured}
    columns |= {"y": np.zeros(n), "z": np.zeros(n), "repeat": np.repeat(np.arange(6), 42)}
    return observations_from_columns(columns | {"temp_bed": told, "temp_room": 21.0 + 0.2 * rng.normal(size=n)})


@pytest.mark.parametrize(
    "readings",
    [
        dict.fromkeys((17, 80, 81, 82, 200), 999.0),
        dict.fromkeys((0, 251), -127.0),
        {100: 150.0},
        {60: 0.0, 150: 85.0, 170: 120.0},
    ],
)
def test_false_readings_count_as_empty(readings: dict[int, float]) -> None:
    sightings = sightings_of(run(readings))
    bed = sightings.numbers("temp_bed")
    far = {row for row, value in readings.items() if abs(value - run({}).numbers("temp_bed")[row, 0]) > 30.0}
    assert set(np.flatnonzero(np.isnan(bed)).tolist()) == far
    (note,) = (note for note in sightings.notes if "count as empty" in note)
    assert note.startswith("temp_bed reads ")
    found = fit_model(
        MACHINE,
        run(readings),
        effects="thermal-expansion:x@temp_bed",
        options=FitOptions(components="12", threads=1),
    ).model
    alpha = found.parameter("thermal-expansion:x@temp_bed.alpha")
    assert abs(alpha.value - PER_K) < 4.0 * alpha.std < 0.1 * PER_K
    assert found.record is not None
    assert found.record.covariate_spans["temp_bed"][1] < 60.0


def test_what_a_bed_does_is_no_false_reading() -> None:
    for sightings in (sightings_of(run({})), sightings_of(run({}, switched=True))):
        assert np.isfinite(sightings.numbers("temp_bed")).all()
        assert not any("count as empty" in note for note in sightings.notes)
