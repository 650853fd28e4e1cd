"""The report: its text, its width, its words."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from fitted_models import REFERENCE, all_terms, classic_terms, drawn_record, expansion, fitted, with_stds
from model_machines import drawn_errors, machine

from geoerr.error_functions import NotDetermined
from geoerr.model import Model

GOLDEN = Path(__file__).parent / "golden"


def fitted_but_for_roll() -> Model:
    """A fit whose roll of X the data leave free."""
    model = fitted()
    assert model.record is not None
    null_space = np.zeros((model.record.n_parameters, 1))
    roll = [place for place, name in enumerate(model.parameter_names) if name.startswith("EAX.")]
    null_space[roll, 0] = np.linspace(-1.0, 1.0, len(roll))
    null_space /= np.linalg.norm(null_space)
    why = "every target is at one height on the carriage: roll of X and its straightness along z are one number"
    # One pair as in a run in which the temperature rose with every reversal.
    covariance = model.record.covariance.copy()
    names = model.parameter_names
    i, j = names.index(f"{REFERENCE}.alpha"), names.index("backlash:y.b")
    covariance[j] = covariance[:, j] = 0.0
    covariance[j, j] = 1e-8
    covariance[i, j] = covariance[j, i] = -0.9 * np.sqrt(covariance[i, i] * covariance[j, j])
    record = dataclasses.replace(
        model.record, covariance=covariance, null_space=null_space, not_determined=(NotDetermined("EAX", why),)
    )
    return with_stds(Model(model.machine, None, model.terms, record))


def check(text: str, name: str) -> None:
    assert all(len(line) <= 100 for line in text.splitlines())
    assert text == (GOLDEN / name).read_text(encoding="utf-8")


def test_of_a_fit() -> None:
    check(fitted_but_for_roll().report(), "fitted.txt")


def test_of_tables_and_an_effect_that_is_not_fitted_yet() -> None:
    term = expansion(float("nan"), float("nan"))
    check(Model(machine(), drawn_errors(machine()), (term,)).report(), "tables.txt")


def test_of_the_nominal_machine() -> None:
    check(Model(machine()).report(), "nominal.txt")


def test_nothing_long_or_unprintable_breaks_it() -> None:
    of = dataclasses.replace(machine(), name="a\x1b[31m name " * 30)
    why = NotDetermined("ECX", "w" * 300)
    record = dataclasses.replace(drawn_record(all_terms()), not_determined=(why,))
    text = Model(of, None, all_terms(), record).report()
    assert all(len(line) <= 100 for line in text.splitlines())
    assert text.isprintable() or "\x1b" not in text


def test_an_unfitted_model() -> None:
    unknown = tuple(term.with_values([float("nan")] * len(term.coefficients)) for term in classic_terms())
    text = Model(machine(), None, unknown).report()
    assert "EXX: 6 coefficients, not fitted yet" in text
    assert "S_xy: 1 coefficients" in text
