"""Cost and memory against size, up to sizes that hardly anybody has: writes `benches/SCALING.md` and `scaling.svg`.

    python benches/python/scaling.py [--quick] [--to FOLDER] [--path NAME ...]

Every size of every path runs in a process of its own, on one thread; the process says what its work took and the
largest memory that it held beyond its input, its result included. Work is done once before it is timed, but for what
takes long: memory that is given back is kept for the next call, as in `results.py`. G-code needs the bench's program,
as that does, and its largest sizes are one program over and over in one stream; frames are twelve pairs of small
pictures over and over. An exponent compares the last two sizes: 1 is proportional, above it cost grows faster than
size. A size that would not fit into the memory that is free is left out and named. Half an hour; `--quick` takes a
minute. With `--path` the rows of the others stay as an earlier run left them.
"""

from __future__ import annotations

import argparse
import ctypes
import itertools
import json
import math
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from unittest import mock

import diagnosis
import joint_fit
import lines
import numpy as np
import numpy.typing as npt
import programs
import straightness
import triangulation
from plot import plot
from race import Costs, table
from results import FOLDER, SETTINGS, versions
from small_session import repeated_session

from geoerr.diagnose.search import look
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import FitOptions, fit_terms, result_of
from geoerr.geometry import fit_lines, integrate_straightness, triangulate
from geoerr.machine import AXES, Axis, Machine
from geoerr.observations import read_observations, write_observations
from geoerr.terms import BasisSpec
from geoerr.vision.images import read_grey
from geoerr.vision.measure import measure
from geoerr.vision.measured import write_measured
from geoerr.vision.rig import read_rig
from geoerr.vision.session import read_session

Work = Callable[[], object]
# Short work is done again for so long, and its median counts; what takes longer than that is timed at once.
_REPEATED_FOR_S = 0.5
_LONG_S = 5.0
_MOST_REPEATS = 25
_PROGRAM_BYTES = 100_000_000
# Of the free memory: what one size may be expected to take.
_MOST_OF_FREE = 0.8
POINTS_OF_A_SESSION = 20
MACHINE = Machine("bench", "wZbXYt", {axis: Axis((0.0, joint_fit.LENGTH_MM)) for axis in AXES})


def fit_options() -> FitOptions:
    """Give 21 cubic splines of five pieces each."""
    knots = tuple(np.linspace(0.0, joint_fit.LENGTH_MM, 6).tolist())
    bases = {name: BasisSpec("bspline", name[2].lower(), knots_mm=knots, degree=3) for name in LINEAR_AND_ANGULAR}
    return FitOptions(bases=bases, threads=1)


def triangulated(n: int, _folder: Path) -> Work:
    """Lay out pixels of both views to points with covariances."""
    left, right = triangulation.RIGS["200 mm"]
    return partial(triangulate, left, right, *triangulation.pixels((left, right), n, 0.1), threads=1)


def lines_fitted(n: int, _folder: Path) -> Work:
    """Lay out points to lines."""
    starts = np.arange(n) * lines.POINTS_OF_A_LINE
    return partial(fit_lines, lines.points(n).reshape(-1, 3), starts)


def integrated(n: int, _folder: Path) -> Work:
    """Lay out angles to straightness, functions of 50 positions."""
    at = straightness.positions()
    values, _ = straightness.angles(n // len(at), at)
    return partial(integrate_straightness, at, values, "trapezoid")


def fitted(n: int, _folder: Path) -> Work:
    """Lay out a table of points to the 21 functions, with covariance and rank."""
    measured = joint_fit.measured(MACHINE, n, np.random.default_rng(n))
    return partial(fit_terms, MACHINE, [measured], options=fit_options())


def fitted_by_sessions(n: int, _folder: Path) -> Work:
    """Lay out a table of sessions of few points, each with a pose of its own, to the 21 functions."""
    rng = np.random.default_rng(n)
    measured = joint_fit.measured(MACHINE, POINTS_OF_A_SESSION * n, rng, n_sessions=n, n_targets=1)
    return lambda: fit_terms(MACHINE, [measured], options=fit_options()).held_out


def predicted(n: int, _folder: Path) -> Work:
    """Lay out commands to the full model's errors there."""
    rng = np.random.default_rng(1)
    model = result_of(fit_terms(MACHINE, [joint_fit.measured(MACHINE, 2000, rng)], options=fit_options())).model
    return partial(model.error_mm, rng.uniform(0.0, joint_fit.LENGTH_MM, (n, 3)), threads=1)


def table_read(n: int, folder: Path) -> Work:
    """Lay out a table of points, as text, to checked observations."""
    path = folder / "observations.csv"
    write_observations(path, joint_fit.measured(MACHINE, n, np.random.default_rng(n)))
    return partial(read_observations, path)


def ranked(n: int, _folder: Path) -> Work:
    """Lay out what a model leaves to the ranking of all candidates, with what chance finds."""
    bench, candidates = diagnosis.laid_out(n, 1)
    return lambda: look(bench, bench.space([]), candidates, [])


def frames_measured(n: int, folder: Path) -> Work:
    """Lay out pairs of pictures to a table of observations."""
    session = read_session(repeated_session(folder, n))
    rig = read_rig(session.directory / "rig.json")

    numbers = itertools.count()

    def photographed(path: Path) -> npt.NDArray[np.uint8]:
        """Read a picture and number it in a corner: what comes again to the last digit is no second measurement."""
        picture = read_grey(path)
        picture[0, :4] = np.frombuffer(next(numbers).to_bytes(4, "little"), dtype=np.uint8)
        return picture

    def work() -> None:
        with mock.patch("geoerr.vision.frame.read_grey", photographed):
            write_measured(folder / "measured.csv", measure(session, rig, 1))

    return work


@dataclass(frozen=True)
class Scaled:
    """One path: how its work is laid out for a size, what a size counts, and which sizes."""

    make: Callable[[int, Path], Work] | None
    item: str
    sizes: tuple[int, ...]


def powers(first: int, last: int) -> tuple[int, ...]:
    """Give powers of ten from one to the other."""
    return tuple(10**power for power in range(first, last + 1))


GCODE = "G-code, file to file"
PLOT = "![Cost of one against how many](scaling.svg)"
CONDITIONS = """\
Written by `python benches/python/scaling.py`: each size in a process of its own, seconds of one thread;
{machine}, {cores} cores that others used too, {versions}.
Memory is the largest that the work held beyond its input, its result included; of G-code all of its process.
What takes more than {long:g} s is timed at once, in memory that the system clears first: tables and fits of ten
million points have that in their cost. Programs stream. So do pictures: what is kept of a frame is the row that it
gives, and what the checks over all rows need of it.
"""
PATHS = {
    "triangulation, with covariance": Scaled(triangulated, "point", powers(3, 7)),
    "lines of 50 points": Scaled(lines_fitted, "line", powers(1, 5)),
    "straightness, trapezoid": Scaled(integrated, "sample", powers(3, 7)),
    "table of points read, .csv": Scaled(table_read, "point", powers(3, 7)),
    "joint fit of 21 functions": Scaled(fitted, "point", powers(3, 7)),
    "joint fit, 20 points a session": Scaled(fitted_by_sessions, "session", (10, 100, 1000, 5000)),
    "prediction of the full model": Scaled(predicted, "point", powers(3, 7)),
    "ranking of candidates": Scaled(ranked, "point", powers(3, 5)),
    "frames, pictures to table": Scaled(frames_measured, "frame", powers(2, 5)),
    GCODE: Scaled(None, "byte", (*powers(6, 9), 2 * 10**9)),
}


@dataclass(frozen=True)
class Taken:
    """What one size took: seconds of one processor, memory beyond the input, and the input's."""

    size: int
    cpu_s: float
    memory_mb: float
    input_mb: float


def told_mb(name: str, by: str = "/proc/self/status") -> float:
    """Give a line of what the system says of this process, or of the machine, in MB."""
    found = re.search(rf"{name}:\s*(\d+) kB", Path(by).read_text())
    assert found is not None
    return int(found[1]) / 1024.0


def take(name: str, size: int) -> None:
    """Do the work of one size in this process, and print what it took."""
    make = PATHS[name].make
    assert make is not None
    with tempfile.TemporaryDirectory() as folder:
        work = make(size, Path(folder))
        # What making the input left behind is no part of it. The largest memory counts from here on.
        ctypes.CDLL("libc.so.6").malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5")
        before_mb = told_mb("VmRSS")
        seconds = [processor_seconds(work)]
        memory_mb = told_mb("VmHWM") - before_mb
        if seconds[0] < _LONG_S:
            seconds = [processor_seconds(work)]
        while sum(seconds) < _REPEATED_FOR_S and len(seconds) < _MOST_REPEATS:
            seconds.append(processor_seconds(work))
    print(json.dumps({"cpu_s": statistics.median(seconds), "memory_mb": memory_mb, "input_mb": before_mb}))


def processor_seconds(work: Work) -> float:
    """Do some work; gives the processor seconds that it took."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def taken(name: str, size: int) -> Taken:
    """Let a process of its own do the work of one size."""
    command = [sys.executable, __file__, "--take", name, str(size)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{name}, {size}: ended with {done.returncode}\n{done.stderr}")
    return Taken(size, **json.loads(done.stdout.splitlines()[-1]))


def program_taken(size: int) -> Taken:
    """Let the bench's program rewrite so many bytes, the larger as one program over and over."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "in.gcode"
        source.write_text(programs.program(min(size, _PROGRAM_BYTES)))
        n_times = max(1, size // _PROGRAM_BYTES)
        cpu_s, _, memory_mb = programs.run(source, Path(folder) / "out.gcode", threads=1, n_times=n_times)
    return Taken(size, cpu_s, memory_mb, 0.0)


def all_taken(name: str, sizes: Sequence[int]) -> tuple[list[Taken], str]:
    """Give what all sizes took, and in words which were left out."""
    found: list[Taken] = []
    for size in sizes:
        if len(found) > 1 and found[-1].memory_mb > 100.0:
            expected_mb = (found[-1].memory_mb + found[-1].input_mb) * size / found[-1].size
            if expected_mb > _MOST_OF_FREE * told_mb("MemAvailable", "/proc/meminfo"):
                return (
                    found,
                    f"{size:,} left out, which would need some {expected_mb / 1024.0:.0f} GB with its input.",
                )
        found.append(program_taken(size) if name == GCODE else taken(name, size))
        print(name, found[-1], file=sys.stderr, flush=True)
    return found, ""


def exponent(values: Sequence[float], sizes: Sequence[int]) -> float:
    """Give how the last value grew against size: 1 is proportional."""
    return math.log(max(values[-1], 1e-9) / max(values[-2], 1e-9)) / math.log(sizes[-1] / sizes[-2])


def rows(name: str, found: Sequence[Taken]) -> list[list[str]]:
    """Lay out one path, the exponents beside its last size."""
    item = PATHS[name].item
    result = [
        [
            name,
            f"{one.size:,}",
            f"{one.cpu_s:.3g}",
            f"{1e6 * one.cpu_s / one.size:.4g} µs/{item}",
            f"{one.memory_mb:.0f}",
            "",
            "",
        ]
        for one in found
    ]
    if len(found) > 1:
        sizes = [one.size for one in found]
        costs, memories = [one.cpu_s for one in found], [one.memory_mb for one in found]
        result[-1][-2:] = [f"{exponent(values, sizes):.2f}" for values in (costs, memories)]
    return result


def earlier(page: Path) -> dict[str, tuple[list[list[str]], list[str]]]:
    """Give what a page says of each path: its rows, and what was left out; of none where there is no page."""
    lines_of_page = page.read_text().splitlines() if page.exists() else []
    found: dict[str, tuple[list[list[str]], list[str]]] = {}
    for name in PATHS:
        own = [line.strip("|").split("|") for line in lines_of_page if line.startswith(f"| {name} |")]
        left_out = [f"{line}\n" for line in lines_of_page if line.startswith(f"- {name}: ")]
        if own:
            found[name] = [[cell.strip() for cell in cells] for cells in own], left_out
    return found


def costs_of(name: str, body: Sequence[Sequence[str]]) -> Costs:
    """Give the costs that rows tell."""
    sizes_and_seconds = [(int(row[1].replace(",", "")), float(row[2])) for row in body]
    return Costs(name, PATHS[name].item, {"geoerr": {size: 1e9 * cpu_s / size for size, cpu_s in sizes_and_seconds}})


def main() -> None:
    """Measure and write."""
    if not SETTINGS.items() <= os.environ.items():
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **SETTINGS})
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two small sizes of each path")
    parser.add_argument("--to", type=Path, default=FOLDER, help="folder of SCALING.md and scaling.svg")
    parser.add_argument(
        "--path",
        nargs="+",
        choices=sorted(PATHS),
        default=list(PATHS),
        help="these paths alone, beside what is there of the others",
    )
    parser.add_argument("--take", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.take:
        take(arguments.take[0], int(arguments.take[1]))
        return
    # Now, and not when all the others have been measured.
    if GCODE in arguments.path and programs.why_left_out():
        parser.error(f"{GCODE}: {programs.why_left_out()}\nor name the other paths with --path")
    arguments.to.mkdir(parents=True, exist_ok=True)
    heads = ["path", "size", "CPU s", "each", "memory, MB", "cost ~ size^", "memory ~ size^"]
    told = {} if arguments.quick else earlier(arguments.to / "SCALING.md")
    for name in arguments.path:
        scaled = PATHS[name]
        found, why = all_taken(name, scaled.sizes[:2] if arguments.quick else scaled.sizes)
        told[name] = rows(name, found), [f"- {name}: {why}\n"] if why else []
    told = {name: told[name] for name in PATHS if name in told}
    body = [row for own, _ in told.values() for row in own]
    left_out = [line for _, own in told.values() for line in own]
    plot([costs_of(name, own) for name, (own, _) in told.items()], arguments.to / "scaling.svg")
    conditions = CONDITIONS.format(
        machine=platform.machine(), cores=os.cpu_count(), versions=versions(), long=_LONG_S
    )
    text = f"# Cost and memory against size\n\n{conditions}\n{table(heads, body)}\n{''.join(left_out)}\n{PLOT}\n"
    (arguments.to / "SCALING.md").write_text(text)


if __name__ == "__main__":
    main()
