"""Rows that state no uncertainty: their scatter told by themselves, and what a fit that is weighed so is worth."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from fit_scenes import Numbers, curve_of, fitted, measured_again, nine_lines_seen, points, replaced
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from virtual_machine import machine_of

from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.errors import GeometryError
from geoerr.fit import Fitted, sightings_of
from geoerr.fit.joined import _of_circle, _of_points
from geoerr.fit.scatter import Scatter, scatter_of
from geoerr.observations import CircularTest, Observations

MACHINE = machine_of("wZbXYt")
N_DRAWS = 60


def runs(
    rng: np.random.Generator,
    std_um: Numbers,
    *,
    n_repeats: int,
    session: str = "a",
    beside: bool = True,
    n_points: int = 21,
) -> Observations:
    """Give lines along three axes there and back, with noise (3,) and, beside it, what is no noise.

    Errors of short wave, play, an offset of each pass, a growth that differs between repeats, a turned camera.
    """
    rows, measured, columns = [], [], {"line": [], "repeat": [], "dir_x": [], "dir_y": [], "dir_z": []}
    along = np.linspace(0.0, 300.0, n_points)
    for repeat in range(n_repeats):
        for axis in range(3):
            for sense in (1, -1):
                command = np.full((n_points, 3), 100.0)
                command[:, axis] = along[::sense]
                error = np.zeros((n_points, 3))
                if beside:
                    error[:, axis] = 0.02 * np.sin(2.0 * np.pi * command[:, axis] / 31.0) + 0.03 * sense
                    error += rng.normal(size=3) * 0.02 + command * rng.normal() * 1e-4
                rows.append(command)
                measured.append(command + error + rng.normal(size=(n_points, 3)) * np.asarray(std_um) * 1e-3)
                columns["line"] += [f"{'xyz'[axis]}"] * n_points
                columns["repeat"] += [repeat] * n_points
                for name in "xyz":
                    columns[f"dir_{name}"] += [sense if name == "xyz"[axis] else 0] * n_points
    q_mm, measured_mm = np.concatenate(rows), np.concatenate(measured)
    turned = measured_mm @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if beside else measured_mm
    return points(q_mm, np.zeros_like(q_mm), turned, covariance_mm2=None, session=[session] * len(q_mm), **columns)


def told(observations: Observations) -> Scatter:
    found = scatter_of(_of_points(observations))
    assert found is not None
    return found


def circles(rng: np.random.Generator, std_um: float, *, n_points: int = 180, **columns: object) -> CircularTest:
    """Give a circle in both senses on a machine out of square."""
    frames = []
    for sense in (1, -1):
        angle = sense * np.linspace(0.0, 2.0 * np.pi, n_points, endpoint=False)
        radius = 100.0 + 0.05 * np.sin(2.0 * angle) + rng.normal(size=n_points) * std_um * 1e-3
        place = {
            "x": 150.0 + 100.0 * np.cos(angle),
            "y": 150.0 + 100.0 * np.sin(angle),
            "z": np.full(n_points, 100.0),
        }
        frames.append(pl.DataFrame({**place, "r": radius, "dir": np.full(n_points, sense), **columns}))
    return CircularTest(pl.concat(frames))


def is_within(std_mm: float, true_um: float, n_told_by: float) -> bool:
    """Tell whether a standard deviation is within six of its own standard errors."""
    return abs(np.log(std_mm * 1e3 / true_um)) < 6.0 * 2.25 / np.sqrt(2.0 * n_told_by)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    std_um=st.tuples(*[st.floats(0.3, 30.0)] * 3),
    n_repeats=st.integers(2, 5),
)
def test_scatter_of_repeats_is_the_noise_whatever_the_machine_does(
    seed: int, std_um: tuple[float, float, float], n_repeats: int
) -> None:
    found = told(runs(np.random.default_rng(seed), np.array(std_um), n_repeats=n_repeats))
    # The camera is turned: its x is the machine's y.
    seen = np.array([std_um[1], std_um[0], std_um[2]])
    are_one = found.std_mm[0].max() == found.std_mm[0].min()
    if are_one:
        # As near to each other as 1.25, or as four standard errors of a difference; what is seen is off by six more
        # at most. A component is told by a third of the numbers that tell the three together.
        error = np.sqrt(2.0) * 2.25 / np.sqrt(2.0 * found.n_told_by.min() / 3.0)
        assert np.ptp(np.log(seen)) < max(np.log(1.25), 4.0 * error) + 6.0 * error
    else:
        for std_mm, true_um, count in zip(found.std_mm[0], seen, found.n_told_by[0], strict=True):
            assert is_within(std_mm, true_um, count)


def test_the_standard_error_of_a_scatter_is_what_it_is_taken_for() -> None:
    """2.25/√(2n) for n independent pseudo-residuals' median: simulated here."""
    rng = np.random.default_rng(5)
    logs = [np.log(told(runs(rng, np.ones(3), n_repeats=2, n_points=41)).std_mm[0, 0]) for _ in range(200)]
    n_told_by = told(runs(rng, np.ones(3), n_repeats=2, n_points=41)).n_told_by[0, 0]
    # 200 draws tell a standard deviation to a twentieth.
    assert np.std(logs) * np.sqrt(2.0 * n_told_by) == pytest.approx(2.25, rel=0.25)


def test_without_repeats_lines_tell_the_scatter_of_a_device() -> None:
    rng = np.random.default_rng(6)
    coarse = runs(rng, np.full(3, 10.0), n_repeats=1, session="a", beside=False)
    fine = runs(rng, np.full(3, 1.0), n_repeats=1, session="b", beside=False)
    found = told(Observations(pl.concat([coarse.frame, fine.frame])))
    for std_mm, true_um, count in zip(found.std_mm[:, 0], (10.0, 1.0), found.n_told_by[:, 0], strict=True):
        assert is_within(std_mm, true_um, count)
    assert (found.std_mm == found.std_mm[:, :1]).all()


def test_scatter_of_a_circle_is_that_of_its_radii() -> None:
    found = scatter_of(_of_circle(circles(np.random.default_rng(7), 0.5)))
    assert found is not None
    assert is_within(found.std_mm[0, 0], 0.5, found.n_told_by[0, 0])
    assert np.isnan(found.std_mm[0, 1:]).all()


def test_gross_rows_do_not_count() -> None:
    clean = runs(np.random.default_rng(8), np.full(3, 5.0), n_repeats=3)
    at = np.arange(0, len(clean), 25)
    gross = measured_again(clean, 10.0 * np.isin(np.arange(len(clean)), at)[:, None] * np.ones(3))
    assert told(gross).std_mm[0, 0] < 1.6 * told(clean).std_mm[0, 0]


@pytest.mark.parametrize("std_um", [0.02, 0.2])
def test_readings_of_a_coarse_scale_are_known_to_its_step(std_um: float) -> None:
    """Readings to 1 µm that mostly come out the same: half a step, 0.29 µm, at least, and never nothing."""
    fine = runs(np.random.default_rng(9), np.full(3, std_um), n_repeats=3)
    coarse = replaced(fine, mx=np.round(fine.measured_mm[:, 0], 3))
    found = told(coarse)
    assert 0.28e-3 < found.std_mm[0, 0] < 0.5e-3
    assert found.std_mm[0, 1] < 1.3 * std_um * 1e-3


@pytest.mark.parametrize("n_repeats", [1, 3])
def test_rows_that_scatter_alike_are_weighed_alike(n_repeats: int) -> None:
    """Byte for byte: weights that do not matter would only add their own noise."""
    rng = np.random.default_rng(10)
    two = [runs(rng, np.full(3, 5.0), n_repeats=n_repeats, session=name) for name in "ab"]
    joined = sightings_of(*two)
    assert (joined.whitening == np.eye(3)).all()
    assert joined.notes == ()


def test_numbers_without_noise_are_weighed_alike() -> None:
    rng = np.random.default_rng(11)
    joined = sightings_of(runs(rng, np.zeros(3), n_repeats=2, beside=False), circles(rng, 0.0))
    assert set(np.unique(joined.whitening)) == {0.0, 1.0}


def test_weights_leave_the_scale_what_a_component_scatters_in_the_mean() -> None:
    rng = np.random.default_rng(12)
    joined = sightings_of(runs(rng, np.full(3, 10.0), n_repeats=3), circles(rng, 0.5))
    assert not joined.is_stated
    weight = np.einsum("nii->ni", joined.whitening)[joined.is_measured]
    assert np.mean(weight**-2.0) == pytest.approx(1.0)
    assert weight.max() / weight.min() == pytest.approx(20.0, rel=0.3)
    assert len(joined.notes) == 2
    assert all("rows are weighed by how they scatter" in note for note in joined.notes)


def test_what_nothing_tells_is_weighed_alike_and_said() -> None:
    rng = np.random.default_rng(13)
    q_mm = rng.uniform(0.0, 300.0, (40, 3))
    poses = points(q_mm, np.zeros_like(q_mm), q_mm + rng.normal(size=q_mm.shape) * 1e-2, covariance_mm2=None)
    joined = sightings_of(poses, circles(rng, 0.5))
    assert set(np.unique(joined.whitening)) == {0.0, 1.0}
    assert "all are weighed alike" in joined.notes[0]
    assert sightings_of(poses).notes == ()


def test_a_circle_beside_points_that_state_their_uncertainty_has_its_own() -> None:
    rng = np.random.default_rng(14)
    std = dict.fromkeys(("sx", "sy", "sz"), np.full(378, 0.01))
    stated = replaced(runs(rng, np.full(3, 10.0), n_repeats=3), **std)
    joined = sightings_of(stated, circles(rng, 0.5))
    radii = joined.is_measured.sum(axis=1) == 1
    assert 1.0 / joined.whitening[radii, 0, 0] == pytest.approx(0.5e-3, rel=0.3)
    assert "scatter from row to row" in joined.notes[0]


def test_points_beside_points_that_state_their_uncertainty_have_that_of_their_scatter() -> None:
    rng = np.random.default_rng(17)
    std = dict.fromkeys(("sx", "sy", "sz"), np.full(378, 0.01))
    stated = replaced(runs(rng, np.full(3, 10.0), n_repeats=3), **std)
    joined = sightings_of(stated, runs(rng, np.array([0.5, 0.5, 3.0]), n_repeats=3, session="fine"))
    assert joined.is_stated
    own = 1.0 / np.einsum("nii->ni", joined.whitening)
    assert own[:378] == pytest.approx(0.01)
    # The camera of these lines is turned: what is noisy is its third direction still.
    assert own[378] * 1e3 == pytest.approx([0.5, 0.5, 3.0], rel=0.2)
    assert "session fine 0.5" in joined.notes[0]


def test_points_that_nothing_tells_are_refused_beside_points_that_state_their_uncertainty() -> None:
    rng = np.random.default_rng(18)
    q_mm = rng.uniform(0.0, 300.0, (40, 3))
    poses = points(q_mm, np.zeros_like(q_mm), q_mm + rng.normal(size=q_mm.shape) * 1e-2, covariance_mm2=None)
    std = dict.fromkeys(("sx", "sy", "sz"), np.full(378, 0.01))
    with pytest.raises(GeometryError, match="or measure those passes again"):
        sightings_of(replaced(runs(rng, np.full(3, 10.0), n_repeats=3), **std), poses)


@pytest.fixture(scope="module")
def two_devices() -> list[Fitted]:
    """Fits to nine lines seen by a camera of 10 µm and again by one of 0.5 µm, none of which states it."""
    rng = np.random.default_rng(15)
    _, exact = nine_lines_seen(rng, MACHINE, has_noise=False, n_repeats=2)
    bare = Observations(exact.frame.drop("cxx", "cxy", "cxz", "cyy", "cyz", "czz"))
    coarse, fine = bare, replaced(bare, session=["fine"] * len(bare))
    fits = []
    for _ in range(N_DRAWS):
        noise = [rng.normal(size=(len(bare), 3)) * std_mm for std_mm in (0.010, 0.0005)]
        tables = [measured_again(one, own) for one, own in zip((coarse, fine), noise, strict=True)]
        fits.append(fitted(MACHINE, *tables))
    return fits


@pytest.mark.parametrize("name", [*LINEAR_AND_ANGULAR])
def test_standard_errors_of_two_unlike_devices_are_their_scatter(two_devices: list[Fitted], name: str) -> None:
    drawn = [curve_of(one, name, np.array([400.0])) for one in two_devices]
    value, std = (np.array(column)[:, 0] for column in zip(*drawn, strict=True))
    ratio = value.var(ddof=1) / (std**2).mean()
    low, high = stats.chi2.ppf([1e-5, 1.0 - 1e-5], N_DRAWS - 1) / (N_DRAWS - 1)
    assert low < ratio < high


def test_the_better_device_decides(two_devices: list[Fitted]) -> None:
    """Of positioning the fine camera alone has 0.5 µm by so many rows; held alike both had fourteen times that."""
    std_um = np.mean([curve_of(one, "EXX", np.array([400.0]))[1][0] for one in two_devices]) * 1e3
    assert std_um < 0.5


@pytest.mark.parametrize(("claimed_um", "used_um"), [(0.5, 1.5), (1.5, 1.5), (15.0, 15.0)])
def test_a_device_that_states_less_than_it_scatters_gets_its_scatter(claimed_um: float, used_um: float) -> None:
    """Beside one that states what it scatters; one that states more may know of more than scatters."""
    rng = np.random.default_rng(19)
    honest, other = (
        replaced(
            runs(rng, np.full(3, std_um), n_repeats=3, session=name),
            **dict.fromkeys(("sx", "sy", "sz"), np.full(378, stated_um * 1e-3)),
        )
        for name, std_um, stated_um in (("honest", 10.0, 10.0), ("other", 1.5, claimed_um))
    )
    joined = sightings_of(honest, other)
    own_um = 1e3 / np.einsum("nii->ni", joined.whitening)
    assert own_um[:378] == pytest.approx(10.0)
    assert own_um[378:] == pytest.approx(used_um, rel=0.15)
    told = [note for note in joined.notes if "than is stated" in note]
    assert [note.split(" than")[0] for note in told] == {0.5: ["rows scatter more"], 15.0: ["rows scatter less"]}.get(
        claimed_um, []
    )


def test_what_all_devices_scatter_more_than_stated_is_the_scale_of_the_fit() -> None:
    rng = np.random.default_rng(20)
    tables = [
        replaced(
            runs(rng, np.full(3, std_um), n_repeats=3, session=name),
            **dict.fromkeys(("sx", "sy", "sz"), np.full(378, std_um / 3.0 * 1e-3)),
        )
        for name, std_um in (("one", 10.0), ("other", 1.5))
    ]
    joined = sightings_of(*tables)
    assert 1e3 / joined.whitening[:378, 0, 0] == pytest.approx(10.0 / 3.0)
    assert 1e3 / joined.whitening[378:, 0, 0] == pytest.approx(0.5)
