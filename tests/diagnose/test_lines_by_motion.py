"""A reading belongs to the line along which the machine moved to it, whatever else lies in its place."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.diagnose.straight_lines import StraightLine, straight_lines
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (400.0, 400.0, 400.0))
SHARE = np.linspace(0.0, 1.0, 9)
N_RUNS = 3

Run = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def run(start: tuple[float, ...], end: tuple[float, ...], resting: tuple[int, ...] = (0, 0, 0)) -> Run:
    """Run a line three times there and back: run number, places, directions, deviation along it in µm.

    Forwards deviations are 10 µm times the sine of 3 times the share, backwards 3 µm less; the run adds its number.
    """
    way = np.subtract(end, start)
    share = np.tile(np.concatenate([SHARE, SHARE[::-1]]), N_RUNS)
    sense = np.tile(np.repeat([1.0, -1.0], 9), N_RUNS)
    number = np.repeat(np.arange(N_RUNS, dtype=np.float64), 18)
    direction = np.where(way != 0.0, np.sign(way) * sense[:, None], np.array(resting))
    deviation = 10.0 * np.sin(3.0 * share) + 1.5 * sense + number
    return number, start + share[:, None] * way, direction, deviation


def one_after_another(*lines: Run, has_repeat: bool = True) -> Observations:
    number, q, direction, deviation = (np.concatenate(own) for own in zip(*lines, strict=True))
    units = np.concatenate(
        [np.tile((own[8] - own[0]) / np.linalg.norm(own[8] - own[0]), (54, 1)) for _, own, *_ in lines]
    )
    seen = q + 1e-3 * deviation[:, None] * units
    columns = dict(zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([q, seen]).T, strict=True))
    columns |= {f"dir_{axis}": direction[:, place] for place, axis in enumerate("xyz")}
    if has_repeat:
        columns["repeat"] = number
    return observations_from_columns(columns | {"carrier": ["relative"] * len(q)})


def is_as_run(line: StraightLine, of: Run) -> None:
    """Hold a line's readings against those of its run; where the frame stands means nothing."""
    _, q, _, deviation = of
    is_reversed = np.linalg.norm(q[8] - line.end_mm) > np.linalg.norm(q[8] - line.start_mm)
    assert len(line.deviation_um) == len(deviation)
    np.testing.assert_allclose(line.position_mm, np.linalg.norm(q - line.start_mm, axis=1), atol=1e-9)
    turned = -deviation if is_reversed else deviation
    off = line.deviation_um - turned
    # A frame that is free turns by what two lines differ; along a line that is of second order.
    np.testing.assert_allclose(off, off.mean(), atol=0.05)


@pytest.mark.parametrize("has_repeat", [True, False])
def test_a_line_that_crosses_is_no_run_of_the_other(has_repeat: bool) -> None:
    """X and then Y through (0, 0, 0), whose rows go on to say that X last went backwards."""
    along_x = run((0, 0, 0), (400, 0, 0))
    along_y = run((0, 0, 0), (0, 400, 0), resting=(-1, 0, 0))
    found = straight_lines(MACHINE, one_after_another(along_x, along_y, has_repeat=has_repeat))
    assert [line.moving for line in found] == ["x", "y"]
    is_as_run(found[0], along_x)
    is_as_run(found[1], along_y)


def test_lines_that_share_a_name_are_told_apart_by_what_moved() -> None:
    """Two diagonals and X, one after another, none with a name."""
    lines = (run((0, 0, 0), (400, 400, 400)), run((400, 0, 0), (0, 400, 400)), run((0, 200, 200), (400, 200, 200)))
    found = straight_lines(MACHINE, one_after_another(*lines))
    assert [line.moving for line in found] == ["xyz", "xyz", "x"]
    for line, of in zip(found, lines, strict=True):
        is_as_run(line, of)


def test_a_grid_has_lines_along_the_axis_that_moved() -> None:
    """Rows of X one beside the other, to and fro: Y only steps from one to the next, and is not run."""
    x = np.linspace(0.0, 400.0, 6)
    q = np.vstack([np.column_stack([x[:: 1 - 2 * (n % 2)], np.full(6, 80.0 * n), np.zeros(6)]) for n in range(5)])
    columns = dict(zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([q, q]).T, strict=True))
    found = straight_lines(MACHINE, observations_from_columns(columns | {"carrier": ["relative"] * 30}))
    assert [(line.moving, float(line.start_mm[1]), len(line.position_mm)) for line in found] == [
        ("x", 80.0 * n, 6) for n in range(5)
    ]
