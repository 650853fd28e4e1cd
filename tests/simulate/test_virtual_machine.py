"""The virtual machine against Li's first-order sums, and its truth in the gauge against the machine itself."""

import itertools

import numpy as np
import pytest

from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.machine import AXES, Axis, Machine
from geoerr.simulate.curves import Polyline
from geoerr.simulate.gauge import to_gauge
from geoerr.simulate.guideway import AxisPlan, ErrorPlan, MachineErrors, build_errors, pair_sign
from geoerr.simulate.machine import VirtualMachine, axis_directions

CHAINS = [
    "w" + "".join(order[:place]) + "b" + "".join(order[place:]) + "t"
    for order in itertools.permutations("XYZ")
    for place in range(4)
]
SQUARENESS = {"EC0Y": -5.05e-3, "EB0Z": -1.24e-3, "EA0Z": 3.84e-3}
GRID = np.linspace(20.0, 380.0, 19)
POSITIONS = {axis: GRID for axis in AXES}


def machine(chain="wZbXYt", tool_offset=(3.0, -20.0, -50.0)):
    return Machine("m", chain, {axis: Axis((0.0, 400.0)) for axis in AXES}, tool_offset_mm=tool_offset)


def drawn(which, carriage="free", squareness=SQUARENESS, tables=None, size=1.0, seed=3, **extra):
    axis = AxisPlan(300.0 * size, 100.0 * size, 600.0 * size, 500.0 * size, carriage, **extra)
    plan = ErrorPlan(dict.fromkeys(AXES, axis), squareness, tables or {})
    return build_errors(which, plan, np.random.SeedSequence(seed))


def with_lines(errors, rng):
    """Add a constant and a slope to every function: what the gauge has to take out again."""

    def added(function, constant, slope):
        return lambda q: function(q) + constant + slope * q

    functions = {}
    for name, function in errors.functions.items():
        size = 1.0 if name[1] in "XYZ" else 1e-3
        functions[name] = added(function, rng.normal(0, size), rng.normal(0, size * 2e-3))
    return MachineErrors(functions, errors.included_angle_rad)


def test_li_first_order_sums_hold_for_his_printer():
    # Errors a thousand times smaller than real ones: second-order terms below 1e-9 mm, first-order ones 1e-4.
    small = {name: value * 1e-3 for name, value in SQUARENESS.items()}
    made = machine(tool_offset=(0.0, 0.0, 0.0))
    errors = drawn(made, squareness=small, size=1e-3)
    q = np.random.default_rng(0).uniform(0.0, 400.0, (50, 3))
    l_x, l_y, l_z = 60.0, -35.0, 110.0
    d = {a: errors.delta_mm(a, q[:, i]).T for i, a in enumerate(AXES)}
    e = {a: errors.epsilon_rad(a, q[:, i]).T for i, a in enumerate(AXES)}
    x, y, z = q.T
    s_xy, s_xz, s_yz = -5.05e-6, 1.24e-6, 3.84e-6
    error_x = d["x"][0] + d["y"][0] + d["z"][0] - y * (e["x"][2] + e["z"][2]) + z * e["z"][1]
    error_x += l_z * (e["x"][1] + e["y"][1] + e["z"][1]) - l_y * (e["x"][2] + e["y"][2] + e["z"][2])
    error_x -= s_xy * y + s_xz * z
    error_y = d["x"][1] + d["y"][1] + d["z"][1] + x * e["z"][2] - z * e["z"][0]
    error_y += l_x * (e["x"][2] + e["y"][2] + e["z"][2]) - l_z * (e["x"][0] + e["y"][0] + e["z"][0])
    error_y -= s_yz * z
    error_z = d["x"][2] + d["y"][2] + d["z"][2] - x * e["z"][1] + y * (e["x"][0] + e["z"][0])
    error_z += -l_x * (e["x"][1] + e["y"][1] + e["z"][1]) + l_y * (e["x"][0] + e["y"][0] + e["z"][0])
    offset = np.array([l_x, l_y, l_z])
    found = VirtualMachine(made, errors).tool_from_work(q, offset) - q - offset
    assert np.abs(found).max() > 1e-4
    assert np.allclose(found, np.stack([error_x, error_y, error_z], axis=1), atol=5e-9)


@pytest.mark.parametrize("chain", CHAINS)
def test_a_perfect_machine_goes_where_it_is_told(chain):
    perfect = machine(chain)
    errors = drawn(perfect, squareness={}, size=1e-300)
    q = np.random.default_rng(1).uniform(0.0, 400.0, (20, 3))
    offset = np.array([10.0, 20.0, 30.0])
    place = VirtualMachine(perfect, errors).tool_from_work(q, offset)
    assert np.allclose(place, q + offset + perfect.tool_offset_mm, atol=1e-12)


def test_included_angles_are_exact():
    directions = axis_directions({"S_xy": -5e-3, "S_xz": 1e-3, "S_yz": 4e-3})
    for pair, angle in (("xy", -5e-3), ("xz", 1e-3), ("yz", 4e-3)):
        cosine = directions[pair[0]] @ directions[pair[1]]
        assert np.arccos(cosine) - np.pi / 2 == pytest.approx(angle, abs=1e-15)
        assert np.linalg.norm(directions[pair[1]]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("chain", CHAINS)
def test_the_truth_in_the_gauge_is_the_same_machine(chain):
    rng = np.random.default_rng(CHAINS.index(chain))
    raw = VirtualMachine(machine(chain), with_lines(drawn(machine(chain)), rng))
    gauged = to_gauge(raw, POSITIONS)
    other = VirtualMachine(raw.machine, gauged.errors)
    q = rng.uniform(0.0, 400.0, (100, 3))
    carriage = np.asarray(raw.machine.tool_offset_mm)
    for offset in ([0.0, 0.0, 0.0], [50.0, -30.0, 100.0]):
        turned = gauged.tool_rotation @ (offset + carriage) - carriage
        moved = (other.tool_from_work(q, turned) + gauged.work_shift_mm) @ gauged.work_rotation.T
        assert np.allclose(raw.tool_from_work(q, np.array(offset)), moved, atol=1e-11)
    for matrix in (gauged.work_rotation, gauged.tool_rotation):
        assert np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("chain", ["wZbXYt", "wbXYZt", "wYXZbt"])
def test_the_gauge_is_what_it_says(chain):
    raw = VirtualMachine(machine(chain), with_lines(drawn(machine(chain)), np.random.default_rng(7)))
    errors = to_gauge(raw, POSITIONS).errors
    first = np.array([20.0])
    for name, function in errors.functions.items():
        assert abs(function(first)[0]) < 1e-12, name
        if name[1] in "XYZ" and name[1] != name[2]:
            # The polygon over a uniform grid by brute force; its end points weigh half too much, 1/36001 of slopes
            # of 2e-4, or 2 nm over the range.
            fine = np.linspace(20.0, 380.0, 36001)
            assert abs(np.polyfit(fine, np.interp(fine, GRID, function(GRID)), 1)[0]) < 1e-8, name
    again = to_gauge(VirtualMachine(raw.machine, errors), POSITIONS).errors
    for name, function in errors.functions.items():
        assert np.allclose(again.functions[name](GRID), function(GRID), atol=1e-12), name
    for name, angle in errors.included_angle_rad.items():
        assert again.included_angle_rad[name] == pytest.approx(angle, abs=1e-14)


def test_errors_drawn_over_the_measured_range_are_in_the_gauge_already_to_second_order():
    made = machine()
    errors = drawn(made, "tangent")
    gauged = to_gauge(VirtualMachine(made, errors), dict.fromkeys(AXES, np.linspace(0.0, 400.0, 21))).errors
    q = np.linspace(0.0, 400.0, 21)
    for name in LINEAR_AND_ANGULAR:
        # Products of two errors: 5 mrad with 0.3 mm, and with 0.6 mrad.
        bound = 2e-3 if name[1] in "XYZ" else 5e-6
        assert np.allclose(gauged.functions[name](q), errors.functions[name](q), atol=bound), name
    for name, angle in errors.included_angle_rad.items():
        assert gauged.included_angle_rad[name] == pytest.approx(angle, abs=5e-6)


# Straightness and the angle whose integral it is, with the sign on the tool side; on the work side every sign turns.
TANGENT = {
    "EYX": ("ECX", 1),
    "EZX": ("EBX", -1),
    "EXY": ("ECY", -1),
    "EZY": ("EAY", 1),
    "EXZ": ("EBZ", 1),
    "EYZ": ("EAZ", -1),
}


@pytest.mark.parametrize("chain", ["wbXYZt", "wXYZbt", "wZbXYt"])
def test_a_carriage_follows_its_guideways_tangent_with_the_right_signs(chain):
    made = machine(chain)
    errors = drawn(made, "tangent")
    q = np.linspace(5.0, 395.0, 40)
    step = 1e-3
    for straight, (angle, sign) in TANGENT.items():
        side = 1 if made.side(straight[2].lower()) == "tool" else -1
        slope = (errors.functions[straight](q + step) - errors.functions[straight](q - step)) / (2 * step)
        difference = slope - sign * side * errors.functions[angle](q)
        assert np.ptp(difference) < 1e-11, straight
        assert np.ptp(errors.functions[angle](q)) > 1e-4
        axis, direction = "XYZ".index(straight[2]), "XYZ".index(straight[1])
        assert pair_sign(axis, direction, made.side(straight[2].lower())) == sign * side


def test_a_long_carriage_rides_on_both_its_ends():
    made, length = machine(), 150.0
    follows = drawn(made, "tangent", squareness={})
    rides = drawn(made, "length", squareness={}, carriage_length_mm=length)
    q = np.linspace(90.0, 310.0, 23)
    ahead, behind = q + length / 2, q - length / 2
    for straight, (angle, sign) in TANGENT.items():
        side = 1 if made.side(straight[2].lower()) == "tool" else -1
        guideway = follows.functions[straight]
        mean = 0.5 * (guideway(ahead) + guideway(behind))
        tilt = sign * side * (guideway(ahead) - guideway(behind)) / length
        # Equal up to what the gauge takes: a line from straightness, a constant from the angle.
        rest = rides.functions[straight](q) - mean
        assert np.abs(rest - np.polyval(np.polyfit(q, rest, 1), q)).max() < 1e-13, straight
        assert np.ptp(rides.functions[angle](q) - tilt) < 1e-14, angle
        assert np.ptp(tilt) < np.ptp(follows.functions[angle](q))


def test_a_free_carriage_has_straightness_of_its_own():
    made = machine()
    errors = drawn(made, "free")
    q = np.linspace(0.0, 400.0, 81)
    slope = np.gradient(errors.functions["EYX"](q), q)
    assert abs(np.corrcoef(slope, errors.functions["ECX"](q))[0, 1]) < 0.95


def test_a_table_stands_in_place_of_its_curve_and_leaves_the_others():
    made = machine()
    table = Polyline(np.array([0.0, 200.0, 400.0]), np.array([0.0, 0.1, -0.1]))
    plain, own = drawn(made, "tangent"), drawn(made, "tangent", tables={"EXX": table, "ECX": table})
    q = np.linspace(0.0, 400.0, 41)
    for name in LINEAR_AND_ANGULAR:
        same = np.array_equal(plain.functions[name](q), own.functions[name](q))
        assert same == (name not in ("EXX", "ECX", "EYX")), name
    assert np.array_equal(own.functions["ECX"](q), table.at(q))
    given_height = drawn(made, "tangent", tables={"EYX": table})
    assert np.array_equal(given_height.functions["EYX"](q), table.at(q))
    assert np.allclose(given_height.functions["ECX"](np.array([10.0, 300.0])), [0.0, -1.5e-3])
