"""Figures show the numbers they were given, with units, names and reasons."""

from __future__ import annotations

import dataclasses
import html

import numpy as np
import plotly.graph_objects as go
import polars as pl
import pytest

from geoerr.error_functions import (
    LINEAR_AND_ANGULAR,
    SQUARENESS,
    ErrorFunction,
    ErrorFunctions,
    NotDetermined,
    Squareness,
    is_angular,
)
from geoerr.machine import AXES, Axis, Machine
from geoerr.model import Model
from geoerr.observations import CircularTest, observations_from_columns
from geoerr.report import figures
from geoerr.report.ballbar import circular_test_blocks
from geoerr.report.error_tables import error_function_table, not_determined, share_within_95, squareness_table
from geoerr.report.figures import style
from geoerr.report.figures.volume import aspect_of
from geoerr.report.page import Table
from geoerr.verify.ballbar import circle_of_first_run, circle_to_test, run_circular_test
from geoerr.verify.positioning import PositioningTest

MACHINE = Machine("test", "wZbXYt", {name: Axis((0.0, 400.0)) for name in AXES})
POSITION_MM = np.linspace(0.0, 400.0, 21)


def some_errors(seed: int = 0, with_std: bool = True, scale: float = 1.0) -> ErrorFunctions:
    rng = np.random.default_rng(seed)
    functions = {}
    for name in LINEAR_AND_ANGULAR:
        size = scale * (1e-4 if is_angular(name) else 0.03)
        value = size * np.sin(POSITION_MM / rng.uniform(60, 200) + rng.uniform(0, 6))
        std = size * 0.1 * np.arange(21) / 20
        functions[name] = ErrorFunction(POSITION_MM, value - value[0], std if with_std else None)
    squareness = {name: Squareness(scale * rng.normal() * 1e-3, 1e-5 if with_std else None) for name in SQUARENESS}
    return ErrorFunctions(MACHINE, functions, squareness, "truth")


def all_figures() -> dict[str, go.Figure]:
    errors = some_errors()
    model = Model(MACHINE, errors)
    result = run_circular_test(model, circle_to_test(model))
    n = 9
    observations = observations_from_columns(
        {"x": np.arange(n), "y": np.zeros(n), "z": np.zeros(n), "mx": np.arange(n), "sx": np.full(n, 0.004)}
    )
    views = [figures.CalibrationView("left01.png", 0.2, 0.3), figures.CalibrationView("b", None, None, "too dark")]
    return {
        "error_curves": figures.error_curves(errors, some_errors(1)),
        "nine_lines": figures.nine_lines(errors),
        "error_field": figures.error_field(model, lambda q: np.zeros_like(q)),
        "circle": figures.circle(result.before[0], result.after[0], result.before[1]),
        "measurement_residuals": figures.measurement_residuals(observations, np.full(n, 0.05)),
        "calibration_views": figures.calibration_views(views),
        "path_error": figures.path_error(np.arange(5.0), np.ones(5), np.full(5, 1e-3), 5e-3),
        "path_places": figures.path_places(np.ones((5, 3)), np.ones(5), np.full(5, 1e-3)),
    }


def test_every_figure_has_a_title_units_and_the_same_look():
    for name, figure in all_figures().items():
        assert figure.layout.title.text, name
        assert figure.layout.title.subtitle.text, name
        assert figure.layout.height >= 360, name
        look = figure.layout.template.layout
        assert look.colorway == style.SERIES, name
        # The unit is the title's: no tick has a prefix of its own.
        for axis in (look.xaxis, look.yaxis, look.polar.radialaxis, look.scene.zaxis):
            assert axis.exponentformat == "none", name
        words = figure.to_json()
        assert any(unit in words for unit in ("µm", "px", "mm")), name


def test_figures_are_the_same_every_time():
    first = {name: figure.to_json() for name, figure in all_figures().items()}
    assert first == {name: figure.to_json() for name, figure in all_figures().items()}


def test_curves_show_values_and_95_percent_bands_in_micro_units():
    errors, truth = some_errors(), some_errors(1)
    figure = figures.error_curves(errors, truth)
    lines = [trace for trace in figure.data if trace.name == "found" and len(trace.x) > 1]
    bands = [trace for trace in figure.data if trace.name == "95 % interval"]
    truths = [trace for trace in figure.data if trace.name == "truth" and len(trace.x) > 2]
    assert len(lines) == len(bands) == len(truths) == 18
    # Rows are directions, columns axes.
    order = [f"E{direction}{axis}" for direction in "XYZABC" for axis in "XYZ"]
    for name, line, band, true in zip(order, lines, bands, truths, strict=True):
        factor = 1e6 if is_angular(name) else 1e3
        found = errors.functions[name]
        np.testing.assert_allclose(line.y, found.value * factor)
        np.testing.assert_allclose(band.y[:21] - line.y, 1.96 * found.std * factor, atol=1e-9)
        np.testing.assert_allclose(line.y - band.y[21:][::-1], 1.96 * found.std * factor, atol=1e-9)
        np.testing.assert_allclose(true.y, truth.functions[name].value * factor)
    titles = " ".join(annotation.text for annotation in figure.layout.annotations)
    assert "<b>EYX</b>  δ<sub>yx</sub>" in titles
    assert "<b>ECX</b>  ε<sub>zx</sub>" in titles
    assert sum(trace.showlegend is not False for trace in figure.data) == 3


def test_squareness_has_its_interval_and_its_value_in_words():
    errors = some_errors()
    figure = figures.error_curves(errors)
    points = [trace for trace in figure.data if trace.name == "found" and len(trace.x) == 1]
    assert len(points) == 3
    for name, point in zip(SQUARENESS, points, strict=True):
        assert point.x[0] == pytest.approx(errors.squareness[name].value_rad * 1e6)
        assert point.error_x.array[0] == pytest.approx(1.96 * 10.0)
        text = f"{errors.squareness[name].value_rad * 1e6:.1f} ± 19.6 µrad".replace("-", "−")
        assert any(text in annotation.text for annotation in figure.layout.annotations)


def test_what_is_not_determined_is_said_where_its_curve_would_be():
    errors = some_errors()
    fewer = {name: function for name, function in errors.functions.items() if name != "EAX"}
    unknown = dataclasses.replace(
        errors,
        functions=fewer,
        squareness={"EC0Y": errors.squareness["EC0Y"]},
        not_determined=(NotDetermined("EAX", "no second target"), NotDetermined("EB0Z", "the camera moved")),
    )
    figure = figures.error_curves(unknown)
    texts = [annotation.text for annotation in figure.layout.annotations]
    assert sum("not determined" in text for text in texts) == 3
    assert any("no second target" in text for text in texts)
    assert any("the camera moved" in text for text in texts)
    blocks = not_determined(unknown)
    assert ("EAX", "ε_xx", "no second target") in blocks[1].rows
    row = next(row for row in error_function_table(unknown).rows if row[0] == "EAX")
    assert row[3] == "not determined"
    assert next(row for row in squareness_table(unknown).rows if row[0] == "EB0Z")[2] == "not determined"


def test_an_empty_panel_says_why_in_its_own_place_and_has_no_scale():
    errors = some_errors()
    functions = {name: one for name, one in errors.functions.items() if name not in ("EAX", "EXY")}
    why = "these measurements cannot tell it from EB0Z, the pose of the measuring frame: the y axis never moved"
    known = dataclasses.replace(
        errors, functions=functions, squareness={}, not_determined=(NotDetermined("EC0Y", why),)
    )
    figure = figures.error_curves(known, absent=("EAX",))
    said = {one.xref.split()[0]: one for one in figure.layout.annotations if one.text.startswith("<i>")}
    assert len(said) == 5
    # What has no trace is no panel: Plotly would say all of it in the first.
    assert set(said) <= {trace.xaxis for trace in figure.data}
    for name, one in said.items():
        for axis in (name, one.yref.split()[0]):
            assert figure.layout[axis[0] + "axis" + axis[1:]].showticklabels is False
    assert [one.text for one in said.values()].count("<i>not in the model</i>") == 1
    # Three lines of a reason fit below the heading of a low panel.
    long = next(one for one in said.values() if "EB0Z" in one.text)
    assert (long.y, long.yanchor, long.text.count("<br>")) == (1.0, "top", 3)


def test_what_a_prediction_takes_as_0_is_said_on_its_picture():
    """One beam along x: what it says of the other axes would be a machine without errors."""
    known = ErrorFunctions(
        MACHINE,
        {"EXX": some_errors().functions["EXX"]},
        {},
        "joint",
        tuple(NotDetermined(name, "the axis never moved") for name in ("EYY", "EZZ")),
    )
    model = Model(MACHINE, known)
    drawn = (model.plot_positioning(), model.plot_circles(), model.plot_diagonals(), model.plot_field())
    for figure in drawn:
        assert figure.layout.title.subtitle.text.endswith(
            "; taken as 0: EYY, EZZ not determined, 18 not in the model"
        )
    assert "taken as 0" not in Model(MACHINE, some_errors()).plot_diagonals().layout.title.subtitle.text


def test_a_band_is_no_row_of_points():
    few = np.array([0.0, 100.0, 200.0])
    assert style.band(few, few, few, style.BLUE).mode == "lines"


@pytest.mark.parametrize("chain", ["wZbXYt", "wbXYZt", "wXYZbt"])
def test_the_nine_lines_are_what_a_target_at_their_offset_travels(chain):
    machine = dataclasses.replace(MACHINE, chain=chain)
    errors = dataclasses.replace(some_errors(scale=0.01), machine=machine, squareness={})
    model = Model(machine, errors)
    curves = {curve.number: curve for curve in figures.lines_of_errors(errors)}
    assert sorted(curves) == list(range(1, 10))
    offsets = {4: (0, 0, 200), 5: (0, 150, 0), 6: (0, 0, 200), 7: (150, 0, 0), 8: (0, 200, 0), 9: (200, 0, 0)}
    for number, curve in curves.items():
        axis = AXES.index(curve.axis)
        q = np.zeros((len(POSITION_MM), 3))
        q[:, axis] = POSITION_MM
        error = model.error_mm(q, offset_mm=np.array(offsets.get(number, (0, 0, 0)), dtype=float))
        # Second order: angles of 1e-6 rad squared on arms of 400 mm.
        np.testing.assert_allclose(curve.deviation_mm, error[:, axis] - error[0, axis], atol=1e-8)


def test_the_field_is_drawn_magnified_as_it_says():
    model = Model(MACHINE, some_errors())
    figure = figures.error_field(model, lambda q: 0.5 * model.error_mm(q))
    nominal, before, _, after = figure.data
    magnification = float(figure.layout.title.subtitle.text.split("magnified ")[1].split(" ")[0].replace(",", ""))
    at = np.column_stack([nominal.x, nominal.y, nominal.z])
    drawn = np.isfinite(at[:, 0])
    error = model.error_mm(np.ascontiguousarray(at[drawn]))
    for trace, share in ((before, 1.0), (after, 0.5)):
        moved = np.column_stack([trace.x, trace.y, trace.z])[drawn] - at[drawn]
        np.testing.assert_allclose(moved, share * magnification * error, atol=1e-9)
    largest = np.linalg.norm(error, axis=1).max()
    assert 0.05 * 400 < magnification * largest <= 0.15 * 400
    assert before.line.cmax == after.line.cmax == pytest.approx(largest * 1e3)
    # Every point of the grid lies on a face of the volume.
    assert ((at[drawn] == 0.0) | (at[drawn] == 400.0)).any(axis=1).all()


def test_the_field_of_a_nominal_machine_can_be_drawn():
    figure = figures.error_field(Model(MACHINE))
    assert "magnified 1 times" in figure.layout.title.subtitle.text


def test_the_circle_shows_the_deviations_and_closes():
    model = Model(MACHINE, some_errors())
    result = run_circular_test(model, circle_to_test(model))
    figure = figures.circle(result.before[0], result.after[0])
    before = next(trace for trace in figure.data if (trace.name or "").startswith("before"))
    np.testing.assert_allclose(before.r[:-1], result.before[0].radial_deviation_mm * 1e3)
    assert before.r[0] == before.r[-1]
    assert f"{result.before[0].circular_deviation_mm * 1e3:.1f} µm" in before.name
    # Nothing falls off the plot, and rings are the tick marks that the caption names.
    for axis, trace in ((figure.layout.polar.radialaxis, before), (figure.layout.polar2.radialaxis, figure.data[-1])):
        assert axis.range[0] < trace.r.min()
        assert trace.r.max() < axis.range[1]
        ring = np.diff(axis.tickvals)
        assert any(f"rings {ring[0]:g} µm apart" in annotation.text for annotation in figure.layout.annotations)


def runs_of_a_circle(names: list[str]) -> CircularTest:
    """Runs both ways under each name, in a file of a ball bar."""
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    frames = [
        pl.DataFrame(
            {
                "line": [name] * len(angle),
                "dir": [sense] * len(angle),
                "x": 200.0 + 100.0 * np.cos(sense * angle),
                "y": 200.0 + 100.0 * np.sin(sense * angle),
                "z": 0.0 * angle,
                "r": 100.0 + 0.005 * np.cos(2.0 * angle),
            }
        )
        for name in names
        for sense in (1, -1)
    ]
    return CircularTest(pl.concat(frames).with_row_index("file_row", offset=2), ("memory",))


def test_measured_runs_are_told_apart_and_their_legend_stands_below_the_plots():
    measured = runs_of_a_circle(["<b>bar</b>", "bar"])
    result = run_circular_test(Model(MACHINE, some_errors()), circle_of_first_run(measured), measured=measured)
    figure = figures.circular_test(result)
    runs = [trace for trace in figure.data if (trace.name or "").startswith("measured")]
    assert len({trace.name for trace in runs}) == len({trace.marker.color for trace in runs}) == 4
    assert len({trace.marker.symbol for trace in runs}) == 4
    assert runs[0].name.startswith("measured &lt;b&gt;bar&lt;/b&gt;, dir +1, G = ")
    assert "<b>" not in runs[0].hovertemplate
    layout = figure.layout
    plots_px = layout.height - layout.margin.t - layout.margin.b
    assert -layout.legend.y * plots_px + 6 * 20 <= layout.margin.b + 12
    assert (layout.legend.orientation, layout.legend.yanchor) == ("v", "top")


def test_a_machine_without_errors_shows_the_measured_runs_alone():
    measured = runs_of_a_circle(["bar"])
    result = run_circular_test(Model(MACHINE), circle_of_first_run(measured), measured=measured)
    drawn, *rest = circular_test_blocks(result)
    assert [trace.name.split(",")[0] for trace in drawn.figure.data if trace.name] == [
        "measured bar",
        "measured bar",
        "machine without errors",
    ]
    assert "compensation" not in drawn.caption
    assert [table.caption for table in rest if isinstance(table, Table)] == ["Measured runs, µm"]


def test_what_files_call_their_lines_is_no_markup_and_no_longer_than_its_plot():
    test = PositioningTest(np.array([0.0, 100.0]), *np.zeros((4, 2)), 5)
    name = "X at y 50, z 40 mm (<i>front</i> & left, by the door of the hall, second try)"
    figure = figures.positioning_curves({name: test}, "Positioning", "measured")
    (title,) = (one.text for one in figure.layout.annotations)
    assert title.startswith("X at y 50, z 40 mm (&lt;i&gt;front&lt;/i&gt; &amp; left")
    assert len(html.unescape(title)) <= 58
    assert title.endswith("…")


def test_places_on_a_line_are_drawn_in_a_cube():
    """True to scale the two other axes have no width, and the camera stands in what is drawn."""
    assert aspect_of(np.array([[0.0, 200.0, 100.0], [400.0, 200.0, 100.0]])) == "cube"
    assert aspect_of(np.array([[0.0, 0.0, 0.0], [400.0, 300.0, 100.0]])) == "data"


def test_a_long_path_keeps_its_largest_error():
    rng = np.random.default_rng(0)
    before, after = rng.uniform(0.5, 1.0, 30_011), rng.uniform(0, 1e-3, 30_011)
    after[17_003] = 0.25
    figure = figures.path_error(np.arange(30_011) * 0.1, before, after)
    assert len(figure.data[1].y) <= 2000
    assert np.nanmax(figure.data[1].y) == pytest.approx(250.0)
    assert np.nanmax(figure.data[0].y) == pytest.approx(before.max() * 1e3)
    assert "largest 250.0 µm" in figure.data[1].name


def test_a_long_path_from_above_keeps_its_largest_error_in_its_place():
    rng = np.random.default_rng(0)
    places = np.cumsum(rng.uniform(0.0, 1.0, (30_011, 3)), axis=0)
    before, after = rng.uniform(0.5, 1.0, 30_011), rng.uniform(0, 1e-3, 30_011)
    after[17_003] = 0.25
    figure = figures.path_places(places, before, after)
    off = figure.data[1]
    assert len(off.x) == len(off.marker.color) <= 2000
    worst = int(np.argmax(off.marker.color))
    assert off.marker.color[worst] == pytest.approx(250.0)
    # A stretch is drawn where it begins: at most 16 samples before.
    assert 0.0 <= places[17_003, 0] - off.x[worst] < 16.0
    # Before and after in the same colours, from no error on.
    assert (figure.layout.coloraxis.cmin, figure.layout.coloraxis.cmax) == (0.0, pytest.approx(1e3 * before.max()))
    assert {trace.marker.coloraxis for trace in figure.data} == {"coloraxis"}


def test_an_empty_path_is_an_empty_figure():
    for figure in (figures.path_error([], [], []), figures.path_places([], [], [])):
        assert all(len(trace.x) == 0 for trace in figure.data)


def test_the_value_of_a_variable_has_its_unit():
    assert figures.value_label("temp_bed", "34.99") == "temp_bed 34.99 °C"
    assert figures.value_label("d_x", "1") == "direction of approach in x 1"
    assert figures.value_label("t", "3") == "time 3 s"
    assert figures.value_label("own_column", "3") == "own_column 3"


def test_dropped_views_are_named_with_their_reason():
    views = [figures.CalibrationView("a.png", 0.2, 0.3), figures.CalibrationView("b.png", None, None, "too dark")]
    figure = figures.calibration_views(views)
    assert list(figure.data[0].x) == ["a.png"]
    assert "b.png (too dark)" in figure.layout.annotations[0].text


def test_the_share_within_95_percent_counts_uncertain_positions_only():
    found = ErrorFunction(POSITION_MM, np.zeros(21), np.where(POSITION_MM == 0.0, 0.0, 1.0))
    true = ErrorFunction(POSITION_MM, np.where(POSITION_MM >= 200.0, 1.97, 1.95))
    assert share_within_95(found, true) == pytest.approx(9 / 20)
    assert share_within_95(dataclasses.replace(found, std=None), true) is None


@pytest.mark.parametrize(
    ("value", "up", "down"), [(1.0, 1, 1), (1.1, 2, 1), (2.0, 2, 2), (30, 50, 20), (0.07, 0.1, 0.05)]
)
def test_rounding_to_1_2_5(value, up, down):
    assert style.round_up_125(value) == pytest.approx(up)
    assert style.round_down_125(value) == pytest.approx(down)


def test_deviations_that_tables_call_nothing_are_drawn_as_nothing():
    at, none = np.linspace(0.0, 300.0, 5), np.full(5, np.nan)
    tiny, small = (PositioningTest(at, -size * at, -size * at, none, none, 0) for size in (5e-7, 1e-3))
    figure = figures.positioning_curves({"Y": tiny, "Z": small}, "Positioning", "as the model has it")
    assert list(figure.layout.yaxis.range) == [-0.05, 0.05]
    assert figure.layout.yaxis2.range is None
