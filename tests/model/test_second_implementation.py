"""The core's kinematics against a second implementation with 40 digits, in quantiles."""

from __future__ import annotations

import numpy as np
import pytest
from model_exact import ExactMachine, numbers
from model_machines import CHAINS, drawn_errors, machine

from geoerr.model import Model

N_POINTS = 6


@pytest.fixture(scope="module")
def differences() -> dict[str, np.ndarray]:
    """|core − exact| in mm (1 for the Jacobian), pooled over all chains."""
    generator = np.random.default_rng(5)
    found: dict[str, list[np.ndarray]] = {}
    for seed, chain in enumerate(CHAINS):
        of = machine(chain, tool_offset_mm=(3.0, -20.0, 55.0))
        errors = drawn_errors(of, seed)
        model, exact = Model(of, errors), ExactMachine(of, errors)
        q = generator.uniform(-30.0, 430.0, (N_POINTS, 3))
        offset = generator.uniform(-200.0, 200.0, (N_POINTS, 3))
        for name in ("tool_from_work", "tool_from_base", "work_from_base", "error", "jacobian"):
            core = getattr(model, "error_mm" if name == "error" else name)(q, offset)
            for row in range(N_POINTS):
                second = getattr(exact, name)(numbers(q[row]), numbers(offset[row]))
                pairs = zip(core[row].ravel(), np.ravel(np.array(second, dtype=object)), strict=True)
                found.setdefault(name, []).append(np.array([abs(float(a - b)) for a, b in pairs]))
    return {name: np.concatenate(values) for name, values in found.items()}


# Positions of up to 700 mm: one rounding is at most 5.7e-14 mm and the nominal sum has three.
# Errors of up to 3 mm: terms of up to 1 mm, at most 1.1e-16 mm each, a dozen of them.
# The Jacobian is 1 with its own rounding of 1.1e-16; products of rotations and columns are six more.
@pytest.mark.parametrize(
    ("name", "q50", "q99", "largest"),
    [
        ("tool_from_work", 6e-14, 1.2e-13, 1.7e-13),
        ("tool_from_base", 6e-14, 1.2e-13, 1.7e-13),
        ("work_from_base", 6e-14, 1.2e-13, 1.7e-13),
        ("error", 3e-16, 1.2e-15, 2e-15),
        ("jacobian", 1.2e-16, 4e-16, 8e-16),
    ],
)
def test_quantiles(differences: dict[str, np.ndarray], name: str, q50: float, q99: float, largest: float) -> None:
    values = differences[name]
    assert np.quantile(values, 0.5) <= q50
    assert np.quantile(values, 0.99) <= q99
    assert values.max() <= largest


def test_commands_reach_their_positions_by_the_second_implementation() -> None:
    generator = np.random.default_rng(6)
    for seed, chain in enumerate(CHAINS[::5]):
        of = machine(chain, tool_offset_mm=(0.0, 0.0, 80.0))
        errors = drawn_errors(of, seed)
        model, exact = Model(of, errors), ExactMachine(of, errors)
        wanted = generator.uniform(20.0, 380.0, (4, 3))
        for command, position in zip(model.commands_for(wanted, 1e-9), wanted, strict=True):
            reached = exact.tool_from_work(numbers(command), [0, 0, 0])
            miss = [float(a - b) for a, b in zip(reached, numbers(position), strict=True)]
            # The tolerance, and the rounding of the wanted position less the tool offset.
            assert np.linalg.norm(miss) < 1e-9 + 2e-13
