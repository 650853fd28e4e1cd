"""The base frame in each session's measuring frame, from the directions of lines 1 to 3.

X is the datum and Y lies in the XY plane. Travel of targets on the work is reversed first. Components across an axis
are taken in this frame; an error of the frame changes them to second order only, except for their slopes, which are
not taken from it (`geoerr.identify.transverse`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geoerr.errors import GeometryError
from geoerr.identify.levers import nominal_position_mm
from geoerr.identify.linear import Numbers
from geoerr.identify.measurements import Measurements
from geoerr.identify.passes import Pass
from geoerr.identify.places import Places
from geoerr.machine import AXES, Machine

# Targets must lie at least this far from each other across the line to show how the frame is turned about it.
_LEAST_SPREAD_MM = 5.0
# Share by which measured and stated distances of targets may differ before they say nothing about the frame.
_LEAST_AGREEMENT = 0.9


@dataclass(frozen=True)
class SessionFrame:
    """How one session's measuring frame lies.

    Attributes
    ----------
    session
        Its name.
    direction
        Axis to the unit direction (3,) of the tool's travel relative to the work, measuring frame.
    base_from_measured : (3, 3) or None
        Rotation; None where the session's lines do not show it.
    origin
        `lines` (from two or three axes), `targets` (one axis, and the stated offsets of its targets), `parallel` (a
        component is never measured), `unknown`.
    """

    session: str
    direction: dict[str, Numbers]
    base_from_measured: Numbers | None
    origin: str
    axes: frozenset[str] = field(default_factory=frozenset)


def session_frames(
    data: Measurements,
    passes: Sequence[Pass],
    fitted_direction: Sequence[Numbers],
    places: Places,
    machine: Machine,
) -> dict[str, SessionFrame]:
    """Find the frame of every session that has a pass.

    Parameters
    ----------
    fitted_direction
        For each pass the direction (3,) of its total-least-squares line, of the tool relative to the work.

    Raises
    ------
    GeometryError
        if a session's X, Y and Z directions are left-handed.
    """
    frames: dict[str, SessionFrame] = {}
    for session in dict.fromkeys(one.session for one in passes):
        members = [number for number, one in enumerate(passes) if one.session == session]
        axes = frozenset(passes[number].axis for number in members)
        if data.is_parallel[session]:
            unit = {axis: np.eye(3)[AXES.index(axis)] for axis in axes}
            frames[session] = SessionFrame(session, unit, np.eye(3), "parallel", axes)
            continue
        direction = {
            axis: _direction(axis, members, passes, fitted_direction, places) for axis in AXES if axis in axes
        }
        rotation, origin = _rotation(session, direction), "lines"
        if rotation is None:
            rotation = _rotation_from_targets(data, [passes[number] for number in members], direction, machine)
            origin = "unknown" if rotation is None else "targets"
        frames[session] = SessionFrame(session, direction, rotation, origin, axes)
    return frames


def _direction(
    axis: str, members: list[int], passes: Sequence[Pass], fitted: Sequence[Numbers], places: Places
) -> Numbers:
    """Average the directions of the session's passes of an axis that lie nearest to the axis's base line."""
    own = [number for number in members if passes[number].axis == axis]
    across = [index for index in range(3) if index != AXES.index(axis)]
    distance = {
        number: float(np.linalg.norm((passes[number].place_mm - places.base_mm[axis])[across])) for number in own
    }
    nearest = min(distance.values())
    chosen = [number for number in own if distance[number] <= nearest + 1e-6]
    total = sum((fitted[number] for number in chosen), start=np.zeros(3))
    return np.asarray(total / np.linalg.norm(total))


def _rotation(session: str, direction: dict[str, Numbers]) -> Numbers | None:
    if len(direction) < 2:
        return None
    if len(direction) == 3 and np.dot(np.cross(direction["x"], direction["y"]), direction["z"]) < 0.0:
        raise GeometryError(
            f"in session {session!r} the directions of travel of X, Y and Z are left-handed\n"
            "hint: check the chain in machine.toml, the column carrier (tool or work) and the signs of mx my mz"
        )
    if "x" in direction:
        x = direction["x"]
        z = np.cross(x, direction["y"]) if "y" in direction else direction["z"] - x * np.dot(x, direction["z"])
    else:
        x = np.cross(direction["y"], direction["z"])
        x = x / np.linalg.norm(x)
        z = np.cross(x, direction["y"])
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _rotation_from_targets(
    data: Measurements, members: list[Pass], direction: dict[str, Numbers], machine: Machine
) -> Numbers | None:
    """Turn the frame about the session's only axis so that its targets lie where their offsets say."""
    (axis,) = direction
    index = AXES.index(axis)
    along = direction[axis]
    first = np.linalg.svd(along[None])[2][1]
    # Columns: along the axis, and two directions across it, right-handed.
    turned = np.stack([along, first, np.cross(along, first)])
    nominal, measured = _centered_means(data, members, machine)
    across = [(index + 1) % 3, (index + 2) % 3]
    stated = nominal[:, across] @ np.array([1.0, 1.0j])
    seen = (measured @ turned.T)[:, 1:] @ np.array([1.0, 1.0j])
    spread = float(np.sum(np.abs(stated) ** 2))
    product = np.sum(np.conj(seen) * stated)
    if spread < _LEAST_SPREAD_MM**2:
        return None
    if abs(product) < _LEAST_AGREEMENT * np.sqrt(spread * float(np.sum(np.abs(seen) ** 2))):
        return None
    # stated ≈ seen · turn, so base components across = turn applied to the components in `turned`.
    turn = product / abs(product)
    second_row = turn.real * turned[1] - turn.imag * turned[2]
    third_row = turn.imag * turned[1] + turn.real * turned[2]
    base_from_measured = np.zeros((3, 3))
    base_from_measured[index] = along
    base_from_measured[across[0]] = second_row
    base_from_measured[across[1]] = third_row
    return base_from_measured


def _centered_means(data: Measurements, members: list[Pass], machine: Machine) -> tuple[Numbers, Numbers]:
    """Give each pass's mean nominal and measured position, relative to the mean of its carrier."""
    nominal, measured = np.zeros((len(members), 3)), np.zeros((len(members), 3))
    carriers = np.array([one.carrier for one in members])
    for number, one in enumerate(members):
        commanded, offset = data.commanded_mm[one.rows], data.offset_mm[one.rows]
        nominal[number] = nominal_position_mm(machine, one.carrier, commanded, offset).mean(axis=0)
        measured[number] = data.measured_mm[one.rows].mean(axis=0)
    for carrier in np.unique(carriers):
        same = carriers == carrier
        nominal[same] -= nominal[same].mean(axis=0)
        measured[same] -= measured[same].mean(axis=0)
    return nominal, measured
