"""Measuring frames that no turn of a device can have are refused, and what any turn explains is taken as it is."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from fit_scenes import Numbers
from scipy.spatial.transform import Rotation
from virtual_machine import machine_of

from geoerr.errors import GeometryError
from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.joined import sightings_of, within_the_machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = machine_of("wbXYZt")
SIDE_MM = np.linspace(10.0, 390.0, 11)


def lines(axes: str = "xyz", n_repeats: int = 2) -> Numbers:
    """Go along axes through one place, there and back, (n, 3)."""
    places = np.tile([200.0, 150.0, 50.0], (n_repeats * 2 * len(axes) * len(SIDE_MM), 1))
    strokes = itertools.product(range(n_repeats), axes, (1, -1))
    for number, (_, axis, way) in enumerate(strokes):
        places[number * len(SIDE_MM) : (number + 1) * len(SIDE_MM), "xyz".index(axis)] = SIDE_MM[::way]
    return places


def points(places: Numbers, measured: Numbers, components: str = "xyz") -> Observations:
    columns = {axis: places[:, number] for number, axis in enumerate("xyz")}
    seen = {f"m{axis}": measured[:, "xyz".index(axis)] for axis in components}
    return observations_from_columns({"carrier": ["relative"] * len(places), **columns, **seen})


def noisy(places: Numbers) -> Numbers:
    return np.asarray(places + np.random.default_rng(3).normal(0.0, 5e-3, places.shape))


def taken(places: Numbers, measured: Numbers, components: str = "xyz") -> bool:
    within_the_machine(sightings_of(points(places, measured, components)), MACHINE)
    return True


@pytest.mark.parametrize(
    ("signs", "order", "hint"),
    [
        ((1.0, -1.0, 1.0), (0, 1, 2), "my looks like an axis that is mirrored"),
        ((1.0, 1.0, -1.0), (0, 1, 2), "mz looks like an axis that is mirrored"),
        ((1.0, 1.0, 1.0), (1, 0, 2), "the columns mx and my look exchanged"),
        ((1.0, 1.0, 1.0), (0, 2, 1), "the columns my and mz look exchanged"),
        ((-1.0, -1.0, -1.0), (0, 1, 2), "the sign of one of mx, my, mz reversed"),
    ],
)
def test_a_mirrored_frame_is_refused(signs: Sequence[float], order: Sequence[int], hint: str) -> None:
    """Of three lines a rotation follows all but one: the residual was 65 mm, and a model was written."""
    places = lines()
    with pytest.raises(GeometryError, match=f"mirror image of what was commanded.*\nhint: .*{hint}"):
        fit_terms(MACHINE, [points(places, noisy(places)[:, order] * signs)], options=FitOptions("12"))


@pytest.mark.parametrize("seed", range(5))
def test_a_device_that_stands_anyhow_is_refused_where_it_is_mirrored(seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    places = lines()
    assert taken(places, noisy(places) @ turn.T)
    with pytest.raises(GeometryError, match="mirror image"):
        taken(places, noisy(places) * [1.0, -1.0, 1.0] @ turn.T)


@pytest.mark.parametrize(("components", "column"), [("xy", "my"), ("yz", "my"), ("y", "my")])
def test_devices_that_see_less_are_refused_too(components: str, column: str) -> None:
    places = lines()
    assert taken(places, noisy(places), components)
    with pytest.raises(GeometryError, match=f"hint: {column} looks"):
        taken(places, noisy(places) * [1.0, -1.0, 1.0], components)


def test_two_exchanged_columns_of_two_are_named() -> None:
    places = lines("xy")
    with pytest.raises(GeometryError, match="columns mx and my look exchanged"):
        taken(places, noisy(places)[:, [1, 0, 2]], "xy")


@pytest.mark.parametrize("axes", ["xy", "yz", "x", "z"])
def test_in_a_plane_a_reflection_is_a_turn(axes: str) -> None:
    """A camera that looks from below sees just that."""
    places = lines(axes)
    assert taken(places, noisy(places)[:, [1, 0, 2]])
    assert taken(places, noisy(places) * [1.0, -1.0, 1.0])


@pytest.mark.parametrize("height_mm", [0.05, 0.5, 2.0])
def test_a_plane_that_is_not_quite_one_is_taken_with_errors_of_millimetres(height_mm: float) -> None:
    """The third direction is as large as errors are: nothing says what of it is which."""
    rng = np.random.default_rng(5)
    places = lines("xy")
    places[:, 2] += rng.choice([-height_mm, height_mm], len(places))
    for _ in range(50):
        bow = 3.0 * np.outer(np.cos(places[:, 0] / 60.0 + rng.uniform(0.0, 6.0)), rng.normal(size=3))
        assert taken(places, noisy(places) + bow)


def test_large_errors_are_taken() -> None:
    """Squareness of 2°, scales of a hundredth and bends of millimetres are no mirror."""
    places = lines()
    askew = np.array([[1.01, -0.035, 0.02], [0.0, 0.99, 0.03], [0.0, 0.0, 1.005]])
    assert taken(places, places @ askew.T + 3.0 * np.sin(places[:, [1, 2, 0]] / 50.0))


def test_a_few_slips_of_sign_are_rows_and_not_a_frame() -> None:
    """Of points in a plane that five rows leave, these are all that tell of the third direction."""
    places = np.concatenate([lines("xy"), [[200.0, 150.0, 50.0 + rise] for rise in (20, 40, 60, 80, 100)]])
    measured = noisy(places)
    measured[-5:, 2] *= -1.0
    assert taken(places, measured)


def test_where_targets_sit_says_nothing() -> None:
    """A plate whose offsets have a wrong sign goes along as it ought to: they are to be mended, not the frame."""
    rng = np.random.default_rng(6)
    offsets = rng.uniform(-60.0, 60.0, (6, 3))
    places = np.repeat(lines("xy"), len(offsets), axis=0)
    stated = np.tile(offsets, (len(places) // len(offsets), 1))
    rows = observations_from_columns(
        {
            "carrier": ["tool"] * len(places),
            **{axis: places[:, number] for number, axis in enumerate("xyz")},
            **{f"t{axis}": stated[:, number] for number, axis in enumerate("xyz")},
            **{f"m{axis}": (places + stated * [1.0, 1.0, -1.0])[:, number] for number, axis in enumerate("xyz")},
        }
    )
    notes = within_the_machine(sightings_of(rows), MACHINE).notes
    assert any("an offset of another sign" in note for note in notes)
