"""Run a sample of the study again, whose lines were made while the package grew, and say what comes out otherwise.

    python -m validation.hidden_effects.again --sets 300     # the first of an order that has nothing to do with them
    python -m validation.hidden_effects.again --tables

Of the same seeds: a set differs only by what has changed since. A run that was cut goes on, and more sets take in
those that were run.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path

from validation.hidden_effects.judge import RIGHT, Line, is_alone_but_for_alike, is_right, outcome
from validation.hidden_effects.sets import PARTS, sets_of
from validation.hidden_effects.study import RESULTS, Task, done, keep, run, summary
from validation.hidden_effects.tables import rate, read_lines, table

AGAIN = Path(__file__).parents[1] / "hidden_effects_again.jsonl"

_TITLE = "# A sample of the study, run again\n\n`python -m validation.hidden_effects.again --tables`\n\n"


def sample(lines: Sequence[Line], n_sets: int) -> list[str]:
    """Give the keys of so many of the study's sets that could be carried, in an order drawn by their names alone."""
    keys = [one["key"] for one in lines if not one["failed"]]
    return sorted(keys, key=lambda key: sha256(key.encode()).hexdigest())[:n_sets]


def tables(before: Sequence[Line], again: Sequence[Line]) -> str:
    """Give how the sets came out when the study ran them, and again."""
    known = {one["key"]: one for one in before}
    pairs = [(known[one["key"]], one) for one in again]
    rules: dict[str, Callable[[Line], bool]] = {"right": is_right, "alone but for what is alike": _is_alone}
    rows = []
    for part in ("all", *PARTS):
        own = [pair for pair in pairs if part in ("all", pair[1]["part"])]
        if own:
            same = sum(outcome(one) == outcome(other) for one, other in own)
            cells = [
                rate(sum(rule(pair[time]) for pair in own), len(own)) for rule in rules.values() for time in (0, 1)
            ]
            rows.append([part, str(len(own)), rate(same, len(own)), *cells])
    head = ["part", "sets", "came out the same", *(f"{rule}, {time}" for rule in rules for time in ("then", "now"))]
    text = _TITLE + table(head, rows) + "\nThose that came out otherwise:\n\n"
    changed = [pair for pair in pairs if outcome(pair[0]) != outcome(pair[1])]
    found = [[one["key"], outcome(one), _told(one), outcome(now), _told(now)] for one, now in changed]
    return text + table(["set", "then", "found", "now", "found"], found)


def _is_alone(line: Line) -> bool:
    return is_alone_but_for_alike(line) if outcome(line) in RIGHT else is_right(line)


def _told(line: Line) -> str:
    if line["failed"]:
        return str(line["failed"])
    names = [one["name"] for one in line["found"]]
    unknown = line["unknown"]
    rest = [] if unknown is None else [f"unknown over {', '.join(unknown['depends_on'])}"]
    return f"{' + '.join([*names, *rest]) or 'nothing'} (p = {line['p']:.2g})"


def main() -> None:
    """Run the sample, or write its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--resume", type=Path, default=AGAIN)
    parser.add_argument("--tables", action="store_true", help="write the tables of what is there")
    given = parser.parse_args()
    lines = read_lines(RESULTS)
    if given.tables:
        print(tables(lines, read_lines(given.resume)), end="")
        return
    rows = {one["key"]: int(one["n_rows"]) for one in lines}
    known = done(given.resume)
    sets = {one.key: one for part in PARTS for one in sets_of(part)}
    tasks = [Task(sets[key], rows[key], True) for key in sample(lines, given.sets) if key not in known]
    keep(given.resume, run, tasks, given.jobs, lambda _, line: print(summary(line), flush=True))


if __name__ == "__main__":
    main()
