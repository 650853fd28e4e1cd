"""What has faded at every row is no candidate, and what is left of others is looked for where the rows show it."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.diagnose.candidates import candidates_of
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.effects.values import value_words
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.machine import Machine
from geoerr.observations import observations_from_columns
from geoerr.terms import Parameter

SPIKE = Catalogue({"reversal-spike": catalogue()["reversal-spike"]})


def fitted(seconds_apart: float) -> Fitted:
    """There and back along X four times, with rows so far apart in time: the first after a reversal, too."""
    way = np.linspace(0.0, 380.0, 20)
    x = np.concatenate([way if number % 2 == 0 else way[::-1] for number in range(8)])
    rng = np.random.default_rng(3)
    observations = observations_from_columns(
        {
            "line": ["x"] * len(x),
            "repeat": np.arange(len(x)) // 20,
            "x": x,
            "y": np.zeros(len(x)),
            "z": np.zeros(len(x)),
            "mx": x + 0.003 * rng.standard_normal(len(x)),
            "my": 0.003 * rng.standard_normal(len(x)),
            "mz": 0.003 * rng.standard_normal(len(x)),
            "t": seconds_apart * np.arange(len(x)),
        }
    )
    machine = Machine.from_chain("wbXYZt", (400.0, 400.0, 300.0))
    return fit_terms(machine, [observations], options=FitOptions(threads=1))


def test_a_decay_that_no_row_shows_is_not_offered() -> None:
    candidates, not_offered, _ = candidates_of(fitted(60.0), SPIKE)
    assert not candidates
    assert dict(not_offered)["reversal-spike"].startswith("wanting: rows sooner after a reversal")


def test_a_decay_is_looked_for_where_rows_show_it() -> None:
    (candidate, *_), not_offered, functions = candidates_of(fitted(2.0), SPIKE)
    assert "reversal-spike" not in dict(not_offered)
    (shapes,) = candidate.shapes
    assert shapes.term is not None
    for codes in shapes.codes:
        assert np.abs(functions.values(codes)).max() > 0.04
    (tau,) = shapes.term.inner
    # Three time constants before the first row after a reversal.
    assert tau.low == pytest.approx(2.0 / 3.0, rel=0.02)
    assert tau.high == 5.0


def test_a_decay_that_rows_show_keeps_its_range() -> None:
    (candidate, *_), _, _ = candidates_of(fitted(0.01), SPIKE)
    assert candidate.shapes[0].term is not None
    assert candidate.shapes[0].term.inner[0].low == 0.005


def test_no_value_is_written_with_thirty_digits() -> None:
    words = value_words(Parameter("A", "mm", value=9.545e27, std=1.04e27))
    assert words == "A = 9.5e+30 ± 1e+30 µm"
