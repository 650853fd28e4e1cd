"""Rows that lack what a model needs are told by the columns of which nothing is known there."""

import numpy as np
import pytest

from geoerr.fit.variables import why_lacking

NAMES = ("x", "temp_bed", "temp_frame", "d_x")
EMPTY = np.nan


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([(1.0, EMPTY, 20.0, 1.0), (2.0, 30.0, 20.0, 1.0)], "nothing is known of temp_bed"),
        ([(1.0, EMPTY, 20.0, 1.0), (2.0, 30.0, 20.0, EMPTY)], "nothing is known of temp_bed and d_x"),
        ([(1.0, EMPTY, EMPTY, EMPTY)], "nothing is known of temp_bed, temp_frame and d_x"),
    ],
)
def test_columns_are_named(rows: list[tuple[float, ...]], said: str) -> None:
    variables = np.array(rows).T
    assert why_lacking(NAMES, variables, np.isfinite(variables).all(axis=0)) == said


def test_what_a_row_may_lack_is_not_named() -> None:
    """Before any travel a wind-up needs none: that row takes part, and says nothing of another that does not."""
    variables = np.array([(1.0, 30.0, 20.0, EMPTY), (2.0, EMPTY, 20.0, 1.0)]).T
    assert why_lacking(NAMES, variables, np.array([True, False])) == "nothing is known of temp_bed"
