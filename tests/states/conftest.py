"""The generator of the study serves here: it shares no code with what explains its data."""

from __future__ import annotations

import pytest
from hot_machines import TEMPERATURES_DEGC, gantry
from validation.hot_and_cold import Hot, states_of

from geoerr.states import States


@pytest.fixture(scope="session")
def hot() -> Hot:
    """A gantry machine that heat bends, tilts and lengthens."""
    return gantry(3)


@pytest.fixture(scope="session")
def states(hot: Hot) -> States:
    """It at three temperatures."""
    return states_of(hot, 3, TEMPERATURES_DEGC)
