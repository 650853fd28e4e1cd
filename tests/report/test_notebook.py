"""What a notebook shows: small tables without scripts, all texts escaped, and every picture in one call."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import polars as pl
import pytest

import geoerr
from geoerr.diagnose import diagnose
from geoerr.diagnose.circles import diagnose_circles
from geoerr.errors import GeoerrError
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import CircularTest, Lengths, observations_from_columns
from geoerr.verify.ballbar import circle_to_test, middle_circle, run_circular_test
from geoerr.vision.rig import Rig, RightFromLeft

HOSTILE = "<img src=x onerror=alert(1)>&"
MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 200.0), name=f"mill {HOSTILE}")


@pytest.fixture(scope="module")
def shown() -> dict[str, Any]:
    """One of everything: measurements of a machine with play in X, its models, what is said of them."""
    rng = np.random.default_rng(7)
    rows = []
    for place in rng.uniform(0.0, 1.0, (30, 2)):
        way = np.column_stack(
            [np.linspace(0.0, 400.0, 9), np.full(9, 300.0 * place[0]), np.full(9, 200.0 * place[1])]
        )
        rows += [(*q, sense) for sense in (1, -1) for q in way[::sense]]
    table = np.array(rows)
    q, sense = table[:, :3], table[:, 3]
    seen = q + np.column_stack([1e-4 * q[:, 0] - 0.5 * 0.015 * sense, 2e-5 * q[:, 1], np.zeros(len(q))])
    seen += rng.normal(0.0, 1e-3, q.shape)
    columns: dict[str, Any] = dict(zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([q, seen]).T, strict=True))
    columns |= {"dir_x": sense, "temp_bed": np.linspace(20.0, 30.0, len(q))}
    names = {"line": [f"x {HOSTILE}"] * len(q), "target": [HOSTILE] * len(q), "carrier": ["relative"] * len(q)}
    observations = observations_from_columns(columns | names | {f"s{axis}": np.full(len(q), 1e-3) for axis in "xyz"})
    plain = geoerr.fit_model(MACHINE, observations, components="12")
    change = geoerr.add_effect(plain.model, observations, reference="backlash:x")
    model = change.result.model
    turn = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    circle = pl.DataFrame(
        {
            "line": [HOSTILE] * 120,
            "x": 200.0 + 100.0 * np.cos(turn),
            "y": 150.0 + 100.0 * np.sin(turn),
            "z": np.full(120, 100.0),
            "r": 100.0 + 0.008 * np.sin(2.0 * turn) + rng.normal(0.0, 5e-4, 120),
            "dir": [1] * 120,
        }
    )
    ends = {name: [0.0] for name in ("x1", "y1", "z1", "y2", "z2")}
    lengths = pl.DataFrame({"feature": [HOSTILE], **ends, "x2": [100.0], "measured": [100.01]})
    errors = model.error_functions()
    assert model.record is not None
    return {
        "machine": MACHINE,
        "rig": Rig(
            *(np.array([[1160.0, 0.0, 615.0], [0.0, 1158.0, 509.0], [0.0, 0.0, 1.0]]), np.full(5, 0.01)) * 2,
            RightFromLeft(np.eye(3), np.array([-300.0, 0.0, 0.0])),
            (1280, 1024),
        ),
        "observations": observations,
        "circular test": CircularTest(circle),
        "lengths": Lengths(lengths),
        "fit": plain,
        "model": model,
        "record": model.record,
        "history": model.record.history[0],
        "errors": errors,
        "change": change,
        "comparison": geoerr.compare(plain.model, observations),
        "diagnosis": diagnose(plain.model, observations),
        "circles": diagnose_circles(Model(MACHINE), CircularTest(circle)),
        "budget": geoerr.uncertainty_budget(model, at={"d_x": 1.0}),
        "ball bar": run_circular_test(Model(MACHINE, errors), circle_to_test(Model(MACHINE), "XY", (200.0, 150.0))),
    }


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("machine", ["wbXYZt", "0 to 400", "400", "20 °C"]),
        ("rig", ["left fx_px", "right k1", "baseline, mm", "not stated"]),
        ("observations", ["540 rows", "temp_bed, °C", "20 to 30", "stated"]),
        ("circular test", ["120 rows", "x, mm"]),
        ("lengths", ["1 rows", "measured, mm"]),
        ("fit", ["Nothing was added"]),
        ("model", ["backlash:x", "b = ", "µm", "residual, rms", "→", "predictions need"]),
        ("record", ["540 rows", "measured range", "backlash:x"]),
        ("history", ["added", "backlash:x", "→"]),
        ("errors", ["EXX", "δ_xx", "µm"]),
        ("change", ["added backlash:x", "before", "after"]),
        ("comparison", ["the data that the model was fitted to", "the residual follows", "d_x"]),
        ("diagnosis", ["missing", "backlash:x", "worth, µm"]),
        ("circles", ["verdict", "G (ISO 230-4), µm"]),
        ("budget", ["worst", "compensated part below, µm"]),
    ],
)
def test_each_shows_itself_without_scripts_and_escaped(shown: dict[str, Any], name: str, words: list[str]) -> None:
    html = shown[name]._repr_html_()
    assert HOSTILE not in html
    assert "<script" not in html
    assert "<img" not in html
    for text in words:
        assert text in html, text
    assert html.count("<table>") == html.count("</table>")
    assert "nan" not in html


@pytest.mark.parametrize("again", [lambda one: pickle.loads(pickle.dumps(one)), copy.deepcopy])
def test_each_goes_to_other_processes_and_is_the_same_there(
    shown: dict[str, Any], again: Callable[[Any], Any]
) -> None:
    for name, one in shown.items():
        other = again(one)
        assert other is not one, name
        # What holds arrays is equal to itself alone: nothing asks for the truth of an array.
        assert (one == other) in (True, False), name
        html = getattr(one, "_repr_html_", None)
        assert html is None or other._repr_html_() == html(), name
    # And there it is gone on from: what is asked of the core gives the same bytes.
    fit, other = shown["fit"].fitted, again(shown["fit"].fitted)
    assert other.residual_mm.tobytes() == fit.residual_mm.tobytes()
    assert other.held_out.residual_mm.tobytes() == fit.held_out.residual_mm.tobytes()
    terms = shown["change"].result.model.terms
    assert other.again(terms).covariance.tobytes() == fit.again(terms).covariance.tobytes()
    finding, same = shown["diagnosis"].found[0], again(shown["diagnosis"]).found[0]
    assert same.explained_um.tobytes() == finding.explained_um.tobytes()


def test_a_damaged_pickle_is_refused(shown: dict[str, Any]) -> None:
    restore, (whole,) = shown["fit"].fitted.solved.state.__reduce__()
    for damaged in (b"", whole[: len(whole) // 2], b"\xff" * 40):
        with pytest.raises(ValueError, match="no object of this version"):
            restore(damaged)


def test_hostile_names_arrive_as_they_are(shown: dict[str, Any]) -> None:
    for name in ("observations", "model", "comparison", "errors", "circles"):
        assert "&lt;img src=x onerror=alert(1)&gt;&amp;" in shown[name]._repr_html_(), name


@pytest.mark.parametrize(
    ("name", "method", "choices"),
    [
        ("observations", "plot_uncertainty", {}),
        ("model", "plot_errors", {"at": {"d_x": 1.0}}),
        ("model", "plot_field", {}),
        ("model", "plot_circles", {}),
        ("model", "plot_positioning", {}),
        ("model", "plot_diagonals", {}),
        ("model", "plot_fall", {}),
        ("errors", "plot_errors", {}),
        ("errors", "plot_nine_lines", {}),
        ("comparison", "plot_residuals", {}),
        ("comparison", "plot_residuals", {"over": "x", "color_by": "temp_bed"}),
        ("comparison", "plot_volume", {}),
        ("comparison", "plot_volume", {"look": "direction", "exaggeration": 2.0}),
        ("comparison", "plot_volume", {"look": "magnitude"}),
        ("comparison", "plot_regions", {}),
        ("comparison", "plot_histogram", {}),
        ("diagnosis", "plot_worth", {}),
        ("diagnosis", "plot_fall", {}),
        ("circles", "plot_causes", {}),
        ("change", "plot_fall", {}),
        ("budget", "plot_volume", {"n": 3}),
        ("ball bar", "plot_circle", {}),
    ],
)
def test_each_picture_is_one_call(shown: dict[str, Any], name: str, method: str, choices: dict[str, Any]) -> None:
    figure = getattr(shown[name], method)(**choices)
    assert isinstance(figure, go.Figure)
    assert figure.layout.title.text
    assert figure.data
    # A figure that somebody can go on with.
    figure.update_layout(title_text="mine")
    json.loads(figure.to_json())


def test_what_a_finding_would_explain_is_drawn_over_the_residual(shown: dict[str, Any]) -> None:
    comparison, finding = shown["comparison"], shown["diagnosis"].found[0]
    drawn = [one.name for one in comparison.plot_residuals("x", explained_um=finding.explained_um).data]
    assert "explained" in drawn
    volume = comparison.plot_volume(explained_um=finding.explained_um, shape_at={})
    plain = comparison.plot_volume()
    assert [one.name for one in volume.data[: len(plain.data)]] == [one.name for one in plain.data]
    strokes, *grid = volume.data[len(plain.data) :]
    assert strokes.name == "would be explained"
    assert len(grid) == 2
    # A stroke is a point, where it would move to, and a gap.
    moved = np.column_stack([np.diff(np.asarray(strokes[axis], dtype=float).reshape(-1, 3)[:, :2]) for axis in "xyz"])
    explained = finding.explained_um[np.isfinite(finding.explained_um).all(axis=1)]
    moved_mm, explained_um = (np.linalg.norm(one, axis=1) for one in (moved, explained))
    # Both drawn with one magnification: the shares of their sums are those of their largest.
    assert moved_mm.sum() / moved_mm.max() == pytest.approx(explained_um.sum() / explained_um.max(), rel=0.01)
    for draw in (comparison.plot_residuals, comparison.plot_volume):
        with pytest.raises(GeoerrError, match=r"\(2, 3\).* rows were compared"):
            draw(explained_um=np.zeros((2, 3)))


def test_pictures_show_the_numbers(shown: dict[str, Any]) -> None:
    comparison, diagnosis = shown["comparison"], shown["diagnosis"]
    most = comparison.trends[0].variable
    assert comparison.plot_residuals().to_json() == comparison.plot_residuals(most).to_json()
    bars = diagnosis.plot_fall().data[0]
    assert bars.x[0] == pytest.approx(diagnosis.held_out_rmse_um)
    assert bars.x[1] == pytest.approx(diagnosis.found[0].held_out_rmse_after_um)
    assert bars.y[1].endswith("+ backlash:x")
    there = shown["model"].plot_positioning().data[0]
    assert there.y[-1] - there.y[0] == pytest.approx(40.0, abs=2.0)


def test_what_cannot_be_drawn_says_so(shown: dict[str, Any]) -> None:
    with pytest.raises(GeoerrError, match="has no history"):
        shown["fit"].model.plot_fall()
    with pytest.raises(GeoerrError, match="no such variable"):
        shown["comparison"].plot_residuals("spool")
    with pytest.raises(GeoerrError, match=r"no way to look.*\nhint: .*, region"):
        shown["comparison"].plot_volume("shadows")
    for look in ("length", "region"):
        for times in (0.0, -5.0, np.nan):
            with pytest.raises(GeoerrError, match=r"^exaggeration is .*\nhint: give a number above 0"):
                shown["comparison"].plot_volume(look, exaggeration=times)
    with pytest.raises(GeoerrError, match="without a name"):
        shown["diagnosis"].plot_unknown()


def test_the_circle_of_a_plane_fits_into_it() -> None:
    model = Model(Machine.from_chain("wbXYZt", (400.0, 90.0, 51.0)))
    assert middle_circle(model, "XY").radius_mm == pytest.approx(40.5)
    assert middle_circle(model, "YZ").radius_mm == pytest.approx(22.9)
    assert middle_circle(Model(MACHINE), "XY").radius_mm == 100.0


def test_who_draws_nothing_loads_no_pictures(tmp_path: Path) -> None:
    code = (
        "import sys, geoerr, geoerr.diagnose; from geoerr.machine import Machine\n"
        "geoerr.Model(Machine.from_chain('wbXYZt', (1.0, 1.0, 1.0)))._repr_html_()\n"
        "sys.exit('plotly' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
