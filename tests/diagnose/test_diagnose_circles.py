"""Circular tests alone: causes with their values, ties, refusals, and what there is nothing of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest

from geoerr.diagnose import diagnose
from geoerr.diagnose.change import add_effect
from geoerr.diagnose.circles import CircleDiagnosis, diagnose_circles
from geoerr.diagnose.circles.causes import suspects_of
from geoerr.diagnose.circles.gross import stand_alone
from geoerr.diagnose.circles.noise import MEMORIES_RAD, SMOOTH_RAD, blocks_of, fit_noise, orthonormal
from geoerr.diagnose.circles.runs import Runs, checked, runs_of
from geoerr.diagnose.circles.shares import shares_of
from geoerr.diagnose.circles.state import State
from geoerr.diagnose.comparison import compare
from geoerr.effects import catalogue, load_effects
from geoerr.errors import GeoerrError, GeometryError
from geoerr.fit import sightings_of
from geoerr.fit.additions import additions
from geoerr.fit.variables import variable_columns
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import CircularTest

Numbers = npt.NDArray[np.float64]
MODEL = Model(Machine.from_chain("wZbXYt", (400.0, 400.0, 300.0)))
R_MM, CENTRE_MM = 100.0, np.array([200.0, 210.0, 0.0])
NOISE_UM = 0.3
FEEDS = (2000.0, 500.0)
# Ball off the centre, in 20 µm.
OFF = (0.7, -0.4)
# What a run does to the radius, µm: a function of angle (rad), sense and feed (mm/min), to first order.
Radius = Callable[[Numbers, int, float], Numbers]


def run(
    radius: Radius, sense: int, feed: float, rng: np.random.Generator, n: int = 180, **more: object
) -> pl.DataFrame:
    theta = 0.4 + sense * np.arange(n) * 2.0 * np.pi / n
    um = radius(theta, sense, feed) + 3.0 + 20.0 * (OFF[0] * np.cos(theta) + OFF[1] * np.sin(theta))
    um = um + NOISE_UM * rng.standard_normal(n)
    columns = {
        "line": ["XY"] * n,
        "dir": [sense] * n,
        "feed": [feed] * n,
        "x": CENTRE_MM[0] + R_MM * np.cos(theta),
        "y": CENTRE_MM[1] + R_MM * np.sin(theta),
        "z": np.zeros(n),
        "r": R_MM + 1e-3 * um,
    }
    return pl.DataFrame(columns | more)


def circular(
    radius: Radius, senses: tuple[int, ...] = (1, -1), feeds: tuple[float, ...] = FEEDS, seed: int = 0
) -> CircularTest:
    rng = np.random.default_rng(seed)
    return CircularTest(pl.concat([run(radius, s, f, rng) for f in feeds for s in senses]), ("memory",))


def runs_from(test: CircularTest) -> Runs:
    usable, problems, notes = checked((test,))
    return runs_of(compare(MODEL, *usable).points, problems, notes)


def nothing(theta: Numbers, sense: int, feed: float) -> Numbers:
    return np.zeros_like(theta)


def squareness(theta: Numbers, sense: int, feed: float) -> Numbers:
    """The angle is wider than 90 degrees by 30 µrad: x moves by -S y."""
    return -30e-3 * R_MM * np.sin(theta) * np.cos(theta)


def several(theta: Numbers, sense: int, feed: float) -> Numbers:
    """Backlash of 3 µm on X, of -2 on Y; X lags by 0.2 ms more; S of 30 µrad; X 25 µm/m too long; a bow of 4 µm."""
    cos, sin, v = np.cos(theta), np.sin(theta), feed / 60.0
    vx, vy = -sense * sin, sense * cos
    along_x = -1.5 * np.sign(vx) - 0.1 * v * vx - 30e-3 * R_MM * sin + 25e-3 * R_MM * cos
    along_y = 1.0 * np.sign(vy) + 0.1 * v * vy + 4.0 * (1.0 - cos**2)
    return along_x * cos + along_y * sin


@cache
def many() -> CircleDiagnosis:
    return diagnose_circles(MODEL, circular(several))


def value(diagnosis: CircleDiagnosis, name: str, parameter: str) -> tuple[float, float]:
    cause = next(one for one in diagnosis.found if str(one.reference) == name)
    found = next(one for one in cause.parameters if one.name == parameter)
    return found.value, found.std


@pytest.mark.parametrize(
    ("name", "parameter", "expected"),
    [
        ("backlash:x", "b", 3e-3),
        ("backlash:y", "b", -2e-3),
        ("servo-mismatch:xy", "dtau", 2e-4),
        ("squareness:xy", "S", 30e-6),
        ("scale-mismatch:xy", "m", 25e-6),
        ("straightness:x", "h_y", 4e-3),
    ],
)
def test_causes_are_told_apart_and_have_their_values(name: str, parameter: str, expected: float) -> None:
    found, std = value(many(), name, parameter)
    # Formulas are to first order; what second order adds is below a hundredth.
    assert abs(found - expected) < 4.0 * std + 0.01 * abs(expected)


def test_what_follows_speeds_is_added_to_circles_that_do_not_say_that_they_move() -> None:
    """Neither `moving` nor `t`: the circle's own motion and its feed are enough."""
    fitted = compare(MODEL, circular(several)).points
    added = additions(
        ["servo-mismatch:xy"], catalogue(), MODEL.machine, fitted.sightings, "none", lambda _: fitted, None
    )
    assert [one.reference for one in added] == ["servo-mismatch:xy"]


def test_nothing_else_is_found_and_the_parts_add_up() -> None:
    diagnosis = many()
    assert len(diagnosis.found) == 6
    assert diagnosis.unknown is None
    percent = [cause.percent or 0.0 for cause in diagnosis.ranked]
    worth_um = [cause.worth_um for cause in diagnosis.ranked]
    assert worth_um == sorted(worth_um, reverse=True)
    assert sum(percent) + diagnosis.shares.percent_unexplained == pytest.approx(100.0)
    assert diagnosis.shares.total == pytest.approx(diagnosis.shares.explained + NOISE_UM**2, rel=0.05)


def test_what_only_a_length_or_another_circle_tells_is_listed() -> None:
    diagnosis = many()
    bow = next(one for one in diagnosis.found if one.reference.effect == "straightness")
    assert [(str(one.reference), round(one.correlation, 3)) for one in diagnosis.tied_with(bow)] == [
        ("pitch-error:y", 1.0)
    ]
    assert bow.separate_by is not None
    assert "centre" in (bow.separate_by.plan or "")
    scales = next(one for one in diagnosis.found if one.reference.effect == "scale-mismatch")
    assert {"scale:x", "scale:y"} <= {str(alias.reference) for alias in scales.aliases}
    assert diagnosis.verdict == "ambiguous"


def test_a_cause_that_makes_up_for_another_is_said_to_leave_the_circle_worse_repaired_alone() -> None:
    """Play and a lag of the other sign: taken away alone, play leaves more than there was."""
    shares = [0.06, -0.02, 0.5]
    causes = [replace(many().found[0], percent=100.0 * share) for share in shares]
    cautious = [one.caution for one in causes]
    assert [bool(said) for said in cautious] == [False, True, False]
    assert "repaired alone" in causes[1].words()
    assert "−2 % of the explainable" in causes[1].words()


def test_document_and_words() -> None:
    diagnosis = many()
    document = diagnosis.to_document()
    for key in ("verdict", "p_value", "noise_floor_um", "held_out_rmse_um", "found", "candidates", "not_offered"):
        assert key in document
    first = document["found"][0]
    assert {"effect", "axis", "covariate", "p_value", "held_out_rmse_after_um", "worth_um", "parameters"} <= set(
        first
    )
    assert document["found"][-1]["held_out_rmse_after_um"] < 0.2 * document["held_out_rmse_um"]
    backlash = next(one for one in diagnosis.found if str(one.reference) == "backlash:x")
    assert "µm (lost motion)" in backlash.words()
    assert "% of the explainable" in backlash.words()
    assert "µm peak to peak" in backlash.words()
    suspect = next(one for one in diagnosis.candidates if not one.readings)
    assert suspect.words().startswith(f"{suspect.effect.title} ({suspect.reference}). Worth ")
    assert "peak to peak" not in suspect.words()
    assert suspect.to_document()["peak_to_peak_um"] is None


def test_every_step_has_words_and_the_search_ends_at_the_one_that_is_told_to() -> None:
    counts: list[tuple[int, int]] = []
    said: list[str] = []
    test = circular(squareness, feeds=(1000.0,))
    diagnose_circles(MODEL, test, progress=lambda done, total: counts.append((done, total)), on_step=said.append)
    assert [done for done, _ in counts] == list(range(len(counts)))
    assert counts[-1] == (len(said), len(said))
    assert said[0] == "the model and the circles are compared"
    assert any(text.endswith(" causes") for text in said)
    assert "values" in said[-1]

    def tell(what: str) -> None:
        if "structure" in what:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        diagnose_circles(MODEL, test, on_step=tell)


def test_figures_of_runs_are_those_of_the_standard() -> None:
    """G of each run: peak to peak about the least-squares circle, here of a sine and noise."""
    diagnosis = diagnose_circles(MODEL, circular(squareness, feeds=(1000.0,)))
    for one in diagnosis.runs:
        assert one.explained_um == pytest.approx(3.0, rel=0.05)
        assert 3.0 < one.circular_deviation_um < 3.0 + 8.0 * NOISE_UM
        assert one.rest_um < 8.0 * NOISE_UM
    (set_up,) = diagnosis.set_ups
    assert set_up.centre_um[:2] == pytest.approx((-20.0 * OFF[0], -20.0 * OFF[1]), abs=0.1)
    assert set_up.radius_um == pytest.approx(3.0, abs=0.1)


def test_what_a_model_explains_is_no_less_of_what_was_measured() -> None:
    """G is of the measured circle, whatever the model that is asked what it lacks."""
    test = circular(squareness, feeds=(1000.0,))
    change = add_effect(MODEL, test, reference="squareness:xy")
    plain, fitted = (diagnose_circles(model, test) for model in (MODEL, change.result.model))
    assert fitted.verdict == "nothing-missing"
    for before, after in zip(plain.runs, fitted.runs, strict=True):
        # A row more or less counts as a mistake.
        assert after.circular_deviation_um == pytest.approx(before.circular_deviation_um, rel=0.01)
        assert after.rest_um == pytest.approx(before.rest_um, rel=0.2)


def test_positions_to_a_micrometre_are_no_error_of_the_axes() -> None:
    """What files round commanded points by is the same in every run, and is none of the machine's."""
    test = circular(squareness, feeds=(1000.0, 1000.0, 1000.0), seed=11)
    rounded = test.frame.with_columns(pl.col("x", "y").round(3))
    diagnosis = diagnose_circles(MODEL, CircularTest(rounded, ("memory",)))
    assert [str(one.reference) for one in diagnosis.found] == ["squareness:xy"]
    assert diagnosis.unknown is None


def test_one_sense_cannot_tell_squareness_from_servos_and_the_other_can() -> None:
    alone = diagnose_circles(MODEL, circular(squareness, senses=(1,), feeds=(1000.0,)))
    assert alone.verdict == "ambiguous"
    assert str(alone.found[0].reference) == "squareness:xy"
    (tied,) = alone.tied_with(alone.found[0])
    assert (str(tied.reference), round(tied.correlation, 6)) == ("servo-mismatch:xy", 1.0)
    assert alone.found[0].separate_by is not None
    assert "counter-clockwise" in (alone.found[0].separate_by.plan or "")
    assert any("the other way" in note for note in alone.notes)
    both = diagnose_circles(MODEL, circular(squareness, feeds=(1000.0,)))
    assert (both.verdict, len(both.found)) == ("missing", 1)
    assert dict(both.not_offered)["radial-shrink:xy"].startswith("needs two feeds")


def test_nothing_is_found_where_nothing_is() -> None:
    diagnosis = diagnose_circles(MODEL, circular(nothing, seed=3))
    assert (diagnosis.verdict, diagnosis.found, diagnosis.unknown) == ("nothing-missing", (), None)
    assert diagnosis.p_value > 0.05
    assert len(diagnosis.candidates) > 3
    assert diagnosis.noise_um == pytest.approx(NOISE_UM, rel=0.3)
    assert not any("outside the range" in note for note in diagnosis.notes)


def test_places_that_the_machine_has_not_are_noted() -> None:
    """As where they are counted from the centre of the circle."""
    test = circular(nothing, seed=3)
    test = replace(test, frame=test.frame.with_columns(pl.col("x") - CENTRE_MM[0]))
    (note,) = (note for note in diagnose_circles(MODEL, test).notes if "outside the range" in note)
    assert note.startswith("places outside the range of x, 0 to 400 mm, in 360 of 720 rows: ")


def test_what_no_cause_explains_is_unknown() -> None:
    diagnosis = diagnose_circles(MODEL, circular(lambda theta, sense, feed: 2.0 * np.cos(7.0 * theta + 0.8)))
    assert diagnosis.verdict == "unknown"
    assert diagnosis.unknown is not None
    assert diagnosis.unknown.depends_on == ("x", "y")
    assert diagnosis.unknown.worth_um == pytest.approx(2.0 / np.sqrt(2.0), rel=0.1)
    assert diagnosis.shares.percent_unexplained == pytest.approx(100.0)


def test_values_and_worth_beside_structure_are_done_again() -> None:
    """Values are in the noise that has the structure in it, and worth is of the rows that decide nothing, too."""

    def lobed(theta: Numbers, sense: int, feed: float) -> Numbers:
        return several(theta, sense, feed) + 2.0 * np.cos(7.0 * theta + 0.8)

    diagnosis = diagnose_circles(MODEL, circular(lobed))
    searched = diagnosis.searched
    assert diagnosis.unknown is not None
    assert diagnosis.found
    set_up = orthonormal(searched.runs.set_up_columns)
    columns = np.concatenate([set_up, *(one.columns for one in searched.found)], axis=1)
    white, signal = (searched.noise_of_values.whiten(one) for one in (columns, searched.runs.signal_um))
    value = np.linalg.lstsq(white, signal, rcond=1e-9)[0][set_up.shape[1] :]
    whole_set_up = orthonormal(searched.whole.set_up_columns)
    for place, (cause, one) in enumerate(zip(diagnosis.found, searched.found, strict=True)):
        own, value = np.split(value, [one.columns.shape[1]])
        if not one.inner:
            assert own[0] == pytest.approx(cause.parameters[0].value, rel=1e-6)
            trace = searched.whole_columns(place) @ own
            trace -= whole_set_up @ (whole_set_up.T @ trace)
            assert np.sqrt((trace**2).mean()) == pytest.approx(cause.worth_um, rel=1e-6)


def test_a_mistake_is_left_out() -> None:
    test = circular(squareness, seed=4)
    frame = test.frame.with_columns(
        pl.when(pl.int_range(pl.len()) == 50).then(pl.col("r") + 0.03).otherwise(pl.col("r")).alias("r")
    )
    diagnosis = diagnose_circles(MODEL, CircularTest(frame, ("memory",)))
    assert [str(one.reference) for one in diagnosis.found] == ["squareness:xy"]
    assert any(note == "1 row stands alone far off the others and was left out" for note in diagnosis.notes)


def test_a_mistake_among_steep_lobes_is_no_pair_of_lost_steps() -> None:
    lobed = circular(lambda theta, sense, feed: 30.0 * np.cos(5.0 * theta + 0.4), seed=8)
    # Half as far off as the lobes are high, in the last run.
    frame = lobed.frame.with_columns(
        pl.when(pl.int_range(pl.len()) == 655).then(pl.col("r") + 0.015).otherwise(pl.col("r")).alias("r")
    )
    diagnosis = diagnose_circles(MODEL, CircularTest(frame, ("memory",)))
    assert (diagnosis.verdict, diagnosis.found) == ("unknown", ())
    assert any(note == "1 row stands alone far off the others and was left out" for note in diagnosis.notes)


def test_a_users_own_cause(tmp_path: object) -> None:
    path = f"{tmp_path}/own.toml"
    with open(path, "w", encoding="utf-8") as file:
        file.write(
            '[[effect]]\nid = "own-lobes"\ntitle = "Seven lobes"\nchannel = "rig"\ndirection = "scale"\n'
            'expression = "k*cos(7*atan2(y - 210, x - 200) + 0.8)"\n[effect.coefficients.k]\nunit = "1"\n'
        )
    test = circular(lambda theta, sense, feed: 2.0 * np.cos(7.0 * theta + 0.8))
    diagnosis = diagnose_circles(MODEL, test, effects=load_effects(path))
    assert [str(one.reference) for one in diagnosis.found] == ["own-lobes"]
    found, std = value(diagnosis, "own-lobes", "k")
    assert abs(found - 2e-5) < 4.0 * std


def test_refusals() -> None:
    with pytest.raises(GeoerrError, match="no measurements were given"):
        diagnose_circles(MODEL)
    short = circular(nothing, senses=(1,), feeds=(1000.0,))
    quarter = CircularTest(short.frame.head(60), ("memory",))
    with pytest.raises(GeometryError, match="covers 118°"):
        diagnose_circles(MODEL, quarter)
    deviations = CircularTest(short.frame.with_columns(pl.col("r") - R_MM), ("memory",))
    with pytest.raises(GeometryError, match=r"no radius.*not its deviation"):
        diagnose_circles(MODEL, deviations)
    diameters = CircularTest(short.frame.with_columns(pl.col("r") * 2.0), ("memory",))
    with pytest.raises(GeometryError, match=r"no radius.*not the diameter"):
        diagnose_circles(MODEL, diameters)


def test_positions_to_a_tenth_of_a_millimetre_are_pointed_out() -> None:
    test = circular(squareness, feeds=(1000.0,))
    told = checked((CircularTest(test.frame.with_columns(pl.col("x", "y").round(1)), ("memory",)),))[2]
    assert any("whole multiples of 0.1 mm" in note for note in told)
    assert not any("whole multiples" in note for note in checked((test,))[2])


def test_a_base_beside_the_centre_is_no_deviation() -> None:
    """A perfect circle of 100 mm seen from 1 mm beside its centre: its radii are no sine, by 5 µm."""
    theta = np.tile(np.arange(360) * 2.0 * np.pi / 360.0, 2)
    x, y = 100.0 * np.cos(theta), 100.0 * np.sin(theta)
    radius = np.hypot(x - 0.8, y + 0.6) + 1e-4 * np.random.default_rng(2).standard_normal(720)
    columns = {"line": ["XY"] * 720, "dir": [1] * 720, "feed": [1000.0] * 720, "repeat": [0] * 360 + [1] * 360}
    frame = pl.DataFrame(columns | {"x": x + 200.0, "y": y + 200.0, "z": np.zeros(720), "r": radius})
    diagnosis = diagnose_circles(MODEL, CircularTest(frame, ("memory",)))
    for one in diagnosis.runs:
        assert one.circular_deviation_um < 1.0
        assert one.circular_deviation_um == pytest.approx(one.rest_um, rel=0.05)


def test_a_sense_against_the_times_is_refused_and_rows_by_angle_are_turned() -> None:
    """A dir the wrong way round is a common slip: runs would be searched with time running backwards."""
    rng = np.random.default_rng(41)
    senses = (1, -1)
    runs = [run(lambda theta, sense, feed: 0.0 * theta, sense, 1000.0, rng) for sense in senses]
    numbered = [one.with_columns(pl.lit(repeat).alias("repeat")) for repeat, one in enumerate(runs)]
    timed = pl.concat([one.with_columns(pl.Series("t", 0.2 * np.arange(one.height))) for one in numbered])
    slip = CircularTest(timed.with_columns((-pl.col("dir")).alias("dir")), ("memory",))
    with pytest.raises(GeometryError, match="dir says counter-clockwise, but by its times the run goes clockwise"):
        checked((slip,))
    # One run of two: the other is still of use, the row says which.
    half = pl.concat([timed.head(180), timed.tail(180).with_columns(-pl.col("dir"))])
    kept, problems, _ = checked((CircularTest(half, ("memory",)),))
    assert kept[0].frame.height == 180
    assert [(one.row, one.column) for one in problems] == [(182, "dir")]
    # Without times the order of rows need not be that of time; but if it is, dir is wrong, which is said.
    by_angle = pl.concat([runs[0], runs[1].reverse()])
    turned, problems, notes = checked((CircularTest(by_angle, ("memory",)),))
    assert not problems
    assert any("in 1 of 2 runs the rows go round the other way than dir says" in note for note in notes)
    assert not any("other way" in note for note in checked((CircularTest(pl.concat(runs), ("memory",)),))[2])
    back = turned[0].frame.filter(pl.col("dir") == -1)
    assert back["x"].to_list() == runs[1]["x"].to_list()
    assert (np.diff(back["t"].to_numpy()) > 0.0).all()


def test_without_feed_and_time_only_shapes_are_looked_for() -> None:
    test = circular(squareness, feeds=(1000.0,))
    diagnosis = diagnose_circles(MODEL, CircularTest(test.frame.drop("feed", "dir"), ("memory",)))
    assert [str(one.reference) for one in diagnosis.found] == ["squareness:xy"]
    wanting = dict(diagnosis.not_offered)
    assert all("needs the feed" in wanting[name] for name in ("servo-mismatch", "vibration", "spiral"))


def test_noise_whitens_what_it_says() -> None:
    """σ²s²(I + U K Uᵀ) written out: whitened, it is one."""
    runs = runs_from(circular(nothing, seed=5))
    blocks = blocks_of(runs)
    noise = fit_noise(runs, blocks, runs.signal_um, runs.set_up_columns)
    dense = _covariance(runs, noise.sigma_um, noise.theta, noise.level)
    root = noise.whiten(np.eye(len(runs)))
    assert np.allclose(root @ dense @ root.T, np.eye(len(runs)), atol=1e-8)


def _covariance(runs: Runs, sigma: float, theta: Numbers, level: Numbers) -> Numbers:
    blocks = blocks_of(runs)
    member = np.repeat(np.arange(len(blocks.counts)), blocks.counts.astype(int))
    run_of = np.concatenate([np.full(own.stop - own.start, k) for k, own in enumerate(blocks.of_run)])
    apart = np.abs(blocks.angle[:, None] - blocks.angle[None, :])
    parts = [np.exp(-apart / one) for one in MEMORIES_RAD] + [np.exp(-0.5 * (apart / one) ** 2) for one in SMOOTH_RAD]
    wander = np.tensordot(theta, np.stack([*parts, np.ones_like(apart)]), 1) * (run_of[:, None] == run_of[None, :])
    inside = np.eye(len(runs)) + wander[np.ix_(member, member)]
    return sigma**2 * inside * np.outer(level, level)


def test_noise_is_most_likely_where_it_was_found() -> None:
    """The restricted likelihood by dense matrices has its maximum where the fit without caution ends."""
    rng = np.random.default_rng(6)
    test = circular(nothing, feeds=(1000.0,), seed=6)
    wander = np.concatenate([np.convolve(rng.standard_normal(180 + 14), np.ones(15), "valid") for _ in range(2)])
    test = CircularTest(test.frame.with_columns(pl.col("r") + pl.Series(1.5e-4 * wander)), ("memory",))
    runs = runs_from(test)
    noise = fit_noise(runs, blocks_of(runs), runs.signal_um, runs.set_up_columns, caution=0.0)
    basis = orthonormal(runs.set_up_columns)

    def likelihood(factors: Numbers) -> float:
        v = _covariance(runs, noise.sigma_um, noise.theta * factors, noise.level)
        inverse = np.linalg.inv(v)
        a = basis.T @ inverse @ basis
        left = runs.signal_um - basis @ np.linalg.solve(a, basis.T @ inverse @ runs.signal_um)
        return -0.5 * float(np.linalg.slogdet(v)[1] + np.linalg.slogdet(a)[1] + left @ inverse @ left)

    best = likelihood(np.ones(len(noise.theta)))
    # The offset is an upper bound by design, and not at its maximum.
    for place in range(len(noise.theta) - 1):
        for factor in (0.7, 1.4):
            factors = np.ones(len(noise.theta))
            factors[place] = factor
            assert likelihood(factors) < best + 0.02


def test_gains_are_those_of_least_squares_written_out() -> None:
    runs = runs_from(circular(several, seed=7))
    suspects, _ = suspects_of(runs, catalogue())
    state = State(runs, suspects)
    basis, left = state.context([])
    weight = np.linalg.inv(_covariance(runs, state.noise.sigma_um, state.noise.theta, state.noise.level))

    def square(columns: Numbers) -> float:
        a = columns.T @ weight @ columns
        rest = runs.signal_um - columns @ np.linalg.lstsq(a, columns.T @ weight @ runs.signal_um, rcond=1e-12)[0]
        return float(rest @ weight @ rest)

    without = square(state.set_up)
    for judged in state.bench.judge(basis, left, state.n, most_trials=20):
        k, trial = judged.group.k, judged.trial
        own = judged.group.columns[:, k * trial : k * (trial + 1)]
        own = own / np.linalg.norm(own, axis=0)
        assert judged.gain == pytest.approx(
            without - square(np.column_stack([state.set_up, own])), rel=1e-5, abs=1e-4
        )


def test_shares_of_traces_by_hand() -> None:
    """Two traces that overlap: 1 and 2 on shapes of mean square 1 and product 1/2."""
    runs = runs_from(circular(nothing, seed=8))
    noise = fit_noise(runs, blocks_of(runs), runs.signal_um, runs.set_up_columns)
    a = np.sqrt(2.0) * np.sin(2.0 * runs.angle_rad)
    b = 0.5 * a + np.sqrt(0.75) * np.sqrt(2.0) * np.cos(3.0 * runs.angle_rad)
    shares = shares_of(
        runs, noise, orthonormal(runs.set_up_columns), np.column_stack([a, 2.0 * b]), 0.0 * a, None, None
    )
    assert shares.by_cause == pytest.approx((1.0 + 1.0, 4.0 + 1.0), rel=1e-6)
    assert shares.explained == pytest.approx(7.0, rel=1e-6)


def test_a_run_knows_the_circle_that_led_to_it() -> None:
    """Travel and time since the reversal at the first rows, whose reversal lies before them."""
    sightings = sightings_of(circular(nothing, senses=(1,), feeds=(1200.0,)))
    d, s, since, v, a = variable_columns(sightings, ["d_x", "s_x", "t_rev_x", "v_x", "a_x"])
    theta = 0.4 + np.arange(180) * 2.0 * np.pi / 180
    assert np.allclose(v, -20.0 * np.sin(theta), atol=1e-9)
    assert np.allclose(a, -(20.0**2) / R_MM * np.cos(theta), atol=1e-9)
    assert np.array_equal(d, np.sign(v))
    passed = np.mod(theta, np.pi)
    assert np.allclose(since, passed * R_MM / 20.0, atol=1e-6)
    assert np.allclose(s, R_MM * (1.0 - np.cos(passed)), atol=1e-6)


def test_fine_runs_are_averaged_row_by_row() -> None:
    """2000 rows become 720 of two or three each: the sum of what is measured stays, and each stands in its middle."""
    rng = np.random.default_rng(9)
    runs = runs_from(CircularTest(run(squareness, 1, 1000.0, rng, n=2000), ("memory",)))
    averaged = runs.averaged()
    assert len(averaged) == 720
    counts = np.diff([*((np.arange(720) * 2000) // 720), 2000])
    assert float(counts @ averaged.signal_um) == pytest.approx(float(runs.signal_um.sum()), abs=1e-9)
    assert np.allclose(np.diff(averaged.travelled_rad), 2.0 * np.pi / 720, atol=2.0 * np.pi / 2000)


def dense(radius: Radius, n: int = 4000, seed: int = 0) -> CircularTest:
    """Two feeds of a bar that is read a hundred times a second and more."""
    rng = np.random.default_rng(seed)
    return CircularTest(pl.concat([run(radius, 1, feed, rng, n=n) for feed in (1000.0, 3000.0)]), ("memory",))


@pytest.mark.parametrize("pitch_mm", [2.0, 1.0])
def test_a_wave_of_few_rows_to_an_average_keeps_its_size_and_pitch(pitch_mm: float) -> None:
    """Columns stood at the middle row of what was averaged: 2 µm were 1.8, and a pitch of 1 mm 0.9946, certainly."""

    def wave(theta: Numbers, sense: int, feed: float) -> Numbers:
        return 2.0 * np.sin(2.0 * np.pi * R_MM * np.cos(theta) / pitch_mm) * np.cos(theta)

    (found,) = diagnose_circles(MODEL, dense(wave)).found
    assert str(found.reference) == "periodic:x"
    pitch = next(one for one in found.parameters if one.name == "P")
    sizes = [one for one in found.parameters if one.name in ("A", "B")]
    assert pitch.value == pytest.approx(pitch_mm, abs=max(4.0 * pitch.std, 1e-4 * pitch_mm))
    assert np.hypot(*[1e3 * one.value for one in sizes]) == pytest.approx(2.0, abs=0.06)


@pytest.mark.parametrize("frequency_hz", [12.0, 33.7])
def test_a_vibration_that_averages_hide_is_found_by_the_rows(frequency_hz: float) -> None:
    def shaken(theta: Numbers, sense: int, feed: float) -> Numbers:
        t_s = np.arange(len(theta)) * 2.0 * np.pi * R_MM / len(theta) / (feed / 60.0)
        return 2.0 * np.sin(2.0 * np.pi * frequency_hz * t_s + feed) * np.cos(theta)

    (found,) = diagnose_circles(MODEL, dense(shaken)).found
    assert str(found.reference) == "vibration:x"
    frequency = next(one for one in found.parameters if one.name == "f")
    assert frequency.value == pytest.approx(frequency_hz, abs=max(4.0 * frequency.std, 1e-4 * frequency_hz))


@pytest.mark.parametrize("frequency_hz", [3.3, 5.0])
def test_a_vibration_that_slow_runs_have_too_few_rows_for_is_told_by_the_fast_ones(frequency_hz: float) -> None:
    """At 1000 mm/min its rows see it slower: it was 1.475 Hz, or a periodic error of a pitch of 43.5 mm."""

    def shaken(theta: Numbers, sense: int, feed: float) -> Numbers:
        t_s = np.arange(len(theta)) * 2.0 * np.pi * R_MM / len(theta) / (feed / 60.0)
        return 3.0 * np.sin(2.0 * np.pi * frequency_hz * t_s + feed) * np.cos(theta)

    rng = np.random.default_rng(0)
    runs = [run(shaken, sense, feed, rng, n=180) for feed in (1000.0, 3000.0) for sense in (1, -1)]
    (found,) = diagnose_circles(MODEL, CircularTest(pl.concat(runs), ("memory",))).found
    assert str(found.reference) == "vibration:x"
    frequency = next(one for one in found.parameters if one.name == "f")
    assert frequency.value == pytest.approx(frequency_hz, abs=4.0 * frequency.std)


def test_dense_runs_of_nothing_have_no_fast_wave() -> None:
    assert diagnose_circles(MODEL, dense(nothing)).verdict == "nothing-missing"


def test_a_wave_is_told_by_its_own_pitch() -> None:
    """Too short to be tried by itself, it was told as the second harmonic of one of twice its pitch."""

    def waves(theta: Numbers, sense: int, feed: float) -> Numbers:
        x, y = R_MM * np.cos(theta), R_MM * np.sin(theta)
        short = 2.0 * np.sin(2.0 * np.pi * y / 4.0 + 0.2) * np.sin(theta)
        return short + 2.0 * np.sin(2.0 * np.pi * x / 11.0) * np.cos(theta)

    found = {str(one.reference): one for one in diagnose_circles(MODEL, circular(waves)).found}
    assert set(found) == {"periodic:x", "periodic:y"}
    names = {one.name: one.value for one in found["periodic:y"].parameters}
    assert names["P"] == pytest.approx(4.0, abs=2e-3)
    assert "A2" not in names


def test_copies_of_rows_are_set_aside_and_change_nothing() -> None:
    """A file that was appended to itself ended in a division by zero."""

    def play(theta: Numbers, sense: int, feed: float) -> Numbers:
        return -5.0 * np.sign(-sense * np.sin(theta)) * np.cos(theta)

    test = circular(play)
    once = diagnose_circles(MODEL, test)
    twice = diagnose_circles(MODEL, CircularTest(pl.concat([test.frame, test.frame]), test.sources))
    assert [str(one.reference) for one in twice.found] == [str(one.reference) for one in once.found] == ["backlash:x"]
    assert twice.found[0].parameters[0].value == once.found[0].parameters[0].value
    copies = [one for one in twice.searched.whole.set_aside if "says the same in every cell" in one.problem]
    assert len(copies) == test.frame.height


def test_a_feed_that_is_not_that_of_the_times_is_told() -> None:
    """A feed in m/min made a lag of 0.4 ms one of 400, without a word."""
    test = circular(nothing)
    angle = pl.int_range(pl.len()).over("dir", "feed") * 2.0 * np.pi / 180
    timed = test.frame.with_columns((angle * R_MM / (pl.col("feed") / 60.0)).alias("t"))
    told = [diagnose_circles(MODEL, CircularTest(frame, ("memory",))).notes for frame in (timed, _in_metres(timed))]
    assert not any("the feed is not that of the times" in note for note in told[0])
    assert any(
        note.startswith("in 4 runs the feed is not that of the times (0.5 and 500 mm/min)") for note in told[1]
    )


def test_a_circle_in_metres_is_told() -> None:
    test = circular(nothing, feeds=(1000.0,))
    small = test.frame.with_columns(pl.col("x", "y", "z", "r") / 1000.0)
    told = [diagnose_circles(MODEL, one).notes for one in (test, CircularTest(small, ("memory",)))]
    assert not any("in millimetres" in note for note in told[0])
    assert "the commanded circle has a radius of 0.1 mm: x, y, z and r are in millimetres" in told[1]


def _in_metres(frame: pl.DataFrame) -> pl.DataFrame:
    return frame.with_columns(pl.col("feed") / 1000.0)


def test_what_is_below_every_bar_is_rounding() -> None:
    test = circular(nothing, feeds=(1000.0,))
    still = CircularTest(test.frame.with_columns(pl.lit(R_MM).alias("r")), ("memory",))
    assert diagnose_circles(MODEL, still).verdict == "nothing-missing"


def test_a_spike_is_at_every_reversal_and_a_mistake_is_not() -> None:
    runs = runs_from(circular(nothing, seed=10))
    beside = np.abs(np.mod(runs.angle_rad + 0.5 * np.pi, np.pi) - 0.5 * np.pi) < 0.03
    assert beside.sum() >= 8
    spikes = np.where(beside, 8.0, 0.0) + 0.1 * np.random.default_rng(11).standard_normal(len(runs))
    assert not stand_alone(runs, spikes, np.zeros(len(runs)))[beside].any()
    mistake = np.flatnonzero(beside)[0]
    alone = np.where(np.arange(len(runs)) == mistake, 8.0, spikes - np.where(beside, 8.0, 0.0))
    assert np.flatnonzero(stand_alone(runs, alone, np.zeros(len(runs)))).tolist() == [mistake]


def test_rows_in_the_order_of_their_angles_are_diagnosed() -> None:
    """Without feeds nothing told that a clockwise run was listed backwards, and the search ended in an error."""
    driven = circular(several, feeds=(2000.0,))
    listed = pl.concat([driven.frame.filter(pl.col("dir") == 1), driven.frame.filter(pl.col("dir") == -1).reverse()])
    by_angle = diagnose_circles(MODEL, CircularTest(listed.drop("feed"), ("memory",)))
    in_order = diagnose_circles(MODEL, CircularTest(driven.frame.drop("feed"), ("memory",)))
    names = [str(one.reference) for one in in_order.found]
    assert "backlash:x" in names
    assert [str(one.reference) for one in by_angle.found] == names
    for name, parameter in (("backlash:x", "b"), ("backlash:y", "b"), ("squareness:xy", "S")):
        assert value(by_angle, name, parameter)[0] == pytest.approx(value(in_order, name, parameter)[0], rel=0.02)


def test_noise_alone_has_hardly_ever_a_row_that_stands_alone() -> None:
    runs = runs_from(
        CircularTest(
            pl.concat([run(nothing, s, f, np.random.default_rng(0), n=720) for f in FEEDS for s in (1, -1)]),
            ("memory",),
        )
    )
    rng = np.random.default_rng(12)
    noise = 0.1 * rng.standard_normal((300, len(runs)))
    with_one = sum(stand_alone(runs, one, np.zeros(len(runs))).any() for one in noise)
    # One in a hundred is what the limit is for: 3, and more than 9 of 300 in one of a thousand times.
    assert with_one <= 9
    # A mistake of six standard deviations is found still.
    noise[:, 1234] += 0.6
    assert np.mean([stand_alone(runs, one, np.zeros(len(runs)))[1234] for one in noise]) > 0.7


def test_the_search_among_points_names_the_one_among_circles() -> None:
    """It gave a verdict: of a machine with play, that a gantry racks."""
    with pytest.raises(GeoerrError, match="diagnose_circles"):
        diagnose(MODEL, circular(lambda theta, sense, feed: 3.0 * np.sign(np.sin(theta))))


def shrinking(theta: Numbers, sense: int, feed: float) -> Numbers:
    """8 µm less at 2000 mm/min."""
    return np.full_like(theta, -8.0 * (feed / 2000.0) ** 2)


def test_a_circle_that_shrinks_is_told_where_runs_share_a_set_up() -> None:
    diagnosis = diagnose_circles(MODEL, circular(shrinking))
    (found,) = diagnosis.found
    assert str(found.reference) == "radial-shrink:xy"
    assert found.readings[0].value == pytest.approx(-8.0, abs=3.0 * found.readings[0].std)
    assert not any("radial-shrink" in note for note in diagnosis.notes)


def test_with_a_set_up_for_every_run_it_is_said_that_shrinking_is_not_told() -> None:
    rng = np.random.default_rng(0)
    passes = [(sense, feed) for feed in FEEDS for sense in (1, -1)]
    frames = [
        run(shrinking, sense, feed, rng).with_columns(line=pl.lit(f"run {number}"))
        for number, (sense, feed) in enumerate(passes)
    ]
    diagnosis = diagnose_circles(MODEL, CircularTest(pl.concat(frames), ("memory",)))
    assert diagnosis.verdict == "nothing-missing"
    (note,) = (note for note in diagnosis.notes if "radial-shrink" in note)
    assert "From 500 to 2000 mm/min the radius changes by −7.5 µm" in note
    assert "give these runs one line" in note


def test_a_vibration_has_an_amplitude_and_no_phase() -> None:
    """Sine and cosine are each run's own: only how large it is holds for all."""

    def shaken(theta: Numbers, sense: int, feed: float) -> Numbers:
        phase = 0.3 + (sense + 1.0) * feed / 700.0
        time_s = np.abs(theta - theta[0]) * R_MM / (feed / 60.0)
        return 4.0 * np.cos(theta) * np.sin(2.0 * np.pi * 3.7 * time_s + phase)

    (found,) = diagnose_circles(MODEL, circular(shaken)).found
    document = found.to_document()["parameters"]
    assert list(document) == ["amplitude", "f"]
    assert abs(document["amplitude"]["value"] - 4e-3) < 4.0 * document["amplitude"]["std"]
    assert document["amplitude"]["unit"] == "mm"
    assert found.readings[0].value == pytest.approx(1e3 * document["amplitude"]["value"])


def test_play_along_an_axis_that_stands_still_is_not_told() -> None:
    def played(theta: Numbers, sense: int, feed: float) -> Numbers:
        return -4.0 * sense * np.sign(np.sin(theta)) * np.sin(theta)

    (found,) = diagnose_circles(MODEL, circular(played)).found
    assert str(found.reference) == "lateral-play:x"
    assert [one.name for one in found.term.coefficients] == ["l_y", "l_z"]
    assert list(found.to_document()["parameters"]) == ["l_y"]


@pytest.mark.parametrize("seed", range(3))
def test_an_s_of_one_axis_is_not_told_from_that_of_the_other(seed: int) -> None:
    """X's guide is off by 10 µm u³ along Y: what of it turns the diameters at 45° and 135° apart is squareness."""

    def bent(theta: Numbers, sense: int, feed: float) -> Numbers:
        return 10.0 * np.cos(theta) ** 3 * np.sin(theta)

    diagnosis = diagnose_circles(MODEL, circular(bent, seed=seed))
    assert diagnosis.verdict == "ambiguous"
    square, shape = diagnosis.ranked
    assert str(square.reference) == "squareness:xy"
    assert square.parameters[0].value == pytest.approx(-50e-6, abs=4.0 * square.parameters[0].std)
    names = {str(shape.reference), *(str(alias.reference) for alias in diagnosis.tied_with(shape))}
    assert names == {"straightness:x", "straightness:y"}
    s = next(one for one in shape.parameters if one.name.startswith("s_"))
    assert abs(s.value) == pytest.approx(0.010, abs=4.0 * s.std)


def bump(theta: Numbers, sense: int, feed: float) -> Numbers:
    """X is off by 12 µm within some millimetres at x = 230."""
    return 12.0 * np.exp(-(((R_MM * np.cos(theta) - 30.0) / 6.0) ** 2)) * np.cos(theta)


def plateau(theta: Numbers, sense: int, feed: float) -> Numbers:
    turned = np.mod(theta, 2.0 * np.pi)
    return 8.0 * ((turned > 1.0) & (turned < 1.7))


def step(theta: Numbers, sense: int, feed: float) -> Numbers:
    return 8.0 * (np.mod(theta, 2.0 * np.pi) > np.radians(65.0))


def noisy(radius: Radius, seed: int) -> CircularTest:
    """Runs at three feeds with noise of 1 µm, a set-up each."""
    rng = np.random.default_rng(seed)
    passes = [(sense, feed) for feed in (600.0, 1800.0, 3000.0) for sense in (1, -1)]

    def scattered(theta: Numbers, sense: int, feed: float) -> Numbers:
        return radius(theta, sense, feed) + 0.95 * rng.standard_normal(len(theta))

    frames = [
        run(scattered, sense, feed, rng, n=120).with_columns(line=pl.lit(f"run {number}"))
        for number, (sense, feed) in enumerate(passes)
    ]
    return CircularTest(pl.concat(frames), ("memory",))


@pytest.mark.parametrize("radius", [bump, plateau, step])
@pytest.mark.parametrize("seed", range(2))
def test_what_is_at_one_place_of_every_run_is_no_wave_and_no_lost_step(radius: Radius, seed: int) -> None:
    diagnosis = diagnose_circles(MODEL, noisy(radius, seed))
    assert not {one.reference.effect for one in diagnosis.found} & {"periodic", "screw-wobble", "lost-steps"}
    assert diagnosis.unknown is not None
    assert set(diagnosis.unknown.depends_on) <= {"x", "y"}


@pytest.mark.parametrize("amplitude_um", [0.7, 4.0])
def test_a_wave_keeps_its_name_beside_what_is_rough(amplitude_um: float) -> None:
    def wave(theta: Numbers, sense: int, feed: float) -> Numbers:
        return amplitude_um * np.sin(2.0 * np.pi * (CENTRE_MM[0] + R_MM * np.cos(theta)) / 8.0) * np.cos(theta)

    (found,) = diagnose_circles(MODEL, noisy(wave, 1)).found
    assert str(found.reference) == "periodic:x"
    assert found.term.inner[0].value == pytest.approx(8.0, abs=4.0 * found.term.inner[0].std)


def test_a_step_of_one_run_that_stays_is_lost() -> None:
    def lost(theta: Numbers, sense: int, feed: float) -> Numbers:
        is_after = (np.abs(theta - theta[0]) > 2.0) & (sense == 1) & (feed == 1800.0)
        return 5.0 * is_after * np.cos(theta)

    (found,) = diagnose_circles(MODEL, noisy(lost, 1)).found
    assert str(found.reference) == "lost-steps:x"
    assert abs(found.parameters[0].value - 5e-3) < 4.0 * found.parameters[0].std
