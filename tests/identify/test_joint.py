"""The joint estimate: truth and intervals, the tested assumption, what other data it takes, what it leaves open."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_machine import Truth, camera, draw_truth, gauged, machine_of, nine_lines, observe

from geoerr.diagnose import compare
from geoerr.error_functions import ALL_NAMES, LINEAR_AND_ANGULAR, errors_from_document, is_angular, write_errors
from geoerr.errors import GeoerrError, InputFileError
from geoerr.identify import NineLineResult, analyze_nine_lines, identify_nine_line
from geoerr.identify.joint import JointResult, identify_joint
from geoerr.model import load_model
from geoerr.observations import Observations, observations_from_columns

CROSSING = {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}
ROLL = ("EAX", "EBY", "ECZ")
COVARIANCE_MM2 = np.diag([1e-6, 1e-6, 9e-6])


def measured(
    seed: int,
    chain: str = "wZbXYt",
    *,
    follows_tangent: bool = True,
    noise: float = 1.0,
    n_points: int = 9,
    is_stated: bool = True,
) -> tuple[Truth, Observations]:
    """Nine lines of one session, twice, with noise of `noise`² times the covariance, stated."""
    rng = np.random.default_rng(seed)
    machine = machine_of(chain)
    truth = draw_truth(rng, chain, follows_tangent=follows_tangent, n_points=n_points)
    moves = [replace(move, repeat=repeat) for repeat in range(2) for move in nine_lines(machine)]
    covariance = noise**2 * COVARIANCE_MM2
    view = {"0": camera(rng)}
    return truth, observe(machine, truth, moves, view, covariance_mm2=covariance, rng=rng, is_stated=is_stated)


def differences(result: JointResult, truth: Truth) -> dict[str, np.ndarray]:
    """Found minus true in standard uncertainties, the first point left out."""
    found = {}
    for name, function in result.errors.functions.items():
        assert function.std is not None
        q = truth.q_mm[name[2].lower()]
        assert np.allclose(function.position_mm, q)
        true = truth.tables[name]
        if not is_angular(name) and name[1] != name[2]:
            true = gauged(q, true)
        found[name] = (function.value - true)[1:] / function.std[1:]
    for name, one in result.errors.squareness.items():
        assert one.std_rad is not None
        found[name] = np.array([(one.value_rad - truth.iso()[name]) / one.std_rad])
    return found


@pytest.mark.parametrize("chain", ["wZbXYt", "wbXYZt", "wYbZXt"])
def test_truth_is_found(chain: str) -> None:
    """Almost no noise: what is left is a hundredth of a micrometre, or of a microradian at 200 mm a twentieth."""
    truth, observations = measured(1, chain, noise=1e-3)
    result = identify_joint(observations, machine_of(chain))
    assert result.errors.not_determined == ()
    assert set(result.errors.functions) == set(LINEAR_AND_ANGULAR)
    for name, function in result.errors.functions.items():
        true = truth.tables[name] if is_angular(name) else gauged(truth.q_mm[name[2].lower()], truth.tables[name])
        if name[1] == name[2]:
            true = truth.tables[name]
        assert np.abs(function.value - true).max() < (2e-7 if is_angular(name) else 2e-5), name
    for name, one in result.errors.squareness.items():
        assert one.value_rad == pytest.approx(truth.iso()[name], abs=2e-7)


def test_intervals_hold_the_truth() -> None:
    """12 machines, 1800 values, correlated in groups of some tens: 95 % to within four standard errors of that."""
    pooled = []
    for seed in range(12):
        truth, observations = measured(100 + seed)
        result = identify_joint(observations, machine_of("wZbXYt"))
        pooled.append(np.concatenate([*differences(result, truth).values()]))
    inside = np.abs(np.concatenate(pooled)) < 1.96
    # Some 60 free directions a machine.
    assert np.mean(inside) == pytest.approx(0.95, abs=4.0 * np.sqrt(0.95 * 0.05 / (12 * 60)))


@pytest.mark.parametrize("names", [("EXX", "EYY", "EZZ"), ("EBX", "ECX", "EAY", "ECY", "EAZ", "EBZ"), ROLL])
def test_it_is_more_certain_than_the_arithmetic_of_nine_lines(names: tuple[str, ...]) -> None:
    """Every row counts, and neighbours on a curve help each other; `validation/joint.md` has the study."""
    squares: dict[str, list[float]] = {"joint": [], "nine-line": []}
    machine = machine_of("wZbXYt")
    for seed in range(200, 204):
        truth, observations = measured(seed)
        for method, errors in (
            ("joint", identify_joint(observations, machine).errors),
            ("nine-line", analyze_nine_lines(observations, machine).errors),
        ):
            squares[method] += [
                float(np.mean((errors.functions[name].value - truth.tables[name]) ** 2)) for name in names
            ]
    assert np.sqrt(np.mean(squares["joint"]) / np.mean(squares["nine-line"])) < 0.8


def test_straightness_from_points_and_from_angles() -> None:
    truth, observations = measured(2)
    direct = identify_joint(observations, machine_of("wZbXYt"))
    integrated = identify_joint(observations, machine_of("wZbXYt"), straightness="integrated")
    assert set(direct.errors.alternatives) == {"straightness-integrated"}
    assert set(integrated.errors.alternatives) == {"straightness-direct"}
    assert set(direct.errors.alternatives["straightness-integrated"]) == CROSSING
    for name in CROSSING:
        from_angles, from_points = integrated.errors.functions[name], direct.errors.functions[name]
        assert np.allclose(from_angles.value, direct.errors.alternatives["straightness-integrated"][name].value)
        assert from_angles.std is not None
        assert from_points.std is not None
        assert np.mean(from_angles.std**2) <= np.mean(from_points.std**2)
    found = differences(integrated, truth)
    assert np.mean(np.abs(np.concatenate([found[name] for name in CROSSING])) < 3.0) > 0.95
    assert {verdict.name for verdict in direct.tangent} == CROSSING


def test_tangent_following_is_accepted_where_it_holds_and_rejected_where_not() -> None:
    kept, broken = [], []
    for seed in range(4):
        for follows, verdicts in ((True, kept), (False, broken)):
            _, observations = measured(300 + seed, follows_tangent=follows)
            result = identify_joint(observations, machine_of("wZbXYt"), straightness="integrated")
            verdicts += [verdict.follows for verdict in result.tangent]
            warned = any("does not follow its guideway's tangent" in note for note in result.errors.notes)
            assert warned or follows
    # One of a hundred is rejected by chance: more than three of 24 once in five thousand such tests.
    assert kept.count(False) <= 3
    assert broken.count(True) == 0


def test_order_of_rows_and_threads_change_nothing() -> None:
    _, observations = measured(3)
    machine = machine_of("wZbXYt")
    first = identify_joint(observations, machine, threads=1).errors
    order = np.random.default_rng(0).permutation(len(observations))
    second = identify_joint(Observations(observations.frame[order], observations.sources), machine, threads=2).errors
    for name in LINEAR_AND_ANGULAR:
        assert np.allclose(first.functions[name].value, second.functions[name].value, rtol=0.0, atol=1e-9), name
    again = identify_joint(observations, machine, threads=2).errors
    assert again.to_document() == first.to_document()


def test_two_sessions_of_the_cameras_lose_squareness_only_where_they_must() -> None:
    """Camera moved between tool lines and bed lines: S_xz and S_yz are lost (docs/theory/gauge.md)."""
    rng = np.random.default_rng(4)
    machine = machine_of("wZbXYt")
    moves = [replace(move, session="bed" if move.carrier == "work" else "tool") for move in nine_lines(machine)]
    views = {"tool": camera(rng), "bed": camera(rng)}
    truth = draw_truth(rng, "wZbXYt")
    observations = observe(machine, truth, moves, views, covariance_mm2=COVARIANCE_MM2, rng=rng)
    result = identify_joint(observations, machine)
    assert {"EB0Z", "EA0Z"} <= {item.name for item in result.errors.not_determined}
    assert "EC0Y" in result.errors.squareness


def test_a_laser_along_one_axis_gives_positioning_and_says_what_it_cannot() -> None:
    q_mm, noise = np.linspace(0.0, 400.0, 21), np.random.default_rng(5).normal(0.0, 2e-4, 21)
    error_mm = 1e-5 * q_mm - 1e-8 * q_mm**2
    columns = {"x": q_mm, "y": 0.0 * q_mm, "z": 0.0 * q_mm, "mx": q_mm + error_mm + noise}
    observations = observations_from_columns(columns | {"sx": np.full(21, 2e-4)})
    result = identify_joint(observations, machine_of("wbXYZt"))
    assert set(result.errors.functions) == {"EXX"}
    assert {item.name for item in result.errors.not_determined} == set(ALL_NAMES) - {"EXX"}
    function = result.errors.functions["EXX"]
    assert function.std is not None
    assert np.abs((function.value - error_mm)[1:] / function.std[1:]).max() < 4.0


def test_two_positions_of_an_axis_have_a_chord_and_no_straightness() -> None:
    """They were told as 0.0 ± 0.0 µm, determined, and squarenesses beside them that were off by 9 standard errors."""
    _, observations = measured(41, n_points=9)
    x_mm = observations.commanded_mm[:, 0]
    at_ends = np.isin(x_mm, (x_mm.min(), x_mm.max()))
    result = identify_joint(observations.select(at_ends), machine_of("wZbXYt"))
    whys = {item.name: item.why for item in result.errors.not_determined}
    assert whys.keys() == {"EYX", "EZX", "EC0Y", "EB0Z"}
    assert "fewer than three positions on X" in whys["EYX"]
    assert "chord" in whys["EC0Y"]
    assert not {"EYX", "EZX"} & result.errors.alternatives["straightness-integrated"].keys()
    assert {one.name for one in result.tangent} == CROSSING - {"EYX", "EZX"}


def test_without_stated_uncertainty_the_scatter_tells_it() -> None:
    stated = identify_joint(measured(6)[1], machine_of("wZbXYt"))
    _, observations = measured(6, is_stated=False)
    result = identify_joint(observations, machine_of("wZbXYt"))
    # All components count alike, with the root mean square of 1, 1 and 3 µm.
    assert result.result.fitted.scale == pytest.approx(np.sqrt(11.0 / 3.0) * 1e-3, rel=0.15)
    assert stated.result.fitted.scale == 1.0


def test_document_is_plain() -> None:
    document = identify_joint(measured(7)[1], machine_of("wZbXYt")).to_document()
    assert json.loads(json.dumps(document)) == document
    assert {item["name"] for item in document["straightness"]} == CROSSING


@pytest.mark.parametrize("identify", [identify_joint, analyze_nine_lines])
def test_tables_know_the_data_that_they_came_from(
    identify: Callable[..., JointResult | NineLineResult], tmp_path: Path
) -> None:
    """Held against these, the model's own freedom takes part, as it does of a fitted model; not against others."""
    _, observations = measured(3)
    _, others = measured(4)
    path = tmp_path / "errors.json"
    write_errors(path, identify(observations, machine_of("wZbXYt")).errors)
    model = load_model(path)
    assert compare(model, observations).freedom == "own"
    assert compare(model, others).freedom == "held"
    document = json.loads(path.read_text(encoding="utf-8"))
    document["data"] = {"digest": 7}
    with pytest.raises(InputFileError, match=r"data\.digest"):
        errors_from_document(document, path)


@pytest.mark.parametrize(
    ("identify", "name", "known"),
    [
        (identify_joint, "straightness", "'direct', 'integrated'"),
        (identify_nine_line, "straightness", "'direct', 'integrated'"),
        (analyze_nine_lines, "roll", "'linear', 'li'"),
    ],
)
def test_a_method_that_is_none_is_refused_before_any_work(
    identify: Callable[..., object], name: str, known: str
) -> None:
    """Of the joint estimate it had been an error of Python, after both fits."""
    _, observations = measured(3)
    with pytest.raises(GeoerrError, match=f"^{name} cannot be 'x'\nhint: write one of {known}$"):
        identify(observations, machine_of("wZbXYt"), **{name: "x"})


@pytest.mark.parametrize(("n_places", "is_told"), [(5, True), (25, False)])
def test_a_squareness_that_is_another_beside_so_few_entries_is_told(n_places: int, is_told: bool) -> None:
    """Of a guideway like an S the polygon through five places has another slope than the curve."""
    rng = np.random.default_rng(1)
    along = np.linspace(0.0, 400.0, n_places)
    lines = [(axis, one) for axis in range(3) for one in rng.uniform(0.0, 400.0, (8, 3))]
    q = np.array([np.insert(np.delete(one, axis), axis, at) for axis, one in lines for at in along])
    u = (q[:, 0] - 200.0) / 200.0
    bent_mm = 0.02 * (5.0 * u**3 - 3.0 * u)
    seen = q + np.outer(bent_mm, [0.0, 1.0, 0.0]) + 1e-3 * rng.normal(size=q.shape)
    columns: dict[str, object] = {"carrier": ["relative"] * len(q)}
    for k, axis in enumerate("xyz"):
        columns |= {axis: q[:, k], f"m{axis}": seen[:, k]}
    result = identify_joint(observations_from_columns(columns), machine_of("wbXYZt"))
    told = [note for note in result.errors.notes if "polygon" in note]
    assert len(told) == is_told
    beside_polygons, beside_curves = (
        1e6 * errors.squareness["EC0Y"].value_rad for errors in (result.errors, result.result.model.error_functions())
    )
    if is_told:
        assert f"EC0Y is {beside_polygons:.1f} µrad" in told[0]
        assert f"{beside_curves:.1f} beside the curves" in told[0]
        assert abs(beside_polygons) > 3.0 * abs(beside_curves), "the S has no slope"
