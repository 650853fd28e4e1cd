"""A simulated session folder, as `calibrate` and `measure` read it, with the truth beside it."""

from __future__ import annotations

import csv
import io
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import tomli_w

from geoerr.arguments import check_threads
from geoerr.errors import InputFileError
from geoerr.files import write_text
from geoerr.machine import write_machine
from geoerr.simulate.pictures import SIDES, Studio, check_complete
from geoerr.simulate.plan import Plan
from geoerr.simulate.truth import Truth, truth_of
from geoerr.vision.images import write_png

# Called with the number of stereo pairs done and their total.
Progress = Callable[[int, int], None]

# A folder that has these is a simulated session; one with more than all that is written holds something else too.
_OWN_FILES = ("session.toml", "truth.json")
_WRITTEN = {*_OWN_FILES, "machine.toml", "frames.csv", "calibration", "frames"}


def simulate_session(plan: Plan, directory: str | Path, threads: int = 0, progress: Progress | None = None) -> Truth:
    """Photograph a virtual machine into a session folder.

    Parameters
    ----------
    plan
        What to simulate.
    directory
        Folder to make. It appears whole or not at all; an earlier simulated session is replaced, anything else, and
        one with anything else in it (a rig that was calibrated with it), is left alone and refused.
    threads
        Threads to use, 0 = all cores; the pictures do not depend on it.
    progress
        Called after each stereo pair.

    Returns
    -------
    Truth
        What SESSION/truth.json holds.

    Raises
    ------
    InputFileError
        for a plan without targets or passes, plates that hide each other, or a folder that holds something else.
    ShapeError
        for what is no number of threads.
    """
    check_threads(threads)
    check_complete(plan)
    _refuse_foreign_folder(Path(directory))
    studio = Studio(plan)
    truth = truth_of(studio.scene)
    with _whole_folder(Path(directory)) as folder:
        _write_descriptions(folder, plan, studio)
        _write_pictures(folder, studio, threads or os.cpu_count() or 1, progress)
        truth.write(folder / "truth.json")
    return truth


def _write_descriptions(folder: Path, plan: Plan, studio: Studio) -> None:
    write_machine(folder / "machine.toml", plan.machine)
    session: dict[str, object] = {"machine": "machine.toml"}
    if plan.board is not None:
        session["board"] = plan.board.document
    session["targets"] = [
        {
            "id": target.id,
            "dictionary": target.dictionary,
            "size_mm": target.size_mm,
            "carrier": target.carrier,
            "offset_mm": list(target.offset_mm),
        }
        for target in plan.targets
    ]
    write_text(folder / "session.toml", tomli_w.dumps(session))
    rows = [studio.row(index).columns for index in range(len(studio.scene))]
    table = io.StringIO()
    writer = csv.DictWriter(table, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(folder / "frames.csv", table.getvalue())


def _write_pictures(folder: Path, studio: Studio, threads: int, progress: Progress | None) -> None:
    for side in SIDES:
        (folder / "calibration" / side).mkdir(parents=True)
        (folder / "frames" / side).mkdir(parents=True)

    def board_view(view: int) -> None:
        for side in SIDES:
            write_png(folder / "calibration" / side / f"{view + 1:02d}.png", studio.board_view(view, side))

    def frame(index: int) -> None:
        names = studio.row(index).columns
        for side in SIDES:
            write_png(folder / str(names[side]), studio.frame(index, side))

    with ThreadPoolExecutor(threads) as pool:
        pairs = [pool.submit(board_view, view) for view in range(len(studio.boards))]
        pairs += [pool.submit(frame, index) for index in range(len(studio.scene))]
        try:
            for done, pair in enumerate(pairs, start=1):
                pair.result()
                if progress is not None:
                    progress(done, len(pairs))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _refuse_foreign_folder(directory: Path) -> None:
    if not directory.parent.is_dir():
        raise InputFileError(directory, f"the folder {directory.parent} does not exist", remedy="create it first")
    if directory.is_dir() and any(directory.iterdir()):
        if not all((directory / name).is_file() for name in _OWN_FILES):
            raise InputFileError(
                directory,
                "the folder holds something that is not a simulated session",
                remedy="name a new folder, or empty this one",
            )
        others = sorted({path.name for path in directory.iterdir()} - _WRITTEN)
        if others:
            raise InputFileError(
                directory,
                f"the folder holds {', '.join(others)} beside a simulated session, and would be replaced",
                remedy="name a new folder, or move away what is to stay",
            )
    elif directory.exists() and not directory.is_dir():
        raise InputFileError(directory, "is a file, a folder is needed", remedy="name a new folder")


@contextmanager
def _whole_folder(directory: Path) -> Iterator[Path]:
    """Give a temporary folder beside `directory`; it takes that name only when the block ends well."""
    temporary = Path(tempfile.mkdtemp(dir=directory.parent, prefix=f".{directory.name}.", suffix=".part"))
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o777 & ~umask)
        if directory.exists():
            shutil.rmtree(directory)
        temporary.replace(directory)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
