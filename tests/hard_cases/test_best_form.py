"""What was found in its plain form is added in the one that the data ask for: with a harmonic or second constant."""

import pytest
from validation.hidden_effects.sets import single_set

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms


@pytest.mark.parametrize(
    ("kind", "reference", "number"), [("periodic-harmonics", "periodic", 0), ("warm-up-two", "warm-up", 0)]
)
def test_the_fuller_form_is_found_with_its_values(kind: str, reference: str, number: int) -> None:
    one = single_set(kind, number, 4.0)
    case = one.case(6000, is_study=False)
    fitted = fit_terms(case.machine, [case.observations], options=FitOptions(threads=1))
    diagnosis = diagnose(fitted, threads=1)
    (found,), (hidden,) = diagnosis.found, case.truth
    assert found.reference.effect == reference
    assert diagnosis.unknown is None
    values = {one.name: one for one in found.parameters}
    assert set(values) == set(hidden.parameters)
    for name, true in hidden.parameters.items():
        assert values[name].value == pytest.approx(true, abs=5.0 * values[name].std)


def test_one_harmonic_stays_one() -> None:
    one = single_set("periodic", 0, 4.0)
    case = one.case(6000, is_study=False)
    (found,) = diagnose(fit_terms(case.machine, [case.observations], options=FitOptions(threads=1)), threads=1).found
    assert {one.name for one in found.parameters} == {"A", "B", "P"}
