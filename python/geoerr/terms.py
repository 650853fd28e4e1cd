"""Terms: what moves a point, as data. One term is one row of "the one model" and stands alone in a model file.

A term displaces points on one or more **channels** (places of the kinematic chain, or of the measuring rig), by an
expression or by the functions of a basis, with linear coefficients θ and a few inner parameters φ:

    p_measured − p_nominal = Σ_terms Σ_parts J_channel(q, l) · factor · f(q, covariates; θ, φ) + noise

Values are plain (texts, numbers, tuples): a term can be compared, pickled, written to JSON and read back without
loss, and nothing in it is ever executed. Documents from untrusted places are checked key by key.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from geoerr.errors import InputFileError, ShapeError
from geoerr.machine import AXES

JOINT_CHANNELS: tuple[str, ...] = tuple(f"E{direction}{axis}" for axis in "XYZ" for direction in "XYZABC")
SQUARENESS_CHANNELS = ("S_xy", "S_xz", "S_yz")
BODY_CHANNELS: tuple[str, ...] = tuple(f"{body}-{axis}" for body in ("tool", "work", "target") for axis in AXES)
RIG_CHANNELS: tuple[str, ...] = (
    *(f"rig-t{axis}" for axis in AXES),
    *(f"rig-r{axis}" for axis in AXES),
    "rig-scale",
    "rig-depth",
    "rig-disparity",
    "rig-ray-x",
    "rig-ray-y",
    *(f"motion-{axis}" for axis in AXES),
)
CHANNELS = JOINT_CHANNELS + SQUARENESS_CHANNELS + BODY_CHANNELS + RIG_CHANNELS

# What an expression may use without the data holding a column of that name.
HISTORY_NAMES = ("d", "s", "t_rev", "v", "a", "mean_v")
# The place on the work that a row is about, in the work's own frame: (tx, ty) on `work`, else the place that the
# target stands over, (x + tx, y + ty).
PLACE_NAMES = ("bed_x", "bed_y")
# Running number of the row's session, 0 for the first.
SESSION_NAME = "session"
# Time since the first session began, all sessions laid end to end: a moment of one session is no moment of another.
CLOCK_NAME = "clock"
RAW_VARIABLES = frozenset(
    {
        *AXES,
        *(f"t{axis}" for axis in AXES),
        "t",
        *(f"{name}_{axis}" for name in HISTORY_NAMES for axis in AXES),
        *PLACE_NAMES,
        SESSION_NAME,
        CLOCK_NAME,
    }
)
FUNCTIONS = frozenset(
    {
        *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
        *("exp", "log", "sqrt", "abs", "sign", "step", "min", "max", "where", "lag", "windup"),
    }
)
CONSTANTS = frozenset({"pi"})
# In a reference's place of an effect: a curve without a cause, `empirical:x@feed`.
EMPIRICAL = "empirical"
# Variables of such a curve, at most.
MOST_OF_A_CURVE = 3

TermKind = Literal["classic", "effect", "empirical"]
TermSource = Literal["built-in", "user"]
Spacing = Literal["linear", "log"]
_SPACINGS = get_args(Spacing)
BasisKind = Literal["bspline", "polynomial", "fourier", "linear", "quadratic"]

# Bounds that no honest document comes near; they keep a hostile one from costing memory or time.
MAX_TEXT = 4000
MAX_ITEMS = 10_000
MAX_DEGREE = 30

_Built = TypeVar("_Built")

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}\Z")
_EFFECT_ID = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*\Z")
_TOKEN = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|([A-Za-z_][A-Za-z0-9_]*)")
_PAIRS = ("xy", "xz", "yz")
REFERENCE_AXES: tuple[str, ...] = (
    *AXES,
    *_PAIRS,
    *(f"{moved}*{other}" for moved in AXES for other in AXES if moved != other),
    *(f"work-{axis}" for axis in AXES),
)
_REFERENCE_HINT = "write ID[:AXIS][@COVARIATE], for example thermal-expansion:x@temp_bed"


def is_motion(name: str, *kinds: str) -> bool:
    """Tell whether a variable says how an axis moves, in one of these ways of `HISTORY_NAMES`.

    `v_x` is a speed; `v_left`, a row of a picture, and a user's column `a_room` are no motion.
    """
    kind, _, axis = name.rpartition("_")
    return kind in kinds and axis in AXES


def has_span(name: str) -> bool:
    """Tell whether a variable that rows have by themselves was measured over a span that says how far it is known.

    How long the machine has run, how hard it works, how fast it goes: a number for it may be as far from what was
    measured as a temperature. A clock always is, and so is a time since a reversal that stands for a long one.
    """
    return name == "t" or is_motion(name, "v", "mean_v")


def is_rig_channel(channel: str) -> bool:
    """Tell whether a channel belongs to the measuring rig: explained, never compensated."""
    return channel in RIG_CHANNELS


def is_name(text: str) -> bool:
    """Tell whether a text can stand in an expression as a name (letters, digits, underscores)."""
    return _NAME.match(text) is not None


def is_column(text: str) -> bool:
    """Tell whether a formula can mean a column by this name: one that is no function or constant of formulas."""
    return is_name(text) and text not in FUNCTIONS | CONSTANTS


def is_effect_id(text: str) -> bool:
    """Tell whether a text is an effect's id: lower-case words joined by hyphens."""
    return _EFFECT_ID.match(text) is not None and len(text) <= 100


@lru_cache(maxsize=4096)
def names_in(expression: str) -> tuple[str, ...]:
    """Give the names that an expression mentions, functions and constants aside, each once, in order.

    `windup` mentions the direction `d` and the travel `s` that it is a recursion over.
    """
    found: dict[str, None] = {}
    for match in _TOKEN.finditer(expression):
        name = match[1]
        if name == "windup":
            found |= {"d": None, "s": None}
        elif name is not None and name not in FUNCTIONS | CONSTANTS:
            found[name] = None
    return tuple(found)


@lru_cache(maxsize=4096)
def mentions(expression: str, function: str) -> bool:
    """Tell whether an expression calls a function."""
    return any(match[1] == function for match in _TOKEN.finditer(expression))


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
        _require(_is_finite(self.value), f"plausible value {self.value!r} is not a finite number")
        _require(
            _is_finite(self.within) and self.within >= 0.0, f"tolerance {self.within!r} is not a number from 0 up"
        )
        _require(_is_text(self.what) and self.what != "", f"{self.what!r} does not say what the value is of")

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        return {"value": self.value, "what": self.what, "within": self.within}


@dataclass(frozen=True)
class UsualSpan:
    """Sizes that are usual for a parameter where physics gives no one value; its sign does not count.

    Attributes
    ----------
    low, high
        In the parameter's unit; `low` is 0 where nothing is too small.
    what
        What has such sizes, in words (`a preloaded ball screw`).
    source
        Who says so: a standard, a paper, a maker, or what it is computed from.
    """

    low: float
    high: float
    what: str
    source: str = ""

    def __post_init__(self) -> None:
        good = _is_finite(self.low) and _is_finite(self.high) and 0.0 <= self.low < self.high
        _require(good, f"{self.low!r} to {self.high!r} is not a span of sizes from 0 up")
        _require(_is_text(self.what) and self.what != "", f"{self.what!r} does not say what the span is of")
        _require(_is_text(self.source), f"source {self.source!r} is not a text")

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        document: dict[str, Any] = {"low": self.low, "high": self.high, "what": self.what}
        return document | ({"source": self.source} if self.source else {})


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

    def __post_init__(self) -> None:
        # Thousands are made in a fit: what is refused is put into words only then.
        if not (isinstance(self.name, str) and is_name(self.name)):
            raise ShapeError(f"{self.name!r} is not a parameter's name")
        for field in ("unit", "what"):
            if not _is_text(text := getattr(self, field)):
                raise ShapeError(f"{field} of {self.name} is {text!r}, not a text")
        for field in ("value", "std"):
            if not _is_number(number := getattr(self, field)) or math.isinf(number):
                raise ShapeError(f"{field} of {self.name} is {number!r}")
        if self.std < 0.0:
            raise ShapeError(f"std of {self.name} is negative")
        if self.spacing not in _SPACINGS:
            raise ShapeError(f"spacing {self.spacing!r} of {self.name} is not known")
        self._check_range()

    def _check_range(self) -> None:
        if (self.low is None) != (self.high is None):
            raise ShapeError(f"the range of {self.name} has one end only")
        if self.low is not None and self.high is not None:
            if not (_is_finite(self.low) and _is_finite(self.high) and self.low <= self.high):
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
        return document

    @classmethod
    def from_document(cls, document: Any, path: str | Path, key: str) -> Parameter:
        """Check and read what `to_document` gives; refuse anything else by file and key."""
        entries = _Entries(document, path, key)
        value, std = entries.number("value", math.nan), entries.number("std", math.nan)
        plausible = tuple(_plausible(item) for _, item in entries.tables("plausible"))
        name, unit = entries.text("name"), entries.text("unit")
        low, high = entries.number("low", None), entries.number("high", None)
        spacing: Any = entries.text("spacing", "linear")
        what = entries.text("what", "")
        return _checked(path, key, lambda: cls(name, unit, value, std, plausible, low, high, spacing, what))


def _plausible(entries: _Entries) -> Plausible | UsualSpan:
    if "low" in entries.content or "high" in entries.content:
        if "value" in entries.content:
            raise entries.refuse("value", "stands beside low and high")
        low, high = entries.number("low"), entries.number("high")
        what, source = entries.text("what"), entries.text("source", "")
        return _checked(entries.path, entries.key, lambda: UsualSpan(low, high, what, source))
    value, what, within = entries.number("value"), entries.text("what"), entries.number("within", Plausible.within)
    return _checked(entries.path, entries.key, lambda: Plausible(value, what, within))


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
        _require(self.kind in get_args(BasisKind), f"basis {self.kind!r} is not known")
        _require(self.axis in AXES, f"basis axis {self.axis!r} is not x, y or z")
        _require(isinstance(self.is_tangent_integral, bool), "is_tangent_integral is neither true nor false")
        used = _BASIS_FIELDS[self.kind]
        for field in ("degree", "low_mm", "high_mm", "period_mm", "order"):
            present = getattr(self, field) is not None
            _require(
                present == (field in used), f"a {self.kind} basis {'needs' if field in used else 'has no'} {field}"
            )
        _require(bool(self.knots_mm) == ("knots_mm" in used), f"knots_mm do not fit a {self.kind} basis")
        for field in ("degree", "order"):
            whole = getattr(self, field)
            good = whole is None or (_is_whole(whole) and 0 <= whole <= MAX_DEGREE)
            _require(good, f"{field} {whole!r} is not a whole number from 0 to {MAX_DEGREE}")
        self._check_places()

    def _check_places(self) -> None:
        _require(isinstance(self.knots_mm, tuple) and len(self.knots_mm) <= MAX_ITEMS, "knots_mm is no short tuple")
        _require(all(_is_finite(knot) for knot in self.knots_mm), "a knot is not a finite number")
        rising = all(low < high for low, high in zip(self.knots_mm, self.knots_mm[1:], strict=False))
        _require(rising and len(self.knots_mm) != 1, "knots_mm do not rise strictly from a low to a high end")
        if self.kind == "quadratic":
            _require(len(self.knots_mm) % 2 == 1, "quadratic elements need an odd number of nodes")
        for field in ("low_mm", "high_mm", "period_mm"):
            number = getattr(self, field)
            _require(number is None or _is_finite(number), f"{field} {number!r} is not a finite number")
        if self.low_mm is not None and self.high_mm is not None:
            _require(self.low_mm < self.high_mm, "low_mm is not below high_mm")
        _require(self.period_mm is None or self.period_mm > 0.0, "period_mm is not above 0")

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
        entries = _Entries(document, path, key)
        kind: Any = entries.text("kind")
        axis = entries.text("axis")
        knots = tuple(entries.numbers("knots_mm"))
        degree, order = entries.whole("degree"), entries.whole("order")
        low, high = entries.number("low_mm", None), entries.number("high_mm", None)
        period = entries.number("period_mm", None)
        tangent = entries.flag("is_tangent_integral")
        return _checked(path, key, lambda: cls(kind, axis, knots, degree, low, high, period, order, tangent))


_BASIS_FIELDS: Mapping[str, tuple[str, ...]] = {
    "bspline": ("knots_mm", "degree"),
    "polynomial": ("low_mm", "high_mm", "degree"),
    "fourier": ("low_mm", "high_mm", "period_mm", "order"),
    "linear": ("knots_mm",),
    "quadratic": ("knots_mm",),
}


@dataclass(frozen=True)
class Part:
    """One place where a term acts.

    Attributes
    ----------
    channel
        One of `CHANNELS`.
    expression
        Formula over raw variables, definitions and the term's parameters, mm and rad inside; or None.
    definitions
        Name and text pairs, inlined when the formula is parsed (`q` is `x`, `T` is `temp_bed - 20`, ...).
    basis
        Instead of an expression: its functions pair with the term's coefficients one to one.
    factor
        Multiplies the part.
    """

    channel: str
    expression: str | None = None
    definitions: tuple[tuple[str, str], ...] = ()
    basis: BasisSpec | None = None
    factor: float = 1.0

    def __post_init__(self) -> None:
        _require(self.channel in CHANNELS, f"channel {self.channel!r} is not known")
        _require((self.expression is None) != (self.basis is None), "a part has either an expression or a basis")
        _require(_is_finite(self.factor), f"factor {self.factor!r} is not a finite number")
        if self.expression is not None:
            _require(_is_text(self.expression), f"an expression is a text of at most {MAX_TEXT} characters")
        _require(self.basis is None or isinstance(self.basis, BasisSpec), "basis is not a BasisSpec")
        _require(self.basis is None or not self.definitions, "a basis has no definitions")
        for name, text in self.definitions:
            _require(isinstance(name, str) and is_name(name), f"{name!r} cannot be defined: not a name")
            _require(_is_text(text), f"the definition of {name} is not a text of at most {MAX_TEXT} characters")
        names = [name for name, _ in self.definitions]
        _require(len(set(names)) == len(names), "a name is defined twice")

    @property
    def names(self) -> tuple[str, ...]:
        """Raw variables, covariates and parameters that the part uses, definitions resolved, in order."""
        if self.basis is not None:
            return (self.basis.axis,)
        definitions = dict(self.definitions)
        pending, seen, has_lag = [self.expression or ""], dict[str, None](), False
        while pending:
            text = pending.pop(0)
            has_lag = has_lag or mentions(text, "lag")
            for name in names_in(text):
                if name not in seen and name in definitions:
                    pending.append(definitions[name])
                seen[name] = None
        names = [name for name in seen if name not in definitions]
        # Inside lag() a speed is the mean speed since the previous row.
        means = [f"mean_{name}" for name in names if has_lag and is_motion(name, "v")]
        return tuple(dict.fromkeys(names + means))

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        document: dict[str, Any] = {"channel": self.channel}
        if self.basis is not None:
            document["basis"] = self.basis.to_document()
        else:
            document["expression"] = self.expression
            document["definitions"] = dict(self.definitions)
        if self.factor != 1.0:
            document["factor"] = self.factor
        return document

    @classmethod
    def from_document(cls, document: Any, path: str | Path, key: str) -> Part:
        """Check and read what `to_document` gives; refuse anything else by file and key."""
        entries = _Entries(document, path, key)
        basis = entries.content.get("basis")
        spec = None if basis is None else BasisSpec.from_document(basis, path, f"{key}.basis")
        expression = None if entries.content.get("expression") is None else entries.text("expression")
        definitions = entries.texts("definitions")
        factor = entries.number("factor", 1.0)
        channel = entries.text("channel")
        return _checked(path, key, lambda: cls(channel, expression, definitions, spec, factor))


@dataclass(frozen=True)
class Term:
    """One named member of a model.

    Attributes
    ----------
    id
        Unique in a model: `EXX` for a classic error, else the reference `thermal-expansion:x@temp_bed`.
    title
        In words.
    kind
        `classic` (one of the 21), `effect` (catalogue or user), `empirical` (a curve without a cause).
    effect, axis, covariate
        The reference's parts; None where there is none.
    parts
        Places where it acts; they share the coefficients and inner parameters.
    coefficients
        Linear parameters θ, in the order of a basis's functions where a part has one.
    inner
        Inner parameters φ.
    source
        `built-in` or `user`.
    """

    id: str
    title: str
    kind: TermKind
    effect: str | None
    axis: str | None
    covariate: str | None
    parts: tuple[Part, ...]
    coefficients: tuple[Parameter, ...]
    inner: tuple[Parameter, ...] = ()
    source: TermSource = "built-in"

    def __post_init__(self) -> None:
        tidy = _is_text(self.id) and self.id != "" and self.id.isprintable() and " " not in self.id
        _require(tidy, f"{self.id!r} is not a term's id")
        _require(_is_text(self.title), "the title is not a text")
        _require(self.kind in get_args(TermKind), f"kind {self.kind!r} is not known")
        _require(self.source in get_args(TermSource), f"source {self.source!r} is not known")
        _require(self.effect is None or is_effect_id(self.effect), f"{self.effect!r} is not an effect's id")
        _require(
            (self.effect is not None) == (self.kind == "effect"), "an effect's term names its effect, others none"
        )
        _require(self.axis is None or self.axis in REFERENCE_AXES, f"axis {self.axis!r} is not known")
        if self.covariate is not None:
            parts = self.covariate.split("*" if self.kind == EMPIRICAL else "-")
            most = MOST_OF_A_CURVE if self.kind == EMPIRICAL else 2
            _require(len(parts) <= most and all(map(is_name, parts)), f"{self.covariate!r} is not a covariate")
        _require(bool(self.parts) and len(self.parts) <= MAX_ITEMS, "a term has at least one part")
        _require(
            bool(self.coefficients) and len(self.coefficients) <= MAX_ITEMS, "a term has at least one coefficient"
        )
        names = [parameter.name for parameter in self.coefficients + self.inner]
        _require(len(set(names)) == len(names), "two parameters have one name")
        _require(all(p.low is not None for p in self.inner), "an inner parameter has no range")
        _require(all(p.low is None for p in self.coefficients), "a linear coefficient has no range to search")
        sides = {is_rig_channel(part.channel) for part in self.parts}
        _require(len(sides) == 1, "parts on the rig and on the machine cannot share a term")
        for part in self.parts:
            if part.basis is not None:
                count = part.basis.n_functions
                _require(
                    count == len(names) - len(self.inner), f"{count} basis functions do not pair with coefficients"
                )

    @property
    def is_rig(self) -> bool:
        """Whether it explains the measuring rig: fitted, never compensated."""
        return is_rig_channel(self.parts[0].channel)

    @property
    def is_wave_in_time(self) -> bool:
        """Whether it hums or breathes without a cause: nobody knows how it will stand when a program runs."""
        return self.kind == EMPIRICAL and bool(self.inner)

    def in_session(self, number: int) -> Term:
        """Give what it is in one of the sessions that it was fitted to, whatever session rows are of.

        A wave in time stays as it is: of another time it says nothing.
        """
        if SESSION_NAME not in self.variables or self.is_wave_in_time:
            return self
        session = (SESSION_NAME, str(number))
        return replace(
            self, parts=tuple(replace(part, definitions=(*part.definitions, session)) for part in self.parts)
        )

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the parts, each once, in order."""
        return tuple(dict.fromkeys(part.channel for part in self.parts))

    @property
    def variables(self) -> tuple[str, ...]:
        """Raw variables and covariate columns that the parts use, each once, in order."""
        parameters = {parameter.name for parameter in self.coefficients + self.inner}
        names = dict.fromkeys(name for part in self.parts for name in part.names)
        return tuple(name for name in names if name not in parameters)

    @property
    def is_of_time(self) -> bool:
        """Whether the time of a row itself counts."""
        return "t" in self.variables or CLOCK_NAME in self.variables

    @property
    def needs(self) -> tuple[str, ...]:
        """Covariate columns without which no row can be predicted."""
        return tuple(name for name in self.variables if name not in RAW_VARIABLES)

    def with_values(
        self,
        coefficients: Sequence[float] | None = None,
        inner: Sequence[float] | None = None,
        *,
        coefficients_std: Sequence[float] | None = None,
        inner_std: Sequence[float] | None = None,
    ) -> Term:
        """Give the same term with other values (and uncertainties), in the order of its parameters.

        Raises
        ------
        ShapeError
            if a list's length is not the number of parameters.
        """
        return replace(
            self,
            coefficients=_revalued(self.coefficients, coefficients, coefficients_std),
            inner=_revalued(self.inner, inner, inner_std),
        )

    def to_document(self) -> dict[str, Any]:
        """Give plain values, for model.json; `from_document` reads them back without loss."""
        return {
            "id": self.id,
            "title": self.title,
            "kind": self.kind,
            "effect": self.effect,
            "axis": self.axis,
            "covariate": self.covariate,
            "source": self.source,
            "parts": [part.to_document() for part in self.parts],
            "coefficients": [parameter.to_document() for parameter in self.coefficients],
            "inner": [parameter.to_document() for parameter in self.inner],
        }

    @classmethod
    def from_document(cls, document: Any, path: str | Path, key: str = "term") -> Term:
        """Check and read what `to_document` gives.

        Raises
        ------
        InputFileError
            for anything else; names the file and the key. Expressions are texts here: the core's parser judges them.
        """
        entries = _Entries(document, path, key)
        kind: Any = entries.text("kind")
        source: Any = entries.text("source")
        parts = tuple(Part.from_document(item.content, path, place) for place, item in entries.tables("parts"))
        parameters = [
            tuple(Parameter.from_document(item.content, path, place) for place, item in entries.tables(group))
            for group in ("coefficients", "inner")
        ]
        effect, axis, covariate = (entries.text(name, None) for name in ("effect", "axis", "covariate"))
        name, title = entries.text("id"), entries.text("title")
        linear, inner = parameters
        return _checked(
            path, key, lambda: cls(name, title, kind, effect, axis, covariate, parts, linear, inner, source)
        )


@dataclass(frozen=True)
class EffectReference:
    """A candidate's name in parts: `effect`, `axis` and `covariate` of `ID[:AXIS][@COVARIATE]`."""

    effect: str
    axis: str | None = None
    covariate: str | None = None

    def __str__(self) -> str:
        """Write it as `ID[:AXIS][@COVARIATE]`."""
        axis = "" if self.axis is None else f":{self.axis}"
        return f"{self.effect}{axis}" + ("" if self.covariate is None else f"@{self.covariate}")

    @property
    def covariate_columns(self) -> tuple[str, ...]:
        """Columns of the covariate: none, one, or the two of a difference or of a curve."""
        return () if self.covariate is None else tuple(re.split("[-*]", self.covariate))


def parse_effect_reference(text: str) -> EffectReference:
    """Read `ID[:AXIS][@COVARIATE]`.

    AXIS is `x y z`, a pair `xy xz yz`, `x*y` (a joint of x as a function of y too), or for a displacement of the
    tool or the work its direction (`z` = tool, `work-z` = work). COVARIATE is a column or a difference of two,
    `temp_a-temp_b`; of an `empirical` curve one to three variables, `feed*z`.

    Raises
    ------
    InputFileError
        if the text is not such a name.
    """
    head, at, covariate = text.partition("@")
    effect, colon, axis = head.partition(":")
    if not is_effect_id(effect):
        raise InputFileError(text, f"{effect!r} is not the id of an effect", remedy=_REFERENCE_HINT)
    if colon and axis not in REFERENCE_AXES:
        raise InputFileError(text, f"{axis!r} is not an axis", remedy=f"axes are {', '.join(REFERENCE_AXES)}")
    is_curve = effect == EMPIRICAL
    columns, most = covariate.split("*" if is_curve else "-"), MOST_OF_A_CURVE if is_curve else 2
    if at and not (len(columns) <= most and all(map(is_column, columns)) and len(set(columns)) == len(columns)):
        several = "two or three different ones" if is_curve else "the difference of two columns"
        raise InputFileError(
            text,
            f"{covariate!r} is neither a column nor {several}",
            remedy=f"write the column's name, or names as {'feed*z' if is_curve else 'temp_a-temp_b'}",
        )
    return EffectReference(effect, axis if colon else None, covariate if at else None)


def _revalued(
    parameters: tuple[Parameter, ...], values: Sequence[float] | None, stds: Sequence[float] | None
) -> tuple[Parameter, ...]:
    for numbers in (values, stds):
        _require(
            numbers is None or len(numbers) == len(parameters),
            f"{len(numbers or ())} numbers for {len(parameters)} parameters",
        )
    return tuple(
        replace(
            parameter,
            value=parameter.value if values is None else float(values[index]),
            std=parameter.std if stds is None else float(stds[index]),
        )
        for index, parameter in enumerate(parameters)
    )


def _require(condition: bool, problem: str) -> None:
    if not condition:
        raise ShapeError(problem)


def _checked(path: str | Path, key: str, build: Callable[[], _Built]) -> _Built:
    """Turn a refusal of content into one that names the file and the key."""
    try:
        return build()
    except ShapeError as error:
        raise InputFileError(path, str(error), column=key) from error


def _is_text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= MAX_TEXT


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


_MISSING: Any = object()


class _Entries:
    """One table of a document, taken out key by key; every refusal names the file and the key."""

    def __init__(self, content: Any, path: str | Path, key: str) -> None:
        if not isinstance(content, dict):
            raise InputFileError(path, f"{_shortened(content)} is not a table", column=key)
        self.content: dict[str, Any] = content
        self.path = path
        self.key = key

    def refuse(self, name: str, problem: str) -> InputFileError:
        return InputFileError(self.path, problem, column=f"{self.key}.{name}")

    def _get(self, name: str, default: Any) -> Any:
        value = self.content.get(name)
        if value is None:
            if default is _MISSING:
                raise self.refuse(name, "is missing")
            return default
        return value

    def text(self, name: str, default: Any = _MISSING) -> Any:
        value = self._get(name, default)
        if value is not default and not _is_text(value):
            raise self.refuse(name, f"{_shortened(value)} is not a text of at most {MAX_TEXT} characters")
        return value

    def number(self, name: str, default: Any = _MISSING) -> Any:
        value = self._get(name, default)
        if value is default:
            return value
        if not _is_number(value) or abs(value) > 1e300 or math.isnan(value):
            raise self.refuse(name, f"{_shortened(value)} is not a finite number")
        return float(value)

    def whole(self, name: str) -> int | None:
        value = self._get(name, None)
        if value is not None and not _is_whole(value):
            raise self.refuse(name, f"{_shortened(value)} is not a whole number")
        return value if value is None else int(value)

    def flag(self, name: str) -> bool:
        value = self._get(name, False)
        if not isinstance(value, bool):
            raise self.refuse(name, f"{_shortened(value)} is neither true nor false")
        return value

    def numbers(self, name: str) -> Iterable[float]:
        value = self._get(name, [])
        good = isinstance(value, list) and len(value) <= MAX_ITEMS
        if not good or not all(_is_number(item) and abs(item) <= 1e300 for item in value):
            raise self.refuse(name, f"{_shortened(value)} is not a list of finite numbers")
        return [float(item) for item in value]

    def texts(self, name: str) -> tuple[tuple[str, str], ...]:
        value = self._get(name, {})
        if not isinstance(value, dict) or len(value) > MAX_ITEMS:
            raise self.refuse(name, f"{_shortened(value)} is not a table of texts")
        for key, item in value.items():
            if not isinstance(key, str) or not _is_text(item):
                raise self.refuse(f"{name}.{_shortened(key)}", "is not a text")
        return tuple(value.items())

    def tables(self, name: str) -> list[tuple[str, _Entries]]:
        value = self._get(name, [])
        if not isinstance(value, list) or len(value) > MAX_ITEMS:
            raise self.refuse(name, f"{_shortened(value)} is not a list of tables")
        places = [f"{self.key}.{name}[{number}]" for number in range(1, len(value) + 1)]
        return [(place, _Entries(item, self.path, place)) for place, item in zip(places, value, strict=True)]


def _shortened(value: object) -> str:
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        text = type(value).__name__
    return text if len(text) <= 60 else text[:57] + "..."
