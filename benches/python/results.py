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
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import lines
import markers
import programs
import straightness
import triangulation
from plot import plot
from race import Costs, Reached, seconds_of_products, table

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
{processor}, {cores} cores, {registers}; {versions}.
Limits are what memory allows: the same bytes copied or summed by NumPy; of G-code, the file copied; of joint fits,
markers and the ranking, their products of matrices alone as fast as NumPy multiplies. Memory that is given back is
kept for the next call, for all paths alike.
"""
PACKAGES = (
    *("numpy", "scipy", "opencv-contrib-python-headless", "opencv-python-headless", "opencv-python"),
    *("numba", "scikit-learn", "lmfit"),
)
# What the core's kernels are compiled for, beside any processor of the kind: they take it where all of it is there.
WIDE = ("avx2", "fma", "bmi1", "bmi2")
# What triangulation is compiled for, too.
WIDEST = (*WIDE, "avx512f", "avx512dq", "avx512vl")
# The script, its options, and what is said of it.
OTHERS = {
    "Least squares, 30,000 × 300": (
        "least_squares.py",
        ("--threads", "1"),
        "Aim: 60 × `scipy.optimize.least_squares`; with rank and covariance no slower than NumPy's `lstsq`.",
    ),
    "Joint fit of 21 spline functions": (
        "joint_fit.py",
        ("--threads", "1"),
        "Aim: 10,000 points for the first time, bases chosen, within 0.5 s. "
        "Points all over a volume, three numbers each; from the table to coefficients, covariance and rank.",
    ),
    "Diagnosis": (
        "diagnosis.py",
        ("--threads", "1", "2", "--points", "10000", "100000", "--peers"),
        "Points in five sessions, three temperature columns; 119 draws of noise. Candidates are laid out and the "
        "noise is fitted once a search, and in no ranking. Gains of a ranking are held against plain NumPy's, of "
        "some candidates. An add has the bases that the search chose; half of it is the held-out error. Peers of the "
        "ranking are handed residual, columns and noise model, draw no chance, and try fewer values; how often they "
        "are right is in [hidden effects beside general-purpose tools](../validation/hidden_effects_peers.md). "
        "SciPy's `least_squares` has the residuals and columns of the model with what was added, and gives no "
        "covariance.",
    ),
}
ELSEWHERE = (
    "In [scaling.svg](scaling.svg), of [SCALING.md](SCALING.md): tables that are read, joint fits, predictions, "
    "rankings and frames, and what is above up to ten million points or two gigabytes.\n"
)
AIM_TIMES_LEAST_SQUARES = 60.0
FIRST_FIT_POINTS, FIRST_FIT_AIM_S = 10_000, 0.5
RANKING = "ranking of names, with what chance finds"
# Steps of a diagnosis on two threads: points, the step, seconds that are aimed at.
AIMS = (
    (10_000, RANKING, 0.2),
    (100_000, RANKING, 2.0),
    (10_000, "add backlash:x", 0.3),
    (10_000, "add thermal-expansion:y@temp_bed", 0.3),
)
IN_A_RANKING = (
    "Of one thread's time a third are products of columns that follow a temperature, at hundreds of values of their "
    "inner parameters, with basis, residual and draws: 11 GFLOP in single precision at 10,000 points, of which "
    "multiplying alone is the limit. A fifth are waves at 1,600 frequencies of each axis, spread on a grid and "
    "transformed, with their sums by block; a seventh is chance, drawn and whitened by its own noise; a tenth judges."
)

IN_AN_ADD = (
    "Half of it are the held-out errors before and after, each of twenty folds from one factorization; a fifth the "
    "products of the two fits' columns, an eighth their residuals and gradients. The rest makes terms, figures and "
    "history of them, spread evenly."
)


# Products of columns that follow a temperature, in single precision.
FLOP_OF_A_RANKING, POINTS_OF_FLOP = 11e9, 10_000


def processor_and_registers() -> tuple[str, str]:
    """Name the processor, and the vector registers in which the core's kernels work on it."""
    cpuinfo = Path("/proc/cpuinfo")
    told = cpuinfo.read_text() if cpuinfo.exists() else ""
    found = {name: re.search(rf"^{name}\s*: (.*)$", told, re.MULTILINE) for name in ("model name", "flags")}
    name = platform.processor() if found["model name"] is None else found["model name"][1]
    kind = platform.machine()
    flags = set() if found["flags"] is None else set(found["flags"][1].split())
    if kind not in ("x86_64", "AMD64"):
        registers = f"vector registers of any {kind}"
    elif not flags:
        registers = "vector registers not known"
    else:
        registers = "kernels in AVX2 + FMA" if flags.issuperset(WIDE) else "kernels in SSE2"
        registers += ", of triangulation and markers in AVX-512" if flags.issuperset(WIDEST) else ""
    return (f"{name} ({kind})" if name not in ("", kind) else kind), registers


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
    lines_of = [
        f"- **{row.path}**, {row.share_of_aim:.0%} of the aim. {row.in_the_way or 'Not profiled.'}\n" for row in short
    ]
    return "\n## What stands in the way\n\nFrom profiles of the rows that fall short.\n\n" + "".join(lines_of)


def cells_of(printed: str) -> list[list[str]]:
    """Give the cells of all rows of the tables that a bench printed."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in printed.splitlines() if "|" in line]


def rows_of_least_squares(printed: str) -> list[Reached]:
    """Give what the joint fit aims at, from what its bench printed of random numbers: the first of its tables."""
    n_rows, n_columns = 30_000, 300
    dgemm = re.search(r"dgemm (\d+) GFLOP/s", printed)
    assert dgemm is not None
    product_s = 1e-9 * n_rows * n_columns**2 / float(dgemm[1])
    cells = cells_of(printed)
    cpu_s: dict[str, float] = {}
    error: dict[str, str] = {}
    for row in cells:
        if row[2:] and re.fullmatch(r"[0-9.]+", row[2]):
            cpu_s.setdefault(row[0], float(row[2]))
            error.setdefault(row[0], row[-1])
    whole, fastest = "geoerr, QR, with covariance", "geoerr, fastest"
    nonlinear = "scipy least_squares, exact Jacobian"
    times = cpu_s[nonlinear] / cpu_s[fastest]
    return [
        Reached(
            path="joint fit, 30,000 × 300, with rank and covariance",
            reached=f"{1e3 * cpu_s[whole]:.0f} ms",
            aim="NumPy's lstsq",
            share_of_aim=cpu_s["numpy lstsq"] / cpu_s[whole],
            accuracy=f"error {error[whole]}; lstsq {error['numpy lstsq']}",
            peer=f"numpy lstsq: {1e3 * cpu_s['numpy lstsq']:.0f} ms",
            times_peer=cpu_s["numpy lstsq"] / cpu_s[whole],
            share_of_limit=2.0 * product_s / cpu_s[whole],
        ),
        Reached(
            path="joint fit, 30,000 × 300, by the path that its condition allows",
            reached=f"{times:.0f} × least_squares",
            aim=f"{AIM_TIMES_LEAST_SQUARES:.0f} ×",
            share_of_aim=times / AIM_TIMES_LEAST_SQUARES,
            accuracy=f"error {error[fastest]}; least_squares {error[nonlinear]}",
            peer=f"{nonlinear}: {cpu_s[nonlinear]:.2f} s",
            times_peer=times,
            share_of_limit=product_s / cpu_s[fastest],
            in_the_way=(
                f"The symmetric product alone, at NumPy's dgemm's speed, is {cpu_s[nonlinear] / product_s:.0f} × as "
                "fast as `least_squares` here. It takes three quarters of the time, at two thirds of that speed, as "
                "NumPy's own `a.T @ a` does; a tenth is the pass over the rows that proves the solution."
            ),
        ),
    ]


def rows_of_joint_fit(printed: str) -> list[Reached]:
    """Give what the first fit aims at, from what its bench printed."""
    cells = {row[1]: row for row in cells_of(printed) if row[0] == str(FIRST_FIT_POINTS)}
    chosen_s, peer_s = float(cells["bases chosen"][3]), float(cells["scipy, bases given"][3])
    return [
        Reached(
            path=f"first fit, {FIRST_FIT_POINTS:,} points, bases chosen",
            reached=f"{chosen_s:.3g} s on one thread",
            aim=f"{FIRST_FIT_AIM_S:g}",
            share_of_aim=FIRST_FIT_AIM_S / chosen_s,
            accuracy=f"coefficients within {cells['scipy, bases given'][6]} std of SciPy's, bases given",
            peer=f"scipy least_squares, bases given: {peer_s:.3g} s",
            times_peer=peer_s / chosen_s,
        )
    ]


def rows_of_diagnosis(printed: str) -> list[Reached]:
    """Give the steps of a diagnosis that aim at something, from what its bench printed."""
    found = {(row[0], row[1], row[2]): row for row in cells_of(printed)}
    multiplied_s = seconds_of_products(FLOP_OF_A_RANKING) / 2.0
    return [_step_of_diagnosis(found, *aim, multiplied_s) for aim in AIMS]


def _step_of_diagnosis(
    found: Mapping[tuple[str, str, str], Sequence[str]], n_points: int, step: str, aim_s: float, multiplied_s: float
) -> Reached:
    of_one, of_two = ({key[2]: row for key, row in found.items() if key[:2] == (str(n_points), n)} for n in "12")
    seconds, is_ranking = float(of_two[step][3]), step == RANKING
    reached = f"{seconds:.3g} s on two threads"
    if is_ranking:
        laid_out, noise = (
            next(float(row[3]) for name, row in of_two.items() if name.startswith(begin))
            for begin in ("candidates laid out", "noise fitted")
        )
        reached += f", without candidates ({laid_out:.3g} s, once) and noise model ({noise:.3g} s)"
    # Peers have one thread; so has geoerr beside them.
    begin = "peer of the ranking: " if is_ranking else f"peer of {step}: "
    peers = sorted(
        (float(row[3]), name.removeprefix(begin)) for name, row in of_one.items() if name.startswith(begin)
    )
    # SciPy is asked beside one thread only; what it says holds for both, whose numbers are the same.
    return Reached(
        path=f"{step}, {n_points:,} points",
        reached=reached,
        aim=f"{aim_s:g}",
        share_of_aim=aim_s / seconds,
        accuracy=of_one[step][5] + (" of NumPy's" if is_ranking else ""),
        peer=", ".join(f"{name}: {peer_s:.3g} s" for peer_s, name in peers),
        times_peer=peers[0][0] / float(of_one[step][3]) if peers else None,
        share_of_limit=multiplied_s / seconds if is_ranking and n_points == POINTS_OF_FLOP else None,
        in_the_way=IN_A_RANKING if is_ranking else IN_AN_ADD,
    )


ROWS_OF = {
    "least_squares.py": rows_of_least_squares,
    "joint_fit.py": rows_of_joint_fit,
    "diagnosis.py": rows_of_diagnosis,
}


def main() -> None:
    """Measure and write."""
    if any(os.environ.get(name) != value for name, value in SETTINGS.items()):
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **SETTINGS})
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few sizes and rounds")
    parser.add_argument("--to", type=Path, default=FOLDER, help="folder of RESULTS.md and cost.svg")
    arguments = parser.parse_args()
    arguments.to.mkdir(parents=True, exist_ok=True)
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
    if programs.why_left_out():
        sections["G-code"] = f"Left out: {programs.why_left_out()}\n"
        print(sections["G-code"], file=sys.stderr, flush=True)
    else:
        keep("G-code", programs.measure((1, 10) if arguments.quick else (1, 10, 100), 1 if arguments.quick else 5))
    if not arguments.quick:
        for title, (script, options, note) in OTHERS.items():
            run = [sys.executable, str(Path(__file__).parent / script), *options]
            printed = subprocess.run(run, capture_output=True, text=True, check=True).stdout
            sections[title] = f"{note}\n\n{printed}"
            print(sections[title], flush=True)
            if script in ROWS_OF:
                summary.extend(ROWS_OF[script](printed))
    plot(all_costs, arguments.to / "cost.svg")
    processor, registers = processor_and_registers()
    conditions = CONDITIONS.format(
        cores=os.cpu_count(), processor=processor, registers=registers, versions=versions()
    )
    (arguments.to / "RESULTS.md").write_text(
        f"# Results\n\n{conditions}\n{summary_table(summary)}\n![Cost against size](cost.svg)\n\n{ELSEWHERE}"
        f"{shortfalls(summary)}" + "".join(f"\n## {title}\n\n{body}" for title, body in sections.items())
    )


if __name__ == "__main__":
    main()
