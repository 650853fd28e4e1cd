"""The catalogue: built-in effects, a user's own beside them, and what is mistaken for what."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path

from geoerr.effects.check import check_effect
from geoerr.effects.definitions import pair_of
from geoerr.effects.description import Description, Rival, Twin
from geoerr.effects.effect import Effect
from geoerr.effects.places import line_of
from geoerr.effects.read import read_descriptions
from geoerr.errors import InputFileError
from geoerr.terms import EffectReference, TermSource, parse_effect_reference

# The order of the families is the order of the documentation.
FAMILIES = ("classic", "reversal", "drive", "dynamic", "thermal", "structure", "setup", "rig", "circle")


@dataclass(frozen=True)
class Catalogue:
    """Effects by id, in order.

    Attributes
    ----------
    effects
        Id to effect.
    """

    effects: Mapping[str, Effect] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.effects)

    def __iter__(self) -> Iterator[Effect]:
        return iter(self.effects.values())

    def __contains__(self, name: object) -> bool:
        return name in self.effects

    def __getitem__(self, name: str) -> Effect:
        """Give an effect by id.

        Raises
        ------
        InputFileError
            if there is none of that id; the nearest ids are named.
        """
        if name in self.effects:
            return self.effects[name]
        raise InputFileError(name, "no effect has this id", remedy=self._meant(name))

    def _meant(self, name: str) -> str:
        """Say which effects a name that none has may be meant for: by spelling, or by a word of id or title."""
        near = difflib.get_close_matches(name, self.effects, n=3, cutoff=0.6)
        words = [one.id for one in self if len(name) > 2 and (name in one.id.split("-") or name in one.title.lower())]
        found = list(dict.fromkeys([*near, *words]))[:4]
        if found:
            return f"did you mean {' or '.join(found)}?"
        nearest = difflib.get_close_matches(name, self.effects, n=3, cutoff=0.0)
        return (
            f"nearest are {', '.join(nearest)}; docs/catalogue.md lists all, --effects FILE adds your own, of a farm "
            "the effects.toml in the machine's folder"
        )

    def resolve(self, reference: str | EffectReference) -> tuple[Effect, EffectReference]:
        """Give the effect of a reference, and the reference as reports write it.

        Raises
        ------
        InputFileError
            if it cannot be read, or names no effect, or an axis or covariate that the effect is not for.
        """
        parsed = parse_effect_reference(reference) if isinstance(reference, str) else reference
        effect = self[parsed.effect]
        return effect, effect.checked_reference(parsed.axis, parsed.covariate)

    def extended(self, effects: Iterable[Effect], path: str | Path) -> Catalogue:
        """Give a catalogue with more effects.

        Raises
        ------
        InputFileError
            if an id is taken, or an effect names one that neither holds; `path` is named.
        """
        joined = dict(self.effects)
        added = tuple(effects)
        for number, effect in enumerate(added, start=1):
            if effect.id in joined:
                kind = "a built-in effect" if joined[effect.id].origin == "built-in" else "an effect read before"
                raise InputFileError(
                    path,
                    f"is the id of {kind}",
                    row=line_of(path, number, "id"),
                    column=f"effect {effect.id!r}: id",
                    remedy=f"give yours another id, for example own-{effect.id}",
                )
            joined[effect.id] = effect
        for number, effect in enumerate(added, start=1):
            for key, names in _mentioned(effect).items():
                for name in names:
                    if name not in joined:
                        raise InputFileError(
                            path,
                            f"{name!r} is the id of no effect",
                            row=line_of(path, number, key),
                            column=f"effect {effect.id!r}: {key}",
                            remedy="check the spelling; docs/catalogue.md lists the built-in ids",
                        )
        return Catalogue(joined)

    def rivals(self, name: str) -> tuple[Rival, ...]:
        """Give what an effect is mistaken for, also where only the other effect says so."""
        effect = self[name]
        found = {rival.effect or rival.what: rival for rival in effect.mistaken_for}
        for other in self:
            for rival in other.mistaken_for:
                if rival.effect == name and other.id not in found and other.id != name:
                    found[other.id] = Rival(other.id, None, rival.separate_by, rival.plan, rival.minutes)
        return tuple(found.values())

    def separation(self, first: str, second: str) -> Rival | None:
        """Give the measurement that separates two effects, whichever of them names it; None where neither does."""
        return next((rival for rival in self.rivals(first) if rival.effect == second), None)

    def twins(self, name: str) -> tuple[Twin, ...]:
        """Give the effects that are the same by construction, also where only the other says so."""
        found = {twin.effect: twin for twin in self[name].twins}
        for other in self:
            for twin in other.twins:
                if twin.effect == name:
                    found.setdefault(other.id, Twin(other.id, twin.why))
        return tuple(found.values())

    def are_twins(self, first: EffectReference, second: EffectReference) -> bool:
        """Tell whether two candidates are the same by construction: declared twins of one axis and one covariate.

        A direction of the tool or the work counts as its axis; a candidate without an axis is of every axis.
        """
        if second.effect not in {twin.effect for twin in self.twins(first.effect)}:
            return False
        axes = [pair_of(reference.axis)[0] for reference in (first, second)]
        same_axis = None in axes or axes[0] == axes[1]
        return same_axis and first.covariate == second.covariate


@cache
def catalogue() -> Catalogue:
    """Give the built-in catalogue."""
    joined: list[Effect] = []
    folder = files("geoerr.effects")
    for family in FAMILIES:
        with as_file(folder / f"{family}.toml") as path:
            joined += _read(path, "built-in")
    return Catalogue().extended(joined, "geoerr.effects")


def load_effects(path: str | Path) -> tuple[Effect, ...]:
    """Read and check a user's effects file.

    Raises
    ------
    InputFileError
        if the file or an effect in it is wrong, or takes a built-in id; names file, effect, key and remedy.
    """
    effects = _read(path, "user")
    catalogue().extended(effects, path)
    return effects


def load_catalogue(paths: Iterable[str | Path]) -> Catalogue:
    """Give the built-in catalogue with the effects of a user's files; an id stands in one file only.

    Raises
    ------
    InputFileError
        as `load_effects`.
    """
    joined = catalogue()
    for path in paths:
        joined = joined.extended(_read(path, "user"), path)
    return joined


def _read(path: str | Path, origin: TermSource) -> tuple[Effect, ...]:
    found = []
    for number, description in enumerate(read_descriptions(path, origin), start=1):
        values = {item.name: getattr(description, item.name) for item in fields(Description)}
        effect = Effect(**values)
        check_effect(effect, path, number)
        found.append(effect)
    return tuple(found)


def _mentioned(effect: Effect) -> dict[str, list[str]]:
    return {
        "mistaken_for": [rival.effect for rival in effect.mistaken_for if rival.effect is not None],
        "twins": [twin.effect for twin in effect.twins],
        "contains": list(effect.contains),
        "offered_as": [] if effect.offered_as is None else [effect.offered_as],
        "again": [] if effect.again is None else [effect.again],
    }
