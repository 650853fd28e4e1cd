"""What a plan was made to show is asked for by itself: the p-value of all knows of it, too."""

import numpy as np
import pytest
from scipy import stats
from validation.laser_run import MACHINE, laser_run

from geoerr.diagnose import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.errors import GeoerrError
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


def test_what_was_asked_is_told_with_what_its_probability_is_made_of() -> None:
    """The p-value of a play was told, and of what it is made nowhere: a search of noise gave another."""
    asked = [(found, one) for found in map(diagnosed, range(14)) for one in found.asked_for if one.gain > 0.0]
    assert asked
    for found, one in asked:
        left = one.n_passes - 1 - one.rank
        ratio = np.expm1(one.gain / one.n_passes) * left / one.rank
        by_rows, by_passes = -stats.chi2.logsf(one.gain, one.rank), -stats.f.logsf(ratio, one.rank, left)
        assert one.surprise == pytest.approx(min(by_rows, by_passes) - np.log(one.n_trials), rel=1e-6)
        p_asked = min(one.n_questions * np.exp(-one.surprise), 1.0)
        assert one.p_value == pytest.approx(p_asked, rel=1e-9)
        p_searched = found.searched.first.p_searched
        assert found.p_value == pytest.approx(1.0 - (1.0 - min(p_asked, p_searched)) ** 2, rel=1e-6)
        (document,) = found.to_document()["asked_for"]
        assert document["p_value"] == one.p_value
        # What is named has its own; what is not has a line of its own.
        told = {named.reference for named in (*found.found, *found.not_told_apart)}
        assert bool(found.asked_words) == (one.reference not in told)


def test_what_is_alike_is_compared_again() -> None:
    """The correlation is of what was found as the look saw it, not as it is beside all that was found later."""
    found = next(one for one in map(diagnosed, range(14)) if one.found and one.found[0].aliases)
    first = found.found[0]
    for alias in first.aliases:
        explained, could = found.compared(str(first.reference), str(alias.reference))
        cosines = [np.linalg.norm(columns.T @ explained) / np.linalg.norm(explained) for columns in could]
        assert max(cosines) == pytest.approx(alias.correlation, rel=1e-9)
    with pytest.raises(GeoerrError, match="straightness:x was not found\nhint: backlash"):
        found.compared("straightness:x", "backlash:x")
    with pytest.raises(GeoerrError, match="is none of what came next to"):
        found.compared(str(first.reference), "backlash:q")
