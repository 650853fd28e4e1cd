"""One number of a term, with what physics says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from geoerr.errors import ShapeError
from geoerr.terms.entries import Entries, checked, is_finite, is_number, is_text, require
from geoerr.terms.names import is_name

Spacing = Literal["linear", "log"]
_SPACINGS = get_args(Spacing)
#: Signs that physics allows a value, as files have them.
SIGNS = {"any": 0, "positive": 1, "negative": -1}


@dataclass(frozen=True)
class Plausible:
    """A value that physics would give a parameter.

    Attributes
    ----------
    value
        In the parameter's unit.
    what
        In words (`steel`).
    within
        How far from it still counts, as a part of it: makers and alloys differ, a screw's lead does not.
    """

    value: float
    what: str
    within: float = 0.05

    def __post_init__(self) -> None:
        require(is_finite(self.value), f"plausible value {self.value!r} is not a finite number")
        require(is_finite(self.within) and self.within >= 0.0, f"tolerance {self.within!r} is not a number from 0 up")
        require(is_text(self.what) and self.what != "", f"{self.what!r} does not say what the value is of")

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        return {"value": self.value, "what": self.what, "within": self.within}


@dataclass(frozen=True)
class UsualSpan:
    """Sizes that are usual for a parameter where physics gives no one value.

    Attributes
    ----------
    low, high
        In the parameter's unit; `low` is 0 where nothing is too small.
    what
        What has such sizes, in words (`a preloaded ball screw`).
    source
        Who says so: a standard, a paper, a maker, or what it is computed from.
    sign
        +1 or −1 where the sizes are those of values of one sign; 0 where that does not count.
    """

    low: float
    high: float
    what: str
    source: str = ""
    sign: int = 0

    def __post_init__(self) -> None:
        good = is_finite(self.low) and is_finite(self.high) and 0.0 <= self.low < self.high
        require(good, f"{self.low!r} to {self.high!r} is not a span of sizes from 0 up")
        require(is_text(self.what) and self.what != "", f"{self.what!r} does not say what the span is of")
        require(is_text(self.source), f"source {self.source!r} is not a text")
        require(self.sign in SIGNS.values(), f"sign of a span is {self.sign!r}")

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        document: dict[str, Any] = {"low": self.low, "high": self.high, "what": self.what}
        document |= {"source": self.source} if self.source else {}
        return document | ({"sign": _sign_name(self.sign)} if self.sign else {})


@dataclass(frozen=True, eq=False)
class Parameter:
    """One number of a term, linear or inner.

    Attributes
    ----------
    name
        As the expressions write it.
    unit
        Of `value`, `std`, `low` and `high`; `""` for a pure number.
    value, std
        NaN while unknown.
    plausible
        Values that physics would give, and spans of usual sizes.
    low, high
        Range in which an inner parameter is searched; None for a linear coefficient. Equal ends hold it fixed.
    spacing
        How trial values are spread over that range.
    what
        What it is, in words, where the effect says; no part of what is compared.
    sign
        +1 or −1 where physics allows one sign only, else 0; no part of what is compared.
    """

    name: str
    unit: str
    value: float = math.nan
    std: float = math.nan
    plausible: tuple[Plausible | UsualSpan, ...] = ()
    low: float | None = None
    high: float | None = None
    spacing: Spacing = "linear"
    what: str = ""
    sign: int = 0

    def __post_init__(self) -> None:
        # Thousands are made in a fit: what is refused is put into words only then.
        if not (isinstance(self.name, str) and is_name(self.name)):
            raise ShapeError(f"{self.name!r} is not a parameter's name")
        for field in ("unit", "what"):
            if not is_text(text := getattr(self, field)):
                raise ShapeError(f"{field} of {self.name} is {text!r}, not a text")
        for field in ("value", "std"):
            if not is_number(number := getattr(self, field)) or math.isinf(number):
                raise ShapeError(f"{field} of {self.name} is {number!r}")
        if self.std < 0.0:
            raise ShapeError(f"std of {self.name} is negative")
        if self.sign not in SIGNS.values():
            raise ShapeError(f"sign of {self.name} is {self.sign!r}")
        if self.spacing not in _SPACINGS:
            raise ShapeError(f"spacing {self.spacing!r} of {self.name} is not known")
        self._check_range()

    def _check_range(self) -> None:
        if (self.low is None) != (self.high is None):
            raise ShapeError(f"the range of {self.name} has one end only")
        if self.low is not None and self.high is not None:
            if not (is_finite(self.low) and is_finite(self.high) and self.low <= self.high):
                raise ShapeError(f"{self.name} ranges from {self.low!r} to {self.high!r}")
            if self.spacing != "linear" and not self.low > 0.0:
                raise ShapeError(f"the log range of {self.name} must be above 0")

    def _key(self) -> tuple[object, ...]:
        return (
            self.name,
            self.unit,
            None if math.isnan(self.value) else self.value,
            None if math.isnan(self.std) else self.std,
            self.plausible,
            self.low,
            self.high,
            self.spacing,
        )

    def __eq__(self, other: object) -> bool:
        """Compare by content; an unknown (NaN) value equals an unknown value."""
        return self._key() == other._key() if isinstance(other, Parameter) else NotImplemented

    def __hash__(self) -> int:
        """Hash what is compared."""
        return hash(self._key())

    @property
    def label(self) -> str:
        """What it is, and the letter that formulas and `TERM.NAME` know it by: `lost motion b`."""
        return f"{self.what} {self.name}".lstrip()

    @property
    def is_fixed(self) -> bool:
        """Whether an inner parameter's range is one point, so that there is nothing to search."""
        return self.low is not None and self.low == self.high

    @property
    def ends(self) -> tuple[float, float]:
        """Both ends of the range of an inner parameter: a coefficient has none."""
        assert self.low is not None
        assert self.high is not None
        return self.low, self.high

    @property
    def middle(self) -> float:
        """Its value; while unknown the middle of its range, in its own spacing; NaN of one without a range."""
        if not math.isnan(self.value) or self.low is None or self.high is None:
            return self.value
        # The product of both ends might overflow.
        return math.sqrt(self.low) * math.sqrt(self.high) if self.spacing == "log" else 0.5 * (self.low + self.high)

    def to_document(self) -> dict[str, Any]:
        """Give plain values; an unknown value or uncertainty is null."""
        document: dict[str, Any] = {
            "name": self.name,
            "unit": self.unit,
            "value": None if math.isnan(self.value) else self.value,
            "std": None if math.isnan(self.std) else self.std,
        }
        if self.plausible:
            document["plausible"] = [item.to_document() for item in self.plausible]
        if self.low is not None:
            document |= {"low": self.low, "high": self.high, "spacing": self.spacing}
        if self.what:
            document["what"] = self.what
        if self.sign:
            document["sign"] = _sign_name(self.sign)
        return document

    @classmethod
    def from_document(cls, document: Any, path: str | Path, key: str) -> Parameter:
        """Check and read what `to_document` gives; refuse anything else by file and key."""
        entries = Entries(document, path, key)
        value, std = entries.number("value", math.nan), entries.number("std", math.nan)
        plausible = tuple(_plausible(item) for _, item in entries.tables("plausible"))
        name, unit = entries.text("name"), entries.text("unit")
        low, high = entries.number("low", None), entries.number("high", None)
        spacing: Any = entries.text("spacing", "linear")
        numbers = low, high, spacing, entries.text("what", ""), _sign_of(entries)
        return checked(path, key, lambda: cls(name, unit, value, std, plausible, *numbers))


def _sign_name(sign: int) -> str:
    """Give a sign as files have it."""
    return next(name for name, own in SIGNS.items() if own == sign)


def _sign_of(entries: Entries) -> int:
    """Read the sign that a table of a file states; 0 where it states none."""
    name = entries.text("sign", "any")
    if name not in SIGNS:
        raise entries.refuse("sign", f"{name!r} is none of {', '.join(SIGNS)}")
    return SIGNS[name]


def _plausible(entries: Entries) -> Plausible | UsualSpan:
    if "low" in entries.content or "high" in entries.content:
        if "value" in entries.content:
            raise entries.refuse("value", "stands beside low and high")
        low, high = entries.number("low"), entries.number("high")
        what, source = entries.text("what"), entries.text("source", "")
        sign = _sign_of(entries)
        return checked(entries.path, entries.key, lambda: UsualSpan(low, high, what, source, sign))
    value, what, within = entries.number("value"), entries.text("what"), entries.number("within", Plausible.within)
    return checked(entries.path, entries.key, lambda: Plausible(value, what, within))
