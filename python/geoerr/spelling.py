"""What a misspelled key of a file was meant to be."""

from __future__ import annotations

import difflib
from collections.abc import Collection

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


def slip_in(keys: Collection[str], known: Collection[str]) -> tuple[str, str] | None:
    """Give the first of a table's keys that is a known one misspelled, which it lacks, and what was meant."""
    absent = [key for key in known if key not in keys]
    words = ((key, meant(key, absent)) for key in keys if key not in known)
    return next(((key, word) for key, word in words if word is not None), None)
