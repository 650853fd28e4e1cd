"""Every effect of the catalogue is a term like any other: added, predicted, written, read, reported."""

from __future__ import annotations

import json

import numpy as np
import pytest
from model_machines import machine

from geoerr.effects import catalogue
from geoerr.files import to_json
from geoerr.model import Model
from geoerr.model.document import document_of, model_from_document
from geoerr.terms import Term

COLUMNS = ("temp_bed", "temp_head", "load", "force", "duty", "feed", "t", "moving", "u_left", "v_left")
OFFSET = (1.0, 2.0, 3.0)


def candidates(effect_id: str) -> list[Term]:
    effect = catalogue()[effect_id]
    references = effect.candidates(machine(), COLUMNS, n_sessions=2, is_circular=True)
    terms = [term for r in references for term in effect.terms(r.axis, r.covariate, machine())]
    return [
        term.with_values(
            # So small that products of errors are far below the errors themselves.
            [1e-9 * (place + 1) for place in range(len(term.coefficients))],
            [0.5 * (parameter.low + parameter.high) for parameter in term.inner],
        )
        for term in terms
    ]


@pytest.mark.parametrize("effect_id", sorted(catalogue().effects))
def test_as_a_term_of_a_model(effect_id: str) -> None:
    q = np.random.default_rng(0).uniform(1.0, 399.0, (5, 3))
    for term in candidates(effect_id):
        model = Model(machine()) + term
        at = {name: {"d": -1.0, "session": 1.0}.get(name.partition("_")[0], 1.5) for name in model.conditions}
        error = model.error_mm(q, OFFSET, at=at)
        assert np.isfinite(error).all()
        if term.is_rig:
            assert not error.any()
        else:
            (contribution,) = model.contributions(q, OFFSET, at=at).values()
            assert np.abs(error - contribution).max() <= 1e-4 * np.abs(error).max()
            if term.inner:
                # Derivatives by inner parameters, against differences.
                check_columns(model, q, at)
        again = model_from_document(json.loads(to_json(document_of(model))), "m.json")
        assert again.terms == model.terms
        assert term.id in model.report() or term.kind == "classic"
        assert model.without(term.id).is_nominal


def test_many_rows_are_predicted_block_by_block() -> None:
    """What a row gives does not depend on the block that it is in, nor do its own conditions get lost."""
    n = (1 << 16) + 3
    rng = np.random.default_rng(2)
    q, temp = rng.uniform(0.0, 400.0, (n, 3)), rng.uniform(20.0, 80.0, n)
    (term,) = catalogue()["thermal-expansion"].terms("x", "temp_bed", machine())
    model = Model(machine()) + term.with_values([11.5e-6], [0.0])
    whole = model.error_mm(q, at={"temp_bed": temp})
    contributions = model.contributions(q, at={"temp_bed": temp})
    for rows in (slice(0, 5), slice(n - 7, n)):
        assert np.array_equal(whole[rows], model.error_mm(q[rows], at={"temp_bed": temp[rows]}))
        assert np.array_equal(
            contributions[term.id][rows], model.contributions(q[rows], at={"temp_bed": temp[rows]})[term.id]
        )
    assert model.error_mm(np.zeros((0, 3)), at={"temp_bed": 30.0}).shape == (0, 3)


def check_columns(model: Model, q: np.ndarray, at: dict[str, float]) -> None:
    (term,) = model.machine_terms
    (columns,) = model._columns(q, OFFSET, "relative", at, 1)
    for place, parameter in enumerate(term.inner):
        assert parameter.low is not None
        assert parameter.high is not None
        if parameter.is_fixed:
            continue
        step = 1e-5 * (parameter.high - parameter.low)
        moved = []
        for sign in (1.0, -1.0):
            inner = [p.value + sign * step * (p is parameter) for p in term.inner]
            moved.append(
                sum((Model(machine()) + term.with_values(inner=inner)).contributions(q, OFFSET, at=at).values())
            )
        difference = (moved[0] - moved[1]) / (2.0 * step)
        derivative = columns[:, :, len(term.coefficients) + place]
        size = max(np.abs(derivative).max(), np.abs(moved[0]).max() / (parameter.high - parameter.low))
        # Truncation of a difference over 1e-5 of the range, and a step function's own jump, which has no derivative.
        assert np.abs(derivative - difference).max() <= 1e-3 * size or "step" in str(term.parts)
