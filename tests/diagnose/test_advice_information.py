"""The expected Δχ² of a plan against least squares written out with dense matrices and columns by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from advice_machine import SIGMA_UM, Log, lines_at_one_feed, machine, measure

from geoerr.diagnose.advice import Adviser, Measurement, adviser_of
from geoerr.diagnose.advice.planned import noise_of, planned
from geoerr.diagnose.advice.situation import Situation, situation_of
from geoerr.diagnose.space import space_of
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.terms import Term

X, Y = np.eye(3)[0], np.eye(3)[1]


def term(reference: str) -> Term:
    effect, checked = catalogue().resolve(reference)
    return effect.term(checked.axis, checked.covariate, machine())


def _hidden(log: Log) -> np.ndarray:
    return -6.0 * log.d[:, :1] * X


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    """A model of a scale and a squareness, of which all columns can be written by hand."""
    table = measure(lines_at_one_feed(np.random.default_rng(3), n_lines=4, n_points=8), _hidden, 3)
    options = FitOptions(components="none", threads=1, is_robust=False)
    return fit_terms(machine(), [table], effects=[term("scale:x"), term("squareness:xy")], options=options)


@pytest.fixture(scope="module")
def adviser(fitted: Fitted) -> Adviser:
    return adviser_of(fitted, [term("backlash:x"), term("lag:x")])


def _seen(vectors: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """What displacements (n, 3) in the base are in whitened numbers (3n,)."""
    return (np.einsum("nij,nj->ni", turned, vectors) / (1e-3 * SIGMA_UM)).reshape(-1)


def _by_hand(q: np.ndarray, turned: np.ndarray, session: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns of the model's two coefficients, and of each session's frame."""
    model = [_seen(q[:, :1] * X, turned), _seen(-q[:, 1:2] * X, turned)]
    frames = []
    for one in np.unique(session):
        own = (session == one)[:, None].astype(float)
        for axis in np.eye(3):
            frames += [_seen(own * axis, turned), _seen(own * np.cross(axis, q - 200.0), turned)]
    return np.array(model).T, np.array(frames).T


def _plan_covariance(situation: Situation, plan: Measurement) -> np.ndarray:
    """The covariance of a plan's numbers (3n, 3n): runs of twelve rows of a pass share what drifts."""
    pictures = plan.pictures
    n = len(pictures)
    block, since = np.zeros(n, dtype=int), 0
    for row in range(1, n):
        same = pictures.pass_number[row] == pictures.pass_number[row - 1]
        since = since + 1 if same else 0
        block[row] = block[row - 1] + int(not same or since % 12 == 0)
    time = np.array([pictures.t_s[block == one].mean() for one in block])
    same_pass = pictures.pass_number[:, None] == pictures.pass_number
    same_session = pictures.session[:, None] == pictures.session
    whole = np.zeros((n, 3, n, 3))
    for c in range(3):
        apart = np.abs(time[:, None] - time)
        drift = situation.drift[c] ** 2 * np.exp(-apart / situation.memory_s[c]) * same_session
        own = np.eye(n) + situation.offset[c] ** 2 * same_pass + drift
        whole[:, c, :, c] = situation.sigma[c] ** 2 * own
    return whole.reshape(3 * n, 3 * n)


class Dense:
    """The data and a plan, whitened by dense matrices; columns of candidates by hand."""

    def __init__(self, fitted: Fitted, adviser: Adviser, plan: Measurement) -> None:
        sightings, space, situation = fitted.sightings, adviser.space, adviser.situation
        rows = len(sightings)
        # The space's own noise, as a matrix.
        unit = np.eye(3 * rows).reshape(rows, 3, 3 * rows)
        self.half = space.noise.whiten(unit).reshape(3 * rows, 3 * rows)
        self.half_plan = np.linalg.inv(np.linalg.cholesky(_plan_covariance(situation, plan)))
        self.log = lines_at_one_feed(np.random.default_rng(3), n_lines=4, n_points=8)
        # Where the speed is unknown (a session's first row) no candidate counts.
        self.known = np.ones(rows)
        self.known[sightings.starts] = 0.0
        self.turned = fitted.solved.state.rotations[sightings.session]
        self.there = np.tile(situation.rotation, (len(plan.pictures), 1, 1))
        self.direction = plan.pictures.direction[:, 0].astype(float)
        model, frames = _by_hand(self.log.q, self.turned, sightings.session)
        own, own_frames = _by_hand(plan.pictures.q_mm, self.there, plan.pictures.session)
        model, frames = self.half @ model, self.half @ frames
        own, own_frames = self.half_plan @ own, self.half_plan @ own_frames
        nothing = np.zeros((len(frames), own_frames.shape[1])), np.zeros((len(own), frames.shape[1]))
        self.base_of_data = np.hstack([model, frames])
        self.base = np.block([[model, frames, nothing[0]], [own, nothing[1], own_frames]])
        self.left = self.half @ (fitted.solved.whitened * space.rows).reshape(-1)

    def columns(self, data: np.ndarray, plan: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What a displacement along x (n,) is in whitened numbers of the data, and of both."""
        own = self.half @ (_seen(data[:, None] * X, self.turned) * np.repeat(self.known, 3))
        return own, np.concatenate([own, self.half_plan @ _seen(plan[:, None] * X, self.there)])

    def apart(self, truth: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
        """What the other, fitted with the model, leaves of the truth at its size by the data."""
        joined = np.column_stack([self.base_of_data, truth[0]])
        moved = np.linalg.lstsq(joined, self.left, rcond=None)[0][-1] * truth[1]
        rival = np.column_stack([self.base, other[1]])
        rest = moved - rival @ np.linalg.lstsq(rival, moved, rcond=None)[0]
        return float(rest @ rest)


def test_expected_difference_is_that_of_dense_least_squares(fitted: Fitted, adviser: Adviser) -> None:
    plan = next(one for one in adviser.plans if one.name == "at-rest")
    dense = Dense(fitted, adviser, plan)
    speed, still = dense.log.speed[:, 0], np.zeros(len(dense.direction))
    backlash = dense.columns(-0.5 * dense.log.d[:, 0], -0.5 * dense.direction)
    lag = dense.columns(-speed, still)
    expected = adviser.expected([(plan, 1)])
    # Winsorised residuals are the only difference.
    assert expected[0, 1] == pytest.approx(dense.apart(backlash, lag), rel=0.01)
    assert expected[1, 0] == pytest.approx(dense.apart(lag, backlash), rel=0.01)


def test_inner_parameters_are_free_to_imitate(fitted: Fitted) -> None:
    """The least over all speeds at which stick-slip could end, near enough though only some are tried."""
    own = adviser_of(fitted, [term("backlash:x"), term("stick-slip:x")])
    plan = next(one for one in own.plans if one.name == "at-rest")
    dense = Dense(fitted, own, plan)
    backlash = dense.columns(-0.5 * dense.log.d[:, 0], -0.5 * dense.direction)
    speed = np.abs(dense.log.speed[:, 0])
    imitations = [
        dense.apart(backlash, dense.columns(-0.5 * dense.log.d[:, 0] * np.exp(-speed / ends), -0.5 * dense.direction))
        for ends in np.geomspace(0.1, 200.0, 60)
    ]
    least = own.expected([(plan, 1)])[0, 1]
    assert max(imitations) > 20.0 * min(imitations)
    assert min(imitations) * 0.99 <= least <= 1.1 * min(imitations)


def test_noise_of_a_plan_is_the_inverse_of_its_covariance(adviser: Adviser) -> None:
    plan = next(one for one in adviser.plans if one.name == "at-rest")
    situation = replace(adviser.situation, offset=np.array([0.5, 0.0, 1.0]), drift=np.array([0.3, 0.2, 0.0]))
    noise = noise_of(situation, planned(situation, plan))
    values = np.random.default_rng(1).normal(size=(len(plan.pictures), 3, 4))
    inverse = np.linalg.inv(_plan_covariance(situation, plan))
    flat = values.reshape(-1, 4)
    np.testing.assert_allclose(noise.product(values, values), flat.T @ inverse @ flat, rtol=1e-9, atol=1e-9)


def test_gain_is_that_of_the_data(fitted: Fitted) -> None:
    """The fall of χ² on adding a candidate, against a refit in the metric of the noise."""
    space = space_of(fitted, threads=1)
    adviser = Adviser(space, [term("backlash:x")])
    column = np.zeros((len(fitted.sightings), 3))
    d = fitted.sightings.directions[:, 0].astype(float)
    turned = fitted.solved.state.rotations[fitted.sightings.session]
    column = _seen(-0.5 * d[:, None] * X, turned).reshape(-1, 3)
    whitened = space.noise.whiten(column[:, :, None]).reshape(-1)
    flat = space.basis.reshape(len(whitened), -1)
    beyond = whitened - flat @ (flat.T @ whitened)
    gain = float(beyond @ space.residual.reshape(-1)) ** 2 / float(beyond @ beyond)
    assert adviser.gains[0] == pytest.approx(gain, rel=1e-6)


def test_same_again_is_twice_the_data(adviser: Adviser) -> None:
    np.testing.assert_allclose(adviser.same_again(), 2.0 * adviser.expected(), rtol=1e-6, atol=1e-6)


def test_the_situation_is_that_of_the_data(fitted: Fitted, adviser: Adviser) -> None:
    situation = situation_of(fitted, adviser.space.noise)
    assert situation.is_in_motion
    assert not situation.is_circular
    assert situation.feed_mm_min == situation.top_feed_mm_min == 1500.0
    assert situation.interval_s == pytest.approx(3.0)
    assert len(situation.targets) == 1
    np.testing.assert_allclose(
        situation.span_mm,
        np.column_stack([fitted.sightings.commanded_mm.min(0), fitted.sightings.commanded_mm.max(0)]),
    )
