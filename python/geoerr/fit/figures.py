"""Error figures (`docs/theory/model.md`): residual = measured − predicted, base axes, µm.

`rmse_um` is the root of the sum over the components of each component's mean square, over the rows that measured it:
the length in 3-D where all three were. Radii and lengths are reported apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geoerr.fit.lengths import is_told
from geoerr.fit.sightings import Numbers, Sightings

_UM_PER_MM = 1e3


@dataclass(frozen=True)
class ErrorFigures:
    """How large residuals are.

    Attributes
    ----------
    rmse_um
        None where no position was measured.
    rms_per_component_um
        x, y, z; None where never measured.
    n_components
        How many numbers were measured in x, y, z.
    radial_rms_um, n_radial
        Of circular tests.
    n
        Rows; a length is one.
    length_rms_um, n_lengths
        Of lengths.
    """

    rmse_um: float | None
    rms_per_component_um: tuple[float | None, float | None, float | None]
    n_components: tuple[int, int, int]
    radial_rms_um: float | None
    n_radial: int
    n: int
    length_rms_um: float | None = None
    n_lengths: int = 0

    @property
    def headline_um(self) -> float | None:
        """The positions' figure; where there are none the radii's, and where there are none of these the lengths'."""
        of_kinds = (self.rmse_um, self.radial_rms_um, self.length_rms_um)
        return next((one for one in of_kinds if one is not None), None)

    def to_document(self) -> dict[str, object]:
        """Give plain values for `--json`."""
        document: dict[str, object] = {
            "rmse_um": self.headline_um,
            "rms_per_component_um": list(self.rms_per_component_um),
            "n_components": list(self.n_components),
            "n": self.n,
        }
        if self.n_radial:
            document |= {"radial_rms_um": self.radial_rms_um, "n_radial": self.n_radial}
        if self.n_lengths:
            document |= {"length_rms_um": self.length_rms_um, "n_lengths": self.n_lengths}
        return document


def figures_of(sightings: Sightings, residual_base_mm: Numbers, used: np.ndarray | None = None) -> ErrorFigures:
    """Summarize residuals (n, 3) in base axes, of whole lengths, over the used rows."""
    # Parts of the data are asked for by the thousand: each takes its own rows only.
    rows = np.arange(len(sightings)) if used is None else np.flatnonzero(used)
    is_circle, of_lengths = (sightings.of_kind(kind, rows=rows) for kind in ("circle", "lengths"))
    residual_mm = residual_base_mm[rows]
    is_measured = is_told(sightings)[rows]
    seen = is_measured & ~(is_circle | of_lengths)[:, None]
    squares = np.where(seen, residual_mm, 0.0) ** 2
    n_components = seen.sum(axis=0)
    means = squares.sum(axis=0) / np.maximum(n_components, 1)
    total = math.sqrt(float(means.sum())) * _UM_PER_MM if n_components.any() else None
    each = [math.sqrt(float(m)) * _UM_PER_MM if n else None for m, n in zip(means, n_components, strict=True)]
    radial, lengths = residual_mm[is_circle, 0], residual_mm[of_lengths & is_measured[:, 0], 0]
    return ErrorFigures(
        rmse_um=total,
        rms_per_component_um=(each[0], each[1], each[2]),
        n_components=(int(n_components[0]), int(n_components[1]), int(n_components[2])),
        radial_rms_um=float(np.sqrt(np.mean(radial**2))) * _UM_PER_MM if radial.size else None,
        n_radial=int(radial.size),
        length_rms_um=float(np.sqrt(np.mean(lengths**2))) * _UM_PER_MM if lengths.size else None,
        n_lengths=int(lengths.size),
        n=len(rows) - int(of_lengths.sum()) + int(lengths.size),
    )
