"""Rows of which nobody knows from which side their axis came: they take no part in a search, and hide no play."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from geoerr.diagnose import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.untold import untold_rows
from geoerr.fit.joined import sightings_of
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (400.0, 400.0, 400.0))
PLACES_MM = np.array([10.0, 31.7, 58.2, 86.6, 109.9, 139.4, 160.1, 188.8, 214.0, 237.3, 262.9, 290.4, 317.6, 345.2])


def to_and_fro(play_um: float, seed: int, *, cycles: int = 5, stated: bool = False) -> Observations:
    """Five cycles along X that overrun their ends (ISO 230-2): both ends are approached from both sides."""
    rng = np.random.default_rng(seed)
    x_mm = np.concatenate([np.concatenate([PLACES_MM, PLACES_MM[::-1]]) for _ in range(cycles)])
    d = np.tile(np.repeat([1.0, -1.0], len(PLACES_MM)), cycles)
    n = len(x_mm)
    seen_mm = x_mm + 1e-3 * (-0.5 * play_um * d + 0.5 * rng.standard_normal(n))
    columns = {
        "line": ["X"] * n,
        "carrier": ["relative"] * n,
        "repeat": np.repeat(np.arange(cycles), 2 * len(PLACES_MM)),
        **{"x": x_mm, "y": np.full(n, 200.0), "z": np.full(n, 100.0), "mx": seen_mm, "t": 8.0 * np.arange(n)},
    }
    return observations_from_columns(columns | ({"dir_x": d.astype(int)} if stated else {}))


def circles(play_um: float, seed: int, n: int, axis: int) -> Observations:
    """Two circles in motion, seen as points: near a reversal the chord from the row before says nothing."""
    rng = np.random.default_rng(seed)
    parts = []
    for number, (sense, feed) in enumerate(((1, 1000.0), (-1, 4000.0))):
        angle = 0.13 + sense * 2.0 * np.pi * np.arange(n) / n
        q_mm = 200.0 + 100.0 * np.column_stack([np.cos(angle), np.sin(angle)])
        speed = sense * np.column_stack([-np.sin(angle), np.cos(angle)])
        seen_mm = q_mm + 5e-4 * rng.standard_normal((n, 2))
        seen_mm[:, axis] -= 5e-4 * play_um * np.sign(speed[:, axis])
        t_s = 100.0 * number + np.arange(n) * 2.0 * np.pi * 100.0 / n / (feed / 60.0)
        parts.append({"q": q_mm, "seen": seen_mm, "t": t_s, "feed": np.full(n, feed), "repeat": np.full(n, number)})
    both = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    total = 2 * n
    return observations_from_columns(
        {
            "line": ["XY"] * total,
            "carrier": ["relative"] * total,
            "repeat": both["repeat"],
            **{"x": both["q"][:, 0], "y": both["q"][:, 1], "z": np.full(total, 200.0)},
            **{"mx": both["seen"][:, 0], "my": both["seen"][:, 1]},
            **{"moving": np.ones(total), "feed": both["feed"], "t": both["t"]},
        }
    )


def play_of(diagnosis: Diagnosis, axis: str) -> tuple[float, float]:
    """Give the play, µm, of the only name, and its standard error."""
    (found,) = diagnosis.found
    assert str(found.reference) == f"backlash:{axis}"
    (b,) = found.parameters
    return 1e3 * b.value, 1e3 * b.std


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("stated", [False, True])
def test_play_is_named_without_a_column_of_directions(seed: int, stated: bool) -> None:
    """Of 140 rows one began with an unknown direction, and nothing was missing at 16 noises of play."""
    value, std = play_of(diagnose(Model(MACHINE), to_and_fro(8.0, seed, stated=stated)), "x")
    assert value == pytest.approx(8.0, abs=4.0 * std)
    assert std < 0.2


def test_rows_that_took_no_part_are_told() -> None:
    (note,) = [one for one in diagnose(Model(MACHINE), to_and_fro(8.0, 1)).notes if "from which side" in one]
    # The first row, and both ends of five cycles but for the last.
    assert note.startswith("in 10 rows nobody knows from which side an axis came")
    stated = diagnose(Model(MACHINE), to_and_fro(8.0, 1, stated=True))
    assert not any("from which side" in one for one in stated.notes)


def slip(rows: Observations, at: int) -> Observations:
    """State the other direction of one row."""
    other = -pl.col("dir_x")
    return Observations(
        rows.frame.with_columns(pl.when(pl.int_range(pl.len()) == at).then(other).otherwise("dir_x").alias("dir_x"))
    )


@pytest.mark.parametrize("row", [5, 20, 77])
def test_one_direction_unlike_its_neighbours_hides_no_play(row: int) -> None:
    """A slip in one row of 140 hid the play of all, as rows of no direction did."""
    value, std = play_of(diagnose(Model(MACHINE), slip(to_and_fro(8.0, 1, stated=True), row)), "x")
    assert value == pytest.approx(8.0, abs=4.0 * std)
    assert std < 0.2


def test_one_direction_unlike_its_neighbours_is_told() -> None:
    rows = to_and_fro(8.0, 1, stated=True)
    (note,) = [one for one in sightings_of(slip(rows, 5)).notes if "unlike the rows" in one]
    assert note.startswith("dir_x of 1 row (the first: row 6 of the measurements)")
    assert not any("unlike the rows" in one for one in sightings_of(rows).notes)
    # Every place approached from above: no slip.
    from_above = rows.frame.with_columns(pl.lit(-1).alias("dir_x"))
    assert not any("unlike the rows" in one for one in sightings_of(Observations(from_above)).notes)


def test_without_play_nothing_is_named() -> None:
    for seed in range(4):
        assert diagnose(Model(MACHINE), to_and_fro(0.0, seed)).verdict == "nothing-missing"


@pytest.mark.parametrize(("n", "axis"), [(1000, 0), (2000, 1)])
def test_play_is_named_in_circles_as_points(n: int, axis: int) -> None:
    """Rows just behind a reversal were told by their chord, the wrong way: 5 of 10 µm, or nothing."""
    value, std = play_of(diagnose(Model(MACHINE), circles(10.0, 5, n, axis)), "xy"[axis])
    assert value == pytest.approx(10.0, abs=4.0 * std)


def test_first_rows_and_ends_are_untold_where_their_axis_moves() -> None:
    rows = to_and_fro(8.0, 1, cycles=2)
    untold = untold_rows(sightings_of(rows))
    m = len(PLACES_MM)
    # The first row, and where the axis may have turned beyond its last place.
    assert np.flatnonzero(untold).tolist() == [0, m, 2 * m, 3 * m]
    # Whoever states directions knows them; y and z rest, from wherever they came.
    assert not untold_rows(sightings_of(to_and_fro(8.0, 1, cycles=2, stated=True))).any()


def test_where_most_rows_are_untold_all_stay() -> None:
    """Of a line of two places run once, one of which is untold, half is left."""
    columns = {
        "line": ["X"] * 3,
        "carrier": ["relative"] * 3,
        "x": [0.0, 100.0, 50.0],
        "y": [0.0] * 3,
        "z": [0.0] * 3,
    }
    told = {**columns, "mx": [0.0, 100.0, 50.0], "dir_x": [0, 0, 1]}
    assert not untold_rows(sightings_of(observations_from_columns(told))).any()


def test_passes_of_which_no_row_takes_part_are_no_obstacle() -> None:
    """Numbers of passes have gaps where rows were left out: `geoerr diagnose` ended in a traceback."""
    sightings = sightings_of(to_and_fro(8.0, 1))
    for gone in (0, 3, sightings.n_passes - 1):
        kept = sightings.select(sightings.pass_number != gone, "no temperature")
        numbered = replace(kept, pass_number=np.unique(kept.pass_number, return_inverse=True)[1])
        assert np.array_equal(untold_rows(kept), untold_rows(numbered))
