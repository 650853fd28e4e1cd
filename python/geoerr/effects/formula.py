"""The one door to the core's parser: a formula is refused with its place marked before anything uses it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from geoerr._core import Expression
from geoerr.errors import ExpressionError


def marked(text: str, name: str | None = None) -> str:
    """Give a formula on a line of its own, with the first place of a name marked below it; all of it without one."""
    start, end = 0, len(text)
    if name is not None:
        found = re.search(rf"(?<![A-Za-z0-9_.]){re.escape(name)}(?![A-Za-z0-9_])", text)
        start, end = (0, len(text)) if found is None else found.span()
    return f"\n  {text}\n  {' ' * start}{'^' * (end - start)}"


def check_formula(
    text: str,
    variables: Sequence[str],
    coefficients: Sequence[str],
    inner: Sequence[str],
    definitions: Sequence[tuple[str, str]],
) -> str | None:
    """Parse a formula and throw the result away.

    Parameters
    ----------
    text
        The formula.
    variables, coefficients, inner
        Names that may stand in it.
    definitions
        Name and text pairs that are inlined.

    Returns
    -------
    str or None
        What is wrong with it, the place marked; None where nothing is.
    """
    try:
        Expression(text, list(variables), list(coefficients), list(inner), dict(definitions))
    except ExpressionError as error:
        return str(error)
    return None
