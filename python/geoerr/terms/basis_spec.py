"""Functions of one axis position as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from geoerr.machine import AXES
from geoerr.terms.entries import MAX_DEGREE, MAX_ITEMS, Entries, checked, is_finite, is_whole, require

BasisKind = Literal["bspline", "polynomial", "fourier", "linear", "quadratic"]

_BASIS_FIELDS: Mapping[str, tuple[str, ...]] = {
    "bspline": ("knots_mm", "degree"),
    "polynomial": ("low_mm", "high_mm", "degree"),
    "fourier": ("low_mm", "high_mm", "period_mm", "order"),
    "linear": ("knots_mm",),
    "quadratic": ("knots_mm",),
}


@dataclass(frozen=True)
class BasisSpec:
    """A smooth function of one axis position as data; the core evaluates it.

    Attributes
    ----------
    kind
        `bspline` (breakpoints `knots_mm`, `degree`), `polynomial` (`low_mm`, `high_mm`, `degree`),
        `fourier` (`low_mm`, `high_mm`, `period_mm`, `order`), or 1-D elements `linear`, `quadratic` (their nodes in
        `knots_mm`).
    axis
        `x`, `y`, `z`: the position that it is a function of.
    knots_mm
        Breakpoints from the low to the high end (each once), or nodes of elements.
    is_tangent_integral
        Whether each function is replaced by its integral less its least-squares line: straightness from angles.
    """

    kind: BasisKind
    axis: str
    knots_mm: tuple[float, ...] = ()
    degree: int | None = None
    low_mm: float | None = None
    high_mm: float | None = None
    period_mm: float | None = None
    order: int | None = None
    is_tangent_integral: bool = False

    def __post_init__(self) -> None:
        require(self.kind in get_args(BasisKind), f"basis {self.kind!r} is not known")
        require(self.axis in AXES, f"basis axis {self.axis!r} is not x, y or z")
        require(isinstance(self.is_tangent_integral, bool), "is_tangent_integral is neither true nor false")
        used = _BASIS_FIELDS[self.kind]
        for field in ("degree", "low_mm", "high_mm", "period_mm", "order"):
            present = getattr(self, field) is not None
            require(
                present == (field in used), f"a {self.kind} basis {'needs' if field in used else 'has no'} {field}"
            )
        require(bool(self.knots_mm) == ("knots_mm" in used), f"knots_mm do not fit a {self.kind} basis")
        for field in ("degree", "order"):
            whole = getattr(self, field)
            good = whole is None or (is_whole(whole) and 0 <= whole <= MAX_DEGREE)
            require(good, f"{field} {whole!r} is not a whole number from 0 to {MAX_DEGREE}")
        self._check_places()

    def _check_places(self) -> None:
        require(isinstance(self.knots_mm, tuple) and len(self.knots_mm) <= MAX_ITEMS, "knots_mm is no short tuple")
        require(all(is_finite(knot) for knot in self.knots_mm), "a knot is not a finite number")
        rising = all(low < high for low, high in zip(self.knots_mm, self.knots_mm[1:], strict=False))
        require(rising and len(self.knots_mm) != 1, "knots_mm do not rise strictly from a low to a high end")
        if self.kind == "quadratic":
            require(len(self.knots_mm) % 2 == 1, "quadratic elements need an odd number of nodes")
        for field in ("low_mm", "high_mm", "period_mm"):
            number = getattr(self, field)
            require(number is None or is_finite(number), f"{field} {number!r} is not a finite number")
        if self.low_mm is not None and self.high_mm is not None:
            require(self.low_mm < self.high_mm, "low_mm is not below high_mm")
        require(self.period_mm is None or self.period_mm > 0.0, "period_mm is not above 0")

    @property
    def n_functions(self) -> int:
        """Number of functions, and so of coefficients."""
        if self.kind == "bspline":
            assert self.degree is not None
            return len(self.knots_mm) - 1 + self.degree
        if self.kind == "polynomial":
            assert self.degree is not None
            return self.degree + 1
        if self.kind == "fourier":
            assert self.order is not None
            return 2 * self.order + 1
        return len(self.knots_mm)

    def to_document(self) -> dict[str, Any]:
        """Give plain values: only the fields that this kind has."""
        document: dict[str, Any] = {"kind": self.kind, "axis": self.axis}
        for field in _BASIS_FIELDS[self.kind]:
            value = getattr(self, field)
            document[field] = list(value) if isinstance(value, tuple) else value
        if self.is_tangent_integral:
            document["is_tangent_integral"] = True
        return document

    @classmethod
    def from_document(cls, document: Any, path: str | Path, key: str) -> BasisSpec:
        """Check and read what `to_document` gives; refuse anything else by file and key."""
        entries = Entries(document, path, key)
        kind: Any = entries.text("kind")
        axis = entries.text("axis")
        knots = tuple(entries.numbers("knots_mm"))
        degree, order = entries.whole("degree"), entries.whole("order")
        low, high = entries.number("low_mm", None), entries.number("high_mm", None)
        period = entries.number("period_mm", None)
        tangent = entries.flag("is_tangent_integral")
        return checked(path, key, lambda: cls(kind, axis, knots, degree, low, high, period, order, tangent))
