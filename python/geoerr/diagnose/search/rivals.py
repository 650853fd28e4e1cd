"""What else might explain the same: how alike two candidates are, and whether these data tell them apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoerr.diagnose.scan import seen
from geoerr.diagnose.search.best_form import in_form_of
from geoerr.diagnose.search.judged import Judged, freedom_of, price_of
from geoerr.diagnose.search.look import Round
from geoerr.diagnose.search.settle import Settled, explained_share, settle
from geoerr.diagnose.search.together import Together, together
from geoerr.diagnose.space import Space
from geoerr.effects.collection import Catalogue
from geoerr.fit.sightings import Numbers
from geoerr.terms import CLOCK_NAME, Term

# Alike so far, an error of a formula of a seventh would decide between the two; with more freedom it is no rival, it
# contains it, unless it follows another course.
_TOO_ALIKE = 0.99
# Vuong's statistic below this, and a correlation above that: not told apart (one in twenty, one-sided).
_VUONG, _LEAST_CORRELATION = 1.64, 0.5
# Falls of the sum of squares that differ by less than 6 are e^3 in likelihood, which is little; by 20, decided.
_LEAST_DIFFERENCE, _MOST_DIFFERENCE = 6.0, 20.0
_TIMES = {"t", CLOCK_NAME}
# Candidates that are looked at closely.
_CLOSELY = 12


def vuong(space: Space, first: Numbers, second: Numbers) -> float:
    """Give Vuong's statistic by pass: how surely the first displacement (n, 3) is the better of two."""
    difference = (space.residual - second) ** 2 - (space.residual - first) ** 2
    by_pass = np.bincount(space.pass_number, weights=difference.sum(axis=1), minlength=space.n_passes)
    spread = float(np.sqrt(((by_pass - by_pass.mean()) ** 2).sum()))
    return float(by_pass.sum()) / spread if spread > 0.0 else 0.0


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
        By how much less the sum of squares falls with it than with the best, in one noise.
    together
        Axes whose effects of this kind do only together what the best does, this one among them; their correlation is
        meant. Empty where it stands for itself.
    """

    judged: Judged
    settled: Settled
    correlation: float
    is_tied: bool
    contains: bool
    behind: float
    together: tuple[str, ...] = ()


def rivals_of(looked: Round, known: Catalogue, first: Judged, best: Settled) -> list[Rival]:
    """Look closely at the next best candidates, and at those that do only together what the best does."""
    others = [one for one in looked.candidates if one.what is not first.what]
    if first.evidence <= 0.0:
        # Its rivals are what chance does not explain either, and their numbers cost as much.
        others.sort(key=lambda one: -one.surprise)
    company = {
        id(member): one
        for one in together(looked, known, first, best)
        if _is_close(one.correlation, best.gain - one.gain)
        for member in one.members
    }
    near = others[:_CLOSELY]
    near += [one for one in others[_CLOSELY:] if id(one) in company]
    return [_rival(looked, first, best, other, company.get(id(other))) for other in near]


def _rival(looked: Round, first: Judged, best: Settled, judged: Judged, company: Together | None) -> Rival:
    is_far = best.gain - judged.gain > 4.0 * _MOST_DIFFERENCE and best.gain > 2.0 * judged.gain
    settled = _unrefined(looked, judged) if is_far else settle(looked.space, looked.scanner, judged)
    if best.term is not None and not is_far:
        judged, settled = in_form_of(best.term, looked, judged, settled)
    # Where it was scanned its affine values are free; where it was settled the others are at their best.
    alike = max(
        explained_share(best, seen(looked.space, looked.scanner.raw_columns(shapes, trial)))
        for shapes, trial in ((judged.shapes, judged.trial), (settled.shapes, 0))
    )
    # In twice the logarithm of the evidence: what has more freedom has to earn it.
    behind = best.gain - settled.gain
    difference = behind + price_of(first) - price_of(judged)
    z = vuong(looked.space, best.displacement, settled.displacement)
    is_near = difference < _LEAST_DIFFERENCE or (difference < _MOST_DIFFERENCE and z < _VUONG)
    is_wider = freedom_of(judged) > freedom_of(first) and difference > 0.0
    contains = alike > _TOO_ALIKE and is_wider and not _is_another_cause(judged, first)
    is_too_alike = alike > _TOO_ALIKE and not is_wider
    tied = not contains and (is_too_alike or (alike > _LEAST_CORRELATION and is_near))
    if company is not None and not tied and not contains:
        return Rival(judged, settled, company.correlation, True, False, behind, company.axes)
    return Rival(judged, settled, alike, tied, contains, behind)


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


def _is_close(alike: float, difference: float) -> bool:
    return alike > _TOO_ALIKE or (alike > _LEAST_CORRELATION and difference < _LEAST_DIFFERENCE)


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
    beside_others
        The same beside all that was found, in the noise that all of it leaves; None while the search goes on.
    """

    judged: Judged
    settled: Settled
    rivals: tuple[Rival, ...]
    looked: Round
    beside_others: Settled | None = None

    @property
    def at_last(self) -> Settled:
        """What it explains beside the others.

        When it was found it was itself a part of the noise: what a play does to a pass counted as the pass's offset,
        and in a session of few passes more was to be explained than had been measured.
        """
        return self.beside_others or self.settled
