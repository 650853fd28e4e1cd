"""Waves beside a model that is held and has some on the same axis: which of them is which.

What is found is what the model lacks: more of a wave that it has, or another one. It is the same where no whole wave
more or less is on the way that was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from geoerr.diagnose.candidates import n_waves_in_some_form
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.search.judged import reference_of
from geoerr.diagnose.search.once_more import by_name_of, candidate_of, in_turn
from geoerr.diagnose.search.rivals import Found
from geoerr.effects import Effect
from geoerr.effects.collection import Catalogue
from geoerr.fit.periods import place_of_period
from geoerr.terms import Parameter, Term


def beside_held(found: Sequence[Found], held: Sequence[Term], known: Catalogue, functions: Functions) -> list[Found]:
    """Give what was found; a wave that the model has by its name there, another one by a name that is free.

    Parameters
    ----------
    held
        The terms of that model.
    """
    own = {term.id: term for term in held}
    waves = {place: wave for place, one in enumerate(found) if (wave := _Wave.of(one, known, functions)) is not None}
    waves = {place: wave for place, wave in waves.items() if not own.keys().isdisjoint(wave.effects)}
    taken = {str(reference_of(one.judged)) for place, one in enumerate(found) if place not in waves}
    given: dict[int, str] = {}
    for has_it in (True, False):
        for place, wave in waves.items():
            fits = (
                name
                for name in wave.effects
                if name not in taken and (name in own and wave.is_more_of(own[name]) if has_it else name not in own)
            )
            if place not in given and (name := next(fits, None)) is not None:
                given[place] = name
                taken.add(name)
    if len(given) < len(waves):
        # More waves than there are names for: as they were found no two have one.
        return list(found)
    return [
        one if place not in given else by_name_of(one, waves[place].effects[given[place]])
        for place, one in enumerate(found)
    ]


@dataclass(frozen=True)
class _Wave:
    """A wave that was found.

    Attributes
    ----------
    effects
        Those that it may be, by what they are called on its axis, in the order in which they are looked for.
    period
        The inner parameter.
    span
        How far what was measured reaches along it, in the period's unit.
    """

    effects: dict[str, Effect]
    period: Parameter
    span: float

    @classmethod
    def of(cls, found: Found, known: Catalogue, functions: Functions) -> _Wave | None:
        """Give it, or None of what is no wave."""
        candidate, term = candidate_of(found), found.at_last.term
        place = None if term is None else place_of_period(term)
        if term is None or place is None:
            return None
        period = term.inner[place]
        span = n_waves_in_some_form(functions, candidate, term) * period.value
        turns = in_turn(candidate.effect, known)
        names = [str(replace(candidate.reference, effect=effect.id)) for effect in turns]
        return cls(dict(zip(names, turns, strict=True)), period, span) if span > 0.0 else None

    def is_more_of(self, term: Term) -> bool:
        """Tell whether a term is this wave, maybe of another size."""
        periods = [one.value for one in term.inner if one.name == self.period.name]
        return any(abs(self.span / period - self.span / self.period.value) < 1.0 for period in periods)
