"""Amplitudes of waves: which coefficients are one, and their standard error against drawn values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_machines import machine

from geoerr.effects import catalogue
from geoerr.effects.amplitudes import amplitude_words, amplitudes_by_term, amplitudes_of, parts_of, wave_pairs
from geoerr.terms import Parameter, Part, Term, UsualSpan

PULLEY = (UsualSpan(0.0, 0.004, "a ball screw"), UsualSpan(0.0, 0.065, "a belt pulley"))


def wave(value: tuple[float, float], std: float, expression: str = "A*sin(2*pi*q/P) + B*cos(2*pi*q/P)") -> Term:
    parameters = tuple(Parameter(name, "mm", own, std, PULLEY) for name, own in zip(("A", "B"), value, strict=True))
    period = (Parameter("P", "mm", 8.0, 0.01, low=0.5, high=200.0, spacing="log"),)
    parts = (Part("EXX", expression=expression, definitions=(("q", "x"),)),)
    return Term("wave:x", "wave", "effect", "wave", "x", None, parts, parameters, period)


@pytest.mark.parametrize(
    ("effect", "axis", "form", "pairs"),
    [
        ("periodic", "x", "", [("A", "B")]),
        ("periodic", "x", "harmonics", [("A", "B"), ("A2", "B2")]),
        ("screw-wobble", "x", "", [("A_y", "B_y"), ("A_z", "B_z")]),
        (
            *("rig-pixel-locking", None, ""),
            [("A_x", "B_x"), ("A_y", "B_y"), ("A_left", "B_left"), ("A_right", "B_right")],
        ),
        ("backlash", "x", "", []),
    ],
)
def test_waves_of_the_catalogue(effect: str, axis: str | None, form: str, pairs: list[tuple[str, str]]) -> None:
    assert list(wave_pairs(catalogue()[effect].term(axis, None, machine(), form=form))) == pairs


@pytest.mark.parametrize(
    ("expression", "is_wave"),
    [
        ("A*sin(2*pi*q/P)+B*cos(2*pi*q / P)", True),
        ("sin(2*pi*(q + 1)/P)*A + cos(2*pi*(q + 1)/P)*B", True),
        ("A*sin(2*pi*q/P) + B*cos(4*pi*q/P)", False),
        ("A*sin(2*pi*q/P) + A*B*cos(2*pi*q/P)", False),
        ("A*sin(2*pi*q/P) + B*cos(2*pi*q/P)^2", False),
        ("A*sin(2*pi*q/P) + B*sin(2*pi*q/P)", False),
        ("A*sin(2*pi*q/P) + B*cos(2*pi*q/P) + B*q", False),
        ("y*(A*sin(2*pi*q/P) + B*cos(2*pi*q/P))", True),
        ("A*y*sin(2*pi*q/P) + B*y*cos(2*pi*q/P)", True),
        ("A*y*sin(2*pi*q/P) + B*z*cos(2*pi*q/P)", False),
        ("2*A*sin(2*pi*q/P) + B*cos(2*pi*q/P)", False),
        ("A*sin(2*pi*q/P)/y + B*cos(2*pi*q/P)", False),
        ("(A*sin(2*pi*q/P))*y + B*cos(2*pi*q/P)", False),
    ],
)
def test_only_a_sine_and_a_cosine_of_the_same_argument_are_a_wave(expression: str, is_wave: bool) -> None:
    assert bool(wave_pairs(wave((1.0, 1.0), 0.1, expression))) == is_wave


def test_the_standard_error_against_drawn_values() -> None:
    rng = np.random.default_rng(1)
    covariance = np.array([[4.0, -1.5], [-1.5, 1.0]]) * 1e-8
    drawn = rng.multivariate_normal([0.006, 0.002], covariance, 100_000)
    (found,) = amplitudes_of(wave((0.006, 0.002), 1e-4), covariance)
    assert found.size.value == pytest.approx(np.hypot(0.006, 0.002))
    assert found.size.std == pytest.approx(np.linalg.norm(drawn, axis=1).std(), rel=0.02)


def test_near_zero_it_is_a_bound_that_holds() -> None:
    rng = np.random.default_rng(2)
    drawn = rng.normal((0.5e-3, 0.0), 1e-3, (2000, 2))
    found = [amplitudes_of(wave((a, b), 1e-3), np.eye(2) * 1e-6)[0] for a, b in drawn]
    bounds = [one.most for one in found if not one.is_told]
    assert np.mean(np.array(bounds) > 0.5e-3) > 0.97
    small = next(one for one in found if not one.is_told)
    assert "at most" in amplitude_words(small)
    assert small.to_document()["plausible"] is None


def test_plausibility_is_asked_of_the_amplitude() -> None:
    """6 µm are a pulley's whatever the phase: 3 µm of one part alone would be a ball screw's."""
    for phase in (0.0, 0.5, 1.0, 1.5):
        (found,) = amplitudes_of(wave((6e-3 * np.cos(phase), 6e-3 * np.sin(phase)), 3e-4), np.eye(2) * 9e-8)
        assert (
            amplitude_words(found) == "amplitude √(A² + B²) = 6.00 ± 0.30 µm (usual: a belt pulley has up to 65 µm)"
        )
        assert found.to_document()["plausible"] == "a belt pulley"
    assert parts_of([found]) == {"A", "B"}


def test_beside_a_period_at_the_end_of_its_range_an_amplitude_is_not_compared() -> None:
    term = replace(wave((6e-3, 0.0), 3e-4), inner=(Parameter("P", "mm", 40.0, 0.1, (), 1.0, 40.0, "log"),))
    (found,) = amplitudes_of(term, np.eye(2) * 9e-8)
    assert "(not to be compared with known values: P is at the end of its range)" in amplitude_words(found)
    assert found.to_document()["plausible"] is None


def test_in_a_fit_of_several_terms_each_has_its_own_covariance() -> None:
    first, second = wave((6e-3, 0.0), 1e-4), replace(wave((3e-3, 0.0), 2e-4), id="wave:y")
    found = amplitudes_by_term([first, second], np.diag([1e-8, 1e-8, 4e-8, 4e-8, 1e-4, 1e-4]))
    assert found["wave:x"][0].size.std == pytest.approx(1e-4)
    assert found["wave:y"][0].size.std == pytest.approx(2e-4)
    assert amplitudes_of(wave((6e-3, 0.0), float("nan")), np.zeros((2, 2))) == ()
