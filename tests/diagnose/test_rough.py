"""A wave along an axis, and a rough error of that axis which would pass for one."""

import numpy as np
import pytest
from validation.fine_errors import LENGTH_MM, MACHINE, Curve, measured, screw, table

from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.diagnose import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.search.rough import _beyond_the_model, of_directions, rough_covariances, rough_evidence
from geoerr.fit import fit_model


def diagnosed(seed: int, curve: Curve, noise_um: float, n_same: int | None) -> Diagnosis:
    """Diagnose a machine that is off by the same curve along each axis."""
    observations = measured(np.random.default_rng(seed), [curve] * 3, noise_um, n_same)
    return diagnose(fit_model(MACHINE, observations).fitted, threads=1)


def log_density(residual: np.ndarray, covariance: np.ndarray) -> float:
    """Give that of a Gaussian variable, but for a constant."""
    return -0.5 * float(np.linalg.slogdet(covariance)[1] + residual @ np.linalg.solve(covariance, residual))


def test_evidence_is_that_of_gaussian_densities() -> None:
    """The densities themselves, at the likeliest sizes, with covariances written out."""
    rng = np.random.default_rng(3)
    n, places_mm = 40, np.sort(rng.uniform(0.0, LENGTH_MM, 9))
    at_places, wave, residual = rng.normal(size=(n, 9)), rng.normal(size=(n, 2)), 2.0 * rng.normal(size=n)
    residual += wave @ [4.0, -3.0] + at_places @ rng.normal(size=9)
    columns = np.concatenate([at_places, wave], axis=1)
    noise = log_density(residual, np.eye(n))
    for covariance in rough_covariances(places_mm, 1):
        alone, beside = [], []
        for variance in np.append(0.0, np.geomspace(1e-4, 1e8, 400)):
            whole = np.eye(n) + variance * at_places @ covariance @ at_places.T
            alone.append(log_density(residual, whole) - noise)
            inverse = np.linalg.inv(whole)
            own = wave.T @ inverse @ wave
            along = wave.T @ inverse @ residual
            size = max(float(along @ np.linalg.solve(own, along)) / 2.0 - 1.0, 0.0)
            with_wave = whole + size * wave @ np.linalg.solve(own, wave.T)
            beside.append(log_density(residual, with_wave) - noise)
        found = rough_evidence(columns.T @ columns, columns.T @ residual, covariance)
        # Between the sizes that each of the two tries.
        assert found == pytest.approx((max(alone), max(beside)), abs=0.1)


def test_what_the_model_has_is_no_rough_error() -> None:
    rng = np.random.default_rng(5)
    columns, model = rng.normal(size=(50, 6)), np.linalg.qr(rng.normal(size=(50, 3)))[0]
    columns[:, :3] = model @ rng.normal(size=(3, 3))
    off = columns - model @ (model.T @ columns)
    keep = _beyond_the_model(off.T @ off, columns.T @ columns, 5)
    assert off @ keep == pytest.approx(np.concatenate([np.zeros((50, 3)), off[:, 3:]], axis=1), abs=1e-12)
    assert keep @ keep == pytest.approx(keep)


def test_directions_that_are_off_by_less_than_noise_have_no_evidence() -> None:
    gains = np.array([0.0, 1.0, 2.0, 4.0, 40.0])
    found = of_directions(gains, 2)
    assert found[:3] == pytest.approx(0.0)
    assert found[3] == pytest.approx(0.5 * (4.0 - 2.0) - np.log(2.0))
    assert (np.diff(found) >= 0.0).all()


@pytest.mark.parametrize(
    ("n_same", "noise_um", "seed"), [(21, 10.0, 1), (21, 10.0, 2), (21, 10.0, 3), (41, 2.0, 3), (41, 2.0, 4)]
)
def test_something_else_at_each_place_is_no_wave(n_same: int, noise_um: float, seed: int) -> None:
    """A table of errors had a wave, on each of these: of 1.6 µm each 0.9 mm, ± 0.00004 mm, or the like."""
    diagnosis = diagnosed(seed, table(np.random.default_rng(seed)), noise_um, n_same)
    assert not diagnosis.found
    assert diagnosis.verdict == "unknown"
    assert diagnosis.unknown is not None
    (axis,) = diagnosis.unknown.depends_on
    assert diagnosis.unknown.component == axis
    assert diagnosis.unknown.curve is None
    assert diagnosis.unknown.worth_um > 0.0
    assert any(f"measure {axis} at places between these" in note for note in diagnosis.notes)
    assert diagnosis.without_numbers().notes == diagnosis.notes
    assert "too stiff" not in " ".join(diagnosis_lines(diagnosis, "geoerr add", ""))


def test_a_wave_beside_rough_errors_is_named_where_places_tell_it() -> None:
    rough = table(np.random.default_rng(1))
    diagnosis = diagnosed(1, lambda q: rough(q) + screw(q), 2.0, None)
    assert {str(one.reference) for one in diagnosis.found} == {"periodic:x", "periodic:y", "periodic:z"}
    for one in diagnosis.found:
        assert next(p for p in one.parameters if p.name == "P").value == pytest.approx(5.0, abs=0.02)


@pytest.mark.parametrize("n_same", [21, None])
def test_a_wave_alone_is_named(n_same: int | None) -> None:
    diagnosis = diagnosed(2, screw, 2.0, n_same)
    assert {str(one.reference) for one in diagnosis.found} == {"periodic:x", "periodic:y", "periodic:z"}
