"""Directions that the data leave free: where the solution stands in them, and which functions they concern."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_machine import camera, draw_truth, machine_of, nine_lines, observe

from geoerr.effects import catalogue
from geoerr.fit import FitOptions, FitResult, fit_model
from geoerr.fit.free_directions import concerned, held_smallest, limits_of
from geoerr.machine import Machine
from geoerr.observations import Observations
from geoerr.terms import Parameter, Part, Term

STEP_MM = 20.0


def wave(period_mm: float, machine: Machine) -> Term:
    term = catalogue()["periodic"].term("x", None, machine)
    return replace(term, inner=tuple(replace(p, value=period_mm, low=period_mm, high=period_mm) for p in term.inner))


@pytest.fixture(scope="module")
def seen() -> tuple[Machine, Observations]:
    rng = np.random.default_rng(21)
    machine = machine_of("wZbXYt")
    moves = [replace(move, repeat=repeat) for repeat in range(2) for move in nine_lines(machine)]
    truth = draw_truth(rng, "wZbXYt", n_points=21)
    return machine, observe(machine, truth, moves, {"0": camera(rng)}, covariance_mm2=np.eye(3) * 1e-6, rng=rng)


@pytest.fixture(scope="module")
def plain(seen: tuple[Machine, Observations]) -> FitResult:
    return fit_model(*seen, options=FitOptions(threads=1))


@pytest.mark.parametrize("period_mm", [STEP_MM * (1.0 + 5e-6), STEP_MM / 3.0000001])
def test_a_wave_that_hardly_shows_takes_nothing_from_the_positioning(
    seen: tuple[Machine, Observations], plain: FitResult, period_mm: float
) -> None:
    """At the data it is a line of a thousandth of its amplitude: any scale could be a wave of centimetres."""
    machine, observations = seen
    found = fit_model(machine, observations, effects=[wave(period_mm, machine)], options=FitOptions(threads=1))
    by_id = {term.id: term for term in found.fitted.terms}
    for term in plain.fitted.terms:
        for was, now in zip(term.coefficients, by_id[term.id].coefficients, strict=True):
            assert abs(now.value - was.value) <= 1e-2 * was.std
            # Two unknowns more are fitted, and nothing is told about the others by that.
            assert now.std == pytest.approx(was.std, rel=1e-2, abs=1e-12)
    amplitude = by_id["periodic:x"].coefficients[0]
    assert abs(amplitude.value) < 1e-4
    assert found.fitted.solved.chi_squared == pytest.approx(plain.fitted.solved.chi_squared, rel=1e-6)


def test_a_function_is_listed_where_the_wave_could_change_it(
    seen: tuple[Machine, Observations], plain: FitResult
) -> None:
    """1 mm of a wave moves EXX by 13 nm at a third of the step, and by 13 µm at a period off by 1e-4."""
    machine, observations = seen
    assert not plain.fitted.not_determined
    names = {}
    for period_mm in (STEP_MM / 3.0000001, STEP_MM * (1.0 + 1e-4)):
        found = fit_model(machine, observations, effects=[wave(period_mm, machine)], options=FitOptions(threads=1))
        names[period_mm] = {item.name for item in found.fitted.not_determined}
        # Between the measured positions nobody knows, in either case.
        assert not found.model.is_determined_at([[5.0, 0.0, 0.0]])[0, 0]
        tables = found.model.without("periodic:x").error_functions()
        assert ("EXX" in tables.functions) is ("EXX" not in names[period_mm])
    assert list(names.values()) == [{"periodic:x"}, {"EXX", "periodic:x"}]


def test_the_point_that_is_taken_is_the_smallest_of_those_that_the_data_cannot_tell() -> None:
    rng = np.random.default_rng(3)
    null_space, values = rng.normal(size=(7, 2)), rng.normal(size=7)
    limits = np.array([3.0, 3.0, 0.02, 1e-3, np.inf, np.inf, np.inf])
    found = held_smallest(values, null_space, limits)
    moved = np.linalg.lstsq(null_space, found - values, rcond=None)
    assert moved[1] == pytest.approx(0.0, abs=1e-20)
    size = np.linalg.norm((found / limits)[:4])
    for other in rng.normal(size=(50, 2)):
        assert np.linalg.norm(((found + null_space @ other) / limits)[:4]) >= size
    columns = np.column_stack([values, 2.0 * values])
    assert held_smallest(columns, null_space, limits) == pytest.approx(np.column_stack([found, 2.0 * found]))
    # A direction of frames alone has no size, and none is nothing.
    frames = np.eye(7)[:, 4:5]
    assert np.array_equal(held_smallest(values, frames, limits), values)
    assert np.array_equal(held_smallest(values, np.zeros((7, 0)), limits), values)


def test_limits_are_in_the_unit_of_each_coefficient() -> None:
    def of(kind: str, unit: str) -> Term:
        effect = None if kind == "classic" else "own"
        part = Part("EXX", "c*x")
        return Term(f"{kind}-{unit}", "", kind, effect, "x", None, (part,), (Parameter("c", unit),))  # type: ignore[arg-type]

    terms = [of("classic", "mm"), of("classic", "rad"), of("effect", "mm"), of("effect", "1/K"), of("effect", "1")]
    limits = limits_of(terms, np.array([1.0, 200.0, 1.0, 8000.0, 0.0]), 7)
    assert limits[:4] == pytest.approx([3.0, 0.02, 1.0, 1.0 / 8000.0])
    assert np.isinf(limits[4:]).all()


def test_whom_a_direction_concerns() -> None:
    part = Part("EXX", "c*x")
    terms = [
        Term(name, "", "effect", "own", "x", None, (part,), (Parameter("c", "mm"),)) for name in ("large", "small")
    ]
    limits = np.array([1.0, 1.0, np.inf])
    for share, is_concerned in ((1e-3, True), (1e-7, False)):
        null_space = np.array([[1.0], [share], [0.5]])
        cleaned, known = concerned(null_space, np.zeros(3, dtype=bool), terms, limits, np.array([1e-6, 1e-6]))
        assert cleaned[:, 0].tolist() == [1.0, share if is_concerned else 0.0, 0.5]
        assert known.tolist() == [False, not is_concerned, False]
