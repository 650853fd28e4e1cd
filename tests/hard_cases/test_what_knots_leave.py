"""What evidence leaves of a smooth error, because its knots were not worth their price, is no wave of the drive."""

from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import generate
from validation.hidden_effects.record import OPTIONS

from geoerr.diagnose import diagnose
from geoerr.fit import fit_terms


def test_three_waves_along_an_axis_are_what_nine_functions_left() -> None:
    """A development set with nothing hidden; a wave of 84 mm was named at p = 5 × 10⁻⁶."""
    case = generate(development_seed(710_047), None, "volume-floor", "outliers", (), 0.0, 10_000)
    diagnosis = diagnose(fit_terms(case.machine, [case.observations], options=OPTIONS), threads=1)
    assert diagnosis.verdict == "nothing-missing"
    assert diagnosis.p_value is not None
    assert diagnosis.p_value > 0.05
