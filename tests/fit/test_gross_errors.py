"""Gross errors: named, all of them, nothing else, and without effect on the estimates."""

from __future__ import annotations

import numpy as np
import pytest
from fit_scenes import covariance_columns, fitted, measured_again, nine_lines_seen, replaced
from virtual_machine import machine_of

from geoerr.fit import Fitted
from geoerr.observations import Observations

MACHINE = machine_of("wZbXYt")


def scene(seed: int) -> tuple[Observations, np.random.Generator]:
    """Nine lines four times over, with noise."""
    rng = np.random.default_rng(seed)
    _, observations = nine_lines_seen(rng, MACHINE, n_repeats=4)
    return observations, rng


def without(observations: Observations, rows: np.ndarray) -> Observations:
    keep = np.ones(len(observations), dtype=bool)
    keep[rows] = False
    return Observations(observations.frame.filter(keep), observations.sources)


def difference_in_std(first: Fitted, second: Fitted) -> float:
    """Largest difference of a coefficient over its standard error."""
    pairs = [
        (one, two)
        for term, other in zip(first.terms, second.terms, strict=True)
        for one, two in zip(term.coefficients, other.coefficients, strict=True)
    ]
    return max(abs(one.value - two.value) / max(two.std, 1e-12) for one, two in pairs)


@pytest.mark.parametrize("seed", range(12))
def test_one_percent_of_gross_errors(seed: int) -> None:
    observations, rng = scene(200 + seed)
    n_bad = max(round(0.01 * len(observations)), 3)
    rows = rng.choice(len(observations), n_bad, replace=False)
    # Any direction; one of them in the first component only, as where one camera mismatched a column.
    blunder = rng.normal(size=(n_bad, 3))
    blunder[0] = [1.0, 0.0, 0.0]
    blunder *= (np.exp(rng.uniform(np.log(0.5), np.log(5.0), n_bad)) / np.linalg.norm(blunder, axis=1))[:, None]
    shift = np.zeros((len(observations), 3))
    shift[rows] = blunder
    result = fitted(MACHINE, measured_again(observations, shift))
    # Rows of chance beyond the limit: 1e-7 of 324.
    assert sorted(outlier.row for outlier in result.outliers) == sorted(rows.tolist())
    sizes = [np.linalg.norm(outlier.residual_um) for outlier in sorted(result.outliers, key=lambda o: o.row)]
    assert np.allclose(sizes, 1e3 * np.linalg.norm(blunder[np.argsort(rows)], axis=1), atol=40.0)
    # Leaving them out by hand is the same fit, up to where iteration stops.
    assert difference_in_std(result, fitted(MACHINE, without(observations, rows))) < 1e-3
    assert result.split.lack_of_fit_p is not None
    assert result.split.lack_of_fit_p > 1e-6


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_a_lost_decimal_point_is_left_out_before_it_turns_a_frame(factor: float) -> None:
    observations, _ = scene(2)
    measured = observations.numbers("mx")[:, 0].copy()
    measured[7] *= factor
    spoilt = fitted(MACHINE, replaced(observations, mx=measured))
    assert spoilt.sightings.left_out == {"measured far from any place that the machine reaches": 1}
    clean = fitted(MACHINE, without(observations, np.array([7])))
    assert difference_in_std(spoilt, clean) < 1e-6


def test_clean_data_lose_no_row() -> None:
    """40 fits of 324 rows: 0.001 rows beyond the limit by chance."""
    for seed in range(40):
        observations, _ = scene(300 + seed)
        assert fitted(MACHINE, observations).outliers == ()


def test_who_wants_every_row_keeps_it() -> None:
    observations, _ = scene(350)
    shift = np.zeros((len(observations), 3))
    shift[17, 2] = 2.0
    result = fitted(MACHINE, measured_again(observations, shift), is_robust=False)
    assert result.outliers == ()
    assert result.scale > 3.0


def test_noise_larger_than_stated_is_no_gross_error() -> None:
    """Stated uncertainties that are five times too small make every row improbable; none of them is a mistake."""
    observations, _ = scene(351)
    columns = {name: values / 25.0 for name, values in covariance_columns(observations).items()}
    result = fitted(MACHINE, replaced(observations, **columns))
    assert result.outliers == ()
    dof = result.split.dof[0]
    assert result.scale == pytest.approx(5.0, rel=5.0 * np.sqrt(0.5 / dof))


def test_a_mistake_among_rows_that_the_model_misses_is_one_all_the_same() -> None:
    """Twelve rows that go on a way of their own are far, and no mistakes; the one that is clearly like none is."""
    observations, _ = scene(6)
    x = observations.frame["mx"].to_numpy().copy()
    stretch = np.arange(200, 212)
    x[stretch] += 0.2 + 0.01 * np.sin(np.arange(12))
    x[206] += 3.0
    seen = fitted(MACHINE, replaced(observations, mx=x))
    assert np.flatnonzero(~seen.solved.used).tolist() == [206]
