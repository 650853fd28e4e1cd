from __future__ import annotations

import contextlib
import copy
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest
import tomli_w
from effect_machines import machine
from effect_values import by_channel
from hypothesis import given, settings
from hypothesis import strategies as st

from geoerr.effects import Effect, catalogue, load_catalogue, load_effects
from geoerr.effects.collection import FAMILIES
from geoerr.errors import InputFileError
from geoerr.terms import Plausible, UsualSpan

OWN = """
[[effect]]
id = "belt-stretch"
title = "Stretch of the belt"
channel = "along"
axes = ["x", "y"]
expression = "alpha*T*(q - q_fixed) + c*humidity"
covariates = ["temp"]
looks_like = "a slope"
mistaken_for = [{ effect = "scale", separate_by = "a second temperature" }]
source = "own"
some_key_of_mine = 5
[effect.coefficients.alpha]
unit = "1/K"
plausible = [{ value = 11.5e-6, what = "steel" }]
[effect.coefficients.c]
unit = "mm"
[effect.inner.q_fixed]
unit = "mm"
range = "axis"
"""


def load(tmp_path: Path, text: str) -> tuple[Effect, ...]:
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    return load_effects(path)


def test_a_parameter_that_is_a_column_of_the_data_is_told(tmp_path: Path) -> None:
    """It took the column's place without a word: `c*humidity` with a column `c` was another formula than written."""
    (effect,) = load(tmp_path, OWN)
    columns = ("temp", "humidity")
    assert effect.wanting(columns) is None
    assert effect.wanting((*columns, "c")) == (
        "its parameter 'c' is a column of these data: give one of them another name"
    )
    assert effect.candidates(machine(), (*columns, "c")) == []
    # What the catalogue calls b is told there.
    assert catalogue()["backlash"].wanting((*columns, "b")) is None


def test_a_span_a_value_and_a_reason_are_read(tmp_path: Path) -> None:
    both = '[{ value = 11.5e-6, what = "steel" }, { low = 1, high = 2e1, what = "a belt", source = "its maker" }]'
    text = OWN.replace('[{ value = 11.5e-6, what = "steel" }]', both)
    text = text.replace(
        'unit = "mm"\n[effect.inner', 'unit = "mm"\nplausible = "the weather: any size"\n[effect.inner'
    )
    (effect,) = load(tmp_path, text)
    alpha, c = effect.coefficients
    assert alpha.plausible == (Plausible(11.5e-6, "steel"), UsualSpan(1.0, 20.0, "a belt", "its maker"))
    assert (alpha.any_size, c.plausible, c.any_size) == ("", (), "the weather: any size")
    assert effect.term("x", "temp", machine()).coefficients[0].plausible == alpha.plausible


def test_a_user_s_effect_is_read_like_a_built_in_one(tmp_path: Path) -> None:
    (effect,) = load(tmp_path, OWN)
    assert effect.origin == "user"
    term = effect.term("y", "temp_bed", machine())
    assert term.source == "user"
    assert term.id == "belt-stretch:y@temp_bed"
    assert set(term.needs) == {"temp_bed", "humidity"}
    displaced = by_channel(
        term, {"y": 110.0, "temp_bed": 30.0, "humidity": 2.0, "alpha": 1e-5, "q_fixed": 10.0, "c": 1.0}
    )
    assert displaced == {"EYY": pytest.approx(2.01)}
    assert effect.wanting(("temp",)) == "wanting: the column humidity"
    assert [str(c) for c in effect.candidates(machine(), ("temp", "humidity"))] == [
        "belt-stretch:x@temp",
        "belt-stretch:y@temp",
    ]
    joined = load_catalogue([tmp_path / "own.toml"])
    assert len(joined) == len(catalogue()) + 1
    assert joined.separation("scale", "belt-stretch") is not None


SHORT = """
[[effect]]
id = "own"
{0}
[effect.coefficients.k]
unit = "mm"
"""


@pytest.mark.parametrize(
    ("body", "axis", "channels"),
    [
        ('channel = "tool"\naxes = ["z"]\nexpression = "k"', "z", {"tool-z"}),
        ('channel = "tool"\ndirection = "z"\nexpression = "k"', None, {"tool-z"}),
        ('channel = "work"\naxes = ["z"]\nexpression = "k"', "work-z", {"work-z"}),
        ('channel = "rig"\ndirection = "depth"\nexpression = "k"', None, {"rig-depth"}),
        ('channel = "joint"\naxes = ["x"]\ndirection = "z"\nexpression = "k*q^2"', "x", {"EZX"}),
        ('channel = "joint"\naxes = ["x"]\ndirection = "B"\nexpression = "k*q"', "x", {"EBX"}),
        ('channel = "across"\naxes = ["x"]\ndirection = "y"\nexpression = "k*q"', "x", {"EYX"}),
        ('channel = "angular"\naxes = ["x"]\ndirection = "y"\nexpression = "k*q"', "x", {"EBX"}),
        ('channel = "squareness"\naxes = ["xy"]\nexpression = "k"', "xy", {"S_xy"}),
        (
            '[[effect.part]]\nchannel = "along"\naxis = "x"\nexpression = "k*q"\n'
            '[[effect.part]]\nchannel = "along"\naxis = "y"\nexpression = "-k*q + k*x"\n'
            '[[effect.part]]\nchannel = "squareness"\naxis = "xy"\nexpression = "k"\n',
            None,
            {"EXX", "EYY", "S_xy"},
        ),
        ('channel = "along"\naxes = ["x*z"]\nexpression = "k*q_a*sin(q_b/L_b)"', "x*z", {"EXX"}),
        ('channel = "along"\naxes = ["x"]\nexpression = "k*where(q > 5, d, humidity)"', "x", {"EXX"}),
    ],
)
def test_short_ways_to_write_an_effect(tmp_path: Path, body: str, axis: str | None, channels: set[str]) -> None:
    (effect,) = load(tmp_path, SHORT.format(body))
    assert effect.title == "own"
    assert set(effect.term(axis, None, machine()).channels) == channels


@pytest.mark.parametrize(
    ("old", "new", "key", "problem"),
    [
        ('id = "belt-stretch"', 'id = "backlash"', "id", "built-in"),
        ('id = "belt-stretch"', 'id = "Belt stretch"', "id", "not an id"),
        ('id = "belt-stretch"', "id = 5", "id", "not a text"),
        ('id = "belt-stretch"', "", "id", "is missing"),
        ('channel = "along"', 'channel = "sideways"', "channel", "not known"),
        ('channel = "along"', "", "channel", "is missing"),
        ('channel = "along"', 'channel = "rig"', "direction", "is missing"),
        ('channel = "along"', 'channel = "rig"\ndirection = "up"', "direction", "not known"),
        ('channel = "along"', 'channel = "along"\ndirection = "x"', "direction", "does not belong"),
        ('channel = "along"', 'channel = "squareness"', "axes", "two axes"),
        ('channel = "along"', 'channel = "across"\ndirection = "x"', "direction", "not across"),
        ('channel = "along"', 'channel = "joint"\ndirection = "each"', "axes", "products"),
        ('["x", "y"]', '["x", "u"]', "axes", "'u' is not an axis"),
        ('["x", "y"]', '["x", "x"]', "axes", "twice"),
        ('["x", "y"]', '"x"', "axes", "not a list"),
        ('["x", "y"]', '["work-x"]', "axes", "direction of the work"),
        ('["x", "y"]', "[]", "axes", "moving axis"),
        ("expression =", "expresion =", "expresion", "did you mean expression"),
        ('unit = "1/K"', 'unt = "1/K"', "coefficients.alpha: unt", "did you mean unit"),
        ('range = "axis"', 'Range = "axis"', "inner.q_fixed: Range", "did you mean range"),
        ("looks_like =", "looks_lke =", "looks_lke", "did you mean looks_like"),
        ("what =", "waht =", "plausible[1]: waht", "did you mean what"),
        ("{ value", "{ low = 1e-6, value", "plausible[1]: value", "beside low and high.*\nhint: keep the value, or"),
        ("value = 11.5e-6", "low = 1e-6", "plausible[1]: high", "is missing"),
        ("value = 11.5e-6", "low = -1e-6, high = 1e-5", "plausible[1]: low", "below 0.*\nhint: .*leave the sign out"),
        (
            "value = 11.5e-6",
            "low = 2e-5, high = 1e-5",
            "plausible[1]: high",
            "not above low.*\nhint: write the smaller",
        ),
        ("value = 11.5e-6", "low = 1e-6, high = inf", "plausible[1]: high", "not a finite number"),
        ("value = 11.5e-6", "low = 1e-6, hihg = 1e-5", "plausible[1]: hihg", "did you mean high"),
        ('value = 11.5e-6, what = "steel"', 'low = 1e-6, high = 1e-5, what = ""', "plausible[1]: what", "is empty"),
        ('[{ value = 11.5e-6, what = "steel" }]', '""', "coefficients.alpha: plausible", "is empty.*\nhint: say why"),
        ("some_key_of_mine = 5", "plausible = 5", "plausible", "not a text"),
        ("alpha*T*", "alpha*Tt*", "expression", r"unknown name `Tt` .*`T`.*\n  alpha\*Tt\*.*\n        \^\^\n"),
        ("alpha*T*", "alpha*T*dx*", "expression", r"`dx` .*`d_x`"),
        ("alpha*T*", "alpha*T*dir_x*", "expression", r"`dir_x` .*`d_x`"),
        ('unit = "1/K"', f'unit = "{"m" * 5000}"', "unit", r"5000 characters, at most 4000.*\nhint: shorten"),
        ("alpha*T*", "alpha*T*mean_vx*", "expression", r"`mean_vx` .*`mean_v_x`"),
        ('expression = "', 'expression = "q_b*', "expression", "pair"),
        ('expression = "', 'expression = "q_cross*', "expression", "needs_xy"),
        ('covariates = ["temp"]', "", "expression", "names no temperature"),
        ('covariates = ["temp"]', 'covariates = ["temp", "temp_b"]', "covariates", "two temperatures"),
        ('covariates = ["temp"]', 'covariates = ["temp bed"]', "covariates", "not a column"),
        (
            "alpha*T",
            "alhpa*T",
            "coefficients.alpha",
            r"stands in no formula, but `alhpa` .*\n  alhpa.*\n  \^\^\^\^\^\n",
        ),
        ("- q_fixed", "", "inner.q_fixed", "stands in no formula"),
        ("alpha*T*(", "sin(alpha)*T*(", "expression", "alpha"),
        ("alpha*T*(", "5 + alpha*T*(", "expression", "5"),
        ("alpha*T*(", "alpha*T*((", "expression", r"\^"),
        ("alpha*T*(", "alpha*T**(", "expression", r"\^"),
        ("alpha*T*(", "alpha*sin()*(", "expression", "sin"),
        ('unit = "1/K"', "unit = 1", "unit", "not a text"),
        ('unit = "1/K"', 'unit = "µm"', "unit", "'µm' is not a unit of formulas"),
        ('unit = "1/K"', 'unit = "deg"', "unit", "'deg' is not a unit of formulas"),
        ("value = 11.5e-6", 'value = "11"', "value", "not a finite number"),
        ("value = 11.5e-6", "value = nan", "value", "not a finite number"),
        ("value = 11.5e-6", "value = 1, within = -1", "within", "below 0"),
        ('what = "steel"', 'what = ""', "what", "empty"),
        ('range = "axis"', "", "range", "is missing"),
        ('range = "axis"', "range = [5, 1]", "range", "low to high"),
        ('range = "axis"', "range = [1, inf]", "range", "low to high"),
        ('range = "axis"', 'range = "far"', "range", "not known"),
        ('range = "axis"', 'range = [0, 1]\nspacing = "log"', "range", "ratios"),
        ('range = "axis"', 'range = [1, 2]\nspacing = "cubic"', "spacing", "not known"),
        ("coefficients.c]", "coefficients.d]", "d", "has a meaning already"),
        ("coefficients.c]", "coefficients.sin]", "sin", "has a meaning already"),
        ("coefficients.c]", 'coefficients."a b"]', "a b", "cannot be a parameter's name"),
        ('effect = "scale"', 'effect = "scael"', "mistaken_for", "id of no effect"),
        ('effect = "scale"', "effect = 5", "effect", "not a text"),
        ("separate_by =", "separated_by =", "separated_by", "did you mean separate_by"),
        ("source =", 'part = [{ expression = "c*q" }]\nsource =', "part", "stands beside"),
        ("source =", 'basis = "smooth"\nsource =', "expression", "stands beside basis"),
        ("source =", "classic = 1\nsource =", "classic", "neither true nor false"),
    ],
)
def test_a_wrong_entry_is_refused_by_file_effect_and_key(
    tmp_path: Path, old: str, new: str, key: str, problem: str
) -> None:
    assert old in OWN
    if problem == "needs_xy":
        old, new, problem = '["x", "y"]', '["z"]', "other of x and y"
        text = OWN.replace("c*humidity", "c*q_cross").replace(old, new, 1)
    else:
        text = OWN.replace(old, new, 1)
    with pytest.raises(InputFileError, match=problem) as caught:
        load(tmp_path, text)
    assert caught.value.path.endswith("own.toml")
    assert caught.value.column is not None
    assert caught.value.column.startswith("effect ")
    assert key in caught.value.column
    assert caught.value.remedy
    # The line that an editor shows: of the key, or of the effect where the key is missing.
    assert caught.value.row is not None
    line = text.splitlines()[caught.value.row - 1]
    word = caught.value.column.rpartition(": ")[2].rpartition(".")[2]
    assert word.partition("[")[0] in line or line == "[[effect]]"


def test_keys_and_columns_of_one_s_own_are_left_alone(tmp_path: Path) -> None:
    text = OWN.replace("some_key_of_mine", "cause_of_death").replace("humidity", "force")
    (effect,) = load(tmp_path, text)
    assert effect.wanting(("temp",)) == "wanting: the column force"
    (listed,) = load(tmp_path, OWN.replace("humidity", "dx").replace('["temp"]', '["temp", "dx"]'))
    assert listed.wanting(("temp", "dx")) is None


def test_a_name_that_no_effect_has_is_answered_with_what_may_be_meant() -> None:
    for name, expected in (("backlsh", "backlash"), ("sag", "gravity-sag"), ("nope", "docs/catalogue.md")):
        with pytest.raises(InputFileError, match=f"no effect has this id\nhint: .*{expected}"):
            catalogue().resolve(f"{name}:z")


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ('channel = "tool"\nexpression = "k"', "needs a direction"),
        ('channel = "along"\naxes = ["x"]\none_direction = true\nexpression = "k"', "nothing to choose from"),
        ('channel = "tool"\naxes = ["xy"]\nexpression = "k"', "needs a direction"),
        ('channel = "rig"\ndirection = "tx"\nexpression = "k*q"', "belongs to an axis"),
        ('channel = "rig"\ndirection = "tx"\nexpression = "k*T"', "names no temperature"),
        ('channel = "along"\naxes = ["x"]\nexpression = "q"', r"has no coefficient\n  q\n  \^\n"),
        ('channel = "along"\naxes = ["x"]\npart = []', "is empty"),
        ('channel = "along"\naxes = ["x"]\nform = []', "is empty"),
        ('channel = "along"\naxes = ["x"]\nbasis = "rough"', "not known"),
        ('channel = "squareness"\naxes = ["xy"]\nbasis = "smooth"', "not for channel"),
        ('detector = "luck"', "not known"),
        (
            '[[effect.part]]\nchannel = "along"\naxis = "second"\nexpression = "k"',
            "needs a moving axis",
        ),
        (
            'axes = ["x"]\n[[effect.part]]\nchannel = "along"\naxis = "second"\nexpression = "k"',
            "needs pairs",
        ),
        (
            'axes = ["x"]\n[[effect.part]]\nchannel = "across"\nexpression = "k"\n'
            '[[effect.part]]\nchannel = "along"\nexpression = "k"',
            "one number for each direction",
        ),
        (
            'axes = ["x"]\n[[effect.part]]\nchannel = "along"\nexpression = "k"\n'
            '[[effect.part]]\nchannel = "rig"\ndirection = "tx"\nexpression = "k"',
            "cannot share a term",
        ),
        (
            'channel = "along"\naxes = ["x"]\n[[effect.form]]\nname = "a"\nexpression = "k"\n'
            '[[effect.form]]\nname = "a"\nexpression = "k*q"',
            "one name",
        ),
    ],
)
def test_what_does_not_fit_together_is_refused(tmp_path: Path, body: str, problem: str) -> None:
    with pytest.raises(InputFileError, match=problem):
        load(tmp_path, SHORT.format(body))


AGAIN = (
    SHORT.format('channel = "along"\naxes = ["x", "y"]\nexpression = "k*q*q"')
    + """
[[effect]]
id = "own-second"
again = "{0}"
title = "Once more"
{1}
"""
)


def test_an_effect_may_be_there_twice(tmp_path: Path) -> None:
    first, second = load(tmp_path, AGAIN.format("own", 'cause = "another part"'))
    assert (second.id, second.title, second.cause, second.again) == ("own-second", "Once more", "another part", "own")
    assert first.again is None
    assert (second.forms, second.axes, second.coefficients) == (first.forms, first.axes, first.coefficients)
    one, other = (effect.term("x", None, machine()) for effect in (first, second))
    assert (one.id, other.id) == ("own:x", "own-second:x")
    assert one.parts == other.parts


def test_an_effect_may_be_there_three_times(tmp_path: Path) -> None:
    first, second, third = load(tmp_path, AGAIN.format("own", '[[effect]]\nid = "own-third"\nagain = "own-second"'))
    assert (first.again, second.again, third.again) == (None, "own", "own-second")
    assert third.term("x", None, machine()).parts == first.term("x", None, machine()).parts


@pytest.mark.parametrize(
    ("name", "more", "problem"),
    [
        ("owl", "", "'owl' is no effect above"),
        ("own-second", "", "'own-second' is no effect above"),
        ("own", 'expression = "k*q"', "expression.*stands beside again"),
        ("own", '[[effect]]\nid = "own-third"\nagain = "own"', "'own' is there again as own-second"),
    ],
)
def test_what_is_there_twice_says_no_more_than_words(tmp_path: Path, name: str, more: str, problem: str) -> None:
    with pytest.raises(InputFileError, match=problem):
        load(tmp_path, AGAIN.format(name, more))


def test_a_range_of_the_axis_needs_an_axis(tmp_path: Path) -> None:
    body = 'channel = "rig"\ndirection = "tx"\nexpression = "k*sin(x/p)"\n[effect.inner.p]\nrange = "axis"'
    with pytest.raises(InputFileError, match="there is none"):
        load(tmp_path, SHORT.format(body))


@pytest.mark.parametrize(
    "text", ["", "effect = 5", "effect = [1]", "[effect]", "[[effect]]", "a = [", "\x00", "a = 1" + "0" * 5000]
)
def test_what_holds_no_effect_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputFileError, match=r"own\.toml"):
        load(tmp_path, text)


def test_a_missing_file_and_a_taken_id_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        load_effects(tmp_path / "none.toml")
    with pytest.raises(InputFileError, match="described twice"):
        load(tmp_path, OWN + OWN)
    load(tmp_path, OWN)
    again = tmp_path / "again.toml"
    again.write_text(OWN, encoding="utf-8")
    with pytest.raises(InputFileError, match="an effect read before"):
        load_catalogue([tmp_path / "own.toml", again])


def test_the_place_of_a_mistake_in_a_formula_is_marked(tmp_path: Path) -> None:
    with pytest.raises(InputFileError) as caught:
        load(tmp_path, OWN.replace("alpha*T*(q", "alpha*T*%(q"))
    lines = str(caught.value).splitlines()
    marked = next(n for n, line in enumerate(lines) if "alpha*T*%(q" in line)
    assert lines[marked + 1].index("^") == lines[marked].index("%")


_BUILT_IN = {family: (files("geoerr.effects") / f"{family}.toml").read_text(encoding="utf-8") for family in FAMILIES}
_VALUES = st.one_of(
    st.booleans(),
    st.integers(-10, 10**30),
    st.floats(),
    st.sampled_from(
        [
            *(
                "",
                "x",
                "xy",
                "x*y",
                "work-z",
                "axis",
                "time",
                "temp",
                "temp-temp",
                "temp|temp-temp",
                "a-b-c",
                "|",
                "k",
            ),
            *("along", "across", "across-angle", "angular", "joint", "squareness", "tool", "work", "target", "rig"),
            *("each", "angle-of-x", "ray-x", "first", "second", "log", "smooth", "pass-disagrees"),
            *("k*", "k**q", "k*q", "(k", "k*q)", "lag(k)", "k*T", "windup(k)", "q_b*k", "k*q_cross", "k*sin(", "é"),
        ]
    ),
    st.text(max_size=12),
    st.lists(st.sampled_from(["x", "y", "xy", "x*y", "work-x", "temp", "force", "first"]), max_size=3),
    st.just({}),
    st.just([{}]),
    st.just({"k": {"unit": "mm"}}),
    st.just([{"channel": "along", "expression": "k*q"}]),
)


def _places(document: object, here: tuple[object, ...] = ()) -> list[tuple[object, ...]]:
    items = document.items() if isinstance(document, dict) else enumerate(document)
    found = []
    for key, value in items:
        found.append((*here, key))
        if isinstance(value, dict | list):
            found += _places(value, (*here, key))
    return found


@settings(max_examples=400)
@given(data=st.data())
def test_mangled_entries_are_refused_or_read_and_nothing_else(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    entries = tomllib.loads(_BUILT_IN[data.draw(st.sampled_from(FAMILIES))])["effect"]
    entry = data.draw(st.sampled_from(entries)) | {"id": "mangled"}
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from(_places(entry)))
        table = entry
        for key in place[:-1]:
            table = table[key]
        if data.draw(st.booleans()) or isinstance(table, list):
            table[place[-1]] = copy.deepcopy(data.draw(_VALUES))
        else:
            del table[place[-1]]
        if not entry:
            break
    path = tmp_path_factory.getbasetemp() / "mangled.toml"
    path.write_text(tomli_w.dumps({"effect": [entry]}), encoding="utf-8")
    try:
        (effect,) = load_effects(path)
    except InputFileError:
        return
    for candidate in effect.candidates(machine(), ("t", "temp_a", "temp_b", "moving", "feed", "force"), n_sessions=2):
        for term in effect.terms(candidate.axis, candidate.covariate, machine()):
            assert term.parts


@settings(max_examples=200)
@given(data=st.data())
def test_mangled_text_is_refused_or_read_and_nothing_else(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    text = _BUILT_IN[data.draw(st.sampled_from(FAMILIES))].replace('id = "', 'id = "own-')
    text = text.replace('effect = "', 'effect = "own-')
    start = data.draw(st.integers(0, len(text) - 1))
    length = data.draw(st.integers(0, 40))
    path = tmp_path_factory.getbasetemp() / "text.toml"
    path.write_text(text[:start] + data.draw(st.text(max_size=6)) + text[start + length :], encoding="utf-8")
    with contextlib.suppress(InputFileError):
        load_effects(path)
