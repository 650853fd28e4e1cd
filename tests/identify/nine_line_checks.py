"""Bounds and comparisons that several tests share."""

from __future__ import annotations

import numpy as np
from virtual_machine import Truth, gauged

from geoerr.error_functions import ErrorFunction, ErrorFunctions, Squareness

ANGLE_RAD = 100e-6
DELTA_MM = 0.03
S_RAD = 1e-3
# Smallest offset that an angle is got from in the fixtures of these tests.
LEAST_OFFSET_MM = 150.0
# What first order leaves out: angles (at most 2·ANGLE_RAD each, three axes) and S, times displacements (at most
# 3·DELTA_MM, and an angle times a lever of half a metre).
SECOND_ORDER_MM = (S_RAD + 6 * ANGLE_RAD) * (3 * DELTA_MM + 2 * ANGLE_RAD * 500.0)
# As an angle: over the offset, and one angle or S times another.
SECOND_ORDER_RAD = SECOND_ORDER_MM / LEAST_OFFSET_MM + (S_RAD + 6 * ANGLE_RAD) * 2 * ANGLE_RAD


def bound_of(name: str) -> float:
    return SECOND_ORDER_RAD if name[1] in "ABC" else SECOND_ORDER_MM


def deviation(truth: Truth, name: str, table: ErrorFunction | Squareness) -> float:
    """Largest difference from the truth in the gauge of the table's own range."""
    if isinstance(table, Squareness):
        return abs(table.value_rad - truth.iso()[name])
    axis = name[2].lower()
    expected = np.interp(table.position_mm, truth.q_mm[axis], truth.tables[name])
    is_straightness = name[1] in "XYZ" and name[1].lower() != axis
    expected = gauged(table.position_mm, expected) if is_straightness else expected - expected[0]
    return float(np.max(np.abs(table.value - expected)))


def assert_recovered(truth: Truth, errors: ErrorFunctions, *, alternatives: tuple[str, ...] = ()) -> None:
    """Everything that is given is right to second order."""
    tables: dict[str, ErrorFunction | Squareness] = {**errors.functions, **errors.squareness}
    wrong = {name: deviation(truth, name, table) for name, table in tables.items()}
    for alternative in alternatives:
        for name, table in errors.alternatives[alternative].items():
            wrong[f"{alternative}: {name}"] = deviation(truth, name, table) * bound_of("EXX") / bound_of(name)
    assert {n: v for n, v in wrong.items() if v > bound_of(n.split()[-1] if ":" not in n else "EXX")} == {}


def names_not_determined(errors: ErrorFunctions) -> set[str]:
    return {item.name for item in errors.not_determined}
