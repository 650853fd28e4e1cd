"""ISO 230-2 figures take every reading; what is most likely a mistake is said beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns
from geoerr.report.model_report import MeasuredLine, ModelReport, model_report
from geoerr.report.page import Paragraph
from geoerr.report.standard_blocks import positioning_blocks
from geoerr.verify.positioning import positioning_test

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 200.0))
TARGETS_MM = np.linspace(0.0, 400.0, 11)


def deviations_um() -> np.ndarray:
    """Five runs (5, 2, 11), forwards and backwards: play of 2 µm, noise of 1 µm."""
    sense = np.array([1.0, -1.0])[:, None]
    return sense + np.random.default_rng(4).normal(0.0, 1.0, (5, 2, 11))


def laser(deviation_um: np.ndarray) -> Observations:
    run, way, target = (own.ravel() for own in np.indices(deviation_um.shape))
    # Backwards from the last target to the first.
    target = np.where(way == 1, 10 - target, target)
    x = TARGETS_MM[target]
    columns = {"x": x, "y": 0.0 * x, "z": 0.0 * x, "repeat": run.astype(np.float64)}
    columns |= {"dir_x": 1.0 - 2.0 * way, "dir_y": 0.0 * x, "dir_z": 0.0 * x}
    columns["mx"] = x + 1e-3 * deviation_um[run, way, target]
    return observations_from_columns(columns | {"line": ["X"] * len(x)})


def figures(deviation_um: np.ndarray) -> dict[str, float]:
    """Sum up by the standard's formulas."""
    mean, twice = deviation_um.mean(axis=0), 2.0 * deviation_um.std(axis=0, ddof=1)
    both = twice.sum(axis=0) + np.abs(mean[0] - mean[1])
    return {
        "A_um": (mean + twice).max() - (mean - twice).min(),
        "E_um": np.ptp(mean),
        "M_um": np.ptp(mean.mean(axis=0)),
        "R_um": max(both.max(), 2.0 * twice.max()),
        "B_um": np.abs(mean[0] - mean[1]).max(),
    }


def reported(deviation_um: np.ndarray) -> tuple[ModelReport, dict[str, object]]:
    report = model_report(Model(MACHINE), laser(deviation_um), search=False)
    (document,) = report.to_document()["iso_230_2"]["measured"]
    return report, document


@pytest.mark.parametrize(("ways", "target", "off_um"), [((0, 1), 5, 100.0), ((0,), 0, 50.0), ((0, 1), 10, 50.0)])
def test_what_every_run_finds_is_in_the_figures(ways: tuple[int, ...], target: int, off_um: float) -> None:
    deviation = deviations_um()
    deviation[:, ways, target] += off_um
    _, document = reported(deviation)
    expected = figures(deviation)
    assert {name: document[name] for name in expected} == pytest.approx(expected, abs=1e-6)
    assert (document["n_targets"], document["n_runs"]) == (11, 5)
    assert (document["n_alone"], document["without_alone"]) == (0, None)


def test_a_reading_that_stands_alone_is_in_the_figures_and_said() -> None:
    """One of five readings is 3 mm off."""
    deviation = deviations_um()
    deviation[2, 0, 4] += 3000.0
    report, document = reported(deviation)
    expected = figures(deviation)
    assert {name: document[name] for name in expected} == pytest.approx(expected, abs=1e-6)
    assert document["n_alone"] == 1
    without = document["without_alone"]
    assert isinstance(without, dict)
    assert without["n_runs"] == 4
    four = np.delete(deviation[:, 0, 4], 2)
    mean = deviation.mean(axis=0)
    mean[0, 4] = four.mean()
    assert without["E_um"] == pytest.approx(np.ptp(mean), abs=1e-6)
    said = " ".join(block.text for block in positioning_blocks(report) if isinstance(block, Paragraph))
    assert "1 reading stands alone" in said
    assert f"E {np.ptp(mean):.1f}" in said


def test_a_reading_that_no_figure_takes_is_not_counted() -> None:
    """The same one, at a target of which it is not known from which side it was reached the other times."""
    deviation = deviations_um()
    deviation[2, 0, 4] += 3000.0
    report, _ = reported(deviation)
    (line,) = (one.line for one in report.measured_lines)
    is_back = (np.abs(line.position_mm - TARGETS_MM[4]) < 1.0) & (line.direction < 0.0)
    one_way = replace(line, direction=np.where(is_back, 0.0, line.direction))
    test = positioning_test(one_way.position_mm, one_way.deviation_um, one_way.direction)
    assert test is not None
    assert MeasuredLine(one_way, test).n_alone == 0
