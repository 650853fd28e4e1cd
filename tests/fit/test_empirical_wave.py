"""Waves in time without a cause: found at their period, with the standard errors they have, and told in words."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

import geoerr
from geoerr.cli.main import app
from geoerr.diagnose.shape import shape_words
from geoerr.fit import FitOptions, Fitted, fit_terms, refit, result_of
from geoerr.fit.empirical import Curve, curve_of, empirical_term
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns
from geoerr.workbench.program import Wish, correct

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
STD_MM = 5e-3
N_ROWS, EVERY_S = 400, 4.0
N_DRAWS = 60


def measured(
    seed: int, period_s: float, sizes_um: tuple[float, ...], *, has_times: bool = True, drift_um: float = 0.0
) -> Observations:
    """Give points taken every few seconds, a session for each size of a wave along z, at uneven moments."""
    rng = np.random.default_rng(seed)
    n = N_ROWS * len(sizes_um)
    session = np.repeat(np.arange(len(sizes_um)), N_ROWS)
    t = EVERY_S * np.tile(np.arange(N_ROWS), len(sizes_um)) + rng.uniform(0.0, 1.0, n)
    q = rng.uniform(0.0, [400.0, 300.0, 250.0], (n, 3))
    seen = q + rng.normal(0.0, STD_MM, q.shape)
    wave = np.sin(2.0 * np.pi * t / period_s + session)
    seen[:, 2] += 1e-3 * (np.asarray(sizes_um)[session] * wave + drift_um * t / t.max())
    columns: dict[str, object] = {"session": session.astype(str), "carrier": ["relative"] * n}
    columns |= {"line": [f"L{number // 20}" for number in range(n)]}
    columns |= {"t": t} if has_times else {}
    columns |= {name: q[:, number] for number, name in enumerate("xyz")}
    columns |= {f"m{name}": seen[:, number] for number, name in enumerate("xyz")}
    columns |= {f"s{name}": np.full(n, STD_MM) for name in "xyz"}
    return observations_from_columns(columns)


def base_of(table: Observations) -> Fitted:
    return fit_terms(MACHINE, [table], options=FitOptions(components="none", threads=1))


def wave_of(table: Observations) -> tuple[Fitted, Curve]:
    base = base_of(table)
    result = refit(base, [empirical_term(base, "empirical:z@t")])
    return result, curve_of(result, "empirical:z@t")


@pytest.mark.parametrize("period_s", [21.7, 0.0199987])
def test_period_and_size_are_within_their_standard_errors(period_s: float) -> None:
    """Slow, and fast as the mains, which pictures see at whatever phase they are taken."""
    of_period, of_size = [], []
    for seed in range(N_DRAWS):
        result, curve = wave_of(measured(seed, period_s, (10.0,)))
        assert curve.period is not None
        of_period.append((curve.period.value - period_s) / curve.period.std)
        a, b = result.terms[-1].coefficients
        size = np.hypot(a.value, b.value)
        of_size.append((1e3 * size - 10.0) / (1e3 * np.hypot(a.value * a.std, b.value * b.std) / size))
    low, high = stats.chi2.ppf([1e-5, 1.0 - 1e-5], N_DRAWS) / N_DRAWS
    for normal in (of_period, of_size):
        assert low < float(np.mean(np.square(normal))) < high


def test_each_session_has_a_wave_of_its_own() -> None:
    result, curve = wave_of(measured(1, 21.7, (4.0, 12.0)))
    assert [one.name for one in result.terms[-1].coefficients] == ["A_1", "B_1", "A_2", "B_2"]
    # The larger one is drawn.
    assert 0.5 * np.ptp(curve.value_um) == pytest.approx(12.0, abs=4.0 * float(curve.std_um.max()))
    assert curve.at[0][-1] == pytest.approx(21.7, rel=1e-3)
    assert shape_words(curve).startswith("goes up and down once in 21.7 s, by ±1")


def test_without_times_rows_are_counted() -> None:
    table = measured(2, 21.7, (10.0,), has_times=False)
    _, curve = wave_of(table)
    assert "once in 5.4" in shape_words(curve)
    assert "rows, by ±" in shape_words(curve)


def test_what_drifts_is_no_wave() -> None:
    base = base_of(measured(3, 21.7, (0.0,), drift_um=30.0))
    term = empirical_term(base, "empirical:z@t")
    assert not term.inner
    assert curve_of(refit(base, [term]), term.id).period is None


def test_the_held_out_error_falls_and_the_report_says_wave(tmp_path: Path) -> None:
    table, model = tmp_path / "obs.csv", tmp_path / "model.json"
    geoerr.write_observations(table, measured(4, 21.7, (10.0,)))
    geoerr.write_model(model, Model(MACHINE))
    runner = CliRunner()
    told = runner.invoke(app, ["diagnose", str(model), str(table)])
    assert told.exit_code == 0, told.output
    period = re.search(r"goes up and down once in ([\d.]+) s", told.stdout)
    assert period is not None
    assert float(period.group(1)) == pytest.approx(21.7, abs=0.05)
    assert "to add it as an empirical wave, without a cause:" in told.stdout, told.stdout
    added = runner.invoke(app, ["add", str(model), str(table), "empirical:z@t", "--json"])
    assert added.exit_code == 0, added.output
    document = json.loads(added.stdout)
    # What is left is the noise of three components; what falls is the wave's share.
    noise_um = 1e3 * STD_MM * np.sqrt(3.0)
    assert document["after"]["held_out_rmse_um"] == pytest.approx(noise_um, rel=0.1)
    assert document["before"]["held_out_rmse_um"] == pytest.approx(np.hypot(noise_um, 10.0 / np.sqrt(2.0)), rel=0.1)


def test_no_program_is_corrected_by_a_wave(tmp_path: Path) -> None:
    result, _ = wave_of(measured(5, 21.7, (10.0, 8.0)))
    model, program, corrected = tmp_path / "model.json", tmp_path / "in.gcode", tmp_path / "out.gcode"
    geoerr.write_model(model, result_of(result).model)
    program.write_text("G21\nG90\nG1 X100 Y100 Z100 F6000\nG1 X200\n")
    done = CliRunner().invoke(app, ["compensate", str(model), str(program), "-o", str(corrected), "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["waves_left_out"] == ["empirical:z@t"]
    assert "stop it" in document["notes"][0]
    assert document["largest_correction_um"] == 0.0
    compared = CliRunner().invoke(app, ["verify", "path", str(model), str(program), str(corrected), "--json"])
    assert compared.exit_code == 0, compared.output
    assert json.loads(compared.stdout)["max_error_um_after"] == 0.0
    on_page = correct(
        result_of(result).model, "model", "in.gcode", program.read_bytes(), Wish({}, "0, 0, 0", False, False)
    )
    assert on_page.left_because
