"""What is offered is laid out once for the same rows and terms; what one search adds to it no other one sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose.candidates import candidates_of
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.probe_variables import variables_of
from geoerr.diagnose.probes import probes_of
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.fit import FitOptions, Fitted, fit_terms

KNOWN = Catalogue({name: catalogue()[name] for name in ("backlash", "thermal-expansion", "periodic", "lost-steps")})


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    rng = np.random.default_rng(1)
    plan = Plan(n_sessions=2, n_lines=16, n_points=12)
    observations = measure(rng, motion(rng, plan), Noise(), plan=plan)
    return fit_terms(machine(), [observations], options=FitOptions(threads=1))


def test_a_second_search_is_offered_what_the_first_was(fitted: Fitted) -> None:
    offers = Offers(KNOWN)
    first, not_offered, functions = offers.to(fitted)
    probes_of(fitted, functions, variables_of(fitted))
    again, still_not, others = offers.to(fitted.again(fitted.terms))
    assert all(one is other for one, other in zip(first, again, strict=True))
    assert still_not == not_offered
    # As if the first search had not been.
    plain, _, own = candidates_of(fitted, KNOWN)
    for one, other in zip(again, plain, strict=True):
        for shapes, alike in zip(one.shapes, other.shapes, strict=True):
            np.testing.assert_array_equal(shapes.codes, alike.codes)
            np.testing.assert_array_equal(others.values(shapes.codes[0]), own.values(alike.codes[0]))
    assert others.given(np.ones(others.n_rows)) == own.given(np.ones(own.n_rows))


def test_lags_that_a_search_asks_for_are_its_own(fitted: Fitted) -> None:
    offers = Offers(KNOWN)
    _, _, functions = offers.to(fitted)
    n_before = len(functions._series)
    functions._series.append(np.ones(functions.n_rows))
    _, _, others = offers.to(fitted)
    assert len(others._series) == n_before


def test_other_rows_are_offered_their_own(fitted: Fitted) -> None:
    offers = Offers(KNOWN)
    first, *_ = offers.to(fitted)
    used = fitted.solved.used.copy()
    used[0] = False
    others, *_ = offers.to(replace(fitted, solved=replace(fitted.solved, used=used)))
    assert not any(one is other for one, other in zip(first, others, strict=True))
