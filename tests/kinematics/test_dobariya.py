"""Dobariya's machine: his equations from his rows, the same machine as a chain, and the search for the rows."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from chains import Floats, columns_of

from geoerr import _core
from geoerr.denavit_hartenberg import structure_of, tool_from_work
from geoerr.dobariya import _ERRORS, _ROWS, dobariya_errors, dobariya_vmc
from geoerr.errors import GeometryError
from geoerr.machine import Machine

# Dimensions without any relation to each other: a sum that is right with them is right.
A, B, C = (131.0, -57.0, 211.0, 83.0), (41.0, 173.0, -97.0, 29.0), (310.0, 151.0, -223.0, 67.0)
ROWS = dobariya_vmc(A, B, C)
BLOCKS = {"x": (0, 4), "y": (4, 9), "z": (9, 13), "p": (13, 16)}
Q = {"x": 120.0, "y": -45.0, "z": 80.0}
SIZES = {
    name: float(size) for name, size in zip(_ERRORS.values(), np.random.default_rng(8).normal(size=12), strict=True)
}


def translation(x: float, y: float, z: float) -> Floats:
    matrix = np.eye(4)
    matrix[:3, 3] = (x, y, z)
    return matrix


def block(name: str, errors: dict[int, tuple[float, float]] | None = None) -> Floats:
    first, last = BLOCKS[name]
    inside = {row - first: both for row, both in (errors or {}).items() if first <= row < last}
    return tool_from_work(ROWS[first:last], Q, inside)


def test_without_errors_the_chain_closes() -> None:
    # Eqs. 2 and 3: [T_tp][T_x][T_y][T_z][T_p][T_c] = I, where the tool's place is the target's.
    tool = np.array([7.0, -3.0, -120.0])
    place = np.array([sum(A) + Q["x"], sum(B) + Q["y"], sum(C) + Q["z"]]) + tool
    closed = translation(*-place) @ tool_from_work(ROWS, Q) @ translation(*tool)
    np.testing.assert_array_equal(closed, np.eye(4))
    product_of_blocks = block("x") @ block("y") @ block("z") @ block("p")
    np.testing.assert_array_equal(product_of_blocks, tool_from_work(ROWS, Q))


def test_equations_5_9_10_11_with_his_twelve_components() -> None:
    errors = dobariya_errors(SIZES)
    s = SIZES
    expected = {
        "x": (A[0] + Q["x"] + s["EXX1"] + s["EXX2"], B[0] + s["EYX"], C[0] + s["EZX"]),
        "y": (A[1] + s["EXY"], B[1] + Q["y"] + s["EYY1"] + s["EYY2"], C[1] + s["EZY"]),
        "z": (A[2] + s["EXZ"], B[2] + s["EYZ"], C[2] + Q["z"] + s["EZZ1"] + s["EZZ2"]),
        "p": (A[3], B[3], C[3]),
    }
    for name, sums in expected.items():
        np.testing.assert_allclose(block(name, errors), translation(*sums), rtol=0.0, atol=1e-12)


def components(sizes: dict[str, float]) -> Floats:
    """Row by direction x y z, column by axis: his δ_i(a)."""
    s = sizes
    return np.array(
        [
            [s["EXX1"] + s["EXX2"], s["EXY"], s["EXZ"]],
            [s["EYX"], s["EYY1"] + s["EYY2"], s["EYZ"]],
            [s["EZX"], s["EZY"], s["EZZ1"] + s["EZZ2"]],
        ]
    )


def test_equations_14_and_16_errors_add_up() -> None:
    displaced = tool_from_work(ROWS, Q, dobariya_errors(SIZES)) - tool_from_work(ROWS, Q)
    np.testing.assert_allclose(displaced[:3, 3], components(SIZES).sum(axis=1), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(displaced[:3, :3], np.zeros((3, 3)))


def test_equations_7_and_8_squareness() -> None:
    alpha = {"xy": 1e-3, "xz": -2e-3, "yz": 5e-4}
    displaced = tool_from_work(ROWS, Q, dobariya_errors({}, alpha, Q)) - tool_from_work(ROWS, Q)
    expected = [0.0, alpha["xy"] * Q["x"], alpha["xz"] * Q["x"] + alpha["yz"] * Q["y"]]
    np.testing.assert_allclose(displaced[:3, 3], expected, rtol=0.0, atol=1e-12)


def test_the_same_machine_as_a_chain() -> None:
    machine = Machine.from_dh(ROWS, travel_mm=(400.0, 300.0, 250.0))
    assert machine.chain == "wXYbZt"
    assert machine.tool_offset_mm == (sum(A), sum(B), sum(C))
    channels = np.zeros((1, 30))
    # Channels are ordered by axis, then direction: 0-2 of X, 6-8 of Y, 12-14 of Z.
    channels[0, [0, 1, 2, 6, 7, 8, 12, 13, 14]] = components(SIZES).T.ravel()
    q = np.array([list(Q.values())])
    relative = np.array([_core.CARRIERS.index("relative")], dtype=np.uint8)
    seen = _core.chain_positions(
        machine.chain, "position", relative, q, np.zeros((1, 3)), machine.tool_offset_mm, channels, 1
    )
    with_errors = tool_from_work(ROWS, Q, dobariya_errors(SIZES))
    np.testing.assert_allclose(seen[0], with_errors[:3, 3], rtol=0.0, atol=1e-12)


def test_his_squareness_is_minus_lis_up_to_a_turn_of_the_work() -> None:
    alpha = {"xy": 1e-3, "xz": -2e-3, "yz": 5e-4}
    random = np.random.default_rng(9)
    q = random.uniform(-200.0, 200.0, (20, 3))
    squareness = [_core.BASE_COLUMNS.index(name) for name in ("S_xy", "S_xz", "S_yz")]
    columns = columns_of("wXYbZt", "relative", q, np.zeros((20, 3)))[:, squareness]
    lis = np.einsum("nsc,s->nc", columns, [-alpha["xy"], -alpha["xz"], -alpha["yz"]])
    his = []
    for place in q:
        at = dict(zip("xyz", place, strict=True))
        his.append((tool_from_work(ROWS, at, dobariya_errors({}, alpha, at)) - tool_from_work(ROWS, at))[:3, 3])
    turn = np.array([alpha["yz"], -alpha["xz"], alpha["xy"]])
    np.testing.assert_allclose(np.array(his) - lis, np.cross(turn, q), rtol=0.0, atol=1e-12)


def test_an_unknown_component_is_refused() -> None:
    with pytest.raises(GeometryError, match="'EAX' is none of the components"):
        dobariya_errors({"EAX": 1e-3, "EYX": 0.1})


def test_structure() -> None:
    assert structure_of(dobariya_vmc()).tool_offset_mm == (0.0, 0.0, 0.0)


# The search. What the damaged tables still say of each row: θ is ±90 ("9"), 180 ("8") or 0; α is 180 ("8") or 0;
# a lone "9" may be θ or α; a dimension stands in column d or a. Table 2 shows "a + δ" with its plus and "b δ"
# without its minus.
TABLE_2_PLUS = {0, 1, 3, 4, 7, 9, 10, 11, 12}
TABLE_2_MINUS = {2, 5, 6}


def elementary(kind: str, amount: float) -> Floats:
    matrix = np.eye(4)
    if kind in "da":
        matrix[2 if kind == "d" else 0, 3] = amount
        return matrix
    cosine, sine = np.round(np.cos(np.radians(amount))), np.round(np.sin(np.radians(amount)))
    i, j = (0, 1) if kind == "θ" else (1, 2)
    matrix[[i, i, j, j], [i, j, i, j]] = (cosine, -sine, sine, cosine)
    return matrix


Reading = dict[str, float]


def readings(row: int) -> list[Reading]:
    """All that a row may have been."""
    theta, alpha, _, _, name = _ROWS[row]
    if not name:
        return [{kind: sign * 90.0} for kind in "θα" for sign in (1, -1)]
    dimensions = {"a": A, "b": B, "c": C, "x": tuple(Q.values())}[name[0]]
    amount = dimensions[int(name[1]) - 1]
    thetas = [90.0, -90.0] if abs(theta) == 90.0 else [theta]
    signs = [1] if row in TABLE_2_PLUS else [-1] if row in TABLE_2_MINUS else [1, -1]
    return [{"θ": turn, "α": alpha, column: sign * amount} for turn, column, sign in product(thetas, "da", signs)]


def solutions(order: str, name: str) -> list[tuple[Reading, ...]]:
    """Readings of a block whose product is the plain translation of Eqs. 5, 9, 10, 11."""
    first, last = BLOCKS[name]
    found: list[tuple[tuple[Reading, ...], Floats]] = [((), np.eye(4))]
    for row in range(first, last):
        matrices = []
        for reading in readings(row):
            matrix = np.eye(4)
            for kind in order:
                matrix = matrix @ elementary(kind, reading.get(kind, 0.0))
            matrices.append((reading, matrix))
        products = np.einsum("pij,rjk->prik", [at for _, at in found], [matrix for _, matrix in matrices])
        found = [
            ((*before, reading), products[p, r])
            for p, (before, _) in enumerate(found)
            for r, (reading, _) in enumerate(matrices)
        ]
    goal = block(name)
    return [rows for rows, at in found if np.array_equal(at, goal)]


def of_all_blocks(order: str) -> dict[str, int]:
    return {name: len(solutions(order, name)) for name in BLOCKS}


def test_of_the_conventions_in_use_only_one_closes() -> None:
    # Neighbours that commute (turn and move along one axis, two moves) in one order only.
    orders = [
        order for order in map("".join, permutations("θdaα")) if not any(pair in order for pair in ("dθ", "αa", "ad"))
    ]
    assert len(orders) == 11
    closing = {order: counts for order in orders if all((counts := of_all_blocks(order)).values())}
    once = {"x": 1, "y": 1, "z": 1, "p": 2}
    # The second is nobody's convention, and the same table but for θ = 90 in T3, which turns about both z and x.
    assert closing == {"θdaα": once, "dαθa": once}
    # The other convention in use, Rx(α) Tx(a) Rz(θ) Tz(d), does not close.
    assert not any(of_all_blocks("aαθd").values())


def test_the_solution_is_the_table() -> None:
    for name, (first, last) in BLOCKS.items():
        # Of the last block's two solutions, the one with θ = 90 in row T14.
        found = max(solutions("θdaα", name), key=lambda rows: rows[1]["θ"])
        for row, reading in zip(ROWS[first:last], found, strict=True):
            matrix = np.eye(4)
            for kind in "θdaα":
                matrix = matrix @ elementary(kind, reading.get(kind, 0.0))
            np.testing.assert_array_equal(row.transform(Q.get(row.joint or "", 0.0)), matrix)


@pytest.mark.parametrize("dimensions", [(1.0, 2.0, 3.0), (1.0, 2.0, 3.0, 4.0, 5.0), (np.nan, 2.0, 3.0, 4.0)])
def test_dimensions_are_four_numbers(dimensions: tuple[float, ...]) -> None:
    with pytest.raises(GeometryError, match=r"^b_mm is .*\nhint: give four finite numbers, b1 to b4"):
        dobariya_vmc(A, dimensions, C)


def test_the_other_end_is_the_same_product() -> None:
    other = min(solutions("θdaα", "p"), key=lambda rows: rows[1]["θ"])
    assert [other[1]["θ"], other[1]["a"], other[2]["θ"]] == [-90.0, B[3], -90.0]


def test_signs_of_dimensions_are_those_of_table_2() -> None:
    assert {row for row in _ERRORS if _ROWS[row][3] > 0} == TABLE_2_PLUS
    assert {row for row in _ERRORS if _ROWS[row][3] < 0} == TABLE_2_MINUS
