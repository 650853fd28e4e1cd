"""Where only the tool is seen from the work, which of the two moved is told by looking at both from the floor."""

from functools import cache

from validation.hidden_effects.record import OPTIONS
from validation.hidden_effects.sets import single_set

from geoerr.diagnose import Diagnosis, diagnose
from geoerr.diagnose.advice import Advice
from geoerr.fit import fit_terms


@cache
def _diagnosis() -> Diagnosis:
    one = single_set("warm-up-two", 1, 8.0)
    case = one.case(4_000, is_study=False)
    assert case.plan == "volume-relative"
    return diagnose(fit_terms(case.machine, [case.observations], options=OPTIONS), threads=1)


def test_both_bodies_are_compared_in_the_form_that_was_found() -> None:
    """With two time constants the one is the other; with one of them it is another curve."""
    diagnosis = _diagnosis()
    assert [one.name for one in diagnosis.found[0].term.inner] == ["tau", "ratio"]
    names = {str(one.reference): one for one in diagnosis.tied}
    assert set(names) == {"warm-up:z", "warm-up:work-z"}
    (alias,) = (one for one in diagnosis.found[0].aliases if one.reference.effect == "warm-up")
    assert alias.correlation > 0.99
    assert diagnosis.verdict == "ambiguous"


def test_a_look_from_the_floor_is_advised() -> None:
    advice = _diagnosis().found[0].separate_by
    assert isinstance(advice, Advice)
    assert advice.plan is not None
    assert "a target on the tool, one on the work and a marker on the machine's base" in advice.plan
    assert advice.expected_delta_chi2 is not None
    assert advice.same_again_delta_chi2 is not None
    assert advice.expected_delta_chi2 > 20.0 > advice.same_again_delta_chi2
