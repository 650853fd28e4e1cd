"""Effects whose inner parameters are still to be found, begun beside functions that leave something of them.

The richest functions of an axis follow most waves along it: in what they leave, a period is that of something else.
A wave is sought where the data have chosen the freedom of the errors without it, and few knots stand where many would
follow one; as many as do not follow what was found are then what is chosen from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from geoerr.fit.classic import on_basis
from geoerr.fit.fitted import Fitted
from geoerr.fit.inner import started
from geoerr.fit.knots import choose_bases
from geoerr.fit.sightings import Numbers
from geoerr.fit.wavy import beside_waves, may_be_followed, without_waves
from geoerr.terms import BasisSpec, Term


def with_effects(
    fitted: Fitted,
    undecided: Sequence[Term],
    effects: Sequence[Term],
    positions_mm: Mapping[str, Numbers],
    *,
    one_step: bool,
    threads: int,
) -> Fitted:
    """Give the fit with these effects, their inner parameters begun.

    Where an undecided function can follow an effect, it has as many functions as do not, and the effect's inner
    parameters stay where they were found: a period beside functions that follow anything is hardly determined.

    Parameters
    ----------
    fitted
        With the richest functions.
    undecided
        Errors of axes whose functions are yet to be chosen.
    effects
        Terms with inner parameters that are unknown.
    positions_mm
        Distinct positions of each axis.
    one_step
        Stay first order.
    """
    followed = [effect for effect in effects if any(may_be_followed(one, effect) for one in undecided)]
    if followed:
        begun = _begun_beside_few(fitted, undecided, followed, positions_mm, threads)
        limited = {
            one.id: beside_waves(one, basis, begun, positions_mm)
            for one in undecided
            if (basis := one.parts[0].basis) is not None
        }
        fitted = fitted.again((*on_bases(fitted.terms, limited), *map(with_inner_held, begun)), one_step=one_step)
    for effect in effects:
        if effect not in followed:
            fitted = fitted.again(
                (*fitted.terms, started(fitted, effect, one_step=one_step, threads=threads)), one_step=one_step
            )
    return fitted


def few_beside(fitted: Fitted, effects: Sequence[Term]) -> dict[str, Term]:
    """Give the errors of a fit, by id, that have few knots where many may follow these effects."""
    shared = {one.id for one in fitted.terms if any(may_be_followed(one, effect) for effect in effects)}
    if not shared:
        return {}
    by_id = {term.id: term for term in fitted.terms}
    few = without_waves(fitted) or ()
    return {term.id: term for term in few if term.id in shared and term != by_id[term.id]}


def with_few_knots(fitted: Fitted, effects: Sequence[Term]) -> Fitted:
    """Give a fit with few knots where many may follow these effects."""
    few = few_beside(fitted, effects)
    return fitted.again(tuple(few.get(term.id, term) for term in fitted.terms)) if few else fitted


def with_inner_held(term: Term) -> Term:
    """Give a term whose inner parameters stay where they were found."""
    held = (one if one.is_fixed else replace(one, low=one.value, high=one.value) for one in term.inner)
    return replace(term, inner=tuple(held))


def _begun_beside_few(
    fitted: Fitted,
    undecided: Sequence[Term],
    effects: Sequence[Term],
    positions_mm: Mapping[str, Numbers],
    threads: int,
) -> list[Term]:
    """Give effects with the values that they have beside the freedom that the data choose without them."""
    chosen = choose_bases(undecided, fitted.terms, fitted.covariance_by_scatter, fitted.null_space, positions_mm)
    plain = fitted.again(on_bases(fitted.terms, {one.name: one.basis for one in chosen}))
    plain = with_few_knots(plain, effects)
    for effect in effects:
        plain = plain.again((*plain.terms, started(plain, effect, threads=threads)))
    ids = {effect.id for effect in effects}
    return [term for term in plain.terms if term.id in ids]


def on_bases(terms: Sequence[Term], bases: Mapping[str, BasisSpec]) -> tuple[Term, ...]:
    """Give terms, those whose ids have one on another basis."""
    return tuple(on_basis(term, bases[term.id]) if term.id in bases else term for term in terms)
