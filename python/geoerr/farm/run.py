"""A farm from folders to folders: models first, then programs, whoever does the work."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import closing, nullcontext, suppress
from pathlib import Path
from typing import NoReturn

from geoerr.compensate.mark import is_corrected_by, name_of_content
from geoerr.errors import GeoerrError, InputFileError
from geoerr.farm.engine import (
    FarmExecutor,
    Finished,
    finished_by,
    finished_here,
    refuse_to_fork,
    refuse_while_beginning,
)
from geoerr.farm.folders import (
    INPUTS,
    MODELS,
    FarmFolder,
    bytes_of,
    machine_paths,
    name_of,
    programs_in,
    read_folder,
    refuse_named_twice,
    refuse_to_send,
    resolved,
)
from geoerr.farm.job import Job
from geoerr.farm.outcome import Farm, Outcome, StepResult
from geoerr.farm.place import place_of
from geoerr.farm.placing import move_result, write_result
from geoerr.farm.recipe import STEPS, Recipe, Step, results_of
from geoerr.farm.staging import staging_in

# Called with what is done and the total: machines and programs.
Progress = Callable[[int, int], None]


def run_farm(
    machines: str | Path | Sequence[str | Path],
    output: str | Path,
    recipe: Recipe | None = None,
    *,
    executor: FarmExecutor | None = None,
    workers: int = 0,
    on_progress: Progress = lambda done, total: None,
) -> Farm:
    """Identify, diagnose and compensate many machines at once; one failure never stops the rest.

    >>> if __name__ == "__main__":  # doctest: +SKIP
    ...     farm = geoerr.run_farm("farm", "results")
    >>> farm = geoerr.run_farm("farm", "results", executor=Client("tcp://farm:8786").get_executor())  # doctest: +SKIP

    Parameters
    ----------
    machines
        A folder of machines' folders, or those folders. Each holds `machine.toml`, measurements (`.csv`, `.parquet`)
        or a session with pictures, programs (`*.gcode`, `*.nc` ..., and all below `programs`); a `model.json` or
        `errors.json` in it is taken as it is, `rig.json` and `effects.toml` (the user's own effects) take part.
    output
        Folder for the results, a folder each: `observations.csv`, `rig.json`, `errors.json`, `model.json`,
        `diagnosis.json`, and programs under their own names. Each file is whole or absent, and replaced when its
        successor is there. Where a step fails, what an earlier call wrote in its place, or in that of a step which
        needs it, is removed; so are programs that do not bear the mark of the model which now stands for them.
    recipe
        What is done with each; None for everything that its folder has something for.
    executor
        Any with `submit` as in `concurrent.futures`; None for a process on each core of this computer, which wants
        the call behind `if __name__ == "__main__":` in a script. A worker that sees the folders of machine and
        results, under the caller's paths, corrects programs of any size from file to file, in constant memory; to
        another one they travel as bytes, up to half a GiB each, and back. All other files travel so, but pictures.
    workers
        Processes where no executor is given; 0 for one a core. Neither it nor the executor changes a byte.
    on_progress
        Called with the number of machines and programs that are done, and of all.

    Raises
    ------
    InputFileError
        where there is no farm, two machines have the same name, or a result would replace an input.
    GeoerrError
        where a script calls it not behind `if __name__ == "__main__":`, and processes that load it would again;
        for a pool that would fork a process in which tables were read.
    """
    refuse_while_beginning()
    refuse_to_fork(executor)
    run = _Run(Path(output), recipe or Recipe(), executor, workers, on_progress)
    return run.farm(_paths(machines, Path(output)))


def _paths(machines: str | Path | Sequence[str | Path], results: Path) -> list[Path]:
    if isinstance(machines, str | Path):
        return machine_paths(Path(machines), results)
    return [Path(one) for one in machines]


class _Run:
    """One call: outcomes by machine and program, in the order of the input."""

    def __init__(
        self, output: Path, recipe: Recipe, executor: FarmExecutor | None, workers: int, on_progress: Progress
    ) -> None:
        self.output, self.recipe, self.executor, self.workers = output, recipe, executor, workers
        self.on_progress = on_progress
        # Of a machine's own steps (None), and of each of its programs.
        self.outcomes: dict[tuple[str, str | None], list[Outcome]] = {}
        # Where a machine's programs find its model; those whose model could not be made are not among them.
        self.models: dict[str, Path] = {}
        # Programs of each machine that this run corrects.
        self.programs: dict[str, tuple[str, ...]] = {}
        # Those that a worker was to correct where they stand, and did not see there.
        self.not_seen: set[tuple[str, str | None]] = set()
        self.n_done = self.n_all = 0

    def farm(self, paths: Sequence[Path]) -> Farm:
        """Do everything."""
        self._check(paths)
        folders = [folder for path in paths if (folder := self._read(path)) is not None]
        # Folders that could not be read have their outcome already.
        self.n_all, self.n_done = len(self.outcomes), sum(map(bool, self.outcomes.values()))
        self.on_progress(self.n_done, self.n_all)
        self._do(self._model_jobs(folders))
        self._correct([(folder, program) for folder in folders for program in self.programs[folder.name]])
        for folder in folders:
            if not any(self.outcomes[folder.name, program] for program in (None, *self.programs[folder.name])):
                self.outcomes[folder.name, None] = [Outcome(folder.name, "read", says="nothing to do")]
        return Farm(tuple(one for outcomes in self.outcomes.values() for one in outcomes))

    def _check(self, paths: Sequence[Path]) -> None:
        names: dict[str, Path] = {}
        for path in paths:
            name = name_of(path)
            if name in names:
                raise InputFileError(
                    path, f"has the name of {names[name]}", remedy="results go by the folder's name: rename one"
                )
            names[name] = path
        machines = {resolved(path) for path in paths}
        results = {resolved(self.output / name) for name in names}
        # Below a machine's own folder nothing is read but programs: results may stand in one of their own there.
        read_below = {resolved(folder) for path in paths for folder in self._program_folders(path)} - machines
        if results & machines:
            _refuse_among_inputs(self.output)
        read = {resolved(path / program) for path in paths for program in self._programs_below(path)}
        written = {
            resolved(self.output / name_of(path) / one) for path in paths for one in self._programs_below(path)
        }
        # To a single file a link among the results may lead.
        if not read.isdisjoint(written):
            _refuse_among_inputs(self.output)
        for folder, others in [*((one, read_below) for one in results), *((one, results) for one in machines)]:
            if not {folder, *folder.parents}.isdisjoint(others):
                _refuse_among_inputs(self.output)

    def _program_folders(self, path: Path) -> set[Path]:
        """Give the folders that a machine's programs are read from: a link may lead to one anywhere."""
        if "compensate" in self.recipe.steps:
            return {path / "programs", *((path / name).parent for name in self._programs_below(path))}
        return set()

    def _programs_below(self, path: Path) -> tuple[str, ...]:
        if "compensate" in self.recipe.steps:
            # A machine's folder that cannot be used has its outcome later.
            with suppress(GeoerrError, OSError):
                return programs_in(path)
        return ()

    def _read(self, path: Path) -> FarmFolder | None:
        name = name_of(path)
        self.outcomes[name, None] = []
        try:
            folder = read_folder(path)
        except GeoerrError as error:
            failed = [Outcome(name, "read", error=str(error))]
            self.outcomes[name, None] = self._without_earlier(failed, name, None, self._results_of(path))
            return None
        self.programs[name] = self._programs(folder)
        self.outcomes |= {(name, program): [] for program in self.programs[name]}
        return folder

    def _programs(self, folder: FarmFolder) -> tuple[str, ...]:
        return folder.programs if "compensate" in self.recipe.steps else ()

    def _model_jobs(self, folders: Iterable[FarmFolder]) -> Iterator[Job]:
        """Make the job of each machine: everything but its programs."""
        for folder in folders:
            if folder.model is not None:
                self.models[folder.name] = folder.path / folder.model
                # One that cannot be read is told when its turn comes.
                with suppress(GeoerrError, OSError):
                    self._without_programs_of_others(folder.name, *folder.carried([folder.model]).values())
            possible: set[Step] = {"diagnose"} if folder.model else {"identify", "fit", "diagnose"}
            steps: list[Step] = [step for step in STEPS if step in possible and step in self.recipe.steps]
            if folder.is_session and "measure" in self.recipe.steps:
                steps.insert(0, "measure")
            elif not folder.tables:
                steps = []
            given = () if folder.model is None else (folder.model,)
            yield from self._job(folder, tuple(steps), (*folder.inputs, *folder.tables, *given))

    def _correct(self, programs: Sequence[tuple[FarmFolder, str]]) -> None:
        """Correct programs where they stand; those that a worker does not see there travel as bytes afterwards."""
        # Where there is no model there is nothing to be written.
        with staging_in(self.output) if self.models and programs else nullcontext() as staging:
            self._do(self._program_jobs(programs, staging), staging)
        left = [one for one in programs if (one[0].name, one[1]) in self.not_seen]
        if left:
            self._do(self._program_jobs(left, None))

    def _program_jobs(self, programs: Iterable[tuple[FarmFolder, str]], staging: Path | None) -> Iterator[Job]:
        """Make the job of each program, with the model from where it was written."""
        for folder, program in programs:
            if folder.name in self.models:
                yield from self._job(folder, ("compensate",), (), program, staging)
            else:
                self._ended(folder.name, program, [_without_model(folder, program)], [program])

    def _job(
        self,
        folder: FarmFolder,
        steps: tuple[Step, ...],
        names: tuple[str, ...],
        program: str | None = None,
        staging: Path | None = None,
    ) -> Iterator[Job]:
        """Make one job; what cannot be read is an outcome, and nothing to do is none."""
        if not steps:
            self._ended(folder.name, program, [])
            return
        files = {name: folder.path / name for name in names}
        place = None
        try:
            refuse_named_twice(folder.path, (name for name in names if name in folder.tables))
            if program is not None:
                model = self.models[folder.name]
                files[model.name] = model
                if staging is None:
                    files[program] = folder.path / program
                    refuse_to_send(files[program])
                else:
                    place = place_of(folder, program, self.output / folder.name / program, staging)
            carried = bytes_of(files)
        except (GeoerrError, OSError) as error:
            failed = [Outcome(folder.name, steps[0], program, error=str(error))]
            self._ended(folder.name, program, failed, results_of(steps, files, program))
            return
        session = str(resolved(folder.path)) if steps[0] == "measure" else None
        yield Job(folder.name, str(folder.path), steps, self.recipe, carried, program, session, place)

    def _do(self, jobs: Iterator[Job], staging: Path | None = None) -> None:
        if self.executor is None:
            finished = finished_here(jobs, self.workers, staging)
        else:
            finished = finished_by(self.executor, jobs)
        # What is under way has ended before its staging is removed, whatever ends this.
        with closing(finished):
            for job, became in finished:
                if not isinstance(became, BaseException) and any(one.is_not_seen for one in became):
                    self.not_seen.add((job.machine, job.program))
                    continue
                if job.program is None and job.machine not in self.models:
                    self._without_programs_of_others(job.machine, _made_model(became))
                outcomes = self._written(job, became)
                written = {name for one in outcomes for name in one.files}
                wanted = results_of(job.steps, job.files, job.program)
                missed = [name for name in wanted if f"{job.machine}/{name}" not in written]
                self._ended(job.machine, job.program, outcomes, missed)

    def _ended(self, machine: str, program: str | None, outcomes: list[Outcome], missed: Iterable[str] = ()) -> None:
        """Keep outcomes; `missed` are files that this run should have written and did not."""
        self.outcomes[machine, program] = self._without_earlier(outcomes, machine, program, missed)
        self.n_done += 1
        self.on_progress(self.n_done, self.n_all)

    def _written(self, job: Job, became: Finished) -> list[Outcome]:
        """Write what a job brought; give what became of it."""
        if isinstance(became, BaseException):
            return [Outcome(job.machine, job.steps[0], job.program, error=_lost(job, became))]
        outcomes = []
        for result in became:
            try:
                files, error = self._placed(job, result), result.error
            except (GeoerrError, OSError) as refused:
                files, error = (), str(refused)
            says = "" if error else result.says
            outcomes.append(Outcome(job.machine, result.step, result.program, files, says, error, result.notes))
        model = _model_of(outcomes) if job.program is None else None
        if model is not None:
            self.models[job.machine] = self.output / job.machine / model
        return outcomes

    def _results_of(self, path: Path) -> list[str]:
        """Name all that a machine's folder that cannot be used would have given."""
        try:
            programs = programs_in(path) if "compensate" in self.recipe.steps else ()
            there = [name for name in INPUTS if (path / name).is_file()]
        except (GeoerrError, OSError):
            programs, there = (), []
        return [*results_of(self.recipe.steps, there), *programs]

    def _without_programs_of_others(self, machine: str, model: bytes | None) -> None:
        """Remove a machine's earlier programs that another model corrected, before its own is there.

        A run that is stopped would leave them beside it; those by the same model stay until they are replaced.

        Parameters
        ----------
        machine
            Its name.
        model
            The model's file; None where there is none.
        """
        for path in (self.output / machine / program for program in self.programs[machine]):
            # What cannot be removed cannot be written either: that is told when its turn comes.
            with suppress(OSError):
                # A device or a pipe has no end, and is no program of an earlier run.
                is_earlier = path.is_file()
                if is_earlier and (model is None or not is_corrected_by(path, name_of_content(model))):
                    path.unlink()

    def _without_earlier(
        self, outcomes: list[Outcome], machine: str, program: str | None, missed: Iterable[str]
    ) -> list[Outcome]:
        """Remove what an earlier run wrote where this one has no result: it would be taken for this one's.

        Gives the outcomes, and one for each file that cannot be removed.
        """
        step, found = outcomes[-1].step if outcomes else "read", list(outcomes)
        for path in (self.output / machine / name for name in missed):
            try:
                if path.is_file() or path.is_symlink():
                    path.unlink()
            except OSError as error:
                told = f"{path}: is of an earlier run, and cannot be removed: {error.strerror}\nhint: remove it"
                found.append(Outcome(machine, step, program, error=told))
        return found

    def _placed(self, job: Job, result: StepResult) -> tuple[str, ...]:
        """Put a step's files into their places; give their names below the output's folder."""
        results = self.output / job.machine
        for name, content in result.files.items():
            write_result(results / name, content)
        for name, part in result.parts.items():
            # Without one, the result of an earlier call is the same.
            if part is not None and job.place is not None:
                move_result(Path(job.place.staging, part), results / name)
        return tuple(f"{job.machine}/{name}" for name in (*result.files, *result.parts))


def _refuse_among_inputs(output: Path) -> NoReturn:
    """Refuse a folder for results from which the next run would read."""
    raise InputFileError(output, "results would stand among the inputs", remedy="name another folder for the results")


def _model_of(results: Iterable[StepResult | Outcome]) -> str | None:
    """Name the best model of what a machine's own steps gave; None where points or model could not be made."""
    there = list(results)
    if any(one.error for one in there if one.step in ("measure", "fit")):
        return None
    made = {Path(name).name for one in there for name in one.files}
    return next((name for name in MODELS if name in made), None)


def _made_model(became: Finished) -> bytes | None:
    """Give the file of the model that a job brought; None where it brought none."""
    if isinstance(became, BaseException):
        return None
    name = _model_of(became)
    return None if name is None else next(one.files[name] for one in became if name in one.files)


def _without_model(folder: FarmFolder, program: str) -> Outcome:
    error = (
        f"{folder.path / program}: there is no model to correct it by\n"
        "hint: see why the machine has none, or put model.json into its folder"
    )
    return Outcome(folder.name, "compensate", program, error=error)


def _lost(job: Job, error: BaseException) -> str:
    """Say why a job has no results."""
    why = "its process died" if isinstance(error, BrokenExecutor) else f"{type(error).__name__}: {error}"
    return f"{job.about}: no result came back: {why}\nhint: give it more memory, or fewer workers to share it"
