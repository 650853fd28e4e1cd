"""Passes of rows against their definition, read row by row: one session, line, repeat and direction."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geoerr.fit import sightings_of
from geoerr.observations import observations_from_columns

Row = tuple[str, str, int, tuple[int, int, int], tuple[int, int, int]]

_THREE = st.tuples(*[st.integers(0, 2)] * 3)
_ROWS = st.lists(
    st.tuples(
        st.sampled_from("ab"), st.sampled_from("LM"), st.integers(0, 1), _THREE, st.tuples(*[st.integers(-1, 1)] * 3)
    ),
    min_size=1,
    max_size=14,
)


def _travel(line: list[Row], at: int, axis: int) -> int:
    """Direction of the step towards a row, at first of the next; at rest as before, or as next if the row says so."""
    steps = [int(np.sign(b[3][axis] - a[3][axis])) for a, b in pairwise(line)]
    said = line[at][4][axis]
    if not any(steps):
        return said
    before = next((one for one in reversed(steps[:at]) if one), next(one for one in steps if one))
    after = next((one for one in steps[at:] if one), next(one for one in reversed(steps) if one))
    return after if at > 0 and steps[at - 1] == 0 and said == after else before


def _place(rows: list[Row], row: Row) -> tuple[object, ...]:
    """Session, line and repeat; without the column that leaves every row alone."""
    for fields in ((0, 1, 2), (0, 2), (0, 1)):
        places = [tuple(one[field] for field in fields) for one in rows]
        if len(set(places)) < len(rows):
            return tuple(row[field] for field in fields)
    return row[:1]


def _by_definition(rows: list[Row]) -> list[Any]:
    """What makes each row's pass."""
    found = []
    places = [_place(rows, row) for row in rows]
    for number, place in enumerate(places):
        line = [one for one, other in zip(rows, places, strict=True) if other == place]
        at = places[:number].count(place)
        moves = [len({one[3][axis] for one in line}) > 1 for axis in range(3)]
        found.append((place, *(_travel(line, at, axis) if moves[axis] else 0 for axis in range(3))))
    return found


@given(_ROWS)
def test_a_pass_is_one_session_line_repeat_and_direction(rows: list[Row]) -> None:
    rows = sorted(rows, key=lambda row: row[0])
    columns: dict[str, Any] = {
        "session": [row[0] for row in rows],
        "line": [row[1] for row in rows],
        "repeat": [float(row[2]) for row in rows],
    }
    for axis, name in enumerate("xyz"):
        columns[name] = [float(row[3][axis]) for row in rows]
        columns[f"m{name}"] = [0.0] * len(rows)
        columns[f"dir_{name}"] = [row[4][axis] for row in rows]
    seen = sightings_of(observations_from_columns(columns))
    expected = _by_definition(rows)
    of_line = [(row[:3], one) for row, one in zip(rows, seen.pass_number.tolist(), strict=True)]
    for (place, number), own in zip(of_line, expected, strict=True):
        same = [other for (_, other), one in zip(of_line, expected, strict=True) if one == own]
        assert set(same) == {number}, place
    assert len(set(seen.pass_number.tolist())) == len(set(expected)) == seen.n_passes


def test_rows_that_all_have_a_repeat_or_a_line_of_their_own_are_no_passes_of_one_row() -> None:
    place = {name: np.zeros(8) for name in ("y", "z", "my", "mz")} | {"x": np.zeros(8), "mx": np.zeros(8)}
    rounds = {"repeat": [0.0] * 4 + [1.0] * 4, "line": list("abcdefgh")}
    for columns, n_passes in (
        ({"repeat": np.arange(8.0)}, 1),
        ({"line": list("abcdefgh")}, 1),
        # Every point a line of its own, in two rounds.
        (rounds, 2),
        ({"repeat": [0.0] * 4 + [1.0] * 4}, 2),
    ):
        assert sightings_of(observations_from_columns(place | columns)).n_passes == n_passes
