"""Effects that a machine may have twice on one axis: the second is looked for once the first was found.

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
    names = {*present, *(str(reference_of(one.judged)) for one in found)}
    return [_by_first_name(one, names, known) for one in found]


def _by_first_name(found: Found, names: set[str], known: Catalogue) -> Found:
    what, judged = found.judged.what, found.judged
    assert isinstance(what, Candidate)
    if what.effect.again is None or has_its_first(what.effect, what.reference, names):
        return found
    first = known[what.effect.again]
    again = _named(what, first)
    return replace(
        found,
        judged=replace(judged, what=again, shapes=_shapes(judged.shapes, again.reference, first)),
        settled=_settled(found.settled, again.reference, first),
        beside_others=None if found.beside_others is None else _settled(found.beside_others, again.reference, first),
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
