"""A bow of the bed far larger than the noise: the drift learns it, and makes a lag of what has none."""

from validation.hidden_effects.record import OPTIONS
from validation.hidden_effects.sets import sets_of

from geoerr.diagnose import diagnose
from geoerr.fit import fit_terms

STRENGTH_UM = 100.0


def test_a_lag_that_is_none_goes_before_the_next_look() -> None:
    """With ten seconds of it 12 of 200 µm were left, which other bows, and something unknown, explained."""
    own = (one for one in sets_of("large", 6, ["bed-bow"]) if one.strength_um == STRENGTH_UM)
    *_, last = own
    case = last.case(4_000, is_study=False)
    diagnosis = diagnose(fit_terms(case.machine, [case.observations], options=OPTIONS), threads=1)
    assert diagnosis.unknown is None
    (found,) = diagnosis.found
    truth = case.truth[0]
    assert str(found.reference) == f"{truth.effect}:{truth.axis}@{truth.covariate}"
    assert "tau" not in {one.name for one in found.term.inner}
    assert found.held_out is not None
    assert found.held_out.after_um is not None
    assert found.held_out.after_um < 18.0
