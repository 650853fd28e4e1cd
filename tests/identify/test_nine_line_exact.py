"""From exact points of machines with full rotations, seen by a turned camera, back to their 21 errors."""

from __future__ import annotations

import numpy as np
import pytest
from nine_line_checks import SECOND_ORDER_MM, assert_recovered, names_not_determined
from virtual_machine import (
    AXES,
    BED,
    FIXTURE,
    Move,
    camera,
    draw_truth,
    li_nine_lines,
    machine_of,
    nine_lines,
    observe,
    place,
)

from geoerr.error_functions import ALL_NAMES, read_errors, write_errors
from geoerr.identify import analyze_nine_lines, identify_nine_line
from geoerr.model import Model

CHAINS = (
    *("wZbXYt", "wZbYXt", "wbXYZt", "wbZYXt", "wXYbZt", "wYXbZt"),
    *("wXbYZt", "wXYZbt", "wYbZXt", "wZYbXt", "wbYZXt"),
)


@pytest.mark.parametrize("follows_tangent", [True, False], ids=["tangent", "free"])
@pytest.mark.parametrize("chain", CHAINS)
def test_nine_lines_give_all_21(chain: str, follows_tangent: bool) -> None:
    rng = np.random.default_rng(CHAINS.index(chain))
    machine = machine_of(chain)
    truth = draw_truth(rng, chain, follows_tangent=follows_tangent)
    result = analyze_nine_lines(observe(machine, truth, nine_lines(machine), {"0": camera(rng)}), machine)
    assert [line.number for line in result.lines] == [1, 4, 5, 2, 6, 7, 3, 8, 9]
    assert result.missing_lines == ()
    assert {*result.errors.functions, *result.errors.squareness} == set(ALL_NAMES)
    assert result.errors.not_determined == ()
    integrated = ("straightness-integrated",) if follows_tangent else ()
    assert_recovered(truth, result.errors, alternatives=integrated)
    # The disagreement of the two straightnesses is what tells the two machines apart.
    largest = max(verdict.rms_mm for verdict in result.tangent)
    assert (largest < SECOND_ORDER_MM) == follows_tangent


@pytest.mark.parametrize("chain", CHAINS)
def test_parked_anywhere_with_targets_anywhere(chain: str) -> None:
    """Axes that carry others turn their lines; lines far from the carriage origin are referred back to it."""
    rng = np.random.default_rng(100 + CHAINS.index(chain))
    machine = machine_of(chain, tool_offset_mm=(10.0, -20.0, -60.0))
    truth = draw_truth(rng, chain, follows_tangent=False)
    tool = {"A": (30.0, 40.0, 50.0), "B": (190.0, 200.0, 30.0), "C": (20.0, 30.0, 240.0)}
    bed = {"D": (100.0, 120.0, -30.0), "E": (90.0, 300.0, 130.0), "F": (310.0, 140.0, 10.0)}
    carriers = {axis: machine.side(axis) for axis in AXES}
    # An L that spans the two directions across the axis.
    moves = [
        Move(axis, carriers[axis], bed if axis == "z" else tool, tuple(rng.uniform(50.0, 350.0, 3)), line=axis)
        for axis in AXES
    ]
    errors = identify_nine_line(observe(machine, truth, moves, {"0": camera(rng)}), machine)
    assert errors.not_determined == ()
    assert_recovered(truth, errors)


@pytest.mark.parametrize("chain", CHAINS)
def test_tool_seen_from_the_work(chain: str) -> None:
    """`relative` data: levers grow with the axes between the moving one and the tool."""
    rng = np.random.default_rng(200 + CHAINS.index(chain))
    machine = machine_of(chain)
    truth = draw_truth(rng, chain, follows_tangent=False)
    targets = {"A": (0.0, 0.0, 0.0), "B": (160.0, 170.0, 0.0), "C": (-170.0, 160.0, 160.0)}
    moves = [Move(axis, "relative", targets, tuple(rng.uniform(0.0, 300.0, 3))) for axis in AXES]
    errors = identify_nine_line(observe(machine, truth, moves, {"0": camera(rng)}), machine)
    assert errors.not_determined == ()
    assert_recovered(truth, errors)


def test_tool_and_bed_targets_on_every_line() -> None:
    """A target that stands still while an axis moves is left out and counted."""
    rng = np.random.default_rng(3)
    machine = machine_of("wZbXYt")
    truth = draw_truth(rng, "wZbXYt")
    bodies = (("tool", FIXTURE), ("work", BED))
    moves = [Move(axis, carrier, targets, line=axis) for axis in AXES for carrier, targets in bodies]
    moves.append(Move("x", "base", {"R": (500.0, 0.0, 0.0)}))
    result = analyze_nine_lines(observe(machine, truth, moves, {"0": camera(rng)}), machine)
    assert result.errors.not_determined == ()
    assert_recovered(truth, result.errors)
    n = len(truth.q_mm["x"])
    assert result.left_out == {
        "the target stands still while this axis moves": 9 * n,
        "a fixed reference target (carrier = base)": n,
    }


def test_model_of_the_result_moves_as_the_machine_does() -> None:
    """E(q, l) over the volume, for several tool lengths, with no rigid motion fitted: the gauge is the same."""
    rng = np.random.default_rng(4)
    for chain in ("wZbXYt", "wXYbZt", "wbXYZt"):
        machine = machine_of(chain)
        truth = draw_truth(rng, chain, follows_tangent=False)
        moves = nine_lines(machine)
        for move in moves:
            move.targets = {name: tuple(np.add(at, (40.0, -30.0, 80.0))) for name, at in move.targets.items()}
        errors = identify_nine_line(observe(machine, truth, moves, {"0": camera(rng)}), machine)
        model = Model(machine, errors)
        q = rng.uniform(0.0, 400.0, (200, 3))
        for offset in ((0.0, 0.0, 0.0), (0.0, 0.0, -100.0), (80.0, -120.0, 60.0)):
            exact = np.array([place(machine, truth, "relative", row, np.array(offset)) for row in q])
            # Two dozen second-order terms, of which each is below the bound.
            assert np.max(np.abs(model.tool_from_work(q, offset_mm=offset) - exact)) < 4 * SECOND_ORDER_MM


def test_li_lines_to_the_letter_in_any_order(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """One target a line, rows shuffled: the same numbers as in order; errors.json keeps them."""
    rng = np.random.default_rng(5)
    machine = machine_of("wZbXYt")
    truth = draw_truth(rng, "wZbXYt")
    cameras = {"0": camera(rng)}
    moves = li_nine_lines(machine)
    errors = identify_nine_line(observe(machine, truth, moves, cameras), machine)
    shuffled = rng.permutation(len(moves) * len(truth.q_mm["x"]))
    again = identify_nine_line(observe(machine, truth, moves, cameras, order=shuffled), machine)
    assert_recovered(truth, errors)
    for name, table in errors.functions.items():
        assert np.allclose(again.functions[name].value, table.value, rtol=0.0, atol=1e-10)
    write_errors(tmp_path / "errors.json", errors)
    assert names_not_determined(read_errors(tmp_path / "errors.json")) == set()


def test_same_data_same_bytes(tmp_path) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(6)
    machine = machine_of("wZbXYt")
    observations = observe(
        machine,
        draw_truth(rng, "wZbXYt"),
        nine_lines(machine),
        {"0": camera(rng)},
        covariance_mm2=np.eye(3) * 1e-4,
        rng=rng,
    )
    for name in ("a.json", "b.json"):
        write_errors(tmp_path / name, identify_nine_line(observations, machine))
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
