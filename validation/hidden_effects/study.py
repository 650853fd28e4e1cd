"""Study hidden effects: does a diagnosis name what is missing, and only that.

    python -m validation.hidden_effects.study                       # everything, on the study's seeds; many hours
    python -m validation.hidden_effects.study --part nulls --seeds 5 --rows 2000 --development
    python -m validation.hidden_effects.tables validation/hidden_effects_sets.jsonl      # the tables

Every set is generated, fitted as a user would (21 components, their freedom chosen by the data: `FitOptions()`), and
diagnosed; it becomes one line of a file of results. A run that was cut goes on where it stopped. Results are the
same for any number of processes, but for the seconds that they took.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

# Before NumPy is loaded, here and in the processes that are started: sets run beside each other, not threads in one.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

from validation.hidden_effects.record import finite, kept, record
from validation.hidden_effects.sets import PARTS, Set, sets_of

T, R = TypeVar("T"), TypeVar("R")
RESULTS = Path(__file__).parents[1] / "hidden_effects_sets.jsonl"
# Of each number of a line: thousands lie beside the tables.
_DIGITS = 9


@dataclass(frozen=True)
class Task:
    """A set, and how to run it."""

    one: Set
    n_rows: int
    is_study: bool


def run(task: Task) -> dict[str, Any]:
    """Run one set."""
    line = finite(kept(record(task.one, task.n_rows, is_study=task.is_study)), _DIGITS)
    return {**line, "n_rows": task.n_rows}


def done(path: Path) -> set[str]:
    """Give the keys of the results that a file holds; a line that was cut short is none."""
    keys = set()
    if path.exists():
        for text in path.read_text(encoding="utf-8").splitlines():
            with suppress(json.JSONDecodeError):
                keys.add(str(json.loads(text)["key"]))
    return keys


def in_processes(run_one: Callable[[T], R], tasks: Sequence[T], n_jobs: int) -> Iterator[R]:
    """Run tasks beside each other, and give the results as they come."""
    if n_jobs == 1:
        yield from map(run_one, tasks)
        return
    # A process of its own for each job, started clean; none outlives this one, however it ends.
    with multiprocessing.get_context("spawn").Pool(n_jobs, _begin, (os.getpid(),)) as pool:
        yield from pool.imap_unordered(run_one, tasks)


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def keep(
    path: Path,
    run_one: Callable[[T], dict[str, Any]],
    tasks: Sequence[T],
    n_jobs: int,
    tell: Callable[[int, dict[str, Any]], None],
) -> None:
    """Run tasks beside each other, and add their lines to a file as they come; `tell` hears of each, with its number.

    Told to end it keeps what is done, and the same call without what is known goes on from there.
    """
    with stop_on_signals(), path.open("a", encoding="utf-8") as file:
        for number, line in enumerate(in_processes(run_one, tasks, n_jobs), start=1):
            file.write(json.dumps(finite(line), ensure_ascii=False, allow_nan=False) + "\n")
            file.flush()
            tell(number, line)


@contextmanager
def stop_on_signals() -> Iterator[None]:
    """End in good order when told to: what is running is dropped, what is done is kept."""
    signal.signal(signal.SIGTERM, _stop)
    try:
        yield
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on from here")


def _stop(_: int, __: FrameType | None) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=PARTS, action="append", help="all parts, if not given; may be repeated")
    parser.add_argument("--seeds", type=int, help="sets of each cell (default: what the tables ask for)")
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--kind", action="append", default=[], help="only this kind of effect or noise; repeatable")
    parser.add_argument("--strength", type=float, action="append", default=[], help="only this strength; repeatable")
    parser.add_argument("--development", action="store_true", help="seeds to develop with, not those of the study")
    parser.add_argument("--resume", type=Path, default=RESULTS, help="file of results; what is in it is not run")
    parser.add_argument("--verbose", action="store_true", help="say what came out of each set")
    given = parser.parse_args()
    known = done(given.resume)
    tasks = [
        Task(one, given.rows, not given.development)
        for part in given.part or PARTS
        for one in sets_of(part, given.seeds, given.kind)
        if one.key not in known and (not given.strength or one.strength_um in given.strength)
    ]
    print(f"{len(tasks)} sets to run, {len(known)} known", flush=True)

    def tell(number: int, line: dict[str, Any]) -> None:
        if given.verbose:
            print(number, summary(line), flush=True)

    keep(given.resume, run, tasks, given.jobs, tell)


def summary(line: dict[str, Any]) -> str:
    """Say in one line what came out."""
    where = f"{line['key']} {line.get('plan', '')} {line.get('chain', '')} {line['noise']}"
    if line["failed"]:
        return f"{where}: {line['failed']}"
    truth = " + ".join(str(one["name"] or ",".join(one["variables"])) for one in line["truth"]) or "nothing"
    found = " + ".join(one["name"] for one in line["found"])
    tied = [one["name"] for one in line["candidates"][1:] if one["tied"]]
    unknown = line["unknown"]
    rest = "" if unknown is None else f" unknown {unknown['component']}({','.join(unknown['depends_on'])})"
    seconds = f"{line['cpu_seconds']['fit']:.2f}+{line['cpu_seconds']['diagnose']:.2f} s"
    return f"{where}: {truth} -> {line['verdict']} p={line['p']:.2g} {found}{rest} tied={tied} {seconds}"


if __name__ == "__main__":
    main()
