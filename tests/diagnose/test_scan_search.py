"""The search on machines that hide something, and on one that hides nothing."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hidden_machine import Motion, Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.candidates import candidates_of
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.probe_variables import variables_of
from geoerr.diagnose.probes import Probe, probes_of
from geoerr.diagnose.scan import all_channels
from geoerr.diagnose.search import Bench, look, search
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions, Fitted, fit_terms

PLAN = Plan(n_sessions=3, n_lines=20, n_points=16)
NOISE = Noise(white=(5.0, 5.0, 7.0), offset=1.5)
KEPT = ("backlash", "thermal-expansion", "thermal-drift", "lag", "squareness", "lateral-play", "screw-heating")
KNOWN = Catalogue({name: catalogue()[name] for name in KEPT})


def _growth(moved: Motion) -> np.ndarray:
    """Y grows by 12 µm a metre and a kelvin from its middle."""
    return 12e-3 * ((moved.bed - 20.0) * (moved.q[:, 1] - 200.0))[:, None] * np.eye(3)[1]


def _play(moved: Motion) -> np.ndarray:
    return -5.0 * moved.d[:, :1] * np.eye(3)[0]


def _strange(moved: Motion) -> np.ndarray:
    """What no catalogue has: z by x and y together."""
    return 12.0 * (np.tanh((moved.q[:, 0] - 200.0) / 70.0) * np.cos(moved.q[:, 1] / 60.0))[:, None] * np.eye(3)[2]


def _fitted(seed: int, *hidden: object) -> Fitted:
    rng = np.random.default_rng(seed)
    moved = motion(rng, PLAN)
    displacement = sum((one(moved) for one in hidden), np.zeros_like(moved.q))  # type: ignore[operator]
    return fit_terms(machine(), [measure(rng, moved, NOISE, displacement)], options=FitOptions(threads=1))


@cache
def _diagnosis() -> Diagnosis:
    return diagnose(_fitted(1, _growth), threads=1)


def test_growth_is_named_with_its_value() -> None:
    diagnosis = _diagnosis()
    first = diagnosis.found[0]
    assert str(first.reference) == "thermal-expansion:y@temp_bed"
    alpha = next(one for one in first.parameters if one.name == "alpha")
    assert abs(alpha.value - 12e-6) < 4.0 * alpha.std
    assert first.p_value < 1e-4
    assert first.held_out_rmse_after_um is not None
    assert diagnosis.held_out_rmse_um is not None
    assert first.held_out_rmse_after_um < diagnosis.held_out_rmse_um


def test_document_has_what_the_contract_names() -> None:
    document = _diagnosis().to_document()
    assert set(document) >= {
        *(
            "verdict",
            "p_value",
            "noise_floor_um",
            "held_out_rmse_um",
            "found",
            "candidates",
            "not_offered",
            "unknown",
        ),
    }
    assert set(document["candidates"][0]) >= {
        *("effect", "axis", "covariate", "p_value", "held_out_rmse_after_um", "worth_um", "parameters", "tied"),
        *("aliases", "separate_by"),
    }
    wanting = {entry["effect"]: entry["why"] for entry in document["not_offered"]}
    assert "force" in wanting["load-deflection"]
    assert "not measurable" in wanting["scale"]


def test_says_it_in_words() -> None:
    words = _diagnosis().found[0].words()
    assert "thermal-expansion:y@temp_bed" in words
    assert "steel" in words


def test_two_effects_are_found_one_after_the_other() -> None:
    searched = search(_fitted(2, _growth, _play), Offers(KNOWN), threads=1)
    names = [str(one.settled.term.id) for one in searched.found if one.settled.term is not None]
    assert set(names) == {"thermal-expansion:y@temp_bed", "backlash:x"}


def test_what_no_effect_explains_is_unknown_with_its_variables() -> None:
    searched = search(_fitted(3, _strange), Offers(KNOWN), threads=1)
    assert not searched.found
    assert searched.unknown is not None
    probe = searched.unknown.judged.what
    assert (probe.component, probe.depends_on) == ("z", ("x", "y"))  # type: ignore[union-attr]


@pytest.mark.parametrize(("degrees", "depends_on"), [(0.5, ("temp_bed",)), (6.0, ("t",))])
def test_a_temperature_that_is_cycled_is_not_called_time(degrees: float, depends_on: tuple[str, ...]) -> None:
    """Its square is a wave of twice its frequency, which a wave in time takes better than what a coarse sensor tells.

    Where the sensor tells next to nothing, time is what there is.
    """
    rng = np.random.default_rng(5)
    moved = motion(rng, Plan(n_sessions=1, n_lines=60, n_points=16))
    exact = 30.0 + 6.0 * np.sin(2.0 * np.pi * moved.t / 500.0)
    moved.bed = np.round(exact / degrees) * degrees
    displacement = 0.4 * ((exact - 30.0) ** 2)[:, None] * np.eye(3)[0]
    seen = measure(rng, moved, NOISE, displacement)
    fitted = fit_terms(machine(), [seen], options=FitOptions(threads=1))
    candidates, _, functions = candidates_of(fitted, KNOWN)
    probes = probes_of(fitted, functions, variables_of(fitted))
    shapes = [one for what in [*candidates, *probes] for one in what.shapes]
    bench = Bench(fitted, functions, names=all_channels(shapes), threads=1)
    first = look(bench, bench.space([]), candidates, probes).probes[0].what
    assert isinstance(first, Probe)
    assert (first.component, first.depends_on) == ("x", depends_on)


def test_nothing_is_found_where_nothing_is_hidden() -> None:
    searched = search(_fitted(4), Offers(KNOWN), threads=1)
    assert not searched.found
    assert searched.unknown is None
    assert searched.first.p_value > 0.05


def test_a_fit_has_its_measurements() -> None:
    fitted = _fitted(5)
    with pytest.raises(GeoerrError, match="has its measurements"):
        diagnose(fitted, fitted)  # type: ignore[arg-type]
