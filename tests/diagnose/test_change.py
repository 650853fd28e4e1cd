"""Effects added to a model and taken away: figures on the same rows, history, and the verbs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import geoerr
from geoerr.cli.main import app
from geoerr.diagnose import compare, diagnose
from geoerr.diagnose.change import add_effect, add_terms, remove_terms
from geoerr.effects import catalogue
from geoerr.errors import GeoerrError, GeometryError
from geoerr.fit import FitOptions, fit_model, fit_terms, result_of
from geoerr.fit.shared_noise import with_shared_noise
from geoerr.machine import Machine
from geoerr.model import Model, load_model, write_model
from geoerr.observations import Observations, observations_from_columns
from geoerr.terms import Term

MACHINE = Machine.from_chain("wZbXYt", (400.0, 400.0, 400.0))
NOISE_MM = 2e-3
PLAY_MM = 0.02
GROWTH_PER_K = 12e-6


def heated(rng: np.random.Generator) -> Observations:
    """Along X there and back five times while the bed warms up: play, and growth from the far end of the axis."""
    q = np.concatenate([np.linspace(0.0, 400.0, 21), np.linspace(400.0, 0.0, 21)])
    rows = {name: [] for name in ("x", "y", "z", "mx", "my", "mz", "temp_bed", "repeat", "dir_x")}  # type: ignore[var-annotated]
    for repeat in range(5):
        temperature = 20.0 + 8.0 * repeat
        direction = np.repeat([1.0, -1.0], 21)
        error = -0.5 * PLAY_MM * direction + GROWTH_PER_K * (temperature - 20.0) * (q - 400.0)
        noise = NOISE_MM * rng.normal(size=(len(q), 3))
        rows["x"] += list(q)
        rows["y"] += [0.0] * len(q)
        rows["z"] += [0.0] * len(q)
        rows["mx"] += list(q + error + noise[:, 0])
        rows["my"] += list(noise[:, 1])
        rows["mz"] += list(noise[:, 2])
        rows["temp_bed"] += [temperature] * len(q)
        rows["repeat"] += [repeat] * len(q)
        rows["dir_x"] += list(direction)
    columns = {name: np.asarray(values, dtype=np.float64) for name, values in rows.items()}
    stated = {name: np.full(len(rows["x"]), NOISE_MM) for name in ("sx", "sy", "sz")}
    texts = {"line": ["X"] * len(rows["x"]), "carrier": ["relative"] * len(rows["x"])}
    return observations_from_columns({**texts, **columns, **stated})


def terms_of(reference: str) -> list[Term]:
    effect, resolved = catalogue().resolve(reference)
    return [effect.term(resolved.axis, resolved.covariate, MACHINE)]


@pytest.fixture(scope="module")
def observations() -> Observations:
    return heated(np.random.default_rng(1))


def added(model: Model, observations: Observations, reference: str) -> Model:
    return add_terms(model, [observations], terms_of(reference), reference, "").result.model


def test_the_error_falls_with_each_effect(observations: Observations) -> None:
    first = add_terms(Model(MACHINE), [observations], terms_of("backlash:x"), "backlash:x", "Backlash")
    growth = "thermal-expansion:x@temp_bed"
    second = add_terms(first.result.model, [observations], terms_of(growth), growth, "Growth")
    record = second.result.model.record
    assert record is not None
    falls = [(entry.figures_before["rmse_um"], entry.figures_after["rmse_um"]) for entry in record.history]
    assert [entry.reference for entry in record.history] == ["backlash:x", growth]
    assert falls[0][0] > falls[0][1] > falls[1][1]
    assert falls[0][1] == pytest.approx(falls[1][0], rel=1e-9)
    # What is left is the noise of three components, less what was fitted.
    assert falls[1][1] == pytest.approx(1e3 * NOISE_MM * np.sqrt(3.0), rel=0.1)
    play = second.result.model.parameter("backlash:x.b")
    alpha = second.result.model.parameter(f"{growth}.alpha")
    assert abs(play.value - PLAY_MM) < 4.0 * play.std
    assert abs(alpha.value - GROWTH_PER_K) < 4.0 * alpha.std


def test_taking_away_undoes_adding(observations: Observations) -> None:
    base = added(Model(MACHINE), observations, "backlash:x")
    more = added(base, observations, "thermal-expansion:x@temp_bed")
    change = remove_terms(more, [observations], "thermal-expansion:x@temp_bed")
    found, expected = change.result.model.parameter("backlash:x.b"), base.parameter("backlash:x.b")
    assert found.value == pytest.approx(expected.value, rel=1e-9)
    record = change.result.model.record
    assert record is not None
    assert [entry.action for entry in record.history] == ["added", "added", "removed"]


def test_a_fit_that_is_known_is_not_made_again_and_changes_nothing(observations: Observations) -> None:
    base = added(Model(MACHINE), observations, "backlash:x")
    growth, known = "thermal-expansion:x@temp_bed", compare(base, observations).fitted
    asked, again = (add_effect(base, observations, reference=growth, known=one) for one in (None, known))
    assert again.before is known
    for one, other in ((asked.before, again.before), (asked.after, again.after)):
        assert other.held_out.figures.headline_um == pytest.approx(one.held_out.figures.headline_um, rel=1e-9)
    value, expected = (one.result.model.parameter(f"{growth}.alpha") for one in (again, asked))
    assert (value.value, value.std) == pytest.approx((expected.value, expected.std), rel=1e-7)


def test_a_change_says_what_it_does(observations: Observations) -> None:
    said, counts = [], []

    def count(done: int, total: int) -> None:
        counts.append((done, total))

    change = add_effect(Model(MACHINE), observations, reference="backlash:x", progress=count, on_step=said.append)
    assert "the fit with backlash:x" in said
    assert said[-1] == "each pass predicted by the others, before and after"
    assert [done for done, _ in counts] == [*range(len(said)), len(said)]
    assert counts[-1] == (len(said), len(said))
    said.clear()
    remove_terms(change.result.model, [observations], "backlash:x", on_step=said.append)
    assert said[:2] == ["the model as it is", "the fit without backlash:x"]

    def stop(_: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        add_effect(Model(MACHINE), observations, reference="backlash:x", on_step=stop)


def test_rows_that_lacked_what_an_effect_needed_come_back_without_it(observations: Observations) -> None:
    gaps = observations.frame.with_columns(
        pl.when(pl.int_range(pl.len()) % 3 == 0).then(None).otherwise(pl.col("temp_bed")).alias("temp_bed")
    )
    table = Observations(gaps, observations.sources)
    base = added(Model(MACHINE), table, "backlash:x")
    more = added(base, table, "thermal-expansion:x@temp_bed")
    change = remove_terms(more, [table], "thermal-expansion:x@temp_bed")
    n_rows = [model.record.n_rows for model in (base, more, change.result.model) if model.record is not None]
    assert n_rows[1] < 0.7 * n_rows[0]
    assert n_rows[2] == n_rows[0] == len(table)
    # The figures before and after are of the same rows all the same.
    assert len(change.before.sightings) == len(change.after.sightings) == n_rows[1]


def test_rows_that_come_back_have_a_say_in_how_free_functions_are(observations: Observations) -> None:
    """Bases that were chosen without half of an axis stood for all of it, with standard errors of a right one."""
    x_mm = pl.col("x")
    bend_mm = pl.when(x_mm > 200.0).then(0.03 * ((x_mm - 200.0) * np.pi / 100.0).sin()).otherwise(0.0)
    table = Observations(
        observations.frame.with_columns(
            mx=pl.col("mx") + bend_mm,
            temp_bed=pl.when(x_mm > 200.0).then(None).otherwise(pl.col("temp_bed")),
        ),
        observations.sources,
    )
    with_it = fit_model(MACHINE, table, effects=terms_of("thermal-expansion:x@temp_bed")).model
    left = remove_terms(with_it, [table], "thermal-expansion:x@temp_bed").result.model
    direct = fit_model(MACHINE, table).model
    places = np.column_stack([np.linspace(0.0, 400.0, 81), np.zeros(81), np.zeros(81)])
    np.testing.assert_allclose(left.error_mm(places), direct.error_mm(places), atol=1e-4)


def test_refusals(observations: Observations) -> None:
    base = added(Model(MACHINE), observations, "backlash:x")
    with pytest.raises(GeoerrError, match="already"):
        add_terms(base, [observations], terms_of("backlash:x"), "backlash:x", "")
    with pytest.raises(GeoerrError, match="it has backlash:x"):
        remove_terms(base, [observations], "lag:x")


def test_verbs_write_what_they_say(observations: Observations, tmp_path: Path) -> None:
    table, first, second = tmp_path / "obs.csv", tmp_path / "1.json", tmp_path / "2.json"
    geoerr.write_observations(table, observations)
    write_model(first, added(Model(MACHINE), observations, "backlash:x"))
    runner = CliRunner()
    arguments = ["add", str(first), str(table), "thermal-expansion:x@temp_bed", "-o", str(second), "--json"]
    outcome = runner.invoke(app, arguments)
    assert outcome.exit_code == 0, outcome.output
    document = json.loads(outcome.stdout)
    assert document["before"]["rmse_um"] > document["after"]["rmse_um"]
    assert [entry["effect"] for entry in document["history"]] == ["backlash:x", "thermal-expansion:x@temp_bed"]
    model = load_model(second)
    assert model.record is not None
    assert len(model.record.history) == 2
    text = runner.invoke(app, ["remove", str(second), str(table), "thermal-expansion:x@temp_bed"])
    assert text.exit_code == 0, text.output
    assert "− thermal-expansion:x@temp_bed" in text.stdout
    assert max(len(line) for line in text.stdout.splitlines()) <= 110
    assert runner.invoke(app, ["add", str(first), "backlash:y"]).exit_code == 2


@pytest.mark.parametrize(("sign", "is_told"), [("positive", True), ("negative", False), ("any", False)])
def test_a_sign_that_an_effect_excludes_is_told(
    observations: Observations, tmp_path: Path, sign: str, is_told: bool
) -> None:
    table, model, own = tmp_path / "obs.csv", tmp_path / "model.json", tmp_path / "own.toml"
    geoerr.write_observations(table, observations)
    # Beside errors that no model has, the same value would be in doubt: what is left of them is shared by passes.
    write_model(model, geoerr.fit_model(MACHINE, observations).model)
    own.write_text(
        '[[effect]]\nid = "mine"\nchannel = "along"\naxes = ["x"]\nexpression = "k*d_x"\n'
        f'[effect.coefficients.k]\nunit = "mm"\nsign = "{sign}"\n'
    )
    said = CliRunner().invoke(app, ["add", str(model), str(table), "mine:x", "--effects", str(own)])
    assert said.exit_code == 0, said.output
    assert ("note: mine:x: k = -0.0" in said.stderr) == is_told


def test_a_start_that_has_not_settled_is_said(observations: Observations, tmp_path: Path) -> None:
    points, path, reference = tmp_path / "points.csv", tmp_path / "model.json", "thermal-expansion:x@temp_bed"
    geoerr.write_observations(points, observations)
    model = added(Model(MACHINE), observations, reference)
    assert model.record is not None
    write_model(path, replace(model, record=replace(model.record, has_settled=False)))
    said = CliRunner().invoke(app, ["remove", str(path), str(points), reference])
    assert said.exit_code == 0, said.output
    assert "warning: the model as it was: the fit has not settled" in said.stderr


@pytest.mark.parametrize("verb", ["add", "remove"])
def test_rows_that_could_not_be_used_are_named(observations: Observations, tmp_path: Path, verb: str) -> None:
    points, model_path = tmp_path / "points.csv", tmp_path / "model.json"
    reference = "thermal-expansion:x@temp_bed"
    model = Model(MACHINE) if verb == "add" else added(Model(MACHINE), observations, reference)
    write_model(model_path, model)
    geoerr.write_observations(points, observations)
    table = pl.read_csv(points, infer_schema=False)
    table[4, "temp_bed"] = "warm"
    table.write_csv(points)
    arguments = [verb, str(model_path), str(points), reference]
    place = f"{points}:6: temp_bed: 'warm' is not a number"
    said = CliRunner().invoke(app, arguments)
    assert said.exit_code == 0, said.output
    assert f"set aside: {place}" in said.stderr.splitlines()
    assert json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)["set_aside"] == [place]


@pytest.mark.real_data
def test_the_voron_told_from_its_sensors(real_data: Path) -> None:
    """Constant 80 µm, frame temperature 37, frame and bed 4.7: the figures known of these data."""
    folder = real_data / "thermal"
    observations = geoerr.read_observations(folder / "observations.csv")
    machine = geoerr.read_machine(folder / "machine.toml")
    model = Model(machine)
    figures = []
    for reference in ("thermal-drift:z@temp_frame", "thermal-drift:z@temp_bed"):
        effect, resolved = catalogue().resolve(reference)
        term = effect.term(resolved.axis, resolved.covariate, machine)
        change = add_terms(model, [observations], [term], reference, effect.title)
        model = change.result.model
        figures.append((change.before.figures.rmse_um, change.after.figures.rmse_um))
    assert figures[0][0] == pytest.approx(80.0, abs=0.5)
    assert figures[0][1] == pytest.approx(37.0, abs=0.5)
    assert figures[1][1] == pytest.approx(4.7, abs=0.3)


def test_what_is_known_already_changes_nothing_that_anybody_reads(observations: Observations) -> None:
    """Columns are of the first order, about the frames that are known or about those of a machine without errors."""
    known = fit_terms(MACHINE, [observations])
    model = result_of(known).model
    without, beside = (
        add_terms(model, [observations], terms_of("backlash:x"), "backlash:x", "", known=one) for one in (None, known)
    )
    assert beside.before is known
    for own, other in zip(beside.after.terms, without.after.terms, strict=True):
        assert own.parts == other.parts
        for one, same in zip(own.coefficients, other.coefficients, strict=True):
            # What the data do not determine has no uncertainty, in either.
            assert abs(one.value - same.value) <= 2e-3 * np.nan_to_num(same.std) + 1e-15
            assert one.std == pytest.approx(same.std, rel=1e-6, abs=1e-12, nan_ok=True)
    assert beside.after.residual_mm == pytest.approx(without.after.residual_mm, abs=2e-3 * NOISE_MM)
    assert beside.result.model.record is not None
    assert without.result.model.record is not None
    figures, others = beside.result.model.record.figures, without.result.model.record.figures
    assert figures == pytest.approx(others, rel=1e-6, nan_ok=True)
    assert beside.before.residual_mm == pytest.approx(without.before.residual_mm, abs=1e-6 * NOISE_MM)


def test_bases_that_are_chosen_again_are_fitted_as_from_the_tables(observations: Observations) -> None:
    """In the scatter of a large play a wave of a few micrometres does not show; beside the play it does."""
    wave_mm = 0.006 * (np.pi * pl.col("x") / 100.0).sin()
    table = Observations(observations.frame.with_columns(mx=pl.col("mx") + wave_mm - 0.2 * pl.col("dir_x")))
    model = result_of(fit_terms(MACHINE, [table])).model
    change = add_terms(model, [table], terms_of("backlash:x"), "backlash:x", "")
    before, after = ({term.id: term.parts[0].basis for term in one.terms} for one in (change.before, change.after))
    assert before["EXX"] != after["EXX"]
    fresh = fit_terms(MACHINE, [table], effects=change.after.terms, options=FitOptions(components="none"))
    assert with_shared_noise(fresh).terms == change.after.terms
    assert fresh.held_out.figures == change.after.held_out.figures


def test_bases_that_a_search_chose_beside_what_it_found_are_not_chosen_once_more(observations: Observations) -> None:
    """What was found is added to the fit that it was found beside; alone it is determined as well."""
    table = Observations(observations.frame.with_columns(mx=pl.col("mx") - 0.2 * pl.col("dir_x")))
    known = fit_terms(MACHINE, [table])
    model = result_of(known).model
    diagnosis = diagnose(model, table)
    found = next(one for one in diagnosis.found if str(one.reference) == "backlash:x")
    assert diagnosis.fitted is not known
    searched, chosen = (
        add_terms(model, [table], [found.term], "backlash:x", "", known=known, searched=one)
        for one in (diagnosis.fitted, None)
    )
    bases, expected = (
        {term.id: term.parts[0].basis for term in one if term.kind == "classic"}
        for one in (searched.after.terms, diagnosis.fitted.terms)
    )
    assert bases == expected
    assert searched.before.figures == chosen.before.figures
    play, other = (
        next(term for term in change.after.terms if term.id == "backlash:x").coefficients[0]
        for change in (searched, chosen)
    )
    assert play.std == pytest.approx(other.std, rel=0.1)
    assert abs(play.value - other.value) < 0.2 * other.std


def test_rows_that_the_known_fit_lacked_take_part_again(observations: Observations) -> None:
    """Rows without a temperature take no part beside a growth, and where it is not in the model they do."""
    frame = observations.frame.with_columns(
        pl.when(pl.int_range(pl.len()) % 7 == 0).then(None).otherwise(pl.col("temp_bed")).alias("temp_bed")
    )
    sparse = Observations(frame)
    growth = "thermal-expansion:x@temp_bed"
    known = fit_terms(MACHINE, [sparse], effects=terms_of(growth))
    assert len(known.sightings) < len(sparse)
    changes = [
        add_terms(result_of(known).model, [sparse], terms_of("backlash:x"), "backlash:x", "", known=one)
        for one in (None, known)
    ]
    # Counted once, and by the same words.
    assert changes[0].after.sightings.left_out == changes[1].after.sightings.left_out == known.sightings.left_out
    assert changes[0].after.terms == changes[1].after.terms


def test_a_fit_of_other_measurements_is_not_known(observations: Observations) -> None:
    fit = fit_model(MACHINE, observations, components="12")
    alone = add_effect(fit.model, observations, reference="backlash:x")
    resolved = catalogue().resolve("backlash:x")[1]
    for known in (fit, fit.fitted):
        same = add_effect(fit.model, observations, reference=resolved, known=known)
        assert same.result.model.parameter("backlash:x.b").value == pytest.approx(
            alone.result.model.parameter("backlash:x.b").value, rel=1e-9
        )
    other = heated(np.random.default_rng(99))
    # All others, or more than it was fitted to.
    for tables in ([other], [observations, other]):
        with pytest.raises(GeoerrError, match="known: this is a fit of other measurements"):
            add_effect(fit.model, *tables, reference="backlash:x", known=fit)


def test_one_row_is_too_little_to_add_anything() -> None:
    table = observations_from_columns({name: [float(k)] for k, name in enumerate(("x", "y", "z", "mx", "my", "mz"))})
    with pytest.raises(GeometryError, match="3 numbers in 1 row leave nothing over"):
        add_effect(Model(MACHINE), table, reference="scale:x")
