"""Machines that nobody listed: from a code or from D-H rows in one line, or from `[[dh]]` in machine.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chains import CHAINS
from hypothesis import given
from hypothesis import strategies as st

from geoerr import load_model
from geoerr.denavit_hartenberg import DhRow, rows_from_document, structure_of, tool_from_work
from geoerr.dobariya import dobariya_vmc
from geoerr.errors import GeoerrError, GeometryError, InputFileError
from geoerr.machine import Machine, machine_from_document, read_machine, write_machine

TRAVEL = (400.0, 300.0, 250.0)
AXES: dict[str, Any] = {axis: {"range": [0.0, 400.0]} for axis in "xyz"}
# Z along d; X along a; Y along a after a quarter turn that the next row takes back.
ROWS: list[dict[str, Any]] = [
    {"theta": 0.0, "d": 5.0, "a": 0.0, "alpha": 0.0, "joint": "z", "base": True},
    {"theta": 0.0, "d": 0.0, "a": 12.5, "alpha": 0.0, "joint": "x", "variable": "a"},
    {"theta": -90.0, "d": 0.0, "a": 3.0, "alpha": 0.0, "joint": "y", "variable": "a", "sign": -1},
    {"theta": 90.0, "d": 7.0, "a": 0.0, "alpha": 0.0},
]


def document(rows: Any = ROWS, **head: Any) -> dict[str, Any]:
    return {"machine": {"name": "rows", **head}, "axes": AXES, "dh": rows}


class TestOneLine:
    @pytest.mark.parametrize("chain", CHAINS)
    def test_any_chain(self, chain: str) -> None:
        machine = Machine.from_chain(chain, travel_mm=TRAVEL, low_mm=(0.0, -150.0, 10.0))
        assert [machine.axes[axis].range_mm for axis in "xyz"] == [(0.0, 400.0), (-150.0, 150.0), (10.0, 260.0)]
        assert sorted(machine.work_axes + machine.tool_axes) == ["x", "y", "z"]

    def test_refusals(self) -> None:
        with pytest.raises(GeometryError, match="'wXYt' is not a structural code: work to tool"):
            Machine.from_chain("wXYt", travel_mm=TRAVEL)
        with pytest.raises(GeometryError, match=r"travel_mm is .*positive length"):
            Machine.from_chain("wZbXYt", travel_mm=(400.0, 0.0, 250.0))
        with pytest.raises(GeometryError, match=r"low_mm is .*three numbers"):
            Machine.from_chain("wZbXYt", travel_mm=TRAVEL, low_mm=(0.0, 0.0))
        with pytest.raises(GeometryError, match=r"tool_offset_mm is .*three numbers"):
            Machine.from_chain("wZbXYt", travel_mm=TRAVEL, tool_offset_mm=(0.0, 0.0, float("nan")))

    def test_dobariya(self, tmp_path: Path) -> None:
        machine = Machine.from_dh(dobariya_vmc(a_mm=(1.0, 2.0, 3.0, 4.0)), travel_mm=TRAVEL)
        assert (machine.chain, machine.tool_offset_mm) == ("wXYbZt", (10.0, 0.0, 0.0))
        write_machine(tmp_path / "machine.toml", machine)
        assert read_machine(tmp_path / "machine.toml") == machine


class TestRows:
    def test_structure(self) -> None:
        machine = machine_from_document(document(), "machine.toml")
        assert machine.chain == "wZbXYt"
        np.testing.assert_allclose(machine.tool_offset_mm, (12.5, -3.0, 12.0), rtol=0.0, atol=1e-12)

    def test_what_the_rows_do_is_what_the_chain_does(self) -> None:
        machine = machine_from_document(document(), "machine.toml")
        q = {"x": 31.0, "y": -17.0, "z": 5.5}
        expected = np.add(list(q.values()), machine.tool_offset_mm)
        np.testing.assert_allclose(tool_from_work(machine.dh, q)[:3, 3], expected, rtol=0.0, atol=1e-12)

    @pytest.mark.parametrize(("base", "chain"), [(None, "wbZXYt"), (0, "wZbXYt"), (1, "wZXbYt"), (3, "wZXYbt")])
    def test_the_base_may_be_anywhere(self, base: int | None, chain: str) -> None:
        rows = [{key: value for key, value in row.items() if key != "base"} for row in ROWS]
        if base is not None:
            rows[base]["base"] = True
        assert structure_of(rows_from_document(rows, "f")).chain == chain

    def test_round_trip_and_use(self, tmp_path: Path) -> None:
        path = tmp_path / "machine.toml"
        machine = machine_from_document(document() | {"house": {"key": 1}}, path)
        write_machine(path, machine)
        again = read_machine(path)
        assert again == machine
        first = path.read_bytes()
        write_machine(path, again)
        assert path.read_bytes() == first
        assert "chain" not in machine.to_document()["machine"]
        nominal = load_model(path).tool_from_work([[1.0, 2.0, 3.0]])
        np.testing.assert_allclose(nominal, [[13.5, -1.0, 15.0]], rtol=0.0, atol=1e-12)

    def test_the_code_beside_the_rows_must_agree(self) -> None:
        assert machine_from_document(document(chain="wZbXYt", tool_offset=[0.0, 0.0, 0.0]), "f").chain == "wZbXYt"
        with pytest.raises(InputFileError, match=r"'wbXYZt', but the rows of .* are wZbXYt"):
            machine_from_document(document(chain="wbXYZt"), "f")
        with pytest.raises(InputFileError, match="a tool offset beside") as caught:
            machine_from_document(document(tool_offset=[0.0, 0.0, 1.0]), "f")
        assert caught.value.column == "machine.tool_offset"

    @pytest.mark.parametrize(
        ("row", "change", "column", "problem"),
        [
            (0, {"theta": None}, "dh[1].theta", "is missing"),
            (1, {"a": "12"}, "dh[2].a", "is not a number"),
            (1, {"d": True}, "dh[2].d", "is not a number"),
            (1, {"alpha": float("nan")}, "dh[2].alpha", "is not a number"),
            (1, {"joint": "u"}, "dh[2].joint", "'u' is not allowed"),
            (1, {"joint": "y"}, "dh[3].joint", "axis y moves rows 2 and 3"),
            (1, {"joint": None}, "dh", "no row is moved by x"),
            (1, {"variable": "theta"}, "dh[2].variable", "'theta' is not allowed"),
            (1, {"variable": "d"}, "dh[2].joint", r"x moves along \(0, 0, 1\)"),
            (2, {"sign": 1}, "dh[3].sign", "a growing y moves the tool towards -y"),
            (2, {"sign": True}, "dh[3].sign", "True is not allowed"),
            (2, {"sign": 0.5}, "dh[3].sign", "0.5 is not allowed"),
            (2, {"base": True}, "dh[3].base", "a second row ends at the base"),
            (2, {"base": 1}, "dh[3].base", "1 is not allowed"),
            (0, {"theta": 1e-6}, "dh[2].joint", "which is not its axis x"),
            (3, {"alhpa": 0.0}, "dh[4].alhpa", "unknown key"),
        ],
    )
    def test_a_wrong_row_is_refused_by_name(
        self, row: int, change: dict[str, Any], column: str, problem: str
    ) -> None:
        rows = [dict(each) for each in ROWS]
        rows[row] = {key: value for key, value in (rows[row] | change).items() if value is not None}
        if "joint" in change and change["joint"] == "y":
            rows[row] |= {"theta": 90.0}
            rows[2] |= {"theta": -180.0}
        with pytest.raises(InputFileError, match=problem) as caught:
            machine_from_document(document(rows), "machine.toml")
        assert caught.value.column == column
        assert caught.value.remedy

    @pytest.mark.parametrize(
        ("change", "hint"),
        [
            ({"joint": "X"}, "axes are x, y and z; leave it out in a row that stands still"),
            ({"variable": "theta"}, r"an axis adds to d \(along z\) or to a \(along x\)"),
            ({"sign": 0}, "write 1 where the coordinate adds, -1 where it subtracts"),
        ],
    )
    def test_a_wrong_row_of_python_is_refused_when_it_is_made(self, change: dict[str, Any], hint: str) -> None:
        (key, value) = next(iter(change.items()))
        with pytest.raises(GeoerrError, match=f"^{key} cannot be {value!r}\nhint: {hint}$"):
            DhRow(**change)

    @pytest.mark.parametrize("rows", [[], "rows", {"theta": 0.0}, [3]])
    def test_no_rows_at_all(self, rows: Any) -> None:
        with pytest.raises(InputFileError, match=r"\[\[dh\]\]"):
            machine_from_document(document(rows), "machine.toml")

    @given(
        st.lists(st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=5), st.lists), max_size=3)
    )
    def test_anything_else_is_refused_and_never_crashes(self, rows: list[Any]) -> None:
        with pytest.raises(InputFileError):
            machine_from_document(document(rows), "machine.toml")

    @given(
        st.fixed_dictionaries(
            {
                key: st.floats(-1e6, 1e6) | st.sampled_from([0.0, 90.0, -90.0, 180.0])
                for key in ("theta", "d", "a", "alpha")
            }
        )
    )
    def test_any_fixed_row_survives_the_file(self, row: dict[str, float]) -> None:
        (read,) = rows_from_document([row], "f")
        assert rows_from_document([read.to_document()], "f") == (read,)
        whole = read.transform()
        # Each row is a rotation and a shift.
        np.testing.assert_allclose(whole[:3, :3] @ whole[:3, :3].T, np.eye(3), rtol=0.0, atol=1e-14)


def test_quarter_turns_are_exact_and_others_are_cosines() -> None:
    for theta in (0.0, 90.0, 180.0, 270.0, -90.0, -180.0, 360.0, 720.0):
        matrix = DhRow(theta_deg=theta, alpha_deg=theta).transform()
        assert set(np.abs(matrix).ravel()) <= {0.0, 1.0}
    turned = DhRow(theta_deg=30.0, a_mm=2.0).transform()
    np.testing.assert_allclose(turned[:2, 3], [np.sqrt(3.0), 1.0], rtol=1e-15)
