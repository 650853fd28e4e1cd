"""Warming up by far more than the noise: the drift learns it, and forgives what its time constants are off."""

from dataclasses import replace

import pytest
from validation.hidden_effects.record import OPTIONS
from validation.hidden_effects.sets import sets_of

from geoerr.diagnose import diagnose
from geoerr.fit import fit_terms

STRENGTH_UM = 100.0


@pytest.mark.parametrize("place", [2, 3])
def test_time_constants_are_those_of_the_noise_beside_it(place: int) -> None:
    """Half a millimetre and eight; estimated in the drift, time constants are tens of per cent off."""
    one = list(sets_of("single", 1, ["warm-up-two"]))[place]
    case = replace(one, strength_um=STRENGTH_UM).case(4_000, is_study=False)
    diagnosis = diagnose(fit_terms(case.machine, [case.observations], options=OPTIONS), threads=1)
    assert diagnosis.unknown is None
    (found,) = diagnosis.found
    truth = case.truth[0]
    assert (found.effect.id, found.reference.axis) == (truth.effect, truth.axis)
    for name in ("tau", "ratio"):
        told = next(one for one in found.term.inner if one.name == name)
        assert abs(told.value - truth.parameters[name]) < 4.0 * told.std
        assert told.std < 0.02 * told.value
