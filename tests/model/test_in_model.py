"""Which of the 21 errors a model stands for, and which figures need them."""

from __future__ import annotations

import numpy as np
import pytest
from model_machines import drawn_errors, machine

from geoerr.effects import catalogue
from geoerr.error_functions import ALL_NAMES
from geoerr.model import Model
from geoerr.model.in_model import is_about_the_model, moving_along, needed_by, not_in_model_words


def of_effects(*references: str) -> Model:
    described = machine("wbXYZt")
    terms = []
    for reference in references:
        effect, placed = catalogue().resolve(reference)
        made = effect.at(placed.axis, placed.covariate).terms(described)
        terms += [one.with_values([1e-4] * len(one.coefficients), [40.0] * len(one.inner)) for one in made]
    return Model(described, None, tuple(terms))


@pytest.mark.parametrize(
    ("references", "stands_for"),
    [
        ((), set()),
        (("scale:x",), {"EXX"}),
        (("squareness:xy",), {"EC0Y"}),
        # In the same place, and saying nothing of how far the axis goes.
        (("backlash:x",), set()),
        (("thermal-expansion:x@temp",), set()),
        (("periodic:x",), set()),
        (("periodic:x", "scale:x"), {"EXX"}),
    ],
)
def test_an_effect_stands_for_an_error_that_it_is_a_form_of(
    references: tuple[str, ...], stands_for: set[str]
) -> None:
    assert set(ALL_NAMES) - set(of_effects(*references).not_in_model) == stands_for


def test_tables_stand_for_their_errors_and_name_what_they_do_not_determine() -> None:
    errors = drawn_errors(machine("wbXYZt"), 1)
    assert Model(errors.machine, errors).not_in_model == ()


def test_a_figure_needs_the_positioning_of_its_axes_and_the_squareness_of_their_pairs() -> None:
    assert needed_by("x") == {"EXX"}
    assert needed_by("zx") == {"EXX", "EZZ", "EB0Z"}
    assert needed_by("xyz") == {"EXX", "EYY", "EZZ", "EC0Y", "EB0Z", "EA0Z"}


def test_a_squareness_counts_away_from_where_the_other_axis_stood() -> None:
    places = np.array([[100.0, 50.0, 0.0], [100.0, 0.0, 0.0]])
    known = is_about_the_model(("EC0Y", "EZZ", "ECX"), places, np.zeros(3))
    assert known.tolist() == [[False, True, False], [True, True, False]]


def test_what_moves_a_line_is_told_by_the_lever() -> None:
    """A yaw of the axis nearest to the work turns what stands on the others: along x by y, and not along z."""
    along_x = np.array([[0.0, 50.0, 20.0], [100.0, 50.0, 20.0]])
    assert moving_along(machine("wbXYZt"), ("ECX", "EYX", "EXX"), along_x, (1.0, 0.0, 0.0)) == ("EXX", "ECX")
    assert moving_along(machine("wbXYZt"), ("ECX",), along_x, (0.0, 0.0, 1.0)) == ()


def test_a_whole_kind_is_named_by_its_kind() -> None:
    angles = [name for name in ALL_NAMES if name[1] in "ABC" and name[2] != "0"]
    assert not_in_model_words(["EXX", *angles]) == "not in the model, taken as 0: EXX, the nine angles"
    assert not_in_model_words(ALL_NAMES) == "not in the model, taken as 0: all of the 21 errors"
