"""The budget in words and columns, eighty wide: each source at the last place, and all of them at each place."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from geoerr.budget.budget import Budget, Contribution, Quantity
from geoerr.model.fit_words import NOT_SETTLED
from geoerr.summaries import capitalised

# Rounding, in any of the units.
_NOTHING = 1e-9
_QUANTITIES: tuple[tuple[Quantity, str], ...] = (("prediction", "predicted error"), ("part", "compensated part"))
_WIDTH = 80
_INDENT = "    "
_MOST_PLACES = 6
# Columns of a place and of a share; six and one leave room for a short name.
_CELL, _SHARE = 9, 8
_WIDEST_NAME = 46
_SOURCE_NAME = 34


def budget_text(budget: Budget) -> str:
    """Give the whole budget: stages, sources with contributions, groups, uncertainties, and what is not counted."""
    shown = _shown(budget)
    heads = _heads(budget, shown)
    lines = [] if budget.has_settled else [f"{capitalised(NOT_SETTLED)}."]
    lines.append("[[Places]] mm")
    for head, row in zip(heads, shown, strict=True):
        name = budget.place_names[row]
        x, y, z = budget.q_mm[row]
        known = "".join(
            f"  {what}: {', '.join(np.array(list('xyz'))[of_these])}"
            for what, of_these in (
                ("not in the model", ~budget.is_in_model[row]),
                ("not determined", budget.is_in_model[row] & ~budget.is_determined[row]),
            )
            if of_these.any()
        )
        named = name if name.endswith(head) else f"{head}: {name}"
        lines += _row(named, 30, f"{x:9.1f} {y:9.1f} {z:9.1f}{known}")
    lines += ["[[From the picture to the parameters]] standard uncertainties, medians"]
    wide = min(max((len(stage.what) for stage in budget.stages), default=0), 59)
    for stage in budget.stages:
        lines += _row(stage.what, max(wide, 52) + 1, f"{_in_unit(stage.std, stage.unit)} {stage.unit}")
    lines += ["[[Sources]] own u, type, degrees of freedom; contribution to a part's error, µm"]
    lines += _sources(budget, shown, heads)
    if len(shown) > 1:
        lines += ["[[The same at each place]] contribution to a part's error, µm"]
        lines += _contributions(_with_pieces(budget), heads, shown)
    lines += ["[[The same through the parameters]] contribution of each group alone, µm"]
    groups = [(one.name, one) for one in budget.parameter_groups()]
    lines += _contributions(groups, heads, shown, has_share=True)
    lines += ["[[Combined]] µm; U at 95 %, k from Student's t with the effective dof"]
    lines += [*_combined(budget, heads, shown), "[[Not counted]]"]
    for sentence in budget.not_counted:
        lines += textwrap.wrap(
            sentence, _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT + "  ", break_on_hyphens=False
        )
    return "\n".join(lines) + "\n"


def _sources(budget: Budget, shown: Sequence[int], heads: Sequence[str]) -> Iterator[str]:
    head = heads[-1] if heads else ""
    yield f"{_INDENT}{'':<{_SOURCE_NAME}}{'u':>9} {'':<5}{'':>2}{'dof':>6}{head:>10}{'share':>9}"
    by_name = {source.name: source for source in budget.sources}
    for one in budget.contributions("part"):
        source = by_name[one.name]
        size = f"{_in_unit(source.std, source.unit):>9} {source.unit:<5}{source.kind:>2}{_dof(source.dof):>6}"
        yield from _row(one.name, _SOURCE_NAME, size + _at_last(one, shown))
        for part in budget.pieces(source.name):
            piece = source.pieces[part.name]
            size = f"{_in_unit(piece.std, piece.unit):>9} {piece.unit:<5}{'':>8}"
            yield from _row(f"  {part.name}", _SOURCE_NAME, size + _at_last(part, shown))


def _with_pieces(budget: Budget) -> Iterator[tuple[str, Contribution]]:
    for one in budget.contributions("part"):
        yield one.name, one
        yield from ((f"  {part.name}", part) for part in budget.pieces(one.name))


def _contributions(
    named: Iterable[tuple[str, Contribution]], heads: Sequence[str], shown: Sequence[int], *, has_share: bool = False
) -> Iterator[str]:
    width = min(_WIDTH - len(_INDENT) - _CELL * len(shown) - _SHARE * has_share, _WIDEST_NAME)
    yield f"{_INDENT}{'':<{width}}{_joined(heads)}" + (f"{'share':>{_SHARE}}" if has_share else "")
    for name, one in named:
        share = _share_of(one, shown) if has_share else ""
        yield from _row(name, width, _values(one.std_um[shown]) + f"{share:>{_SHARE}}".rstrip())


def _combined(budget: Budget, heads: Sequence[str], shown: Sequence[int]) -> Iterator[str]:
    width = min(_WIDTH - len(_INDENT) - _CELL * len(shown), _WIDEST_NAME)
    for of, what in _QUANTITIES:
        yield f"{_INDENT}{what:<{width}}{_joined(heads)}"
        for sign, numbers in (("u", budget.standard_um(of)), ("U", budget.expanded_um(of))):
            for axis, name in enumerate("xyz"):
                yield from _row(f"  {sign} {name}", width, _values(numbers[shown, axis]))
        yield from _row("  u of the length", width, _values(budget.standard_length_um(of)[shown]))
        yield from _row("  length below", width, _values(budget.expanded_length_um(of)[shown]))
        yield from _row("  effective dof", width, _joined(map(_dof, budget.dof(of)[shown, 3].tolist())))


def _shown(budget: Budget) -> list[int]:
    """Give the places that a page has room for: ends, centre and worst where they are named, else the first six."""
    wanted = ("corner −−−", "corner +−−", "corner −+−", "corner +++", "centre", "worst")
    named = [budget.place_names.index(name) for name in wanted if name in budget.place_names]
    return named or list(range(min(len(budget.place_names), _MOST_PLACES)))


def _heads(budget: Budget, shown: Sequence[int]) -> list[str]:
    """Give the heads of the places' columns: their names, or numbers where one is too long."""
    names = [budget.place_names[row].removeprefix("corner ") for row in shown]
    is_short = all(len(name) < _CELL for name in names)
    return names if is_short else [f"place {number}" for number in range(1, len(names) + 1)]


def _row(name: str, width: int, cells: str) -> list[str]:
    """Give a row; a name that is wider than its column has a line of its own."""
    if len(name) < width:
        return [f"{_INDENT}{name:<{width}}{cells}"]
    return [f"{_INDENT}{name}", f"{_INDENT}{'':<{width}}{cells}"]


def _joined(cells: Iterable[str]) -> str:
    return "".join(f"{cell:>{_CELL}}" for cell in cells)


def _values(values: np.ndarray) -> str:
    return _joined(map(_number, values.tolist()))


def _at_last(one: Contribution, shown: Sequence[int]) -> str:
    """Give what is contributed at the last place shown."""
    return f"{_number(float(one.std_um[shown[-1]])):>10}{_share_of(one, shown):>9}" if shown else ""


def _share_of(one: Contribution, shown: Sequence[int]) -> str:
    """Give the share of the variance at the last place shown."""
    share = one.share[shown[-1]] if shown else math.nan
    # What rounds to 0 has no sign.
    return "" if math.isnan(share) else f"{round(100.0 * float(share), 1) + 0.0:.1f} %".replace("-", "−")


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    if abs(value) < _NOTHING:
        return "0"
    return f"{value:.3g}" if abs(value) < 100.0 else f"{value:.0f}"


def _in_unit(value: float, unit: str) -> str:
    """Write a standard deviation; what is counted by the kelvin or the millimetre is small however much it does."""
    return f"{value:.3g}" if "/" in unit and math.isfinite(value) else _number(value)


def _dof(value: float) -> str:
    return "–" if math.isnan(value) else "∞" if value > 1e4 else f"{value:.0f}"
