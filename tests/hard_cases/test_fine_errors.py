"""Errors finer than a model's functions are no wave, though the best wave explains a part of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest
from hidden_machine import LENGTH_MM, Noise, Plan, machine, measure, motion
from validation.fine_errors import Curve, bump, step

from geoerr.diagnose import Diagnosis
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.search.coherence import is_one_wave
from geoerr.diagnose.search.settle import settle_as
from geoerr.fit import FitOptions, fit_model

Draw = Callable[[np.random.Generator], Curve]
PERIOD_MM = 20.0


def diagnosed(rng: np.random.Generator, errors: Sequence[Curve], noise_um: float) -> Diagnosis:
    """Let axes have errors along themselves, µm."""
    moved = motion(rng, Plan())
    hidden = np.zeros_like(moved.q)
    for axis, error in enumerate(errors):
        hidden[:, axis] = error(moved.q[:, axis])
    observations = measure(rng, moved, Noise(white=(noise_um,) * 3), hidden)
    return diagnose(fit_model(machine(), observations, options=FitOptions(threads=1)).fitted, threads=1)


@pytest.mark.parametrize("seed", [102, 103])
@pytest.mark.parametrize("draw", [step, bump])
def test_a_step_and_a_bump_are_no_waves(draw: Draw, seed: int) -> None:
    """How often one is called a wave all the same: `validation/fine_errors.md`."""
    rng = np.random.default_rng(seed)
    assert diagnosed(rng, [draw(rng) for _ in range(3)], 2.0).found == ()


def wave(size_um: Curve) -> Curve:
    return lambda q: size_um(q) * np.sin(2.0 * np.pi * q / PERIOD_MM)


def even_um(q: np.ndarray) -> np.ndarray:
    return np.full_like(q, 4.0)


@cache
def diagnosed_wave(size_um: Curve) -> Diagnosis:
    return diagnosed(np.random.default_rng(1), [wave(size_um)], 2.0)


def test_a_wave_is_one_along_all_of_its_axis_also_where_it_wears() -> None:
    for size_um in (even_um, lambda q: 4.0 + 2.0 * q / LENGTH_MM):
        found = diagnosed_wave(size_um)
        assert [str(one.reference) for one in found.found] == ["periodic:x"]
        assert is_one_wave(found.searched.bench.functions, found.searched.found[0].settled)


def test_a_wave_that_ends_midway_is_not_one_wave() -> None:
    """No screw turns in half of its length alone."""
    whole, half = diagnosed_wave(even_um), diagnosed_wave(lambda q: 4.0 * (q < 0.5 * LENGTH_MM))
    (waves,) = whole.searched.found
    assert is_one_wave(whole.searched.bench.functions, waves.settled)
    # The same term, of what the machine with half a wave leaves.
    ending = settle_as(half.searched.first.space, half.searched.first.scanner, waves.settled.term, [PERIOD_MM], {})
    assert not is_one_wave(half.searched.bench.functions, ending)
    assert "periodic:x" not in {str(one.reference) for one in half.found}
