"""Measured lines of a report: targets with some spread, where the figures begin and end, why there are none."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns
from geoerr.report import model_report as parts
from geoerr.report.model_report import model_report
from geoerr.report.page import Table
from geoerr.report.standard_blocks import positioning_blocks

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 200.0))
TARGETS_MM = np.linspace(0.0, 400.0, 9)
N_RUNS = 5


def laser(x: np.ndarray, sense: np.ndarray, deviation_um: np.ndarray | float = 0.0) -> Observations:
    columns = {"x": x, "y": 0.0 * x, "z": 0.0 * x, "mx": x + 1e-3 * deviation_um}
    columns |= {"dir_x": sense, "dir_y": 0.0 * x, "dir_z": 0.0 * x}
    return observations_from_columns(columns | {"line": ["X"] * len(x)})


@pytest.mark.parametrize("spread_mm", [1e-4, 1e-3])
def test_a_target_is_one_whatever_the_encoder_adds(spread_mm: float) -> None:
    """Nine targets, five runs both ways; sums by target number against the report."""
    rng = np.random.default_rng(7)
    deviation = rng.normal(0.0, 2.0, (N_RUNS, 2, 9)) + np.array([4.0, -4.0])[:, None]
    run, way, target = (own.ravel() for own in np.indices(deviation.shape))
    target = np.where(way == 1, 8 - target, target)
    x = TARGETS_MM[target] + rng.uniform(-spread_mm, spread_mm, len(run))
    report = model_report(Model(MACHINE), laser(x, 1.0 - 2.0 * way, deviation[run, way, target]), search=False)
    (document,) = report.to_document()["iso_230_2"]["measured"]
    assert (document["n_targets"], document["n_runs"]) == (9, N_RUNS)
    mean, std = deviation.mean(axis=0), deviation.std(axis=0, ddof=1)
    assert document["E_um"] == pytest.approx(np.ptp(mean), abs=1e-6)
    assert document["B_um"] == pytest.approx(np.abs(mean[0] - mean[1]).max(), abs=1e-6)
    assert document["A_um"] == pytest.approx((mean + 2.0 * std).max() - (mean - 2.0 * std).min(), abs=1e-6)


def test_the_table_tells_the_range_of_the_figures() -> None:
    """Both ways from 50 to 350 mm only; 0 and 400 mm were reached from one side."""
    there, back = TARGETS_MM[:-1], TARGETS_MM[:0:-1]
    x = np.tile(np.concatenate([there, back]), 2)
    sense = np.tile(np.repeat([1.0, -1.0], 8), 2)
    report = model_report(Model(MACHINE), laser(x, sense), search=False)
    (table,) = (block for block in positioning_blocks(report) if isinstance(block, Table))
    assert [row[table.header.index("from – to, mm")] for row in table.rows] == ["50 – 350"]
    (document,) = report.to_document()["iso_230_2"]["measured"]
    assert (document["from_mm"], document["to_mm"]) == (50.0, 350.0)


@pytest.mark.parametrize(
    ("n_targets", "senses", "why"),
    [
        (9, (1.0, 1.0), "a line along X was measured: run in one direction only"),
        (4, (1.0, -1.0), "4 targets were reached from both sides, and a test needs 5"),
        (9, (0.0, 0.0), "do not tell from which side"),
    ],
)
def test_a_line_that_is_no_test_says_why(n_targets: int, senses: tuple[float, float], why: str) -> None:
    targets = TARGETS_MM[:n_targets]
    x = np.tile(np.concatenate([targets, targets]), 3)
    report = model_report(Model(MACHINE), laser(x, np.tile(np.repeat(senses, n_targets), 3)), search=False)
    assert not report.measured_lines
    assert why in next(one.why for one in report.left_out if one.section == parts.POSITIONING)
