"""A lag of up to a millimetre on the work: told in the scatter that it makes, a straight line looked like a curve."""

from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Case, Hidden, generate
from validation.hidden_effects.record import OPTIONS

from geoerr.diagnose import Diagnosis, diagnose
from geoerr.fit import fit_terms

# Targets on the tool and on the work are seen from the floor; the axis that lags carries the work.
PLAN, NOISE = "volume-floor", "gauss-10"


def diagnosed(number: int, kind: str, strength_um: float, n_rows: int) -> tuple[Case, Diagnosis]:
    case = generate(development_seed(number), None, PLAN, NOISE, [Hidden(kind)], strength_um, n_rows)
    fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
    return case, diagnose(fitted, threads=1)


def test_beside_a_curve_of_the_right_body_it_is_named() -> None:
    """The curve that stands for it until then was one of the tool, which does not move.

    And where a small name stood beside it, as here, it was not fitted along.
    """
    case, diagnosis = diagnosed(980_009, "lag", 100.0, 10_000)
    assert diagnosis.unknown is None
    (found,) = diagnosis.found
    assert str(found.reference) == "lag:z"
    (tau,) = found.term.coefficients
    assert abs(tau.value - case.truth[0].parameters["tau"]) < 4.0 * tau.std


def test_without_a_name_the_curve_is_one_of_the_body_that_moves() -> None:
    """What `geoerr add` is told to take lets the error fall."""
    _, diagnosis = diagnosed(981_001, "direction-tilt-with-z", 30.0, 4_000)
    unknown = diagnosis.unknown
    assert unknown is not None
    assert unknown.reference == "empirical:work-x@d_x*z"
    assert unknown.held_out is not None
    assert unknown.held_out.before_um is not None
    assert unknown.held_out.after_um is not None
    assert unknown.held_out.after_um < 0.3 * unknown.held_out.before_um
