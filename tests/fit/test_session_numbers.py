"""What changed between sessions is said of, and corrected for, the sessions that the table names."""

import numpy as np
import pytest

from geoerr.compensate.program import compensate_bytes
from geoerr.diagnose.change import add_effect
from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions, fit_model
from geoerr.fit.result import FitResult
from geoerr.machine import Axis, Machine
from geoerr.observations import Observations, observations_from_columns
from geoerr.terms import session_numbers

LENGTH_MM, CHANGE_RAD = 300.0, 2e-3
MACHINE = Machine("printer", "wbXYZt", {axis: Axis((0.0, LENGTH_MM)) for axis in "xyz"})
PROGRAM = b"G1 X100 Y0 Z10 F3000\nG1 Y200\n"


def knocked_table(*names: str) -> Observations:
    """Measure a machine whose y axis leans in the second of its sessions."""
    rng = np.random.default_rng(1)
    place = np.linspace(0.0, LENGTH_MM, 8)
    lines = [place[:, None] * np.eye(3)[axis] for axis in range(3)] + [np.repeat(place[:, None], 3, axis=1)]
    q = np.concatenate(lines * len(names))
    number = np.repeat(np.arange(len(names)), 4 * len(place))
    measured = q + 2e-3 * rng.normal(size=q.shape)
    measured[:, 0] -= np.where(number == 1, CHANGE_RAD, 0.0) * q[:, 1]
    columns: dict[str, object] = {"session": np.array(names)[number], "carrier": ["relative"] * len(q)}
    columns["line"] = np.tile(np.repeat([*"xyzd"], len(place)), len(names))
    for axis, name in enumerate("xyz"):
        columns |= {name: q[:, axis], f"m{name}": measured[:, axis]}
    return observations_from_columns(columns)


def knocked(*names: str) -> FitResult:
    options = FitOptions(components="12", threads=1)
    return fit_model(MACHINE, knocked_table(*names), effects="squareness-change:xy", options=options)


def corrected_x(result: FitResult, session: int) -> float:
    written, _ = compensate_bytes(result.model, PROGRAM, at={"session": session})
    return float(written.decode().split("X")[-1].split()[0])


@pytest.mark.parametrize("first", [0, 1, 7])
def test_numbers_of_the_table_are_those_of_the_model(first: int) -> None:
    result = knocked(*(str(first + place) for place in range(3)))
    changed = result.model.parameter(f"squareness-change:xy.S_{first + 1}")
    assert abs(abs(changed.value) - CHANGE_RAD) < 4.0 * changed.std < 0.1 * CHANGE_RAD
    assert changed.what.endswith(f"in session {first + 1}")
    # 2 mrad of 200 mm.
    assert corrected_x(result, first + 1) - corrected_x(result, first) == pytest.approx(0.4, abs=0.02)
    assert corrected_x(result, first + 2) - corrected_x(result, first) == pytest.approx(0.0, abs=0.02)
    for unknown in {0, first + 3} - {first}:
        with pytest.raises(
            GeoerrError, match=rf"session {unknown} is none .*: the model's are {first}, {first + 1}, {first + 2}"
        ):
            corrected_x(result, unknown)


def test_what_is_measured_besides_leaves_sessions_their_numbers() -> None:
    """One more session of another name made 0, 1 and 2 of 1, 2 and 3: the change was looked for in the wrong one."""
    first = knocked("1", "2", "3")
    for more in ("check", "5"):
        change = add_effect(first.model, knocked_table("1", "2", "3", more), reference="backlash:x")
        again = change.result.model.parameter("squareness-change:xy.S_2")
        assert abs(abs(again.value) - CHANGE_RAD) < 4.0 * again.std < 0.1 * CHANGE_RAD


def test_a_session_that_has_another_number_now_is_refused() -> None:
    model = knocked("mon", "tue").model
    with pytest.raises(
        GeoerrError, match=r"knows session 'mon' by the number 0, and in these data it has 8: .*\n.*anew"
    ):
        add_effect(model, knocked_table("mon", "tue", "7"), reference="backlash:x")
    with pytest.raises(GeoerrError, match="knows session 'mon' by the number 0"):
        fit_model(model, knocked_table("mon", "tue", "7"))


def test_names_that_are_no_numbers_are_told_beside_theirs() -> None:
    result = knocked("mon", "tue", "wed")
    assert result.model.parameter("squareness-change:xy.S_1").what.endswith("in session 1 (tue)")
    assert corrected_x(result, 1) - corrected_x(result, 0) == pytest.approx(0.4, abs=0.02)


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        ((), []),
        (("0",), [0]),
        (("1", "2", "3"), [1, 2, 3]),
        (("1.0", "2.0"), [1, 2]),
        (("3", "1", "5"), [3, 1, 5]),
        (("1", "2", "check", "circle xy/1"), [1, 2, 3, 4]),
        (("mon", "tue"), [0, 1]),
        (("mon", "1"), [2, 1]),
        (("1", "1.0"), [1, 2]),
        (("1.5", "-1", "nan", " 2", "1_0", "20240101"), [0, 1, 2, 3, 4, 5]),
    ],
)
def test_what_is_named_by_a_number_has_it(names: tuple[str, ...], numbers: list[int]) -> None:
    assert session_numbers(names) == numbers
