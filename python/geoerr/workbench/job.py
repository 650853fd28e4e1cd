"""Long work beside the page: one thread, its progress, and a stop that takes effect at once for the person."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeAlias

from geoerr.errors import GeoerrError


class _StoppedError(Exception):
    """The person stopped the work: it ends where it next tells its progress."""


class Advance:
    """What work tells of itself as it goes; where it was stopped, telling ends it.

    Parameters
    ----------
    stopped
        Set when the person stops the work.
    """

    def __init__(self, stopped: threading.Event) -> None:
        self._stopped = stopped
        self.progress, self.step = (0, 0), ""

    def __call__(self, done: int, total: int) -> None:
        """Tell the steps done and their number."""
        self._end_where_stopped()
        self.progress = (done, total)

    def say(self, what: str) -> None:
        """Tell what comes next."""
        self._end_where_stopped()
        self.step = what

    def _end_where_stopped(self) -> None:
        if self._stopped.is_set():
            raise _StoppedError


def slip_words(error: Exception) -> str:
    """Say what nobody has foreseen."""
    return f"this went wrong inside geoerr ({type(error).__name__}: {error})\nhint: please report it"


# The work: gives what is to be done with its result, which happens only if nobody stopped it.
Work: TypeAlias = Callable[[Advance], Callable[[], None]]


class Job:
    """One piece of work.

    Parameters
    ----------
    title
        What is done, in words.
    place
        The panel in which a failure is shown.
    work
        Runs in a thread of its own.
    on_end
        Called when it ended, with the message of a failure or None; not called after a stop.
    """

    def __init__(self, title: str, place: str, work: Work, on_end: Callable[[Job, str | None], None]) -> None:
        self.title, self.place = title, place
        self._work, self._on_end = work, on_end
        self._stopped = threading.Event()
        self._applying = threading.Lock()
        self._advance = Advance(self._stopped)
        self._began = time.monotonic()
        self._thread = threading.Thread(target=self._run, name=f"workbench: {title}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Take no result any more; the work itself ends at its next step."""
        with self._applying:
            self._stopped.set()

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until it has ended."""
        self._thread.join(timeout_s)

    @property
    def progress(self) -> tuple[int, int]:
        """Steps done and their number; (0, 0) where that is not known."""
        return self._advance.progress

    @property
    def step(self) -> str:
        """What is being done, in words; empty where the work is one step."""
        return self._advance.step

    @property
    def elapsed_s(self) -> float:
        """Since it began."""
        return time.monotonic() - self._began

    def _run(self) -> None:
        problem: str | None = None
        apply: Callable[[], None] | None = None
        try:
            apply = self._work(self._advance)
        except _StoppedError:
            return
        except GeoerrError as error:
            problem = str(error)
        except MemoryError:
            problem = "there is not enough memory for this\nhint: take fewer rows, or close other programs"
        except Exception as error:
            # A slip of ours must not leave a page that waits for ever.
            problem = slip_words(error)
        with self._applying:
            if self._stopped.is_set():
                return
            if apply is not None:
                apply()
            self._on_end(self, problem)
