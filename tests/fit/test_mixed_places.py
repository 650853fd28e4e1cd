"""A laser at many places of an axis, and an artefact at few: each function has the places of what shows it."""

from __future__ import annotations

import numpy as np

from geoerr.fit import fit_model
from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

RANGES = {"x": (0.0, 600.0), "y": (0.0, 400.0), "z": (-450.0, 0.0)}
MACHINE = Machine("mill", "wXYbZt", {axis: Axis(own) for axis, own in RANGES.items()}, tool_offset_mm=(0.0, 0.0, 0.0))
LASER_UM, PLATE_UM = 0.3, 0.8


def _wave_mm(x_mm: np.ndarray) -> np.ndarray:
    """Error in the direction of x, whose places the plate does not show."""
    return 0.010 * np.sin(2.0 * np.pi * x_mm / 300.0)


def _laser(rng: np.random.Generator) -> Observations:
    x = np.concatenate([np.linspace(*RANGES["x"], 31)[::way] for _ in range(3) for way in (1, -1)])
    n, number = len(x), np.repeat(np.arange(6), 31)
    columns = {
        **{"x": x, "y": np.full(n, 200.0), "z": np.full(n, -200.0), "dir_x": np.where(number % 2, -1, 1)},
        **{"tx": np.zeros(n), "ty": np.zeros(n), "tz": np.zeros(n)},
        **{"mx": x + _wave_mm(x) + rng.normal(0.0, 1e-3 * LASER_UM, n), "my": np.full(n, np.nan)},
        **{"mz": np.full(n, np.nan), "repeat": number // 2},
        **{"carrier": ["relative"] * n, "session": ["laser"] * n, "line": ["X"] * n},
    }
    return observations_from_columns(columns)


def _plate(rng: np.random.Generator) -> Observations:
    offsets_mm = [(0.0, 0.0, 0.0), (80.0, 0.0, -60.0), (0.0, 80.0, -120.0)]
    place = [
        (*offset, x, y, z, repeat, way, f"{number} {y} {z}")
        for number, offset in enumerate(offsets_mm)
        for repeat in range(2)
        for z in (-400.0, -250.0, -60.0)
        for y in (40.0, 150.0, 260.0, 370.0)
        for way in (1, -1)
        for x in (30.0, 170.0, 310.0, 450.0, 590.0)[::way]
    ]
    tx, ty, tz, x, y, z, repeat, way = (np.array(own, dtype=np.float64) for own in list(zip(*place, strict=True))[:8])
    n = len(x)
    noise = rng.normal(0.0, 1e-3 * PLATE_UM, (n, 3))
    columns = {
        **{"x": x, "y": y, "z": z, "dir_x": way.astype(np.int64), "tx": tx, "ty": ty, "tz": tz},
        **{"mx": x + tx + _wave_mm(x) + noise[:, 0], "my": y + ty + noise[:, 1], "mz": z + tz + noise[:, 2]},
        **{"repeat": repeat.astype(np.int64), "carrier": ["relative"] * n, "session": ["plate"] * n},
        "line": [one[-1] for one in place],
    }
    return observations_from_columns(columns)


def test_an_artefact_beside_a_laser_takes_no_places_away() -> None:
    rng = np.random.default_rng(3)
    result = fit_model(MACHINE, _laser(rng), _plate(rng))
    along = np.linspace(20.0, 580.0, 100)
    command = np.column_stack([along, np.full(100, 200.0), np.full(100, -200.0)])
    off_um = 1e3 * (result.model.error_mm(command)[:, 0] - _wave_mm(along))
    # A set-up of its own tells neither where it stands nor how long its millimetres are along other lines.
    straight = np.polynomial.Polynomial.fit(along, off_um, 1)(along)
    assert np.abs(off_um - straight).max() < 1.0
    assert result.figures["lack_of_fit_um"] < 0.5
    # Angles have the plate's places still, and nothing of x is open.
    of_x = {"EXX", "EYX", "EZX", "EAX", "EBX", "ECX"}
    assert of_x.isdisjoint(result.fitted.undetermined.names)
