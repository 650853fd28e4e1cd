"""A model held against circles is off by as much as it may be: that is no news, and what is off by more is."""

from __future__ import annotations

from functools import cache

import numpy as np
from validation.given_models import exact
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Case, generate

from geoerr.diagnose.circles import diagnose_circles
from geoerr.diagnose.circles.diagnosis import CircleDiagnosis
from geoerr.diagnose.circles.noise import blocks_of, fit_noise
from geoerr.diagnose.circles.runs import Runs, checked, runs_of
from geoerr.diagnose.comparison import compare
from geoerr.diagnose.own_uncertainty import own_doubt
from geoerr.fit import FitOptions, fit_model
from geoerr.model import Model
from validation import given_circles

FIRST_SEED, N_ROWS = 994_000, 40
# One plane, both senses, two feeds.
RUNS = given_circles.RUNS[:4]


def case_of(number: int) -> Case:
    return generate(development_seed(FIRST_SEED + number), None, "volume-relative", "gauss-10", (), 0.0, 1_500)


@cache
def model_of(number: int) -> Model:
    case = case_of(number)
    return fit_model(case.machine, case.observations, options=FitOptions(freedom="smooth", threads=1)).model


def told(model: Model, number: int, hidden: str | None = None) -> CircleDiagnosis:
    circles = given_circles.circles_of(case_of(number), number, hidden, RUNS, N_ROWS)
    return diagnose_circles(model, circles, threads=1)


@cache
def runs() -> Runs:
    usable, problems, notes = checked((given_circles.circles_of(case_of(0), 0, None, RUNS, N_ROWS),))
    fitted = compare(model_of(0), *usable, threads=1).points
    return runs_of(fitted, problems, notes, own_doubt(model_of(0), fitted, counts_choice=False))


def test_noise_and_doubt_together_are_white() -> None:
    own = runs()
    alone = fit_noise(own, blocks_of(own), own.signal_um, own.set_up_columns)
    both = alone.with_doubt(own.doubt_um)
    unit = np.eye(len(own))
    back = np.linalg.inv(alone.whiten(unit))
    covariance = back @ back.T + own.doubt_um @ own.doubt_um.T
    white = both.whiten(unit)
    np.testing.assert_allclose(white @ covariance @ white.T, unit, atol=1e-6)
    # Without the doubt they are far from it.
    assert np.abs(alone.whiten(unit) @ covariance @ alone.whiten(unit).T - unit).max() > 1.0


def test_the_doubt_is_as_large_as_the_model_is_off() -> None:
    """In µm, beside centre and radius of each set-up: of 0.4 µm of noise most of the radius is the model's."""
    own = runs()
    basis = np.linalg.svd(own.set_up_columns, full_matrices=False)
    inside = basis[0][:, basis[1] > 1e-9 * basis[1][0]]
    off = own.signal_um - inside @ (inside.T @ own.signal_um)
    expected = own.doubt_um - inside @ (inside.T @ own.doubt_um)
    ratio = float(np.sqrt((off**2).sum() / (expected**2).sum()))
    assert 0.5 < ratio < 2.0, ratio


def test_a_right_model_lacks_nothing_and_taken_for_exact_it_does() -> None:
    assert told(model_of(1), 1).verdict == "nothing-missing"
    assert told(exact(model_of(1)), 1).verdict != "nothing-missing"


def test_what_a_machine_gained_is_named() -> None:
    for number, hidden in ((2, "backlash:x"), (3, "squareness:xy")):
        assert given_circles.is_named(told(model_of(number), number, hidden), hidden), hidden


def test_more_of_what_the_model_has_is_told_as_that() -> None:
    model, circles = given_circles.causes_of_a_ball_bar(9_001, "backlash:x")
    diagnosis = diagnose_circles(model, circles, threads=1)
    (found,) = diagnosis.found
    assert (str(found.reference), found.in_model) == ("backlash:x", True)
    assert abs(abs(found.term.coefficients[0].value) - 5e-3) < 5e-4
    assert found.to_document()["in_model"]
