"""A small farm, whose machines are plain arithmetic."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geoerr.farm import Recipe

MACHINE = '[machine]\nname = "mill"\nchain = "wbXYZt"\n' + "".join(
    f"[axes.{a}]\nrange = [0.0, 200.0]\n" for a in "xyz"
)
# The play is what `diagnose` is left to find.
RECIPE = Recipe(steps=("fit", "diagnose", "compensate"), components="none", effects=("scale:x",))
PROGRAM = "G21\nG90\nG0 X10 Y10 Z20\nG1 X150 Y10 F1200\nG1 X150 Y150\n"


def write_machine(folder: Path, number: int) -> None:
    """A mill with 5 µm more play than the one before, measured on a diagonal, there and back five times."""
    rng = np.random.default_rng(number)
    way = np.linspace(5.0, 195.0, 9)
    rows = ["line,repeat,carrier,x,y,z,dir_x,dir_y,dir_z,mx,my,mz"]
    for repeat in range(5):
        for sense, places in ((1, way), (-1, way[::-1])):
            for q in places:
                error = np.array([40e-6 * q - 0.0025 * (number + 1) * sense, 0.0, 0.0]) + rng.normal(0.0, 1e-3, 3)
                numbers = [*[q] * 3, *[sense] * 3, *(q + error)]
                rows.append(f"d,{repeat},relative," + ",".join(f"{value:.6g}" for value in numbers))
    (folder / "programs").mkdir(parents=True)
    (folder / "machine.toml").write_text(MACHINE)
    (folder / "observations.csv").write_text("\n".join(rows) + "\n")
    (folder / "programs" / "corner.gcode").write_text(PROGRAM)


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def peak_mb() -> float:
    """The most memory that this process has had, MB; Linux counts what it was begun by with no process but this."""
    (line,) = (one for one in Path("/proc/self/status").read_text().splitlines() if one.startswith("VmHWM:"))
    return float(line.split()[1]) / 1e3


def put(files: dict[str, bytes], folder: Path) -> None:
    """Write files by name below a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def write_farm(folder: Path) -> Path:
    """Four machines, the last of which has two programs."""
    for number in range(4):
        write_machine(folder / f"mill-{number}", number)
    (folder / "mill-3" / "square.nc").write_text(PROGRAM + "G1 X10 Y150\nG1 X10 Y10\n")
    return folder
