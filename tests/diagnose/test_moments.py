"""Moments on the clock of all sessions, told on the session's own."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

import geoerr
from geoerr.cli.fit_text import effect_rows
from geoerr.diagnose.answer import with_terms
from geoerr.diagnose.moments import moment_of, moments_of, span_words
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.search import search
from geoerr.diagnose.told import diagnosis_of
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.fit import FitOptions, sightings_of
from geoerr.fit.sightings import Sightings
from geoerr.observations import Observations, observations_from_columns


def seen(**columns: object) -> Sightings:
    place = {name: np.arange(6.0) for name in ("x", "y", "z", "mx", "my", "mz")}
    return sightings_of(observations_from_columns({**place, **columns}))


TWO = ["cold"] * 3 + ["hot"] * 3
TIMES = [0.0, 10.0, 20.0, 100.0, 110.0, 130.0]


@pytest.mark.parametrize(
    ("clock", "session", "t", "between"),
    [
        (5.0, "cold", 5.0, (0.0, 10.0)),
        # The second session begins where the first ended, at 20 on the clock: its own 100.
        (21.0, "hot", 101.0, (100.0, 110.0)),
        (45.0, "hot", 125.0, (110.0, 130.0)),
        # Beyond the data the last rows are the nearest.
        (70.0, "hot", 150.0, (110.0, 130.0)),
    ],
)
def test_the_clock_is_taken_apart_into_sessions(
    clock: float, session: str, t: float, between: tuple[float, float]
) -> None:
    moment = moment_of(clock, seen(session=TWO, t=TIMES))
    assert (moment.session, moment.t, moment.between, moment.unit) == (session, t, between, "s")
    assert moment.words() == f"session {session}, between t = {between[0]:g} and {between[1]:g} s"


def test_one_session_needs_no_name_and_rows_are_counted_where_there_is_no_time() -> None:
    assert moment_of(5.0, seen(t=TIMES)).words() == "between t = 0 and 10 s"
    moment = moment_of(3.5, seen(session=TWO))
    # Two rows later than the first of the second session: its rows 2 and 3.
    assert (moment.session, moment.t, moment.unit) == ("hot", 1.5, "rows")
    assert moment.words() == "session hot, between its rows 2 and 3"


def test_spans_of_rows_name_their_sessions() -> None:
    two = seen(session=TWO, t=TIMES)
    assert span_words(3, 5, two) == "session hot, t 100 to 130"
    assert span_words(1, 4, two) == "session cold, t 10, to session hot, t 110"
    assert span_words(1, 4, seen(t=TIMES)) == "t 10 to 110"


def test_only_what_is_taken_from_the_clock_is_a_moment() -> None:
    jump = catalogue()["step"].term(None, None, machine())
    warm = catalogue()["warm-up"].term("z", None, machine())
    values = [jump.with_values([0.0] * len(jump.coefficients), [21.0]), warm.with_values([0.0], [21.0])]
    assert [list(moments_of(term, seen(session=TWO, t=TIMES))) for term in values] == [["t0"], []]


def jumped() -> tuple[Observations, float, float]:
    """Two sessions, each with its own time; in the second everything jumps between two rows."""
    rng = np.random.default_rng(11)
    moved = motion(rng, Plan(n_sessions=2, n_lines=20, n_points=10))
    row = int(np.flatnonzero(moved.session == 1)[87])
    moved.t -= np.where(moved.session == 1, moved.t[moved.session == 1][0] - 50.0, 0.0)
    hidden = np.zeros_like(moved.q)
    hidden[row:] = (60.0, -40.0, 30.0)
    return measure(rng, moved, Noise(white=(5.0, 5.0, 7.0)), hidden), float(moved.t[row - 1]), float(moved.t[row])


def test_a_jump_that_is_found_is_told_on_the_time_of_its_session() -> None:
    observations, before, after = jumped()
    fitted = geoerr.fit_model(machine(), observations, options=FitOptions(threads=1)).fitted
    known = Catalogue({name: catalogue()[name] for name in ("step", "backlash")})
    found = diagnosis_of(fitted, search(fitted, Offers(known), threads=1), known).found[0]
    assert str(found.reference) == "step"
    words = f"session 1, between t = {before:g} and {after:g} s"
    assert words in found.value_words[-1]
    document = found.to_document()["parameters"]["t0"]
    assert document["session"] == "1"
    assert document["session_between"] == [before, after]
    # The model's own t0 stays on the clock of all sessions: the second begins at the first one's end.
    assert document["value"] == found.parameters[-1].value
    assert document["value"] == pytest.approx(document["session_t"] - 50.0 + 199.0 * 3.0)
    refitted = with_terms(fitted, [found.term])
    assert any(words in line for line in effect_rows(refitted))
