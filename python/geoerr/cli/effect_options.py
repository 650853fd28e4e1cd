"""`--effects own.toml` and `--add ID[:AXIS][@COVARIATE]`: references on the command line become terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from geoerr.effects import load_catalogue
from geoerr.errors import InputFileError
from geoerr.fit import Components, Sightings
from geoerr.fit.additions import refuse_wanting, usual_terms
from geoerr.fit.classic import names_of
from geoerr.machine import Machine
from geoerr.terms import SQUARENESS_CHANNELS, Term


@dataclass(frozen=True)
class Addition:
    """An effect that was asked for: its reference as reports write it, its title, its terms."""

    reference: str
    title: str
    terms: tuple[Term, ...]


def additions(
    references: Sequence[str],
    effect_files: Sequence[Path],
    machine: Machine,
    sightings: Sightings,
    components: Components,
) -> list[Addition]:
    """Give the effects that references name, as terms whose values are unknown.

    Parameters
    ----------
    references
        As the user wrote them.
    effect_files
        A user's own effects, beside the built-in ones.
    machine
        For ranges, sides and the reference temperature.
    sightings
        The data: they must hold the columns that an effect needs.
    components
        Classic errors of the model: one of them is not added a second time.

    Raises
    ------
    InputFileError
        for a reference that names no effect, or a column that the data do not have, or what the model holds already.
    """
    known = load_catalogue(effect_files)
    held = {*names_of(components), *(() if components == "none" else SQUARENESS_CHANNELS)}
    added: list[Addition] = []
    for text in references:
        effect, reference = known.resolve(text)
        refuse_wanting(effect, reference, sightings)
        one = Addition(str(reference), effect.title, usual_terms(effect, reference, machine, sightings))
        channels = [channel for term in one.terms for channel in term.channels]
        if effect.is_classic and held.issuperset(channels):
            raise InputFileError(
                text,
                f"is in the model already, among its {components} components: {', '.join(channels)}",
                remedy="leave it out, or fit it with --components none",
            )
        names = {term.id for other in added for term in other.terms}
        if names.intersection(term.id for term in one.terms):
            raise InputFileError(text, "is added twice", remedy="name it once")
        added.append(one)
    return added
