"""What chance does not explain is named, also where its many numbers cost more than they gain (Schwarz)."""

from validation.hidden_effects.sets import single_set

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms


def test_an_effect_of_many_numbers_is_named_where_chance_is_out_of_the_question() -> None:
    one = single_set("cross-coupling", 6, 1.0)
    case = one.case(4000, is_study=False)
    fitted = fit_terms(case.machine, [case.observations], options=FitOptions(threads=1))
    found = diagnose(fitted, threads=1)
    first = found.found[0]
    assert first.evidence < 0.0
    assert found.p_value < 1e-4
    (hidden,) = case.truth
    names = {str(first.reference), *(str(rival.reference) for rival in first.aliases)}
    assert f"cross-coupling:{hidden.axis}" in names
    assert first.held_out is not None
    assert first.held_out.after_um < first.held_out.before_um
