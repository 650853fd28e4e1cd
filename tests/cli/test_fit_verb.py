"""`geoerr fit`: what it finds, prints, writes and refuses."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import typer
from typer.testing import CliRunner

import geoerr
from geoerr.cli import fit as verb
from geoerr.effects import catalogue, load_catalogue, load_effects
from geoerr.errors import ExpressionError, GeoerrError, InputFileError
from geoerr.machine import write_machine

Numbers = np.ndarray[Any, np.dtype[np.float64]]
MACHINE = geoerr.Machine.from_chain("wYbZXt", (400.0, 300.0, 250.0), name="one that nobody listed")
NOISE_MM = 1e-3
K, B_MM, ALPHA, FIXED_MM = 40e-6, 0.020, 11.5e-6, 120.0
COMPARED = {
    *("rmse_um", "rms_per_component_um", "held_out_rmse_um", "noise_floor_um", "noise_um", "n", "worst"),
    *("by_line", "by_axis", "lack_of_fit_p"),
}
OWN = """
[[effect]]
id = "my-gap"
title = "My gap"
channel = "along"
axes = ["x", "y", "z"]
expression = "-(b/2)*d"
looks_like = "a gap"
cause = "play"
remedy = "take it up"
source = "own measurements"
[effect.coefficients.b]
unit = "mm"

[[effect]]
id = "my-growth"
title = "My growth"
channel = "along"
axes = ["x", "y", "z"]
covariates = ["temp"]
expression = "alpha*T*(q - q_fixed)"
looks_like = "growth"
cause = "heat"
remedy = "wait"
source = "own measurements"
[effect.coefficients.alpha]
unit = "1/K"
[effect.inner.q_fixed]
unit = "mm"
range = "around-axis"
"""


def grid(
    seed: int, *, slope: float = K, gap_mm: float = B_MM, alpha: float = 0.0, session: str = "a"
) -> pl.DataFrame:
    """Points of a CMM: X there and back three times at four places; with `alpha`, warming from pass to pass."""
    rng = np.random.default_rng(seed)
    there = np.linspace(0.0, 400.0, 11)
    rows = []
    for repeat in range(3):
        for place, (y, z) in enumerate([(0.0, 0.0), (300.0, 0.0), (0.0, 250.0), (300.0, 250.0)]):
            for sense, positions in ((1, there), (-1, there[::-1])):
                temp = 20.0 + (4.0 * repeat + 0.5 * place + 0.1 * sense if alpha else 0.0)
                rows += [(place, repeat, x, y, z, sense, temp) for x in positions]
    place_of_row, repeat, x, y, z, sense, temp = np.array(rows).T
    q_mm = np.column_stack([x, y, z])
    error_mm = np.zeros_like(q_mm)
    error_mm[:, 0] = slope * x - 0.5 * gap_mm * sense + alpha * (temp - 20.0) * (x - FIXED_MM)
    seen_mm = q_mm + error_mm + np.array([50.0, -20.0, 5.0]) + rng.normal(0.0, NOISE_MM, q_mm.shape)
    columns: dict[str, Any] = {"session": [session] * len(x), "carrier": ["relative"] * len(x)}
    columns |= {"line": [f"x{place:g}" for place in place_of_row], "repeat": repeat.astype(int)}
    columns |= {"x": x, "y": y, "z": z, "dir_x": sense.astype(int), "temp_bed": temp}
    columns |= dict(zip(("mx", "my", "mz"), seen_mm.T, strict=True))
    return pl.DataFrame(columns | dict.fromkeys(("sx", "sy", "sz"), [NOISE_MM] * len(x)))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_machine(tmp_path / "machine.toml", MACHINE)
    grid(1).write_csv(tmp_path / "grid.csv")
    (tmp_path / "own.toml").write_text(OWN)
    return tmp_path


def run(folder: Path, *arguments: str, files: tuple[str, ...] = ("grid.csv",)):  # type: ignore[no-untyped-def]
    app = typer.Typer()
    verb.register(app)
    app.command("other")(lambda: None)
    fixed = ["fit", *(str(folder / name) for name in files), "--machine", str(folder / "machine.toml")]
    return CliRunner().invoke(app, [*fixed, *arguments], catch_exceptions=True)


def done(folder: Path, *arguments: str, files: tuple[str, ...] = ("grid.csv",)) -> str:
    result = run(folder, *arguments, files=files)
    assert result.exit_code == 0, result.exception
    return result.stdout


SMALL = ("--components", "none", "--add", "scale:x", "--add", "backlash:x")


def test_effects_are_found_and_the_figures_before_and_after_say_what_they_are_worth(folder: Path) -> None:
    document = json.loads(done(folder, *SMALL, "--json"))
    found = document["parameters"]
    for name, true in (("scale:x.k", K), ("backlash:x.b", B_MM)):
        assert abs(found[name]["value"] - true) < 4.0 * found[name]["std"]
    assert found["scale:x.k"]["std"] < 1e-6
    assert found["backlash:x.b"]["unit"] == "mm"
    before, after = document["before"], document["after"]
    assert set(before) >= COMPARED
    assert set(after) >= COMPARED
    noise_um = np.sqrt(3.0) * NOISE_MM * 1e3
    assert after["rmse_um"] == pytest.approx(noise_um, rel=0.1)
    assert after["held_out_rmse_um"] == pytest.approx(noise_um, rel=0.1)
    assert after["noise_floor_um"] == pytest.approx(noise_um, rel=0.15)
    assert after["lack_of_fit_p"] > 1e-3
    assert before["lack_of_fit_p"] < 1e-6
    assert before["rmse_um"] > 4.0 * after["rmse_um"]
    assert document["not_determined"] == []
    assert [(entry["effect"], entry["action"]) for entry in document["history"]] == [
        ("scale:x", "added"),
        ("backlash:x", "added"),
    ]
    first, second = document["history"]
    assert first["before"]["rmse_um"] == before["rmse_um"]
    assert first["after"] == second["before"]
    assert second["after"]["rmse_um"] == after["rmse_um"]
    assert document["output"] is None
    assert set(document["provenance"]["inputs"]) == {str(folder / name) for name in ("grid.csv", "machine.toml")}


def test_worst_rows_lines_and_axes_are_those_of_the_residuals(folder: Path) -> None:
    after = json.loads(done(folder, *SMALL, "--json"))["after"]
    sizes = [float(np.linalg.norm(row["residual_um"])) for row in after["worst"]]
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) == 10
    assert sizes[0] > after["rmse_um"]
    by_line = after["by_line"]
    assert {name: figures["n"] for name, figures in by_line.items()} == dict.fromkeys(("x0", "x1", "x2", "x3"), 66)
    squares = [figures["rmse_um"] ** 2 * figures["n"] for figures in by_line.values()]
    assert np.sqrt(sum(squares) / after["n"]) == pytest.approx(after["rmse_um"])
    each = [after["by_axis"][axis]["rms_um"] for axis in "xyz"]
    assert each == after["rms_per_component_um"]
    assert np.linalg.norm(each) == pytest.approx(after["rmse_um"])


def test_text_fits_the_terminal_and_says_it_in_words(folder: Path) -> None:
    result = run(folder, *SMALL, "-o", str(folder / "model.json"))
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("one that nobody listed (wYbZXt): no components, 2 effects; 264 rows in 24")
    assert any(line.startswith("residual, rms") for line in lines)
    assert "(before: the same model without the effects)" in lines
    assert any(line.startswith("what is left is noise, as far as can be told (p = ") for line in lines)
    assert "  scale:x: Scale of an axis" in lines
    (gap,) = [match for line in lines if (match := re.fullmatch(r"    lost motion b = (\S+) ± (\S+) µm \(.*", line))]
    assert abs(float(gap[1]) - B_MM * 1e3) < 4.0 * float(gap[2])
    assert any(line.startswith("  2. added backlash:x: ") for line in lines)
    assert result.stderr.splitlines()[-1] == f"model: {folder / 'model.json'}"
    assert run(folder, *SMALL, "--quiet").stderr == ""


def test_micrometres_in_columns_of_millimetres_are_asked_about(folder: Path) -> None:
    words = "times less than stated: are sx, sy and sz in mm"
    assert words not in " ".join(done(folder, *SMALL).split())
    stated = grid(1).with_columns(pl.col("sx", "sy", "sz") * 1e3)
    stated.write_csv(folder / "micrometres.csv")
    said = " ".join(done(folder, *SMALL, "-o", str(folder / "model.json"), files=("micrometres.csv",)).split())
    factor = re.search(rf"the points scatter ([0-9,]+) {words}", said)
    assert factor is not None
    assert float(factor[1].replace(",", "")) == pytest.approx(1000.0, rel=0.1)
    record = geoerr.load_model(folder / "model.json").record
    assert record is not None
    assert record.noise["scatter_of_stated"] == pytest.approx(1e-3, rel=0.1)
    assert words in " ".join(geoerr.load_model(folder / "model.json").report().split())


def test_with_nothing_added_before_is_the_nominal_machine(folder: Path) -> None:
    """Its residual is that of a rigid motion, here by NumPy alone (Kabsch)."""
    document = json.loads(done(folder, "--json", "--components", "12"))
    frame = pl.read_csv(folder / "grid.csv")
    q, p = frame.select("x", "y", "z").to_numpy(), frame.select("mx", "my", "mz").to_numpy()
    q, p = q - q.mean(axis=0), p - p.mean(axis=0)
    left, _, right = np.linalg.svd(p.T @ q)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    expected_um = float(np.sqrt(((p - q @ turn.T) ** 2).sum(axis=1).mean())) * 1e3
    assert document["before"]["rmse_um"] == pytest.approx(expected_um, rel=1e-6)
    assert document["history"] == []
    assert document["bases"]["EXX"]["free"] >= 1
    assert not {name for name in document["parameters"] if name[1] in "ABC"}


def test_model_file_stands_alone_and_is_the_same_for_any_number_of_threads(folder: Path) -> None:
    for threads in ("1", "2"):
        done(folder, *SMALL, "--threads", threads, "-o", str(folder / f"{threads}.json"))
    assert (folder / "1.json").read_bytes() == (folder / "2.json").read_bytes()
    model = geoerr.load_model(folder / "1.json")
    assert model.machine.chain == "wYbZXt"
    k, b = model.parameter("scale:x.k").value, model.parameter("backlash:x.b").value
    found = model.error_mm([[100.0, 50.0, 10.0]], at={"d_x": -1.0})
    assert np.allclose(found, [[k * 100.0 + b / 2.0, 0.0, 0.0]], atol=1e-12)
    assert model.record is not None
    assert [entry.reference for entry in model.record.history] == ["scale:x", "backlash:x"]
    assert model.record.history[1].parameters[0].value == b


def test_python_writes_the_same_model_file_with_its_history(folder: Path) -> None:
    grid(2, alpha=ALPHA).write_csv(folder / "grid.csv")
    added = ("scale:x", "my-growth:x@temp_bed", "backlash:x")
    arguments = [part for reference in added for part in ("--add", reference)]
    own = folder / "own.toml"
    done(folder, "--components", "none", *arguments, "--effects", str(own), "-o", str(folder / "verb.json"))
    seen = []
    result = geoerr.fit_model(
        MACHINE,
        geoerr.read_observations(folder / "grid.csv"),
        components="none",
        effects=added,
        known=load_catalogue([own]),
        on_progress=lambda step, total: seen.append((step, total)),
    )
    geoerr.write_model(folder / "python.json", result.model)
    assert (folder / "python.json").read_bytes() == (folder / "verb.json").read_bytes()
    assert result.model.record is not None
    history = result.model.record.history
    assert [entry.reference for entry in history] == list(added)
    assert history[0].figures_before["rmse_um"] == result.before.figures.rmse_um
    assert seen == [(step, 5) for step in range(6)]
    growth = load_effects(own)[1].at("x", "temp_bed")
    table = geoerr.read_observations(folder / "grid.csv")
    placed = geoerr.fit_model(MACHINE, table, components="none", effects=["scale:x", growth, "backlash:x"])
    assert placed.model.terms == result.model.terms
    # A model that was composed names its new effects by having no values for them.
    known, new = result.model.without_terms(["backlash:x"]), catalogue()["backlash"].term("x", None, MACHINE)
    composed = geoerr.fit_model(known + new, geoerr.read_observations(folder / "grid.csv"))
    assert composed.model.record is not None
    assert [entry.reference for entry in composed.model.record.history] == ["backlash:x"]


def following(seed: int, tau_s: float) -> pl.DataFrame:
    """A point that follows its sensor with a first-order lag, 3 µm/K, exactly between rows; times in a column."""
    rng = np.random.default_rng(seed)
    t = 30.0 * np.arange(200)
    temp = 20.0 + 20.0 * (1.0 - np.exp(-t / 900.0)) + 5.0 * np.sin(t / 500.0)
    slow = np.empty_like(temp)
    slow[0] = temp[0]
    for row in range(1, len(t)):
        # The sensor's straight line between two rows, as the formula has it.
        rate, step = (temp[row] - temp[row - 1]) / 30.0, 30.0
        end = temp[row] - rate * tau_s
        slow[row] = (
            end + (slow[row - 1] - (temp[row - 1] - rate * tau_s)) * np.exp(-step / tau_s) if tau_s else temp[row]
        )
    x = np.tile(np.linspace(0.0, 400.0, 10), 20)
    seen = np.zeros((len(t), 3))
    seen[:, 0], seen[:, 2] = x, 3e-3 * (slow - 20.0)
    seen += rng.normal(0.0, NOISE_MM, seen.shape)
    columns: dict[str, Any] = {"carrier": ["relative"] * len(t), "line": ["a"] * len(t), "t": t, "temp_bed": temp}
    columns |= {"x": x, "y": np.zeros(len(t)), "z": np.zeros(len(t))}
    columns |= dict(zip(("mx", "my", "mz"), seen.T, strict=True))
    return pl.DataFrame(columns | dict.fromkeys(("sx", "sy", "sz"), [NOISE_MM] * len(t)))


DRIFT = ("--components", "none", "--add", "thermal-drift:z@temp_bed", "--json")


@pytest.mark.parametrize("tau_s", [600.0, 0.0])
def test_whether_a_temperature_is_followed_with_a_lag_is_told_by_the_data(folder: Path, tau_s: float) -> None:
    following(5, tau_s).write_csv(folder / "grid.csv")
    found = json.loads(done(folder, *DRIFT))["parameters"]
    assert ("thermal-drift:z@temp_bed.tau" in found) is (tau_s > 0.0)
    if tau_s:
        tau = found["thermal-drift:z@temp_bed.tau"]
        assert abs(tau["value"] - tau_s) < 4.0 * tau["std"]


def test_a_lag_can_be_forced_and_forbidden(folder: Path) -> None:
    following(5, 600.0).write_csv(folder / "grid.csv")
    assert "thermal-drift:z@temp_bed.tau" not in json.loads(done(folder, *DRIFT, "--lag", "no"))["parameters"]
    following(5, 0.0).write_csv(folder / "grid.csv")
    assert "thermal-drift:z@temp_bed.tau" in json.loads(done(folder, *DRIFT, "--lag", "yes"))["parameters"]
    following(5, 0.0).drop("t").write_csv(folder / "grid.csv")
    with pytest.raises(InputFileError, match="have no time"):
        raise run(folder, *DRIFT, "--lag", "yes").exception or AssertionError
    with pytest.raises(InputFileError, match="no effect follows a temperature"):
        raise run(folder, *SMALL, "--lag", "yes").exception or AssertionError


def test_a_form_can_be_asked_for(folder: Path) -> None:
    wave = ("--components", "none", "--add", "periodic:x", "--json")
    forced = json.loads(done(folder, *wave, "--form", "harmonics"))["parameters"]
    assert {name.partition(".")[2] for name in forced} == {"A", "B", "A2", "B2", "P"}
    with pytest.raises(InputFileError, match="forms are 'harmonics'"):
        raise run(folder, *wave, "--form", "sawtooth").exception or AssertionError


def test_columns_that_place_a_row_are_not_offered(folder: Path) -> None:
    with pytest.raises(InputFileError) as refused:
        raise run(folder, "--add", "thermal-expansion:x@temp_head").exception or AssertionError
    assert refused.value.remedy == "columns that an effect may follow are temp_bed"


def test_an_own_effect_is_fitted_and_predicted_as_a_built_in_one(folder: Path) -> None:
    grid(2, alpha=ALPHA).write_csv(folder / "grid.csv")
    models = {}
    pairs = {"own": ("my-gap:x", "my-growth:x@temp_bed"), "built-in": ("backlash:x", "thermal-expansion:x@temp_bed")}
    for name, references in pairs.items():
        added = [part for reference in references for part in ("--add", reference)]
        path = folder / f"{name}.json"
        done(
            folder,
            "--components",
            "none",
            "--add",
            "scale:x",
            "--effects",
            str(folder / "own.toml"),
            *added,
            "-o",
            str(path),
        )
        models[name] = geoerr.load_model(path)
    own, built_in = models["own"], models["built-in"]
    for mine, its in zip(own.parameter_names, built_in.parameter_names, strict=True):
        assert own.parameter(mine).value == built_in.parameter(its).value
        assert own.parameter(mine).std == built_in.parameter(its).std
    alpha = built_in.parameter("thermal-expansion:x@temp_bed.alpha")
    assert abs(alpha.value - ALPHA) < 4.0 * alpha.std
    q_mm = np.random.default_rng(0).uniform(0.0, 250.0, (50, 3))
    at = {"d_x": 1.0, "temp_bed": 31.0}
    assert np.array_equal(own.error_mm(q_mm, at=at), built_in.error_mm(q_mm, at=at))
    assert np.array_equal(own.prediction_covariance_mm2(q_mm, at=at), built_in.prediction_covariance_mm2(q_mm, at=at))


def test_a_plausible_value_is_named(folder: Path) -> None:
    grid(3, slope=0.0, alpha=ALPHA).write_csv(folder / "grid.csv")
    arguments = ("--components", "none", "--add", "thermal-expansion:x@temp_bed", "--add", "backlash:x")
    text = " ".join(done(folder, *arguments).split())
    assert "plausible: steel has" in text
    assert "µm (usual: a ball screw of a milling machine has up to 20 µm)" in text
    document = json.loads(done(folder, *arguments, "--json"))
    assert document["parameters"]["thermal-expansion:x@temp_bed.alpha"]["plausible"] == "steel"
    assert document["parameters"]["backlash:x.b"]["plausible"] == "a ball screw of a milling machine"


def test_before_has_the_rows_that_after_has(folder: Path) -> None:
    """Rows without the temperature are left out, counted, of both models."""
    frame = grid(4, alpha=ALPHA)
    bare = frame.with_columns(temp_bed=pl.when(pl.int_range(pl.len()) < 30).then(None).otherwise(pl.col("temp_bed")))
    bare.write_csv(folder / "grid.csv")
    arguments = ("--components", "none", "--add", "backlash:x", "--add", "thermal-expansion:x@temp_bed")
    document = json.loads(done(folder, *arguments, "--json"))
    assert document["before"]["n"] == document["after"]["n"] == len(frame) - 30
    assert document["left_out"] == {"nothing is known of temp_bed": 30}


def test_gross_outliers_are_named_by_file_and_row(folder: Path) -> None:
    second = grid(5, session="b")
    second[17, "my"] = second[17, "my"] + 0.5
    second.write_csv(folder / "second.csv")
    files = ("grid.csv", "second.csv")
    place = f"{folder / 'second.csv'}:19"
    document = json.loads(done(folder, *SMALL, "--json", files=files))
    assert [outlier["place"] for outlier in document["outliers"]] == [place]
    assert document["outliers"][0]["residual_um"][1] == pytest.approx(500.0, abs=10.0)
    assert document["after"]["worst"][0]["is_outlier"] is True
    text = done(folder, *SMALL, files=files)
    assert "gross outliers, left out:" in text
    assert place in "".join(text.split())


def test_circles_and_points_are_told_apart_by_their_columns(folder: Path) -> None:
    """A squareness S makes a circle an ellipse at 45 degrees: r = R − S·R·sin φ·cos φ to first order."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)[:-1]
    s_rad, radius_mm = 2e-4, 100.0
    noise = np.random.default_rng(6).normal(0.0, NOISE_MM, angle.size)
    pl.DataFrame(
        {
            "line": ["XY"] * 72,
            "x": 200.0 + radius_mm * np.cos(angle),
            "y": 150.0 + radius_mm * np.sin(angle),
            "z": [0.0] * 72,
            "r": radius_mm + 0.003 - s_rad * radius_mm * np.sin(angle) * np.cos(angle) + noise,
        }
    ).write_csv(folder / "circle.csv")
    arguments = ("--components", "none", "--add", "squareness:xy")
    document = json.loads(done(folder, *arguments, "--json", files=("circle.csv",)))
    found = document["parameters"]["squareness:xy.S"]
    assert abs(found["value"] - s_rad) < 4.0 * found["std"]
    assert document["after"]["radial_rms_um"] == pytest.approx(1.0, rel=0.3)
    assert "residual of the radii, rms" in done(folder, *arguments, files=("circle.csv",))
    sheared = grid(7, slope=0.0, gap_mm=0.0).with_columns(mx=pl.col("mx") - s_rad * pl.col("y"))
    sheared.drop("sx", "sy", "sz").write_csv(folder / "grid.csv")
    both = json.loads(done(folder, *arguments, "--json", files=("circle.csv", "grid.csv")))
    assert both["after"]["n"] == 72 + 264
    joined = both["parameters"]["squareness:xy.S"]
    assert abs(joined["value"] - s_rad) < 4.0 * joined["std"]
    assert joined["std"] < found["std"]


def test_what_is_not_determined_is_grouped_by_reason(folder: Path) -> None:
    """X alone moved along itself: with one tool point, roll of X and everything of Z and Y remain open."""
    frame = grid(8).filter((pl.col("y") == 0.0) & (pl.col("z") == 0.0))
    frame.write_csv(folder / "grid.csv")
    result = run(folder)
    assert result.exit_code == 0, result.exception
    text = " ".join(result.stdout.split())
    assert "not determined (unknown, not zero): EXY (δ_xy), EYY (δ_yy), " in text
    assert "the y axis never moved" in text
    assert "EB0Z (−S_xz)" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--add", "nosuch"), "no effect has this id"),
        (("--add", "backlash"), "needs an axis"),
        (("--add", "scale:x"), "is in the model already"),
        (("--components", "12", "--add", "straightness:x"), "is in the model already"),
        (("--add", "backlash:x", "--add", "backlash:x"), "is added twice"),
        (("--add", "lag:x"), "wanting: speeds"),
        (("--add", "thermal-expansion:x@temp_head"), "the data have no column temp_head"),
        (("--add", "thermal-expansion:x"), "needs"),
        (("--effects", "absent.toml"), "no such file"),
    ],
)
def test_effects_that_cannot_be_added_are_refused_with_the_reason(
    folder: Path, arguments: tuple[str, ...], words: str
) -> None:
    result = run(folder, *arguments, "-o", str(folder / "model.json"))
    assert isinstance(result.exception, InputFileError)
    assert words in str(result.exception)
    assert not (folder / "model.json").exists()


def test_a_formula_that_cannot_be_read_is_refused_by_name(folder: Path) -> None:
    (folder / "own.toml").write_text(OWN.replace('"-(b/2)*d"', '"-(b/2*d"'))
    result = run(folder, "--effects", str(folder / "own.toml"), "--add", "my-gap:x")
    assert isinstance(result.exception, ExpressionError | InputFileError)
    assert "my-gap" in str(result.exception)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--tangent", "--components", "12"), "--components 21"),
        (("--components", "13"), "'13' is not one of"),
    ],
)
def test_wrong_usage(folder: Path, arguments: tuple[str, ...], words: str) -> None:
    result = run(folder, *arguments)
    assert result.exit_code == 2
    assert words in " ".join(result.stderr.replace("│", " ").split())


def test_lengths_are_fitted_and_their_error_stands_by_itself(folder: Path) -> None:
    rows = [f"f{k},0,50,0,{100 + 20 * k},50,0,{(100 + 20 * k) * 1.001 + 0.002 * (-1) ** k},0" for k in range(8)]
    (folder / "lengths.csv").write_text("\n".join(["feature,x1,y1,z1,x2,y2,z2,measured,repeat", *rows]) + "\n")
    options = ("--components", "none", "--add", "scale:x")
    result = run(folder, *options, files=("lengths.csv",))
    assert result.exit_code == 0, result.exception
    assert "8 lengths" in result.stdout
    assert "residual of the lengths, rms" in result.stdout
    after = json.loads(run(folder, *options, "--json", files=("lengths.csv",)).stdout)["after"]
    assert (after["n_lengths"], after["n"]) == (8, 8)
    assert after["rmse_um"] == after["length_rms_um"] == pytest.approx(2.0, abs=0.2)


def test_a_model_is_not_written_under_the_name_of_a_table(folder: Path) -> None:
    result = run(folder, "-o", str(folder / "model.csv"))
    assert isinstance(result.exception, InputFileError)
    assert "is the name of a table, and what is written is JSON" in str(result.exception)
    assert "name it model.json" in str(result.exception)
    assert not (folder / "model.csv").exists()


@pytest.mark.parametrize("name", ["grid.csv", "machine.toml", "own.toml"])
def test_an_input_is_never_replaced(folder: Path, name: str) -> None:
    before = (folder / name).read_bytes()
    result = run(folder, "--effects", str(folder / "own.toml"), "-o", str(folder / name))
    assert isinstance(result.exception, GeoerrError)
    assert "is an input of this command" in str(result.exception)
    assert (folder / name).read_bytes() == before


def test_standard_output_is_no_place_for_a_model(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of the name - was written."""
    monkeypatch.chdir(folder)
    result = run(folder, *SMALL, "-o", "-")
    assert isinstance(result.exception, InputFileError)
    assert "standard output has what is said of the result" in str(result.exception)
    assert "hint: name a file for it" in str(result.exception)
    assert not (folder / "-").exists()


def test_status_and_streams_of_the_program(folder: Path) -> None:
    table, machine = folder / "grid.csv", folder / "machine.toml"
    base = [sys.executable, "-m", "geoerr", "fit", str(table), "--machine", str(machine)]
    refused = subprocess.run([*base, "--add", "nosuch"], capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stdout) == (1, "")
    assert refused.stderr.startswith("error: nosuch: no effect has this id\nhint: ")
    piped = subprocess.run(
        [*base[:4], "-", *base[5:], *SMALL, "--json"],
        input=table.read_text(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert piped.returncode == 0, piped.stderr
    document = json.loads(piped.stdout)
    assert document["converged"] is True
    assert document["parameters"] == json.loads(done(folder, *SMALL, "--json"))["parameters"]


def test_an_effect_that_is_not_told_from_nothing_is_said_to_be_none(folder: Path) -> None:
    text = " ".join(done(folder, *SMALL, "--add", "lateral-play:x").split())
    _, backlash, lateral = re.split("backlash:x: Backlash|lateral-play:x: Play", text)
    assert "do not tell it from nothing" not in backlash
    assert "these data do not tell it from nothing (p = 0." in lateral


def test_an_effect_that_is_not_determined_is_said_to_be_where_its_value_stands(folder: Path) -> None:
    text = " ".join(done(folder, *SMALL, "--effects", str(folder / "own.toml"), "--add", "my-gap:x").split())
    assert "is not determined by these data not determined: these measurements cannot tell it from my-gap:x" in text
    assert "is not determined by these data not determined: these measurements cannot tell it from backlash:x" in text
    assert "from nothing" not in text


def test_a_model_that_predicts_worse_than_none_says_so(folder: Path) -> None:
    """Twenty points that were touched one after the other, with play that no error function is."""
    rng = np.random.default_rng(0)
    x, y, z = q = rng.uniform(10.0, 290.0, (3, 20)).round(1)
    seen = q + 0.02 * rng.normal(size=q.shape)
    seen[0, 1:] -= 0.04 * np.sign(np.diff(x))
    columns = {"carrier": ["relative"] * 20, "x": x, "y": y, "z": z, "mx": seen[0], "my": seen[1], "mz": seen[2]}
    pl.DataFrame(columns).write_csv(folder / "touched.csv")
    told = run(folder, "--components", "12", files=("touched.csv",))
    assert told.exit_code == 0, told.output
    said = " ".join(told.stdout.split())
    assert "what it did not see the model predicts worse" in said
    assert "than a machine without errors does" in said
    assert "predicts worse" not in " ".join(run(folder).stdout.split())
