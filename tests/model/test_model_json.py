"""model.json: without loss, the same bytes, and safe to open from anywhere."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fitted_models import (
    backlash,
    classic_terms,
    drawn_record,
    expansion,
    fitted,
    rig_scale,
    squareness,
    with_stds,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from model_machines import drawn_errors, machine

from geoerr.effects.wording import with_words
from geoerr.error_functions import NotDetermined
from geoerr.errors import InputFileError
from geoerr.files import to_json
from geoerr.model import FitRecord, HistoryEntry, Model, load_model, write_model
from geoerr.model.document import document_of, model_from_document
from geoerr.terms import BasisSpec, Parameter, Part, Plausible, Term, UsualSpan

AT = {"temp_bed": 60.0, "d_y": 1.0}

# The parser's stack and Python's: both end before this.
DEEP = 100_000


def points(n: int = 20, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 400.0, (n, 3))


numbers = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e300, max_value=1e300)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
names = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
figures = st.dictionaries(texts, st.one_of(numbers, st.just(math.nan)), max_size=3)
spans = st.tuples(numbers, numbers).map(lambda pair: (min(pair), max(pair)))
values = numbers.map(lambda value: Plausible(value, "what"))
usual = numbers.map(lambda value: UsualSpan(0.0, abs(value) or 1.0, "what", "who says so"))


@st.composite
def parameters(draw: st.DrawFn, inner: bool) -> Parameter:
    low, high = draw(spans) if inner else (None, None)
    return Parameter(
        draw(names.filter(lambda name: name not in {"x", "y", "z", "t", "pi", "a", "d", "s", "v"})),
        draw(texts),
        draw(st.one_of(st.just(math.nan), numbers)),
        draw(st.one_of(st.just(math.nan), numbers.map(abs))),
        draw(st.lists(st.one_of(values, usual), max_size=2).map(tuple)),
        low,
        high,
    )


@st.composite
def terms(draw: st.DrawFn, number: int) -> Term:
    if draw(st.booleans()):
        knots = sorted(draw(st.sets(st.integers(-1000, 1000), min_size=2, max_size=6)))
        scale = draw(st.floats(1e-3, 1e3))
        basis = BasisSpec("bspline", draw(st.sampled_from("xyz")), tuple(knot * scale for knot in knots), 3)
        own = tuple(
            Parameter(f"c{place}", "mm", draw(st.one_of(st.just(math.nan), numbers)))
            for place in range(basis.n_functions)
        )
        part = Part(draw(st.sampled_from(["EXX", "ECZ", "tool-x"])), basis=basis, factor=draw(st.floats(-9.0, 9.0)))
        return Term(f"f{number}", draw(texts), "empirical", None, None, None, (part,), own)
    own = (dataclasses.replace(draw(parameters(False)), name="alpha"),)
    phi = (dataclasses.replace(draw(parameters(True)), name="tau"),)
    part = Part("S_xz", expression="alpha*T*tau", definitions=(("T", "temp_bed - 20"),))
    return Term(f"e{number}", draw(texts), "effect", "own-effect", "xz", "temp_bed", (part,), own, phi, "user")


@st.composite
def models(draw: st.DrawFn) -> Model:
    drawn = tuple(draw(terms(number)) for number in range(draw(st.integers(0, 3))))
    of = dataclasses.replace(machine(), name=draw(texts))
    if not draw(st.booleans()):
        return Model(of, None, drawn)
    size = sum(len(term.coefficients) + len(term.inner) for term in drawn)
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    root = generator.normal(size=(size, size)) * 10.0 ** generator.uniform(-9.0, 3.0, (size, 1))
    covariance = root @ root.T
    directions, _ = np.linalg.qr(generator.normal(size=(size, draw(st.integers(0, size)))))
    entry = HistoryEntry(draw(texts), draw(texts), draw(figures), draw(figures), (draw(parameters(True)),), "removed")
    record = FitRecord(
        0.5 * (covariance + covariance.T),
        directions,
        (NotDetermined(draw(texts), draw(texts)),),
        draw(texts),
        draw(st.integers(0, 2**40)),
        draw(st.integers(0, 9)),
        {"x": draw(spans)},
        {draw(texts): draw(spans)},
        draw(figures),
        draw(figures),
        (entry,),
    )
    return Model(of, None, drawn, record)


class TestRoundTrip:
    @settings(max_examples=150)
    @given(model=models())
    def test_without_loss_and_the_same_bytes(self, model: Model) -> None:
        written = to_json(document_of(model))
        again = model_from_document(json.loads(written), "drawn.json")
        assert again.machine == model.machine
        assert again.terms == model.terms
        assert to_json(document_of(again)) == written
        if model.record is None:
            assert again.record is None
            return
        assert again.record is not None
        for field in dataclasses.fields(FitRecord):
            before, after = getattr(model.record, field.name), getattr(again.record, field.name)
            if isinstance(before, np.ndarray):
                assert np.array_equal(before, after), field.name
            else:
                # Unknown numbers are NaN, which equals nothing; as text they do.
                assert repr(before) == repr(after), field.name

    def test_predictions_survive_a_file(self, tmp_path: Path) -> None:
        made, q = with_stds(fitted(n_null=2)), points()
        # As the catalogue makes terms: of values without words the reader says what the catalogue says.
        terms = tuple(with_words(term, made.machine) for term in made.terms)
        model = dataclasses.replace(made, terms=terms)
        write_model(tmp_path / "model.json", model)
        again = load_model(tmp_path / "model.json")
        assert np.array_equal(again.error_mm(q, at=AT), model.error_mm(q, at=AT))
        covariances = [one.prediction_covariance_mm2(q, at=AT) for one in (model, again)]
        assert np.array_equal(*covariances, equal_nan=True)
        assert again.report() == model.report()
        write_model(tmp_path / "again.json", again)
        assert (tmp_path / "again.json").read_bytes() == (tmp_path / "model.json").read_bytes()

    def test_no_path_and_no_date_in_it(self, tmp_path: Path) -> None:
        write_model(tmp_path / "model.json", fitted())
        text = (tmp_path / "model.json").read_text()
        assert str(tmp_path) not in text
        assert set(json.loads(text)) == {
            *("schema", "machine", "terms", "parameters", "covariance", "null_space", "not_determined"),
            *("data", "noise", "figures", "history"),
        }

    def test_tables_become_terms(self, tmp_path: Path) -> None:
        of = machine("wXbYZt")
        model = Model(of, drawn_errors(of), (rig_scale(), expansion()))
        write_model(tmp_path / "model.json", model)
        again = load_model(tmp_path / "model.json")
        assert again.errors is None
        assert np.array_equal(again.error_mm(points(), at=AT), model.error_mm(points(), at=AT))
        assert again.rig_terms == model.rig_terms

    def test_a_nominal_machine(self, tmp_path: Path) -> None:
        write_model(tmp_path / "model.json", Model(machine()))
        assert load_model(tmp_path / "model.json").is_nominal

    def test_further_keys_are_for_others(self) -> None:
        document = document_of(fitted()) | {"note": {"mine": [1, 2]}}
        document["terms"][0]["colour"] = "blue"
        assert model_from_document(document, "m.json").terms == fitted().terms


def attempted(call: Callable[[], Model]) -> tuple[Model | None, InputFileError | None]:
    """The model, or the one kind of refusal that there may be."""
    try:
        return call(), None
    except InputFileError as error:
        return None, error


def good() -> dict[str, Any]:
    """A small document with every part."""
    kept = (rig_scale(), squareness("S_xy", 1e-4), expansion(), backlash())
    record = drawn_record(kept, n_null=1)
    return json.loads(to_json(document_of(Model(machine(), None, kept, record))))


def put(document: Any, place: str, value: Any) -> Any:
    """Set `a.b.0.c`; the value `...` deletes."""
    document = copy.deepcopy(document)
    *path, last = [int(key) if key.isdigit() else key for key in place.split(".")]
    inner = document
    for key in path:
        inner = inner[key]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return document


class TestRefusals:
    @pytest.mark.parametrize(
        ("place", "value", "problem"),
        [
            ("schema", "geoerr-model/2", r"m\.json: schema: schema 'geoerr-model/2' is not known.*\n.*update geoerr"),
            ("schema", "geoerr-model/x", "schema: 'geoerr-model/x' is not a schema"),
            ("schema", ..., "schema: the schema is missing"),
            ("machine", ..., "machine: holds no machine"),
            ("machine.machine.chain", "wXt", "machine.chain: 'wXt' is not"),
            ("terms", {}, r"terms: a table of 0 entries is not a list"),
            ("terms.0", 7, r"terms\[1\]"),
            ("terms.1.id", ..., r"terms\[2\]\.id: is missing"),
            ("terms.1.parts.0.channel", "S_yx", r"terms\[2\]\.parts\[1\]: channel 'S_yx'"),
            ("terms.1.parts.0.expression", "S*(1", r"terms: term S_xy, on S_xy"),
            ("terms.1.parts.0.expression", "__import__('os').system('true')", "terms: term S_xy, on S_xy"),
            ("terms.1.parts.0.expression", "S*S", "terms: term S_xy, on S_xy"),
            ("terms.1.id", "backlash:y", "terms: the model has two terms backlash:y"),
            ("parameters.0", "rig-scale.q", "parameters: does not name the parameters"),
            ("covariance", 1.0, "covariance: 1.0 is not a list"),
            ("covariance.4", ..., "covariance: has 4 rows for 5 parameters"),
            ("covariance.1.0", "1", r"covariance\[2\]: has an entry that is not a number"),
            ("covariance.1.0", -1.0, "covariance: covariance has a negative variance"),
            ("covariance.0.1", 1e10, "covariance: covariance is not positive|far beyond"),
            ("covariance.1", [1.0], r"covariance\[2\]: has 1 numbers, 4 are needed"),
            ("null_space.0.0", 2.0, "covariance: null_space has a direction whose length is not 1"),
            ("null_space.0", [], r"null_space\[1\]: has 0 numbers"),
            ("null_space", [[0.0] * 5] * 6, "null_space: has 6 directions of 5"),
            ("data.n_rows", -1, r"data\.n_rows: -1 is not a number of rows"),
            ("data.n_rows", True, r"data\.n_rows: True is not a number of rows"),
            ("data.range_mm.x", [1.0, 0.0], "range_mm of x"),
            ("data.range_mm", {"u": [0.0, 1.0]}, "range_mm has axes u"),
            ("data.covariate_spans.temp_bed", [1.0], r"data\.covariate_spans\.temp_bed: has 1 numbers"),
            ("data", [], "data: a list of 0 entries is not a table"),
            ("noise.floor_um", "x", r"noise\.floor_um: 'x' is not a number"),
            ("figures", None, "figures: None is not a table"),
            ("history.0.action", "found", r"history\[1\]\.action"),
            ("history.0.parameters.0.name", "a b", r"history\[1\]\.parameters\[1\]"),
            ("history.0.reference", 5, r"history\[1\]\.reference: 5 is not a text"),
            ("not_determined.0", "EXX", r"not_determined\[1\]: 'EXX' is not a table"),
            (
                "terms.0.coefficients.0.value",
                10**400,
                r"terms\[1\]\.coefficients\[1\]\.value: is not a finite number",
            ),
            ("machine.machine.tool_offset", [10**400, 0, 0], r"machine\.machine\.tool_offset\[1\]: is not a finite"),
            ("figures.rmse_um", math.inf, r"figures\.rmse_um: is not a finite number"),
            ("extra", math.nan, "extra: is not a finite number"),
        ],
    )
    def test_each_is_named_by_file_and_key(self, place: str, value: Any, problem: str) -> None:
        with pytest.raises(InputFileError, match=problem) as caught:
            model_from_document(put(good(), place, value), "m.json")
        assert caught.value.path == "m.json"

    @pytest.mark.parametrize("content", [[], 3, None, "text"])
    def test_no_table_at_all(self, content: Any) -> None:
        with pytest.raises(InputFileError, match="not a table of keys"):
            model_from_document(content, "m.json")

    @pytest.mark.parametrize(
        ("content", "problem"),
        [
            ("[" * DEEP, "not usable JSON"),
            ('{"schema": "geoerr-model/1", "a": ' + '{"a":' * 60 + "1" + "}" * 61, "nested deeper than 40"),
            ('{"schema": "geoerr-model/1", "a": ' + "9" * 5000 + "}", "not usable JSON"),
            ('{"schema": "geoerr-model/1", "a": NaN}', "a: is not a finite number"),
            ('{"schema": "geoerr-model/1", "a": 1e999}', "a: is not a finite number"),
            ('{"schema": "geoerr-model/1"}', "holds no machine"),
            ('{"terms": []}', "the schema is missing"),
            (b"\xff\xfe{}", "not a text file"),
        ],
    )
    def test_files_made_to_do_harm(self, tmp_path: Path, content: str | bytes, problem: str) -> None:
        path = tmp_path / "model.json"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(InputFileError, match=problem):
            load_model(path)

    def test_a_file_beyond_all_models(self, tmp_path: Path) -> None:
        path = tmp_path / "model.json"
        with path.open("wb") as stream:
            stream.truncate(1 << 40)
        with pytest.raises(InputFileError, match=r"no model is larger"):
            load_model(path)

    def test_definitions_that_would_grow_exponentially(self) -> None:
        document = good()
        part = document["terms"][1]["parts"][0]
        part["definitions"] = {f"a{k}": f"a{k + 1}*a{k + 1}*a{k + 1}" for k in range(100)} | {"a100": "x*x*x"}
        part["expression"] = "S*a0"
        _, refusal = attempted(lambda: model_from_document(document, "m.json"))
        assert refusal is None or refusal.column == "terms"

    def test_too_many_parameters(self) -> None:
        document = good()
        first = document["terms"][1]
        many = [first | {"id": f"t{k}"} for k in range(3001)]
        with pytest.raises(InputFileError, match=r"have 3001 parameters, at most 3000"):
            model_from_document(document | {"terms": many}, "m.json")


PLACES = st.sampled_from(
    [
        *("schema", "machine", "machine.machine", "machine.axes", "machine.axes.x", "machine.axes.x.range"),
        *("terms", "terms.0", "terms.2.parts", "terms.2.parts.0", "terms.2.parts.0.channel"),
        *("terms.2.parts.0.expression", "terms.2.parts.0.definitions", "terms.2.parts.0.definitions.T"),
        *("terms.2.coefficients", "terms.2.coefficients.0", "terms.2.coefficients.0.value", "terms.2.inner.0.low"),
        *("terms.2.coefficients.0.plausible", "terms.2.axis", "terms.2.covariate", "terms.2.kind", "terms.2.id"),
        *(
            "parameters",
            "covariance",
            "covariance.0",
            "covariance.0.0",
            "null_space",
            "null_space.0",
            "null_space.0.1",
        ),
        *("data", "data.digest", "data.n_rows", "data.n_outliers", "data.range_mm", "data.range_mm.x"),
        *("data.covariate_spans", "noise", "noise.floor_um", "figures", "history", "history.0", "history.0.title"),
        *("history.0.figures_after", "history.0.parameters", "not_determined", "not_determined.0"),
    ]
)
ANYTHING = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.just(10**400),
        st.floats(),
        st.text(max_size=30),
        st.sampled_from(
            ["x", "alpha*T", "alpha", "lag(alpha, 1)", "EXX", "rig-scale", "temp_bed", "classic", "((((("]
        ),
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=4)),
    max_leaves=12,
)


class TestFuzz:
    @settings(max_examples=600)
    @given(changes=st.lists(st.tuples(PLACES, st.one_of(ANYTHING, st.just(...))), min_size=1, max_size=2))
    def test_a_changed_file_is_read_or_refused(self, changes: list[tuple[str, Any]]) -> None:
        document = good()
        for place, value in changes:
            try:
                document = put(document, place, value)
            except (KeyError, IndexError, TypeError, AttributeError):
                continue
        model, refusal = attempted(lambda: model_from_document(document, "m.json"))
        if model is None:
            assert refusal is not None
            assert refusal.path == "m.json"
            return
        # What was read can be written, read again and asked.
        again = model_from_document(json.loads(to_json(document_of(model))), "m.json")
        assert to_json(document_of(again)) == to_json(document_of(model))
        assert all(len(line) <= 100 for line in model.report().splitlines())

    @settings(max_examples=200)
    @given(start=st.integers(0, 6000), length=st.integers(0, 40), patch=st.binary(max_size=20))
    def test_changed_bytes_are_read_or_refused(
        self, tmp_path_factory: Any, start: int, length: int, patch: bytes
    ) -> None:
        content = to_json(good()).encode()
        start %= len(content)
        path = tmp_path_factory.getbasetemp() / "patched.json"
        path.write_bytes(content[:start] + patch + content[start + length :])
        model, refusal = attempted(lambda: load_model(path))
        assert model is not None or (refusal is not None and refusal.path == str(path))


def test_a_large_record_is_read_in_reasonable_time(tmp_path: Path) -> None:
    """21 splines of 20 functions: some 350 parameters, 60,000 numbers."""
    many = classic_terms(n_functions=20)
    write_model(tmp_path / "model.json", Model(machine(), None, many, drawn_record(many)))
    again = load_model(tmp_path / "model.json")
    assert again.record is not None
    assert again.record.n_parameters == 363


def test_a_fit_that_has_not_settled_is_remembered() -> None:
    """And only that: files of fits that came to rest are as they were."""
    document = document_of(model_from_document(good(), "model.json"))
    assert "has_settled" not in document
    model = model_from_document({**document, "has_settled": False}, "model.json")
    assert model.record is not None
    assert not model.record.has_settled
    assert document_of(model)["has_settled"] is False
    assert "has not settled" in model.report()
    with pytest.raises(InputFileError, match="has_settled: 'no' is neither true nor false"):
        model_from_document({**document, "has_settled": "no"}, "model.json")
