"""Gains, scores and the null of the search against least squares written out, and against chance."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion
from scipy import stats

from geoerr.diagnose.candidates import Candidate, candidates_of
from geoerr.diagnose.null import Null, surprise, turns
from geoerr.diagnose.scan import OWNED, Scanner, raw_columns
from geoerr.diagnose.space import Channels, Space, space_of
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.fit import FitOptions, fit_terms

NAMES = ("backlash", "thermal-expansion", "lag", "step", "camera-drift", "thermal-bending", "screw-heating", "scale")


@cache
def _searched() -> tuple[Space, Channels, list[Candidate]]:
    rng = np.random.default_rng(1)
    plan = Plan(n_sessions=2, n_lines=16, n_points=12)
    observations = measure(rng, motion(rng, plan), Noise(offset=3.0, drift=3.0), plan=plan)
    fitted = fit_terms(machine(), [observations], options=FitOptions(threads=1))
    space = space_of(fitted)
    known = Catalogue({name: catalogue()[name] for name in NAMES})
    return space, Channels(fitted, space.rows), candidates_of(fitted, known)[0]


@pytest.mark.parametrize("name", NAMES)
def test_gain_estimate_and_scores_are_those_of_least_squares(name: str) -> None:
    space, channels, candidates = _searched()
    scanner = Scanner(space, channels)
    basis = space.basis.reshape(-1, space.basis.shape[2])
    residual, unseen = space.residual.reshape(-1), space.unseen.reshape(-1)
    owner = np.repeat(space.pass_number, 3)
    candidate = next(one for one in candidates if one.effect.id == name)
    for shapes in candidate.shapes:
        scanned = scanner.scan(shapes)
        trial = len(shapes.trials) // 2
        columns = space.noise.whiten(raw_columns(channels, shapes, shapes.values[trial])).reshape(len(basis), -1)
        beyond = columns - basis @ (basis.T @ columns)
        u, s, _ = np.linalg.svd(columns, full_matrices=False)
        u = u[:, s > 1e-6 * s[0]]
        own, share, _ = np.linalg.svd(u - basis @ (basis.T @ u), full_matrices=False)
        own = own[:, share**2 > OWNED]
        assert scanned.rank[trial] == own.shape[1]
        assert scanned.gain[trial] == pytest.approx(float(((own.T @ residual) ** 2).sum()), rel=1e-6, abs=1e-9)
        root = scanned.root[trial]
        assert beyond @ scanned.estimate[trial] == pytest.approx(own @ (own.T @ residual), abs=1e-6)
        scores = np.stack([(beyond * unseen[:, None])[owner == p].sum(axis=0) for p in range(space.n_passes)], axis=1)
        assert scanned.by_pass[trial] == pytest.approx(root.T @ scores, rel=1e-6, abs=1e-6)


def test_what_the_rigid_machine_owns_is_not_measurable() -> None:
    space, channels, candidates = _searched()
    scanner = Scanner(space, channels)
    scale = next(one for one in candidates if one.effect.id == "scale")
    assert all((scanner.scan(shapes).rank == 0).all() for shapes in scale.shapes)


def test_affine_parameters_need_no_trials() -> None:
    _, _, candidates = _searched()
    growth = next(one for one in candidates if one.effect.id == "thermal-expansion")
    at_once = growth.shapes[0]
    assert len(at_once.trials) == 1
    assert at_once.n_coefficients == 2


def test_tail_of_the_null_is_that_of_the_largest_of_many() -> None:
    rng = np.random.default_rng(2)
    largest = surprise(stats.chi2.rvs(3, size=(50, 199), random_state=rng), 3, 1).max(axis=0)
    null = Null(largest)
    # Beyond the turns: 50 chances of e^-s, exactly.
    for s in (12.0, 20.0):
        assert np.log(null.p_value(s)) == pytest.approx(np.log(50.0) - s, abs=1.5)
    assert null.p_value(float(np.median(largest))) == pytest.approx(0.5, abs=0.01)


def test_turns_are_always_the_same() -> None:
    assert (turns(7) == turns(7)).all()
