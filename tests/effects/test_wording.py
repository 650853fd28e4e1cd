"""Terms of files from before effects said what their values are: the catalogue says it, of its own effects only."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from effect_machines import machine

from geoerr.effects import catalogue
from geoerr.effects.wording import with_words
from geoerr.errors import InputFileError
from geoerr.model import Model
from geoerr.model.document import document_of, model_from_document
from geoerr.terms import Parameter, Term

MACHINE = machine()


def without_words(term: Term) -> Term:
    def bare(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
        return tuple(replace(one, what="") for one in parameters)

    return replace(term, coefficients=bare(term.coefficients), inner=bare(term.inner))


def said(term: Term) -> list[str]:
    return [one.what for one in (*term.coefficients, *term.inner)]


def terms_of_every_kind() -> list[Term]:
    """Give every effect that has a formula, in each of its forms, with and without a lag, in three sessions."""
    found = []
    for effect in catalogue():
        if effect.detector is not None or effect.is_smooth:
            continue
        for covariate in ("temp_bed", "temp_bed-temp_frame", None):
            for form in effect.form_names:
                for lagged in (False, True):
                    try:
                        found.append(
                            effect.term(
                                next(iter(effect.axes), None),
                                covariate,
                                MACHINE,
                                lagged=lagged,
                                form=form,
                                sessions=("0", "1", "2"),
                            )
                        )
                    except InputFileError:
                        continue
    return found


def test_every_built_in_term_says_again_what_it_said() -> None:
    terms = terms_of_every_kind()
    assert len({term.effect for term in terms}) > 30
    for term in terms:
        assert said(with_words(without_words(term), MACHINE)) == said(term), term.id


def test_what_a_term_says_itself_stays_and_a_users_own_is_its_own() -> None:
    term = catalogue()["backlash"].term("x", None, MACHINE)
    own = replace(term, coefficients=(replace(term.coefficients[0], what="gap"),))
    assert with_words(own, MACHINE) is own
    users = replace(without_words(term), source="user")
    assert with_words(users, MACHINE) is users
    other = replace(without_words(term), effect="no-such-effect")
    assert with_words(other, MACHINE) is other
    strange = replace(term, coefficients=(replace(term.coefficients[0], name="zz", what=""),))
    assert said(with_words(strange, MACHINE)) == [""]


def test_a_term_of_a_file_without_signs_has_those_of_the_catalogue() -> None:
    terms = [term for term in terms_of_every_kind() if any(one.sign for one in term.coefficients)]
    assert terms
    for term in terms:
        bare = replace(term, coefficients=tuple(replace(one, sign=0) for one in term.coefficients))
        again = with_words(bare, MACHINE)
        assert [one.sign for one in again.coefficients] == [one.sign for one in term.coefficients]


@pytest.mark.parametrize("reference", ["backlash:x", "thermal-expansion:y@temp_bed"])
def test_an_old_model_file_has_its_values_in_words(reference: str) -> None:
    effect, place = catalogue().resolve(reference)
    term = effect.term(place.axis, place.covariate, MACHINE)
    document = document_of(Model(MACHINE, None, (term,)))
    for parameter in (*document["terms"][0]["coefficients"], *document["terms"][0]["inner"]):
        assert parameter.pop("what")
    (again,) = model_from_document(document, "old.json").terms
    assert said(again) == said(term)
    assert all(re.search(r"[a-z]{3}", one.label) for one in again.coefficients)
