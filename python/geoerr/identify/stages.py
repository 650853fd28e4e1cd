"""The stages of the method for all axes, in the order in which they need each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from geoerr.identify.along import Along, FittedPass, identify_along
from geoerr.identify.axis import AxisFunctions, angles_of, at_carriage_origin
from geoerr.identify.frames import SessionFrame
from geoerr.identify.levers import axes_that_turn
from geoerr.identify.linear import Numbers
from geoerr.identify.measurements import Measurements
from geoerr.identify.nodes import choose_nodes, is_first
from geoerr.identify.places import Places
from geoerr.identify.transverse import Transverse, identify_transverse
from geoerr.machine import AXES, Machine


@dataclass(frozen=True)
class Stages:
    """What each stage found, by axis; axes without lines are absent.

    Attributes
    ----------
    nodes_mm
        Grid of the axis.
    along, transverse
        None where the axis's passes do not show that component.
    functions
        Referred to the carriage origin, in the gauge.
    notes
        Sentences for the reader.
    """

    nodes_mm: dict[str, Numbers]
    along: dict[str, Along | None]
    transverse: dict[str, Transverse | None]
    functions: dict[str, AxisFunctions]
    notes: tuple[str, ...]


def run_stages(
    passes: Sequence[FittedPass],
    data: Measurements,
    frames: Mapping[str, SessionFrame],
    places: Places,
    machine: Machine,
) -> Stages:
    """Work out every axis that has lines, first those that carry others and were parked off their first point."""
    by_axis = {axis: [one for one in passes if one.source.axis == axis] for axis in AXES}
    by_axis = {axis: members for axis, members in by_axis.items() if members}
    stages = Stages({}, {}, {}, {}, ())
    notes: list[str] = []
    for axis, members in by_axis.items():
        lines = [line for line in places.lines if line.axis == axis]
        stages.nodes_mm[axis], note = choose_nodes(lines, [one.source for one in passes])
        notes.extend([note] if note else [])
        travelling = [one for one in members if one.shows_travel]
        along = None
        if travelling:
            along = identify_along(travelling, data, stages.nodes_mm[axis], places.base_mm[axis])
            if along.n_outside:
                notes.append(f"{along.n_outside} points along {axis.upper()} lie outside the lines' common range")
        stages.along[axis] = along
    known = {axis: angles_of(axis, along, None) for axis, along in stages.along.items()}
    for axis in _carrying_first(by_axis, machine, stages.nodes_mm):
        base_mm = places.base_mm[axis]
        transverse = identify_transverse(
            by_axis[axis], data, frames, machine, stages.nodes_mm[axis], base_mm, known, stages.nodes_mm
        )
        stages.transverse[axis] = transverse
        known[axis] = angles_of(axis, stages.along[axis], transverse)
        stages.functions[axis] = at_carriage_origin(axis, stages.along[axis], transverse, base_mm)
    return Stages(stages.nodes_mm, stages.along, stages.transverse, stages.functions, tuple(notes))


def _carrying_first(
    by_axis: Mapping[str, Sequence[FittedPass]], machine: Machine, nodes_mm: Mapping[str, Numbers]
) -> list[str]:
    """Order the axes so that each comes after those whose rotation turns its lines."""
    needs = {axis: _turned_by(members, machine, nodes_mm) & set(by_axis) for axis, members in by_axis.items()}
    order: list[str] = []
    while len(order) < len(by_axis):
        waiting = [axis for axis in by_axis if axis not in order]
        # Floor and relative data together can need each other both ways; then the first goes without.
        ready = [axis for axis in waiting if needs[axis] <= set(order)] or waiting
        order.append(ready[0])
    return order


def _turned_by(members: Sequence[FittedPass], machine: Machine, nodes_mm: Mapping[str, Numbers]) -> set[str]:
    return {
        other
        for one in members
        for other in axes_that_turn(machine, one.source.carrier, one.source.axis)
        if other not in nodes_mm or not is_first(float(one.source.parked_mm[AXES.index(other)]), nodes_mm[other])
    }
