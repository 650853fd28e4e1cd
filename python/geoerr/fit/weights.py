"""What rows are weighed by: what they state, or how they scatter where that tells another thing of some devices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from geoerr.fit.scatter import ALIKE, Scatter, are_apart, scatter_beside_stated, scatter_of
from geoerr.fit.sightings import Numbers, Sightings

_UM_PER_MM = 1e3
# A note that names more is not read.
_MOST_NAMED = 4
# What states one number: what it is called, where it states how surely, what has that, and how it tells it.
_OF_ONE_NUMBER = {
    frozenset({"circle"}): ("a circular test states", "sr", "its radii", "from row to row"),
    frozenset({"lengths"}): ("lengths state", "s_measured", "they", "when they are measured again"),
}


def weighed(tables: Sequence[Sightings]) -> list[Sightings]:
    """Give tables whose rows have weights by their own scatter, and notes that say so.

    Rows that state no uncertainty; and those of devices that scatter more, beside what they state, than others do.
    """
    if any(table.is_stated for table in tables):
        return _fairly_stated([table if table.is_stated else _beside(table, tables) for table in tables])
    scatters = [scatter_of(table) for table in tables]
    told = [one for one in scatters if one is not None]
    if len(told) < len(tables):
        return [*_not_told(tables)] if len(tables) > 1 else list(tables)
    is_told = [one.n_told_by > 0.0 for one in told]
    n_told_by, std_mm = (
        np.concatenate([getattr(one, name)[own] for one, own in zip(told, is_told, strict=True)])
        for name in ("n_told_by", "std_mm")
    )
    if not are_apart(std_mm, n_told_by):
        return list(tables)
    by_row = [one.std_mm[one.device] for one in told]
    # The scale of a fit stays what a component scatters in the mean.
    mean_mm = _root_mean_square([own[table.is_measured] for own, table in zip(by_row, tables, strict=True)])
    return [
        replace(_with_std(table, own / mean_mm), notes=(*table.notes, _note(one)))
        for table, own, one in zip(tables, by_row, told, strict=True)
    ]


def _fairly_stated(tables: Sequence[Sightings]) -> list[Sightings]:
    """Enlarge what devices state that scatter more than that, where others do not.

    The scale of a fit is one for all: of a laser that scatters three times what it states, beside cameras that state
    what they scatter, every standard error was too small by two, and its noise was called an error of the machine.
    What is stated is never made less: there may be more in it than scatters from row to row. That is told.
    """
    found = [scatter_beside_stated(table, _stated_mm(table)) if table.is_stated else None for table in tables]
    told = [one for one in found if one is not None]
    ratio, n_told_by = (
        np.concatenate([np.zeros(0), *(getattr(one, name) for one in told)]) for name in ("ratio", "n_told_by")
    )
    is_told = n_told_by > 0.0
    if is_told.sum() < 2 or not are_apart(ratio[is_told], n_told_by[is_told]):
        return list(tables)
    least = float(ratio[is_told].min())
    # What all of them scatter more than stated is the scale of the fit.
    usual = max(least, 1.0)
    result = []
    for table, one in zip(tables, found, strict=True):
        if one is None:
            result.append(table)
            continue
        factor = np.where(one.ratio > ALIKE * usual, one.ratio / usual, 1.0)
        whitening = table.whitening / factor[one.device][:, None, None]
        is_less = one.ratio * ALIKE < 1.0
        told_of = (*_of_more(one.names, one.ratio, factor > 1.0), *_of_less(one.names, one.ratio, is_less))
        result.append(replace(table, whitening=whitening, notes=(*table.notes, *told_of)))
    return result


def _of_more(names: Sequence[str], ratio: Numbers, chosen: np.ndarray) -> Iterator[str]:
    if chosen.any():
        yield (
            f"rows scatter more than is stated, and other devices' do not: {_listed(names, ratio, chosen)}; these "
            "uncertainties are taken that much larger (correct sx, sy, sz, or what else states them)"
        )


def _of_less(names: Sequence[str], ratio: Numbers, chosen: np.ndarray) -> Iterator[str]:
    if chosen.any():
        yield (
            f"rows scatter less than is stated, beside another device: {_listed(names, ratio, chosen)}; weights are "
            "as stated, and a search may take the noise of the other device for an error (state what scatters from "
            "row to row)"
        )


def _listed(names: Sequence[str], ratio: Numbers, chosen: np.ndarray) -> str:
    """Say of devices how many times what is stated their rows scatter."""
    numbers = np.flatnonzero(chosen)
    listed = ", ".join(f"{names[number]} {ratio[number]:.2g} times" for number in numbers[:_MOST_NAMED])
    return listed + (f" and {len(numbers) - _MOST_NAMED} more" if len(numbers) > _MOST_NAMED else "")


def _not_told(tables: Sequence[Sightings]) -> Iterator[Sightings]:
    note = (
        "no uncertainty is stated (columns sx, sy, sz, sr and s_measured, mm), and too few rows were measured again "
        "to tell it: all are weighed alike, whatever device they are from"
    )
    for number, table in enumerate(tables):
        yield table if number else replace(table, notes=(*table.notes, note))


def _beside(table: Sightings, tables: Sequence[Sightings]) -> Sightings:
    """Weigh rows beside others that state theirs: by how they scatter; radii and lengths, or else, like the points.

    Points that nothing tells the scatter of stay as they are, and cannot be joined with the others.
    """
    scatter = scatter_of(table)
    of_one_number = _OF_ONE_NUMBER.get(frozenset(table.frames))
    if scatter is None and of_one_number is None:
        return table
    if scatter is None:
        stated = [one for one in tables if one.is_stated]
        std_mm = _root_mean_square([_stated_mm(one)[one.is_measured] for one in stated])
        by_row = np.full((len(table), 3), std_mm)
        assert of_one_number is not None
        note = _of_numbers(of_one_number, "that of what stands beside them", std_mm)
    else:
        by_row = scatter.std_mm[scatter.device]
        note = _note(scatter)
        if of_one_number is not None:
            note = _of_numbers(of_one_number, f"what they scatter {of_one_number[3]}", by_row[0, 0])
    return replace(_with_std(table, by_row), is_stated=True, notes=(*table.notes, note))


def _of_numbers(words: tuple[str, str, str, str], whose: str, std_mm: float) -> str:
    states, column, what, _ = words
    return f"{states} no uncertainty (column {column}, mm): {what} got {whose}, {std_mm:.2g} mm"


def _note(scatter: Scatter) -> str:
    """Say what rows of a table are weighed by, µm."""
    devices = [
        f"{name} " + ", ".join(f"{value * _UM_PER_MM:.3g}" for value in std_mm[told])
        for name, std_mm, told in zip(scatter.names, scatter.std_mm, scatter.n_told_by > 0, strict=True)
    ]
    named = "; ".join(devices[:_MOST_NAMED]) + (
        f"; and {len(devices) - _MOST_NAMED} more" * (len(devices) > _MOST_NAMED)
    )
    return f"no uncertainty is stated: rows are weighed by how they scatter from row to row, µm by component: {named}"


def _root_mean_square(values: Sequence[Numbers]) -> float:
    return float(np.sqrt((np.concatenate(values) ** 2).mean()))


def _stated_mm(table: Sightings) -> Numbers:
    """Give the stated standard uncertainties of components (n, 3), of radii and of lengths."""
    std = np.sqrt((table.unwhitening**2).sum(axis=2))
    return np.asarray(np.where(table.of_kind("lengths")[:, None], std * math.sqrt(2.0), std))


def _with_std(table: Sightings, std: Numbers) -> Sightings:
    """Give the table with a standard deviation (n, 3) of each component that is measured."""
    # Of two ends that are independent.
    std = np.where(table.of_kind("lengths")[:, None], std / math.sqrt(2.0), std)
    by_component = np.where(table.is_measured, 1.0 / np.where(table.is_measured, std, 1.0), 0.0)
    return replace(table, whitening=np.ascontiguousarray(np.eye(3) * by_component[:, None, :]))
