"""A device that is set up anew for every line may roll about it: the machine's errors tell how far, no jump does."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from hidden_machine import Motion, Noise, Plan, machine, measure, motion

from geoerr.diagnose import compare, diagnose
from geoerr.fit import FitOptions, fit_model, fit_terms
from geoerr.fit.fitted import Fitted
from geoerr.observations import Observations

WHITE = Noise(white=(2.0, 2.0, 2.0))
PERIOD_MM = 7.3


@cache
def moved() -> Motion:
    return motion(np.random.default_rng(3), Plan(n_sessions=2, n_lines=15, n_points=12))


def observed(moved: Motion, wave_um: float = 0.0) -> Observations:
    """Frames are turned by up to 0.6 rad about any axis; the machine is the same for every seed of a motion."""
    wave = np.outer(np.sin(2.0 * np.pi * moved.q[:, 0] / PERIOD_MM), [1.0, 0.0, 0.0])
    return measure(np.random.default_rng(103), moved, WHITE, wave_um * wave)


def with_markers(observations: Observations) -> Observations:
    """A marker that stands still is seen at the end of every line."""
    frame = observations.frame
    last = frame.group_by("session", maintain_order=True).last()
    place = {f"m{name}": pl.col(f"m{name}") + 150.0 for name in "xyz"}
    still = last.with_columns(carrier=pl.lit("base", frame.schema["carrier"]), **place)
    return Observations(pl.concat([frame, still.select(frame.columns)]))


def fitted_by_line(wave_um: float = 0.0, *, has_markers: bool = False) -> Fitted:
    """Commands are rounded to micrometres: diagonals lie beside their line by what no roll is to be read from."""
    one = moved()
    one = replace(one, session=one.line, q=np.round(one.q, 3))
    table = observed(one, wave_um)
    return fit_terms(machine(), [with_markers(table) if has_markers else table], options=FitOptions(threads=1))


def test_only_noise_is_left_and_nothing_is_missing() -> None:
    fitted = fitted_by_line(has_markers=True)
    assert fitted.solved.converged
    assert abs(fitted.solved.chi_squared / fitted.dof - 1.0) < 4.0 * np.sqrt(2.0 / fitted.dof)
    assert diagnose(fitted, threads=1).verdict == "nothing-missing"


def test_rolls_that_have_not_settled_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geoerr.fit.fit._MOST_ROLLS", 1)
    assert not fitted_by_line().solved.converged


def test_a_wave_keeps_its_name() -> None:
    found = diagnose(fitted_by_line(wave_um=6.0), threads=1).found
    assert [str(one.reference) for one in found] == ["periodic:x"]


def test_a_held_model_is_off_by_noise_only() -> None:
    """Both sets come from one machine; the second has a session for every line."""
    one = motion(np.random.default_rng(3), Plan(n_sessions=2, n_lines=30, n_points=24))
    model = fit_model(machine(), observed(one), options=FitOptions(threads=1)).model
    lines = observed(replace(moved(), session=moved().line))
    comparison = compare(model, lines, threads=1)
    assert comparison.figures.rmse_um < 2.0 * np.sqrt(3.0) * 1.1
    assert diagnose(model, lines, threads=1).verdict == "nothing-missing"
