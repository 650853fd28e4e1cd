"""Functions that the data do not tell apart: one of them gets the freedom that their sum needs."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.bases import basis_of, spline_over
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.aliases import Determined, simplified
from geoerr.fit.classic import classic_terms, positions_by_axis, tells_noise
from geoerr.fit.joined import sightings_of
from geoerr.fit.sightings import SAME_POSITION_MM
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns
from geoerr.terms import BasisSpec

NOISE_MM = 0.004
MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 200.0))


def _waved(q: np.ndarray, length_mm: float, size_mm: float, degree: int = 5) -> np.ndarray:
    """A polynomial of that degree, as large at the ends as anywhere."""
    return size_mm * np.cos(degree * np.arccos(np.clip(2.0 * q / length_mm - 1.0, -1.0, 1.0)))


def _along_x(rng: np.random.Generator) -> Observations:
    """A laser along x: one point of the tool, one component."""
    q = np.tile(np.concatenate([np.linspace(0.0, 400.0, 41), np.linspace(400.0, 0.0, 41)]), 4)
    n = len(q)
    columns: dict[str, object] = {"carrier": ["relative"] * n, "line": ["X1"] * n, "repeat": np.arange(n) // 82}
    columns |= {
        "x": q,
        "y": np.full(n, 150.0),
        "z": np.full(n, 100.0),
        **dict.fromkeys(("tx", "ty", "tz"), np.zeros(n)),
    }
    columns["mx"] = q + _waved(q, 400.0, 0.02) + NOISE_MM * rng.standard_normal(n)
    return observations_from_columns(columns)


def _on_a_grid(rng: np.random.Generator, n_levels: int) -> Observations:
    """All axes on a few levels, three tools of different length; nothing is said of the noise."""
    levels = [np.linspace(0.0, length, n_levels) for length in (400.0, 300.0, 200.0)]
    grid = np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, 3)
    q = np.repeat(grid, 3, axis=0)
    n = len(q)
    tool = np.tile([[0.0, 0.0, 0.0], [60.0, 0.0, -40.0], [0.0, 50.0, -80.0]], (len(grid), 1))
    error = np.column_stack([_waved(q[:, axis], levels[axis][-1], 0.03, n_levels - 1) for axis in range(3)])
    seen = q + tool + error + NOISE_MM * rng.standard_normal((n, 3))
    columns: dict[str, object] = {"carrier": ["relative"] * n}
    for axis, name in enumerate("xyz"):
        columns |= {name: q[:, axis], f"t{name}": tool[:, axis], f"m{name}": seen[:, axis]}
    return observations_from_columns(columns)


def test_what_is_determined_stays_and_what_is_not_becomes_simple() -> None:
    rng = np.random.default_rng(1)
    places = np.linspace(0.0, 400.0, 30)
    rich = spline_over("x", places, 9)
    simple = BasisSpec("polynomial", "x", degree=1, low_mm=0.0, high_mm=400.0)
    terms = [term for term in classic_terms(MACHINE, "21", {"EXX": rich, "EBX": rich}) if term.id in ("EXX", "EBX")]
    columns = basis_of(rich).evaluate(places)
    # 70 mm of arm, everywhere.
    by_id = {"EXX": columns, "EBX": 70.0 * columns}
    design = np.hstack([by_id[term.id] for term in terms])
    _, size, turned = np.linalg.svd(design)
    rank = int((size > 1e-9 * size[0]).sum())
    covariance = np.linalg.pinv(design.T @ design, rcond=1e-12)
    before = Determined(rng.standard_normal(18), covariance, turned[rank:].T)
    after = simplified(terms, {"EXX": simple, "EBX": simple}, {"x": places}, before)
    scale = np.abs(design @ before.values).max()
    assert np.abs(design @ (after.values - before.values)).max() < 1e-9 * scale
    assert np.abs(design @ after.covariance @ design.T - design @ covariance @ design.T).max() < 1e-9
    # The angle is a straight line now, for certain; of its line and the translation's it stays open which it is.
    angle = slice(9, 18) if terms[1].id == "EBX" else slice(0, 9)
    line = np.linalg.lstsq(basis_of(simple).evaluate(places), columns @ after.values[angle], rcond=None)
    assert float(line[1][0]) < 1e-16
    assert after.simple == {"EBX"}
    assert after.null_space.shape[1] == 2
    assert np.abs(design @ after.null_space).max() < 1e-9 * np.abs(design).max()
    # Nothing is free: nothing moves.
    held = Determined(before.values, covariance, np.empty((18, 0)))
    assert simplified(terms, {"EXX": simple, "EBX": simple}, {"x": places}, held) is held


@pytest.mark.parametrize("seed", [2, 3])
def test_a_laser_run_is_followed_though_angles_move_its_point_too(seed: int) -> None:
    """Positioning, pitch and yaw are one there: none of them is known, their sum is."""
    fitted = fit_terms(MACHINE, [_along_x(np.random.default_rng(seed))], options=FitOptions(threads=1))
    scatter = float(np.sqrt((fitted.solved.residual_mm[:, 0] ** 2).mean()))
    # 328 numbers and some ten unknowns.
    assert 0.88 * NOISE_MM < scatter < 1.1 * NOISE_MM
    chosen = {choice.name: choice.basis.n_functions for choice in fitted.choices}
    assert chosen["EXX"] > 5
    assert chosen["EBX"] == chosen["ECX"] == 2


@pytest.mark.parametrize("n_levels", [4, 5, 6, 7])
def test_a_grid_of_few_levels_gets_a_function_for_every_level(n_levels: int) -> None:
    table = _on_a_grid(np.random.default_rng(n_levels), n_levels)
    fitted = fit_terms(MACHINE, [table], options=FitOptions(threads=1))
    rows = np.isfinite(fitted.solved.residual_mm).all(axis=1)
    scatter = float(np.sqrt((fitted.solved.residual_mm[rows] ** 2).sum() / (fitted.dof)))
    assert 0.9 * NOISE_MM < scatter < 1.1 * NOISE_MM
    by_name = {choice.name: choice.basis.n_functions for choice in fitted.choices}
    assert all(by_name[name] == n_levels for name in ("EXX", "EYY", "EZZ"))


def test_nine_lines_run_once_keep_positions_for_the_noise() -> None:
    """297 numbers for 198 values of functions: passing through all of them, little would tell the noise."""
    parts = []
    for axis, length in enumerate((400.0, 300.0, 200.0)):
        for tool in ((0.0, 0.0, 0.0), (60.0, 0.0, -40.0), (0.0, 50.0, -80.0)):
            q = np.tile([200.0, 150.0, 100.0], (11, 1))
            q[:, axis] = np.linspace(0.0, length, 11)
            parts.append(np.hstack([q, np.tile(tool, (11, 1))]))
    rows = np.vstack(parts)
    seen = rows[:, :3] + rows[:, 3:]
    n = len(rows)
    columns: dict[str, object] = {"carrier": ["relative"] * n, "line": [f"l{row // 11}" for row in range(n)]}
    for axis, name in enumerate("xyz"):
        columns |= {name: rows[:, axis], f"t{name}": rows[:, 3 + axis], f"m{name}": seen[:, axis]}
    sightings = sightings_of(observations_from_columns(columns))
    positions = positions_by_axis(sightings.commanded_mm, SAME_POSITION_MM)
    assert not tells_noise(sightings, LINEAR_AND_ANGULAR, positions)
    grid = sightings_of(_on_a_grid(np.random.default_rng(5), 5))
    assert tells_noise(grid, LINEAR_AND_ANGULAR, positions_by_axis(grid.commanded_mm, SAME_POSITION_MM))
