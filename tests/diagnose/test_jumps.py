"""Moments of a jump: which parameters are some, where they are tried, and how sure they are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.candidates import _towards_ends
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.jumps import MOST_GAPS, Gaps, jump_places
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import variable_columns


def _gaps(moments: Numbers) -> Gaps:
    return Gaps(0.5 * (moments[1:] + moments[:-1]), np.diff(moments))


def test_jumps_are_told_from_what_begins_at_a_moment() -> None:
    terms = [
        catalogue()["lost-steps"].term("z", None, machine()),
        catalogue()["step"].term(None, None, machine()),
        catalogue()["warm-up"].term("z", None, machine()),
        catalogue()["camera-drift"].term(None, None, machine()),
    ]
    assert [jump_places(term) for term in terms] == [(0,), (0,), (), ()]


def test_trials_lie_so_close_that_no_jump_between_two_is_unlike_both() -> None:
    """A jump off the mean of its session, as a frame of its own leaves it."""
    for n in (40, 500, 3000):
        rows = np.arange(n)

        def off_mean(moment: float, rows: Numbers = rows) -> Numbers:
            column = (rows > moment).astype(np.float64)
            return column - column.mean()

        middle = rows[:-1] + 0.5
        tried = _towards_ends(middle, 32)
        assert len(tried) <= 32 + 2 * 14
        assert tried[0] == middle[0]
        assert tried[-1] == middle[-1]
        for low, high in pairwise(tried):
            between = off_mean(middle[round(0.5 * (low + high))])
            alike = max(
                float(between @ end / np.linalg.norm(between) / np.linalg.norm(end))
                for end in (off_mean(low), off_mean(high))
            )
            # Between neighbours 1.6 times as far from an end the one between has 1/√1.6 of one's length squared.
            assert alike > 0.77


@pytest.mark.parametrize("size", [0.7, 1.5, 20.0])
def test_the_standard_error_of_a_moment_is_that_of_many_runs(size: float) -> None:
    rng = np.random.default_rng(7)
    # Rows are not evenly apart.
    moments = np.cumsum(rng.uniform(0.5, 2.0, 400))
    gaps = _gaps(moments)
    off, stated = [], []
    for _ in range(300):
        truth = rng.uniform(moments[150], moments[250])
        seen = size * (moments > truth) + rng.standard_normal(len(moments))
        # Of a jump of known size: twice the logarithm of the likelihood of each gap.
        after = np.cumsum((2.0 * size * seen - size**2)[::-1])[::-1][1:]
        found = float(gaps.middle[np.argmax(after)])

        def gains(at: Numbers, after: Numbers = after) -> Numbers:
            return after[np.searchsorted(gaps.middle, at)]

        stated.append(gaps.standard_error(found, gains))
        off.append(found - truth)
    # 300 runs: the root of a mean square is known to 4 % where it is normal, and this has tails.
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=0.15)


def test_a_sure_jump_is_as_unsure_as_its_gap_is_wide() -> None:
    gaps = _gaps(np.array([0.0, 1.0, 4.0, 5.0]))
    assert gaps.standard_error(2.5, lambda at: -1e6 * (at - 2.5) ** 2) == pytest.approx(3.0 / np.sqrt(12.0))
    assert _gaps(np.array([3.0])).standard_error(3.0, lambda at: at) == 0.0


def test_a_jump_that_nothing_tells_may_be_anywhere_and_is_not_sought_row_by_row() -> None:
    gaps, asked = _gaps(np.arange(20_001.0)), []

    def gains(at: Numbers) -> Numbers:
        asked.append(len(at))
        return np.zeros(len(at))

    # Evenly over 20,000 s from its middle.
    assert gaps.standard_error(1e4, gains) == pytest.approx(2e4 / np.sqrt(12.0), rel=0.02)
    assert max(asked) <= MOST_GAPS
    assert np.isnan(gaps.standard_error(1e4, lambda at: np.full(len(at), np.nan)))


def test_gaps_are_tried_one_by_one_where_they_are_few() -> None:
    gaps = _gaps(np.arange(1000.0))
    assert gaps.within(10.0, 12.0) == pytest.approx([10.5, 11.5])
    assert gaps.within(10.2, 10.3) is None
    assert gaps.within(0.0, float(MOST_GAPS + 10)) is None


def test_steps_lost_six_rows_after_a_session_began_are_found() -> None:
    """Trials evenly apart are 45 rows apart, and at the next one less than a quarter of the gain is left."""
    rng = np.random.default_rng(5)
    plan = Plan(n_sessions=3, n_lines=60, n_points=24)
    moved = motion(rng, plan)
    start = int(np.flatnonzero(moved.session == 2)[0])
    hidden = np.zeros((len(moved.q), 3))
    hidden[start + 6 :, 0] = 35.0
    observations = measure(rng, moved, Noise(), hidden, plan)
    fitted = fit_terms(machine(), [observations], options=FitOptions(threads=1))
    (found,) = diagnose(fitted, threads=1).found
    assert str(found.reference) == "lost-steps:x"
    (moment,) = [one for one in found.parameters if one.name == "t0"]
    clock = variable_columns(fitted.sightings, ["clock"])[0]
    truth = 0.5 * (clock[start + 5] + clock[start + 6])
    assert abs(moment.value - truth) < 4.0 * moment.std
    # Rows are 3 s apart, and a jump of 3.5 standard deviations is sure to a row or two.
    assert moment.std < 6.0


def test_the_moment_of_an_added_jump_is_as_unsure_as_the_rows_around_it_leave_it() -> None:
    """Its derivative is 0, and would say that it is sure."""
    rng = np.random.default_rng(6)
    plan = Plan(n_sessions=2, n_lines=20, n_points=24)
    moved = motion(rng, plan)
    for size_um, least, most in ((60.0, 0.86, 1.0), (15.0, 2.0, 60.0)):
        hidden = np.zeros((len(moved.q), 3))
        hidden[700:, 0] = size_um
        observations = measure(rng, moved, Noise(), hidden, plan)
        fitted = fit_terms(
            machine(),
            [observations],
            options=FitOptions(threads=1),
            effects=[catalogue()["lost-steps"].term("x", None, machine())],
        )
        (moment,) = fitted.terms[-1].inner
        clock = variable_columns(fitted.sightings, ["clock"])[0]
        # Rows are 3 s apart: 3 over the root of 12 is 0.87, and six standard deviations are sure to a row.
        assert least < moment.std < most
        assert abs(moment.value - 0.5 * (clock[699] + clock[700])) < 4.0 * moment.std
        place = fitted.compiled.n_coefficients
        assert fitted.covariance[place, place] == pytest.approx(moment.std**2)
