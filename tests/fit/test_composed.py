"""A model that was composed of terms is fitted as it stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_machine import camera, draw_truth, machine_of, nine_lines, observe

from geoerr.errors import ShapeError
from geoerr.fit import FitOptions, fit_model


def test_a_model_is_fitted_as_it_is_composed() -> None:
    """The terms of a fit with one more: the same as naming the effect from the start, with the same bases."""
    rng = np.random.default_rng(21)
    machine = machine_of("wZbXYt")
    truth = draw_truth(rng, "wZbXYt", n_points=9)
    moves = [replace(move, repeat=repeat) for repeat in range(2) for move in nine_lines(machine)]
    observations = observe(machine, truth, moves, {"0": camera(rng)}, covariance_mm2=np.eye(3) * 1e-6, rng=rng)
    base = fit_model(machine, observations, options=FitOptions(threads=1))
    composed = fit_model(base.model + "backlash:x", observations, options=FitOptions(threads=1))
    bases = {term.id: term.parts[0].basis for term in base.model.terms if term.parts[0].basis is not None}
    named = fit_model(machine, observations, effects=["backlash:x"], options=FitOptions(bases=bases, threads=1))
    alone = fit_model(machine, observations, effects="backlash:x", options=FitOptions(bases=bases, threads=1))
    assert alone.model.terms == named.model.terms
    for term in named.model.terms:
        for parameter in term.coefficients:
            found = composed.model.parameter(f"{term.id}.{parameter.name}")
            assert abs(found.value - parameter.value) <= 1e-6 * parameter.std


def test_no_number_of_threads_is_refused_by_its_name() -> None:
    with pytest.raises(ShapeError, match="threads is -1"):
        FitOptions(threads=-1)
