"""What rows of a pass share: the likelihood against dense matrices, sizes that were put in, and nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hot_machines import gantry
from validation.hot_and_cold import observe

from geoerr.bases import spline_over
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.states.offsets import _blocks, _Likelihood, _sums, pass_offsets, root_of_correlation


def fitted(noise: str) -> Fitted:
    hot = gantry(5)
    ranges = {axis: np.linspace(*one.range_mm, 13) for axis, one in hot.machine.axes.items()}
    bases = {name: spline_over(name[2].lower(), ranges[name[2].lower()], 7) for name in LINEAR_AND_ANGULAR}
    table = observe(hot, 20.0, 5, noise)
    return fit_terms(hot.machine, [table], options=FitOptions(bases=bases, threads=1))


@pytest.fixture(scope="module")
def shaken() -> Fitted:
    return fitted("offsets-8")


def test_the_likelihood_is_that_of_dense_matrices(shaken: Fitted) -> None:
    """Restricted likelihood of y = A u + noise, noise with covariance s² (1 + Z K Zᵀ), s² profiled."""
    sightings, n = shaken.sightings, len(shaken.sightings)
    block, pass_of, _, _ = _blocks(sightings)
    root = root_of_correlation((pass_of[:, None] == pass_of).astype(np.float64))
    gram, pull = _sums(shaken, block, len(pass_of))
    noise = np.full(3, 1e-4)
    likelihood = _Likelihood.of(gram, pull, root, noise, shaken.solved.chi_squared, shaken.dof)

    problem = shaken.problem
    design = problem.design(shaken.solved.state, np.ones(n), 0, n, 1)
    left, size, _ = np.linalg.svd(design, full_matrices=False)
    taken = left[:, size > 1e-9 * size[0]]
    # A gauge only names what the columns already span.
    members = np.zeros((n, 3, 3, root.shape[1]))
    for row in range(n):
        members[row, :, :, :] = sightings.whitening[row][:, :, None] * root[block[row]]
    whitened = shaken.solved.whitened.ravel()
    whitened = whitened - taken @ (taken.T @ whitened)

    def dense(log_ratio: np.ndarray) -> float:
        scaled = members * np.sqrt(noise * np.exp(log_ratio))[None, None, :, None]
        columns = scaled.reshape(3 * n, -1)
        outside = columns - taken @ (taken.T @ columns)
        inner = np.eye(columns.shape[1]) + outside.T @ outside
        sums = outside.T @ whitened
        left_over = whitened @ whitened - sums @ np.linalg.solve(inner, sums)
        return float(shaken.dof * np.log(left_over) + np.linalg.slogdet(inner)[1])

    first, second = np.array([0.3, -0.5, -1.0]), np.array([-2.0, 1.0, 0.0])
    assert likelihood(first) - likelihood(second) == pytest.approx(dense(first) - dense(second), rel=1e-5)


def test_offsets_that_were_put_in_are_found(shaken: Fitted) -> None:
    """8 µm on each axis, from 18 passes: a variance known to about 2/√(2·12)."""
    offsets = pass_offsets(shaken)
    assert np.sqrt((offsets.std_mm**2).mean()) == pytest.approx(8e-3, rel=0.3)
    assert 15.0 < offsets.dof < 54.0
    rows = np.arange(0, len(shaken.sightings), 37)
    moved = offsets.sensitivity(shaken, len(shaken.sightings))[rows]
    block = offsets.block[rows]
    alike = (offsets.root @ offsets.root.T)[np.ix_(block, block)]
    expected = alike[:, None, :, None] * np.diag(offsets.std_mm**2)[None, :, None, :]
    assert np.einsum("nak,mbk->namb", moved, moved) == pytest.approx(expected, abs=1e-12)
    passes = shaken.sightings.pass_number[rows]
    same = passes[:, None] == passes
    assert alike[same].min() > 0.5
    assert np.abs(alike[~same]).mean() < 0.5


def test_where_rows_are_independent_next_to_nothing_is_found() -> None:
    assert (pass_offsets(fitted("gauss-10")).std_mm < 2e-3).all()
