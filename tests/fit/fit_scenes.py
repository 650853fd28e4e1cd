"""Machines whose errors are cubics, in the gauge of the fit by construction, and what is measured of them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import polars as pl
from numpy.polynomial import Legendre, Polynomial
from virtual_machine import AXES, LENGTH_MM, Camera, Truth, camera, nine_lines, observe, place, rotation

from geoerr.bases import basis_of
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.machine import Machine
from geoerr.observations import CircularTest, Observations, observations_from_columns
from geoerr.terms import BasisSpec, Term

Numbers = npt.NDArray[np.float64]
TRANSLATION, ROTATION = "XYZ", "ABC"
# A stereo pair's: three times as uncertain in depth, turned against every axis.
ROOT_MM = np.array([[2e-3, 0.0, 0.0], [0.7e-3, 2.5e-3, 0.0], [-1.5e-3, 2e-3, 6e-3]])
COVARIANCE_MM2 = ROOT_MM @ ROOT_MM.T


def cubic(axis: str, *, degree: int = 3) -> BasisSpec:
    return BasisSpec("polynomial", axis, degree=degree, low_mm=0.0, high_mm=LENGTH_MM)


CUBICS = {name: cubic(name[2].lower()) for name in LINEAR_AND_ANGULAR}


def cubic_truth(
    rng: np.random.Generator, *, angle_rad: float = 100e-6, delta_mm: float = 0.03, s_rad: float = 5e-4, n: int = 9
) -> Truth:
    """Positioning and angles are 0 at the first point; Legendre's P2 and P3 have no least-squares slope."""
    q = np.linspace(0.0, LENGTH_MM, n)
    v = 2.0 * q / LENGTH_MM - 1.0
    tables = {}
    for name in LINEAR_AND_ANGULAR:
        draw = rng.uniform(-1.0, 1.0, 3)
        if name[1] in ROTATION:
            tables[name] = angle_rad * Polynomial([0.0, *draw])((v + 1.0) / 2.0)
        elif name[1] == name[2]:
            tables[name] = delta_mm * Polynomial([0.0, *draw])((v + 1.0) / 2.0)
        else:
            shape = Legendre([0.0, 0.0, *draw[:2]])
            tables[name] = delta_mm * (shape(v) - shape(-1.0))
    s = dict(zip(("xy", "xz", "yz"), rng.uniform(-s_rad, s_rad, 3), strict=True))
    return Truth(dict.fromkeys(AXES, q), tables, s)


def covariance_columns(observations: Observations) -> dict[str, Numbers]:
    """Give the stated covariances column by column."""
    return {name: observations.numbers(name)[:, 0] for name in ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")}


def nine_lines_seen(
    rng: np.random.Generator, machine: Machine, *, has_noise: bool = True, n_repeats: int = 1
) -> tuple[Truth, Observations]:
    """Three targets on each body of a machine with cubic errors, one camera anywhere."""
    truth = cubic_truth(rng)
    moves = [move for repeat in range(n_repeats) for move in nine_lines(machine, repeat=repeat)]
    exact = observe(machine, truth, moves, {"0": camera(rng)}, covariance_mm2=COVARIANCE_MM2)
    return truth, measured_again(exact, rng.normal(size=(len(exact), 3)) @ ROOT_MM.T) if has_noise else exact


def no_errors(n: int = 9) -> Truth:
    q = np.linspace(0.0, LENGTH_MM, n)
    return Truth(dict.fromkeys(AXES, q), {name: np.zeros(n) for name in LINEAR_AND_ANGULAR})


def seen(
    machine: Machine,
    truth: Truth,
    camera: Camera,
    rows: Sequence[tuple[str, Sequence[float], Sequence[float]]],
    rng: np.random.Generator | None = None,
    *,
    covariance_mm2: Numbers = COVARIANCE_MM2,
    **columns: object,
) -> Observations:
    """Measure rows of carrier, axis positions and offset with one camera; noise of `covariance_mm2`, stated."""
    places = [place(machine, truth, carrier, np.array(q), np.array(offset)) for carrier, q, offset in rows]
    measured = np.array(places) @ camera.turn.T + camera.shift_mm
    if rng is not None:
        measured = measured + rng.normal(size=measured.shape) @ np.linalg.cholesky(covariance_mm2).T
    q, offsets = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    return points(q, offsets, measured, carrier=[row[0] for row in rows], covariance_mm2=covariance_mm2, **columns)


def there_and_back(
    targets: Mapping[str, Sequence[Sequence[float]]], through_mm: Sequence[float], n_places: int, n_repeats: int
) -> tuple[list[tuple[str, Numbers, Sequence[float]]], dict[str, list[object]]]:
    """Lines along each axis through one place; every picture shows all targets, offsets (mm) by carrier.

    Returns rows as `seen` takes them, and their columns `repeat` and `line`.
    """
    rows: list[tuple[str, Numbers, Sequence[float]]] = []
    repeats: list[object] = []
    lines: list[object] = []
    for repeat, axis, way in itertools.product(range(n_repeats), range(3), (1, -1)):
        for place_mm in np.linspace(0.0, LENGTH_MM, n_places)[::way]:
            q = np.array(through_mm)
            q[axis] = place_mm
            own = [(carrier, q, offset) for carrier, offsets in targets.items() for offset in offsets]
            rows += own
            repeats += [float(repeat)] * len(own)
            lines += [f"L{axis}{way:+d}"] * len(own)
    return rows, {"repeat": repeats, "line": lines}


def points(
    q_mm: Numbers, offset_mm: Numbers, measured_mm: Numbers, *, covariance_mm2: Numbers | None, **columns: object
) -> Observations:
    """Make observations; a component that is NaN was not measured."""
    table: dict[str, object] = {name: q_mm[:, index] for index, name in enumerate("xyz")}
    table |= {f"t{name}": offset_mm[:, index] for index, name in enumerate("xyz")}
    for index, name in enumerate("xyz"):
        table[f"m{name}"] = [None if np.isnan(value) else float(value) for value in measured_mm[:, index]]
    if covariance_mm2 is not None:
        for name, i, j in (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2)):
            table[f"c{name}"] = np.full(len(q_mm), covariance_mm2[i, j])
    return observations_from_columns(table | columns)


def measured_again(observations: Observations, noise_mm: Numbers) -> Observations:
    """Add noise (n, 3) to measured positions."""
    return replaced(
        observations, **dict(zip(("mx", "my", "mz"), (observations.measured_mm + noise_mm).T, strict=True))
    )


def replaced(observations: Observations, **columns: object) -> Observations:
    frame = observations.frame.with_columns(**{name: pl.Series(values) for name, values in columns.items()})
    return Observations(frame, observations.sources)


def fitted(
    machine: Machine,
    *tables: Observations | CircularTest,
    effects: Sequence[Term] = (),
    **options: object,
) -> Fitted:
    """Fit on one thread, with cubics unless other bases are named."""
    chosen = {"bases": CUBICS, "threads": 1} | options
    return fit_terms(machine, tables, effects=effects, options=FitOptions(**chosen))  # type: ignore[arg-type]


def lost(result: Fitted) -> set[str]:
    return {item.name for item in result.not_determined}


def why(result: Fitted, name: str) -> str:
    return next(item.why for item in result.not_determined if item.name == name)


def term_of(result: Fitted, term_id: str) -> Term:
    return next(term for term in result.terms if term.id == term_id)


def value_of(result: Fitted, term_id: str, number: int = 0) -> tuple[float, float]:
    """Give a coefficient's value and standard error."""
    parameter = term_of(result, term_id).coefficients[number]
    return parameter.value, parameter.std


def curve_of(result: Fitted, name: str, q_mm: Numbers) -> tuple[Numbers, Numbers]:
    """Give an error function's values and standard errors at positions."""
    first = 0
    for term in result.terms:
        if term.id == name:
            break
        first += len(term.coefficients)
    spec = term.parts[0].basis
    assert spec is not None
    rows = basis_of(spec).evaluate(q_mm)
    own = slice(first, first + len(term.coefficients))
    variance = np.einsum("ni,ij,nj->n", rows, result.covariance[own, own], rows)
    return rows @ [c.value for c in term.coefficients], np.sqrt(np.maximum(variance, 0.0))


def camera_near_base(rng: np.random.Generator) -> Camera:
    return Camera(rotation(rng.uniform(-0.02, 0.02, 3)), rng.uniform(-500.0, 500.0, 3))
