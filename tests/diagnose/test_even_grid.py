"""Grids of few even places: a smooth error with a function too few is no screw's wave of any period."""

import numpy as np
import pytest

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

TRAVEL_MM = np.array([400.0, 300.0, 250.0])
MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
NOISE_MM = 0.001


def grid(seed: int) -> Observations:
    """Ten by ten places at three heights, run through twice; errors of 12 µm are cubics and two waves of an axis."""
    rng = np.random.default_rng(seed)
    x, y = np.linspace(20.0, 380.0, 10), np.linspace(20.0, 280.0, 10)
    q = np.array([(one, two, three) for three in (10.0, 120.0, 240.0) for _ in range(2) for two in y for one in x])
    measured = q + NOISE_MM * rng.normal(size=q.shape)
    for axis in range(3):
        u = q[:, axis : axis + 1] / TRAVEL_MM[axis]
        phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        waves = [np.sin(2.0 * np.pi * (1 + number) * u + phase[number]) for number in range(2)]
        shapes = np.hstack([u, 4.0 * u * (1.0 - u), 8.0 * (u - 0.5) ** 3, *waves])
        size = 0.012 * rng.normal(size=(5, 3)) * np.array([0.6, 0.5, 0.35, 0.25, 0.12])[:, None]
        measured += shapes @ size
    rows = np.arange(len(q)) // 10
    columns: dict[str, object] = {"carrier": ["relative"] * len(q), "line": rows.astype(str).tolist()}
    columns |= {name: q[:, index] for index, name in enumerate("xyz")}
    columns |= {f"m{name}": measured[:, index] for index, name in enumerate("xyz")}
    return observations_from_columns(columns | {f"s{name}": np.full(len(q), NOISE_MM) for name in "xyz"})


@pytest.mark.parametrize("seed", range(6))
def test_no_wave_is_named_on_a_grid_of_a_smooth_machine(seed: int) -> None:
    fitted = fit_terms(MACHINE, [grid(seed)], options=FitOptions(components="12", threads=1))
    found = diagnose(fitted, threads=1)
    assert not [str(one.reference) for one in found.found if one.reference.effect in ("periodic", "screw-wobble")]
