"""Effects that a machine may have more than once on one axis: the next is looked for once the one before was found.

Before, both would be one candidate. Where the first is dropped again because the second does it, too, that is the
first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from geoerr.diagnose.candidates import Candidate, Shapes, has_its_first
from geoerr.diagnose.probes import Probe
from geoerr.diagnose.search.judged import reference_of
from geoerr.diagnose.search.rivals import Found
from geoerr.diagnose.search.settle import Settled
from geoerr.effects import Effect
from geoerr.effects.collection import Catalogue
from geoerr.terms import EffectReference, Term


def once_more(what: Candidate | Probe, known: Catalogue, present: Sequence[str]) -> Iterator[Candidate]:
    """Give the candidates that have the formula of one that was found once more.

    Parameters
    ----------
    present
        Ids of the terms that the model has.
    """
    if isinstance(what, Candidate):
        for effect in known:
            if effect.again == what.effect.id and str(replace(what.reference, effect=effect.id)) not in present:
                yield _named(what, effect)


def by_first_names(found: Sequence[Found], present: Sequence[str], known: Catalogue) -> list[Found]:
    """Give what was found, a second of which there is no first by the name of the first.

    Parameters
    ----------
    present
        Ids of the terms that the model has.
    """
    named = list(found)
    while (place := _without_first(named, present)) is not None:
        effect = candidate_of(named[place]).effect
        assert effect.again is not None
        named[place] = by_name_of(named[place], known[effect.again])
    return named


def in_turn(effect: Effect, known: Catalogue) -> list[Effect]:
    """Give an effect with all that are it once more, in the order in which they are looked for."""
    while effect.again is not None:
        effect = known[effect.again]
    turns: list[Effect] = []
    following: Effect | None = effect
    while following is not None:
        turns.append(following)
        following = next((one for one in known if one.again == turns[-1].id), None)
    return turns


def candidate_of(found: Found) -> Candidate:
    """Give the candidate that was found; what has no name is none."""
    assert isinstance(found.judged.what, Candidate)
    return found.judged.what


def _without_first(found: Sequence[Found], present: Sequence[str]) -> int | None:
    names = {*present, *(str(reference_of(one.judged)) for one in found)}
    for place, one in enumerate(found):
        candidate = candidate_of(one)
        if not has_its_first(candidate.effect, candidate.reference, names):
            return place
    return None


def by_name_of(found: Found, effect: Effect) -> Found:
    """Give what was found by the name of an effect that has the same formula."""
    judged = found.judged
    again = _named(candidate_of(found), effect)
    return replace(
        found,
        judged=replace(judged, what=again, shapes=_shapes(judged.shapes, again.reference, effect)),
        settled=_settled(found.settled, again.reference, effect),
        beside_others=None if found.beside_others is None else _settled(found.beside_others, again.reference, effect),
    )


def _named(candidate: Candidate, effect: Effect) -> Candidate:
    reference = replace(candidate.reference, effect=effect.id)
    shapes = tuple(_shapes(one, reference, effect) for one in candidate.shapes)
    return Candidate(reference, effect, shapes, tuple(_term(one, reference, effect) for one in candidate.refined))


def _shapes(shapes: Shapes, reference: EffectReference, effect: Effect) -> Shapes:
    return shapes if shapes.term is None else replace(shapes, term=_term(shapes.term, reference, effect))


def _settled(settled: Settled, reference: EffectReference, effect: Effect) -> Settled:
    term = None if settled.term is None else _term(settled.term, reference, effect)
    return replace(settled, term=term, shapes=_shapes(settled.shapes, reference, effect))


def _term(term: Term, reference: EffectReference, effect: Effect) -> Term:
    return replace(term, id=str(reference), title=effect.title, effect=effect.id, source=effect.origin)
