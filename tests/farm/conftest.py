"""What the tests of farms share."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from small_farm import RECIPE, contents, write_farm

import geoerr


@pytest.fixture
def farm(tmp_path: Path) -> Path:
    """Four machines with five programs."""
    return write_farm(tmp_path / "farm")


@pytest.fixture(scope="session")
def right_bytes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What one worker writes that does one job after the other."""
    folder = tmp_path_factory.mktemp("one-by-one")
    with ThreadPoolExecutor(1) as one:
        done = geoerr.run_farm(write_farm(folder / "farm"), folder / "out", RECIPE, executor=one)
    assert not done.failures
    return contents(folder / "out")
