from __future__ import annotations

import math
import tomllib
from importlib.resources import files

import pytest
from effect_machines import CHAINS, machine

from geoerr._core import Expression
from geoerr.effects import Effect, catalogue
from geoerr.effects.collection import FAMILIES
from geoerr.errors import InputFileError
from geoerr.terms import EffectReference, Term, is_rig_channel

# The ids are a contract; coefficients and inner parameters as other programs name them, for the axis or direction
# beside them (x, xy, x*y, work-z, or none) and the usual form.
EXPECTED: dict[str, tuple[str | None, str, str]] = {
    "scale": ("x", "k", ""),
    "squareness": ("xy", "S", ""),
    "backlash": ("x", "b", ""),
    "backlash-position": ("x", "b0 b1", ""),
    "reversal-windup": ("x", "b", "lambda"),
    "reversal-spike": ("x", "A", "tau"),
    "lateral-play": ("x", "l_y l_z", ""),
    "angular-reversal": ("y", "c_x c_y c_z", ""),
    "periodic": ("x", "A B", "P"),
    "periodic-second": ("x", "A B", "P"),
    "periodic-third": ("x", "A B", "P"),
    "screw-wobble": ("z", "A_x A_y B_x B_y", "P"),
    "lag": ("x", "tau", ""),
    "servo-mismatch": ("xy", "dtau", ""),
    "radial-shrink": ("x", "k", ""),
    "acceleration": ("x", "c", ""),
    "stick-slip": ("x", "b_s", "v_s"),
    "lost-steps": ("x", "A", "t0"),
    "step": (None, "A_x A_y A_z c_x c_y c_z", "t0"),
    "homing-offset": ("x", "c_1", ""),
    "scale-change": ("x", "k_1", ""),
    "squareness-change": ("yz", "S_1", ""),
    "rig-scale-change": (None, "k_1", ""),
    "thermal-expansion": ("x", "alpha", "q_fixed"),
    "thermal-drift": ("work-z", "k", ""),
    "warm-up": ("z", "A", "tau"),
    "screw-heating": ("x", "k", "tau q_fixed"),
    "thermal-bending": ("x", "kappa_y kappa_z", ""),
    "bed-bow": ("work-z", "alpha", "h x_c y_c"),
    "frame-tilt-thermal": ("yz", "k", ""),
    "nozzle-growth": ("z", "alpha", "l"),
    "gravity-sag": ("x", "k", ""),
    "gantry-racking": ("y", "c0 c1", ""),
    "tool-offset": (None, "c_x c_y c_z", ""),
    "load-deflection": ("z", "c", ""),
    "camera-drift": (None, "k_x k_y k_z c_x c_y c_z", ""),
    "rig-scale": (None, "k", ""),
    "rig-scale-thermal": (None, "k", ""),
    "rig-depth": (None, "k1 k2", ""),
    "timing": (None, "dt", ""),
    "target-expansion": (None, "alpha", ""),
    "angular-thermal": ("x", "k_x k_y k_z", ""),
    "scale-mismatch": ("xy", "m", ""),
    "change-over": ("xy", "A", ""),
    "vibration": ("x", "A B", "f"),
    "radius-change": (None, "k", ""),
    "centre-offset": (None, "c_x c_y c_z", ""),
    "spiral": (None, "k", ""),
}
ELSEWHERE = {
    *("pitch-error", "straightness", "angular", "cross-coupling", "rig-distortion", "rig-pixel-locking"),
    *("heat-haze", "outlier-pass"),
}
COLUMNS = (
    *("line", "x", "y", "z", "t", "feed", "moving", "temp_a", "temp_b", "temp_nozzle", "duty", "force", "load"),
    *("u_left", "v_left", "u_right", "v_right"),
)
EFFECTS = tuple(catalogue())
FORMULAS = tuple(effect for effect in EFFECTS if not effect.is_smooth and effect.detector is None)


def covariate_for(effect: Effect) -> str | None:
    needed = next((c for form in effect.forms for c in form.covariates if c.startswith("temp")), None)
    return {None: None, "temp-temp": "temp_a-temp_b", "temp_nozzle": "temp_nozzle"}.get(needed, "temp_a")


def every_term(effect: Effect, chain: str) -> list[Term]:
    found = []
    for axis in effect.axes or (None,):
        for form in effect.form_names:
            for lagged in {False, effect.follows_temperature}:
                found.append(
                    effect.term(axis, covariate_for(effect), machine(chain, low=-50.0), lagged=lagged, form=form)
                )
    return found


def test_every_fixed_id_is_there_once() -> None:
    assert set(catalogue().effects) == set(EXPECTED) | ELSEWHERE
    ids = []
    for family in FAMILIES:
        text = (files("geoerr.effects") / f"{family}.toml").read_text(encoding="utf-8")
        ids += [entry["id"] for entry in tomllib.loads(text)["effect"]]
    assert len(ids) == len(set(ids))


@pytest.mark.parametrize("name", EXPECTED)
def test_parameters_bear_the_fixed_symbols(name: str) -> None:
    axis, coefficients, inner = EXPECTED[name]
    effect = catalogue()[name]
    term = effect.term(axis, covariate_for(effect), machine())
    assert " ".join(parameter.name for parameter in term.coefficients) == coefficients
    assert " ".join(parameter.name for parameter in term.inner) == inner


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_every_entry_speaks_to_a_shop_floor(effect: Effect) -> None:
    for text in (effect.title, effect.looks_like, effect.cause, effect.remedy, effect.source):
        assert len(text) > 3
    assert effect.mistaken_for
    for rival in effect.mistaken_for:
        assert rival.separate_by
        assert rival.plan
        assert rival.minutes is not None
    assert effect.origin == "built-in"


@pytest.mark.parametrize("effect", FORMULAS, ids=lambda effect: effect.id)
def test_it_expands_on_every_axis_of_every_chain(effect: Effect) -> None:
    for chain in CHAINS:
        for term in every_term(effect, chain):
            assert term.kind == "effect"
            assert term.effect == effect.id
            assert term.source == "built-in"
            assert term.is_rig == effect.is_rig
            assert Term.from_document(term.to_document(), "model.json") == term
            used = {name for part in term.parts for name in part.names}
            for parameter in term.coefficients + term.inner:
                assert parameter.name in used
                assert math.isnan(parameter.value)


@pytest.mark.parametrize("effect", FORMULAS, ids=lambda effect: effect.id)
def test_the_core_reads_every_formula_and_finds_it_linear(effect: Effect) -> None:
    for term in every_term(effect, "wZbXYt"):
        coefficients = [parameter.name for parameter in term.coefficients]
        inner = [parameter.name for parameter in term.inner]
        for part in term.parts:
            assert part.expression is not None
            formula = Expression(part.expression, list(term.variables), coefficients, inner, dict(part.definitions))
            assert formula.coefficients_used
            assert set(formula.variables_used) <= set(part.names)


def test_the_parts_of_a_term_that_are_on_the_rig_are_those_of_rig_effects() -> None:
    for effect in FORMULAS:
        for term in every_term(effect, "wbXYZt"):
            assert {is_rig_channel(part.channel) for part in term.parts} == {effect.channel == "rig"}


def test_mistaken_for_is_known_from_both_sides() -> None:
    effects = catalogue()
    for effect in effects:
        for rival in effects.rivals(effect.id):
            if rival.effect is not None:
                assert effects.separation(rival.effect, effect.id) is not None
                assert effects.separation(effect.id, rival.effect) is not None
    both = effects.separation("scale", "thermal-expansion")
    assert both is not None
    assert "temperature" in both.separate_by
    assert effects.separation("backlash", "rig-depth") is None


def test_twins_are_declared_and_symmetric() -> None:
    effects = catalogue()
    for effect in effects:
        for twin in effects.twins(effect.id):
            assert effect.id in {other.effect for other in effects.twins(twin.effect)}
    expansion = EffectReference("thermal-expansion", "x", "temp_bed")
    assert effects.are_twins(expansion, EffectReference("thermal-drift", "x", "temp_bed"))
    assert effects.are_twins(EffectReference("thermal-drift", "work-x", "temp_bed"), expansion)
    assert effects.are_twins(expansion, EffectReference("rig-scale-thermal", None, "temp_bed"))
    assert not effects.are_twins(expansion, EffectReference("thermal-drift", "y", "temp_bed"))
    assert not effects.are_twins(expansion, EffectReference("thermal-drift", "x", "temp_frame"))
    assert not effects.are_twins(expansion, EffectReference("scale", "x", None))


def test_candidates_name_every_axis_and_temperature_once() -> None:
    names = [str(c) for c in catalogue()["thermal-expansion"].candidates(machine(), COLUMNS)]
    assert names == [f"thermal-expansion:{axis}@temp_{column}" for axis in "xyz" for column in ("a", "b", "nozzle")]
    bow = [str(c) for c in catalogue()["bed-bow"].candidates(machine(), ("temp", "temp_b"))]
    # Bottom minus top of a plate that grows: physics gives the sign, and so the order counts.
    assert bow == ["bed-bow:work-z@temp-temp_b", "bed-bow:work-z@temp_b-temp"]
    both = [str(c) for c in catalogue()["frame-tilt-thermal"].candidates(machine(), ("temp_a", "temp_b"))]
    assert both[:3] == [f"frame-tilt-thermal:xy@{c}" for c in ("temp_a", "temp_b", "temp_a-temp_b")]
    assert [str(c) for c in catalogue()["rig-scale"].candidates(machine(), ())] == ["rig-scale"]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_every_candidate_becomes_a_term(effect: Effect) -> None:
    candidates = effect.candidates(machine(), COLUMNS, n_sessions=3, is_circular=True)
    assert len(set(candidates)) == len(candidates)
    hidden = effect.detector is not None or effect.offered_as is not None
    assert bool(candidates) == (not hidden)
    for candidate in candidates:
        terms = effect.terms(candidate.axis, candidate.covariate, machine())
        assert all(term.axis == candidate.axis for term in terms)
        if not effect.is_smooth:
            assert [term.id for term in terms] == [str(candidate)]
        assert catalogue().resolve(str(candidate)) == (effect, candidate)


@pytest.mark.parametrize(
    ("name", "columns", "wanting"),
    [
        ("thermal-drift", ("x", "t"), "temperature column"),
        ("bed-bow", ("temp_a",), "two temperature columns"),
        ("nozzle-growth", ("temp_a",), "temp_nozzle"),
        ("load-deflection", (), "the column force"),
        ("rig-distortion", ("u_left", "v_left"), "u_right"),
        ("lag", ("feed", "t"), "moving"),
        ("lag", ("moving",), "feed"),
        ("timing", ("feed",), "moving"),
        ("reversal-spike", ("feed",), "times"),
        ("screw-heating", ("feed", "moving"), "times"),
        ("homing-offset", COLUMNS, "second session"),
        ("squareness-change", COLUMNS, "second session"),
        ("scale-change", COLUMNS, "second session"),
        ("rig-scale-change", COLUMNS, "second session"),
        ("vibration", COLUMNS, "circular"),
    ],
)
def test_what_the_data_lack_is_said(name: str, columns: tuple[str, ...], wanting: str) -> None:
    effect = catalogue()[name]
    sentence = effect.wanting(columns)
    assert sentence is not None
    assert wanting in sentence
    assert effect.candidates(machine(), columns) == []


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("backlash", ()),
        ("warm-up", ()),
        ("lag", ("moving", "t")),
        ("screw-heating", ("t",)),
        ("screw-heating", ("duty",)),
        ("gravity-sag", ()),
    ],
)
def test_what_the_data_have_is_enough(name: str, columns: tuple[str, ...]) -> None:
    assert catalogue()[name].wanting(columns) is None


@pytest.mark.parametrize(
    ("reference", "problem"),
    [
        ("backlsh:x", "did you mean backlash"),
        ("zzz", "docs/catalogue.md"),
        ("backlash", "needs an axis"),
        ("backlash:xy", "not an effect of axis"),
        ("backlash:work-x", "not an effect of axis"),
        ("rig-scale:x", "not an effect of axis"),
        ("thermal-drift:z", "needs a temperature column"),
        ("backlash:x@temp_bed", "does not follow"),
        ("thermal-drift:z@humidity", "temperature columns are named"),
        ("bed-bow:work-z@temp_bed", "two temperature columns"),
    ],
)
def test_a_reference_that_fits_no_effect_is_refused(reference: str, problem: str) -> None:
    with pytest.raises(InputFileError, match=problem) as caught:
        catalogue().resolve(reference)
    assert caught.value.remedy


def test_what_can_be_left_out_of_a_reference_is_filled_in() -> None:
    effects = catalogue()
    assert str(effects.resolve("bed-bow@temp_a-temp_b")[1]) == "bed-bow:work-z@temp_a-temp_b"
    assert str(effects.resolve("nozzle-growth")[1]) == "nozzle-growth:z@temp_nozzle"
    assert str(effects.resolve("load-deflection:z@force")[1]) == "load-deflection:z"
    duty = effects["screw-heating"].term(*_axis_and_covariate("screw-heating:x@duty"), machine())
    assert duty.needs == ("duty",)
    assert effects["screw-heating"].term("x", None, machine()).needs == ()


def _axis_and_covariate(reference: str) -> tuple[str | None, str | None]:
    resolved = catalogue().resolve(reference)[1]
    return resolved.axis, resolved.covariate


def test_what_has_no_formula_makes_no_single_term() -> None:
    for name in ("outlier-pass", "heat-haze", "pitch-error"):
        with pytest.raises(InputFileError, match="no formula"):
            catalogue()[name].term("x", None, machine())


def test_smooth_effects_are_classic_terms_of_their_channels() -> None:
    ids = [term.id for term in catalogue()["straightness"].terms("y", None, machine())]
    assert ids == ["EXY", "EZY"]
    angles = catalogue()["angular"].terms("z", None, machine())
    assert [term.id for term in angles] == ["EAZ", "EBZ", "ECZ"]
    assert {parameter.unit for term in angles for parameter in term.coefficients} == {"rad"}
    assert {term.kind for term in angles} == {"classic"}
    assert all(term.parts[0].basis is not None for term in angles)


def test_every_letter_is_told_in_words_with_its_direction_or_session() -> None:
    silent = [
        f"{one.id}.{spec.name}" for one in catalogue() for spec in one.coefficients + one.inner if not spec.what
    ]
    assert silent == []
    own = machine("wbXYZt")
    labels = {
        reference: [one.label for one in (*term.coefficients, *term.inner)]
        for reference, term in {
            "backlash": catalogue()["backlash"].term("x", None, own),
            "lateral-play": catalogue()["lateral-play"].term("x", None, own),
            "angular-thermal": catalogue()["angular-thermal"].term("x", "temp", own, lagged=True),
            "homing-offset": catalogue()["homing-offset"].term("x", None, own, sessions=("0", "1", "2")),
        }.items()
    }
    assert labels["backlash"] == ["lost motion b"]
    assert labels["lateral-play"] == ["play along y l_y", "play along z l_z"]
    assert labels["angular-thermal"][0] == "tilt per kelvin about x k_x"
    assert labels["angular-thermal"][-1] == "lag behind the temperature tau"
    assert labels["homing-offset"] == ["offset in session 1 c_1", "offset in session 2 c_2"]


def test_an_id_that_nothing_is_like_is_told_where_effects_of_ones_own_belong() -> None:
    with pytest.raises(InputFileError, match=r"no effect has this id\nhint: .*--effects FILE .*farm.*effects\.toml"):
        catalogue()["qqqqqq"]
