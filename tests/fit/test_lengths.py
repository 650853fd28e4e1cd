"""Models fitted to measured lengths: a calliper on a printed part. The part is made by arithmetic of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest
from fit_scenes import cubic_truth, seen
from virtual_machine import LENGTH_MM, camera, machine_of, place

from geoerr.budget import uncertainty_budget
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.change import add_effect, remove_terms
from geoerr.diagnose.comparison import compare
from geoerr.errors import GeometryError
from geoerr.fit import FitResult, Sightings, fit_model, sightings_of
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import CircularTest, Lengths, Observations

Array = npt.NDArray[np.float64]
Pair = tuple[Sequence[float], Sequence[float]]

MACHINE = Machine.from_chain("wYbXZt", (300.0, 300.0, 200.0))
CORNERS = {"A": (50.0, 50.0, 0.0), "B": (250.0, 50.0, 0.0), "C": (250.0, 250.0, 0.0), "D": (50.0, 250.0, 0.0)}
SIDES_AND_DIAGONALS = ("AB", "BC", "CD", "DA", "AC", "BD")


def skewed(skew_rad: float, kx: float, ky: float) -> Callable[[Array], Array]:
    """A machine whose Y axis leans by an angle, and whose axes go too far."""
    y_axis = np.array([-np.sin(skew_rad), np.cos(skew_rad), 0.0])
    return lambda p: np.array([p[0] * (1.0 + kx), 0.0, p[2]]) + p[1] * (1.0 + ky) * y_axis


def lengths(
    pairs: Sequence[Pair], made: Callable[[Array], Array], std_mm: float = 0.0, seed: int = 0, **more: object
) -> Lengths:
    rng = np.random.default_rng(seed)
    ends = np.array(pairs, dtype=np.float64)
    measured = [float(np.linalg.norm(made(two) - made(one))) + std_mm * rng.normal() for one, two in ends]
    columns = {f"{axis}{end + 1}": ends[:, end, i] for end in (0, 1) for i, axis in enumerate("xyz")}
    names = [f"f{number}" for number in range(len(ends))]
    return Lengths(pl.DataFrame({"feature": names, **columns, "measured": measured, **more}), ("lengths.csv",))


def plate(made: Callable[[Array], Array], std_mm: float = 0.0, n_repeats: int = 1, seed: int = 0) -> Lengths:
    pairs = [(CORNERS[one], CORNERS[two]) for one, two in SIDES_AND_DIAGONALS] * n_repeats
    return lengths(pairs, made, std_mm, seed, repeat=np.repeat(np.arange(n_repeats), len(SIDES_AND_DIAGONALS)))


PRINTER = machine_of("wYbXZt")


def along_x(std_mm: float, carrier: str = "tool", n_times: int = 1, **columns: object) -> Observations:
    """A right machine seen along x, there and back."""
    rng = np.random.default_rng(2)
    there = np.linspace(0.0, LENGTH_MM, 15)
    places = np.concatenate([there, there[::-1]])
    line = [(carrier, np.array([x, 100.0, 50.0]), (0.0, 0.0, 0.0)) for x in places] * n_times
    right = cubic_truth(rng, angle_rad=0.0, delta_mm=0.0, s_rad=0.0)
    return seen(PRINTER, right, camera(rng), line, rng, covariance_mm2=np.eye(3) * std_mm**2, **columns)


def anywhere(n: int, seed: int) -> list[Pair]:
    rng = np.random.default_rng(seed)
    return [(rng.uniform(10.0, 290.0, 3) * (1, 1, 0.6), rng.uniform(10.0, 290.0, 3) * (1, 1, 0.6)) for _ in range(n)]


EFFECTS = ("scale:x", "scale:y", "squareness:xy")


def sizes(result: FitResult) -> tuple[Array, Array]:
    coefficients = [term.coefficients[0] for term in result.model.terms]
    return np.array([one.value for one in coefficients]), np.array([one.std for one in coefficients])


def test_skew_and_scales_are_those_of_the_sides_and_the_diagonals() -> None:
    """Of two sides and their diagonal the law of cosines tells the angle, exactly."""
    hidden = (1.2e-3, -4e-4, 5e-3)
    table = plate(skewed(hidden[2], *hidden[:2]))
    found, _ = sizes(fit_model(MACHINE, table, components="none", effects=EFFECTS))
    # A scale of an axis that leans: which of the two comes first is a convention, and their product 2e-6.
    np.testing.assert_allclose(found, hidden, atol=2.1e-6)
    alone, _ = sizes(fit_model(MACHINE, plate(skewed(hidden[2], 0.0, 0.0)), components="none", effects=EFFECTS))
    np.testing.assert_allclose(alone, [0.0, 0.0, hidden[2]], atol=1e-10)
    side, other, _, _, diagonal, _ = table.frame["measured"].to_list()
    angle = np.arccos((diagonal**2 - side**2 - other**2) / (-2.0 * side * other))
    # From A over B to C the corner at B is told, which leans the other way.
    assert found[2] == pytest.approx(0.5 * np.pi - angle, abs=2.1e-6)


def test_residuals_are_measured_less_predicted_lengths_exactly() -> None:
    """Of a machine with all its errors, far beyond the first order: angles of milliradians, and ends that turn."""
    machine, rng = machine_of("wYbXZt"), np.random.default_rng(3)
    truth = cubic_truth(rng, angle_rad=4e-3, delta_mm=0.5, s_rad=5e-3)
    places = [rng.uniform(0.0, LENGTH_MM, 3) for _ in range(300)]
    offsets = ((0.0, 0.0, 0.0), (80.0, 0.0, 10.0), (20.0, 90.0, 0.0))
    rows = [(carrier, q, offset) for q in places for carrier in ("tool", "work") for offset in offsets]
    model = fit_model(machine, seen(machine, truth, camera(rng), rows, rng)).model
    table = lengths(anywhere(25, 4), lambda p: place(machine, truth, "relative", p, np.zeros(3)), 0.02, 5)
    compared = compare(model, table)
    ends = [np.ascontiguousarray(table.frame.select(f"x{end}", f"y{end}", f"z{end}").to_numpy()) for end in (1, 2)]
    made = [model.tool_from_work(own) for own in ends]
    assert compared.lengths is not None
    expected_um = 1e3 * (table.frame["measured"].to_numpy() - np.linalg.norm(made[1] - made[0], axis=1))
    np.testing.assert_allclose(compared.lengths.residual_um, expected_um, atol=1e-3)
    assert compared.rmse_um == pytest.approx(np.sqrt(np.mean(expected_um**2)), rel=1e-6)
    # The machine of the points made the part, too: what is left is the calliper's.
    assert 12.0 < compared.rmse_um < 30.0


@pytest.mark.parametrize("is_stated", [True, False])
def test_standard_errors_and_doubt_are_those_of_many_parts(is_stated: bool) -> None:
    std_mm, hidden, n_parts = 0.02, (6e-4, -3e-4, 1e-3), 120
    deviations, p_values, held_out = [], [], []
    for seed in range(n_parts):
        table = plate(skewed(hidden[2], *hidden[:2]), std_mm, 3, seed)
        if is_stated:
            table = Lengths(table.frame.with_columns(s_measured=pl.lit(std_mm)))
        result = fit_model(MACHINE, table, components="none", effects=EFFECTS)
        found, error = sizes(result)
        deviations.append((found - hidden) / error)
        p_values.append(result.fitted.split.lack_of_fit_p)
        figures = result.fitted.held_out.figures
        assert figures is not None
        held_out.append((figures.length_rms_um, result.fitted.expected_held_out_um))
    # Student's with 15 degrees of freedom has 1.07; the standard error of each is 0.07.
    np.testing.assert_allclose(np.std(deviations, axis=0), 1.03, atol=0.22)
    np.testing.assert_allclose(np.mean(deviations, axis=0), 0.0, atol=0.3)
    assert 0.35 < np.mean(np.array(p_values, dtype=float) < 0.5) < 0.65
    of_the_fits, expected = np.mean(np.array(held_out, dtype=float), axis=0)
    assert of_the_fits == pytest.approx(expected, rel=0.06)


def test_the_pure_error_of_repeated_lengths_is_theirs() -> None:
    table = plate(skewed(1e-3, 0.0, 0.0), 0.03, 4, 8)
    fitted = fit_model(MACHINE, table, components="none", effects=EFFECTS).fitted
    measured = table.frame["measured"].to_numpy().reshape(4, len(SIDES_AND_DIAGONALS))
    pooled_um = 1e3 * np.sqrt(np.mean(np.var(measured, axis=0, ddof=1)))
    assert fitted.repeats.floor_um == pytest.approx(pooled_um, rel=1e-5)
    # Corners are shared by three lengths, and no repeats of each other.
    assert fitted.repeats.dof[0] == 3 * len(SIDES_AND_DIAGONALS)
    assert fitted.dof == 4 * len(SIDES_AND_DIAGONALS) - len(EFFECTS)


def test_lengths_stand_beside_points_and_circles() -> None:
    """A skew that points do not show by one line alone is told by the lengths, and the fit says how each is off."""
    points = along_x(1e-3)
    table = plate(skewed(2e-3, 0.0, 0.0), 0.01, 2, 3)
    table = Lengths(table.frame.with_columns(s_measured=pl.lit(0.01)))
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    round_one = {"x": 150.0 + 50.0 * np.cos(angle), "y": 150.0 + 50.0 * np.sin(angle), "z": 0.0 * angle}
    circle = CircularTest(
        pl.DataFrame({"line": "c", **round_one, "r": 50.0 - 0.05 * np.sin(2.0 * angle), "sr": 1e-3})
    )
    result = fit_model(PRINTER, points, table, circle, components="none", effects=["squareness:xy"])
    (skew,), (error,) = sizes(result)
    # r of a circle with its Y axis leaning by S: −R S sin φ cos φ.
    assert abs(skew - 2e-3) < 4.0 * error < 1e-4
    document = result.fitted.figures.to_document()
    assert document["n_lengths"] == 12
    assert document["n_radial"] == 90
    assert document["n"] == 30 + 12 + 90
    assert document["n_components"] == [30, 30, 30]


def test_lengths_that_state_nothing_are_as_sure_as_the_points_beside_them() -> None:
    points = along_x(2e-3)
    sightings = sightings_of(points, plate(skewed(0.0, 0.0, 0.0)))
    assert any("lengths state no uncertainty (column s_measured, mm)" in note for note in sightings.notes)
    assert std_of_lengths_mm(sightings) == pytest.approx(0.002)
    # Those that were measured again tell their own.
    again = sightings_of(points, plate(skewed(0.0, 0.0, 0.0), 0.03, 4))
    assert std_of_lengths_mm(again) == pytest.approx(0.03, rel=0.4)
    assert any("they got what they scatter when they are measured again" in note for note in again.notes)


def test_lengths_that_were_made_cold_and_warm_are_no_repeats_of_each_other() -> None:
    """Weighed beside points by what they scatter, and not by what they grow."""
    points = along_x(2e-3, temp=[20.0] * 30)
    pairs = anywhere(12, 3)
    parts = [
        lengths(pairs * 2, skewed(0.0, 1e-5 * (temp - 20.0), 0.0), 0.005, int(temp), temp=temp)
        for temp in (20.0, 90.0)
    ]
    sightings = sightings_of(points, Lengths(pl.concat([part.frame for part in parts])))
    assert std_of_lengths_mm(sightings) == pytest.approx(0.005, rel=0.4)


def std_of_lengths_mm(sightings: Sightings) -> float:
    """What lengths are weighed by, of two ends that are independent."""
    return float(np.sqrt(2.0) / np.median(sightings.whitening[sightings.of_kind("lengths"), 0, 0]))


def test_lengths_and_radii_that_state_nothing_are_weighed_by_what_each_scatters() -> None:
    """A ball bar of a micrometre beside a calliper of twenty: alike they would be as wrong as they differ."""
    deviations, p_values = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        skew, kx, ky = rng.normal(0.0, 1e-3, 3)
        made = skewed(skew, kx, ky)
        angle = np.tile(np.linspace(0.0, 2.0 * np.pi, 121)[:-1], 2)
        flat = np.column_stack([150.0 + 50.0 * np.cos(angle), 150.0 + 50.0 * np.sin(angle), 0.0 * angle])
        centre = made(np.array([150.0, 150.0, 0.0]))
        radius = np.array([float(np.linalg.norm(made(p) - centre)) for p in flat]) + 1e-3 * rng.standard_normal(240)
        columns = {"line": "c", **{name: flat[:, i] for i, name in enumerate("xyz")}, "r": radius}
        circle = CircularTest(pl.DataFrame({**columns, "repeat": np.repeat([0, 1], 120)}))
        result = fit_model(MACHINE, circle, plate(made, 0.02, 3, seed), components="none", effects=EFFECTS)
        found, error = sizes(result)
        deviations.append((found - np.array([kx, ky, skew])) / error)
        p_values.append(result.fitted.split.lack_of_fit_p)
    assert np.abs(np.std(deviations, axis=0) - 1.0).max() < 0.35
    assert 0.02 < np.mean(np.array(p_values, dtype=float) < 0.5) < 0.98


def test_a_temperature_while_the_part_was_made_is_followed() -> None:
    alpha, temperatures = 12e-6, (20.0, 60.0)
    tables = [
        lengths(anywhere(20, 6), skewed(0.0, alpha * (t - 20.0), 0.0), 0.002, seed, temp=t)
        for seed, t in enumerate(temperatures)
    ]
    joined = Lengths(pl.concat([table.frame for table in tables]))
    result = fit_model(MACHINE, joined, components="none", effects=["thermal-expansion:x@temp"])
    (found,), (error,) = sizes(result)
    assert abs(found - alpha) < 4.0 * error < 1e-6
    # A part of which nobody knows how warm it was takes no part.
    unknown = Lengths(
        joined.frame.with_columns(temp=pl.when(pl.col("temp") > 40.0).then(None).otherwise(pl.col("temp")))
    )
    compared = compare(result.model, unknown)
    assert compared.lengths is not None
    assert (len(compared.lengths), compared.lengths.n_lacking) == (20, 20)


def test_a_mistyped_length_and_one_without_extent_take_no_part_and_are_named() -> None:
    table = plate(skewed(1e-3, 0.0, 0.0))
    wrong = table.frame.with_columns(
        measured=pl.when(pl.int_range(pl.len()) == 2).then(20.01).otherwise(pl.col("measured")),
        x2=pl.when(pl.int_range(pl.len()) == 3).then(pl.col("x1")).otherwise(pl.col("x2")),
        y2=pl.when(pl.int_range(pl.len()) == 3).then(pl.col("y1")).otherwise(pl.col("y2")),
    )
    sightings = sightings_of(Lengths(wrong))
    assert len(sightings) == 2 * (len(SIDES_AND_DIAGONALS) - 2)
    assert sorted(sightings.left_out.values()) == [1, 1]
    assert any("20.01 mm where the end points are 200 mm apart" in note for note in sightings.notes)


def test_lengths_in_inches_are_refused() -> None:
    table = plate(skewed(0.0, 0.0, 0.0))
    inches = Lengths(table.frame.with_columns(pl.col("measured") / 25.4), ("lengths.csv",))
    with pytest.raises(GeometryError, match=r"lengths\.csv: 6 of 6 lengths .*0\.03937 times"):
        fit_model(MACHINE, inches, components="none", effects=["scale:x"])


LEAN = 5e-4


def leaning_column(p: Array) -> Array:
    """Z leans in x."""
    return p + np.array([-LEAN * p[2], 0.0, 0.0])


def test_what_hides_in_a_part_is_found_and_nothing_where_nothing_does() -> None:
    verdicts = []
    for seed in range(6):
        leaning = lengths(anywhere(30, seed) * 2, leaning_column, 0.02, seed)
        found = diagnose(Model(MACHINE), leaning)
        assert found.verdict in ("missing", "ambiguous")
        first = found.found[0]
        assert str(first.reference) == "squareness:xz"
        assert abs(first.parameters[0].value - LEAN) < 4.0 * first.parameters[0].std
        assert first.worth_um == pytest.approx(_rms_um(lengths(anywhere(30, seed), leaning_column)), rel=0.3)
        right = lengths(anywhere(30, seed) * 2, lambda p: p, 0.02, seed)
        verdicts.append(diagnose(Model(MACHINE), right).verdict)
    assert verdicts.count("nothing-missing") >= 5


def _rms_um(table: Lengths) -> float:
    ends = [table.frame.select(f"x{end}", f"y{end}", f"z{end}").to_numpy() for end in (1, 2)]
    off = table.frame["measured"].to_numpy() - np.linalg.norm(ends[1] - ends[0], axis=1)
    return float(1e3 * np.sqrt(np.mean(off**2)))


def test_few_lengths_that_are_far_off_are_not_passed_over() -> None:
    """Two causes at once in twelve lengths: a search takes the one for the noise of the other."""
    off = diagnose(Model(MACHINE), plate(skewed(2.1e-3, 1.6e-3, -4e-4), 0.02, 2, 4))
    right = diagnose(Model(MACHINE), plate(skewed(0.0, 0.0, 0.0), 0.02, 2, 4))
    words = "the lengths are off by far more than they scatter when they are measured again"
    assert bool(off.found) != any(words in note for note in off.notes)
    assert not any(words in note for note in right.notes)


def test_sides_that_are_alike_are_no_copies_and_copies_are_told() -> None:
    """Four sides of one length share their corners; the same table twice is one measurement."""
    table = Lengths(plate(skewed(0.0, 0.0, 0.0)).frame.drop("repeat"))
    assert not [note for note in sightings_of(table).notes if "counts twice" in note]
    twice = Lengths(pl.concat([table.frame] * 2))
    assert [note for note in sightings_of(twice).notes if "counts twice" in note]


def test_repeats_of_lengths_are_no_repeatability_of_points() -> None:
    fit = fit_model(MACHINE, plate(skewed(1e-3, 0.0, 0.0), 0.02, 3, 6), components="none", effects=EFFECTS)
    assert all("repeat" not in one.name for one in uncertainty_budget(fit).sources)


def test_effects_are_added_and_removed_with_lengths() -> None:
    table = plate(skewed(2e-3, 1e-3, 0.0), 0.01, 3, 4)
    added = add_effect(Model(MACHINE), table, reference="squareness:xy").result
    again = add_effect(added.model, table, reference="scale:x").result
    sizes_of = {term.id: term.coefficients[0] for term in again.model.terms}
    assert abs(sizes_of["squareness:xy"].value - 2e-3) < 4.0 * sizes_of["squareness:xy"].std
    assert abs(sizes_of["scale:x"].value - 1e-3) < 4.0 * sizes_of["scale:x"].std
    assert again.fitted.figures.length_rms_um < 0.2 * added.fitted.figures.length_rms_um
    back = remove_terms(again.model, [table], "scale:x").result
    assert back.fitted.figures.length_rms_um == pytest.approx(added.fitted.figures.length_rms_um, rel=1e-6)


def test_own_data_are_known_by_what_was_measured() -> None:
    table = plate(skewed(1e-3, 0.0, 0.0), 0.02, 2, 6)
    model = fit_model(MACHINE, table, components="none", effects=EFFECTS).model
    assert model.record is not None
    assert model.record.n_rows == 2 * len(SIDES_AND_DIAGONALS)
    own = compare(model, table)
    assert own.freedom == "own"
    document = own.to_document()
    assert document["held_out_rmse_um"] > document["rmse_um"] > 0.0
    assert 0.0 < document["lack_of_fit_p"] <= 1.0
    other = plate(skewed(1e-3, 0.0, 0.0), 0.02, 2, 7)
    held = compare(model, other)
    assert held.freedom == "held"
    # By the model's own doubt the other part's figure is the larger: g'Σg of each length, by differences.
    ends = [np.ascontiguousarray(other.frame.select(f"x{end}", f"y{end}", f"z{end}").to_numpy()) for end in (1, 2)]

    def predicted(step: np.ndarray) -> Array:
        terms = [
            term.with_values([term.coefficients[0].value + change])
            for term, change in zip(model.terms, step, strict=True)
        ]
        made = [Model(MACHINE, terms=tuple(terms)).tool_from_work(own) for own in ends]
        return np.linalg.norm(made[1] - made[0], axis=1)

    gradient = np.column_stack([(predicted(1e-6 * one) - predicted(-1e-6 * one)) / 2e-6 for one in np.eye(3)])
    doubt_mm2 = float(np.mean(np.einsum("nj,jk,nk->n", gradient, model.record.covariance, gradient)))
    noise_um = held.whole.split.noise_um
    assert noise_um is not None
    assert held.expected_rmse_um == pytest.approx(np.sqrt(noise_um**2 + 1e6 * doubt_mm2), rel=1e-3)


def test_what_is_found_is_held_out_as_a_fit_says() -> None:
    table = lengths(anywhere(30, 2) * 2, leaning_column, 0.02, 2)
    (first, *_) = diagnose(Model(MACHINE), table).found
    figures = fit_model(MACHINE, table, components="none", effects=["squareness:xz"]).fitted.held_out.figures
    assert figures is not None
    assert first.held_out_rmse_after_um == pytest.approx(figures.length_rms_um, rel=0.02)


def test_lengths_are_searched_beside_points_whose_directions_are_known() -> None:
    """A lean that points along one line do not show: the lengths beside them do, no row is left out, and a note says
    that the lengths alone tell more.
    """
    repeats = {"repeat": np.repeat([0.0, 1.0, 2.0], 30), "dir_x": np.tile(np.repeat([1.0, -1.0], 15), 3)}
    points = along_x(1e-3, "relative", 3, **repeats)
    table = lengths(anywhere(30, 5) * 2, leaning_column, 0.02, 5, s_measured=0.02)
    found = diagnose(Model(PRINTER), points, table)
    assert found.verdict != "nothing-missing"
    assert not any("nobody knows from which side" in note for note in found.notes)
    assert any("ask of the lengths alone, too" in note for note in found.notes)
    alone = diagnose(Model(PRINTER), table)
    assert str(alone.found[0].reference) == "squareness:xz"
    assert not any("ask of the lengths alone" in note for note in alone.notes)


def test_of_lengths_nobody_knows_that_an_axis_stood_at_the_first_of_their_ends() -> None:
    """Both ends of a length take no part in what follows directions: one of them alone is no length."""
    directions = {"dir_x": np.repeat([1.0, -1.0], 15)}
    table = lengths(anywhere(30, 5), lambda p: np.array(p), s_measured=0.02)
    fitted = fit_model(PRINTER, along_x(1e-3, **directions), table, components="none", effects=["backlash:x"]).fitted
    assert fitted.sightings.left_out == {"nothing is known of d_x": 30}


def test_a_length_from_its_other_end_is_the_same_and_conditions_have_any_name() -> None:
    pairs = [(CORNERS[one], CORNERS[two]) for one, two in SIDES_AND_DIAGONALS]
    swapped = [(two, one) for one, two in pairs]
    table = lengths(pairs + swapped, skewed(1e-3, 0.0, 0.0), 0.02, 3, d_x=1.0)
    fitted = fit_model(MACHINE, table, components="none", effects=EFFECTS).fitted
    assert fitted.repeats.dof[0] == len(SIDES_AND_DIAGONALS)
    assert not any("is not read" in note for note in fitted.sightings.notes)


def test_too_few_lengths_are_told_as_lengths() -> None:
    with pytest.raises(GeometryError, match=r"2 numbers in 2 lengths leave nothing over.*\n.*s_measured"):
        fit_model(MACHINE, lengths(anywhere(2, 1), skewed(0.0, 0.0, 0.0)), components="none", effects=EFFECTS)


def test_a_slip_among_repeats_is_named() -> None:
    table = plate(skewed(2e-3, 0.0, 0.0), 0.02, 3, 2)
    slipped = table.frame.with_columns(
        measured=pl.when(pl.int_range(pl.len()) == 8).then(pl.col("measured") + 1.0).otherwise(pl.col("measured")),
        file_row=pl.int_range(2, pl.len() + 2),
    )
    (note,) = [one for one in sightings_of(Lengths(slipped)).notes if "when they are measured again" in one]
    assert note.startswith("f2 was measured from ")
    assert "line 10 of its file" in note
    assert not any("mistyped" in one for one in sightings_of(table).notes)
