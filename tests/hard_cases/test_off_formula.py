"""Effects that are 30 % uneven along an axis of which their formula knows nothing: by the study's own generator."""

import pytest
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Hidden, generate
from validation.hidden_effects.judge import TIED

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.search.uneven import most_uneven
from geoerr.fit import FitOptions, fit_terms
from geoerr.terms import EffectReference

UNEVEN, STRENGTH_UM, N_ROWS = 0.3, 8.0, 2500


@pytest.mark.parametrize(
    ("kind", "plan", "noise"),
    [
        ("backlash", "nine-lines", "gauss-10"),
        ("angular-reversal", "volume-floor", "offsets-3"),
        ("frame-tilt-thermal", "volume-floor", "drift-2"),
    ],
)
def test_an_uneven_effect_keeps_its_name_and_the_rest_is_told(kind: str, plan: str, noise: str) -> None:
    hidden = (Hidden(kind, off_formula=UNEVEN),)
    case = generate(development_seed(61), None, plan, noise, hidden, STRENGTH_UM, N_ROWS)
    truth = case.truth[0]
    found = diagnose(fit_terms(case.machine, [case.observations], options=FitOptions(threads=1)), threads=1)
    assert truth.effect is not None
    name = EffectReference(truth.effect, truth.axis, truth.covariate)
    # What contains the name may say a little of what is off it: the study's rule for one tied set.
    alike = [alias.reference for alias in found.found[0].aliases if alias.correlation > TIED]
    assert name in [found.found[0].reference, *alike]
    assert found.unknown is not None
    assert truth.off_variable in found.unknown.depends_on
    settled = found.searched.found[0].settled
    uneven = most_uneven(settled.space, settled)
    # And how uneven it is.
    assert uneven is not None
    assert uneven.axis == truth.off_variable
    assert uneven.share == pytest.approx(UNEVEN, abs=0.1)
