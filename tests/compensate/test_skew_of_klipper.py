"""Lengths that Klipper's skew correction wants, of a squareness as stated here: docs/guides/no_cameras.md."""

from __future__ import annotations

import math

import numpy as np
import pytest
from term_models import machine, term

from geoerr.model import Model

SIDE_MM = 150.0


def lengths_mm(s_rad: float) -> tuple[float, float, float]:
    """Give AC, BD and AD as the guide has them."""
    diagonals = (SIDE_MM * math.sqrt(2.0 * (1.0 + sign * math.sin(s_rad))) for sign in (-1.0, 1.0))
    return (*diagonals, SIDE_MM)


def klipper_factor(ac_mm: float, bd_mm: float, ad_mm: float) -> float:
    """Give tan(90° − ∠DAB) of a parallelogram by its diagonals and one side: what Klipper takes of y off x."""
    other_mm = math.sqrt(2.0 * ac_mm**2 + 2.0 * bd_mm**2 - 4.0 * ad_mm**2) / 2.0
    at_a_rad = math.acos((ac_mm**2 - other_mm**2 - ad_mm**2) / (2.0 * other_mm * ad_mm))
    return math.tan(math.pi / 2.0 - at_a_rad)


@pytest.mark.parametrize("chain", ["wbXYZt", "wYbXZt", "wZbXYt", "wXYbZt"])
@pytest.mark.parametrize("s_rad", [2025e-6, -5e-3, 0.02])
def test_lengths_of_a_squareness_are_those_of_the_part_and_klipper_takes_it_out(chain: str, s_rad: float) -> None:
    of = machine(chain)
    model = Model(of, None, (term(of, "squareness:xy", S=s_rad),))
    corners_mm = np.array([[20.0, 20.0, 1.0], [170.0, 20.0, 1.0], [170.0, 170.0, 1.0], [20.0, 170.0, 1.0]])
    a, b, c, d = model.tool_from_work(corners_mm)
    printed = [float(np.linalg.norm(second - first)) for first, second in ((a, c), (b, d), (a, d))]
    assert printed == pytest.approx(lengths_mm(s_rad), abs=1e-9)
    assert printed[0] < printed[1] if s_rad > 0.0 else printed[0] > printed[1]
    factor = klipper_factor(*lengths_mm(s_rad))
    assert factor == pytest.approx(-math.tan(s_rad), abs=1e-12)
    # Klipper moves to x − factor·y.
    corrected_mm = corners_mm - factor * corners_mm[:, [1]] * [1.0, 0.0, 0.0]
    a, b, c, d = model.tool_from_work(corrected_mm)
    # It counts y along x's perpendicular: tan S for sin S, and y is short by S²/2.
    assert abs((b - a) @ (d - a)) / SIDE_MM**2 < 0.6 * abs(s_rad) ** 3
    assert np.abs(c - a - [SIDE_MM, SIDE_MM, 0.0]).max() / SIDE_MM < 0.6 * s_rad**2
