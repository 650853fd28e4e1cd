"""Of functions that nearly cancel, or follow what is missing, fewer are taken: they ran away to metres."""

import numpy as np
import pytest

from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.run_away import run_away
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

TRAVEL_MM = np.array([400.0, 300.0, 250.0])
MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
NOISE_MM, JUMP_MM = 0.004, 0.05


def seen(seed: int) -> Observations:
    """Lines and diagonals at places of their own, there and back, by cameras that are knocked in the middle."""
    rng = np.random.default_rng(seed)
    q_mm, names = [], []
    for number in range(5):
        through = rng.uniform(0.1, 0.9, 3)
        share = np.array([0.02, *np.sort(rng.uniform(size=5)), 0.98])
        for way in (*np.eye(3), (1, 1, 1), (1, -1, 1), (1, 1, -1)):
            moves = np.array(way) != 0.0
            for along in (share, share[::-1]):
                own = np.where(np.array(way) > 0.0, along[:, None], 1.0 - along[:, None])
                q_mm.append(np.where(moves, own, through) * TRAVEL_MM)
                names += [f"{way}{number}"] * len(share)
    q = np.concatenate(q_mm)
    angle = np.cumsum(rng.normal(size=(3, 3)), axis=0)[:, None, :] * 3e-5 * (q / TRAVEL_MM).T[:, :, None]
    error = sum(np.cross(turn, np.where(np.arange(3) > axis, q, 0.0)) for axis, turn in enumerate(angle))
    error = error + JUMP_MM * (np.arange(len(q)) >= len(q) // 2)[:, None] * np.array([0.8, 0.0, 0.6])
    measured = q + error + NOISE_MM * rng.normal(size=q.shape)
    columns: dict[str, object] = {"carrier": ["tool"] * len(q), "line": names}
    columns |= {name: q[:, index] for index, name in enumerate("xyz")}
    columns |= {f"m{name}": measured[:, index] for index, name in enumerate("xyz")}
    return observations_from_columns(columns | {f"s{name}": np.full(len(q), NOISE_MM) for name in "xyz"})


@pytest.mark.parametrize("seed", range(4))
def test_no_error_runs_away_where_something_is_missing(seed: int) -> None:
    fitted = fit_terms(MACHINE, [seen(seed)], options=FitOptions(threads=1))
    assert fitted.solved.converged
    assert not run_away(fitted)
    # 50 µm that jump in the middle are not followed by what is missed by more where it was not seen.
    assert fitted.held_out.figures is not None
    unseen, seen_um = fitted.held_out.figures.rmse_um, fitted.figures.rmse_um
    assert unseen is not None
    assert seen_um is not None
    assert unseen < 1.5 * seen_um < 1.5 * 1e3 * JUMP_MM
