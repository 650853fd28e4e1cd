"""Machines that stand in for yours: `python examples/virtual_machines.py NAME FOLDER` writes what one shows.

Each has errors that we know because we put them in, by arithmetic that a page can hold and geoerr has no part in.
The names: circles, warm-mill, spool-printer, laser, printers.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

MACHINE = """\
[machine]
name = "{name}"
chain = "{chain}"
[axes.x]
range = [0.0, 400.0]
material = "steel"
[axes.y]
range = [0.0, 400.0]
material = "steel"
[axes.z]
range = [0.0, 300.0]
material = "steel"
"""
SQUARE = "G21\nG90\nG0 X50 Y50 Z20\nG1 X350 Y50 F1200\nG1 X350 Y350\nG1 X50 Y350\nG1 X50 Y50\n"
# x, y and z of the two ends of the lines that `warm-mill` and `spool-printer` are measured on.
LINES = {
    "x front": ((0, 50, 40), (400, 50, 40)),
    "x back": ((0, 350, 260), (400, 350, 260)),
    "y left": ((60, 0, 200), (60, 400, 200)),
    "y right": ((340, 0, 60), (340, 400, 60)),
    "z": ((200, 200, 0), (200, 200, 300)),
    "diagonal": ((0, 0, 0), (400, 400, 300)),
    "other diagonal": ((400, 0, 0), (0, 400, 300)),
}


def main(name: str, folder: Path) -> None:
    """Write machine.toml and measurements of the machine `name` into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    MAKERS[name](folder)


def circles(folder: Path) -> None:
    """Write a ball-bar test of a mill, 100 mm, both senses at two feeds.

    X has 14 µm of play, X and Y stand 40 µrad off the square, and the Y drive follows 0.4 ms later than X.
    """
    rng = np.random.default_rng(2)
    play_mm, squareness_rad, later_s, radius_mm = 0.014, 40e-6, 0.4e-3, 100.0
    rows, t = [], 0.0
    for sense, feed in [(1, 1000), (-1, 1000), (1, 4000), (-1, 4000)]:
        # No sample lies on a reversal, where the direction is neither.
        angle = sense * (np.linspace(0.0, 2.0 * np.pi, 181) + np.pi / 180.0)
        speed = feed / 60.0
        seconds = abs(angle - angle[0]) * radius_mm / speed
        x, y = radius_mm * np.cos(angle), radius_mm * np.sin(angle)
        speed_x, speed_y = -sense * speed * np.sin(angle), sense * speed * np.cos(angle)
        error_x = -0.5 * play_mm * np.sign(speed_x) - squareness_rad * y
        error_y = -later_s * speed_y
        r = radius_mm + (error_x * x + error_y * y) / radius_mm + rng.normal(0.0, 0.5e-3, len(angle))
        for k in range(len(angle)):
            rows.append(("bar", 200 + x[k], 200 + y[k], 50.0, r[k], sense, feed, t + seconds[k]))
        t += seconds[-1] + 20.0
    _write_machine(folder, "mill", "wbXYZt")
    _write_table(folder / "circle.csv", ("line", "x", "y", "z", "r", "dir", "feed", "t"), rows)


def warm_mill(folder: Path) -> None:
    """Write a mill that is measured while its bed warms and cools again, tool against work, to 2 µm.

    Y grows as steel does with `temp_bed`, held at y = 50; X has 16 µm of play; X and Y stand 60 µrad off the square.
    """
    rng = np.random.default_rng(5)
    q, d, line, repeat = _there_and_back(5)
    t = 8.0 * np.arange(len(q))
    warm = 25.0 * (1.0 - np.exp(-np.minimum(t, 2200.0) / 900.0))
    bed = np.round(20.0 + warm * np.exp(-np.maximum(t - 2200.0, 0.0) / 900.0), 1)
    error = np.zeros_like(q)
    error[:, 0] = 30e-6 * q[:, 0] - 0.5 * 0.016 * d[:, 0] - 60e-6 * q[:, 1]
    error[:, 1] = 11.5e-6 * (bed - 20.0) * (q[:, 1] - 50.0) + 0.012 * np.sin(q[:, 1] / 130.0)
    error[:, 2] = -20e-6 * q[:, 2]
    seen = q + error + rng.normal(0.0, 2e-3, q.shape)
    _write_machine(folder, "mill", "wbXYZt")
    _write_points(folder / "observations.csv", line, repeat, q, d, seen, t=t, temp_bed=bed)


def spool_printer(folder: Path) -> None:
    """Write a printer whose spool hangs on the gantry: X sags under what is left of the filament, 2 µm of noise.

    `spool` is its mass, kg: it is changed between repeats.
    """
    rng = np.random.default_rng(8)
    q, d, line, repeat = _there_and_back(4)
    spool = np.array([1.2, 0.4, 0.9, 0.1])[repeat]
    error = np.zeros_like(q)
    error[:, 0] = 50e-6 * q[:, 0]
    error[:, 1] = -35e-6 * q[:, 1]
    error[:, 2] = -1.1e-6 * spool * q[:, 0] * (400.0 - q[:, 0])
    seen = q + error + rng.normal(0.0, 2e-3, q.shape)
    _write_machine(folder, "printer", "wZbXYt")
    _write_points(folder / "observations.csv", line, repeat, q, d, seen, t=8.0 * np.arange(len(q)), spool=spool)


def laser(folder: Path) -> None:
    """Write what a laser interferometer sees of X: one component, along the beam, there and back five times.

    The screw of 5 mm lead is 80 µm/m too long and wobbles by 3 µm once a turn; 9 µm of play; 0.3 µm of noise.
    """
    rng = np.random.default_rng(3)
    # Uneven steps, as ISO 230-2 wants them: even ones show a wave at a period that it does not have.
    there = np.round(np.linspace(0.0, 400.0, 55) + np.append(rng.uniform(0.0, 5.0, 54), 0.0), 2)
    rows = []
    for repeat in range(5):
        for sense, positions in ((1, there), (-1, there[::-1])):
            for x in positions:
                error = 80e-6 * x + 0.003 * np.sin(2.0 * np.pi * x / 5.0) - 0.5 * 0.009 * sense
                rows.append(("x", repeat, "relative", x, 200.0, 100.0, sense, x + error + rng.normal(0.0, 3e-4)))
    _write_machine(folder, "mill", "wbXYZt")
    names = ("line", "repeat", "carrier", "x", "y", "z", "dir_x", "mx")
    _write_table(folder / "laser.csv", names, rows)


def printers(folder: Path) -> None:
    """Write six printers, a folder each, with a program each; 2 µm of noise.

    X of the n-th is 10 n µm/m too long, and every third has 8 + n µm of play. The fourth's table lost its columns.
    """
    for n in range(1, 7):
        own = folder / f"printer-{n}"
        (own / "programs").mkdir(parents=True, exist_ok=True)
        rng = np.random.default_rng(n)
        q, d, line, repeat = _there_and_back(2)
        error = np.zeros_like(q)
        error[:, 0] = 10e-6 * n * q[:, 0] - (0.5e-3 * (8 + n) * d[:, 0] if n % 3 == 0 else 0.0)
        _write_machine(own, own.name, "wZbXYt")
        seen = q + error + rng.normal(0.0, 2e-3, q.shape)
        _write_points(own / "observations.csv", line, repeat, q, d, seen, t=8.0 * np.arange(len(q)))
        (own / "programs" / "square.gcode").write_text(SQUARE, encoding="utf-8")
    (folder / "printer-4" / "observations.csv").write_text("line,repeat,x,y,z\n", encoding="utf-8")


MAKERS: dict[str, Callable[[Path], None]] = {
    "circles": circles,
    "warm-mill": warm_mill,
    "spool-printer": spool_printer,
    "laser": laser,
    "printers": printers,
}


def _there_and_back(n_repeats: int) -> tuple[np.ndarray, np.ndarray, list[str], np.ndarray]:
    """Give positions and directions on all lines, eight points a line, and to which line and repeat they belong."""
    q, d, lines, repeats = [], [], [], []
    for repeat in range(n_repeats):
        for name, ends in LINES.items():
            start, end = (np.array(one, dtype=float) for one in ends)
            way = np.linspace(start, end, 8)
            for sense, places in ((1.0, way), (-1.0, way[::-1])):
                # An axis that stands still on this line came from below.
                moved = sense * np.sign(end - start)
                q += list(places)
                d += [np.where(moved == 0.0, 1.0, moved)] * len(places)
                lines += [name] * len(places)
                repeats += [repeat] * len(places)
    return np.array(q), np.array(d), lines, np.array(repeats)


def _write_machine(folder: Path, name: str, chain: str) -> None:
    (folder / "machine.toml").write_text(MACHINE.format(name=name, chain=chain), encoding="utf-8")


def _write_points(
    path: Path,
    line: list[str],
    repeat: np.ndarray,
    q: np.ndarray,
    d: np.ndarray,
    seen: np.ndarray,
    **covariates: np.ndarray,
) -> None:
    names = ("line", "repeat", "carrier", "x", "y", "z", "dir_x", "dir_y", "dir_z", "mx", "my", "mz", *covariates)
    numbers = zip(*covariates.values(), strict=True)
    rows = [(line[k], repeat[k], "relative", *q[k], *d[k], *seen[k], *others) for k, others in enumerate(numbers)]
    _write_table(path, names, rows)


def _write_table(path: Path, names: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(names)
        for row in rows:
            writer.writerow(f"{value:.6g}" if isinstance(value, float) else value for value in row)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in MAKERS:
        sys.exit(f"usage: python {sys.argv[0]} {'|'.join(MAKERS)} FOLDER")
    main(sys.argv[1], Path(sys.argv[2]))
