"""`geoerr compare`: what it prints, writes and refuses; the pictures; and real data."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from compare_scenes import MACHINE, NOISE_MM, circle, measured, places, term, turning_its_sign
from typer.testing import CliRunner

import geoerr
from geoerr.cli.main import app
from geoerr.diagnose import Comparison, compare
from geoerr.diagnose.components import is_circle
from geoerr.diagnose.labels import variable_meaning
from geoerr.errors import GeoerrError, GeometryError, InputFileError
from geoerr.machine import write_machine
from geoerr.model import Model, write_model
from geoerr.observations import observations_from_columns
from geoerr.report import figures
from geoerr.report.figures import style
from geoerr.report.figures.volume import direction_colors, volume_of

STRETCHED = Model(MACHINE, terms=(term("scale", "EXX", "k*x", k=1e-4),))
# docs/reference/formats/json.md, `compare`.
KEYS = {
    *("rmse_um", "rms_per_component_um", "held_out_rmse_um", "noise_floor_um", "noise_um", "n", "worst"),
    *("by_line", "by_axis", "lack_of_fit_p"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(1)
    q = places(rng, 90)
    lines = [f"line {number % 3}" for number in range(90)]
    observations = measured(
        q, STRETCHED.tool_from_work(q), rng, line=lines, temp_bed=np.linspace(20.0, 40.0, 90), t=np.arange(90.0)
    )
    geoerr.write_observations(tmp_path / "points.csv", observations)
    circle(STRETCHED, noise_mm=NOISE_MM).frame.write_csv(tmp_path / "circle.csv")
    lengths = {"feature": ["a", "b"], "x1": [0.0, 0.0], "y1": [0.0, 0.0], "z1": [0.0, 0.0]}
    lengths |= {"x2": [100.0, 200.0], "y2": [0.0, 0.0], "z2": [0.0, 0.0], "measured": [100.01, 200.02]}
    pl.DataFrame(lengths).write_csv(tmp_path / "lengths.csv")
    write_machine(tmp_path / "machine.toml", MACHINE)
    model = geoerr.fit_model(
        MACHINE, geoerr.read_observations(tmp_path / "points.csv"), components="none", effects=("scale:x",)
    ).model
    write_model(tmp_path / "model.json", model)
    geoerr.write_errors(tmp_path / "errors.json", model.error_functions())
    return tmp_path


def run(folder: Path, *words: str):  # type: ignore[no-untyped-def]
    known = {path.name: str(path) for path in folder.iterdir()}
    return CliRunner().invoke(app, ["compare", *(known.get(word, word) for word in words)])


def document(folder: Path, *words: str) -> dict[str, Any]:
    result = run(folder, *words, "--json")
    assert result.exit_code == 0, result.exception
    found: dict[str, Any] = json.loads(result.stdout)
    return found


@pytest.mark.parametrize("model", ["machine.toml", "errors.json", "model.json"])
@pytest.mark.parametrize("data", [("points.csv",), ("circle.csv",), ("lengths.csv",), ("points.csv", "circle.csv")])
def test_any_model_with_any_measurements_gives_the_keys_of_the_contract(
    folder: Path, model: str, data: tuple[str, ...]
) -> None:
    found = document(folder, model, *data)
    assert set(found) >= KEYS
    assert isinstance(found["rmse_um"], float)
    assert isinstance(found["n"], int)
    assert set(found["by_axis"]) == {"x", "y", "z"}
    for row in found["worst"]:
        assert {"line", "x", "y", "z", "residual_um"} <= set(row)
        assert len(row["residual_um"]) == 3
    for part in found["by_line"].values():
        assert {"rmse_um", "n"} <= set(part)
    own = model == "model.json" and data == ("points.csv",)
    assert (found["is_own_data"], found["model_takes_part"]) == (own, own)


def test_a_page_tells_radii_and_lengths_from_components_of_positions(folder: Path) -> None:
    def page(*data: str) -> str:
        result = run(folder, "machine.toml", *data, "--report", str(folder / "page.html"))
        assert result.exit_code == 0, result.exception
        return (folder / "page.html").read_text(encoding="utf-8")

    alone = page("circle.csv")
    assert "residual radius, µm" in alone
    assert "residual x, µm" not in alone
    # Two lengths that are off by no more than points are among the worst, in a column of their own.
    mixed = page("points.csv", "circle.csv", "lengths.csv")
    assert {"residual x, µm", "residual length, µm"} <= set(re.findall("residual [a-z]+, µm", mixed))


def test_only_positions_are_drawn_in_the_volume(folder: Path) -> None:
    points, lengths = (geoerr.read_observations(folder / "points.csv"), geoerr.read_lengths(folder / "lengths.csv"))
    comparison = compare(Model(MACHINE), points, lengths)
    assert len(volume_of(comparison).rows) == 90
    drawn = figures.residual_histogram(comparison).data
    assert [trace.name for trace in drawn].count("residual") == 4
    # Nobody repeated a length: the noise of points is not theirs.
    assert "x4" not in [trace.xaxis for trace in drawn if trace.name == "noise floor (repeats)"]
    # A length is no variable of its own residual.
    assert not {"measured", "s_measured"} & {trend.variable for trend in comparison.trends}
    assert {trace.yaxis for trace in figures.residual_over(comparison, "temp_bed").data} == {"y", "y2", "y3"}


def test_variables_of_the_machine_come_before_pixels_and_all_have_a_meaning(folder: Path) -> None:
    """Where the camera saw the target follows the position, and its error no less than the position does."""
    points = pl.read_csv(folder / "points.csv").with_columns(u_left=pl.col("x") + 100.0, load=pl.int_range(90) % 7)
    points.write_csv(folder / "points.csv")
    trends = document(folder, "machine.toml", "points.csv")["trends"]
    named = [trend["variable"] for trend in trends]
    assert set(named[-3:]) == {"u_left"}
    assert "u_left" not in named[:-3]
    text = " ".join(run(folder, "machine.toml", "points.csv").stdout.split())
    assert "the largest first, pixels last: along x over x (position, mm): worth" in text
    without = points.drop("u_left")
    without.write_csv(folder / "points.csv")
    assert "pixels" not in run(folder, "machine.toml", "points.csv").stdout


def test_a_size_that_follows_a_temperature_is_told(folder: Path) -> None:
    observations, _ = turning_its_sign(np.random.default_rng(10))
    geoerr.write_observations(folder / "turning.csv", observations)
    text = " ".join(run(folder, "machine.toml", "turning.csv").stdout.split())
    assert "the residual follows nothing" not in text
    assert "its size follows temp_bed (temperature, °C), along y: " in text
    assert " rms 96 rows" in text
    run(folder, "machine.toml", "turning.csv", "--report", str(folder / "page.html"))
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert "What its size follows about the mean of each bin" in page
    assert "Y over temp_bed" in page


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("y", "position, mm"),
        ("temp_bed", "temperature, °C"),
        ("s_x", "travel of x since it turned round, mm"),
        ("u_left", "column of the left picture, px"),
        ("load", "as measured"),
    ],
)
def test_a_name_has_a_meaning(name: str, meaning: str) -> None:
    assert variable_meaning(name) == meaning


def test_the_model_that_knows_the_scale_is_better_and_refit_is_said(folder: Path) -> None:
    nominal, own = document(folder, "machine.toml", "points.csv"), document(folder, "model.json", "points.csv")
    assert own["rmse_um"] < 0.3 * nominal["rmse_um"]
    again = document(folder, "model.json", "points.csv", "circle.csv", "--refit")
    assert again["model_takes_part"]
    assert not again["is_own_data"]
    assert again["set_aside"] == []
    text = run(folder, "model.json", "circle.csv").stdout
    assert "numbers stay as they are" in text
    assert "its own numbers take part" in run(folder, "model.json", "points.csv").stdout


@pytest.mark.parametrize("data", [("points.csv",), ("circle.csv",), ("lengths.csv",), ("points.csv", "lengths.csv")])
def test_the_text_fits_the_terminal_and_says_where(folder: Path, data: tuple[str, ...]) -> None:
    result = run(folder, "machine.toml", *data)
    assert result.exit_code == 0, result.exception
    # A path cannot be broken.
    lines = [line for line in result.stdout.splitlines() if str(folder) not in line]
    assert max(map(len, lines)) <= 100
    assert "nan" not in result.stdout
    if "points.csv" in data:
        for words in (
            "by line, worst first",
            "by region",
            "along x over x (position, mm): worth",
            "worst places:",
            "points.csv:",
        ):
            assert words in result.stdout
    if "lengths.csv" in data:
        # 10 µm in 100 mm and 20 in 200.
        assert "15.81" in result.stdout


def test_nothing_but_json_on_standard_output_and_the_same_bytes(folder: Path) -> None:
    words = ("machine.toml", "points.csv", "circle.csv", "--json", "--threads")
    first, second = run(folder, *words, "1"), run(folder, *words, "2")
    assert json.loads(first.stdout)["trends"] == json.loads(second.stdout)["trends"]
    assert first.stdout.splitlines()[0] == "{"


def test_refusals(folder: Path) -> None:
    result = run(folder, "nothing.json", "points.csv")
    assert isinstance(result.exception, InputFileError)
    result = run(folder, "machine.toml", "points.csv", "--report", str(folder / "points.csv"))
    assert isinstance(result.exception, InputFileError)
    assert "is an input" in str(result.exception)
    (folder / "empty.csv").write_text("x,y,z,mx,my,mz\n1,2,3,,,\n")
    result = run(folder, "machine.toml", "empty.csv")
    assert isinstance(result.exception, GeometryError)
    assert run(folder, "machine.toml").exit_code == 2
    warm = Model(MACHINE, terms=(term("growth", "EXX", "a*(temp_spindle-20)*x", a=1e-7),))
    write_model(folder / "warm.json", warm)
    result = run(folder, "warm.json", "points.csv")
    assert "no column 'temp_spindle'" in str(result.exception)


def test_the_page_stands_alone(folder: Path) -> None:
    words = ("machine.toml", "points.csv", "circle.csv", "--report", str(folder / "page.html"))
    assert run(folder, *words).exit_code == 0
    first = (folder / "page.html").read_bytes()
    text = first.decode()
    for title in ("Histogram of the residual", "Residual in the volume", "Residual by region", "Residual over x"):
        assert title in text
    assert "http://" not in text.split("<script")[0]
    assert run(folder, *words).exit_code == 0
    assert (folder / "page.html").read_bytes() == first


# Pictures.


@pytest.fixture(scope="module")
def scene() -> Comparison:
    rng = np.random.default_rng(2)
    q = np.repeat(places(rng, 60), 2, axis=0)
    observations = measured(q, STRETCHED.tool_from_work(q), rng, temp_bed=np.linspace(20.0, 40.0, 120))
    return compare(Model(MACHINE), observations, circle(STRETCHED, noise_mm=NOISE_MM))


def test_every_picture_has_title_units_and_the_common_look(scene: Comparison) -> None:
    for figure in (
        figures.residual_against(scene, "x", "temp_bed"),
        figures.residual_vectors(scene),
        figures.residual_directions(scene),
        figures.residual_by_region(scene),
        figures.residual_histogram(scene),
    ):
        assert figure.layout.title.text
        assert figure.layout.title.subtitle.text
        assert figure.layout.template.layout.colorway == style.SERIES
        assert "µm" in str(figure.to_plotly_json())


def test_the_picture_over_a_variable_shows_the_numbers(scene: Comparison) -> None:
    figure = figures.residual_against(scene, "x", "temp_bed")
    points = figure.data[0]
    known = scene.components[0].is_known & np.isfinite(scene.points.sightings.numbers("temp_bed"))
    np.testing.assert_array_equal(points.x[: known.sum()], scene.points.sightings.commanded_mm[known, 0])
    np.testing.assert_array_equal(points.y[: known.sum()], scene.components[0].residual_um[known])
    means = figure.data[1]
    trend = next(one for one in scene.trends if (one.variable, one.component) == ("x", "x"))
    np.testing.assert_allclose(means.y, [one.mean_um for one in trend.bins])
    np.testing.assert_allclose(means.error_y.array, [1.96 * one.std_error_um for one in trend.bins])
    with pytest.raises(GeoerrError, match=r"cannot be drawn over 'speed'.*\n.*temp_bed"):
        figures.residual_against(scene, "speed")


def test_columns_of_texts_and_columns_with_odd_names_are_colours_too() -> None:
    rng = np.random.default_rng(30)
    q = places(rng, 40)
    lines = ["first" if number < 20 else "<b>second" for number in range(40)]
    more = {"line": lines, "load <N>": np.arange(40.0), "dir_x": np.tile([1, -1], 20), "note": ["same"] * 40}
    scene = compare(Model(MACHINE), measured(q, STRETCHED.tool_from_work(q), rng, **more))
    figure = figures.residual_against(scene, "x", "line")
    np.testing.assert_array_equal(figure.data[0].marker.color, np.repeat([0.0, 1.0], 20))
    bar = figure.layout.coloraxis.colorbar
    assert (bar.tickvals, bar.ticktext) == ((0, 1), ("first", "&lt;b&gt;second"))
    figure = figures.residual_against(scene, "dir_x", "load <N>")
    np.testing.assert_array_equal(figure.data[0].x, np.tile([1.0, -1.0], 20))
    assert figure.layout.coloraxis.colorbar.title.text == "load &lt;N&gt;"
    with pytest.raises(GeoerrError, match=r"over 'line': no such variable of numbers.*\n.*; for colour also line"):
        figures.residual_against(scene, "line")
    with pytest.raises(GeoerrError, match="over 'note'"):
        figures.residual_against(scene, "x", "note")
    many = compare(Model(MACHINE), measured(q, q, rng, line=[f"line {number}" for number in range(40)]))
    with pytest.raises(GeoerrError, match="'line' has 40 different texts"):
        figures.residual_against(many, "x", "line")


def test_strokes_are_magnified_residuals(scene: Comparison) -> None:
    stroke = figures.residual_vectors(scene).data[0]
    factor = float(
        figures.residual_vectors(scene)
        .layout.title.subtitle.text.split("magnified ")[1]
        .split(" ")[0]
        .replace(",", "")
    )
    fitted = scene.points
    shown = fitted.solved.used & ~is_circle(fitted)
    ends = np.column_stack([stroke.x, stroke.y, stroke.z]).reshape(-1, 3, 3)
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], factor * fitted.residual_mm[shown], atol=1e-9)


def test_opposite_directions_have_different_colours() -> None:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    colors = direction_colors(axes)
    assert len(set(colors)) == 6
    assert direction_colors(3.0 * axes) == colors
    assert direction_colors(np.zeros((1, 3)))[0].startswith("#")


def test_a_direction_has_no_halves(folder: Path) -> None:
    rows = pl.read_csv(folder / "points.csv")
    rows = rows.with_columns(dir_x=pl.Series(np.tile([1, -1], 45)), dir_y=1, dir_z=1)
    rows.write_csv(folder / "both.csv")
    comparison = compare(Model(MACHINE), geoerr.read_observations(folder / "both.csv"))
    figure = figures.residual_over(comparison, "d_x", color_by="d_x")
    assert list(figure.layout.xaxis.tickvals) == [-1.0, 1.0]
    assert list(figure.layout.coloraxis.colorbar.tickvals) == [-1.0, 1.0]
    assert figures.residual_over(comparison, "temp_bed", color_by="temp_bed").layout.xaxis.tickvals is None


def test_a_noise_far_below_the_residual_leaves_the_histogram_at_its_top() -> None:
    x = np.tile(np.linspace(0.0, 300.0, 60), 3)
    off = 5e-3 * np.sin(x / 20.0) + np.random.default_rng(3).normal(0.0, 1e-4, x.shape)
    columns = {"x": x, "y": 0.0 * x + 10.0, "z": 0.0 * x + 10.0, "repeat": np.repeat([0.0, 1.0, 2.0], 60)}
    points = observations_from_columns(columns | {"mx": x + off, "carrier": ["relative"] * len(x)})
    figure = figures.residual_histogram(compare(Model(MACHINE), points))
    bars, curve = figure.data
    density = np.array(curve.y)
    assert density.max() > 4.0 * max(bars.y)
    # A curve that is cut off level would be another distribution.
    assert (density == density.max()).sum() == 1
    assert max(bars.y) < figure.layout.yaxis.range[1] < density.max()
    assert figure.layout.yaxis.range[0] == 0.0


def test_the_histogram_counts_every_residual(scene: Comparison) -> None:
    figure = figures.residual_histogram(scene)
    bars = [trace for trace in figure.data if trace.type == "bar"]
    assert [int(sum(bar.y)) for bar in bars] == [int(one.is_known.sum()) for one in scene.components]
    assert "noise floor" in figure.layout.title.subtitle.text


# Real data: figures of their own descriptions, rms per component in µm.


def real(real_data: Path, name: str) -> dict[str, object]:
    folder = real_data / name
    result = CliRunner().invoke(
        app, ["compare", str(folder / "machine.toml"), str(folder / "observations.csv"), "--json"]
    )
    assert result.exit_code == 0, result.exception
    return json.loads(result.stdout)  # type: ignore[no-any-return]


@pytest.mark.real_data
def test_a_printer_that_warms_up(real_data: Path) -> None:
    found = real(real_data, "thermal")
    assert found["rmse_um"] == pytest.approx(80.0, abs=0.5)
    assert found["outliers"] == []
    assert found["held_out_rmse_um"] > found["rmse_um"]  # type: ignore[operator]
    named = [(trend["variable"], trend["component"]) for trend in found["trends"]]
    assert named.index(("temp_frame", "z")) < named.index(("temp_nozzle", "z"))


@pytest.mark.real_data
def test_a_slide_under_a_laser(real_data: Path) -> None:
    found = real(real_data, "positioning")
    assert found["rmse_um"] == pytest.approx(39.9, abs=0.05)
    worth = {trend["variable"]: trend["worth_um"] for trend in found["trends"]}
    assert worth["repeat"] > worth["d_x"] > 0.0


@pytest.mark.real_data
def test_a_plate_on_a_cmm(real_data: Path) -> None:
    found = real(real_data, "plates")["set_up"]
    assert isinstance(found, dict)
    assert found["as_measured_rms_um"] == pytest.approx(142.0, abs=0.5)
    assert found["shifted_rms_um"] == pytest.approx(10.2, abs=0.05)
    assert found["turned_rms_um"] == pytest.approx(7.6, abs=0.05)
