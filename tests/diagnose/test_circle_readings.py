"""Readings of circles say of a value what a fit says of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from compare_scenes import MACHINE

from geoerr.diagnose.circles.readings import readings_of
from geoerr.effects import catalogue
from geoerr.effects.plausible import plausible_words
from geoerr.effects.values import BOUND


@pytest.mark.parametrize("period_mm", [5.0, 5.9, 200.0])
def test_a_pitch_is_compared_as_everywhere(period_mm: float) -> None:
    term = catalogue()["periodic"].term("x", None, MACHINE)
    period = replace(term.inner[0], value=period_mm, std=1e-3)
    coefficients = tuple(replace(one, value=5e-3, std=1e-4) for one in term.coefficients)
    term = replace(term, coefficients=coefficients, inner=(period,))
    no_runs: Any = None
    pitch = readings_of(term, np.diag([1e-8, 1e-8, 1e-6]), no_runs)[-1]
    assert (pitch.what, pitch.value) == ("pitch", period_mm)
    assert pitch.says == (BOUND if period_mm == period.high else plausible_words(period, term.inner))
