"""All benches that go through Python, in one run: writes `benches/RESULTS.md` and `benches/cost.svg`.

    python benches/python/results.py [--quick] [--to FOLDER]

Every path runs on one thread unless its row says otherwise, beside its peers in the same process and the same rounds.
G-code needs the bench's program: `cargo build --release -p geoerr-bench --bin gcode_stream`. Peers that are not
installed are left out. `--quick` takes few sizes and rounds, for a look that is not to be kept.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import lines
import markers
import programs
import straightness
import triangulation
from plot import plot
from race import Costs, Reached, table

# Read when NumPy and the core are loaded: the script begins again with them. The last two keep memory that was given
# back for the next call, for all paths alike: else every other result would be made in pages that the kernel has to
# clear first.
SETTINGS = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "RAYON_NUM_THREADS": "1",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 40),
    "MALLOC_MMAP_THRESHOLD_": str(1 << 30),
}
FOLDER = Path(__file__).parents[1]
CONDITIONS = """\
Written by `python benches/python/results.py`. Medians of processor seconds, every path in turn in the same rounds;
{machine}, {cores} cores that others used too, {versions}.
Limits are what memory allows: the same bytes copied or summed by NumPy. Memory that is given back is kept for the
next call, for all paths alike.
"""
PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "opencv-python-headless", "opencv-python", "numba")
# The script, on how many threads, and what is said of it.
OTHERS = {
    "Least squares, 30,000 × 300": (
        "least_squares.py",
        ("1",),
        "Aim: 60 × `scipy.optimize.least_squares`; with rank and covariance no slower than NumPy's `lstsq`.",
    ),
    "Joint fit of 21 spline functions": (
        "joint_fit.py",
        ("1",),
        "Points all over a volume, three numbers each; from the table to coefficients, covariance and rank.",
    ),
    "Diagnosis": (
        "diagnosis.py",
        ("1", "2"),
        "10,000 points in five sessions, three temperature columns; 119 draws of noise. Aims on two threads: a "
        "ranking in 0.2 s, an add in 0.3 s. Half of a ranking is products of matrices, the rest formulas and sums by "
        "block. An add has the bases that the search chose; half of it is the held-out error.",
    ),
}


def versions() -> str:
    """Tell what was measured with what."""
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join([f"Python {platform.python_version()}", *found])


def summary_table(summary: Sequence[Reached]) -> str:
    """Lay out what was reached beside what was aimed at."""
    heads = ["path", "reached", "aim", "best peer here", "its time, geoerr = 1", "of the limit", "accuracy"]
    rows = [
        [
            row.path,
            row.reached,
            row.aim,
            row.peer,
            "" if row.times_peer is None else f"{row.times_peer:.1f}",
            "" if row.share_of_limit is None else f"{row.share_of_limit:.0%}",
            row.accuracy,
        ]
        for row in summary
    ]
    return table(heads, rows)


def shortfalls(summary: Sequence[Reached]) -> str:
    """Tell what stands in the way of the rows that did not reach what they aim at."""
    short = [row for row in summary if row.share_of_aim < 1.0]
    if not short:
        return ""
    lines_of = [f"- **{row.path}**, {row.share_of_aim:.0%} of the aim. {row.in_the_way}\n" for row in short]
    return "\n## What stands in the way\n\nFrom profiles of the rows that fall short.\n\n" + "".join(lines_of)


def main() -> None:
    """Measure and write."""
    if any(os.environ.get(name) != value for name, value in SETTINGS.items()):
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **SETTINGS})
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few sizes and rounds")
    parser.add_argument("--to", type=Path, default=FOLDER, help="folder of RESULTS.md and cost.svg")
    arguments = parser.parse_args()
    seconds = 0.2 if arguments.quick else 2.0
    powers = (3, 5) if arguments.quick else (3, 4, 5, 6)
    sections: dict[str, str] = {}
    all_costs: list[Costs] = []
    summary: list[Reached] = []

    def keep(title: str, found: tuple[str, Costs, list[Reached]]) -> None:
        sections[title], costs, rows = found
        all_costs.append(costs)
        summary.extend(rows)
        print(sections[title], flush=True)

    keep("Triangulation", triangulation.measure(tuple(10**power for power in powers), seconds))
    fewer = (10, 10_000) if arguments.quick else (10, 100, 1000, 10_000, 100_000)
    keep("Lines", lines.measure(fewer, seconds))
    keep("Straightness", straightness.measure(fewer, seconds))
    sections["Markers"], rows = markers.measure(seconds)
    summary.extend(rows)
    print(sections["Markers"], flush=True)
    if programs.BINARY.exists():
        keep("G-code", programs.measure((1, 10) if arguments.quick else (1, 10, 100), 1 if arguments.quick else 5))
    if not arguments.quick:
        for title, (script, threads, note) in OTHERS.items():
            run = [sys.executable, str(Path(__file__).parent / script), "--threads", *threads]
            sections[title] = f"{note}\n\n{subprocess.run(run, capture_output=True, text=True, check=True).stdout}"
            print(sections[title], flush=True)
    plot(all_costs, arguments.to / "cost.svg")
    (arguments.to / "RESULTS.md").write_text(
        f"# Results\n\n{CONDITIONS.format(cores=os.cpu_count(), machine=platform.machine(), versions=versions())}\n"
        f"{summary_table(summary)}\n![Cost against size](cost.svg)\n{shortfalls(summary)}"
        + "".join(f"\n## {title}\n\n{body}" for title, body in sections.items())
    )


if __name__ == "__main__":
    main()
