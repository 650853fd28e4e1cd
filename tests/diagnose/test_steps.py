"""What a diagnosis tells of itself while it goes: rounds, and what is tried in them; there it can be ended."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hidden_machine import Motion, Noise, Plan, machine, measure, motion

from geoerr.diagnose import diagnose
from geoerr.diagnose.steps import RoundSteps, Steps
from geoerr.fit import FitOptions, Fitted, fit_terms


def with_play() -> Fitted:
    rng = np.random.default_rng(2)
    moved = motion(rng, Plan(n_sessions=2, n_lines=20, n_points=16))
    observations = measure(rng, moved, Noise(white=(5.0, 5.0, 7.0)), play_um(moved))
    return fit_terms(machine(), [observations], options=FitOptions(threads=1))


def play_um(moved: Motion) -> np.ndarray:
    return -5.0 * moved.d[:, :1] * np.eye(3)[0]


def test_every_step_has_words_and_the_count_goes_on_to_its_end() -> None:
    counts: list[tuple[int, int]] = []
    said: list[str] = []
    diagnosis = diagnose(
        with_play(), progress=lambda done, total: counts.append((done, total)), on_step=said.append, threads=1
    )
    assert [str(one.reference) for one in diagnosis.found] == ["backlash:x"]
    assert [done for done, _ in counts] == list(range(len(counts)))
    assert counts[-1] == (len(said), len(said))
    assert all(total > done for done, total in counts[:-1])
    rounds = [text for text in said if re.match(r"search \d+, round \d+: [\d,]+ candidates and [\d,]+ curves", text)]
    assert len(rounds) >= 2
    assert "beside" not in rounds[0]
    assert rounds[-1].endswith("beside backlash:x")
    assert any("the form of backlash:x" in text for text in said)
    assert said[0] == "the model and the measurements are compared"
    assert any(text.startswith("values, worth and certainty") for text in said[-2:])


class EndError(Exception):
    """Somebody does not want to wait."""


def test_a_diagnosis_ends_at_the_step_that_is_told_to() -> None:
    said: list[str] = []

    def tell(what: str) -> None:
        said.append(what)
        if "round 2" in what:
            raise EndError

    with pytest.raises(EndError):
        diagnose(with_play(), on_step=tell, threads=1)
    assert sum("round 2" in what for what in said) == 1


def test_rounds_are_counted_in_each_search_anew() -> None:
    said: list[str] = []
    rounds = RoundSteps(Steps(on_step=said.append))
    rounds.begin_search()
    rounds.begin_round([], 387, 3312)
    rounds.begin_round(["backlash:x", "scale:y"], 1, 2)
    rounds.begin_search()
    rounds.begin_round([], 1, 2)
    assert said == [
        "search 1, round 1: 387 candidates and 3,312 curves without a name",
        "search 1, round 2: 1 candidate and 2 curves without a name, beside backlash:x and scale:y",
        "search 2, round 1: 1 candidate and 2 curves without a name",
    ]
