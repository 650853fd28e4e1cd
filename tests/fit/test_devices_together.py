"""Cameras beside a laser: each states its uncertainty in its way, and a rig moves the points of its cameras alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from fit_scenes import cubic_truth, seen
from virtual_machine import LENGTH_MM, Camera, machine_of

from geoerr.diagnose.comparison import compare
from geoerr.errors import GeometryError, ShapeError
from geoerr.fit import fit_model, sightings_of
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns
from geoerr.vision.rig import Rig, RightFromLeft
from geoerr.vision.sensitivity import project_to_both, rig_sensitivity

MACHINE = machine_of("wYbXZt")
PIXELS = ("u_left", "v_left", "u_right", "v_right")
N_SEEN, N_BY_LASER = 120, 60
# Before the machine, looking along its y axis.
VIEW = Camera(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.array([-200.0, 100.0, 900.0]))


def by_cameras(seed: int = 1) -> Observations:
    """Places anywhere, seen to 20 µm, covariances stated."""
    rng = np.random.default_rng(seed)
    rows = [("relative", rng.uniform(0.0, LENGTH_MM, 3), (0.0, 0.0, 0.0)) for _ in range(N_SEEN)]
    truth = cubic_truth(rng, angle_rad=0.0, delta_mm=0.0, s_rad=0.0)
    return seen(MACHINE, truth, VIEW, rows, rng, covariance_mm2=np.eye(3) * 4e-4, session=["cameras"] * N_SEEN)


def by_laser(std_mm: float = 3e-4, seed: int = 2, **columns: object) -> Observations:
    """A run along x, there and back and again, of a machine without errors; only mx is measured."""
    rng = np.random.default_rng(seed)
    place = np.tile(np.concatenate([np.linspace(0.0, LENGTH_MM, 15), np.linspace(LENGTH_MM, 0.0, 15)]), 2)
    still = np.full(N_BY_LASER, 100.0)
    measured = place + std_mm * rng.standard_normal(N_BY_LASER)
    return observations_from_columns(
        {
            **{"session": "laser", "line": "x", "repeat": np.repeat([0, 1], 30), "carrier": "relative"},
            **{"x": place, "y": still, "z": still, "mx": measured, "my": np.nan, "mz": np.nan},
            **columns,
        }
    )


def together(*tables: Observations) -> Observations:
    return Observations(pl.concat([table.frame for table in tables], how="diagonal_relaxed"))


def stated_um(observations: Observations, session: str) -> float:
    """Median of what the rows of a session are weighed by, along x."""
    sightings = sightings_of(observations)
    own = np.array(sightings.sessions)[sightings.session] == session
    return float(1e3 * np.median(1.0 / sightings.whitening[own, 0, 0]))


def test_each_row_has_what_it_states_covariance_or_standard_uncertainty() -> None:
    both = together(by_cameras(), by_laser(sx=3e-4, sy=np.nan, sz=np.nan))
    assert stated_um(both, "cameras") == pytest.approx(20.0)
    assert stated_um(both, "laser") == pytest.approx(0.3)
    assert not [note for note in sightings_of(both).notes if "no uncertainty" in note]


@pytest.mark.parametrize("is_first", [True, False])
def test_a_session_that_states_nothing_has_its_own_scatter(is_first: bool) -> None:
    tables = (by_laser(), by_cameras()) if is_first else (by_cameras(), by_laser())
    both = together(*tables)
    sightings = sightings_of(both)
    assert sightings.sessions == (("laser", "cameras") if is_first else ("cameras", "laser"))
    assert stated_um(both, "cameras") == pytest.approx(20.0)
    # From the mean of the others it would have 20 µm.
    assert stated_um(both, "laser") == pytest.approx(0.3, rel=0.4)
    np.testing.assert_array_equal(sightings.commanded_mm, both.commanded_mm[sightings.source_row])


def test_a_session_too_short_to_tell_its_scatter_has_the_mean_of_the_others() -> None:
    short = by_laser()
    both = together(by_cameras(), short.select(np.arange(len(short)) < 3))
    assert stated_um(both, "laser") == pytest.approx(20.0)
    assert any("3 rows state no uncertainty" in note for note in sightings_of(both).notes)


def rig_and_pixels(observations: Observations) -> tuple[Rig, Observations]:
    """A rig with a baseline known to 1 in 1000, and where it saw the points."""
    matrix = np.array([[2300.0, 0.0, 1224.0], [0.0, 2300.0, 1024.0], [0.0, 0.0, 1.0]])
    pose = RightFromLeft(np.eye(3), np.array([-300.0, 0.0, 0.0]))
    plain = Rig(matrix, np.zeros(5), matrix, np.zeros(5), pose, (2448, 2048), None)
    variance = np.zeros(len(plain.parameter_names))
    variance[plain.parameter_names.index("t_x_mm")] = 0.3**2
    rig = replace(plain, covariance=np.diag(variance))
    pixels = project_to_both(rig, observations.measured_mm).pixel
    frame = observations.frame.with_columns(**{name: pl.Series(pixels[:, i]) for i, name in enumerate(PIXELS)})
    return rig, Observations(frame)


def test_a_rig_moves_the_points_of_its_cameras_alone() -> None:
    """The laser tells the scale along x that a baseline known to 1 in 1000 leaves open, and so the cameras' own."""
    rig, shown = rig_and_pixels(by_cameras())
    both = together(shown, by_laser(sx=3e-4, sy=np.nan, sz=np.nan))
    sensitivity = rig_sensitivity(rig, both)
    assert not sensitivity[N_SEEN:].any()
    assert np.isfinite(sensitivity).all()
    effects = ["scale:x", "scale:y", "scale:z"]
    for table, low, high in ((shown, 8e-4, 1.2e-3), (both, 0.0, 5e-6)):
        own = sensitivity[: len(table)]
        result = fit_model(
            MACHINE, table, components="none", effects=effects, rig_sensitivity=own, rig_covariance=rig.covariance
        )
        of_x, of_y, _ = (term.coefficients[0].std for term in result.model.terms)
        assert low <= of_x <= high
        if table is shown:
            assert of_y == pytest.approx(of_x, rel=0.05)
    # One scale for all three axes: what is known of x is known of y.
    assert of_y < 5e-5


def test_a_row_of_the_cameras_without_pixels_is_refused() -> None:
    rig, shown = rig_and_pixels(by_cameras())
    frame = shown.frame.with_columns(
        u_left=pl.when(pl.int_range(pl.len()) == 3).then(None).otherwise(pl.col("u_left"))
    )
    holed = Observations(frame)
    with pytest.raises(GeometryError, match="some rows of a session that cameras saw have no pixels"):
        fit_model(
            MACHINE,
            holed,
            components="none",
            effects=["scale:x"],
            rig_sensitivity=rig_sensitivity(rig, holed),
            rig_covariance=rig.covariance,
        )


def test_a_calibration_that_is_none_is_refused() -> None:
    rig, shown = rig_and_pixels(by_cameras())
    moved, known = rig_sensitivity(rig, shown), rig.covariance
    assert known is not None
    not_symmetric = known + np.triu(np.full_like(known, 1e-3), 1)
    cases = {
        "belong together": (None, known),
        "one of them is missing": (moved, None),
        r"rig_sensitivity has shape \(7, 3, ": (moved[:7], known),
        "a square matrix is needed": (moved, np.diag(known)),
        "negative eigenvalue": (moved, -known),
        "not symmetric": (moved, not_symmetric),
        "no finite numbers": (moved, np.full_like(known, np.nan)),
    }
    for words, (sensitivity, covariance) in cases.items():
        given = {"rig_sensitivity": sensitivity, "rig_covariance": covariance}
        with pytest.raises(ShapeError, match=words):
            fit_model(MACHINE, shown, components="none", effects=["scale:x"], **given)
        with pytest.raises(ShapeError, match=words):
            compare(Model(MACHINE), shown, **given)


def test_a_laser_without_a_session_of_its_own_is_told() -> None:
    """Its numbers were put into the cameras' turned frame: residuals of millimetres came without a word."""
    in_one = together(by_cameras(), by_laser(session="cameras"))
    told = [note for note in sightings_of(in_one).notes if "session of its own" in note]
    assert [note.split(" (")[0] for note in told] == ["in session 'cameras' 60 rows of passes with mx alone"]
    assert not [note for note in sightings_of(together(by_cameras(), by_laser())).notes if "of its own" in note]


def test_points_that_cameras_saw_in_part_are_not_told() -> None:
    seen_in_part = by_cameras()
    frame = seen_in_part.frame.with_row_index("row").with_columns(
        mz=pl.when(pl.col("row") % 7 == 0).then(None).otherwise(pl.col("mz"))
    )
    assert not [note for note in sightings_of(replace(seen_in_part, frame=frame)).notes if "of its own" in note]
