"""Tests and bands over a map: against dense inverses, against independent normal numbers, and by drawing."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from geoerr.states.chance import Spread, deviations, holm, largest_by_chance, whole_test


def spread(
    root: np.ndarray, part: np.ndarray | None = None, part_dof: float = math.inf, dof: float = math.inf
) -> Spread:
    return Spread(root, np.zeros((*root.shape[:-1], 0)) if part is None else part, part_dof, dof)


def test_the_whole_is_tested_as_a_dense_inverse_would() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(5, 7)) * np.array([1e-3, 1e-6, 1.0, 1e-5, 10.0])[:, None]
    value = root @ rng.normal(size=7)
    test = whole_test(value, spread(root))
    assert test.rank == 5
    assert test.chi_squared == pytest.approx(value @ np.linalg.solve(root @ root.T, value), rel=1e-9)
    assert test.p_value == pytest.approx(stats.chi2.sf(test.chi_squared, 5), rel=1e-12)
    estimated = whole_test(value, spread(root, dof=20.0))
    assert estimated.p_value == pytest.approx(stats.f.sf(test.chi_squared / 5, 5, 20.0), rel=1e-12)


def test_asking_at_more_places_tells_nothing_more() -> None:
    """A curve of three parameters at 60 places, some of them fixed by a gauge, has three degrees of freedom."""
    rng = np.random.default_rng(2)
    places = np.linspace(0.0, 1.0, 60)
    rows = np.column_stack([places, places**2, places**3])
    root = rng.normal(size=(3, 3))
    error = root @ rng.normal(size=3)
    few = whole_test(rows[[10, 30, 59]] @ error, spread(root).through(rows[[10, 30, 59]]))
    many = whole_test(rows @ error, spread(root).through(rows))
    assert (few.rank, many.rank) == (3, 3)
    assert many.chi_squared == pytest.approx(few.chi_squared, rel=1e-6)


def test_nothing_to_test_is_no_alarm() -> None:
    assert whole_test(np.ones(3), spread(np.zeros((3, 2)))).p_value == 1.0


def test_the_largest_of_independent_numbers() -> None:
    """Of n: quantile of |z| at 0.95^(1/n). The draws' own error at 95 % is 0.2 %, four of which are allowed."""
    largest = largest_by_chance(spread(np.eye(30)[:, None, :]))
    exact = stats.norm.ppf(0.5 + 0.5 * 0.95 ** (1.0 / 30.0))
    assert (2.0 * stats.norm.cdf(largest.quantile()) - 1.0) ** 30 == pytest.approx(0.95, abs=0.008)
    assert largest.p_value(np.array([exact]))[0] == pytest.approx(0.05, abs=0.008)
    vectors = largest_by_chance(spread(np.eye(30).reshape(10, 3, 30)))
    assert stats.chi2.cdf(vectors.quantile() ** 2, 3) ** 10 == pytest.approx(0.95, abs=0.008)


def test_neighbours_that_are_alike_widen_the_band_less() -> None:
    one = largest_by_chance(spread(np.ones((30, 1, 1))))
    assert one.quantile() == pytest.approx(stats.norm.ppf(0.975), abs=0.05)


def test_deviations_of_vectors() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(4, 3, 6))
    value = rng.normal(size=(4, 3))
    squares = [v @ np.linalg.solve(r @ r.T, v) for v, r in zip(value, root, strict=True)]
    assert deviations(value, root) == pytest.approx(np.sqrt(squares))


def test_a_part_whose_size_was_estimated_makes_tests_careful() -> None:
    """Numbers whose variance is 1 − f + f s², s² told by 6 degrees of freedom: p-values stay uniform.

    1000 draws have a standard error of 0.7 % at 5 %. Satterthwaite's approximation costs about as much.
    """
    n_dof = 6
    rng = np.random.default_rng(4)
    noise, common = np.eye(12), 1.5 * np.repeat(np.eye(4), 3, axis=0)
    alarms, plain, beyond = [], [], []
    for _ in range(1000):
        value = noise @ rng.normal(size=12) + common @ rng.normal(size=4)
        part = common * math.sqrt(rng.chisquare(n_dof) / n_dof)
        estimated = spread(np.hstack([noise, part]), part, float(n_dof))
        alarms.append(whole_test(value, estimated).p_value < 0.05)
        plain.append(whole_test(value, dataclasses.replace(estimated, part_dof=math.inf)).p_value < 0.05)
    assert np.mean(alarms) == pytest.approx(0.05, abs=0.02)
    assert np.mean(plain) > np.mean(alarms)
    largest = largest_by_chance(spread(np.hstack([noise, common])[:, None, :], common[:, None, :], float(n_dof)))
    for _ in range(1000):
        value = noise @ rng.normal(size=12) + common @ rng.normal(size=4)
        std = np.sqrt(1.0 + 2.25 * rng.chisquare(n_dof) / n_dof)
        beyond.append(np.abs(value / std).max() > largest.quantile())
    assert np.mean(beyond) == pytest.approx(0.05, abs=0.02)


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.9, 0.8]) == pytest.approx([1.0, 1.0])
