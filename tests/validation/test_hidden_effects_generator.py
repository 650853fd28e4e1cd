"""The generator of the hidden-effect study: deterministic, independent, exact, and of the strength that it says."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from validation.hidden_effects import generate as generator
from validation.hidden_effects.cases import DEVELOPMENT, development_seed, study_seed
from validation.hidden_effects.chain import CARRIERS, RELATIVE, Displacements, levers, nothing, places_mm
from validation.hidden_effects.changed import CHANGED
from validation.hidden_effects.generate import KINDS, CannotCarryError, Case, Hidden, generate
from validation.hidden_effects.listed import LISTED, wound_up
from validation.hidden_effects.log import arms_mm, followed
from validation.hidden_effects.machines import CHAINS, draw_machine
from validation.hidden_effects.noise import NOISES, draw_noise
from validation.hidden_effects.unlisted import UNLISTED
from validation.hidden_effects.visible import Projection, rms_um

from geoerr import _core
from geoerr.machine import Machine
from geoerr.observations import MEASURED
from geoerr.simulate.machine import axis_directions
from geoerr.simulate.rotations import rotation

FOLDER = Path(generator.__file__).parent
SMALL = 1600
SHOWN_PLANS = ("nine-lines", "volume-relative", "volume-floor", "mixed")


def random_displacements(rng: np.random.Generator, n_rows: int, size: float = 1.0) -> Displacements:
    moved = nothing(n_rows)
    moved.delta_mm[:] = 0.05 * size * rng.standard_normal((n_rows, 3, 3))
    moved.epsilon_rad[:] = 1e-3 * size * rng.standard_normal((n_rows, 3, 3))
    moved.squareness_rad[:] = 1e-3 * size * rng.standard_normal(3)
    moved.tool_mm[:] = 0.05 * size * rng.standard_normal((n_rows, 3))
    moved.work_mm[:] = 0.05 * size * rng.standard_normal((n_rows, 3))
    return moved


def second_chain(
    chain: str, carrier: str, q: np.ndarray, arm: np.ndarray, moved: Displacements, row: int
) -> np.ndarray:
    """Homogeneous 4 × 4 matrices, one row at a time, with the simulator's own rotations."""
    names = dict(zip(("S_xy", "S_xz", "S_yz"), moved.squareness_rad[row], strict=True))
    along = axis_directions(names)
    machine = Machine.from_chain(chain, (300, 300, 300))

    def side(axes: str, sign: float, body: np.ndarray) -> np.ndarray:
        product = np.eye(4)
        for axis in axes:
            a = "xyz".index(axis)
            step = np.eye(4)
            step[:3, :3] = rotation(sign * moved.epsilon_rad[row, a])
            step[:3, 3] = sign * (q[a] * along[axis] + moved.delta_mm[row, a])
            product = product @ step
        product[:3, 3] += body
        return product

    tool = side(machine.tool_axes, 1.0, moved.tool_mm[row])
    work = side(machine.work_axes, -1.0, moved.work_mm[row])
    pose = {"tool": tool, "work": work, "base": np.eye(4), "relative": np.linalg.inv(work) @ tool}[carrier]
    return (pose @ np.append(arm, 1.0))[:3]


@pytest.mark.parametrize("chain", CHAINS)
def test_the_chain_agrees_with_homogeneous_matrices(chain: str) -> None:
    rng = np.random.default_rng(3)
    n_rows = 12
    carrier = np.arange(n_rows) % 4
    q, arm = rng.uniform(-200, 400, (n_rows, 3)), rng.uniform(-200, 200, (n_rows, 3))
    moved = random_displacements(rng, n_rows)
    ours = places_mm(chain, carrier, q, arm, moved)
    for row in range(n_rows):
        theirs = second_chain(chain, CARRIERS[carrier[row]], q[row], arm[row], moved, row)
        np.testing.assert_allclose(ours[row], theirs, atol=1e-9)


@pytest.mark.parametrize("chain", CHAINS)
def test_levers_are_the_chain_s_derivatives(chain: str) -> None:
    rng = np.random.default_rng(4)
    n_rows = 16
    carrier = np.arange(n_rows) % 4
    q, arm = rng.uniform(0, 300, (n_rows, 3)), rng.uniform(-200, 200, (n_rows, 3))
    sign, lever = levers(chain, carrier, q, arm)
    step = 1e-7
    for axis in range(3):
        for b in range(3):
            moved = nothing(n_rows)
            moved.epsilon_rad[:, axis, b] = step
            slope = (
                places_mm(chain, carrier, q, arm, moved) - places_mm(chain, carrier, q, arm, nothing(n_rows))
            ) / step
            expected = sign[:, axis, None] * np.cross(np.eye(3)[b], lever[:, axis])
            # Second order of a turn by 1e-7 at 1 m: 1e-4 mm/rad; rounding 1e-13/1e-7.
            np.testing.assert_allclose(slope, expected, atol=1e-3)


def imported(path: Path) -> set[str]:
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return names | {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}


def test_nothing_of_what_explains_data_is_used() -> None:
    """The generator and all that it imports; the study beside it uses the package."""
    own, room = {"generate", "cases", "bound"}, "validation.hidden_effects."
    waiting = set(own)
    while waiting:
        names = imported(FOLDER / f"{waiting.pop()}.py")
        found = {name.removeprefix(room) for name in names if name.startswith(room)} - own
        own |= found
        waiting |= found
        assert {name for name in names if name.startswith("geoerr")} <= {"geoerr.machine", "geoerr.observations"}
    assert own >= {"listed", "unlisted", "log", "plans", "chain", "noise", "visible", "machines", "limited"}
    assert not own & {"record", "study", "tables"}


def test_there_are_enough_kinds() -> None:
    assert len(LISTED.kinds) >= 30
    assert len(UNLISTED.kinds) >= 8
    assert all(kind.effect for kind in (LISTED.kinds | CHANGED.kinds).values())
    assert not any(kind.effect for kind in UNLISTED.kinds.values())


@pytest.mark.parametrize("plan", SHOWN_PLANS)
def test_same_arguments_give_the_same_bytes(plan: str) -> None:
    options = {"plan": plan, "noise": "everything", "hidden": ["periodic"], "n_rows": SMALL}
    first, again = generate(5, **options), generate(5, **options)
    assert first.observations.frame.equals(again.observations.frame)
    assert first.truth == again.truth
    assert not first.observations.frame.equals(generate(6, **options).observations.frame)


def test_what_is_hidden_and_the_noise_leave_the_measurement_as_it_was() -> None:
    plain, other = generate(5, n_rows=SMALL), generate(5, noise="everything", hidden=["backlash"], n_rows=SMALL)
    kept = [name for name in plain.observations.frame.columns if name not in (*MEASURED, "sx", "sy", "sz")]
    assert plain.observations.frame[kept].equals(other.observations.frame[kept])


def carried_by(plan: str, number: int, kind: str) -> Case | None:
    """Hide one kind, on a chain of its own; chains with all axes on one side hide the other body."""
    chain = CHAINS[(7 * number + len(plan)) % 24]
    try:
        return generate(number, chain, plan, hidden=[kind], strength_um=3.0, n_rows=SMALL)
    except CannotCarryError:
        return None


@pytest.mark.parametrize("first", range(len(SHOWN_PLANS)))
def test_every_kind_has_the_strength_that_was_asked_for(first: int) -> None:
    own = list(enumerate(KINDS))[first :: len(SHOWN_PLANS)]
    tried = [(number, carried_by(SHOWN_PLANS[first], number, kind)) for number, kind in own]
    carried = [(number, case) for number, case in tried if case is not None]
    lacking = [number for number, case in tried if case is None]
    # Not every plan has what an effect needs, and to some a slow one is drift: the last has the most.
    others = [(number, carried_by(SHOWN_PLANS[-1], number, list(KINDS)[number])) for number in lacking]
    carried += [(number, case) for number, case in others if case is not None]
    assert len(carried) >= len(own) - 2
    for number, case in carried:
        (truth,) = case.truth
        observations = case.observations
        assert not observations.set_aside
        assert np.isfinite(observations.measured_mm).all()
        # Nine lines with three repeats in two sessions have three thousand rows at least.
        assert 0.6 * SMALL < len(observations) < 2.0 * SMALL
        if number % 3 == 0:
            again = rms_um(Projection(case.log, with_offsets=True)(case.displacement_mm))
            assert np.sqrt(np.sum(again**2)) == pytest.approx(3.0, rel=0.02)
        assert truth.visible_rms_um == pytest.approx(3.0, rel=0.02)
        assert truth.visible_rms_um <= truth.explainable_rms_um * 1.001 <= truth.raw_rms_um * 1.002


def test_two_at_once_and_off_the_formula() -> None:
    hidden = [Hidden("backlash", "x"), Hidden("periodic", "y", off_formula=0.3)]
    case = generate(9, "wZbXYt", "mixed", hidden=hidden, strength_um=5.0, n_rows=SMALL)
    assert [one.axis for one in case.truth] == ["x", "y"]
    assert [one.off_formula for one in case.truth] == [0.0, 0.3]
    assert case.truth[1].off_variable in ("x", "z")
    # 30 % of what is there is not 30 % of what is seen: along a pass the unevenness hardly changes.
    assert case.truth[0].visible_off_rms_um == 0.0
    assert 0.1 < case.truth[1].visible_off_rms_um / case.truth[1].visible_rms_um < 0.5
    alone = [generate(9, "wZbXYt", "mixed", hidden=hidden[:1], strength_um=5.0, n_rows=SMALL)]
    assert alone[0].truth[0] == case.truth[0]


def test_refusals_name_what_is_possible() -> None:
    with pytest.raises(ValueError, match="no plan"):
        generate(1, plan="circle")
    with pytest.raises(ValueError, match="no kind"):
        generate(1, hidden=["gremlins"], n_rows=SMALL)
    with pytest.raises(ValueError, match="no axis"):
        generate(1, hidden=[Hidden("backlash", "xy")], n_rows=SMALL)
    with pytest.raises(CannotCarryError, match="needs motion"):
        generate(1, plan="nine-lines", hidden=["lag"], n_rows=SMALL)


def test_seeds_of_development_and_study_never_meet() -> None:
    with pytest.raises(ValueError, match="not between"):
        development_seed(study_seed(0))
    assert len({one.seed for one in DEVELOPMENT}) == len(DEVELOPMENT)
    for one in DEVELOPMENT:
        case = generate(one.seed, one.chain, one.plan, one.noise, one.hidden, one.strength_um, SMALL)
        assert len(case.truth) == len(one.hidden)


@pytest.mark.parametrize("plan", SHOWN_PLANS)
def test_the_log_tells_what_was_so(plan: str) -> None:
    """The core's reading of the table against the generator's own motion."""
    case = generate(11, plan=plan, n_rows=SMALL)
    log, frame = case.log, case.observations
    starts = np.flatnonzero(np.diff(log.session, prepend=-1))
    columns = np.ascontiguousarray(frame.numbers("t", "moving", "feed").T)
    read = read_history(frame.commanded_mm, *columns, frame.directions.astype(float), starts)
    for name, attribute in (("d", "direction"), ("v", "velocity_mm_s"), ("a", "acceleration_mm_s2")):
        ours = np.stack([log.moved(attribute, a) for a in range(3)], axis=1)
        known = np.isfinite(read[name])
        assert known.mean() > 0.7
        np.testing.assert_allclose(read[name][known], ours[known], rtol=1e-6, atol=1e-6)
    for name, attribute in (("s", "travel_mm"), ("t_rev", "since_reversal_s")):
        ours = np.stack([log.moved(attribute, a) for a in range(3)], axis=1)
        known = np.isfinite(read[name])
        assert known.mean() > 0.9
        np.testing.assert_allclose(read[name][known], ours[known], rtol=1e-6, atol=1e-6)


def read_history(q: np.ndarray, *rest: np.ndarray) -> dict[str, np.ndarray]:
    t, moving, feed, direction, starts = rest
    found = _core.history(q, t, moving, feed, direction, starts)
    return {n: np.stack([found[f"{n}_{a}"] for a in "xyz"], axis=1) for n in ("d", "s", "t_rev", "v", "a")}


def test_a_lag_follows_a_ramp_as_the_equation_says() -> None:
    t = np.cumsum(np.random.default_rng(0).uniform(0.5, 3.0, 200))
    tau, starts = 20.0, np.array([0, 200])
    since = t - t[0]
    expected = 0.3 * (since - tau * -np.expm1(-since / tau))
    np.testing.assert_allclose(followed(0.3 * since, t, starts, tau), expected, atol=1e-12)
    held = followed(np.append(0.0, np.ones(199)), t, starts, tau, is_held=True)
    np.testing.assert_allclose(held, -np.expm1(-since / tau), atol=1e-12)


def test_wind_up_goes_on_from_where_the_turn_was() -> None:
    sense, way = np.array([1.0, 1.0, -1.0, -1.0]), np.array([0.0, 50.0, 2.0, 4.0])
    found = wound_up(sense, way, np.zeros(4, dtype=np.int64), 3.0)
    np.testing.assert_allclose(found[:2], -0.5)
    np.testing.assert_allclose(found[2:], 0.5 - np.exp([-2 / 3, -4 / 3]))


@pytest.mark.parametrize("name", NOISES)
def test_noise_is_what_its_kind_says(name: str) -> None:
    kind = NOISES[name]
    n_passes, per_pass = 400, 60
    number = np.repeat(np.arange(n_passes), per_pass)
    session, t = number // 100, np.tile(np.arange(100 * per_pass), 4) * 1.0
    drawn = draw_noise(np.random.default_rng(8), kind, number, session, t)
    clean = (drawn.total_mm - drawn.correlated_mm)[~drawn.is_outlier]
    # 24,000 numbers: 0.5 % of their deviation, three times that for the tails of t with 4 degrees of freedom.
    np.testing.assert_allclose(1e3 * clean.std(axis=0), kind.white_um, rtol=0.06 if kind.tail_dof else 0.025)
    np.testing.assert_allclose(1e3 * drawn.stated_mm[0], kind.white_um)
    share = kind.gross_share + kind.moderate_share
    assert drawn.is_outlier.mean() == pytest.approx(share, abs=5 * np.sqrt(share / len(t)) + 1e-12)
    wandering = draw_noise(np.random.default_rng(8), replace(kind, drift_um=0.0), number, session, t)
    offset = wandering.correlated_mm[::per_pass]
    assert 1e3 * offset.std() == pytest.approx(kind.pass_offset_um, rel=0.1)


def test_drift_forgets_with_its_time() -> None:
    """Autocorrelation at one correlation time is 1/e; a fifth of the session is one."""
    t = np.arange(500) * 1.0
    kind = replace(NOISES["drift-2"], white_um=(0.0, 0.0, 0.0))
    lag, products, squares = 100, [], []
    for seed in range(80):
        path = draw_noise(np.random.default_rng(seed), kind, np.zeros(500, int), np.zeros(500, int), t).total_mm
        products.append(np.mean(path[:-lag] * path[lag:]))
        squares.append(np.mean(path**2))
    assert 1e3 * np.sqrt(np.mean(squares)) == pytest.approx(2.0, rel=0.1)
    # 240 paths of about five independent stretches each: 0.04.
    assert np.mean(products) / np.mean(squares) == pytest.approx(np.exp(-lag / (0.2 * 499)), abs=0.12)


def test_error_functions_have_their_size_and_smoothness() -> None:
    machine, errors = draw_machine(np.random.default_rng(1), None)
    q = np.linspace(
        [axis.range_mm[0] for axis in machine.axes.values()],
        [axis.range_mm[1] for axis in machine.axes.values()],
        400,
    )
    moved = errors.at(machine, q)
    np.testing.assert_allclose(1e3 * moved.delta_mm.std(axis=0), 25.0, rtol=0.01)
    np.testing.assert_allclose(1e6 * moved.epsilon_rad.std(axis=0), 60.0, rtol=0.01)


def test_null_cases_hold_nothing_but_the_base() -> None:
    """F-test of structure outside the base, on 60 seeds and all plans: p uniform (Kolmogorov–Smirnov at 0.1 %)."""
    p_values = [null_p(generate(seed, plan=SHOWN_PLANS[seed % 4], n_rows=900), seed) for seed in range(60)]
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_the_same_test_sees_what_is_hidden() -> None:
    """Eight micrometres among ten in 900 rows: 570 in chi-squared, most of it in the wave's three columns."""
    case = generate(1, "wbXYZt", "mixed", hidden=[Hidden("diagonal-wave")], strength_um=8.0, n_rows=900)
    assert null_p(case, 1) < 1e-6


def null_p(case: Case, seed: int) -> float:
    """Give the F-test's p for products of positions, directions and a wave in each component."""
    log = case.log
    turn = np.swapaxes(log.camera_from_base, 1, 2)
    error = (turn @ (case.observations.measured_mm - log.in_camera_mm)[:, :, None])[:, :, 0]
    projection = Projection(log, with_offsets=False)
    left = projection(error)
    share = np.stack([log.share(a) for a in range(3)])
    shapes = [share[0] * share[1], share[0] * share[2], share[1] * share[2], np.prod(share, axis=0)]
    shapes += [log.moved("direction", 0), np.sin(2 * np.pi * (log.q_mm[:, 0] + log.q_mm[:, 1]) / 170.0)]
    probes = np.zeros((log.n_rows, 3, 3 * len(shapes)))
    for number, shape in enumerate(shapes):
        for b in range(3):
            probes[:, b, 3 * number + b] = shape
    flat = projection(probes).reshape(-1, probes.shape[2])
    vectors, sizes, _ = np.linalg.svd(flat, full_matrices=False)
    vectors = vectors[:, sizes > 1e-6 * sizes[0]]
    explained = float(np.sum((vectors.T @ left.ravel()) ** 2))
    total, freedom = float(np.sum(left**2)), left.size - projection.rank
    count = vectors.shape[1]
    ratio = (explained / count) / ((total - explained) / (freedom - count))
    return float(stats.f.sf(ratio, count, freedom - count))


def test_relative_cases_are_seen_from_the_work_alone() -> None:
    case = generate(2, plan="volume-relative", n_rows=SMALL)
    assert (case.log.carrier == RELATIVE).all()
    assert "u_left" not in case.observations.frame.columns
    assert arms_mm(case.machine, case.log.plan).shape == (len(case.observations), 3)
