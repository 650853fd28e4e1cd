from __future__ import annotations

import copy
import json
import math
import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoerr import _core
from geoerr.bases import basis_of
from geoerr.errors import InputFileError, ShapeError
from geoerr.terms import (
    CHANNELS,
    BasisSpec,
    EffectReference,
    Parameter,
    Part,
    Plausible,
    Term,
    UsualSpan,
    is_rig_channel,
    parse_effect_reference,
)

TERM = Term(
    "thermal-expansion:x@temp_bed",
    "Thermal expansion",
    "effect",
    "thermal-expansion",
    "x",
    "temp_bed",
    (
        Part("EXX", "alpha*T*(q - q_fixed)", (("q", "x"), ("T", "lag(temp_bed - 20.0, tau)"))),
        Part("EYX", "1e-3*alpha*v", (("v", "v_x"),), factor=-1.0),
    ),
    (Parameter("alpha", "1/K", 1.1e-5, 2e-7, (Plausible(11.5e-6, "steel", 0.06),)),),
    (
        Parameter("q_fixed", "mm", plausible=(UsualSpan(0.0, 50.0, "a screw", "ISO"),), low=0.0, high=400.0),
        Parameter("tau", "s", low=10.0, high=1e4, spacing="log"),
    ),
)
BASES = (
    BasisSpec("bspline", "x", knots_mm=(0.0, 100.0, 250.0, 400.0), degree=3),
    BasisSpec("bspline", "y", knots_mm=(0.0, 100.0, 250.0), degree=2, is_tangent_integral=True),
    BasisSpec("polynomial", "z", low_mm=-5.0, high_mm=5.0, degree=4),
    BasisSpec("fourier", "x", low_mm=0.0, high_mm=400.0, period_mm=40.0, order=3),
    BasisSpec("linear", "x", knots_mm=(0.0, 1.0, 5.0)),
    BasisSpec("quadratic", "x", knots_mm=(0.0, 1.0, 5.0, 6.0, 7.0)),
)


def smooth(basis: BasisSpec) -> Term:
    coefficients = tuple(Parameter(f"c{n}", "mm") for n in range(basis.n_functions))
    return Term("EXX", "Positioning", "classic", None, basis.axis, None, (Part("EXX", basis=basis),), coefficients)


def test_channels_are_the_core_s() -> None:
    assert tuple(_core.CHANNELS) == CHANNELS


@pytest.mark.parametrize("basis", BASES, ids=lambda basis: basis.kind)
def test_a_basis_has_as_many_functions_as_the_core_makes_of_it(basis: BasisSpec) -> None:
    assert basis.n_functions == len(basis_of(basis))


@pytest.mark.parametrize("term", [TERM, *map(smooth, BASES)], ids=lambda term: term.id)
def test_a_term_comes_back_as_it_was(term: Term) -> None:
    document = json.loads(json.dumps(term.to_document(), allow_nan=False))
    again = Term.from_document(document, "model.json")
    assert again == term
    assert hash(again) == hash(term)
    assert again.to_document() == term.to_document()
    assert pickle.loads(pickle.dumps(term)) == term


def test_an_unknown_value_equals_an_unknown_value_and_no_other() -> None:
    assert Parameter("k", "mm", float("nan")) == Parameter("k", "mm", math.nan)
    assert Parameter("k", "mm", 0.0) != Parameter("k", "mm")


def test_values_are_put_in_by_order() -> None:
    changed = TERM.with_values([2e-5], [100.0, 60.0], coefficients_std=[1e-7])
    assert changed.coefficients[0].value == 2e-5
    assert changed.coefficients[0].std == 1e-7
    assert [parameter.value for parameter in changed.inner] == [100.0, 60.0]
    assert math.isnan(changed.inner[0].std)
    assert TERM.coefficients[0].value == 1.1e-5
    with pytest.raises(ShapeError, match="2 numbers for 1 parameters"):
        TERM.with_values([1.0, 2.0])


def test_variables_are_found_through_definitions() -> None:
    assert set(TERM.variables) == {"x", "temp_bed", "v_x"}
    assert TERM.needs == ("temp_bed",)


def test_inside_a_lag_a_speed_is_a_mean_speed() -> None:
    part = Part("EXX", "k*lag(abs(v), tau)", (("v", "v_x"),))
    assert set(part.names) == {"k", "tau", "v_x", "mean_v_x"}


def test_windup_reads_direction_and_travel() -> None:
    part = Part("EYY", "b*windup(lambda)", (("d", "d_y"), ("s", "s_y")))
    assert set(part.names) == {"b", "lambda", "d_y", "s_y"}


def test_a_number_s_exponent_is_no_name() -> None:
    assert Part("EXX", "k*1e5*x + 2.5E-3*k").names == ("k", "x")


def test_rig_and_machine_do_not_share_a_term() -> None:
    assert is_rig_channel("motion-x")
    assert not is_rig_channel("target-x")
    parts = (Part("rig-tx", "k"), Part("EXX", "k"))
    with pytest.raises(ShapeError, match="cannot share a term"):
        Term("a", "", "effect", "a", None, None, parts, (Parameter("k", "mm"),))


@pytest.mark.parametrize(
    ("text", "effect", "axis", "covariate"),
    [
        ("rig-scale", "rig-scale", None, None),
        ("backlash:x", "backlash", "x", None),
        ("squareness:xz", "squareness", "xz", None),
        ("cross-coupling:y*x", "cross-coupling", "y*x", None),
        ("thermal-drift:work-z@temp", "thermal-drift", "work-z", "temp"),
        ("bed-bow@temp_a-temp_b", "bed-bow", None, "temp_a-temp_b"),
    ],
)
def test_references(text: str, effect: str, axis: str | None, covariate: str | None) -> None:
    reference = parse_effect_reference(text)
    assert reference == EffectReference(effect, axis, covariate)
    assert str(reference) == text


@pytest.mark.parametrize(
    "text",
    [
        *("", ":x", "Backlash", "backlash:", "backlash:w", "backlash:yx", "a b", "a@", "a@temp bed", "a@t-u-v"),
        *("backlash:x*x", "a@temp-temp", "a@b@c", "a:x:y", "backlash :x", "a--b", "a\n"),
    ],
)
def test_what_is_no_reference_is_refused_with_a_remedy(text: str) -> None:
    with pytest.raises(InputFileError, match="hint:"):
        parse_effect_reference(text)


@pytest.mark.parametrize(
    ("keys", "value", "where"),
    [
        (("parts", 0, "channel"), "EXW", r"term.parts\[1\]"),
        (("parts", 0, "channel"), "rig-tx", "term"),
        (("parts", 0, "expression"), 5, r"term.parts\[1\].expression"),
        (("parts", 0, "expression"), None, r"term.parts\[1\]"),
        (("parts", 0, "expression"), "x" * 5000, r"term.parts\[1\].expression"),
        (("parts", 0, "definitions"), {"a b": "x"}, r"term.parts\[1\]"),
        (("parts", 0, "definitions"), {"q": 5}, r"term.parts\[1\].definitions.'q'"),
        (("parts", 0, "factor"), "2", r"term.parts\[1\].factor"),
        (("parts", 0, "factor"), 10**400, r"term.parts\[1\].factor"),
        (("parts",), {}, "term.parts"),
        (("parts",), [], "term"),
        (("coefficients",), [], "term"),
        (("coefficients", 0, "name"), "1a", r"term.coefficients\[1\]"),
        (("coefficients", 0, "std"), -1.0, r"term.coefficients\[1\]"),
        (("coefficients", 0, "low"), 0.0, r"term.coefficients\[1\]"),
        (("coefficients", 0, "sign"), "up", r"term.coefficients\[1\].sign"),
        (("coefficients", 0, "plausible"), [{"value": 1.0}], r"term.coefficients\[1\].plausible\[1\].what"),
        (("inner", 0, "plausible", 0, "high"), 0.0, r"term.inner\[1\].plausible\[1\]"),
        (("inner", 0, "plausible", 0, "low"), -1.0, r"term.inner\[1\].plausible\[1\]"),
        (("inner", 0, "plausible", 0, "value"), 1.0, r"term.inner\[1\].plausible\[1\].value"),
        (("inner", 0, "plausible", 0, "source"), 1.0, r"term.inner\[1\].plausible\[1\].source"),
        (("inner", 0, "plausible"), [{"low": 1.0, "what": "a screw"}], r"term.inner\[1\].plausible\[1\].high"),
        (("inner", 0, "low"), 500.0, r"term.inner\[1\]"),
        (("inner", 1, "low"), 0.0, r"term.inner\[2\]"),
        (("inner", 0, "low"), None, r"term.inner\[1\]"),
        (("inner", 0, "name"), "alpha", "term"),
        (("inner", 0, "name"), "tau", "term"),
        (("kind",), "magic", "term"),
        (("source",), None, "term.source"),
        (("effect",), None, "term"),
        (("axis",), "w", "term"),
        (("covariate",), "a-b-c", "term"),
        (("id",), "two words", "term"),
    ],
)
def test_a_wrong_document_is_refused_by_file_and_key(keys: tuple[object, ...], value: object, where: str) -> None:
    document = copy.deepcopy(TERM.to_document())
    table = document
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = value
    with pytest.raises(InputFileError, match=f"^model.json: {where}: "):
        Term.from_document(document, "model.json")


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"degree": None}, "needs degree"),
        ({"order": 3}, "has no order"),
        ({"degree": -1}, "degree -1"),
        ({"degree": True}, "degree: True"),
        ({"knots_mm": [0.0]}, "rise strictly"),
        ({"knots_mm": [0.0, 0.0]}, "rise strictly"),
        ({"knots_mm": [1.0, 0.0]}, "rise strictly"),
        ({"knots_mm": []}, "do not fit"),
        ({"kind": "wavelet"}, "not known"),
        ({"axis": "w"}, "not x, y or z"),
        ({"is_tangent_integral": 1}, "neither true nor false"),
    ],
)
def test_a_wrong_basis_is_refused(changes: dict[str, object], problem: str) -> None:
    document = BASES[0].to_document() | changes
    with pytest.raises(InputFileError, match=problem) as caught:
        BasisSpec.from_document(document, "model.json", "basis")
    assert caught.value.column is not None
    assert caught.value.column.startswith("basis")


def test_coefficients_pair_with_functions() -> None:
    with pytest.raises(ShapeError, match="6 basis functions"):
        Term("EXX", "", "classic", None, "x", None, (Part("EXX", basis=BASES[0]),), (Parameter("c", "mm"),))


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


def _paths(document: object, here: tuple[object, ...] = ()) -> list[tuple[object, ...]]:
    items = document.items() if isinstance(document, dict) else enumerate(document)
    paths = []
    for key, value in items:
        paths.append((*here, key))
        if isinstance(value, dict | list):
            paths += _paths(value, (*here, key))
    return paths


@settings(max_examples=400)
@given(data=st.data(), n_changes=st.integers(1, 3))
def test_mangled_documents_are_refused_or_read_and_nothing_else(data: st.DataObject, n_changes: int) -> None:
    document = copy.deepcopy(data.draw(st.sampled_from([TERM, *map(smooth, BASES)])).to_document())
    for _ in range(n_changes):
        path = data.draw(st.sampled_from(_paths(document)))
        table = document
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = data.draw(_JSON)
    try:
        term = Term.from_document(document, "model.json")
    except InputFileError:
        return
    assert Term.from_document(json.loads(json.dumps(term.to_document())), "model.json") == term


@settings(max_examples=100)
@given(document=_JSON)
def test_anything_else_is_refused(document: object) -> None:
    with pytest.raises(InputFileError):
        Term.from_document(document, "model.json")
