"""Where inner parameters start beside cameras whose calibration is uncertain, and that a fit goes on from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from fit_scenes import cubic_truth, seen
from virtual_machine import LENGTH_MM, Camera, machine_of

from geoerr.fit import FitResult, Fitted, fit_model
from geoerr.fit.inner import best_start
from geoerr.observations import Observations
from geoerr.terms import Parameter, Term
from geoerr.vision.rig import Rig, RightFromLeft
from geoerr.vision.sensitivity import points_from_pixels, project_to_both, rig_sensitivity

MACHINE = machine_of("wXYbZt")
VIEW = Camera(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.array([-200.0, 100.0, 900.0]))
PIXELS = ("u_left", "v_left", "u_right", "v_right")
EFFECT = "thermal-expansion:y@temp"
ALPHA_PER_K, FIXED_MM = 11.5e-6, 40.0
N_ROWS = 400


def rig_of(baseline_mm: float, turn_rad: float = 0.0) -> Rig:
    matrix = np.array([[2300.0, 0.0, 1224.0], [0.0, 2300.0, 1024.0], [0.0, 0.0, 1.0]])
    turn = np.array(
        [[np.cos(turn_rad), 0.0, np.sin(turn_rad)], [0.0, 1.0, 0.0], [-np.sin(turn_rad), 0.0, np.cos(turn_rad)]]
    )
    pose = RightFromLeft(turn, np.array([-baseline_mm, 0.0, 0.0]))
    return Rig(matrix, np.zeros(5), matrix, np.zeros(5), pose, (2448, 2048), None)


def scene(seed: int, pixel_std: float, fixed_mm: float = FIXED_MM) -> tuple[Observations, dict[str, np.ndarray]]:
    """A screw that grows while it warms, seen through a rig that is off by a part in 500 and half a milliradian."""
    rng = np.random.default_rng(seed)
    rows = [("relative", rng.uniform(0.0, LENGTH_MM, 3), (0.0, 0.0, 0.0)) for _ in range(N_ROWS)]
    right = cubic_truth(rng, angle_rad=0.0, delta_mm=0.1, s_rad=2e-3)
    temp = 20.0 + 35.0 * (1.0 - np.exp(-np.arange(N_ROWS) / 60.0))
    places = np.array([q for _, q, _ in rows])
    grown = np.zeros((N_ROWS, 3))
    grown[:, 1] = ALPHA_PER_K * (temp - 20.0) * (places[:, 1] - fixed_mm)
    truth = (
        seen(MACHINE, right, VIEW, rows, covariance_mm2=np.eye(3) * 1e-4, temp=temp).measured_mm + grown @ VIEW.turn.T
    )
    pixels = project_to_both(rig_of(300.6, 5e-4), truth).pixel + pixel_std * rng.standard_normal((N_ROWS, 4))
    rig = rig_of(300.0)
    measured = points_from_pixels(rig, pixels)
    variance = np.full(len(rig.parameter_names), 1e-12)
    for name, std in (("t_x_mm", 0.6), ("rotation_y_rad", 5e-4)):
        variance[rig.parameter_names.index(name)] = std**2
    by_point = project_to_both(rig, measured).by_point
    covariance = np.linalg.inv(by_point.transpose(0, 2, 1) @ by_point) * pixel_std**2
    table = {name: places[:, i] for i, name in enumerate("xyz")} | {"carrier": "relative", "temp": temp}
    table |= {f"m{name}": measured[:, i] for i, name in enumerate("xyz")}
    table |= {name: pixels[:, i] for i, name in enumerate(PIXELS)}
    for name, i, j in (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2)):
        table[f"c{name}"] = covariance[:, i, j]
    frame = pl.DataFrame(table)
    base = seen(MACHINE, right, VIEW, rows).frame
    columns = [name for name in base.columns if name not in frame.columns]
    observations = Observations(frame.with_columns(base[name] for name in columns))
    return observations, {"rig_sensitivity": rig_sensitivity(rig, observations), "rig_covariance": np.diag(variance)}


def growth(result: FitResult) -> tuple[Term, Parameter, Parameter]:
    term = next(one for one in result.model.terms if one.effect == "thermal-expansion")
    return term, term.coefficients[0], term.inner[0]


@pytest.mark.parametrize("seed", range(3))
def test_what_a_trial_gains_is_what_adding_it_gives(seed: int) -> None:
    """Beside unknowns that a calibration holds loosely, and that nearly cancel with those of frame and machine."""
    observations, calibration = scene(seed, 0.02)
    fitted = fit_model(MACHINE, observations, components="12", **calibration).fitted
    term, _, _ = growth(fit_model(MACHINE, observations, components="12", effects=EFFECT, **calibration))
    for place_mm in (20.0, 60.0, 300.0):
        inner = tuple(replace(one, value=place_mm, low=place_mm, high=place_mm) for one in term.inner)
        _, gain = best_start(fitted, replace(term, inner=inner))
        again = fitted.again((*fitted.terms, replace(term, inner=inner)))

        def cost(own: Fitted) -> float:
            assert own.prior is not None
            held = own.solved.state.shared[: own.prior.shape[0]]
            return float(own.solved.chi_squared + held @ held)

        assert gain == pytest.approx(cost(fitted) - cost(again), rel=0.02, abs=0.5)


@pytest.mark.parametrize("seed", range(4))
def test_growth_is_found_beside_a_calibration(seed: int) -> None:
    observations, calibration = scene(seed, 0.01)
    result = fit_model(MACHINE, observations, components="12", effects=EFFECT, **calibration)
    _, alpha, fixed = growth(result)
    assert result.fitted.solved.converged
    assert result.fitted.solved.steps < 15
    assert abs(alpha.value - ALPHA_PER_K) < 4.0 * alpha.std
    assert abs(fixed.value - FIXED_MM) < 4.0 * fixed.std
