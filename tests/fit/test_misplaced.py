"""Targets that stand elsewhere than their offsets say are told: exchanged plates passed as "scatter 12.9 times"."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.fit.joined import sightings_of, within_the_machine
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wbXYZt", (300.0, 300.0, 300.0))
OFFSETS_MM = np.array([[50.0, 0.0, 0.0], [0.0, 80.0, 0.0], [-70.0, -60.0, 20.0]])


def seen(stated_mm: np.ndarray, *, lines: bool = False, seed: int = 3) -> Observations:
    """Three targets on the tool, seen by cameras that stand askew; `stated_mm` (3, 3) is what the file says."""
    rng = np.random.default_rng(seed)
    q_mm = rng.uniform(0.0, 300.0, (8, 3))
    if lines:
        # Along one axis motion does not tell how the cameras are turned about it.
        q_mm[:, 1:] = 150.0
    askew, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    askew *= np.sign(np.linalg.det(askew))
    n = len(q_mm) * len(OFFSETS_MM)
    places = np.repeat(q_mm, 3, axis=0)
    measured = (places + np.tile(OFFSETS_MM, (len(q_mm), 1))) @ askew.T + [10.0, -40.0, 900.0]
    measured += rng.normal(0.0, 0.01, measured.shape)
    offset = np.tile(stated_mm, (len(q_mm), 1))
    columns = {"carrier": ["tool"] * n, "target": ["a", "b", "c"] * len(q_mm)}
    for number, axis in enumerate("xyz"):
        columns |= {axis: places[:, number], f"t{axis}": offset[:, number], f"m{axis}": measured[:, number]}
    return observations_from_columns(columns)


def told(rows: Observations) -> list[str]:
    return [note for note in within_the_machine(sightings_of(rows), MACHINE).notes if "exchanged" in note]


@pytest.mark.parametrize(
    "stated", [OFFSETS_MM[[1, 0, 2]], OFFSETS_MM * [[1.0], [-1.0], [1.0]], OFFSETS_MM[:, [1, 0, 2]], OFFSETS_MM / 1e3]
)
def test_exchanged_mirrored_and_small_offsets_are_told(stated: np.ndarray) -> None:
    (note,) = told(seen(stated))
    assert "an offset of another sign, order or unit" in note


def test_exchanged_targets_are_told_with_how_far_they_are_off() -> None:
    (note,) = told(seen(OFFSETS_MM[[1, 0, 2]]))
    off_mm = 2.0 * np.linalg.norm(OFFSETS_MM[0] - OFFSETS_MM[1])
    assert f"is seen {off_mm:.0f} mm from there" in note


def test_plates_that_are_glued_on_askew_are_not_told() -> None:
    assert not told(seen(OFFSETS_MM))
    assert not told(seen(OFFSETS_MM + np.array([[0.0, 3.0, 0.0], [2.0, -4.0, 5.0], [0.0, 0.0, -6.0]])))


def test_motion_along_one_line_tells_no_turn() -> None:
    assert not told(seen(OFFSETS_MM[[1, 0, 2]], lines=True))
