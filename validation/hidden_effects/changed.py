"""What a machine or its cameras became between two sessions: another squareness, scale, base line.

A part of the study of its own, so that the seeds of the others stay what they were.
"""

from __future__ import annotations

import numpy as np
from validation.hidden_effects.chain import Array, nothing
from validation.hidden_effects.kinds import AXES, PAIRS, Acting, Registry, either_sign, index, joint
from validation.hidden_effects.log import Log

CHANGED = Registry()
_SIZE = 1e-4


def _after(log: Log, rng: np.random.Generator) -> Array:
    """Give 1 in the sessions since a change, or in a single one after which somebody put it right; else 0."""
    numbers = np.unique(log.session)
    begins = int(rng.choice(numbers[1:]))
    stays = rng.uniform() < 0.75
    return 1.0 * ((log.session >= begins) if stays else (log.session == begins))


@CHANGED.kind("squareness-change", "squareness-change", axes=PAIRS, off_axis=False)
def _squareness(log: Log, rng: np.random.Generator, pair: str, _: str) -> Acting:
    moved = nothing(log.n_rows)
    size = either_sign(rng) * _SIZE
    moved.squareness_rad[:, PAIRS.index(pair)] = size * _after(log, rng)
    return Acting(moved, {"S": size}, {}, ("session", pair[1]), (f"S_{pair}",))


@CHANGED.kind("scale-change", "scale-change", axes=AXES, off_axis=False)
def _scale(log: Log, rng: np.random.Generator, axis: str, _: str) -> Acting:
    a = index(axis)
    moved = nothing(log.n_rows)
    size = either_sign(rng) * _SIZE
    moved.delta_mm[:, a, a] = size * _after(log, rng) * log.q_mm[:, a]
    return Acting(moved, {"k": size}, {}, ("session", axis), (joint(a, a),))


@CHANGED.kind("rig-scale-change", "rig-scale-change", needs=("cameras",), off_axis=False)
def _rig_scale(log: Log, rng: np.random.Generator, _: str, __: str) -> Acting:
    moved = nothing(log.n_rows)
    size = either_sign(rng) * _SIZE
    moved.rig_mm[:] = size * _after(log, rng)[:, None] * log.in_camera_mm
    return Acting(moved, {"k": size}, {}, ("session",), ("rig-scale",))
