"""A second reader of formulas, for tests: Python's own, with the definitions written in."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from geoerr.terms import Part, Term

_FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "abs": np.abs,
    "step": lambda u: np.heaviside(u, 1.0),
    # Steady state.
    "lag": lambda u, tau: u + 0.0 * tau,
    "pi": np.pi,
}


def value(part: Part, names: Mapping[str, object]) -> np.ndarray:
    """Value of one part, its factor included."""
    text = part.expression
    for name, definition in part.definitions:
        text = re.sub(rf"(?<![A-Za-z0-9_.]){name}(?![A-Za-z0-9_])", f"({definition})", text)
    # "lambda" is a word of Python's.
    text = re.sub(r"\blambda\b", "lambda_", text).replace("^", "**")
    scope = {("lambda_" if name == "lambda" else name): item for name, item in names.items()}
    return part.factor * np.asarray(eval(text, {"__builtins__": {}}, _FUNCTIONS | scope), dtype=float)


def by_channel(term: Term, names: Mapping[str, object]) -> dict[str, np.ndarray]:
    """Sum of the parts of each channel."""
    sums: dict[str, np.ndarray] = {}
    for part in term.parts:
        sums[part.channel] = sums.get(part.channel, 0.0) + value(part, names)
    return sums
