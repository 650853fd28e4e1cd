"""Hidden effects beside general-purpose tools: who stays silent, who names what, who says that there is no name.

    python -m validation.hidden_effects.peers [--nulls 3] [--singles 1] [--unlisted 1] [--every 1] [-o FILE.md]

Needs scikit-learn and lmfit, which geoerr does not. The peers are given the hard part done: residual and columns of
geoerr's own candidates (every form at trial values of its inner parameters) in units of their standard deviations,
projected off everything that the base model is free to do. Those marked `+` are given geoerr's noise model as well:
white columns and residual in the presence of offsets and drift. Sets are those of the study.

| peer | how it is asked |
| --- | --- |
| geoerr | `fit_terms`, `diagnose` |
| geoerr, one look | its candidates judged once against what the base leaves, chance drawn: the first that passes |
| LassoLarsIC | `criterion="bic"`, noise variance given (1); the candidate that explains most of the prediction |
| OMP | `OrthogonalMatchingPursuitCV`, passes left out by turns; likewise; it cannot say none |
| stepwise BIC | forward by candidate in NumPy, k ln N for k columns; the first that enters |
| lmfit | a fit of each of the 40 candidates that gain most, inner parameters too, from its best trial; lowest BIC |

Times are of one thread and without the fit of the base. The peers' are given without the columns, which they were
handed, and with them; geoerr's have everything.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from validation.hidden_effects.chain import Array
from validation.hidden_effects.generate import CannotCarryError
from validation.hidden_effects.judge import depends_on, named
from validation.hidden_effects.record import OPTIONS, answer_of, truth_of
from validation.hidden_effects.sets import Set, sets_of
from validation.hidden_effects.tables import rate, table

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.candidates import Shapes, candidates_of
from geoerr.diagnose.scan import all_channels
from geoerr.diagnose.search import Round
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.beside_drift import beside_drift
from geoerr.diagnose.search.judged import ALPHA, first_to_pass
from geoerr.diagnose.search.look import look
from geoerr.diagnose.space import orthonormal
from geoerr.effects import catalogue
from geoerr.fit import Fitted, fit_terms
from geoerr.fit.owned import OWNED

# Trial values of one form that a peer is given; of a wave's period more.
_MOST_TRIALS, _MOST_PERIODS = 24, 110
_LARS_STEPS, _OMP_COLUMNS, _FOLDS = 60, 12, 5
# Candidates that are fitted one by one: those that gain most at their best trial.
_FITTED = 40
NULL_NOISES = ("gauss-10", "offsets-3", "offsets-8", "drift-2", "heavy-tails", "outliers")
SINGLE_STRENGTHS_UM, UNLISTED_STRENGTHS_UM = (2.0, 4.0), (4.0,)


@dataclass(frozen=True)
class Form:
    """One way to write a candidate: which, and where its columns begin and end."""

    name: str
    shapes: Shapes
    trial: int
    columns: slice


@dataclass(frozen=True)
class Problem:
    """What a peer is given: residual (m,), columns (m, k) of unit length off the base, and whose they are."""

    residual: Array
    columns: Array
    forms: tuple[Form, ...]
    fold: np.ndarray
    project: Callable[[Array], Array]
    looked: Round

    def names(self) -> np.ndarray:
        """Name of each column's candidate."""
        result = np.empty(self.columns.shape[1], dtype=object)
        for form in self.forms:
            result[form.columns] = form.name
        return result


def problem_of(looked: Round, fitted: Fitted, *, with_noise_model: bool) -> Problem:
    """Make the columns of all candidates."""
    solved, space = fitted.solved, looked.space
    counts = space.rows.reshape(-1) > 0.0
    if with_noise_model:
        basis, residual, whiten = space.basis, space.residual, space.noise.whiten
    else:
        raw = fitted.problem.times(solved.state, solved.solution.covariance_root, solved.used.astype(float), 1)
        basis = orthonormal(raw.reshape(-1, raw.shape[2])).reshape(*space.rows.shape, -1)
        residual, whiten = solved.whitened * space.rows, lambda columns: columns * space.rows[:, :, None]
    flat = basis.reshape(-1, basis.shape[2])

    def off_model(whole: Array) -> Array:
        return np.asarray((whole - flat @ (flat.T @ whole))[counts])

    def project(raw: Array) -> Array:
        return off_model(whiten(raw).reshape(len(flat), -1))

    blocks, forms, at = [], [], 0
    for judged in looked.candidates:
        for shapes in judged.what.shapes:
            trials = _some_trials(shapes)
            whole = whiten(np.concatenate([looked.scanner.raw_columns(shapes, trial) for trial in trials], axis=2))
            whole = whole.reshape(len(flat), -1)
            own = off_model(whole)
            left = np.linalg.norm(own, axis=0)
            seen = left**2 > OWNED * np.maximum(np.linalg.norm(whole, axis=0), 1e-300) ** 2
            blocks.append(own[:, seen] / left[seen])
            for trial, kept in zip(trials, seen.reshape(len(trials), -1).sum(axis=1).tolist(), strict=True):
                if kept:
                    forms.append(Form(str(judged.what.reference), shapes, trial, slice(at, at + kept)))
                    at += kept
    return Problem(
        off_model(residual.reshape(-1)),
        np.concatenate(blocks, axis=1),
        tuple(forms),
        np.repeat(fitted.sightings.pass_number % _FOLDS, 3)[counts],
        project,
        looked,
    )


def _some_trials(shapes: Shapes) -> list[int]:
    is_period = shapes.term is not None and any(one.name == "P" for one in shapes.term.inner)
    most = _MOST_PERIODS if is_period else _MOST_TRIALS
    return sorted({int(place) for place in np.linspace(0, len(shapes.trials) - 1, min(most, len(shapes.trials)))})


def _weightiest(problem: Problem, coefficients: Array) -> str | None:
    """Name the candidate whose columns make the largest part of a prediction."""
    names, sizes = problem.names(), {}
    for name in set(names[coefficients != 0.0]):
        own = (names == name) & (coefficients != 0.0)
        sizes[name] = float(np.linalg.norm(problem.columns[:, own] @ coefficients[own]))
    return max(sizes, key=lambda name: sizes[name]) if sizes else None


def lasso(problem: Problem) -> str | None:
    """Ask LassoLarsIC."""
    from sklearn.linear_model import LassoLarsIC

    model = LassoLarsIC(criterion="bic", fit_intercept=False, noise_variance=1.0, max_iter=_LARS_STEPS)
    return _weightiest(problem, model.fit(problem.columns, problem.residual).coef_)


def matching_pursuit(problem: Problem) -> str | None:
    """Ask OrthogonalMatchingPursuitCV."""
    from sklearn.linear_model import OrthogonalMatchingPursuitCV

    folds = [(np.flatnonzero(problem.fold != one), np.flatnonzero(problem.fold == one)) for one in range(_FOLDS)]
    model = OrthogonalMatchingPursuitCV(cv=folds, fit_intercept=False, max_iter=_OMP_COLUMNS)
    return _weightiest(problem, model.fit(problem.columns, problem.residual).coef_)


def stepwise(problem: Problem) -> str | None:
    """Take the candidate that lowers BIC most, if any does."""
    best, found = 0.0, None
    for form in problem.forms:
        own = problem.columns[:, form.columns]
        gain = float(np.sum((np.linalg.qr(own)[0].T @ problem.residual) ** 2))
        worth = gain - own.shape[1] * np.log(len(problem.residual))
        if worth > best:
            best, found = worth, form.name
    return found


def one_by_one(problem: Problem) -> str | None:
    """Ask lmfit for each candidate."""
    import lmfit

    size = len(problem.residual)
    lowest, found = size * np.log(np.mean(problem.residual**2)), None
    for form in _best_forms(problem):
        term = form.shapes.term
        assert term is not None
        inner = [one for one in term.inner if one.low is not None and one.high is not None and one.low < one.high]
        start = dict(zip((one.name for one in term.inner), form.shapes.trials[form.trial], strict=True))
        parameters = lmfit.Parameters()
        for one in inner:
            # A name of its own: `lambda` is a word of Python's.
            value = min(max(start[one.name], one.low), one.high)
            parameters.add(f"inner_{one.name}", value, min=one.low, max=one.high)
        first = _columns_at(problem, form, start)
        solved = np.linalg.lstsq(first, problem.residual, rcond=1e-8)[0]
        for place, value in enumerate(solved):
            parameters.add(f"c{place}", float(value))

        def left(values: Any, form: Form = form, start: dict[str, float] = start, k: int = len(solved)) -> Array:
            at = start | {name: values[f"inner_{name}"].value for name in start if f"inner_{name}" in values}
            coefficients = np.array([values[f"c{place}"].value for place in range(k)])
            return problem.residual - _columns_at(problem, form, at) @ coefficients

        fit = lmfit.minimize(left, parameters, max_nfev=60) if inner else None
        chi2 = float(np.sum(left(parameters) ** 2)) if fit is None else float(fit.chisqr)
        bic = size * np.log(chi2 / size) + len(parameters) * np.log(size)
        if bic < lowest:
            lowest, found = bic, form.name
    return found


def _best_forms(problem: Problem) -> Iterator[Form]:
    """Give the best form of those candidates that gain most."""
    best: dict[str, tuple[float, Form]] = {}
    for form in problem.forms:
        own = problem.columns[:, form.columns]
        gain = float(np.sum((np.linalg.qr(own)[0].T @ problem.residual) ** 2))
        if form.name not in best or gain > best[form.name][0]:
            best[form.name] = (gain, form)
    ranked = sorted(best.values(), key=lambda one: -one[0])
    yield from (form for _, form in ranked[:_FITTED])


def _columns_at(problem: Problem, form: Form, inner: dict[str, float]) -> Array:
    from geoerr.diagnose.candidates import Formulas
    from geoerr.diagnose.scan import raw_columns

    term, scanner = form.shapes.term, problem.looked.scanner
    assert term is not None
    formulas = Formulas(scanner.functions, term)
    values = formulas.at([inner[one.name] for one in term.inner])
    single = Shapes(
        *(term, form.shapes.channels, formulas.columns, len(term.coefficients), ({},)),
        trials=(tuple(inner.values()),),
        codes=form.shapes.codes[:1],
    )
    return problem.project(raw_columns(scanner.channels, single, values))


PEERS: dict[str, Callable[[Problem], str | None]] = {
    "LassoLarsIC": lasso,
    "OMP": matching_pursuit,
    "stepwise BIC": stepwise,
    "lmfit": one_by_one,
}


def one_look(fitted: Fitted) -> str | None:
    """Name what geoerr's first look at its candidates alone would: no curves beside them, no second look."""
    candidates, _, functions = candidates_of(fitted, catalogue())
    names = all_channels([shapes for one in candidates for shapes in one.shapes])
    bench = Bench(fitted, functions, names=names, threads=1)
    looked = beside_drift(bench, look(bench, bench.space([]), candidates, []), [])
    best = first_to_pass(looked.candidates, ALPHA)
    return None if best is None else str(best.what.reference)


def compare(one: Set, n_rows: int, names: Sequence[str], *, is_study: bool) -> Iterator[dict[str, Any]]:
    """Ask geoerr and every peer about one set."""
    case = one.case(n_rows, is_study=is_study)
    fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
    start = time.perf_counter()
    diagnosis = diagnose(fitted, threads=1)
    seconds = time.perf_counter() - start
    line: dict[str, Any] = {"key": one.key, "part": one.part, "noise": one.noise, "failed": None}
    line["truth"] = [truth_of(case, place) for place in range(len(case.truth))]
    answer = line | answer_of(diagnosis)
    yield answer | {"peer": "geoerr", "outcome": outcome(answer), "seconds": seconds}
    start = time.perf_counter()
    found = one_look(fitted)
    seconds = time.perf_counter() - start
    yield line | {
        "peer": "geoerr, one look",
        "outcome": _peer_outcome(line, found),
        "seconds": seconds,
        "said": found,
    }
    looked = diagnosis.searched.first
    for mark in ("", " +"):
        start = time.perf_counter()
        problem = problem_of(looked, fitted, with_noise_model=bool(mark))
        of_columns = time.perf_counter() - start
        for name in names:
            start = time.perf_counter()
            with warnings.catch_warnings():
                # Paths that end early, fits that stop at their number of calls.
                warnings.simplefilter("ignore")
                found = PEERS[name](problem)
            seconds = time.perf_counter() - start
            yield line | {
                "peer": name + mark,
                "outcome": _peer_outcome(line, found),
                "seconds": seconds,
                "seconds_of_columns": of_columns,
                "said": found,
            }


def outcome(line: dict[str, Any]) -> str:
    """Say what geoerr answered, in the words of the table."""
    if not line["truth"]:
        return "silent" if line["verdict"] == "nothing-missing" else "alarm"
    if line["truth"][0]["name"] is None:
        if line["found"] or line["unknown"] is None:
            return "named" if line["found"] else "silent"
        found, hidden = depends_on(line)
        return "unknown" if found == hidden else "unknown, other variables"
    return {"alone": "right", "tied": "right", "second": "tied"}.get(named(line), named(line))


def _peer_outcome(line: dict[str, Any], found: str | None) -> str:
    if not line["truth"]:
        return "silent" if found is None else "alarm"
    if found is None:
        return "silent"
    if line["truth"][0]["name"] is None:
        return "named"
    return "right" if found == line["truth"][0]["name"] else "wrong"


def sample(n_nulls: int, n_singles: int, n_unlisted: int, every: int) -> Iterator[Set]:
    """Give some of the study's sets of each kind; of those with an effect every so many-th."""
    yield from (one for one in sets_of("nulls", n_nulls) if one.cell in NULL_NOISES)
    singles = (one for one in sets_of("single", n_singles) if one.strength_um in SINGLE_STRENGTHS_UM)
    yield from islice(singles, 0, None, every)
    unlisted = (one for one in sets_of("unlisted", n_unlisted) if one.strength_um in UNLISTED_STRENGTHS_UM)
    yield from islice(unlisted, 0, None, every)


def tables(lines: Sequence[dict[str, Any]]) -> str:
    """Give the side-by-side."""
    by_peer: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for line in lines:
        by_peer[line["peer"]].append(line)
    rows, more = [], []
    for peer, own in by_peer.items():
        parts = {part: [one for one in own if one["part"] == part] for part in ("nulls", "single", "unlisted")}
        count = {part: Counter(one["outcome"] for one in some) for part, some in parts.items()}
        n = {part: len(some) for part, some in parts.items()}
        right = count["single"]["right"]
        rows.append(
            [
                *(peer, rate(count["nulls"]["alarm"], n["nulls"]), rate(right, n["single"])),
                *(rate(right + count["single"]["tied"], n["single"]), rate(count["single"]["wrong"], n["single"])),
                *(rate(count["unlisted"]["unknown"], n["unlisted"]), rate(count["unlisted"]["named"], n["unlisted"])),
                f"{np.median([one['seconds'] for one in own]):.2f}",
                f"{np.median([one['seconds'] + one.get('seconds_of_columns', 0.0) for one in own]):.2f}",
            ]
        )
        alarms = [Counter(one["outcome"] for one in parts["nulls"] if one["noise"] == noise) for noise in NULL_NOISES]
        more.append([peer, *(f"{one['alarm']}/{one.total()}" for one in alarms)])
    head = ["", "false alarms", "right name first", "right or listed as tied", "wrong name"]
    more_heads = ["unknown, right variables", "unknown effect named", "s, median", "s with columns"]
    text = table([*head, *more_heads], rows)
    return text + "\n" + table(["false alarms", *NULL_NOISES], more)


def main() -> None:
    """Run the side-by-side."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nulls", type=int, default=5, help="sets of each of six noises")
    parser.add_argument("--singles", type=int, default=1, help="sets of each kind of effect at 2 and 4 µm")
    parser.add_argument("--unlisted", type=int, default=1, help="sets of each effect that the catalogue lacks, 4 µm")
    parser.add_argument("--every", type=int, default=1, help="only every so many-th set with an effect")
    parser.add_argument("--only", metavar="KEY", action="append", help="only this set; may be repeated")
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--peer", action="append", choices=[*PEERS], help="all, if not given")
    parser.add_argument("--development", action="store_true", help="seeds to develop with, not those of the study")
    parser.add_argument("--resume", type=Path, default=Path(__file__).parents[1] / "hidden_effects_peers.jsonl")
    parser.add_argument("-o", "--output", type=Path, help="write the tables there")
    given = parser.parse_args()
    lines = [json.loads(text) for text in given.resume.read_text().splitlines()] if given.resume.exists() else []
    known = {line["key"] for line in lines}
    with given.resume.open("a", encoding="utf-8") as file:
        for one in sample(given.nulls, given.singles, given.unlisted, given.every):
            if one.key in known or (given.only and one.key not in given.only):
                continue
            try:
                asked = [*compare(one, given.rows, given.peer or [*PEERS], is_study=not given.development)]
            except CannotCarryError:
                continue
            for line in asked:
                file.write(json.dumps(line, ensure_ascii=False) + "\n")
            file.flush()
            lines += asked
            print(one.key, {line["peer"]: (line["outcome"], round(line["seconds"], 1)) for line in asked}, flush=True)
    text = tables(lines)
    print(text)
    if given.output is not None:
        given.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
