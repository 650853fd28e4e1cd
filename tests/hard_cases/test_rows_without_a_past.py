"""At the first picture of a session nothing shows when an axis turned: what a spike did there is no other effect."""

import pytest
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Hidden, generate
from validation.hidden_effects.record import OPTIONS

from geoerr.diagnose import diagnose
from geoerr.fit import fit_terms


@pytest.mark.parametrize("number", [1, 9])
def test_a_spike_at_the_start_is_no_jump(number: int) -> None:
    """Development sets in which a jump and a warm-up were named beside the spike."""
    seed = development_seed(700_000 + number)
    case = generate(seed, None, "nine-lines", "drift-2", (Hidden("reversal-spike"),), 8.0, 10_000)
    diagnosis = diagnose(fit_terms(case.machine, [case.observations], options=OPTIONS), threads=1)
    assert diagnosis.unknown is None
    (found,) = diagnosis.found
    truth = case.truth[0]
    assert (found.effect.id, found.reference.axis) == (truth.effect, truth.axis)
    for told in found.parameters:
        assert abs(told.value - truth.parameters[told.name]) < 4.0 * told.std
