"""What is said before a diagnosis is trusted: lines come back to, numbers of other data, fits that run away."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.notes import interrupted_lines, notes_of
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.model import FitRecord, Model
from geoerr.observations import Observations

OPTIONS = FitOptions(components="none", threads=1)


def observed(hidden_um: float = 0.0) -> Observations:
    rng = np.random.default_rng(1)
    moved = motion(rng, Plan(n_sessions=2, n_lines=10))
    gap_um = np.outer(-0.5 * hidden_um * moved.d[:, 0], [1.0, 0.0, 0.0])
    return measure(rng, moved, Noise(), gap_um)


def of_lines(names: Sequence[str], rows: Observations) -> Fitted:
    """One session: a name for each row."""
    frame = rows.frame.head(len(names)).with_columns(pl.Series("line", names))
    return fit_terms(machine(), [replace(rows, frame=frame)], options=OPTIONS)


def test_a_line_that_was_come_back_to_is_named() -> None:
    rows = observed()
    # The first line's direction, with another line in between.
    once = of_lines(["A"] * 10 + ["B"] * 4 + ["A"] * 10, rows)
    assert interrupted_lines(once) == ["A"]
    (said,) = notes_of(once, None, has_found=False)
    assert "1 line (A) was left and come back to" in said
    assert "repeat" in said


@pytest.mark.parametrize("names", [["A"] * 12 + ["B"] * 12, ["A", "B"] * 12, ["A", "B", "C"] * 8])
def test_lines_one_after_the_other_or_by_turns_are_whole(names: list[str]) -> None:
    fitted = of_lines(names, observed())
    assert interrupted_lines(fitted) == []
    assert notes_of(fitted, None, has_found=False) == ()


def test_a_reference_marker_is_looked_at_between_passes() -> None:
    rows = observed()
    names = ["A"] * 10 + ["marker"] * 2 + ["B"] * 10 + ["marker"] * 2
    carriers = ["base" if name == "marker" else "tool" for name in names]
    frame = rows.frame.head(24).with_columns(pl.Series("carrier", carriers))
    assert interrupted_lines(of_lines(names, replace(rows, frame=frame))) == []


def test_a_whole_look_at_a_reference_marker_interrupts_no_line() -> None:
    rows = observed()
    names = ["A"] * 10 + ["marker"] * 2 + ["A"] * 10
    carriers = ["base" if name == "marker" else "tool" for name in names]
    frame = rows.frame.head(22).with_columns(pl.Series("carrier", carriers))
    assert interrupted_lines(of_lines(names, replace(rows, frame=frame))) == []


def test_times_that_are_no_seconds_are_doubted() -> None:
    rows = observed()
    names = ["A"] * 24
    assert not notes_of(of_lines(names, rows), None, has_found=False)
    seconds = rows.frame["t"]
    hours = replace(rows, frame=rows.frame.with_columns(t=seconds / 3600.0))
    (said,) = notes_of(of_lines(names, hours), None, has_found=False)
    assert "by its times" in said
    assert said.endswith("t is in seconds")
    milliseconds = replace(rows, frame=rows.frame.with_columns(t=seconds * 1e6))
    (said,) = notes_of(of_lines(names, milliseconds), None, has_found=False)
    assert "days by its times" in said


def test_time_decides_the_order_and_not_the_file() -> None:
    rows = observed()
    names = ["A"] * 10 + ["B"] * 4 + ["A"] * 10
    times = [*range(10), *range(50, 54), *range(10, 20)]
    in_time = replace(rows, frame=rows.frame.head(24).with_columns(pl.Series("t", times, dtype=pl.Float64)))
    assert interrupted_lines(of_lines(names, in_time)) == []


def test_numbers_of_other_data_may_hold_a_part_of_the_cause() -> None:
    own = Model(machine(), terms=fit_terms(machine(), [observed()], options=FitOptions(threads=1)).terms)
    other = observed(hidden_um=60.0)
    held = diagnose(own, other, threads=1)
    assert held.found
    assert [note for note in held.notes if "--refit" in note]
    assert held.to_document()["notes"] == list(held.notes)
    assert not diagnose(own, other, refit=True, threads=1).notes
    n = sum(len(term.coefficients) + len(term.inner) for term in own.terms)
    record = FitRecord(np.zeros((n, n)), np.zeros((n, 0)), has_settled=False)
    unsettled = replace(own, record=record)
    told = [note for note in diagnose(unsettled, other, threads=1).notes if "has not settled" in note]
    assert len(told) == 1
    # Nothing found, nothing to doubt.
    assert not diagnose(own, observed(), threads=1).notes


def test_a_fit_that_has_not_settled_is_said() -> None:
    fitted = of_lines(["A"] * 12 + ["B"] * 12, observed())
    running = replace(fitted, solved=replace(fitted.solved, converged=False))
    (said,) = notes_of(running, None, has_found=False)
    assert "has not settled" in said


def test_uncertainties_in_micrometres_are_doubted() -> None:
    """A table that states 3 where it means 0.003 has no gross rows, and nothing is seen in it."""
    rows = observed()
    in_um = replace(rows, frame=rows.frame.with_columns(pl.col("sx", "sy", "sz") * 1e3))
    fitted = fit_terms(machine(), [in_um], options=OPTIONS)
    assert any("are sx, sy and sz in mm" in said for said in notes_of(fitted, None, has_found=False))
