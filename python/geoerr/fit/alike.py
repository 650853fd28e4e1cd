"""Rows that have the same keys."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from geoerr.fit.sightings import Integers, Numbers


def numbers_of_alike(keys: Sequence[npt.NDArray[Any]]) -> Integers:
    """Give every row the number of its group, (n,), in the order of their first rows.

    `keys` are columns of numbers, (n,) or (n, k) each, without NaN.
    """
    rows = pl.DataFrame(np.column_stack(keys)).with_row_index("row")
    alike = rows.group_by(pl.exclude("row"), maintain_order=True).agg("row")["row"]
    group = np.empty(rows.height, dtype=np.int64)
    group[alike.explode().to_numpy()] = np.repeat(np.arange(len(alike)), alike.list.len().to_numpy())
    return group


def scatter_in_groups(values: Numbers, group: Integers) -> tuple[float, int]:
    """Give the sum of squares of what means of groups leave of values (n,), and its degrees of freedom."""
    count = np.bincount(group)
    mean = np.bincount(group, weights=values) / np.maximum(count, 1)
    deviation = values - mean[group]
    return float(deviation @ deviation), int((count[count > 1] - 1).sum())
