"""A model that is given is off by as much as it may be: that is no news, and what is off by more is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from validation.given_models import given, sessions
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Case, Hidden, generate

from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.diagnose import Diagnosis, diagnose
from geoerr.diagnose.change import add_effect
from geoerr.diagnose.findings import IN_MODEL
from geoerr.diagnose.space import Doubt, basis_of_draws, beyond_in_metric, doubt_that_counts, orthonormal
from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions, fit_model
from geoerr.fit.sightings import Numbers
from geoerr.model import Model
from geoerr.summaries import capitalised

ROWS = 40
# Noise that is white already.
WHITE: Any = SimpleNamespace(whiten=lambda columns: columns)
FREE = 1e6


def drawn(columns: int, seed: int, size: float = 1.0) -> Numbers:
    return size * np.random.default_rng(seed).normal(size=(ROWS, 3, columns))


def dense_metric(doubt: Numbers, *free: Numbers) -> Numbers:
    """Invert the covariance that noise, a doubt and what is free have together."""
    flat = [one.reshape(3 * ROWS, -1) for one in (doubt, *free)]
    covariance = np.eye(3 * ROWS) + flat[0] @ flat[0].T
    for one in flat[1:]:
        basis = np.linalg.qr(one)[0]
        covariance += FREE * basis @ basis.T
    return np.asarray(np.linalg.inv(covariance))


def shortened(doubt: Numbers, free: Numbers) -> Numbers:
    whole = orthonormal(np.concatenate([free, doubt], axis=2).reshape(3 * ROWS, -1))
    return Doubt(doubt, free).shortened(whole, WHITE)


@pytest.mark.parametrize("size", [0.01, 0.3, 3.0])
def test_short_columns_are_the_inverse_covariance(size: float) -> None:
    doubt, free = drawn(5, 1, size), drawn(4, 2)
    basis = shortened(doubt, free)
    np.testing.assert_allclose(np.eye(3 * ROWS) - basis @ basis.T, dense_metric(doubt, free), atol=5e-6)


def test_what_is_added_becomes_free_in_the_same_metric() -> None:
    doubt, free = drawn(5, 1), drawn(4, 2)
    # Partly what the model may be off by anyway.
    added = drawn(2, 3) + doubt[:, :, :2]
    basis = shortened(doubt, free)
    _, new = beyond_in_metric(basis, added.reshape(3 * ROWS, -1))
    metric = np.eye(3 * ROWS) - basis @ basis.T - new @ new.T
    np.testing.assert_allclose(metric, dense_metric(doubt, free, added), atol=5e-6)


def test_a_doubt_far_below_the_scatter_does_not_count() -> None:
    doubt = np.concatenate([drawn(2, 1), drawn(3, 2, 1e-3)], axis=2)
    free = orthonormal(drawn(4, 3).reshape(3 * ROWS, -1)).reshape(ROWS, 3, -1)
    assert doubt_that_counts(doubt, free, 1.0).shape == (ROWS, 3, 2)
    assert doubt_that_counts(doubt, free, 1e-4).shape == (ROWS, 3, 5)


def case_of(number: int, *hidden: Hidden) -> Case:
    noise = ("gauss-10", "offsets-3", "drift-2", "heavy-tails")[number % 4]
    plan = ("volume-floor", "volume-relative")[number // 4 % 2]
    return generate(development_seed(996_000 + number), None, plan, noise, hidden, 8.0 if hidden else 0.0, 3_000)


def told_of_the_rest(case: Case) -> Diagnosis:
    """Fit a model to the first sessions, and ask what it lacks in the others."""
    return diagnose(*given(case), threads=1)


def test_a_right_model_lacks_nothing_in_other_data() -> None:
    p_values = [told_of_the_rest(case_of(number)).p_value for number in range(6)]
    # At 5 %, three of six would be a chance of one in 400.
    assert sum(p < 0.05 for p in p_values) < 3, p_values
    assert max(p_values) > 0.2, p_values


@pytest.mark.parametrize(("number", "kind"), [(20, "backlash"), (21, "screw-wobble")])
def test_what_is_off_by_more_than_the_model_may_be_is_named(number: int, kind: str) -> None:
    case = case_of(number, Hidden(kind))
    diagnosis = told_of_the_rest(case)
    assert diagnosis.found[0].reference.effect == kind


def test_draws_off_a_doubt_scatter_as_the_residual_does() -> None:
    basis = shortened(drawn(5, 1, 0.3), drawn(4, 2))
    unit = np.eye(3 * ROWS)
    of_draws = basis_of_draws(basis.reshape(ROWS, 3, -1)).reshape(3 * ROWS, -1)
    metric, root = (unit - one @ one.T for one in (basis, of_draws))
    np.testing.assert_allclose(root @ root, metric, atol=1e-9)
    # With the basis itself they would be smaller.
    assert np.trace(metric @ metric) < np.trace(metric) - 0.1


@pytest.mark.parametrize(
    ("number", "plan", "kind", "name", "value"),
    [
        (0, "volume-floor", "backlash", "backlash:z", "b"),
        # Of its own freedom the model may be off by more than the noise there.
        (1, "volume-relative", "thermal-expansion", "thermal-expansion:z@temp_bed_low", "alpha"),
    ],
)
def test_more_of_what_the_model_has_is_told_as_that(number: int, plan: str, kind: str, name: str, value: str) -> None:
    """A play that has grown is no wind-up: it is told by how much, and to fit the model again."""
    seed = development_seed(991_000 + number)
    before, after = (
        generate(seed, None, plan, "gauss-10", (Hidden(kind),), strength, 3_000) for strength in (6.0, 15.0)
    )
    options, seen = FitOptions(threads=1), sessions(before.observations, seen=True)
    plain = fit_model(before.machine, seen, options=options).model
    model = add_effect(plain, seen, reference=name, threads=1).result.model
    had = model.parameter(f"{name}.{value}")
    diagnosis = diagnose(model, sessions(after.observations, seen=False), threads=1)
    (found,) = diagnosis.found
    assert (str(found.reference), found.in_model) == (name, True)
    more = found.parameters[0]
    truth = next(size for key, size in after.truth[0].parameters.items() if key == value)
    assert more.value == pytest.approx(truth - had.value, abs=4.0 * np.hypot(more.std, had.std))
    assert capitalised(IN_MODEL) in found.words()
    text = "\n".join(diagnosis_lines(diagnosis, "geoerr add model.json new.csv", ""))
    assert IN_MODEL[:40] in text
    assert "to add it" not in text


def test_what_acted_on_the_models_own_data_is_named_with_its_numbers_fitted() -> None:
    """Of growth with temperature the model's functions hold a part; the rest of it is no known effect."""
    case = case_of(1, Hidden("thermal-expansion"))
    diagnosis = told_of_the_rest(case)
    held = diagnosis.other_way
    assert held is not None
    assert (held.verdict, held.takes_part, held.found) == ("unknown", False, ())
    assert diagnosis.takes_part
    (found,) = diagnosis.found
    (truth,) = case.truth
    assert found.reference.effect == truth.kind
    growth = next(one for one in found.parameters if one.name == "alpha")
    assert growth.value == pytest.approx(truth.parameters["alpha"], abs=4.0 * growth.std)
    (note,) = [text for text in diagnosis.notes if "hold a part of a cause" in text]
    assert held.unknown is not None
    assert all(name in note for name in held.unknown.depends_on)
    document = diagnosis.to_document()
    assert document["model_takes_part"] is True
    assert document["other_way"]["verdict"] == "unknown"
    assert document["other_way"]["model_takes_part"] is False
    text = "\n".join(diagnosis_lines(diagnosis, "geoerr add model.json new.csv", ""))
    assert "numbers are fitted to these data, too" in text
    # What it is told to add lets the error fall.
    assert f"geoerr add model.json new.csv {found.reference} " in text
    assert found.held_out is not None
    assert found.held_out.after_um < 0.9 * found.held_out.before_um


def test_what_has_no_name_has_none_with_the_models_numbers_fitted() -> None:
    case = case_of(0, Hidden("play-cubic-across"))
    diagnosis = told_of_the_rest(case)
    assert (diagnosis.verdict, diagnosis.takes_part) == ("unknown", False)
    fitted = diagnosis.other_way
    assert fitted is not None
    assert (fitted.verdict, fitted.takes_part) == ("unknown", True)
    (note,) = [text for text in diagnosis.notes if "no name either" in text]
    assert fitted.unknown is not None
    assert all(name in note for name in fitted.unknown.depends_on)
    # The answer can be gone through; of the other way only what it says is kept.
    assert diagnosis.searched.unknown is not None
    with pytest.raises(GeoerrError, match="let go"):
        _ = fitted.searched


def test_errors_of_its_own_that_have_changed_stay_without_a_name() -> None:
    """A straightness is another by now: fitted to the new data nothing is missing, and the answer stays."""
    model, others = given(case_of(1))
    diagnosis = diagnose(changed(model, "EYX", 0.1), others, threads=1)
    assert (diagnosis.verdict, diagnosis.takes_part) == ("unknown", False)
    fitted = diagnosis.other_way
    assert fitted is not None
    assert fitted.verdict == "nothing-missing"
    assert [text for text in diagnosis.notes if "its own errors can do" in text]


def changed(model: Model, name: str, by: float) -> Model:
    """Move one function of an error in the middle of its axis."""
    terms = []
    for term in model.terms:
        if term.id == name:
            coefficients = list(term.coefficients)
            middle = len(coefficients) // 2
            coefficients[middle] = replace(coefficients[middle], value=coefficients[middle].value + by)
            term = replace(term, coefficients=tuple(coefficients))
        terms.append(term)
    assert any(term.id == name for term in terms)
    return replace(model, terms=tuple(terms))
