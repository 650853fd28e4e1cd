"""Why a candidate was looked at and left: what the last look, beside all that was found, has of it."""

from __future__ import annotations

from geoerr.diagnose.search.judged import ALPHA, Judged, reference_of
from geoerr.diagnose.search.rounds import FURTHER, MOST_EFFECTS, Searched


def why_left(searched: Searched, judged: Judged) -> str | None:
    """Give the reason, without a full stop; None where the search knows none."""
    reference, last = reference_of(judged), searched.last
    if reference in searched.dropped:
        return searched.dropped[reference]
    is_beside = bool(searched.found) or searched.unknown is not None
    beside = " beside what was found" if is_beside else ""
    if any(one.reference == reference for one in last.invisible):
        return f"nothing of it is left{beside}"
    now = next((one for one in last.candidates if reference_of(one) == reference), None)
    if now is None:
        return "only with the sign that physics does not give it"
    if now.p_value > 0.5 * ALPHA:
        return f"no more than chance{beside}"
    if now.p_value > 0.5 * ALPHA * FURTHER and is_beside:
        return f"not sure enough{beside}"
    if now.evidence <= 0.0:
        return f"explains too little{beside} for so many numbers"
    if len(searched.found) >= MOST_EFFECTS:
        return f"{MOST_EFFECTS} effects were found, and no more are looked for"
    return None if searched.unknown is None else "may be a part of what has no name"
