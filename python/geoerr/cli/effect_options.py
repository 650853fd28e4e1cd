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


def way_of(lag: Lagging, form: str | None) -> Way:
    """Give how effects are to be written."""
    from geoerr.fit import Way

    return Way(None if lag is Lagging.AUTO else lag is Lagging.YES, form)
