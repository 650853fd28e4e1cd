"""Positions that were measured in another unit are told: residuals of hundreds of metres came without a word."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.fit.joined import sightings_of, within_the_machine
from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine(name="m", chain="wbXYZt", axes={axis: Axis((0.0, 300.0)) for axis in "xyz"})


def measured(times: float, components: str = "xyz", carrier: str = "relative", n: int = 12) -> Observations:
    rng = np.random.default_rng(4)
    places = rng.uniform(0.0, 300.0, (n, 3))
    # The device stands askew where it sees all three.
    turned = (
        places @ np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]) if len(components) == 3 else places
    )
    seen = {f"m{axis}": times * turned[:, "xyz".index(axis)] for axis in components}
    return observations_from_columns(
        {"carrier": [carrier] * n, **{axis: places[:, k] for k, axis in enumerate("xyz")}, **seen}
    )


def told(rows: Observations) -> list[str]:
    return [note for note in sightings_of(rows).notes if "look like" in note]


@pytest.mark.parametrize(("times", "unit"), [(1e3, "µm"), (1.0 / 25.4, "inches"), (1e-3, "metres")])
@pytest.mark.parametrize("components", ["xyz", "y"])
def test_another_unit_is_named(times: float, unit: str, components: str) -> None:
    (note,) = told(measured(times, components))
    assert note.endswith(f"these look like {unit}")


@pytest.mark.parametrize("times", [1.0, 1.01, 0.99, 2.0, 0.5, 10.0])
def test_millimetres_are_not_told(times: float) -> None:
    assert not told(measured(times))
    assert not told(measured(times, "x"))


def test_what_does_not_move_says_nothing() -> None:
    assert not told(measured(0.0, carrier="base"))
    assert not told(measured(1e3, n=4))


@pytest.mark.parametrize(("times", "is_told"), [(1e-3, True), (1.0, False), (0.01, False), (1e-5, False)])
def test_places_in_metres_are_told(times: float, is_told: bool) -> None:
    """All of it in metres is consistent: 0.3 mm of a machine of 300 mm are no measurement of it."""
    rng = np.random.default_rng(4)
    places = times * rng.uniform(0.0, 300.0, (12, 3))
    columns = {f"{prefix}{axis}": places[:, k] for k, axis in enumerate("xyz") for prefix in ("", "m")}
    rows = observations_from_columns({"carrier": ["relative"] * 12, **columns})
    assert (
        any("look like metres" in note for note in within_the_machine(sightings_of(rows), MACHINE).notes) is is_told
    )
