"""Linear least squares that says which unknowns the data do not determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.identify.linear import Indices, Numbers

# Singular values below this share of the largest are zero; columns are scaled to the same size before.
_RANK_TOLERANCE = 1e-8
# Entries of null vectors (unit length) closer than this are the same.
_NULL_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Solution:
    """The least-squares solution of `design · unknowns = data` for any data.

    Attributes
    ----------
    inverse : (n_unknowns, n_data)
        Pseudo-inverse: unknowns = inverse · data, the smallest where they are not unique.
    null_space : (n_unknowns, n_null)
        What can be added to the unknowns without changing the data.
    range_basis : (n_data, rank)
        Orthonormal basis of what the design can reproduce.
    """

    inverse: Numbers
    null_space: Numbers
    range_basis: Numbers

    @property
    def dof(self) -> int:
        """Number of data that the unknowns leave over."""
        n_data, rank = self.range_basis.shape
        return int(n_data - rank)

    def residual(self, data: Numbers) -> Numbers:
        """Give what of the data (n_data, ...) the design cannot reproduce."""
        return np.asarray(data - self.range_basis @ (self.range_basis.T @ data))

    def is_determined(self, unknown: int) -> bool:
        """Tell whether one unknown is unique."""
        return bool(np.max(np.abs(self.null_space[unknown]), initial=0.0) < _NULL_TOLERANCE)

    def determined_together(self, unknowns: Indices) -> Indices:
        """Give the largest set of these unknowns whose differences are unique, as indices into `unknowns`."""
        null = self.null_space[unknowns]
        distance = np.max(np.abs(null[:, None] - null[None]), axis=2, initial=0.0)
        same = distance < _NULL_TOLERANCE
        return np.flatnonzero(same[np.argmax(same.sum(axis=1))])


def solve(design: Numbers) -> Solution:
    """Solve by singular value decomposition with columns scaled to unit length.

    Parameters
    ----------
    design : (n_data, n_unknowns)
        Rows already divided by the data's standard uncertainty.
    """
    n_data, n_unknowns = design.shape
    if n_data < n_unknowns:
        # Rows of zeros, so that the thin decomposition below still spans all unknowns.
        design = np.vstack([design, np.zeros((n_unknowns - n_data, n_unknowns))])
    length = np.linalg.norm(design, axis=0)
    scale = np.where(length > 0.0, length, 1.0)
    u, s, vt = np.linalg.svd(design / scale, full_matrices=False)
    rank = int((s > _RANK_TOLERANCE * s[0]).sum()) if len(s) and s[0] > 0.0 else 0
    basis = u[:n_data, :rank]
    inverse = (vt[:rank].T / s[:rank]) @ basis.T / scale[:, None]
    null = vt[rank:].T / scale[:, None]
    # Scaling back bends the basis; what counts below is equality of its rows, so its columns are made unit again.
    null = null / np.linalg.norm(null, axis=0)
    return Solution(inverse, null, basis)
