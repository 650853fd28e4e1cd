"""What chance finds in one search and in the best of several."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from geoerr.diagnose.null import N_DRAWS, Null, p_value_of_all

# Candidates are few, probes of many kinds.
SIZES = (60, 4000)


def _largest(rng: np.random.Generator, n_trials: int, n_searches: int) -> np.ndarray:
    """Largest surprises of so many searches where nothing is: of n uniform numbers the smallest, as −ln."""
    return -np.log(-np.expm1(np.log1p(-rng.uniform(size=n_searches)) / n_trials))


def test_the_best_of_unequal_searches_is_as_rare_as_it_says() -> None:
    rng = np.random.default_rng(11)
    p_values = []
    for _ in range(1000):
        drawn = [_largest(rng, size, N_DRAWS + 1) for size in SIZES]
        p_values.append(p_value_of_all([(Null(own[1:]), float(own[0])) for own in drawn]))
    assert stats.kstest(p_values, "uniform").pvalue > 0.01
    assert np.mean(np.array(p_values) <= 0.05) == pytest.approx(0.05, abs=0.02)


def test_what_is_rare_in_the_smaller_search_is_rare_in_all() -> None:
    """A name passes at half the level in its own search, and so does the whole at the level."""
    rng = np.random.default_rng(12)
    few, many = (Null(_largest(rng, size, N_DRAWS)) for size in SIZES)
    surprise = float(np.quantile(few.largest, 0.985))
    ordinary = float(np.median(many.largest))
    own = few.p_value(surprise)
    assert own <= 0.025
    assert own <= p_value_of_all([(few, surprise), (many, ordinary)]) <= 0.06
    assert Null(np.maximum(few.largest, many.largest)).p_value(max(surprise, ordinary)) > 0.2


def test_a_search_of_nothing_takes_no_part() -> None:
    rng = np.random.default_rng(13)
    few = Null(_largest(rng, SIZES[0], N_DRAWS))
    nothing = Null(np.full(N_DRAWS, -math.inf))
    assert p_value_of_all([(few, 30.0), (nothing, -math.inf)]) == pytest.approx(few.p_value(30.0), rel=1e-9)
    assert p_value_of_all([(nothing, -math.inf)]) == 1.0


def test_what_chance_has_two_searches_for_is_twice_as_likely() -> None:
    rng = np.random.default_rng(8)
    one = Null(_largest(rng, SIZES[0], N_DRAWS))
    two = replace(one, n_searches=2)
    found = float(np.quantile(one.largest, 0.99))
    assert two.p_value(found) == 2.0 * one.p_value(found)
    assert two.p_value(float(one.largest.min())) == 1.0
    assert p_value_of_all([(two, found)]) == 2.0 * p_value_of_all([(one, found)])
