"""Whoever does the work, the bytes are those of the functions called one by one; a failure is a result."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_farm import RECIPE, contents, put

import geoerr
from geoerr.compensate.mark import name_of_model
from geoerr.compensate.program import CompensationOptions
from geoerr.farm import Farm, Outcome, Recipe, Step
from geoerr.files import read_json


def results(farm: Path, recipe: Recipe = RECIPE, workers: int = 2) -> tuple[geoerr.farm.Farm, dict[str, bytes]]:
    output = farm.parent / "out"
    with ThreadPoolExecutor(workers) as threads:
        return geoerr.run_farm(farm, output, recipe, executor=threads), contents(output)


def test_one_machine_is_what_the_functions_write(farm: Path, right_bytes: dict[str, bytes], tmp_path: Path) -> None:
    machine, observations = geoerr.read_machine(farm / "mill-3/machine.toml"), farm / "mill-3/observations.csv"
    fitted = geoerr.fit_model(
        machine, geoerr.read_observations(observations), components="none", effects=("scale:x",)
    )
    geoerr.write_model(tmp_path / "model.json", fitted.model)
    assert right_bytes["mill-3/model.json"] == (tmp_path / "model.json").read_bytes()
    name = name_of_model(tmp_path / "model.json")
    geoerr.compensate_program(fitted.model, farm / "mill-3/square.nc", tmp_path / "square.nc", model_name=name)
    assert right_bytes["mill-3/square.nc"] == (tmp_path / "square.nc").read_bytes()
    assert {path for path in right_bytes if path.startswith("mill-3/")} == {
        "mill-3/model.json",
        "mill-3/diagnosis.json",
        "mill-3/programs/corner.gcode",
        "mill-3/square.nc",
    }


def test_each_machine_is_told_what_it_lacks(farm: Path) -> None:
    done, _ = results(farm)
    assert [(one.machine, one.step, one.program) for one in done.by_machine["mill-3"]] == [
        ("mill-3", "fit", None),
        ("mill-3", "diagnose", None),
        ("mill-3", "compensate", "square.nc"),
        ("mill-3", "compensate", "programs/corner.gcode"),
    ]
    assert list(done.by_machine) == ["mill-0", "mill-1", "mill-2", "mill-3"]
    for outcomes in done.by_machine.values():
        assert "backlash:x" in outcomes[1].says
    assert read_json(farm.parent / "out/mill-3/diagnosis.json")["found"][0]["effect"] == "backlash"


@pytest.mark.parametrize("workers", [1, 3])
def test_threads_write_the_same_bytes(farm: Path, right_bytes: dict[str, bytes], workers: int) -> None:
    done, written = results(farm, workers=workers)
    assert not done.failures
    assert written == right_bytes


def test_processes_of_this_computer_write_the_same_bytes(farm: Path, right_bytes: dict[str, bytes]) -> None:
    seen: list[tuple[int, int]] = []
    done = geoerr.run_farm(farm, farm.parent / "out", RECIPE, workers=2, on_progress=lambda *now: seen.append(now))
    assert not done.failures
    assert contents(farm.parent / "out") == right_bytes
    assert seen == [(n, 9) for n in range(10)]


def test_bad_files_among_good_ones_are_named_and_stop_nothing(farm: Path, right_bytes: dict[str, bytes]) -> None:
    (farm / "mill-0/observations.csv").write_text("line,x\n")
    (farm / "mill-1/machine.toml").write_text("[machine\n")
    (farm / "mill-2/programs/arc.gcode").write_text("G21\nG90\nG0 X10 Y10 Z10\nG2 X90 Y90 I40 J40\n")
    (farm / "empty").mkdir()
    done, written = results(farm)
    errors = {(one.machine, one.step, one.program): str(one.error) for one in done.failures}
    assert set(errors) == {
        ("empty", "read", None),
        ("mill-0", "fit", None),
        ("mill-0", "compensate", "programs/corner.gcode"),
        ("mill-1", "fit", None),
        ("mill-1", "compensate", "programs/corner.gcode"),
        ("mill-2", "compensate", "programs/arc.gcode"),
    }
    # The caller's files are named, not the copies that a worker has.
    assert errors["mill-0", "fit", None].startswith(f"{farm}/mill-0/observations.csv:1: ")
    assert errors["mill-1", "fit", None].startswith(f"{farm}/mill-1/machine.toml: ")
    assert errors["mill-2", "compensate", "programs/arc.gcode"].startswith(f"{farm}/mill-2/programs/arc.gcode:4: ")
    assert all("\nhint: " in text for key, text in errors.items() if key != ("mill-1", "fit", None))
    assert written == {name: right_bytes[name] for name in right_bytes if name.startswith(("mill-2/", "mill-3/"))}


def test_a_model_that_is_given_is_used_and_not_made_again(farm: Path, right_bytes: dict[str, bytes]) -> None:
    (farm / "mill-0/model.json").write_bytes(right_bytes["mill-0/model.json"])
    done, written = results(farm / "mill-0")
    assert [one.step for one in done.outcomes] == ["diagnose", "compensate"]
    assert written == {name: right_bytes[name] for name in ("mill-0/diagnosis.json", "mill-0/programs/corner.gcode")}


def test_a_condition_that_a_machine_does_not_follow_is_none_of_its(farm: Path, right_bytes: dict[str, bytes]) -> None:
    done, written = results(farm / "mill-0", replace(RECIPE, at={"temp_bed": 90.0}))
    assert not done.failures
    assert written["mill-0/programs/corner.gcode"] == right_bytes["mill-0/programs/corner.gcode"]


def test_an_old_model_in_the_results_corrects_nothing(farm: Path) -> None:
    """Where the fit fails now, what an earlier call wrote is not the model."""
    results(farm / "mill-0")
    (farm / "mill-0/observations.csv").write_text("line,x\n")
    done, _ = results(farm / "mill-0")
    assert [one.step for one in done.failures] == ["fit", "compensate"]


def test_programs_in_folders_of_programs_are_corrected(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """They were passed over without a word."""
    program = (farm / "mill-0/programs/corner.gcode").read_bytes()
    names = ["programs/a/b/corner.gcode", "programs/a/corner.gcode", "programs/corner.gcode"]
    put({name: program for name in (*names, "programs/.trash/corner.gcode")}, farm / "mill-0")
    (farm / "mill-0/programs/a/back").symlink_to(farm / "mill-0/programs", target_is_directory=True)
    done, written = results(farm / "mill-0")
    assert [one.program for one in done.outcomes if one.step == "compensate"] == names
    assert {written[f"mill-0/{name}"] for name in names} == {right_bytes["mill-0/programs/corner.gcode"]}
    assert not any(".trash" in name or "back" in name for name in written)


def test_programs_behind_a_link_to_a_folder_are_corrected(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """They were passed over without a word; results in that folder would be read as programs."""
    shared = farm.parent / "shared"
    put({"part.gcode": (farm / "mill-0/programs/corner.gcode").read_bytes()}, shared)
    (shared / "again").symlink_to(shared, target_is_directory=True)
    (farm / "mill-0/programs/shared").symlink_to(shared, target_is_directory=True)
    done, written = results(farm / "mill-0")
    assert not done.failures
    names = ["programs/corner.gcode", "programs/shared/part.gcode"]
    assert [one.program for one in done.outcomes if one.step == "compensate"] == names
    assert written["mill-0/programs/shared/part.gcode"] == right_bytes["mill-0/programs/corner.gcode"]
    with pytest.raises(geoerr.GeoerrError, match="among the inputs"):
        geoerr.run_farm(farm / "mill-0", shared / "out")


def test_a_link_that_leads_nowhere_is_a_failure_by_its_name(farm: Path) -> None:
    """It was passed over: "1 of 1 programs corrected"."""
    for link in ("mill-0/programs/gone.txt", "mill-0/gone.nc", "mill-1/second.csv", "mill-2/model.json", "mill-9"):
        (farm / link).symlink_to("nowhere")
    done, _ = results(farm)
    failed = {(one.machine, one.step, one.program): str(one.error) for one in done.failures}
    assert set(failed) == {
        ("mill-0", "compensate", "gone.nc"),
        ("mill-0", "compensate", "programs/gone.txt"),
        ("mill-1", "fit", None),
        ("mill-1", "compensate", "programs/corner.gcode"),
        ("mill-2", "diagnose", None),
        ("mill-2", "compensate", "programs/corner.gcode"),
        ("mill-9", "read", None),
    }
    gone = farm / "mill-0/programs/gone.txt"
    assert failed["mill-0", "compensate", "programs/gone.txt"] == (
        f"{gone}: is a link to nowhere, which is not there\nhint: bring it there, or remove the link"
    )


def test_links_that_lead_round_to_each_other_stop_nothing(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """They ended the call with a traceback."""
    for link, target in (("one", "other"), ("other", "one"), ("mill-0/programs/round.nc", "round.nc")):
        (farm / link).symlink_to(target)
    done, written = results(farm)
    assert {(one.machine, one.step, one.program) for one in done.failures} == {
        ("one", "read", None),
        ("other", "read", None),
        ("mill-0", "compensate", "programs/round.nc"),
    }
    assert written == right_bytes


def test_a_file_where_results_would_stand_is_told(farm: Path) -> None:
    (farm.parent / "out").mkdir()
    (farm.parent / "out/mill-1").write_text("notes")
    done, written = results(farm)
    assert {one.machine for one in done.failures} == {"mill-1"}
    told = next(one.error for one in done.failures)
    assert told.startswith(f"{farm.parent / 'out/mill-1'}: no folder for results can be made: ")
    assert "remove the file in its place" in told
    assert written["mill-1"] == b"notes"


def test_results_of_an_earlier_run_do_not_stand_beside_a_failure(farm: Path, right_bytes: dict[str, bytes]) -> None:
    put(right_bytes, farm.parent / "out")
    others = {name: b"mine" for name in ("mill-0/notes.txt", "mill-0/rig.json", "mill-0/programs/other.gcode")}
    put(others, farm.parent / "out")
    (farm / "mill-0/observations.csv").write_text("line,x\n")
    (farm / "mill-1/machine.toml").write_text("[machine\n")
    (farm / "mill-2/programs/corner.gcode").write_text("G21\nG90\nG0 X10 Y10 Z10\nG2 X90 Y90 I40 J40\n")
    (farm / "mill-3/observations.csv").unlink()
    done, written = results(farm)
    assert {one.machine for one in done.failures} == {"mill-0", "mill-1", "mill-2", "mill-3"}
    kept = {name: right_bytes[name] for name in ("mill-2/model.json", "mill-2/diagnosis.json")}
    assert written == kept | others


class Stopped:
    """An executor whose user presses Ctrl-C when the first program's turn comes."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        if args[0].program is not None:
            raise KeyboardInterrupt
        future: Future[Any] = Future()
        future.set_result(fn(*args))
        return future


def test_a_run_that_is_stopped_leaves_no_program_of_an_earlier_one(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """By another model than that which now stands beside them; a given model may have changed, too."""
    put(right_bytes, farm.parent / "out")
    put({"mill-0/programs/other.gcode": b"mine"}, farm.parent / "out")
    (farm / "mill-1/model.json").write_bytes(right_bytes["mill-2/model.json"])
    with pytest.raises(KeyboardInterrupt):
        geoerr.run_farm(farm, farm.parent / "out", replace(RECIPE, effects=()), executor=Stopped())
    written = contents(farm.parent / "out")
    assert written["mill-0/model.json"] != right_bytes["mill-0/model.json"]
    assert {name for name in written if name.endswith((".gcode", ".nc"))} == {"mill-0/programs/other.gcode"}


@pytest.mark.parametrize("is_given", [False, True])
def test_a_run_that_is_stopped_leaves_programs_by_the_same_model(
    farm: Path, right_bytes: dict[str, bytes], is_given: bool
) -> None:
    """They were removed before there was anything in their place."""
    put(right_bytes, farm.parent / "out")
    if is_given:
        put({name: content for name, content in right_bytes.items() if name.endswith("/model.json")}, farm)
    with pytest.raises(KeyboardInterrupt):
        geoerr.run_farm(farm, farm.parent / "out", RECIPE, executor=Stopped())
    assert contents(farm.parent / "out") == right_bytes


def test_a_result_that_is_there_already_needs_no_room(
    farm: Path, right_bytes: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk a second run removed the programs of the first, which were the same."""
    put(right_bytes, farm.parent / "out")

    def full(_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("geoerr.farm.placing.whole_or_absent", full)
    monkeypatch.setattr("geoerr.farm.placing.Successor._begun", full)
    done, written = results(farm)
    assert not done.failures
    assert written == right_bytes


def test_steps_that_were_not_asked_for_leave_earlier_results(farm: Path, right_bytes: dict[str, bytes]) -> None:
    put({name: right_bytes[name] for name in right_bytes if name.startswith("mill-0/")}, farm / "out")
    (farm / "mill-0/observations.csv").write_text("line,x\n")
    done, written = results(farm / "mill-0", replace(RECIPE, steps=("diagnose",)))
    assert done.failures
    assert set(written) == {"mill-0/model.json", "mill-0/programs/corner.gcode"}


def test_errors_of_points_are_identified(farm: Path) -> None:
    done, written = results(farm / "mill-0", Recipe(steps=("identify",)))
    assert set(written) == {"mill-0/errors.json"}
    assert [one.step for one in done.outcomes] == ["identify"]


def test_what_is_meant_wrongly_is_refused_before_anything_is_done(farm: Path) -> None:
    with pytest.raises(geoerr.GeoerrError, match="no step 'fitt'"):
        Recipe(steps=("fitt",))  # type: ignore[arg-type]  # the point of the test
    with pytest.raises(geoerr.GeoerrError, match="among the inputs"):
        geoerr.run_farm(farm, farm)
    with pytest.raises(geoerr.GeoerrError, match="has the name of"):
        geoerr.run_farm([farm / "mill-0", farm / "mill-0"], farm.parent / "out")
    with pytest.raises(geoerr.GeoerrError, match="no such folder"):
        geoerr.run_farm(farm / "nowhere", farm.parent / "out")
    assert not (farm.parent / "out").exists()


@pytest.mark.parametrize("machines", ["", "mill-1"])
@pytest.mark.parametrize("output", ["", "mill-1/programs", "mill-1/programs/out", "link/out"])
def test_results_inside_a_machine_are_refused_before_anything_is_done(farm: Path, machines: str, output: str) -> None:
    """The next run would take them for programs."""
    if output.startswith("link"):
        (farm.parent / "link").symlink_to(farm / "mill-1/programs", target_is_directory=True)
    before = contents(farm)
    with pytest.raises(geoerr.GeoerrError, match="among the inputs"):
        geoerr.run_farm(farm / machines, farm.parent / output if output.startswith("link") else farm / output)
    assert contents(farm) == before


def test_machines_inside_results_are_refused(farm: Path) -> None:
    inner = farm.parent / "out/mill-0/mill-1"
    inner.parent.mkdir(parents=True)
    (farm / "mill-1").rename(inner)
    with pytest.raises(geoerr.GeoerrError, match="among the inputs"):
        geoerr.run_farm([farm / "mill-0", inner], farm.parent / "out")


def test_results_that_stand_among_the_machines_are_no_machine(farm: Path) -> None:
    recipe = replace(RECIPE, steps=("fit",))
    with ThreadPoolExecutor(1) as one:
        first, again = (geoerr.run_farm(farm, farm / "results", recipe, executor=one) for _ in range(2))
    assert list(again.by_machine) == list(first.by_machine) == [f"mill-{number}" for number in range(4)]
    assert not again.failures


def test_outcomes_of_many_machines_are_gone_through_once() -> None:
    """Each machine went through those of all: 4000 of 13 outcomes took seconds to be told."""

    class Counting(tuple[Outcome, ...]):
        n_times = 0

        def __iter__(self) -> Iterator[Outcome]:
            self.n_times += 1
            return super().__iter__()

    outcomes = Counting(Outcome(f"m{k}", step) for k in range(30) for step in ("fit", "diagnose"))
    found = Farm(outcomes).by_machine
    assert outcomes.n_times == 1
    assert list(found) == [f"m{k}" for k in range(30)]
    assert [one.step for one in found["m7"]] == ["fit", "diagnose"]


def test_an_outcome_says_that_nothing_was_corrected(farm: Path) -> None:
    (farm / "mill-1/programs/readme.txt").write_text("hello\n")
    done, written = results(farm / "mill-1")
    by_program = {one.program: one for one in done.outcomes}
    assert not by_program["programs/corner.gcode"].has_nothing_corrected
    assert not by_program[None].has_nothing_corrected
    readme = by_program["programs/readme.txt"]
    assert readme.has_nothing_corrected
    document = readme.to_document()
    assert (document["says"], document["error"]) == ("nothing was corrected", None)
    assert document["notes"][0] == "warning: no move was read in 1 line: nothing was corrected; is it G-code?"
    assert written["mill-1/programs/readme.txt"] == b"hello\n"


def test_what_is_to_be_known_of_a_program_is_handed_on(farm: Path) -> None:
    """As `geoerr compensate` says it: of a program that was corrected in part a number of warnings was told."""
    (farm / "mill-1/programs/corner.gcode").write_text("G21\nG90\nG0 X10 Y10 Z20\nG2 X20 Y20 I10 J0\nG1 X150\n")
    options = CompensationOptions(on_unsupported="pass")
    recipe = replace(RECIPE, steps=("fit", "compensate"), options=options)
    with ThreadPoolExecutor(1) as one:
        done = geoerr.run_farm(farm, farm.parent / "out", recipe, executor=one)
    noted = {one.machine: one.notes for one in done.outcomes if one.step == "compensate"}
    (warning,) = (said for said in noted["mill-1"] if said.startswith("warning: "))
    assert "line 4" in warning
    assert not any(said.startswith("warning: ") for said in noted["mill-0"])
    told = {one["machine"]: one["notes"] for one in done.to_document()["outcomes"] if one["program"]}
    assert told["mill-1"] == list(noted["mill-1"])


def test_a_link_is_a_machine_of_its_own_name(farm: Path, right_bytes: dict[str, bytes]) -> None:
    """Two names of one folder stop nothing: each has its results."""
    (farm / "again").symlink_to("mill-0")
    done, written = results(farm)
    assert not done.failures
    assert list(done.by_machine) == ["again", "mill-0", "mill-1", "mill-2", "mill-3"]
    own = {name: content for name, content in written.items() if not name.startswith("again/")}
    assert own == right_bytes
    model = "model.json"
    assert written[f"again/{model}"] == written[f"mill-0/{model}"]


def test_a_step_that_a_folder_has_nothing_for_is_left_out(farm: Path) -> None:
    steps: tuple[Step, ...] = ("measure",)
    done, written = results(farm / "mill-0", Recipe(steps=steps))
    assert [(one.says, one.error) for one in done.outcomes] == [("nothing to do", None)]
    assert not written
