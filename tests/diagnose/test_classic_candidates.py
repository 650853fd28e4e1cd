"""The classic errors as candidates where a model lacks their channel."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose.classic import lacking_classics
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, Fitted, fit_terms, frames_only, refit, sightings_of
from geoerr.fit.classic import Components
from geoerr.observations import Observations


@pytest.fixture(scope="module")
def observations() -> Observations:
    rng = np.random.default_rng(11)
    moved = motion(rng, Plan(n_sessions=1, n_lines=20, n_points=12))
    return measure(rng, moved, Noise(white=(3.0, 3.0, 3.0)))


def fitted(observations: Observations, components: Components) -> Fitted:
    return fit_terms(machine(), [observations], options=FitOptions(components=components, threads=1))


def names(of: Fitted, present: tuple[str, ...] = ()) -> set[str]:
    return {str(reference) for reference, _, _ in lacking_classics(of, catalogue(), present)}


def test_a_model_of_twelve_lacks_the_angles(observations: Observations) -> None:
    twelve = fitted(observations, "12")
    assert names(twelve) == {"angular:x", "angular:y", "angular:z"}
    assert not names(fitted(observations, "21"))
    # 27 numbers of no worth would lower χ² by 100 once in a billion; here turns of 30 µrad have arms of 400 mm.
    angles = [term for _, _, term in lacking_classics(twelve, catalogue())]
    assert twelve.solved.chi_squared - refit(twelve, [*twelve.terms, *angles]).solved.chi_squared > 100.0


def test_a_nominal_machine_lacks_them_all_and_what_a_held_model_has_is_not_lacking(
    observations: Observations,
) -> None:
    nominal = frames_only(machine(), sightings_of(observations), (), threads=1)
    assert len(names(nominal)) == 9
    assert "angular:x" not in names(nominal, ("EAX", "EBX", "ECX"))
    some = [
        term
        for reference, _, term in lacking_classics(nominal, catalogue(), ("EAX",))
        if str(reference) == "angular:x"
    ]
    assert some[0].channels == ("EBX", "ECX")
