"""G-code from a file through the model of 21 tables to a file, by the bench `gcode_stream`.

The program is written here: closed walls of short moves, rectilinear infill of long ones, extrusion, travels,
comments. Where the environment's GEOERR_TEST_DATA names a folder with programs of slicers (`gcode/slicers`), those
are measured too.
"""

from __future__ import annotations

import itertools
import math
import os
import random
import re
import resource
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
from race import Costs, Reached, table

from geoerr.error_functions import ErrorFunction, ErrorFunctions, Squareness
from geoerr.machine import AXES, Axis, Machine
from geoerr.model import Model

Array = npt.NDArray[np.float64]

TARGET = Path(os.environ.get("CARGO_TARGET_DIR", Path(__file__).parents[2] / "target"))
BINARY = TARGET / "release" / "gcode_stream"
AIM_MB_PER_S = 300.0
SLICED = {
    "CuraEngine, spiral, relative E": "curaengine413_ender3_spiralize_relE.gcode",
    "PrusaSlicer, absolute E": "prusaslicer250_marlin2_absE.gcode",
}
MAIN = "walls and infill"
IN_THE_WAY = (
    "Of one thread's time an eighth is the system's, which copies the files; a seventh reads: 450 instructions "
    "for the three numbers of a line, its place, its extrusion and its range. A quarter writes: 75 instructions a"
    " number, of which there are three to a line where two came in, as corrections move Z; the choice of words to"
    " write, the place of the machine that runs them, and sums. Two fifths solve: one polynomial of 27 terms for "
    "each end, of which each waits for the one before, and for the tenth of the moves that are long one at each "
    "face of a box on their way and one between two of these; a twentieth makes the boxes. Two threads wait for "
    "each other for a tenth of the time, at the end of each block and while a chunk of the file is taken over."
)

# The machine of `gcode_stream`, as `benches/src/gcode.rs` has it: waves with an entry each 10 mm, Li's squareness.
RANGE_MM = (-20.0, 420.0)
_SQUARENESS_RAD = {"EC0Y": -5.05e-3, "EB0Z": -1.24e-3, "EA0Z": 3.84e-3}
# A piece that ends as near to a move's end is the move's last.
_END_MM = 1e-3
_MOVE = re.compile(r"^G[01] (.*)$", re.MULTILINE)


def why_left_out() -> str:
    """Say why no program can be rewritten, and what to do; nothing where it can."""
    if BINARY.exists():
        return ""
    return f"{BINARY} is not there: cargo build --release -p geoerr-bench --bin {BINARY.name}"


def bent() -> Model:
    """Make the machine anew."""
    machine = Machine("bench", "wZbXYt", {axis: Axis(RANGE_MM) for axis in AXES})
    entries = np.linspace(*RANGE_MM, 45)
    functions = {}
    for number, (axis, component) in enumerate(itertools.product("XYZ", "XYZABC")):
        wave = (0.2 if component in "XYZ" else 1e-3) * (np.sin(entries / 70.0 + number) - np.sin(number))
        functions[f"E{component}{axis}"] = ErrorFunction(entries, wave)
    squareness = {name: Squareness(value) for name, value in _SQUARENESS_RAD.items()}
    return Model(machine, ErrorFunctions(machine, functions, squareness, method="bench"))


def ends_of_moves(text: str) -> Array:
    """Give where straight moves end, (n, 3), from the first that follows a whole position on."""
    at = [math.nan] * 3
    ends = []
    for words in _MOVE.findall(text):
        found = [("XYZ".index(word[0]), float(word[1:])) for word in words.split() if word[0] in "XYZ"]
        for axis, number in found:
            at[axis] = number
        if found and not any(map(math.isnan, at)):
            ends.append(tuple(at))
    return np.array(ends)


def closeness_um(model: Model, before: str, after: str) -> tuple[float, float]:
    """Give by how much, at most, the machine that runs the written moves misses the meant ends, and the meant lines.

    Lines are held against eleven places of each written move.
    """
    meant, written = ends_of_moves(before), ends_of_moves(after)
    actual = written + model.error_mm(written)
    owner, last = np.empty(len(written), dtype=np.int64), []
    to = 0
    for piece, place in enumerate(actual):
        owner[piece] = to
        if to < len(meant) and math.dist(place, meant[to]) < _END_MM:
            last.append(piece)
            to += 1
    if to != len(meant) or last[-1] != len(written) - 1:
        raise ValueError(f"{len(meant)} moves, of which the written ones reach {to}")
    ends_mm = np.linalg.norm(actual[last] - meant, axis=1)
    shares = np.linspace(0.0, 1.0, 11)[:, None, None]
    command = (written[:-1] + shares * (written[1:] - written[:-1])).reshape(-1, 3)
    on_the_way = (command + model.error_mm(command)).reshape(11, -1, 3)
    begin, along = meant[owner[1:] - 1], (meant[owner[1:]] - meant[owner[1:] - 1])
    length_2 = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((on_the_way - begin) * along).sum(axis=2) / length_2, 0.0, 1.0)
    path_mm = np.linalg.norm(on_the_way - begin - share[:, :, None] * along, axis=2)
    return 1e3 * float(ends_mm.max()), 1e3 * float(path_mm.max())


# What a plain loop moves a point by along each axis: one table of errors each, with an entry each 10 mm.
_ENTRIES_MM = [0.01 * math.sin(0.3 * entry) for entry in range(32)]
_AXIS_WORD = re.compile(r"([XYZ])(-?[0-9.]+)")


def _looked_up(word: re.Match[str]) -> str:
    at = min(max(float(word[2]) / 10.0, 0.0), 30.0)
    entry = int(at)
    share = at - entry
    error = (1.0 - share) * _ENTRIES_MM[entry] + share * _ENTRIES_MM[entry + 1]
    return f"{word[1]}{float(word[2]) - error:.3f}"


def plain_loop(source: Path, target: Path) -> None:
    """Correct a program as a short script does: numbers by their axis' own table, moves and extrusion as they are."""
    with source.open() as lines, target.open("w") as out:
        for line in lines:
            out.write(_AXIS_WORD.sub(_looked_up, line) if line[:2] in ("G0", "G1") else line)


def seconds_of(work: Callable[[], object], repeats: int) -> float:
    """Give the median wall seconds of several calls."""
    samples = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        samples.append(time.perf_counter() - start)
    return statistics.median(samples)


def program(n_bytes: int) -> str:
    """Layers of three round walls of 220 moves and one infill of lines of 50 mm, in places drawn by a fixed seed."""
    draw = random.Random(1)
    parts = ["G21\nG90\nM83\nG28\nG1 Z5 F1200\nG1 X100 Y100 F6000\n"]
    size, layer = len(parts[0]), 0
    while size < n_bytes:
        z = 0.2 + 0.2 * (layer % 900)
        lines = [f";LAYER:{layer}", f"G1 Z{z:.2f} F720"]
        x0, y0 = 60 + 120 * draw.random(), 60 + 120 * draw.random()
        for wall in range(3):
            at = [(30 - 0.45 * wall + 3 * math.sin(5 * turn)) for turn in (2 * math.pi * k / 220 for k in range(221))]
            corners = [
                (x0 + r * math.cos(2 * math.pi * k / 220), y0 + r * math.sin(2 * math.pi * k / 220))
                for k, r in enumerate(at)
            ]
            lines += [
                "G1 E-.8 F2400",
                f"G0 X{corners[0][0]:.3f} Y{corners[0][1]:.3f} F9000",
                "G1 E.8 F2400",
                "G1 F1800",
            ]
            lines += [
                f"G1 X{x:.3f} Y{y:.3f} E{0.0333 * math.dist((x, y), before):.5f}"
                for before, (x, y) in itertools.pairwise(corners)
            ]
        lines += [f"G0 X{x0 - 25:.3f} Y{y0 - 25:.3f} F9000", "G1 F3600"]
        for k in range(100):
            side, y = x0 + (25 if k % 2 == 0 else -25), y0 - 25 + 0.5 * k
            lines += [f"G1 X{side:.3f} Y{y:.3f} E1.66500", f"G1 X{side:.3f} Y{y + 0.5:.3f} E.01665"]
        text = "\n".join(lines) + "\n"
        parts.append(text)
        size += len(text)
        layer += 1
    return "".join(parts)


def run(source: Path, target: Path, threads: int, n_times: int = 1) -> tuple[float, float, float]:
    """Give processor seconds, wall seconds as the program says, and its largest memory in MB.

    With `n_times` the source is read so many times over, as one stream.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [str(BINARY), str(source), str(target), "tables", "klipper", str(n_times)]
    environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
    largest_kb = 0
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        # What the system tells after a process has ended counts the memory of the one that started it.
        status = Path(f"/proc/{process.pid}/status")
        while process.poll() is None:
            found = re.search(r"VmHWM:\s*(\d+) kB", status.read_text()) if status.exists() else None
            largest_kb = max(largest_kb, int(found[1]) if found else 0)
            time.sleep(0.005)
        said = process.stdout.read() if process.stdout else ""
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = re.search(r"([0-9.]+) s", said)
    if process.returncode != 0 or seconds is None:
        raise RuntimeError(f"{BINARY.name} ended with {process.returncode} and said {said!r}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu, float(seconds[1]), largest_kb / 1024.0


def cost(source: Path, target: Path, *, threads: int, repeats: int) -> tuple[float, float, float]:
    """Give the medians of several runs."""
    runs = [run(source, target, threads) for _ in range(repeats)]
    cpu, wall, memory = (statistics.median(column) for column in zip(*runs, strict=True))
    return cpu, wall, memory


def measure(sizes_mb: tuple[int, ...], repeats: int) -> tuple[str, Costs, list[Reached]]:
    """Give the text of the results, the costs against size, and rows for the summary."""
    costs = Costs("G-code", "byte")
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "out.gcode"
        cases: dict[str, Path] = {}
        for megabytes in sizes_mb:
            cases[f"{MAIN}, {megabytes} MB"] = Path(folder) / f"{megabytes}.gcode"
            cases[f"{MAIN}, {megabytes} MB"].write_text(program(megabytes * 1_000_000))
        data = os.environ.get("GEOERR_TEST_DATA")
        if data:
            sliced = {name: Path(data) / "gcode" / "slicers" / file for name, file in SLICED.items()}
            cases |= {name: path for name, path in sliced.items() if path.exists()}
        for name, source in cases.items():
            n_bytes = source.stat().st_size
            cpu, _, memory = cost(source, target, threads=1, repeats=repeats)
            cpu_two, wall, _ = cost(source, target, threads=2, repeats=repeats)
            if name.startswith(MAIN):
                copied = seconds_of(partial(shutil.copyfile, source, target), repeats)
                costs.add(
                    n_bytes, {"geoerr, one thread": cpu, "geoerr, two threads": cpu_two, "limit: copied": copied}
                )
                last = (name, n_bytes, wall, cpu, memory, copied)
            rows.append(
                [
                    name,
                    f"{n_bytes / 1e6:.1f}",
                    f"{n_bytes / cpu / 1e6:.0f}",
                    f"{n_bytes / wall / 1e6:.0f}",
                    f"{memory:.0f}",
                ]
            )
        least = min(sizes_mb)
        small = cases[f"{MAIN}, {least} MB"]
        run(small, target, 1)
        ends_um, path_um = closeness_um(bent(), small.read_text(), target.read_text())
        of_a_loop = small.stat().st_size / seconds_of(partial(plain_loop, small, target), 1) / 1e6
    name, n_bytes, wall, cpu, memory, copied = last
    two_threads = n_bytes / wall / 1e6
    summary = [
        Reached(
            path=f"G-code, {name}",
            reached=f"{two_threads:.0f} MB/s on two threads",
            aim=f"{AIM_MB_PER_S:.0f}",
            share_of_aim=two_threads / AIM_MB_PER_S,
            accuracy=(
                f"ends within {ends_um:.2f} µm, paths within {path_um:.2f}; {n_bytes / cpu / 1e6:.0f} MB per "
                f"processor second on one thread; {memory:.0f} MB of memory"
            ),
            peer=f"Python loop, one table an axis, moves as they are: {of_a_loop:.1f} MB/s",
            times_peer=two_threads / of_a_loop,
            share_of_limit=copied / wall,
            in_the_way=IN_THE_WAY,
        )
    ]
    heads = ["program", "MB", "MB per CPU s, one thread", "MB/s, two threads, wall", "memory, MB"]
    note = (
        "Full model of 21 tables with an entry each 10 mm, corrections of up to 1.5 mm, tolerance 5 µm. The machine "
        f"that runs what was written of the {least} MB ends its moves within {ends_um:.2f} µm of where they were "
        f"meant to end, and stays within {path_um:.2f} µm of their lines, at eleven places of each; `cargo bench -p "
        "geoerr-bench --bench gcode` asserts the like of other programs.\n\n"
    )
    return note + table(heads, rows), costs, summary
