"""Combination and expansion of variances, against numbers by hand and against Monte-Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from geoerr.budget.combine import effective_dof, expanded, expanded_length
from geoerr.budget.implementation import Implementation
from geoerr.errors import GeometryError


def test_gum_example_of_end_gauges() -> None:
    """GUM H.1.6: components of an end gauge's length, ν_eff = 16 (floor of 16.7), k = 2.92 at 99 %."""
    std_nm, dof = np.array([25.0, 9.7, 2.9, 16.6]), [18.0, 25.6, 50.0, 2.0]
    found = effective_dof([np.array([u**2]) for u in std_nm], dof)
    assert np.floor(found[0]) == 16.0
    assert stats.t.isf(0.005, 16) == pytest.approx(2.92, abs=0.005)


def test_exact_sources_have_no_end_of_freedom() -> None:
    assert effective_dof([np.array([1.0]), np.array([2.0])], [np.inf, np.inf])[0] == np.inf
    # One estimated source that is all: its own.
    assert effective_dof([np.array([4.0]), np.array([0.0])], [7.0, np.inf])[0] == pytest.approx(7.0)


def test_a_length_in_one_direction_is_a_component() -> None:
    direction = np.array([0.36, 0.48, 0.8])
    covariance = 9.0 * np.outer(direction, direction)[None]
    for dof in (4.0, 30.0, np.inf):
        assert expanded_length(covariance, np.array([dof]))[0] == pytest.approx(
            expanded(np.array([3.0]), dof)[0], rel=1e-6
        )


@pytest.mark.parametrize("sizes", [(1, 1, 1), (1, 0.5, 0.25), (1, 1, 0), (1, 0.1, 0.1), (1, 0.4, 0.0), (1, 0.9, 0.3)])
def test_lengths_of_any_shape_are_right_to_one_percent(sizes: tuple[float, float, float]) -> None:
    """10⁶ draws: the quantile itself is known to 0.2 % (density 0.05 to 0.3 at it, √(pq/n) = 2·10⁻⁴)."""
    rng = np.random.default_rng(1)
    length = np.linalg.norm(rng.standard_normal((1_000_000, 3)) * sizes, axis=1)
    found = expanded_length(np.diag(np.square(sizes))[None].astype(float), np.array([np.inf]))[0]
    assert found == pytest.approx(np.quantile(length, 0.95), rel=0.01)


def test_implementation_in_numbers_by_hand() -> None:
    """Step 0.01 mm: 0.01/√12 each component; a distance of at most 6 µm: mean square 12 µm², 4 µm² a component."""
    sources = {
        source.name: source for source in Implementation(0.0, 0.006, digits=2, controller_step_mm=0.0125).sources()
    }
    assert sources["rounding"].std == pytest.approx(10.0 / np.sqrt(12.0))
    assert sources["controller"].std == pytest.approx(12.5 / np.sqrt(12.0))
    assert sources["chord"].std == pytest.approx(np.sqrt(12.0))
    root = sources["chord"].everywhere_mm
    assert root is not None
    assert np.trace(root @ root.T) == pytest.approx(12e-6)
    assert {source.kind for source in sources.values()} == {"B"}
    assert "controller" not in {source.name for source in Implementation().sources()}


@pytest.mark.parametrize("name", ["rounding", "chord"])
def test_draws_have_the_stated_covariance(name: str) -> None:
    """Bounded draws: mean square within 4 σ of 1, σ = √(1/n) at most, and never beyond their bounds."""
    source = next(source for source in Implementation().sources() if source.name == name)
    draws = source.draw(np.random.default_rng(2), 40_000, 3)
    assert np.abs(draws.T @ draws / len(draws) - np.eye(3)).max() < 4.0 * np.sqrt(1.8 / len(draws))
    limit = np.abs(draws).max() if name == "rounding" else np.linalg.norm(draws, axis=1).max()
    assert limit <= (np.sqrt(3.0) if name == "rounding" else 3.0)


@pytest.mark.parametrize("changes", [{"tolerance_mm": -1.0}, {"newton_tolerance_mm": np.nan}])
def test_what_is_no_length_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(GeometryError, match="not a length in mm"):
        Implementation(**changes)
