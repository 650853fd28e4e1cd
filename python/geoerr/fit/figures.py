"""Error figures (`docs/theory/model.md`): residual = measured − predicted, base axes, µm.

`rmse_um` is the root of the sum over the components of each component's mean square, over the rows that measured it:
the length in 3-D where all three were. Radii are reported apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

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
        Rows.
    """

    rmse_um: float | None
    rms_per_component_um: tuple[float | None, float | None, float | None]
    n_components: tuple[int, int, int]
    radial_rms_um: float | None
    n_radial: int
    n: int

    @property
    def headline_um(self) -> float | None:
        """The positions' figure, or the radii's where there are no positions."""
        return self.rmse_um if self.rmse_um is not None else self.radial_rms_um

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
        return document


def figures_of(sightings: Sightings, residual_base_mm: Numbers, used: np.ndarray | None = None) -> ErrorFigures:
    """Summarize residuals (n, 3) in base axes over the used rows."""
    # Parts of the data are asked for by the thousand: each takes its own rows only.
    rows = np.arange(len(sightings)) if used is None else np.flatnonzero(used)
    is_circle = np.array([kind == "circle" for kind in sightings.frames])[sightings.session[rows]]
    residual_mm = residual_base_mm[rows]
    seen = sightings.is_measured[rows] & ~is_circle[:, None]
    squares = np.where(seen, residual_mm, 0.0) ** 2
    n_components = seen.sum(axis=0)
    means = squares.sum(axis=0) / np.maximum(n_components, 1)
    total = math.sqrt(float(means.sum())) * _UM_PER_MM if n_components.any() else None
    each = [math.sqrt(float(m)) * _UM_PER_MM if n else None for m, n in zip(means, n_components, strict=True)]
    radial = residual_mm[is_circle, 0]
    return ErrorFigures(
        rmse_um=total,
        rms_per_component_um=(each[0], each[1], each[2]),
        n_components=(int(n_components[0]), int(n_components[1]), int(n_components[2])),
        radial_rms_um=float(np.sqrt(np.mean(radial**2))) * _UM_PER_MM if radial.size else None,
        n_radial=int(radial.size),
        n=len(rows),
    )
