"""Bases chosen again, once what was missing is known.

The freedom of an error function is weighed against the scatter. A missing effect of a hundred micrometres is scatter:
functions that are chosen in it are too stiff, and leave a micrometre of themselves, which looks like a wave once the
effect is known; or they follow the effect with knots that the machine does not need.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from geoerr.fit.beside_effects import on_bases, with_inner_held
from geoerr.fit.classic import knot_places_by_axis, rich_bases
from geoerr.fit.fitted import Fitted
from geoerr.fit.knots import Ladder, choose_bases
from geoerr.fit.run_away import run_away
from geoerr.fit.sightings import Sightings
from geoerr.fit.wavy import beside_waves
from geoerr.terms import BasisSpec, Term

# Where the error fell by this factor, what was chosen before is chosen again.
_FELL = 1.3


def is_worth_asking(before: float | None, after: float | None) -> bool:
    """Tell whether an error fell so far that the scatter in which bases were chosen was not the noise."""
    return before is not None and after is not None and before > _FELL * after


def choose_again(fitted: Fitted, earlier: Sightings | None = None) -> tuple[Term, ...] | None:
    """Give a fit's terms on the bases that its data choose beside its effects; None where these are the same.

    A basis that `fit_terms` would not choose from was given, and stays.

    Parameters
    ----------
    earlier
        Rows that the bases may have been chosen with, where they were others.
    """
    sightings = fitted.sightings
    positions = knot_places_by_axis(sightings)
    own = {term.id: basis for term in fitted.terms if (basis := _basis_of(term)) is not None}
    richest = rich_bases(sightings, list(own), positions)
    ladder = Ladder(positions)
    may_change = _chosen_from(ladder, richest, own)
    if earlier is not None:
        of_earlier = knot_places_by_axis(earlier)
        may_change |= _chosen_from(Ladder(of_earlier), rich_bases(earlier, list(own), of_earlier), own)
    rich = {name: basis for name, basis in richest.items() if name in may_change}
    if not rich:
        return None
    effects = [term for term in fitted.terms if term.kind != "classic"]
    by_id = {term.id: term for term in fitted.terms}
    rich = {name: beside_waves(by_id[name], basis, effects, positions) for name, basis in rich.items()}
    # A period beside functions that follow anything is hardly determined: fitted along it would creep for many steps.
    terms = on_bases([with_inner_held(term) for term in fitted.terms], rich)
    # On the rows that were found not to be gross.
    free = fitted.again(terms, used=fitted.solved.used)
    if run_away(free):
        free = fitted.again(terms, used=fitted.solved.used, one_step=True)
    if not math.isfinite(free.scale):
        # So much freedom leaves nothing over to choose by.
        return None
    undecided = [term for term in terms if term.id in rich]
    chosen = choose_bases(
        undecided, free.terms, free.covariance_by_scatter, free.null_space, positions, ladder=ladder
    )
    new = {one.name: one.basis for one in chosen if one.basis != own[one.name]}
    return on_bases(fitted.terms, new) if new else None


def _chosen_from(ladder: Ladder, richest: Mapping[str, BasisSpec], own: Mapping[str, BasisSpec]) -> set[str]:
    """Name the functions whose bases are among those that `fit_terms` chooses from."""
    return {name for name, basis in richest.items() if own[name] in ladder.splines(name, basis)}


def _basis_of(term: Term) -> BasisSpec | None:
    """Give the basis of an error function; None of any other term."""
    return term.parts[0].basis if term.kind == "classic" else None
