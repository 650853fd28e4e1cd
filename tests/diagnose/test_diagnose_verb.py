"""`geoerr diagnose`: what it prints, writes and refuses; curves without a name; the pictures; real data."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hidden_machine import Motion, Noise, Plan, machine, measure, motion
from typer.testing import CliRunner

import geoerr
from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.cli.main import app
from geoerr.cli.text_tables import WIDTH
from geoerr.diagnose import add_effect
from geoerr.diagnose.advice import Advice, adviser_of
from geoerr.diagnose.answer import with_terms
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.search import AskedFor, reference_of, search, why_left
from geoerr.diagnose.told import diagnosis_of
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions
from geoerr.fit.empirical import Curve
from geoerr.machine import write_machine
from geoerr.model import write_model
from geoerr.observations import Observations
from geoerr.report import figures
from geoerr.report.diagnosis_page import diagnosis_sections
from geoerr.report.page import Figure, Paragraph, Table
from geoerr.terms import EffectReference
from geoerr.workbench.told import told_of

PLAN = Plan(n_sessions=2, n_lines=20, n_points=14)
NOISE = Noise(white=(5.0, 5.0, 7.0), offset=1.5)
# A few effects suffice to tell a verdict, and take a second instead of ten.
KEPT = ("backlash", "thermal-expansion", "thermal-drift", "lag", "stick-slip", "rig-scale", "load-deflection")
KNOWN = Catalogue({name: catalogue()[name] for name in KEPT})
OPTIONS = FitOptions(threads=1)


def growth(moved: Motion) -> np.ndarray:
    return 12e-3 * ((moved.bed - 20.0) * (moved.q[:, 1] - 200.0))[:, None] * np.eye(3)[1]


def play(moved: Motion) -> np.ndarray:
    return -6.0 * moved.d[:, :1] * np.eye(3)[0]


def nameless(moved: Motion) -> np.ndarray:
    """Twist of z with x, at some feeds one way and at others the other."""
    return 12.0 * ((moved.q[:, 0] - 200.0) / 200.0 * np.cos(moved.feed / 2000.0))[:, None] * np.eye(3)[2]


def nothing(moved: Motion) -> np.ndarray:
    return np.zeros_like(moved.q)


def observed(hidden: Callable[[Motion], np.ndarray], seed: int = 1, feed_mm_min: float | None = None) -> Observations:
    rng = np.random.default_rng(seed)
    moved = motion(rng, PLAN)
    if feed_mm_min is not None:
        moved.feed[:] = feed_mm_min
    return measure(rng, moved, NOISE, hidden(moved))


def diagnosed(hidden: Callable[[Motion], np.ndarray], feed_mm_min: float | None = None) -> Diagnosis:
    fitted = geoerr.fit_model(machine(), observed(hidden, feed_mm_min=feed_mm_min), options=OPTIONS).fitted
    return diagnosis_of(fitted, search(fitted, Offers(KNOWN), threads=1), KNOWN)


@pytest.fixture(scope="module")
def named() -> Diagnosis:
    return diagnosed(growth)


@pytest.fixture(scope="module")
def ambiguous() -> Diagnosis:
    """At one feed stick-slip is the same gap at every row."""
    return diagnosed(play, feed_mm_min=600.0)


@pytest.fixture(scope="module")
def unknown() -> Diagnosis:
    return diagnosed(nameless)


@pytest.fixture(scope="module")
def clean() -> Diagnosis:
    return diagnosed(nothing)


@pytest.fixture
def few_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geoerr.diagnose.asked.catalogue", lambda: KNOWN)


def text_of(diagnosis: Diagnosis, *, verbose: bool = False) -> str:
    lines = list(diagnosis_lines(diagnosis, "geoerr add m.json o.csv", "", verbose=verbose))
    # A line to copy is not broken; all others fit.
    assert max(len(line) for line in lines if "geoerr add" not in line) <= WIDTH
    return "\n".join(lines)


def test_an_effect_is_named_with_value_worth_place_and_doubt(named: Diagnosis) -> None:
    text = text_of(named)
    lines = text.splitlines()
    assert named.verdict == "missing"
    assert lines[2].startswith("An effect is missing: thermal expansion of the drive")
    assert "expansion per kelvin alpha = 11." in text
    assert "×10⁻⁶/K (plausible: steel has 11.5)" in " ".join(text.split())
    assert "µm rms, " in text
    assert "end of y" in text
    assert "held out " in text
    assert "certain as can be: chance does as much in" in text
    assert lines[-1] == "  geoerr add m.json o.csv thermal-expansion:y@temp_bed -o model2.json"
    assert "load-deflection: " in text
    verbose = text_of(named, verbose=True)
    assert verbose.count("cause: ") == len({*named.found, *named.candidates})


def test_what_is_no_chance_and_has_no_name_is_not_said_to_be_nothing(clean: Diagnosis) -> None:
    assert clean.sentence.startswith("nothing is missing that these data could show: chance does as much in ")
    assert clean.sentence.count(":") == 1
    left = replace(clean, p_value=1e-9).sentence
    assert left.startswith("nothing can be named, though what is left is more than chance (chance does as much in ")


def test_what_was_asked_for_by_itself_has_a_line(clean: Diagnosis) -> None:
    """One search of 40 was told, and of all that was listed beside it nothing had less than p = 0.3."""
    asked = AskedFor(EffectReference("backlash", "x"), 12.0, 1, 112, 1, 5.5, 3)
    told = replace(clean, asked_for=(asked, replace(asked, reference=EffectReference("backlash", "y"), surprise=0.0)))
    line = "backlash:x was asked for by itself: p = 0.012, with the search counted 0.025"
    assert line in text_of(told)
    assert "backlash:y was asked" not in text_of(told)
    assert any(section.blocks == (Paragraph(f"{line}."),) for section in diagnosis_sections(told))
    assert [one["p_value"] for one in told.to_document()["asked_for"]] == pytest.approx([3.0 * np.exp(-5.5), 1.0])


def test_what_the_data_cannot_tell_apart_is_said_with_what_would(ambiguous: Diagnosis) -> None:
    text = text_of(ambiguous)
    assert ambiguous.verdict == "ambiguous"
    assert {str(one.reference) for one in ambiguous.tied} >= {"backlash:x", "stick-slip:x"}
    assert "these data cannot tell which" in text
    assert "these data cannot tell it from:" in text
    assert "  what would: " in text
    assert " minutes): " in text.replace("\n    ", " ")
    # One measurement for all of them.
    assert len({id(one.separate_by) for one in ambiguous.tied}) == 1


def test_the_advised_measurement_is_written_where_there_is_one(
    ambiguous: Diagnosis, clean: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nominal, table, path = tmp_path / "machine.toml", tmp_path / "o.csv", tmp_path / "plan.csv"
    write_machine(nominal, machine())
    geoerr.write_observations(table, observed(nothing))
    arguments = ["diagnose", str(nominal), str(table), "--plan", str(path)]
    plan = adviser_of(ambiguous.fitted, [one.term for one in ambiguous.tied]).plans[0]
    advice = Advice(plan.title, plan.text(2), plan.minutes(2), measurements=((plan, 2),))
    advised = replace(ambiguous, found=(replace(ambiguous.found[0], separate_by=advice), *ambiguous.found[1:]))
    advised = replace(advised, candidates=(advised.found[0], *advised.candidates[1:]))
    # So weak a gap no plan would separate: the catalogue speaks, in words.
    for diagnosis, why in ((clean, "nothing is tied"), (ambiguous, "is known in words at most"), (advised, None)):
        monkeypatch.setattr("geoerr.diagnose.asked.diagnose", lambda *_, found=diagnosis, **__: found)
        said, as_json = (CliRunner().invoke(app, [*arguments, *more]) for more in ([], ["--json"]))
        assert (said.exit_code, as_json.exit_code) == (0, 0), said.output + as_json.output
        assert path.exists() is (why is None)
        assert json.loads(as_json.stdout)["plan"] == (str(path) if why is None else None)
        assert (f"plan: {path}" if why is None else why) in said.stderr
    assert pl.read_csv(path).height == 2 * len(plan.pictures)
    refused = CliRunner().invoke(app, [*arguments[:-1], str(table)])
    assert "is an input of this command" in str(refused.exception)


def test_what_was_looked_at_and_left_has_a_reason(named: Diagnosis, ambiguous: Diagnosis, clean: Diagnosis) -> None:
    for diagnosis in (named, ambiguous, clean):
        spoken = {one.reference for one in (*diagnosis.found, *diagnosis.tied)}
        for one in diagnosis.candidates:
            assert (one.left_because is None) == (one.reference in spoken), one.reference
            assert one.to_document()["left_because"] == one.left_because
    text = " ".join(text_of(named).split())
    others = [one for one in named.candidates if one.reference not in {each.reference for each in named.found}]
    assert f"{others[0].reference}" in text[text.index("looked at and left") :]
    assert f": {others[0].left_because}" in text[text.index("looked at and left") :]
    assert f"left: {others[0].left_because}" in " ".join(text_of(named, verbose=True).split())
    assert ": no more than chance" in text_of(clean)
    assert "beside what was found" not in text_of(clean)
    (section,) = (one for one in diagnosis_sections(named) if one.title == "What was looked at and left")
    (table,) = section.blocks
    assert isinstance(table, Table)
    reasons = {name: why for why, names in table.rows for name in names.split(", ")}
    assert reasons[str(others[0].reference)] == others[0].left_because
    cards = {card.reference: card for card in told_of(named, ()).others}
    assert cards[str(others[0].reference)].rank == f"looked at, and not needed: {others[0].left_because}"


def test_the_reason_is_what_the_last_look_says(named: Diagnosis) -> None:
    searched = named.searched
    last = searched.last.candidates
    judged = last[0]

    def why(*, p_value: float = 0.0, evidence: float = 1.0, **changes: object) -> str | None:
        now = replace(judged, p_value=p_value, evidence=evidence)
        looked = replace(searched.last, candidates=(now, *last[1:]))
        return why_left(replace(searched, **{"last": looked, "unknown": None} | changes), judged)

    reference = reference_of(judged)
    assert why(p_value=0.3) == "no more than chance beside what was found"
    assert why(p_value=0.3, found=()) == "no more than chance"
    assert why(p_value=0.01) == "not sure enough beside what was found"
    assert why(evidence=-1.0) == "explains too little beside what was found for so many numbers"
    assert why(found=searched.found * 6) == "6 effects were found, and no more are looked for"
    assert why(unknown=searched.found[0]) == "may be a part of what has no name"
    assert why(dropped={reference: "no better held out"}) == "no better held out"
    assert why() is None
    unseen = replace(searched.last, candidates=last[1:], invisible=(judged.what,))
    assert why(last=unseen) == "nothing of it is left beside what was found"
    assert why(last=replace(unseen, invisible=())) == "only with the sign that physics does not give it"


@pytest.mark.usefixtures("few_effects")
def test_a_machine_whose_errors_were_never_fitted_is_told_so_before_anything_else(tmp_path: Path) -> None:
    observations = observed(play)
    write_machine(tmp_path / "machine.toml", machine())
    geoerr.write_observations(tmp_path / "o.csv", observations)
    model = geoerr.fit_model(machine(), geoerr.read_observations(tmp_path / "o.csv"), options=OPTIONS).model
    write_model(tmp_path / "model.json", model)
    nominal, fitted = (
        CliRunner().invoke(app, ["diagnose", str(tmp_path / name), str(tmp_path / "o.csv")]).stdout
        for name in ("machine.toml", "model.json")
    )
    said, verdict = "note: the 21 geometric errors were never fitted", "backlash"
    assert 0 < nominal.index(said) < nominal.index(verdict)
    command = f"  geoerr fit {tmp_path}/o.csv --machine {tmp_path}/machine.toml -o model.json\n"
    assert nominal.index(said) < nominal.index(command) < nominal.index(verdict)
    assert verdict in fitted
    assert "never fitted" not in fitted
    assert "geoerr fit" not in fitted


def test_what_has_no_name_is_described_and_can_be_drawn(unknown: Diagnosis) -> None:
    text = text_of(unknown)
    found = unknown.unknown
    assert unknown.verdict == "unknown"
    assert found is not None
    assert (found.component, found.depends_on) == ("z", ("feed", "x"))
    assert "no known effect explains acts along z and depends on feed and x" in text.replace("\n  ", " ")
    assert found.shape is not None
    # The truth turns its sign at 200, and a part of it is the model's.
    turned = re.search(r"turns round at x = ([\d.]+);", found.shape)
    assert turned is not None
    assert float(turned[1]) == pytest.approx(200.0, abs=40.0)
    assert "'empirical:z@feed*x' -o model2.json" in text
    curve = found.curve
    assert curve is not None
    truth = 12.0 * np.outer(np.cos(curve.at[0] / 2000.0), (curve.at[1] - 200.0) / 200.0)
    # What the model and the frames do of it is theirs: compared is what is left of both as a product.
    twist = [values - values.mean(axis=0) - values.mean(axis=1, keepdims=True) for values in (curve.value_um, truth)]
    assert np.corrcoef(twist[0].ravel(), twist[1].ravel())[0, 1] > 0.95
    figure = figures.unknown_curve(unknown)
    assert np.array_equal(figure.data[0].z, curve.value_um.T)
    assert (figure.layout.xaxis.title.text, figure.layout.yaxis.title.text) == ("feed, mm/min", "x, mm")
    in_time = dataclasses.replace(found, depends_on=("t",), curve=dataclasses.replace(curve, variables=("t", "x")))
    timed = dataclasses.replace(unknown, unknown=in_time)
    assert figures.unknown_curve(timed).layout.xaxis.title.text == "time, s"
    seen = unknown.fitted.sightings
    without_time = dataclasses.replace(seen, table=seen.table.drop("t"))
    untimed = dataclasses.replace(timed, fitted=dataclasses.replace(unknown.fitted, sightings=without_time))
    figure = figures.unknown_curve(untimed)
    assert figure.layout.xaxis.title.text == "number of the row"
    assert "over row:" in figure.layout.title.text
    document = found.to_document()
    assert np.shape(document["curve"]["value_um"]) == (4, 17)
    held = found.held_out
    assert held is not None
    assert held.before_um is not None
    assert held.after_um is not None
    assert held.after_um < held.before_um


def test_of_three_variables_surfaces_are_drawn_and_the_largest_is_a_table(unknown: Diagnosis) -> None:
    """At the ends and the middle of the one that is no position."""
    found = unknown.unknown
    assert found is not None
    at = tuple(np.linspace(low, high, 9) for low, high in ((600.0, 6000.0), (0.0, 400.0), (0.0, 300.0)))
    value_um = np.einsum("i,j,k->ijk", at[0] / 6000.0, at[1] - 200.0, at[2] - 150.0) * 1e-3
    curve = Curve("z", ("feed", "x", "y"), at, value_um, np.ones_like(value_um))
    solid = dataclasses.replace(found, depends_on=("feed", "x", "y"), curve=curve)
    diagnosis = dataclasses.replace(unknown, unknown=solid)
    figure = figures.unknown_curve(diagnosis)
    assert [trace.z[0, 0] for trace in figure.data] == [value_um[place, 0, 0] for place in (0, 4, 8)]
    heads = [figure.layout[axis].title.text for axis in ("xaxis", "xaxis2", "xaxis3")]
    assert heads == ["x, mm (feed = 600)", "x, mm (feed = 3300)", "x, mm (feed = 6000)"]
    assert "over feed, x and y:" in figure.layout.title.text
    text = text_of(diagnosis)
    assert "    at feed = 6000:\n    z, µm (± 1.0), over x (down) and y (across)" in text
    assert "so at feed = 6000, 0.1 times as large at feed = 600" in text.replace("\n      ", " ")


def test_nothing_is_said_where_nothing_is(clean: Diagnosis) -> None:
    text = text_of(clean)
    assert clean.verdict == "nothing-missing"
    assert "Nothing is missing that these data could show" in text
    assert "geoerr add" not in text
    with pytest.raises(GeoerrError, match="no curve without a name"):
        figures.unknown_curve(clean)
    with pytest.raises(GeoerrError, match=r"no candidate to draw.*\nhint: the verdict is nothing-missing"):
        figures.diagnosis_bars(dataclasses.replace(clean, candidates=()))


def test_bars_show_the_numbers(named: Diagnosis) -> None:
    figure = figures.diagnosis_bars(named)
    bars = {
        name: value
        for trace in figure.data
        if trace.type == "bar"
        for name, value in zip(trace.y, trace.x, strict=True)
    }
    assert bars["thermal-expansion:y@temp_bed"] == named.found[0].worth_um
    held = next(trace for trace in figure.data if trace.type == "scatter")
    first = named.found[0].held_out
    assert first is not None
    assert tuple(held.x) == (first.before_um, first.after_um)


def test_what_nobody_has_held_out_takes_no_room(named: Diagnosis, clean: Diagnosis) -> None:
    def first(diagnosis: Diagnosis) -> tuple[Figure, Table]:
        figure, table = diagnosis_sections(diagnosis)[0].blocks
        assert isinstance(figure, Figure)
        assert isinstance(table, Table)
        return figure, table

    figure, table = first(clean)
    assert clean.candidates
    assert [text.text for text in figure.figure.layout.annotations] == ["worth, µm rms"]
    assert figure.figure.layout.shapes == ()
    for said in (figure.caption, figure.figure.layout.title.subtitle.text, *table.header):
        assert "held" not in said
        assert "ashed" not in said
    assert {len(row) for row in table.rows} == {len(table.header)} == {4}
    figure, table = first(named)
    assert len(figure.figure.layout.annotations) == 2
    assert "held-out error without it and with it" in figure.caption
    assert "Dashed: noise" in figure.figure.layout.title.subtitle.text
    assert len(table.header) == 6


def test_every_number_can_be_had_again(named: Diagnosis) -> None:
    """By the calls that a user has: the value by adding, the held-out errors by refitting."""
    finding, fitted = named.found[0], named.fitted
    assert finding.held_out is not None
    again = with_terms(fitted, [finding.term])
    assert again.held_out.figures is not None
    # Columns beside the fit's, no refit: first order in inner parameters, which a pass left out moves by little.
    assert finding.held_out.after_um == pytest.approx(again.held_out.figures.headline_um, rel=1e-3)
    # Directions that the rest of the data determine by less than a thousandth are left to the pass.
    assert finding.held_out.before_um == pytest.approx(named.held_out_rmse_um, rel=1e-3)
    model = geoerr.fit_model(machine(), observed(growth), options=OPTIONS).model
    change = add_effect(model, observed(growth), reference=str(finding.reference), threads=1)
    alpha = change.result.model.parameter("thermal-expansion:y@temp_bed.alpha")
    own = finding.parameters[0]
    # The diagnosis weighs by the noise that it found, the fit by what is stated: two estimates of one number.
    assert abs(alpha.value - own.value) < 3.0 * own.std


@pytest.mark.usefixtures("few_effects")
def test_the_verb_writes_what_it_says(tmp_path: Path) -> None:
    table, model, page = tmp_path / "obs.csv", tmp_path / "m.json", tmp_path / "page.html"
    observations = observed(growth)
    geoerr.write_observations(table, observations)
    write_model(model, geoerr.fit_model(machine(), geoerr.read_observations(table), options=OPTIONS).model)
    runner = CliRunner()
    arguments = ["diagnose", str(model), str(table), "--json", "--threads", "1", "--report", str(page)]
    outcome = runner.invoke(app, arguments)
    assert outcome.exit_code == 0, outcome.output
    document = json.loads(outcome.stdout)
    assert document["verdict"] == "missing"
    assert document["found"][0]["effect"] == "thermal-expansion"
    assert document["found"][0]["parameters"]["alpha"]["plausible"] == "steel"
    assert document["candidates"][0]["held_out_rmse_after_um"] < document["held_out_rmse_um"]
    assert {"not_offered", "unknown", "p_value", "noise_floor_um", "provenance"} <= set(document)
    assert "thermal-expansion:y@temp_bed" in page.read_text(encoding="utf-8")
    assert runner.invoke(app, ["diagnose", str(model), str(table), "--report", str(table)]).exit_code == 1
    assert runner.invoke(app, ["diagnose", str(model)]).exit_code == 2


@pytest.mark.usefixtures("few_effects")
def test_a_model_of_other_data_keeps_its_numbers(tmp_path: Path) -> None:
    """Cold, then warm: what was fitted cold has nothing of the growth, and none of it is fitted away."""
    model = geoerr.fit_model(machine(), observed(nothing, seed=1), options=OPTIONS).model
    table, path = tmp_path / "warm.csv", tmp_path / "m.json"
    geoerr.write_observations(table, observed(growth, seed=1))
    write_model(path, model)
    outcome = CliRunner().invoke(app, ["diagnose", str(path), str(table), "--json", "--threads", "1"])
    assert outcome.exit_code == 0, outcome.output
    document = json.loads(outcome.stdout)
    assert [document["found"][0][key] for key in ("effect", "axis", "covariate")] == [
        *("thermal-expansion", "y", "temp_bed")
    ]


def test_a_lag_is_chosen_where_there_is_one() -> None:
    """`add` follows the temperature in the way that explains more: ten minutes late, or at once."""
    moved = motion(np.random.default_rng(8), Plan(n_sessions=1, n_lines=20, n_points=12, seconds=12.0))
    # Each session begins with a part as warm as its sensor.
    late = moved.bed.copy()
    for row in range(1, len(late)):
        if moved.session[row] == moved.session[row - 1]:
            keep = np.exp(-(moved.t[row] - moved.t[row - 1]) / 600.0)
            late[row] = moved.bed[row] + (late[row - 1] - moved.bed[row]) * keep
    for temperature, n_inner in ((late, 2), (moved.bed, 1)):
        hidden = 12e-3 * ((temperature - 20.0) * (moved.q[:, 1] - 200.0))[:, None] * np.eye(3)[1]
        observations = measure(np.random.default_rng(9), moved, NOISE, hidden)
        base = geoerr.fit_model(machine(), observations, components="12", options=OPTIONS).model
        change = add_effect(base, observations, reference="thermal-expansion:y@temp_bed", threads=1)
        term = change.after.terms[-1]
        assert len(term.inner) == n_inner
        if n_inner == 2:
            tau = next(one for one in term.inner if one.name == "tau")
            assert abs(tau.value - 600.0) < 4.0 * tau.std


def test_circular_tests_alone_are_ranked(tmp_path: Path) -> None:
    """Both senses at one feed: play of x of 12 µm, from the nominal machine."""
    table, nominal, page = tmp_path / "circle.csv", tmp_path / "machine.toml", tmp_path / "page.html"
    rng = np.random.default_rng(3)
    rows = ["line,dir,x,y,z,r,feed"]
    for sense in (1, -1):
        angle = sense * 2.0 * np.pi * (np.arange(180) + 0.5) / 180
        gap_um = -0.5 * 12.0 * -sense * np.sign(np.sin(angle)) * np.cos(angle)
        radius = 100.0 + 1e-3 * (gap_um + rng.normal(0.0, 0.5, len(angle)))
        places = zip(200.0 + 100.0 * np.cos(angle), 200.0 + 100.0 * np.sin(angle), radius, strict=True)
        rows += [f"XY,{sense},{x:.6f},{y:.6f},200,{r:.6f},1000" for x, y, r in places]
    table.write_text("\n".join(rows) + "\n")
    ranges = "".join(f"[axes.{axis}]\nrange = [0.0, 400.0]\n" for axis in "xyz")
    nominal.write_text(f'[machine]\nname = "mill"\nchain = "wXYbZt"\n{ranges}')
    runner = CliRunner()
    arguments = ["diagnose", str(nominal), str(table), "--threads", "1"]
    outcome = runner.invoke(app, [*arguments, "--json", "--report", str(page)])
    assert outcome.exit_code == 0, outcome.output
    document = json.loads(outcome.stdout)
    assert document["found"][0]["axis"] == "x"
    assert document["circle"]["runs"][0]["plane"] == "XY"
    assert document["circle"]["ranked"][0] in page.read_text(encoding="utf-8")
    text = runner.invoke(app, arguments).stdout
    assert "The circle is off by" in text
    assert "unexplained" in text
    assert max(len(line) for line in text.splitlines() if "geoerr add" not in line) <= WIDTH


def test_what_is_explained_row_by_row_is_worth_what_is_said(named: Diagnosis, unknown: Diagnosis) -> None:
    for diagnosis, what in ((named, named.found[0]), (unknown, unknown.unknown)):
        moved_um = what.explained_um
        used = diagnosis.fitted.solved.used
        assert np.sqrt((moved_um[used] ** 2).sum(axis=1).mean()) == pytest.approx(what.worth_um, rel=0.02)
    growth_um = named.found[0].explained_um
    assert np.abs(growth_um[:, 1]).max() > 5.0 * np.abs(growth_um[:, [0, 2]]).max()


def test_a_diagnosis_says_the_same_without_the_numbers_behind_it(named: Diagnosis, unknown: Diagnosis) -> None:
    for whole in (named, unknown):
        alone = whole.without_numbers()
        assert alone.to_document() == whole.to_document()
        assert [one.words() for one in alone.candidates] == [one.words() for one in whole.candidates]
        with pytest.raises(GeoerrError, match="diagnose again"):
            _ = alone.searched
    # What judged it is made anew where it is asked for, and says the same.
    first = named.searched.found[0]
    (rival,) = named.searched.rivals_at_last(first, first.rivals[:1])
    (said,) = (one for one in named.candidates if one.reference == reference_of(first.rivals[0].judged))
    assert rival.visible_um == pytest.approx(said.worth_um, rel=1e-9)
