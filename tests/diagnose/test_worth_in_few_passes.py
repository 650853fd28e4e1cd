"""What something is worth is what of the residuals it explains, however much of it passed for noise at first."""

import numpy as np
import pytest
from compare_scenes import measured
from hidden_machine import Plan, machine, motion

import geoerr
from geoerr.diagnose import diagnose
from geoerr.fit import FitOptions

NOISE_UM, PLAY_UM = 2.0, 32.0


@pytest.mark.parametrize("seed", [5, 6])
def test_in_a_session_of_few_passes_play_is_not_worth_more_than_was_measured(seed: int) -> None:
    """Six passes: until the play is known, what it does to each of them is an offset of the pass."""
    rng = np.random.default_rng(seed)
    moved = motion(rng, Plan(n_sessions=1, n_lines=6, n_points=12))
    seen_mm = moved.q - 0.5e-3 * PLAY_UM * moved.d[:, :1] * np.eye(3)[0]
    observations = measured(moved.q, seen_mm, rng, noise_mm=1e-3 * NOISE_UM, **moved.seen_from_the_tool)
    model = geoerr.fit_model(machine(), observations, components="none", options=FitOptions(threads=1)).model
    diagnosis = diagnose(model, observations, threads=1)
    play = diagnosis.found[0]
    assert str(play.reference) == "backlash:x"
    # Nothing else is there but noise: three components of it.
    of_play_um = np.sqrt(diagnosis.fitted.figures.headline_um**2 - 3.0 * NOISE_UM**2)
    assert play.worth_um == pytest.approx(of_play_um, rel=0.1)
    used = diagnosis.fitted.solved.used
    assert np.sqrt((play.explained_um[used] ** 2).sum(axis=1).mean()) == pytest.approx(play.worth_um, rel=0.02)
