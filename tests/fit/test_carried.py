"""Targets that do the opposite of what their carrier does: a carrier that nobody stated, or another chain."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from fit_scenes import fitted
from virtual_machine import camera, draw_truth, machine_of, nine_lines, observe

from geoerr.errors import GeometryError
from geoerr.observations import Observations

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
