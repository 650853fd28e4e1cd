"""A marker on two plates: where a picture shows one of them, what is commanded and stated says which, or nobody."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from rendering import marker_plate, turned
from stereo_scenes import TARGETS, make_session, photograph, plates_at, rig, rig_covariance

from geoerr.errors import InputFileError
from geoerr.machine import Machine
from geoerr.vision.copies import judge_copies
from geoerr.vision.images import write_png
from geoerr.vision.measure import measure
from geoerr.vision.patterns import marker_bits
from geoerr.vision.plate_rows import PlateRows
from geoerr.vision.session import Session, Target, read_session

NAME = f"{TARGETS[0]['dictionary']}:{TARGETS[0]['id']}"
COPY_MM = np.array([0.0, 95.0, 690.0])


def copy_of_the_first():
    bits = marker_bits(TARGETS[0]["dictionary"], TARGETS[0]["id"])
    return marker_plate(bits, TARGETS[0]["size_mm"], turned(3.0, -8.0, 2.0), COPY_MM)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """Of five frames the fourth shows the first target and its copy, the second the copy alone."""
    folder = tmp_path / "session"
    make_session(folder)
    for step, is_hidden in ((1, True), (3, False)):
        plates, _ = plates_at(step)
        shown = [*plates[int(is_hidden) :], copy_of_the_first()]
        for side, picture in zip(("left", "right"), photograph(shown, np.random.default_rng(step)), strict=True):
            write_png(folder / side / f"{step}.png", picture)
    return folder


def test_a_copy_that_is_seen_alone_is_not_taken_for_the_target(session: Path) -> None:
    """Its place was an observation like any other, 150 mm from the target."""
    measured = measure(read_session(session), rig(rig_covariance()))
    frame = measured.observations.frame
    assert frame.filter(pl.col("target") == NAME)["x"].to_list() == [0.0, 24.0, 48.0]
    assert [(item.frame, item.target, item.why) for item in measured.missed] == [
        (
            "left/1.png",
            NAME,
            "row 5 of frames.csv shows it more than once, and which of them this is cannot be known",
        ),
        ("left/3.png", NAME, "seen more than once in one picture: which one is meant cannot be known"),
    ]
    assert measured.notes[0] == (
        f"target {NAME} is seen more than once in 1 frame, the first in row 5 of frames.csv; of 4 frames that "
        "show it once 1 left out: give every plate a marker of its own"
    )


def test_where_nothing_is_left_it_says_what_to_do(session: Path) -> None:
    """Commanded to stand still, no sighting can be told from another."""
    frames = pl.read_csv(session / "frames.csv")
    frames.with_columns(x=pl.lit(0.0)).write_csv(session / "frames.csv")
    text = (session / "session.toml").read_text()
    (session / "session.toml").write_text("[[targets]]" + text.split("[[targets]]")[1])
    with pytest.raises(InputFileError, match="none of its 5 frames can be used") as caught:
        measure(read_session(session), rig(rig_covariance()))
    assert "print another id" in str(caught.value.remedy)


GANTRY = Machine.from_chain("wbXYZt", (300.0, 300.0, 300.0))
TURN = turned(20.0, -35.0, 50.0)
LINES = np.concatenate([np.outer(np.linspace(0.0, 300.0, 7), axis) for axis in np.eye(3)])
PLATES = tuple(
    Target(number, "DICT_4X4_50", 54.0, "tool", offset)
    for number, offset in enumerate([(0.0, 0.0, 0.0), (200.0, 0.0, 0.0), (0.0, 200.0, 0.0), (0.0, 0.0, 200.0)])
)


def places(target: Target, q_mm: np.ndarray, off_mm: float = 0.0) -> np.ndarray:
    """Where a plate on the tool of a gantry is seen, glued on a little off its offset."""
    return (np.array(target.offset_mm) + off_mm + q_mm) @ TURN.T + np.array([50.0, -20.0, 900.0])


def judged(
    seen: dict[int, np.ndarray],
    targets: tuple[Target, ...] = PLATES,
    machine: Machine | None = GANTRY,
    of: int = 1,
) -> tuple[list[bool], list[str]]:
    """Which sightings of a target are left out, and why; NaN where it is not seen once."""
    numbers = sorted(seen)
    row = np.concatenate([np.flatnonzero(np.isfinite(seen[n]).all(axis=1)) for n in numbers])
    target = np.concatenate([np.full(int(np.isfinite(seen[n]).all(axis=1).sum()), n) for n in numbers])
    centre = np.concatenate([seen[n][np.isfinite(seen[n]).all(axis=1)] for n in numbers])
    blank = {item.name: np.zeros(len(row)) for item in fields(PlateRows)}
    rows = PlateRows(**{**blank, "row": row, "target": target, "centre_mm": centre})
    frames = pl.DataFrame({"x": LINES[:, 0], "y": LINES[:, 1], "z": LINES[:, 2]}).with_row_index("file_row", offset=2)
    session = Session(Path(), machine, None, targets, frames, (), (), (), ())
    twice = [(int(number), of) for number in np.flatnonzero(~np.isfinite(seen[of]).all(axis=1))]
    why = judge_copies(session, rows, np.ones(len(row), dtype=bool), twice).why
    assert not any(why[target != of])
    return [bool(reason) for reason in why[target == of]], [reason for reason in why if reason]


def without(place: np.ndarray, every: int) -> np.ndarray:
    """Sightings of which every so many are of two plates."""
    return np.where(np.arange(len(place))[:, None] % every == 1, np.nan, place)


def others(*numbers: int) -> dict[int, np.ndarray]:
    # Plates sit some millimetres off what is stated.
    return {number: places(PLATES[number], LINES, 4.0 * number) for number in numbers}


@pytest.mark.parametrize("machine", [GANTRY, None])
def test_other_targets_say_where_one_is(machine: Machine | None) -> None:
    own = places(PLATES[1], LINES, 3.0)
    assert not any(judged({**others(0, 2, 3), 1: without(own, 2)}, machine=machine)[0])
    # One that lies about, and one on the same carrier 60 mm beside: neither is where the target is.
    for other in (np.tile(own[0], (len(LINES), 1)) + 100.0, own + TURN @ np.array([0.0, 0.0, 60.0])):
        left_out, why = judged({**others(0, 2, 3), 1: without(other, 2)}, machine=machine)
        assert all(left_out)
        assert "from where offset_mm and the other targets say that it is" in why[0]
        mixed = np.where(np.arange(len(own))[:, None] % 3 == 0, other, own)
        left_out, _ = judged({**others(0, 2, 3), 1: without(mixed, 2)}, machine=machine)
        assert left_out == [number % 3 == 0 for number in range(len(own)) if number % 2 != 1]


@pytest.mark.parametrize("machine", [GANTRY, None])
def test_a_target_alone_on_its_carrier_moves_as_it(machine: Machine | None) -> None:
    own = places(PLATES[1], LINES)
    still = np.tile(own[0], (len(LINES), 1)) + 100.0
    assert not any(judged({1: without(own, 2)}, machine=machine)[0])
    left_out, why = judged({1: without(still, 2)}, machine=machine)
    assert all(left_out)
    assert "which of them this is cannot be known" in why[0]
    mixed = np.where(np.arange(len(own))[:, None] % 4 == 0, still, own)
    left_out, _ = judged({1: without(mixed, 3)}, machine=machine)
    assert left_out == [number % 4 == 0 for number in range(len(own)) if number % 3 != 1]
    # Two that move alike: nobody can tell.
    beside = np.where(np.arange(len(own))[:, None] % 4 == 0, own + 60.0, own)
    assert all(judged({1: without(beside, 3)}, machine=machine)[0])


def test_a_plate_on_the_base_stands_still() -> None:
    on_base = (replace(PLATES[0], carrier="base"), replace(PLATES[1], carrier="base"))
    own = places(PLATES[1], LINES)
    still = np.tile(own[0], (len(LINES), 1))
    assert not any(judged({0: still + 300.0, 1: without(still, 2)}, on_base)[0])
    assert all(judged({0: still + 300.0, 1: without(own, 2)}, on_base)[0])


def test_a_plate_on_the_work_moves_the_other_way() -> None:
    machine = Machine.from_chain("wYXbZt", (300.0, 300.0, 300.0))
    targets = tuple(replace(item, carrier="work") for item in PLATES)
    moved = -LINES * [1.0, 1.0, 0.0]
    seen = {number: places(PLATES[number], moved, 4.0 * number) for number in (0, 2, 3)}
    assert not any(judged({**seen, 1: without(places(PLATES[1], moved), 2)}, targets, machine)[0])
    left_out, _ = judged({**seen, 1: without(places(PLATES[1], LINES), 2)}, targets, machine)
    assert sum(left_out) > len(left_out) // 2
