"""What is left of an error where poorly known terms are not corrected: the expectation, and the choice."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from fitted_models import fitted, spline, squareness
from model_machines import machine

from geoerr.model import FitRecord, Model
from geoerr.model.worth import left_mm2, spread_places, uncertain_terms, well_known

AT = {"temp_bed": 50.0}
N_DRAWS = 4000


def three_terms(values: np.ndarray) -> tuple:
    return (spline("EXX", values[:5]), spline("ECX", values[5:10]), squareness("S_xy", values[10]))


def of_record(values: np.ndarray, covariance: np.ndarray) -> Model:
    return Model(machine(), None, three_terms(values), FitRecord(covariance, np.zeros((len(values), 0))))


def test_the_mean_square_is_what_is_left_on_average() -> None:
    """Estimates drawn about a truth; every choice of terms is scored, and carried out against the truth."""
    generator = np.random.default_rng(3)
    sizes = np.concatenate([np.full(5, 2e-3), np.full(5, 1e-5), [1e-5]])
    truth = sizes * generator.normal(size=11)
    root = sizes[:, None] * (np.eye(11) + 0.5 * generator.normal(size=(11, 11)))
    places = spread_places([(0.0, 400.0)] * 3, 40)
    choices = [np.array(out) for out in itertools.product((False, True), repeat=3)]
    by_parameter = next(of_record(truth, root @ root.T)._columns(places, None, "relative", None, 1))
    owner = np.repeat([0, 1, 2], [5, 5, 1])
    scored, left = np.zeros((N_DRAWS, 8)), np.zeros((N_DRAWS, 8))
    true_mm = by_parameter @ truth
    covariance = np.array(
        [
            [
                np.einsum(
                    "nci,ij,ncj->", by_parameter[:, :, owner == a], (root @ root.T)[np.ix_(owner == a, owner == b)],
                    by_parameter[:, :, owner == b],
                )
                for b in range(3)
            ]
            for a in range(3)
        ]
    ) / len(places)  # fmt: skip
    for draw in range(N_DRAWS):
        estimate = truth + root @ generator.normal(size=11)
        each = np.array([(by_parameter[:, :, owner == a] @ estimate[owner == a]).ravel() for a in range(3)])
        for number, out in enumerate(choices):
            scored[draw, number] = left_mm2(each @ each.T / len(places), covariance, out)
            left[draw, number] = ((true_mm.ravel() - each[~out].sum(axis=0)) ** 2).sum() / len(places)
    # What is left out looks larger by its own noise, and by nothing else.
    difference = scored - left - [covariance[np.ix_(out, out)].sum() for out in choices]
    standard_error = difference.std(axis=0) / np.sqrt(N_DRAWS)
    assert (np.abs(difference.mean(axis=0)) < 4.0 * standard_error).all()
    # The model's own moments are the same numbers.
    products, own = of_record(truth, root @ root.T).contribution_moments_mm2(places)
    assert own == pytest.approx(covariance, rel=1e-9)
    whole = next(of_record(truth, root @ root.T)._columns(places, None, "relative", None, 1)) @ truth
    assert products.sum() == pytest.approx((whole**2).sum() / len(places), rel=1e-9)


def test_a_well_known_sum_of_poorly_known_terms_is_kept() -> None:
    """Turn and squareness trade places: both are uncertain by more than they are, and their sum is known."""
    values = np.concatenate([np.zeros(5), np.full(5, 1e-4), [-0.5e-4]])
    sum_std, split_std = 1e-6, 5e-4
    # The turn's constant c and S move x at y by −y (c + S): the difference is unknown, the sum is known.
    turn, lean = np.zeros(11), np.zeros(11)
    turn[5:10], lean[10] = 1.0, 1.0
    covariance = sum_std**2 * np.outer(turn + lean, turn + lean) / 4.0
    covariance += split_std**2 * np.outer(turn - lean, turn - lean)
    model = of_record(values, covariance)
    assert uncertain_terms(model) == ()
    alone = of_record(values, split_std**2 * (np.outer(turn, turn) + np.outer(lean, lean)))
    assert [term.id for term in uncertain_terms(alone)] == ["ECX", "S_xy"]


def test_a_worthless_sum_goes_as_a_whole() -> None:
    """Neither of the two can go alone, for the other would have to carry the doubt of both."""
    values = np.concatenate([np.zeros(5), np.full(5, 4e-4), [-4.001e-4]])
    turn, lean = np.zeros(11), np.zeros(11)
    turn[5:10], lean[10] = 1.0, 1.0
    covariance = (2e-5) ** 2 * np.outer(turn + lean, turn + lean) / 4.0
    covariance += (5e-4) ** 2 * np.outer(turn - lean, turn - lean)
    model = of_record(values, covariance)
    assert [term.id for term in uncertain_terms(model)] == ["ECX", "S_xy"]
    products, variances = model.contribution_moments_mm2(spread_places([(0.0, 400.0)] * 3))
    one_out, none_out = np.array([False, True, False]), np.zeros(3, dtype=bool)
    assert left_mm2(products, variances, one_out) > left_mm2(products, variances, none_out)


def test_what_can_be_told_from_0_stays_whatever_the_others() -> None:
    generator = np.random.default_rng(8)
    for _ in range(50):
        size = 10.0 ** generator.uniform(-6, -3, 11)
        values = size * generator.normal(size=11)
        root = size[:, None] * generator.normal(size=(11, 11))
        model = of_record(values, root @ root.T)
        assert all(term.rms_um < 1.4143 * term.std_um for term in uncertain_terms(model))


def test_nothing_is_left_out_of_what_is_known_or_not_fitted() -> None:
    assert uncertain_terms(fitted(), AT) == ()
    unfitted = dataclasses.replace(fitted(), record=None)
    assert uncertain_terms(unfitted, AT) == ()
    assert uncertain_terms(Model(machine())) == ()


def test_the_rest_of_a_model_keeps_its_values_and_its_conditions() -> None:
    model = fitted()
    assert model.record is not None
    covariance = model.record.covariance.copy()
    place = model.parameter_names.index("thermal-expansion:x@temp_bed.alpha")
    covariance[place, place] = 1.0
    unsure = dataclasses.replace(model, record=dataclasses.replace(model.record, covariance=covariance))
    rest, left_out, at = well_known(unsure, AT | {"d_y": 1.0})
    assert [term.id for term in left_out] == ["thermal-expansion:x@temp_bed"]
    assert at == {"d_y": 1.0}
    assert [term.id for term in rest.terms] == [term.id for term in model.terms if term.id != left_out[0].id]
    q = spread_places([(0.0, 400.0)] * 3, 20)
    expected = model.error_mm(q, at={"temp_bed": "reference", "d_y": 1.0})
    assert rest.error_mm(q, at=at) == pytest.approx(expected, abs=1e-12)


def test_places_fill_the_box() -> None:
    places = spread_places([(0.0, 400.0), (-10.0, 10.0), (5.0, 5.0)])
    assert places.min(axis=0) == pytest.approx([0.0, -10.0, 5.0], abs=4.0)
    assert places.max(axis=0) == pytest.approx([400.0, 10.0, 5.0], abs=4.0)
    for axis in range(2):
        assert len(np.unique(places[:, axis])) == len(places)
        # Any interval of a tenth holds about a tenth of them.
        counts, _ = np.histogram(places[:, axis], bins=10)
        assert counts.min() >= 22
