"""What does a diagnosis of circular tests alone find, miss and invent? On machines with known causes.

    python validation/circles.py               # all tables; writes validation/circles.md
    python validation/circles.py --sets 2      # a look, two sets a cell, to standard output

`circular_tests.py` makes the tests: geometry, servos and noise of its own. Set-up (ball off the centre by 20 µm, bar
off by 30 µm) and noise are drawn anew for every set. A name is *right* where the hidden effect is found on its axis;
*tied* where what is found lists it as not told apart, or is its special case (backlash that does not vary); *wrong*
where something else is found that is tied with no hidden cause. A set may have a right and a wrong name.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import circular_tests as made
import numpy as np

from geoerr.diagnose.circles import CircleDiagnosis, diagnose_circles
from geoerr.effects import catalogue
from geoerr.files import write_text
from geoerr.machine import Machine
from geoerr.model import Model

HERE = Path(__file__).parent
MODEL = Model(Machine.from_chain("wZbXYt", (420.0, 520.0, 300.0)))
# Peak to peak of what is hidden, µm.
STRENGTHS = (0.5, 1.0, 4.0)
NULL_SETS, CAUSE_SETS, MACHINES = 5, 1, 24
PLANS = ("both senses, two feeds", "both senses, one feed", "both senses, three times", "one sense", "three planes")
NOISES_OF_CAUSES = ("white", "all of it")


@dataclass(frozen=True)
class Hidden:
    """A cause to hide: its name in a diagnosis, how to make it so many µm peak to peak, and the value to be found."""

    name: str
    make: Callable[[float], made.Cause]
    value: Callable[[float], float] | None = None
    parameter: str = ""
    plans: tuple[str, ...] = PLANS
    in_three_planes: tuple[str, ...] = ()

    def names(self, plan: str) -> tuple[str, ...]:
        """Give what a diagnosis should find."""
        return self.in_three_planes if plan == "three planes" and self.in_three_planes else (self.name,)


_PAIRS = ("change-over:xy", "change-over:xz", "change-over:yz")
BOTH = tuple(plan for plan in PLANS if plan != "one sense")
TWO_FEEDS = ("both senses, two feeds",)
ONE_PLANE = tuple(plan for plan in PLANS if plan != "three planes")


def hidden() -> list[Hidden]:
    """Give the causes of a ball bar."""
    r = 100.0
    return [
        Hidden("squareness:xy", lambda p: made.squareness(0, 1, 1e3 * p / r), lambda p: 1e-3 * p / r, "S"),
        Hidden("scale-mismatch:xy", lambda p: made.scale(0, 1e3 * p / r), lambda p: 1e-3 * p / r, "m", ONE_PLANE),
        Hidden("scale:x", lambda p: made.scale(0, 1e3 * p / r), lambda p: 1e-3 * p / r, "k", ("three planes",)),
        Hidden("servo-mismatch:xy", _servo, _servo_s, "dtau", PLANS, ("lag:x",)),
        Hidden(
            "radial-shrink:xy", lambda p: made.servo((_lag_s(p),) * 3), lambda p: 0.5 * _lag_s(p) ** 2, "k", TWO_FEEDS
        ),
        Hidden("change-over:xy", made.change_over, lambda p: 1e-3 * p, "A", PLANS, _PAIRS),
        Hidden("backlash:x", lambda p: made.backlash(0, p), lambda p: 1e-3 * p, "b"),
        Hidden("backlash:y", lambda p: made.backlash(1, -p), lambda p: -1e-3 * p, "b"),
        Hidden("backlash-position:x", lambda p: made.unequal_backlash(0, 0.2 * p, p)),
        Hidden("lateral-play:x", lambda p: made.lateral_play(0, 1, p), lambda p: 1e-3 * p, "l_y", BOTH),
        Hidden("straightness:x", lambda p: made.bow(0, 1, 2.0 * p), lambda p: 2e-3 * p, "h_y"),
        Hidden("straightness:y", lambda p: made.s_shape(1, 0, 1.6 * p), lambda p: 1.6e-3 * p, "s_x"),
        Hidden("reversal-spike:y", lambda p: made.spike(1, p, 0.15), lambda p: 1e-3 * p, "A"),
        Hidden("reversal-spike:x", lambda p: made.rounded_spike(0, 1.4 * p, 0.2)),
        Hidden("stick-slip:x", lambda p: made.stick_slip(0, p, 1.2), lambda p: 1e-3 * p, "b_s"),
        Hidden("periodic:x", lambda p: made.periodic(0, 0.5 * p, 10.0), lambda p: 10.0, "P"),
        Hidden("vibration:y", lambda p: made.vibration(1, 0.5 * p, 1.7), lambda p: 1.7, "f"),
        Hidden("spiral", lambda p: made.spiral(2.0 * p), lambda p: 2e-3 * p / 60.0 / r, "k"),
    ]


def _servo(p: float) -> made.Cause:
    return made.servo((2e-3 + _servo_s(p), 2e-3, 2e-3))


def _servo_s(p: float) -> float:
    """Give the mismatch that is so large at the first feed of the plans with one."""
    return 1e-3 * p / 25.0


def _lag_s(p: float) -> float:
    """Give the lag that takes so much off the radius between 3000 and 750 mm/min."""
    return float(np.sqrt(2e-3 * p * 100.0 / (50.0**2 - 12.5**2)))


UNLISTED: dict[str, Callable[[float], made.Cause]] = {
    "five lobes": lambda p: made.lobes(5, 0.5 * p),
    "eight lobes": lambda p: made.lobes(8, 0.5 * p),
    "three lobes that turn over with the sense": lambda p: made.sense_lobes(3, 0.5 * p),
    "a ridge at one angle": lambda p: made.ridge(1.0, 0.25, p),
    "lobes that grow with the feed": lambda p: _with_feed(made.lobes(4, 0.5 * p)),
}


def _with_feed(cause: made.Cause) -> made.Cause:
    return lambda m, rng: cause(m, rng) * (m.run.feed_mm_min / 3000.0)


@dataclass(frozen=True)
class Case:
    """One set to make and diagnose."""

    table: str
    row: str
    plan: str
    noise: str
    strength: float
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What came out of it."""

    case: Case
    verdict: str
    p_value: float
    truths: tuple[str, ...]
    right: tuple[str, ...]
    tied: tuple[str, ...]
    wrong: tuple[str, ...]
    unknown: tuple[str, ...] | None
    deviation: float
    relative: float


def outcome_of(case: Case) -> Outcome:
    """Make a set, diagnose it, and hold it against the truth."""
    rng = np.random.default_rng([case.seed, zlib.crc32(f"{case.table}{case.row}{case.plan}{case.noise}".encode())])
    plan, noise = made.plans()[case.plan], made.NOISES[case.noise]
    parameter, value = "", None
    truths: tuple[str, ...] = ()
    causes: list[made.Cause] = []
    if case.table == "cause":
        one = next(each for each in hidden() if f"{each.name} ({each.parameter})" == case.row)
        causes, truths = [one.make(case.strength)], one.names(case.plan)
        parameter = one.parameter
        value = None if one.value is None else one.value(case.strength)
    elif case.table == "machine":
        chosen = _machine(rng, case.plan)
        causes = [one.make(size) for one, size in chosen]
        truths = tuple(name for one, _ in chosen for name in one.names(case.plan))
    elif case.table == "unlisted":
        causes = [UNLISTED[case.row](case.strength)]
    diagnosis = diagnose_circles(MODEL, made.circular_test(plan, causes, noise, rng), threads=1)
    return _judged(case, diagnosis, truths, parameter, value)


def _machine(rng: np.random.Generator, plan: str) -> list[tuple[Hidden, float]]:
    """Draw five causes of one machine, 0.5 to 5 µm each, no two of one name."""
    offered = {one.name: one for one in hidden() if plan in one.plans}
    for name in ("backlash-position:x", "stick-slip:x", "radial-shrink:xy"):
        offered.pop(name, None)
    names = rng.choice(sorted(offered), 5, replace=False)
    return [(offered[str(name)], float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))) for name in names]


def _judged(
    case: Case, diagnosis: CircleDiagnosis, truths: Sequence[str], parameter: str, value: float | None
) -> Outcome:
    right, tied, wrong = [], [], []
    deviation = relative = float("nan")
    ties = {
        str(found.suspect.reference): [str(rival.suspect.reference) for rival in rivals if rival.is_tied]
        for found, rivals in zip(diagnosis.searched.found, diagnosis.searched.rivals, strict=True)
    }
    for cause in diagnosis.found:
        name = str(cause.reference)
        if name in truths:
            (tied if ties[name] else right).append(name)
            number = next((p for p in cause.parameters if p.name == parameter), None)
            if (
                name == truths[0]
                and number is not None
                and value is not None
                and np.isfinite(number.std)
                and number.std > 0.0
            ):
                deviation, relative = (number.value - value) / number.std, number.value / value - 1.0
        elif set(ties[name]) & set(truths) or _contained(cause.reference.effect, cause.reference.axis, truths):
            tied.append(name)
        else:
            wrong.append(name)
    unknown = None if diagnosis.unknown is None else diagnosis.unknown.depends_on
    return Outcome(
        case,
        diagnosis.verdict,
        diagnosis.p_value,
        tuple(truths),
        tuple(right),
        tuple(tied),
        tuple(wrong),
        unknown,
        float(deviation),
        float(relative),
    )


def _contained(effect: str, axis: str | None, truths: Sequence[str]) -> bool:
    """Tell whether a name is a special case of what is hidden: backlash of one that varies along the axis."""
    known = catalogue()
    return any(effect in known[truth.partition(":")[0]].contains and truth.endswith(f":{axis}") for truth in truths)


def cases(n_null: int, n_cause: int, n_machines: int) -> list[Case]:
    """Give every set of the study."""
    found = [
        Case("null", noise, plan, noise, 0.0, seed)
        for plan in PLANS
        for noise in made.NOISES
        for seed in range(n_null)
    ]
    found += [
        Case("cause", f"{one.name} ({one.parameter})", plan, noise, strength, seed)
        for one in hidden()
        for plan in one.plans
        for noise in NOISES_OF_CAUSES
        for strength in STRENGTHS
        for seed in range(n_cause)
    ]
    found += [
        Case("machine", "five causes", plan, noise, 0.0, seed)
        for plan in ("both senses, two feeds", "both senses, three times")
        for noise in NOISES_OF_CAUSES
        for seed in range(max(n_machines // 4, 1))
    ]
    found += [
        Case("unlisted", row, "both senses, two feeds", noise, strength, seed)
        for row in UNLISTED
        for noise in NOISES_OF_CAUSES
        for strength in STRENGTHS[1:]
        for seed in range(4 * n_cause)
    ]
    return found


def _share(flags: Iterable[bool]) -> str:
    values = [bool(flag) for flag in flags]
    return f"{100.0 * np.mean(values):.0f}" if values else ""


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [" | ".join(head), " | ".join(["---"] * len(head)), *(" | ".join(row) for row in rows)]
    return "\n".join(f"| {line} |" for line in lines)


def _grouped(outcomes: Iterable[Outcome], key: Callable[[Outcome], object]) -> dict[object, list[Outcome]]:
    groups: dict[object, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        groups[key(outcome)].append(outcome)
    return groups


def null_table(outcomes: list[Outcome]) -> str:
    rows = []
    for noise in made.NOISES:
        cells = []
        for plan in PLANS:
            own = [one for one in outcomes if one.case.plan == plan and one.case.row == noise]
            cells.append(f"{sum(one.verdict != 'nothing-missing' for one in own)} of {len(own)}")
        own = [one for one in outcomes if one.case.row == noise]
        rows.append([noise, *cells, f"{_share(one.verdict != 'nothing-missing' for one in own)} %"])
    total = f"{_share(one.verdict != 'nothing-missing' for one in outcomes)} %"
    rows.append(["all", *("" for _ in PLANS), total])
    return _table(["noise", *PLANS, "alarms"], rows)


def cause_table(outcomes: list[Outcome]) -> str:
    rows = []
    for (row, strength), own in _grouped(outcomes, lambda one: (one.case.row, one.case.strength)).items():
        rows.append([str(row), f"{strength:g}", *_shares(own), *_accuracy(own)])
    return _table(_HEAD, rows)


_HEAD = (
    *("hidden (value compared)", "µm peak to peak", "sets", "right, alone %", "right, tied %", "silent %"),
    *("other name too %", "wrong name only %", "error of value, median %", "error over std, rms"),
)


def _shares(own: list[Outcome]) -> list[str]:
    return [
        str(len(own)),
        _share(bool(one.right) for one in own),
        _share(bool(one.tied) and not one.right for one in own),
        _share(not (one.right or one.tied or one.wrong) for one in own),
        _share(bool(one.wrong) and bool(one.right or one.tied) for one in own),
        _share(bool(one.wrong) and not (one.right or one.tied) for one in own),
    ]


def _accuracy(own: list[Outcome]) -> list[str]:
    relative = np.array([one.relative for one in own if np.isfinite(one.relative)])
    deviation = np.array([one.deviation for one in own if np.isfinite(one.deviation)])
    if not len(relative):
        return ["", ""]
    return [f"{100.0 * np.median(np.abs(relative)):.2g}", f"{np.sqrt(np.mean(deviation**2)):.2f}"]


def plan_table(outcomes: list[Outcome]) -> str:
    rows = [
        [str(plan), str(noise), *_shares(own)]
        for (plan, noise), own in _grouped(
            (one for one in outcomes if one.case.strength >= 1.0), lambda one: (one.case.plan, one.case.noise)
        ).items()
    ]
    return _table(["plan", "noise", *_HEAD[2:8]], rows)


def machine_table(outcomes: list[Outcome]) -> str:
    rows = []
    for (plan, noise), own in _grouped(outcomes, lambda one: (one.case.plan, one.case.noise)).items():
        hidden_count = sum(len(one.truths) for one in own)
        rows.append(
            [
                str(plan),
                str(noise),
                str(len(own)),
                f"{100.0 * sum(len(one.right) for one in own) / hidden_count:.0f}",
                f"{100.0 * sum(len(one.tied) for one in own) / hidden_count:.0f}",
                f"{sum(len(one.wrong) for one in own) / len(own):.2f}",
                _share(one.unknown is not None for one in own),
            ]
        )
    head = ["plan", "noise", "machines", "right, alone %", "tied %", "wrong names a machine", "also unknown %"]
    return _table(head, rows)


def unlisted_table(outcomes: list[Outcome]) -> str:
    rows = [
        [
            str(row),
            f"{strength:g}",
            str(len(own)),
            _share(one.verdict == "unknown" for one in own),
            _share(one.verdict == "nothing-missing" for one in own),
            _share(bool(one.wrong) and one.unknown is not None for one in own),
            _share(bool(one.wrong) and one.unknown is None for one in own),
        ]
        for (row, strength), own in _grouped(outcomes, lambda one: (one.case.row, one.case.strength)).items()
    ]
    head = ["hidden", "µm", "sets", "unknown %", "silent %", "a name, and unknown %", "a name only %"]
    return _table(head, rows)


def page(outcomes: list[Outcome], command: str) -> str:
    """Write the page."""
    own = {
        name: [one for one in outcomes if one.case.table == name] for name in ("null", "cause", "machine", "unlisted")
    }
    scatter = made.NOISES["white"].white
    return "\n".join(
        [
            "# Circular tests alone: what is found, missed and invented",
            "",
            f"`{command}`. Radius 100 mm, 360 rows a run (240 in three planes), scatter {scatter:g} µm;",
            "*all of it* adds what wanders within 5° (0.3 µm) and over a turn (0.4 µm), offsets of runs (0.5 µm),",
            "heavy tails, gross rows, and more scatter at speed.",
            "",
            "## Nothing hidden: alarms",
            "",
            null_table(own["null"]),
            "",
            "## One cause",
            "",
            "All plans that can see it, both kinds of noise.",
            "",
            cause_table(own["cause"]),
            "",
            "The same by plan, from 1 µm on:",
            "",
            plan_table(own["cause"]),
            "",
            "## Five causes at once, 0.5 to 5 µm each",
            "",
            machine_table(own["machine"]),
            "",
            "## What the catalogue does not have",
            "",
            unlisted_table(own["unlisted"]),
            "",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=None, help="so many sets a cell, to standard output")
    parser.add_argument("--tables", default="null,cause,machine,unlisted")
    parser.add_argument("--jobs", type=int, default=min(multiprocessing.cpu_count(), 4))
    arguments = parser.parse_args()
    few = arguments.sets
    chosen = cases(few or NULL_SETS, few or CAUSE_SETS, 4 * few if few else MACHINES)
    chosen = [case for case in chosen if case.table in arguments.tables.split(",")]
    # Forked, a worker could wait for threads that only its parent has.
    with ProcessPoolExecutor(arguments.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        outcomes = list(pool.map(outcome_of, chosen, chunksize=4))
    command = "python validation/circles.py"
    if few is None and arguments.tables == parser.get_default("tables"):
        write_text(HERE / "circles.md", page(outcomes, command))
    else:
        print(page(outcomes, command))
        for one in outcomes:
            if one.wrong:
                print(one.case, one.wrong, one.right, one.tied, one.unknown)


if __name__ == "__main__":
    main()
