r"""Terms as tables, in the gauge of errors.json.

A table stands for its polygon. Positioning and angles are 0 at the first entry; straightness has no least-squares
slope over the range of its polygon and is 0 at the first entry; slopes are squareness. To first order (THEORY of the
chain: tool from the work) the errors enter as

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

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

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
from geoerr.model.compile import Compiled, compile_terms, start_values
from geoerr.model.record import FitRecord
from geoerr.terms import CHANNELS, JOINT_CHANNELS, SQUARENESS_CHANNELS, Part, Term

# Entries of a table over a measured range: every centimetre of a printer's bed.
N_ENTRIES = 41
# As for a displacement: see `Model.is_determined_at`.
_NO_EFFECT = 1e-6
# Step of the difference by an inner parameter, as a part of its range: the truncation of a smooth function is its
# square, the rounding 1e-16 over it.
_INNER_STEP = 1e-5


_CoreRows: TypeAlias = tuple[npt.NDArray[np.uint8], Numbers, Numbers, Numbers, npt.NDArray[np.int64], None]


@dataclass(frozen=True)
class _Rows:
    """Functionals of the parameters: value (n,) now, derivative (n, m)."""

    value: Numbers
    by_parameter: Numbers

    def minus(self, value: Numbers, by_parameter: Numbers) -> _Rows:
        return _Rows(self.value - value, self.by_parameter - by_parameter)


def tables_of_terms(
    machine: Machine,
    terms: tuple[Term, ...],
    record: FitRecord | None,
    range_mm: Mapping[str, tuple[float, float] | None],
    positions: int | Mapping[str, npt.ArrayLike],
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
    """
    tabular = _tabular(terms)
    position_mm = {axis: _positions(machine, axis, range_mm, positions) for axis in AXES}
    joints, squareness = _functionals(machine, terms, tabular, position_mm)
    functions, slopes = _in_gauge(machine, joints, position_mm)
    squareness = _with_slopes(squareness, slopes)

    reasons = {} if record is None else {item.name: item for item in record.not_determined}
    given = {name: item for name, item in reasons.items() if name in ALL_NAMES}
    tables: dict[str, ErrorFunction] = {}
    squarenesses: dict[str, Squareness] = {}
    for name in ALL_NAMES:
        rows = squareness.get(LI_SQUARENESS[name][0]) if name in LI_SQUARENESS else functions.get(name)
        if rows is None or name in given:
            continue
        if record is not None and not _is_determined(rows, record):
            given[name] = NotDetermined(name, "the data do not determine it")
        elif name in LI_SQUARENESS:
            std = _std(rows, record)
            sign = LI_SQUARENESS[name][1]
            squarenesses[name] = Squareness(sign * float(rows.value[0]), None if std is None else float(std[0]))
        else:
            tables[name] = ErrorFunction(position_mm[name[2].lower()], rows.value, _std(rows, record))
    rest = [term.id for term in terms if term not in tabular]
    notes = (f"not in tables, for they follow conditions or another axis: {', '.join(rest)}",) if rest else ()
    return ErrorFunctions(
        machine,
        tables,
        squarenesses,
        "model" if record is None else "joint",
        not_determined=tuple(given[name] for name in ALL_NAMES if name in given),
        notes=notes,
    )


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
    joints, _ = _functionals(machine, terms, _tabular(terms), position_mm)
    scales = {}
    for axis in AXES:
        rows = joints.get(f"E{axis.upper()}{axis.upper()}")
        if rows is None:
            continue
        weights = least_squares_slope(position_mm[axis])[None, :]
        slope = _Rows(weights @ rows.value, weights @ rows.by_parameter)
        if record is None or _is_determined(slope, record):
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


def _tabular(terms: tuple[Term, ...]) -> list[Term]:
    return [term for term in terms if all(_is_tabular(term, part) for part in term.parts)]


def _is_tabular(term: Term, part: Part) -> bool:
    parameters = {parameter.name for parameter in term.coefficients + term.inner}
    names = {name for name in part.names if name not in parameters}
    if part.channel in JOINT_CHANNELS:
        return names <= {part.channel[2].lower()}
    return part.channel in SQUARENESS_CHANNELS and not names


def _positions(
    machine: Machine,
    axis: str,
    range_mm: Mapping[str, tuple[float, float] | None],
    positions: int | Mapping[str, npt.ArrayLike],
) -> Numbers:
    if not isinstance(positions, int):
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


def _functionals(
    machine: Machine, terms: tuple[Term, ...], tabular: list[Term], position_mm: Mapping[str, Numbers]
) -> tuple[dict[str, _Rows], dict[str, _Rows]]:
    """Give every channel's values along its own axis, in the gauge of the terms; squareness as one entry."""
    whole = compile_terms(machine, terms)
    n_parameters = whole.n_coefficients + whole.n_inner
    found: dict[str, _Rows] = {}
    for term, coefficients, inner in zip(terms, whole.coefficient_slices, whole.inner_slices, strict=True):
        if term not in tabular:
            continue
        places = [*range(coefficients.start, coefficients.stop)]
        places += [whole.n_coefficients + place for place in range(inner.start, inner.stop)]
        for channel, (value, derivative) in _of_term(machine, term, position_mm).items():
            by_parameter = np.zeros((len(value), n_parameters))
            by_parameter[:, places] = derivative
            before = found.get(channel)
            if before is not None:
                value, by_parameter = value + before.value, by_parameter + before.by_parameter
            found[channel] = _Rows(value, by_parameter)
    joints = {name: rows for name, rows in found.items() if name in JOINT_CHANNELS}
    squareness = {
        name: _Rows(rows.value[:1], rows.by_parameter[:1]) for name, rows in found.items() if name not in joints
    }
    return joints, squareness


def _of_term(machine: Machine, term: Term, position_mm: Mapping[str, Numbers]) -> dict[str, tuple[Numbers, Numbers]]:
    """Give a term's value and derivative by its own parameters on each of its channels."""
    compiled = compile_terms(machine, (term,))
    theta, phi = start_values((term,))
    result = {}
    for channel in term.channels:
        axis = channel[2].lower() if channel in JOINT_CHANNELS else "x"
        along = position_mm[axis]
        q_mm = np.zeros((len(along), 3))
        q_mm[:, AXES.index(axis)] = along
        variables = np.array([q_mm[:, AXES.index(name)] for name in compiled.variables], dtype=np.float64)
        rows: _CoreRows = (
            np.full(len(along), 3, dtype=np.uint8),
            q_mm,
            np.zeros_like(q_mm),
            np.ascontiguousarray(variables.reshape(len(compiled.variables), len(along))),
            np.arange(len(along), dtype=np.int64),
            None,
        )
        column = CHANNELS.index(channel)

        values = partial(_channel_values, compiled, rows, column)
        constant = values(np.zeros_like(theta), phi)
        by_coefficient = [values(unit, phi) - constant for unit in np.eye(len(theta))]
        by_inner = []
        for place, parameter in enumerate(term.inner):
            assert parameter.low is not None
            assert parameter.high is not None
            step = np.zeros_like(phi)
            step[place] = _INNER_STEP * (parameter.high - parameter.low or 1.0)
            by_inner.append((values(theta, phi + step) - values(theta, phi - step)) / (2.0 * step[place]))
        result[channel] = (values(theta, phi), np.array([*by_coefficient, *by_inner]).T)
    return result


def _channel_values(
    compiled: Compiled, rows: _CoreRows, column: int, coefficients: Numbers, inner: Numbers
) -> Numbers:
    return np.asarray(compiled.core.channel_values(*rows, coefficients, inner, 1)[:, column])


def _in_gauge(
    machine: Machine, joints: Mapping[str, _Rows], position_mm: Mapping[str, Numbers]
) -> tuple[dict[str, _Rows], dict[tuple[str, str], _Rows]]:
    """Give the tables in their gauge, and the slopes (m_b)_a that were taken out, by (b, a)."""
    tables: dict[str, _Rows] = {}
    slopes: dict[tuple[str, str], _Rows] = {}

    def add_slope(of: str, along: str, rows: _Rows) -> None:
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
                    add_slope(other, along, _Rows(sign * rows.value[:1], sign * rows.by_parameter[:1]))
        elif name[1].lower() != axis:
            weights = least_squares_slope(position_mm[axis])
            slope = _Rows(weights[None, :] @ rows.value, weights[None, :] @ rows.by_parameter)
            add_slope(axis, name[1].lower(), slope)
            arm = position_mm[axis] - position_mm[axis][0]
            rows = rows.minus(arm * slope.value, arm[:, None] * slope.by_parameter)
        tables[name] = rows.minus(rows.value[:1], rows.by_parameter[:1])
    return tables, slopes


def _with_slopes(squareness: Mapping[str, _Rows], slopes: Mapping[tuple[str, str], _Rows]) -> dict[str, _Rows]:
    """Give S_ab − (m_b)_a − (m_a)_b."""
    result = {}
    for channel in SQUARENESS_CHANNELS:
        first, second = channel[2], channel[3]
        total = squareness.get(channel)
        for key in ((second, first), (first, second)):
            slope = slopes.get(key)
            if slope is None:
                continue
            empty = _Rows(np.zeros(1), np.zeros_like(slope.by_parameter))
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


def _is_determined(rows: _Rows, record: FitRecord) -> bool:
    moved = np.abs(rows.by_parameter @ record.null_space)
    sizes = np.abs(rows.by_parameter) @ np.abs(record.null_space)
    # The first entry is 0 by the gauge, but for rounding: rows are compared with the largest.
    largest = sizes.max(axis=0, initial=0.0)
    return bool((moved <= _NO_EFFECT * largest).all())


def _std(rows: _Rows, record: FitRecord | None) -> Numbers | None:
    if record is None:
        return None
    variance = np.einsum("nj,jk,nk->n", rows.by_parameter, record.covariance, rows.by_parameter, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
