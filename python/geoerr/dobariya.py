"""Dobariya's vertical machining centre and its twelve error components, as Denavit–Hartenberg rows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from geoerr.denavit_hartenberg import DhRow
from geoerr.errors import GeometryError

# Rows T₀ to T₁₅ of his Table 1: θ, α, column, sign and name of the dimension; x1, x2, x3 move.
_ROWS: tuple[tuple[float, float, str | None, int, str], ...] = (
    (0.0, 0.0, "a", 1, "a1"),
    (0.0, 180.0, "d", 1, "c1"),
    (90.0, 0.0, "a", -1, "b1"),
    (-90.0, 180.0, "a", 1, "x1"),
    (0.0, 0.0, "d", 1, "c2"),
    (-90.0, 0.0, "a", -1, "b2"),
    (-90.0, 0.0, "a", -1, "a2"),
    (-90.0, 0.0, "a", 1, "x2"),
    (-90.0, 0.0, None, 1, ""),
    (0.0, 0.0, "d", 1, "c3"),
    (90.0, 0.0, "a", 1, "b3"),
    (-90.0, 0.0, "a", 1, "a3"),
    (0.0, 0.0, "d", 1, "x3"),
    (180.0, 0.0, "a", -1, "a4"),
    (90.0, 0.0, "a", -1, "b4"),
    (90.0, 0.0, "d", 1, "c4"),
)

# Row to the error that is added to its dimension, with the dimension's sign (his Table 2).
_ERRORS = {
    0: "EXX1", 1: "EZX", 2: "EYX", 3: "EXX2",
    4: "EZY", 5: "EYY1", 6: "EXY", 7: "EYY2",
    9: "EZZ1", 10: "EYZ", 11: "EXZ", 12: "EZZ2",
}  # fmt: skip


def dobariya_vmc(
    a_mm: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    b_mm: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    c_mm: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
) -> tuple[DhRow, ...]:
    """Dobariya's vertical machining centre as D-H rows (his Table 1): a table on X on Y, a head on Z, `wXYbZt`.

    Parameters
    ----------
    a_mm, b_mm, c_mm
        Nominal dimensions a₁ to a₄ along X, b₁ to b₄ along Y, c₁ to c₄ along Z.

    Returns
    -------
    tuple of DhRow
        His rows T₀ to T₁₅. The tool is at `(Σa + x, Σb + y, Σc + z)`, his Eq. 3, and stands parallel to the work.

    Notes
    -----
    In the copy of the paper that we have every digit 0 and 1 and every minus is lost from the tables: "9" stands for
    90 or -90, "8" for 180, and nothing says whether a dimension stands in column d or a. The table was rebuilt by
    search: all orders of the four elementary motions, and in each row all turns and columns that the remaining digits
    allow. Signs of dimensions are those of Table 2, where "a + δ" still shows its plus and "b δ" has lost its minus.
    Each block has to be a plain translation with the sums of Eqs. 5, 9, 10 and 11. Of the two conventions in use,
    `Rz(θ) Tz(d) Tx(a) Rx(α)` does that and `Rx(α) Tx(a) Rz(θ) Tz(d)` cannot. The blocks X, Y and Z have one solution
    each, the last has two with one product: rows T₁₄ and T₁₅ may also have θ = -90 with +b₄.
    `tests/kinematics/test_dobariya.py` repeats the search.

    The paper does not say which frame stands on the base: here it is C4' (row T₈), between Y and Z. Seen from the
    work, translations act alike wherever it is.

    Raises
    ------
    GeometryError
        naming the argument, for dimensions that are not four finite numbers.

    Source: Dobariya et al., Tables 1 and 2, Eqs. 2 to 16.
    """
    numbers = {"": 0.0}
    for letter, dimensions in (("a", a_mm), ("b", b_mm), ("c", c_mm)):
        if len(dimensions) != 4 or not all(math.isfinite(number) for number in dimensions):
            raise GeometryError(
                f"{letter}_mm is {tuple(dimensions)}\nhint: give four finite numbers, {letter}1 to {letter}4 in mm"
            )
        numbers |= {f"{letter}{place}": float(number) for place, number in enumerate(dimensions, start=1)}
    rows = []
    for index, (theta, alpha, column, sign, name) in enumerate(_ROWS):
        row = DhRow(theta_deg=theta, alpha_deg=alpha, is_base=index == 8)
        if name.startswith("x"):
            row = replace(row, joint="xyz"[int(name[1]) - 1], variable="a" if column == "a" else "d")
        elif column == "d":
            row = replace(row, d_mm=sign * numbers[name])
        elif column == "a":
            row = replace(row, a_mm=sign * numbers[name])
        rows.append(row)
    return tuple(rows)


def dobariya_errors(
    translations_mm: Mapping[str, float],
    alpha_rad: Mapping[str, float] | None = None,
    q_mm: Mapping[str, float] | None = None,
) -> dict[int, tuple[float, float]]:
    """Turn Dobariya's twelve error components into additions to his rows (his Table 2).

    The result is for `geoerr.denavit_hartenberg.tool_from_work`.

    Parameters
    ----------
    translations_mm
        Errors at the axis positions `q_mm`, by ISO name: `EYX` is his δ_y(x). A scale error is that of the slide and
        that of the ball screw (his Eq. 6): `EXX1 EXX2`, `EYY1 EYY2`, `EZZ1 EZZ2`. What is not named is 0.
    alpha_rad
        His squarenesses `xy`, `xz` and `yz`: α_xy turns X towards Y, `δ_y(x) += α_xy x` (his Eq. 7), α_xz towards Z
        (his Eq. 8); α_yz by analogy turns Y towards Z. Li's S is the negative of each, up to a turn of the work.
    q_mm
        Axis to coordinate; only the squarenesses need it.

    Returns
    -------
    dict
        Row (from 0) to what is added to its `d` and `a`, mm. The tool's displacement `(E_x, E_y, E_z)` is the sum
        over the axes (his Eq. 14): actual minus nominal, as everywhere in geoerr; his Eq. 1 has it the other way
        round.

    Raises
    ------
    GeometryError
        for a name that is none of the components.
    """
    sizes = dict(translations_mm)
    alpha, q = alpha_rad or {}, q_mm or {}
    for name, pair, axis in (("EYX", "xy", "x"), ("EZX", "xz", "x"), ("EZY", "yz", "y")):
        sizes[name] = sizes.get(name, 0.0) + alpha.get(pair, 0.0) * q.get(axis, 0.0)
    additions = {}
    for index, name in _ERRORS.items():
        _, _, column, sign, _ = _ROWS[index]
        size = sign * sizes.pop(name, 0.0)
        additions[index] = (size, 0.0) if column == "d" else (0.0, size)
    if sizes:
        known = ", ".join(sorted(_ERRORS.values()))
        raise GeometryError(f"{min(sizes)!r} is none of the components {known}")
    return additions
