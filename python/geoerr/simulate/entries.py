"""Entries of a plan, taken out one by one: each refusal names the file, the key and what would be right."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geoerr.errors import InputFileError
from geoerr.spelling import slip_in


@dataclass(frozen=True)
class Entries:
    """One table of a plan.

    Attributes
    ----------
    content
        Its keys and values.
    path
        The plan's file, for messages.
    place
        Its own name, such as `passes[2]`; empty at the top.
    """

    content: dict[str, Any]
    path: str | Path
    place: str = ""

    def key(self, name: str) -> str:
        """Give the full name of a key."""
        return f"{self.place}.{name}" if self.place else name

    def refuse(self, name: str, problem: str, remedy: str | None = None) -> InputFileError:
        """Make a refusal of one key."""
        return InputFileError(self.path, problem, column=self.key(name), remedy=remedy)

    def only(self, *known: Collection[str]) -> Entries:
        """Refuse a key that is an absent one misspelled, which would count for nothing; others are the user's own."""
        slip = slip_in(self.content, [key for keys in known for key in keys])
        if slip is not None:
            key, word = slip
            raise self.refuse(key, f"is no key of this table (did you mean {word}?)", "correct the spelling")
        return self

    def table(self, name: str) -> Entries:
        """Give a sub-table; an absent one is empty."""
        content = self.content.get(name, {})
        if not isinstance(content, dict):
            raise self.refuse(name, f"{content!r} is not a table", f"write it as [{self.key(name)}]")
        return Entries(content, self.path, self.key(name))

    def tables(self, name: str) -> list[Entries]:
        """Give the tables of a list; an absent one is empty."""
        content = self.content.get(name, [])
        if not isinstance(content, list) or not all(isinstance(item, dict) for item in content):
            raise self.refuse(name, "is not a list of tables", f"write each as [[{self.key(name)}]]")
        return [Entries(item, self.path, f"{self.key(name)}[{n}]") for n, item in enumerate(content, start=1)]

    def number(
        self,
        name: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        above: float = -math.inf,
        high: float = math.inf,
    ) -> float:
        """Give a finite number from `low` to `high`, greater than `above`; without a default it must be there."""
        value = self._present(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.refuse(name, f"{value!r} is not a number")
        if value < low or value <= above:
            bound = f"at least {low:g}" if value < low else f"above {above:g}"
            raise self.refuse(name, f"{value!r} is too small: it must be {bound}")
        if value > high:
            raise self.refuse(name, f"{value!r} is too large: it must be at most {high:g}")
        return float(value)

    def whole(self, name: str, default: int | None = None, *, low: int = 0) -> int:
        """Give a whole number not below `low`."""
        value = self._present(name, default)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.refuse(name, f"{value!r} is not a whole number")
        if value < low:
            raise self.refuse(name, f"{value!r} is too small: it must be at least {low}")
        return value

    def numbers(self, name: str, count: int | None = None, default: list[float] | None = None) -> list[float]:
        """Give a list of finite numbers, of `count` entries where that is given."""
        value = self._present(name, default)
        right = isinstance(value, list) and all(
            not isinstance(item, bool) and isinstance(item, int | float) and math.isfinite(item) for item in value
        )
        if not right or (count is not None and len(value) != count):
            wanted = "numbers" if count is None else f"{count} numbers"
            raise self.refuse(name, f"{value!r} is not a list of {wanted}")
        return [float(item) for item in value]

    def text(self, name: str, default: str | None = None, choices: tuple[str, ...] = ()) -> str:
        """Give a text, one of `choices` where they are given."""
        value = self._present(name, default)
        if not isinstance(value, str) or (choices and value not in choices):
            allowed = f"one of {', '.join(choices)}" if choices else "a text in quotation marks"
            raise self.refuse(name, f"{value!r} is not known" if choices else f"{value!r} is not a text", allowed)
        return value

    def flag(self, name: str, default: bool) -> bool:
        """Give true or false."""
        value = self.content.get(name, default)
        if not isinstance(value, bool):
            raise self.refuse(name, f"{value!r} is neither true nor false")
        return value

    def _present(self, name: str, default: Any) -> Any:
        if name not in self.content and default is None:
            raise self.refuse(name, "is missing")
        return self.content.get(name, default)
