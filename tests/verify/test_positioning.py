"""Positioning figures (ISO 230-2) against sums by hand, of readings and of models; diagonals (ISO 230-6)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geoerr
from geoerr.diagnose.straight_lines import straight_lines
from geoerr.errors import GeometryError, ShapeError
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import observations_from_columns
from geoerr.terms import Parameter, Part, Term
from geoerr.verify.positioning import axis_line_mm, diagonals_mm, positioning_test, predict_positioning

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 200.0))
TARGETS_MM = np.array([0.0, 11.0, 23.0, 31.0, 45.0])


def term(name: str, channel: str, expression: str, **values: float) -> Term:
    parameters = tuple(Parameter(each, "1", value) for each, value in values.items())
    return Term(name, name, "effect", name, None, None, (Part(channel, expression=expression),), parameters)


def readings() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two runs: forwards 0, 1, 2, 3, 4 µm ± 1, backwards 2 µm more ± 0.5; the middle one scatters twice as much."""
    position, deviation, direction = [], [], []
    for run in (-1.0, 1.0):
        for sense, extra, scatter in ((1.0, 0.0, 1.0), (-1.0, 2.0, 0.5)):
            for number, target in enumerate(TARGETS_MM):
                position.append(target)
                deviation.append(number + extra + run * scatter * (2.0 if number == 2 else 1.0))
                direction.append(sense)
    return np.array(position), np.array(deviation), np.array(direction)


def test_figures_are_those_of_the_standard() -> None:
    found = positioning_test(*readings())
    assert found is not None
    root_2 = np.sqrt(2.0)  # standard deviation of ±1, n − 1
    assert found.n_runs == 2
    np.testing.assert_allclose(found.position_mm, TARGETS_MM)
    np.testing.assert_allclose(found.up_um, [0, 1, 2, 3, 4])
    np.testing.assert_allclose(found.down_std_um, root_2 * np.array([0.5, 0.5, 1.0, 0.5, 0.5]))
    assert found.reversal_um == pytest.approx(2.0)
    assert found.mean_reversal_um == pytest.approx(-2.0)
    assert found.systematic_um == pytest.approx(6.0)
    assert found.one_way_systematic_um == pytest.approx((4.0, 4.0))
    assert found.mean_um == pytest.approx(4.0)
    # At the middle target: 2 · 2√2 + 2 · √2 + 2 against 4 · 2√2.
    assert found.repeatability_um == pytest.approx(max(6.0 * root_2 + 2.0, 8.0 * root_2))
    assert found.one_way_repeatability_um == pytest.approx((8.0 * root_2, 4.0 * root_2))
    # Both ends at the middle target, forwards: 2 ± 2 · 2√2; the last one backwards ends at 6 + √2 only.
    assert found.accuracy_um == pytest.approx(8.0 * root_2)


def test_an_offset_of_the_whole_line_changes_nothing_and_order_neither() -> None:
    position, deviation, direction = readings()
    mixed = np.random.default_rng(0).permutation(len(position))
    one = positioning_test(position, deviation, direction)
    other = positioning_test(position[mixed], deviation[mixed] + 71.0, direction[mixed])
    assert one is not None
    assert other is not None
    assert one.to_document() == pytest.approx(other.to_document())


def test_single_runs_have_no_repeatability_and_one_way_lines_no_figures() -> None:
    position, deviation, direction = (one[:10] for one in readings())
    single = positioning_test(position, deviation, direction)
    assert single is not None
    assert (single.accuracy_um, single.repeatability_um, single.n_runs) == (None, None, 1)
    # From 0 − 1 forwards to 6 − 0.5 backwards.
    assert single.systematic_um == pytest.approx(6.5)
    assert positioning_test(position, deviation, np.ones(10)) is None
    assert positioning_test(*(one[position != 45.0] for one in (position, deviation, direction))) is None
    with pytest.raises(ShapeError, match="one reading each"):
        positioning_test(position, deviation[:3], direction)


def test_a_model_with_scale_and_play_has_their_figures() -> None:
    """100 µm/m over 400 mm, and 8 µm of play in X: E is both, M is the scale, B is the play."""
    model = Model(MACHINE, terms=(term("scale", "EXX", "k*x", k=1e-4), term("play", "EXX", "-b/2*d_x", b=0.008)))
    found = predict_positioning(model, *axis_line_mm(model, "x"))
    assert found.reversal_um == pytest.approx(8.0)
    assert found.mean_um == pytest.approx(40.0)
    assert found.systematic_um == pytest.approx(48.0)
    assert found.accuracy_um is None
    assert found.to_document()["R_um"] is None
    still = predict_positioning(model, *axis_line_mm(model, "z"))
    assert still.systematic_um == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(GeometryError, match="begins where it ends"):
        predict_positioning(model, np.zeros(3), np.zeros(3))


def test_travel_counts_from_where_the_axis_turned() -> None:
    """What grows with the travel since the reversal, 1 µm a 100 mm: the two ways differ at the ends only."""
    model = Model(MACHINE, terms=(term("windup", "EXX", "k*s_x", k=1e-5),))
    found = predict_positioning(model, *axis_line_mm(model, "x"), n_targets=5)
    np.testing.assert_allclose(found.up_um, 10.0 * (10.0 + np.array([0.0, 100, 200, 300, 400])) / 1e3)
    np.testing.assert_allclose(found.down_um, found.up_um[::-1])


def test_squareness_shows_in_the_diagonals_by_its_sign() -> None:
    """S of X and Y moves x by −S·y: along a diagonal of a box a × b × c that is −S·a·b/length at its end, or plus."""
    squareness = 50e-6
    model = Model(MACHINE, terms=(term("square", "S_xy", "S", S=squareness),))
    ends = diagonals_mm(model)
    assert set(ends) == {"PPP", "NPP", "PNP", "PPN"}
    length = np.sqrt(400.0**2 + 300.0**2 + 200.0**2)
    for name, (start, end) in ends.items():
        assert np.linalg.norm(end - start) == pytest.approx(length)
        found = predict_positioning(model, start, end)
        grows = found.up_um[-1] - found.up_um[0]
        sign = -1.0 if name in ("PPP", "PPN") else 1.0
        assert grows == pytest.approx(sign * squareness * 400.0 * 300.0 / length * 1e3, rel=1e-3)


def test_lines_of_measured_points_are_found_whatever_they_are_called() -> None:
    """X there and back twice, a space diagonal, and Z on the work side's table; a frame that lies askew."""
    x = np.tile(np.concatenate([TARGETS_MM, TARGETS_MM[::-1]]), 2)
    zero = np.zeros_like(x)
    rows = [
        np.column_stack([x, zero, zero]),
        np.column_stack([x, 2.0 * x, 3.0 * x]),
        np.column_stack([zero, zero, x]),
    ]
    q = np.vstack([*rows, [[300.0, 200.0, 100.0]]])
    sense = np.concatenate([np.tile(np.repeat([1.0, -1.0], 5), 2)] * 3 + [[0.0]])
    seen = q * (1.0 + 1e-4)
    turned = seen @ np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turned *= np.sign(np.linalg.det(np.linalg.lstsq(seen, turned, rcond=None)[0]))
    columns = dict(zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([q, turned]).T, strict=True))
    columns |= {f"dir_{axis}": np.where(np.ptp(q, axis=0)[place] > 0, sense, 0.0) for place, axis in enumerate("xyz")}
    names = ["a"] * 40 + ["a"] * 20 + ["stray"]
    observations = observations_from_columns(columns | {"carrier": ["relative"] * len(q), "line": names})
    found = {line.moving: line for line in straight_lines(MACHINE, observations)}
    assert {"x", "z"} <= set(found)
    figures = positioning_test(found["x"].position_mm, found["x"].deviation_um, found["x"].direction)
    assert figures is not None
    assert figures.mean_um == pytest.approx(1e-4 * 45.0 * 1e3, rel=1e-3)
    assert figures.reversal_um == pytest.approx(0.0, abs=1e-6)


def test_the_work_side_counts_as_seen_from_the_work() -> None:
    """A table that goes 1 µm too far for each 10 mm: its target is seen to go the other way."""
    machine = Machine.from_chain("wXbYZt", (400.0, 300.0, 200.0))
    x = np.concatenate([TARGETS_MM, TARGETS_MM[::-1]])
    columns = {
        "x": x,
        "y": np.zeros(10),
        "z": np.zeros(10),
        "mx": -x * (1.0 + 1e-4),
        "dir_x": np.repeat([1.0, -1.0], 5),
    }
    observations = observations_from_columns(columns | {"carrier": ["work"] * 10})
    (line,) = straight_lines(machine, observations)
    figures = positioning_test(line.position_mm, line.deviation_um, line.direction)
    assert figures is not None
    assert figures.up_um[-1] - figures.up_um[0] == pytest.approx(4.5)


def test_a_target_that_stands_still_tells_no_positioning() -> None:
    """X carries the tool: a target on the work, and one on the base, see nothing of it."""
    machine = Machine.from_chain("wYbXZt", (400.0, 300.0, 200.0))
    x = np.tile(np.concatenate([TARGETS_MM, TARGETS_MM[::-1]]), 3)
    carrier = ["tool"] * 10 + ["work"] * 10 + ["base"] * 10
    seen = np.where(np.array(carrier) == "tool", x, 0.0)
    columns = {"x": x, "y": 0.0 * x, "z": 0.0 * x, "mx": seen, "my": 0.0 * x, "mz": 0.0 * x}
    columns |= {"dir_x": np.tile(np.repeat([1.0, -1.0], 5), 3)}
    observations = observations_from_columns(columns | {"carrier": carrier, "target": carrier})
    assert [(line.target, line.moving) for line in straight_lines(machine, observations)] == [("tool", "x")]


@pytest.mark.real_data
def test_a_run_of_a_slide_by_the_standard(real_data: Path) -> None:
    """Five targets, five cycles, both ways: the figures against NumPy on the table itself."""
    machine = geoerr.read_machine(real_data / "positioning" / "machine.toml")
    observations = geoerr.read_observations(real_data / "positioning" / "observations.csv")
    (line,) = straight_lines(machine, observations)
    found = positioning_test(line.position_mm, line.deviation_um, line.direction)
    assert found is not None
    assert (len(found.position_mm), found.n_runs) == (5, 5)
    x, mx, sense = observations.numbers("x", "mx", "dir_x").T
    deviation = 1e3 * (mx - x)
    up, down = (
        np.array([deviation[(x == one) & (sense == side)].mean() for one in np.unique(x)]) for side in (1, -1)
    )
    assert found.reversal_um == pytest.approx(np.abs(up - down).max())
    assert found.systematic_um == pytest.approx(np.ptp([up, down]))
