"""Stated uncertainties against the scatter and the errors of many noise draws."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest
from virtual_machine import AXES, Move, Truth, camera, draw_truth, li_nine_lines, machine_of, nine_lines, observe

from geoerr.error_functions import ErrorFunction, ErrorFunctions
from geoerr.errors import ShapeError
from geoerr.identify import NineLineResult, analyze_nine_lines, identify_nine_line
from geoerr.observations import Observations

Numbers = npt.NDArray[np.float64]

N_DRAWS = 200
CHAIN = "wZbXYt"
MACHINE = machine_of(CHAIN, tool_offset_mm=(10.0, -20.0, -60.0))
# As of a stereo pair: three times as uncertain in depth, turned against every axis.
_ROOT = np.array([[3e-3, 0.0, 0.0], [1e-3, 4e-3, 0.0], [-2e-3, 3e-3, 9e-3]])
COVARIANCE = _ROOT @ _ROOT.T


def with_noise(observations: Observations, rng: np.random.Generator, factor: float = 1.0) -> Observations:
    noise = factor * rng.normal(size=(len(observations), 3)) @ _ROOT.T
    measured = observations.measured_mm + noise
    frame = observations.frame.with_columns(
        **{name: pl.Series(measured[:, index]) for index, name in enumerate(("mx", "my", "mz"))}
    )
    return Observations(frame, observations.sources)


@dataclass
class Draws:
    """What many draws gave, by name: values, stated standard uncertainties, true values."""

    value: dict[str, list[Numbers]] = field(default_factory=lambda: defaultdict(list))
    std: dict[str, list[Numbers]] = field(default_factory=lambda: defaultdict(list))
    true: dict[str, Numbers] = field(default_factory=dict)
    results: list[NineLineResult] = field(default_factory=list)

    def add(self, truth: Truth, result: NineLineResult) -> None:
        self.results.append(result)
        for name, table in _tables(result.errors).items():
            assert table.std is not None
            is_free = table.std > 0.0
            error = name.split()[-1]
            true = np.interp(table.position_mm, truth.q_mm[error[2].lower()], truth.tables[error])
            self._add(name, table.value[is_free], table.std[is_free], true[is_free])
        for name, one in result.errors.squareness.items():
            assert one.std_rad is not None
            self._add(name, np.array([one.value_rad]), np.array([one.std_rad]), np.array([truth.iso()[name]]))

    def _add(self, name: str, value: Numbers, std: Numbers, true: Numbers) -> None:
        self.value[name].append(value)
        self.std[name].append(std)
        self.true[name] = true

    def ratio(self, name: str) -> float:
        """Scatter over stated standard uncertainty, root mean square over points."""
        scatter = np.std(self.value[name], axis=0, ddof=1)
        return float(np.sqrt(np.mean((scatter / np.mean(self.std[name], axis=0)) ** 2)))

    def coverage(self, name: str, z: float = 1.96) -> float:
        within = np.abs(np.array(self.value[name]) - self.true[name]) < z * np.array(self.std[name])
        return float(within.mean())


def _tables(errors: ErrorFunctions) -> dict[str, ErrorFunction]:
    tables = dict(errors.functions)
    for name, table in errors.alternatives["straightness-integrated"].items():
        assert isinstance(table, ErrorFunction)
        tables[f"integrated {name}"] = table
    return tables


@pytest.fixture(scope="module")
def draws() -> Draws:
    """Nine lines of a tangent-following machine, axes parked off, targets off the carriage origin."""
    rng = np.random.default_rng(50)
    truth = draw_truth(rng, CHAIN, n_points=7)
    tool = {"A": (30.0, 40.0, 50.0), "B": (180.0, 200.0, 30.0), "C": (20.0, 10.0, 240.0)}
    bed = {"D": (100.0, 120.0, -30.0), "E": (90.0, 300.0, -20.0), "F": (310.0, 140.0, 10.0)}
    moves = [
        Move(axis, MACHINE.side(axis), bed if axis == "z" else tool, (100.0, 150.0, 200.0), line=axis)
        for axis in AXES
    ]
    exact = observe(MACHINE, truth, moves, {"0": camera(rng)}, covariance_mm2=COVARIANCE)
    collected = Draws()
    for _ in range(N_DRAWS):
        collected.add(truth, analyze_nine_lines(with_noise(exact, rng), MACHINE))
    return collected


def test_scatter_is_as_stated(draws: Draws) -> None:
    """One function's points are correlated: at worst as uncertain as a single one, √(1/2·199) = 5 %; four of that."""
    ratios = {name: draws.ratio(name) for name in draws.value}
    assert len(ratios) == 18 + 6 + 3
    assert {
        name: ratio for name, ratio in ratios.items() if abs(ratio - 1.0) > 4 * np.sqrt(0.5 / (N_DRAWS - 1))
    } == {}
    pooled = float(np.sqrt(np.mean(np.square(list(ratios.values())))))
    assert abs(pooled - 1.0) < 0.03


def test_95_percent_of_the_truth_lies_within_95_percent_intervals(draws: Draws) -> None:
    """A single point's coverage over 200 draws is uncertain by 1.5 %; correlated points of a function gain little."""
    coverage = {name: draws.coverage(name) for name in draws.value}
    assert {name: share for name, share in coverage.items() if abs(share - 0.95) > 4 * 0.0154} == {}
    assert abs(float(np.mean(list(coverage.values()))) - 0.95) < 0.012


def test_the_test_of_the_tangent_is_calibrated(draws: Draws) -> None:
    """p is uniform where the carriage follows the tangent: mean 1/2 (±1/√12·200), 1 % rejected."""
    by_name: dict[str, list[float]] = defaultdict(list)
    for result in draws.results:
        for verdict in result.tangent:
            assert verdict.p_value is not None
            by_name[verdict.name].append(verdict.p_value)
    assert len(by_name) == 6
    for name, p_values in by_name.items():
        assert abs(np.mean(p_values) - 0.5) < 4 / np.sqrt(12 * N_DRAWS), name
    rejected = np.mean([p < 0.01 for p_values in by_name.values() for p in p_values])
    assert rejected < 0.02


def test_scatter_is_tested_against_what_it_should_be(draws: Draws) -> None:
    """χ² per degree of freedom is 1 although pitch and yaw take part in roll's data (targets apart along it)."""
    for number in range(3):
        found = [result.scatter[number] for result in draws.results]
        dof = found[0].dof
        mean = np.mean([one.chi_squared_per_dof for one in found])
        assert abs(mean - 1.0) < 4 * np.sqrt(2.0 / dof / N_DRAWS), found[0].axis
        assert np.mean([one.birge_ratio > 1.0 for one in found]) < 0.04


def test_a_carriage_that_does_not_follow_its_tangent_is_found_out() -> None:
    rng = np.random.default_rng(51)
    truth = draw_truth(rng, CHAIN, follows_tangent=False, n_points=9)
    observations = observe(
        MACHINE, truth, nine_lines(MACHINE), {"0": camera(rng)}, covariance_mm2=np.eye(3) * 2.5e-7, rng=rng
    )
    result = analyze_nine_lines(observations, MACHINE)
    assert [verdict.follows for verdict in result.tangent] == [False] * 6
    assert all("does not follow its guideway's tangent" in verdict.in_words() for verdict in result.tangent)


def test_integrated_straightness_is_more_certain() -> None:
    """Several times more certain than the direct one, where the assumption holds."""
    rng = np.random.default_rng(52)
    truth = draw_truth(rng, CHAIN, n_points=21)
    observations = observe(
        MACHINE, truth, nine_lines(MACHINE), {"0": camera(rng)}, covariance_mm2=np.eye(3) * 1e-4, rng=rng
    )
    errors = identify_nine_line(observations, MACHINE)
    for name, table in errors.alternatives["straightness-integrated"].items():
        assert isinstance(table, ErrorFunction)
        direct = errors.functions[name].std
        assert table.std is not None
        assert direct is not None
        assert np.median(direct) / np.median(table.std) > 2.0, name


def test_more_scatter_than_stated_is_scaled_and_said() -> None:
    """Noise three times as large as stated: the Birge ratio is 3 within its own uncertainty, and covers again."""
    rng = np.random.default_rng(53)
    truth = draw_truth(rng, CHAIN, n_points=9)
    moves = [replace(move, repeat=repeat) for repeat in range(3) for move in nine_lines(MACHINE)]
    exact = observe(MACHINE, truth, moves, {"0": camera(rng)}, covariance_mm2=COVARIANCE)
    stated = analyze_nine_lines(with_noise(exact, rng), MACHINE)
    larger = analyze_nine_lines(with_noise(exact, rng, factor=3.0), MACHINE)
    for one, other in zip(stated.scatter, larger.scatter, strict=True):
        assert one.birge_ratio == 1.0
        assert abs(other.birge_ratio - 3.0) < 3.0 * 4 / np.sqrt(2 * other.dof)
    assert sum("Birge ratio" in note for note in larger.errors.notes) == 3
    ratio = larger.errors.functions["EBX"].std[-1] / stated.errors.functions["EBX"].std[-1]  # type: ignore[index]
    # The lines' directions differ a little from draw to draw.
    assert ratio == pytest.approx(larger.scatter[0].birge_ratio, rel=1e-3)


def test_repeats_tell_the_uncertainty_that_nobody_stated() -> None:
    rng = np.random.default_rng(54)
    truth = draw_truth(rng, CHAIN, n_points=9)
    moves = [replace(move, repeat=repeat) for repeat in range(5) for move in nine_lines(MACHINE)]
    exact = observe(MACHINE, truth, moves, {"0": camera(rng)}, covariance_mm2=COVARIANCE)
    noisy = with_noise(exact, rng)
    columns = [name for name in noisy.frame.columns if name.startswith("c") and len(name) == 3]
    unstated = Observations(noisy.frame.drop(columns), noisy.sources)
    known, found = identify_nine_line(noisy, MACHINE), identify_nine_line(unstated, MACHINE)
    assert any("it was taken from repeats (288 degrees of freedom)" in note for note in found.notes)
    for name, table in known.functions.items():
        other = found.functions[name]
        # Unweighted data are a little less certain; the estimated noise has √(1/2·288) = 4 % of its own.
        ratio = np.median(other.std[1:] / table.std[1:])  # type: ignore[index]
        assert 0.85 < ratio < 1.6, name


def test_without_uncertainties_and_repeats_there_are_none() -> None:
    rng = np.random.default_rng(55)
    truth = draw_truth(rng, CHAIN)
    result = analyze_nine_lines(observe(MACHINE, truth, li_nine_lines(MACHINE), {"0": camera(rng)}), MACHINE)
    assert all(table.std is None for table in result.errors.functions.values())
    assert all(one.std_rad is None for one in result.errors.squareness.values())
    assert any(note.startswith("no uncertainties: the observations state none") for note in result.errors.notes)
    assert all("cannot be judged" in verdict.in_words() for verdict in result.tangent)


def test_calibration_is_shared_by_all_points() -> None:
    """A scale error of the rig (1e-4) makes positioning uncertain in proportion, angles and squareness hardly."""
    rng = np.random.default_rng(56)
    truth = draw_truth(rng, CHAIN, angle_rad=0.0)
    observations = observe(
        MACHINE, truth, li_nine_lines(MACHINE), {"0": camera(rng)}, covariance_mm2=np.eye(3) * 1e-10, rng=rng
    )
    scale_std = 1e-4
    sensitivity = observations.measured_mm[:, :, None]
    errors = identify_nine_line(
        observations, MACHINE, rig_sensitivity=sensitivity, rig_covariance=np.array([[scale_std**2]])
    )
    table = errors.functions["EXX"]
    assert np.allclose(table.std, scale_std * (table.position_mm - table.position_mm[0]), rtol=1e-3, atol=1e-4)
    for name in ("EBX", "EAX"):
        # Of an error function of 0.1 mm the scale takes 1e-8 mm.
        assert np.max(errors.functions[name].std) < 3e-7  # type: ignore[arg-type]
    assert errors.squareness["EC0Y"].std_rad < 1e-6  # type: ignore[operator]
    assert not any("calibration" in note for note in errors.notes)


def test_calibration_uncertainty_by_monte_carlo() -> None:
    """Bent measuring frames, drawn with the stated covariance: scatter as stated."""
    rng = np.random.default_rng(57)
    truth = draw_truth(rng, CHAIN, n_points=5)
    exact = observe(MACHINE, truth, nine_lines(MACHINE), {"0": camera(rng)}, covariance_mm2=np.eye(3) * 1e-16)
    points = exact.measured_mm
    # Nine parameters, correlated, 1e-5 each: component i grows with coordinate j, and with its product with x.
    basis = np.zeros((len(points), 3, 9))
    for number in range(9):
        basis[:, number // 3, number] = points[:, number % 3] * (1.0 + points[:, 0] / 1000.0)
    root = 1e-5 * rng.normal(size=(9, 9))
    stated = identify_nine_line(exact, MACHINE, rig_sensitivity=basis, rig_covariance=root @ root.T)
    values: dict[str, list[Numbers]] = defaultdict(list)
    n_draws = 100
    for _ in range(n_draws):
        moved = points + basis @ (root @ rng.normal(size=9))
        frame = exact.frame.with_columns(
            **{name: pl.Series(moved[:, index]) for index, name in enumerate(("mx", "my", "mz"))}
        )
        errors = identify_nine_line(Observations(frame, exact.sources), MACHINE)
        for name, table in errors.functions.items():
            values[name].append(table.value[1:])
    for name, table in stated.functions.items():
        std = table.std[1:]  # type: ignore[index]
        # Where the distortions bend nothing (parabolas end where they began) second-order terms are all there is.
        is_bent = std > (1e-5 if name[1] in "XYZ" else 1e-8)
        ratio = np.std(values[name], axis=0, ddof=1)[is_bent] / std[is_bent]
        assert np.all(np.abs(ratio - 1.0) < 4.5 * np.sqrt(0.5 / (n_draws - 1))), name


def test_calibration_arrays_must_fit() -> None:
    rng = np.random.default_rng(58)
    observations = observe(MACHINE, draw_truth(rng, CHAIN), li_nine_lines(MACHINE), {"0": camera(rng)})
    with pytest.raises(ShapeError, match="belong together"):
        identify_nine_line(observations, MACHINE, rig_covariance=np.eye(2))
    with pytest.raises(ShapeError, match=r"rig_sensitivity has shape \(3, 3, 2\), \(81, 3, 2\) is needed"):
        identify_nine_line(observations, MACHINE, rig_sensitivity=np.zeros((3, 3, 2)), rig_covariance=np.eye(2))
    with pytest.raises(ShapeError, match="square matrix"):
        identify_nine_line(observations, MACHINE, rig_sensitivity=np.zeros((81, 3, 2)), rig_covariance=np.eye(2)[0])
