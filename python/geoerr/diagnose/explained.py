"""What a candidate of a diagnosis would explain of every residual."""

from __future__ import annotations

from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.findings import Finding, Unknown
from geoerr.diagnose.search import Settled, reference_of, settle
from geoerr.diagnose.where import displacement_um
from geoerr.errors import GeoerrError
from geoerr.fit.sightings import Numbers


def explained_um(diagnosis: Diagnosis, what: Finding | Unknown) -> Numbers:
    """Give the part of the residuals that something would explain: (n, 3), µm in base axes, rows as in the fit.

    Of an effect it is what neither the model nor the other effects that were found can do: `worth_um` is its root
    mean square.

    Raises
    ------
    GeoerrError
        for a finding of another diagnosis.
    """
    settled = _settled(diagnosis, what)
    return displacement_um(settled.space, settled.displacement)


def _settled(diagnosis: Diagnosis, what: Finding | Unknown) -> Settled:
    searched = diagnosis.searched
    if isinstance(what, Unknown):
        if searched.unknown is None:
            raise GeoerrError("this diagnosis found nothing without a name")
        return searched.unknown.at_last
    for found in searched.found:
        if reference_of(found.judged) == what.reference:
            return found.at_last
        for rival in found.rivals:
            if reference_of(rival.judged) == what.reference:
                return searched.rivals_at_last(found, [rival])[0]
    first = searched.first
    for judged in first.candidates:
        if reference_of(judged) == what.reference:
            return settle(first.space, first.scanner, judged)
    raise GeoerrError(f"{what.reference} is no candidate of this diagnosis")
