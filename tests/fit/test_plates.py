"""650 holes that a mill drilled in a plate, measured on a CMM in X and Y: what one plane tells, and what it cannot.

The plate lies on the CMM turned by some 70 µrad, which is the measuring frame's and no error of the machine: it is
fitted along as what it is, a turn of the rig about Z.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geoerr
from geoerr.diagnose import diagnose
from geoerr.error_functions import LINEAR_AND_ANGULAR, SQUARENESS
from geoerr.fit import FitResult, Fitted
from geoerr.fit.classic import Components
from geoerr.terms import BasisSpec

pytestmark = pytest.mark.real_data

AFFINE = ("scale:x", "scale:y", "squareness:xy")


@pytest.fixture(scope="module")
def plate(real_data: Path) -> tuple[geoerr.Machine, geoerr.Observations]:
    folder = real_data / "plates"
    return geoerr.read_machine(folder / "machine.toml"), geoerr.read_observations(folder / "observations.csv")


@pytest.fixture(scope="module")
def affine(plate: tuple[geoerr.Machine, geoerr.Observations]) -> FitResult:
    machine, observations = plate
    return geoerr.fit_model(machine, observations, components="none", effects=AFFINE)


@pytest.fixture(scope="module")
def whole(plate: tuple[geoerr.Machine, geoerr.Observations]) -> FitResult:
    machine, observations = plate
    return geoerr.fit_model(machine, observations, components="21")


def per_component_um(rms_um: tuple[float | None, float | None, float | None]) -> float:
    """Pool x and y; z was not measured."""
    x_um, y_um, z_um = rms_um
    assert x_um is not None
    assert y_um is not None
    assert z_um is None
    return float(np.hypot(x_um, y_um) / np.sqrt(2.0))


def at_random_um(fitted: Fitted, seed: int) -> float:
    """Hold holes out at random, in ten folds."""
    fold = np.random.default_rng(seed).permutation(len(fitted.sightings)) % 10
    return held_out_um(fitted, fold)


def by_strips_um(fitted: Fitted) -> float:
    """Hold out ten strips across the direction in which the plate is longest: the outer two are extrapolated."""
    centred = fitted.sightings.commanded_mm - fitted.sightings.commanded_mm.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    fold = np.argsort(np.argsort(along, kind="stable"), kind="stable") * 10 // len(along)
    return held_out_um(fitted, fold)


def by_squares_um(fitted: Fitted) -> float:
    """Hold out squares of a 4 by 4 grid."""
    return held_out_um(fitted, squares_of(fitted.sightings.commanded_mm))


def squares_of(commanded_mm: np.ndarray) -> np.ndarray:
    x, y, _ = commanded_mm.T
    edges = np.linspace(-330.0, 330.0, 5)[1:-1]
    return np.asarray(4 * np.digitize(x, edges) + np.digitize(y, edges))


def held_out_um(fitted: Fitted, fold: np.ndarray) -> float:
    held = fitted.leave_out(fold)
    assert held.n_not_computable == 0
    assert held.figures is not None
    return per_component_um(held.figures.rms_per_component_um)


def test_scale_and_squareness_leave_what_an_affine_map_leaves(
    plate: tuple[geoerr.Machine, geoerr.Observations], affine: FitResult
) -> None:
    """Three axes' worth of linear errors and a rigid motion are the affine maps of the plane: NumPy's answer."""
    _, observations = plate
    q, p = observations.commanded_mm[:, :2], observations.measured_mm[:, :2]
    design = np.column_stack([q, np.ones(len(q))])
    left = p - design @ np.linalg.lstsq(design, p, rcond=None)[0]
    expected_um = float(np.sqrt(np.mean(left**2))) * 1e3
    found_um = per_component_um(affine.fitted.figures.rms_per_component_um)
    assert found_um == pytest.approx(expected_um, abs=1e-3)
    assert found_um == pytest.approx(3.7, abs=0.05)


def test_scale_and_squareness_have_their_sizes(affine: FitResult) -> None:
    scale = {axis: affine.model.parameter(f"scale:{axis}.k") for axis in "xy"}
    mean = 0.5 * (scale["x"].value + scale["y"].value)
    assert mean == pytest.approx(-34e-6, abs=3e-6)
    squareness = affine.model.parameter("squareness:xy.S")
    assert abs(squareness.value) == pytest.approx(64e-6, abs=3.0 * squareness.std)
    slopes = affine.model.mean_scales()
    assert slopes["x"].value == pytest.approx(scale["x"].value, rel=1e-9)


def test_standard_errors_are_those_of_squares_left_out(
    plate: tuple[geoerr.Machine, geoerr.Observations], affine: FitResult
) -> None:
    """What neighbours share is no scatter: were holes independent, errors would be told 3 to 4 times too small."""
    _, observations = plate
    q, p = observations.commanded_mm[:, :2], observations.measured_mm[:, :2]

    def linear(rows: np.ndarray) -> np.ndarray:
        design = np.column_stack([q[rows], np.ones(int(rows.sum()))])
        (xx, yx), (xy, yy) = np.linalg.lstsq(design, p[rows], rcond=None)[0][:2]
        return np.array([xx, yy, xy + yx])

    square = squares_of(observations.commanded_mm)
    left_out = np.array([linear(square != one) for one in np.unique(square)])
    # Jackknife (Tukey 1958).
    jackknife = np.sqrt((len(left_out) - 1) ** 2 / len(left_out)) * left_out.std(axis=0, ddof=1)
    told = [affine.model.parameter(name).std for name in ("scale:x.k", "scale:y.k", "squareness:xy.S")]
    assert (np.abs(np.log2(told / jackknife)) < 1.0).all()


def test_functions_of_the_axes_and_yaw_predict_holes_that_they_have_not_seen(
    affine: FitResult, whole: FitResult
) -> None:
    assert np.mean([at_random_um(whole.fitted, seed) for seed in range(3)]) < 3.0
    assert by_squares_um(whole.fitted) < 3.4
    assert by_squares_um(affine.fitted) > 3.6


def test_polynomials_of_the_axes_and_yaw_predict_strips_at_the_rim(
    plate: tuple[geoerr.Machine, geoerr.Observations],
) -> None:
    """Cubics may be extrapolated a little; splines, whose outer functions only the rim's holes determine, may not."""
    machine, observations = plate
    range_mm = {
        axis: (values.min(), values.max()) for axis, values in zip("xy", observations.commanded_mm.T, strict=False)
    }
    bases = {
        f"E{letter}{axis.upper()}": BasisSpec("polynomial", axis, degree=3, low_mm=float(low), high_mm=float(high))
        for axis, (low, high) in range_mm.items()
        for letter in "XYZABC"
    }
    options = geoerr.FitOptions(bases=bases)
    cubics = geoerr.fit_model(machine, observations, options=options).fitted
    assert by_strips_um(cubics) < 3.4
    assert by_squares_um(cubics) < 3.4
    assert np.mean([at_random_um(cubics, seed) for seed in range(3)]) == pytest.approx(3.0, abs=0.05)


def test_yaw_of_x_is_worth_something(plate: tuple[geoerr.Machine, geoerr.Observations], whole: FitResult) -> None:
    machine, observations = plate
    flat = geoerr.fit_model(machine, observations, components="12")
    assert at_random_um(whole.fitted, 0) < at_random_um(flat.fitted, 0)


def test_mean_scale_of_the_whole_model(whole: FitResult) -> None:
    """The slope of the curve that the data chose: of both axes together −34 ± 3 in 10⁶."""
    scales = whole.model.mean_scales()
    assert 0.5 * (scales["x"].value + scales["y"].value) == pytest.approx(-34e-6, abs=3e-6)


def test_what_one_plane_cannot_determine_is_listed(whole: FitResult) -> None:
    """wXYbZt, both axes under the plate, z parked and not measured. From docs/theory/equations.md:

    - Z never moved: its six, and its two squarenesses (S_xz·z, S_yz·z at one z are a translation).
    - δ_zx, δ_zy lie along z.
    - A turn ε acts on (x, y, 0) from X, which carries Y (on (0, y, 0) from Y): ε_x and ε_y move it along z only, so
      roll and pitch of X and of Y are not seen; ε_zx (−y, x) is: the error along x is a product of x and y, which no
      other error has.
    - ε_zy acts on (0, y, 0): −y·ε_zy(y) along x, a function of y as δ_xy is; with ε_zy free, S_xy·y is one more such.
    """
    lost = {item.name for item in whole.fitted.not_determined}
    of_z = {f"E{letter}Z" for letter in "XYZABC"}
    assert lost == of_z | {"EB0Z", "EA0Z", "EZX", "EZY", "EAX", "EBX", "EAY", "EBY", "EXY", "ECY", "EC0Y"}
    assert set(LINEAR_AND_ANGULAR + SQUARENESS) - lost == {"EXX", "EYX", "ECX", "EYY"}
    reasons = {item.name: item.why for item in whole.fitted.not_determined}
    assert all(reasons[name] == "the z axis never moved" for name in of_z)
    assert "ECY" in reasons["EXY"]
    assert "EXY" in reasons["ECY"]
    assert {"EXY", "ECY"} <= set(reasons["EC0Y"].replace(",", "").split())


def test_without_angles_squareness_is_determined(plate: tuple[geoerr.Machine, geoerr.Observations]) -> None:
    machine, observations = plate
    flat = geoerr.fit_model(machine, observations, components="12")
    lost = {item.name for item in flat.fitted.not_determined}
    assert lost == {"EXZ", "EYZ", "EZZ", "EZX", "EZY", "EB0Z", "EA0Z"}
    squareness = flat.model.parameter("S_xy.S")
    assert abs(squareness.value) == pytest.approx(64e-6, abs=4.0 * squareness.std)


def test_a_diagnosis_finds_yaw_and_no_screw(plate: tuple[geoerr.Machine, geoerr.Observations]) -> None:
    """Of twelve components the plate lacks a coupling of both axes and the yaw of X, which lowers the held-out error.

    Over few turns a smooth error is a wave: what was left of the straightness had the name of a screw of 196 mm.
    """
    machine, observations = plate
    twelve = geoerr.fit_model(machine, observations, components="12")
    diagnosis = diagnose(twelve.model, observations)
    names = [str(one.reference) for one in diagnosis.found]
    assert names in (["cross-coupling:x*y", "angular:x"], ["cross-coupling:y*x", "angular:x"])
    yaw = diagnosis.found[1].held_out
    assert yaw is not None
    assert yaw.before_um is not None
    assert yaw.after_um is not None
    assert yaw.after_um < yaw.before_um - 0.1
    assert diagnosis.unknown is None


@pytest.mark.parametrize("components", ["none", "12", "21"])
def test_no_periodic_screw_error_is_claimed(
    plate: tuple[geoerr.Machine, geoerr.Observations], affine: FitResult, components: Components
) -> None:
    machine, observations = plate
    result = affine if components == "none" else geoerr.fit_model(machine, observations, components=components)
    diagnosis = diagnose(result.model, observations)
    named = [*diagnosis.found, *diagnosis.tied]
    assert named
    assert not {one.effect.id for one in named} & {"periodic", "screw-wobble"}
