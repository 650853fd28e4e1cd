"""What else might explain the same: how alike two candidates are, and whether these data tell them apart."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from geoerr.diagnose.candidates import Candidate, Shapes
from geoerr.diagnose.scan import seen
from geoerr.diagnose.search.beside_each import BesideEach, vuong
from geoerr.diagnose.search.best_form import in_form_of
from geoerr.diagnose.search.judged import Judged, freedom_of, price_of, reference_of
from geoerr.diagnose.search.look import Round
from geoerr.diagnose.search.settle import Settled, explained_share, settle
from geoerr.diagnose.search.together import Together, together
from geoerr.diagnose.ties import MOST_DIFFERENCE, TOO_ALIKE, is_as_good
from geoerr.effects.collection import Catalogue
from geoerr.fit.sightings import Numbers
from geoerr.terms import CLOCK_NAME, Term

_TIMES = {"t", CLOCK_NAME}
# Candidates that are looked at closely.
_CLOSELY = 12


@dataclass(frozen=True, eq=False)
class Rival:
    """A candidate beside the best: how alike they are, and whether these data tell them apart.

    Attributes
    ----------
    judged, settled
        The candidate.
    correlation
        Share, as a cosine, of what the best explains that this one could have explained.
    is_tied
        Whether these data do not tell them apart.
    contains
        Whether it says what the best says, with more freedom: no rival, but the best written otherwise.
    behind
        By how much less the sum of squares falls with it than with the best, in one noise; where that leaves it open
        which of the two it is, by how much twice the logarithm of the likelihood does, in the noise beside each.
    together
        Axes whose effects of this kind do only together what the best does, this one among them; their correlation is
        meant. Empty where it stands for itself.
    columns_together : (n, 3, k)
        Their columns, in units of the stated uncertainties.
    """

    judged: Judged
    settled: Settled
    correlation: float
    is_tied: bool
    contains: bool
    behind: float
    together: tuple[str, ...] = ()
    columns_together: Numbers | None = None

    def is_of_company_of(self, other: Rival) -> bool:
        """Tell whether the other one does what the best does only together with this one, and others maybe."""
        own, theirs = (reference_of(one.judged) for one in (self, other))
        return own.axis in other.together and replace(own, axis=theirs.axis) == theirs

    def is_twin_of(self, found: Found) -> bool:
        """Tell whether its effect, on some axis, is one with what was found by construction."""
        own, theirs = self.judged.what, reference_of(found.judged)
        twins = [twin.effect for twin in own.effect.twins] if isinstance(own, Candidate) else []
        return theirs.effect in twins and theirs.covariate == reference_of(self.judged).covariate


def rivals_of(looked: Round, known: Catalogue, first: Judged, best: Settled, beside_each: BesideEach) -> list[Rival]:
    """Look closely at the next best candidates, and at those that do only together what the best does."""
    others = [one for one in looked.candidates if one.what is not first.what]
    if first.evidence <= 0.0:
        # Its rivals are what chance does not explain either, and their numbers cost as much.
        others.sort(key=lambda one: -one.surprise)
    company = {
        id(member): one
        for one in together(looked, known, first, best)
        if _does_as_much(one, best, beside_each)
        for member in one.members
    }
    near = others[:_CLOSELY]
    near += [one for one in others[_CLOSELY:] if id(one) in company]
    return [_rival(looked, first, best, other, company.get(id(other)), beside_each) for other in near]


def _rival(
    looked: Round,
    first: Judged,
    best: Settled,
    judged: Judged,
    company: Together | None,
    beside_each: BesideEach,
) -> Rival:
    is_far = best.gain - judged.gain > 4.0 * MOST_DIFFERENCE and best.gain > 2.0 * judged.gain
    settled = _unrefined(looked, judged) if is_far else settle(looked.space, looked.scanner, judged)
    if best.term is not None and not is_far:
        judged, settled = in_form_of(best.term, looked, judged, settled)
    at_trial, at_best = (
        explained_share(best, seen(looked.space, looked.scanner.raw_columns(shapes, trial)))
        for shapes, trial in _compared_at(judged, settled)
    )
    alike = max(at_trial, at_best)
    behind = best.gain - settled.gain
    # In twice the logarithm of the evidence: what has more freedom has to earn it.
    price = price_of(first) - price_of(judged)
    z = vuong(looked.space, best.displacement, settled.displacement)
    is_wider = freedom_of(judged) > freedom_of(first)
    # Its columns with values that it cannot have are not what it does.
    is_too_alike = at_best > TOO_ALIKE and not is_wider
    contains = alike > TOO_ALIKE and is_wider and behind + price > 0.0 and not _is_another_cause(judged, first)
    tied = not contains and (is_too_alike or is_as_good(alike, behind + price, z))
    if tied and not is_too_alike:
        behind, z = beside_each.behind(best, settled)
        tied = is_as_good(alike, behind + price, z)
    if company is not None and not tied and not contains:
        return Rival(judged, settled, company.correlation, True, False, behind, company.axes, company.columns)
    return Rival(judged, settled, alike, tied, contains, behind)


def _compared_at(judged: Judged, settled: Settled) -> tuple[tuple[Shapes, int], tuple[Shapes, int]]:
    """Give where it was scanned, its affine values free, and where it was settled, the others at their best."""
    return (judged.shapes, judged.trial), (settled.shapes, 0)


def _does_as_much(company: Together, best: Settled, beside_each: BesideEach) -> bool:
    """Tell whether effects of single axes do together what the best does, whatever so many numbers cost."""
    if company.correlation > TOO_ALIKE:
        return True
    alike, behind = company.correlation, best.gain - company.gain
    if not is_as_good(alike, behind, math.inf):
        return False
    return is_as_good(alike, beside_each.behind_with(best, company.columns), math.inf)


def _is_another_cause(judged: Judged, first: Judged) -> bool:
    """Tell whether a candidate that says the same with more freedom is another cause all the same.

    The machine's where the first is the cameras', or the cameras': one is to be compensated, the other never. With a
    number more; what has ten is like anything.
    """
    one, other = judged.shapes.term, first.shapes.term
    if one is None or other is None:
        return False
    is_next = freedom_of(judged) <= freedom_of(first) + 1
    return _is_another_course(one, other) or (is_next and one.is_rig != other.is_rig)


def _is_another_course(one: Term, other: Term) -> bool:
    """Tell whether an effect follows time or a column, and not all that the other one follows.

    Temperatures rise together, and with time: that warming up goes as a temperature did is no coincidence, and though
    it has a number more than the drift with that temperature it is another cause. That a jump in time falls between
    two passes, and does what a play would, is a coincidence.
    """
    follows, first_follows = _courses(one), _courses(other)
    return bool(follows) and not first_follows <= follows


def _courses(term: Term) -> set[str]:
    return {*term.needs, *(_TIMES & {*term.variables})}


def _unrefined(looked: Round, judged: Judged) -> Settled:
    """Give a candidate as the trial found it: for one that is far behind the digits do not matter."""
    if judged.shapes.term is None:
        return settle(looked.space, looked.scanner, judged)
    return settle(looked.space, looked.scanner, judged, refinements=0)


@dataclass(frozen=True, eq=False)
class Found:
    """What the search added: an effect, or structure without a name.

    Attributes
    ----------
    judged, settled
        The effect, as it was found.
    rivals
        What came next; of what has no name there are none.
    looked
        The look that found it.
    as_good
        Of a wave, other periods that explain as much.
    compared
        It in the space of the look, as rivals are compared with it; of what has no name None.
    beside_others
        The same beside all that was found, in the noise that all of it leaves; None while the search goes on.
    """

    judged: Judged
    settled: Settled
    rivals: tuple[Rival, ...]
    looked: Round
    as_good: tuple[float, ...] = ()
    compared: Settled | None = None
    beside_others: Settled | None = None

    @property
    def at_last(self) -> Settled:
        """What it explains beside the others.

        When it was found it was itself a part of the noise: what a play does to a pass counted as the pass's offset,
        and in a session of few passes more was to be explained than had been measured.
        """
        return self.beside_others or self.settled

    def compared_with(self, rival: Rival) -> tuple[Numbers, tuple[Numbers, ...]]:
        """Give what it explains (3 n,), and what a rival can do (3 n, k), orthonormal off the model.

        In the space of the look: at the rival's trial, and at its best values; what it does only with others, once.
        """
        assert self.compared is not None
        if rival.columns_together is not None:
            could = [seen(self.looked.space, rival.columns_together)]
        else:
            could = [
                seen(self.looked.space, self.looked.scanner.raw_columns(shapes, trial))
                for shapes, trial in _compared_at(rival.judged, rival.settled)
            ]
        return self.compared.displacement.reshape(-1), tuple(one.whitened @ one.root for one in could)
