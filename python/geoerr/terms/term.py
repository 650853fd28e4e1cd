"""Terms, and the places where they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

from geoerr.terms.basis_spec import BasisSpec
from geoerr.terms.entries import MAX_ITEMS, MAX_TEXT, Entries, checked, is_finite, is_text, require
from geoerr.terms.names import (
    CHANNELS,
    CLOCK_NAME,
    EMPIRICAL,
    MOST_OF_A_CURVE,
    RAW_VARIABLES,
    SESSION_NAME,
    is_effect_id,
    is_motion,
    is_name,
    is_rig_channel,
    mentions,
    names_in,
)
from geoerr.terms.parameter import Parameter
from geoerr.terms.reference import REFERENCE_AXES

TermKind = Literal["classic", "effect", "empirical"]
TermSource = Literal["built-in", "user"]


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
        require(self.channel in CHANNELS, f"channel {self.channel!r} is not known")
        require((self.expression is None) != (self.basis is None), "a part has either an expression or a basis")
        require(is_finite(self.factor), f"factor {self.factor!r} is not a finite number")
        if self.expression is not None:
            require(is_text(self.expression), f"an expression is a text of at most {MAX_TEXT} characters")
        require(self.basis is None or isinstance(self.basis, BasisSpec), "basis is not a BasisSpec")
        require(self.basis is None or not self.definitions, "a basis has no definitions")
        for name, text in self.definitions:
            require(isinstance(name, str) and is_name(name), f"{name!r} cannot be defined: not a name")
            require(is_text(text), f"the definition of {name} is not a text of at most {MAX_TEXT} characters")
        names = [name for name, _ in self.definitions]
        require(len(set(names)) == len(names), "a name is defined twice")

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
        entries = Entries(document, path, key)
        basis = entries.content.get("basis")
        spec = None if basis is None else BasisSpec.from_document(basis, path, f"{key}.basis")
        expression = None if entries.content.get("expression") is None else entries.text("expression")
        definitions = entries.texts("definitions")
        factor = entries.number("factor", 1.0)
        channel = entries.text("channel")
        return checked(path, key, lambda: cls(channel, expression, definitions, spec, factor))


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
        tidy = is_text(self.id) and self.id != "" and self.id.isprintable() and " " not in self.id
        require(tidy, f"{self.id!r} is not a term's id")
        require(is_text(self.title), "the title is not a text")
        require(self.kind in get_args(TermKind), f"kind {self.kind!r} is not known")
        require(self.source in get_args(TermSource), f"source {self.source!r} is not known")
        require(self.effect is None or is_effect_id(self.effect), f"{self.effect!r} is not an effect's id")
        require(
            (self.effect is not None) == (self.kind == "effect"), "an effect's term names its effect, others none"
        )
        require(self.axis is None or self.axis in REFERENCE_AXES, f"axis {self.axis!r} is not known")
        if self.covariate is not None:
            parts = self.covariate.split("*" if self.kind == EMPIRICAL else "-")
            most = MOST_OF_A_CURVE if self.kind == EMPIRICAL else 2
            require(len(parts) <= most and all(map(is_name, parts)), f"{self.covariate!r} is not a covariate")
        require(bool(self.parts) and len(self.parts) <= MAX_ITEMS, "a term has at least one part")
        require(
            bool(self.coefficients) and len(self.coefficients) <= MAX_ITEMS, "a term has at least one coefficient"
        )
        names = [parameter.name for parameter in self.coefficients + self.inner]
        require(len(set(names)) == len(names), "two parameters have one name")
        require(all(p.low is not None for p in self.inner), "an inner parameter has no range")
        require(all(p.low is None for p in self.coefficients), "a linear coefficient has no range to search")
        sides = {is_rig_channel(part.channel) for part in self.parts}
        require(len(sides) == 1, "parts on the rig and on the machine cannot share a term")
        for part in self.parts:
            if part.basis is not None:
                count = part.basis.n_functions
                require(
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
        entries = Entries(document, path, key)
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
        return checked(
            path, key, lambda: cls(name, title, kind, effect, axis, covariate, parts, linear, inner, source)
        )


def _revalued(
    parameters: tuple[Parameter, ...], values: Sequence[float] | None, stds: Sequence[float] | None
) -> tuple[Parameter, ...]:
    for numbers in (values, stds):
        require(
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
