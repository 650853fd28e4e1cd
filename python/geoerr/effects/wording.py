"""What a built-in effect says of its values, for terms of files that were written before effects said so."""

from __future__ import annotations

import contextlib
from dataclasses import replace

from geoerr.effects.collection import catalogue
from geoerr.effects.effect import Effect
from geoerr.errors import InputFileError
from geoerr.machine import Machine
from geoerr.terms import Parameter, Term


def with_words(term: Term, machine: Machine) -> Term:
    """Give a term whose values say what they are and which sign physics allows, as the catalogue has it.

    What a term says itself stays. A user's own effect is for its file to say, and so is a name that the catalogue's
    effect does not have.
    """
    if term.source != "built-in" or term.effect is None or term.effect not in catalogue():
        return term
    effect = catalogue()[term.effect]
    has_words = all(one.what for one in (*term.coefficients, *term.inner))
    has_signs = any(one.sign for one in term.coefficients) or not any(spec.sign for spec in effect.coefficients)
    if has_words and has_signs:
        return term
    known = _parameters_by_name(effect, term, machine)

    def said(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
        return tuple(_as_said(one, known.get(one.name, one)) for one in parameters)

    return replace(term, coefficients=said(term.coefficients), inner=said(term.inner))


def _as_said(parameter: Parameter, known: Parameter) -> Parameter:
    return replace(parameter, what=parameter.what or known.what, sign=parameter.sign or known.sign)


def _parameters_by_name(effect: Effect, term: Term, machine: Machine) -> dict[str, Parameter]:
    """Give what an effect has by each name: in any of its forms, lagged or not, in as many sessions as there are."""
    found: dict[str, Parameter] = {}
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
                    found.setdefault(one.name, one)
    return found
