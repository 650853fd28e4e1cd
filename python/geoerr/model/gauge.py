r"""Terms as tables, in the gauge of errors.json.

A table stands for its polygon. Positioning and angles are 0 at the first entry; straightness has no least-squares
slope over the range of its polygon and is 0 at the first entry; slopes are squareness (`docs/theory/gauge.md`).
To first order, of the tool seen from the work, the errors enter as

    E = Σ_a δ_a(q_a) + ε_a(q_a) × (l + Σ_{b ∈ lever(a)} q_b b̂)  −  (S_xy y + S_xz z, S_yz z, 0)

with lever(a) the tool-side axes further from the base than a; for an axis on the work side all tool-side axes, a
itself, and the work-side axes between it and the base. Taken out of the tables:

- a constant δ: a shift of the work's set-up;
- a constant angle c of axis a: c × l, a constant tilt of the tool, and q_b (c × b̂) for each b of its lever;
- the slope s of axis a's straightness along b: q_a s b̂.

The last two are slopes m_b, E = Σ_b q_b m_b with m_b ⟂ b̂. A small rotation ω of the work's set-up adds ω × q. With
ω = (m_y,z, −m_x,z, m_x,y) the x axis keeps its direction and y stays in the XY plane, and what is left is

    E_x += (m_y,x + m_x,y) y + (m_z,x + m_x,z) z,     E_y += (m_z,y + m_y,z) z

so that S_ab becomes S_ab − (m_b)_a − (m_a)_b, and E is what it was up to that rigid set-up and the tool's tilt.
Everything is linear in the parameters, so each entry is a row t with value t·θ and variance t C tᵀ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoerr.error_functions import (
    ALL_NAMES,
    LI_SQUARENESS,
    LINEAR_AND_ANGULAR,
    ErrorFunction,
    ErrorFunctions,
    NotDetermined,
    Squareness,
    is_angular,
)
from geoerr.errors import ShapeError
from geoerr.geometry import remove_line
from geoerr.machine import AXES, Machine
from geoerr.model.arrays import Numbers, as_numbers
from geoerr.model.functionals import Rows, functionals, tabular_terms
from geoerr.model.record import FitRecord
from geoerr.terms import SQUARENESS_CHANNELS, Term

# Entries of a table over a measured range: every centimetre of a printer's bed.
N_ENTRIES = 41
# As for a displacement: see `Model.is_determined_at`.
_NO_EFFECT = 1e-6
# A straightness by one unit of a parameter, mm, that is round-off of the line taken off; a polygon with fewer entries
# is straight.
_ROUND_OFF, _LEAST_BENT = 1e-9, 3


def tables_of_terms(
    machine: Machine,
    terms: tuple[Term, ...],
    record: FitRecord | None,
    range_mm: Mapping[str, tuple[float, float] | None],
    positions: int | Mapping[str, npt.ArrayLike],
    constants: Mapping[str, float],
) -> ErrorFunctions:
    """Give terms as tables; see the module's text for the gauge.

    Parameters
    ----------
    terms
        Of the machine. Those that are functions of their own axis only, or constant squarenesses, are in the tables.
    record
        About the parameters of exactly these terms; None gives tables without uncertainties.
    range_mm
        Axis to its measured range; the machine's where there is none.
    positions
        Number of entries over that range, or positions for each axis.
    constants
        Conditions that stand still: name to value.
    """
    position_mm = {axis: _positions(machine, axis, range_mm, positions) for axis in AXES}
    by_name = gauged_rows(machine, terms, position_mm, constants)

    reasons = {} if record is None else {item.name: item for item in record.not_determined}
    given = {name: item for name, item in reasons.items() if name in ALL_NAMES}
    tables: dict[str, ErrorFunction] = {}
    squarenesses: dict[str, Squareness] = {}
    for name in ALL_NAMES:
        rows = by_name.get(name)
        if rows is None or name in given:
            continue
        if record is not None and not is_determined(rows, record.null_space):
            given[name] = NotDetermined(name, "the data do not determine it")
        elif record is not None and _has_no_freedom(name, rows):
            given[name] = NotDetermined(name, f"so few positions on {name[2]} leave nothing of it beside a line")
        elif name in LI_SQUARENESS:
            std = _std(rows, record)
            squarenesses[name] = Squareness(float(rows.value[0]), None if std is None else float(std[0]))
        else:
            tables[name] = ErrorFunction(position_mm[name[2].lower()], rows.value, _std(rows, record))
    tabular = tabular_terms(terms, constants)
    rest = [term.id for term in terms if term not in tabular]
    notes = [f"not in tables, for they follow conditions or another axis: {', '.join(rest)}"] if rest else []
    if constants:
        notes.append("at " + ", ".join(f"{name} = {value:g}" for name, value in constants.items()))
    return ErrorFunctions(
        machine,
        tables,
        squarenesses,
        "model" if record is None else "joint",
        not_determined=tuple(given[name] for name in ALL_NAMES if name in given),
        notes=tuple(notes),
    )


def _has_no_freedom(name: str, rows: Rows) -> bool:
    """Tell of a straightness whether its functions make lines alone: what nobody could see is no 0 ± 0.

    A polygon of two entries has none of any function.
    """
    if name not in LINEAR_AND_ANGULAR or is_angular(name) or name[1] == name[2] or len(rows.value) < _LEAST_BENT:
        return False
    return bool(max(np.abs(rows.by_parameter).max(initial=0.0), np.abs(rows.value).max(initial=0.0)) < _ROUND_OFF)


def gauged_rows(
    machine: Machine, terms: Sequence[Term], position_mm: Mapping[str, Numbers], constants: Mapping[str, float]
) -> dict[str, Rows]:
    """Give the 21 errors at positions in the gauge of the tables, by ISO name, with derivatives by all parameters.

    Only those that some term acts on; a squareness has its ISO sign and one row. See `tables_of_terms`.
    """
    joints, squareness = functionals(terms, tabular_terms(terms, constants), position_mm, constants)
    by_name, slopes = _in_gauge(machine, joints, position_mm)
    squareness = _with_slopes(squareness, slopes)
    for name, (channel, sign) in LI_SQUARENESS.items():
        if channel in squareness:
            rows = squareness[channel]
            by_name[name] = Rows(sign * rows.value, sign * rows.by_parameter)
    return by_name


@dataclass(frozen=True)
class MeanScale:
    """Slope of a positioning error's least-squares line, mm/mm, and its standard uncertainty (None: unknown)."""

    value: float
    std: float | None = None


def mean_scales(
    machine: Machine,
    terms: tuple[Term, ...],
    record: FitRecord | None,
    range_mm: Mapping[str, tuple[float, float] | None],
) -> dict[str, MeanScale]:
    """Give the mean scale of each axis whose positioning is in tables and determined; see `tables_of_terms`."""
    position_mm = {axis: _positions(machine, axis, range_mm, N_ENTRIES) for axis in AXES}
    joints, _ = functionals(terms, tabular_terms(terms, {}), position_mm, {})
    scales = {}
    for axis in AXES:
        rows = joints.get(f"E{axis.upper()}{axis.upper()}")
        if rows is None:
            continue
        weights = least_squares_slope(position_mm[axis])[None, :]
        slope = Rows(weights @ rows.value, weights @ rows.by_parameter)
        if record is None or is_determined(slope, record.null_space):
            std = _std(slope, record)
            scales[axis] = MeanScale(float(slope.value[0]), None if std is None else float(std[0]))
    return scales


def least_squares_slope(position_mm: Numbers) -> Numbers:
    """Give the weights w (n,) with w·f the slope, per mm, of the least-squares line of a polygon f over its range.

    What `remove_line`, the gauge of straightness everywhere, takes off each unit value: value and line are 0 at the
    first position.
    """
    unit = np.eye(len(position_mm))
    removed = unit[:, -1] - unit[:, 0] - remove_line(position_mm, unit)[:, -1]
    return np.asarray(removed / (position_mm[-1] - position_mm[0]))


def _positions(
    machine: Machine,
    axis: str,
    range_mm: Mapping[str, tuple[float, float] | None],
    positions: int | Mapping[str, npt.ArrayLike],
) -> Numbers:
    if not isinstance(positions, int | np.integer):
        # A list would be asked for the axis, too, and have none.
        if not isinstance(positions, Mapping) and type(positions).__name__ != "DataFrame":
            raise ShapeError(
                f"positions is {positions!r}\nhint: write how many entries a table has, a whole number, or positions "
                "in mm for each axis, such as {'x': [0.0, 100.0, 200.0]}"
            )
        if axis in positions:
            given = as_numbers(positions[axis], f"positions of {axis}")
            rises = given.ndim == 1 and len(given) >= 2 and bool((np.diff(given) > 0.0).all())
            if not (rises and bool(np.isfinite(given).all())):
                raise ShapeError(f"positions of {axis} must be (n,) rising numbers, two or more")
            return given
        positions = 2
    if positions < 2:
        raise ShapeError(f"a table has two entries or more, not {positions}")
    low, high = range_mm.get(axis) or machine.axes[axis].range_mm
    return np.linspace(low, high, positions)


def _in_gauge(
    machine: Machine, joints: Mapping[str, Rows], position_mm: Mapping[str, Numbers]
) -> tuple[dict[str, Rows], dict[tuple[str, str], Rows]]:
    """Give the tables in their gauge, and the slopes (m_b)_a that were taken out, by (b, a)."""
    tables: dict[str, Rows] = {}
    slopes: dict[tuple[str, str], Rows] = {}

    def add_slope(of: str, along: str, rows: Rows) -> None:
        before = slopes.get((of, along))
        slopes[of, along] = rows if before is None else rows.minus(-before.value, -before.by_parameter)

    for name in LINEAR_AND_ANGULAR:
        rows = joints.get(name)
        if rows is None:
            continue
        axis = name[2].lower()
        if is_angular(name):
            about = AXES["ABC".index(name[1])]
            for other in _lever(machine, axis):
                turned = _cross(about, other)
                if turned is not None:
                    along, sign = turned
                    add_slope(other, along, Rows(sign * rows.value[:1], sign * rows.by_parameter[:1]))
        elif name[1].lower() != axis:
            weights = least_squares_slope(position_mm[axis])
            slope = Rows(weights[None, :] @ rows.value, weights[None, :] @ rows.by_parameter)
            add_slope(axis, name[1].lower(), slope)
            arm = position_mm[axis] - position_mm[axis][0]
            rows = rows.minus(arm * slope.value, arm[:, None] * slope.by_parameter)
        tables[name] = rows.minus(rows.value[:1], rows.by_parameter[:1])
    return tables, slopes


def _with_slopes(squareness: Mapping[str, Rows], slopes: Mapping[tuple[str, str], Rows]) -> dict[str, Rows]:
    """Give S_ab − (m_b)_a − (m_a)_b."""
    result = {}
    for channel in SQUARENESS_CHANNELS:
        first, second = channel[2], channel[3]
        total = squareness.get(channel)
        for key in ((second, first), (first, second)):
            slope = slopes.get(key)
            if slope is None:
                continue
            empty = Rows(np.zeros(1), np.zeros_like(slope.by_parameter))
            total = (empty if total is None else total).minus(slope.value, slope.by_parameter)
        if total is not None:
            result[channel] = total
    return result


def _lever(machine: Machine, axis: str) -> str:
    """Axes whose position is part of the arm of an axis's angle: see the module's text."""
    tool, work = machine.tool_axes, machine.work_axes
    if axis in tool:
        return tool[tool.index(axis) + 1 :]
    return tool + work[: work.index(axis) + 1]


def _cross(about: str, arm: str) -> tuple[str, float] | None:
    """Axis and sign of `about × arm`; None where they are parallel."""
    if about == arm:
        return None
    third = next(axis for axis in AXES if axis not in (about, arm))
    return third, 1.0 if (AXES.index(arm) - AXES.index(about)) % 3 == 1 else -1.0


def is_determined(rows: Rows, null_space: Numbers) -> bool:
    """Tell whether directions (m, k) that the data do not determine leave all of these functionals alone."""
    moved = np.abs(rows.by_parameter @ null_space)
    sizes = np.abs(rows.by_parameter) @ np.abs(null_space)
    # The first entry is 0 by the gauge, but for rounding: rows are compared with the largest.
    largest = sizes.max(axis=0, initial=0.0)
    return bool((moved <= _NO_EFFECT * largest).all())


def _std(rows: Rows, record: FitRecord | None) -> Numbers | None:
    if record is None:
        return None
    variance = np.einsum("nj,jk,nk->n", rows.by_parameter, record.covariance, rows.by_parameter, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
