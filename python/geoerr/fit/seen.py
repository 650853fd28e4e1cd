"""What a fit sees of functions on a channel, beyond all that it does itself.

| symbol | code | what |
|---|---|---|
| D | `direction` | whitened displacement of each row by one unit along the channel |
| S | `spread` | orthonormal columns of the fit: its hat matrix is S Sᵀ |
| r | `residual` | what the fit leaves, whitened, in standard deviations |
"""

from __future__ import annotations

import math

import numpy as np

from geoerr.fit.fitted import Fitted
from geoerr.fit.inner import directions
from geoerr.fit.sightings import Numbers
from geoerr.terms import EMPIRICAL, Parameter, Part, Term


class Seen:
    """A channel as a fit sees it.

    Attributes
    ----------
    fitted
        The fit.
    used : (n,)
        Rows that count.
    direction, residual : (n, 3)
        See above.
    """

    def __init__(self, fitted: Fitted, channel: str) -> None:
        solved = fitted.solved
        unit = Term(EMPIRICAL, "", "empirical", None, None, None, (Part(channel, "u"),), (Parameter("u", "mm"),))
        self.fitted, self.used = fitted, solved.used
        self.direction = directions(fitted, unit, solved.used.astype(np.float64), fitted.threads)[0]
        spread = fitted.problem.times(
            solved.design_state, solved.solution.covariance_root, solved.used.astype(np.float64), fitted.threads
        )
        self._spread = spread.reshape(-1, spread.shape[2])
        self.residual = solved.whitened * solved.used[:, None] / fitted.unit
        self._n_numbers = int(fitted.sightings.is_measured[solved.used].sum())

    def off(self, functions: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Give what functions (k, n) do beyond the fit: sizes before it, Gram matrix, share of the residual."""
        raw = np.einsum("nc,kn->nck", self.direction, functions).reshape(-1, len(functions))
        size = np.sqrt(np.einsum("nk,nk->k", raw, raw))
        beyond = raw - self._spread @ (self._spread.T @ raw)
        beyond -= self._spread @ (self._spread.T @ beyond)
        return size, beyond.T @ beyond, beyond.T @ self.residual.reshape(-1)

    def evidence(self, gram: Numbers, along: Numbers, n_inner: int = 0, n_trials: int = 1) -> float:
        """Give Schwarz's evidence for functions against the fit without them; each trial is as likely as another."""
        gain = float(along @ np.linalg.solve(gram, along))
        n_free = len(along) + n_inner
        return 0.5 * gain - 0.5 * n_free * math.log(max(self._n_numbers, 2)) - math.log(n_trials)
