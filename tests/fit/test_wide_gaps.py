"""Stretches of an axis in which nothing was measured."""

import numpy as np
import pytest
from validation.laser_run import MACHINE, laser_run

from geoerr.fit import fit_model
from geoerr.fit.joined import sightings_of
from geoerr.fit.wide_gaps import wide_gaps
from geoerr.observations import observations_from_columns

EVEN = np.linspace(0.0, 400.0, 21)


def said(places_mm: np.ndarray) -> tuple[str, ...]:
    """Give what a fit says of a laser's run through some places."""
    run = laser_run(places_mm, 3)
    error_um = 5.0 * np.sin(run.x_mm / 80.0) + 0.1 * np.random.default_rng(3).normal(size=len(run.x_mm))
    fitted = fit_model(MACHINE, run.observed(error_um)).fitted
    assert tuple(wide_gaps(fitted.sightings, MACHINE)) == tuple(
        note for note in fitted.sightings.notes if note.startswith("nothing was measured")
    )
    return tuple(wide_gaps(fitted.sightings, MACHINE))


def test_a_gap_of_half_the_travel_is_told() -> None:
    (note,) = said(np.concatenate([EVEN[EVEN <= 100.0], EVEN[EVEN >= 300.0]]))
    assert note.startswith("nothing was measured between x = 100 and 300 mm: ")


def test_gaps_between_clusters_are_counted() -> None:
    middles = np.array([0.0, 130.0, 262.0, 397.0])
    (note,) = said(np.sort((middles[:, None] + np.arange(4.0)).ravel()))
    assert note.startswith("nothing was measured between x = 265 and 397 mm (and in 2 other such gaps): ")


@pytest.mark.parametrize("seed", range(5))
def test_places_as_they_are_usual_have_no_gap(seed: int) -> None:
    drawn = np.sort(np.random.default_rng(seed).uniform(0.0, 400.0, 24))
    assert not said(drawn)
    assert not said(EVEN)
    assert not said(np.array([0.0, 30.0, 200.0, 370.0, 400.0]))


@pytest.mark.parametrize("seed", range(8))
def test_an_axis_that_stands_has_no_gap(seed: int) -> None:
    """Its positions may be read from an encoder, and scatter by some micrometres."""
    n = len(EVEN)
    columns = {"line": ["x"] * n, "carrier": ["relative"] * n, "x": EVEN, "z": np.full(n, 100.0), "mx": EVEN}
    columns |= {f"t{axis}": np.zeros(n) for axis in "xyz"}
    columns["y"] = 200.0 + 0.004 * np.random.default_rng(seed).normal(size=n).round(1)
    sightings = sightings_of(observations_from_columns(columns))
    assert np.ptp(sightings.commanded_mm[:, 1]) > 0.0
    assert not tuple(wide_gaps(sightings, MACHINE))
