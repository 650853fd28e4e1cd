"""Errors that ran away in a fit: less certain than errors of machines are large."""

from __future__ import annotations

from geoerr.fit.fitted import Fitted

# A standard uncertainty beyond this is no knowledge of a machine's error: 3 mm, 20 mrad.
_ABSURD = {"mm": 3.0, "rad": 0.02}


def run_away(fitted: Fitted) -> frozenset[str]:
    """Name them (ISO); none of a fit that may be used."""
    return frozenset(
        term.id
        for term in fitted.terms
        if term.kind == "classic" and any(one.std > _ABSURD[one.unit] for one in term.coefficients)
    )
