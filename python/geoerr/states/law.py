r"""Functions that do not follow temperature by the law of the shapes: named one by one, and what that costs.

What a state shows beyond the model, d_s = θ_s − θ(T_s), has the covariance δ_st V_s − A_s C A_tᵀ, C that of the
model's coefficients and A_s how they move the state's parameters. Of one function all states' values together are
tested by χ² (`chance.tail`), corrected for looking at all functions (Holm). The one that stands out most is given a
variance of its own,

    M = Σ_s d_s d_sᵀ / (n − q),      q = 1 + number of powers of T that it has,

by which each state, and each temperature that was not measured, may be off beside the law (a random effect of
states; DerSimonian and Laird, Controlled Clinical Trials 7 (1986)), and everything is found anew: what only leaked
into other functions is gone then. One factor for all functions (Birge's) would make good ones worse, and be far too
small for the one that is wrong.

Verified: tests/states/test_law.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import linalg

from geoerr.fit.sightings import Numbers
from geoerr.states.chance import Test, tail
from geoerr.states.evidence import Space
from geoerr.states.functions import Estimate, Functions

# Directions of values over all states with less variance than this share of the largest have none.
_RANK = 1e-6
# How much of the size of a misfit may have another shape than is seen.
_BLUR = 0.1


def beyond_the_law(space: Space, estimates: Sequence[Estimate], moves: Sequence[Numbers], found: Numbers) -> Numbers:
    """Give what states show beyond the model, (n_states, m).

    Parameters
    ----------
    moves : (m, r + k) of each state
        A_s.
    found : (r + k,)
        The coefficients.
    """
    return np.array(
        [space.out @ space.into(one.parameters) - by @ found for one, by in zip(estimates, moves, strict=True)]
    )


def tests_by_function(
    functions: Functions,
    estimates: Sequence[Estimate],
    moves: Sequence[Numbers],
    covariance: Numbers,
    left: Numbers,
) -> dict[str, Test]:
    """Test each function's misfit in all states together; `left` is what `beyond_the_law` gave."""
    dof = min(estimate.dof for estimate in estimates)
    tests = {}
    for name, rows in functions.rows.items():
        value = (left @ rows.T).ravel()
        moved = np.concatenate([rows @ by for by in moves])
        own = linalg.block_diag(*(rows @ estimate.covariance @ rows.T for estimate in estimates))
        left_over = own - moved @ covariance @ moved.T
        std = np.sqrt(np.maximum(np.diag(own), 0.0))
        known = std > _RANK * std.max(initial=0.0)
        scaled = left_over[np.ix_(known, known)] / np.outer(std[known], std[known])
        size, vector = np.linalg.eigh(scaled)
        kept = size > _RANK * max(float(size[-1]), 1.0) if len(size) else np.zeros(0, dtype=bool)
        along = vector[:, kept].T @ (value[known] / std[known])
        tests[name] = tail(float((along**2 / size[kept]).sum()), int(kept.sum()), dof)
    return tests


def own_variance(functions: Functions, space: Space, powers: Mapping[str, int], left: Numbers) -> Numbers:
    """Give the variance M (m, m) of functions that break the law.

    Parameters
    ----------
    powers
        Name of each to the number of powers of T that it has in the model.
    """
    total = np.zeros((left.shape[1], left.shape[1]))
    for name, n_powers in powers.items():
        rows = functions.rows[name]
        own = np.flatnonzero(np.abs(rows).max(axis=0) > 0.0)
        values = left @ rows.T
        freedom = max(len(left) - 1 - n_powers, 1)
        # What shape it has is known to a share of its size only.
        blurred = _BLUR * np.sqrt((values**2).sum() / values.shape[1]) * np.eye(values.shape[1])
        # Parameters of this function alone, of those that the states' gauge leaves free.
        others = np.setdiff1d(np.arange(left.shape[1]), own)
        free = space.out @ linalg.null_space(space.directions[others], rcond=_RANK)
        seen = free @ np.linalg.pinv(rows @ free, rcond=_RANK) @ np.column_stack([values.T, blurred])
        total += seen @ seen.T / freedom
    return total
