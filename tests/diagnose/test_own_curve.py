"""What a model's own curve leaves over its own variables: told as that, made finer, and never an error."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import geoerr
from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.cli.main import app
from geoerr.diagnose import Diagnosis, add_effect, diagnose
from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions, fit_terms, refit
from geoerr.fit.empirical import curve_in, empirical_term, finer_term
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import Observations, observations_from_columns
from geoerr.terms import Parameter, Part, Term
from geoerr.workbench.told import told_of

MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
STD_MM = 1e-3
NAME = "empirical:z@x*y"


def observations(seed: int = 0, size: float = 1.0, n: int = 600) -> Observations:
    """Make points of a machine without errors but a saddle along z, of the first degree and of the third in x, µm."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(0.0, [400.0, 300.0, 250.0], (n, 3))
    u, w = q[:, 0] / 200.0 - 1.0, q[:, 1] / 150.0 - 1.0
    seen = q + rng.normal(0.0, STD_MM, q.shape)
    seen[:, 2] += 1e-3 * size * (10.0 * u + 6.0 * (2.5 * u**3 - 1.5 * u)) * w
    columns: dict[str, object] = {"carrier": ["relative"] * n, "line": [f"L{number // 20}" for number in range(n)]}
    columns |= {name: q[:, number] for number, name in enumerate("xyz")}
    columns |= {f"m{name}": seen[:, number] for number, name in enumerate("xyz")}
    columns |= {f"s{name}": np.full(n, STD_MM) for name in "xyz"}
    return observations_from_columns(columns)


def coarse(term: Term) -> Term:
    """Keep of a curve over two variables the product of both: straight lines."""
    part = term.parts[0]
    straight = tuple(one for one in part.definitions if one[0] in ("u_1", "u_2"))
    return replace(
        term, parts=(Part(part.channel, "c1_1*u_1*u_2", straight),), coefficients=(Parameter("c1_1", "mm"),)
    )


@pytest.fixture(scope="module")
def model() -> Model:
    table = observations()
    base = fit_terms(MACHINE, [table], options=FitOptions(components="none", threads=1))
    own = coarse(empirical_term(base, NAME))
    return geoerr.fit_model(MACHINE, table, components="none", effects=[own]).model


@pytest.fixture(scope="module")
def told(model: Model) -> Diagnosis:
    return diagnose(model, observations(), threads=1)


def text_of(diagnosis: Diagnosis) -> str:
    return " ".join(" ".join(diagnosis_lines(diagnosis, "geoerr add m.json o.csv", "")).split())


def test_what_the_own_curve_leaves_is_unknown_and_told_as_that(told: Diagnosis) -> None:
    assert told.verdict == "unknown"
    unknown = told.unknown
    assert unknown is not None
    assert (unknown.component, unknown.depends_on, unknown.reference) == ("z", ("x", "y"), NAME)
    assert "nor the model's own curve over the same" in told.sentence
    assert "it has to be finer, which adding it once more makes it" in unknown.words()
    document = unknown.to_document()
    assert document["in_model"] is True
    assert document["can_be_added"] is True
    assert f"to make the model's curve finer: geoerr add m.json o.csv '{NAME}'" in text_of(told)
    card = next(one for one in told_of(told, ()).cards if one.reference == NAME)
    assert card.adds == "Make it finer"


def test_the_two_largest_are_told_apart_and_the_uncertainty_is_said_to_be_of_these_degrees(told: Diagnosis) -> None:
    assert told.unknown is not None
    text, words = text_of(told), told.unknown.words()
    for one in (text, words):
        assert "hat the model cannot do of it: " in one
        assert "; the curve itself is largest (" in one
        assert "s a curve: held out " in one
    assert text.count("± is that of a curve of these degrees") == 1


def test_the_curve_is_what_is_left_beyond_the_own_one(told: Diagnosis) -> None:
    """The third degree in x alone: 6 µm in either corner, and nothing of the product of straight lines."""
    assert told.unknown is not None
    curve = told.unknown.curve
    assert curve is not None
    u, w = (2.0 * (at - at[0]) / (at[-1] - at[0]) - 1.0 for at in curve.at)
    product = np.outer(u, w)
    assert abs(float((curve.value_um * product).sum() / (product**2).sum())) < 1.5
    assert float(np.abs(curve.value_um).max()) == pytest.approx(6.0, abs=1.5)


@pytest.mark.parametrize("reference", [NAME, "empirical:z@y*x"])
def test_adding_it_once_more_makes_it_finer(model: Model, reference: str) -> None:
    table = observations()
    change = add_effect(model, table, reference=reference, threads=1)
    own = [term for term in change.result.model.terms if term.kind == "empirical"]
    assert [term.id for term in own] == [NAME]
    assert {"c1_1", "c3_1"} <= {parameter.name for parameter in own[0].coefficients}
    before, after = change.before.held_out.figures, change.after.held_out.figures
    assert before is not None
    assert after is not None
    assert before.headline_um is not None
    assert after.headline_um is not None
    # What is left is noise of three components.
    assert after.headline_um == pytest.approx(1e3 * STD_MM * np.sqrt(3.0), rel=0.05)
    assert before.headline_um > 1.2 * after.headline_um
    assert change.result.model.record is not None
    assert change.result.model.record.history[-1].title.endswith("made finer")
    assert diagnose(change.result.model, table, threads=1).verdict == "nothing-missing"
    with pytest.raises(GeoerrError, match="is in the model already, and these data show no more of it"):
        add_effect(change.result.model, table, reference=reference, threads=1)


def test_a_curve_of_other_data_is_told_as_another_value(model: Model) -> None:
    """Held as it is: twice the size is no reason to add it a second time."""
    found = diagnose(model, observations(1, 2.0), threads=1)
    assert found.unknown is not None
    assert found.unknown.reference == NAME
    assert found.unknown.own_is_held
    assert "he model has it with another value" in found.unknown.words()
    assert found.unknown.to_document()["can_be_added"] is False
    assert "geoerr add" not in text_of(found)
    assert next(one for one in told_of(found, ()).cards if one.reference == NAME).adds == ""


def test_a_curve_that_was_written_otherwise_is_no_error_either() -> None:
    """Nothing can be put into it: it is to be taken out, and added anew."""
    table = observations()
    base = fit_terms(MACHINE, [table], options=FitOptions(components="none", threads=1))
    own = coarse(empirical_term(base, NAME))
    part = replace(own.parts[0], expression=str(own.parts[0].expression).replace("c1_1", "size"))
    own = replace(own, parts=(part,), coefficients=(Parameter("size", "mm"),))
    fitted = refit(base, [own])
    assert curve_in(fitted.terms, "empirical:z@y*x") is fitted.terms[0]
    assert finer_term(fitted, fitted.terms[0]) is None
    found = diagnose(fitted, threads=1)
    assert found.verdict == "unknown"
    assert found.unknown is not None
    assert found.unknown.curve is not None
    assert not found.unknown.can_be_added
    assert "take it out and add it anew" in found.unknown.words()


def test_a_second_wave_over_time_is_no_error_either() -> None:
    """Two things hum, and one is in the model: of the other the period is told."""
    table, rng = observations(2, 0.0), np.random.default_rng(3)
    t = np.cumsum(rng.uniform(6.0, 10.0, len(table)))
    columns = {name: table.frame[name].to_numpy() for name in table.frame.columns if name != "file_row"}
    waves = 8.0 * np.sin(2.0 * np.pi * t / 330.0) + 4.0 * np.sin(2.0 * np.pi * t / 97.0)
    table = observations_from_columns({**columns, "t": t, "my": columns["my"] + 1e-3 * waves})
    base = fit_terms(MACHINE, [table], options=FitOptions(components="none", threads=1))
    own = empirical_term(base, "empirical:y@t")
    assert own.inner
    found = diagnose(refit(base, [own]), threads=1)
    assert found.verdict == "unknown"
    unknown = found.unknown
    assert unknown is not None
    assert (unknown.reference, unknown.can_be_added) == ("empirical:y@t", False)
    assert unknown.curve is not None
    assert unknown.curve.period is not None
    assert unknown.curve.period.value == pytest.approx(97.0, rel=0.01)
    assert "takes no second one beside it" in unknown.words()


def test_the_verbs_go_round(tmp_path: Path, model: Model) -> None:
    """Diagnosed, made finer by what that says, and diagnosed again; the report has its section of what is missing."""
    table, first, second = tmp_path / "obs.csv", tmp_path / "1.json", tmp_path / "2.json"
    geoerr.write_observations(table, observations())
    geoerr.write_model(first, model)
    runner = CliRunner()
    said = runner.invoke(app, ["diagnose", str(first), str(table), "--json", "--refit", "--quiet"])
    assert said.exit_code == 0, said.output
    reference = json.loads(said.stdout)["unknown"]["reference"]
    added = runner.invoke(app, ["add", str(first), str(table), reference, "-o", str(second)])
    assert added.exit_code == 0, added.output
    again = runner.invoke(app, ["diagnose", str(second), str(table), "--json", "--quiet"])
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["verdict"] == "nothing-missing"
    page = tmp_path / "page.html"
    reported = runner.invoke(app, ["report", str(first), str(table), "-o", str(page), "--quiet"])
    assert reported.exit_code == 0, reported.output
    assert "has to be finer" in page.read_text()
