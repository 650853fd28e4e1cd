"""Models side by side: on the rows that all of them have, as `geoerr add` compares what was before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

pytest.importorskip("dash")

from workbench_scenes import N_LINES, N_POINTS, settle, texts, write_scene

from geoerr.model import write_model
from geoerr.workbench import actions, wiring
from geoerr.workbench.own_effect import OwnFormula
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session
from geoerr.workbench.side_by_side import story

N_ROWS, N_UNKNOWN = N_LINES * N_POINTS, N_LINES * N_POINTS // 4
# Of the rows of which nobody knows how warm it was.
MORE_NOISE_UM = 40.0
# It does nothing: no row is warmer for what it is off by.
IDLE = OwnFormula("warmth", "along", "x", "c*(temp_bed - 20)*q")


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """Give the 21 errors fitted to rows of which a quarter has no temperature, and more noise."""
    machine, table = write_scene(tmp_path)
    rng = np.random.default_rng(8)
    rows = pl.read_csv(table)
    # Whole lines, of every direction.
    is_unknown = np.arange(N_ROWS) >= N_ROWS - N_UNKNOWN
    rows = rows.with_columns(
        pl.Series("temp_bed", np.where(is_unknown, np.nan, rng.uniform(20.0, 45.0, N_ROWS))).fill_nan(None),
        *(pl.col(name) + np.where(is_unknown, 1e-3 * MORE_NOISE_UM, 0.0) * rng.normal(size=N_ROWS)
          for name in ("mx", "my", "mz")),
        *(pl.lit(0.01).alias(name) for name in ("sx", "sy", "sz")),
    )  # fmt: skip
    rows.write_csv(table)
    session = begin_session([machine, table], tmp_path / "session.json", threads=1)
    settle(session)
    wiring.do(session, "fit", "21")
    settle(session)
    return session


def add_idle(session: Session) -> None:
    actions.try_formula(session, IDLE)
    settle(session)
    wiring.do(session, "add-trial", "")
    settle(session)


def held_out_um(session: Session) -> list[float | None]:
    """Give the bars of the held-out error."""
    return [stage.figure("held_out_rmse_um") for stage in story(session.steps, session.current, session.beside)]


def listed(session: Session) -> str:
    return texts(wiring.panels(session)["given"]).partition("Models so far")[2]


def test_what_an_effect_leaves_out_is_no_fall_of_the_error(session: Session) -> None:
    noisy = held_out_um(session)
    actions.try_formula(session, IDLE)
    settle(session)
    change = session.trial.change
    wiring.do(session, "add-trial", "")
    settle(session)
    nominal, before, after = held_out_um(session)
    # As `geoerr add` says it of the same rows; little beside what leaving out the noisy ones would seem to gain.
    assert before == pytest.approx(change.before.held_out.figures.headline_um, rel=1e-6)
    assert after == pytest.approx(change.after.held_out.figures.headline_um, rel=1e-6)
    assert abs(after - before) < 0.2 * (noisy[1] - after)
    assert nominal < noisy[0]
    # The list says the same, and both say of which rows.
    told = f"On the {N_ROWS - N_UNKNOWN} of {N_ROWS} rows that all of them have."
    assert f"3. + warmth:x  @temp_bed {after:.1f} {after - nominal:.1f}".replace("-", "−") in listed(session)
    assert f"2. 21 errors fitted {before:.1f}" in listed(session)
    assert told in listed(session)
    assert told in texts(wiring.panels(session)["fall"])


def test_looking_back_tells_of_all_rows_again_and_the_reference_of_fewer(session: Session) -> None:
    noisy = held_out_um(session)
    add_idle(session)
    on_fewer = held_out_um(session)
    wiring.do(session, "undo", "")
    settle(session)
    assert held_out_um(session) == noisy
    assert "rows that all" not in listed(session)
    # It cannot be had on these rows.
    assert "3. + warmth:x  @temp_bed –" in listed(session)
    assert "A model with a dash has no figure on these rows" in listed(session)
    wiring.do(session, "refer", "2")
    settle(session)
    assert held_out_um(session) == pytest.approx(on_fewer[:2])
    assert "with a dash" not in listed(session)


def test_a_saved_session_compares_on_the_common_rows_again(session: Session) -> None:
    add_idle(session)
    again = begin_session([], session.saved_in, threads=1)
    settle(again)
    assert held_out_um(again) == pytest.approx(held_out_um(session))
    assert listed(again) == listed(session)


def test_what_was_removed_is_compared_on_the_rows_that_it_had(session: Session) -> None:
    add_idle(session)
    _, before, after = held_out_um(session)
    wiring.do(session, "remove", "warmth:x@temp_bed")
    settle(session)
    assert len(session.seen.comparison.points.sightings) == N_ROWS
    assert held_out_um(session)[1:3] == pytest.approx([before, after])
    # As free as all rows ask for: as it was before the effect.
    assert held_out_um(session)[3] == pytest.approx(before, rel=0.01)
    # What is said of the model alone is of all its rows.
    assert session.step.figures["held_out_rmse_um"] > 1.5 * after


def test_the_history_that_a_model_came_with_is_drawn_where_it_is_of_the_same_rows(
    session: Session, tmp_path: Path
) -> None:
    add_idle(session)
    write_model(tmp_path / "grown.json", session.model)
    again = begin_session([tmp_path / "grown.json", tmp_path / "observations.csv"], None, threads=1)
    settle(again)
    names = [stage.name for stage in story(again.steps, again.current, again.beside)]
    assert names == ["before 1. at first", "1. grown.json"]
    assert held_out_um(again) == pytest.approx(held_out_um(session)[1:])
    rows = pl.read_csv(tmp_path / "observations.csv")
    rows.filter(pl.int_range(pl.len()) % (2 * N_POINTS) < N_POINTS).write_csv(tmp_path / "half.csv")
    of_others = begin_session([tmp_path / "grown.json", tmp_path / "half.csv"], None, threads=1)
    settle(of_others)
    assert [stage.name for stage in story(of_others.steps, 0, of_others.beside)] == ["1. grown.json"]
