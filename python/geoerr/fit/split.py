"""The residual in parts: noise, and what the model does not hold."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geoerr.distributions import chi_squared_sf, f_sf, never_zero
from geoerr.fit.alike import scatter_in_groups
from geoerr.fit.figures import figures_of
from geoerr.fit.lengths import is_told, of_the_headline, of_whole_lengths
from geoerr.fit.noise import Repeats, where
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.solve import Solved


@dataclass(frozen=True)
class Split:
    """The residual in parts.

    Attributes
    ----------
    noise_um
        What repeats (or, without them, the stated covariances) say the noise is, summed over components.
    is_from_repeats
        Which of the two.
    lack_of_fit_um
        Root of what the residual has beyond it; 0 where it has none.
    lack_of_fit_p
        Probability of so much by chance, for independent noise; None where nothing tells the noise.
    dof
        Degrees of freedom of the residual, and of the repeats in it.
    noise_ss
        Sum of squares of the repeats about their means, whitened; 0 without repeats.
    """

    noise_um: float | None
    is_from_repeats: bool
    lack_of_fit_um: float | None
    lack_of_fit_p: float | None
    dof: tuple[float, int]
    noise_ss: float = 0.0


def split_of(sightings: Sightings, solved: Solved, residual_mm: Numbers, repeats: Repeats, dof: float) -> Split:
    """Part the residual into noise and lack of fit: by repeats where there are, else by the stated covariances."""
    used = solved.used
    whitened = solved.whitened[used]
    total = float((whitened**2).sum())
    figures = figures_of(sightings, residual_mm, used)
    size = figures.headline_um
    told = is_told(sightings)[used]
    each = of_whole_lengths(sightings, solved.whitened, size=math.sqrt(2.0))[used]
    noise_ss, noise_dof = _scatter_in_groups(each, repeats.group[used], told)
    if noise_dof >= 1 and dof > noise_dof:
        lack_dof = dof - noise_dof
        ratio = ((total - noise_ss) / lack_dof) / (noise_ss / noise_dof) if noise_ss > 0.0 else math.inf
        p_value = never_zero(float(f_sf(max(ratio, 0.0), lack_dof, noise_dof)))
        noise = repeats.floor_um
    elif sightings.is_stated and dof > 0:
        p_value = never_zero(float(chi_squared_sf(total, dof)))
        variances, counts = sightings.once("variances", _variances_mm2)
        count = np.maximum(counts[used].sum(axis=0), 1)
        noise = math.sqrt(float((variances[used].sum(axis=0) / count).sum())) * 1e3
        noise_dof = 0
    else:
        return Split(None, False, None, None, (dof, 0))
    lack = None
    if size is not None and noise is not None:
        # The residual of a right model is smaller than the noise by the parameters that it was fitted with.
        n_numbers = int(told.sum())
        lack = math.sqrt(max(size**2 * n_numbers / max(dof, 1) - noise**2, 0.0))
    return Split(noise, noise_dof > 0, lack, p_value, (dof, noise_dof), noise_ss if noise_dof > 0 else 0.0)


def _variances_mm2(sightings: Sightings) -> tuple[Numbers, np.ndarray]:
    """Give the stated variance of each number (n, 3), and which of them are beside the figure of the residual."""
    counts = of_the_headline(sightings)
    variances = of_whole_lengths(sightings, (sightings.unwhitening**2).sum(axis=2))
    return np.where(counts, variances, 0.0), counts


def _scatter_in_groups(values: Numbers, group: np.ndarray, seen: np.ndarray) -> tuple[float, int]:
    total, dof = 0.0, 0
    for component in range(3):
        rows = where(seen[:, component])
        squares, n_free = scatter_in_groups(values[rows, component], group[rows])
        total += squares
        dof += n_free
    return total, dof
