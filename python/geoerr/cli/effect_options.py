"""Options of the verbs that add effects: with a lag or without, and in which form."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from geoerr.fit import Way


class Lagging(StrEnum):
    """Whether temperatures are followed through a lag."""

    AUTO = "auto"
    YES = "yes"
    NO = "no"


Lag = Annotated[
    Lagging,
    typer.Option(
        "--lag",
        help="Whether an effect follows its temperature through a first-order lag (a time constant, tau);"
        " auto: as the data have it.",
    ),
]
Form = Annotated[
    str | None,
    typer.Option(
        "--form",
        help="Form of an effect that has several (docs/catalogue.md); without it as the data have it.",
    ),
]


def complete_effect(incomplete: str) -> list[str]:
    """Give the ids of the catalogue that begin so, and behind the colon the axes; a shell asks for it.

    Where nothing is typed yet it is as likely to be a file.
    """
    if not incomplete:
        return []
    from geoerr.effects import catalogue

    name, colon, _ = incomplete.partition(":")
    effects = catalogue()
    if colon:
        known = [f"{name}:{axis}" for axis in effects[name].axes] if name in effects else []
    else:
        known = [effect.id for effect in effects]
    return [text for text in known if text.startswith(incomplete)]


def way_of(lag: Lagging, form: str | None) -> Way:
    """Give how effects are to be written."""
    from geoerr.fit import Way

    return Way(None if lag is Lagging.AUTO else lag is Lagging.YES, form)
