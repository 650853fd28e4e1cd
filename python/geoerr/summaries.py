"""What an object shows of itself in a notebook: heading, sentences, small tables; all texts escaped, no scripts.

The texts of numbers, spans and reasons serve pages and terminals as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

# Rows of a table that are shown; a notebook's cell is no report.
MOST_ROWS = 30
_UNKNOWN = "–"
# A smaller probability is told as smaller than this.
_LEAST_P = 1e-300
_STYLE = "text-align:left;vertical-align:top;padding:2px 14px 2px 0"


def summary_html(title: str, *parts: str) -> str:
    """Put parts, each HTML, under a heading, a text."""
    return f'<div class="geoerr"><p><b>{escape(title)}</b></p>{"".join(parts)}</div>'


def sentences_html(*sentences: str) -> str:
    """Make a paragraph of each sentence."""
    return "".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)


def table_html(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Make a table of texts; of very many rows the first are shown, and the others counted."""
    if not rows:
        return ""
    head = "".join(f'<th style="{_STYLE}">{escape(name)}</th>' for name in header)
    body = "".join(
        "<tr>" + "".join(f'<td style="{_STYLE}">{escape(cell)}</td>' for cell in row) + "</tr>"
        for row in rows[:MOST_ROWS]
    )
    more = sentences_html(f"and {len(rows) - MOST_ROWS} more") if len(rows) > MOST_ROWS else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def facts_html(facts: dict[str, str]) -> str:
    """Make a table of two columns, name and what there is to say of it."""
    rows = "".join(
        f'<tr><th style="{_STYLE}">{escape(name)}</th><td style="{_STYLE}">{escape(text)}</td></tr>'
        for name, text in facts.items()
    )
    return f"<table><tbody>{rows}</tbody></table>"


def number_text(value: float | None, digits: int = 2) -> str:
    """Write a number with so many decimals; a dash where there is none."""
    return _UNKNOWN if value is None or math.isnan(value) else f"{value:.{digits}f}".replace("-", "−")


def number_words(value: float) -> str:
    """Write a number with four figures, and no power of ten where people write none."""
    text = f"{value:.0f}" if 1e4 <= abs(value) < 1e6 else f"{value:.4g}"
    return text.replace("-", "−")


def p_text(p_value: float, digits: int = 2) -> str:
    """Write a probability; of one that no number tells any more a bound, for none is 0."""
    return f"{p_value:.{digits}g}" if p_value >= _LEAST_P else f"< {_LEAST_P:g}"


def p_words(p_value: float, digits: int = 2) -> str:
    """Write `p = 0.02`, or that it is below what numbers tell."""
    text = p_text(p_value, digits)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def listed(texts: Sequence[str], last: str = "and") -> str:
    """Write `a, b and c`."""
    return ", ".join(texts) if len(texts) < 2 else f"{', '.join(texts[:-1])} {last} {texts[-1]}"


def place_of_row(file_row: float, row: int) -> str:
    """Say where a row stands: the line of its file that an editor shows; without one its number, from 1."""
    return f"line {file_row:.0f} of its file" if math.isfinite(file_row) else f"row {row + 1}"


def counted(count: int, what: str, *, grouped: bool = False) -> str:
    """Write `1 pass`, `2 passes`; large numbers in groups of three digits if asked."""
    number = f"{count:,}" if grouped else f"{count}"
    return f"{number} {what}" if count == 1 else f"{number} {what}{'es' if what.endswith('s') else 's'}"


def capitalised(text: str) -> str:
    """Begin a text with a capital, and leave the rest of it as it is; the name of a column is written as it is."""
    is_name = "_" in text.partition(" ")[0]
    return text if is_name else text[:1].upper() + text[1:]


def uncapitalised(text: str) -> str:
    """Write a title as it stands inside a sentence."""
    return text[:1].lower() + text[1:]


def span_text(low: float, high: float) -> str:
    """Write a range, or the one number that it is."""
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def by_reason(names_and_reasons: Iterable[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    """Group names by the reason given for each; reasons and names in the order in which they come."""
    found: dict[str, tuple[str, ...]] = {}
    for name, why in names_and_reasons:
        found[why] = (*found.get(why, ()), name)
    return found
