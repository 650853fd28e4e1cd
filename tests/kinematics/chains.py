"""The 24 structural codes, and calls of the core that the tests here share."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import numpy.typing as npt

from geoerr import _core

Floats = npt.NDArray[np.float64]

CHAINS = [
    f"w{''.join(order)[:place]}b{''.join(order)[place:]}t" for order in permutations("XYZ") for place in range(4)
]


def columns_of(chain: str, carrier: str, q_mm: Floats, offset_mm: Floats) -> Floats:
    """First-order columns (n, 33, 3) of points that are all fixed alike."""
    carriers = np.full(len(q_mm), _core.CARRIERS.index(carrier), dtype=np.uint8)
    return _core.channel_columns(chain, carriers, q_mm, offset_mm, (0.0, 0.0, 0.0), 1)
