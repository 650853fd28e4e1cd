"""A fit that begins at what another one sums up to, against the same made whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from fit_scenes import CUBICS, cubic, fitted, nine_lines_seen, replaced
from virtual_machine import machine_of

from geoerr.effects import catalogue
from geoerr.fit import Fitted
from geoerr.fit.begun import known_columns
from geoerr.fit.inner import started
from geoerr.terms import Term

MACHINE = machine_of("wZbXYt")


@pytest.fixture(scope="module")
def plain() -> Fitted:
    _, observations = nine_lines_seen(np.random.default_rng(720), MACHINE, n_repeats=2)
    repeat = observations.numbers("repeat")[:, 0]
    way = np.where(repeat == 0, 1.0, -1.0)
    temperature = 20.0 + 15.0 * (1.0 - np.exp(-np.arange(len(way)) / 60.0))
    columns = {"temp_bed": temperature, "t": np.arange(len(way)) * 5.0}
    return fitted(MACHINE, replaced(observations, **columns, **{f"dir_{axis}": way for axis in "xyz"}))


def effect(name: str, covariate: str | None = None, **options: bool) -> Term:
    return catalogue()[name].term("y", covariate, MACHINE, **options)


def values_of(one: Fitted) -> np.ndarray:
    return np.array([p.value for term in one.terms for p in (*term.coefficients, *term.inner)])


@pytest.mark.parametrize(
    "more",
    [
        [effect("scale")],
        [effect("backlash")],
        [effect("thermal-expansion", "temp_bed", lagged=True)],
        [effect("backlash"), effect("thermal-expansion", "temp_bed")],
        [],
    ],
    ids=lambda terms: "+".join(term.id for term in terms) or "none",
)
def test_more_terms_on_what_is_known(plain: Fitted, more: Sequence[Term]) -> None:
    """In another order, too: where a column stands is looked up."""
    more = [started(plain, term, threads=1) if term.inner else term for term in more]
    terms = (*plain.terms[5:], *more, *plain.terms[:5])
    begun, whole = plain.again(terms), plain.fit_of_terms(terms)
    is_known = known_columns(plain, terms, whole.compiled, whole.problem, whole.sightings, whole.shared)
    assert is_known is not None
    assert is_known.is_most
    new = {term.id for term in more}
    for term, own in zip(terms, whole.compiled.coefficient_slices, strict=True):
        assert ((is_known.places[own] < 0) == (term.id in new)).all()
    assert begun.solved.steps == whole.solved.steps
    std = np.sqrt(np.diag(whole.covariance))
    # What the gauge holds at 0 is 0 but for round-off.
    assert (np.abs(values_of(begun) - values_of(whole)) <= 1e-6 * std + 1e-15).all()
    assert begun.covariance == pytest.approx(whole.covariance, rel=1e-6, abs=1e-9 * whole.covariance.max())
    assert begun.held_out.residual_mm == pytest.approx(whole.held_out.residual_mm, abs=1e-9)


def test_fewer_terms_are_all_known(plain: Fitted) -> None:
    more = plain.again((*plain.terms, effect("backlash")))
    begun, whole = more.again(plain.terms), plain.fit_of_terms(plain.terms)
    found = known_columns(more, plain.terms, plain.compiled, plain.problem, plain.sightings, plain.shared)
    assert found is not None
    assert (found.places >= 0).all()
    assert values_of(begun) == pytest.approx(values_of(whole), rel=1e-9, abs=1e-12)


def test_rows_that_do_not_count_alike_make_it_whole(plain: Fitted) -> None:
    used = np.arange(len(plain.sightings)) % 7 > 0
    begun, whole = plain.again(plain.terms, used=used), plain.fit_of_terms(plain.terms, used=used)
    assert np.array_equal(values_of(begun), values_of(whole))


def test_other_rows_and_forms_are_not_known(plain: Fitted) -> None:
    _, observations = nine_lines_seen(np.random.default_rng(721), MACHINE)
    other = fitted(MACHINE, observations, bases={**CUBICS, "EYY": cubic("y", degree=4)})
    assert known_columns(plain, other.terms, other.compiled, other.problem, other.sightings, other.shared) is None
    # A term of the same name with another basis.
    whole = plain.fit_of_terms(other.terms)
    found = known_columns(plain, whole.terms, whole.compiled, whole.problem, whole.sightings, whole.shared)
    assert found is not None
    for term, own in zip(whole.terms, whole.compiled.coefficient_slices, strict=True):
        assert ((found.places[own] < 0) == (term.id == "EYY")).all()


@pytest.fixture(scope="module", params=[False, True], ids=["alike", "some-surer"])
def long(request: pytest.FixtureRequest) -> Fitted:
    """So many rows that a fold is left out by its sums; uncertainties alike, or not."""
    rng = np.random.default_rng(722)
    _, observations = nine_lines_seen(rng, MACHINE, n_repeats=60)
    repeat = observations.numbers("repeat")[:, 0]
    columns = {f"dir_{axis}": np.where(repeat % 2 == 0, 1.0, -1.0) for axis in "xyz"}
    if request.param:
        frame = observations.frame
        size = rng.uniform(0.5, 2.0, len(repeat))
        columns |= {name: frame[name].to_numpy() * size**2 for name in ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")}
    return fitted(MACHINE, replaced(observations, **columns), is_robust=False)


def test_folds_begin_at_known_sums(long: Fitted) -> None:
    fold = np.random.default_rng(723).integers(0, 3, len(long.sightings))
    _ = long.held_out
    terms = (*long.terms[7:], effect("backlash"), *long.terms[:7])
    begun, whole = long.again(terms), long.fit_of_terms(terms)
    assert begun.begun_sums is not None
    # None of the other blocks is asked for, and once they are taken they are held no longer.
    by_other_blocks = begun.leave_out(fold)
    assert by_other_blocks.residual_mm == pytest.approx(whole.leave_out(fold).residual_mm, abs=1e-9)
    assert begun.begun_sums.take() is None
    again = long.again(terms)
    assert again.held_out.sums is not None
    assert again.held_out.residual_mm == pytest.approx(whole.held_out.residual_mm, abs=1e-9)
    assert again.held_out.prediction_variance_mm2 == pytest.approx(whole.held_out.prediction_variance_mm2, rel=1e-9)
    assert whole.begun_sums is None
    # And on from there, with a term less.
    fewer = again.again(long.terms)
    assert fewer.begun_sums is not None
    expected = again.fit_of_terms(long.terms).held_out
    assert fewer.held_out.residual_mm == pytest.approx(expected.residual_mm, abs=1e-9)


def test_sums_of_other_rows_are_not_begun_at(long: Fitted) -> None:
    _ = long.held_out
    used = np.arange(len(long.sightings)) % 7 > 0
    assert long.again(long.terms, used=used).begun_sums is None
    nobody_asked = long.fit_of_terms(long.terms)
    assert nobody_asked.again(long.terms).begun_sums is None
