"""What the fit derives of its rows for the effects' formulas."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from geoerr.effects import catalogue
from geoerr.errors import InputFileError
from geoerr.fit.additions import refuse_wanting
from geoerr.fit.columns import unread_columns
from geoerr.fit.joined import sightings_of
from geoerr.fit.variables import clock_span_s, variable_columns
from geoerr.observations import CircularTest, Observations
from geoerr.terms import CLOCK_NAME, HISTORY_NAMES, PLACE_NAMES, RAW_VARIABLES

RADIUS_MM, FEED_MM_MIN = 100.0, 3000.0
CENTRE_MM = (212.0, 270.0)


@pytest.mark.parametrize("n_points", [36, 360])
def test_speed_and_acceleration_of_a_circular_test(n_points: int) -> None:
    """Both senses at a constant feed: along the tangent, and v²/R towards the centre, however far apart rows are."""
    angle = np.linspace(0.0, 2.0 * np.pi, n_points + 1)
    tables = []
    for sense in (1, -1):
        turn = sense * angle
        tables.append(
            pl.DataFrame(
                {
                    "line": "ccw" if sense > 0 else "cw",
                    "x": CENTRE_MM[0] + RADIUS_MM * np.cos(turn),
                    "y": CENTRE_MM[1] + RADIUS_MM * np.sin(turn),
                    "z": 0.0,
                    "r": RADIUS_MM,
                    "dir": sense,
                    "feed": FEED_MM_MIN,
                }
            )
        )
    sightings = sightings_of(CircularTest(pl.concat(tables)))
    v_x, v_y, a_x, a_y, d_x = variable_columns(sightings, ["v_x", "v_y", "a_x", "a_y", "d_x"])
    v = FEED_MM_MIN / 60.0
    for run, sense in enumerate((1, -1)):
        rows = np.flatnonzero(sightings.session == run)
        cos, sin = np.cos(sense * angle), np.sin(sense * angle)
        # A circle through three rows on a circle is that circle: round-off alone.
        assert np.allclose(v_x[rows], -sense * v * sin, rtol=0.0, atol=1e-8 * v)
        assert np.allclose(v_y[rows], sense * v * cos, rtol=0.0, atol=1e-8 * v)
        assert np.allclose(a_x[rows], -(v**2) / RADIUS_MM * cos, rtol=0.0, atol=1e-8 * v**2)
        assert np.allclose(a_y[rows], -(v**2) / RADIUS_MM * sin, rtol=0.0, atol=1e-8 * v**2)
        moves = np.abs(sin) > 1e-6
        assert (d_x[rows][moves] == np.sign(-sense * sin[moves])).all()


def test_the_clock_lays_sessions_end_to_end() -> None:
    """As `t` in the first session; a moment of one session is at no other session's moment."""
    table = pl.DataFrame(
        {
            "session": ["a"] * 3 + ["b"] * 3 + ["c"] * 2,
            "carrier": "tool",
            "line": "X",
            "repeat": 0,
            "tx": 0.0,
            "ty": 0.0,
            "tz": 0.0,
            "x": np.arange(8.0),
            "y": 0.0,
            "z": 0.0,
            "mx": np.arange(8.0),
            "my": 0.0,
            "mz": 0.0,
            "t": [2.0, 5.0, 9.0, 0.0, 4.0, 4.5, 100.0, 101.0],
        }
    )
    sightings = sightings_of(Observations(table))
    (clock,) = variable_columns(sightings, ["clock"])
    assert clock.tolist() == [2.0, 5.0, 9.0, 9.0, 13.0, 13.5, 13.5, 14.5]
    assert clock_span_s(sightings) == (2.0, 14.5)
    # Without times the rows themselves count.
    (rows,) = variable_columns(sightings_of(Observations(table.drop("t"))), ["clock"])
    assert rows.tolist() == [0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 4.0, 5.0]
    assert clock_span_s(sightings_of(Observations(table[:1]))) is None


def rows(**columns: object) -> pl.DataFrame:
    place = {"session": "0", "carrier": "tool", "line": "X", "target": "", "repeat": 0, "moving": 0}
    zero = dict.fromkeys(("tx", "ty", "tz", "y", "z", "mx", "my", "mz"), 0.0)
    return pl.DataFrame({**place, **zero, **columns})


def test_a_direction_that_is_stated_as_unknown_is_not_guessed() -> None:
    """0 in the file is unknown, and so are travel and time since the reversal; a column that is absent is derived."""
    table = rows(x=[0.0, 10.0, 20.0, 10.0], t=[0.0, 1.0, 2.0, 3.0])
    names = ["d_x", "s_x", "t_rev_x"]
    derived = variable_columns(sightings_of(Observations(table)), names)
    assert np.isnan(derived[0]).tolist() == [True, False, False, False]
    stated = table.with_columns(pl.Series("dir_x", [0, 0, 1, 0]))
    left = variable_columns(sightings_of(Observations(stated)), names)
    assert np.isnan(left[0]).tolist() == [True, True, False, True]
    assert np.isnan(left[1:, [1, 3]]).all()
    assert left[0, 2] == 1.0


@pytest.mark.parametrize("times", [{}, {"t": [0.0, 1.0, 2.0, 9.0, 10.0, 11.0]}])
def test_the_second_look_at_the_end_of_a_run_has_no_direction(times: dict[str, list[float]]) -> None:
    """As ISO 230-2 has it: the axis went beyond the last point in between, or it did not, and only `dir_x` tells."""
    run = rows(x=[0.0, 10.0, 20.0, 20.0, 10.0, 0.0], **times)
    (derived,) = variable_columns(sightings_of(Observations(run)), ["d_x"])
    assert np.nan_to_num(derived).tolist() == [0.0, 1.0, 1.0, 0.0, -1.0, -1.0]
    stated = run.with_columns(pl.Series("dir_x", [1, 1, 1, -1, -1, -1]))
    (known,) = variable_columns(sightings_of(Observations(stated)), ["d_x"])
    assert known.tolist() == [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]


def test_an_axis_that_stands_while_another_turns_keeps_its_direction() -> None:
    """Along y and back, at the x where it came to rest; x goes back later only, with the way to the next line."""
    x, y = [0.0, 10.0, 10.0, 10.0, 10.0, 0.0], [0.0, 0.0, 5.0, 5.0, 0.0, 0.0]
    d_x, d_y = variable_columns(sightings_of(Observations(rows(x=x, y=y))), ["d_x", "d_y"])
    assert np.nan_to_num(d_x).tolist() == [0.0, 1.0, 1.0, 1.0, 1.0, -1.0]
    assert np.nan_to_num(d_y).tolist() == [0.0, 0.0, 1.0, 0.0, -1.0, -1.0]


def test_targets_of_one_moment_and_looks_before_going_on_keep_their_direction() -> None:
    """Three targets seen at the end of a run are one look; a place that is looked at twice on the way is passed."""
    plate = rows(x=[0.0, 10.0, 10.0, 10.0, 0.0], target=["a", "a", "b", "c", "a"])
    (together,) = variable_columns(sightings_of(Observations(plate)), ["d_x"])
    assert np.nan_to_num(together).tolist() == [0.0, 1.0, 1.0, 1.0, -1.0]
    nameless = plate.with_columns(target=pl.lit(""), ty=pl.Series([0.0, 0.0, 20.0, 40.0, 0.0]))
    (apart,) = variable_columns(sightings_of(Observations(nameless)), ["d_x"])
    assert np.nan_to_num(apart).tolist() == [0.0, 1.0, 1.0, 1.0, -1.0]
    passed = rows(x=[0.0, 10.0, 10.0, 20.0], t=[0.0, 1.0, 2.0, 3.0])
    (onwards,) = variable_columns(sightings_of(Observations(passed)), ["d_x"])
    assert np.nan_to_num(onwards).tolist() == [0.0, 1.0, 1.0, 1.0]


def test_the_first_look_of_the_way_back_moves_back() -> None:
    """The last move that rows show went the other way; its direction says so, or nobody knows its speed."""
    run = rows(x=[0.0, 10.0, 20.0, 20.0, 10.0, 0.0], t=[0.0, 1.0, 2.0, 9.0, 10.0, 11.0], feed=600.0)
    run = run.with_columns(moving=pl.lit(1))
    stated = run.with_columns(pl.Series("dir_x", [1, 1, 1, -1, -1, -1]))
    v, a = variable_columns(sightings_of(Observations(stated)), ["v_x", "a_x"])
    assert v[1:].tolist() == [10.0, 10.0, -10.0, -10.0, -10.0]
    assert np.isnan(a[[3, 4]]).all()
    assert (a[2], a[5]) == (0.0, 0.0)
    (unknown,) = variable_columns(sightings_of(Observations(run)), ["v_x"])
    assert np.isnan(unknown[[0, 3]]).all()
    assert unknown[[1, 2, 4, 5]].tolist() == [10.0, 10.0, -10.0, -10.0]


def test_columns_that_have_names_of_the_formulas_own_are_said_not_to_be_read() -> None:
    table = Observations(rows(x=np.arange(4.0), d_x=1.0, t_rev_y=2.0, bed_x=3.0, clock=4.0, a_room=5.0, d_left=6.0))
    own, renamed = "is not read: the name is geoerr's own, for the", "rename it if an effect is to follow it"
    assert [note for note in sightings_of(table).notes if "not read" in note] == [
        f"the column d_x {own} direction of travel; did you mean dir_x?",
        f"the column t_rev_y {own} time since the last reversal; {renamed}",
        f"the column bed_x {own} place on the work; {renamed}",
        f"the column clock {own} time with all sessions end to end; {renamed}",
    ]
    assert {name for name in RAW_VARIABLES if [*unread_columns([name])]} == {
        *(f"{name}_{axis}" for name in HISTORY_NAMES for axis in "xyz"),
        *PLACE_NAMES,
        CLOCK_NAME,
    }


@pytest.mark.parametrize(
    ("name", "word"), [("carier", "carrier"), ("Tx", "tx"), ("Session", "session"), ("MX ", "mx")]
)
def test_a_column_that_is_nearly_one_of_ours_is_told(name: str, word: str) -> None:
    (note,) = unread_columns([name])
    assert f"did you mean {word}?" in note


@pytest.mark.parametrize("name", ["heater_bed", "bed_temp", "Temperature", "temperature_2", "temp 1", "Heater bed"])
def test_a_temperature_by_another_name_is_told_how_it_is_called(name: str) -> None:
    (note,) = unread_columns([name])
    assert f"name it temp_{name.lower().replace(' ', '_')}: effects of temperature" in note


def test_an_effect_of_temperature_names_the_columns_that_are_there() -> None:
    """Klipper calls its bed `heater_bed`: the file has a temperature, and the message said that it is wanting."""
    sightings = sightings_of(Observations(rows(x=np.arange(4.0), t=np.arange(4.0), heater_bed=np.arange(4.0))))
    effect, reference = catalogue().resolve("thermal-expansion:y@temp_bed")
    with pytest.raises(InputFileError, match="wanting: a temperature column") as caught:
        refuse_wanting(effect, reference, sightings)
    assert caught.value.remedy == (
        "columns that an effect may follow are t, heater_bed; one that holds a temperature is named temp or "
        "temp_..., as temp_bed"
    )


def test_columns_of_ones_own_are_nobodys_slip() -> None:
    assert not [
        *unread_columns(
            ["temp_bed", "temp", "load", "rpm", "humidity", "feed_rate", "r2", "line1", "attempt", "file_row"]
        )
    ]
