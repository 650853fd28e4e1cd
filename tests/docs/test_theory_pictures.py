"""The theory's pictures are those that their script draws, and show what the pages say of them."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

THEORY = Path(__file__).parents[2] / "docs" / "theory"
_NUMBER = re.compile(r"-?\d+\.\d+|-?\d+")
# A tenth of a pixel is the last digit; other processors may round it, and draw noise, a little otherwise.
_PIXELS = 0.3


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_pictures", THEORY / "make_pictures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["make_pictures"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def drawn(maker: ModuleType) -> dict[str, str]:
    return {name: draw() for name, draw in maker.PICTURES.items()}


def test_pictures_are_those_of_the_script(drawn: dict[str, str]) -> None:
    for name, now in drawn.items():
        there = (THEORY / f"{name}.svg").read_text(encoding="utf-8")
        remedy = f"{name}: run python docs/theory/make_pictures.py"
        assert _NUMBER.sub("#", there) == _NUMBER.sub("#", now), remedy
        pairs = zip(_NUMBER.findall(there), _NUMBER.findall(now), strict=True)
        assert all(abs(float(old) - float(new)) <= max(_PIXELS, 0.01 * abs(float(old))) for old, new in pairs), remedy


def test_every_picture_stands_on_a_page(drawn: dict[str, str]) -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in THEORY.glob("*.md"))
    shown = set(re.findall(r"\]\(([\w-]+)\.svg\)", pages))
    assert set(drawn) <= shown
    assert {path.stem for path in THEORY.glob("*.svg")} == shown


def test_no_text_leaves_its_picture(drawn: dict[str, str]) -> None:
    """By 5.5 px a letter, of which these texts take less on average."""
    found = re.compile(r'<text x="([\d.-]+)" y="([\d.-]+)"[^>]*text-anchor="(\w+)">([^<]*)<')
    for name, picture in drawn.items():
        head = re.search(r'viewBox="0 0 (\d+) (\d+)"', picture)
        assert head is not None
        for x, y, anchor, words in found.findall(picture):
            width = 5.5 * len(words)
            left = float(x) - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * width
            assert left > -5.0, (name, words)
            assert left + width < float(head[1]) + 5.0, (name, words)
            assert 8.0 < float(y) < float(head[2]), (name, words)


def test_a_cut_move_is_within_its_tolerance(drawn: dict[str, str]) -> None:
    """What the picture says of it: ends alone leave more than the tolerance, pieces less."""
    before, ends, cut = (float(words) for words in re.findall(r": ([\d.]+)</text>", drawn["split"]))
    assert before > ends > 5.0 > cut


def test_a_squareness_makes_a_circle_deviate_by_its_radius_times_itself(drawn: dict[str, str]) -> None:
    deviation_mm = re.search(r">([\d.]+) mm = ", drawn["circle"])
    assert deviation_mm is not None
    assert float(deviation_mm[1]) == pytest.approx(5.05e-3 * 100.0, abs=2e-3)


def test_the_best_candidate_is_the_one_that_was_put_in(drawn: dict[str, str]) -> None:
    shares = {name: float(share) for name, share in re.findall(r">([\w-]+:\w): ([\d.]+)<", drawn["chance"])}
    assert min(shares, key=lambda name: shares[name]) == "backlash:x"
