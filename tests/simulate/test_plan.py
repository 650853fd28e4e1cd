"""Plans: what is read, in which order things happen, and what is refused by file and key."""

import inspect
import json
import textwrap
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from small_plans import DOCUMENT, changed

from geoerr.error_functions import write_errors
from geoerr.errors import InputFileError
from geoerr.files import write_json
from geoerr.machine import Axis, write_machine
from geoerr.simulate import plan as plan_module
from geoerr.simulate.effects import AVAILABLE_EFFECTS, disturbance_of
from geoerr.simulate.moments import measured_positions, moments_of
from geoerr.simulate.plan import plan_from_document, read_plan, write_plan
from geoerr.simulate.scene import Scene
from geoerr.simulate.truth import truth_of
from geoerr.vision.session import FORBIDDEN_COLUMNS, FRAME_COLUMNS


def plan(**changes):
    return plan_from_document(changed(**changes), "plan.toml")


def moments(which):
    return moments_of(which.passes, which.covariates, which.machine, which.seconds_per_frame)


def test_a_plan_written_is_the_plan_read(tmp_path):
    write_plan(tmp_path / "plan.toml", plan())
    again = read_plan(tmp_path / "plan.toml")
    assert again.document == DOCUMENT
    assert (again.passes, again.targets, again.rig, again.errors) == (
        plan().passes,
        plan().targets,
        plan().rig,
        plan().errors,
    )


def test_the_plan_that_the_documentation_shows_is_a_plan(tmp_path):
    _, _, example = inspect.getdoc(plan_module).partition("::")
    document = tomllib.loads(textwrap.dedent(example))
    machine = plan().machine
    write_machine(tmp_path / "machine.toml", replace(machine, axes=dict.fromkeys("xyz", Axis((0.0, 400.0)))))
    shown = plan_from_document(document, tmp_path / "plan.toml")
    assert len(shown.passes[0].positions_mm) == 21
    assert shown.hidden[0].parameters == {"alpha": 11.5e-6, "q_fixed": 0.0}
    assert shown.errors.tables["EZZ"].value.tolist() == [0.0, 0.08]


def test_the_machine_may_stand_in_a_file_of_its_own(tmp_path):
    write_machine(tmp_path / "machine.toml", plan().machine)
    document = changed(machine="machine.toml")
    del document["axes"]
    assert plan_from_document(document, tmp_path / "plan.toml").machine == plan().machine


def test_moments_come_in_the_order_of_passes_with_the_direction_of_approach():
    order = moments(plan())
    assert order.q_mm.tolist() == [
        *([0, 0, 0], [100, 0, 0], [100, 0, 0], [0, 0, 0]),
        *([0, 100, 10], [0, 100, 50], [0, 100, 90]),
    ]
    assert order.direction.tolist() == [
        *([1, 0, 0], [1, 0, 0], [-1, 0, 0], [-1, 0, 0]),
        *([-1, 1, 1], [-1, 1, 1], [-1, 1, 1]),
    ]
    assert order.line == ("X",) * 4 + ("up",) * 3
    assert order.t_s.tolist() == [0, 4, 8, 12, 16, 20, 24]
    assert measured_positions(order, 2).tolist() == [10, 50, 90]
    assert measured_positions(order, 1).size == 0
    assert {axis: (float(at[0]), float(at[-1])) for axis, at in Scene(plan()).positions_mm.items()} == {
        "x": (0.0, 100.0),
        "y": (0.0, 100.0),
        "z": (10.0, 90.0),
    }


def test_a_step_is_kept():
    (only,) = plan(passes=[{"axis": "x", "start": 0.3, "stop": 99.9, "step": 33.2}]).passes
    assert only.positions_mm == pytest.approx([0.3, 33.5, 66.7, 99.9], abs=1e-12)


def test_repeats_are_numbered():
    order = moments(plan(passes=[{"axis": "y", "positions": [5.0, 1.0], "repeats": 2, "both_directions": True}]))
    assert order.repeat.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert order.q_mm[:, 1].tolist() == [5, 1, 1, 5] * 2
    assert order.direction[:, 1].tolist() == [-1, -1, 1, 1] * 2


def test_covariates_are_functions_of_time():
    given = {
        "temp_a": {"t_s": [0.0, 16.0], "value": [20.0, 28.0]},
        "temp_b": {"start": 20.0, "end": 60.0, "tau_s": 10.0},
    }
    columns = moments(plan(covariates={**given, "load": {"value": 3.0}})).covariates
    assert columns["temp_a"].tolist() == [20, 22, 24, 26, 28, 28, 28]
    assert np.allclose(columns["temp_b"], 60.0 - 40.0 * np.exp(-np.arange(7) * 0.4))
    assert columns["load"].tolist() == [3.0] * 7


def hidden(effect, axis=None, covariate=None, **parameters):
    parts = {"axis": axis, "covariate": covariate, "parameters": parameters}
    return {"effect": effect, **{key: value for key, value in parts.items() if value}}


def effect_of(*effects):
    which = plan(
        hidden=list(effects),
        covariates={"temp_a": {"t_s": [0.0, 24.0], "value": [20.0, 32.0]}, "temp_b": {"value": 21.0}},
    )
    return disturbance_of(which.hidden, moments(which), which.machine), moments(which)


def test_hidden_effects_follow_the_catalogue():
    t = np.arange(7) * 4.0
    kelvin = t / 2.0
    x = np.array([0, 100, 100, 0, 0, 0, 0.0])
    d = np.array([1, 1, -1, -1, -1, -1, -1.0])
    for effect, expected in (
        (hidden("scale", "x", k=2e-4), 2e-4 * x),
        (hidden("backlash", "x", b=0.03), -0.015 * d),
        (hidden("backlash-position", "x", b0=0.02, b1=1e-4), -d / 2 * (0.02 + 1e-4 * x)),
        (
            hidden("periodic", "x", A=0.01, B=0.02, P=40.0),
            0.01 * np.sin(np.pi * x / 20) + 0.02 * np.cos(np.pi * x / 20),
        ),
        (hidden("thermal-expansion", "x", "temp_a", alpha=1e-5, q_fixed=30.0), 1e-5 * kelvin * (x - 30.0)),
        (hidden("thermal-expansion", "x", "temp_a-temp_b", alpha=1e-5), 1e-5 * (kelvin - 1.0) * x),
    ):
        found, _ = effect_of(effect)
        assert np.allclose(found.delta_mm[:, 0, 0], expected, atol=1e-15), effect["effect"]
        found.delta_mm[:, 0, 0] = 0.0
        rest = (found.delta_mm, found.epsilon_rad, found.tool_mm, found.work_mm, found.rig_mm, found.rig_rad)
        assert not any(part.any() for part in rest)


def test_effects_on_bodies_and_on_the_rig_go_to_their_place():
    t = np.arange(7) * 4.0
    d = np.array([1, 1, -1, -1, -1, -1, -1.0])
    found, _ = effect_of(
        hidden("thermal-drift", "z", "temp_a", k=0.002),
        hidden("warm-up", "work-y", A=0.05, tau=8.0),
        hidden("camera-drift", k_x=1e-3, c_z=2e-6),
        hidden("lateral-play", "x", l_x=9.0, l_z=0.01),
        hidden("angular-reversal", "x", c_y=1e-5),
    )
    assert np.allclose(found.tool_mm, np.outer(0.002 * t / 2.0, [0, 0, 1]))
    assert np.allclose(found.work_mm, np.outer(0.05 * (1 - np.exp(-t / 8.0)), [0, 1, 0]))
    assert np.allclose(found.rig_mm, np.outer(1e-3 * t, [1, 0, 0]))
    assert np.allclose(found.rig_rad, np.outer(2e-6 * t, [0, 0, 1]))
    assert np.allclose(found.delta_mm[:, 0], np.outer(0.005 * d, [0, 0, 1]))
    assert np.allclose(found.epsilon_rad[:, 0], np.outer(1e-5 * d, [0, 1, 0]))


def test_scatter_moves_only_the_axis_that_moved():
    scene = Scene(plan(noise={"repeatability_um": 5.0}))
    shift = scene.disturbance.delta_mm
    moving = scene.moments.moving_axis
    own = shift[np.arange(len(scene)), moving, moving]
    assert (own != 0.0).all()
    assert np.count_nonzero(shift) == len(scene)
    assert np.abs(own).max() < 5 * 5e-3


REFUSED = [
    ({"machine": "none.toml"}, "none.toml"),
    ({"machine": {"chain": "wXYt"}}, "machine.chain"),
    ({"seed": -1}, "seed"),
    ({"seed": 1.5}, "seed"),
    ({"rig": {"middle_mm": [0.0, 1.0]}}, "rig.middle_mm"),
    ({"rig": {"middle_mm": [80.0, 0.0, 50.0]}}, "rig.up"),
    ({"rig": {"baseline_mm": 0.0}}, "rig.baseline_mm"),
    ({"rig": {"baseline_mm": float("nan")}}, "rig.baseline_mm"),
    ({"rig": {"image_size_px": [612.5, 512]}}, "rig.image_size_px"),
    ({"rig": {"image_size_px": [12240000, 1024000]}}, "rig.image_size_px: .* megapixels, more than 300"),
    ({"rig": {"left": {"distortion": [0.1]}}}, "rig.left.distortion"),
    ({"rig": {"left": {"focal_px": [0.0, 100.0]}}}, "rig.left.focal_px"),
    ({"rig": {"left": 3}}, "rig.left"),
    ({"board": {"type": "circles"}}, "board.type"),
    ({"board": {"dictionary": "DICT_1"}}, "board.squares"),
    ({"board": {"depth_mm": [900.0, 500.0]}}, "board.depth_mm"),
    ({"board": {"squares": [7]}}, "board.squares"),
    ({"targets": {}}, "targets"),
    ({"targets": [{"id": 99, "size_mm": 60.0, "offset_mm": [0, 0, 0]}]}, r"targets\[1\].id"),
    ({"targets": [{"id": 9, "size_mm": 60.0, "offset_mm": [0, 0, 0], "carrier": "bed"}]}, r"targets\[1\].carrier"),
    ({"targets": [{"id": 9, "size_mm": "big", "offset_mm": [0, 0, 0]}]}, r"targets\[1\].size_mm"),
    ({"targets": [DOCUMENT["targets"][0]] * 2}, r"targets\[2\].id"),
    ({"errors": {"carriage": "floating"}}, "carriage"),
    ({"errors": {"carriage": "length"}}, "carriage_length_mm"),
    ({"errors": {"squareness_mrad": {"S_xy": 1.0}}}, "squareness_mrad.S_xy"),
    ({"errors": {"tables": {"EXQ": {}}}}, "errors.tables.EXQ"),
    ({"errors": {"tables": {"EXX": {"position_mm": [0, 1], "value_um": [0]}}}}, "errors.tables.EXX"),
    ({"errors": {"tables": "none.json"}}, "none.json"),
    ({"passes": [{"axis": "a", "count": 2}]}, r"passes\[1\].axis"),
    ({"passes": [{"axis": "x"}]}, r"passes\[1\].count"),
    ({"passes": [{"axis": "x", "stop": 400.0, "count": 3}]}, "outside the range"),
    ({"passes": [{"axis": "x", "count": 3, "at": {"z": -1.0}}]}, "at.z"),
    ({"passes": [{"axis": "x", "positions": []}]}, "positions"),
    ({"passes": [{"axis": "x", "start": 0.0, "stop": 100.0, "step": 30.0}]}, "30 mm does not divide the 100 mm"),
    ({"passes": [{"axis": "x", "start": 0.0, "stop": 100.0, "step": 150.0}]}, "150 mm does not divide the 100 mm"),
    ({"passes": [{"axis": "x", "count": 3, "step": 50.0}]}, "stands beside count"),
    ({"passes": [{"axis": "x", "count": 2, "both_directions": 1}]}, "both_directions"),
    ({"covariates": {"temp": {"t_s": [1.0, 0.0], "value": [1.0, 2.0]}}}, "covariates.temp.t_s"),
    ({"hidden": [{"effect": "gremlins"}]}, "available are scale, backlash"),
    ({"hidden": [{"effect": "scale", "axis": "x"}]}, "parameters.k"),
    ({"hidden": [{"effect": "scale", "axis": "work-x", "parameters": {"k": 1.0}}]}, r"hidden\[1\].axis"),
    ({"hidden": [hidden("scale", "x", k=1.0, q=2.0)]}, "has no parameter 'q'"),
    ({"hidden": [hidden("periodic", "x", P=0.0)]}, "parameters.P"),
    ({"hidden": [hidden("thermal-expansion", "x", "temp", alpha=1.0)]}, "names no column"),
    ({"noise": {"grey": -1.0}}, "noise.grey"),
    ({"board": {"squares": [14.9, 10]}}, r"board.squares: \[14.9, 10.0\] is not two whole numbers above 1"),
    ({"board": {"squares": [7, 1]}}, "board.squares: .* is not two whole numbers above 1"),
    ({"seconds_per_frame": 1e308}, "seconds_per_frame: .* s for each of 7 frames is no finite time"),
    ({"light": {"white_grey": 300.0}}, "light.white_grey: 300.0 is too large: it must be at most 255"),
    ({"light": {"background_grey": 256}}, "light.background_grey: 256 is too large"),
]

# Words with a slip of the finger, which counted for nothing.
MISSPELT = [
    ({"seconds_per_frames": 2.0}, "seconds_per_frames", "seconds_per_frame"),
    ({"rig": {"base_line_mm": 300.0, "baseline_mm": None}}, "rig.base_line_mm", "baseline_mm"),
    ({"rig": {"left": {"distorsion": [0.0] * 5}}}, "rig.left.distorsion", "distortion"),
    ({"light": {"white_gray": 200.0}}, "light.white_gray", "white_grey"),
    ({"noise": {"repeatabilty_um": 50.0}}, "noise.repeatabilty_um", "repeatability_um"),
    ({"board": {"max_tild_deg": 20.0}}, "board.max_tild_deg", "max_tilt_deg"),
    ({"targets": [{"id": 1, "size_mm": 9.0, "offset_mm": [0, 0, 0], "carier": "work"}]}, "carier", "carrier"),
    ({"errors": {"positioning_mu": 100.0, "positioning_um": None}}, "errors.positioning_mu", "positioning_um"),
    ({"errors": {"x": {"rol_urad": 100.0}}}, "errors.x.rol_urad", "roll_urad"),
    ({"passes": [{"axis": "x", "count": 2, "both_direction": True}]}, "both_direction", "both_directions"),
    ({"passes": [{"axis": "x", "count": 2, "at": {"Z": 50.0}}]}, r"passes\[1\].at.Z", "z"),
    ({"covariates": {"temp": {"values": 20.0}}}, "covariates.temp.values", "value"),
    ({"hidden": [{"effect": "scale", "axis": "x", "parameter": {"k": 1.0}}]}, "parameter", "parameters"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_a_wrong_entry_is_refused_by_file_and_key(changes, message):
    with pytest.raises(InputFileError, match=message):
        plan(**changes)


@pytest.mark.parametrize(("changes", "key", "word"), MISSPELT, ids=[key for _, key, _ in MISSPELT])
def test_a_misspelt_key_is_told_what_was_meant(changes, key, word):
    document = changed(**changes)
    for name, table in changes.items():
        for absent in [part for part in table if table[part] is None] if isinstance(table, dict) else []:
            del document[name][absent]
    with pytest.raises(InputFileError, match=rf"{key}: is no key of this table \(did you mean {word}\?\)"):
        plan_from_document(document, "plan.toml")


def test_keys_of_the_user_s_own_are_left_alone():
    assert plan(remark="the old machine", noise={"camera": "A"}).covariates == {}


@pytest.mark.parametrize(
    "name", [*FORBIDDEN_COLUMNS, *(name for name in FRAME_COLUMNS.columns if name not in ("feed", "temp"))]
)
def test_a_covariate_cannot_be_a_column_that_something_else_gives(name):
    """One called x wrote its values over the commanded positions, and the truth knew nothing of it."""
    with pytest.raises(InputFileError, match=rf"covariates\.{name}: this column is what the passes, the session or"):
        plan(covariates={name: {"value": 5.0}})


def test_a_covariate_may_be_a_column_that_nothing_else_gives():
    given = {"feed": {"value": 3000.0}, "temp": {"value": 21.0}, "load": {"value": 2.0}}
    assert list(plan(covariates=given).covariates) == list(given)


@pytest.mark.parametrize("missing", ["machine", "rig"])
def test_what_must_be_there_is_asked_for(missing):
    document = changed()
    del document[missing]
    with pytest.raises(InputFileError, match=missing):
        plan_from_document(document, "plan.toml")


def test_a_machine_is_told_that_it_is_no_plan(tmp_path):
    write_machine(tmp_path / "machine.toml", plan().machine)
    with pytest.raises(InputFileError, match="rig: is missing") as caught:
        read_plan(tmp_path / "machine.toml")
    assert "a machine.toml is no plan" in caught.value.remedy


def test_every_available_effect_is_one_of_the_catalogue_s_ids():
    assert set(AVAILABLE_EFFECTS) <= {
        *("scale", "backlash", "backlash-position", "lateral-play", "angular-reversal", "periodic"),
        *("thermal-expansion", "thermal-drift", "warm-up", "camera-drift"),
    }


def test_errors_may_be_taken_from_an_errors_file(tmp_path):
    tables = {"EXX": {"position_mm": [0.0, 100.0], "value_um": [0.0, 50.0]}, "EC0Y": {"value_urad": 10.0}}
    write_json(tmp_path / "errors.json", {"errors": tables})
    own = {"squareness_mrad": {"EB0Z": -1.24}}
    for given in ("errors.json", tables):
        which = plan_from_document(changed(errors={"tables": given, **own}), tmp_path / "plan.toml")
        assert list(which.errors.tables) == ["EXX"]
        assert which.errors.tables["EXX"].value.tolist() == [0.0, 0.05]
        assert which.errors.squareness_rad == pytest.approx({"EC0Y": 1e-5, "EB0Z": -1.24e-3, "EA0Z": 0.0})
    # What is stated twice may be stated in two ways.
    with pytest.raises(
        InputFileError, match=r"squareness_mrad\.EC0Y: is given by errors\.EC0Y of .*errors\.json, too"
    ):
        plan_from_document(changed(errors={"tables": "errors.json"}), tmp_path / "plan.toml")
    write_json(tmp_path / "rig.json", {"K_left": []})
    with pytest.raises(InputFileError, match=r"rig\.json: errors: has no errors"):
        plan_from_document(changed(errors={"tables": "rig.json"}), tmp_path / "plan.toml")
    (tmp_path / "errors.json").write_text(json.dumps({"errors": {"EXX": {"position_mm": [0.0]}}}))
    with pytest.raises(InputFileError, match="value_um"):
        plan_from_document(changed(errors={"tables": "errors.json"}), tmp_path / "plan.toml")


def test_a_machine_made_of_its_truth_is_the_same_machine(tmp_path):
    """Its squarenesses were dropped: the machine came out square, and its truth said so."""
    passes = [{"axis": axis, "count": 9} for axis in "xyz"]
    first = truth_of(Scene(plan(passes=passes))).errors
    write_errors(tmp_path / "truth.json", first)
    again = changed(passes=passes)
    again["errors"] = {"tables": "truth.json"}
    second = truth_of(Scene(plan_from_document(again, tmp_path / "plan.toml"))).errors
    assert first.squareness["EC0Y"].value_rad == pytest.approx(-5.05e-3, abs=1e-4)
    for name, value in first.squareness.items():
        assert second.squareness[name].value_rad == pytest.approx(value.value_rad, abs=1e-14), name
    for name, function in first.functions.items():
        assert np.allclose(second.functions[name].value, function.value, atol=1e-13), name
