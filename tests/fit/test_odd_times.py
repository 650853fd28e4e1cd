"""Times of a clock, and of some rows only: a drift was called unseen, and a play of 6 µm was 0, without a word."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from geoerr.fit.joined import sightings_of
from geoerr.fit.sightings import Sightings
from geoerr.observations import observations_from_columns

EPOCH_S = 1_764_444_000.0
N = 20


def seen(*begins_s: float, duration_s: float = 600.0, empty: Sequence[int] = ()) -> Sightings:
    """Give sessions of some rows each that begin at these times; in some rows nobody read the clock."""
    places = np.random.default_rng(1).uniform(0.0, 300.0, (N * len(begins_s), 3))
    t = np.concatenate([begin_s + np.linspace(0.0, duration_s, N) for begin_s in begins_s])
    columns: dict[str, object] = {"session": np.repeat([f"s{k}" for k in range(len(begins_s))], N).tolist(), "t": t}
    for k, axis in enumerate("xyz"):
        columns |= {axis: places[:, k], f"m{axis}": places[:, k]}
    if empty:
        columns["t"] = np.where(np.isin(np.arange(len(t)), empty), np.nan, t)
    return sightings_of(observations_from_columns(columns))


def told(sightings: Sightings) -> list[str]:
    return [note for note in sightings.notes if "session's begin" in note]


def test_seconds_since_1970_count_from_the_begin_of_each_session() -> None:
    sightings = seen(EPOCH_S, EPOCH_S + 7200.0)
    np.testing.assert_allclose(sightings.numbers("t"), np.tile(np.linspace(0.0, 600.0, N), 2), atol=1e-6)
    assert not told(sightings)


@pytest.mark.parametrize("begin_s", [0.0, 30.0, 3600.0, -100.0])
def test_times_of_a_session_stay_as_they_are(begin_s: float) -> None:
    sightings = seen(begin_s)
    assert sightings.numbers("t")[0] == begin_s
    assert not told(sightings)


@pytest.mark.parametrize(("days", "is_told"), [(1, False), (2, True), (3, True)])
def test_a_clock_that_begins_again_in_one_session_is_told(days: int, is_told: bool) -> None:
    """Rows of three days came one between the other, and what they differ by had names."""
    n = days * N
    places = np.random.default_rng(1).uniform(0.0, 300.0, (n, 3))
    columns: dict[str, object] = {"t": np.tile(np.linspace(0.0, 600.0, N), days)}
    for k, axis in enumerate("xyz"):
        columns |= {axis: places[:, k], f"m{axis}": places[:, k]}
    notes = [note for note in sightings_of(observations_from_columns(columns)).notes if "begins again" in note]
    assert bool(notes) is is_told
    mixed = np.random.default_rng(2).permutation(n)
    shuffled = observations_from_columns({name: np.asarray(own)[mixed] for name, own in columns.items()})
    assert not any("begins again" in note for note in sightings_of(shuffled).notes)
    by_target = {name: np.tile(np.asarray(own)[:N], 3) for name, own in columns.items()}
    by_target["tx"] = np.repeat([0.0, 40.0, 80.0], N)
    by_target["mx"] = np.asarray(by_target["mx"]) + np.asarray(by_target["tx"])
    by_target |= {"carrier": ["tool"] * 3 * N}
    assert not any("begins again" in note for note in sightings_of(observations_from_columns(by_target)).notes)
    named = observations_from_columns(columns | {"session": np.repeat(np.arange(days), N).astype(str).tolist()})
    assert not any("begins again" in note for note in sightings_of(named).notes)


def test_a_time_of_day_is_told() -> None:
    (note,) = told(seen(36_000.0, 43_200.0))
    assert note.startswith("the time t begins at 36000 s in a session of 600 s")


def test_a_time_that_runs_on_from_session_to_session_is_not_told() -> None:
    assert not told(seen(*np.arange(20) * 700.0))


def test_a_session_without_duration_is_not_told() -> None:
    assert not told(seen(36_000.0, duration_s=0.0))


def test_a_time_that_some_rows_lack_is_told() -> None:
    notes = [note for note in seen(0.0, 0.0, empty=[N + 3]).notes if "is empty in" in note]
    assert [note.split(":")[0] for note in notes] == [f"the time t is empty in 1 of {N} rows of session 's1'"]


def test_a_session_without_times_is_not_told() -> None:
    assert not [note for note in seen(0.0, 0.0, empty=range(N)).notes if "is empty in" in note]
