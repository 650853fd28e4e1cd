"""A static reference marker tells whether the machine drifts or what measures it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hidden_machine import machine

from geoerr.diagnose.between_passes import BetweenPasses, between_passes
from geoerr.diagnose.marker import Rise
from geoerr.diagnose.space import space_of
from geoerr.fit import FitOptions, fit_terms
from geoerr.observations import Observations, observations_from_columns

NOISE_UM = 4.0
N_LINES, N_PLACES = 40, 12


def observed(device_um: float, machine_um: float, *, has_marker: bool = True, seed: int = 1) -> Observations:
    """Measure lines there and back, of a machine without errors; both drifts are along z, over the session."""
    rng = np.random.default_rng(seed)
    q, line, share = [], [], []
    for number in range(N_LINES):
        along = np.linspace(0.0, 1.0, N_PLACES)[:: 1 if number % 2 else -1, None]
        first, last = np.random.default_rng(number // 2).uniform(20.0, 380.0, (2, 3))
        q.append(first + (last - first) * along)
        line += [f"L{number}"] * N_PLACES
        share.append((number + np.linspace(0.0, 0.9, N_PLACES)) / N_LINES)
    places, gone = np.concatenate(q), np.concatenate(share)
    is_looked_at = np.arange(len(places)) % 4 == 0 if has_marker else np.zeros(len(places), dtype=bool)
    row = np.sort(np.concatenate([np.arange(len(places)), np.flatnonzero(is_looked_at)]))
    is_marker = np.concatenate([[False], np.diff(row) == 0])
    seen = np.where(is_marker[:, None], [450.0, 450.0, 0.0], places[row])
    seen = seen + 1e-3 * NOISE_UM * rng.normal(size=seen.shape)
    seen[:, 2] += 1e-3 * gone[row] * np.where(is_marker, device_um, device_um + machine_um)
    columns: dict[str, object] = {
        "line": [line[one] for one in row],
        "carrier": np.where(is_marker, "base", "tool"),
        "target": np.where(is_marker, "M", "T"),
        "t": 1000.0 * gone[row],
    }
    for index, axis in enumerate("xyz"):
        columns |= {axis: places[row, index], f"m{axis}": seen[:, index]}
        columns |= {f"t{axis}": np.zeros(len(row)), f"s{axis}": np.full(len(row), 1e-3 * NOISE_UM)}
    return observations_from_columns(columns)


@cache
def found(device_um: float, machine_um: float, *, has_marker: bool = True) -> BetweenPasses:
    data = observed(device_um, machine_um, has_marker=has_marker)
    return between_passes(space_of(fit_terms(machine(), [data], options=FitOptions(threads=1))))


def test_a_marker_that_moves_with_the_machine_shows_a_drift_of_the_device() -> None:
    """It was in the data, and the report asked for one."""
    between = found(20.0, 0.0)
    assert between.rises
    assert between.of_marker is not None
    assert between.of_marker.um == pytest.approx(20.0, abs=3.0 * between.of_marker.std_um)
    assert between.of_marker.std_um < 2.0
    assert "a drift of the measuring device (" in between.short_words
    assert "The fixed marker rose with it" in between.words()
    assert between.to_document()["marker_um"] == between.of_marker.um


def test_a_marker_that_stands_still_shows_a_drift_of_the_machine() -> None:
    between = found(0.0, 20.0)
    assert between.rises
    assert between.short_words.startswith("a drift of the machine (")
    assert "The fixed marker stood still" in between.words()


def test_a_marker_that_moves_less_shows_both() -> None:
    between = found(-15.0, 35.0)
    assert between.rises
    assert between.short_words.startswith("a drift of the machine and of the measuring device (")
    assert "The fixed marker fell by 1" in between.words()
    assert "the rest is the machine's" in between.words()


def test_a_marker_that_may_stand_still_and_may_not_does_not_tell() -> None:
    """Of 15 ± 8 µm beside 20 ± 3 the machine was said to drift."""
    known = found(20.0, 0.0)
    unsure = replace(known, of_marker=Rise(15.0, 8.0), of_machine=Rise(20.0, 3.0))
    assert unsure.short_words.startswith("a drift over time (")
    assert "The fixed marker does not tell which" in unsure.words()


def test_without_a_marker_nobody_knows() -> None:
    between = found(20.0, 0.0, has_marker=False)
    assert between.of_marker is None
    assert between.short_words.startswith("a drift over time (")
    assert "A fixed reference marker in the view tells which" in between.words()
    assert between.to_document()["marker_um"] is None


def test_standard_errors_are_those_of_the_rise() -> None:
    rises = []
    for seed in range(30):
        data = observed(0.0, 0.0, seed=seed)
        between = between_passes(space_of(fit_terms(machine(), [data], options=FitOptions(threads=1))))
        assert between.of_marker is not None
        # Along whichever component is largest: none of them drifts.
        rises.append(between.of_marker.um / between.of_marker.std_um)
    assert np.std(rises) == pytest.approx(1.0, rel=0.4)
