"""A machine with play in x, measured along lines or by a ball bar: files on disk, and sessions over them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geoerr.machine import Axis, Machine, write_machine
from geoerr.observations import observations_from_columns, write_observations
from geoerr.workbench import wiring
from geoerr.workbench.server import begin_session
from geoerr.workbench.session import Session

LENGTH_MM = 300.0
PLAY_UM = 24.0
NOISE_UM = 2.0
N_LINES, N_POINTS = 40, 12
CIRCLE_MM, BOW_UM, CIRCLE_NOISE_UM, CIRCLE_POINTS = 100.0, 5.0, 0.4, 180
PROGRAM = b"G21\nG90\nG1 X50 Y50 Z50 F2000\nG1 X250 Y50\nG1 X250 Y250\nG1 X50 Y250\nG1 X50 Y50\nM30\n"


def write_scene(folder: Path) -> tuple[Path, Path]:
    """Write machine.toml and observations.csv."""
    rng = np.random.default_rng(5)
    places, senses, lines = [], [], []
    for number in range(N_LINES):
        # Along x, y, z and two diagonals, there and back.
        kind, forward = number // 2 % 5, 1.0 if number % 2 == 0 else -1.0
        moves = [*np.eye(3), np.ones(3), np.array([1.0, -1.0, 1.0])][kind]
        along = forward * moves
        at = np.sort(rng.uniform(5.0, LENGTH_MM - 5.0, N_POINTS))
        own = np.where(along > 0.0, at[:, None], LENGTH_MM - at[:, None])
        places.append(np.where(moves == 0.0, rng.uniform(20.0, 280.0, 3), own))
        senses.append(np.tile(np.where(moves == 0.0, rng.choice([-1.0, 1.0], 3), np.sign(along)), (N_POINTS, 1)))
        lines += [f"L{number}"] * N_POINTS
    q, d = np.concatenate(places), np.concatenate(senses)
    error_um = np.column_stack(
        [0.2 * q[:, 0] - 0.5 * PLAY_UM * d[:, 0], 20.0 * np.sin(q[:, 1] / 90.0), 0.1 * q[:, 2]]
    )
    measured = q + 1e-3 * (error_um + NOISE_UM * rng.normal(size=q.shape))
    columns: dict[str, object] = {"line": lines, "t": 3.0 * np.arange(len(q))}
    for index, name in enumerate("xyz"):
        columns |= {
            name: q[:, index],
            f"dir_{name}": d[:, index],
            f"m{name}": measured[:, index],
            f"s{name}": np.full(len(q), 1e-3 * NOISE_UM),
        }
    machine = Machine("mill", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in "xyz"}, tool_offset_mm=(0, 0, 0))
    write_machine(folder / "machine.toml", machine)
    write_observations(folder / "observations.csv", observations_from_columns(columns))
    return folder / "machine.toml", folder / "observations.csv"


def circle_table(turn: float = 1.0, seed: int = 3) -> bytes:
    """Give circular tests of a machine with play in x and a bow of x: both senses at two feeds.

    `turn` is the part of a whole turn that is run.
    """
    rng = np.random.default_rng(seed)
    rows = ["line,x,y,z,r,dir,feed"]
    for sense, feed in ((1, 500), (-1, 500), (1, 2000), (-1, 2000)):
        angle = sense * (0.01 + np.linspace(0.0, 2.0 * np.pi * turn, CIRCLE_POINTS, endpoint=False))
        cos, sin = np.cos(angle), np.sin(angle)
        # To first order the radius moves by the error along it.
        along_x, along_y = 0.5 * PLAY_UM * np.sign(sense * sin), BOW_UM * (1.0 - cos**2)
        radius_um = along_x * cos + along_y * sin + CIRCLE_NOISE_UM * rng.normal(size=len(angle))
        for a, b, um in zip(cos, sin, radius_um, strict=True):
            x, y, r = 150.0 + CIRCLE_MM * a, 150.0 + CIRCLE_MM * b, CIRCLE_MM + 1e-3 * um
            rows.append(f"bar {feed},{x:.7f},{y:.7f},20,{r:.7f},{sense},{feed}")
    return ("\n".join(rows) + "\n").encode()


def loaded(folder: Path, saved_in: Path | None = None) -> Session:
    """Begin a session and wait until it has compared."""
    session = begin_session(write_scene(folder), saved_in, threads=1)
    settle(session)
    return session


def fitted(folder: Path, saved_in: Path | None = None) -> Session:
    """Begin a session with the 21 errors fitted."""
    session = loaded(folder, saved_in)
    wiring.do(session, "fit", "21")
    settle(session)
    return session


def settle(session: Session) -> None:
    """Wait until no work is under way, and insist that nothing went wrong."""
    job = session.job
    if job is not None:
        job.wait(120.0)
    assert session.job is None
    assert session.problems == {}


def texts(component: object) -> str:
    """Give all texts of a page's part, in order."""
    if isinstance(component, str):
        return component
    if isinstance(component, list | tuple):
        return " ".join(texts(one) for one in component)
    return texts(getattr(component, "children", None) or "")
