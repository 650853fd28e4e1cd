"""Small pieces that every panel is made of."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

from dash import html

from geoerr.errors import InputFileError
from geoerr.workbench.clicks import button_id
from geoerr.workbench.session import Session

_IN_BACKTICKS: Final = re.compile(r"`([^`]*)`")
# For fields that belong to the page alone: what was typed is there again after a reload.
STAYS: Final = {"persistence": True, "persistence_type": "session"}


def breakable(name: str) -> list[Any]:
    """Let a long name of an effect go on in another line before its `@`, not in the midst of a word."""
    head, at, rest = name.partition("@")
    return [head, html.Wbr(), at + rest] if at else [head]


def button(
    text: str | list[Any],
    do: str,
    what: str = "",
    *,
    is_main: bool = False,
    title: str = "",
    off: bool = False,
    rests: bool = False,
) -> Any:
    """Make a button that asks for an action: `do`, of `what`.

    One that `rests` is off while work is under way, too: the page sees to that itself (`assets/resting.js`), so that
    no panel has to be made and drawn anew when work begins.
    """
    kinds = [name for name, holds in (("main", is_main), ("rests", rests)) if holds]
    return html.Button(
        text,
        id=button_id(do, what),
        n_clicks=0,
        className=" ".join(kinds),
        title=title,
        disabled=off,
        type="button",
        **{"data-off": "true"} if off else {},
    )


def problem(session: Session, place: str) -> Any:
    """Show what went wrong in a panel, in the words of the error; nothing where nothing did."""
    text = session.problems.get(place)
    if text is None:
        return html.Div()
    said, _, hint = text.partition("\nhint: ")
    said, _, marked = said.partition("\n")
    return html.Div(
        [
            html.P(sentence(said), className="said"),
            # A formula or a line with a place marked below it: as wide as it is written.
            html.Pre(marked, className="code") if marked else None,
            html.P([html.B("What to do: "), hint]) if hint else None,
            button("OK", "dismiss", place, title="Take this message away"),
        ],
        className="problem",
        role="alert",
    )


def wrong_field(error: InputFileError) -> Any:
    """Say what is wrong with what was typed, beside its field."""
    return html.P(sentence(f"{error.path}: {error.problem}; {error.remedy}"), className="problem", role="alert")


def sentence(text: str) -> str:
    """Begin with a capital, unless the first word is a name (`part.gcode:118:`), and end with a full stop.

    What stands in backticks, for a terminal, stands in quotes.
    """
    text = _IN_BACKTICKS.sub(r"“\1”", text.strip())
    if not text:
        return text
    begins = text[0].upper() if text.split()[0].isalpha() else text[0]
    return begins + text[1:] + ("" if text[-1] in ".!?:" else ".")


def figure_row(name: str, value: str, title: str = "") -> Any:
    """Make a row of a small table of figures."""
    return html.Tr([html.Th(name, scope="row", title=title), html.Td(value)])


def um(value: float | None) -> str:
    """Write a length in µm; a dash where there is none."""
    return "–" if value is None else f"{value:.{0 if abs(value) >= 1000.0 else 1}f} µm"


def difference_um(value: float | None, other: float | None) -> str:
    """Write how a length differs from another."""
    if value is None or other is None:
        return ""
    return signed(value - other)


def signed(value: float) -> str:
    """Write a number with its sign and one decimal; what rounds to nothing has none."""
    text = f"{value:+.1f}"
    return "0.0" if text in ("+0.0", "-0.0") else text.replace("-", "−")


def section(title: str, children: Sequence[Any], *, name: str, explanation: str = "") -> Any:
    """Make a part of a panel with a heading; `explanation` stands under it in grey."""
    return html.Section(
        [
            html.H2(title, id=f"{name}-heading"),
            html.P(explanation, className="why") if explanation else None,
            *children,
        ],
        className="part",
        **{"aria-labelledby": f"{name}-heading"},
    )
