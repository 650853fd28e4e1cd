"""What follows from an object alone, worked out once and kept beside it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Self, TypeVar

T = TypeVar("T")


class KeepsWorkedOut:
    """An object that does not change, and keeps what others have worked out from it."""

    def once(self, name: str, work_out: Callable[[Self], T]) -> T:
        """Give what follows from this alone, worked out when it is first asked for by this name."""
        if name not in self._worked_out:
            self._worked_out[name] = work_out(self)
        found: T = self._worked_out[name]
        return found

    @cached_property
    def _worked_out(self) -> dict[str, Any]:
        return {}
