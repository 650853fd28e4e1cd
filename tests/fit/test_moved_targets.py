"""A plate that somebody touched: told, and another one from then on; what moves several of them is no plate's."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from fit_scenes import Numbers, cubic_truth, fitted, measured_again, seen, there_and_back
from virtual_machine import camera, machine_of

import geoerr
from geoerr.diagnose import diagnose
from geoerr.fit.joined import sightings_of
from geoerr.fit.moved_targets import moved_targets
from geoerr.fit.sightings import Sightings
from geoerr.observations import Observations
from geoerr.report.compare_page import write_comparison_page
from geoerr.report.provenance import provenance_of_call

MACHINE = machine_of("wYbXZt")


TARGETS = {
    "tool": ((0.0, 0.0, 0.0), (90.0, 0.0, 10.0), (20.0, 80.0, 0.0)),
    "work": ((30.0, 20.0, 0.0), (150.0, 40.0, 0.0), (60.0, 140.0, 5.0)),
}


def measured(
    seed: int = 1, targets: Mapping[str, tuple[tuple[float, float, float], ...]] = TARGETS, n_repeats: int = 2
) -> Observations:
    """Lines along each axis, there and back and again; every picture shows all targets on the tool and the work."""
    rng = np.random.default_rng(seed)
    rows, columns = there_and_back(targets, (60.0, 110.0, 40.0), 7, n_repeats)
    truth, pose = cubic_truth(rng), camera(rng)
    return seen(MACHINE, truth, pose, rows, rng, covariance_mm2=np.eye(3) * 4e-6, **columns)


def displaced(observations: Observations, rows: np.ndarray, by_mm: Numbers) -> Observations:
    return measured_again(observations, rows[:, None] * np.broadcast_to(by_mm, (len(rows), 3)))


def of_target(observations: Observations, carrier: str, number: int) -> np.ndarray:
    """Rows of one target."""
    own = np.array(observations.texts("carrier")) == carrier
    return own & (observations.target_offset_mm == TARGETS[carrier][number]).all(axis=1)


def in_plane(observations: Observations, carrier: str, number: int) -> Numbers:
    """A tenth of a millimetre towards another target as the camera sees it: no turn of the carrier is that."""
    own, other = (of_target(observations, carrier, one) for one in (number, (number + 1) % 3))
    way = observations.measured_mm[other].mean(axis=0) - observations.measured_mm[own].mean(axis=0)
    return 0.1 * way / np.linalg.norm(way)


@pytest.mark.parametrize("number", [0, 2])
@pytest.mark.parametrize("after", [0.4, 0.55])
def test_a_plate_that_moved_is_told_with_when_and_how_far(number: int, after: float) -> None:
    observations = measured()
    rows = of_target(observations, "tool", number) & (np.arange(len(observations)) >= after * len(observations))
    by_mm = in_plane(observations, "tool", number)
    sightings = sightings_of(displaced(observations, rows, by_mm))
    (moved,) = moved_targets(sightings)
    assert sorted(sightings.source_row[moved.rows].tolist()) == np.flatnonzero(rows).tolist()
    # Five standard errors of a median over some ten places, of 2 µm each before and after.
    assert moved.by_mm == pytest.approx(by_mm, abs=0.005)
    (told,) = [note for note in sightings.notes if "moved by" in note]
    assert "on the tool moved by 0." in told
    assert f"between rows {sightings.source_row[moved.last] + 1} and {np.flatnonzero(rows)[0] + 1}" in told


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("after", [0.35, 0.5, 0.62])
def test_the_moment_is_told_where_only_one_line_is_come_back_to(seed: int, after: float) -> None:
    """Between its two visits every moment leaves as much; how the target stood to the others tells which."""
    observations = measured(seed)
    repeat, lines = observations.numbers("repeat")[:, 0], np.array(observations.texts("line"))
    seldom = observations.select((repeat == 0) | np.char.startswith(lines.astype(str), "L0"))
    rows = of_target(seldom, "tool", 2) & (np.arange(len(seldom)) >= after * len(seldom))
    sightings = sightings_of(displaced(seldom, rows, 0.5 * in_plane(seldom, "tool", 2)))
    (moved,) = moved_targets(sightings)
    assert sorted(sightings.source_row[moved.rows].tolist()) == np.flatnonzero(rows).tolist()


def test_the_model_is_that_of_the_plate_that_stayed() -> None:
    observations = measured(2)
    rows = of_target(observations, "work", 1) & (np.arange(len(observations)) >= 0.6 * len(observations))
    spoilt = displaced(observations, rows, 10.0 * in_plane(observations, "work", 1))
    as_it_was, now = (fitted(MACHINE, one) for one in (observations, spoilt))
    assert now.scale == pytest.approx(as_it_was.scale, rel=0.02)
    assert now.solved.used.all()
    before, after = (
        np.array([one.value for term in result.terms for one in term.coefficients]) for result in (as_it_was, now)
    )
    std = np.array([one.std for term in as_it_was.terms for one in term.coefficients])
    # Of what is 0 by convention round-off is left.
    known = std > 1e-12
    # Three unknowns more: a part of a standard error.
    assert np.abs((after - before)[known] / std[known]).max() < 1.5


@pytest.mark.parametrize("seed", [2, 3])
def test_a_diagnosis_says_what_it_says_of_the_plate_that_stayed(seed: int) -> None:
    # Of the second, noise alone looks like something, as of one in twenty.
    observations = measured(seed)
    rows = of_target(observations, "work", 1) & (np.arange(len(observations)) >= 0.6 * len(observations))
    spoilt = displaced(observations, rows, 10.0 * in_plane(observations, "work", 1))
    before, after = (diagnose(geoerr.fit_model(MACHINE, one).model, one) for one in (observations, spoilt))
    assert (after.verdict, after.found != ()) == (before.verdict, before.found != ())
    assert [one.reference for one in after.found] == [one.reference for one in before.found]
    assert any("moved by 1 mm" in note for note in after.notes)


@pytest.mark.parametrize("after", [0.07, 0.9])
@pytest.mark.parametrize("size", [0.5, 3.0, 30.0])
def test_early_or_late_by_little_or_by_much(after: float, size: float) -> None:
    # Of a few visits before or after; what is wild is no measure of what is usual.
    observations = measured(7, n_repeats=3)
    rows = of_target(observations, "work", 2) & (np.arange(len(observations)) >= after * len(observations))
    by_mm = size * in_plane(observations, "work", 2)
    (moved,) = moved_targets(sightings_of(displaced(observations, rows, by_mm)))
    # Where the first of them are at places that are never visited again nothing tells.
    assert abs(len(moved.rows) - int(rows.sum())) <= 2
    assert moved.by_mm == pytest.approx(by_mm, abs=0.01)


def test_two_plates_of_one_carrier_at_different_times() -> None:
    more = {**TARGETS, "tool": (*TARGETS["tool"], (0.0, 30.0, 90.0), (60.0, 60.0, 50.0))}
    observations = measured(8, more, n_repeats=3)
    later = [np.arange(len(observations)) >= share * len(observations) for share in (0.35, 0.6)]
    rows = [of_target(observations, "tool", number) & own for number, own in enumerate(later)]
    spoilt = displaced(observations, rows[0], np.array([0.1, 0.03, 0.0]))
    spoilt = displaced(spoilt, rows[1], np.array([0.0, -0.05, 0.08]))
    found = moved_targets(sightings_of(spoilt))
    assert {len(one.rows) for one in found} == {int(own.sum()) for own in rows}


@pytest.mark.parametrize("is_sudden", [True, False])
def test_a_far_target_of_a_carrier_that_grows_is_no_plate_that_was_touched(is_sudden: bool) -> None:
    # Three near the place from where it grows, one far off, which moves eight times as far.
    far = {**TARGETS, "work": ((0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (0.0, 30.0, 0.0), (260.0, 40.0, 0.0))}
    observations = measured(9, far)
    work = np.array(observations.texts("carrier")) == "work"
    time = np.linspace(0.0, 1.0, len(observations))
    share = (time > 0.4).astype(float) if is_sudden else time
    origin, along = (
        observations.measured_mm[(observations.target_offset_mm == far["work"][number]).all(axis=1) & work].mean(
            axis=0
        )
        for number in (0, 3)
    )
    way = (along - origin) / np.linalg.norm(far["work"][3])
    grown = 1e-3 * share * np.linalg.norm(observations.target_offset_mm, axis=1) * work
    assert not moved_targets(sightings_of(measured_again(observations, grown[:, None] * way)))


def with_fixed_marker(observations: Observations, rng: np.random.Generator) -> Observations:
    """Put a marker on the base into every picture of the tool's first target."""
    frame = observations.frame.with_row_index("order")
    fixed = frame.filter(pl.Series(of_target(observations, "tool", 0))).with_columns(
        carrier=pl.lit("base"), **{f"t{axis}": pl.lit(0.0) for axis in "xyz"}
    )
    stands = np.array([100.0, 50.0, 800.0]) + rng.normal(0.0, 2e-3, (len(fixed), 3))
    fixed = fixed.with_columns(**{f"m{axis}": values for axis, values in zip("xyz", stands.T, strict=True)})
    return Observations(pl.concat([frame, fixed]).sort("order", maintain_order=True).drop("order"), ("memory",))


def test_a_fixed_marker_that_moved_is_told_beside_others() -> None:
    observations = with_fixed_marker(measured(3), np.random.default_rng(4))
    assert not moved_targets(sightings_of(observations))
    fixed = np.array(observations.texts("carrier")) == "base"
    rows = fixed & (np.arange(len(observations)) >= 0.5 * len(observations))
    sightings = sightings_of(displaced(observations, rows, np.array([0.05, 0.0, 0.0])))
    (moved,) = moved_targets(sightings)
    assert sorted(moved.rows.tolist()) == np.flatnonzero(rows).tolist()
    assert any(re.search(r"on the base moved by 0\.0(49|5|51) mm", note) for note in sightings.notes)


def _cameras(observations: Observations, later: np.ndarray) -> Observations:
    return displaced(observations, later, np.array([0.1, 0.0, 0.05]))


def _turn(observations: Observations, later: np.ndarray) -> Observations:
    """The tool's carriage turned about one of its targets."""
    tool = np.array(observations.texts("carrier")) == "tool"
    own = of_target(observations, "tool", 0)
    centre = observations.measured_mm[own].mean(axis=0)
    # How far each target is from the first, as the camera sees it: the carriage's motion is the same for all.
    lever = np.zeros((len(observations), 3))
    for number in (1, 2):
        rows = of_target(observations, "tool", number)
        lever[rows] = observations.measured_mm[rows].mean(axis=0) - centre
    turned = np.cross([0.3e-3, -0.8e-3, 0.6e-3], lever)
    return measured_again(observations, np.where((later & tool)[:, None], turned, 0.0))


def _growth(observations: Observations, later: np.ndarray) -> Observations:
    """The work's targets grow apart with time, as a plate does that warms up."""
    grown = 2e-4 * np.linspace(0.0, 1.0, len(observations))[:, None] * observations.target_offset_mm
    return measured_again(observations, grown)


def _wild(observations: Observations, later: np.ndarray) -> Observations:
    rows = np.flatnonzero(of_target(observations, "tool", 1) & later)[[0, 7, 11]]
    return displaced(observations, np.isin(np.arange(len(observations)), rows), np.array([3.0, 0.0, 0.0]))


def _tool(observations: Observations, later: np.ndarray) -> Observations:
    tool = np.array(observations.texts("carrier")) == "tool"
    return displaced(observations, later & tool, np.array([0.0, 0.1, 0.0]))


@pytest.mark.parametrize("spoil", [_cameras, _turn, _growth, _wild, _tool, lambda one, later: one])
@pytest.mark.parametrize("seed", [5, 6])
def test_what_moves_several_targets_or_a_few_rows_is_no_plates(
    spoil: Callable[[Observations, np.ndarray], Observations], seed: int
) -> None:
    observations = measured(seed)
    later = np.arange(len(observations)) >= 0.5 * len(observations)
    sightings: Sightings = sightings_of(spoil(observations, later))
    assert not moved_targets(sightings)
    assert not any("moved by" in note for note in sightings.notes)


def test_the_page_of_a_comparison_tells_it(tmp_path: Path) -> None:
    observations = measured(4)
    rows = of_target(observations, "tool", 2) & (np.arange(len(observations)) >= 0.4 * len(observations))
    spoilt = displaced(observations, rows, in_plane(observations, "tool", 2))
    comparison = geoerr.compare(geoerr.fit_model(MACHINE, spoilt).model, spoilt)
    assert [part.figures.n for part in comparison.by_target if "moved" in part.name] == [int(rows.sum())]
    page = tmp_path / "page.html"
    write_comparison_page(page, comparison, comparison.to_document(), provenance_of_call("a test", []))
    assert "while the others stayed" in page.read_text(encoding="utf-8")
