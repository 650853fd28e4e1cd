from __future__ import annotations

import numpy as np
import pytest
from effect_machines import CHAINS, machine
from effect_values import by_channel

from geoerr.effects import catalogue
from geoerr.effects.channels import angle_of_straightness, lever_axes
from geoerr.effects.covariates import split_lags
from geoerr.effects.definitions import renamed, temperature_text

AXES = "xyz"
Q_MM = np.linspace(30.0, 260.0, 41)
# Eq. 19 of Li with its signs corrected, for an axis on the tool side: straightness = sign × ∫ angle.
TANGENT = {
    "EYX": ("ECX", 1.0),
    "EZX": ("EBX", -1.0),
    "EXY": ("ECY", -1.0),
    "EZY": ("EAY", 1.0),
    "EXZ": ("EBZ", 1.0),
    "EYZ": ("EAZ", -1.0),
}


@pytest.mark.parametrize("chain", ["wbXYZt", "wXYZbt"])
def test_angles_that_follow_the_tangent_have_the_signs_of_the_theory(chain: str) -> None:
    side = "tool" if chain == "wbXYZt" else "work"
    for straightness, (angle, sign) in TANGENT.items():
        axis, direction = straightness[2].lower(), straightness[1].lower()
        expected = (angle, sign if side == "tool" else -sign)
        assert machine(chain).side(axis) == side
        assert angle_of_straightness(axis, direction, side) == expected


@pytest.mark.parametrize("chain", CHAINS)
def test_thermal_bending_is_a_bow_and_its_own_slope(chain: str) -> None:
    where = machine(chain, low=20.0)
    for axis in AXES:
        term = catalogue()["thermal-bending"].term(axis, "temp_bed", where)
        kappa = {parameter.name: 1e-7 * (1 + n) for n, parameter in enumerate(term.coefficients)}
        displaced = by_channel(term, {axis: Q_MM, "temp_bed": 50.0, **kappa})
        length = where.axes[axis].length_mm
        for direction in AXES.replace(axis, ""):
            straightness = f"E{direction.upper()}{axis.upper()}"
            q = Q_MM - 20.0
            np.testing.assert_allclose(
                displaced[straightness], kappa[f"kappa_{direction}"] * 30.0 * q * (length - q) / 2, rtol=1e-12
            )
            angle, sign = TANGENT[straightness]
            sign = sign if where.side(axis) == "tool" else -sign
            # The central difference of a parabola is exact inside; numpy's ends are one-sided.
            slope = np.gradient(displaced[straightness], Q_MM)[1:-1]
            np.testing.assert_allclose(displaced[angle][1:-1], sign * slope, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("form", catalogue()["gravity-sag"].form_names)
@pytest.mark.parametrize("chain", CHAINS)
def test_a_travelling_load_pitches_by_half_the_slope_of_its_path(chain: str, form: str) -> None:
    # A beam is held at the low end of the travel, wherever the range puts its zero.
    low = -150.0 if chain < "wY" else 40.0
    where = machine(chain, low=low)
    names = {"k": 1e-9, "k1": 2e-9, "load": 3.0}
    weight = 1e-9 + (6e-9 if "weights" in form else 0.0)
    for axis in "xy":
        term = catalogue()["gravity-sag"].term(axis, None, where, form=form)
        q = np.linspace(1.0, 299.0, 3001)
        displaced = by_channel(term, {axis: q + low, **names})
        assert set(displaced) == {f"EZ{axis.upper()}", TANGENT[f"EZ{axis.upper()}"][0]}
        sag = displaced[f"EZ{axis.upper()}"]
        length = where.axes[axis].length_mm
        beam = q**3 / 3 if form.startswith("cantilever") else q**2 * (length - q) ** 2 / (3 * length)
        side = 1.0 if where.side(axis) == "tool" else -1.0
        np.testing.assert_allclose(sag, -side * weight * beam, rtol=1e-12, atol=1e-15)
        angle, sign = TANGENT[f"EZ{axis.upper()}"]
        slope = np.gradient(sag, q)[1:-1]
        # Central differences of a cubic are off by h²/6 of its third derivative.
        spacing = q[1] - q[0]
        allowed = spacing**2 * weight * 8
        np.testing.assert_allclose(displaced[angle][1:-1], sign * side * slope / 2, atol=allowed)


def test_formulas_of_the_catalogue_by_hand() -> None:
    rng = np.random.default_rng(4)
    n = 50
    rows = {name: rng.uniform(10.0, 300.0, n) for name in (*AXES, "tx", "ty", "tz", "bed_x", "bed_y")}
    rows |= {f"d_{axis}": rng.choice([-1.0, 1.0], n) for axis in AXES}
    rows |= {f"{name}_{axis}": rng.normal(0.0, 5.0, n) for name in "va" for axis in AXES}
    rows |= {f"t_rev_{axis}": rng.uniform(0.0, 1.0, n) for axis in AXES}
    rows |= {name: rng.uniform(0.0, 500.0, n) for name in ("t", "clock")}
    rows |= {"temp_a": rng.uniform(15.0, 60.0, n), "force": rng.normal(0, 9, n)}
    rows |= {"temp_b": rng.uniform(15.0, 60.0, n), "session": rng.integers(0, 3, n).astype(float)}
    x, y, d, v, a, t = (rows[name] for name in ("x", "y", "d_x", "v_x", "a_x", "t"))
    warm, rise = rows["temp_a"] - 20.0, rows["temp_a"] - rows["temp_b"]

    def channels(reference: str, **values: float) -> dict[str, np.ndarray]:
        effect, resolved = catalogue().resolve(reference)
        term = effect.term(resolved.axis, resolved.covariate, machine(), sessions=("0", "1", "2"))
        return by_channel(term, rows | values)

    one_turn = catalogue()["angular-reversal"].term("x", None, machine(), form="z only")
    bowl = (rows["bed_x"] - 90.0) ** 2 + (rows["bed_y"] - 70.0) ** 2
    expected: list[tuple[dict[str, np.ndarray], dict[str, np.ndarray]]] = [
        (channels("scale:x", k=1e-5), {"EXX": 1e-5 * x}),
        (channels("backlash:x", b=0.02), {"EXX": -0.01 * d}),
        (channels("backlash-position:x", b0=0.02, b1=1e-4), {"EXX": -d / 2 * (0.02 + 1e-4 * x)}),
        (
            channels("reversal-spike:x", A=0.03, tau=0.2),
            {"EXX": -0.03 * d * np.exp(-rows["t_rev_x"] / 0.2)},
        ),
        (channels("lateral-play:x", l_y=0.02, l_z=0.04), {"EYX": 0.01 * d, "EZX": 0.02 * d}),
        (
            channels("angular-reversal:x", c_x=1e-5, c_y=2e-5, c_z=3e-5),
            {"EAX": 1e-5 * d, "EBX": 2e-5 * d, "ECX": 3e-5 * d},
        ),
        (by_channel(one_turn, rows | {"c_z": 3e-5}), {"ECX": 3e-5 * d}),
        (
            channels("periodic:y", A=0.01, B=0.02, P=8.0),
            {"EYY": 0.01 * np.sin(2 * np.pi * y / 8) + 0.02 * np.cos(2 * np.pi * y / 8)},
        ),
        (channels("lag:x", tau=0.002), {"EXX": -0.002 * v}),
        (channels("servo-mismatch:xz", dtau=0.004), {"EXX": -0.002 * v, "EZZ": 0.002 * rows["v_z"]}),
        (channels("radial-shrink:x", k=1e-4), {"EXX": 1e-4 * a}),
        (channels("acceleration:x", c=1e-4), {"EXX": -1e-4 * a}),
        (channels("stick-slip:x", b_s=0.02, v_s=3.0), {"EXX": -0.01 * d * np.exp(-np.abs(v) / 3.0)}),
        (channels("lost-steps:x", A=0.8, t0=200.0), {"EXX": 0.8 * (rows["clock"] >= 200.0)}),
        (
            channels("homing-offset:x", c_1=0.1, c_2=0.3),
            {"EXX": np.choose(rows["session"].astype(int), [0.0, 0.1, 0.3])},
        ),
        (channels("thermal-expansion:x@temp_a", alpha=1e-5, q_fixed=50.0), {"EXX": 1e-5 * warm * (x - 50.0)}),
        (channels("thermal-drift:work-z@temp_a-temp_b", k=1e-3), {"work-z": 1e-3 * rise}),
        (channels("warm-up:z", A=0.05, tau=300.0), {"tool-z": 0.05 * (1 - np.exp(-t / 300.0))}),
        (
            channels("bed-bow@temp_a-temp_b", alpha=2e-5, h=6.0, x_c=90.0, y_c=70.0),
            {"work-z": 2e-5 * rise * bowl / 12.0},
        ),
        (channels("frame-tilt-thermal:xz@temp_a", k=1e-6), {"S_xz": 1e-6 * warm}),
        (channels("squareness:yz", S=1e-4), {"S_yz": np.full(n, 1e-4)}),
        (channels("gantry-racking:y", c0=1e-5, c1=1e-7), {"ECY": (1e-5 + 1e-7 * x) * rows["d_y"]}),
        (channels("load-deflection:z", c=1e-4), {"tool-z": 1e-4 * rows["force"]}),
        (
            channels("timing", dt=0.01),
            {f"motion-{axis}": 0.01 * rows[f"v_{axis}"] for axis in AXES},
        ),
        (
            channels("target-expansion@temp_a", alpha=2.34e-5),
            {f"target-{axis}": 2.34e-5 * warm * rows[f"t{axis}"] for axis in AXES},
        ),
        (channels("spiral", k=1e-6), {"rig-scale": 1e-6 * t}),
        (
            channels("camera-drift", k_x=1e-6, k_y=2e-6, k_z=3e-6, c_x=1e-9, c_y=2e-9, c_z=3e-9),
            {
                **{f"rig-t{axis}": (1 + i) * 1e-6 * t for i, axis in enumerate(AXES)},
                **{f"rig-r{axis}": (1 + i) * 1e-9 * t for i, axis in enumerate(AXES)},
            },
        ),
    ]
    for found, wanted in expected:
        assert set(found) == set(wanted)
        for channel, values in wanted.items():
            np.testing.assert_allclose(np.broadcast_to(found[channel], n), values, rtol=1e-12, atol=1e-15)


def test_a_millimetre_of_aluminium_fixture_is_as_long_as_the_theory_says() -> None:
    term = catalogue()["target-expansion"].term(None, "temp", machine())
    names = {"alpha": 23.4e-6, "temp": 120.0, "tx": 200.0, "ty": 0.0, "tz": 0.0}
    assert by_channel(term, names)["target-x"] == pytest.approx(0.468)


def test_a_lag_wraps_every_temperature_and_adds_one_parameter() -> None:
    plain = catalogue()["thermal-bending"].term("x", "temp_a-temp_b", machine())
    lagged = catalogue()["thermal-bending"].term("x", "temp_a-temp_b", machine(), lagged=True)
    assert lagged.id == plain.id
    assert lagged.coefficients == plain.coefficients
    (tau,) = lagged.inner
    assert (tau.name, tau.unit, tau.low, tau.high, tau.spacing) == ("tau", "s", 10.0, 10_800.0, "log")
    for part in lagged.parts:
        assert dict(part.definitions)["T"] == "lag(temp_a - temp_b, tau)"
    assert lagged.needs == plain.needs == ("temp_a", "temp_b")


def test_the_reference_temperature_may_be_below_freezing() -> None:
    assert temperature_text("temp", 20.0) == "temp - 20.0"
    assert temperature_text("temp", -5.5) == "temp + 5.5"
    term = catalogue()["thermal-drift"].term("x", "temp", machine(reference_degc=-5.5))
    assert by_channel(term, {"k": 1.0, "temp": 1.0})["tool-x"] == 6.5


@pytest.mark.parametrize("low", [0.0, 40.0, -120.0])
def test_where_the_length_appears_the_position_counts_from_the_low_end(low: float) -> None:
    term = catalogue()["thermal-bending"].term("y", "temp", machine(low=low))
    names = {"y": np.array([low, low + 300.0, low + 150.0]), "temp": 21.0, "kappa_x": 1.0, "kappa_z": 1.0}
    np.testing.assert_allclose(by_channel(term, names)["EXY"], [0.0, 0.0, 150.0 * 150.0 / 2])
    plain = catalogue()["scale"].term("y", None, machine(low=low))
    assert by_channel(plain, {"y": low, "k": 1.0})["EYY"] == low


def test_ranges_become_numbers() -> None:
    where = machine(low=-10.0)
    fixed = catalogue()["thermal-expansion"].term("y", "temp", where).inner[0]
    # Where it is held may lie beyond its travel.
    assert (fixed.low, fixed.high) == (-160.0, 440.0)
    jump = catalogue()["lost-steps"].term("x", None, where, time_range_s=(5.0, 900.0)).inner[0]
    assert (jump.low, jump.high) == (5.0, 900.0)
    bow = {
        parameter.name: parameter for parameter in catalogue()["bed-bow"].term("work-z", "temp-temp_b", where).inner
    }
    assert (bow["x_c"].low, bow["x_c"].high) == (-10.0, 390.0)
    assert (bow["y_c"].low, bow["y_c"].high) == (-10.0, 290.0)
    assert bow["h"].is_fixed


def test_levers_as_the_theory_has_them() -> None:
    # Li's printer: y is carried by x; the bed's angles turn what all of the tool side does.
    printer = machine("wZbXYt")
    assert (lever_axes("x", printer), lever_axes("y", printer), set(lever_axes("z", printer))) == (
        "y",
        "",
        {"x", "y"},
    )


def _rigid_columns(chain: str, q: np.ndarray) -> np.ndarray:
    """Columns of all 18 joint functions (powers up to 4) seen from the work, from the first-order sums."""
    where = machine(chain)
    tool, work = where.tool_axes, where.work_axes
    unit = np.eye(3)
    columns = []
    for axis in AXES:
        lever = np.zeros_like(q)
        inside = tool[tool.index(axis) + 1 :] if axis in tool else tool + axis + work[: work.index(axis)]
        for other in inside:
            lever[:, AXES.index(other)] += q[:, AXES.index(other)]
        u = q[:, AXES.index(axis)]
        for power in range(5):
            for b in range(3):
                columns.append(np.outer(u**power, unit[b]).ravel())
                columns.append((u[:, None] ** power * np.cross(unit[b], lever)).ravel())
    return np.array(columns).T


@pytest.mark.parametrize("chain", CHAINS)
def test_cross_coupling_is_what_no_rigid_body_does(chain: str) -> None:
    rng = np.random.default_rng(8)
    where = machine(chain)
    # Positions as the formula has them, −1 to 1, so that powers are well conditioned.
    u = rng.uniform(-1.0, 1.0, (80, 3))
    lengths = np.array([where.axes[axis].length_mm for axis in AXES])
    position = dict(zip(AXES, ((u + 1.0) / 2.0 * lengths).T, strict=True))
    rigid, _ = np.linalg.qr(_rigid_columns(chain, u))
    products = {"c11": (1, 1), "c21": (2, 1), "c12": (1, 2), "c22": (2, 2)}
    for pair in ("x*y", "x*z", "y*x", "y*z", "z*x", "z*y"):
        term = catalogue()["cross-coupling"].term(pair, None, where)
        names = {parameter.name for parameter in term.coefficients}
        first, second = (u[:, AXES.index(axis)] for axis in pair.split("*"))
        for symbol, (m, n) in products.items():
            for b, direction in enumerate(AXES):
                column = np.outer(first**m * second**n, np.eye(3)[b]).ravel()
                left = column - rigid @ (rigid.T @ column)
                is_held = np.linalg.norm(left) < 1e-8 * np.linalg.norm(column)
                assert is_held == (f"{symbol}_{direction}" not in names), (pair, symbol, direction)
        values = {name: float(n + 1) for n, name in enumerate(sorted(names))}
        displaced = by_channel(term, position | values)
        for b, direction in enumerate(AXES):
            wanted = sum(
                values.get(f"{symbol}_{direction}", 0.0) * first**m * second**n for symbol, (m, n) in products.items()
            )
            channel = f"E{'XYZ'[b]}{pair[0].upper()}"
            np.testing.assert_allclose(displaced.get(channel, 0.0), wanted, atol=1e-12)


def test_what_stands_inside_a_lag_is_told_from_what_stands_outside() -> None:
    outside, inside = split_lags("k*lag(abs(v)*(1 + q), tau)*v + flag(a)")
    assert outside.replace(" ", "") == "k*lag*v+flag(a)"
    assert inside == "(abs(v)*(1 + q), tau)"


def test_whole_names_are_renamed_and_nothing_else() -> None:
    assert renamed("k*k1 + 2e5*k - a.k + k2", {"k": "k_x"}) == "k_x*k1 + 2e5*k_x - a.k + k2"
