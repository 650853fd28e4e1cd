"""What all tests share: repeatable draws, and the folder of real data, where there is one."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

# The same cases on every machine, so that a red run can be repeated, and however slow it is: no test is one of time.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
# Cases are drawn from constants of the project's modules, too: of those that are loaded, which differ with the tests
# that a process happens to have run before.
providers._get_local_constants = lambda: providers._local_constants

# However wide the window is in which they run, lines are not folded.
os.environ.pop("COLUMNS", None)

TESTS = Path(__file__).parent
# Pages, examples, farms and the whole job: they start programs.
LONG = {"docs", "examples", "farm", "test_public_names.py", "test_whole_job.py"}

if "PYTEST_XDIST_WORKER" in os.environ:
    # Processes run beside each other, one for each core: threads of each would only wait for those of the others. Set
    # before NumPy is loaded and before the core makes its threads, here and in what a test starts.
    for library in ("OPENBLAS", "RAYON"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes long: short tests are left at the end, and no process waits for another's long one."""
    items.sort(key=lambda item: LONG.isdisjoint(item.path.relative_to(TESTS).parts))


def pytest_collection_finish() -> None:
    """Leave what all modules hold out of every later look for what can go: it stays until the end."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def full_device() -> Path:
    """A device that never has room; tests that need it are skipped where the system has none."""
    device = Path("/dev/full")
    if not device.exists():
        pytest.skip("the system has no device that is always full")
    return device


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder that GEOERR_TEST_DATA names; tests that need it are skipped without it."""
    folder = os.environ.get("GEOERR_TEST_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("GEOERR_TEST_DATA names no folder of real data")
    return Path(folder)
