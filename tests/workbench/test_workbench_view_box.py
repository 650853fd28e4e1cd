"""A box over the volume as it is seen: what lies in it on the screen is marked, whatever turned and projected it."""

from __future__ import annotations

import numpy as np
import pytest
from workbench_scenes import LENGTH_MM, loaded, texts

from geoerr.workbench import marking
from geoerr.workbench.session import Session

# An eye outside the volume, what it looks at, and half of what it sees upwards and sideways at the distance 1.
EYE_MM, TARGET_MM = np.array([500.0, -700.0, 400.0]), np.array([150.0, 160.0, 120.0])
HALF_UP, HALF_RIGHT = 0.3, 0.45


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Give a session with the scene, compared."""
    return loaded(tmp_path_factory.mktemp("scene"))


def _directions(eye_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give the unit vectors ahead of an eye, to its right and upwards."""
    ahead = (TARGET_MM - eye_mm) / np.linalg.norm(TARGET_MM - eye_mm)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return ahead, right, np.cross(right, ahead)


def _to_clip(eye_mm: np.ndarray) -> list[list[float]]:
    """Give the matrix of a pinhole at the eye: right, up, depth as it comes, and the distance ahead."""
    ahead, right, up = _directions(eye_mm)
    rows = [right / HALF_RIGHT, up / HALF_UP, ahead, ahead]
    return [[*row.tolist(), float(-row @ eye_mm)] for row in rows]


def _seen_at(places_mm: np.ndarray, eye_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give, row by row, how far ahead a place is and under which tangents it is seen."""
    found = []
    for place in places_mm:
        ahead, right, up = (float(axis @ (place - eye_mm)) for axis in _directions(eye_mm))
        found.append((ahead, right / ahead, up / ahead))
    ahead_mm, to_the_right, upwards = np.array(found).T
    return ahead_mm, to_the_right, upwards


def test_what_is_seen_in_a_box_is_marked_in_front_and_behind_and_in_both_pictures(session: Session) -> None:
    places_mm = session.seen.comparison.points.sightings.commanded_mm
    _, to_the_right, upwards = _seen_at(places_mm, EYE_MM)
    told = {"to_clip": _to_clip(EYE_MM), "right": [-0.1, 0.6], "up": [-0.5, 0.2]}

    words = marking.mark(session, "view-box", told)

    in_box = (np.abs(to_the_right / HALF_RIGHT - 0.25) < 0.35) & (np.abs(upwards / HALF_UP + 0.15) < 0.35)
    assert 0 < in_box.sum() < len(in_box)
    np.testing.assert_array_equal(session.selected, in_box)
    assert f"{in_box.sum()} rows marked" in texts(words)
    assert marking.mark_volume(session).to_plotly_json()["operations"]
    drawn = marking.mark_residual(session).to_plotly_json()["operations"]
    assert any(one["location"][-1] == "selectedpoints" and one["params"]["value"] for one in drawn)


def test_what_is_behind_the_eye_is_not_seen(session: Session) -> None:
    # In the middle of the volume, with half of it behind.
    eye_mm = np.full(3, 0.5 * LENGTH_MM) + np.array([0.3, 0.2, 0.1])
    everything = {"to_clip": _to_clip(eye_mm), "right": [-1e9, 1e9], "up": [-1e9, 1e9]}

    marking.mark(session, "view-box", everything)

    ahead_mm, _, _ = _seen_at(session.seen.comparison.points.sightings.commanded_mm, eye_mm)
    assert 0 < (ahead_mm > 0.0).sum() < len(ahead_mm)
    np.testing.assert_array_equal(session.selected, ahead_mm > 0.0)


def test_a_box_beside_the_volume_marks_nothing(session: Session) -> None:
    marking.mark(session, "view-box", {"to_clip": _to_clip(EYE_MM), "right": [5.0, 6.0], "up": [-1.0, 1.0]})

    assert session.selected is None
