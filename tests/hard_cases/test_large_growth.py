"""Growth of a screw a hundred times the noise, alone and beside play: more of the machine hides in it."""

from test_large_effects import (
    HIDDEN,
    assert_far_rows_are_no_mistakes,
    assert_functions_are_those_without,
    assert_one_name,
    fitted_to,
    named,
    observed,
    play,
    warmth,
)

from geoerr.diagnose.asked import diagnose

GROWTH = "thermal-expansion:y@temp_bed"


def test_it_has_one_name() -> None:
    assert_one_name(GROWTH)


def test_beside_it_the_machine_has_the_functions_that_it_has_without() -> None:
    assert_functions_are_those_without(GROWTH)


def test_rows_that_are_far_by_it_are_no_mistakes() -> None:
    assert_far_rows_are_no_mistakes(GROWTH)


def test_two_large_effects_are_both_named() -> None:
    """The search ends beside the larger, and once more beside both."""
    found = diagnose(fitted_to(observed(lambda moved: play(moved) + warmth(moved))), threads=1)
    assert set(named(found)) == set(HIDDEN)
    assert found.unknown is None
