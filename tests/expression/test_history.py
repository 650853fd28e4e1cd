"""What follows from the order of rows, against a second implementation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from geoerr import _core
from geoerr.errors import ShapeError

Array = npt.NDArray[np.float64]
ONE_SEQUENCE = np.zeros(1, dtype=np.int64)


def by_numpy(q: Array, t: Array) -> dict[str, Array]:
    """Direction, travel, time since the reversal and mean speed of one axis, from its strokes as slices."""
    n = q.size
    d, s, t_rev = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    moves = np.flatnonzero(np.diff(q))
    signs = np.sign(np.diff(q)[moves])
    # The rows from which strokes begin: before the first move, and before every move that turns.
    begins = moves[np.flatnonzero(np.append(1.0, signs[1:] * signs[:-1] * -1.0) > 0.0)] if moves.size else moves
    for number, begin in enumerate(begins):
        end = begins[number + 1] + 1 if number + 1 < begins.size else n
        rows = slice(begin + 1, end)
        d[rows] = np.sign(q[begin + 1] - q[begin])
        s[rows] = np.abs(q[rows] - q[begin])
        t_rev[rows] = t[rows] - t[begin]
    mean_v = np.append(0.0, np.diff(q) / np.diff(t))
    return {"d": d, "s": s, "t_rev": t_rev, "mean_v": mean_v}


@pytest.mark.parametrize("seed", range(20))
def test_strokes_as_slices(seed: int) -> None:
    random = np.random.default_rng(seed)
    q = np.cumsum(random.integers(-2, 3, (200, 3)) * 2.5, axis=0)
    t = np.cumsum(random.exponential(2.0, 200))
    starts = np.array([0, 60, 61, 150])
    found = _core.history(q, t, None, None, None, starts)
    for axis, letter in enumerate("xyz"):
        for first, last in zip(starts, [*starts[1:], 200], strict=True):
            expected = by_numpy(q[first:last, axis], t[first:last])
            for name, values in expected.items():
                got = found[f"{name}_{letter}"][first:last]
                np.testing.assert_allclose(got, values, rtol=1e-12, atol=1e-9, err_msg=f"{name}_{letter}")
    assert set(found) == {f"{name}_{axis}" for name in ("d", "s", "t_rev", "v", "a", "mean_v") for axis in "xyz"}


def test_a_circle_at_its_feed() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 91)
    q = np.column_stack([212.0 + 100.0 * np.cos(angle), 270.0 + 100.0 * np.sin(angle), np.zeros(91)])
    feed, on = np.full(91, 1500.0), np.ones(91)
    found = _core.history(q, None, None, feed, None, ONE_SEQUENCE, curve=on)
    # The chords of 7 mm between positions of 400 mm lose 2 digits in 16, squared in the curvature.
    np.testing.assert_allclose(found["v_x"], -25.0 * np.sin(angle), atol=1e-9)
    np.testing.assert_allclose(found["v_y"], 25.0 * np.cos(angle), atol=1e-9)
    np.testing.assert_allclose(found["a_x"], -6.25 * np.cos(angle), atol=1e-8)
    np.testing.assert_allclose(found["a_y"], -6.25 * np.sin(angle), atol=1e-8)


def test_a_circle_told_as_straight_moves_leans_by_half_a_step() -> None:
    """Why curves are told as such: the chord to a row is half a step behind the tangent at it."""
    angle = np.linspace(0.0, 2.0 * np.pi, 91)
    q = np.column_stack([100.0 * np.cos(angle), 100.0 * np.sin(angle), np.zeros(91)])
    found = _core.history(q, None, np.ones(91), np.full(91, 1500.0), None, ONE_SEQUENCE)
    behind = angle[1:] - np.pi / 90.0
    np.testing.assert_allclose(found["v_x"][1:], -25.0 * np.sin(behind), atol=1e-9)


def test_wrong_lengths_are_refused() -> None:
    q = np.zeros((4, 3))
    with pytest.raises(ShapeError, match="`feed` has 3 entries for 4 rows"):
        _core.history(q, None, None, np.zeros(3), None, ONE_SEQUENCE)
    with pytest.raises(ShapeError, match="start 0 is row 1"):
        _core.history(q, None, None, None, None, np.ones(1, dtype=np.int64))
    with pytest.raises(ShapeError, match=r"q_mm must be a C-contiguous \(n, 3\)"):
        _core.history(np.zeros((3, 4)), None, None, None, None, ONE_SEQUENCE)
