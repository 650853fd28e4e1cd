"""A name whose own variable does what it does, and clearly more, has another formula: it is none."""

from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Hidden, generate
from validation.hidden_effects.sets import sets_of

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms

# A plan whose feeds give an axis more than one acceleration: with one alone, sign and size are the same.
SEED = 6


def test_what_an_acceleration_does_by_its_sign_has_no_name() -> None:
    """A straight line does four fifths of a sign, and `acceleration` is a straight line."""
    case = generate(development_seed(SEED), None, "mixed", "gauss-10", (Hidden("acceleration-sign"),), 8.0, 3000)
    fitted = fit_terms(case.machine, [case.observations], options=FitOptions(threads=1))
    diagnosis = diagnose(fitted, threads=1)
    assert diagnosis.verdict == "unknown"
    assert diagnosis.found == ()
    assert diagnosis.unknown is not None
    assert diagnosis.unknown.depends_on == case.truth[0].variables


def test_a_small_one_is_told_by_what_its_name_leaves() -> None:
    """At 2 µm the name comes first, and what it leaves follows the acceleration alone: it was named, worth 0 µm."""
    sets = {one.key: one for one in sets_of("unlisted", 40, ["acceleration-sign"])}
    one = sets["unlisted/acceleration-sign/2/4"]
    case = one.case(10_000, is_study=False)
    fitted = fit_terms(case.machine, [case.observations], options=FitOptions(threads=1))
    diagnosis = diagnose(fitted, threads=1)
    assert diagnosis.found == ()
    assert diagnosis.unknown is not None
    assert diagnosis.unknown.depends_on == case.truth[0].variables


def test_what_an_acceleration_does_by_its_size_has_one() -> None:
    case = generate(development_seed(SEED), None, "mixed", "gauss-10", (Hidden("acceleration"),), 8.0, 3000)
    fitted = fit_terms(case.machine, [case.observations], options=FitOptions(threads=1))
    assert [str(one.reference) for one in diagnose(fitted, threads=1).found] == [f"acceleration:{case.truth[0].axis}"]
