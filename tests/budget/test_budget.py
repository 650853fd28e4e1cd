"""The budget: parts add up, noise and calibration are what refits say, and everything has its unit."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from budget_scenes import fit_of_nine_lines
from fit_scenes import CUBICS
from fitted_models import backlash, expansion
from fitted_models import fitted as drawn_model
from scipy import stats
from virtual_machine import machine_of

from geoerr.budget import (
    Budget,
    Implementation,
    UncertaintyMap,
    budget_text,
    propagate_distributions,
    refit_with_noise,
    uncertainty_budget,
    uncertainty_map,
)
from geoerr.effects import catalogue
from geoerr.error_functions import ErrorFunctions
from geoerr.errors import GeoerrError, GeometryError, NotDeterminedError, ShapeError
from geoerr.fit import FitOptions, FitResult, fit_terms, result_of
from geoerr.model import Model
from geoerr.model.document import document_of, model_from_document
from geoerr.observations import Observations, observations_from_columns
from geoerr.vision.rig import Rig

PLACES = {"a": (400.0, 400.0, 400.0), "b": (200.0, 100.0, 300.0), "c": (400.0, 0.0, 100.0)}
N_REFITS = 400


@pytest.fixture(scope="module")
def told() -> tuple[FitResult, Rig]:
    """A fit that knows its calibration."""
    result, rig = fit_of_nine_lines(with_rig=True)
    assert rig is not None
    return result, rig


@pytest.fixture(scope="module")
def budget(told: tuple[FitResult, Rig]) -> Budget:
    return uncertainty_budget(told[0], PLACES, rig=told[1])


def test_sources_add_up_to_the_fit(told: tuple[FitResult, Rig], budget: Budget) -> None:
    """The law of total variance: noise and calibration are all that the record's covariance holds."""
    assert told[0].fitted.scale == 1.0
    expected = told[0].model.prediction_covariance_mm2(budget.q_mm)
    roots = {source.name: root for source, root in budget.chosen("prediction") if source.by_parameter is not None}
    assert set(roots) == {"pixels", "calibration"}
    found = np.sum([root @ root.transpose(0, 2, 1) for root in roots.values()], axis=0)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_calibration_by_groups_is_that_of_the_fit(told: tuple[FitResult, Rig], budget: Budget) -> None:
    """T Σ Tᵀ from the rig's own derivatives and K_θh K_θhᵀ from the solution: two ways, one number."""
    without = uncertainty_budget(told[0], PLACES)
    for one, other in zip(budget.contributions("prediction"), without.contributions("prediction"), strict=True):
        assert one.name == other.name
        assert one.std_um == pytest.approx(other.std_um, rel=1e-7)


def test_shares_add_up(budget: Budget) -> None:
    for of in ("prediction", "part"):
        shares = [one.share for one in budget.contributions(of)]
        assert np.sum(shares, axis=0) == pytest.approx(np.ones(3), abs=1e-12)
    for pieces in (budget.pieces("calibration"), budget.pieces("pixels"), budget.parameter_groups()):
        assert len(pieces) >= 2
        assert np.sum([one.share for one in pieces], axis=0) == pytest.approx(np.ones(3), abs=1e-9)


def test_places_of_targets_cost_what_a_fit_with_known_places_saves(budget: Budget) -> None:
    """The two pieces of the noise are independent: their variances, not only their shares, add up."""
    noise = next(one for one in budget.contributions() if one.name == "pixels")
    variances = [one.std_um**2 for one in budget.pieces("pixels")]
    assert np.sum(variances, axis=0) == pytest.approx(noise.std_um**2, rel=1e-9)
    assert all((one > 0.0).all() for one in variances)


@pytest.mark.parametrize(("noise", "calibration"), [(True, False), (False, True), (True, True)])
def test_exact_refits_scatter_as_propagated(budget: Budget, noise: bool, calibration: bool) -> None:
    """Variance of 400 refits over the propagated one: chi-squared, 10⁻⁴ two-sided for each of nine components."""
    found = refit_with_noise(budget, n_trials=N_REFITS, seed=3, with_noise=noise, with_calibration=calibration)
    low, high = stats.chi2.ppf([5e-5, 1.0 - 5e-5], N_REFITS - 1) / (N_REFITS - 1)
    assert (found.ratio[:, :3] ** 2 > low).all()
    assert (found.ratio[:, :3] ** 2 < high).all()


def test_a_fit_that_was_not_told_has_the_larger_calibration_part(told: tuple[FitResult, Rig], budget: Budget) -> None:
    """Weights that do not know the calibration leave more of it (Gauss and Markov); refits agree here too."""
    result, rig = fit_of_nine_lines(with_rig=True, told=False)
    other = uncertainty_budget(result, PLACES, rig=rig)
    assert (other.standard_length_um() > budget.standard_length_um()).all()
    found = refit_with_noise(other, n_trials=N_REFITS, seed=5)
    low, high = stats.chi2.ppf([5e-5, 1.0 - 5e-5], N_REFITS - 1) / (N_REFITS - 1)
    assert (found.ratio[:, :3] ** 2 > low).all()
    assert (found.ratio[:, :3] ** 2 < high).all()
    silent = uncertainty_budget(result, PLACES)
    assert any("not told" in sentence for sentence in silent.not_counted)


def test_distributions_agree_with_propagation(budget: Budget) -> None:
    """Supplement 1, 8: ends of the intervals within half of the last significant digit."""
    for of in ("prediction", "part"):
        found = propagate_distributions(budget, of, seed=1)
        assert found.is_stable
        assert found.is_validated
        assert (np.abs(found.ratio - 1.0) < 3.0 * found.ratio_half_width).all()
        assert (found.difference_um <= found.tolerance_um).all()


def test_more_digits_take_more_trials_and_the_same_seed_gives_the_same(budget: Budget) -> None:
    one, two = (propagate_distributions(budget, seed=7, n_digits=digits, most_trials=80_000) for digits in (1, 2))
    assert one.n_trials < two.n_trials <= 80_000
    again = propagate_distributions(budget, seed=7)
    assert np.array_equal(one.std_um, again.std_um)


def test_units(told: tuple[FitResult, Rig], budget: Budget) -> None:
    """What was put in comes out: 0.01 px of the pictures, and the sizes of the rig's groups."""
    stages = {stage.name: stage for stage in budget.stages}
    assert stages["corner"].unit == "px"
    assert stages["corner"].std == pytest.approx(0.01, rel=1e-3)
    rig = told[1]
    assert rig.covariance is not None
    pieces = next(source for source in budget.sources if source.name == "calibration").pieces
    along = rig.right_from_left.t_mm / rig.baseline_mm
    scale = math.sqrt(along @ rig.covariance[-3:, -3:] @ along) / rig.baseline_mm
    assert pieces["length of the baseline (scale)"].std == pytest.approx(scale * 1e6)
    assert pieces["length of the baseline (scale)"].unit == "10⁻⁶"
    assert pieces["turn of the right camera"].unit == "µrad"
    expected_mm = np.sqrt(np.trace(budget.covariance_mm2(), axis1=1, axis2=2))
    assert budget.standard_length_um() == pytest.approx(1e3 * expected_mm)
    coverage = stats.t.isf(0.025, budget.dof()[:, :3])
    assert (coverage >= 1.95996).all()
    assert budget.expanded_um() == pytest.approx(coverage * budget.standard_um())


def test_a_part_is_less_certain_than_its_prediction(told: tuple[FitResult, Rig]) -> None:
    exact = Implementation(0.0, 0.0, digits=None)
    same = uncertainty_budget(told[0], PLACES, implementation=exact)
    assert same.standard_um("part") == pytest.approx(same.standard_um("prediction"))
    coarse = uncertainty_budget(told[0], PLACES, implementation=Implementation(0.0, 0.0, None, 0.05))
    extra = coarse.standard_um("part") ** 2 - coarse.standard_um("prediction") ** 2
    assert extra == pytest.approx(np.full((3, 3), 50.0**2 / 12.0))


def test_corners_centre_and_worst_are_the_places_if_none_are_named(told: tuple[FitResult, Rig]) -> None:
    found = uncertainty_budget(told[0])
    assert len(found.place_names) == 10
    assert found.place_names[-2:] == ("centre", "worst")
    assert found.standard_length_um()[-1] >= found.standard_length_um()[:-1].max() * (1.0 - 1e-12)
    volume = uncertainty_map(found, 5)
    assert volume.prediction_um.shape == (5, 5, 5)
    assert volume.prediction_um[-1, -1, -1] == pytest.approx(found.standard_length_um()[7])
    assert volume.part_95_um[2, 2, 2] == pytest.approx(found.expanded_length_um("part")[8])
    assert (volume.part_um >= volume.prediction_um).all()


def test_a_single_place_of_an_edge_is_in_its_middle(told: tuple[FitResult, Rig]) -> None:
    found = uncertainty_budget(told[0])
    one = uncertainty_map(found, 1)
    assert [*one.x_mm, *one.y_mm, *one.z_mm] == pytest.approx(found.q_mm[-2])
    assert one.prediction_um[0, 0, 0] == pytest.approx(found.standard_length_um()[-2])
    ends, middle, more = (list(axis) for axis in _axes_mm(uncertainty_map(found, (2, 1, np.int64(3)))))
    assert (ends, middle, more) == ([0.0, 400.0], [200.0], [0.0, 200.0, 400.0])


@pytest.mark.parametrize("n", [0, -1, 2.5, (2, 3), (2, 3, 0), (2, 3, 4, 5), (2, 3, 4.0), "two", None])
def test_what_is_no_number_of_places_is_refused(told: tuple[FitResult, Rig], n: object) -> None:
    with pytest.raises(ShapeError, match=r"^n is .*\nhint: write how many places .* along each edge of the volume"):
        uncertainty_map(uncertainty_budget(told[0]), n)  # type: ignore[arg-type]  # n may be no number of places


def _axes_mm(volume: UncertaintyMap) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return volume.x_mm, volume.y_mm, volume.z_mm


def test_conditions_count_by_their_own_slope() -> None:
    """alpha·(T − 20)·(x − q_fixed): 1 K is alpha·(x − q_fixed) along x, first order in nothing else."""
    model = drawn_model(size=0.0)
    places = {"end": (400.0, 0.0, 0.0), "fixed": (120.0, 0.0, 0.0)}
    at = {"temp_bed": 50.0, "d_y": 1.0}
    sure, unsure = (uncertainty_budget(model, places, at=at, at_std=std) for std in ({}, {"temp_bed": 2.0}))
    extra = unsure.covariance_mm2()[:, 0, 0] - sure.covariance_mm2()[:, 0, 0]
    assert np.sqrt(np.maximum(extra, 0.0)) == pytest.approx([2.0 * 1.17e-5 * 280.0, 0.0], abs=1e-9)
    source = next(source for source in unsure.sources if source.condition is not None)
    assert (source.kind, source.unit, source.std) == ("B", "°C", 2.0)
    with pytest.raises(GeoerrError, match="an uncertainty is stated for the condition temp_spindle"):
        uncertainty_budget(model, places, at=at, at_std={"temp_spindle": 1.0})
    with pytest.raises(GeoerrError, match="temp_bed"):
        uncertainty_budget(model, places, at={"d_y": 1.0})


def test_a_place_outside_the_measured_range_is_said() -> None:
    at = {"temp_bed": 50.0, "d_y": 1.0}
    places = {"inside": (400.0, 0.0, 100.0), "below": (100.0, -30.0, 80.0), "far": (450.0, -60.0, 80.0)}
    found = uncertainty_budget(drawn_model(), places, at=at)
    assert [one for one in found.not_counted if "measured range" in one] == [
        "far: x = 450 is extrapolated: 50 mm outside the measured range (0 to 400 mm): "
        "whether the errors go on like that",
        "far (and 1 more): y = -60 is extrapolated: 60 mm outside the measured range (0 to 400 mm): "
        "whether the errors go on like that",
    ]
    assert "y = -60 is extrapolated" in budget_text(found)
    assert found.to_document()["not_counted"][0] == found.not_counted[0]
    # It follows the places.
    assert not any("measured range" in one for one in found.at_places([places["inside"]]).not_counted)


def test_a_model_file_is_enough_for_what_it_holds() -> None:
    model = drawn_model()
    at = {"temp_bed": 50.0, "d_y": 1.0}
    found = uncertainty_budget(model, PLACES, at=at)
    assert found.covariance_mm2() == pytest.approx(model.prediction_covariance_mm2(found.q_mm, at=at), rel=1e-9)
    assert {one.name for one in found.parameter_groups()} >= {"positioning", "roll", expansion().id, backlash().id}
    assert any("model file" in sentence for sentence in found.not_counted)
    with pytest.raises(NotDeterminedError, match="nothing can be fitted again"):
        refit_with_noise(found)


def test_what_is_not_determined_is_no_number() -> None:
    found = uncertainty_budget(drawn_model(n_null=1), PLACES, at={"temp_bed": 50.0, "d_y": 1.0})
    assert not found.is_determined.any()
    assert np.isnan(found.standard_um()).all()
    assert "not determined" in budget_text(found)
    assert found.to_document()["places"][0]["prediction"]["std_length_um"] is None
    with pytest.raises(NotDeterminedError, match="at no place"):
        found.worst()


@pytest.mark.parametrize("moved", ["XY", "XYZ"])
def test_the_worst_place_is_one_that_is_known(moved: str) -> None:
    """A plane was measured: the worst place is in it, and not the first point, where the error is 0 by convention."""
    laser = plane_at_100_mm(np.random.default_rng(5))
    bases = {name: basis for name, basis in CUBICS.items() if name[2] in moved}
    fit = result_of(fit_terms(machine_of("wbXYZt"), [laser], options=FitOptions(bases=bases)))
    assert fit.model.record is not None
    assert fit.model.record.stood_mm == {"z": 100.0}
    budget = uncertainty_budget(fit)
    is_in_plane = budget.q_mm[:, 2] == 100.0
    assert is_in_plane.sum() == 1
    assert np.array_equal(is_in_plane, budget.is_determined.all(axis=1))
    place, std_um = budget.worst()
    assert place[2] == 100.0
    assert std_um > 0.1


def test_what_is_known_by_convention_alone_is_no_worst_place() -> None:
    """A laser along X: at the ends of the line its straightness is 0 by convention, and known nowhere else."""
    rng = np.random.default_rng(6)
    x = np.tile(np.linspace(0.0, 400.0, 21), 3)
    columns: dict[str, object] = {"line": ["X"] * 63, "repeat": np.repeat([0, 1, 2], 21), "carrier": ["tool"] * 63}
    columns |= {"x": x, "y": np.zeros(63), "z": np.zeros(63), "mx": x + rng.normal(0.0, 1e-3, 63)}
    columns |= {"sx": np.full(63, 1e-3)}
    budget = uncertainty_budget(result_of(fit_terms(machine_of("wbXYZt"), [observations_from_columns(columns)])))
    assert "worst" not in budget.place_names
    with pytest.raises(NotDeterminedError, match="at no place"):
        budget.worst()


def plane_at_100_mm(rng: np.random.Generator) -> Observations:
    """Three targets in the plane of X and Y, 1 µm."""
    grid = np.array([(x, y, 100.0) for x in np.linspace(0.0, 400.0, 4) for y in np.linspace(0.0, 400.0, 4)])
    targets = np.array([(0.0, 0.0, -80.0), (60.0, 0.0, -80.0), (0.0, 60.0, -40.0)])
    q, offset = np.repeat(grid, len(targets), axis=0), np.tile(targets, (len(grid), 1))
    measured = q + offset + rng.normal(0.0, 1e-3, q.shape)
    columns: dict[str, object] = {"line": [f"y{y:g}" for y in q[:, 1]], "carrier": ["relative"] * len(q)}
    for heads, numbers in ((("x", "y", "z"), q), (("tx", "ty", "tz"), offset), (("mx", "my", "mz"), measured)):
        columns |= dict(zip(heads, numbers.T, strict=True))
    return observations_from_columns(columns | {name: np.full(len(q), 1e-3) for name in ("sx", "sy", "sz")})


def test_a_component_that_is_not_determined_hides_no_other() -> None:
    """A free turn about z leaves x and y open, and says nothing against z."""
    whole = drawn_model()
    assert whole.record is not None
    free = np.zeros((whole.record.n_parameters, 1))
    free[whole.parameter_names.index("ECX.c5")] = 1.0
    model = dataclasses.replace(whole, record=dataclasses.replace(whole.record, null_space=free))
    at = {"temp_bed": 50.0, "d_y": 1.0}
    found, known = (uncertainty_budget(one, [[350.0, 150.0, 80.0]], at=at) for one in (model, whole))
    assert found.is_determined.tolist() == [[False, False, True]]
    assert found.standard_um()[0, 2] == known.standard_um()[0, 2] > 0.0
    assert found.expanded_um()[0, 2] == known.expanded_um()[0, 2]
    assert np.isnan(found.standard_um()[0, :2]).all()
    assert np.isnan(found.standard_length_um()).all()
    assert "not determined: x, y" in budget_text(found)


def test_refusals(told: tuple[FitResult, Rig], budget: Budget) -> None:
    result, rig = told
    bare = Model(result.model.machine, terms=result.model.terms)
    with pytest.raises(NotDeterminedError, match="no covariance of its parameters") as refused:
        uncertainty_budget(bare)
    assert "geoerr fit" in str(refused.value)
    with pytest.raises(NotDeterminedError):
        uncertainty_budget(Model(result.model.machine, ErrorFunctions(result.model.machine, {}, {}, "none")))
    unknown = Rig(rig.K_left, rig.dist_left, rig.K_right, rig.dist_right, rig.right_from_left, rig.image_size)
    with pytest.raises(GeometryError, match="states no covariance"):
        uncertainty_budget(result, rig=unknown)
    with pytest.raises(ShapeError, match="q_mm"):
        uncertainty_budget(result, np.zeros(3))
    with pytest.raises(ShapeError, match="2 names are given for 3 places"):
        budget.at_places(np.zeros((3, 3)), ["a", "b"])
    with pytest.raises(GeometryError, match="no rig"):
        refit_with_noise(uncertainty_budget(result, PLACES))


def test_text_and_document_say_the_same(budget: Budget) -> None:
    text, document = budget_text(budget), budget.to_document()
    json.dumps(document, allow_nan=False)
    for source in document["sources"]:
        assert source["name"] in text
    worst = document["places"][0]["part"]["std_length_um"]
    assert f"{worst:.3g}" in text or f"{worst:.0f}" in text
    for words in ("[[Not counted]]", "µrad", "px", "effective dof", "turn of the right camera"):
        assert words in text


def test_what_one_axis_alone_was_measured_for_is_off_along_it() -> None:
    """A laser along x sees errors of 5 µm up and down that no smooth function follows: all of that is along x."""
    x = np.linspace(0.0, 400.0, 41)
    off_mm = 5e-3 * np.where(np.arange(len(x)) % 2 == 0, 1.0, -1.0)
    noise_mm = 1e-4 * np.random.default_rng(3).normal(size=(3, len(x)))
    columns = {"x": np.tile(x, 3), "y": np.zeros(123), "z": np.zeros(123), "repeat": np.repeat([0.0, 1.0, 2.0], 41)}
    columns |= {"mx": np.tile(x + off_mm, 3) + noise_mm.ravel(), "dir_x": np.ones(123)}
    laser = observations_from_columns(columns)
    machine = machine_of("wbXYZt")
    scale = catalogue()["scale"].term("x", None, machine)
    fit = result_of(fit_terms(machine, [laser], effects=[scale], options=FitOptions(components="none")))
    budget = uncertainty_budget(fit, {"a": (200.0, 0.0, 0.0)})
    (misfit,) = (source for source, _ in budget.chosen("prediction") if source.name == "misfit")
    assert misfit.everywhere_mm is not None
    assert misfit.everywhere_mm[0, 0] == pytest.approx(5e-3, rel=0.05)
    # The file holds it as well.
    of_file = uncertainty_budget(read_again(fit.model), {"a": (200.0, 0.0, 0.0)})
    assert of_file.expanded_um() == pytest.approx(budget.expanded_um(), rel=1e-6, nan_ok=True)
    assert of_file.dof() == pytest.approx(budget.dof(), rel=1e-6, nan_ok=True)
    # Of y and z nothing was asked: neither "± 0" nor a misfit that x alone has shown.
    assert np.isnan(of_file.expanded_um()[0, 1:]).all()


@pytest.mark.parametrize("stated_mm", [None, 0.4e-3, 4e-3])
def test_a_file_is_as_sure_as_the_fit(stated_mm: float | None) -> None:
    """Four points and a scale: k of two degrees of freedom, where the scatter tells and not what is stated."""
    x = np.linspace(0.0, 400.0, 4)
    noise_mm = 1e-3 * np.random.default_rng(1).normal(size=4)
    columns = {"x": x, "y": np.zeros(4), "z": np.zeros(4), "mx": x + noise_mm, "dir_x": np.ones(4)}
    if stated_mm is not None:
        columns["sx"] = np.full(4, stated_mm)
    machine, options = machine_of("wbXYZt"), FitOptions(components="none")
    scale = catalogue()["scale"].term("x", None, machine)
    fit = result_of(fit_terms(machine, [observations_from_columns(columns)], effects=[scale], options=options))
    model = read_again(fit.model)
    of_fit, of_file = (uncertainty_budget(one, {"end": (400.0, 0.0, 0.0)}) for one in (fit, model))
    assert of_file.expanded_um()[0, 0] == pytest.approx(of_fit.expanded_um()[0, 0], rel=1e-9)
    assert of_file.dof()[0, 0] == pytest.approx(of_fit.dof()[0, 0], rel=1e-9)
    assert model.record is not None
    older = dataclasses.replace(model, record=dataclasses.replace(model.record, figures={}))
    told = uncertainty_budget(older, {"end": (400.0, 0.0, 0.0)}).not_counted
    assert any("count as infinite" in sentence for sentence in told) == (fit.fitted.scale > 1.0 or stated_mm is None)


def read_again(model: Model) -> Model:
    return model_from_document(json.loads(json.dumps(document_of(model))), "model.json")
