"""What a plan was made to show is asked for by itself: the p-value of all knows of it, too."""

import numpy as np
from validation.laser_run import MACHINE, laser_run

from geoerr.diagnose import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.fit import fit_model

ALPHA = 0.05


def diagnosed(seed: int, play_um: float = 2.2) -> Diagnosis:
    """Diagnose four cycles of an axis with play, whose passes have offsets larger than that."""
    rng = np.random.default_rng(seed)
    run = laser_run(np.arange(2.0, 400.0, 19.3), 4)
    offset_um = 3.0 * rng.normal(size=8)[2 * run.repeat.astype(int) + (run.direction > 0.0)]
    scatter_um = 3.0 * rng.normal(size=len(run.x_mm))
    error_um = 6.0 * np.sin(run.x_mm / 60.0) - play_um * run.direction
    return diagnose(fit_model(MACHINE, run.observed(error_um + offset_um + scatter_um)).fitted, threads=1)


def test_what_is_named_and_the_whole_agree() -> None:
    """Play of p = 0.04 was named, and "nothing is missing" had p = 0.11 beside it."""
    named = [one for one in map(diagnosed, range(14)) if one.found]
    assert len(named) >= 3
    assert any(one.searched.first.p_asked < 1.0 for one in named)
    for one in named:
        assert one.found[0].p_value <= ALPHA
        assert one.p_value <= ALPHA
