"""A share of what is explained is a cosine: 1 at most, whatever rounding leaves."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from geoerr.diagnose.search.settle import explained_share


def test_what_explains_the_same_is_alike_to_1_and_no_more() -> None:
    """Columns that a displacement is made of explain all of it: of some, rounding leaves 1.0000000000000002."""
    rng = np.random.default_rng(5)
    raw = 0.0
    for _ in range(200):
        column = rng.normal(size=(90, 1))
        unit = column / np.linalg.norm(column)
        settled: Any = SimpleNamespace(displacement=column[:, 0].reshape(30, 3))
        columns: Any = SimpleNamespace(root=np.eye(1), whitened=unit)
        flat = settled.displacement.reshape(-1)
        raw = max(raw, float(np.linalg.norm(unit.T @ flat) / np.linalg.norm(flat)))
        assert explained_share(settled, columns) <= 1.0
    assert raw > 1.0
