"""Tables of the 21 errors for a page: size, uncertainty, truth where it is known, and what is not determined."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from geoerr.error_functions import (
    LI_NAMES,
    LINEAR_AND_ANGULAR,
    SQUARENESS,
    ErrorFunction,
    ErrorFunctions,
    is_angular,
)
from geoerr.report.page import NOT_DETERMINED, NOT_IN_MODEL, Block, Paragraph, Table

_UM_PER_MM = 1e3
_MICRO = 1e6
_COVERAGE_95 = 1.96
_UNKNOWN = "–"


def error_function_table(
    errors: ErrorFunctions, truth: ErrorFunctions | None = None, *, absent: Collection[str] = ()
) -> Table:
    """Make a row for each of the 18 functions; those that are `absent` are not in the model.

    Columns: name, Li's symbol, unit, peak to peak, median and largest standard uncertainty; with a truth also its
    peak to peak, the rms difference, and the share of positions whose 95 % interval holds the truth.
    """
    header = ["error", "Li", "unit", "peak to peak", "std, median", "std, largest"]
    if truth is not None:
        header += ["truth, peak to peak", "rms difference", "truth within 95 %"]
    rows = []
    for name in LINEAR_AND_ANGULAR:
        found = errors.functions.get(name)
        factor, unit = (_MICRO, "µrad") if is_angular(name) else (_UM_PER_MM, "µm")
        row = [name, LI_NAMES[name], unit, *_size(found, factor, NOT_IN_MODEL if name in absent else NOT_DETERMINED)]
        if truth is not None:
            row += _against_truth(found, truth.functions.get(name), factor)
        rows.append(tuple(row))
    return Table("The 18 error functions", tuple(header), tuple(rows))


def squareness_table(
    errors: ErrorFunctions, truth: ErrorFunctions | None = None, *, absent: Collection[str] = ()
) -> Table:
    """Make a row for each squareness: value with its 95 % interval, and the truth where it is known."""
    header = ["error", "Li", "value, µrad", "95 % interval, µrad"]
    if truth is not None:
        header += ["truth, µrad", "difference, µrad"]
    rows = []
    for name in SQUARENESS:
        found = errors.squareness.get(name)
        without = NOT_IN_MODEL if name in absent else NOT_DETERMINED
        row = [name, LI_NAMES[name], without if found is None else _number(found.value_rad * _MICRO)]
        std = None if found is None else found.std_rad
        row.append(_UNKNOWN if std is None else f"± {_number(std * _MICRO * _COVERAGE_95)}")
        if truth is not None:
            true = truth.squareness.get(name)
            row.append(_UNKNOWN if true is None else _number(true.value_rad * _MICRO))
            if found is None or true is None:
                row.append(_UNKNOWN)
            else:
                row.append(_number((found.value_rad - true.value_rad) * _MICRO))
        rows.append(tuple(row))
    return Table("The three squarenesses", tuple(header), tuple(rows))


def not_determined(errors: ErrorFunctions, absent: Sequence[str] = ()) -> tuple[Block, ...]:
    """Say what the data do not determine, and why, and what is `absent`: not in the model; unknown, not zero."""
    rows = tuple((item.name, LI_NAMES.get(item.name, ""), item.why) for item in errors.not_determined)
    blocks: list[Block] = []
    if rows:
        blocks += [
            Paragraph("These errors are unknown, not zero: the measurements do not see them."),
            Table("Not determined", ("error", "Li", "why"), rows),
        ]
    if absent:
        said = "Of these errors the model has nothing: predictions take them as 0, and no uncertainty counts them."
        names = tuple((name, LI_NAMES.get(name, "")) for name in absent)
        blocks += [Paragraph(said), Table("Not in the model: taken as 0", ("error", "Li"), names)]
    return tuple(blocks) or (Paragraph("The measurements determine all 21 errors."),)


def share_within_95(found: ErrorFunction, true: ErrorFunction) -> float | None:
    """Give the share of a table's positions at which the 95 % interval holds the truth; None without uncertainties.

    Positions without uncertainty (where the convention sets the value) do not count.
    """
    if found.std is None:
        return None
    counts = found.std > 0.0
    if not counts.any():
        return None
    inside = np.abs(found.value - true.at(found.position_mm)) <= _COVERAGE_95 * found.std
    return float(inside[counts].mean())


def _size(found: ErrorFunction | None, factor: float, without: str) -> list[str]:
    if found is None:
        return [without, _UNKNOWN, _UNKNOWN]
    size = [_number(float(np.ptp(found.value)) * factor)]
    if found.std is None:
        return [*size, _UNKNOWN, _UNKNOWN]
    return [*size, _number(float(np.median(found.std)) * factor), _number(float(found.std.max()) * factor)]


def _against_truth(found: ErrorFunction | None, true: ErrorFunction | None, factor: float) -> list[str]:
    if true is None:
        return [_UNKNOWN] * 3
    size = _number(float(np.ptp(true.value)) * factor)
    if found is None:
        return [size, _UNKNOWN, _UNKNOWN]
    difference = found.value - true.at(found.position_mm)
    share = share_within_95(found, true)
    return [
        size,
        _number(float(np.sqrt(np.mean(difference**2))) * factor),
        _UNKNOWN if share is None else f"{100.0 * share:.0f} %",
    ]


def _number(value: float) -> str:
    return f"{value:.1f}".replace("-", "−")
