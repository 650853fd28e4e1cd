"""What a button of the page means, there and back: on the page its id, here what it does, and of what."""

from __future__ import annotations

from urllib.parse import quote, unquote

from dash import ctx


def button_id(do: str, what: str = "") -> dict[str, str]:
    """Give the id of a button that does something, of something.

    Browser and server write an id's letters beyond ASCII in two ways, and a click whose id reads otherwise is lost.
    """
    return {"do": do, "what": quote(what)}


def clicked() -> tuple[str, str] | None:
    """Give what the clicked button does, and of what; None of buttons that were drawn anew, which call too."""
    if not ctx.triggered or not ctx.triggered[0]["value"]:
        return None
    return ctx.triggered_id["do"], unquote(ctx.triggered_id["what"])
