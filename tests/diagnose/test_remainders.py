"""What an effect of an acceleration leaves of itself is no find; what has nothing to do with one is."""

from types import SimpleNamespace

import pytest

from geoerr.diagnose.search.nameless import is_a_remainder


def settled(visible_um: float, *variables: str) -> SimpleNamespace:
    return SimpleNamespace(visible_um=visible_um, term=SimpleNamespace(variables=variables))


@pytest.mark.parametrize(
    ("larger", "own", "is_left_over"),
    [
        (("a_x",), ("v_x",), True),
        (("a_x",), ("v_y",), False),
        (("d_x",), ("v_x",), False),
        # A constant follows nothing: it is no remainder of what has no acceleration.
        (("d_x",), (), False),
    ],
)
def test_only_an_acceleration_leaves_remainders(
    larger: tuple[str, ...], own: tuple[str, ...], *, is_left_over: bool
) -> None:
    found = [SimpleNamespace(settled=settled(10.0, *larger))]
    assert is_a_remainder(found, settled(1.0, *own)) == is_left_over
