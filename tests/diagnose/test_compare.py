"""A model held against measurements: what is fitted and what is not, and every figure by hand."""

from __future__ import annotations

import itertools

import numpy as np
import polars as pl
import pytest
from compare_scenes import (
    MACHINE,
    NOISE_MM,
    beam,
    circle,
    measured,
    passes_along,
    places,
    rigid_residual_mm,
    term,
    turn,
    turning_its_sign,
    warming_up,
)
from scipy import stats

import geoerr
from geoerr.diagnose import common_rows, compare
from geoerr.diagnose.spread_trends import spreads_to_tell
from geoerr.errors import GeoerrError, GeometryError, ShapeError
from geoerr.fit import frames_only, own_freedom, sightings_of
from geoerr.fit.gross_rows import stand_alone
from geoerr.model import Model
from geoerr.observations import Lengths, Observations

SCALE = 40e-6
NOMINAL = Model(MACHINE)
BENT = Model(
    MACHINE,
    terms=(
        term("scale", "EXX", "k*x", k=SCALE),
        term("bow", "EZX", "c*x*(400-x)", c=4e-7),
        term("pitch", "EAY", "k1*y*y", k1=1e-9),
        term("square", "S_xy", "S", S=3e-4),
    ),
)


# What is fitted, and what is not.


def test_only_the_frame_is_fitted_and_the_residual_is_kabschs() -> None:
    rng = np.random.default_rng(1)
    q = places(rng)
    other = BENT.tool_from_work(q) + 1e-3 * np.column_stack([np.sin(q[:, 0] / 40.0), np.zeros((len(q), 2))])
    observations = measured(q, other, rng, noise_mm=1e-5)
    comparison = compare(BENT, observations)
    assert comparison.freedom == "held"
    expected = rigid_residual_mm(BENT.tool_from_work(q), observations.measured_mm)
    # Weights are equal, so that Kabsch's motion is the fit's. Its columns are those of the first frame, 3e-4 rad off
    # for the squareness, and so is the direction in which a residual of 1e-3 mm is least.
    np.testing.assert_allclose(comparison.residual_mm, expected, atol=3e-7)


def test_a_fit_of_the_same_terms_agrees_where_they_are_right_already() -> None:
    rng = np.random.default_rng(2)
    q = places(rng, 200)
    observations = measured(q, BENT.tool_from_work(q))
    fitted = frames_only(MACHINE, sightings_of(observations), BENT.terms)
    again = own_freedom(MACHINE, sightings_of(observations), BENT.terms)
    np.testing.assert_allclose(fitted.residual_mm, 0.0, atol=1e-9)
    np.testing.assert_allclose(again.residual_mm, 0.0, atol=1e-9)
    found = [parameter.value for each in again.terms for parameter in each.coefficients]
    np.testing.assert_allclose(found, [SCALE, 4e-7, 1e-9, 3e-4], rtol=1e-6)


def test_terms_can_be_fitted_on_top_of_what_is_held() -> None:
    rng = np.random.default_rng(3)
    q = places(rng, 200)
    more = Model(MACHINE, terms=(*BENT.terms, term("more", "EYY", "k*y", k=25e-6)))
    fitted = frames_only(MACHINE, sightings_of(measured(q, more.tool_from_work(q))), BENT.terms)
    on_top = fitted.again((term("more", "EYY", "k*y", k=0.0),))
    assert on_top.terms[0].coefficients[0].value == pytest.approx(25e-6, rel=1e-4)
    assert on_top.figures.rmse_um < 1e-2 < fitted.figures.rmse_um


def test_the_growth_of_a_hot_machine_is_not_fitted_away() -> None:
    rng = np.random.default_rng(4)
    cold, hot = places(rng, 150), places(rng, 150)
    model = geoerr.fit_model(
        MACHINE, measured(cold, NOMINAL.tool_from_work(cold), rng), components="none", effects=("scale:x",)
    ).model
    growth = Model(MACHINE, terms=(term("growth", "EXX", "k*x", k=200e-6),))
    warm = measured(hot, growth.tool_from_work(hot), rng)
    held, refit = compare(model, warm), compare(model, warm, refit=True)
    assert (held.freedom, refit.freedom) == ("held", "refit")
    # 200e-6 over x uniform in 0..400: a standard deviation of 400/sqrt(12) mm.
    assert held.rmse_um == pytest.approx(200e-3 * np.std(hot[:, 0]), rel=0.02)
    assert refit.rmse_um == pytest.approx(np.sqrt(3.0) * 1e3 * NOISE_MM, rel=0.15)
    assert held.lack_of_fit_p < 1e-9 < 0.001 < refit.lack_of_fit_p
    assert held.trends[0].variable == "x"
    assert held.trends[0].component == "x"


def test_its_own_data_are_known_by_their_digest_and_give_the_figures_of_the_fit() -> None:
    rng = np.random.default_rng(5)
    q = places(rng, 200)
    observations = measured(q, BENT.tool_from_work(q), rng)
    result = geoerr.fit_model(MACHINE, observations)
    own = compare(result.model, observations)
    assert own.freedom == "own"
    for name in ("rmse_um", "held_out_rmse_um", "noise_um", "lack_of_fit_p", "n"):
        assert own.to_document()[name] == pytest.approx(result.figures[name], rel=1e-6)
    # One digit of one cell makes them other data.
    frame = observations.frame.with_columns(mx=pl.col("mx") + pl.when(pl.col("x") == q[0, 0]).then(1e-9).otherwise(0))
    assert compare(result.model, Observations(frame)).freedom == "held"


def test_the_digest_is_of_the_rows_that_the_model_can_use() -> None:
    rng = np.random.default_rng(6)
    q = places(rng, 100)
    temp = np.where(np.arange(100) % 10 == 0, np.nan, rng.uniform(20.0, 40.0, 100))
    observations = measured(q, NOMINAL.tool_from_work(q), rng, temp_bed=temp)
    result = geoerr.fit_model(MACHINE, observations, components="none", effects=("thermal-expansion:x@temp_bed",))
    comparison = compare(result.model, observations)
    assert comparison.freedom == "own"
    assert comparison.points.sightings.left_out == {"nothing is known of temp_bed": 10}
    assert comparison.to_document()["left_out"] == {"nothing is known of temp_bed": 10}


def test_tables_of_errors_are_held_too() -> None:
    rng = np.random.default_rng(7)
    errors = geoerr.fit_model(MACHINE, measured(q := places(rng, 300), BENT.tool_from_work(q), rng)).model
    tables = Model(MACHINE, errors.error_functions())
    fresh = places(rng, 100)
    comparison = compare(tables, observations := measured(fresh, BENT.tool_from_work(fresh), rng))
    expected = rigid_residual_mm(tables.tool_from_work(fresh), observations.measured_mm)
    np.testing.assert_allclose(comparison.residual_mm, expected, atol=1e-7)
    assert comparison.rmse_um < 0.5 * compare(NOMINAL, observations).rmse_um


def test_errors_of_the_rig_are_held_and_their_absence_shows() -> None:
    rng = np.random.default_rng(8)
    q = places(rng, 100)
    seen = NOMINAL.tool_from_work(q) @ turn([0.3, -0.2, 0.9]).T + [50.0, -20.0, 5.0]
    # The camera's own scale, about the camera.
    observations = measured(q, NOMINAL.tool_from_work(q))
    scaled = (1.0 + 1e-4) * seen
    frame = observations.frame.with_columns(
        **{name: pl.Series(scaled[:, i]) for i, name in enumerate(("mx", "my", "mz"))}
    )
    rig = Model(MACHINE, terms=(term("camera", "rig-scale", "k", k=1e-4),))
    # Second order: 1e-4 of 1e-4 of half a metre.
    assert compare(rig, Observations(frame)).rmse_um < 0.02
    assert compare(NOMINAL, Observations(frame)).rmse_um > 5.0


def test_the_same_with_any_number_of_threads_and_twice() -> None:
    rng = np.random.default_rng(9)
    q = places(rng, 300)
    observations = measured(q, BENT.tool_from_work(q), rng)
    documents = [compare(NOMINAL, observations, threads=threads).to_document() for threads in (1, 2, 1)]
    assert documents[0] == documents[1] == documents[2]


# Gross errors.


def test_a_glint_stands_alone_and_a_machine_that_warmed_up_does_not() -> None:
    rng = np.random.default_rng(10)
    x = np.linspace(0.0, 400.0, 80)
    error = rng.normal(0.0, 1.0, 80)
    error[40:] += 500.0
    error[17] += 200.0
    comparison = compare(NOMINAL, beam(x, error))
    assert np.flatnonzero(~comparison.points.solved.used).tolist() == [17]
    left = np.delete(error, 17)
    assert comparison.rmse_um == pytest.approx(float(np.std(left)), rel=1e-6)
    assert comparison.figures.n == 79
    assert [row["residual_um"][0] for row in comparison.to_document()["outliers"]] == [
        pytest.approx(error[17] - left.mean())
    ]


def test_two_mistakes_beside_each_other_do_not_hide_each_other() -> None:
    rng = np.random.default_rng(12)
    x = np.linspace(0.0, 400.0, 80)
    error = rng.normal(0.0, 1.0, 80)
    error[[17, 18]] += 200.0, -150.0
    comparison = compare(NOMINAL, beam(x, error))
    assert np.flatnonzero(~comparison.points.solved.used).tolist() == [17, 18]


def test_noise_alone_has_no_gross_rows() -> None:
    rng = np.random.default_rng(11)
    sightings = sightings_of(measured(q := places(rng, 2000), q, rng))
    # Heavier tails than Gauss's may lose a row in a thousand, no more.
    assert not stand_alone(sightings, rng.normal(size=(2000, 3))).any()
    assert stand_alone(sightings, rng.standard_t(5, size=(2000, 3))).sum() <= 2


# Figures by hand.


def test_figures_of_a_beam_by_hand() -> None:
    x = np.tile([0.0, 100.0, 200.0], 4)
    sense = np.repeat([1, -1, 1, -1], 3)
    error = np.array([3.0, 5.0, 4.0, -4.0, -2.0, -6.0, 5.0, 5.0, 6.0, -6.0, -4.0, -6.0])
    comparison = compare(NOMINAL, beam(x, error, dir_x=sense, repeat=np.repeat([0, 0, 1, 1], 3), line=["there"] * 12))
    mean = error.mean()
    document = comparison.to_document()
    assert document["rmse_um"] == pytest.approx(np.sqrt(np.mean((error - mean) ** 2)))
    assert document["rms_per_component_um"][1:] == [None, None]
    assert document["by_axis"]["x"]["rms_um"] == pytest.approx(document["rmse_um"])
    assert document["n_components"] == [12, 0, 0]
    there, back = error[sense > 0] - mean, error[sense < 0] - mean
    assert document["by_direction"]["x+"]["mean_um"]["x"] == pytest.approx(there.mean())
    assert document["by_direction"]["x-"]["rmse_um"] == pytest.approx(np.sqrt(np.mean(back**2)))
    # Six places and directions, twice each: half of the sum of squared differences, over six.
    first, again = error[:6], error[6:]
    floor = np.sqrt(np.sum((first - again) ** 2 / 2.0) / 6.0)
    assert document["noise_floor_um"] == pytest.approx(floor)
    assert document["worst"][0] == {
        "line": "there",
        "x": 200.0,
        "y": 0.0,
        "z": 0.0,
        "residual_um": [pytest.approx(-6.0 - mean), None, None],
        "is_outlier": False,
    }
    assert document["set_up"]["as_measured_rms_um"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert document["set_up"]["shifted_rms_um"] == pytest.approx(document["rmse_um"])
    # F of what is left of 11 degrees of freedom by the 6 of the repeats.
    total, pure = np.sum((error - mean) ** 2), floor**2 * 6.0
    expected = stats.f.sf((total - pure) / 5.0 / (pure / 6.0), 5, 6)
    assert document["lack_of_fit_p"] == pytest.approx(expected)
    assert len(document["by_region"]) == 3
    ends = error[x == 200.0] - mean
    last = document["by_region"][-1]
    assert last["low_mm"] == pytest.approx([400.0 / 3.0, 0.0, 0.0])
    assert last["mean_um"]["x"] == pytest.approx(ends.mean())
    assert last["std_um"]["x"] == pytest.approx(ends.std(ddof=1))
    assert last["n"] == 4


def test_trends_are_means_of_bins_with_what_passes_have_in_common() -> None:
    x = np.tile(np.arange(10.0) * 40.0, 4)
    offset = np.repeat([2.0, -2.0, 1.0, -1.0], 10)
    comparison = compare(
        NOMINAL, beam(x, offset, repeat=np.repeat([0, 1, 2, 3], 10), load=np.repeat([0, 1, 0, 1], 10))
    )
    trends = {trend.variable: trend for trend in comparison.trends if trend.component == "x"}
    high, low = trends["load"].bins
    assert (high.mean_um, low.mean_um) == (pytest.approx(1.5), pytest.approx(-1.5))
    # Two passes in each bin, sums of deviations ±5 in 20 rows: √(2/1 · 50) / 20.
    assert high.std_error_um == pytest.approx(0.5)
    assert trends["load"].worth_um == pytest.approx(np.sqrt(1.5**2 - 0.5**2))
    assert trends["x"].worth_um == 0.0
    assert comparison.trends[0].worth_um == max(trend.worth_um for trend in comparison.trends)


def test_of_many_values_bins_hold_as_many_rows_each_and_empty_cells_are_left_out() -> None:
    load = np.where(np.arange(100) % 5 == 0, np.nan, np.arange(100.0))
    comparison = compare(NOMINAL, beam(np.linspace(0.0, 400.0, 100), 0.1 * np.arange(100.0) ** 1.5, load=load))
    bins = next(trend for trend in comparison.trends if trend.variable == "load").bins
    assert [one.n for one in bins] == [8] * 10
    assert all(one.high < other.low for one, other in itertools.pairwise(bins))
    assert comparison.components[0].residual_um[np.isfinite(load)].size == sum(one.n for one in bins)


def test_bins_have_their_rms_and_a_size_that_depends_on_a_variable_is_seen() -> None:
    """Of sin(x)·(T − T₀) the mean over T is 0 everywhere, and the rms is least at T₀."""
    rng = np.random.default_rng(10)
    observations, temp = turning_its_sign(rng)
    comparison = compare(NOMINAL, observations)
    first = comparison.spread_trends[0]
    assert (first.variable, first.component) == ("temp_bed", "y")
    assert first.stands_out
    over = {(one.variable, one.component): one for one in comparison.trends}["temp_bed", "y"]
    residual_um = 1e3 * comparison.residual_mm[:, 1]
    for one in over.bins:
        rows = (temp >= one.low) & (temp <= one.high) & comparison.points.solved.used
        assert one.rms_um == pytest.approx(np.sqrt(np.mean(residual_um[rows] ** 2)))
        assert one.spread_um == pytest.approx(residual_um[rows].std())
    assert first.least_um == min(one.spread_um for one in over.bins) < 0.5 * first.most_um
    document = comparison.to_document()
    assert document["spread_trends"][0]["stands_out"]
    assert spreads_to_tell(comparison.spread_trends, 0.1 * comparison.rmse_um)[0] is first
    assert "its size follows" in comparison._repr_html_()


@pytest.mark.parametrize(("n_passes", "n_rows", "offset_mm"), [(96, 10, 5e-4), (40, 6, 3e-3), (6, 40, 1e-3)])
def test_of_noise_alone_no_size_follows_anything(n_passes: int, n_rows: int, offset_mm: float) -> None:
    rng = np.random.default_rng(11)
    told = 0
    for _ in range(30):
        q, own_pass = passes_along(rng, n_passes, n_rows)
        true = NOMINAL.tool_from_work(q) + rng.normal(0.0, offset_mm, (n_passes, 3))[own_pass]
        lines = [f"L{number}" for number in own_pass]
        observations = measured(q, true, rng, line=lines, temp_bed=warming_up(rng, len(q)), t=5.0 * np.arange(len(q)))
        told += any(one.stands_out for one in compare(NOMINAL, observations).spread_trends)
    # At most 1 of 100 by chance: two of 30 would be rare.
    assert told <= 1


def scattered(
    rng: np.random.Generator,
    n_passes: int,
    n_rows: int,
    offset_mm: float,
    grows: bool,
    *,
    has_names: bool = True,
    z_mm: float | None = None,
) -> Observations:
    """Points anywhere, or at one height, runs that are off by something each, and another temperature in each."""
    own_pass = np.repeat(np.arange(n_passes), n_rows)
    temp = rng.permutation(warming_up(rng, n_passes))[own_pass]
    q = places(rng, len(own_pass))
    q[:, 2] = q[:, 2] if z_mm is None else z_mm
    noise = rng.normal(0.0, 1e-3, q.shape) * (1.0 + 2.0 * grows * (temp - temp.min()) / np.ptp(temp))[:, None]
    true = NOMINAL.tool_from_work(q) + rng.normal(0.0, offset_mm, (n_passes, 3))[own_pass] + noise
    names = {"line": [f"L{number}" for number in own_pass]} if has_names else {}
    return measured(q, true, temp_bed=temp, t=5.0 * np.arange(len(q)), **names)


@pytest.mark.parametrize("has_names", [True, False])
@pytest.mark.parametrize(("n_passes", "n_rows"), [(12, 20), (24, 10)])
def test_offsets_that_scattered_points_share_follow_nothing(n_passes: int, n_rows: int, has_names: bool) -> None:
    """Nearly every step of such a run turns an axis round: as passes of their own its rows were told to be 8 µm wide
    at one temperature and 4 µm at another, in four of five sets.
    """
    rng = np.random.default_rng(14)
    told = 0
    for _ in range(12):
        observations = scattered(rng, n_passes, n_rows, 8e-3, grows=False, has_names=has_names)
        told += any(one.stands_out for one in compare(NOMINAL, observations).spread_trends)
    assert told <= 1


def test_a_scatter_that_grows_from_run_to_run_is_told_beneath_larger_offsets() -> None:
    first = compare(NOMINAL, scattered(np.random.default_rng(15), 24, 10, 8e-3, grows=True)).spread_trends[0]
    assert first.variable == "temp_bed"
    assert first.stands_out
    # From 1 µm to 3, of offsets of 8 µm nothing.
    assert first.is_within_runs
    assert 0.5 < first.least_um < 1.7
    assert 1.7 < first.most_um < 4.0


def test_at_which_height_a_plane_was_measured_does_not_matter() -> None:
    """Rounding of an axis that stood at 0.1 mm was taken for a lean, 10³⁰⁰ times as large."""
    told = [
        compare(NOMINAL, scattered(np.random.default_rng(16), 24, 10, 8e-3, grows=True, z_mm=z_mm)).spread_trends[0]
        for z_mm in (0.0, 0.1, 100.0)
    ]
    assert {one.variable for one in told} == {"temp_bed"}
    assert [one.p_value for one in told[1:]] == pytest.approx([told[0].p_value] * 2, rel=1e-3)


def test_what_a_fit_leaves_of_exact_data_follows_nothing() -> None:
    q, own_pass = passes_along(np.random.default_rng(12), 40, 6)
    exact = measured(q, NOMINAL.tool_from_work(q), line=[f"L{number}" for number in own_pass])
    assert compare(NOMINAL, exact).spread_trends == ()


def test_models_are_compared_on_their_common_rows() -> None:
    rng = np.random.default_rng(12)
    q = places(rng, 60)
    temp = np.where(np.arange(60) < 20, np.nan, 30.0 + rng.normal(size=60))
    observations = measured(q, NOMINAL.tool_from_work(q), rng, temp_bed=temp)
    warm = Model(MACHINE, terms=(term("growth", "EXX", "a*(temp_bed-20)*x", a=1e-7),))
    rows = common_rows((NOMINAL, warm), observations)
    assert rows.sum() == 40
    one, other = (compare(model, observations, rows=rows) for model in (NOMINAL, warm))
    assert one.figures.n == other.figures.n == 40
    assert compare(NOMINAL, observations).figures.n == 60
    half = np.arange(40) < 20
    both = np.sqrt(np.mean(np.sum(one.residual_mm[half] ** 2, axis=1))) * 1e3
    assert one.figures_on(half).rmse_um == pytest.approx(both)
    with pytest.raises(ShapeError, match=r"rows must be \(60,\)"):
        compare(NOMINAL, observations, rows=np.ones(5, dtype=bool))


# Circles and lengths.


def test_circles_and_points_stand_side_by_side_and_are_reported_apart() -> None:
    rng = np.random.default_rng(13)
    q = places(rng, 80)
    points = measured(q, BENT.tool_from_work(q), rng)
    test = circle(BENT, noise_mm=NOISE_MM)
    both = compare(NOMINAL, points, test)
    alone = compare(NOMINAL, test)
    document = both.to_document()
    assert document["n"] == 170
    assert document["n_radial"] == 90
    assert document["radial_rms_um"] == pytest.approx(alone.rmse_um, rel=1e-6)
    assert document["rmse_um"] == pytest.approx(compare(NOMINAL, points).rmse_um, rel=1e-6)
    assert {component.name for component in both.components} == {"x", "y", "z", "radius"}
    # The right model leaves noise of both; centre and excess cost three of ninety numbers.
    right = compare(BENT, points, test).to_document()
    assert right["radial_rms_um"] == pytest.approx(1e3 * NOISE_MM, rel=0.25)
    assert right["rmse_um"] == pytest.approx(np.sqrt(3.0) * 1e3 * NOISE_MM, rel=0.15)


def test_a_circle_alone_by_hand() -> None:
    stretched = Model(MACHINE, terms=(term("scale", "EXX", "k*x", k=1e-4),))
    residual_um = compare(NOMINAL, test := circle(stretched)).residual_mm[:, 0] * 1e3
    # r(φ) = 100 mm + 10 µm cos²φ: the mean goes with the excess, 5 µm cos 2φ is left.
    angle = np.linspace(0.0, 2.0 * np.pi, test.frame.height, endpoint=False)
    np.testing.assert_allclose(residual_um, 5.0 * np.cos(2.0 * angle), atol=0.01)


def lengths(ends: list[tuple[list[float], list[float]]], measured_mm: list[float], **more: object) -> Lengths:
    columns = {f"{axis}{end + 1}": [pair[end][i] for pair in ends] for end in (0, 1) for i, axis in enumerate("xyz")}
    names = [f"f{number}" for number in range(len(ends))]
    frame = pl.DataFrame({"feature": names, **columns, "measured": measured_mm, **more})
    return Lengths(frame, ("lengths.csv",))


def test_lengths_by_hand() -> None:
    ends = [([0.0, 0.0, 0.0], [300.0, 0.0, 0.0]), ([0.0, 0.0, 0.0], [0.0, 200.0, 0.0])] * 2
    model = Model(MACHINE, terms=(term("scale", "EXX", "k*x", k=1e-4),))
    table = lengths(ends, [300.032, 200.001, 300.030, 200.003], group=["x", "y", "x", "y"])
    comparison = compare(model, table)
    held = comparison.lengths
    assert held is not None
    np.testing.assert_allclose(held.residual_um, [2.0, 1.0, 0.0, 3.0], atol=1e-6)
    assert comparison.rmse_um == pytest.approx(np.sqrt(14.0 / 4.0))
    # Both pairs differ by 2 µm: 2/√2.
    assert held.noise_floor_um == pytest.approx(np.sqrt(2.0))
    document = comparison.to_document()
    assert document["rmse_um"] == pytest.approx(np.sqrt(3.5))
    assert document["lengths"]["by_group"]["y"] == {"rms_um": pytest.approx(np.sqrt(5.0)), "n": 2}
    assert document["lengths"]["worst"][0]["feature"] == "f3"
    with pytest.raises(GeoerrError, match="measured lengths only"):
        _ = comparison.residual_mm


# The model's own doubt.


def test_a_held_models_own_covariance_is_no_lack_of_fit() -> None:
    """P-values of a right but uncertain model are uniform: 80 machines, Kolmogorov-Smirnov."""
    with_doubt, without, seen, promised = [], [], [], []
    for seed in range(80):
        rng = np.random.default_rng(1000 + seed)
        train, fresh = places(rng, 25), places(rng, 40)
        model = geoerr.fit_model(
            MACHINE,
            measured(train, NOMINAL.tool_from_work(train), rng),
            components="none",
            effects=("scale:x", "scale:y", "squareness:xy", "squareness:xz"),
            options=geoerr.FitOptions("none", threads=1),
        ).model
        comparison = compare(model, measured(fresh, NOMINAL.tool_from_work(fresh), rng), threads=1)
        with_doubt.append(comparison.lack_of_fit_p)
        without.append(comparison.points.split.lack_of_fit_p)
        seen.append(comparison.figures.rmse_um**2)
        promised.append(comparison.expected_rmse_um**2)
    assert stats.kstest(with_doubt, "uniform").pvalue > 0.01
    assert np.median(without) < np.median(with_doubt)
    # Six of 120 numbers go to the frame; the mean of 80 sums of squares is certain to about 1.5 %.
    assert np.mean(seen) == pytest.approx(np.mean(promised) - 3.0 * 1e6 * NOISE_MM**2 * 6.0 / 120.0, rel=0.05)


# Refusals.


def test_what_is_wanting_is_refused_by_name() -> None:
    rng = np.random.default_rng(14)
    q = places(rng, 20)
    observations = measured(q, NOMINAL.tool_from_work(q), rng)
    warm = Model(MACHINE, terms=(term("growth", "EXX", "a*(temp_bed-20)*x", a=1e-7),))
    with pytest.raises(GeoerrError, match="no column 'temp_bed'"):
        compare(warm, observations)
    with pytest.raises(GeometryError, match="no row has all that the model needs: temp_bed"):
        compare(warm, measured(q, NOMINAL.tool_from_work(q), rng, temp_bed=np.full(20, np.nan)))
    with pytest.raises(GeoerrError, match=r"backlash:x\.b: no value yet"):
        compare(NOMINAL + "backlash:x", observations)
    with pytest.raises(GeoerrError, match="no measurements"):
        compare(NOMINAL)
    table = lengths([([0.0, 0.0, 0.0], [300.0, 0.0, 0.0])], [300.0])
    with pytest.raises(GeoerrError, match="no column 'temp_bed', which the model needs"):
        compare(warm, table)
