"""Where in a file something stands, and what a misspelled key was meant to be."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection
from pathlib import Path

_EFFECT = re.compile(r"\s*\[\[\s*effect\s*\]\]")
# Spellings that agree this well are one word with a slip of the finger: `unt` and `unit`, `looks_lke` and
# `looks_like`.
_SLIP = 0.75


def meant(name: str, known: Collection[str], cutoff: float = _SLIP) -> str | None:
    """Give the known name that a misspelled one was meant to be; None where it is like none."""
    folded = {word.lower().replace("_", ""): word for word in known}
    same = folded.get(name.lower().replace("_", ""))
    if same is not None:
        return same
    near = difflib.get_close_matches(name, sorted(known), n=1, cutoff=cutoff)
    return near[0] if near else None


def line_of(path: str | Path, number: int, key: str) -> int | None:
    """Give the line (1-based) on which a key of the `number`-th effect stands; the effect's own where it does not.

    Parameters
    ----------
    path
        A file that was read before.
    number
        Counts the effects from 1.
    key
        The last part of it is looked for: `coefficients.alpha` is where alpha is.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return None
    heads = [place for place, line in enumerate(lines) if _EFFECT.match(line)]
    if not 1 <= number <= len(heads):
        return None
    last = heads[number] if number < len(heads) else len(lines)
    word = re.escape(re.split(r"[.\[]", key.rstrip("]0123456789["))[-1] or key)
    given = re.compile(
        rf"(?:^|[\s{{,])[\"']?{word}[\"']?\s*=|^\s*\[\[?\s*effect\.(?:[^\]]*\.)?[\"']?{word}[\"']?\s*\]"
    )
    for place in range(heads[number - 1], last):
        if given.search(lines[place].partition("#")[0]):
            return place + 1
    return heads[number - 1] + 1
