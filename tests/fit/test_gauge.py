"""What measurements determine, by rank (docs/theory/gauge.md), and what the fit says of what they do not."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fit_scenes import (
    COVARIANCE_MM2,
    Numbers,
    camera_near_base,
    cubic,
    cubic_truth,
    curve_of,
    fitted,
    lost,
    no_errors,
    replaced,
    seen,
    value_of,
    why,
)
from virtual_machine import (
    BED,
    FIXTURE,
    LENGTH_MM,
    Camera,
    Move,
    camera,
    li_nine_lines,
    machine_of,
    nine_lines,
    observe,
    place,
)

from geoerr import _core
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.fit import Fitted, result_of, sightings_of
from geoerr.fit.classic import classic_terms, gauge_rows
from geoerr.fit.noise import is_static
from geoerr.fit.start import nominal_mm, start_frames
from geoerr.fit.undetermined import Undetermined
from geoerr.fit.variables import variable_columns
from geoerr.machine import Machine
from geoerr.model.compile import compile_terms

CHAIN = "wZbXYt"
ALL_CHAINS = [
    "w" + "".join(axes[:split]) + "b" + "".join(axes[split:]) + "t"
    for axes in itertools.permutations("XYZ")
    for split in range(4)
]
SQUARENESS = {"EC0Y", "EB0Z", "EA0Z"}
# The points of a 5 x 5 x 5 grid, and those between them.
COARSE = [np.array(q) for q in itertools.product(np.linspace(0.0, LENGTH_MM, 5), repeat=3)]


def lines_of(
    machine: Machine, moves: list[Move], seed: int = 3, cameras: dict[str, Camera] | None = None
) -> set[str]:
    return lost(fit_of(machine, moves, seed, cameras))


def fit_of(machine: Machine, moves: list[Move], seed: int = 3, cameras: dict[str, Camera] | None = None) -> Fitted:
    rng = np.random.default_rng(seed)
    truth = cubic_truth(rng)
    cameras = cameras or {name: camera(rng) for name in sorted({move.session for move in moves})}
    return fitted(machine, observe(machine, truth, moves, cameras, covariance_mm2=COVARIANCE_MM2, rng=rng))


def in_sessions(moves: list[Move], names: Sequence[str]) -> list[Move]:
    return [replace(move, session=name) for move, name in zip(moves, names, strict=True)]


def design_of_li(machine: Machine, held_to: Numbers | None = None) -> tuple[Numbers, _core.FitTriangle, Numbers]:
    """Whitened columns of Li's nine lines with every target's place unknown; the triangle; the fit's gauge."""
    observations = observe(
        machine,
        no_errors(),
        li_nine_lines(machine),
        {"0": camera(np.random.default_rng(8))},
        covariance_mm2=np.eye(3),
    )
    sightings = sightings_of(observations)
    terms = classic_terms(machine, "21", {name: cubic(name[2].lower(), degree=4) for name in LINEAR_AND_ANGULAR})
    compiled = compile_terms(machine, terms)
    frames = start_frames(nominal_mm(machine, sightings), sightings, is_static(sightings))
    keys = [(int(c), *t) for c, t in zip(sightings.carrier, sightings.offset_mm.tolist(), strict=True)]
    names = list(dict.fromkeys(keys))
    places = np.zeros((len(keys), 3, 3 * len(names)))
    for row, key in enumerate(keys):
        first = 3 * names.index(key)
        places[row, :, first : first + 3] = frames.rotations[0]
    problem = _core.FitProblem(
        compiled.core,
        sightings.carrier,
        np.ascontiguousarray(sightings.commanded_mm),
        np.ascontiguousarray(sightings.offset_mm),
        np.ascontiguousarray(variable_columns(sightings, compiled.variables)),
        sightings.starts,
        None,
        np.ascontiguousarray(sightings.measured_mm),
        np.ascontiguousarray(sightings.whitening),
        sightings.session,
        (frames.kinds, frames.rotations, frames.translations_mm, frames.excess_mm, frames.pivots_mm),
        np.zeros(compiled.n_coefficients),
        np.empty(0),
        [],
        places,
    )
    scale = np.ones(len(sightings))
    design = problem.design(problem.start, scale, 0, len(sightings), 1)
    gauge = np.zeros((24, problem.n_columns))
    gauge[:, : compiled.n_coefficients] = gauge_rows(terms)
    held = np.zeros((0, problem.n_columns)) if held_to is None else np.vstack([gauge, held_to])
    return design, problem.triangle(problem.start, scale, held, None, 1), gauge


def rank_of(design: Numbers) -> int:
    """By singular values of columns of unit length: the second implementation."""
    length = np.linalg.norm(design, axis=0)
    size = np.linalg.svd(design / np.where(length > 0.0, length, 1.0), compute_uv=False)
    return int((size > 1e-10 * size[0]).sum())


def restricted(design: Numbers, constraint: Numbers) -> Numbers:
    """The design for unknowns on which every constraint is 0."""
    _, _, directions = np.linalg.svd(constraint)
    return np.asarray(design @ directions[len(constraint) :].T)


def test_nine_lines_count() -> None:
    """18 functions of five coefficients, 3 squarenesses, 6 of the pose, 7 target places: 120 unknowns, rank 93.

    The null space: 18 constants and 6 transverse slopes, which the gauge takes, and 3 translations.
    """
    design, triangle, gauge = design_of_li(machine_of(CHAIN))
    assert design.shape[1] == 18 * 5 + 3 + 6 + 7 * 3 == 120
    assert rank_of(design) == 93
    bare = triangle.solve(None, 1)
    assert bare.rank == 93
    assert bare.null_space.shape == (120, 27)
    # Nothing but bends is determined of a function: each has a constant that is free.
    assert all(not all(bare.is_determined[5 * number : 5 * number + 5]) for number in range(18))
    # Constants and slopes cost nothing of the rank: they are within the null space.
    assert np.linalg.matrix_rank(gauge) == 18 + 6
    assert rank_of(restricted(design, gauge)) == 93
    solution = triangle.solve(gauge, 1)
    assert solution.rank == 93
    assert solution.null_space.shape[1] == 3
    assert all(solution.is_determined[: 90 + 3])
    # The last three move the places of all targets and the frame against each other, and no error.
    assert np.abs(solution.null_space[:93]).max() < 1e-9
    first_place = np.zeros((3, 120))
    first_place[:, 99:102] = np.eye(3)
    whole = triangle.solve(np.vstack([gauge, first_place]), 1)
    assert (whole.rank, whole.null_space.shape[1]) == (93, 0)


def test_a_triangle_that_is_made_for_its_gauge_is_solved_as_one_that_is_held_to_it_after() -> None:
    _, triangle, gauge = design_of_li(machine_of(CHAIN))
    first_place = np.zeros((3, 120))
    first_place[:, 99:102] = np.eye(3)
    # With three directions that stay free, with none, and with constraints that come later.
    for early, late in [(first_place[:0], first_place[:0]), (first_place, first_place[:0]), (gauge[:0], first_place)]:
        _, held, _ = design_of_li(machine_of(CHAIN), early)
        after, before = triangle.solve(np.vstack([gauge, early, late]), 1), held.solve(late, 1)
        assert after.rank == before.rank == 93
        assert after.is_determined == before.is_determined
        covariance, same = (one.covariance_root @ one.covariance_root.T for one in (after, before))
        assert covariance == pytest.approx(same, abs=1e-9 * float(np.abs(same).max()))


@pytest.mark.parametrize("chain", ALL_CHAINS)
def test_nine_lines_with_three_places_on_each_body_determine_everything(chain: str) -> None:
    machine = machine_of(chain)
    rng = np.random.default_rng(5)
    truth = cubic_truth(rng)
    result = fitted(
        machine, observe(machine, truth, nine_lines(machine), {"0": camera(rng)}, covariance_mm2=COVARIANCE_MM2)
    )
    assert result.not_determined == ()
    # Without noise the truth comes back. First-order columns, exact residuals: what is left is a thousandth of the
    # least standard error, where iteration stops.
    for name in LINEAR_AND_ANGULAR:
        value, std = curve_of(result, name, truth.q_mm["x"])
        assert np.abs(value - truth.tables[name]).max() < 1e-3 * std.max(), name
    for pair, true in truth.s_rad.items():
        value_rad, std_rad = value_of(result, f"S_{pair}")
        assert abs(value_rad - true) < 1e-3 * std_rad, pair


def test_stated_places_of_targets_need_not_be_true() -> None:
    """A plate glued on 0.3 mm off is no error of the machine; its lever arm is wrong by a hundredth of a percent."""
    machine = machine_of(CHAIN)
    rng = np.random.default_rng(6)
    truth = cubic_truth(rng)
    observations = observe(machine, truth, nine_lines(machine), {"0": camera(rng)}, covariance_mm2=COVARIANCE_MM2)
    names = observations.texts("target")
    slip = {name: rng.uniform(-0.3, 0.3, 3) for name in dict.fromkeys(names)}
    stated = observations.target_offset_mm + np.array([slip[name] for name in names])
    result = fitted(machine, replaced(observations, **dict(zip(("tx", "ty", "tz"), stated.T, strict=True))))
    # The residual: 0.3 mm times angles of 0.3 mrad, 0.1 um.
    assert result.figures.rmse_um is not None
    assert result.figures.rmse_um < 0.1
    assert lost(result) == set()
    model = result_of(result).model
    expected = np.array([place(machine, truth, "relative", q, np.zeros(3)) - q for q in COARSE[::6]])
    difference = model.error_mm(np.array(COARSE[::6])) - expected
    # Lever arms of 200 mm are wrong by 0.15 %, so are angles and what they do over 400 mm (0.3 mrad: 0.2 um).
    assert np.abs(difference - difference[0]).max() < 1e-3


def test_camera_moved_between_bodies() -> None:
    machine = machine_of(CHAIN)
    result = fit_of(machine, in_sessions(nine_lines(machine), ["tool", "tool", "bed"]))
    assert lost(result) == {"EB0Z", "EA0Z"}
    assert "the measuring frame moved between x and z; S_xz needs one frame" in why(result, "EB0Z")
    assert "the measuring frame moved between y and z; S_yz needs one frame" in why(result, "EA0Z")


def test_camera_moved_for_every_axis() -> None:
    """Three targets in one frame still see each axis's roll."""
    machine = machine_of(CHAIN)
    assert lines_of(machine, in_sessions(nine_lines(machine), ["a", "b", "c"])) == SQUARENESS


def test_camera_moved_for_every_line() -> None:
    machine = machine_of(CHAIN)
    moves = li_nine_lines(machine)
    result = fit_of(machine, in_sessions(moves, [move.line for move in moves]))
    assert lost(result) == SQUARENESS | {"EAX", "EBY", "ECZ"}
    for name in ("EAX", "EBY", "ECZ"):
        text = why(result, name)
        assert text.startswith("only its part in proportion to the position is open"), text
    # What is open is linear to round-off: the roll's curvature is known.
    roll = next(term for term in result.terms if term.id == "EAX")
    first = sum(len(term.coefficients) for term in result.terms[: result.terms.index(roll)])
    curves = cubic_columns(result.null_space[first : first + 4])
    assert np.abs(curves).max() > 1e-4
    assert np.abs(np.diff(curves, n=2, axis=0)).max() < 1e-9


def cubic_columns(coefficients: Numbers) -> Numbers:
    from geoerr.bases import basis_of

    return np.asarray(basis_of(cubic("x")).evaluate(np.linspace(0.0, LENGTH_MM, 9)) @ coefficients)


def with_bed(machine: Machine, targets: dict[str, tuple[float, float, float]]) -> list[Move]:
    return [replace(move, targets=targets) if move.axis == "z" else move for move in nine_lines(machine)]


def test_bed_with_one_target() -> None:
    """The bed turns the work under the tool, and one point cannot show it: E(q) is not determined either."""
    machine = machine_of(CHAIN)
    result = fit_of(machine, with_bed(machine, {"D": (0.0, 0.0, 0.0)}))
    assert lost(result) == {"EAZ", "EBZ", "ECZ"}


def test_where_a_bed_with_one_target_leaves_the_prediction_open() -> None:
    machine = machine_of(CHAIN)
    model = result_of(fit_of(machine, with_bed(machine, {"D": (0.0, 0.0, 0.0)}))).model
    q = np.array([[0.0, 0.0, 0.0], [200.0, 0.0, 0.0], [200.0, 0.0, 200.0], [0.0, 200.0, 300.0]])
    assert model.is_determined_at(q).all(axis=1).tolist() == [True, True, False, False]


def test_where_one_tool_point_leaves_the_prediction_open() -> None:
    """Nowhere for that point; everywhere but at the first position for another."""
    machine = machine_of(CHAIN, (30.0, -20.0, -80.0))
    rng = np.random.default_rng(10)
    rows = [("relative", q, (0.0, 0.0, 0.0)) for q in COARSE]
    model = result_of(fitted(machine, seen(machine, cubic_truth(rng), camera_near_base(rng), rows, rng))).model
    assert model.is_determined_at(np.array(COARSE)).all()
    assert not model.is_determined_at(np.array(COARSE[1:]), (0.0, 0.0, 50.0)).all(axis=1).any()


def test_bed_with_one_target_off_the_origin() -> None:
    """Then the carriage's translation, that of l = 0, is not told from its turn either."""
    machine = machine_of(CHAIN)
    result = fit_of(machine, with_bed(machine, {"D": (120.0, 90.0, -30.0)}))
    assert {"EAZ", "EBZ", "ECZ"} <= lost(result) <= {"EAZ", "EBZ", "ECZ", "EXZ", "EYZ", "EZZ"} | SQUARENESS


@pytest.mark.parametrize(
    ("second", "turn"), [((200.0, 0.0, 0.0), {"EAZ"}), ((0.0, 200.0, 0.0), {"EBZ"}), ((0.0, 0.0, 90.0), {"ECZ"})]
)
def test_bed_with_two_targets(second: tuple[float, float, float], turn: set[str]) -> None:
    machine = machine_of(CHAIN)
    assert lines_of(machine, with_bed(machine, {"D": (0.0, 0.0, 0.0), "E": second})) == turn


def words(result: Fitted, name: str) -> str:
    """With the machine, which tells whose targets are wanting."""
    listed = Undetermined(
        result.terms,
        np.asarray(result.solved.solution.is_determined),
        np.asarray(result.solved.solution.null_space),
        result.sightings,
        result.n_parameters,
        [],
        (),
        result.machine,
    )
    return next(item.why for item in listed.reasons if item.name == name)


def test_words_name_the_targets_that_are_wanting() -> None:
    machine = machine_of(CHAIN)
    one = fit_of(machine, with_bed(machine, {"D": (0.0, 0.0, 0.0)}))
    assert why(one, "EAZ").startswith("no measured point responds to it")
    assert "there is one target on the work; add two more, not on one line with it" in words(one, "EAZ")
    two = fit_of(machine, with_bed(machine, {"D": (0.0, 0.0, 0.0), "E": (200.0, 0.0, 0.0)}))
    assert "the targets on the work lie on one line; add one beside it" in words(two, "EAZ")
    moves = li_nine_lines(machine)
    apart = fit_of(machine, in_sessions(moves, [move.line for move in moves]))
    assert "the targets on the work were seen from different frames; see three" in words(apart, "ECZ")


def grid_rows(
    tool: Sequence[Sequence[float]], bed: Sequence[Sequence[float]]
) -> list[tuple[str, Numbers, Sequence[float]]]:
    """The tool over an (x, y) grid, the bed along z: `wZbXYt` seen from the floor."""
    side = np.linspace(0.0, LENGTH_MM, 5)
    rows: list[tuple[str, Numbers, Sequence[float]]] = [
        ("tool", np.array([x, y, 0.0]), t) for x in side for y in side for t in tool
    ]
    return rows + [("work", np.array([0.0, 0.0, z]), t) for z in np.linspace(0.0, LENGTH_MM, 9) for t in bed]


def test_floor_camera_with_one_target_on_each_body() -> None:
    machine = machine_of(CHAIN)
    rng = np.random.default_rng(9)
    rows = grid_rows([(0.0, 0.0, 0.0)], [(0.0, 0.0, 0.0)])
    result = fitted(machine, seen(machine, cubic_truth(rng), camera(rng), rows, rng))
    angles = {name for name in LINEAR_AND_ANGULAR if name[1] in "ABC"}
    assert lost(result) == angles - {"EAX", "ECX"}


def test_floor_camera_with_three_targets_on_each_body() -> None:
    machine = machine_of(CHAIN)
    rng = np.random.default_rng(9)
    rows = grid_rows(list(FIXTURE.values()), list(BED.values()))
    result = fitted(machine, seen(machine, cubic_truth(rng), camera(rng), rows, rng))
    assert lost(result) == set()


@pytest.mark.parametrize("tool_offset", [(0.0, 0.0, 0.0), (30.0, -20.0, -80.0)])
def test_tool_against_work_with_one_tool_point(tool_offset: tuple[float, float, float]) -> None:
    """Four angles act only through the tool's length: they stay open, and E(q) of that tool is right without them."""
    machine = machine_of(CHAIN, tool_offset)
    rng = np.random.default_rng(10)
    truth = cubic_truth(rng)
    rows = [("relative", q, (0.0, 0.0, 0.0)) for q in COARSE]
    # A device that stands on the work, nearly parallel to it.
    observations = seen(machine, truth, camera_near_base(rng), rows)
    result = fitted(machine, observations)
    open_angles = {"EBX", "EAY", "EBY", "ECY"}
    if tool_offset == (0.0, 0.0, 0.0):
        assert lost(result) == open_angles
    else:
        # The carriage's translations, those of l = 0, hide behind the tool's length.
        assert open_angles <= lost(result) <= open_angles | {"EXX", "EYX", "EZX", "EXY", "EYY", "EZY"} | SQUARENESS
    between = rng.choice(truth.q_mm["x"], size=(40, 3))
    model = result_of(result).model
    true = np.array([place(machine, truth, "relative", q, np.zeros(3)) - model.nominal_mm([q])[0] for q in between])
    assert up_to_a_rigid_motion(between, model.error_mm(between) - true) < 0.05e-3


def up_to_a_rigid_motion(q: Numbers, difference: Numbers) -> float:
    """Largest difference once the work's set-up (a shift and a small turn) is taken off."""
    x, y, z = q.T
    zero = np.zeros_like(x)
    turns = np.stack([np.stack([zero, -z, y], 1), np.stack([z, zero, -x], 1), np.stack([-y, x, zero], 1)], axis=2)
    design = np.concatenate([np.tile(np.eye(3), (len(q), 1, 1)), turns], axis=2).reshape(-1, 6)
    solution = np.linalg.lstsq(design, difference.ravel(), rcond=None)[0]
    return float(np.abs(difference.ravel() - design @ solution).max())


def test_tool_against_work_with_three_tool_points() -> None:
    machine = machine_of(CHAIN)
    rng = np.random.default_rng(11)
    rows = [("relative", q, t) for q in COARSE for t in ((0.0, 0.0, -50.0), (80.0, 0.0, -50.0), (0.0, 80.0, -80.0))]
    result = fitted(machine, seen(machine, cubic_truth(rng), camera_near_base(rng), rows, rng))
    assert lost(result) == set()


def test_an_axis_that_stands_still() -> None:
    machine = machine_of(CHAIN)
    result = fit_of(machine, nine_lines(machine)[1:])
    named = {item.name: item.why for item in result.not_determined}
    assert set(named) >= {name for name in LINEAR_AND_ANGULAR if name.endswith("X")} | {"EC0Y", "EB0Z"}
    assert "EA0Z" not in named


def test_one_axis_twelve_components() -> None:
    """Dobariya's model has no angles, so none is missing."""
    machine = machine_of(CHAIN)
    rng = np.random.default_rng(12)
    truth = cubic_truth(rng, angle_rad=0.0)
    rows = [("relative", q, (0.0, 0.0, 0.0)) for q in COARSE]
    result = fitted(machine, seen(machine, truth, camera_near_base(rng), rows, rng), components="12")
    assert lost(result) == set()
    assert len(result.terms) == 9 + 3
