"""What an angle does between places: nothing where they resolve it, and honest where they do not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from geoerr.geometry import integrate_straightness, remove_line
from geoerr.identify.between_places import integral_covariance

Numbers = npt.NDArray[np.float64]
LENGTH_MM = 400.0
STD_RAD = 2e-6


def waves(rng: np.random.Generator, turns: float) -> Callable[[Numbers], Numbers]:
    """Three angles of waves, (3, n) at n positions."""
    phase, size = rng.uniform(0.0, 2.0 * np.pi, (3, 1)), rng.uniform(2e-4, 5e-4, (3, 1))
    return lambda position_mm: np.asarray(size * np.sin(2.0 * np.pi * turns * position_mm / LENGTH_MM + phase))


def covariances(places: Numbers) -> list[Numbers | None]:
    return [STD_RAD**2 * np.eye(len(places))] * 3


@pytest.mark.parametrize("turns", [0.5, 1.0, 2.0])
def test_places_that_resolve_the_curves_add_nothing(turns: float) -> None:
    places = np.sort(np.random.default_rng(1).uniform(0.0, LENGTH_MM, 41))
    rng = np.random.default_rng(2)
    seen = waves(rng, turns)(places) + STD_RAD * rng.normal(size=(3, len(places)))
    added = integral_covariance(places, list(seen), covariances(places))
    assert 1e3 * np.sqrt(np.diag(added)).max() < 0.5


def test_parabolas_add_nothing_however_few_the_places() -> None:
    places = np.array([0.0, 90.0, 250.0, 400.0])
    curves = [5e-4 * (places / LENGTH_MM) ** 2, 1e-3 * places / LENGTH_MM]
    exact: list[Numbers | None] = [1e-20 * np.eye(4)] * 2
    assert not integral_covariance(places, curves, exact).any()


def test_a_few_places_tell_how_little_they_tell() -> None:
    """Curves of one to two turns at 5 places: the integral's error is within what is stated, not far within."""
    places = np.linspace(0.0, LENGTH_MM, 5)
    dense = np.linspace(0.0, LENGTH_MM, 4001)
    rng = np.random.default_rng(3)
    p_values, ratios = [], []
    for _ in range(200):
        angles = waves(rng, rng.uniform(1.0, 2.0))
        curves, at_places = angles(dense), angles(places)
        added = integral_covariance(places, list(at_places), covariances(places))
        truth = integrate_straightness(dense, np.ascontiguousarray(curves[0]), rule="simpson")[::1000]
        told = integrate_straightness(places, np.ascontiguousarray(at_places[0]), rule="simpson")
        error = remove_line(places, truth - told)
        spread, direction = np.linalg.eigh(added)
        kept = spread > 1e-9 * spread[-1]
        assert kept.sum() == 3
        p_values.append(stats.chi2.sf(((direction[:, kept].T @ error) ** 2 / spread[kept]).sum(), 3))
        ratios.append(float((error**2).sum() / np.trace(added)))
    assert np.mean(np.array(p_values) < 0.01) < 0.05
    assert 0.05 < np.mean(ratios) < 1.0


def test_what_has_no_covariance_says_nothing() -> None:
    places = np.linspace(0.0, LENGTH_MM, 4)
    curve = waves(np.random.default_rng(4), 2.0)(places)
    assert not integral_covariance(places, list(curve), [None] * 3).any()
    assert not integral_covariance(places, [], []).any()
    assert not integral_covariance(places[:2], list(curve[:, :2]), [np.eye(2)] * 3).any()
