"""What rows that state no uncertainty are weighed by, among themselves and beside those that do."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from geoerr.fit.scatter import Scatter, are_apart, scatter_of
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
    """Give tables whose rows that state no uncertainty have weights by their own scatter, and notes that say so."""
    if any(table.is_stated for table in tables):
        return [table if table.is_stated else _beside(table, tables) for table in tables]
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
