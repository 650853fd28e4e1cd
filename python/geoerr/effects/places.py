"""Where in a file something stands."""

from __future__ import annotations

import re
from pathlib import Path

_EFFECT = re.compile(r"\s*\[\[\s*effect\s*\]\]")


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
