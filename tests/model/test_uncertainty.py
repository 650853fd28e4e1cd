"""Uncertainty of predictions and tables: against Monte-Carlo, and what is not determined."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fitted_models import all_terms, classic_terms, drawn_record, expansion, fitted, spline, values_of
from fitted_models import squareness as squareness_term
from model_machines import CHAINS, machine

from geoerr.error_functions import ALL_NAMES, LI_SQUARENESS, NotDetermined, is_angular, read_errors, write_errors
from geoerr.errors import ShapeError
from geoerr.model import FitRecord, Model
from geoerr.model.document import document_of, model_from_document
from geoerr.model.gauge import least_squares_slope
from geoerr.report.error_tables import error_function_table
from geoerr.terms import Term
from geoerr.verify.ballbar import li_eq23_trace
from geoerr.verify.circle import CircleOfCommands

AT = {"temp_bed": 60.0, "d_y": 1.0}
N_DRAWS = 4000
# A variance estimated from n draws is itself uncertain by √(2/n), 2.2 %; of the some hundred numbers compared the
# largest deviation of an honest one stays within five of these.
FIVE_SIGMA = 5.0 * np.sqrt(2.0 / N_DRAWS)


def points(n: int = 6, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 400.0, (n, 3))


def with_values(terms: tuple[Term, ...], values: np.ndarray) -> tuple[Term, ...]:
    result, place = [], 0
    first_inner = sum(len(term.coefficients) for term in terms)
    for term in terms:
        end, end_inner = place + len(term.coefficients), first_inner + len(term.inner)
        result.append(term.with_values(values[place:end].tolist(), values[first_inner:end_inner].tolist()))
        place, first_inner = end, end_inner
    return tuple(result)


class TestPredictionCovariance:
    @pytest.mark.parametrize("carrier", ["relative", "tool", "work"])
    def test_against_monte_carlo_through_the_exact_chain(self, carrier: str) -> None:
        model, q = fitted(chain="wXbYZt"), points()
        assert model.record is not None
        covariance = model.prediction_covariance_mm2(q, (0.0, 0.0, 20.0), carrier=carrier, at=AT)
        generator = np.random.default_rng(7)
        draws = generator.multivariate_normal(values_of(model.terms), model.record.covariance, N_DRAWS, method="eigh")
        # The machine's share of each draw, in the core's order: the first coefficient is the rig's.
        n = sum(len(term.coefficients) for term in model.terms)
        rows = next(model._rows(q, (0.0, 0.0, 20.0), carrier, AT, len(q)))
        seen = np.array([model._seen.core.displacements(*rows, d[1:n].copy(), d[n:].copy(), 1) for d in draws])
        for row in range(len(q)):
            # One body of the machine may not move at all along some direction: compared without units.
            sample = np.cov(seen[:, row].T)
            root = np.linalg.cholesky(covariance[row])
            whitened = np.linalg.solve(root, np.linalg.solve(root, sample).T)
            assert np.abs(whitened - np.eye(3)).max() < FIVE_SIGMA

    def test_the_rig_has_no_share(self) -> None:
        model, q = fitted(), points()
        assert model.record is not None
        sure = model.record.covariance.copy()
        sure[0] = sure[:, 0] = 0.0
        other = dataclasses.replace(model, record=dataclasses.replace(model.record, covariance=sure))
        assert model.rig_terms
        assert np.array_equal(model.prediction_covariance_mm2(q, at=AT), other.prediction_covariance_mm2(q, at=AT))

    def test_rows_do_not_depend_on_their_block(self) -> None:
        model, q = fitted(), points(2500)
        temperature = np.linspace(20.0, 90.0, len(q))
        at = {"temp_bed": temperature, "d_y": 1.0}
        whole, some = model.prediction_covariance_mm2(q, at=at), slice(1000, 1100)
        part = model.prediction_covariance_mm2(q[some], at={"temp_bed": temperature[some], "d_y": 1.0})
        # The same sums, in an order that the linear algebra chooses by the shape.
        assert whole[some] == pytest.approx(part, rel=1e-12)
        assert model.is_determined_at(q, at=at).shape == (2500, 3)
        assert model.prediction_covariance_mm2(q[:0], at={"temp_bed": 20.0, "d_y": 1.0}).shape == (0, 3, 3)

    @pytest.mark.parametrize("bad", [np.nan, np.inf])
    @pytest.mark.parametrize("what", ["position", "offset", "condition"])
    def test_a_row_that_is_not_finite_is_nan_and_disturbs_no_other(self, bad: float, what: str) -> None:
        model, q, offset, temperature = fitted(), points(), np.zeros((6, 3)), np.full(6, 60.0)
        covariance = model.prediction_covariance_mm2(q, offset, at=AT)
        {"position": q[:, 0], "offset": offset[:, 1], "condition": temperature}[what][2] = bad
        at = {"temp_bed": temperature, "d_y": 1.0}
        others = np.arange(6) != 2
        found = model.prediction_covariance_mm2(q, offset, at=at)
        assert np.isnan(found[2]).all()
        assert found[others] == pytest.approx(covariance[others], rel=1e-12)
        is_determined = model.is_determined_at(q, offset, at=at)
        assert not is_determined[2].any()
        assert is_determined[others].all()
        assert not model.is_determined_at(q[2:3], offset[2:3], at={"temp_bed": temperature[2:3], "d_y": 1.0}).any()

    def test_a_row_that_overflows_disturbs_no_other(self) -> None:
        q = points()
        q[2, 0] = 1e200
        with np.errstate(over="ignore", invalid="ignore"):
            covariance = fitted().prediction_covariance_mm2(q, at=AT)
        assert np.isfinite(covariance).all(axis=(1, 2)).tolist() == [True, True, False, True, True, True]

    def test_rounding_below_0_is_0(self) -> None:
        """The sum of two terms that are −1 correlated, but for one part in 10¹⁶."""
        first, second = spline("EXX", np.zeros(6)), dataclasses.replace(spline("EXX", np.zeros(6)), id="again:x")
        root = np.random.default_rng(3).normal(size=(6, 6)) * 1e-3
        both = np.vstack([root, -root])
        model = Model(machine(), None, (first, second), FitRecord(both @ both.T, np.zeros((12, 0))))
        covariance = model.prediction_covariance_mm2(points(200))
        assert np.array_equal(covariance, covariance.transpose(0, 2, 1))
        assert np.diagonal(covariance, axis1=1, axis2=2).min() >= 0.0
        assert np.linalg.eigvalsh(covariance).min() >= -1e-30
        assert covariance.max() < 1e-20

    def test_symmetric_and_positive(self) -> None:
        covariance = fitted().prediction_covariance_mm2(points(50), at=AT)
        assert np.abs(covariance - covariance.transpose(0, 2, 1)).max() < 1e-15
        assert np.linalg.eigvalsh(covariance).min() > 0.0


class TestDetermined:
    def model(self, *directions: dict[str, float]) -> Model:
        terms = (spline("EXX", np.zeros(6)), spline("EXY", np.zeros(6)), spline("ECX", np.zeros(6)))
        names = Model(machine(), None, terms).parameter_names
        null_space = np.zeros((len(names), len(directions)))
        for column, direction in enumerate(directions):
            for name, value in direction.items():
                null_space[names.index(name), column] = value
        null_space /= np.linalg.norm(null_space, axis=0)
        record = FitRecord(np.eye(len(names)) * 1e-6, null_space)
        return Model(machine(), None, terms, record)

    def test_where_the_free_function_lives(self) -> None:
        # The last of six cubic B-splines on three spans of 133 mm is 0 below the last span.
        model = self.model({"EXX.c5": 1.0})
        q = np.array([[x, 200.0, 100.0] for x in (0.0, 100.0, 266.0, 267.0, 300.0, 400.0)])
        assert model.is_determined_at(q)[:, 0].tolist() == [True, True, True, False, False, False]

    def test_an_unknown_temperature_determines_nothing_elsewhere(self) -> None:
        """Rigid motions are told at the ends of each condition, and no number is above NaN: all was a set-up."""
        terms = (spline("EXX", np.zeros(6)), expansion())
        null_space = np.zeros((8, 1))
        null_space[5] = 1.0
        model = Model(machine(), None, terms, FitRecord(np.eye(8) * 1e-6, null_space))
        q = np.array([[x, 200.0, 100.0] for x in (50.0, 100.0, 300.0)])
        assert model.is_determined_at(q, at={"temp_bed": 60.0})[:, 0].tolist() == [True, True, False]
        at = {"temp_bed": [np.nan, 20.0, 60.0]}
        assert model.is_determined_at(q, at=at)[:, 0].tolist() == [False, True, False]

    def test_what_is_not_determined_has_no_covariance_and_disturbs_no_other_component(self) -> None:
        free, bound = self.model({"EXX.c5": 1.0}), self.model()
        q = np.array([[100.0, 200.0, 100.0], [300.0, 200.0, 100.0]])
        beside = (30.0, 0.0, 0.0)
        assert free.is_determined_at(q, beside).tolist() == [[True, True, True], [False, True, True]]
        covariance, known = (one.prediction_covariance_mm2(q, beside) for one in (free, bound))
        assert np.array_equal(covariance[0], known[0])
        assert np.isnan(covariance[1, 0]).all()
        assert np.isnan(covariance[1, :, 0]).all()
        assert np.array_equal(covariance[1, 1:, 1:], known[1, 1:, 1:])
        assert known[1, 1, 1] > 0.0

    def test_directions_that_cancel_in_the_error_are_no_loss(self) -> None:
        constant = {f"EXX.c{place}": 1.0 for place in range(6)} | {f"EXY.c{place}": -1.0 for place in range(6)}
        model = self.model(constant)
        assert model.is_determined_at(points(40)).all()
        # Seen from the floor likewise: both ride on the tool's side.
        assert model.is_determined_at(points(40), carrier="tool").all()

    def test_rounding_in_a_direction_is_no_part_in_it(self) -> None:
        rounded = {f"EXX.c{place}": 1e-15 for place in range(6)} | {"ECX.c0": 1.0}
        model = self.model(rounded)
        assert "EXX" in model.error_functions().functions
        assert model.is_determined_at([[50.0, 0.0, 0.0]]).all()

    def test_an_angle_is_not_needed_where_it_has_no_arm(self) -> None:
        model = self.model({f"ECX.c{place}": 1.0 for place in range(6)})
        q = np.array([[100.0, 0.0, 50.0], [100.0, 80.0, 50.0]])
        # wZbXYt: ε_zx turns what rides on X, and Y is its arm.
        assert model.is_determined_at(q).all(axis=1).tolist() == [True, False]
        assert model.is_determined_at(q, [0.0, 30.0, 0.0]).all(axis=1).tolist() == [False, False]
        # The turn about z moves nothing along z.
        assert model.is_determined_at(q, [0.0, 30.0, 0.0])[:, 2].all()

    def test_an_axis_that_stood_is_unknown_elsewhere(self) -> None:
        plane = self.on_a_plane("EXZ", "EYZ", "EZZ", "EAZ", "EBZ", "ECZ")
        q = np.array([[0.0, 0.0, 100.0], [300.0, 200.0, 100.0], [0.0, 0.0, 300.0], [300.0, 200.0, 0.0]])
        assert plane.is_determined_at(q).all(axis=1).tolist() == [True, True, False, False]
        covariance = plane.prediction_covariance_mm2(q)
        assert np.isfinite(covariance[:2]).all()
        assert np.isnan(covariance[2:]).all()

    def test_absent_functions_leave_open_what_they_move(self) -> None:
        q = [[300.0, 200.0, 300.0]]
        assert self.on_a_plane("EXZ").is_determined_at(q).tolist() == [[False, True, True]]
        # A turn about z without an arm along z moves no z, and one about x no x.
        assert self.on_a_plane("EAZ").is_determined_at(q, [0.0, 30.0, -80.0]).tolist() == [[True, False, False]]
        assert self.on_a_plane().is_determined_at(q).all()

    def test_a_squareness_with_an_axis_that_stood_shifts_the_plane(self) -> None:
        """It is the set-up where the axis stood; on the way from there it is open."""
        plane = self.on_a_plane("EZZ", free="S_xz.S")
        q = [[300.0, 200.0, 100.0], [300.0, 200.0, 300.0]]
        assert plane.is_determined_at(q).tolist() == [[True, True, True], [False, True, False]]

    def on_a_plane(self, *absent: str, free: str | None = None) -> Model:
        """Measured at z = 100 mm, without these functions of z."""
        terms = (spline("EXX", np.zeros(6)), spline("EYY", np.zeros(6)), squareness_term("S_xz", 0.0))
        of = machine("wbXYZt")
        names = Model(of, None, terms).parameter_names
        null_space = np.array([[float(name == free)] for name in names])
        record = FitRecord(
            np.eye(len(names)) * 1e-6,
            null_space[:, null_space.any(axis=0)],
            tuple(NotDetermined(name, "the z axis never moved") for name in absent),
            range_mm={"x": (0.0, 400.0), "y": (0.0, 400.0)},
            stood_mm={"z": 100.0},
        )
        return model_from_document(document_of(Model(of, None, terms, record)), "model.json")

    def test_nothing_free_is_all_determined(self) -> None:
        assert fitted().is_determined_at(points(), at=AT).all()


def rigid_part(q: np.ndarray, change: np.ndarray) -> np.ndarray:
    """What of a change of E(q) no rigid set-up of the work explains (first order), least squares."""
    x, y, z = q.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    columns = [
        *(np.stack([one * (axis == k) for k in range(3)]) for axis in range(3)),
        np.stack([zero, -z, y]),
        np.stack([z, zero, -x]),
        np.stack([-y, x, zero]),
    ]
    design = np.array([column.T.ravel() for column in columns]).T
    solution, *_ = np.linalg.lstsq(design, change.ravel(), rcond=None)
    return (change.ravel() - design @ solution).reshape(-1, 3)


def polygons(chain: str, size: float, seed: int = 3) -> Model:
    """Terms whose functions are the polygons of the tables that they become, in no gauge."""
    of = machine(chain, (3.0, -20.0, 55.0))
    terms = classic_terms(seed, size)
    linear = []
    for term in terms:
        basis = term.parts[0].basis
        if basis is None:
            linear.append(term)
            continue
        nodes = dataclasses.replace(basis, kind="linear", degree=None, knots_mm=tuple(np.linspace(0.0, 400.0, 6)))
        linear.append(dataclasses.replace(term, parts=(dataclasses.replace(term.parts[0], basis=nodes),)))
    return Model(of, None, tuple(linear))


class TestTables:
    @pytest.mark.parametrize("chain", CHAINS)
    def test_the_gauge_moves_the_set_up_only(self, chain: str) -> None:
        q, left = points(60), []
        for size in (1e-2, 1e-3):
            model = polygons(chain, size)
            tables = Model(model.machine, model.error_functions(6))
            left.append(np.abs(rigid_part(q, tables.error_mm(q) - model.error_mm(q))).max())
            # Something was moved.
            assert np.abs(tables.error_mm(q) - model.error_mm(q)).max() > 1e-4 * size / 1e-2
        # What is left is of second order: products of 50 µrad with 10 µrad over 800 mm and more, a hundredth for a
        # tenth of the size.
        assert left[0] < 5e-6
        assert left[1] < 0.02 * left[0]

    def test_tables_are_in_the_gauge(self) -> None:
        errors = fitted().error_functions(17)
        assert set(errors.functions) | set(errors.squareness) == set(ALL_NAMES)
        for name, function in errors.functions.items():
            assert function.value[0] == 0.0
            assert len(function.position_mm) == 17
            if not is_angular(name) and name[1] != name[2]:
                slope = least_squares_slope(function.position_mm) @ function.value
                assert abs(slope) * 400.0 < 1e-14
        assert errors.method == "joint"
        assert REFERENCE_NOTE in errors.notes[0]

    def test_the_slope_is_that_of_a_fine_uniform_grid(self) -> None:
        generator = np.random.default_rng(4)
        position = np.sort(generator.uniform(-50.0, 350.0, 9))
        value = generator.normal(size=9)
        fine = np.linspace(position[0], position[-1], 400_001)
        ends_count_half = np.ones(len(fine))
        ends_count_half[[0, -1]] = np.sqrt(0.5)
        slope = np.polyfit(fine, np.interp(fine, position, value), 1, w=ends_count_half)[0]
        # The trapezoids' own error falls with their number squared.
        assert least_squares_slope(position) @ value == pytest.approx(slope, rel=1e-8)

    def test_their_uncertainty_against_monte_carlo(self) -> None:
        terms = (*classic_terms(), expansion())
        record = drawn_record(terms, seed=5)
        model = Model(machine("wYbXZt"), None, terms, record)
        errors = model.error_functions(5)
        draws = np.random.default_rng(8).multivariate_normal(
            values_of(terms), record.covariance, N_DRAWS // 10, method="eigh"
        )
        drawn = [Model(model.machine, None, with_values(terms, draw)).error_functions(5) for draw in draws]
        five_sigma = 5.0 * np.sqrt(2.0 / len(drawn))
        for name, function in errors.functions.items():
            sample = np.std([one.functions[name].value for one in drawn], axis=0, ddof=1)
            assert function.std is not None
            assert function.std[0] == 0.0
            assert sample[1:] / function.std[1:] == pytest.approx(1.0, abs=0.5 * five_sigma)
        for name, squareness in errors.squareness.items():
            sample = np.std([one.squareness[name].value_rad for one in drawn], ddof=1)
            assert sample / squareness.std_rad == pytest.approx(1.0, abs=0.5 * five_sigma)

    def test_written_and_read_as_errors_json(self, tmp_path: object) -> None:
        errors = fitted().error_functions(9)
        path = tmp_path / "errors.json"  # type: ignore[operator]
        write_errors(path, errors)
        again = read_errors(path)
        for name, function in errors.functions.items():
            assert again.functions[name].value == pytest.approx(function.value, rel=1e-14)
            assert again.functions[name].std == pytest.approx(function.std, rel=1e-14)

    def test_what_is_not_determined_is_not_in_tables(self) -> None:
        terms = (spline("EXX", np.zeros(6)), spline("EAX", np.zeros(6)), spline("EYX", np.zeros(6)))
        null_space = np.zeros((18, 1))
        # A constant roll is in no table, for the gauge takes it out; a free function is.
        null_space[6:12] = np.linspace(-1.0, 1.0, 6)[:, None]
        null_space /= np.linalg.norm(null_space)
        record = FitRecord(np.eye(18), null_space)
        errors = Model(machine(), None, terms, record).error_functions()
        assert set(errors.functions) == {"EXX", "EYX"}
        assert errors.not_determined[0] == NotDetermined("EAX", "the data do not determine it")
        # S is moved by straightness' slope and by roll, through whatever hangs on X (wZbXYt: Y).
        assert set(errors.squareness) == {"EC0Y"}
        reason = NotDetermined("EAX", "one target on the carriage")
        named = Model(machine(), None, terms, dataclasses.replace(record, not_determined=(reason,)))
        assert reason in named.error_functions().not_determined

    def test_tables_stay_what_they_were(self) -> None:
        model = polygons("wZbXYt", 1.0)
        errors = model.error_functions(6)
        assert Model(model.machine, errors).error_functions() is errors
        same = Model(model.machine, errors).error_functions(6)
        for name, function in errors.functions.items():
            assert same.functions[name].value == pytest.approx(function.value, abs=1e-15)
        for name, squareness in errors.squareness.items():
            assert same.squareness[name].value_rad == pytest.approx(squareness.value_rad, abs=1e-17)

    def test_who_uses_tables_takes_a_model_of_terms(self) -> None:
        model = Model(machine(), None, classic_terms())
        tables = Model(machine(), model.error_functions())
        circle = CircleOfCommands("XY", (212.0, 170.0, 50.0), 100.0)
        assert np.array_equal(li_eq23_trace(model, circle).points_mm, li_eq23_trace(tables, circle).points_mm)
        assert error_function_table(model.error_functions()).rows[0][0] == "EXX"
        assert Model(machine()).error_functions().functions == {}

    def test_positions_of_ones_own(self) -> None:
        errors = fitted().error_functions({"x": [0.0, 100.0, 400.0]})
        assert errors.functions["EXX"].position_mm.tolist() == [0.0, 100.0, 400.0]
        assert errors.functions["EYY"].position_mm.tolist() == [0.0, 400.0]
        for bad in ({"x": [1.0]}, {"x": [2.0, 1.0]}, {"x": [0.0, np.nan]}, 1):
            with pytest.raises(ShapeError, match=r"positions of x|two entries"):
                fitted().error_functions(bad)
        assert fitted().error_functions(np.int64(5)).functions["EXX"].position_mm.shape == (5,)
        for bad in (5.0, "5", [0.0, 100.0], np.array([0.0, 100.0])):
            with pytest.raises(ShapeError, match=r"^positions is .*\nhint: write how many entries .*'x': \["):
                fitted().error_functions(bad)

    def test_at_conditions_that_stand_still(self) -> None:
        of, term = machine(), expansion()
        record = FitRecord(np.diag([1e-14, 4.0]), np.zeros((2, 0)))
        errors = Model(of, None, (term,), record).error_functions(5, at={"temp_bed": 70.0})
        position = errors.functions["EXX"].position_mm
        assert errors.functions["EXX"].value == pytest.approx(1.17e-5 * 50.0 * position)
        # In the gauge the fixed point is a shift: only the coefficient is uncertain.
        assert errors.functions["EXX"].std == pytest.approx(1e-7 * 50.0 * position)
        assert errors.notes == ("at temp_bed = 70",)
        cold = Model(of, None, (term,), record).error_functions(5, at={"temp_bed": "reference"})
        assert not cold.functions["EXX"].value.any()
        with pytest.raises(ShapeError, match="temp_bed must be one number"):
            Model(of, None, (term,)).error_functions(at={"temp_bed": [20.0, 30.0]})

    def test_squareness_has_iso_signs(self) -> None:
        model = fitted()
        plain = {term.id: term for term in model.terms if term.id.startswith("S_")}
        only = Model(machine(), None, tuple(plain.values()))
        for name, squareness in only.error_functions().squareness.items():
            symbol, sign = LI_SQUARENESS[name]
            assert squareness.value_rad == sign * plain[symbol].coefficients[0].value


class TestMeanScale:
    def test_of_a_straight_line(self) -> None:
        # Coefficients of a cubic B-spline at Greville's points make the line itself.
        knots = np.array([0, 0, 0, 0, 400 / 3, 800 / 3, 400, 400, 400, 400], dtype=float)
        greville = np.array([knots[k + 1 : k + 4].mean() for k in range(6)])
        term = spline("EXX", -34e-6 * greville)
        covariance = np.outer(greville, greville) * 3e-6**2
        record = FitRecord(covariance, np.zeros((6, 0)))
        scale = Model(machine(), None, (term,), record).mean_scales()["x"]
        assert scale.value == pytest.approx(-34e-6, rel=1e-12)
        assert scale.std == pytest.approx(3e-6, rel=1e-9)
        assert Model(machine(), None, (term,)).mean_scales()["x"].std is None

    def test_effects_that_follow_conditions_are_apart(self) -> None:
        assert Model(machine(), None, (expansion(),)).mean_scales() == {}
        assert set(fitted().mean_scales()) == {"x", "y", "z"}


class TestRecord:
    def test_what_a_covariance_cannot_be(self) -> None:
        none = np.zeros((2, 0))
        for covariance, problem in (
            (np.zeros((2, 3)), "not square"),
            ([[1.0, 0.5], [0.4, 1.0]], "not symmetric"),
            ([[1.0, 2.0], [2.0, 1.0]], "not positive semidefinite"),
            ([[-1.0, 0.0], [0.0, 1.0]], "negative variance"),
            ([[0.0, 1e-9], [1e-9, 1.0]], "without its variance"),
            ([[np.nan, 0.0], [0.0, 1.0]], "not finite"),
            ([[1e-320, 1e10], [1e10, 1.0]], "far beyond|not positive"),
        ):
            with pytest.raises(ShapeError, match=problem):
                FitRecord(np.asarray(covariance), none)

    def test_what_rounding_leaves_of_a_fixed_parameter(self) -> None:
        for size in (1e-170, 1e-140, 1e-20, 0.0):
            root = np.array([[1e-3, 2e-4], [size, -0.5 * size], [-3e-6, 1e-6]])
            record = FitRecord(root @ root.T, np.zeros((3, 0)))
            assert record.std == pytest.approx(np.sqrt((root**2).sum(axis=1)), rel=1e-12)

    def test_what_a_null_space_cannot_be(self) -> None:
        for null_space in (np.zeros((3, 0)), np.ones((2, 1)), np.zeros((2, 1)), np.full((2, 1), np.nan)):
            with pytest.raises(ShapeError, match="null_space"):
                FitRecord(np.eye(2), null_space)

    def test_of_other_terms(self) -> None:
        with pytest.raises(ShapeError, match="about 2 parameters, the terms have 6"):
            Model(machine(), None, (spline("EXX", np.zeros(6)),), FitRecord(np.eye(2), np.zeros((2, 0))))
        tables = fitted().error_functions()
        with pytest.raises(ShapeError, match="no tables besides"):
            Model(machine(), tables, (), FitRecord(np.zeros((0, 0)), np.zeros((0, 0))))

    def test_a_part_keeps_its_covariance_and_its_share_of_what_is_free(self) -> None:
        record = drawn_record(all_terms(), n_null=3)
        places = [5, 2, 17]
        part = record.selected(places)
        assert np.array_equal(part.covariance, record.covariance[np.ix_(places, places)])
        # Three directions of many parameters cover these three whole.
        assert part.null_space.shape == (3, 3)
        twice = np.eye(record.n_parameters)[:, [5, 5]]
        twice[0, 1] = 1.0
        shared = dataclasses.replace(record, null_space=twice / np.linalg.norm(twice, axis=0)).selected(places)
        assert shared.null_space.tolist() == [[1.0], [0.0], [0.0]]
        untouched = dataclasses.replace(record, null_space=np.eye(record.n_parameters)[:, [0]])
        assert untouched.selected(places).null_space.shape == (3, 0)


REFERENCE_NOTE = "thermal-expansion:x@temp_bed"
