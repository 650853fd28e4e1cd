"""The model's own promises: identities, signs, ranges, groups, refusals."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from model_machines import CHAINS, drawn_errors, machine

from geoerr.error_functions import ALL_NAMES, ErrorFunction, ErrorFunctions, Squareness
from geoerr.errors import GeoerrError, GeometryError, NotConvergedError, ShapeError
from geoerr.model import GROUPS, Model

OFFSET = (3.0, -20.0, 55.0)


def points(n: int = 50, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 400.0, (n, 3))


def drawn_model(chain: str = "wZbXYt", tool_offset_mm: tuple[float, float, float] = OFFSET) -> Model:
    of = machine(chain, tool_offset_mm)
    return Model(of, drawn_errors(of))


def single(name: str, value: float) -> Model:
    """One constant error only."""
    of = machine()
    if name in GROUPS["squareness"]:
        return Model(of, ErrorFunctions(of, {}, {name: Squareness(value)}, "test"))
    function = ErrorFunction(np.array([0.0]), np.array([value]))
    return Model(of, ErrorFunctions(of, {name: function}, {}, "test"))


class TestIdentities:
    @pytest.mark.parametrize("chain", CHAINS)
    def test_nominal_machine_is_q_plus_offset_bit_for_bit(self, chain: str) -> None:
        model = Model(machine(chain, OFFSET))
        q, offset = points(), points(seed=2)
        assert model.is_nominal
        assert np.array_equal(model.tool_from_work(q), q + np.array(OFFSET))
        assert np.array_equal(model.tool_from_work(q, offset), q + (np.array(OFFSET) + offset))
        assert np.array_equal(model.nominal_mm(q, offset), model.tool_from_work(q, offset))
        assert not model.error_mm(q, offset).any()
        assert np.array_equal(model.jacobian(q), np.broadcast_to(np.eye(3), (50, 3, 3)))

    def test_nominal_commands_are_the_positions_bit_for_bit(self) -> None:
        q = points()
        assert Model(machine()).commands_for(q).tobytes() == q.tobytes()

    @settings(max_examples=100)
    @given(
        chain=st.sampled_from(CHAINS),
        q=st.lists(st.tuples(*[st.floats(-50.0, 450.0)] * 3), min_size=1, max_size=5),
        seed=st.integers(0, 5),
    )
    def test_commands_invert_the_map(self, chain: str, q: list[tuple[float, ...]], seed: int) -> None:
        of = machine(chain, OFFSET)
        model = Model(of, drawn_errors(of, seed))
        commanded = np.array(q)
        again = model.commands_for(model.tool_from_work(commanded), 1e-9)
        # A nanometre.
        assert np.abs(again - commanded).max() < 1e-6

    def test_error_is_actual_minus_nominal(self) -> None:
        model, q, offset = drawn_model(), points(), points(seed=2)
        difference = model.tool_from_work(q, offset) - model.nominal_mm(q, offset)
        assert np.abs(model.error_mm(q, offset) - difference).max() < 2e-13

    def test_one_offset_for_all_rows_or_one_a_row(self) -> None:
        model, q = drawn_model(), points()
        for view in (model.tool_from_work, model.tool_from_base, model.work_from_base, model.jacobian):
            one = view(q, OFFSET)
            assert np.array_equal(one, view(q, np.tile(OFFSET, (50, 1))))
            assert np.array_equal(view(q), view(q, np.zeros(3)))
            assert not np.array_equal(one, view(q))

    def test_same_bytes_from_any_number_of_threads(self) -> None:
        model, q = drawn_model(), points(10_001)
        for call in (
            lambda threads: model.tool_from_work(q, OFFSET, threads=threads),
            lambda threads: model.jacobian(q, threads=threads),
            lambda threads: model.commands_for(q, threads=threads),
        ):
            one = call(1).tobytes()
            assert all(call(threads).tobytes() == one for threads in (0, 2, 8))

    def test_arrays_of_any_layout(self) -> None:
        model, q = drawn_model(), points()
        for same in (np.asfortranarray(q), q.tolist(), np.repeat(q, 2, axis=0)[::2]):
            assert np.array_equal(model.tool_from_work(same), model.tool_from_work(q))
        assert model.tool_from_work(np.empty((0, 3))).shape == (0, 3)

    def test_pickle(self) -> None:
        model = drawn_model()
        again = pickle.loads(pickle.dumps(model))
        assert np.array_equal(again.error_mm(points()), model.error_mm(points()))


class TestSigns:
    """ISO 230-1: a positive squareness turns the axis about the base axis by the right-hand rule."""

    @pytest.mark.parametrize(
        ("name", "moving", "displaced", "sign"),
        [("EC0Y", 1, 0, -1.0), ("EB0Z", 2, 0, 1.0), ("EA0Z", 2, 1, -1.0)],
    )
    def test_squareness_turns_by_the_right_hand(self, name: str, moving: int, displaced: int, sign: float) -> None:
        q = np.zeros((1, 3))
        q[0, moving] = 200.0
        error = single(name, 1e-4).error_mm(q)[0]
        assert error[displaced] == pytest.approx(sign * 200.0 * 1e-4, rel=1e-7)

    @pytest.mark.parametrize(
        ("name", "offset", "expected"),
        [
            ("ECX", (0.0, 100.0, 0.0), (-0.01, 0.0, 0.0)),
            ("EAY", (0.0, 100.0, 0.0), (0.0, 0.0, 0.01)),
            ("EBZ", (0.0, 0.0, 100.0), (0.01, 0.0, 0.0)),
        ],
    )
    def test_angles_turn_by_the_right_hand_on_both_sides(
        self, name: str, offset: tuple[float, ...], expected: tuple[float, ...]
    ) -> None:
        error = single(name, 1e-4).error_mm(np.zeros((1, 3)), offset)[0]
        assert error == pytest.approx(expected, abs=1e-6)

    def test_a_floor_camera_sees_a_work_side_error_reversed(self) -> None:
        model = single("EZZ", 0.02)
        q = np.array([[0.0, 0.0, 100.0]])
        assert model.tool_from_work(q)[0, 2] == pytest.approx(100.02)
        assert model.work_from_base(q)[0, 2] == pytest.approx(-100.02)
        assert model.tool_from_base(q)[0, 2] == 0.0


class TestParts:
    def test_taking_everything_out_leaves_the_nominal_machine(self) -> None:
        model = drawn_model()
        assert not model.is_nominal
        assert model.without(ALL_NAMES).is_nominal
        assert model.without(["positioning", "straightness", "angular", "squareness"]).is_nominal
        assert not model.without(["positioning", "straightness", "pitch-yaw", "squareness"]).is_nominal
        assert model.without(["positioning", "straightness", "pitch-yaw", "roll", "squareness"]).is_nominal

    def test_groups_share_out_the_21(self) -> None:
        parts = ("positioning", "straightness", "angular", "squareness")
        assert sorted(name for group in parts for name in GROUPS[group]) == sorted(ALL_NAMES)
        assert [len(GROUPS[group]) for group in parts] == [3, 6, 9, 3]
        assert sorted(GROUPS["pitch-yaw"] + GROUPS["roll"]) == sorted(GROUPS["angular"])

    def test_a_part_is_taken_out_and_the_rest_stays(self) -> None:
        model, q = drawn_model(), points()
        less = model.without(["ECX", "squareness"])
        assert model.errors is not None
        assert less.errors is not None
        assert set(model.errors.functions) - set(less.errors.functions) == {"ECX"}
        assert less.errors.squareness == {}
        assert not np.allclose(less.error_mm(q), model.error_mm(q))
        assert Model(machine()).without(["angular"]).is_nominal

    def test_unknown_part(self) -> None:
        with pytest.raises(GeoerrError, match=r"'EDX' is neither .*\n.*pitch-yaw"):
            drawn_model().without(["EDX"])

    def test_measured_range_is_what_all_tables_of_the_axis_cover(self) -> None:
        of = machine()

        def table(*position: float) -> ErrorFunction:
            return ErrorFunction(np.array(position), np.zeros(len(position)))

        functions = {"EXX": table(0.0, 400.0), "ECX": table(10.0, 200.0, 390.0), "EAX": table(700.0)}
        model = Model(of, ErrorFunctions(of, {**functions, "EZZ": table(5.0)}, {}, "test"))
        assert model.measured_range_mm == {"x": (10.0, 390.0), "y": None, "z": None}
        assert Model(of).measured_range_mm == {"x": None, "y": None, "z": None}
        assert model.knots_mm("x").tolist() == [0.0, 10.0, 200.0, 390.0, 400.0, 700.0]
        assert model.knots_mm("y").tolist() == []


class TestRefusals:
    @pytest.mark.parametrize("bad", [np.zeros(3), np.zeros((2, 2)), np.zeros((1, 2, 3)), [["a", 0, 0]]])
    def test_positions_of_another_shape(self, bad: object) -> None:
        model = drawn_model()
        calls: tuple[Callable[..., object], ...] = (model.tool_from_work, model.jacobian, model.error_mm)
        for call in calls:
            with pytest.raises(ShapeError, match="q_mm"):
                call(bad)
        with pytest.raises(ShapeError, match="p_mm"):
            model.commands_for(bad)

    @pytest.mark.parametrize("bad", [np.zeros(2), np.zeros((2, 3)), 0.0])
    def test_offsets_of_another_shape(self, bad: object) -> None:
        with pytest.raises(ShapeError, match=r"offset_mm must be \(3,\) or \(4, 3\)"):
            drawn_model().tool_from_work(np.zeros((4, 3)), bad)

    @pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf])
    def test_tolerance(self, tolerance: float) -> None:
        with pytest.raises(GeometryError, match="tolerance"):
            drawn_model().commands_for(points(), tolerance)

    def test_a_row_without_a_command_is_named_and_alone(self) -> None:
        model, wanted = drawn_model(), points(4)
        good = model.commands_for(wanted)
        wanted[1, 2] = np.nan
        wanted[2, 0] = np.inf
        with pytest.raises(NotConvergedError, match=r"position 2 \(and 1 more\): not finite\nhint: .* in p_mm"):
            model.commands_for(wanted)
        commands = model.try_commands_for(wanted)
        assert commands.status.tolist() == [0, 2, 2, 0]
        assert commands.is_converged.tolist() == [True, False, False, True]
        assert np.isnan(commands.command_mm[1:3]).all()
        assert np.array_equal(commands.command_mm[[0, 3]], good[[0, 3]])
        assert commands.remaining_mm[0] <= 1e-6

    def test_a_tool_that_stands_still_says_what_remains(self) -> None:
        of = machine()
        still = ErrorFunction(np.array([0.0, 1e6]), np.array([0.0, -1e6]))
        model = Model(of, ErrorFunctions(of, {"EXX": still}, {}, "test"))
        with pytest.raises(NotConvergedError, match="position 1: not converged, 10 mm remain"):
            model.commands_for([[10.0, 0.0, 0.0]])

    @pytest.mark.parametrize(
        ("position", "value", "problem"),
        [
            ([0.0, 0.0], [0.0, 0.0], "must grow: entry 1 is 0 mm after 0 mm"),
            ([0.0, 1.0], [0.0, np.nan], "entry 1 of a table is not finite"),
            ([0.0, 1e-320], [0.0, 1.0], "too close together"),
        ],
    )
    def test_tables(self, position: list[float], value: list[float], problem: str) -> None:
        of = machine()
        errors = ErrorFunctions(of, {"EXX": ErrorFunction(np.array(position), np.array(value))}, {}, "test")
        with pytest.raises(GeometryError, match=problem):
            Model(of, errors)

    def test_tables_that_do_not_pair(self) -> None:
        of = machine()
        for position, value in ([[0.0, 1.0], [0.0]], [[], []]):
            function = ErrorFunction(np.array(position), np.array(value))
            with pytest.raises(ShapeError, match="a table"):
                Model(of, ErrorFunctions(of, {"EXX": function}, {}, "test"))

    def test_impossible_squareness(self) -> None:
        with pytest.raises(GeometryError, match="no three axes"):
            single("EC0Y", 2.0)

    def test_names_and_chains_that_only_code_can_get_wrong(self) -> None:
        of = machine("wXYZt")
        with pytest.raises(GeometryError, match="not a structural code"):
            Model(of)
        function = ErrorFunction(np.array([0.0]), np.array([0.0]))
        with pytest.raises(GeometryError, match='"EDX" is not an error function'):
            Model(machine(), ErrorFunctions(machine(), {"EDX": function}, {}, "test"))

    def test_the_core_refuses_arrays_that_it_cannot_view(self) -> None:
        core, rows, none = drawn_model()._core, points(4), np.zeros((1, 3))
        for bad in (np.zeros((4, 2)), np.asfortranarray(rows), rows[::2]):
            with pytest.raises(ShapeError, match=r"q_mm must be a C-contiguous \(n, 3\)"):
                core.tool_from_work(bad, none, 1)
        with pytest.raises(ShapeError, match="2 offsets for 4 positions"):
            core.jacobian(rows, np.zeros((2, 3)), 1)
        with pytest.raises(ShapeError, match="axis must be 0, 1 or 2"):
            core.knots_mm(3)


@pytest.mark.parametrize("threads", [-1, 1.5, None])
def test_what_is_no_number_of_threads_is_refused(threads: object) -> None:
    model = drawn_model()
    calls: tuple[Callable[..., object], ...] = (
        *(model.tool_from_work, model.error_mm, model.tool_from_base, model.work_from_base, model.displacement_mm),
        *(model.jacobian, model.commands_for, model.contributions),
    )
    for call in calls:
        with pytest.raises(ShapeError, match=r"^threads is .*\nhint: write a whole number"):
            call(points(3), threads=threads)


def test_a_file_is_no_machine() -> None:
    with pytest.raises(ShapeError, match=r"^machine: a value of type str .*\nhint: load_model\(path\)"):
        Model("machine.toml")  # type: ignore[arg-type]  # what a type checker refuses is told to others, too
