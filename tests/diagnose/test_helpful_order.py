"""The order in which finds are told: each lets the held-out error fall, where one of them does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import pytest

from geoerr.diagnose.search.helpful_order import in_helpful_order, without_harmful


def asked(what: Callable[[Any, list[Any]], list[Any]], um: Mapping[str, float | None], names: str) -> str:
    """Ask of finds by their letters; `um` is the held-out error with those of a key, in any order."""
    bench: Any = SimpleNamespace(held_out=SimpleNamespace(um=lambda columns: um["".join(sorted(columns))]))
    finds: list[Any] = [SimpleNamespace(settled=SimpleNamespace(raw=name)) for name in names]
    return "".join(str(one.settled.raw) for one in what(bench, finds))


def ordered(um: Mapping[str, float | None], names: str) -> str:
    return asked(in_helpful_order, um, names)


@pytest.mark.parametrize(
    ("um", "told"),
    [
        # Each lets it fall: as they were found, though the second alone lets it fall farther.
        ({"": 9.0, "a": 8.0, "b": 5.0, "ab": 3.0}, "ab"),
        # The first raises it until the second is there.
        ({"": 9.0, "a": 18.0, "b": 4.0, "ab": 3.0}, "ba"),
        # Where none lets it fall, the one that raises it least is first.
        ({"": 9.0, "a": 18.0, "b": 12.0, "ab": 3.0}, "ba"),
        # Passes are too few to leave any out.
        ({"": None, "a": None, "b": None, "ab": None}, "ab"),
    ],
)
def test_what_raises_the_error_stands_behind_what_lets_it_fall(um: Mapping[str, float | None], told: str) -> None:
    assert ordered(um, "ab") == told


def test_of_three_each_is_asked_beside_those_before_it() -> None:
    um = {"": 9.0, "a": 12.0, "b": 10.0, "c": 6.0, "ac": 7.0, "bc": 5.0, "abc": 4.0}
    assert ordered(um, "abc") == "cba"


@pytest.mark.parametrize(
    ("um", "kept"),
    [
        ({"": 9.0, "a": 8.0, "ab": 7.0, "abc": 6.0}, "abc"),
        # The last raises it; and where the one before does, too, both go.
        ({"": 9.0, "a": 8.0, "ab": 7.0, "abc": 7.1}, "ab"),
        ({"": 9.0, "a": 8.0, "ab": 8.5, "abc": 8.6}, "a"),
        # What is told first is asked by its evidence alone.
        ({"": 9.0, "a": 9.5, "ab": 9.6, "abc": 9.7}, "a"),
        ({"": None, "a": None, "ab": None, "abc": None}, "abc"),
    ],
)
def test_what_is_told_later_and_raises_the_error_goes(um: Mapping[str, float | None], kept: str) -> None:
    assert asked(without_harmful, um, "abc") == kept
