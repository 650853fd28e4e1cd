"""Rows that were taken before an axis had moved: its play is an unknown there, and takes no other error away."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from fit_scenes import Numbers, camera_near_base, curve_of, fitted, lost, points, value_of
from virtual_machine import LENGTH_MM, machine_of

from geoerr.diagnose import compare
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, fit_terms, result_of
from geoerr.fit.empirical import empirical_term
from geoerr.observations import Observations

MACHINE = machine_of("wZbXYt")
STD_MM = 1e-3
PLAY_MM = 0.03
OFFSETS_MM = np.array([[0.0, 0.0, 0.0], [150.0, 0.0, 80.0], [0.0, 150.0, -60.0]])
Q_MM = np.linspace(0.0, LENGTH_MM, 9)
# How far the play moves y at a direction; of `lateral-play` it moves x and z.
MOVES = {
    "backlash": [0.0, -0.5, 0.0],
    "lateral-play": [0.5, 0.0, -0.25],
    "reversal-windup": [0.0, -0.5, 0.0],
}


def straightness_mm(q_mm: Numbers) -> Numbers:
    """An error of x with no slope by least squares over even steps, and 0 at 0."""
    return np.asarray(0.03 * ((2.0 * q_mm / LENGTH_MM - 1.0) ** 2 - 1.0))


def three_lines(effect: str, direction: int, seed: int, *, n_sessions: int = 1) -> Observations:
    """X, Y and Z there and back; y came to the first line in a direction that the file does not know."""
    rng = np.random.default_rng(seed)
    q, d_y, line, session = [], [], [], []
    for number in range(n_sessions):
        last = direction if number == 0 else -direction
        for axis, name in enumerate("xyz"):
            for way in (1, -1):
                rows = np.zeros((len(Q_MM), 3))
                rows[:, axis] = Q_MM[::way]
                # The first row of a way back is a second look at the end: y has not turned yet.
                directions = np.full(len(rows), last)
                if name == "y":
                    directions[1:] = way
                    directions[0] = last if way == 1 else 1
                    last = way
                q.append(np.repeat(rows, len(OFFSETS_MM), axis=0))
                d_y.append(np.repeat(directions, len(OFFSETS_MM)))
                line += [name] * len(q[-1])
                session += [f"s{number}"] * len(q[-1])
    q_mm, d, offset = np.concatenate(q), np.concatenate(d_y), np.tile(OFFSETS_MM, (len(np.concatenate(q)) // 3, 1))
    error = PLAY_MM * d[:, None] * np.array(MOVES[effect])
    error[:, 1] += straightness_mm(q_mm[:, 0])
    error[:, 0] += 5e-5 * q_mm[:, 0]
    cameras = {name: camera_near_base(rng) for name in dict.fromkeys(session)}
    seen = np.array(
        [
            point @ cameras[name].turn.T + cameras[name].shift_mm
            for point, name in zip(q_mm + offset + error, session, strict=True)
        ]
    )
    seen += STD_MM * np.random.default_rng(seed + 1).normal(size=seen.shape)
    columns: dict[str, object] = {"carrier": ["relative"] * len(q_mm), "line": line, "session": session}
    return points(q_mm, offset, seen, covariance_mm2=np.eye(3) * STD_MM**2, **columns)


@pytest.mark.parametrize("effect", list(MOVES))
@pytest.mark.parametrize("direction", [1, -1])
def test_a_play_takes_no_error_of_an_axis_that_was_measured_before(effect: str, direction: int) -> None:
    table = three_lines(effect, direction, 11)
    play = catalogue()[effect].term("y", None, MACHINE)
    result = fitted(MACHINE, table, effects=[play])
    assert len(result.sightings) == len(table)
    assert not result.sightings.left_out
    assert not lost(result)
    values, std = curve_of(result, "EYX", Q_MM)
    off = values - straightness_mm(Q_MM)
    assert np.abs(off - off.mean()).max() < 2.0 * STD_MM
    assert (std < STD_MM).all()
    scale = curve_of(result, "EXX", np.array([0.0, LENGTH_MM]))[0]
    assert scale[1] - scale[0] == pytest.approx(5e-5 * LENGTH_MM, abs=3e-3)
    found, error = value_of(result, play.id)
    assert abs(found - PLAY_MM) < 5.0 * error
    assert result.solved.chi_squared / result.dof == pytest.approx(1.0, abs=0.2)


def test_errors_do_not_depend_on_how_the_axis_came() -> None:
    """The same noise, the other side: what is fitted of all else is the same, session by session."""
    play = catalogue()["backlash"].term("y", None, MACHINE)
    one, other = (
        fitted(MACHINE, three_lines("backlash", direction, 3, n_sessions=2), effects=[play]) for direction in (1, -1)
    )
    for name in ("EXX", "EYX", "EZX", "EYY"):
        values, others = curve_of(one, name, Q_MM)[0], curve_of(other, name, Q_MM)[0]
        assert np.abs(values - others).max() < 1e-6
    assert value_of(one, play.id)[0] == pytest.approx(value_of(other, play.id)[0], abs=1e-6)


def test_a_session_in_which_the_axis_never_moves_keeps_its_rows() -> None:
    """X alone on one day, all on another: what the play does on the first day is how the camera stood."""
    whole = three_lines("backlash", 1, 5, n_sessions=2)
    table = Observations(whole.frame.filter((pl.col("session") != "s0") | (pl.col("line") == "x")), whole.sources)
    play = catalogue()["backlash"].term("y", None, MACHINE)
    result = fitted(MACHINE, table, effects=[play])
    assert len(result.sightings) == len(table)
    assert not lost(result)
    found, error = value_of(result, play.id)
    assert abs(found - PLAY_MM) < 5.0 * error
    assert result.solved.chi_squared / result.dof == pytest.approx(1.0, abs=0.2)


def test_a_model_that_is_given_is_compared_at_all_rows() -> None:
    """Its own data, and another day's on which the axis had come from the other side."""
    table = three_lines("backlash", 1, 5)
    play = catalogue()["backlash"].term("y", None, MACHINE)
    model = result_of(fit_terms(MACHINE, [table], effects=[play], options=FitOptions(threads=1))).model
    for measured in (table, three_lines("backlash", -1, 8)):
        comparison = compare(model, measured)
        assert comparison.points is not None
        assert len(comparison.points.sightings) == len(measured)
        assert comparison.points.figures.rmse_um < 1.3e3 * STD_MM * np.sqrt(3.0)


def test_what_two_axes_do_together_that_both_have_not_moved_yet() -> None:
    """The first rows know neither direction: what one of them would do there is told with the other midway."""
    before = fit_terms(MACHINE, [three_lines("backlash", 1, 5)], options=FitOptions(threads=1))
    term = empirical_term(before, "empirical:y@d_x*d_z")
    after = before.again((*before.terms, term))
    assert len(after.sightings) == len(before.sightings)
    assert np.isfinite(after.residual_mm).all()
