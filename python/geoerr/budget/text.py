"""The budget in words and columns, as wide as its places."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.budget.budget import Budget, Contribution, Quantity

# Rounding, in any of the units.
_NOTHING = 1e-9
_QUANTITIES: tuple[tuple[Quantity, str], ...] = (("prediction", "predicted error"), ("part", "compensated part"))


def budget_text(budget: Budget) -> str:
    """Give the whole budget: stages, sources with contributions, groups, uncertainties, and what is not counted."""
    shown = _shown(budget)
    heads = "".join(f"{budget.place_names[row].removeprefix('corner '):>16}" for row in shown)
    lines = ["[[Places]] mm"]
    for row in shown:
        x, y, z = budget.q_mm[row]
        unknown = "".join(np.array(list("xyz"))[~budget.is_determined[row]])
        known = f"  not determined: {', '.join(unknown)}" if unknown else ""
        lines.append(f"    {budget.place_names[row]:<12} {x:9.1f} {y:9.1f} {z:9.1f}{known}")
    lines += ["[[From the picture to the parameters]] standard uncertainties, medians"]
    wide = max((len(stage.what) for stage in budget.stages), default=0)
    lines += [f"    {stage.what:<{max(wide, 52)}} {_number(stage.std)} {stage.unit}" for stage in budget.stages]
    lines += ["[[Sources]] own standard uncertainty, type, degrees of freedom; contribution to a part's error, µm"]
    lines += [f"    {'':<28}{'u':>9} {'':<5}{'':>2}{'dof':>5}{heads}   last share", *_sources(budget, shown)]
    lines += ["[[The same through the parameters]] contribution of each group alone, µm"]
    lines += [f"    {'':<50}{heads}   last share"]
    for one in budget.parameter_groups():
        lines.append(f"    {one.name:<50}" + _values(one.std_um[shown]) + _share_of(one, shown))
    lines += ["[[Combined]] µm; U at 95 %, k from Student's t with the effective degrees of freedom"]
    lines += [f"    {'':<50}{heads}", *_combined(budget, shown)]
    return "\n".join([*lines, "[[Not counted]]", *(f"    {sentence}" for sentence in budget.not_counted)]) + "\n"


def _sources(budget: Budget, shown: Sequence[int]) -> Iterator[str]:
    by_name = {source.name: source for source in budget.sources}
    for one in budget.contributions("part"):
        source = by_name[one.name]
        size = f"{_number(source.std):>9} {source.unit:<5}{source.kind:>2}{_dof(source.dof):>5}"
        yield f"    {one.name:<28}{size}" + _values(one.std_um[shown]) + _share_of(one, shown)
        for part in budget.pieces(source.name):
            piece = source.pieces[part.name]
            size = f"{_number(piece.std):>9} {piece.unit:<5}{'':>7}"
            yield f"      {part.name:<26}{size}" + _values(part.std_um[shown]) + _share_of(part, shown)


def _combined(budget: Budget, shown: Sequence[int]) -> Iterator[str]:
    for of, what in _QUANTITIES:
        for sign, numbers in (("u", budget.standard_um(of)), ("U", budget.expanded_um(of))):
            for axis, name in enumerate("xyz"):
                yield f"    {f'{what}, {sign} {name}':<50}" + _values(numbers[shown, axis])
        yield f"    {what + ', u of the length':<50}" + _values(budget.standard_length_um(of)[shown])
        yield f"    {what + ', length below':<50}" + _values(budget.expanded_length_um(of)[shown])
        dof = budget.dof(of)[shown, 3].tolist()
        yield f"    {what + ', effective dof':<50}" + "".join(f"{_dof(value):>16}" for value in dof)


def _shown(budget: Budget) -> list[int]:
    """Give the places that a page has room for: ends, centre and worst where they are named, else the first six."""
    wanted = ("corner −−−", "corner +−−", "corner −+−", "corner +++", "centre", "worst")
    named = [budget.place_names.index(name) for name in wanted if name in budget.place_names]
    return named or list(range(min(len(budget.place_names), 6)))


def _values(values: np.ndarray) -> str:
    return "".join(f"{_number(value):>16}" for value in values.tolist())


def _share_of(one: Contribution, shown: Sequence[int]) -> str:
    """Give the share of the variance at the last place shown, the last one shown."""
    share = one.share[shown[-1]] if shown else math.nan
    return "" if math.isnan(share) else f"{100.0 * share:11.1f} %"


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    if abs(value) < _NOTHING:
        return "0"
    return f"{value:.3g}" if abs(value) < 100.0 else f"{value:.0f}"


def _dof(value: float) -> str:
    return "–" if math.isnan(value) else "∞" if value > 1e4 else f"{value:.0f}"
