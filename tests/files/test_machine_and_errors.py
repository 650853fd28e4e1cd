"""machine.toml and errors.json: read, written, refused by name."""

from __future__ import annotations

import json
import os
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import geoerr
from geoerr.error_functions import (
    ALL_NAMES,
    LI_NAMES,
    ErrorFunction,
    ErrorFunctions,
    NotDetermined,
    Squareness,
    read_errors,
    write_errors,
)
from geoerr.errors import InputFileError, ShapeError
from geoerr.files import whole_or_absent, write_text
from geoerr.machine import Axis, Machine, read_machine, write_machine

MACHINE = Machine(
    name="printer 7",
    chain="wZbXYt",
    axes={name: Axis((0.0, 400.0), "steel" if name == "x" else None) for name in "xyz"},
    tool_offset_mm=(1.0, 2.0, -3.0),
    extra={"house": {"key": 1}},
)


def test_machine_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    write_machine(path, MACHINE)
    assert read_machine(path) == MACHINE
    first = path.read_bytes()
    write_machine(path, read_machine(path))
    assert path.read_bytes() == first


@pytest.mark.parametrize(
    ("chain", "work", "tool"),
    [("wZbXYt", "z", "xy"), ("wbXYZt", "", "xyz"), ("wXYbZt", "yx", "z"), ("wXYZbt", "zyx", "")],
)
def test_sides_of_the_chain_from_the_base_outwards(chain: str, work: str, tool: str) -> None:
    machine = Machine("m", chain, MACHINE.axes)
    assert (machine.work_axes, machine.tool_axes) == (work, tool)
    assert {axis: machine.side(axis) for axis in work + tool} == dict.fromkeys(work, "work") | dict.fromkeys(
        tool, "tool"
    )


@pytest.mark.parametrize(
    ("old", "new", "column"),
    [
        ('"wZbXYt"', '"wZXYt"', "machine.chain"),
        ('"wZbXYt"', '"wZbXXt"', "machine.chain"),
        ('"wZbXYt"', "3", "machine.chain"),
        ("[machine]", "[mashine]", "machine"),
        ("[axes.y]", "[axes.w]", "axes.y.range"),
        ("[0.0, 400.0]", "[400.0, 0.0]", "axes.x.range"),
        ("[0.0, 400.0]", '["a", 1.0]', "axes.x.range"),
        ("[0.0, 400.0]", "[0.0, nan]", "axes.x.range"),
        ('name = "m"', "tool_ofset = [0.0, 0.0, 1.0]", "machine.tool_ofset"),
        ('name = "m"', "reference-temperature = 25.0", "machine.reference-temperature"),
        ("[axes.x]", '[axes.x]\nmateral = "steel"', "axes.x.materal"),
    ],
)
def test_a_wrong_machine_is_refused_by_key(tmp_path: Path, old: str, new: str, column: str) -> None:
    path = tmp_path / "machine.toml"
    ranges = "".join(f"[axes.{axis}]\nrange = [0.0, 400.0]\n" for axis in "xyz")
    write_text(path, ('[machine]\nname = "m"\nchain = "wZbXYt"\n' + ranges).replace(old, new, 1))
    with pytest.raises(InputFileError) as caught:
        read_machine(path)
    assert caught.value.column == column


def test_broken_toml_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text("[machine\n")
    with pytest.raises(InputFileError, match=r"machine\.toml: not valid TOML"):
        read_machine(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputFileError, match="not a text file"):
        read_machine(path)


@pytest.mark.parametrize(
    ("text", "words", "remedy"),
    [
        ("line,x,y,z\n", "not valid TOML", "name the .toml file"),
        ("", r"the table \[machine\] is missing", 'chain = "wZbXYt"'),
        ('[machine]\nchain = "wZbXYt"\nreference_temperature = "20"\n', "not a temperature", "write a number"),
        ('[machine]\nname = 7\nchain = "wZbXYt"\n', "not a text", "in quotes"),
        ('[machine]\nchain = "wZbXYt"\n[axes.x]\nmaterial = 1\nrange = [0, 1]\n', "not a text", "in quotes"),
    ],
)
def test_what_to_do_is_said_of_a_machine_that_is_refused(tmp_path: Path, text: str, words: str, remedy: str) -> None:
    ranges = "".join(f"[axes.{axis}]\nrange = [0, 400]\n" for axis in "xyz" if f"axes.{axis}" not in text)
    path = tmp_path / "machine.toml"
    path.write_text(text + ranges)
    with pytest.raises(InputFileError, match=words) as caught:
        read_machine(path)
    assert remedy in (caught.value.remedy or "")


def test_a_model_that_was_cut_short_is_told(tmp_path: Path) -> None:
    path = tmp_path / "errors.json"
    path.write_text('{"schema": "geoerr-err')
    with pytest.raises(InputFileError, match=r"errors\.json:1: not valid JSON: .*\nhint: .*was cut short"):
        read_errors(path)


def test_a_model_in_the_place_of_a_machine_is_told(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text('{"machine": {}}', encoding="utf-8")
    with pytest.raises(InputFileError, match=r"not valid TOML: .*\nhint: this is JSON, .*name the \.toml file"):
        read_machine(path)


def example_errors() -> ErrorFunctions:
    grid = np.linspace(0, 400, 5)
    functions = {
        name: ErrorFunction(grid, np.sin(grid / 90 + index) * 1e-3, np.full(5, 1e-5) if index % 2 else None)
        for index, name in enumerate(ALL_NAMES[:17])
    }
    return ErrorFunctions(
        machine=MACHINE,
        functions=functions,
        squareness={"EC0Y": Squareness(-5.05e-3, 2e-5), "EB0Z": Squareness(-1.24e-3)},
        method="nine-line",
        not_determined=(NotDetermined("EA0Z", "lines 2 and 3 are in different sessions"),),
        alternatives={"straightness-integrated": {"EYX": functions["EYX"]}},
        notes=("a note",),
        extra={"hidden": []},
    )


def test_errors_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "errors.json"
    errors = example_errors()
    write_errors(path, errors)
    again = read_errors(path)
    for name, function in errors.functions.items():
        np.testing.assert_array_equal(again.functions[name].position_mm, function.position_mm)
        np.testing.assert_allclose(again.functions[name].value, function.value, rtol=1e-15)
    assert again.squareness["EC0Y"].value_rad == pytest.approx(-5.05e-3, rel=1e-15)
    assert again.squareness["EB0Z"].std_rad is None
    assert again.not_determined == errors.not_determined
    assert (again.machine, again.notes, again.extra) == (errors.machine, errors.notes, errors.extra)
    assert "EYX" in again.alternatives["straightness-integrated"]


def test_names_are_those_of_the_standard_and_the_paper() -> None:
    assert len(set(ALL_NAMES)) == 21
    assert (LI_NAMES["EYX"], LI_NAMES["ECX"], LI_NAMES["EBZ"]) == ("δ_yx", "ε_zx", "ε_yz")


def test_a_function_is_a_polygon_that_keeps_its_ends() -> None:
    function = ErrorFunction(np.array([0.0, 10.0]), np.array([1.0, 3.0]))
    np.testing.assert_array_equal(function.at([-5, 0, 5, 10, 99]), [1, 1, 2, 3, 3])


@pytest.mark.parametrize(
    ("change", "column"),
    [
        (lambda d: d.pop("errors"), "errors"),
        (lambda d: d["errors"].update(EXQ={}), "errors.EXQ"),
        (lambda d: d["errors"]["EXX"].update(position_mm=[0, 10, 5, 20, 30]), "errors.EXX.position_mm"),
        (lambda d: d["errors"]["EXX"].update(value_um=[1, "a", 3, 4, 5]), "errors.EXX.value_um"),
        (lambda d: d["errors"]["EXX"].update(value_um=[1]), "errors.EXX"),
        (lambda d: d["errors"]["EAX"].update(std_urad=[-1] * 5), "errors.EAX.std_urad"),
        (lambda d: d.update(schema="geoerr-errors/99"), "schema"),
        (lambda d: d.pop("machine"), "machine"),
        (lambda d: d["errors"]["EC0Y"].update(value_urad=None), "errors.EC0Y.value_urad"),
    ],
)
def test_wrong_errors_are_refused_by_key(tmp_path: Path, change: object, column: str) -> None:
    document = json.loads(json.dumps(example_errors().to_document()))
    change(document)  # type: ignore[operator]  # a parametrised lambda
    path = tmp_path / "errors.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputFileError) as caught:
        read_errors(path)
    assert caught.value.column == column


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(
    content=st.recursive(
        st.none() | st.integers() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner)
            | st.dictionaries(st.sampled_from(["errors", "machine", "EXX", "position_mm", "value_um", "axes"]), inner)
        ),
    )
)
def test_any_json_is_read_or_refused(tmp_path: Path, content: object) -> None:
    path = tmp_path / "errors.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputFileError):
        read_errors(path)


def test_a_failed_write_leaves_the_earlier_file(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    write_text(path, "first")

    def fail_half_way() -> None:
        with whole_or_absent(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_half_way()
    assert path.read_text() == "first"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_an_output_folder_that_is_absent_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="does not exist"):
        write_text(tmp_path / "absent" / "out.txt", "text")


def test_the_error_survives_pickling() -> None:
    error = InputFileError("a.csv", "is wrong", row=3, column="x", remedy="mend it")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.row, again.column) == (str(error), 3, "x")
    assert str(error) == "a.csv:3: x: is wrong\nhint: mend it"


def test_a_link_stays_one_and_its_file_is_written(tmp_path: Path) -> None:
    (tmp_path / "third.json").write_text("old")
    link = tmp_path / "newest.json"
    link.symlink_to("third.json")
    write_text(link, "new")
    assert link.is_symlink()
    assert (tmp_path / "third.json").read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["newest.json", "third.json"]


def test_what_is_no_file_is_given_what_was_written_and_never_replaced(tmp_path: Path) -> None:
    """As the system's administrator, geoerr replaced /dev/null by a file."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor(1) as pool:
        read = pool.submit(pipe.read_text)
        write_text(pipe, "through a pipe")
        assert read.result(timeout=10) == "through a pipe"
    assert pipe.is_fifo()
    write_text(os.devnull, "nothing")
    assert Path(os.devnull).is_char_device()


@pytest.mark.parametrize(
    "name", ["write_errors", "write_model", "write_model_report", "write_observations", "write_rig"]
)
def test_swapped_arguments_are_named(tmp_path: Path, name: str) -> None:
    write = getattr(geoerr, name)
    with pytest.raises(ShapeError, match=rf"path: a value of type Machine was given[^\n]*\nhint: {name}\(path, "):
        write(MACHINE, tmp_path / "out")
    with pytest.raises(
        ShapeError, match=rf": a value of type str was given where \w+ is needed\nhint: {name}\(path, "
    ):
        write(tmp_path / "out", "out")
    with pytest.raises(ShapeError, match="path: a value of type Machine"):
        write_machine(MACHINE, tmp_path / "out")  # type: ignore[arg-type]  # the point of the test
    assert not list(tmp_path.iterdir())
