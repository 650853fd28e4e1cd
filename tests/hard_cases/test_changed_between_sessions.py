"""A belt that was tensioned, and a third session that tells a change from a temperature."""

from dataclasses import replace

import numpy as np
import polars as pl
from hidden_machine import Motion, Numbers, motion
from test_between_sessions import (
    AFTER,
    CHANGE_RAD,
    PLAN,
    assert_named_with_its_size,
    diagnosed,
    observed,
)


def tensioned(moved: Motion) -> Numbers:
    """The belt of X is tighter from some session on."""
    return np.outer(1e3 * CHANGE_RAD * moved.q[:, 0] * (moved.session >= AFTER), [1.0, 0.0, 0.0])


def test_a_belt_that_was_tensioned_is_named_with_its_size() -> None:
    assert_named_with_its_size(tensioned, "scale-change:x", 1.0)


def test_two_sessions_at_two_temperatures_are_told_apart_by_a_third() -> None:
    """What changed with the machine stays; what followed a temperature is gone when that is as it was.

    Within a session no temperature changes here: where one does, two sessions tell them apart.
    """
    three = motion(np.random.default_rng(11), replace(PLAN, n_sessions=3))
    warm = (three.session == AFTER - 1).astype(np.float64)
    three = replace(three, bed=40.0 + 30.0 * warm, frame=20.0 + 6.0 * warm)
    table = observed(np.outer(1e3 * CHANGE_RAD * three.q[:, 2] * (three.session >= 1), [0.0, 1.0, 0.0]), three)
    two = diagnosed(replace(table, frame=table.frame.filter(pl.col("session") != str(AFTER))))
    assert two.verdict == "ambiguous"
    assert {"squareness-change:yz", "frame-tilt-thermal:yz@temp_bed", "frame-tilt-thermal:yz@temp_frame"} <= {
        str(one.reference) for one in two.tied
    }
    separation = two.found[0].separate_by
    assert separation is not None
    assert "heat what temp_" in str(separation.plan)
    whole = diagnosed(table)
    assert whole.verdict == "missing"
    assert [str(one.reference) for one in whole.found] == ["squareness-change:yz"]
