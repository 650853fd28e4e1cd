"""What passes share is split from what rows scatter, with its size, and a drift is told from offsets."""

from pathlib import Path

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.between_passes import BetweenPasses, between_passes
from geoerr.diagnose.space import space_of
from geoerr.fit import FitOptions, fit_terms
from geoerr.machine import read_machine
from geoerr.observations import read_observations


def _split(noise: Noise, seed: int = 3) -> BetweenPasses:
    rng = np.random.default_rng(seed)
    observations = measure(rng, motion(rng, Plan()), noise)
    return between_passes(space_of(fit_terms(machine(), [observations], options=FitOptions(threads=1))))


def test_offsets_are_split_from_scatter() -> None:
    found = _split(Noise(offset=30.0))
    # Three components; 80 offsets each have a standard error of 6 % themselves, and the fit's freedom takes a part.
    assert found.worth_um == pytest.approx(30.0 * np.sqrt(3.0), rel=0.15)
    assert found.rows_um == pytest.approx(np.sqrt(10.0**2 + 10.0**2 + 15.0**2), rel=0.05)
    assert found.stands_out
    assert "offsets of passes, not a drift" in found.words()


def test_nothing_stands_out_where_passes_come_back() -> None:
    found = _split(Noise())
    assert found.worth_um < 0.3 * found.rows_um
    assert not found.stands_out


def test_a_session_on_the_move_is_a_drift() -> None:
    rng = np.random.default_rng(5)
    moved = motion(rng, Plan())
    rising_um = np.outer(200.0 * moved.t / moved.t.max(), [0.0, 0.0, 1.0])
    observations = measure(rng, moved, Noise(), rising_um)
    found = between_passes(space_of(fit_terms(machine(), [observations], options=FitOptions(threads=1))))
    assert found.component == "z"
    assert found.trend_p is not None
    assert found.trend_p < 0.01
    # Of the 50 µm that each session rises the model's own freedom takes a part.
    assert found.trend_um is not None
    assert 25.0 < found.trend_um < 55.0
    assert "rises with time" in found.words()
    assert found.short_words.startswith("a drift over time (")


def test_a_verdict_of_nothing_tells_what_it_counts_as_noise() -> None:
    rng = np.random.default_rng(5)
    moved = motion(rng, Plan())
    offsets = measure(rng, moved, Noise(offset=30.0))
    found = diagnose(fit_terms(machine(), [offsets], options=FitOptions(threads=1)), threads=1)
    assert not found.found
    assert found.between_passes.stands_out
    assert found.sentence.endswith(f"; {found.between_passes.short_words}")
    assert found.between_passes.short_words.startswith("what differs from pass to pass (5")
    steady = measure(rng, moved, Noise())
    quiet = diagnose(fit_terms(machine(), [steady], options=FitOptions(threads=1)), threads=1)
    assert not quiet.found
    assert "counts as noise" not in quiet.sentence


def test_a_slide_drifts_by_more_than_it_has_play(real_data: Path) -> None:
    folder = real_data / "positioning"
    observations = read_observations(folder / "observations.csv")
    fitted = fit_terms(read_machine(folder / "machine.toml"), [observations], options=FitOptions(threads=1))
    found = diagnose(fitted, threads=1)
    # Five cycles, of which the first turns by twice as much as the others: over passes the play has p = 0.017, enough
    # for what the run was made to show. In a search of everything it would not be.
    assert [str(one.reference) for one in found.found] == ["backlash:x"]
    play = found.found[0]
    assert found.between_passes.stands_out
    assert found.between_passes.worth_um > play.worth_um > 10.0
    assert found.between_passes.trend_p is not None
    assert found.between_passes.trend_p < 0.025
