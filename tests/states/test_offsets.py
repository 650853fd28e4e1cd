"""What rows of a pass share: the likelihood against dense matrices, sizes that were put in, and nothing."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from hot_machines import gantry, two_bodies
from validation.hot_and_cold import N_POINTS, Hot, observe

from geoerr.bases import spline_over
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import FitOptions, Fitted, fit_terms, sightings_of
from geoerr.observations import Observations
from geoerr.states.blocks import blocks_of, passes_from_turns
from geoerr.states.offsets import _Likelihood, _Sums, _sums, pass_offsets, root_of_correlation

# Moments of a line, there and back, whose turn is one of them.
MOMENTS = 2 * N_POINTS - 1


def fit_of(hot: Hot, table: Observations) -> Fitted:
    ranges = {axis: np.linspace(*one.range_mm, 13) for axis, one in hot.machine.axes.items()}
    bases = {name: spline_over(name[2].lower(), ranges[name[2].lower()], 7) for name in LINEAR_AND_ANGULAR}
    return fit_terms(hot.machine, [table], options=FitOptions(bases=bases, threads=1))


def fitted(noise: str) -> Fitted:
    hot = gantry(5)
    return fit_of(hot, observe(hot, 20.0, 5, noise))


def moment_of(table: Observations) -> np.ndarray:
    return np.round(table.numbers("t")[:, 0] / 2.0).astype(np.int64)


def way_of(table: Observations) -> np.ndarray:
    """Give each row's pass by the program: 13 moments there, 12 back."""
    moment = moment_of(table)
    return 2 * (moment // MOMENTS) + (moment % MOMENTS >= N_POINTS)


def shifted(table: Observations, group: np.ndarray, size_mm: float, seed: int) -> Observations:
    """Move all rows of a group by one and the same vector."""
    _, place = np.unique(group, return_inverse=True)
    moved = table.measured_mm + np.random.default_rng(seed).normal(0.0, size_mm, (place.max() + 1, 3))[place]
    return Observations(table.frame.with_columns(mx=moved[:, 0], my=moved[:, 1], mz=moved[:, 2]))


def stands_twice_at_turns(hot: Hot, size_mm: float) -> tuple[Observations, np.ndarray]:
    """Write down both ends of both ways, each way with an offset of its own; and each row's way."""
    first, again = observe(hot, 20.0, 5), observe(hot, 20.0, 5)
    # The second look has noise of its own.
    noise = np.random.default_rng(8).normal(0.0, 1e-2, again.measured_mm.shape)
    at_turn = moment_of(again) % MOMENTS == N_POINTS - 1
    look = again.frame.with_columns(
        *(
            pl.Series(name, again.measured_mm[:, axis] + noise[:, axis])
            for axis, name in enumerate(("mx", "my", "mz"))
        ),
        t=again.frame["t"] + 1.0,
    ).filter(pl.Series(at_turn))
    marked = pl.concat(
        [
            first.frame.with_columns(way=pl.Series(way_of(first))),
            look.with_columns(way=pl.Series(way_of(again)[at_turn] + 1)),
        ],
        how="diagonal_relaxed",
    ).sort("t", maintain_order=True)
    way = marked["way"].to_numpy()
    return shifted(Observations(marked.drop("way")), way, size_mm, 9), way


@pytest.fixture(scope="module")
def shaken() -> Fitted:
    return fitted("offsets-8")


def test_the_likelihood_is_that_of_dense_matrices(shaken: Fitted) -> None:
    """Restricted likelihood of y = A u + noise, noise with covariance s² (1 + Z K Zᵀ), s² profiled."""
    sightings, n = shaken.sightings, len(shaken.sightings)
    blocks = blocks_of(sightings, sightings.pass_number, by_carrier=False)
    block = blocks.of_row
    root = root_of_correlation(blocks.correlation(1.0, 1.0, 0.0))
    gram, pull = _sums(shaken, block, len(blocks))
    noise = np.full(3, 1e-4)
    sums = _Sums(blocks, gram, pull, noise, shaken.solved.chi_squared, shaken.dof)
    likelihood = _Likelihood.of(sums, root)

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


def test_a_second_look_where_the_machine_turns_may_belong_to_the_way_back() -> None:
    """Twice the noise, from pass to pass; one row of the wrong pass would be eight of its standard deviations off."""
    hot = gantry(5)
    table, way = stands_twice_at_turns(hot, 20e-3)
    assert (passes_from_turns(sightings_of(table)) == way).all()
    fitted = fit_of(hot, table)
    assert (fitted.sightings.pass_number != way).sum() == 9 * 3
    offsets = pass_offsets(fitted)
    alike = (offsets.root @ offsets.root.T)[np.ix_(offsets.block, offsets.block)]
    same = way[:, None] == way
    assert alike[same].min() > 0.99
    assert np.abs(alike[~same]).max() < 0.01
    assert np.sqrt((offsets.std_mm**2).mean()) == pytest.approx(20e-3, rel=0.3)


def test_no_way_back_takes_a_look_of_another_line() -> None:
    """What lines are called parts passes, also where one ends as the next begins."""
    table, way = stands_twice_at_turns(gantry(5), 0.0)
    # The look at the turn is called by the line that ends there.
    named = table.frame.with_columns(line=pl.Series([str(one) for one in way]))
    ends = named.with_columns(line=pl.when(pl.col("t") % 2.0 == 1.0).then(pl.col("line").shift(3)).otherwise("line"))
    sightings = sightings_of(Observations(ends))
    assert (passes_from_turns(sightings) == sightings.pass_number).all()
    assert (sightings.pass_number != way).any()


@pytest.mark.parametrize("is_of_each_body", [True, False])
def test_offsets_of_each_body_are_told_from_those_of_the_camera(is_of_each_body: bool) -> None:
    hot = two_bodies(5)
    plain = observe(hot, 20.0, 5)
    body = np.unique(plain.frame["carrier"].to_numpy(), return_inverse=True)[1]
    way = way_of(plain)
    fitted = fit_of(hot, shifted(plain, 2 * way + body if is_of_each_body else way, 20e-3, 9))
    offsets = pass_offsets(fitted)
    alike = (offsets.root @ offsets.root.T)[np.ix_(offsets.block, offsets.block)]
    same, own = way[:, None] == way, body[:, None] == body
    assert alike[same & own].min() > 0.99
    assert alike[same & ~own] == pytest.approx(0.0 if is_of_each_body else 1.0, abs=0.01)
    assert np.abs(alike[~same]).max() < 0.01
    assert np.sqrt((offsets.std_mm**2).mean()) == pytest.approx(20e-3, rel=0.3)
