"""The pages of the file formats: examples are read, what is refused is refused, and every column and key is there."""

from __future__ import annotations

import importlib.util
import inspect
import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, get_args

import numpy as np
import pytest
from typer.testing import CliRunner

import geoerr.cli.demo
import geoerr.cli.simulate
import geoerr.machine
import geoerr.model.load
import geoerr.vision.rig
import geoerr.vision.session
from geoerr.cli.doctor_checks import Check
from geoerr.cli.main import VERBS, app
from geoerr.diagnose.findings import HeldOut, Unknown
from geoerr.diagnose.moments import Moment
from geoerr.diagnose.where import Span, Where
from geoerr.effects import load_catalogue
from geoerr.effects.read import EFFECT_KEYS, PARAMETER_KEYS
from geoerr.errors import GeoerrError
from geoerr.farm.outcome import Farm, Outcome
from geoerr.fit.empirical import Curve
from geoerr.observations import (
    CIRCLE_COLUMNS,
    LENGTH_COLUMNS,
    POINT_COLUMNS,
    read_circular_test,
    read_lengths,
    read_observations,
)
from geoerr.simulate.effects import AVAILABLE_EFFECTS
from geoerr.simulate.entries import Entries
from geoerr.simulate.plan import read_plan
from geoerr.terms import BasisKind, Parameter
from geoerr.vision.calibrate import Calibration
from geoerr.vision.measured import Measured
from geoerr.vision.scale_bar import ScaleBarResult
from geoerr.vision.session import FORBIDDEN_COLUMNS, FRAME_COLUMNS, read_session

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "reference" / "formats"
PACKAGE = ROOT / "python" / "geoerr"
_FENCE = re.compile(r"(?:<!-- file: (?P<name>\S+) -->\n)?```(?P<language>\w+)\n(?P<text>.*?)```", re.DOTALL)
_CODE = re.compile(r"`([^`\n]+)`")
_LINK = re.compile(r"\]\(([\w./]*)#([\w-]+)\)")
OTHER = "any other"


class Table(NamedTuple):
    """A table of a page: the anchor of its heading, the name and text of the last example before it, its cells."""

    anchor: str
    example: tuple[str, str] | None
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@cache
def text_of(page: str) -> str:
    return (PAGES / page).read_text(encoding="utf-8")


@cache
def tables_of(page: str) -> tuple[Table, ...]:
    tables, anchor, example, rows = [], "", None, []
    lines = iter([*text_of(page).splitlines(), ""])
    text = text_of(page)
    examples = {fence.start("text"): fence for fence in _FENCE.finditer(text)}
    at = 0
    for line in lines:
        if at in examples and examples[at]["name"]:
            example = (examples[at]["name"], examples[at]["text"])
        at += len(line) + 1
        if line.startswith("#"):
            anchor = re.sub(r"[^\w -]", "", line.lstrip("# ").lower()).replace(" ", "-")
        if line.startswith("|"):
            rows.append(tuple(cell.strip() for cell in line.strip("|").split(" | ")))
        elif rows:
            tables.append(Table(anchor, example, rows[0], tuple(rows[2:])))
            rows = []
    return tuple(tables)


def read_own_effects(path: Path) -> object:
    return load_catalogue([path])


def read_whole_session(path: Path) -> object:
    (path.parent / "machine.toml").write_text(text_of_example("machine.md", "machine.toml"), encoding="utf-8")
    return read_session(path.parent)


def read_frames(path: Path) -> object:
    (path.parent / "session.toml").write_text("", encoding="utf-8")
    return read_session(path.parent)


READERS: dict[str, Callable[[Path], Any]] = {
    "machine.toml": geoerr.machine.read_machine,
    "observations.csv": read_observations,
    "circle.csv": read_circular_test,
    "lengths.csv": read_lengths,
    "session.toml": read_whole_session,
    "frames.csv": read_frames,
    "rig.json": geoerr.vision.rig.read_rig,
    "errors.json": geoerr.model.load.load_model,
    "model.json": geoerr.model.load.load_model,
    "effects.toml": read_own_effects,
    "plan.toml": read_plan,
}
ALL_PAGES = sorted(path.name for path in PAGES.glob("*.md"))
EXAMPLES = [(page, fence) for page in ALL_PAGES for fence in _FENCE.finditer(text_of(page))]
REFUSED = [
    (table.example, written, why)
    for page in ALL_PAGES
    for table in tables_of(page)
    if table.header == ("refused", "because")
    for written, why in table.rows
]


def text_of_example(page: str, name: str) -> str:
    return next(fence["text"] for fence in _FENCE.finditer(text_of(page)) if fence["name"] == name)


def said(name: str, text: str, folder: Path) -> str:
    """What a reader says of a file: its refusal, or the rows that it set aside."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    try:
        read = READERS[name](path)
    except GeoerrError as error:
        return str(error)
    return "\n".join(map(str, getattr(read, "set_aside", ())))


def test_every_example_says_what_file_it_is() -> None:
    assert [fence["text"] for _, fence in EXAMPLES if fence["name"] not in READERS] == []
    assert {fence["name"] for _, fence in EXAMPLES} == set(READERS)


@pytest.mark.parametrize(("page", "fence"), EXAMPLES, ids=[f"{page}-{fence['name']}" for page, fence in EXAMPLES])
def test_examples_are_read(page: str, fence: re.Match[str], tmp_path: Path) -> None:
    assert said(fence["name"], fence["text"], tmp_path) == ""


def changed(name: str, text: str, written: str) -> str:
    """The example with a line written otherwise, without a line or column, with a column, or with one row more."""
    word, _, key = written.partition(" `")
    key = key.strip("`")
    if name.endswith(".csv"):
        header, *rows = text.splitlines()
        names = header.split(",")
        if word == "without":
            names[names.index(key)] = f"not_{key}"
            return "\n".join([",".join(names), *rows, ""])
        if word == "with":
            return "\n".join([f"{header},{key}", *(f"{row}," for row in rows), ""])
        return f"{text}{written.strip('`')}\n"
    code = written.strip("`")
    separator = ":" if name.endswith(".json") else "="
    wanted = key if word == "without" else code.partition(separator)[0].strip()
    lines = text.splitlines()
    if name.endswith(".json"):
        return _json_changed(text, wanted.strip('"'), code)
    if not any(_key(line, separator) == wanted for line in lines):
        return f"{text}{code}\n"
    place = next(n for n, line in enumerate(lines) if _key(line, separator) == wanted)
    return "\n".join([*lines[:place], *([] if word == "without" else [code]), *lines[place + 1 :], ""])


def _key(line: str, separator: str) -> str:
    return line.partition(separator)[0].strip() if separator in line else ""


def _json_changed(text: str, key: str, code: str) -> str:
    """The document with the first value of a key replaced; a key that it has not goes into `errors`."""
    value = json.loads("{" + code.rstrip(",") + "}")[key]
    document = json.loads(text)
    pending = [document]
    while pending:
        inside = pending.pop(0)
        if isinstance(inside, dict) and key in inside:
            inside[key] = value
            return json.dumps(document)
        pending += inside.values() if isinstance(inside, dict) else inside if isinstance(inside, list) else []
    document["errors"][key] = value
    return json.dumps(document)


@pytest.mark.parametrize(("example", "written", "why"), REFUSED, ids=[f"{e[0]}-{w}" for e, w, _ in REFUSED])
def test_what_is_refused_is_refused_with_these_words(
    example: tuple[str, str], written: str, why: str, tmp_path: Path
) -> None:
    name, text = example
    assert why in said(name, changed(name, text, written), tmp_path)


def words_of(page: str) -> set[str]:
    """All that a page writes as code, its examples aside."""
    return set(_CODE.findall(_FENCE.sub("", text_of(page))))


def columns_on(page: str, anchor: str) -> set[str]:
    table = next(one for one in tables_of(page) if one.anchor == anchor and one.header[0] == "column")
    return {name for row in table.rows for name in _CODE.findall(row[0])}


@pytest.mark.parametrize(
    ("page", "anchor", "known"),
    [
        ("observations.md", "measured-points", POINT_COLUMNS),
        ("observations.md", "circular-tests", CIRCLE_COLUMNS),
        ("observations.md", "lengths", LENGTH_COLUMNS),
    ],
)
def test_every_column_that_a_reader_knows_is_on_the_page_and_no_other(page: str, anchor: str, known: Any) -> None:
    assert columns_on(page, anchor) == set(known.columns)


def test_columns_of_frames_and_those_that_they_may_not_have() -> None:
    assert columns_on("session.md", "framescsv") == set(FRAME_COLUMNS.columns)
    sentence = re.search(r"What measuring gives cannot stand here: (.*)\.\n", text_of("session.md"))
    assert sentence is not None
    names = " ".join(_CODE.findall(sentence[1])).split()
    assert set(names) == set(FORBIDDEN_COLUMNS) - {"cxy", "cxz", "cyy", "cyz"}


def test_needed_columns_are_said_to_be() -> None:
    for anchor, known in (("measured-points", POINT_COLUMNS), ("circular-tests", CIRCLE_COLUMNS)):
        table = next(one for one in tables_of("observations.md") if one.anchor == anchor)
        needed = {name for row in table.rows if row[2].startswith("needed") for name in _CODE.findall(row[0])}
        assert needed == set(known.required)


def keys_in(page: str, *anchors: str) -> set[str]:
    """Keys that the tables of a section describe."""
    tables = [one for one in tables_of(page) if one.anchor in anchors and one.header[0].startswith("key")]
    return {name for table in tables for row in table.rows for name in _CODE.findall(row[0])}


def test_keys_of_effects() -> None:
    page = keys_in("effects.md", "owntoml-effects-of-your-own")
    with_others = words_of("effects.md")
    assert page <= set(EFFECT_KEYS)
    assert {*EFFECT_KEYS, *PARAMETER_KEYS} <= with_others


class Asked(dict[str, Any]):
    """A document that remembers which of its keys were asked for."""

    def __init__(self, content: dict[str, Any], place: str, keys: set[str]) -> None:
        super().__init__({key: _asked(value, f"{place}{key}.", keys) for key, value in content.items()})
        self.place, self.keys_asked = place, keys

    def _note(self, key: object) -> None:
        self.keys_asked.add(f"{self.place}{key}")

    def get(self, key: str, default: Any = None) -> Any:
        self._note(key)
        return super().get(key, default)

    def __getitem__(self, key: str) -> Any:
        self._note(key)
        return super().__getitem__(key)

    def __contains__(self, key: object) -> bool:
        self._note(key)
        return super().__contains__(key)


def _asked(value: Any, place: str, keys: set[str]) -> Any:
    if isinstance(value, dict):
        return Asked(value, place, keys)
    return [_asked(one, place, keys) for one in value] if isinstance(value, list) else value


def keys_asked(
    monkeypatch: pytest.MonkeyPatch, module: ModuleType, reader: str, page: str, name: str, folder: Path
) -> set[str]:
    """Keys that a reader asks for in all examples of a file."""
    keys: set[str] = set()
    real = getattr(module, reader)
    monkeypatch.setattr(module, reader, lambda path: Asked(real(path), "", keys))
    for fence in _FENCE.finditer(text_of(page)):
        if fence["name"] == name:
            assert said(name, fence["text"], folder) == ""
    return keys


def test_keys_of_a_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = keys_asked(monkeypatch, geoerr.machine, "read_toml", "machine.md", "machine.toml", tmp_path)
    rows = {f"dh.{key}" for key in keys_in("machine.md", "as-denavithartenberg-rows")}
    on_page = keys_in("machine.md", "machinetoml") | rows | {"machine", "axes", "axes.x", "axes.y", "axes.z", "dh"}
    assert asked <= on_page | {"axes.y.material", "axes.z.material"}
    assert on_page <= asked


def test_keys_of_a_session(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = keys_asked(monkeypatch, geoerr.vision.session, "read_toml", "session.md", "session.toml", tmp_path)
    assert asked == keys_in("session.md", "sessiontoml") | {"board", "targets", "scale_bars"}


def test_keys_of_a_rig(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = keys_asked(monkeypatch, geoerr.vision.rig, "read_json", "session.md", "rig.json", tmp_path)
    assert asked == keys_in("session.md", "rigjson") - {"schema"} | {"right_from_left"}


def test_keys_of_errors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = keys_asked(monkeypatch, geoerr.model.load, "read_json", "models.md", "errors.json", tmp_path)
    asked = {re.sub(r"^errors\.E\w+", "errors.*", key) for key in asked if not key.startswith("machine.")}
    # What tells a model.json from it, and entries of a list.
    asked -= {"terms", "errors.*", "not_determined.name", "not_determined.why", "data"}
    assert asked == keys_in("models.md", "errorsjson")


def test_keys_of_a_model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = keys_asked(monkeypatch, geoerr.model.load, "read_json", "models.md", "model.json", tmp_path)
    top = {key for key in asked if not key.startswith(("machine.", "terms.")) and key != "data"}
    of_terms = {key.removeprefix("terms.") for key in asked if key.startswith("terms.")}
    on_page = keys_in("models.md", "modeljson")
    # `basis` is described beside the keys of terms, and stands in a part.
    assert top | {key for key in of_terms if "." not in key} == on_page - {"basis"}
    words = words_of("models.md")
    assert {key.rpartition(".")[2] for key in of_terms} <= words | {"what", "within"}


def test_functions_of_every_basis_are_on_the_page() -> None:
    of_bases = [one for one in tables_of("models.md") if one.header[0] == "`kind` of a basis"]
    assert {kind for table in of_bases for row in table.rows for kind in _CODE.findall(row[0])} == {
        *get_args(BasisKind),
        "is_tangent_integral",
    }


def test_keys_of_a_plan(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: set[str] = set()
    for method in ("table", "tables", "number", "whole", "numbers", "text", "flag"):
        real = getattr(Entries, method)

        def noting(self: Entries, name: str, *words: Any, real: Any = real, **more: Any) -> Any:
            asked.add(re.sub(r"\[\d+\]", "", self.key(name)))
            return real(self, name, *words, **more)

        monkeypatch.setattr(Entries, method, noting)
    text = text_of_example("simulation.md", "plan.toml")
    # Other ways to say the same, which the example has no room for.
    others = {
        "count = 21": "start = 0.0\nstop = 100.0\nstep = 5.0",
        "roll_urad = 400.0": 'carriage = "length"\ncarriage_length_mm = 80.0',
        "start = 20.0\nend = 60.0\ntau_s = 600.0": "t_s = [0.0, 60.0]\nvalue = [20.0, 21.0]",
        "offset_mm = [0.0, 0.0, 0.0]": "offset_mm = [0.0, 0.0, 0.0]\nfacing_mm = [0.0, 0.0, 500.0]",
    }
    assert said("plan.toml", text, tmp_path) == ""
    assert said("plan.toml", text.replace("count = 21", "positions = [0.0, 50.0]"), tmp_path) == ""
    for here, there in others.items():
        text = text.replace(here, there)
    assert said("plan.toml", text, tmp_path) == ""
    words = words_of("simulation.md") | words_of("session.md")
    last = {
        key.rpartition(".")[2] for key in asked if not re.search(r"parameters\.|squareness_mrad\.|tables\.E", key)
    }
    assert last <= {part for word in words for part in word.split(".")} | {"y", "z", "temp_bed"}
    on_page = {
        re.sub(r"\.\*$", "", key) for key in keys_in("simulation.md", "plantoml-truthjson-and-a-simulated-session")
    }
    assert on_page - {"machine", "axes"} <= {re.sub(r"^errors\.[xyz]\.", "errors.", key) for key in asked}


def test_hidden_effects_are_listed() -> None:
    sentence = re.search(r"Hidden effects there are: (.*?)\. ", text_of("simulation.md"), re.DOTALL)
    assert sentence is not None
    assert tuple(_CODE.findall(sentence[1])) == AVAILABLE_EFFECTS


class Keys(NamedTuple):
    """Keys of a document as a section of a page has them: patterns of paths, and those below which anything goes."""

    paths: frozenset[str]
    open_below: frozenset[str]


@cache
def keys_of(page: str, anchor: str) -> Keys:
    """Keys that a section describes, those of the sections that it refers to among them."""
    tables = [one for one in tables_of(page) if one.anchor == anchor and one.header[0] == "key"]
    assert tables, f"{page} has no table of keys under #{anchor}"
    paths: set[str] = set()
    open_below: set[str] = set()
    for row in (row for table in tables for row in table.rows):
        link = _LINK.search(row[-1])
        for key in _CODE.findall(row[0]) or [""]:
            if link is None:
                paths.add(key)
                continue
            other = link[1] or page
            if not other.startswith("json"):
                paths.add(key)
                open_below.add(key)
                continue
            inner = keys_of(other, link[2])
            prefix = f"{key}." if key else ""
            # What may be null as a whole, and is described elsewhere.
            paths |= {key} - {""} | {prefix + one for one in inner.paths}
            open_below |= {prefix + one for one in inner.open_below}
    return Keys(frozenset(paths), frozenset(open_below))


def leaves(document: Any, place: str = "") -> Iterator[tuple[str, bool]]:
    """Paths of all values, `.key` and `[]` for every entry of a list, and whether anything stands there."""
    if isinstance(document, dict) and document:
        for key, value in document.items():
            name = key.replace(".", "·")
            yield from leaves(value, f"{place}.{name}" if place else name)
    elif isinstance(document, list) and document and isinstance(document[0], dict):
        for value in document:
            yield from leaves(value, f"{place}[]")
    else:
        yield (f"{place}[]" if isinstance(document, list) else place), document in (None, {}, [])


def pattern_of(keys: frozenset[str] | set[str], below: str) -> re.Pattern[str]:
    texts = [re.escape(key).replace(r"\*", r"[^.\[\]]*") for key in sorted(keys)]
    return re.compile(f"(?:{'|'.join(texts)}){below}" if texts else "(?!)")


def not_described(document: Any, keys: Keys) -> list[str]:
    """Paths of a document that a page does not have; where nothing stands, what may stand below is enough."""
    here, below = pattern_of(keys.paths, r"\Z"), pattern_of(keys.open_below, r"(\[\])*(\..*)?\Z")
    above = {key[: found.start()] for key in keys.paths for found in re.finditer(r"[.\[]", key)}
    empty = pattern_of(above | keys.paths, r"(\[\])?\Z")
    found = dict.fromkeys(leaves(document))
    return [
        path
        for path, is_empty in found
        if not (here.match(path) or below.match(path) or (is_empty and empty.match(path)))
    ]


def virtual_machines() -> ModuleType:
    spec = importlib.util.spec_from_file_location("virtual_machines", ROOT / "examples" / "virtual_machines.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


Documents = dict[str, Any]


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> Documents:
    """What verbs print of small machines."""
    folder = tmp_path_factory.mktemp("json")
    machines = virtual_machines()
    for name in ("warm-mill", "circles"):
        (folder / name).mkdir()
        machines.main(name, folder / name)
    points, circle = folder / "warm-mill" / "observations.csv", folder / "circles" / "circle.csv"
    for path, kept in (
        (points, lambda n, row: row.split(",")[1] in "01"),
        (circle, lambda n, row: n < 362 and n % 5 == 0),
    ):
        header, *rows = path.read_text(encoding="utf-8").splitlines()
        fewer = [row for n, row in enumerate(rows) if kept(n, row)]
        path.write_text("\n".join([header, *fewer, ""]), encoding="utf-8")
    (folder / "lengths.csv").write_text(text_of_example("observations.md", "lengths.csv"), encoding="utf-8")
    (folder / "part.gcode").write_text(
        "G21\nG90\nG0 X50 Y50 Z20\nG1 X350 Y50 F1200\nG1 X350 Y350\n", encoding="utf-8"
    )
    machine, model, errors = folder / "warm-mill" / "machine.toml", folder / "model.json", folder / "errors.json"
    few = ("--components", "12", "--add", "backlash:x")
    calls: dict[str, tuple[object, ...]] = {
        "fit": ("fit", points, "--machine", machine, *few, "-o", model),
        "fit of both": ("fit", points, circle, "--machine", machine, "--components", "none", "--add", "scale:x"),
        "add": ("add", model, points, "backlash:y"),
        "remove": ("remove", model, points, "backlash:x"),
        "compare": ("compare", model, points),
        "compare all": ("compare", machine, points, circle, folder / "lengths.csv"),
        "compare lengths": ("compare", machine, folder / "lengths.csv"),
        "diagnose": ("diagnose", model, points),
        "diagnose circles": ("diagnose", machine, circle),
        "identify": ("identify", points, "--machine", machine, "-o", errors),
        "identify nine": ("identify", points, "--machine", machine, "--method", "nine-line"),
        "compensate": ("compensate", model, folder / "part.gcode", "-o", folder / "out.gcode"),
        "verify path": ("verify", "path", model, folder / "part.gcode", folder / "out.gcode"),
        "verify ballbar": ("verify", "ballbar", errors, "--trace", circle, "--eq23"),
        "verify workpiece": ("verify", "workpiece", folder / "lengths.csv", folder / "lengths.csv"),
        "budget": ("budget", model, "--place", "200,200,100"),
        "states": ("states", f"20={points}", f"60={points}", "--machine", machine),
        "report": ("report", model, points, "--no-search"),
        "target": ("target", "chessboard:10x7:25", "-o", folder / "board.pdf"),
    }
    made = {}
    for name, words in calls.items():
        result = CliRunner().invoke(app, [*map(str, words), "--threads", "1", "--json"])
        assert result.exit_code == 0, (name, result.exception, result.stderr)
        made[name] = json.loads(result.stdout)
    return made


SECTIONS = {
    "fit": ("json.md", "fit-add-remove"),
    "fit of both": ("json.md", "fit-add-remove"),
    "add": ("json.md", "fit-add-remove"),
    "remove": ("json.md", "fit-add-remove"),
    "compare": ("json.md", "compare"),
    "compare all": ("json.md", "compare"),
    "compare lengths": ("json.md", "compare"),
    "diagnose": ("json_diagnose.md", "diagnose"),
    "diagnose circles": ("json_diagnose.md", "diagnose"),
    "identify": ("json.md", "identify"),
    "identify nine": ("json.md", "identify"),
    "compensate": ("json_others.md", "compensate"),
    "verify path": ("json_others.md", "verify-path"),
    "verify ballbar": ("json_others.md", "verify-ballbar"),
    "verify workpiece": ("json_others.md", "verify-workpiece"),
    "budget": ("json_others.md", "budget"),
    "states": ("json_others.md", "states"),
    "report": ("json_others.md", "report"),
    "target": ("json_others.md", "target"),
}


@pytest.mark.parametrize("name", SECTIONS)
def test_every_key_of_a_document_is_on_the_page(documents: Documents, name: str) -> None:
    assert not_described(documents[name], keys_of(*SECTIONS[name])) == []


def test_a_key_that_no_page_has_is_seen(documents: Documents) -> None:
    document = {**documents["compare"], "new_um": 1.0, "worst": [{"line": "x", "colour": None}]}
    assert not_described(document, keys_of("json.md", "compare")) == ["worst[].colour", "new_um"]


def test_the_pages_have_no_key_that_no_document_has(documents: Documents) -> None:
    """Shown by a document, or at least written by the code: small machines have no gross rows, for one."""
    written = set(re.findall(r'"(\w+)"', "".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))))
    shown: dict[tuple[str, str], set[str]] = {}
    for name, section in SECTIONS.items():
        shown.setdefault(section, set()).update(path for path, _ in leaves(documents[name]))
    stale = []
    for section, paths in shown.items():
        for key in sorted(keys_of(*section).paths):
            is_shown = any(map(pattern_of({key}, r"(\[\])*(\..*)?\Z").match, paths))
            last = re.findall(r"\w+", key)[-1]
            if not is_shown and last not in written:
                stale.append((section[1], key))
    assert stale == []


WHERE = Where("X", 3.0, 9.0, (200.0, 0.0, 0.0), (Span("temp", "high", 30.0, 40.0, 5.0),))


def test_keys_of_what_has_no_name_and_of_a_moment() -> None:
    period = Parameter("P", "s", 21.7, 0.01)
    curve = Curve("x", ("feed",), (np.zeros(2),), np.zeros(2), np.ones(2), period)
    unknown = Unknown(
        ("feed",), "x", 12.0, 1e-3, WHERE, np.zeros((1, 3)), "empirical:x@feed", curve, HeldOut(5.0, 2.0)
    )
    assert not_described(unknown.to_document(), keys_of("json_diagnose.md", "structure-without-a-name")) == []
    moment = {"parameters": {"t0": Moment("hot", 812.0, (810.0, 816.0), "s").to_document()}}
    assert not_described(moment, keys_of("json_diagnose.md", "a-finding")) == []


def test_keys_of_a_farm_and_of_a_check() -> None:
    farm = Farm((Outcome("one", "fit", files=("one/model.json",)), Outcome("two", "read", error="no")))
    assert not_described(farm.to_document(), keys_of("json_others.md", "farm")) == []
    check = Check("python", "ok", "3.11").to_document()
    document = {"ok": True, "installation": [check], "files": [check]}
    assert not_described(document, keys_of("json_others.md", "doctor")) == []


@pytest.mark.parametrize(
    ("function", "section"),
    [
        (Calibration.to_document, "calibrate"),
        (ScaleBarResult.to_document, "calibrate"),
        (Measured.to_document, "measure"),
        (geoerr.cli.simulate, "simulate"),
        (geoerr.cli.demo, "demo-workbench"),
    ],
)
def test_keys_of_what_needs_pictures(function: Any, section: str) -> None:
    """By what the code writes; pictures take longer than a page is worth."""
    named = {word for key in keys_of("json_others.md", section).paths for word in re.findall(r"\w+", key)}
    assert set(re.findall(r'"(\w+)":', inspect.getsource(function))) <= named


def test_every_verb_has_its_keys_on_a_page() -> None:
    anchors = {table.anchor for page in ALL_PAGES if page.startswith("json") for table in tables_of(page)}
    verbs = {word for anchor in anchors for word in anchor.split("-")}
    assert set(VERBS) <= verbs


def test_every_page_is_in_the_table_of_files() -> None:
    overview = (PAGES.parent / "formats.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(formats/(\w+\.md)", overview)) == set(ALL_PAGES)
