"""What a given set of lines cannot determine is named, with the reason; the rest is identified and right."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest
from nine_line_checks import assert_recovered, names_not_determined
from virtual_machine import (
    AXES,
    FIXTURE,
    Camera,
    Move,
    Truth,
    camera,
    draw_truth,
    li_nine_lines,
    machine_of,
    nine_lines,
    observe,
)

from geoerr.errors import GeometryError
from geoerr.identify import NineLineResult, analyze_nine_lines, identify_nine_line
from geoerr.observations import COVARIANCE, Observations, observations_from_columns

CHAIN = "wZbXYt"
MACHINE = machine_of(CHAIN)
SQUARENESS = {"EC0Y", "EB0Z", "EA0Z"}
Z_FUNCTIONS = {"EXZ", "EYZ", "EZZ", "EAZ", "EBZ", "ECZ"}


def truth_and_cameras(seed: int) -> tuple[Truth, dict[str, Camera]]:
    rng = np.random.default_rng(seed)
    return draw_truth(rng, CHAIN, follows_tangent=False), {str(number): camera(rng) for number in range(10)}


def analyzed(moves: list[Move], seed: int = 20) -> tuple[Truth, NineLineResult]:
    truth, cameras = truth_and_cameras(seed)
    return truth, analyze_nine_lines(observe(MACHINE, truth, moves, cameras), MACHINE)


def whys(result: NineLineResult) -> dict[str, str]:
    return {item.name: item.why for item in result.errors.not_determined}


def bed(moves: list[Move], targets: dict[str, tuple[float, float, float]]) -> list[Move]:
    return [replace(move, targets=targets) if move.axis == "z" else move for move in moves]


# Li's line to what its absence costs. Without line 1, 2 or 3 the two offset lines show only a sum of pitch and yaw.
COST = {
    "1": {"EBX", "ECX"},
    "2": {"EAY", "ECY"},
    "3": {"EAZ", "EBZ"},
    "4": {"EBX"},
    "5": {"ECX"},
    "6": {"EAY"},
    "7": {"ECY"},
    "8": {"EAZ"},
    "9": {"EBZ"},
}


@pytest.mark.parametrize("missing", sorted(COST))
def test_one_line_missing_is_named_by_its_number(missing: str) -> None:
    truth, result = analyzed([move for move in li_nine_lines(MACHINE) if move.line != f"line {missing}"])
    assert result.missing_lines == (int(missing),)
    assert f"of Li's nine lines the data lack {missing}" in result.errors.notes
    told = whys(result)
    if missing in "123":
        # Positioning then belongs to an offset line, and stands aside: it is not that of the carriage origin.
        axis = "XYZ"[int(missing) - 1]
        assert "own place only" in told.pop(f"E{axis}{axis}")
        assert set(result.errors.alternatives["at-line"]) == {f"E{axis}{axis}"}
    assert told.keys() == COST[missing]
    assert all(why.startswith(f"line {missing} (") for why in told.values())
    assert_recovered(truth, result.errors)


def test_camera_moved_between_tool_lines_and_bed_lines() -> None:
    """S_xz and S_yz are lost. The bed's own frame comes from its targets' offsets."""
    for lines in (nine_lines, li_nine_lines):
        moves = [replace(move, session="1") if move.axis == "z" else move for move in lines(MACHINE)]
        truth, result = analyzed(moves)
        assert names_not_determined(result.errors) == {"EB0Z", "EA0Z"}
        assert whys(result)["EB0Z"] == "no session holds lines along both X and Z: the camera was moved between them"
        assert_recovered(truth, result.errors)


def test_camera_moved_for_every_line() -> None:
    """Every S and the linear part of every roll are lost.

    The direct straightness is lost with them here: a session that shows one target on one line tells nothing of how
    its frame is turned about that line. The integrated one stays.
    """
    moves = [replace(move, session=str(number)) for number, move in enumerate(li_nine_lines(MACHINE))]
    truth, result = analyzed(moves)
    straightness = {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}
    assert names_not_determined(result.errors) == SQUARENESS | {"EAX", "EBY", "ECZ"} | straightness
    assert set(result.errors.alternatives["straightness-integrated"]) == straightness
    assert all("integrated from the angle" in whys(result)[name] for name in straightness)
    assert_recovered(truth, result.errors)


def test_offset_lines_in_sessions_of_their_own_lose_the_linear_part_of_roll() -> None:
    """Lines 1 to 3 share a session; each offset line comes with another two base lines, so its frame is known."""
    moves = li_nine_lines(MACHINE)
    base = [move for move in moves if move.line in ("line 1", "line 2", "line 3")]
    again = []
    for number, move in enumerate((move for move in moves if move not in base), start=1):
        session = str(number)
        again += [replace(other, session=session) for other in base if other.axis != move.axis]
        again.append(replace(move, session=session))
    truth, result = analyzed(base + again)
    assert names_not_determined(result.errors) == {"EAX", "EBY", "ECZ"}
    assert "its linear part is lost" in whys(result)["EAX"]
    assert_recovered(truth, result.errors)


def test_camera_moved_for_every_axis_with_three_targets_in_view() -> None:
    """Every S is lost; with all targets of an axis in one session its roll is whole."""
    moves = [replace(move, session=str(number)) for number, move in enumerate(nine_lines(MACHINE))]
    truth, result = analyzed(moves)
    assert names_not_determined(result.errors) == SQUARENESS
    assert_recovered(truth, result.errors)


def test_bed_with_one_target() -> None:
    truth, result = analyzed(bed(nine_lines(MACHINE), {"D": (0.0, 0.0, 0.0)}))
    assert names_not_determined(result.errors) == {"EAZ", "EBZ", "ECZ"}
    assert "only one target place moves along Z" in whys(result)["EAZ"]
    assert "8 (Z, target offset along y)" in whys(result)["EAZ"]
    assert_recovered(truth, result.errors)


def test_bed_with_one_target_away_from_the_origin_says_where_it_holds() -> None:
    truth, result = analyzed(bed(nine_lines(MACHINE), {"D": (100.0, 50.0, 0.0)}))
    at_line = {"EZZ", "EXZ", "EYZ", "EB0Z", "EA0Z"}
    assert names_not_determined(result.errors) == {"EAZ", "EBZ", "ECZ"} | at_line
    assert all("own place only (lever 100, 50, 0 mm)" in whys(result)[name] for name in at_line)
    assert set(result.errors.alternatives["at-line"]) == at_line
    assert_recovered(truth, result.errors)


@pytest.mark.parametrize(
    ("second", "lost"),
    [
        ((150.0, 0.0, 0.0), {"EAZ"}),
        ((0.0, 150.0, 0.0), {"EBZ"}),
        ((0.0, 0.0, 150.0), {"ECZ"}),
        # Along a slant every angle but the third takes part in the rotation about it.
        ((150.0, 150.0, 0.0), {"EAZ", "EBZ"}),
        ((150.0, 0.0, 100.0), {"EAZ", "ECZ"}),
    ],
)
def test_bed_with_two_targets_loses_the_rotation_about_their_line(
    second: tuple[float, float, float], lost: set[str]
) -> None:
    truth, result = analyzed(bed(nine_lines(MACHINE), {"D": (0.0, 0.0, 0.0), "E": second}))
    assert names_not_determined(result.errors) == lost
    assert_recovered(truth, result.errors)


def test_tool_targets_tell_nothing_of_a_bed() -> None:
    moves = [replace(move, carrier="tool") for move in nine_lines(MACHINE)]
    truth, result = analyzed(moves)
    assert names_not_determined(result.errors) == Z_FUNCTIONS | {"EB0Z", "EA0Z"}
    assert "Z moves the work: for a camera on the floor the target must be there" in whys(result)["EZZ"]
    assert_recovered(truth, result.errors)


def test_axis_without_lines() -> None:
    truth, result = analyzed([move for move in nine_lines(MACHINE) if move.axis != "y"])
    assert names_not_determined(result.errors) == {"EXY", "EYY", "EZY", "EAY", "EBY", "ECY", "EC0Y", "EA0Z"}
    assert set(whys(result).values()) == {"no line along Y is in the data (lines 2, 6 and 7)"}
    assert_recovered(truth, result.errors)


def test_tool_against_work_over_a_volume_with_one_tool_point() -> None:
    """ε_yx, ε_xy, ε_yy, ε_zy are not determined; levers come from parked positions, lines are turned back."""
    moves = []
    for axis in AXES:
        for first in (0.0, 200.0, 400.0):
            for second in (0.0, 200.0, 400.0):
                parked = [first, second]
                parked.insert(AXES.index(axis), 0.0)
                moves.append(
                    Move(
                        axis,
                        "relative",
                        {"tip": (0.0, 0.0, 0.0)},
                        (parked[0], parked[1], parked[2]),
                        line=f"{axis} {parked}",
                    )
                )
    truth, result = analyzed(moves)
    assert names_not_determined(result.errors) == {"EBX", "EAY", "EBY", "ECY"}
    assert_recovered(truth, result.errors)


@pytest.mark.parametrize(
    ("targets", "angles"),
    [
        ({"A": (0.0, 0.0, 0.0)}, {"EAX", "ECX"}),
        (FIXTURE, {"EAX", "EBX", "ECX", "EAY", "EBY", "ECY"}),
    ],
    ids=["one target", "three targets"],
)
def test_floor_camera_over_an_xy_grid(targets: dict[str, tuple[float, float, float]], angles: set[str]) -> None:
    """With one target, of the angles of X and Y only ε_xx and ε_zx; all rows in one `line`."""
    truth, cameras = truth_and_cameras(21)
    moves = [Move("x", "tool", targets, (0.0, float(y), 0.0), line="grid") for y in truth.q_mm["y"]]
    result = analyze_nine_lines(observe(MACHINE, truth, moves, cameras), MACHINE)
    assert {name for name in result.errors.functions if name[1] in "ABC"} == angles
    assert_recovered(truth, result.errors)


def laser(components: dict[str, str], seed: int = 22) -> tuple[Truth, Observations]:
    """Runs along each axis of which only some components were measured, frame parallel to the base."""
    truth, _ = truth_and_cameras(seed)
    straight = {"0": Camera(np.eye(3), np.zeros(3))}
    moves = [Move(axis, MACHINE.side(axis), {"": (0.0, 0.0, 0.0)}, line=f"run {axis}") for axis in components]
    full = observe(MACHINE, truth, moves, straight)
    columns: dict[str, Any] = {"line": full.texts("line"), "carrier": full.texts("carrier")}
    for name in ("x", "y", "z"):
        columns[name] = full.numbers(name)[:, 0]
    for index, name in enumerate(("mx", "my", "mz")):
        kept = [AXES[index] in components[line[-1]] for line in full.texts("line")]
        values = zip(full.measured_mm[:, index].tolist(), kept, strict=True)
        columns[name] = [value if is_kept else None for value, is_kept in values]
    return truth, observations_from_columns(columns)


def test_laser_along_one_axis_gives_its_positioning_only() -> None:
    truth, observations = laser({"x": "x"})
    errors = identify_nine_line(observations, MACHINE)
    assert set(errors.functions) == {"EXX"}
    assert errors.squareness == {}
    whys = {item.name: item.why for item in errors.not_determined}
    assert "the component along Y was not measured on the X lines" in whys["EYX"]
    assert_recovered(truth, errors)


def test_laser_along_three_axes_gives_positioning_only() -> None:
    truth, observations = laser({"x": "x", "y": "y", "z": "z"})
    errors = identify_nine_line(observations, MACHINE)
    assert set(errors.functions) == {"EXX", "EYY", "EZZ"}
    assert errors.squareness == {}
    assert_recovered(truth, errors)


def test_two_components_give_one_straightness_each_and_one_squareness() -> None:
    truth, observations = laser({"x": "xy", "y": "xy"})
    errors = identify_nine_line(observations, MACHINE)
    assert set(errors.functions) == {"EXX", "EYX", "EXY", "EYY"}
    assert set(errors.squareness) == {"EC0Y"}
    assert_recovered(truth, errors)


def test_straightness_component_without_positioning() -> None:
    """A straightness run (transverse component only) needs no distance along the line."""
    truth, observations = laser({"x": "z"})
    errors = identify_nine_line(observations, MACHINE)
    assert set(errors.functions) == {"EZX"}
    assert_recovered(truth, errors)


def test_squareness_at_an_unknown_rotation_is_not_given() -> None:
    """A Y line at x = 200 mm measures S_xy + ε_zx(200); without ε_zx it is no squareness."""
    moves = [move for move in li_nine_lines(MACHINE) if move.line != "line 5"]
    moves = [replace(move, parked_mm=(200.0, 0.0, 0.0)) if move.axis == "y" else move for move in moves]
    truth, result = analyzed(moves)
    assert names_not_determined(result.errors) == {"ECX", "EC0Y"}
    assert whys(result)["EC0Y"] == "the Y line was taken at X = 200 mm, where the angle that turns it is not known"
    assert_recovered(truth, result.errors)


@pytest.mark.parametrize("short", [("line 1",), ("line 1", "line 4", "line 5")])
def test_squareness_beside_a_line_that_begins_elsewhere_is_not_given(short: tuple[str, ...]) -> None:
    """X lines from the middle on, the Y line at x = 0: S where the table begins was told by that at the line."""
    truth, cameras = truth_and_cameras(31)
    observations = observe(MACHINE, truth, li_nine_lines(MACHINE), cameras)
    middle_mm = float(np.median(observations.frame.filter(pl.col("line") == "line 1")["x"].to_numpy()))
    is_cut = pl.col("line").is_in(list(short)) & (pl.col("x") < middle_mm)
    cut = Observations(observations.frame.filter(~is_cut), observations.sources)
    whys = {item.name: item.why for item in identify_nine_line(cut, MACHINE).not_determined}
    assert "the Y line was taken at X = 0 mm, where the angle that turns it is not known" in whys["EC0Y"]


def test_squareness_of_two_lines_turned_alike_needs_no_angle() -> None:
    """X and Y lines at the same z of an axis below both that was never measured."""
    chain = "wbZXYt"
    machine = machine_of(chain)
    rng = np.random.default_rng(23)
    truth = draw_truth(rng, chain)
    moves = [replace(move, parked_mm=(0.0, 0.0, 250.0)) for move in nine_lines(machine) if move.axis != "z"]
    errors = identify_nine_line(observe(machine, truth, moves, {"0": camera(rng)}), machine)
    assert set(errors.squareness) == {"EC0Y"}
    assert_recovered(truth, errors)


def test_integrated_straightness_needs_its_angle() -> None:
    truth, cameras = truth_and_cameras(24)
    moves = [move for move in li_nine_lines(MACHINE) if move.line != "line 5"]
    errors = identify_nine_line(observe(MACHINE, truth, moves, cameras), MACHINE, straightness="integrated")
    assert names_not_determined(errors) == {"ECX", "EYX"}
    assert "EYX" in errors.alternatives["straightness-direct"]


def test_nothing_but_noise_is_refused_with_reasons() -> None:
    truth, cameras = truth_and_cameras(25)
    moves = [Move("x", "base", {"R": (0.0, 0.0, 0.0)})]
    with pytest.raises(GeometryError, match=r"no line of points(?s:.)*9 rows: a fixed reference target(?s:.)*hint: "):
        identify_nine_line(observe(MACHINE, truth, moves, cameras), MACHINE)


def test_left_handed_data_are_refused() -> None:
    truth, _ = truth_and_cameras(26)
    mirror = {"0": Camera(np.diag([1.0, 1.0, -1.0]), np.zeros(3))}
    with pytest.raises(GeometryError, match=r"left-handed(?s:.)*hint: check the chain"):
        identify_nine_line(observe(MACHINE, truth, nine_lines(MACHINE), mirror), MACHINE)


def test_measured_metres_are_set_aside_with_the_reason() -> None:
    truth, cameras = truth_and_cameras(27)
    cameras["1"] = Camera(cameras["1"].turn * 1e-3, cameras["1"].shift_mm)
    moves = [replace(move, session="1") if move.axis == "z" else move for move in nine_lines(MACHINE)]
    result = analyze_nine_lines(observe(MACHINE, truth, moves, cameras), MACHINE)
    assert any("travelled 0.001 mm for each mm commanded along Z; check unit" in note for note in result.errors.notes)
    assert names_not_determined(result.errors) == Z_FUNCTIONS | {"EB0Z", "EA0Z"}
    assert_recovered(truth, result.errors)


def test_copied_rows_and_uncertainties_that_are_none_are_told() -> None:
    truth, cameras = truth_and_cameras(30)
    observations = observe(MACHINE, truth, nine_lines(MACHINE), cameras)
    twice = Observations(pl.concat([observations.frame, observations.frame]), observations.sources)
    assert any("digit for digit" in note for note in identify_nine_line(twice, MACHINE).notes)
    std = dict.fromkeys(("sx", "sy", "sz"), pl.lit(0.004))
    negative = pl.when(pl.int_range(pl.len()) == 7).then(-1.0).otherwise(0.004).alias("sx")
    bare = observations.frame.drop(*COVARIANCE, strict=False)
    result = analyze_nine_lines(Observations(bare.with_columns(**std).with_columns(negative)), MACHINE)
    assert any("sx -1 there" in note for note in result.errors.notes)
    assert sum(result.left_out.values()) == 1


def test_offsets_that_contradict_the_picture_are_pointed_out() -> None:
    truth, cameras = truth_and_cameras(28)
    observations = observe(MACHINE, truth, nine_lines(MACHINE), cameras)
    swapped = Observations(observations.frame.rename({"ty": "tz", "tz": "ty"}), observations.sources)
    notes = identify_nine_line(swapped, MACHINE).notes
    assert any(
        "from target A to C (tool) the data show (0, 0, 200) mm, the offsets tx ty tz say (0, 200, 0) mm" in note
        for note in notes
    )


def test_direct_straightness_that_stands_aside_says_where_it_holds_too() -> None:
    """Two slanted targets leave roll open, so the direct straightness of a line off the origin stays there."""
    slanted = {"A": (0.0, 0.0, 0.0), "B": (160.0, 170.0, 0.0)}
    truth, cameras = truth_and_cameras(29)
    moves = [Move(axis, "tool", slanted, (0.0, 300.0, 0.0), line=axis) for axis in "xy"]
    errors = identify_nine_line(observe(MACHINE, truth, moves, cameras), MACHINE, straightness="integrated")
    assert any("own place only" in note and note.endswith("EZX (direct)") for note in errors.notes)


def test_rows_far_off_their_line_are_told() -> None:
    """Four rows 30 mm off made every uncertainty hundreds of times larger, and none was named."""
    truth, cameras = truth_and_cameras(32)
    observations = observe(MACHINE, truth, li_nine_lines(MACHINE), cameras)
    assert not any("far from the others" in note for note in identify_nine_line(observations, MACHINE).notes)
    off = pl.when(pl.int_range(pl.len()).is_in([3, 40])).then(30.0).when(pl.int_range(pl.len()) == 70).then(-45.0)
    wrong = observations.frame.with_columns(mz=pl.col("mz") + off.otherwise(0.0))
    (note,) = (
        note for note in identify_nine_line(Observations(wrong), MACHINE).notes if "far from the others" in note
    )
    assert note.startswith("3 rows are far from the others of the line, the farthest by 45 mm (line 72 of its file)")
