"""The normal distribution on arrays, quick and good to 1e-7: what an edge looks like through a Gaussian blur."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
import numpy.typing as npt

Real = TypeVar("Real", np.float32, np.float64)


def normal_distribution(z: npt.NDArray[Real]) -> tuple[npt.NDArray[Real], npt.NDArray[Real]]:
    """Give Φ(z) and φ(z) from one exponential (Abramowitz & Stegun 7.1.26, |error| < 1e-7), in z's precision."""
    exponential = np.exp(-0.5 * z * z)
    k = 1.0 / (1.0 + 0.3275911 / math.sqrt(2.0) * np.abs(z))
    poly = k * (0.254829592 + k * (-0.284496736 + k * (1.421413741 + k * (-1.453152027 + k * 1.061405429))))
    tail = 0.5 * poly * exponential
    return np.where(z > 0.0, 1.0 - tail, tail), exponential * (1.0 / math.sqrt(2.0 * math.pi))
