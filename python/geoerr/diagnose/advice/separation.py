"""Which measurement tells candidates apart that the data cannot: the shortest plan that would, by expected Δχ²."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.advice.columns import Terms, poses_of
from geoerr.diagnose.advice.families import Company, Family, family_of, joined
from geoerr.diagnose.advice.information import Information, Measured, expected, measured
from geoerr.diagnose.advice.measurement import Measurement
from geoerr.diagnose.advice.menu import menu
from geoerr.diagnose.advice.planned import noise_of, planned
from geoerr.diagnose.advice.question import Question, question_of
from geoerr.diagnose.advice.score import Candidates, Truths, is_believable
from geoerr.diagnose.advice.situation import Situation, situation_of
from geoerr.diagnose.findings import Separation
from geoerr.diagnose.space import Space
from geoerr.fit.sightings import Numbers
from geoerr.summaries import listed
from geoerr.terms import SESSION_NAME, Term

# The search takes a difference of χ² of 20 as decided. It scatters by 2√λ about its expectation λ: with λ = 41 it
# exceeds 20 in 19 of 20.
MARGIN = 41.0
# Candidates whose correlation is higher than this count as one, however much data there are. The noise is estimated
# anew with what was measured, and the share of an effect that another leaves is then another by 3 to 8 %: 0.94 is
# 0.95 with a fifth to spare.
_ALIKE, _SURELY_UNLIKE = 0.95, 0.94
# Of what some plan would separate the chosen one separates so much: nine cases of ten.
_ENOUGH = 0.9
_LITTLE_MORE = 1.3
# How often a plan may be carried out, and how long all may take.
_TIMES = (1, 2, 4)
MOST_MINUTES = 120.0
# Pairs of plans are tried among so many.
_PAIRED = 8
_ALTERNATIVES = 3


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another measurement that would do: what to do, how long it takes, the expected Δχ² as for the chosen one."""

    text: str
    plan: str
    minutes: float
    expected_delta_chi2: float


@dataclass(frozen=True)
class Advice(Separation):
    """The measurement that would tell candidates apart, computed for the data at hand.

    Attributes
    ----------
    text
        What has to differ, in a few words; or that nothing in the menu would do.
    plan
        What to do, in sentences with durations; None where nothing would do.
    minutes
        Of machine time, with what it takes to prepare.
    expected_delta_chi2
        By which the right candidate is expected to fit better than the other one that comes nearest: in the middle
        of the cases, of what may be true by these data and can be told apart at all.
    separated_share
        Of these cases, how many reach the margin.
    same_again_delta_chi2
        The same as `expected_delta_chi2` for as much of the same data again.
    measurements
        The plan as it can be carried out: measurements in their order, each with how often.
    contained
        Pairs of which the first, if it is true, is imitated by the second in everything that could be measured: where
        the second shows nothing of its own, the simpler first one stands.
    alternatives
        Other plans that would do.
    still_alike
        Pairs, a truth and another, that are expected to correlate by more than 0.95 after it, and by how much: the
        data that there are weigh more than what any plan of two hours adds.
    """

    expected_delta_chi2: float | None = None
    separated_share: float | None = None
    same_again_delta_chi2: float | None = None
    measurements: tuple[tuple[Measurement, int], ...] = ()
    contained: tuple[tuple[str, str], ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    still_alike: tuple[tuple[str, str, float], ...] = ()

    @property
    def is_enough(self) -> bool:
        """Whether it separates nearly all cases that can be told apart."""
        return self.separated_share is not None and self.separated_share >= _ENOUGH


# Two plans one after another, each with how often.
_Pair = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True, eq=False)
class _Option:
    """Plans, each with how often.

    Attributes
    ----------
    left, share : (n_families, n_truths)
        What every other candidate leaves of every truth, and as a share of all of it: 1 − their squared correlation.
    """

    plans: tuple[tuple[int, int], ...]
    minutes: float
    left: Numbers
    share: Numbers


@dataclass(frozen=True, eq=False)
class _Goal:
    """What a plan should reach.

    Attributes
    ----------
    margin
        Of the expected Δχ².
    reachable, share : (n_families, n_truths)
        Cases in which some plan reaches the margin; the share that is to be left there, 0 where any will do.
    """

    margin: float
    reachable: np.ndarray
    share: Numbers

    def is_met(self, option: _Option) -> np.ndarray:
        """Tell in which cases an option does what can be done, (n_families, n_truths)."""
        return np.asarray((option.left >= self.margin) & (option.share >= self.share) | ~self.reachable)


class Adviser:
    """A space with the candidates that it leaves tied, and everything of the data that plans are added to.

    Parameters
    ----------
    space
        What a fit leaves, with its noise.
    candidates
        The tied candidates, with the values that were found; one that can be written in several ways as a sequence
        of them, the one that fits best first; those that are one candidate only together as a `Company`.
    added
        Effects that the space counts as the model's own, besides the fit's.
    acceleration_mm_s2
        Of the axes, for how long moves take.

    Attributes
    ----------
    situation
        How this machine is measured.
    names
        Of the candidates.
    firsts
        Each in the form that fits best, those of a `Company` one after the other.
    """

    def __init__(
        self,
        space: Space,
        candidates: Sequence[Term | Sequence[Term] | Company],
        *,
        added: Sequence[Term] = (),
        acceleration_mm_s2: float | None = None,
        threads: int = 1,
    ) -> None:
        fitted = space.fitted
        poses = poses_of(fitted)
        self.situation: Situation = situation_of(fitted, space.noise, acceleration_mm_s2=acceleration_mm_s2)
        families: list[Family] = []
        terms: list[Term] = []
        for one in candidates:
            forms = _each_form(one)
            own = [
                family_of(fitted.machine, form, len(terms) + number, fitted.sightings, poses)
                for number, form in enumerate(forms)
            ]
            families.append(joined(own, one.id) if isinstance(one, Company) else own[0])
            terms += [term for form in forms for term in form]
        self.names = tuple(family.name for family in families)
        self.firsts = firsts_of(candidates)
        self.space = space
        self._candidates = Candidates(families)
        self._model = Terms(fitted.machine, (*fitted.terms, *added), with_inner=True)
        self._columns = Terms(
            fitted.machine, [copy for family in families for copy in family.terms], with_inner=False
        )
        prior = _prior(fitted.prior, self._model, fitted.compiled.n_coefficients)
        self._data: Measured = measured(space, self._model, self._columns, poses, prior, threads=threads)
        self._truths: Truths = self._candidates.truths(self._data)
        self._known: dict[int, tuple[Measurement, Information]] = {}
        self.plans: tuple[Measurement, ...] = tuple(_plans(self.situation, question_of(terms)))

    @property
    def gains(self) -> Numbers:
        """By how much each candidate, at its best, lets χ² of the data fall, (n,)."""
        return self._candidates.gains(self._data)

    def expected(self, plans: Sequence[tuple[Measurement, int]] = ()) -> Numbers:
        """Give the expected Δχ² of every pair with some plans carried out, (n, n): row the truth, column the other.

        The middle over what the truth may be by the data.
        """
        return self._middle(self._left(plans)[0])

    def correlations(self, plans: Sequence[tuple[Measurement, int]] = ()) -> Numbers:
        """Give how alike every pair is with some plans carried out, (n, n): row the truth, column the other.

        A cosine, off the model and in the noise of the space, in the middle over what the truth may be by the data.
        """
        left, whole = self._left(plans)
        return np.sqrt(np.clip(1.0 - self._middle(_share_of(left, whole)), 0.0, 1.0))

    def same_again(self) -> Numbers:
        """Give the same with as much of the same data again."""
        return self._middle(self._left_by_same()[0])

    def separation(
        self,
        among: Sequence[int] | None = None,
        *,
        margin: float = MARGIN,
        most_minutes: float = MOST_MINUTES,
    ) -> Advice:
        """Choose the shortest plan that tells candidates apart (all of them, if not said which).

        Every candidate may be true, at every value that explains the data as well as its best. Of those cases that
        some plan separates, the chosen one separates nine of ten: the expected Δχ² against every other candidate
        reaches the margin, and where some plan can do that the two are no longer alike (correlation below 0.95, and
        below 0.94 where that can be, to be sure of it). Where no plan does so in all cases, the one that does so in
        most.
        """
        among = range(len(self.names)) if among is None else among
        options = [
            self._option(((place, times),))
            for place, plan in enumerate(self.plans)
            for times in _TIMES
            if plan.minutes(times) <= most_minutes
        ]
        asked = self._asked(among)
        reachable = asked & np.any([one.left >= margin for one in options], axis=0)
        contained = self._contained(asked, reachable)
        if not reachable.any():
            return self._none(among, options, asked, contained)
        plain = _Goal(margin, reachable, np.zeros(reachable.shape))
        surely_unlike, unlike = self._unlike(options, plain, most_minutes)
        found = self._enough(options, surely_unlike, most_minutes) or self._enough(options, unlike, most_minutes)
        found = found or self._most_unlike(options, plain, unlike, most_minutes)
        found = found or [max(options, key=lambda one: (self._share(one, plain), -one.minutes))]
        # A little more time is worth being surer.
        near = [one for one in found if one.minutes <= _LITTLE_MORE * found[0].minutes]
        best = max(near, key=lambda one: self._nearest(one.left, reachable))
        still_alike = self._still_alike(best, reachable)
        return Advice(
            listed([self.plans[place].title for place, _ in best.plans], "and then"),
            self._sentences(best) + _alike_words(still_alike),
            best.minutes,
            self._nearest(best.left, reachable),
            self._share(best, plain),
            self._nearest(self._left_by_same()[0], reachable),
            tuple((self.plans[place], times) for place, times in best.plans),
            contained,
            self._others(best, found, reachable),
            still_alike,
        )

    def _left_by_same(self) -> tuple[Numbers, Numbers]:
        return self._candidates.apart(self._data.information.plus(self._data.information), self._truths)

    def _left(self, plans: Sequence[tuple[Measurement, int]]) -> tuple[Numbers, Numbers]:
        total = self._data.information
        for plan, times in plans:
            total = total.plus(self._information(plan), times)
        return self._candidates.apart(total, self._truths)

    def _information(self, plan: Measurement) -> Information:
        known = self._known.get(id(plan))
        if known is None:
            rows = planned(self.situation, plan)
            known = (plan, expected(self._model, self._columns, rows, noise_of(self.situation, rows)))
            self._known[id(plan)] = known
        return known[1]

    def _asked(self, among: Sequence[int]) -> np.ndarray:
        """Tell which cases are asked about, (n_families, n_truths): a truth and another candidate."""
        chosen = np.isin(np.arange(len(self.names)), list(among))
        family = self._truths.family
        asked = chosen[:, None] & chosen[family]
        asked[family, np.arange(len(family))] = False
        votes = [is_believable(self._data.information, self._information(plan), self._truths) for plan in self.plans]
        # Where there is no plan none speaks against a truth.
        believable = np.mean(votes, axis=0) >= 0.5 if votes else np.ones(len(family), dtype=bool)
        for number in range(len(self.names)):
            own = family == number
            if not believable[own].any():
                # The best one comes first.
                believable[np.flatnonzero(own)[0]] = True
        return np.asarray(asked & believable)

    def _share(self, option: _Option, goal: _Goal) -> float:
        """Give the share of truths that an option separates from all that can be: a mean of the candidates' means."""
        whole = np.asarray(goal.is_met(option).all(axis=0))
        counts = goal.reachable.any(axis=0)
        family = self._truths.family
        means = [float(whole[own].mean()) for n in range(len(self.names)) if (own := counts & (family == n)).any()]
        return sum(means) / len(means)

    def _enough(self, options: Sequence[_Option], goal: _Goal, most_minutes: float) -> list[_Option]:
        """Give the plans, alone or one after another, that separate enough, shortest first."""
        found = [one for one in options if self._share(one, goal) >= _ENOUGH]
        shortest = min((one.minutes for one in found), default=most_minutes)
        return sorted(found + self._paired(options, goal, shortest), key=lambda one: one.minutes)

    def _unlike(self, options: Sequence[_Option], plain: _Goal, most_minutes: float) -> tuple[_Goal, _Goal]:
        """Give the goal that two are no longer alike either where some plan, or one after another, makes them so.

        Surely where that can be, and else as it is expected; and as it is expected everywhere.
        """
        pairs = [self._option(both[-1]) for both in self._pairs(options, plain, most_minutes)]
        most = np.max([np.where(one.left >= plain.margin, one.share, 0.0) for one in (*options, *pairs)], axis=0)
        least, surely_least = 1.0 - _ALIKE**2, 1.0 - _SURELY_UNLIKE**2
        share = np.where(most >= least, least, 0.0)
        return replace(plain, share=np.where(most >= surely_least, surely_least, share)), replace(plain, share=share)

    def _most_unlike(
        self, options: Sequence[_Option], plain: _Goal, unlike: _Goal, most_minutes: float
    ) -> list[_Option]:
        """Give the plan, or two, that separate enough and leave the fewest cases alike, if any do."""
        pairs = [self._option(both) for some in self._pairs(options, unlike, most_minutes) for both in some]
        enough = [one for one in (*options, *pairs) if self._share(one, plain) >= _ENOUGH]
        return sorted(enough, key=lambda one: (-float(unlike.is_met(one).mean()), one.minutes))[:1]

    def _paired(self, options: Sequence[_Option], goal: _Goal, most_minutes: float) -> list[_Option]:
        """Try one plan after another; of each pair the shortest that is enough."""
        found: list[_Option] = []
        for some in self._pairs(options, goal, most_minutes):
            plans = [both for both in some if self._minutes(both) < most_minutes]
            if not plans or self._share(self._option(plans[-1]), goal) < _ENOUGH:
                continue
            enough = (one for both in plans if self._share(one := self._option(both), goal) >= _ENOUGH)
            found.append(next(enough))
            most_minutes = min(most_minutes, found[-1].minutes)
        return found

    def _pairs(self, options: Sequence[_Option], goal: _Goal, most_minutes: float) -> Iterator[list[_Pair]]:
        """Give two plans among those that separate most, one after another, each as often as may be, shortest first.

        What separates nothing by itself is no part of them: it would be there for its number of pictures alone.
        """
        able = [one for one in options if (goal.reachable & (one.left >= goal.margin)).any()]
        best: dict[int, _Option] = {}
        for one in sorted(able, key=lambda option: (-self._share(option, goal), -float(goal.is_met(option).mean()))):
            best.setdefault(one.plans[0][0], one)
        most = {place: max(one.plans[0][1] for one in options if one.plans[0][0] == place) for place in best}
        for first, second in itertools.combinations(list(best)[:_PAIRED], 2):
            often = itertools.product(*[[n for n in _TIMES if n <= most[place]] for place in (first, second)])
            plans = sorted((((first, one), (second, other)) for one, other in often), key=self._minutes)
            plans = [both for both in plans if self._minutes(both) < most_minutes]
            if plans:
                yield plans

    def _minutes(self, plans: tuple[tuple[int, int], ...]) -> float:
        return sum(self.plans[place].minutes(times) for place, times in plans)

    def _option(self, plans: tuple[tuple[int, int], ...]) -> _Option:
        left, whole = self._left([(self.plans[place], times) for place, times in plans])
        return _Option(plans, self._minutes(plans), left, _share_of(left, whole))

    def _middle(self, left: Numbers) -> Numbers:
        """Give the middle over each candidate's truths of what each other one leaves, (n, n)."""
        n = len(self.names)
        result = np.zeros((n, n))
        for truth in range(n):
            own = self._truths.family == truth
            result[truth] = np.median(left[:, own], axis=1) if own.any() else 0.0
        return result

    def _nearest(self, left: Numbers, counted: np.ndarray) -> float:
        """Give what the nearest other one leaves in the middle of the cases that count, candidates weighing alike."""
        nearest = np.where(counted, left, np.inf).min(axis=0)
        own = np.isfinite(nearest)
        if not own.any():
            return 0.0
        family = self._truths.family[own]
        weight = 1.0 / np.bincount(family)[family]
        order = np.argsort(nearest[own])
        share = np.cumsum(weight[order]) / weight.sum()
        return float(nearest[own][order][np.searchsorted(share, 0.5 - 1e-9)])

    def _contained(self, asked: np.ndarray, reachable: np.ndarray) -> tuple[tuple[str, str], ...]:
        found = []
        for truth in range(len(self.names)):
            own = self._truths.family == truth
            for other in range(len(self.names)):
                if asked[other, own].any() and not reachable[other, own].any():
                    found.append((self.names[truth], self.names[other]))
        return tuple(found)

    def _still_alike(self, option: _Option, reachable: np.ndarray) -> tuple[tuple[str, str, float], ...]:
        """Give the pairs that it tells apart and leaves alike all the same, with their correlations."""
        correlation = np.sqrt(np.clip(1.0 - self._middle(option.share), 0.0, 1.0))
        pairs = itertools.permutations(range(len(self.names)), 2)
        return tuple(
            (self.names[truth], self.names[other], float(correlation[truth, other]))
            for truth, other in pairs
            if correlation[truth, other] > _ALIKE and reachable[other, self._truths.family == truth].any()
        )

    def _sentences(self, option: _Option) -> str:
        sentences = [self.plans[place].text(times) for place, times in option.plans]
        taken = {name for place, _ in option.plans for name in self.plans[place].conditions}
        held = self._held_cold() - taken
        if held:
            cold = [f"{name} at {self.situation.temperatures[name][0]:.3g} °C" for name in sorted(held)]
            sentences[0] = f"With {listed(cold)}: {sentences[0][0].lower()}{sentences[0][1:]}"
        return ". Then: ".join(sentences)

    def _held_cold(self) -> set[str]:
        """Name temperatures that have to be as they are computed to be: beside a change from session to session.

        What changed stays changed, and what follows a temperature is gone with it.
        """
        followed = [set(term.variables) for term in self.firsts]
        if not any(SESSION_NAME in names for names in followed):
            return set()
        return {name for names in followed for name in names if name in self.situation.temperatures}

    def _others(self, best: _Option, found: Sequence[_Option], reachable: np.ndarray) -> tuple[Alternative, ...]:
        taken = {place for place, _ in best.plans}
        others = []
        for one in found:
            places = {place for place, _ in one.plans}
            if places & taken:
                continue
            taken |= places
            title = listed([self.plans[place].title for place, _ in one.plans], "and then")
            others.append(Alternative(title, self._sentences(one), one.minutes, self._nearest(one.left, reachable)))
        return tuple(others[:_ALTERNATIVES])

    def _none(
        self,
        among: Sequence[int],
        options: Sequence[_Option],
        asked: np.ndarray,
        contained: tuple[tuple[str, str], ...],
    ) -> Advice:
        """Say that nothing would do, and how far the best would get."""
        names = listed([self.names[place] for place in among])
        reached = max((self._nearest(one.left, asked) for one in options), default=0.0)
        text = f"no measurement known here would tell {names} apart at their present size"
        return Advice(text, None, None, reached, 0.0, None, (), contained, ())


def _alike_words(still_alike: Sequence[tuple[str, str, float]]) -> str:
    """Say what stays alike, each pair once: the data that there are outweigh two hours of others."""
    most: dict[frozenset[str], float] = {}
    for truth, other, correlation in still_alike:
        pair = frozenset((truth, other))
        most[pair] = max(correlation, most.get(pair, 0.0))
    if not most:
        return ""
    pairs = [f"{' and '.join(sorted(pair))} ({correlation:.3f})" for pair, correlation in most.items()]
    return f". It tells them apart; their correlation stays above {_ALIKE} all the same: {'; '.join(pairs)}"


def _share_of(left: Numbers, whole: Numbers) -> Numbers:
    """Give what others leave (n_families, n_truths) as a share of all of each truth (n_truths,)."""
    return left / np.maximum(whole, np.finfo(np.float64).tiny)


def _forms(candidate: Term | Sequence[Term]) -> tuple[Term, ...]:
    return (candidate,) if isinstance(candidate, Term) else tuple(candidate)


def _each_form(candidate: Term | Sequence[Term] | Company) -> list[tuple[Term, ...]]:
    return [(term,) for term in candidate.terms] if isinstance(candidate, Company) else [_forms(candidate)]


def firsts_of(candidates: Sequence[Term | Sequence[Term] | Company]) -> tuple[Term, ...]:
    """Give each candidate in the form that fits best, those of a `Company` one after the other."""
    return tuple(form[0] for one in candidates for form in _each_form(one))


def _prior(prior: Numbers | None, model: Terms, n_fitted: int) -> Numbers | None:
    """Give what is known besides the measurements, with columns for what was added to the fit's own terms."""
    if prior is None:
        return None
    n_new = model.compiled.n_coefficients - n_fitted
    return np.hstack([prior[:, :n_fitted], np.zeros((len(prior), n_new)), prior[:, n_fitted:]])


def _plans(situation: Situation, question: Question) -> Iterator[Measurement]:
    """Give the plans along axes that can be moved; along all of those where none of them is in question."""
    axes = situation.moving(question.axes) or situation.moving()
    return menu(situation, replace(question, axes=axes)) if axes else iter(())
