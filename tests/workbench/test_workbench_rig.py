"""The calibration's uncertainty on the page: given by dropping the rig, shown, taken by fits, refused in words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

pytest.importorskip("dash")

from workbench_scenes import settle, texts, write_scene

from geoerr.diagnose import diagnose
from geoerr.fit.result import CALIBRATION_UNKNOWNS
from geoerr.vision.rig import Rig, RightFromLeft, write_rig
from geoerr.vision.sensitivity import project_to_both
from geoerr.workbench import actions, wiring
from geoerr.workbench.notes import notes_of
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session

MATRIX = np.array([[2300.0, 0.0, 1224.0], [0.0, 2300.0, 1024.0], [0.0, 0.0, 1.0]])
POSE = RightFromLeft(np.eye(3), np.array([-300.0, 0.0, 0.0]))
RIG = Rig(MATRIX, np.zeros(5), MATRIX, np.zeros(5), POSE, (2448, 2048), None)
# The camera looks along z of the machine, this far behind the middle of x and y.
MIDDLE_MM, AWAY_MM = 150.0, 900.0
BASELINE_STD_MM, END_MM = 0.03, 290.0


def known_rig() -> Rig:
    """Give the rig with a baseline that is known to 1 in 10⁴, and the rest well."""
    std = np.full(len(RIG.parameter_names), 1e-9)
    std[-3] = BASELINE_STD_MM
    return replace(RIG, covariance=np.diag(std**2))


def write_seen(folder: Path) -> tuple[Path, Path, Path]:
    """Write machine, observations that cameras saw, and their rig."""
    machine, table = write_scene(folder)
    frame = pl.read_csv(table)
    points = frame.select("mx", "my", "mz").to_numpy() + np.array([-MIDDLE_MM, -MIDDLE_MM, AWAY_MM])
    pixels = project_to_both(RIG, points).pixel
    seen = dict(zip(("mx", "my", "mz"), points.T, strict=True))
    seen |= dict(zip(("u_left", "v_left", "u_right", "v_right"), pixels.T, strict=True))
    frame.with_columns(**{name: pl.Series(values) for name, values in seen.items()}).write_csv(table)
    rig = folder / "rig.json"
    write_rig(rig, known_rig())
    return machine, table, rig


def unknowns(session: Session) -> float:
    """Give how many unknowns of the calibration the model was fitted with."""
    assert session.model.record is not None
    return session.model.record.noise.get(CALIBRATION_UNKNOWNS, 0.0)


def length_std_mm(session: Session) -> float:
    """Give how sure the model is of x at the end of its axis, from the other end."""
    at = dict.fromkeys(session.model.conditions, 1.0)
    place = np.array([[END_MM, MIDDLE_MM, MIDDLE_MM]])
    return float(session.model.prediction_covariance_mm2(place, at=at)[0, 0, 0] ** 0.5)


def test_a_rig_that_is_dropped_takes_part_in_fits_and_searches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, table, rig = write_seen(tmp_path)
    session = begin_session([machine, table], None, threads=1)
    settle(session)
    assert not session.calibration.is_given
    assert "the calibration's uncertainty is not included: add the rig (rig.json)" in notes_of(session)
    wiring.do(session, "fit", "12")
    settle(session)
    assert unknowns(session) == 0.0
    assert length_std_mm(session) < 0.01
    actions.take_dropped(session, ["rig.json"], [rig.read_bytes()])
    settle(session)
    told = texts(wiring.panels(session)["given"])
    assert "rig.json  calibration of the cameras" in told
    assert "The calibration's uncertainty takes part in every fit and search." in told
    wiring.do(session, "fit", "12")
    settle(session)
    assert unknowns(session) > 0.0
    taken: list[object] = []

    def spied(*arguments: object, **options: object) -> object:
        taken.extend((options["rig_sensitivity"], options["rig_covariance"]))
        return diagnose(*arguments, **options)

    monkeypatch.setattr(actions, "diagnose", spied)
    wiring.do(session, "diagnose", "")
    settle(session)
    assert np.shape(taken[0]) == (pl.read_csv(table).height, 3, len(RIG.parameter_names))
    assert taken[1] == pytest.approx(known_rig().covariance)
    wiring.do(session, "add", "backlash:x")
    settle(session)
    assert unknowns(session) > 0.0
    # The baseline is known to 1 in 10⁴, and so is every length.
    assert length_std_mm(session) == pytest.approx(BASELINE_STD_MM / 300.0 * END_MM, rel=0.3)
    wiring.do(session, "put-away", "rig.json")
    settle(session)
    assert not session.calibration.is_given
    assert "it is lost here without the rig" in texts(wiring.panels(session)["given"])


def test_a_rig_is_named_on_the_command_line_and_kept_with_the_session(tmp_path: Path) -> None:
    saved = tmp_path / "session.json"
    session = begin_session(write_seen(tmp_path), saved, threads=1)
    settle(session)
    assert session.calibration.is_given
    wiring.do(session, "refer", "0")
    again = begin_session([], saved, threads=1)
    settle(again)
    assert again.calibration.is_given


def test_a_newer_rig_stands_for_the_earlier_one(tmp_path: Path) -> None:
    session = begin_session(write_seen(tmp_path), None, threads=1)
    settle(session)
    other = replace(known_rig(), covariance=4.0 * known_rig().covariance)
    write_rig(tmp_path / "better.json", other)
    actions.take_dropped(session, ["better.json"], [(tmp_path / "better.json").read_bytes()])
    settle(session)
    assert [one.name for one in session.files if one.kind == "rig"] == ["better.json"]
    assert session.calibration.rig_covariance == pytest.approx(other.covariance)


def test_a_rig_that_does_not_serve_is_refused_and_nothing_changes(tmp_path: Path) -> None:
    machine, table, rig = write_seen(tmp_path)
    session = begin_session([machine, table], None, threads=1)
    settle(session)
    write_rig(rig, RIG)
    actions.take_dropped(session, ["rig.json"], [rig.read_bytes()])
    session.job.wait(60.0)
    told = texts(wiring.panels(session)["given"])
    assert "states no covariance" in told
    assert "calibrate again" in told
    assert [one.kind for one in session.files] == ["model", "measurements"]
    session.problems.clear()
    plain = pl.read_csv(table).drop("u_left", "v_left", "u_right", "v_right")
    actions.take_dropped(session, ["observations.csv"], [plain.write_csv().encode()])
    settle(session)
    write_rig(rig, known_rig())
    actions.take_dropped(session, ["rig.json"], [rig.read_bytes()])
    session.job.wait(60.0)
    told = texts(wiring.panels(session)["given"])
    assert "have no pixels" in told
    assert "leave the rig out" in told
    assert not session.calibration.is_given
