"""Temperatures that hardly change: what they are multiplied with hides in a model, all but little.

A machine at 120 ± 3 °C has grown by 100 K times its coefficient, and of that a model with a scale has all but 3 K. As
α T q the growth lies in the model but for a thousandth of its square, and of what a model leaves so little nothing is
said: as little of anything is left by functions that are not fine enough. As α (T − T̄) q it spans the same beside the
model, and is judged by what can be seen of it. So where all of these hold:

- it hardly changes (`is_steady`);
- it is a straight line in the temperature;
- the model owns what the mean does (`are_owned`), at ends and middles of its inner parameters (`ends_and_middle`).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoerr.terms import Parameter

# What follows a temperature is judged about its mean where its variance is a smaller share of its mean square, both
# above what it is told from: a tenth of what follows it is as much as nothing is said of. One that rises evenly from
# there has a quarter.
_STEADY = 0.02


def is_steady(changes: npt.ArrayLike, whole: npt.ArrayLike) -> np.ndarray:
    """Tell whether what follows a temperature hardly changes: by its squares about the mean, and of all of it."""
    return np.asarray(np.asarray(changes) < _STEADY * np.asarray(whole))


def ends_and_middle(parameter: Parameter) -> list[float]:
    """Give the values of an inner parameter at which a model is asked for what a term does at a mean."""
    if parameter.low is None or parameter.high is None or parameter.is_fixed or not np.isnan(parameter.value):
        return [parameter.middle]
    return [parameter.low, parameter.middle, parameter.high]
