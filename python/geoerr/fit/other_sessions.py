"""Models that know sessions by other numbers than the data that they are to be fitted to again."""

from __future__ import annotations

from geoerr.errors import GeoerrError
from geoerr.fit.sightings import Sightings
from geoerr.model import Model


def refuse_other_sessions(model: Model, sightings: Sightings) -> None:
    """Refuse to fit what changes from session to session where a session has another number in these data.

    Raises
    ------
    GeoerrError
        naming the session and both numbers.
    """
    known = {} if model.record is None else model.record.sessions
    numbers = sightings.numbers_of_set_ups
    for name, number in known.items():
        if numbers.get(name, number) != number:
            raise GeoerrError(
                f"the model knows session {name!r} by the number {number}, and in these data it has {numbers[name]}: "
                "what changed between sessions would be taken for that of another\n"
                "hint: fit anew from all the data, or name sessions by numbers of their own"
            )
