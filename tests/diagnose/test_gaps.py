"""Temperatures between readings: what a search takes them for, and where it takes them for nothing."""

from __future__ import annotations

import numpy as np
import polars as pl

from geoerr.diagnose.gaps import Gaps, between_readings, gaps_of, read_columns, unread_rows
from geoerr.fit.joined import sightings_of
from geoerr.fit.sightings import Sightings
from geoerr.observations import Observations

NAN = float("nan")


def session(t: list[float], temp: list[float], name: str = "a", **more: list[float]) -> pl.DataFrame:
    n = len(t)
    columns: dict[str, object] = {"session": [name] * n, "carrier": "relative", "line": "X", "repeat": 0}
    columns |= {"x": np.arange(float(n)), "y": 0.0, "z": 0.0, "tx": 0.0, "ty": 0.0, "tz": 0.0}
    columns |= {"mx": np.arange(float(n)), "my": 0.0, "mz": 0.0, "t": t, "temp_bed": temp}
    return pl.DataFrame(columns | more)


def joined(*tables: pl.DataFrame) -> Sightings:
    return sightings_of(Observations(pl.concat(tables)))


def between(sightings: Sightings) -> list[float]:
    return [round(value, 9) for value in between_readings(sightings, sightings.numbers("temp_bed")).tolist()]


def test_a_temperature_runs_straight_between_readings() -> None:
    """By time, not by row."""
    t = [0.0, 1.0, 4.0, 5.0, 100.0]
    assert between(joined(session(t, [20.0, NAN, NAN, 21.0, 60.0]))) == [20.0, 20.2, 20.8, 21.0, 60.0]


def test_nothing_is_known_over_a_long_gap_a_large_change_and_far_beyond_a_reading() -> None:
    long = joined(session([0.0, 30.0, 60.0, 100.0], [20.0, NAN, 20.0, 60.0]))
    assert np.isnan(between(long)[1])
    # Ten degrees of forty in one step.
    large = joined(session([0.0, 2.0, 4.0, 100.0], [20.0, NAN, 30.0, 60.0]))
    assert np.isnan(between(large)[1])
    ends = joined(session([0.0, 8.0, 9.0, 99.0, 100.0], [NAN, NAN, 20.0, 60.0, NAN]))
    assert np.isnan(between(ends)[0])
    assert between(ends)[1] == 20.0
    assert between(ends)[4] == 60.0


def test_sessions_are_apart_and_one_without_readings_stays_empty() -> None:
    t = [0.0, 1.0, 2.0, 100.0]
    both = joined(session(t, [20.0, NAN, 20.5, 60.0]), session(t, [NAN] * 4, "b"))
    assert between(both)[1] == 20.25
    assert np.isnan(between(both)[4:]).all()
    assert gaps_of(both) == (Gaps("temp_bed", 5, 1),)


def test_rows_without_a_temperature_that_others_have_are_told() -> None:
    t = [0.0, 1.0, 2.0, 100.0]
    read, unread = session(t, [20.0, NAN, 20.5, 60.0]), session(t, [NAN] * 4, "b")
    assert unread_rows(joined(read, unread)).tolist() == [False] * 4 + [True] * 4
    # Where more rows have none than have one, none is left out for it.
    assert not unread_rows(joined(read, unread, session(t, [NAN] * 4, "c"))).any()


def test_only_temperatures_run_straight() -> None:
    """A feed or a load jumps from one row to the next."""
    table = joined(session([0.0, 1.0, 2.0, 100.0], [20.0] * 4, load=[0.0, NAN, 0.0, 5.0]))
    (load,) = read_columns(table, ["load"])
    assert np.isnan(load[1])
    assert gaps_of(table) == ()


def test_readings_are_what_they_were() -> None:
    rng = np.random.default_rng(4)
    values = np.where(rng.random(200) < 0.3, NAN, 20.0 + np.cumsum(rng.normal(0.0, 0.1, 200)))
    table = joined(session(np.arange(200.0).tolist(), values.tolist()))
    found = between_readings(table, values)
    known = np.isfinite(values)
    assert np.array_equal(found[known], values[known])
    assert np.isfinite(found).mean() > 0.95
