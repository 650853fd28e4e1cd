"""Lasers, ball bars, static targets, missing conditions, sessions and files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from fit_scenes import (
    COVARIANCE_MM2,
    Numbers,
    covariance_columns,
    cubic,
    cubic_truth,
    curve_of,
    fitted,
    lost,
    measured_again,
    nine_lines_seen,
    no_errors,
    points,
    replaced,
    seen,
    term_of,
    value_of,
)
from virtual_machine import LENGTH_MM, Camera, Truth, camera, machine_of, nine_lines, observe, place

from geoerr.effects import catalogue
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.errors import GeometryError
from geoerr.fit import Components, FitOptions, Fitted, fit_terms, sightings_of
from geoerr.fit.start import planes_of_circles
from geoerr.identify.measurements import measurements_of
from geoerr.observations import STANDARD_UNCERTAINTY as STD
from geoerr.observations import CircularTest, Observations, observations_from_columns

MACHINE = machine_of("wZbXYt")
LEVEL = Camera(np.eye(3), np.zeros(3))
STD_MM = np.array([1e-3, 2e-3, 0.5e-3])


def laser_runs(truth: Truth, rng: np.random.Generator | None) -> Observations:
    """One session for each axis, tool against work, the component along the beam only, zeroed anywhere."""
    runs, names, zeros = [], [], {"x": 12.345, "y": -700.0, "z": 0.25}
    for index, axis in enumerate("xyz"):
        for q in truth.q_mm[axis]:
            command = np.zeros(3)
            command[index] = q
            at = place(MACHINE, truth, "relative", command, np.zeros(3))
            measured = np.full(3, np.nan)
            measured[index] = at[index] + zeros[axis]
            runs.append((command, measured))
            names.append(f"laser {axis}")
    q_mm, measured_mm = (np.array(column) for column in zip(*runs, strict=True))
    if rng is not None:
        measured_mm = measured_mm + STD_MM * rng.normal(size=measured_mm.shape)
    std = {f"s{name}": np.full(len(q_mm), STD_MM[index]) for index, name in enumerate("xyz")}
    return points(
        q_mm, np.zeros_like(q_mm), measured_mm, covariance_mm2=None, session=names, carrier=["relative"] * 27, **std
    )


def test_laser_runs_are_polynomials_through_their_own_zero() -> None:
    """Each run is one cubic with a free constant: NumPy's fit less its first value, and no other error responds."""
    truth = cubic_truth(np.random.default_rng(400))
    runs = laser_runs(truth, np.random.default_rng(401))
    result = fitted(MACHINE, runs)
    assert lost(result) == set(LINEAR_AND_ANGULAR) - {"EXX", "EYY", "EZZ"} | {"EC0Y", "EB0Z", "EA0Z"}
    q = truth.q_mm["x"]
    for index, (name, std_mm) in enumerate(zip(("EXX", "EYY", "EZZ"), STD_MM, strict=True)):
        own = np.asarray(runs.texts("session")) == f"laser {'xyz'[index]}"
        error = runs.measured_mm[own, index] - q
        design = np.vander(q / LENGTH_MM, 4, increasing=True)
        expected = design @ np.linalg.lstsq(design, error, rcond=None)[0]
        value, std = curve_of(result, name, q)
        # Unit directions and full rotations differ from sums by products of errors, 0.1 µm times 0.5 mrad.
        assert np.allclose(value, expected - expected[0], atol=1e-6)
        covariance = np.linalg.inv(design.T @ design) * (std_mm * result.scale) ** 2
        less_first = design - design[0]
        assert np.allclose(std, np.sqrt(np.einsum("ni,ij,nj->n", less_first, covariance, less_first)), rtol=1e-6)


def test_lasers_and_cameras_together_weigh_as_they_are_certain() -> None:
    """A laser of 1 µm beside a camera of 6 µm: positioning as certain as by both, S from the camera alone."""
    rng = np.random.default_rng(402)
    truth, seen_by_camera = nine_lines_seen(rng, MACHINE)
    apart = fitted(MACHINE, seen_by_camera), fitted(MACHINE, laser_runs(truth, rng))
    both = fitted(MACHINE, seen_by_camera, laser_runs(truth, rng))
    assert lost(both) == set()
    # The gain is at least that of the better one.
    at_end = np.array([LENGTH_MM])
    for name in ("EXX", "EYY", "EZZ"):
        value, std = curve_of(both, name, at_end)
        assert std[0] <= min(curve_of(one, name, at_end)[1][0] for one in apart)
        assert abs(value[0] - truth.tables[name][-1]) < 5.0 * std[0]


def circle(
    truth: Truth, plane: tuple[int, int], *, centre: Numbers, rng: np.random.Generator | None, **columns: object
) -> CircularTest:
    """A ball bar of 100 mm with its ball 0.2 mm off the centre and 0.05 mm too long."""
    angle = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    q = np.tile(centre, (120, 1))
    q[:, plane[0]] += 100.0 * np.cos(angle)
    q[:, plane[1]] += 100.0 * np.sin(angle)
    slip = np.array([0.12, -0.16, 0.0])[list(np.argsort(np.argsort([*plane, 3 - sum(plane)])))]
    at = np.array([place(MACHINE, truth, "relative", one, np.zeros(3)) for one in q])
    radius = np.linalg.norm(at - (centre + slip), axis=1) + 0.05
    if rng is not None:
        radius = radius + 1e-3 * rng.normal(size=len(radius))
    frame = pl.DataFrame({"line": ["c"] * 120, "x": q[:, 0], "y": q[:, 1], "z": q[:, 2], "r": radius, **columns})
    return CircularTest(frame, ("memory",))


def sheared() -> Truth:
    """Squareness 300 µrad, scales of +80 and −40 ppm, and nothing else."""
    truth = no_errors(3)
    q = truth.q_mm["x"]
    tables = truth.tables | {"EXX": 80e-6 * q, "EYY": -40e-6 * q}
    return Truth(truth.q_mm, tables, {"xy": 300e-6, "xz": 0.0, "yz": 0.0})


def test_ball_bar_alone() -> None:
    """A circle tells squareness and the difference of two scales; their mean is the radius, which is free."""
    effects = [catalogue()["squareness"].term("xy", None, MACHINE)]
    effects += [catalogue()["scale"].term(axis, None, MACHINE) for axis in "xy"]
    test = circle(sheared(), (0, 1), centre=np.array([200.0, 200.0, 0.0]), rng=np.random.default_rng(403))
    result = fitted(MACHINE, test, effects=effects, components="none")
    assert lost(result) == {"scale:x", "scale:y"}
    ids = [term.id for term in result.terms]
    x, y = ids.index("scale:x"), ids.index("scale:y")
    open_direction = result.null_space[:, 0] / np.abs(result.null_space[:, 0]).max()
    assert open_direction[x] == pytest.approx(open_direction[y], rel=1e-6)
    angle, std_rad = value_of(result, term_of(result, ids[0]).id)
    # Amplitude of sin 2φ: ½·S·R, of 120 radii with 1 µm: √(2/120) µm.
    expected_std = 2.0 * np.sqrt(2.0 / 120.0) * 1e-3 / 100.0 * result.scale / 1e-3
    assert std_rad == pytest.approx(expected_std, rel=0.02)
    assert abs(abs(angle) - 300e-6) < 4.0 * std_rad
    difference = value_of(result, "scale:x")[0] - value_of(result, "scale:y")[0]
    covariance = result.covariance
    std = np.sqrt(covariance[x, x] + covariance[y, y] - 2.0 * covariance[x, y])
    assert std == pytest.approx(expected_std, rel=0.02)
    assert abs(difference - 120e-6) < 4.0 * std
    assert result.scale == pytest.approx(1e-3, rel=5.0 * np.sqrt(0.5 / 110.0))


def test_ball_bar_beside_points() -> None:
    """Points with stated uncertainties and radii without: the mean scale is then known too."""
    rng = np.random.default_rng(404)
    truth = sheared()
    side = np.linspace(0.0, LENGTH_MM, 5)
    rows = [("relative", np.array([x, y, 0.0]), (0.0, 0.0, 0.0)) for x in side for y in side]
    grid = seen(MACHINE, truth, LEVEL, rows, rng)
    effects = [catalogue()["squareness"].term("xy", None, MACHINE)]
    effects += [catalogue()["scale"].term(axis, None, MACHINE) for axis in "xy"]
    test = circle(truth, (0, 1), centre=np.array([200.0, 200.0, 0.0]), rng=rng)
    result = fitted(MACHINE, grid, test, effects=effects, components="none")
    assert lost(result) == set()
    for axis, true in (("x", 80e-6), ("y", -40e-6)):
        value, std = value_of(result, f"scale:{axis}")
        assert abs(value - true) < 5.0 * std
    assert result.figures.n_radial == 120
    assert any("uncertainty" in note for note in result.sightings.notes)


def test_a_circle_of_which_no_row_is_left_has_no_plane() -> None:
    centre = np.array([200.0, 200.0, 0.0])
    near, far = (circle(sheared(), plane, centre=centre, rng=None) for plane in ((0, 1), (1, 2)))
    sightings = sightings_of(near, far)
    assert planes_of_circles(sightings, 0, 8).shape == (2, 8)
    left = sightings.select(sightings.session == 1, "not asked")
    normals = planes_of_circles(left, 0, 8)
    # The frame of the second circle, whose plane is that of y and z, begins at column 4.
    np.testing.assert_allclose(np.abs(normals), [[0, 0, 0, 0, 1, 0, 0, 0]], atol=1e-12)


def drifting(with_reference: bool, seed: int = 405) -> tuple[Truth, Observations]:
    """Nine lines one after the other while the camera wanders 60 µm, with or without a target on the base."""
    rng = np.random.default_rng(seed)
    truth = cubic_truth(rng)
    at = camera(rng)
    tool, bed = (
        {"A": (0.0, 0.0, 0.0), "B": (150.0, 150.0, 0.0), "C": (0.0, 0.0, 200.0)},
        {
            "D": (0.0, 0.0, 0.0),
            "E": (0.0, 200.0, 0.0),
            "F": (200.0, 0.0, 0.0),
        },
    )
    rows, names, times = [], [], []
    there_and_back = [*truth.q_mm["x"], *truth.q_mm["x"][::-1]]
    for number, (index, position) in enumerate((index, q) for index in range(3) for q in there_and_back):
        q = np.zeros(3)
        q[index] = position
        targets = [("work" if index == 2 else "tool", name, o) for name, o in (bed if index == 2 else tool).items()]
        if with_reference:
            targets.append(("base", "R", (250.0, -100.0, 50.0)))
        for carrier, name, offset in targets:
            rows.append((carrier, q, offset))
            names.append(name)
            times.append(10.0 * number)
    noisy = seen(MACHINE, truth, at, rows, rng, t=np.array(times), target=names)
    drift = np.array(times)[:, None] * np.array([60e-3, -40e-3, 30e-3]) / max(times)
    return truth, measured_again(noisy, drift)


def test_static_targets_hold_the_camera() -> None:
    truth, observations = drifting(with_reference=True)
    drift = catalogue()["camera-drift"].term(None, None, MACHINE)
    result = fitted(MACHINE, observations, effects=[drift])
    assert lost(result) == set()
    assert result.split.lack_of_fit_p is not None
    assert result.split.lack_of_fit_p > 1e-4
    for pair, true in truth.s_rad.items():
        value, std = value_of(result, f"S_{pair}")
        assert abs(value - true) < 5.0 * std
    without = fitted(MACHINE, observations)
    assert without.split.lack_of_fit_p is not None
    assert without.split.lack_of_fit_p < 1e-9
    # A target on the base is wherever it is: its stated offset means nothing.
    moved = observations.target_offset_mm + 1000.0 * (np.asarray(observations.texts("carrier")) == "base")[:, None]
    elsewhere = replaced(observations, **dict(zip(("tx", "ty", "tz"), moved.T, strict=True)))
    assert same_values(fitted(MACHINE, elsewhere, effects=[drift]), result)


def same_values(first: Fitted, second: Fitted, tolerance: float = 1e-9) -> bool:
    """Whether all coefficients agree, in their standard errors."""
    one = np.array([c.value for term in first.terms for c in term.coefficients])
    two = np.array([c.value for term in second.terms for c in term.coefficients])
    std = np.array([c.std for term in second.terms for c in term.coefficients])
    return bool((np.abs(one - two) <= tolerance * np.maximum(std, 1e-6)).all())


def test_rows_without_a_condition_are_left_out_and_counted() -> None:
    rng = np.random.default_rng(406)
    _, observations = nine_lines_seen(rng, MACHINE)
    temperature = rng.uniform(18.0, 30.0, len(observations))
    missing = rng.choice(len(observations), 7, replace=False)
    temperature[missing] = np.nan
    warm = replaced(observations, temp_bed=temperature)
    growth = catalogue()["thermal-drift"].term("z", "temp_bed", MACHINE)
    plain, result = fitted(MACHINE, warm), fitted(MACHINE, warm, effects=[growth])
    assert len(plain.sightings) == len(observations)
    assert plain.sightings.left_out == {}
    assert len(result.sightings) == len(observations) - 7
    assert list(result.sightings.left_out.values()) == [7]
    keep = np.isfinite(temperature)
    by_hand = Observations(warm.frame.filter(keep), warm.sources)
    # Pivots of frames differ, so that the last steps do.
    assert same_values(fitted(MACHINE, by_hand, effects=[growth]), result, 1e-3)


def test_a_row_that_measured_nothing_is_counted() -> None:
    rng = np.random.default_rng(407)
    observations = nine_lines_seen(rng, MACHINE)[1]
    measured = observations.measured_mm.copy()
    measured[4] = np.nan
    gap = replaced(observations, **dict(zip(("mx", "my", "mz"), measured.T, strict=True)))
    assert sightings_of(gap).left_out == {"nothing measured": 1}
    with pytest.raises(GeometryError, match="no row has a measured component"):
        sightings_of(Observations(gap.frame[4:5], gap.sources))


def two_sessions(seed: int) -> tuple[Observations, Observations]:
    rng = np.random.default_rng(seed)
    truth = cubic_truth(rng)
    first, second = (
        observe(
            MACHINE,
            truth,
            nine_lines(MACHINE, session=name),
            {name: camera(rng)},
            covariance_mm2=COVARIANCE_MM2,
            rng=rng,
        )
        for name in ("a", "b")
    )
    return first, second


def test_sessions_may_be_interleaved_in_a_file() -> None:
    """Each session keeps its own order; nothing else counts."""
    first, second = two_sessions(408)
    after = Observations(pl.concat([first.frame, second.frame]), ("one",))
    rows = np.arange(len(first))
    mixed = Observations(after.frame[np.column_stack([rows, rows + len(first)]).ravel()], ("one",))
    one, other = fitted(MACHINE, after), fitted(MACHINE, mixed)
    assert one.sightings.sessions == other.sightings.sessions == ("a", "b")
    assert one.sightings.n_passes == other.sightings.n_passes == 6
    assert same_values(one, other)
    assert other.sightings.source_row[:3].tolist() == [0, 2, 4]


def test_two_files_are_two_sessions() -> None:
    first, second = two_sessions(409)
    together = Observations(pl.concat([first.frame, second.frame]), ("one",))
    one, other = fitted(MACHINE, together), fitted(MACHINE, first, second)
    assert same_values(one, other)
    assert other.figures == one.figures
    # Even where both call theirs 0: a camera that moved between them is not one camera.
    unnamed = [replaced(table, session=["0"] * len(table)) for table in (first, second)]
    assert same_values(one, fitted(MACHINE, *unnamed))


def test_two_sessions_are_more_certain_than_one() -> None:
    """Twice the data from cameras that are turned alike, nothing shared but the errors: 1/√2."""
    first, _ = two_sessions(410)
    shifted = replaced(first, session=["b"] * len(first), mx=first.measured_mm[:, 0] + 1000.0)
    one, both = fitted(MACHINE, first), fitted(MACHINE, first, shifted)
    for name in LINEAR_AND_ANGULAR:
        at = np.array([LENGTH_MM / 3.0, LENGTH_MM])
        ratio = (curve_of(both, name, at)[1] / both.scale) / (curve_of(one, name, at)[1] / one.scale)
        assert np.allclose(ratio, np.sqrt(0.5), rtol=1e-3), name


def test_places_beyond_the_machines_range_are_noted() -> None:
    table, _ = two_sessions(412)
    assert not [note for note in fitted(MACHINE, table).sightings.notes if "outside the range" in note]
    small = replace(MACHINE, axes={**MACHINE.axes, "x": replace(MACHINE.axes["x"], range_mm=(0.0, 100.0))})
    notes = [note for note in fitted(small, table).sightings.notes if "outside the range of" in note]
    n_beyond = int((table.commanded_mm[:, 0] > 101.0).sum())
    assert n_beyond > 0
    assert len(notes) == 1
    assert f"range of x, 0 to 100 mm, in {n_beyond} of {len(table)} rows" in notes[0]


def in_row_six(observations: Observations, value: float) -> dict[str, Numbers]:
    sixth = np.arange(len(observations)) == 5
    return {name: np.where(sixth, value, own) for name, own in covariance_columns(observations).items()}


def test_a_row_with_a_singular_covariance_is_left_out_and_counted() -> None:
    first, _ = two_sessions(412)
    result = fitted(MACHINE, replaced(first, **in_row_six(first, 0.0)))
    assert result.sightings.left_out == {"its covariance is not positive": 1}
    assert len(result.sightings) == len(first) - 1


def test_where_no_covariance_is_positive_the_data_are_refused() -> None:
    first, _ = two_sessions(412)
    none = {name: np.zeros(len(first)) for name in ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")}
    with pytest.raises(GeometryError, match="row 1 is not positive"):
        fitted(MACHINE, replaced(first, **none))


@pytest.mark.parametrize("value", [0.0, -0.002])
def test_a_standard_uncertainty_that_is_not_positive_leaves_its_row_out(value: float) -> None:
    first, _ = two_sessions(412)
    bare = Observations(first.frame.drop("cxx", "cxy", "cxz", "cyy", "cyz", "czz"))
    std = dict.fromkeys(STD, np.full(len(bare), 0.002))
    sixth = replaced(bare, **std | {"sx": np.where(np.arange(len(bare)) == 5, value, 0.002)})
    told = sightings_of(sixth)
    assert told.left_out == {"its covariance is not positive": 1}
    assert any(
        note.startswith("1 row, the first in line 7 of its file, has no") and f"sx {value:g}" in note
        for note in told.notes
    )
    with pytest.raises(GeometryError, match=r"row 1 is not positive.*\nhint: .*above 0"):
        sightings_of(replaced(bare, **std | {"sx": np.full(len(bare), value)}))


def test_rows_without_a_covariance_get_the_mean_of_the_others() -> None:
    first, _ = two_sessions(413)
    columns = in_row_six(first, np.nan)
    result = fitted(MACHINE, replaced(first, **columns))
    assert same_values(result, fitted(MACHINE, first))
    assert any("given the mean of the others" in note for note in result.sightings.notes)


@pytest.mark.parametrize(
    ("stated", "note"),
    [
        (("sx", "sy"), "sx and sy are stated and sz is not: none of them is used; state sz, or leave mz out"),
        (
            ("sz",),
            "sz is stated and sx and sy are not: none of them is used; state sx and sy, or leave mx and my out",
        ),
        (
            ("cxx", "cyy", "czz"),
            "cxx, cyy and czz are stated and cxy, cxz and cyz are not: none of them is used; state all six elements "
            "of the covariance, or sx, sy and sz in their place",
        ),
    ],
)
def test_what_is_stated_of_some_components_alone_is_said_to_be_unused(stated: tuple[str, ...], note: str) -> None:
    first, _ = two_sessions(415)
    bare = Observations(first.frame.drop("cxx", "cxy", "cxz", "cyy", "cyz", "czz"))
    partly = sightings_of(replaced(bare, **dict.fromkeys(stated, np.full(len(bare), 0.01))))
    assert note in partly.notes
    assert not partly.is_stated
    assert (partly.whitening == sightings_of(bare).whitening).all()
    assert note in measurements_of(replaced(bare, **dict.fromkeys(stated, np.full(len(bare), 0.01)))).notes


def test_uncertainties_of_what_was_measured_are_enough_and_others_are_named() -> None:
    first, _ = two_sessions(416)
    bare = Observations(first.frame.drop("cxx", "cxy", "cxz", "cyy", "cyz", "czz"))
    std = dict.fromkeys(("sx", "sy"), np.full(len(bare), 0.01))
    flat = replaced(bare, **std, mz=np.full(len(bare), np.nan))
    assert sightings_of(flat).is_stated
    by_turns = {name: np.where(np.arange(len(bare)) % 3 == place, 0.01, np.nan) for place, name in enumerate(STD)}
    (note,) = [one for one in sightings_of(replaced(bare, **by_turns)).notes if "are stated" in one]
    assert note.startswith("sx, sy and sz are stated, but in no row for all that it measured")
    empty = dict.fromkeys(STD, np.full(len(bare), np.nan))
    assert "the columns are empty" in sightings_of(replaced(bare, **empty)).notes[0]


def test_line_bases_of_named_functions() -> None:
    """A basis that is named is used as it is; the others are chosen."""
    rng = np.random.default_rng(414)
    observations = nine_lines_seen(rng, MACHINE)[1]
    result = fitted(MACHINE, observations, bases={"EXX": cubic("x")})
    assert term_of(result, "EXX").parts[0].basis == cubic("x")
    assert {choice.name for choice in result.choices} == set(LINEAR_AND_ANGULAR) - {"EXX"}


@pytest.mark.parametrize("n_rows", [1, 2])
def test_a_row_or_two_are_too_few_and_that_is_said(n_rows: int) -> None:
    q_mm = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])[:n_rows]
    few = points(q_mm, np.zeros_like(q_mm), q_mm + 0.01, covariance_mm2=None, carrier=["relative"] * n_rows)
    with pytest.raises(GeometryError, match=f"in {n_rows} rows? leave nothing over"):
        fitted(machine_of("wZbXYt"), few, bases=None)


def test_what_is_given_twice_is_said_to_count_twice() -> None:
    rng = np.random.default_rng(3)
    _, first = nine_lines_seen(rng, MACHINE)
    again = replaced(first, session=["again"] * len(first))
    other = measured_again(again, rng.normal(size=(len(first), 3)) * 1e-3)
    twice = [note for note in sightings_of(first, again).notes if "counts twice" in note]
    assert twice == [
        "sessions 0 and again hold the same readings, digit for digit: one measurement counts twice, and all seems "
        "surer than it is; leave one out"
    ]
    assert not any("counts twice" in note for note in sightings_of(first, other).notes)


def copied(observations: Observations, rows: slice) -> Observations:
    return Observations(pl.concat([observations.frame, observations.frame[rows]]))


def counting(*tables: Observations | CircularTest) -> list[str]:
    return [note for note in sightings_of(*tables).notes if "counts twice" in note]


def test_rows_that_were_copied_are_said_to_count_twice() -> None:
    _, first = nine_lines_seen(np.random.default_rng(4), MACHINE)
    timed = replaced(first, t=np.arange(len(first), dtype=float))
    assert counting(first) == counting(timed) == []
    (note,) = counting(copied(first, slice(None)))
    assert note.startswith(
        f"{len(first)} rows, the first in line 2 of its file, are the same as another of the session"
    )
    (note,) = counting(copied(timed, slice(7, 8)))
    assert note.startswith("1 row, the first in line 9 of its file, is the same as another of the session")
    later = replaced(first, t=np.arange(len(first)) + 1e4)
    assert counting(Observations(pl.concat([timed.frame, later.frame]))) == []


def test_a_coarse_device_repeats_itself_honestly() -> None:
    _, first = nine_lines_seen(np.random.default_rng(5), MACHINE)
    assert counting(copied(first, slice(0, len(first) // 4))) == []
    again = replaced(first, repeat=np.ones(len(first), dtype=np.int64))
    assert counting(Observations(pl.concat([first.frame, again.frame]))) == []


def test_a_circle_that_is_given_twice_is_said_to_count_twice() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    radius = 50.0 + np.random.default_rng(6).normal(size=90) * 1e-3
    place = {"x": 50.0 * np.cos(angle), "y": 50.0 * np.sin(angle), "z": np.zeros(90)}
    test = CircularTest(pl.DataFrame({**place, "r": radius}))
    assert len(counting(test, test)) == 1
    assert counting(test) == []


def test_radii_that_state_their_uncertainty_in_part_say_that_none_is_used() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    place = {"x": 50.0 * np.cos(angle), "y": 50.0 * np.sin(angle), "z": np.zeros(90), "r": np.full(90, 50.0)}

    def notes(stated: Numbers) -> tuple[str, ...]:
        test = CircularTest(pl.DataFrame({**place, "sr": stated}, nan_to_null=True))
        return tuple(note for note in sightings_of(test).notes if "sr" in note)

    stated = np.full(90, 1e-3)
    assert notes(stated) == ()
    assert notes(np.full(90, np.nan)) == ()
    stated[:4] = np.nan
    (note,) = notes(stated)
    assert "in 4 of 90 radii" in note


@pytest.mark.parametrize("read", [sightings_of, measurements_of])
def test_a_component_that_no_row_states_has_the_mean_of_the_others(read: object) -> None:
    # Lasers along x and y, 1 µm and 3 µm stated, and points of a camera that states nothing.
    n = 6
    frame = pl.DataFrame(
        {
            "session": ["x"] * n + ["y"] * n + ["camera"] * n,
            **{axis: np.tile(np.linspace(0.0, 100.0, n), 3) for axis in "xyz"},
            "mx": [*np.linspace(0.0, 100.0, n), *[None] * n, *np.linspace(0.0, 100.0, n)],
            "my": [*[None] * n, *np.linspace(0.0, 100.0, n), *np.linspace(0.0, 100.0, n)],
            "mz": [*[None] * (2 * n), *np.linspace(0.0, 100.0, n)],
            "sx": [*[1e-3] * n, *[None] * (2 * n)],
            "sy": [*[None] * n, *[3e-3] * n, *[None] * n],
            "sz": pl.Series([None] * (3 * n), dtype=pl.Float64),
        },
        strict=False,
    )
    table = observations_from_columns(frame.to_dict(as_series=False))
    if read is sightings_of:
        of_camera = sightings_of(table).unwhitening[-1]
        variance_mm2 = np.diagonal(of_camera @ of_camera.T)
    else:
        covariance = measurements_of(table).covariance_mm2
        assert covariance is not None
        variance_mm2 = np.diagonal(covariance[-1])
    assert variance_mm2 == pytest.approx([1e-6, 9e-6, 5e-6], rel=1e-9)


def across(tilt_rad: float, components: str, *, y_mm: tuple[float, ...] = (150.0,)) -> Observations:
    """A bow of x by 8 µm, measured across along straight edges that are tilted, there and back."""
    rng = np.random.default_rng(2)
    there = np.linspace(0.0, LENGTH_MM, 15)
    rows = [(x, y) for y in y_mm for x in (*there, *there[::-1])]
    q_mm = np.array([(x, y, 100.0) for x, y in rows])
    bow_mm = 8e-3 * (1.0 - (2.0 * q_mm[:, 0] / LENGTH_MM - 1.0) ** 2)
    seen_mm = {"y": bow_mm + tilt_rad * q_mm[:, 0], "z": bow_mm + tilt_rad * (q_mm[:, 1] - 0.5 * q_mm[:, 0])}
    columns: dict[str, object] = {"carrier": ["relative"] * len(rows)}
    columns |= {axis: q_mm[:, number] for number, axis in enumerate("xyz")}
    columns |= {f"m{axis}": seen_mm[axis] + 2e-4 * rng.normal(size=len(rows)) for axis in components}
    return observations_from_columns(columns)


@pytest.mark.parametrize(("components", "y_mm"), [("yz", (150.0,)), ("y", (150.0,)), ("z", (50.0, 150.0, 250.0))])
@pytest.mark.parametrize("classic", ["21", "12"])
def test_a_straight_edge_may_be_tilted(components: str, y_mm: tuple[float, ...], classic: Components) -> None:
    """50 µrad of an edge of 400 mm were 72 µm of straightness."""
    options = FitOptions(components=classic, threads=1)
    fits = [
        fit_terms(MACHINE, [across(tilt_rad, components, y_mm=y_mm)], options=options)
        for tilt_rad in (0.0, 5e-5, 5e-3)
    ]
    for component in components:
        curves = [curve_of(one, f"E{component.upper()}X", np.linspace(0.0, LENGTH_MM, 9))[0] for one in fits]
        assert max(curves[0]) - min(curves[0]) == pytest.approx(8e-3, abs=4e-4)
        for other in curves[1:]:
            assert other == pytest.approx(curves[0], abs=2e-6), "but for the second order of a tilt"
    assert [one.figures.headline_um for one in fits] == pytest.approx([fits[0].figures.headline_um] * 3, rel=1e-3)
