"""Bases that data could choose among: elements and splines of growing number, spread like the positions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from geoerr.bases.knots import places_for_knots, spline_over
from geoerr.errors import ShapeError
from geoerr.terms import BasisKind, BasisSpec

Numbers = npt.NDArray[np.float64]

ELEMENTS: tuple[BasisKind, ...] = ("linear", "quadratic")
_CUBIC = 3


def candidate_bases(
    axis: str,
    position_mm: npt.ArrayLike,
    *,
    kinds: Sequence[BasisKind] = ELEMENTS,
    most_functions: int = 16,
) -> tuple[BasisSpec, ...]:
    """Give bases of growing size over the range of some positions, the smaller ones first.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    position_mm : (n,)
        Where the axis was measured, in any order, repeats allowed.
    kinds
        `linear` (1, 2, ... two-node elements), `quadratic` (1, 2, ... three-node elements), `bspline` (cubic, 0, 1,
        ... inner knots), `polynomial` (degree 0, 1, ...). Element ends lie at the quantiles of the distinct
        positions, the middle nodes of three-node elements in the middle, and knots are spread like the positions,
        where they lie side by side like every so manieth.
    most_functions
        No basis has more functions than this, nor than there are distinct positions.

    Raises
    ------
    ShapeError
        for fewer than two distinct positions, or a kind that has no sizes to choose.
    """
    distinct = np.unique(np.asarray(position_mm, dtype=np.float64))
    if distinct.ndim != 1 or len(distinct) < 2 or not np.isfinite(distinct).all():
        raise ShapeError("a basis needs at least two distinct, finite positions")
    most = min(most_functions, len(distinct))
    found = [spec for kind in kinds for spec in _of_kind(kind, axis, distinct, most)]
    return tuple(sorted(found, key=lambda spec: spec.n_functions))


def _of_kind(kind: BasisKind, axis: str, distinct: Numbers, most: int) -> Iterable[BasisSpec]:
    low, high = float(distinct[0]), float(distinct[-1])
    match kind:
        case "linear":
            for n_elements in range(1, most):
                yield BasisSpec("linear", axis, knots_mm=_quantiles(distinct, n_elements))
        case "quadratic":
            for n_elements in range(1, (most - 1) // 2 + 1):
                ends = np.array(_quantiles(distinct, n_elements))
                nodes = np.sort(np.concatenate((ends, 0.5 * (ends[:-1] + ends[1:]))))
                yield BasisSpec("quadratic", axis, knots_mm=tuple(nodes.tolist()))
        case "bspline":
            places = places_for_knots(distinct, most)
            for n_functions in range(_CUBIC + 1, min(most, len(places)) + 1):
                yield spline_over(axis, places, n_functions)
        case "polynomial":
            for degree in range(most):
                yield BasisSpec("polynomial", axis, degree=degree, low_mm=low, high_mm=high)
        case _:
            raise ShapeError(f"a {kind} basis has no sizes to choose among")


def _quantiles(distinct: Numbers, n_cells: int) -> tuple[float, ...]:
    quantiles: Numbers = np.quantile(distinct, np.linspace(0.0, 1.0, n_cells + 1))
    return tuple(quantiles.tolist())


def in_words(spec: BasisSpec) -> str:
    """Say what a basis is: `3 three-node quadratic elements`."""
    cells = len(spec.knots_mm) - 1
    match spec.kind:
        case "linear":
            text = _counted(cells, "two-node linear element")
        case "quadratic":
            text = _counted(cells // 2, "three-node quadratic element")
        case "bspline":
            text = f"spline of degree {spec.degree} with {_counted(cells - 1, 'inner knot')}"
        case "polynomial":
            text = f"polynomial of degree {spec.degree}"
        case _:
            text = f"{_counted(spec.order or 0, 'wave')} of {spec.period_mm} mm and a constant"
    return f"integral of {text}" if spec.is_tangent_integral else text


def _counted(number: int, name: str) -> str:
    return f"{number} {name}" if number == 1 else f"{number} {name}s"
