"""Jobs through any executor: a job that is lost is a result, and what is under way is bounded."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import current_process, get_context, parent_process
from pathlib import Path
from queue import SimpleQueue
from shutil import rmtree
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from typing import Any, Protocol

from geoerr.errors import GeoerrError
from geoerr.farm.job import Job, work
from geoerr.farm.outcome import StepResult

# What jobs under way may carry, all together: a farm of any size fits a caller's memory.
MOST_CARRIED_BYTES = 1 << 30

# Settings of libraries, as the environment has them.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "POLARS_MAX_THREADS": "1", "RAYON_NUM_THREADS": "1"}
_ENVIRONMENT = Lock()
_GUARD = 'hint: in a script, put the call behind `if __name__ == "__main__":`'

# What became of a job: its results, or why there are none.
Finished = list[StepResult] | BaseException


class FarmFuture(Protocol):
    """What is asked of an executor's future."""

    def result(self) -> Any:
        """Give the result, or raise what went wrong."""

    def add_done_callback(self, fn: Callable[[Any], Any], /) -> Any:
        """Call a function with the future when it is done."""


class FarmExecutor(Protocol):
    """What is asked of an executor: those of `concurrent.futures` have it, and Dask's `Client` has."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Any:
        """Take a call; give its future."""


def finished_by(
    executor: FarmExecutor, jobs: Iterable[Job], most_jobs: float = float("inf")
) -> Generator[tuple[Job, Finished], None, None]:
    """Give each job with what became of it, as they are ready.

    Parameters
    ----------
    executor
        Who works.
    jobs
        Taken one by one as there is room, so that they may be made then.
    most_jobs
        Under way at once.
    """
    waiting = iter(jobs)
    ready: SimpleQueue[tuple[Job, FarmFuture]] = SimpleQueue()
    n_jobs = n_bytes = 0
    while True:
        while n_jobs == 0 or (n_jobs < most_jobs and n_bytes < MOST_CARRIED_BYTES):
            job = next(waiting, None)
            if job is None:
                break
            try:
                future = executor.submit(work, job)
            except Exception as error:
                yield job, error
                continue
            n_jobs += 1
            n_bytes += job.n_bytes
            future.add_done_callback(partial(_put, ready, job))
        if n_jobs == 0:
            return
        job, done = ready.get()
        n_jobs -= 1
        n_bytes -= job.n_bytes
        yield job, _result_of(done)


def _result_of(done: FarmFuture) -> Finished:
    """Give what a future has: what a worker raised, or an executor has instead of results, is that job's alone."""
    try:
        results = done.result()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # A worker that was told to exit is no Exception.
        return error
    if not isinstance(results, list) or not all(isinstance(one, StepResult) for one in results):
        return TypeError(f"the executor has no results but {type(results).__name__}")
    return results


def _put(ready: SimpleQueue[tuple[Job, FarmFuture]], job: Job, future: FarmFuture) -> None:
    ready.put((job, future))


def finished_here(
    jobs: Iterable[Job], n_workers: int = 0, staging: Path | None = None
) -> Generator[tuple[Job, Finished], None, None]:
    """Give each job with what became of it, by processes of this computer: one a core, of one thread each.

    A process that dies takes the pool and all that it had along. Those jobs are done again, one at a time in a
    process of their own, so that only the one that kills its process is lost; the others go on in a new pool.

    Parameters
    ----------
    jobs
        Taken one by one as there is room.
    n_workers
        Processes; 0 for one a core.
    staging
        What jobs write in, and processes remove as well as their own files where the caller is killed.

    Raises
    ------
    GeoerrError
        where processes end before they have a job.
    """
    n_workers = n_workers or _cores()
    waiting = iter(jobs)
    while True:
        lost: list[Job] = []
        with _pool(n_workers, staging) as pool:
            for job, finished in finished_by(pool, _until(waiting, lost), most_jobs=2 * n_workers):
                if isinstance(finished, BrokenExecutor):
                    lost.append(job)
                else:
                    yield job, finished
        if not lost:
            return
        _refuse_where_none_begins()
        yield from _one_at_a_time(lost, staging)


def refuse_while_beginning() -> None:
    """Refuse a call by a process that is only being started.

    It loads the script of who started it, and makes the call in it where nothing keeps it from that. It would find no
    process for its jobs, take all for lost, and remove the results that the first call writes meanwhile.

    Raises
    ------
    GeoerrError
        in such a process.
    """
    # As `multiprocessing.spawn` tells it itself, which has no public name for it.
    if getattr(current_process(), "_inheriting", False):
        raise GeoerrError(f"a process that was started for a farm loads the script and calls it again\n{_GUARD}")


def refuse_to_fork(executor: FarmExecutor | None) -> None:
    """Refuse a pool that would fork this process after tables were read in it: its jobs would wait for ever.

    Polars reads with threads of its own, and no fork has the threads of who was forked.

    Raises
    ------
    GeoerrError
        for such a pool.
    """
    # Executors have no public names for how they begin processes, nor for those that there are.
    context = getattr(executor, "_mp_context", None)
    # Processes that there are already are forks of what was before.
    if context is None or getattr(executor, "_processes", None):
        return
    if context.get_start_method() == "fork" and _has_threads_of_polars():
        raise GeoerrError(
            "the executor would fork a process that has read tables: in its processes reading one waits for ever\n"
            'hint: ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")), or no executor'
        )


def _has_threads_of_polars() -> bool:
    """Say whether there are any, as Linux names them; elsewhere nothing is forked that is not asked to be."""
    names = []
    for path in Path("/proc/self/task").glob("*/comm"):
        # A thread may end meanwhile.
        with suppress(OSError):
            names.append(path.read_text())
    return any(name.startswith("polars") for name in names)


def _refuse_where_none_begins() -> None:
    """Refuse to go on where a process ends before it has a job, as of a script that begins anew in each."""
    with _pool(1) as pool:
        try:
            pool.submit(_cores).result()
        except BrokenExecutor as error:
            raise GeoerrError(f"processes for a farm end as they begin\n{_GUARD}") from error


def _one_at_a_time(jobs: list[Job], staging: Path | None) -> Iterator[tuple[Job, Finished]]:
    """Give each job with what became of it, all by one process, and by a new one where that died.

    A job is lost that kills a process which had no other: of one that had, it is not known what it died of.
    """
    while jobs:
        n_done = 0
        with _pool(1, staging) as own:
            for job, finished in finished_by(own, jobs, most_jobs=1):
                has_died = isinstance(finished, BrokenExecutor)
                if n_done == 0 or not has_died:
                    n_done += 1
                    yield job, finished
                if has_died:
                    break
        jobs = jobs[n_done:]


def _until(waiting: Iterator[Job], lost: list[Job]) -> Iterator[Job]:
    """Give jobs as long as none is lost."""
    while not lost:
        job = next(waiting, None)
        if job is None:
            return
        yield job


class _Pool(ProcessPoolExecutor):
    """Processes of one thread, which Ctrl-C reaches in a job only: one that loads libraries has nothing to say."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Take a call; a process that begins for it inherits what is held back."""
        with _interrupts(held_back=True), _of_one_thread():
            return super().submit(_interruptible, fn, *args, **kwargs)


def _interruptible(fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Do a job in a process of a pool: Ctrl-C that came before it stops it at once."""
    with _interrupts(held_back=False):
        return fn(*args, **kwargs)


@contextmanager
def _interrupts(*, held_back: bool) -> Iterator[None]:
    """Hold SIGINT back meanwhile, or let it through; what was held back comes afterwards."""
    if sys.platform == "win32":
        yield
        return
    how = signal.SIG_BLOCK if held_back else signal.SIG_UNBLOCK
    before = signal.pthread_sigmask(how, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _pool(n_workers: int, staging: Path | None = None) -> Iterator[ProcessPoolExecutor]:
    """Open a pool whose processes begin anew: threads of libraries do not survive a fork."""
    # What a process that is killed was working with goes with its pool.
    with TemporaryDirectory(prefix="geoerr-farm-") as folder:
        folders = (folder,) if staging is None else (folder, str(staging))
        pool = _Pool(n_workers, mp_context=get_context("spawn"), initializer=_begin, initargs=folders)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _of_one_thread() -> Iterator[None]:
    """Have libraries of processes that begin meanwhile work on one thread: pools in each take the others' cores.

    Read by NumPy and Polars as a process loads them, and by the core where nothing else says how many. No longer than
    that: what the caller itself begins to work with is not to be held to one.
    """
    # Two farms of one process would otherwise take each other's setting for the one that was there.
    with _ENVIRONMENT:
        before = {name: os.environ.get(name) for name in _ONE_THREAD}
        os.environ.update(_ONE_THREAD)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


def _begin(folder: str, *others: str) -> None:
    """Have all temporary files of this process in a folder, and end it with the one that began it."""
    tempfile.tempdir = folder
    Thread(target=_end_with_parent, args=(folder, *others), daemon=True).start()


def _end_with_parent(*folders: str) -> None:
    """Wait for the death of who began this process, and do what it cannot any more: remove what jobs work in."""
    parent = parent_process()
    if parent is None:
        return
    parent.join()
    for folder in folders:
        rmtree(folder, ignore_errors=True)
    # Nobody waits for what is under way.
    os._exit(1)


def _cores() -> int:
    # Linux can give a process fewer cores than there are.
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
