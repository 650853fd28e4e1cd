"""The first-order error equations of any machine, as text, from its structural code.

For Li's printer, `wZbXYt`, seen from the work, they are Li's Eq. 8, which is missing in the copy that we have. Seen
from the floor, its tool has

>>> print(error_equations("wZbXYt", "tool"))
E_x = δ_xx + δ_xy − y ε_zx − l_y(ε_zx + ε_zy) + l_z(ε_yx + ε_yy) − y S_xy
E_y = δ_yx + δ_yy + l_x(ε_zx + ε_zy) − l_z(ε_xx + ε_xy)
E_z = δ_zx + δ_zy + y ε_xx − l_x(ε_yx + ε_yy) + l_y(ε_xx + ε_xy)

They are derived as on paper: the point's lever is carried along the chain, and each axis that carries the point adds
`δ + ε × lever`. The compiled core derives the same columns as numbers; the tests compare the two.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from geoerr.errors import GeometryError
from geoerr.machine import AXES, Machine, checked_chain

Notation = Literal["unicode", "latex"]
Seen = Literal["relative", "tool", "work"]

# b: (c, d) with b × c = d and b × d = -c.
_NEXT = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}
# Axis that leans: (component, squareness). X is the datum, and Y lies in the XY plane.
_LEANS = {"x": (), "y": (("x", "S_xy"),), "z": (("x", "S_xz"), ("y", "S_yz"))}


@dataclass(frozen=True)
class EquationTerm:
    """One product: `sign * factor * error`.

    Attributes
    ----------
    sign
        1 or -1.
    factor
        An axis position `x`, a lever `l_x` (for a point of the work `w_x`), or empty for 1.
    error
        In Li's notation: `δ_yx` (along y, of axis x), `ε_zx` (about z, of axis x), `S_xy`.
    """

    sign: int
    factor: str
    error: str


def equation_terms(machine: Machine | str, carrier: Seen = "relative") -> dict[str, list[EquationTerm]]:
    """Every term of the first-order displacement of a point, by component.

    Parameters
    ----------
    machine
        A machine, or a structural code such as `wZbXYt`.
    carrier
        `relative`: a point of the tool seen from the work; `tool` or `work`: a point of that body seen from the base,
        as a camera on the floor sees it.

    Returns
    -------
    dict
        `x`, `y`, `z` to terms. `l` is the lever from the carriage origin to the point (tool offset and target
        offset); for `work`, `w` is the point's place from the base origin at x = y = z = 0.

    Raises
    ------
    GeometryError
        for a text that is no structural code, or another carrier.
    """
    chain = machine.chain if isinstance(machine, Machine) else checked_chain(machine)
    inner, outer = chain[1:-1].lower().split("b")
    terms: dict[str, list[EquationTerm]] = {component: [] for component in AXES}
    if carrier == "work":
        lever = {component: [(1, f"w_{component}")] for component in AXES}
        # From the outermost carriage inwards; each has moved the point by −q before the next turns it.
        for axis in inner:
            _add_axis(terms, axis, lever, -1)
            lever[axis].insert(0, (-1, axis))
    elif carrier in ("tool", "relative"):
        lever = {component: [(1, f"l_{component}")] for component in AXES}
        for axis in reversed(outer):
            _add_axis(terms, axis, lever, 1)
            lever[axis].insert(0, (1, axis))
        if carrier == "relative":
            # Innermost first: the way from the base to the work undoes −q before it undoes the turn.
            for axis in reversed(inner):
                lever[axis].insert(0, (1, axis))
                _add_axis(terms, axis, lever, 1)
    else:
        raise GeometryError(f"{carrier!r} is not relative, tool or work: a point of the base has no error")
    return terms


def _add_axis(
    terms: dict[str, list[EquationTerm]], axis: str, lever: dict[str, list[tuple[int, str]]], side: int
) -> None:
    for b in AXES:
        terms[b].append(EquationTerm(side, "", f"δ_{b}{axis}"))
        c, d = _NEXT[b]
        terms[d] += [EquationTerm(side * sign, factor, f"ε_{b}{axis}") for sign, factor in lever[c]]
        terms[c] += [EquationTerm(-side * sign, factor, f"ε_{b}{axis}") for sign, factor in lever[d]]
    for component, squareness in _LEANS[axis]:
        terms[component].append(EquationTerm(-side, axis, squareness))


def error_equations(machine: Machine | str, carrier: Seen = "relative", notation: Notation = "unicode") -> str:
    """Write the first-order equations of a machine: three lines, one a component.

    Parameters
    ----------
    machine
        A machine, or a structural code such as `wZbXYt`.
    carrier
        `relative`: the tool seen from the work; `tool`, `work`: that body seen from the base. See `equation_terms`.
    notation
        `unicode` for people's eyes; `latex` for the inside of an `aligned` environment.

    Raises
    ------
    GeometryError
        for a text that is no structural code, or another carrier or notation.

    Notes
    -----
    Verified by `tests/kinematics/test_equations.py`: what is printed, read back as a formula, equals the core's
    columns (`geoerr._core.channel_columns`) on all 24 chains, and for `wZbXYt` Li's Eq. 8.
    """
    if notation not in ("unicode", "latex"):
        raise GeometryError(f"{notation!r} is not unicode or latex")
    by_component = equation_terms(machine, carrier)
    lines = [_line(component, _grouped(terms)) for component, terms in by_component.items()]
    if notation == "unicode":
        return "\n".join(lines)
    return " \\\\\n".join(_latex(line) for line in lines)


def _grouped(terms: list[EquationTerm]) -> list[tuple[int, str, list[str]]]:
    """Sum the errors that share sign and factor; squareness stands alone, at the end."""
    groups: dict[tuple[bool, str, int], list[str]] = {}
    for term in terms:
        key = (term.error.startswith("S"), term.factor, term.sign)
        groups.setdefault(key, []).append(term.error)
    ordered = sorted(groups.items(), key=lambda item: (item[0][0], len(item[0][1]), item[0][1], -item[0][2]))
    return [(sign, factor, sorted(errors, key=_axis_first)) for (_, factor, sign), errors in ordered]


def _axis_first(error: str) -> tuple[str, str]:
    """By the moving axis, as Li writes sums."""
    return (error[-1], error)


def _line(component: str, groups: list[tuple[int, str, list[str]]]) -> str:
    text = ""
    for sign, factor, errors in groups:
        if not factor:
            plus = " + " if sign > 0 else " − "
            for error in errors:
                text += plus + error
            continue
        body = f"({' + '.join(errors)})" if len(errors) > 1 else f" {errors[0]}"
        text += (" + " if sign > 0 else " − ") + factor + body
    text = text.removeprefix(" + ")
    return f"E_{component} = " + (text.replace(" − ", "−", 1) if text.startswith(" − ") else text or "0")


def _latex(line: str) -> str:
    line = re.sub(r"([A-Za-zδε])_(\w+)", r"\1_{\2}", line)
    line = re.sub(r"(?<=[\w}]) (?=[δεS])", r"\\,", line)
    line = line.replace("δ", "\\delta").replace("ε", "\\varepsilon").replace("−", "-").replace("(", "\\,(")
    return line.replace(" = ", " &= ", 1)
