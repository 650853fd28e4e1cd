"""What a search listed, added one by one while a person reads: pressing *Add* then takes no time.

It changes nothing but `prepared`, and is given up where another model or search takes the place of its own.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Final

from geoerr.diagnose import Diagnosis
from geoerr.errors import GeoerrError
from geoerr.workbench.addition import Addition, seen_after
from geoerr.workbench.job import Advance
from geoerr.workbench.session import Prepared, Session

# So many names in all, and rows of all of them together: each model holds the measurements anew, about 1 kB a row.
MOST_NAMES: Final = 12
MOST_ROWS: Final = 800_000
_MOMENT_S = 0.05
# A fit that was given up ends at its next step only: who adds and undoes at once would have several side by side.
_ONE_AT_A_TIME = threading.Lock()


class _OverError(Exception):
    """Another model or search has taken the place of the one that this belongs to."""


class Ahead:
    """Adds names while the session does nothing else.

    Parameters
    ----------
    session
        What gets the prepared models, as long as its `ahead` is this one's `awaited`.
    addition, diagnosis
        What is added to, and what was found.
    """

    def __init__(self, session: Session, addition: Addition, diagnosis: Diagnosis) -> None:
        self._session, self._addition, self._diagnosis = session, addition, diagnosis
        # What is being added, what of it, and what somebody waits for.
        self._current, self._step, self._wanted = "", "", ""
        self._thread = threading.Thread(target=self._run, name="workbench: adding ahead", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until all names are done, or it was given up."""
        self._thread.join(timeout_s)

    def awaited(self, reference: str, advance: Advance) -> Prepared | None:
        """Wait for the end of what is begun already, and give it; None of a name that is not under way."""
        if self._current != reference:
            return None
        self._wanted = reference
        try:
            while self._current == reference and self._thread.is_alive():
                advance.say(self._step)
                self._thread.join(_MOMENT_S)
        finally:
            self._wanted = ""
        return self._session.prepared_of(reference)

    def _run(self) -> None:
        try:
            for reference in self._names():
                self._current = reference
                with _ONE_AT_A_TIME:
                    self._say("")
                    self._add(reference)
        except _OverError:
            pass
        finally:
            self._current = ""

    def _names(self) -> Sequence[str]:
        """Give what can still be asked for, what is most likely to be first."""
        found = self._diagnosis
        first = [str(one.reference) for one in found.found]
        unknown = [] if found.unknown is None or not found.unknown.can_be_added else [found.unknown.reference]
        others = [str(one.reference) for one in (*found.not_told_apart, *found.candidates)]
        most = min(MOST_NAMES, MOST_ROWS // len(found.fitted.sightings))
        names = list(dict.fromkeys([*first, *unknown, *others]))[:most]
        return [name for name in names if self._session.prepared_of(name) is None]

    def _add(self, reference: str) -> None:
        try:
            change = self._addition.of(reference, self._diagnosis, on_step=self._say)
            seen = seen_after(change)
        except (GeoerrError, MemoryError):
            # Who asks for it is told.
            return
        with self._session.lock:
            if seen is not None and self._session.ahead == self.awaited:
                self._session.prepared = (*self._session.prepared, Prepared(reference, seen))

    def _say(self, what: str) -> None:
        """Rest while other work is under way, but for who waits for just this."""
        self._step = what
        while self._session.is_busy and self._wanted != self._current:
            self._end_where_over()
            time.sleep(_MOMENT_S)
        self._end_where_over()

    def _end_where_over(self) -> None:
        if self._session.ahead != self.awaited:
            raise _OverError


def begin_ahead(session: Session, addition: Addition) -> None:
    """Add ahead what the session's search listed; a fit of circles takes no time anyway."""
    diagnosis = session.diagnosis
    if isinstance(diagnosis, Diagnosis):
        ahead = Ahead(session, addition, diagnosis)
        session.ahead = ahead.awaited
        ahead.start()
