"""Circular tests of models with terms: conditions, both senses, speeds."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from geoerr.cli.main import app
from geoerr.effects import catalogue
from geoerr.errors import GeoerrError
from geoerr.machine import Axis, Machine
from geoerr.model import Model, write_model
from geoerr.observations import CircularTest
from geoerr.terms import Term
from geoerr.verify.ballbar import circle_of_first_run, circle_to_test, run_circular_test

MACHINE = Machine("mill", "wbXYZt", {name: Axis((0.0, 400.0)) for name in "xyz"})


def term(reference: str, **values: float) -> Term:
    effect, parsed = catalogue().resolve(reference)
    made = effect.term(parsed.axis, parsed.covariate, MACHINE)
    coefficients, inner = (
        tuple(dataclasses.replace(p, value=values[p.name]) for p in parameters)
        for parameters in (made.coefficients, made.inner)
    )
    return dataclasses.replace(made, coefficients=coefficients, inner=inner)


def test_backlash_is_a_step_at_the_reversals_and_is_compensated():
    model = Model(MACHINE, None, (term("backlash:x", b=0.02),))
    result = run_circular_test(model, circle_to_test(model))
    for trace, sense in zip(result.before, (1, -1), strict=True):
        # X lags behind its direction by 10 µm: counter-clockwise it goes down while the angle is below 180 degrees.
        expected = 0.01 * sense * np.sign(np.sin(trace.angle_rad + sense * 1e-6))
        assert np.allclose(trace.points_mm[:, 0] - 100.0 * np.cos(trace.angle_rad), expected, atol=1e-9)
    # Commands are found to a tenth of a nanometre.
    assert max(trace.circular_deviation_mm for trace in result.after) < 1e-6


def test_following_error_turns_the_circle_with_the_feed():
    model = Model(MACHINE, None, (term("lag:x", tau=1e-3),))
    circle = circle_to_test(model)
    with pytest.raises(GeoerrError, match=r"v_x: a circle has speeds only with a feed"):
        run_circular_test(model, circle)
    slow, fast = (run_circular_test(model, circle, at={"feed": feed}) for feed in (600.0, 6000.0))
    # x = R cos + tau v sin: an ellipse at 45 degrees whose axes differ by tau v, in the other diagonal clockwise.
    assert fast.before[0].circular_deviation_mm == pytest.approx(0.1, rel=2e-3)
    assert slow.before[0].circular_deviation_mm == pytest.approx(0.01, rel=2e-3)
    widest = [abs(np.rad2deg(t.angle_rad[np.argmax(t.radial_deviation_mm)])) % 90.0 for t in fast.before]
    assert widest == pytest.approx([45.0, 45.0], abs=1.0)
    assert fast.after[0].circular_deviation_mm < 1e-6


def test_measured_runs_are_predicted_at_their_own_feeds():
    model = Model(MACHINE, None, (term("lag:x", tau=1e-3),))
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    frames = []
    for feed in (600.0, 6000.0):
        # To first order: x = R cos + tau v sin, v = feed / 60, counter-clockwise.
        r = 100.0 + 1e-3 * feed / 60.0 * np.sin(angle) * np.cos(angle)
        at = {"x": 200.0 + 100.0 * np.cos(angle), "y": 200.0 + 100.0 * np.sin(angle), "z": 0.0 * angle}
        frames.append(pl.DataFrame({"line": ["XY"] * 181, "dir": [1] * 181, "feed": [feed] * 181, **at, "r": r}))
    frame = pl.concat(frames).with_row_index("file_row", offset=2)
    measured = CircularTest(frame, ("memory",))
    result = run_circular_test(model, circle_of_first_run(measured), measured=measured)
    assert [run.name for run in result.runs] == ["XY, feed 600.0", "XY, feed 6000.0"]
    for run, width_mm in zip(result.runs, (0.01, 0.1), strict=True):
        assert run.predicted.circular_deviation_mm == pytest.approx(width_mm, rel=2e-3)
        # Of the second order, and the set-up's.
        assert run.set_up.rms_mm < 1e-3 * width_mm
    assert result.notes == ("before and after are at the feed of the first measured run, 600 mm/min",)
    assert result.before[0].circular_deviation_mm == pytest.approx(0.01, rel=2e-3)


def test_wind_up_follows_the_travel_since_the_reversal():
    model = Model(MACHINE, None, (term("reversal-windup:x", b=0.02, **{"lambda": 10.0}),))
    trace = run_circular_test(model, circle_to_test(model)).before[0]
    travel = 100.0 * (1.0 - np.cos(trace.angle_rad[:300]))
    expected = 0.01 * (1.0 - 2.0 * np.exp(-travel / 10.0))
    found = trace.points_mm[:300, 0] - 100.0 * np.cos(trace.angle_rad[:300])
    assert np.allclose(found, expected, atol=1e-12)


def test_the_verb_takes_conditions(tmp_path):
    path = tmp_path / "model.json"
    write_model(path, Model(MACHINE, None, (term("thermal-expansion:x@temp", alpha=1e-5, q_fixed=0.0),)))
    refused = CliRunner().invoke(app, ["verify", "ballbar", str(path)])
    assert refused.exit_code == 1
    assert "--at temp=reference; 'reference' is the machine's reference temperature" in str(refused.exception)
    hot = CliRunner().invoke(app, ["verify", "ballbar", str(path), "--at", "temp=70", "--json"])
    assert hot.exit_code == 0, hot.output
    # X grows by 0.5 mm/m and Y does not: the diameters of 200 mm differ by 0.1 mm, the radii by half of that.
    assert json.loads(hot.stdout)["before"]["ccw"]["circular_deviation_um"] == pytest.approx(50.0, rel=1e-3)
    other = CliRunner().invoke(
        app, ["verify", "ballbar", str(path), "--at", "temp=70", "--at", "humidity=3", "--json"]
    )
    assert other.stderr == "note: the model does not depend on humidity: --at humidity changes nothing\n"
    assert json.loads(other.stdout)["before"] == json.loads(hot.stdout)["before"]


@pytest.mark.parametrize("direction", [7.0, 0.5])
def test_a_direction_is_one_way_or_the_other(direction: float):
    model = Model(MACHINE, None, (term("backlash:x", b=0.02),))
    with pytest.raises(GeoerrError, match=r"d_x is [0-9.]+, a direction is −1 or 1"):
        model.error_mm([[100.0, 100.0, 100.0]], at={"d_x": direction})
