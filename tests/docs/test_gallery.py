"""The gallery: every effect that moves the machine has its picture, and the pictures are those of the catalogue."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from geoerr.effects import catalogue

DOCS = Path(__file__).parents[2] / "docs"
_NUMBER = re.compile(r"-?\d+\.\d")
# A tenth of a pixel is the last digit; other processors may round it otherwise.
_PIXELS = 0.2


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_gallery", DOCS / "make_gallery.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up by its name.
    sys.modules["make_gallery"] = module
    spec.loader.exec_module(module)
    return module


def test_pictures_are_those_of_the_catalogue(maker: ModuleType) -> None:
    drawn = {effect.id: (effect.title, maker.draw(effect)) for effect in catalogue()}
    drawn = {name: made for name, made in drawn.items() if made[1] is not None}
    assert {path.stem for path in (DOCS / "gallery").glob("*.svg")} == set(drawn)
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert page == maker.page([(name, title) for name, (title, _) in drawn.items()]), (
        "run: python docs/make_gallery.py"
    )
    for name, (_, now) in drawn.items():
        there = (DOCS / "gallery" / f"{name}.svg").read_text(encoding="utf-8")
        assert _NUMBER.sub("#", there) == _NUMBER.sub("#", now), f"{name}: run python docs/make_gallery.py"
        pairs = zip(_NUMBER.findall(there), _NUMBER.findall(now), strict=True)
        assert all(abs(float(old) - float(new)) <= _PIXELS for old, new in pairs), name


def test_what_is_not_drawn_moves_nothing_of_the_machine(maker: ModuleType) -> None:
    absent = {effect.id for effect in catalogue() if maker.draw(effect) is None}
    still = {effect.id for effect in catalogue() if effect.is_rig or effect.detector is not None}
    # Named so where the value of another fits.
    assert absent == still | {effect.id for effect in catalogue() if effect.offered_as is not None}


def test_a_step_is_drawn_where_it_is(maker: ModuleType) -> None:
    """Play is two level lines a frame apart: both ends of each at one height, the two at the frame's edges."""
    points = re.findall(r'points="([^"]+)"', maker.draw(catalogue()["backlash"]))
    heights = [{place.split(",")[1] for place in line.split()} for line in points]
    assert [len(one) for one in heights] == [1, 1, 1]
    zero, there, back = (float(next(iter(one))) for one in heights)
    assert there == pytest.approx(maker._HEIGHT - maker._EDGE)
    assert back == pytest.approx(2 * maker._EDGE)
    assert zero == pytest.approx(0.5 * (there + back))
