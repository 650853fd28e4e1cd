"""A wave of a few centimetres, which many knots follow, too: it is the wave's whole, and as sure as it can be."""

import pytest
from validation.hidden_effects.bound import inner_bounds
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Case, Hidden, generate
from validation.hidden_effects.record import OPTIONS
from validation.hidden_effects.sets import single_set

from geoerr.diagnose.whole_search import searched_whole
from geoerr.effects import catalogue
from geoerr.effects.collection import Catalogue
from geoerr.fit import fit_terms
from geoerr.terms import Parameter

STRENGTH_UM, NUMBER = 8.0, 5


def test_the_period_is_as_sure_as_a_smooth_error_lets_it_be() -> None:
    """Beside many knots half of this wave was left, and its period six times as unsure."""
    one = single_set("periodic", NUMBER, STRENGTH_UM)
    case = one.case(4_000, is_study=False)
    fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
    _, searched = searched_whole(fitted, catalogue(), threads=1)
    (found,) = searched.found
    assert found.settled.term is not None
    assert found.settled.term.effect == "periodic"
    (period,) = found.settled.term.inner
    assert abs(period.value - case.truth[0].parameters["P"]) < 4.0 * period.std
    assert period.std < 2.5 * inner_bounds(case)["P"]


def period_of_waves_in(case: Case) -> Parameter:
    """Give the period that a search for waves alone tells, of a set that hides one."""
    fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
    _, searched = searched_whole(fitted, Catalogue({"periodic": catalogue()["periodic"]}), threads=1)
    (found,) = searched.found
    assert found.settled.term is not None
    (period,) = found.settled.term.inner
    assert abs(period.value - case.truth[0].parameters["P"]) < 4.0 * period.std
    return period


def test_of_a_wave_with_harmonics_the_first_counts() -> None:
    """As it was settled it is no wave of one frequency: beside few knots it was found, and not counted as one."""
    one = single_set("periodic-harmonics", 15, 2.0)
    # Beside many knots half of it is left: the second harmonic.
    assert period_of_waves_in(one.case(10_000, is_study=False)).value > 40.0


@pytest.mark.parametrize("number", [2, 14])
def test_a_large_wave_with_harmonics_is_told_at_its_period(number: int) -> None:
    """Sought about the period of one frequency alone, the first was silent, and the second 41 standard errors off."""
    hidden = [Hidden("periodic-harmonics")]
    seed = development_seed(10_000 + number)
    period_of_waves_in(generate(seed, None, "nine-lines", "offsets-3", hidden, 30.0, 10_000))


@pytest.mark.parametrize(
    ("number", "noise", "strength_um"),
    [
        # Few knots and a wave left a ninth of what few knots leave, and a tenth was asked for.
        (930_108, "offsets-3+drift-2", 30.0),
        # Chosen again beside the wave, knots followed it: another wave was told.
        (970_215, "offsets-3", 100.0),
        # Knots followed the wave and a little of a smooth error besides.
        (970_165, "offsets-3+drift-2", 100.0),
    ],
)
def test_a_large_wave_of_few_turns_is_told_at_its_period(number: int, noise: str, strength_um: float) -> None:
    """Of six to nine turns: two were silent, and one was told as another wave."""
    hidden = [Hidden("periodic")]
    period_of_waves_in(generate(development_seed(number), None, "nine-lines", noise, hidden, strength_um, 10_000))
