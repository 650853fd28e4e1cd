"""What all tests share: the folder of real data, where there is one."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder that GEOERR_TEST_DATA names; tests that need it are skipped without it."""
    folder = os.environ.get("GEOERR_TEST_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("GEOERR_TEST_DATA names no folder of real data")
    return Path(folder)
