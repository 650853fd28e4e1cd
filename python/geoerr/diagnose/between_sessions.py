"""Whether the machine is another one from session to session: guideways that came out of square between them.

A machine that was knocked or levelled between two sessions is no effect of a catalogue, and has images: a change of
depth of cameras whose frames are turned differently, a tilt that follows a temperature which differs between the
sessions. So beside whatever was found squareness of each session is tried, and told where it lets the held-out error
fall.

Verified in `tests/diagnose/test_between_sessions.py`, on machines that changed and on machines that did not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from geoerr.diagnose.answer import held_out_um, with_terms
from geoerr.effects import catalogue
from geoerr.errors import GeoerrError
from geoerr.fit import Fitted
from geoerr.summaries import listed
from geoerr.terms import Parameter, Term

_PLANES = ("xy", "xz", "yz")
# By so much the held-out error has to fall, and so many standard errors away from nothing a change has to be.
_FALLS, _STANDARD_ERRORS = 0.97, 4.0
_URAD_PER_RAD = 1e6


@dataclass(frozen=True)
class SquarenessChange:
    """Squareness that differs between sessions, beside what was found.

    Attributes
    ----------
    changes
        Plane, session and change since the first session, in radians with its standard error.
    before_um, after_um
        Held-out error beside what was found, and with these changes too.
    """

    changes: tuple[tuple[str, str, float, float], ...]
    before_um: float
    after_um: float

    @property
    def sentence(self) -> str:
        """Give it in words, without a full stop."""
        own = [
            f"{plane} by {_URAD_PER_RAD * value:.1f} ± {_URAD_PER_RAD * std:.1f} µrad in {session!r}"
            for plane, session, value, std in self.changes
        ]
        return (
            "the machine is another one from session to session: since the first its squareness has changed in "
            f"{listed(own)}. Held-out rows are off by {self.after_um:.3g} µm with that, and with all that is named "
            f"here by {self.before_um:.3g} µm, which may be no more than its image: fit each session by itself, and "
            "hold the model of one against the other"
        )


def squareness_change(fitted: Fitted, found: Sequence[Term | None]) -> SquarenessChange | None:
    """Give how squareness differs between sessions, where that explains more than what was found; else None."""
    sessions = fitted.sightings.sessions
    if len(sessions) < 2 or "circle" in fitted.sightings.frames:
        return None
    effect = replace(catalogue()["squareness"], id="squareness-by-session", is_classic=False, each_session=True)
    terms = [effect.term(plane, None, fitted.machine, n_sessions=len(sessions)) for plane in _PLANES]
    try:
        beside = with_terms(fitted, found)
        changed = with_terms(beside, terms)
    except GeoerrError:
        # Too little was measured for that.
        return None
    before_um, after_um = held_out_um(beside), held_out_um(changed)
    if before_um is None or after_um is None or not after_um < _FALLS * before_um:
        return None
    own = {term.id: term for term in changed.terms}
    changes = [
        (plane, sessions[int(one.name.rpartition("_")[2])], one.value, one.std)
        for plane, term in zip(_PLANES, terms, strict=True)
        for one in own[term.id].coefficients
        if _is_seen(one)
    ]
    return SquarenessChange(tuple(changes), before_um, after_um) if changes else None


def _is_seen(one: Parameter) -> bool:
    return abs(one.value) > _STANDARD_ERRORS * one.std
