"""What all tests of the workbench share."""

from collections.abc import Iterator

import pytest

from geoerr.workbench import actions

# The tests of what is added while nobody asks; all others would leave such work behind for those that follow.
_OF_ADDING_AHEAD = "test_workbench_ahead"


@pytest.fixture(scope="module", autouse=True)
def nothing_goes_on_behind(request: pytest.FixtureRequest) -> Iterator[None]:
    """Add nothing ahead but what a search itself adds."""
    with pytest.MonkeyPatch.context() as patch:
        if request.module.__name__.rpartition(".")[2] != _OF_ADDING_AHEAD:
            patch.setattr(actions, "begin_ahead", lambda *_: None)
        yield
