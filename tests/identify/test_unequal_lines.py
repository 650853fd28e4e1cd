"""Missing and unordered points, repeats, both directions, and lines that do not have the same points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
from nine_line_checks import SECOND_ORDER_MM, SECOND_ORDER_RAD, assert_recovered, deviation
from virtual_machine import Move, Truth, camera, draw_truth, li_nine_lines, machine_of, nine_lines, observe

from geoerr.identify import analyze_nine_lines, identify_nine_line
from geoerr.observations import Observations

CHAIN = "wZbXYt"
MACHINE = machine_of(CHAIN)


def truth_of(seed: int, n_points: int = 9) -> Truth:
    return draw_truth(np.random.default_rng(seed), CHAIN, n_points=n_points)


def observed(truth: Truth, moves: list[Move], seed: int = 30) -> Observations:
    return observe(MACHINE, truth, moves, {"0": camera(np.random.default_rng(seed))})


def without(observations: Observations, rows: list[tuple[str, float]]) -> Observations:
    """Drop rows by line and position of the moving axis."""
    moving = {**dict.fromkeys("145", "x"), **dict.fromkeys("267", "y"), **dict.fromkeys("389", "z")}
    keep = pl.lit(True)
    for line, position in rows:
        keep = keep & ~((pl.col("line") == f"line {line}") & (pl.col(moving[line]) == position))
    return Observations(observations.frame.filter(keep), observations.sources)


def test_a_missing_point_drops_its_node_for_what_needs_it() -> None:
    """Line 4 lacks x = 150: ε_yx and roll's share of it; line 1 lacks x = 300: everything that is counted from it."""
    truth = truth_of(31)
    observations = without(observed(truth, li_nine_lines(MACHINE)), [("4", 150.0), ("1", 300.0)])
    errors = identify_nine_line(observations, MACHINE)
    grid = truth.q_mm["x"]
    assert errors.functions["EBX"].position_mm.tolist() == [q for q in grid if q not in (150.0, 300.0)]
    assert errors.functions["ECX"].position_mm.tolist() == [q for q in grid if q != 300.0]
    assert errors.functions["EXX"].position_mm.tolist() == [q for q in grid if q != 300.0]
    # Lines 4 and 5 show roll at 300 without line 1, and line 5 with line 1 at 150 without line 4.
    assert errors.functions["EAX"].position_mm.tolist() == grid.tolist()
    assert errors.functions["EYY"].position_mm.tolist() == truth.q_mm["y"].tolist()
    assert_recovered(truth, errors)


def test_first_point_missing_moves_the_gauge_to_the_next() -> None:
    truth = truth_of(32)
    observations = without(observed(truth, li_nine_lines(MACHINE)), [("5", 0.0)])
    errors = identify_nine_line(observations, MACHINE)
    assert errors.functions["ECX"].position_mm[0] == 50.0
    assert errors.functions["ECX"].value[0] == 0.0
    assert errors.functions["EXX"].position_mm[0] == 0.0
    # The line is turned by ε_zx counted from x = 50, and so is S_xy: no more than the angle between the two.
    assert_recovered(truth, errors)


def test_empty_cells_are_counted() -> None:
    truth = truth_of(33)
    observations = observed(truth, nine_lines(MACHINE))
    row = pl.int_range(pl.len()) == 40
    frame = observations.frame.with_columns(mx=pl.when(row).then(None).otherwise(pl.col("mx")))
    result = analyze_nine_lines(Observations(frame, observations.sources), MACHINE)
    assert result.left_out == {"the target's position is missing or incomplete": 1}
    assert_recovered(truth, result.errors)


def test_repeats_in_both_directions() -> None:
    truth = truth_of(34)
    moves = []
    for repeat in range(3):
        for move in nine_lines(MACHINE):
            grid = truth.q_mm[move.axis]
            moves.append(replace(move, repeat=repeat, q_mm=np.concatenate([grid, grid[::-1]])))
    result = analyze_nine_lines(observed(truth, moves), MACHINE)
    assert {line.n_passes for line in result.lines} == {3}
    assert {line.n_points for line in result.lines} == {3 * 2 * 9}
    assert result.errors.not_determined == ()
    assert_recovered(truth, result.errors)
    assert result.errors.functions["EXX"].position_mm.tolist() == truth.q_mm["x"].tolist()


def test_partial_passes_are_joined_where_they_overlap() -> None:
    """Each pass has a constant of its own; two that share two positions make one line."""
    truth = truth_of(35)
    moves = []
    for move in li_nine_lines(MACHINE):
        grid = truth.q_mm[move.axis]
        moves += [replace(move, q_mm=grid[:5]), replace(move, repeat=1, q_mm=grid[3:])]
    errors = identify_nine_line(observed(truth, moves), MACHINE)
    assert errors.not_determined == ()
    assert_recovered(truth, errors)
    assert len(errors.functions["EBX"].position_mm) == 9


def test_passes_that_share_no_position_are_not_joined() -> None:
    """Without a common point nothing says how the second half follows the first; the larger half stays."""
    truth = truth_of(36)
    moves = []
    for move in li_nine_lines(MACHINE):
        grid = truth.q_mm[move.axis]
        halves = [replace(move, q_mm=grid[:4]), replace(move, repeat=1, q_mm=grid[4:])]
        moves += halves if move.line == "line 4" else [move]
    errors = identify_nine_line(observed(truth, moves), MACHINE)
    assert errors.functions["EBX"].position_mm.tolist() == truth.q_mm["x"][4:].tolist()
    assert_recovered(truth, errors)


def test_lines_with_different_points_meet_on_a_common_grid() -> None:
    """Nodes where the coarsest line's points allow; between them the functions are straight lines.

    What a parabola of ±2e-4 rad (0.1 mm at most across 400 mm) leaves over a node distance h is at most f″h²/8.
    """
    truth = truth_of(37, n_points=81)
    steps = {"1": 20.0, "4": 25.0, "5": 30.0}
    starts = {"1": 0.0, "4": 5.0, "5": 10.0}
    moves = []
    for move in li_nine_lines(MACHINE):
        number = move.line[-1]
        if number in steps:
            move = replace(move, q_mm=np.arange(starts[number], 400.1, steps[number]))
        moves.append(move)
    errors = identify_nine_line(observed(truth, moves), MACHINE)
    (note,) = (note for note in errors.notes if "different points" in note)
    assert note.startswith("the lines along X have different points: its functions are given on")
    assert "from 10 to 380 mm" in note
    assert errors.not_determined == ()
    node_mm = np.diff(errors.functions["EXX"].position_mm)[0]
    assert 30.0 < node_mm < 60.0
    curvature = 2 * 2.0 / 400.0**2
    for name in ("EAX", "EBX", "ECX"):
        left_over = 100e-6 * curvature * node_mm**2 / 8.0
        # An angle is a difference of lines: twice that, times the ratio of positioning's curvature to the offset.
        bound = SECOND_ORDER_RAD + 2 * (left_over + 0.03 * 4 * curvature * node_mm**2 / 8.0 / 150.0)
        assert deviation(truth, name, errors.functions[name]) < bound, name
    bound_mm = SECOND_ORDER_MM + 2 * 0.03 * 4 * curvature * node_mm**2 / 8.0
    assert deviation(truth, "EXX", errors.functions["EXX"]) < bound_mm


def test_a_fourth_target_takes_part() -> None:
    """Further lines have no number of Li's; they make the result redundant."""
    truth = truth_of(38)
    moves = nine_lines(MACHINE)
    for move in moves:
        move.targets = {**move.targets, "extra": (120.0, 130.0, 140.0)}
    result = analyze_nine_lines(observed(truth, moves), MACHINE)
    assert [line.number for line in result.lines if line.axis == "x"] == [1, 4, 5, None]
    assert result.errors.not_determined == ()
    assert_recovered(truth, result.errors)


def test_two_sessions_that_see_everything_are_averaged() -> None:
    truth = truth_of(39)
    rng = np.random.default_rng(39)
    moves = nine_lines(MACHINE) + [replace(move, session="1") for move in nine_lines(MACHINE)]
    observations = observe(MACHINE, truth, moves, {"0": camera(rng), "1": camera(rng)})
    errors = identify_nine_line(observations, MACHINE)
    assert errors.not_determined == ()
    assert_recovered(truth, errors)


def test_many_missing_points_are_no_different_points() -> None:
    """A third of the points lost at random: the lines still share their positions, and no grid is laid over them."""
    truth = truth_of(40, n_points=11)
    rng = np.random.default_rng(40)
    observations = observed(truth, li_nine_lines(MACHINE))
    errors = identify_nine_line(observations.select(rng.random(len(observations)) > 0.33), MACHINE)
    assert not any("different points" in note for note in errors.notes)
    functions = {name: table for name, table in errors.functions.items() if len(table.position_mm) > 1}
    assert set(functions["EXX"].position_mm) <= set(truth.q_mm["x"])
    for name, table in functions.items():
        # Straightness is compared in the gauge of the nodes that are left; what holds at a line only is not compared.
        assert deviation(truth, name, table) < 2 * (SECOND_ORDER_RAD if name[1] in "ABC" else SECOND_ORDER_MM), name
