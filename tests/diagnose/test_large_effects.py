"""Effects a hundred times the noise: what they hide of the machine is seen once they are known, and not named."""

from collections.abc import Callable
from functools import cache

import numpy as np
from hidden_machine import Motion, Noise, Numbers, Plan, machine, measure, motion

from geoerr.diagnose import Change, add_effect
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.fit.choose_again import choose_again
from geoerr.fit.result import result_of
from geoerr.observations import Observations

WHITE_UM = (2.0, 2.0, 2.0)


def play(moved: Motion) -> Numbers:
    return np.outer(-0.5 * 500.0 * moved.d[:, 1], [0.0, 1.0, 0.0])


def warmth(moved: Motion) -> Numbers:
    """A thermal growth of the Y screw from its low end."""
    return np.outer(11.5e-6 * (moved.bed - 20.0) * moved.q[:, 1] * 1e3 * 5.0, [0.0, 1.0, 0.0])


HIDDEN: dict[str, Callable[[Motion], Numbers]] = {"backlash:y": play, "thermal-expansion:y@temp_bed": warmth}


def observed(hidden: Callable[[Motion], Numbers], seed: int = 1, outliers: float = 0.0) -> Observations:
    rng = np.random.default_rng(seed)
    moved = motion(rng, Plan())
    return measure(rng, moved, Noise(white=WHITE_UM, outliers=outliers), hidden(moved))


def fitted_to(observations: Observations) -> Fitted:
    return fit_terms(machine(), [observations], options=FitOptions(threads=1))


@cache
def session(name: str, outliers: float = 0.0) -> tuple[Observations, Fitted]:
    """Give what is measured of a machine with one of them, and the fit without it."""
    observations = observed(HIDDEN[name], outliers=outliers)
    return observations, fitted_to(observations)


def added(fitted: Fitted, observations: Observations, name: str) -> Change:
    return add_effect(result_of(fitted).model, observations, reference=name, threads=1)


def n_functions(fitted: Fitted) -> dict[str, int]:
    return {term.id: len(term.coefficients) for term in fitted.terms if term.kind == "classic"}


def named(found: Diagnosis) -> list[str]:
    return [str(one.reference) for one in found.found]


def assert_one_name(name: str) -> None:
    found = diagnose(session(name)[1], threads=1)
    assert named(found) == [name]
    assert found.unknown is None
    after = found.found[0].held_out_rmse_after_um
    assert after is not None
    # Of a machine whose errors are known, 2 µm in three components.
    assert after < 1.15 * 2.0 * np.sqrt(3.0)


def assert_functions_are_those_without(name: str) -> None:
    observations, stiff = session(name)
    change = added(stiff, observations, name)
    clean = n_functions(fitted_to(observed(lambda moved: np.zeros_like(moved.q))))
    before, after = n_functions(stiff), n_functions(change.after)
    assert max(abs(before[one] - clean[one]) for one in clean) > 5
    assert max(abs(after[one] - clean[one]) for one in clean) <= 2
    # Chosen beside it once, there is nothing more to choose.
    assert choose_again(change.after) is None
    assert diagnose(change.result.model, observations, threads=1).verdict == "nothing-missing"


def test_one_large_effect_has_one_name() -> None:
    assert_one_name("backlash:y")


def test_beside_it_the_machine_has_the_functions_that_it_has_without() -> None:
    assert_functions_are_those_without("backlash:y")


def test_rows_that_are_far_by_what_is_missing_are_no_mistakes() -> None:
    assert_far_rows_are_no_mistakes("backlash:y")


def test_bases_that_were_given_stay() -> None:
    observations, stiff = session("backlash:y")
    bases = {term.id: term.parts[0].basis for term in stiff.terms if term.parts[0].basis is not None}
    moved = {name: basis for name, basis in bases.items() if basis is not None and basis.kind == "bspline"}
    given = {
        name: type(basis)("bspline", basis.axis, knots_mm=(0.0, 130.0, 400.0), degree=3)
        for name, basis in moved.items()
    }
    own = fit_terms(machine(), [observations], options=FitOptions(bases={**bases, **given}, threads=1))
    change = added(own, observations, "backlash:y")
    kept = {term.id: term.parts[0].basis for term in change.after.terms if term.id in given}
    assert kept == given


def assert_far_rows_are_no_mistakes(name: str) -> None:
    (_, clean), (observations, dirty) = session(name), session(name, 0.01)
    n_rows = len(clean.sightings)
    assert len(clean.outliers) < 0.005 * n_rows
    # Where it is known, mistakes are found whatever it does.
    after = added(dirty, observations, name).after
    assert 0.007 * n_rows < len(after.outliers) < 0.02 * n_rows


def test_first_order_about_a_fit_is_that_fit() -> None:
    _, fitted = session("backlash:y", 0.01)
    again = fitted.again(fitted.terms, used=fitted.solved.used, around=fitted.solved.state)
    rows = fitted.solved.used
    np.testing.assert_array_equal(again.solved.used, rows)
    # In standard errors.
    np.testing.assert_allclose(again.solved.whitened[rows], fitted.solved.whitened[rows], atol=2e-3)
    np.testing.assert_array_equal(again.solved.state.rotations, fitted.solved.state.rotations)
