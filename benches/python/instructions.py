"""Instructions of the core's hot paths: the gate against work that creeps in.

    python benches/python/instructions.py            # compare with what was recorded, and fail where there are more
    python benches/python/instructions.py --record   # record what is counted

Seconds rise and fall with what else a machine does; instructions do not. They are counted by Valgrind, on one thread
and with the registers that it knows (AVX2), and are those of one compiler and one C library: counts of others are not
compared, and that is said. What is counted is in `benches/src/bin/instructions.rs`.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from race import table

ROOT = Path(__file__).parents[2]
RECORDED = ROOT / "benches" / "instructions.json"
BINARY = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "instructions"
# More than this share is a regression; hash tables and a worker's first look for work make a thousandth.
ALLOWED = 0.02
# Counts of so many runs, less that of one, divided by their difference: what prepares the runs is not counted.
TIMES = 3
_COUNT = re.compile(r"I\s+refs:\s+([\d,]+)")


def made_by() -> dict[str, str]:
    """Tell whose instructions are counted: copies of memory are the C library's."""

    def version(program: str) -> str:
        said = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout
        return said.split()[1] if program == "rustc" else said.strip()

    libc = " ".join(platform.libc_ver())
    return {"machine": platform.machine(), "libc": libc, "rustc": version("rustc"), "counter": version("valgrind")}


def counted(path: str, times: int) -> int:
    """Count the instructions of so many runs of a path."""
    command = ["valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]
    done = subprocess.run([*command, str(BINARY), path, str(times)], capture_output=True, text=True, check=False)
    count = _COUNT.search(done.stderr)
    if done.returncode or count is None:
        raise SystemExit(f"{path}: {done.stderr.strip()}")
    return int(count[1].replace(",", ""))


def of_one_run(path: str) -> int:
    """Count the instructions of one run of a path."""
    return (counted(path, TIMES) - counted(path, 1)) // (TIMES - 1)


def main() -> None:
    """Count, and record or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help=f"write {RECORDED.relative_to(ROOT)}")
    wants_record = parser.parse_args().record
    if shutil.which("valgrind") is None:
        raise SystemExit("valgrind is not installed: nothing is counted")
    known = json.loads(RECORDED.read_text(encoding="utf-8")) if RECORDED.exists() else {}
    if not wants_record and known.get("made_by") != made_by():
        print(f"instructions were recorded for {known.get('made_by')}, not for {made_by()}: not compared")
        return
    # With the package of the wheel beside it, for its features: what a wheel was built with serves here too.
    packages = ["-p", "geoerr-py", "-p", "geoerr-bench"]
    build = ["cargo", "build", "--release", "--locked", "--quiet", *packages, "--bin", "instructions"]
    subprocess.run(build, cwd=ROOT, check=True)
    paths = subprocess.run([str(BINARY)], capture_output=True, text=True, check=True).stdout.split()
    # Beside each other: what else the machine does changes no count.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        counts = dict(zip(paths, pool.map(of_one_run, paths), strict=True))
    if wants_record:
        RECORDED.write_text(json.dumps({"made_by": made_by(), "counts": counts}, indent=2) + "\n", encoding="utf-8")
        return
    before = known["counts"]
    ratios = {path: count / before.get(path, count) for path, count in counts.items()}
    rows = [[path, f"{before.get(path, 0):,}", f"{counts[path]:,}", f"{ratio:.3f}"] for path, ratio in ratios.items()]
    print(table(["path", "recorded", "now", "ratio"], rows))
    more = [path for path, ratio in ratios.items() if ratio > 1.0 + ALLOWED]
    if more:
        sys.exit(f"more instructions than recorded: {', '.join(more)}\nhint: where that is meant, --record")


if __name__ == "__main__":
    main()
