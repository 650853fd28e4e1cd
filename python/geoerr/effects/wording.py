"""What the values of a built-in effect are in words, for terms of files that were written before effects said so."""

from __future__ import annotations

import contextlib
from dataclasses import replace

from geoerr.effects.collection import catalogue
from geoerr.errors import InputFileError
from geoerr.machine import Machine
from geoerr.terms import Parameter, Term


def with_words(term: Term, machine: Machine) -> Term:
    """Give a term whose values say what they are, as the catalogue has it; what a term says itself stays.

    A user's own effect is for its file to say, and so is a name that the catalogue's effect does not have.
    """
    is_known = term.source == "built-in" and term.effect is not None and term.effect in catalogue()
    if not is_known or all(one.what for one in (*term.coefficients, *term.inner)):
        return term
    words = _words_of_names(term, machine)

    def said(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
        return tuple(one if one.what else replace(one, what=words.get(one.name, "")) for one in parameters)

    return replace(term, coefficients=said(term.coefficients), inner=said(term.inner))


def _words_of_names(term: Term, machine: Machine) -> dict[str, str]:
    """Give what the effect calls each name: in any of its forms, lagged or not, in as many sessions as there are."""
    assert term.effect is not None
    effect = catalogue()[term.effect]
    words: dict[str, str] = {}
    numbers = [int(tail) for one in term.coefficients if (tail := one.name.rpartition("_")[2]).isdigit()]
    # Any name for the first, of which nothing is said.
    sessions = ["first", *(str(number) for number in dict.fromkeys(numbers))]
    for form in effect.form_names:
        for lagged in (False, True):
            # A form may be for another covariate, or follow no temperature.
            with contextlib.suppress(InputFileError):
                placed = effect.term(
                    term.axis,
                    term.covariate,
                    machine,
                    lagged=lagged,
                    form=form,
                    sessions=sessions,
                )
                for one in (*placed.coefficients, *placed.inner):
                    words.setdefault(one.name, one.what)
    return words
