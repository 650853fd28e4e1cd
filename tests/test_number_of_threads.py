"""What is no number of threads is refused by everything public that takes one, in the same words."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from virtual_machine import machine_of

import geoerr
from geoerr.demo.job import run_demo
from geoerr.diagnose import diagnose
from geoerr.diagnose.advice import adviser_of, separation_for
from geoerr.diagnose.space import space_of
from geoerr.errors import ShapeError
from geoerr.geometry import remove_line
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.session import simulate_session

MACHINE = machine_of("wZbXYt")
MODEL = geoerr.Model(MACHINE)
PLACES = np.array([[x, y, z] for x in (0.0, 150.0, 200.0) for y in (0.0, 200.0) for z in (0.0, 200.0)])
NOISE = np.random.default_rng(1).normal(0.0, 1e-3, PLACES.shape)
COLUMNS = dict(zip(("x", "y", "z", "mx", "my", "mz"), np.hstack([PLACES, PLACES + NOISE]).T, strict=True))
POINTS = geoerr.observations_from_columns(COLUMNS | {"carrier": ["relative"] * len(PLACES)})
STATES = {20.0: POINTS, 90.0: POINTS}
LINE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
LEFT = np.eye(3, 4)
RIGHT = LEFT - 100.0 * np.eye(3, 4, 3)
UV = np.zeros((2, 2))
PLAN = nine_line_plan(NineLines(n_points=2, both_directions=False, board_views=3))
# Where there are pictures to work on.
IN_VISION = {"calibrate", "measure"}


@pytest.fixture(scope="module")
def result() -> geoerr.FitResult:
    return geoerr.fit_model(MACHINE, POINTS, components="none", effects=("scale:x",))


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "a.gcode"
    path.write_text("G1 X10 F600\n", encoding="utf-8")
    return path


Calls = dict[str, Callable[[int], object]]


@pytest.fixture
def public(program: Path, result: geoerr.FitResult) -> Calls:
    """How every public function that takes `threads` is called with as many."""
    other = program.with_name("b.gcode")
    return {
        "add_effect": lambda n: geoerr.add_effect(MODEL, POINTS, reference="scale:y", known=result, threads=n),
        "compare": lambda n: geoerr.compare(MODEL, POINTS, threads=n),
        "compare_paths": lambda n: geoerr.compare_paths(MODEL, program, program, threads=n),
        "compensate_program": lambda n: geoerr.compensate_program(MODEL, program, other, threads=n),
        "fit_lines": lambda n: geoerr.fit_lines(LINE, [0], threads=n),
        "identify_joint": lambda n: geoerr.identify_joint(POINTS, MACHINE, threads=n),
        "identify_states": lambda n: geoerr.identify_states(STATES, MACHINE, threads=n),
        "integrate_straightness": lambda n: geoerr.integrate_straightness([0.0, 1.0], [0.0, 1.0], threads=n),
        "trace_paths": lambda n: geoerr.trace_paths(MODEL, program, program, threads=n),
        "triangulate": lambda n: geoerr.triangulate(LEFT, RIGHT, UV, UV, threads=n),
        "triangulate_points": lambda n: geoerr.triangulate_points(LEFT, RIGHT, UV, UV, threads=n),
        "write_model_report": lambda n: geoerr.write_model_report(other, MODEL, POINTS, threads=n),
    }


@pytest.fixture
def others(tmp_path: Path, result: geoerr.FitResult) -> Calls:
    """Those of the rooms, beside the names of `geoerr`."""
    terms = result.model.terms
    return {
        "adviser_of": lambda n: adviser_of(result.fitted, terms, threads=n),
        "diagnose": lambda n: diagnose(result.fitted, threads=n),
        "remove_line": lambda n: remove_line([0.0, 1.0], [0.0, 1.0], threads=n),
        "run_demo": lambda n: run_demo(tmp_path / "demo", lambda _: nullcontext(lambda done, n_all: None), threads=n),
        "separation_for": lambda n: separation_for(space_of(result.fitted, threads=1), terms, threads=n),
        "simulate_session": lambda n: simulate_session(PLAN, tmp_path / "session", threads=n),
    }


def _untold(calls: Calls, threads: int) -> dict[str, str]:
    """Give what does not say that this is no number of threads, with what it says."""
    found = {}
    for name, call in calls.items():
        try:
            call(threads)
        except ShapeError as error:
            if str(error) != f"threads is {threads!r}\nhint: write a whole number: how many cores to use, 0 for all":
                found[name] = str(error)
        except Exception as error:
            found[name] = repr(error)
        else:
            found[name] = "accepted"
    return found


def test_every_public_function_refuses_what_is_no_number_of_threads(public: Calls) -> None:
    functions = {name: getattr(geoerr, name) for name in geoerr.__all__}
    taking = {
        name
        for name, function in functions.items()
        if inspect.isfunction(function) and "threads" in inspect.signature(function).parameters
    }
    assert taking == set(public) | IN_VISION
    assert _untold(public, -1) == {}
    assert _untold(public, 1.5) == {}  # type: ignore[arg-type]  # 1.5 is no number of threads


def test_so_do_those_of_the_rooms_before_they_begin(others: Calls, tmp_path: Path) -> None:
    assert _untold(others, -1) == {}
    assert _untold(others, 1.5) == {}  # type: ignore[arg-type]  # 1.5 is no number of threads
    assert list(tmp_path.iterdir()) == []
