"""Documents of terms from untrusted places, read key by key."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from geoerr.errors import InputFileError, ShapeError

# Bounds that no honest document comes near; they keep a hostile one from costing memory or time.
MAX_TEXT = 4000
MAX_ITEMS = 10_000
MAX_DEGREE = 30

Built = TypeVar("Built")


def require(condition: bool, problem: str) -> None:
    """Refuse content that does not fit."""
    if not condition:
        raise ShapeError(problem)


def checked(path: str | Path, key: str, build: Callable[[], Built]) -> Built:
    """Turn a refusal of content into one that names the file and the key."""
    try:
        return build()
    except ShapeError as error:
        raise InputFileError(path, str(error), column=key) from error


def is_text(value: object) -> bool:
    """Tell whether it is a text, and no endless one."""
    return isinstance(value, str) and len(value) <= MAX_TEXT


def is_number(value: object) -> bool:
    """Tell whether it is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_finite(value: object) -> bool:
    """Tell whether it is a number, neither NaN nor infinite."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_whole(value: object) -> bool:
    """Tell whether it is a whole number; true and false are none."""
    return isinstance(value, int) and not isinstance(value, bool)


_MISSING: Any = object()


class Entries:
    """One table of a document, taken out key by key; every refusal names the file and the key."""

    def __init__(self, content: Any, path: str | Path, key: str) -> None:
        if not isinstance(content, dict):
            raise InputFileError(path, f"{_shortened(content)} is not a table", column=key)
        self.content: dict[str, Any] = content
        self.path = path
        self.key = key

    def refuse(self, name: str, problem: str) -> InputFileError:
        """Give the refusal of a key."""
        return InputFileError(self.path, problem, column=f"{self.key}.{name}")

    def _get(self, name: str, default: Any) -> Any:
        value = self.content.get(name)
        if value is None:
            if default is _MISSING:
                raise self.refuse(name, "is missing")
            return default
        return value

    def text(self, name: str, default: Any = _MISSING) -> Any:
        """Take a text."""
        value = self._get(name, default)
        if value is not default and not is_text(value):
            raise self.refuse(name, f"{_shortened(value)} is not a text of at most {MAX_TEXT} characters")
        return value

    def number(self, name: str, default: Any = _MISSING) -> Any:
        """Take a finite number."""
        value = self._get(name, default)
        if value is default:
            return value
        if not is_number(value) or abs(value) > 1e300 or math.isnan(value):
            raise self.refuse(name, f"{_shortened(value)} is not a finite number")
        return float(value)

    def whole(self, name: str) -> int | None:
        """Take a whole number, None where there is none."""
        value = self._get(name, None)
        if value is not None and not is_whole(value):
            raise self.refuse(name, f"{_shortened(value)} is not a whole number")
        return value if value is None else int(value)

    def flag(self, name: str) -> bool:
        """Take true or false, false where there is neither."""
        value = self._get(name, False)
        if not isinstance(value, bool):
            raise self.refuse(name, f"{_shortened(value)} is neither true nor false")
        return value

    def numbers(self, name: str) -> Iterable[float]:
        """Take a list of numbers, none where there is no list."""
        value = self._get(name, [])
        good = isinstance(value, list) and len(value) <= MAX_ITEMS
        if not good or not all(is_number(item) and abs(item) <= 1e300 for item in value):
            raise self.refuse(name, f"{_shortened(value)} is not a list of finite numbers")
        return [float(item) for item in value]

    def texts(self, name: str) -> tuple[tuple[str, str], ...]:
        """Take texts by name, in their order."""
        value = self._get(name, {})
        if not isinstance(value, dict) or len(value) > MAX_ITEMS:
            raise self.refuse(name, f"{_shortened(value)} is not a table of texts")
        for key, item in value.items():
            if not isinstance(key, str) or not is_text(item):
                raise self.refuse(f"{name}.{_shortened(key)}", "is not a text")
        return tuple(value.items())

    def tables(self, name: str) -> list[tuple[str, Entries]]:
        """Take tables, each with its key in the document."""
        value = self._get(name, [])
        if not isinstance(value, list) or len(value) > MAX_ITEMS:
            raise self.refuse(name, f"{_shortened(value)} is not a list of tables")
        places = [f"{self.key}.{name}[{number}]" for number in range(1, len(value) + 1)]
        return [(place, Entries(item, self.path, place)) for place, item in zip(places, value, strict=True)]


def _shortened(value: object) -> str:
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        text = type(value).__name__
    return text if len(text) <= 60 else text[:57] + "..."
