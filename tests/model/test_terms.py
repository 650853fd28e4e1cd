"""Predictions of models with terms: against tables, against formulas by hand, with conditions."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from fitted_models import (
    all_terms,
    backlash,
    classic_terms,
    expansion,
    fitted,
    rig_scale,
    spline,
    values_of,
)
from model_machines import CHAINS, drawn_errors, machine

from geoerr.errors import ExpressionError, GeoerrError, GeometryError, NotDeterminedError, ShapeError
from geoerr.machine import AXES
from geoerr.model import Model, compile_terms
from geoerr.model.tables import terms_of_errors
from geoerr.terms import HISTORY_NAMES, RAW_VARIABLES, BasisSpec, Parameter, Part, Term, is_motion

OFFSET = (3.0, -20.0, 55.0)
AT = {"temp_bed": 60.0, "d_y": 1.0}


def points(n: int = 30, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 400.0, (n, 3))


class TestPrediction:
    @pytest.mark.parametrize("chain", CHAINS)
    def test_tables_and_the_same_tables_as_terms_agree(self, chain: str) -> None:
        of = machine(chain, OFFSET)
        errors = drawn_errors(of)
        tables, terms = Model(of, errors), Model(of, None, terms_of_errors(errors))
        q, offset = points(), points(seed=2) - 200.0
        # Two sums of the same numbers in another order: rounding of positions of some 700 mm.
        for view in ("error_mm", "tool_from_work", "tool_from_base", "work_from_base"):
            difference = getattr(tables, view)(q, offset) - getattr(terms, view)(q, offset)
            assert np.abs(difference).max() < 1e-12, view
        assert terms.measured_range_mm == tables.measured_range_mm
        assert terms.knots_mm("x").tolist() == tables.knots_mm("x").tolist()

    def test_terms_add_to_tables(self) -> None:
        of = machine()
        errors, q = drawn_errors(of), points()
        both = Model(of, errors, (expansion(),))
        joined = Model(of, None, (*terms_of_errors(errors), expansion()))
        at = {"temp_bed": 75.0}
        assert np.array_equal(both.error_mm(q, at=at), joined.error_mm(q, at=at))
        assert not np.allclose(both.error_mm(q, at=at), Model(of, errors).error_mm(q), atol=1e-3)
        at_reference = both.error_mm(q, at={"temp_bed": "reference"})
        assert np.abs(at_reference - Model(of, errors).error_mm(q)).max() < 1e-12

    def test_an_effect_by_hand(self) -> None:
        model, q = Model(machine(), None, (expansion(), backlash())), points()
        temperature = np.linspace(10.0, 90.0, len(q))
        direction = np.where(np.arange(len(q)) % 2, 1.0, -1.0)
        error = model.error_mm(q, at={"temp_bed": temperature, "d_y": direction})
        assert error[:, 0] == pytest.approx(1.17e-5 * (temperature - 20.0) * (q[:, 0] - 120.0), abs=1e-15)
        assert error[:, 1] == pytest.approx(-0.01 * direction, abs=1e-15)
        assert not error[:, 2].any()

    def test_an_unknown_condition_is_an_unknown_error_of_that_row_only(self) -> None:
        model, q = Model(machine(), None, (expansion(),)), points(3)
        error = model.error_mm(q, at={"temp_bed": [30.0, np.nan, 50.0]})
        assert np.isnan(error[1, 0])
        assert np.isfinite(error[[0, 2]]).all()

    def test_rig_terms_explain_measurements_and_are_never_predicted(self) -> None:
        q = points()
        with_rig = Model(machine(), None, (rig_scale(), *classic_terms()))
        assert np.array_equal(with_rig.error_mm(q), Model(machine(), None, classic_terms()).error_mm(q))
        assert [term.id for term in with_rig.rig_terms] == ["rig-scale"]
        assert len(with_rig.machine_terms) == 21
        assert "temp_room" not in with_rig.conditions
        assert "rig-scale" not in with_rig.contributions(q)
        assert Model(machine(), None, (rig_scale(),)).is_nominal

    def test_same_bytes_from_any_number_of_threads(self) -> None:
        model, q = fitted(), points(3001)
        one = model.error_mm(q, at=AT, threads=1).tobytes()
        assert all(model.error_mm(q, at=AT, threads=threads).tobytes() == one for threads in (0, 2, 5))
        one = model.prediction_covariance_mm2(q[:600], at=AT, threads=1).tobytes()
        assert model.prediction_covariance_mm2(q[:600], at=AT, threads=2).tobytes() == one

    def test_a_lag_alone_is_in_its_steady_state(self) -> None:
        part = Part("tool-z", expression="k*lag(temp_head - 20, tau)")
        inner = (Parameter("tau", "s", 300.0, low=10.0, high=1e4, spacing="log"),)
        term = Term("drift", "Drift", "empirical", None, None, None, (part,), (Parameter("k", "mm/K", 1e-3),), inner)
        model = Model(machine(), None, (term,))
        error = model.error_mm(points(5), at={"temp_head": [20.0, 30.0, 120.0, 30.0, 20.0]})
        assert error[:, 2] == pytest.approx([0.0, 0.01, 0.1, 0.01, 0.0], abs=1e-12)
        assert compile_terms(machine(), (term,)).needs_order
        assert not compile_terms(machine(), all_terms()).needs_order

    def test_the_place_on_the_bed_and_what_stands_over_it(self) -> None:
        part = Part("work-z", expression="k*(bed_x^2 + bed_y^2)")
        term = Term("bow", "Bow", "empirical", None, None, None, (part,), (Parameter("k", "1/mm", 1e-6),))
        model, q = Model(machine("wZbXYt"), None, (term,)), np.array([[100.0, 50.0, 30.0]])
        # The work moves up under the tool: seen from the work the tool is lower.
        assert model.error_mm(q, [10.0, 0.0, 0.0])[0, 2] == pytest.approx(-1e-6 * (110.0**2 + 50.0**2))
        on_work = model.displacement_mm(q, [10.0, 0.0, 0.0], carrier="work")
        assert on_work[0, 2] == pytest.approx(1e-6 * 10.0**2)

    def test_pickle(self) -> None:
        model, q = fitted(n_null=2), points()
        again = pickle.loads(pickle.dumps(model))
        assert np.array_equal(again.error_mm(q, at=AT), model.error_mm(q, at=AT))
        covariances = [one.prediction_covariance_mm2(q, at=AT) for one in (model, again)]
        assert np.array_equal(*covariances, equal_nan=True)

    def test_names_that_collide_between_terms_do_not(self) -> None:
        """A column of one term may have the name of another's parameter or definition."""
        column = Part("tool-x", expression="k*alpha*T")
        other = Term("odd", "Odd", "empirical", None, None, None, (column,), (Parameter("k", "mm", 1.0),))
        model, q = Model(machine(), None, (expansion(), other)), points()
        error = model.error_mm(q, at={"alpha": 3.0, "T": 7.0, "temp_bed": 30.0})
        assert error[:, 0] == pytest.approx(1.17e-4 * (q[:, 0] - 120.0) + 21.0, abs=1e-12)


class TestConditions:
    def test_missing_conditions_are_named_with_what_reference_means(self) -> None:
        with pytest.raises(GeoerrError, match=r"temp_bed.*reference 20 °C.*d_y.*direction.*\n.*T = 0"):
            fitted().error_mm(points())
        assert fitted().conditions == ("temp_bed", "d_y")

    @pytest.mark.parametrize(
        ("at", "problem"),
        [
            ({"temp_bed": 30.0}, "d_y"),
            ({"temp_bed": "hot", "d_y": 1}, "temp_bed is 'hot', a number is needed"),
            ({"temp_bed": 30.0, "d_y": "reference"}, "d_y is 'reference'.*\n.*only temperatures"),
            ({"temp_bed": [30.0, 31.0], "d_y": 1}, r"temp_bed must be one number or \(30,\), not \(2,\)"),
            ({"temp_bed": object(), "d_y": 1}, "temp_bed is not an array of numbers"),
        ],
    )
    def test_refusals(self, at: dict[str, object], problem: str) -> None:
        with pytest.raises(GeoerrError, match=problem):
            fitted().error_mm(points(), at=at)

    def test_the_reference_is_the_machines_own(self) -> None:
        q = points()
        model = fitted()
        assert np.array_equal(
            model.error_mm(q, at={"temp_bed": "reference", "d_y": 1.0}),
            model.error_mm(q, at={"temp_bed": 20.0, "d_y": 1.0}),
        )

    def test_a_model_without_conditions_needs_none(self) -> None:
        model = Model(machine(), None, classic_terms())
        assert model.conditions == ()
        assert np.array_equal(model.error_mm(points()), model.error_mm(points(), at={"temp_bed": 1.0}))


class TestContributions:
    def test_their_sum_is_the_first_order_prediction(self) -> None:
        model, q, offset = fitted(), points(), (10.0, 20.0, 30.0)
        contributions = model.contributions(q, offset, at=AT)
        assert list(contributions) == [term.id for term in model.machine_terms]
        # Another way: the fit's columns times the coefficients (effects here are linear in them).
        (columns,) = model._columns(q, offset, "relative", AT, 1)
        theta = values_of(model.machine_terms)
        theta[-1] = 0.0  # The inner parameter is in the column of alpha already.
        total = sum(contributions.values())
        assert np.abs(total - columns @ theta).max() < 1e-12
        assert contributions["backlash:y"][:, 1] == pytest.approx(-0.01)

    def test_what_they_leave_is_of_second_order(self) -> None:
        q, left = points(), []
        for size in (1.0, 0.1):
            model = Model(machine("wXbYZt", OFFSET), None, classic_terms(size=size))
            left.append(np.abs(model.error_mm(q) - sum(model.contributions(q).values())).max())
        # A hundredth, and a thousandth part of third order.
        assert left[1] == pytest.approx(left[0] / 100.0, rel=0.05)

    @pytest.mark.parametrize("carrier", ["tool", "work", "relative"])
    def test_on_every_carrier(self, carrier: str) -> None:
        model = Model(machine("wXbYZt", OFFSET), None, (*classic_terms(size=1e-3), expansion()))
        q, at = points(), {"temp_bed": 20.1}
        total = sum(model.contributions(q, carrier=carrier, at=at).values())
        # 5 µrad times 1 µrad over 400 mm is far below a nanometre.
        assert np.abs(model.displacement_mm(q, carrier=carrier, at=at) - total).max() < 1e-7


class TestRefusals:
    def test_two_terms_of_one_name(self) -> None:
        with pytest.raises(ShapeError, match=r"two terms thermal-expansion:x@temp_bed\n"):
            Model(machine(), None, (expansion(), expansion()))

    def test_a_formula_is_refused_with_its_term_and_place(self) -> None:
        part = Part("EXX", expression="alpha*(x - ")
        term = Term("odd", "Odd", "empirical", None, None, None, (part,), (Parameter("alpha", "1"),))
        with pytest.raises(ExpressionError, match=r"term odd, on EXX: .*\n.*alpha") as caught:
            Model(machine(), None, (term,))
        assert caught.value.text == "alpha*(x - "

    def test_a_basis_is_refused_with_its_term(self) -> None:
        basis = BasisSpec("bspline", "x", knots_mm=(0.0, 100.0), degree=30)
        coefficients = tuple(Parameter(f"c{place}", "mm") for place in range(31))
        term = Term("EXX", "x", "classic", None, "x", None, (Part("EXX", basis=basis),), coefficients)
        with pytest.raises((GeometryError, ShapeError), match="term EXX, on EXX: "):
            Model(machine(), None, (term,))

    def test_what_has_no_value_yet_cannot_be_predicted(self) -> None:
        term = spline("EXX", np.full(6, np.nan))
        model = Model(machine(), None, (term,))
        assert not model.has_values
        for call in (model.error_mm, model.contributions):
            with pytest.raises(GeoerrError, match=r"EXX\.c0, EXX\.c1, EXX\.c2 and 3 more: no value yet"):
                call(points())

    def test_without_a_record_there_is_no_uncertainty(self) -> None:
        model = Model(machine(), None, classic_terms())
        for call in (model.prediction_covariance_mm2, model.is_determined_at):
            with pytest.raises(NotDeterminedError, match="not fitted here"):
                call(points())
        with pytest.raises(NotDeterminedError):
            model.correlations()

    def test_an_unknown_carrier(self) -> None:
        with pytest.raises(GeoerrError, match="'bed' carries no target"):
            fitted().displacement_mm(points(), carrier="bed", at=AT)


def test_a_row_of_a_picture_and_a_column_of_the_user_are_no_motion() -> None:
    motion = [name for name in RAW_VARIABLES if is_motion(name, *HISTORY_NAMES)]
    assert sorted(motion) == sorted(f"{kind}_{axis}" for kind in HISTORY_NAMES for axis in AXES)
    assert is_motion("v_x", "v")
    assert not is_motion("v_x", "a", "mean_v")
    for name in ("v_left", "v_right", "a_room", "d_sensor", "s", "v_xy", "t_rev", "temp_x"):
        assert not is_motion(name, *HISTORY_NAMES)
