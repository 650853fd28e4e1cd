"""Targets that do the opposite of what their carrier does: a carrier that nobody stated, or another chain."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from fit_scenes import fitted
from scipy.spatial.transform import Rotation
from virtual_machine import camera, draw_truth, machine_of, nine_lines, observe

from geoerr.errors import GeometryError
from geoerr.fit.joined import sightings_of, within_the_machine
from geoerr.observations import Observations, observations_from_columns

CHAIN = "wZbXYt"


def nine_lines_seen(seed: int = 7) -> Observations:
    """Two targets on the tool and on the bed, whose errors are those of a printer."""
    rng = np.random.default_rng(seed)
    machine = machine_of(CHAIN)
    truth = draw_truth(rng, CHAIN, follows_tangent=True, n_points=9)
    return observe(machine, truth, nine_lines(machine), {"0": camera(rng)}, covariance_mm2=1e-6 * np.eye(3), rng=rng)


def with_carrier(observations: Observations, carrier: str) -> Observations:
    return Observations(observations.frame.with_columns(pl.lit(carrier).alias("carrier")), observations.sources)


def test_carriers_that_go_where_they_ought_to_are_fitted() -> None:
    observations = nine_lines_seen()
    assert len(fitted(machine_of(CHAIN), observations).sightings) == len(observations)


def test_a_carrier_that_nobody_stated_is_named() -> None:
    """Z moves the bed: a third of the rows only, which passed as a residual of 48 mm and errors of 100."""
    observations = nine_lines_seen()
    with pytest.raises(GeometryError, match=r"when Z moved, targets with carrier tool moved with it.*stands still"):
        fitted(machine_of(CHAIN), with_carrier(observations, "tool"))
    with pytest.raises(
        GeometryError, match=r"when X moved, targets with carrier work moved with it.*\nhint: `carrier` says"
    ):
        fitted(machine_of(CHAIN), with_carrier(observations, "work"))


def test_a_chain_of_another_machine_is_named() -> None:
    with pytest.raises(GeometryError, match=r"when Z moved, targets with carrier work moved with it.*machine wbXYZt"):
        fitted(machine_of("wbXYZt"), nine_lines_seen())


def test_an_axis_that_did_not_move_is_named() -> None:
    observations = nine_lines_seen()
    still = observations.frame.with_columns(
        **{name: pl.when(pl.col("y") > 0.0).then(pl.col(name).first()).otherwise(name) for name in ("mx", "my", "mz")}
    )
    moves_y = still.filter(pl.col("y") > 0.0).height
    assert moves_y > 10
    with pytest.raises(GeometryError, match=r"when Y moved, targets with carrier tool stood still.*goes along"):
        fitted(machine_of(CHAIN), Observations(still))


@pytest.mark.parametrize(("factor", "unit"), [(1.0 / 25.4, "inches"), (1e-3, "metres"), (1e3, "µm")])
def test_another_unit_is_no_other_carrier(factor: float, unit: str) -> None:
    observations = nine_lines_seen()
    scaled = observations.frame.with_columns(**{name: pl.col(name) * factor for name in ("mx", "my", "mz")})
    with pytest.raises(GeometryError, match=f"do not follow the commanded ones.*\nhint: .*{unit}"):
        fitted(machine_of(CHAIN), Observations(scaled))


def scattered(carrier: str, n: int, moved: str = "xyz", gross: int = 0) -> Observations:
    """Draw places anywhere and a device that stands askew; `moved` are the axes that the target goes with."""
    rng = np.random.default_rng(n)
    places = rng.uniform(0.0, 300.0, (n, 3))
    seen = places * [axis in moved for axis in "xyz"] + rng.normal(0.0, 0.01, (n, 3))
    seen[:gross] += rng.uniform(-50.0, 50.0, (gross, 3))
    turned = seen @ Rotation.random(random_state=n).as_matrix().T
    columns = {axis: places[:, number] for number, axis in enumerate("xyz")}
    measured = {f"m{axis}": turned[:, number] for number, axis in enumerate("xyz")}
    return observations_from_columns({"carrier": [carrier] * n, **columns, **measured})


@pytest.mark.parametrize("gross", [0, 8])
@pytest.mark.parametrize("n", [30, 1000])
def test_steps_of_several_axes_name_a_carrier_too(n: int, gross: int) -> None:
    """No axis moves alone among scattered points, which passed as a residual of 86 mm and a roll of 0.3 rad."""
    machine = machine_of(CHAIN)
    within_the_machine(sightings_of(scattered("tool", n, "xy", gross)), machine)
    within_the_machine(sightings_of(scattered("relative", n, "xyz", gross)), machine)
    with pytest.raises(GeometryError, match=r"carrier tool move along with Z.*machine wZbXYt.*\nhint: .*relative"):
        within_the_machine(sightings_of(scattered("tool", n, "xyz", gross)), machine)
    with pytest.raises(GeometryError, match=r"carrier relative do not move with Z"):
        within_the_machine(sightings_of(scattered("relative", n, "xy", gross)), machine)
    with pytest.raises(GeometryError, match=r"carrier work move along with X"):
        within_the_machine(sightings_of(scattered("work", n, "xyz", gross)), machine)


def test_few_steps_or_what_no_carrier_does_are_left_to_others() -> None:
    machine = machine_of(CHAIN)
    within_the_machine(sightings_of(scattered("tool", 8)), machine)
    stretched = scattered("tool", 100, "xy")
    frame = stretched.frame.with_columns(**{name: 1.7 * pl.col(name) for name in ("mx", "my", "mz")})
    within_the_machine(sightings_of(Observations(frame, stretched.sources)), machine)


def test_one_component_that_follows_nothing_is_refused_by_its_name() -> None:
    """A third of the numbers is fewer than half, and was fitted."""
    observations = nine_lines_seen()
    wild = np.random.default_rng(1).uniform(-200.0, 200.0, len(observations))
    frame = observations.frame.with_columns(mz=pl.Series(wild))
    with pytest.raises(GeometryError, match=r"do not follow the commanded ones: half of m[xyz] is off by more"):
        fitted(machine_of(CHAIN), Observations(frame, observations.sources))


def test_a_laser_that_saw_what_stands_still_move_is_refused() -> None:
    """One component tells no carrier, and a place that never changes spans nothing to compare with."""
    z_mm = np.tile(np.linspace(0.0, 300.0, 13), 2)
    run = observations_from_columns({"carrier": "tool", "x": 100.0, "y": 100.0, "z": z_mm, "mz": -z_mm})
    with pytest.raises(GeometryError, match=r"half of mz is off by more than 75\.0 mm over 300 mm\n.*the carriers"):
        fitted(machine_of(CHAIN), run)
