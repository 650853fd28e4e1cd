"""Break ties: with the measurement that is advised, and with as much of the same again.

    python -m validation.hidden_effects.ambiguous [--seeds 20] [--rows 3000] [--jobs 2] [--resume FILE]
    python -m validation.hidden_effects.ambiguous --tables [--resume FILE]

Each set is a measurement that lacks something (`limited.py`) of a machine with one hidden effect. Where the diagnosis
has ties that hold the right name, the advised measurement is carried out on the same machine with the same effect, in
sessions of their own, by the generator's physics; then as much of the first measurement again. A tie is broken as the
report has it where the right name is first and alone (`right and alone`); and by the rule that candidates whose
projected correlation exceeds 0.95 are one set where none of the former rivals is like it, either (`and unlike`). What
the catalogue declares to be its twin by construction is like it whatever is measured: growth from a fixed point far
off is a drift (`but for twins`).
"""

from __future__ import annotations

import argparse
import os
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import polars as pl
from validation.hidden_effects.cases import development_seed, study_seed
from validation.hidden_effects.chain import Array, nothing, places_mm
from validation.hidden_effects.generate import (
    CannotCarryError,
    Case,
    Hidden,
    Scene,
    acting_of,
    columns_of,
    generate,
    in_effects,
)
from validation.hidden_effects.judge import named, tied_with_first
from validation.hidden_effects.limited import Limits
from validation.hidden_effects.log import Log, arms_mm, camera_of, motion_of
from validation.hidden_effects.noise import draw_noise
from validation.hidden_effects.plans import Moments, Pass, Plan, Rows
from validation.hidden_effects.record import OPTIONS, answer_of, finite, truth_of
from validation.hidden_effects.study import done, keep
from validation.hidden_effects.tables import rate, read_lines, table

from geoerr.diagnose.advice.measurement import Measurement
from geoerr.diagnose.advice.separation import Advice
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.effects import catalogue
from geoerr.fit import fit_terms
from geoerr.observations import Observations, observations_from_columns

RESULTS = Path(__file__).parents[1] / "hidden_effects_ambiguous.jsonl"
STRENGTH_UM, NOISE = 6.0, "offsets-3"
ONE_FEED = Limits("one-feed", is_moving=True, closest_mm=15.0)
COARSE = Limits("coarse", closest_mm=25.0)
ONE_TARGET = Limits("one-target", n_targets=1)
TOGETHER = Limits("sensors-together", temperatures="together")
_THERMAL = ("thermal-expansion", "thermal-bending", "thermal-drift", "angular-thermal")
CELLS = (
    *((ONE_FEED, Hidden(kind)) for kind in ("backlash", "lag", "stick-slip")),
    *((COARSE, Hidden(kind)) for kind in ("backlash", "reversal-windup")),
    *((ONE_TARGET, Hidden(kind)) for kind in ("backlash", "angular-reversal")),
    *((TOGETHER, Hidden(kind, None, "temp_bed")) for kind in _THERMAL),
)
_FIRST_SEED, _SEEDS_OF_A_SET = 600_000, 5


@dataclass(frozen=True)
class Question:
    """One ambiguous set."""

    limits: Limits
    hidden: Hidden
    number: int
    index: int
    n_rows: int
    is_study: bool

    @property
    def key(self) -> str:
        """Give its name in a file of results."""
        return f"ambiguous/{self.limits.name}/{self.hidden.kind}/{self.number}"

    def case(self) -> Case:
        """Generate the first measurement."""
        why = CannotCarryError("no seed was tried")
        for attempt in range(_SEEDS_OF_A_SET):
            number = _FIRST_SEED + self.index * _SEEDS_OF_A_SET + attempt
            seed = study_seed(number) if self.is_study else development_seed(number)
            try:
                return generate(seed, None, self.limits, NOISE, [self.hidden], STRENGTH_UM, self.n_rows)
            except CannotCarryError as refused:
                why = refused
        raise why


def questions(n_each: int, n_rows: int, *, is_study: bool) -> Iterator[Question]:
    """Give all sets, cells by turns."""
    for number in range(n_each):
        for place, (limits, hidden) in enumerate(CELLS):
            yield Question(limits, hidden, number, place * max(n_each, 20) + number, n_rows, is_study)


def ask(question: Question) -> dict[str, Any]:
    """Run one set."""
    kind = question.hidden.kind
    line: dict[str, Any] = {"key": question.key, "cell": f"{question.limits.name}: {kind}", "failed": None}
    try:
        case = question.case()
    except CannotCarryError as why:
        return line | {"failed": "not-carried", "why": str(why)}
    line |= {"seed": case.seed, "chain": case.chain, "n": len(case.observations), "truth": [truth_of(case, 0)]}
    try:
        first = _diagnosed(case, [case.observations])
        line["first"] = finite(answer_of(first))
        before = {**line, **line["first"]}
        line["how"], line["ties"] = named(before), sorted(tied_with_first(before))
        advice = _advice(first)
        if line["how"] not in ("tied", "second") or advice is None:
            return line
        line["advice"] = {"text": advice.text, "plan": advice.plan, "minutes": advice.minutes}
        if not advice.measurements:
            return line
        rivals = {*line["ties"], str(first.found[0].reference)} - {line["truth"][0]["name"]}
        advised = [carried_out(case, *one) for one in advice.measurements]
        line["advised"] = _broken(case, [case.observations, *_numbered(advised)], rivals, line)
        line["again"] = _broken(case, [case.observations, *_numbered([same_again(case)])], rivals, line)
    except Exception as failure:
        # A set that cannot be diagnosed is a result of the study, not its end.
        line |= {"failed": f"{type(failure).__name__}: {failure}", "traceback": traceback.format_exc()}
    return line


def _diagnosed(case: Case, tables: Sequence[Observations]) -> Diagnosis:
    return diagnose(fit_terms(case.machine, tables, options=OPTIONS), threads=1)


def _advice(diagnosis: Diagnosis) -> Advice | None:
    given = [one.separate_by for one in (*diagnosis.found, *diagnosis.candidates)]
    return next((one for one in given if isinstance(one, Advice)), None)


def _broken(case: Case, tables: Sequence[Observations], rivals: set[str], line: dict[str, Any]) -> dict[str, Any]:
    answer = finite(answer_of(_diagnosed(case, tables)))
    told = {**line, **answer}
    how, ties = named(told), tied_with_first(told)
    return {
        "how": how,
        "ties": sorted(ties),
        "alike": sorted(ties & rivals),
        "is_broken": how in ("alone", "tied") and not ties & rivals,
        "first": answer["found"][0]["name"] if answer["found"] else None,
    }


def is_broken_but_for_twins(line: dict[str, Any]) -> bool:
    """Tell whether after the advised measurement only twins of the right name are like it."""
    known = catalogue()
    after, truth = line["advised"], known.resolve(line["truth"][0]["name"])[1]
    are_twins = all(known.are_twins(truth, known.resolve(name)[1]) for name in after["alike"])
    return after["how"] in ("alone", "tied") and are_twins


def _numbered(tables: Sequence[Observations]) -> list[Observations]:
    """Give sessions names that no other table has."""
    return [
        replace(
            one, frame=one.frame.with_columns((pl.lit(f"further {number} ") + pl.col("session")).alias("session"))
        )
        for number, one in enumerate(tables)
    ]


def same_again(case: Case) -> Observations:
    """Measure once more just as it was measured."""
    return _measured(case, case.log, _moved(case, case.log), stream=5)


def carried_out(case: Case, plan: Measurement, times: int) -> Observations:
    """Carry out a measurement on the machine of a case."""
    log = _log_of(case, plan, times)
    return _measured(case, log, _moved(case, log), stream=6)


def _moved(case: Case, log: Log) -> Any:
    """Give what the hidden effect does to the rows of another log of the same machine."""
    effect = case.truth[0]
    wanted = Hidden(effect.kind, effect.axis, effect.covariate)
    given = {name: effect.parameters[name] for name in effect.inner}
    acting, _, _ = acting_of(replace(log, given=given), in_effects(case.seed), wanted)
    first = next(iter(acting.linear))
    return acting.moved.scaled(effect.parameters[first] / acting.linear[first])


def _measured(case: Case, log: Log, moved: Any, *, stream: int) -> Observations:
    rng = np.random.default_rng([case.seed, stream])
    scene = Scene(log, case.errors.at(case.machine, log.q_mm))
    noisy = draw_noise(rng, case.noise, log.pass_number, log.session, log.t_s)
    columns = columns_of(log, scene.measured_mm(moved) + noisy.total_mm, noisy.stated_mm)
    return observations_from_columns(columns, f"case {case.seed}, further")


def _log_of(case: Case, plan: Measurement, times: int) -> Log:
    """Lay a measurement out as the generator's log: every picture shows every target; once for each time."""
    pictures, n_moments, n_targets = plan.pictures, len(plan.pictures), len(plan.targets)
    round_of = np.repeat(np.arange(times), n_moments)
    of = np.tile(np.arange(n_moments), times)
    n_passes = int(pictures.pass_number.max()) + 1
    passes = []
    for number in range(times):
        for one in range(n_passes):
            first = int(np.flatnonzero(pictures.pass_number == one)[0])
            session = int(pictures.session[first]) + number * plan.n_sessions
            repeat = int(pictures.repeat[first])
            passes.append(Pass(session, pictures.line[first], repeat, False, pictures.q_mm[:1], 0.0))
    moments = Moments(
        pictures.q_mm[of],
        pictures.t_s[of],
        (pictures.session[of] + round_of * plan.n_sessions).astype(np.int64),
        (pictures.pass_number[of] + round_of * n_passes).astype(np.int64),
        pictures.feed_mm_min[of],
        pictures.is_moving[of],
        np.zeros(len(of)),
        tuple(passes),
    )
    offsets = np.array([one.offset_mm for one in plan.targets])
    target = np.tile(np.arange(n_targets), len(of))
    rows = Rows(
        np.repeat(np.arange(len(of)), n_targets),
        np.array([one.carrier for one in plan.targets], dtype=np.int64)[target],
        target,
        offsets[target],
    )
    laid = Plan(plan.name, moments, rows, is_seen_by_cameras=case.log.plan.is_seen_by_cameras)
    # A direction is the machine's own, also where a turn was not looked at.
    motion = replace(motion_of(moments), direction=pictures.direction[of].astype(float))
    by_moment = {name: np.full(len(of), values.min()) for name, values in case.log.by_moment.items()}
    by_moment |= {name: np.asarray(values, dtype=float)[of] for name, values in plan.conditions.items()}
    return _posed(case, laid, motion, by_moment, plan.set_ups)


def _posed(case: Case, plan: Plan, motion: Any, by_moment: dict[str, Array], set_ups: Array | None) -> Log:
    """Set the cameras up as they stood, or as the plan moves them; in each session a little otherwise."""
    rows, moments = plan.rows, plan.moments
    rng = np.random.default_rng([case.seed, 7])
    arm = arms_mm(case.machine, plan)
    nominal = places_mm(case.machine.chain, rows.carrier, moments.q_mm[rows.moment], arm, nothing(len(rows.moment)))
    turn, place = np.zeros((len(arm), 3, 3)), np.zeros((len(arm), 3))
    if set_ups is not None and np.any(set_ups):
        raise CannotCarryError("cameras that are moved are not simulated")
    for session in np.unique(moments.session):
        mine = moments.session[rows.moment] == session
        pose, shift = camera_of(rng, nominal[mine])
        turn[mine], place[mine] = pose, nominal[mine] @ pose.T + shift
    columns = {name: values[rows.moment] for name, values in by_moment.items()}
    return Log(case.machine, plan, motion, columns, nominal, place, turn, by_moment)


def tables(lines: Sequence[dict[str, Any]]) -> str:
    """Give what became of ties."""
    # Sets come as they are done, two at once.
    lines = sorted(lines, key=lambda line: line["key"])
    by_cell: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for line in lines:
        by_cell[line["cell"]].append(line)
    rows = []
    for cell, own in [("all", lines), *by_cell.items()]:
        asked = [one for one in own if not one["failed"]]
        tied = [one for one in asked if one["how"] in ("tied", "second")]
        advised = [one for one in tied if "advised" in one]
        told, told_again = (sum(one[key]["how"] == "alone" for one in advised) for key in ("advised", "again"))
        broken, again = (sum(one[key]["is_broken"] for one in advised) for key in ("advised", "again"))
        but_for_twins = sum(is_broken_but_for_twins(one) for one in advised)
        plans = Counter(one["advice"]["text"] for one in advised).most_common(2)
        minutes = f"{np.median([one['advice']['minutes'] for one in advised]):.0f}" if advised else "–"
        rows.append(
            [
                *(cell, str(len(own)), rate(len(tied), len(asked)), rate(len(advised), len(tied))),
                *(rate(n, len(advised)) for n in (told, broken, but_for_twins)),
                *(rate(told_again, len(advised)), rate(again, len(advised)), minutes),
                ", ".join(f"{text} ({n})" for text, n in plans),
            ]
        )
    head = ["lacking: hidden", "sets", "tied with the right name", "a measurement is advised"]
    head += [
        "after it: right and alone",
        "and unlike",
        "but for twins",
        "after the same again: right and alone",
        "and unlike",
    ]
    return table([*head, "minutes", "advice"], rows)


def main() -> None:
    """Run the sets, or write their table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="sets of each cell")
    parser.add_argument("--rows", type=int, default=3000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--development", action="store_true", help="seeds to develop with, not those of the study")
    parser.add_argument("--resume", type=Path, default=RESULTS)
    parser.add_argument("--tables", action="store_true", help="write the table of what is there")
    given = parser.parse_args()
    if given.tables:
        print(tables(read_lines(given.resume)))
        return
    known = done(given.resume)
    asked = [
        one for one in questions(given.seeds, given.rows, is_study=not given.development) if one.key not in known
    ]
    keep(given.resume, ask, asked, given.jobs, tell)


def tell(_: int, line: dict[str, Any]) -> None:
    """Say in one line what came out."""
    told = {key: line[key]["is_broken"] for key in ("advised", "again") if key in line}
    advice = line.get("advice", {}).get("text", "")
    print(line["key"], line["failed"] or line["how"], line.get("ties", ""), advice, told, flush=True)


if __name__ == "__main__":
    main()
