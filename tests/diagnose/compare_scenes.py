"""A machine, its points and what is measured of them, small enough to compute by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

import geoerr
from geoerr.model import Model
from geoerr.observations import CircularTest, Observations, observations_from_columns
from geoerr.terms import Parameter, Part, Term

Numbers = npt.NDArray[np.float64]
MACHINE = geoerr.Machine.from_chain("wYbZXt", (400.0, 300.0, 250.0), name="one that nobody listed")
NOISE_MM = 1e-3


def term(name: str, channel: str, expression: str, **values: float) -> Term:
    """An effect of one part; units do not matter here."""
    parameters = tuple(Parameter(each, "1", value) for each, value in values.items())
    return Term(name, name, "effect", name, None, None, (Part(channel, expression=expression),), parameters)


def turn(vector: npt.ArrayLike) -> Numbers:
    """Rodrigues' rotation."""
    v = np.asarray(vector, dtype=np.float64)
    angle = float(np.linalg.norm(v))
    x, y, z = v / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def places(rng: np.random.Generator, n: int = 60) -> Numbers:
    return rng.uniform(0.0, [400.0, 300.0, 250.0], (n, 3))


def passes_along(rng: np.random.Generator, n_passes: int, n_rows: int) -> tuple[Numbers, npt.NDArray[np.int64]]:
    """Commanded positions of passes along x, y, z by turns, uneven steps; and the pass of each row."""
    own_pass = np.repeat(np.arange(n_passes), n_rows)
    q_mm = places(rng, n_passes)[own_pass]
    for axis, length in enumerate((400.0, 300.0, 250.0)):
        along = own_pass % 3 == axis
        q_mm[along, axis] = np.sort(rng.uniform(0.0, length, (n_passes, n_rows)), axis=1).ravel()[along]
    return q_mm, own_pass


def measured(
    q_mm: Numbers,
    true_mm: Numbers,
    rng: np.random.Generator | None = None,
    *,
    noise_mm: float = NOISE_MM,
    **more: Any,
) -> Observations:
    """The tool seen from the work, as a CMM that lies anywhere has it; noise where a generator is given."""
    seen = true_mm @ turn([0.3, -0.2, 0.9]).T + [50.0, -20.0, 5.0]
    if rng is not None:
        seen = seen + rng.normal(0.0, noise_mm, seen.shape)
    columns: dict[str, Any] = dict(zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([q_mm, seen]).T, strict=True))
    columns |= {"carrier": ["relative"] * len(q_mm)}
    columns |= {name: np.full(len(q_mm), noise_mm) for name in ("sx", "sy", "sz")}
    return observations_from_columns(columns | more)


def warming_up(rng: np.random.Generator, n: int) -> Numbers:
    return np.asarray(25.0 + 20.0 * (1.0 - np.exp(-4.0 * np.arange(n) / n)) + rng.normal(0.0, 0.3, n))


def turning_its_sign(rng: np.random.Generator) -> tuple[Observations, Numbers]:
    """A wave along X whose height follows a temperature from below 0 to above it; the temperature of each row."""
    q, own_pass = passes_along(rng, 96, 10)
    temp = rng.permutation(warming_up(rng, 96))[own_pass] + rng.normal(0.0, 0.3, len(q))
    true = Model(MACHINE).tool_from_work(q)
    true[:, 1] += 5e-3 * np.sin(2.0 * np.pi * q[:, 0] / 170.0) * (temp - 38.0) / 8.0
    return measured(q, true, rng, line=[f"L{number}" for number in own_pass], temp_bed=temp), temp


def beam(x_mm: npt.ArrayLike, error_um: npt.ArrayLike, **more: Any) -> Observations:
    """A laser along X."""
    x = np.asarray(x_mm, dtype=np.float64)
    nothing = np.zeros_like(x)
    columns: dict[str, Any] = {"x": x, "y": nothing, "z": nothing, "mx": x + 1e-3 * np.asarray(error_um)}
    return observations_from_columns(columns | {"carrier": ["relative"] * len(x)} | more)


def circle(model: Model, *, n: int = 90, sense: int = 1, noise_mm: float = 0.0, seed: int = 0) -> CircularTest:
    """Radii of 100 mm in XY about the middle, as the model's machine has them."""
    angle = sense * np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    centre = np.array([200.0, 150.0, 125.0])
    q = centre + 100.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    radius = np.linalg.norm(model.tool_from_work(q) - centre, axis=1)
    radius += np.random.default_rng(seed).normal(0.0, noise_mm, n) if noise_mm else 0.0
    frame = pl.DataFrame(
        {"line": ["XY"] * n, "x": q[:, 0], "y": q[:, 1], "z": q[:, 2], "r": radius, "dir": [sense] * n}
    )
    return CircularTest(frame, ("circle.csv",))


def rigid_residual_mm(predicted_mm: Numbers, seen_mm: Numbers) -> Numbers:
    """Measured minus predicted in the axes of the prediction, after the least-squares rigid motion (Kabsch)."""
    middle, seen_middle = predicted_mm.mean(axis=0), seen_mm.mean(axis=0)
    left, _, right = np.linalg.svd((seen_mm - seen_middle).T @ (predicted_mm - middle))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return (seen_mm - seen_middle) @ rotation - (predicted_mm - middle)
