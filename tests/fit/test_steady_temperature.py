"""Growth of a machine that is kept warm: its fixed point is found where that of a cold one is."""

import numpy as np
import pytest

from geoerr.fit import FitOptions, fit_model
from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

LENGTH_MM, PER_K = 400.0, 12e-6
MACHINE = Machine("chamber", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in "xyz"})


def observed(at_degc: float, fixed_mm: float) -> Observations:
    """A z axis that is held at one place and warms by nine kelvins, three times along all axes and a diagonal."""
    rng = np.random.default_rng(8)
    places = np.linspace(0.0, LENGTH_MM, 11)
    lines = [places[:, None] * np.eye(3)[axis] for axis in range(3)] + [np.repeat(places[:, None], 3, axis=1)]
    q = np.concatenate(lines * 3)
    t = 15.0 * np.arange(len(q))
    warmer = 9.0 * (1.0 - np.exp(-t / 600.0))
    measured = q + 2e-3 * rng.normal(size=q.shape)
    # Before it is warm the axis is as long as it is commanded.
    measured[:, 2] += PER_K * warmer * (q[:, 2] - fixed_mm) + 0.01 * np.sin(q[:, 2] / 70.0)
    columns: dict[str, object] = {"t": t, "temp_bed": at_degc + warmer, "carrier": ["tool"] * len(q)}
    columns |= {"line": np.tile(np.repeat([*"xyzd"], 11), 3), "repeat": np.repeat(np.arange(3), 44)}
    for axis, name in enumerate("xyz"):
        columns |= {name: q[:, axis], f"t{name}": np.zeros(len(q)), f"m{name}": measured[:, axis]}
        columns[f"s{name}"] = np.full(len(q), 2e-3)
    return observations_from_columns(columns)


@pytest.mark.parametrize("at_degc", [20.0, 100.0, -80.0])
@pytest.mark.parametrize("fixed_mm", [460.0, 400.0, 300.0])
def test_growth_is_found_from_where_the_axis_is_held(at_degc: float, fixed_mm: float) -> None:
    """Far from 20 °C most of it is the axis' scale: an expansion of the other sign from the other end is as good."""
    observations = observed(at_degc, fixed_mm)
    effects = "thermal-expansion:z@temp_bed"
    result = fit_model(MACHINE, observations, effects=effects, options=FitOptions(threads=1))
    alpha, place = (result.model.parameter(f"{effects}.{name}") for name in ("alpha", "q_fixed"))
    assert abs(alpha.value - PER_K) < 4.0 * alpha.std < 0.5 * PER_K
    assert abs(place.value - fixed_mm) <= 4.0 * place.std
    cold = fit_model(MACHINE, observed(20.0, fixed_mm), effects=effects, options=FitOptions(threads=1))
    assert alpha.value == pytest.approx(cold.model.parameter(f"{effects}.alpha").value, rel=1e-4)
