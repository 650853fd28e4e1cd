"""Tables that say another thing than they mean: kelvins, strokes without names, readings from both sides."""

import re

import numpy as np
import polars as pl
import pytest

from geoerr.fit.joined import sightings_of
from geoerr.observations import Observations, observations_from_columns


def table(**more: object) -> Observations:
    """A grid of 8 × 8 points that is run back and forth, row by row."""
    place = np.linspace(20.0, 280.0, 8)
    x = np.concatenate([place if row % 2 == 0 else place[::-1] for row in range(8)])
    y = np.repeat(place, 8)
    rng = np.random.default_rng(0)
    columns: dict[str, object] = {"carrier": ["relative"] * 64, "x": x, "y": y, "z": np.zeros(64)}
    columns |= {"mx": x + 0.01 * rng.normal(size=64), "my": y + 0.01 * rng.normal(size=64)}
    return observations_from_columns(columns | more)


def notes_of(observations: Observations, about: str) -> list[str]:
    return [note for note in sightings_of(observations).notes if about in note]


def test_a_grid_that_is_one_line_is_told_to_name_its_strokes() -> None:
    (note,) = notes_of(table(line=["grid"] * 64), "strokes")
    assert "8 strokes, which the table counts as 2 passes" in note
    assert not notes_of(table(line=[f"row {row // 8}" for row in range(64)]), "strokes")


def test_scattered_points_have_no_strokes() -> None:
    order = np.random.default_rng(1).permutation(64)
    seen = table()
    assert not notes_of(Observations(seen.frame[order]), "strokes")


@pytest.mark.parametrize(
    ("name", "low", "high", "is_told"),
    [
        ("temp_bed", 296.0, 306.0, True),
        ("temp", 291.2, 291.2, True),
        ("temp_bed", 20.0, 120.0, False),
        ("temp_nozzle", 280.0, 290.0, False),
        ("temp_e0", 285.0, 285.0, False),
        ("temp_tool1", 285.0, 285.0, False),
        ("temp_heater_bed", 290.0, 300.0, True),
        ("temp_chamber", 240.0, 300.0, False),
    ],
)
def test_kelvins_are_told(name: str, low: float, high: float, is_told: bool) -> None:
    warm = table(**{name: np.linspace(low, high, 64)})
    assert bool(notes_of(warm, "look like kelvins")) is is_told


@pytest.mark.parametrize(("scatter_k", "is_told"), [(0.0, False), (0.03, False), (0.2, True), (2.0, False)])
def test_a_thermometer_that_scatters_is_told(scatter_k: float, is_told: bool) -> None:
    """Of 0.5 K of drift that many kelvins; what is all scatter has nothing that an effect could follow."""
    rng = np.random.default_rng(1)
    readings = np.linspace(20.0, 22.0, 64) + scatter_k * rng.normal(size=64)
    told = notes_of(table(temp_frame=readings), "temp_frame scatters")
    assert bool(told) is is_told


def test_how_much_too_small_an_expansion_comes_out_is_told() -> None:
    """The share that is told is by how much a straight line on the readings is flatter than on the temperature."""
    rng = np.random.default_rng(2)
    n = 2000
    true_k = np.cumsum(rng.normal(size=n)) * 0.01
    readings = 20.0 + true_k + 0.3 * np.std(true_k) * rng.normal(size=n)
    flatter = 1.0 - np.polyfit(readings, true_k, 1)[0]
    place = np.tile(np.linspace(0.0, 300.0, 20), 100)
    columns = {"carrier": ["relative"] * n, "line": ["x"] * n, "x": place, "y": 0.0 * place, "z": 0.0 * place}
    told = notes_of(
        observations_from_columns({**columns, "mx": place, "temp_frame": readings}), "temp_frame scatters"
    )
    (share,) = (float(found) for note in told for found in re.findall(r"(\d+) % too small", note))
    assert share == pytest.approx(100.0 * flatter, abs=1.5)


@pytest.mark.parametrize("n_targets", [1, 2, 6])
def test_scatter_is_that_of_looks(n_targets: int) -> None:
    """Every look has a row for each target, of one temperature."""
    rng = np.random.default_rng(5)
    n = 60
    x = np.repeat(np.linspace(0.0, 300.0, n), n_targets)
    reading = np.repeat(20.0 + np.linspace(0.0, 2.0, n) + 0.15 * rng.normal(size=n), n_targets)
    offset = np.tile(50.0 * np.arange(n_targets), n)
    columns: dict[str, object] = {"carrier": ["tool"] * len(x), "t": np.repeat(4.0 * np.arange(n), n_targets)}
    columns |= {"x": x, "y": 0.0 * x, "z": 0.0 * x, "tx": offset, "mx": x + offset, "temp_frame": reading}
    (note,) = notes_of(observations_from_columns(columns), "temp_frame scatters")
    assert 0.1 < float(note.split("scatters by ")[1].split()[0]) < 0.2


@pytest.mark.parametrize(("n_passes", "n_rows"), [(20, 11), (12, 7), (4, 9), (6, 11)])
def test_a_thermometer_that_is_noted_once_a_pass_does_not_scatter(n_passes: int, n_rows: int) -> None:
    rng = np.random.default_rng(6)
    of_pass = 20.0 + np.linspace(0.0, 2.0, n_passes) + 0.1 * rng.normal(size=n_passes)
    n = n_passes * n_rows
    place = np.tile(np.linspace(0.0, 300.0, n_rows), n_passes)
    columns: dict[str, object] = {"carrier": ["relative"] * n, "repeat": np.repeat(np.arange(n_passes), n_rows)}
    columns |= {"x": place, "y": 0.0 * place, "z": 0.0 * place, "mx": place, "temp_bed": np.repeat(of_pass, n_rows)}
    assert not notes_of(observations_from_columns(columns), "scatters")


def test_a_heater_that_is_switched_does_not_scatter() -> None:
    """Steps between set points are no scatter of a sensor, nor a curve, nor readings that are held for some rows."""
    switched = np.repeat([60.0, 62.0, 60.0, 61.0], 16)
    assert not notes_of(table(temp_bed=switched), "scatters")
    few_rows = 60.0 - 30.0 * np.exp(-np.linspace(0.0, 6.0, 64))
    assert not notes_of(table(temp_bed=few_rows), "scatters")
    held = np.repeat(np.linspace(60.0, 62.0, 16), 4)
    assert not notes_of(table(temp_bed=held), "scatters")


@pytest.mark.parametrize(("sign", "is_told"), [(1, False), (-1, True)])
def test_a_direction_whose_sign_is_exchanged_is_told(sign: int, is_told: bool) -> None:
    """Play of 8 µm was −8 ± 0.2, and would have been doubled."""
    place = np.tile(np.concatenate([np.linspace(0.0, 300.0, 11), np.linspace(300.0, 0.0, 11)]), 5)
    way = np.tile(np.repeat([1, -1], 11), 5)
    columns: dict[str, object] = {"carrier": ["relative"] * 110, "repeat": np.repeat(np.arange(5), 22)}
    columns |= {"x": place, "y": np.zeros(110), "z": np.zeros(110), "mx": place - 0.004 * way, "dir_x": sign * way}
    assert bool(notes_of(observations_from_columns(columns), "its sign is exchanged")) is is_told
    one_sided = observations_from_columns(columns | {"dir_x": np.full(110, sign)})
    assert not notes_of(one_sided, "its sign is exchanged")


def test_a_coarse_dial_that_is_read_from_both_sides_counts_once() -> None:
    """Within a repeat its rows there and back are alike, digit for digit, and came from either side."""
    place = np.tile(np.concatenate([np.arange(0.0, 300.0, 30.0), np.arange(270.0, -30.0, -30.0)]), 3)
    columns: dict[str, object] = {
        "carrier": ["relative"] * 60,
        "line": ["x"] * 60,
        "repeat": np.repeat([0, 1, 2], 20),
    }
    columns |= {"x": place, "y": np.zeros(60), "z": np.zeros(60), "mx": place + 0.01 * np.round(place / 100.0)}
    assert not notes_of(observations_from_columns(columns), "digit for digit")
    stated = {"dir_x": np.tile(np.repeat([1, -1], 10), 3)}
    assert not notes_of(observations_from_columns(columns | stated), "digit for digit")
    whole = observations_from_columns(columns)
    assert notes_of(Observations(pl.concat([whole.frame, whole.frame])), "digit for digit")
