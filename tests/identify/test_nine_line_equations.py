"""The paper's equations written out, against the method."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from virtual_machine import LENGTH_MM, camera, draw_truth, li_nine_lines, machine_of, observe

from geoerr.geometry import fit_line
from geoerr.identify import analyze_nine_lines, identify_nine_line
from geoerr.observations import Observations

Numbers = npt.NDArray[np.float64]

# Positions of up to half a metre in the camera's frame carry roundings of 10⁻¹³ mm; angles have them over the offset.
ROUNDING_MM = 1e-12 * LENGTH_MM


def noisy_li_lines(chain: str, seed: int, is_stated: bool = True) -> tuple[Observations, dict[str, Numbers]]:
    """Li's nine lines with 10 µm of noise, and each line's points in order of q (work side: reversed)."""
    rng = np.random.default_rng(seed)
    machine = machine_of(chain)
    moves = li_nine_lines(machine)
    observations = observe(
        machine,
        draw_truth(rng, chain),
        moves,
        {"0": camera(rng)},
        covariance_mm2=np.diag([1e-4, 2e-4, 9e-4]),
        rng=rng,
        is_stated=is_stated,
    )
    labels = np.asarray(observations.texts("line"))
    points = {
        move.line.removeprefix("line "): observations.measured_mm[labels == move.line]
        * (1.0 if move.carrier == "tool" else -1.0)
        for move in moves
    }
    return observations, points


@pytest.mark.parametrize("chain", ["wZbXYt", "wbXYZt", "wXYbZt"])
def test_positioning_pitch_and_yaw_are_equations_17_and_18(chain: str) -> None:
    observations, points = noisy_li_lines(chain, seed=7)
    errors = identify_nine_line(observations, machine_of(chain), first_order=True)
    q = errors.functions["EXX"].position_mm
    delta_l = {name: fit_line(line).along_mm - (q - q[0]) for name, line in points.items()}
    z0 = y0 = x0 = 200.0
    expected = {
        "EXX": delta_l["1"],
        "EYY": delta_l["2"],
        "EZZ": delta_l["3"],
        "EBX": (delta_l["4"] - delta_l["1"]) / z0,
        "ECX": (delta_l["1"] - delta_l["5"]) / 150.0,
        "EAY": (delta_l["2"] - delta_l["6"]) / z0,
        "ECY": (delta_l["7"] - delta_l["2"]) / 150.0,
        "EAZ": (delta_l["8"] - delta_l["3"]) / y0,
        "EBZ": (delta_l["3"] - delta_l["9"]) / x0,
    }
    for name, value in expected.items():
        scale = 1.0 if name[1] in "XYZ" else 1.0 / 150.0
        assert np.max(np.abs(errors.functions[name].value - value)) < ROUNDING_MM * scale, name


def base_frame(points: dict[str, Numbers]) -> Numbers:
    """Rows: X the datum, Y in the XY plane, from lines 1 and 2."""
    x = fit_line(points["1"]).direction
    z = np.cross(x, fit_line(points["2"]).direction)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


@pytest.mark.parametrize(
    ("roll", "lines", "offset_line", "component", "factor"),
    [
        ("EAX", ("1", "4"), "4", 1, -1.0 / 200.0),
        ("EAX", ("1", "5"), "5", 2, 1.0 / 150.0),
        ("EBY", ("2", "6"), "6", 0, 1.0 / 200.0),
        ("EBY", ("2", "7"), "7", 2, -1.0 / 150.0),
        ("ECZ", ("3", "8"), "8", 0, -1.0 / 200.0),
        ("ECZ", ("3", "9"), "9", 1, 1.0 / 200.0),
    ],
)
@pytest.mark.parametrize("chain", ["wZbXYt", "wbXYZt"])
def test_roll_from_one_offset_line_is_theorys_difference(
    chain: str, roll: str, lines: tuple[str, str], offset_line: str, component: int, factor: float
) -> None:
    """ε_xx = (E_y1 − E_y4)/z₀ = (E_z5 − E_z1)/y₀ and so on, each formula where only its line is there."""
    # Without stated covariances all data weigh the same; with them, correlated components would take part.
    observations, points = noisy_li_lines(chain, seed=8, is_stated=False)
    labels = np.asarray(observations.texts("line"))
    others = {"1", "2", "3"} | set(lines)
    kept = observations.select(np.isin(labels, [f"line {name}" for name in others]))
    errors = identify_nine_line(kept, machine_of(chain), first_order=True)
    rows = base_frame(points)[component]
    difference = (points[offset_line] - points[lines[0]]) @ rows
    expected = (difference - difference[0]) * factor
    assert np.max(np.abs(errors.functions[roll].value - expected)) < ROUNDING_MM / 150.0


def test_straightness_by_integration_has_the_signs_of_both_sides() -> None:
    """Eq. 19 with the signs of docs/theory/papers.md, written out for each of the six and for both sides."""
    signs = {
        "EYX": ("ECX", 1),
        "EZX": ("EBX", -1),
        "EXY": ("ECY", -1),
        "EZY": ("EAY", 1),
        "EXZ": ("EBZ", 1),
        "EYZ": ("EAZ", -1),
    }
    for chain, work in (("wbXYZt", ""), ("wZbXYt", "z"), ("wXYZbt", "xyz")):
        observations, _ = noisy_li_lines(chain, seed=9)
        errors = identify_nine_line(observations, machine_of(chain), straightness="integrated")
        assert set(errors.alternatives) == {"straightness-direct", "roll-li"}
        for name, (angle, sign) in signs.items():
            side = -1.0 if name[2].lower() in work else 1.0
            table, turn = errors.functions[name], errors.functions[angle]
            # Second differences, which no line changes; Simpson's rule differs from the trapezoid by curvature only.
            rise = np.diff(table.value)
            area = sign * side * np.diff(table.position_mm) * (turn.value[1:] + turn.value[:-1]) / 2.0
            correlation = np.corrcoef(np.diff(rise), np.diff(area))[0, 1]
            assert correlation > 0.9, (chain, name, correlation)


def test_squareness_is_the_angle_between_the_fitted_lines() -> None:
    """With targets at the carriage origin and nothing parked off: Li's included angle minus 90°."""
    for chain in ("wZbXYt", "wbXYZt"):
        observations, points = noisy_li_lines(chain, seed=10)
        errors = identify_nine_line(observations, machine_of(chain))
        directions = {axis: fit_line(points[number]).direction for axis, number in zip("xyz", "123", strict=True)}
        for name, pair, sign in (("EC0Y", "xy", 1.0), ("EB0Z", "xz", -1.0), ("EA0Z", "yz", 1.0)):
            angle = np.arccos(directions[pair[0]] @ directions[pair[1]]) - np.pi / 2.0
            # The gauge's line is over the range and uses all targets; Li's is through line 1's points: noise of 10 to
            # 30 µm on nine points over 400 mm differs by less than three standard deviations of a slope.
            assert abs(errors.squareness[name].value_rad - sign * angle) < 3 * 0.03 / (400.0 * np.sqrt(9 / 12))


def test_roll_by_equation_22_hides_its_size_and_its_sign() -> None:
    """Linear roll and 10 µm of noise: the root gives the same answer for 0, +50, −50 and +200 µrad."""
    chain = "wbXYZt"
    machine = machine_of(chain)
    ends = {}
    for end_urad in (0.0, 50.0, -50.0, 200.0):
        rng = np.random.default_rng(11)
        truth = draw_truth(rng, chain, angle_rad=0.0, delta_mm=0.0, s_rad=0.0, n_points=21)
        truth.tables["EAX"] = np.linspace(0.0, end_urad * 1e-6, 21)
        observations = observe(
            machine, truth, li_nine_lines(machine), {"0": camera(rng)}, covariance_mm2=np.eye(3) * 1e-4, rng=rng
        )
        result = analyze_nine_lines(observations, machine, roll="li")
        table = result.errors.functions["EAX"]
        assert table.std is None
        ends[end_urad] = np.sqrt(np.mean((table.value - table.value[0]) ** 2)) * 1e6
        linear = result.errors.alternatives["roll-linear"]["EAX"]
        assert not isinstance(linear, float)
        assert abs(linear.value[-1] * 1e6 - end_urad) < 4 * linear.std[-1] * 1e6  # type: ignore[union-attr,index]
        lost = 21 - len(table.position_mm)
        assert any(note.startswith(f"EAX by Eq. 22: {lost} of 21") for note in result.errors.notes) == (lost > 0)
    assert np.ptp(list(ends.values())) < 1.0


def test_roll_by_equation_22_finds_a_bent_roll_without_noise() -> None:
    """Where nothing disturbs it and straightness is small, the root is right in size; its line is lost."""
    chain = "wbXYZt"
    machine = machine_of(chain)
    rng = np.random.default_rng(12)
    truth = draw_truth(rng, chain, angle_rad=0.0, delta_mm=0.0, s_rad=0.0, n_points=21)
    u = np.linspace(0.0, 1.0, 21)
    truth.tables["EAX"] = 100e-6 * u**2
    observations = observe(machine, truth, li_nine_lines(machine), {"0": camera(rng)})
    root = identify_nine_line(observations, machine, roll="li").functions["EAX"]
    fitted = np.polynomial.Polynomial.fit(u, truth.tables["EAX"], 1)(u)
    bent = np.abs(truth.tables["EAX"] - fitted)
    assert np.allclose(np.abs(root.value + bent[0]), bent, atol=2e-9) or np.allclose(
        np.abs(root.value - bent[0]), bent, atol=2e-9
    )
