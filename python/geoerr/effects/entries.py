"""Entries of an effects file, taken out one by one: each refusal names file, effect, key and what is right."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geoerr.effects.places import line_of
from geoerr.errors import InputFileError
from geoerr.spelling import slip_in
from geoerr.terms import MAX_TEXT


@dataclass(frozen=True)
class Entries:
    """One table of an effects file.

    Attributes
    ----------
    content
        Its keys and values.
    path
        The file, for messages.
    place
        Its own name in messages, such as `effect "backlash"`.
    effect_number
        Of the effect in the file, from 1: tells the line of a refusal.
    """

    content: dict[str, Any]
    path: str | Path
    place: str
    effect_number: int

    def refuse(self, key: str, problem: str, remedy: str | None = None) -> InputFileError:
        """Make a refusal of one key."""
        row = line_of(self.path, self.effect_number, key)
        return InputFileError(self.path, problem, row=row, column=f"{self.place}: {key}", remedy=remedy)

    def only(self, known: Collection[str]) -> Entries:
        """Refuse a key that is a known one misspelled; keys of the user's own are left alone."""
        slip = slip_in(self.content, known)
        if slip is not None:
            key, word = slip
            raise self.refuse(key, f"is no key of this table (did you mean {word}?)", "correct the spelling")
        return self

    def text(self, key: str, default: str | None = None, choices: tuple[str, ...] = ()) -> str:
        """Give a text, one of `choices` where they are given; without a default it must be there."""
        value = self.content.get(key, default)
        if value is None:
            raise self.refuse(key, "is missing", f"choose one of {', '.join(choices)}" if choices else "write a text")
        if not isinstance(value, str):
            raise self.refuse(key, f"{shortened(value)} is not a text", "write it in quotation marks")
        if len(value) > MAX_TEXT:
            problem = f"is a text of {len(value)} characters, at most {MAX_TEXT} are read"
            raise self.refuse(key, problem, "shorten it; a long formula may be several effects")
        if choices and value not in choices:
            raise self.refuse(key, f"{shortened(value)} is not known", f"choose one of {', '.join(choices)}")
        return value

    def optional_text(self, key: str) -> str | None:
        """Give a text, or None where the key is absent."""
        return self.text(key) if key in self.content else None

    def texts(self, key: str) -> tuple[str, ...]:
        """Give a list of texts; an absent one is empty."""
        value = self.content.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) and len(item) <= MAX_TEXT for item in value):
            raise self.refuse(key, f"{shortened(value)} is not a list of texts", f'write it as {key} = ["..."]')
        if len(set(value)) != len(value):
            raise self.refuse(key, "names something twice", "name each once")
        return tuple(value)

    def flag(self, key: str) -> bool:
        """Give true or false; an absent one is false."""
        value = self.content.get(key, False)
        if not isinstance(value, bool):
            raise self.refuse(key, f"{shortened(value)} is neither true nor false", f"write {key} = true")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Give a finite number; without a default it must be there."""
        value = self.content.get(key, default)
        if not is_finite_number(value):
            problem = "is missing" if value is None else f"{shortened(value)} is not a finite number"
            raise self.refuse(key, problem, "write a number without a unit")
        return float(value)  # type: ignore[arg-type]

    def table(self, key: str) -> Entries:
        """Give a sub-table; an absent one is empty."""
        value = self.content.get(key, {})
        if not isinstance(value, dict):
            raise self.refuse(key, f"{shortened(value)} is not a table", f"write it as [effect.{key}.NAME]")
        return Entries(value, self.path, f"{self.place}: {key}", self.effect_number)

    def tables(self, key: str) -> list[Entries]:
        """Give the tables of a list; an absent one is empty."""
        value = self.content.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.refuse(key, f"{shortened(value)} is not a list of tables", f"write each as [[effect.{key}]]")
        return [
            Entries(item, self.path, f"{self.place}: {key}[{place}]", self.effect_number)
            for place, item in enumerate(value, start=1)
        ]


def is_finite_number(value: object) -> bool:
    """Tell whether a value is an honest number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= 1e300 and math.isfinite(value)


def shortened(value: object) -> str:
    """Write a value in a message, cut where it is long."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        return f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."
