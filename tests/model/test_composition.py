"""Models are put together and taken apart by term."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fitted_models import (
    REFERENCE,
    all_terms,
    backlash,
    classic_terms,
    drawn_record,
    expansion,
    fitted,
    rig_scale,
    spline,
    squareness,
)
from model_machines import drawn_errors, machine

from geoerr.effects import catalogue
from geoerr.error_functions import ALL_NAMES
from geoerr.errors import GeoerrError, InputFileError, ShapeError
from geoerr.model import GROUPS, FitRecord, Model
from geoerr.model.document import document_of
from geoerr.terms import Part

AT = {"temp_bed": 60.0, "d_y": 1.0}


def points(n: int = 20, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 400.0, (n, 3))


class TestLaws:
    def test_adding_and_taking_away_is_nothing(self) -> None:
        base = Model(machine(), None, classic_terms(), drawn_record(classic_terms()))
        for term in (expansion(std=1e-7), backlash()):
            again = (base + term).without(term.id)
            assert again.terms == base.terms
            assert np.array_equal(again.error_mm(points()), base.error_mm(points()))
        # A stated uncertainty keeps the record, whose order has room for it before the inner parameters.
        assert document_of((base + expansion(std=1e-7)).without(REFERENCE)) == document_of(base)

    def test_taking_away_goes_in_any_order(self) -> None:
        model = fitted(n_null=2)
        first = model.without(REFERENCE).without(["ECX", "squareness"])
        second = model.without(["squareness", "ECX", REFERENCE])
        assert first.terms == second.terms
        assert first.record is not None
        assert second.record is not None
        assert np.array_equal(first.record.covariance, second.record.covariance)
        # The same directions, whatever basis they are given in.
        bases = [np.linalg.qr(record.null_space)[0] for record in (first.record, second.record)]
        projections = [basis @ basis.T for basis in bases]
        assert np.abs(projections[0] - projections[1]).max() < 1e-12

    def test_the_whole_is_the_sum_of_its_parts_to_first_order(self) -> None:
        model, q = Model(machine(), None, all_terms(size=1e-3)), points()
        at = {"temp_bed": 20.01, "d_y": 1.0}
        whole = model.error_mm(q, at=at)
        for name in (REFERENCE, "backlash", "angular", "ECX", "EC0Y"):
            less = model.without(name)
            taken = [term.id for term in model.machine_terms if term.id not in {t.id for t in less.terms}]
            contributions = model.contributions(q, at=at)
            rest = whole - sum(contributions[name] for name in taken)
            # 10 µm of backlash times a microradian is far below; so is a microradian times 5 µrad over 400 mm.
            assert np.abs(less.error_mm(q, at=at) - rest).max() < 1e-7

    def test_a_record_is_dropped_with_a_term_that_is_yet_to_be_fitted(self) -> None:
        model = fitted().without(REFERENCE)
        unfitted = expansion(alpha=float("nan"), q_fixed=float("nan"))
        assert model.record is not None
        assert (model + unfitted).record is None
        assert not (model + unfitted).has_values

    def test_an_independent_term_adds_its_own_variance(self) -> None:
        base = Model(machine(), None, classic_terms(), drawn_record(classic_terms()))
        term, q, at = expansion(std=1e-7), points(), {"temp_bed": 60.0}
        more = (base + term).prediction_covariance_mm2(q, at=at) - base.prediction_covariance_mm2(q)
        expected = (1e-7 * 40.0 * (q[:, 0] - 120.0)) ** 2 + (1.17e-5 * 40.0 * 2.0) ** 2
        assert more[:, 0, 0] == pytest.approx(expected, rel=1e-6)
        assert np.abs(more[:, 1:, 1:]).max() < 1e-15

    def test_effects_of_the_catalogue_by_name(self) -> None:
        model = Model(machine(), None, classic_terms()) + "thermal-expansion:x@temp_bed" + "backlash:y"
        assert [term.id for term in model.terms[-2:]] == ["thermal-expansion:x@temp_bed", "backlash:y"]
        assert set(model.conditions) == {"temp_bed", "d_y"}
        steel = model.parameter("thermal-expansion:x@temp_bed.alpha").plausible
        assert any(item.what == "steel" for item in steel)
        with pytest.raises(GeoerrError, match="no-such-effect"):
            model + "no-such-effect:x"
        with pytest.raises(ShapeError, match="two terms backlash:y"):
            model + "backlash:y"
        with pytest.raises(TypeError):
            model + 3  # type: ignore[operator]

    def test_effects_in_their_places(self) -> None:
        base, known = Model(machine(), None, classic_terms()), catalogue()
        placed = base + known["thermal-expansion"].at("x", "temp_bed") + known["backlash"].at("y")
        assert placed.terms == (base + "thermal-expansion:x@temp_bed" + "backlash:y").terms
        lagged = base + known["thermal-drift"].at("z", "temp_bed", lagged=True)
        assert [parameter.name for parameter in lagged.terms[-1].inner] == ["tau"]
        # One place to act in needs no word; several are named.
        alone = base + known["rig-scale"]
        assert alone.terms[-1].id == "rig-scale"
        with pytest.raises(InputFileError, match=r"backlash: needs an axis\nhint: write backlash:AXIS .* x, y, z"):
            base + known["backlash"]
        with pytest.raises(InputFileError, match="needs a temperature column"):
            base + dataclasses.replace(known["thermal-expansion"], axes=("x",))
        # Smooth functions are a term for each of their channels.
        smooth = Model(machine()) + known["straightness"].at("x")
        assert [term.id for term in smooth.terms] == ["EYX", "EZX"]
        assert (Model(machine()) + "straightness:x").terms == smooth.terms

    def test_terms_on_tables(self) -> None:
        errors = drawn_errors(machine())
        model = Model(machine(), errors) + expansion()
        assert model.errors is errors
        assert model.without(REFERENCE).terms == ()
        less = model.without(["ECX", REFERENCE])
        assert less.errors is not None
        assert "ECX" not in less.errors.functions
        assert np.array_equal(less.error_mm(points()), Model(machine(), errors).without("ECX").error_mm(points()))


class TestWithout:
    def test_everything(self) -> None:
        model = fitted()
        ids = [term.id for term in model.terms if term.kind != "classic"]
        nothing = model.without([*ALL_NAMES, *ids])
        assert nothing.terms == ()
        assert nothing.is_nominal
        assert nothing.record is not None
        assert nothing.record.n_parameters == 0

    def test_groups_take_classic_errors_only(self) -> None:
        model = fitted()
        less = model.without("positioning")
        assert {term.id for term in model.terms} - {term.id for term in less.terms} == set(GROUPS["positioning"])
        assert REFERENCE in {term.id for term in less.terms}

    def test_an_effect_takes_all_its_terms(self) -> None:
        other = dataclasses.replace(expansion(), id="thermal-expansion:y@temp_bed", axis="y")
        model = Model(machine(), None, (expansion(), other, backlash()))
        assert [term.id for term in model.without("thermal-expansion").terms] == ["backlash:y"]
        assert [term.id for term in model.without(REFERENCE).terms] == [other.id, "backlash:y"]

    def test_squareness_by_either_name(self) -> None:
        model = Model(machine(), None, (squareness("S_xy", 1e-4), squareness("S_xz", 2e-4)))
        for name in ("EC0Y", "S_xy"):
            assert [term.id for term in model.without(name).terms] == ["S_xz"]

    def test_straightness_that_follows_from_an_angle_is_a_part_of_its_term(self) -> None:
        yaw = spline("ECX", np.random.default_rng(1).normal(size=6) * 1e-4)
        basis = yaw.parts[0].basis
        assert basis is not None
        follows = Part("EYX", basis=dataclasses.replace(basis, is_tangent_integral=True))
        yaw = dataclasses.replace(yaw, parts=(*yaw.parts, follows))
        record = FitRecord(np.eye(6), np.zeros((6, 0)))
        model, q = Model(machine(), None, (yaw,), record), points()
        stiff = model.without("straightness")
        assert [part.channel for part in stiff.terms[0].parts] == ["ECX"]
        assert not stiff.error_mm(q, [0.0, 0.0, 0.0])[:, 2].any()
        straight = model.without("ECX")
        assert [part.channel for part in straight.terms[0].parts] == ["EYX"]
        total = stiff.contributions(q)["ECX"] + straight.contributions(q)["ECX"]
        assert np.abs(total - model.contributions(q)["ECX"]).max() < 1e-15
        assert stiff.record is not None
        assert stiff.record.n_parameters == 6

    @pytest.mark.parametrize("name", ["EDX", "thermal-expansion:y@temp_bed", ""])
    def test_unknown(self, name: str) -> None:
        with pytest.raises(GeoerrError, match=r"neither one of the 21.*nor a term\n.*thermal-expansion:x@temp_bed"):
            fitted().without(name)

    def test_a_model_of_tables_is_as_before(self) -> None:
        of = machine()
        model = Model(of, drawn_errors(of))
        assert np.array_equal(
            model.without("roll").error_mm(points()), model.without(["EAX", "EBY", "ECZ"]).error_mm(points())
        )
        with pytest.raises(GeoerrError, match="nor a group of them\n"):
            model.without(REFERENCE)


class TestParameters:
    def test_by_name(self) -> None:
        model = fitted()
        alpha = model.parameter(f"{REFERENCE}.alpha")
        assert (alpha.value, alpha.unit, alpha.plausible[0].what) == (1.17e-5, "1/K", "steel")
        assert model.parameter("rig-scale.k").value == 1e-4
        assert model.parameter("S_xy.S").unit == "rad"
        assert Model(machine(), drawn_errors(machine())).parameter("EXX.c1").unit == "mm"

    @pytest.mark.parametrize(
        ("name", "problem"),
        [
            (f"{REFERENCE}.beta", rf"names no parameter of {REFERENCE}\n.*alpha, .*q_fixed"),
            ("EXX", "names no parameter of EXX"),
            ("drift.k", r"has no term 'drift'\n.*EXX.*backlash:y"),
            ("", "has no term ''"),
        ],
    )
    def test_refusals(self, name: str, problem: str) -> None:
        with pytest.raises(GeoerrError, match=problem):
            fitted().parameter(name)

    def test_names_are_in_the_records_order(self) -> None:
        model = fitted()
        assert model.record is not None
        names = model.parameter_names
        assert len(names) == model.record.n_parameters == len(set(names))
        assert names[0] == "rig-scale.k"
        assert names[-1] == f"{REFERENCE}.q_fixed"

    def test_correlations(self) -> None:
        terms = (rig_scale(), spline("EXX", np.zeros(6)), expansion(), backlash())
        covariance = np.eye(10)
        # k, c0 ... c5, alpha, b, q_fixed
        for i, j, value in ((0, 7, 0.95), (1, 2, 0.99), (3, 8, -0.85), (7, 9, 0.15), (4, 9, 0.81)):
            covariance[i, j] = covariance[j, i] = value
        covariance *= np.multiply.outer(*[np.arange(1.0, 11.0)] * 2)
        model = Model(machine(), None, terms, FitRecord(covariance, np.zeros((10, 0))))
        found = [(item.first, item.second, round(item.value, 12)) for item in model.correlations()]
        # Neighbours on one curve are not among them.
        assert found == [
            ("rig-scale.k", f"{REFERENCE}.alpha", 0.95),
            ("EXX.c2", "backlash:y.b", -0.85),
            ("EXX.c3", f"{REFERENCE}.q_fixed", 0.81),
        ]
        assert len(model.correlations(0.1)) == 4
        assert model.correlations(0.96) == ()
        # What is not determined has no correlation.
        free = FitRecord(covariance, np.eye(10)[:, [7]])
        assert [item.first for item in Model(machine(), None, terms, free).correlations()] == ["EXX.c2", "EXX.c3"]
