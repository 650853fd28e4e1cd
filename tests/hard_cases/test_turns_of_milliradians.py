"""Milliradians that follow a temperature: their squares are no other formula."""

import numpy as np
import pytest
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Case, Hidden, Scene, acting_of, generate, in_effects
from validation.hidden_effects.record import OPTIONS

from geoerr.diagnose.offers import Offers
from geoerr.diagnose.search import Searched, search
from geoerr.diagnose.second_order import second_order
from geoerr.diagnose.whole_search import searched_whole
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.fit import Fitted, fit_terms, has_covariates, refit

# Of an axis that turns by some milliradians, and of a plan that shows little of that.
KIND, CHAIN, PLAN, STRENGTH_UM = "angular-thermal", "wbYXZt", "volume-relative", 8.0
SMALL = 1e-3


@pytest.fixture(scope="module")
def case() -> Case:
    return generate(development_seed(700_001), CHAIN, PLAN, "gauss-10", (Hidden(KIND, "z"),), STRENGTH_UM, 4_000)


@pytest.fixture(scope="module")
def fitted(case: Case) -> Fitted:
    return fit_terms(case.machine, [case.observations], options=OPTIONS)


@pytest.fixture(scope="module")
def searched(fitted: Fitted) -> Searched:
    return searched_whole(fitted, catalogue(), threads=1)[1]


def test_the_second_order_is_that_of_exact_kinematics(case: Case, fitted: Fitted, searched: Searched) -> None:
    term = searched.found[0].settled.term
    assert term is not None
    beside = refit(fitted, [*fitted.terms, term])
    # Columns in the frames of the fit beside, as a search that begins again takes them.
    all_rows = np.ones(len(beside.sightings), dtype=bool)
    whitened = second_order(beside, [len(fitted.terms)], beside, all_rows)
    mm = np.einsum("nij,nj->ni", beside.sightings.unwhitening, whitened)
    told_mm = beside.problem.in_base_axes(beside.solved.state, np.ascontiguousarray(mm))

    scene = Scene(case.log, case.errors.at(case.machine, case.log.q_mm))
    truth = case.truth[0]
    unit, _, _ = acting_of(case.log, in_effects(case.seed), Hidden(truth.kind, truth.axis, truth.covariate))
    first = next(iter(unit.linear))
    moved = unit.moved.scaled(truth.parameters[first] / unit.linear[first])
    true_mm = scene.effect_mm(moved) - scene.effect_mm(moved.scaled(SMALL)) / SMALL
    assert np.sqrt(np.mean(true_mm**2)) > 1e-3
    # The errors and frames of a fit are not those of the machine: what they do with the effect is told with it.
    assert np.sqrt(np.mean((told_mm - true_mm) ** 2)) < 0.1 * np.sqrt(np.mean(true_mm**2))


def test_it_is_named_and_not_bent(case: Case, searched: Searched) -> None:
    truth = case.truth[0]
    named = [one.settled.term.id for one in searched.found if one.settled.term is not None]
    assert named == [f"{truth.effect}:{truth.axis}@{truth.covariate}"]
    assert searched.unknown is None


def test_what_only_shifts_has_no_second_order() -> None:
    """Nor where pictures are left out at which nothing shows when an axis turned: those after them know it still."""
    hidden = (Hidden("reversal-spike", "x"),)
    case = generate(development_seed(700_000), CHAIN, "mixed", "gauss-10", hidden, 100.0, 4_000)
    fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
    searched = search(fitted, Offers(Catalogue({"reversal-spike": catalogue()["reversal-spike"]})), threads=1)
    term = searched.found[0].settled.term
    assert term is not None
    beside = refit(fitted, [*fitted.terms, term])
    known = has_covariates(fitted.machine, fitted.sightings, beside.terms)
    assert not known.all()
    whitened = second_order(beside, [len(fitted.terms)], fitted, known)
    left_um = 1e3 * np.einsum("nij,nj->ni", beside.sightings.unwhitening, whitened)
    assert np.abs(left_um).max() < 0.01 * 100.0
