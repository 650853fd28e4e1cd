"""The centre of a bed's bow: slope and height alone are those of a flat bow far off, or of a round one nearer."""

import pytest
from validation.hidden_effects.record import OPTIONS
from validation.hidden_effects.sets import single_set

from geoerr.diagnose.offers import Offers
from geoerr.diagnose.search import search
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.fit import fit_terms

STRENGTH_UM = 4.0


@pytest.mark.parametrize("number", [1, 6])
def test_a_centre_is_as_sure_as_it_says(number: int) -> None:
    """In the first set two centres explain the same; in the second one does, far from where a search begins."""
    one = single_set("bed-bow", number, STRENGTH_UM)
    case = one.case(4_000, is_study=False)
    fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
    (found,) = search(fitted, Offers(Catalogue({"bed-bow": catalogue()["bed-bow"]})), threads=1).found
    term = found.at_last.term
    assert term is not None
    told = {one.name: one for one in term.inner}
    for name in ("x_c", "y_c"):
        assert 0.0 < told[name].std < 100.0
        assert abs(told[name].value - case.truth[0].parameters[name]) < 4.0 * told[name].std
