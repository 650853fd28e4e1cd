"""Formulas in Python: values and derivatives against NumPy and SciPy, refusals, shapes."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy.signal import cont2discrete

from geoerr import _core
from geoerr.errors import ExpressionError, GeoerrError, ShapeError

Array = npt.NDArray[np.float64]
ONE_SEQUENCE = np.zeros(1, dtype=np.int64)
NOTHING = np.empty(0)


def columns_of(n: int = 5000, seed: int = 7) -> dict[str, Array]:
    """Draw columns x, y, z, T, d, s, t of n rows."""
    random = np.random.default_rng(seed)
    return {
        "x": random.uniform(0.0, 400.0, n),
        "y": random.uniform(0.0, 300.0, n),
        "z": random.uniform(-50.0, 50.0, n),
        "T": random.normal(10.0, 5.0, n),
        "d": random.choice([-1.0, 1.0], n),
        "s": random.exponential(5.0, n),
        "t": np.cumsum(random.exponential(1.0, n)),
    }


class Formula:
    """A formula over the drawn columns."""

    def __init__(self, text: str, coefficients: dict[str, float], inner: dict[str, float]) -> None:
        self.core = _core.Expression(text, list(columns_of(1)), list(coefficients), list(inner), {"q": "x"})
        self.coefficients = np.array(list(coefficients.values()))
        self.inner = np.array(list(inner.values()))

    def value(self, columns: dict[str, Array], inner: Array | None = None, threads: int = 1) -> Array:
        table = np.ascontiguousarray(list(columns.values()))
        used = self.inner if inner is None else inner
        return self.core.evaluate(table, self.coefficients, used, ONE_SEQUENCE, columns["t"], threads)

    def columns(self, columns: dict[str, Array]) -> Array:
        table = np.ascontiguousarray(list(columns.values()))
        return self.core.coefficient_columns(table, self.inner, ONE_SEQUENCE, columns["t"], 0)

    def by_inner(self, columns: dict[str, Array]) -> Array:
        table = np.ascontiguousarray(list(columns.values()))
        return self.core.inner_derivatives(table, self.coefficients, self.inner, ONE_SEQUENCE, columns["t"], 0)

    def by_position(self, columns: dict[str, Array]) -> Array:
        table = np.ascontiguousarray(list(columns.values()))
        return self.core.position_derivatives(table, self.coefficients, self.inner, ONE_SEQUENCE, columns["t"], 0)


# Formula, coefficients, inner parameters, and for each coefficient what multiplies it, written with NumPy.
EFFECTS: list[tuple[str, dict[str, float], dict[str, float], list[Callable[[dict[str, Array]], Array]]]] = [
    ("alpha*T*(q - q_fixed)", {"alpha": 1.15e-5}, {"q_fixed": 30.0}, [lambda c: c["T"] * (c["x"] - 30.0)]),
    (
        "A*sin(2*pi*q/P) + B*cos(2*pi*q/P)",
        {"A": 0.02, "B": -0.01},
        {"P": 40.0},
        [lambda c: np.sin(2.0 * np.pi * c["x"] / 40.0), lambda c: np.cos(2.0 * np.pi * c["x"] / 40.0)],
    ),
    (
        "-(b/2)*d*(1 - 2*exp(-s/lambda))",
        {"b": 0.03},
        {"lambda": 2.5},
        [lambda c: -0.5 * c["d"] * (1.0 - 2.0 * np.exp(-c["s"] / 2.5))],
    ),
    (
        "-(d/2)*(b0 + b1*q) + b0*abs(z)^1.5",
        {"b0": 0.1, "b1": -0.2},
        {},
        [lambda c: -c["d"] / 2.0 + np.abs(c["z"]) ** 1.5, lambda c: -c["d"] / 2.0 * c["x"]],
    ),
    (
        "where(q > q0, k*(q - q0)^2, 0) + k*min(T, y/100, 3) + k*step(z)*sign(z - 10)",
        {"k": 0.5},
        {"q0": 120.0},
        [
            lambda c: (
                np.where(c["x"] > 120.0, (c["x"] - 120.0) ** 2, 0.0)
                + np.minimum(np.minimum(c["T"], c["y"] / 100.0), 3.0)
                + np.heaviside(c["z"], 1.0) * np.sign(c["z"] - 10.0)
            )
        ],
    ),
    (
        "k*(tanh(z/w)*sqrt(y) + log(1 + s)*atan2(z, q) + cosh(z/w)/sinh(1 + s/w))",
        {"k": 2.0},
        {"w": 20.0},
        [
            lambda c: (
                np.tanh(c["z"] / 20.0) * np.sqrt(c["y"])
                + np.log(1.0 + c["s"]) * np.arctan2(c["z"], c["x"])
                + np.cosh(c["z"] / 20.0) / np.sinh(1.0 + c["s"] / 20.0)
            )
        ],
    ),
]


@pytest.mark.parametrize(("text", "coefficients", "inner", "expected"), EFFECTS, ids=[e[0] for e in EFFECTS])
def test_effects_as_numpy_has_them(
    text: str,
    coefficients: dict[str, float],
    inner: dict[str, float],
    expected: list[Callable[[dict[str, Array]], Array]],
) -> None:
    columns = columns_of()
    formula = Formula(text, coefficients, inner)
    wanted = np.column_stack([column(columns) for column in expected])
    # A dozen operations of one rounding each, functions of one or two; differences of columns up to 400.
    np.testing.assert_allclose(formula.columns(columns), wanted, rtol=1e-13, atol=1e-11)
    np.testing.assert_allclose(formula.value(columns), wanted @ formula.coefficients, rtol=1e-13, atol=1e-11)


@pytest.mark.parametrize(("text", "coefficients", "inner", "expected"), EFFECTS, ids=[e[0] for e in EFFECTS])
def test_derivatives_as_differences_have_them(
    text: str, coefficients: dict[str, float], inner: dict[str, float], expected: object
) -> None:
    columns = columns_of()
    formula = Formula(text, coefficients, inner)
    scale = np.abs(formula.value(columns)).max()

    def agrees(found: Array, at: Callable[[float], Array], step: float) -> None:
        # Only rows whose slope changes by less than 1/20 over two steps: they are ten steps and more from a corner or
        # a singularity, where the fourth power of that, 1e-5, bounds what the five points neglect. Rounding is
        # 1.5 ε f/h, and ten times that for formulas of several operations.
        low, high = (at(2.0 * step) - at(0.0)) / step, (at(0.0) - at(-2.0 * step)) / step
        smooth = np.abs(high - low) <= 0.05 * (np.abs(high) + np.abs(low)) + 1e-6 * scale
        slope = (8.0 * (at(step) - at(-step)) - at(2.0 * step) + at(-2.0 * step)) / (12.0 * step)
        assert smooth.mean() > 0.9
        np.testing.assert_allclose(found[smooth], slope[smooth], rtol=1e-5, atol=3e-15 * scale / step)

    for number, value in enumerate(formula.inner):

        def by_inner(h: float, number: int = number) -> Array:
            moved = formula.inner.copy()
            moved[number] += h
            return formula.value(columns, moved)

        agrees(formula.by_inner(columns)[:, number], by_inner, 1e-4 * value)
    for axis, name in enumerate("xyz"):

        def by_axis(h: float, name: str = name) -> Array:
            return formula.value(columns | {name: columns[name] + h})

        agrees(formula.by_position(columns)[:, axis], by_axis, 1e-3)


@pytest.mark.parametrize(("name", "method"), [("T", "foh"), ("mean_v_x", "zoh")])
@pytest.mark.parametrize("tau", [0.03, 1.0, 400.0])
def test_lag_as_scipy_discretises_it(name: str, method: str, tau: float) -> None:
    """`foh`: straight lines between rows; `zoh`: what is a mean since the previous row is constant over the step."""
    columns = columns_of(400)
    u, t = columns["T"], columns["t"]
    lag = _core.Expression(f"lag({name}, tau)", [name], [], ["tau"], {})
    found = lag.evaluate(u[None, :], NOTHING, np.array([tau]), ONE_SEQUENCE, t, 1)
    expected = np.empty_like(u)
    expected[0] = u[0]
    for row in range(1, u.size):
        step = t[row] - t[row - 1]
        system = (np.array([[-1.0 / tau]]), np.array([[1.0 / tau]]), np.eye(1), np.zeros((1, 1)))
        a, b, c, d, _ = cont2discrete(system, step, method=method)
        if method == "zoh":
            expected[row] = a[0, 0] * expected[row - 1] + b[0, 0] * u[row]
        else:
            # SciPy's state is y − d·u, so that its output follows a straight line to the new input.
            state = (expected[row - 1] - d[0, 0] * u[row - 1]) / c[0, 0]
            expected[row] = c[0, 0] * (a[0, 0] * state + b[0, 0] * u[row - 1]) + d[0, 0] * u[row]
    # The matrix exponential of a step of hundreds of τ is good to about 1e-13 of its norm.
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_wind_up_is_the_recursion() -> None:
    random = np.random.default_rng(3)
    turns = np.flatnonzero(random.random(500) < 0.15)
    x = np.zeros(500)
    d = np.ones(500)
    for turn in turns:
        d[turn:] *= -1.0
    x = np.cumsum(d * random.uniform(0.1, 2.0, 500))
    history = _core.history(np.column_stack([x, x, x]), None, None, None, None, ONE_SEQUENCE)
    b, length = 0.02, 1.7
    formula = _core.Expression("b*windup(lambda)", ["d_x", "s_x"], ["b"], ["lambda"], {"d": "d_x", "s": "s_x"})
    table = np.ascontiguousarray([history["d_x"], history["s_x"]])
    found = formula.evaluate(table, np.array([b]), np.array([length]), ONE_SEQUENCE, None, 1)
    assert np.isnan(found[0])
    # Row by row from the positions: each move eats e^(−move/λ) of the distance to where the stroke will end.
    error = b / 2.0 * d[1]
    for row in range(1, 500):
        end = -b / 2.0 * d[row]
        error = end + (error - end) * np.exp(-abs(x[row] - x[row - 1]) / length)
        assert found[row] == pytest.approx(error, abs=1e-15)


def test_a_point_alone_is_settled() -> None:
    formula = Formula("k*lag(T*x, tau) + b*windup(w)", {"k": 2.0, "b": 0.5}, {"tau": 9.0, "w": 4.0})
    point = np.array([100.0, 0.0, 0.0, 3.0, -1.0, 2.0, 0.0])
    value, gradient = formula.core.evaluate_at(point, formula.coefficients, formula.inner)
    assert value == pytest.approx(600.0 + 0.25 * (1.0 - 2.0 * np.exp(-0.5)), rel=1e-15)
    np.testing.assert_array_equal(gradient, [6.0, 0.0, 0.0])


def test_threads_change_no_bit() -> None:
    columns = columns_of(30_000)
    formula = Formula("k*exp(sin(q/P))*T^3 + k*lag(T, P)", {"k": 2.0}, {"P": 11.0})
    starts = np.arange(0, 30_000, 77)
    table = np.ascontiguousarray(list(columns.values()))
    runs = [
        formula.core.evaluate(table, formula.coefficients, formula.inner, starts, columns["t"], threads).tobytes()
        for threads in (1, 2, 4)
    ]
    assert runs[0] == runs[1] == runs[2]


def test_what_is_used() -> None:
    formula = Formula("k*T*q", {"k": 1.0, "unused": 2.0}, {})
    assert formula.core.variables_used == ["x", "T"]
    assert formula.core.coefficients_used == ["k"]
    assert not formula.core.needs_order
    assert formula.core.text == "k*T*q"
    assert Formula("k*lag(T, 3)", {"k": 1.0}, {}).core.needs_order


def test_a_bad_formula_marks_its_place() -> None:
    with pytest.raises(ExpressionError, match=r"unknown name `qq` \(did you mean `q`\?\)") as caught:
        Formula("k*T*(qq - 3)", {"k": 1.0}, {})
    error = caught.value
    assert isinstance(error, GeoerrError)
    assert isinstance(error, ValueError)
    assert (error.text, error.start, error.end) == ("k*T*(qq - 3)", 5, 7)
    assert str(error).splitlines()[1:] == ["  k*T*(qq - 3)", "       ^^"]
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.text, again.start, again.end) == (str(error), error.text, error.start, error.end)
    assert str(copy.copy(error)) == str(error)


def test_places_count_characters() -> None:
    with pytest.raises(ExpressionError) as caught:
        Formula("k*T*π", {"k": 1.0}, {})
    assert caught.value.text[caught.value.start : caught.value.end] == "π"


def test_a_bad_definition_is_named() -> None:
    with pytest.raises(ExpressionError, match="in the definition of `T`: this bracket is not closed") as caught:
        _core.Expression("k*T", ["temp"], ["k"], [], {"T": "(temp - 20"})
    assert caught.value.text == "(temp - 20"


def test_wrong_shapes_are_refused() -> None:
    formula = Formula("k*T", {"k": 1.0}, {})
    table = np.zeros((7, 4))
    good = (np.ones(1), NOTHING, ONE_SEQUENCE, None, 1)
    formula.core.evaluate(table, *good)
    with pytest.raises(ShapeError, match="6 columns for 7 variables"):
        formula.core.evaluate(np.zeros((6, 4)), *good)
    with pytest.raises(ShapeError, match="2 coefficients for 1"):
        formula.core.evaluate(table, np.ones(2), *good[1:])
    with pytest.raises(ShapeError, match="1 inner parameters for 0"):
        formula.core.evaluate(table, np.ones(1), np.ones(1), *good[2:])
    with pytest.raises(ShapeError, match="3 times for 4 rows"):
        formula.core.evaluate(table, np.ones(1), NOTHING, ONE_SEQUENCE, np.zeros(3), 1)
    with pytest.raises(ShapeError, match="start 1 is row 4"):
        formula.core.evaluate(table, np.ones(1), NOTHING, np.array([0, 4]), None, 1)
    with pytest.raises(ShapeError, match="negative"):
        formula.core.evaluate(table, np.ones(1), NOTHING, np.array([-1]), None, 1)
    with pytest.raises(ShapeError, match="C-contiguous"):
        formula.core.evaluate(np.zeros((4, 7)).T, *good)
    with pytest.raises(ShapeError, match="columns for 7 variables"):
        formula.core.evaluate_at(np.zeros(3), np.ones(1), NOTHING)


def test_no_rows_and_no_columns() -> None:
    empty = np.empty(0, dtype=np.int64)
    formula = Formula("k*T", {"k": 1.0}, {})
    assert formula.core.evaluate(np.zeros((7, 0)), np.ones(1), NOTHING, empty, None, 1).shape == (0,)
    assert formula.core.coefficient_columns(np.zeros((7, 0)), NOTHING, empty, None, 1).shape == (0, 1)
    assert formula.core.inner_derivatives(np.zeros((7, 5)), np.ones(1), NOTHING, empty, None, 1).shape == (5, 0)
    plain = _core.Expression("3", [], [], [], {})
    np.testing.assert_array_equal(plain.evaluate(np.zeros((0, 2)), NOTHING, NOTHING, empty, None, 1), [3.0, 3.0])
