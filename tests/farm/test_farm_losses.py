"""Workers that die: nothing hangs, nothing else is lost, and the bytes are the same."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

import pytest
from small_farm import RECIPE, contents, put

import geoerr
from geoerr.farm.engine import _pool, finished_here
from geoerr.farm.job import Job, work

pytestmark = pytest.mark.timeout(120)


class Killer(Job):
    """A job whose worker ends as it takes it, as one without memory does."""

    def __reduce__(self) -> tuple[Callable[[int], Any], tuple[int]]:
        return os._exit, (9,)


class KillOnce:
    """Kills a worker when the second job is done, and never again."""

    def __init__(self, pids: Callable[[], list[int]]) -> None:
        self.pids = pids
        self.killed: int | None = None

    def __call__(self, done: int, total: int) -> None:
        if done >= 2 and self.killed is None:
            self.killed = self.pids()[0]
            os.kill(self.killed, signal.SIGKILL)


def children() -> list[int]:
    return [child.pid for child in active_children() if child.pid is not None]


def test_a_process_that_is_killed_changes_nothing(
    farm: Path, right_bytes: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    kill = KillOnce(children)
    done = geoerr.run_farm(farm, farm.parent / "out", RECIPE, workers=2, on_progress=kill)
    assert kill.killed is not None
    assert not done.failures
    assert contents(farm.parent / "out") == right_bytes
    # Nor does it leave what it worked with.
    assert not list(tmp_path.glob("geoerr-farm-*"))


def test_only_the_job_that_kills_its_process_is_lost(farm: Path) -> None:
    program = {"model.json": b"", "part.gcode": b""}
    good = Job("mill", "mill", ("compensate",), RECIPE, program, "part.gcode")
    jobs = [replace(good, machine=f"mill-{n}") for n in range(12)]
    jobs[3] = Killer("killer", "killer", ("compensate",), RECIPE, program, "part.gcode")
    finished = {job.machine: became for job, became in finished_here(jobs, 2)}
    assert isinstance(finished.pop("killer"), BrokenExecutor)
    # An empty model is refused in words: that is a result.
    assert len(finished) == 11
    assert all(isinstance(one, list) and "model.json" in str(one[0].error) for one in finished.values())


def test_a_pool_that_breaks_is_an_outcome_for_what_it_had(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """A caller's own pool is not opened again: what it had, and what it did not take any more, is named."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        done = geoerr.run_farm(farm, farm.parent / "out", RECIPE, executor=pool, on_progress=KillOnce(children))
    assert done.failures
    assert list(done.by_machine) == ["mill-0", "mill-1", "mill-2", "mill-3"]
    told = [str(one.error) for one in done.failures]
    assert any("its process died" in text for text in told)
    assert all("\nhint: " in text for text in told)
    assert contents(farm.parent / "out").items() <= right_bytes.items()


@pytest.mark.parametrize("executor", ["", ", executor=ProcessPoolExecutor(2, get_context('spawn'))"])
def test_processes_of_an_unguarded_script_do_not_call_again(
    farm: Path, right_bytes: dict[str, bytes], executor: str
) -> None:
    """Each made the call anew as it began, took its jobs for lost, and removed what the first call had written."""
    out, script = farm.parent / "out", farm.parent / "unguarded.py"
    put(right_bytes, out)
    script.write_text(
        "from concurrent.futures import ProcessPoolExecutor\nfrom multiprocessing import get_context\nimport geoerr\n"
        f"geoerr.run_farm({str(farm)!r}, {str(out)!r}{executor})\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, timeout=60)
    assert "a process that was started for a farm loads the script and calls it again\n" in done.stderr
    assert "bootstrapping" not in done.stderr + done.stdout
    # Where the processes are the call's own, it ends with that; a given pool's are its owner's business.
    if not executor:
        assert contents(out) == right_bytes
        assert done.returncode == 1
        assert done.stderr.splitlines()[-2:] == [
            "geoerr.errors.GeoerrError: processes for a farm end as they begin",
            'hint: in a script, put the call behind `if __name__ == "__main__":`',
        ]


@pytest.mark.skipif(sys.platform == "win32", reason="a console's Ctrl-C cannot be held back there")
def test_a_worker_that_is_interrupted_as_it_begins_prints_nothing() -> None:
    """It takes a second to load its libraries; Ctrl-C comes before, and is told to who asked."""
    script = """
import os, signal
from multiprocessing import active_children
from geoerr.farm.engine import _pool
if __name__ == "__main__":
    with _pool(1) as pool:
        asked = pool.submit(os.getpid)
        os.kill(active_children()[0].pid, signal.SIGINT)
        print(type(asked.exception()).__name__)
        print(pool.submit(os.getpid).result() > 0)
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.stdout.split(), done.stderr) == (["KeyboardInterrupt", "True"], "")


class Odd:
    """An executor whose first future is an odd one."""

    def __init__(self, fill: Callable[[Future[Any]], None]) -> None:
        self.fill: Callable[[Future[Any]], None] | None = fill

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        future: Future[Any] = Future()
        fill, self.fill = self.fill, None
        if fill is None:
            future.set_result(fn(*args))
        else:
            fill(future)
        return future


@pytest.mark.parametrize(
    ("fill", "why"),
    [
        (lambda future: future.set_exception(SystemExit(3)), "SystemExit: 3"),
        (lambda future: future.set_result(None), "no results but NoneType"),
        (lambda future: future.set_result([1, 2]), "no results but list"),
    ],
)
def test_an_odd_future_is_one_failure(farm: Path, fill: Callable[[Future[Any]], None], why: str) -> None:
    machines = [farm / "mill-0", farm / "mill-1"]
    done = geoerr.run_farm(machines, farm.parent / "out", replace(RECIPE, steps=("fit",)), executor=Odd(fill))
    failed, good = done.outcomes
    assert why in str(failed.error)
    assert (good.machine, good.error) == ("mill-1", None)


def test_libraries_of_a_process_have_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """On 16 cores each of 16 processes had 72 threads."""
    names = ("OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS", "RAYON_NUM_THREADS")
    monkeypatch.setenv("RAYON_NUM_THREADS", "16")
    monkeypatch.delenv("POLARS_MAX_THREADS", raising=False)
    with _pool(1) as pool:
        assert [pool.submit(os.getenv, name).result() for name in names] == ["1"] * 3
        # What the caller itself works with meanwhile has all cores.
        assert os.environ["RAYON_NUM_THREADS"] == "16"
        assert "POLARS_MAX_THREADS" not in os.environ


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing is forked")
def test_a_pool_of_forks_is_refused_where_it_would_hang(farm: Path) -> None:
    """After a table was read, as in a notebook, its processes waited for ever for threads that a fork has not."""
    geoerr.read_observations(farm / "mill-0/observations.csv")
    with (
        ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool,
        pytest.raises(geoerr.GeoerrError, match=r"has read tables.*\nhint: .*get_context\(\"spawn\"\)"),
    ):
        geoerr.run_farm(farm, farm.parent / "out", RECIPE, executor=pool)
    assert not (farm.parent / "out").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing is forked")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_the_core_works_in_a_fork_of_a_process_whose_cores_it_had() -> None:
    """Where no number of threads was asked for, it waited for ever for those of the first process."""
    script = """
import os, signal
import numpy as np
from geoerr.geometry import fit_lines
points, starts = np.random.default_rng(0).normal(size=(500_000, 3)), np.arange(10_000) * 50
first = fit_lines(points, starts).direction
if (child := os.fork()) == 0:
    signal.alarm(20)
    os._exit(0 if (fit_lines(points, starts).direction == first).all() else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "0\n"


def test_another_version_is_refused_by_the_worker() -> None:
    job = Job("mill", "farm/mill", ("fit",), RECIPE, {}, version="0.0.0")
    (result,) = work(job)
    assert "the call came from 0.0.0" in str(result.error)


def test_a_worker_without_room_names_the_program(farm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It named the machine, and said `[Errno 28]`."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("geoerr.farm.steps.Bench.lay_out", full)
    (result,) = work(Job("mill", "farm/mill", ("compensate",), RECIPE, {}, "part.nc"))
    assert str(result.error).startswith("farm/mill/part.nc: no room to work in ")
    assert str(result.error).endswith("set TMPDIR to a folder on another disk")


def test_results_without_room_are_named(farm: Path, full_device: Path) -> None:
    (farm.parent / "out/mill-0").mkdir(parents=True)
    (farm.parent / "out/mill-0/model.json").symlink_to(full_device)
    with ThreadPoolExecutor(1) as one:
        done = geoerr.run_farm(farm / "mill-0", farm.parent / "out", RECIPE, executor=one)
    told = str(done.failures[0].error)
    assert told.startswith(f"{farm.parent / 'out/mill-0/model.json'}: cannot be written: ")
    assert "\nhint: make room on its disk" in told


def test_a_cluster_writes_the_same_bytes(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """Dask is the engine that is tested: it does a lost worker's jobs again by itself."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        distributed.Client(cluster) as client,
    ):
        # The client itself has all that a farm asks for, and so has its executor.
        whole = geoerr.run_farm(farm, farm.parent / "whole", RECIPE, executor=client)
        kill = KillOnce(lambda: list(client.run(os.getpid).values()))
        robbed = geoerr.run_farm(
            farm, farm.parent / "robbed", RECIPE, executor=client.get_executor(), on_progress=kill
        )
    assert kill.killed is not None
    assert not whole.failures
    assert not robbed.failures
    assert contents(farm.parent / "whole") == contents(farm.parent / "robbed") == right_bytes
