"""Errors between positions that lie side by side: a cause that is missing makes no millimetres there."""

import numpy as np
import pytest

from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.result import result_of
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

MACHINE = Machine.from_chain("wYbXZt", (220.0, 300.0, 200.0))
PLAY_MM, NOISE_MM, ERROR_MM = 0.014, 0.002, 0.02
TARGETS_MM = np.array([[0.0, 0.0, 0.0], [40.0, 0.0, -20.0], [0.0, 40.0, -30.0]])


def seen(rng: np.random.Generator, inside: float) -> Observations:
    """Nine lines and four diagonals, there and back twice; diagonals begin a share of the travel inside the lines."""
    travel = np.array([220.0, 300.0, 200.0])
    lines = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        for shares in ((0.1, 0.1), (0.9, 0.15), (0.2, 0.9)):
            ends = np.full((2, 3), 0.5)
            ends[:, others] = shares
            ends[:, axis] = 0.02, 0.98
            lines.append(ends * travel)
    for signs in ((1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)):
        half = np.array(signs) * (0.48 - inside)
        lines.append(np.stack([0.5 - half, 0.5 + half]) * travel)
    places, names, repeats = [], [], []
    for repeat in range(2):
        for number, (start, end) in enumerate(lines):
            share = np.concatenate([np.linspace(0.0, 1.0, 11), np.linspace(1.0, 0.0, 11)])
            places.append(start + share[:, None] * (end - start))
            names += [f"L{number}"] * 22
            repeats += [repeat] * 22
    q = np.concatenate(places)
    # The last direction holds where x stands.
    step = np.sign(np.round(np.diff(q[:, 0], prepend=q[0, 0] - 1.0), 6))
    last = np.maximum.accumulate(np.where(step != 0.0, np.arange(len(q)), 0))
    error = np.zeros_like(q)
    error[:, 0] = ERROR_MM * np.sin(q[:, 0] / 35.0) - 0.5 * PLAY_MM * step[last]
    columns: dict[str, list[np.ndarray]] = {}
    for target in TARGETS_MM:
        measured = q + target + error + NOISE_MM * rng.normal(size=q.shape)
        for name, at, offset, where in zip("xyz", q.T, target, measured.T, strict=True):
            columns.setdefault(name, []).append(at)
            columns.setdefault(f"t{name}", []).append(np.full(len(q), offset))
            columns.setdefault(f"m{name}", []).append(where)
            columns.setdefault(f"s{name}", []).append(np.full(len(q), NOISE_MM))
    n_targets = len(TARGETS_MM)
    texts: dict[str, object] = {"carrier": ["relative"] * len(q) * n_targets, "line": names * n_targets}
    texts |= {"repeat": repeats * n_targets, "target": np.repeat(["A", "B", "C"], len(q)).tolist()}
    directions = {"dir_x": np.tile(step[last], n_targets)}
    return observations_from_columns(
        texts | {name: np.concatenate(own) for name, own in columns.items()} | directions
    )


@pytest.mark.parametrize("inside", [0.0, 0.01, 0.02])
def test_play_that_no_term_has_leaves_the_model_better_than_none(inside: float) -> None:
    fitted = fit_terms(MACHINE, [seen(np.random.default_rng(1), inside)], options=FitOptions(threads=1))
    rng = np.random.default_rng(2)
    q = np.array([220.0, 300.0, 200.0]) * rng.uniform(0.03, 0.97, (400, 3))
    truth = np.zeros((400, 3))
    truth[:, 0] = ERROR_MM * np.sin(q[:, 0] / 35.0)

    def left_um(error_mm: np.ndarray) -> float:
        """What stays when a pose of the cameras and small turns are taken off: Tᵀ of three shifts and three turns."""
        centred = q - q.mean(axis=0)
        turns = [np.cross(axis, centred) for axis in np.eye(3)]
        shifts = [np.tile(axis, (len(q), 1)) for axis in np.eye(3)]
        pose = np.stack([column.ravel() for column in (*shifts, *turns)], axis=1)
        rest = error_mm.ravel() - pose @ np.linalg.lstsq(pose, error_mm.ravel(), rcond=None)[0]
        return 1e3 * float(np.sqrt((rest**2).sum() / len(q)))

    found = result_of(fitted).model.error_mm(q)
    assert left_um(truth) > 5.0
    # Play acts in the data with ±7 µm, and where lines stand across it half of it may look like an error.
    assert left_um(truth - found) < 0.5 * left_um(truth)
