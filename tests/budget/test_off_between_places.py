"""What a model is off by between the places that were measured is a source of the budget."""

from pathlib import Path

import numpy as np
import pytest
from validation.fine_errors import KINDS, MACHINE, measured, nothing

from geoerr.budget import Budget, budget_text, uncertainty_budget
from geoerr.fit import FitResult, fit_model
from geoerr.machine import AXES
from geoerr.model.document import document_of, model_from_document

NOISE_UM = 2.0
CENTRE = {"centre": (203.0, 197.0, 201.0)}


def of_machine(kind: str) -> FitResult:
    rng = np.random.default_rng(5)
    curves = [KINDS.get(kind, nothing)(rng) for _ in AXES]
    return fit_model(MACHINE, measured(rng, curves, NOISE_UM, 21))


def stated_um(budget: Budget) -> float | None:
    return next((one.std for one in budget.sources if one.name == "between places"), None)


def test_a_rough_machine_is_less_sure_between_its_places_and_its_file_says_so() -> None:
    fit = of_machine("table")
    budget = uncertainty_budget(fit, CENTRE)
    said_um = stated_um(budget)
    assert said_um is not None
    own_um = {source.name: 1e3 * float(np.linalg.norm(root)) for source, root in budget.chosen("prediction")}
    assert budget.standard_length_um()[0] == pytest.approx(np.linalg.norm(list(own_um.values())))
    # Its numbers alone are more than twice as sure as it is.
    assert own_um["between places"] == pytest.approx(said_um)
    assert said_um > 2.0 * np.linalg.norm([own_um["pixels"], own_um.get("scatter", 0.0)])
    assert "    between places " in budget_text(budget)
    of_file = uncertainty_budget(model_from_document(document_of(fit.model), Path("model.json")), CENTRE)
    assert stated_um(of_file) == pytest.approx(said_um)
    assert of_file.standard_um() == pytest.approx(budget.standard_um(), rel=1e-6)
    # A file does not say how much of it rows share, of which fewer degrees of freedom tell.
    assert of_file.expanded_um() == pytest.approx(budget.expanded_um(), rel=1e-3)


def test_of_a_smooth_machine_it_is_said_that_nothing_is_seen() -> None:
    for one in (fit := of_machine("nothing"), fit.model):
        budget = uncertainty_budget(one, CENTRE)
        assert stated_um(budget) is None
        assert any("by no more than chance" in sentence for sentence in budget.not_counted)
