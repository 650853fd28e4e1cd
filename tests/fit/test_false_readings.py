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
        {60: 0.0, 150: 120.0, 170: -20.0},
    ],
)
def test_false_readings_count_as_empty(readings: dict[int, float]) -> None:
    sightings = sightings_of(run(readings))
    bed = sightings.numbers("temp_bed")
    assert set(np.flatnonzero(np.isnan(bed)).tolist()) == set(readings)
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


def looked_at(readings: list[float], n_targets: int) -> Observations:
    """Looks at several targets on the tool, with one temperature each; by the clock."""
    n = len(readings)
    columns: dict[str, object] = {"carrier": ["tool"] * n * n_targets}
    columns |= {"t": np.repeat(4.0 * np.arange(n), n_targets), "temp_bed": np.repeat(readings, n_targets)}
    x = np.repeat(np.linspace(0.0, 300.0, n), n_targets)
    columns |= {"x": x, "y": 0.0 * x, "z": 0.0 * x, "tx": np.tile(50.0 * np.arange(n_targets), n)}
    columns |= {"mx": x + np.tile(50.0 * np.arange(n_targets), n), "my": 0.0 * x, "mz": 0.0 * x}
    return observations_from_columns(columns)


@pytest.mark.parametrize("n_targets", [1, 3])
def test_a_reading_is_that_of_a_look_at_all_targets(n_targets: int) -> None:
    rng = np.random.default_rng(3)
    readings = (20.0 + 0.05 * np.arange(60) + 0.02 * rng.normal(size=60)).tolist()
    readings[23] = 85.0
    bed = sightings_of(looked_at(readings, n_targets)).numbers("temp_bed")
    assert np.flatnonzero(np.isnan(bed)).tolist() == list(range(23 * n_targets, 24 * n_targets))


@pytest.mark.parametrize("readings", [[20.0, 80.0] * 20, [20.0, 60.0, 20.0], [20.0] * 3 + [20.0, 20.0, 90.0] * 10])
def test_what_is_hot_at_every_other_look_is_no_false_reading(readings: list[float]) -> None:
    """A hot part and a cold one by turns: 38 of 40 temperatures were no temperature of a machine."""
    assert np.isfinite(sightings_of(looked_at(readings, 1)).numbers("temp_bed")).all()


def test_what_a_bed_does_is_no_false_reading() -> None:
    for sightings in (sightings_of(run({})), sightings_of(run({}, switched=True))):
        assert np.isfinite(sightings.numbers("temp_bed")).all()
        assert not any("count as empty" in note for note in sightings.notes)
