"""Freedom chosen by the data: curvature, knots, and elements."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from fit_scenes import fit_terms
from numpy.polynomial import Polynomial
from scipy.integrate import quad
from virtual_machine import camera, draw_truth, machine_of, nine_lines, observe

from geoerr.bases import basis_of, spline_over
from geoerr.fit import FitOptions, Fitted
from geoerr.fit.smoothness import choose_smoothness, curvature_rows
from geoerr.terms import BasisSpec, Parameter, Part, Term

Q_MM = np.linspace(0.0, 400.0, 21)
CHAIN = "wZbXYt"


def test_rows_hold_the_integral_of_the_squared_curvature() -> None:
    """Against adaptive quadrature of a second difference."""
    spec = spline_over("x", Q_MM, 9)
    rows = curvature_rows(spec)
    assert rows is not None
    basis = basis_of(spec)
    rng = np.random.default_rng(1)
    coefficients = rng.normal(size=9)
    step = 1e-2

    def squared(q: float) -> float:
        values = basis.derivative(np.array([q - step, q + step])) @ coefficients
        return float(((values[1] - values[0]) / (2.0 * step)) ** 2)

    knots = np.array(spec.knots_mm)
    expected = sum(quad(squared, low + step, high - step)[0] for low, high in itertools.pairwise(knots))
    # The difference leaves out two steps at each of seven pieces of 57 mm.
    assert float(((rows @ coefficients) ** 2).sum()) == pytest.approx(expected, rel=1e-2)
    assert curvature_rows(BasisSpec("polynomial", "x", degree=3, low_mm=0.0, high_mm=400.0)) is None


def curve(values: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Give the effective freedom and the curvature of one function that was measured at all positions."""
    spec = spline_over("x", Q_MM, 21)
    inverse = np.linalg.inv(basis_of(spec).evaluate(Q_MM))
    coefficients = tuple(Parameter(f"c{place}", "mm", float(value)) for place, value in enumerate(inverse @ values))
    term = Term("EXX", "", "classic", None, "x", None, (Part("EXX", basis=spec),), coefficients)
    found = choose_smoothness([term], [term], inverse @ covariance @ inverse.T, np.zeros((21, 0)))
    return found[0].n_free, found[0].curvature


def test_a_line_is_found_to_be_one_and_a_wave_is_followed() -> None:
    rng = np.random.default_rng(2)
    noise = rng.normal(0.0, 1e-3, 21)
    free_of_line, curvature_of_line = curve(1e-4 * Q_MM + noise, np.eye(21) * 1e-6)
    free_of_wave, curvature_of_wave = curve(0.05 * np.sin(2.0 * np.pi * Q_MM / 133.0) + noise, np.eye(21) * 1e-6)
    assert free_of_line < 5.0
    assert free_of_wave > 9.0
    assert curvature_of_wave > 10.0 * curvature_of_line


def test_curvature_is_that_of_the_curves_it_is_drawn_from() -> None:
    """The roughness of random curves comes back within its own uncertainty, on average over 60 of them."""
    rng = np.random.default_rng(3)
    spec = spline_over("x", Q_MM, 21)
    rows = curvature_rows(spec)
    assert rows is not None
    _, size, turned = np.linalg.svd(rows, full_matrices=False)
    true = 2e-4
    ratios = []
    for _ in range(60):
        bent = turned[:19].T @ (rng.normal(0.0, true, 19) / size[:19])
        values = basis_of(spec).evaluate(Q_MM) @ bent + rng.normal(0.0, 1e-4, 21)
        ratios.append(np.log(curve(values, np.eye(21) * 1e-8)[1] / true))
    # The upper end of the likelihood's interval is taken: with some 15 bends, a quarter above the truth.
    assert -0.1 < np.mean(ratios) < 0.6


@pytest.fixture(scope="module")
def observed() -> dict[str, Fitted]:
    """A machine whose X errors are straight lines and parabolas, fitted in three ways."""
    rng = np.random.default_rng(4)
    machine = machine_of(CHAIN)
    truth = draw_truth(rng, CHAIN, n_points=21)
    line, parabola = Polynomial([0.0, 2e-4]), Polynomial([0.0, 1e-4, -8e-7])
    truth.tables["EXX"], truth.tables["EAX"] = line(Q_MM), 1e-3 * parabola(Q_MM)
    observations = observe(
        machine,
        truth,
        nine_lines(machine),
        {"0": camera(rng)},
        covariance_mm2=np.diag([0.5e-3, 0.5e-3, 1e-3]) ** 2,
        rng=rng,
    )
    return {
        freedom: fit_terms(machine, [observations], options=FitOptions(freedom=freedom))  # type: ignore[arg-type]
        for freedom in ("knots", "smooth", "elements")
    }


def test_elements_are_chosen_by_kind_and_number(observed: dict[str, Fitted]) -> None:
    chosen = {choice.name: choice for choice in observed["elements"].choices}
    assert chosen["EXX"].n_free <= 2
    assert chosen["EAX"].basis.kind == "quadratic"
    assert {choice.basis.kind for choice in chosen.values()} <= {"linear", "quadratic"}


def test_all_ways_hold_the_data(observed: dict[str, Fitted]) -> None:
    for freedom, fitted in observed.items():
        assert fitted.not_determined == (), freedom
        assert fitted.split.lack_of_fit_p is not None
        assert fitted.split.lack_of_fit_p > 1e-3, freedom


def test_a_prior_determines_nothing_that_the_data_do_not() -> None:
    """With one target on the bed its angles stay unknown, however smooth they are held to be."""
    rng = np.random.default_rng(6)
    machine = machine_of(CHAIN)
    truth = draw_truth(rng, CHAIN, n_points=21)
    moves = nine_lines(machine)
    moves[-1].targets = {"D": (0.0, 0.0, 0.0)}
    observations = observe(machine, truth, moves, {"0": camera(rng)}, covariance_mm2=np.eye(3) * 1e-6, rng=rng)
    lost = {
        freedom: {
            item.name
            for item in fit_terms(
                machine,
                [observations],
                options=FitOptions(freedom=freedom),  # type: ignore[arg-type]
            ).not_determined
        }
        for freedom in ("knots", "smooth")
    }
    assert lost["smooth"] == lost["knots"] == {"EAZ", "EBZ", "ECZ"}
