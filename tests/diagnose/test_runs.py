"""Runs by which sizes are counted: of lines, to and fro, and of scattered points."""

from __future__ import annotations

import numpy as np
from compare_scenes import MACHINE, measured, passes_along, places

from geoerr.diagnose.runs import runs_of
from geoerr.diagnose.sizes import chance_between_runs, chance_within_runs, off_neighbours
from geoerr.fit import Sightings, sightings_of
from geoerr.model import Model

NOMINAL = Model(MACHINE)


def seen(q_mm: np.ndarray, lines: list[str]) -> Sightings:
    return sightings_of(measured(q_mm, NOMINAL.tool_from_work(q_mm), line=lines))


def test_a_line_there_and_back_is_two_runs_each_time() -> None:
    there = np.linspace(0.0, 400.0, 8)
    x = np.concatenate([there, there[::-1], there, there[::-1]])
    q = np.column_stack([x, np.full_like(x, 100.0), np.full_like(x, 50.0)])
    runs = runs_of(seen(q, ["X"] * len(x)))
    assert not runs.is_scattered.any()
    assert len(np.unique(runs.number)) == 4
    assert [len(np.unique(runs.number[at : at + 7])) for at in (1, 9, 17, 25)] == [1, 1, 1, 1]


def test_lines_are_their_passes() -> None:
    q, own_pass = passes_along(np.random.default_rng(1), 12, 10)
    runs = runs_of(seen(q, [f"L{number}" for number in own_pass]))
    assert np.array_equal(runs.number, own_pass)
    assert not runs.level.any()


def test_scattered_points_are_one_run_by_its_name() -> None:
    own = np.repeat(np.arange(12), 10)
    sightings = seen(places(np.random.default_rng(2), 120), [f"L{number}" for number in own])
    assert sightings.n_passes > 24
    runs = runs_of(sightings)
    assert np.array_equal(runs.number, own)
    assert runs.is_scattered.all()


def test_one_run_of_scattered_points_is_cut_and_its_pieces_are_held_against_each_other_alone() -> None:
    runs = runs_of(seen(places(np.random.default_rng(3), 240), ["all"] * 240))
    assert np.array_equal(runs.number, np.arange(240) // 10)
    assert len(np.unique(runs.level)) == 1
    assert runs.level.all()
    two = runs_of(seen(places(np.random.default_rng(4), 240), ["first"] * 120 + ["second"] * 120))
    assert np.array_equal(two.number, np.arange(240) // 10)
    assert np.array_equal(two.level[:120] == two.level[0], np.ones(120, dtype=bool))
    assert (two.level[120:] != two.level[0]).all()


def test_by_chance_chances_are_even() -> None:
    """Of 400 draws with offsets of runs the chances are spread evenly, and of none of them below 1/1000."""
    rng = np.random.default_rng(5)
    run = np.repeat(np.arange(20), 12)
    between, within = [], []
    for _ in range(400):
        place = rng.uniform(-1.0, 1.0, 20)[run] + rng.uniform(-0.2, 0.2, len(run))
        places_of = np.column_stack([place, place**2])
        size = np.abs(rng.normal(size=len(run))) + rng.uniform(0.0, 0.1, 20)[run]
        between.append(chance_between_runs(size, places_of, run, np.zeros_like(run)))
        within.append(chance_within_runs(size, places_of, run))
    for found in (np.array(between, dtype=float), np.array(within, dtype=float)):
        shares = [float(np.mean(found < level)) for level in (0.05, 0.5)]
        assert found.min() > 1e-3
        # Standard errors of 0.011 and 0.025.
        assert shares[0] < 0.05 + 3.0 * 0.011
        assert abs(shares[1] - 0.5) < 4.0 * 0.025


def test_pieces_of_one_run_are_not_held_against_those_of_another() -> None:
    rng = np.random.default_rng(6)
    run = np.repeat(np.arange(24), 10)
    level = run // 12
    size, place = np.abs(rng.normal(size=len(run))), rng.uniform(-0.3, 0.3, 24)[run]
    # One run is three times as rough as the other, and warmer.
    size, place = size * (1.0 + 2.0 * level), (place + level)[:, None]
    alone = chance_between_runs(size, place, run, level)
    as_one = chance_between_runs(size, place, run, np.zeros_like(level))
    assert as_one is not None
    assert as_one < 1e-6
    assert alone is not None
    assert alone > 0.01


def test_what_follows_the_variable_is_no_width() -> None:
    run = np.repeat(np.arange(40), 5)
    place = np.linspace(-1.0, 1.0, 40)[run][:, None]
    offset = np.where(np.arange(40) % 2, 1.0, -1.0)[run]
    # Ten steps of four runs each: of an error that follows the variable nothing is left.
    off = off_neighbours(50.0 * (run // 4) + offset, place, run)
    assert np.allclose(off, offset)
    assert np.allclose(off_neighbours(offset, place, run), offset)
