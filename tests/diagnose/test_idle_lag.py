"""A lag that has come to the least that is looked for, and does nothing there, is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geoerr
from geoerr.diagnose import diagnose
from geoerr.diagnose.change import add_effect
from geoerr.diagnose.search.best_form import beside_others
from geoerr.diagnose.search.settle import settle_as
from geoerr.fit.additions import Way
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns
from geoerr.terms import Term

MACHINE = Machine.from_chain("wbZYXt", (350.0, 350.0, 340.0))
NAME = "thermal-drift:z@temp_bed"


def homed(tau_s: float) -> Observations:
    """Give the height of a place that a bed moves, whose temperature ramps, with this time constant (exact)."""
    rng, bends = np.random.default_rng(7), np.arange(12)
    t_s = 30.0 * np.arange(480)
    bend_k_s = np.where(bends % 3 == 2, -0.04, 0.02)
    since_s = np.maximum(t_s[:, None] - 1200.0 * bends, 0.0)
    behind_s = tau_s * (1.0 - np.exp(-since_s / max(tau_s, 1e-9)))
    bed_degc, grown_k = 22.0 + since_s @ bend_k_s, (since_s - behind_s) @ bend_k_s
    n = len(t_s)
    seen = {"mx": [None] * n, "my": [None] * n, "mz": 1.5e-3 * grown_k + 0.002 * rng.normal(size=n)}
    place = {"x": np.full(n, 175.0), "y": np.full(n, 175.0), "z": np.zeros(n)}
    return observations_from_columns(
        {"line": ["home"] * n, "carrier": ["relative"] * n, **place, **seen, "t": t_s, "temp_bed": bed_degc}
    )


def beside_nothing(tau_s: float) -> tuple[Term, Term]:
    """Give the lagged form at its least lag, and what becomes of it where it is estimated again."""
    searched = diagnose(Model(MACHINE), homed(tau_s)).searched
    judged = next(one for one in searched.first.candidates if str(one.what.reference) == NAME)
    lagged = next(one for one in judged.what.terms if one.inner)
    (tau,) = lagged.inner
    assert tau.low is not None
    space = searched.first.space
    scanner = searched.bench.scanner(space, n_draws=0)
    settled = settle_as(space, scanner, lagged, [tau.low], {})
    again = beside_others(space, scanner, judged, settled)
    assert settled.term is not None
    assert again.term is not None
    return settled.term, again.term


def test_where_nothing_lags_the_form_without_a_lag_is_taken() -> None:
    lagged, again = beside_nothing(0.0)
    assert [one.name for one in lagged.inner] == ["tau"]
    assert not again.inner
    (k,) = again.coefficients
    assert 1e3 * k.value == pytest.approx(1.5, abs=4e3 * k.std)


def test_where_even_the_least_lag_says_more_it_stays() -> None:
    lagged, again = beside_nothing(60.0)
    assert [one.name for one in again.inner] == [one.name for one in lagged.inner]


@pytest.mark.real_data
def test_the_bed_of_the_voron_is_named_beside_its_frame(real_data: Path) -> None:
    """The frame's thermometer is known, the bed's is found, and moves the gantry without a lag of its own.

    In the noise of this run, which drifts, none pays for itself: where every row counts by itself a lag of 57 s lets
    the residual fall from 4.8 to 4.2 µm, as `geoerr add --lag yes` gives it.
    """
    folder = real_data / "thermal"
    observations = geoerr.read_observations(folder / "observations.csv")
    machine = geoerr.read_machine(folder / "machine.toml")
    frame = add_effect(Model(machine), observations, reference="thermal-drift:z@temp_frame", way=Way(lagged=False))
    diagnosis = diagnose(frame.result.model, observations)
    first = diagnosis.found[0]
    assert str(first.reference) == NAME
    # Of one place: that the head rises or the work sinks is the same.
    assert {str(one.reference) for one in diagnosis.tied} == {NAME, NAME.replace(":z", ":work-z")}
    assert [one.name for one in first.parameters] == ["k"]
    assert first.held_out.before_um == pytest.approx(41.6, abs=0.1)
    assert first.held_out.after_um < 6.0
    bed = add_effect(frame.result.model, observations, reference=NAME, way=Way(lagged=True))
    tau = bed.result.model.parameter(f"{NAME}.tau")
    assert tau.value == pytest.approx(57.4, abs=0.1)
    assert bed.before.figures.rmse_um == pytest.approx(36.9, abs=0.1)
    assert bed.after.figures.rmse_um == pytest.approx(4.22, abs=0.01)
