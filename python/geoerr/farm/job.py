"""What travels to a worker and what it does there: files as bytes, programs by their place, failures as texts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from geoerr import __version__
from geoerr.errors import GeoerrError
from geoerr.farm.outcome import StepResult
from geoerr.farm.place import Place
from geoerr.farm.recipe import Recipe, Step
from geoerr.files import MAKE_ROOM_FOR_COPIES, is_full


@dataclass(frozen=True)
class Job:
    """Steps that one worker does with one machine.

    Attributes
    ----------
    machine
        Name of the machine's folder.
    folder
        The folder as the caller names it: what messages name.
    steps
        In this order; what follows a step that failed and needs it is left out.
    recipe
        How they are done.
    files
        What they are done with, by name: as bytes, for a worker may have no disk in common with the caller.
    program
        Which of them `compensate` corrects; with a `place` it is none of them.
    place
        Where the program stands and its result will, so that it is corrected from file to file, whatever its size; a
        worker that does not see the same files says so.
    session
        Absolute path of a folder of pictures; gigabytes stay where they are, and the worker has to see that disk.
    version
        Of the geoerr that asks: another one might write other bytes.
    """

    machine: str
    folder: str
    steps: tuple[Step, ...]
    recipe: Recipe
    files: Mapping[str, bytes]
    program: str | None = None
    session: str | None = None
    place: Place | None = None
    version: str = __version__

    @cached_property
    def n_bytes(self) -> int:
        """What it carries."""
        return sum(map(len, self.files.values()))

    @property
    def about(self) -> str:
        """What messages name: the program, or the machine's folder where there is none."""
        return self.folder if self.program is None else f"{self.folder}/{self.program}"


def work(job: Job) -> list[StepResult]:
    """Do a job, on one thread; whatever goes wrong is a result."""
    from geoerr.farm.steps import DONE_BY, Bench

    if job.version != __version__:
        error = (
            f"{job.folder}: the worker has geoerr {__version__}, the call came from {job.version}\n"
            "hint: install the same version on all workers"
        )
        return [StepResult(job.steps[0], job.program, error=error)]
    if job.place is not None and not job.place.is_seen():
        return [StepResult(job.steps[0], job.program, is_not_seen=True)]
    results: list[StepResult] = []
    with TemporaryDirectory(prefix="geoerr-farm-") as name:
        # Messages name the caller's files, not the copies.
        said_as = {name: job.folder}
        session = None if job.session is None else Path(job.session)
        bench = Bench(Path(name), job.recipe, job.program, session, job.place)
        if job.session is not None:
            said_as[job.session] = job.folder
        if job.place is not None:
            said_as[job.place.folder] = job.folder
        try:
            bench.lay_out(job.files)
        except OSError as error:
            return [StepResult(job.steps[0], job.program, error=_told(job, error, said_as))]
        for step in job.steps:
            try:
                results += DONE_BY[step](bench)
            except (KeyboardInterrupt, SystemExit):
                raise
            except BaseException as error:  # A panic of the core is no Exception.
                results.append(StepResult(step, job.program, error=_told(job, error, said_as)))
                if step in ("measure", "fit"):
                    break
    return results


def _told(job: Job, error: BaseException, said_as: Mapping[str, str]) -> str:
    """Say what went wrong as the command line does; of what geoerr does not refuse itself, say also its kind."""
    # What is written here is copies, and no output of the caller's is meant, but where the result has its place: that
    # is refused by its own name.
    for one in (error, None if job.place is not None else error.__cause__):
        if is_full(one):
            return f"{job.about}: no room to work in {gettempdir()}: {one.strerror}\nhint: {MAKE_ROOM_FOR_COPIES}"
    text = str(error) if isinstance(error, GeoerrError) else f"{job.about}: {type(error).__name__}: {error}"
    for there, here in said_as.items():
        text = text.replace(there, here)
    return text
