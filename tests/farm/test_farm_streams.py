"""Programs go from file to file where a worker sees them, else as bytes; nothing half-written stays."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from small_farm import PROGRAM, RECIPE, contents, peak_mb, put, write_machine

import geoerr
from geoerr.compensate.mark import is_corrected_by
from geoerr.farm import Farm
from geoerr.farm.job import Job, work
from geoerr.farm.outcome import StepResult
from geoerr.farm.placing import move_result, successor_of
from geoerr.farm.staging import staging_in

pytestmark = pytest.mark.timeout(120)

CORNER = "mill-0/programs/corner.gcode"


class Workers:
    """An executor that does each job at once, in its own way."""

    def __init__(self, do: Callable[[Job], list[StepResult]]) -> None:
        self.do = do
        self.jobs: list[Job] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        (job,) = args
        self.jobs.append(job)
        future: Future[Any] = Future()
        try:
            future.set_result(self.do(job))
        except Exception as error:
            future.set_exception(error)
        return future


def run(farm: Path, do: Callable[[Job], list[StepResult]] = work) -> tuple[Farm, list[Job]]:
    """Give what became of a farm, and the jobs of its programs."""
    workers = Workers(do)
    done = geoerr.run_farm(farm, farm.parent / "out", RECIPE, executor=workers)
    return done, [job for job in workers.jobs if job.program is not None]


def elsewhere(**other: Any) -> Callable[[Job], list[StepResult]]:
    """Work as a worker does that finds something else under the caller's paths."""

    def do(job: Job) -> list[StepResult]:
        return work(job if job.place is None else replace(job, place=replace(job.place, **other)))

    return do


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system does not say what one process had")
def test_the_memory_of_a_worker_does_not_grow_with_the_program(farm: Path) -> None:
    """Of a program of 60 MB it took another 200."""
    machine = farm / "mill-0"
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        geoerr.run_farm(machine, farm.parent / "out", RECIPE, executor=pool)
        before_mb = pool.submit(peak_mb).result()
        large = machine / "programs/corner.gcode"
        with large.open("ab") as stream:
            for _ in range(60):
                stream.write(b"; a line without a move\nG1 X20.5 Y30\n" * 26_000)
        assert large.stat().st_size > 55e6
        done = geoerr.run_farm(machine, farm.parent / "out", RECIPE, executor=pool)
        after_mb = pool.submit(peak_mb).result()
    assert not done.failures
    assert (farm.parent / "out" / CORNER).stat().st_size > 55e6
    assert after_mb - before_mb < 20


def test_nothing_reads_a_program_whole(farm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []
    read_bytes = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: (read.append(path), read_bytes(path))[1])
    for _ in range(2):
        done, jobs = run(farm)
        assert not done.failures
        assert len(jobs) == 5
        assert all(set(job.files) == {"model.json"} for job in jobs)
    assert read
    assert not [path for path in read if path.suffix in (".gcode", ".nc")]


@pytest.mark.parametrize("other", [{"staging": "/nowhere/at/all"}, {"modified_ns": 1}, {"folder": "/nowhere"}])
def test_a_worker_that_does_not_see_the_files_gets_and_sends_bytes(
    farm: Path, right_bytes: dict[str, bytes], other: dict[str, Any]
) -> None:
    done, jobs = run(farm, elsewhere(**other))
    assert not done.failures
    assert contents(farm.parent / "out") == right_bytes
    assert [job.place is None for job in jobs] == [False] * 5 + [True] * 5
    assert all(job.program in job.files for job in jobs[5:])


@pytest.mark.parametrize(("most", "n_failed"), [(len(PROGRAM) - 1, 5), (len(PROGRAM), 5), (1000, 0)])
def test_programs_that_are_too_large_to_be_sent_are_refused(
    farm: Path, monkeypatch: pytest.MonkeyPatch, most: int, n_failed: int
) -> None:
    """Whichever way: a corrected program is the larger one."""
    monkeypatch.setattr("geoerr.farm.folders.MOST_SENT_BYTES", most)
    done, _ = run(farm, elsewhere(staging="/nowhere"))
    assert len(done.failures) == n_failed
    for failed in done.failures:
        assert str(failed.error).startswith(
            f"{farm}/{failed.machine}/{failed.program}: has 0 MB, and more than 0 are "
        )
        assert "\nhint: share both with the workers" in str(failed.error)
    # From file to file there is no bound.
    assert not run(farm)[0].failures


def test_a_worker_that_is_lost_half_way_leaves_nothing(farm: Path, right_bytes: dict[str, bytes]) -> None:
    def lose(job: Job) -> list[StepResult]:
        if job.place is not None and job.machine == "mill-0":
            job.place.new_part().write_bytes(b"G1 X")
            raise MemoryError
        return work(job)

    done, _ = run(farm, lose)
    assert [(one.machine, one.program) for one in done.failures] == [("mill-0", "programs/corner.gcode")]
    assert contents(farm.parent / "out") == {name: right_bytes[name] for name in right_bytes if name != CORNER}
    assert sorted(path.name for path in (farm.parent / "out").iterdir()) == [f"mill-{k}" for k in range(4)]


def test_a_job_that_is_done_twice_at_once_is_one_result(farm: Path, right_bytes: dict[str, bytes]) -> None:
    with ThreadPoolExecutor(2) as threads:

        def twice(job: Job) -> list[StepResult]:
            first, second = threads.map(work, [job, job])
            assert [one.says for one in first] == [one.says for one in second]
            return second

        done, _ = run(farm, twice)
    assert not done.failures
    assert contents(farm.parent / "out") == right_bytes


def test_a_job_that_comes_back_late_changes_nothing(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """An engine may take a worker for lost that only did not answer."""
    _, jobs = run(farm)
    put({CORNER: b"earlier"}, farm.parent / "out")
    (late,) = work(jobs[0])
    assert late.is_not_seen
    assert contents(farm.parent / "out") == right_bytes | {CORNER: b"earlier"}


def test_what_a_killed_call_left_goes_and_what_another_is_at_stays(tmp_path: Path) -> None:
    put({".geoerr-farm-dead/held": b"", ".geoerr-farm-dead/part": b"G1 X", ".geoerr-farm-young/part": b""}, tmp_path)
    with staging_in(tmp_path) as one, staging_in(tmp_path) as other:
        assert one is not None
        assert other is not None
        assert {path.name for path in tmp_path.iterdir()} == {one.name, other.name}
    assert not list(tmp_path.iterdir())


KILLED = """
import sys, geoerr
from small_farm import RECIPE
if __name__ == "__main__":
    geoerr.run_farm(sys.argv[1], sys.argv[2], RECIPE, workers=1)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot tell another process to end")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_caller_that_is_killed_leaves_no_temporary_files(tmp_path: Path, number: int) -> None:
    """Its folder in that of temporary files stayed; its processes remove it, and what they write in the results."""
    write_machine(tmp_path / "farm/mill-0", 0)
    with (tmp_path / "farm" / CORNER).open("ab") as stream:
        for _ in range(100):
            stream.write(b"G1 X20.5 Y30\nG1 X120 Y130.25\n" * 10_000)
    (tmp_path / "killed.py").write_text(KILLED)
    (tmp_path / "tmp").mkdir()
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp")}
    environment["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    command = [sys.executable, tmp_path / "killed.py", tmp_path / "farm", tmp_path / "out"]

    def temporary() -> list[Path]:
        return [*(tmp_path / "tmp").iterdir(), *(tmp_path / "out").glob(".*")]

    with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as process:
        # A part is there besides the file that the caller holds.
        assert until(lambda: len(list((tmp_path / "out").glob(".geoerr-farm-*/*"))) > 1)
        assert len(temporary()) == 2
        process.send_signal(number)
        assert process.wait(timeout=30) == -number
    assert until(lambda: not temporary())
    assert set(contents(tmp_path / "out")) == {"mill-0/model.json", "mill-0/diagnosis.json"}


def until(is_so: Callable[[], bool]) -> bool:
    deadline_s = time.monotonic() + 60.0
    while not is_so() and time.monotonic() < deadline_s:
        time.sleep(0.02)
    return is_so()


@pytest.mark.parametrize("link", [CORNER, "mill-0/programs"])
def test_a_link_among_the_results_to_a_program_is_refused(farm: Path, link: str) -> None:
    """The program was replaced."""
    (farm.parent / "out" / link).parent.mkdir(parents=True)
    (farm.parent / "out" / link).symlink_to(farm / link)
    before = contents(farm)
    with pytest.raises(geoerr.GeoerrError, match="among the inputs"):
        run(farm)
    assert contents(farm) == before


def test_results_that_are_a_link_to_another_disk_are_copied_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No file is moved from one disk to another."""
    put({"results/.staging/part": b"new", "other/part.nc": b"old"}, tmp_path)
    (tmp_path / "results/mill").symlink_to(tmp_path / "other", target_is_directory=True)
    replace_path = Path.replace

    def across(path: Path, target: Path) -> Path:
        if path.parent != target.parent:
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        return replace_path(path, target)

    monkeypatch.setattr(Path, "replace", across)
    move_result(tmp_path / "results/.staging/part", tmp_path / "results/mill/part.nc")
    assert contents(tmp_path) == {"other/part.nc": b"new"}
    assert (tmp_path / "results/mill").is_symlink()


def test_a_program_without_room_is_named_as_the_caller_names_its_result(
    farm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("geoerr.farm.placing.Successor._begun", full)
    done, _ = run(farm)
    assert len(done.failures) == 5
    assert done.failures[0].error == (
        f"{farm.parent / 'out' / CORNER}: cannot be written: {os.strerror(errno.ENOSPC)}\n"
        "hint: make room on its disk, or name an output on another"
    )


def test_what_is_no_file_among_the_results_is_given_the_program(farm: Path, full_device: Path) -> None:
    """It was read for a mark, and has no end."""
    (farm.parent / "out" / CORNER).parent.mkdir(parents=True)
    (farm.parent / "out" / CORNER).symlink_to(full_device)
    done, _ = run(farm)
    (failed,) = done.failures
    assert str(failed.error).startswith(f"{farm.parent / 'out' / CORNER}: cannot be written: ")


@pytest.mark.parametrize("there", [None, b"", b"abc", b"abcdef", b"abcdefgh", b"abXdef"])
@pytest.mark.parametrize("new", [b"", b"abcdef"])
def test_a_file_is_written_only_where_it_differs(tmp_path: Path, there: bytes | None, new: bytes) -> None:
    earlier, part = tmp_path / "earlier", tmp_path / "part"
    if there is not None:
        earlier.write_bytes(there)
    with successor_of(earlier, part, "earlier") as successor:
        for start in range(0, len(new), 2):
            assert successor.write(new[start : start + 2]) == 2
    assert successor.is_written == part.exists() == (there != new)
    assert not part.exists() or part.read_bytes() == new


def test_a_file_that_fails_half_way_is_not_left(tmp_path: Path) -> None:
    def fail() -> None:
        with successor_of(tmp_path / "earlier", tmp_path / "part", "earlier") as successor:
            successor.write(b"half")
            assert (tmp_path / "part").exists()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("block", [7, 1 << 20])
def test_a_program_is_read_as_far_as_its_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    """One by another model was read to its end."""
    monkeypatch.setattr("geoerr.compensate.mark._BLOCK_BYTES", block)
    program = tmp_path / "part.nc"
    marks = [
        f"; corrected by geoerr: model {name}, tolerance 0.005 mm\n" for name in ("0123456789ab", "ba9876543210")
    ]
    program.write_text("G21\n" + marks[0] + "G1 X1\n" + marks[1])
    assert is_corrected_by(program, "0123456789ab")
    assert not is_corrected_by(program, "ba9876543210")
    program.write_text("G21\nG1 X1\n")
    assert not is_corrected_by(program, "0123456789ab")


def test_a_table_that_is_there_twice_is_refused_by_both_names(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """It was taken for two, each reading for two of the same."""
    first, second = farm / "mill-0/observations.csv", farm / "mill-0/observations.CSV"
    second.write_bytes(first.read_bytes())
    if first.samefile(second):
        pytest.skip("the disk does not tell capitals")
    put({"mill-1/model.json": right_bytes["mill-1/model.json"], "mill-1/Observations.csv": first.read_bytes()}, farm)
    done, _ = run(farm)
    failed = {(one.machine, one.step): str(one.error) for one in done.failures}
    assert set(failed) == {("mill-0", "fit"), ("mill-0", "compensate"), ("mill-1", "diagnose")}
    assert failed["mill-0", "fit"] == (
        f"{first}: has the name of {second} but for capitals: one table that is there twice would count twice\n"
        "hint: remove one of them, or give it another name"
    )
    # A model that is given does without them.
    assert (farm.parent / "out/mill-1/programs/corner.gcode").read_bytes() == right_bytes[
        "mill-1/programs/corner.gcode"
    ]
