"""The search: candidates and probes judged together, the best added, until chance explains what is left."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from geoerr.diagnose.candidates import Candidate
from geoerr.diagnose.gaps import unread_rows, unread_temperatures
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.probe_variables import variables_of
from geoerr.diagnose.probes import Probe, probes_of
from geoerr.diagnose.scan import all_channels
from geoerr.diagnose.search.alike import at_likeliest_period
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.beside_drift import beside_drift, is_beside_drift
from geoerr.diagnose.search.beside_each import BesideEach
from geoerr.diagnose.search.best_form import at_its_values, beside_others, in_best_form
from geoerr.diagnose.search.coherence import is_one_wave
from geoerr.diagnose.search.finer import finer_functions
from geoerr.diagnose.search.held_waves import beside_held
from geoerr.diagnose.search.helpful_order import in_helpful_order, without_harmful
from geoerr.diagnose.search.judged import (
    ALPHA,
    Judged,
    evidence_of,
    first_to_pass,
    is_admissible,
    reference_of,
    simplest_to_pass,
)
from geoerr.diagnose.search.look import Round, look
from geoerr.diagnose.search.nameless import (
    acts_elsewhere,
    bent_by_its_covariate,
    is_a_remainder,
    is_impostor,
    misnamed,
    not_taken_back,
    unevenness,
    without_remainders,
)
from geoerr.diagnose.search.once_more import by_first_names, once_more
from geoerr.diagnose.search.own_noise import in_own_noise
from geoerr.diagnose.search.rivals import Found, Rival, rivals_of
from geoerr.diagnose.search.rough import RoughError, may_be_smooth, rough_error
from geoerr.diagnose.search.settle import Settled, settle
from geoerr.diagnose.search.uneven_waves import UnevenWaves
from geoerr.diagnose.space import Space
from geoerr.diagnose.steps import RoundSteps, Steps
from geoerr.diagnose.untold import untold_rows
from geoerr.effects.collection import Catalogue
from geoerr.fit.choose_again import is_worth_asking
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.terms import EffectReference

MOST_EFFECTS = 6
# Every further look is another chance to be wrong: beside what was found, this share of the level.
FURTHER = 0.2
# Less sure than this, a name has to help where the fit did not see the data.
_SURE = 1e-3
# What gains less than this share of what it gained when it was found may be nothing beside what was found later.
_REMAINS = 0.5
# What chance does no more often than this is missing, also where it gains less than its many numbers cost (Schwarz).
_NO_CHANCE = 1e-4
# What is left of a name beside what has no name, as a share of what it gained: less is nothing of its own.
_SWALLOWED = 0.02


@dataclass(frozen=True, eq=False)
class Searched:
    """What the search found.

    Attributes
    ----------
    bench
        The fit, and what it is multiplied with.
    first
        The look at the model as it was.
    last
        The look after all that was added.
    found
        Effects in the order in which they were added, but that none raises the held-out error where another lets it
        fall.
    unknown
        The probe that no candidate matches, as it was found; None where there is none.
    not_offered
        Effects that the data cannot carry, and why.
    beside
        Columns (n, 3, k) that stood beside what was found: more freedom of the model, and what has no name.
    ends_early
        Whether it ended where something large was found.
    dropped
        What passed for more than chance and was not added all the same, and why.
    has_unread
        Whether rows took part in which a temperature is unknown, and nothing that follows it.
    rough
        Rough errors of axes that explain as much as a wave would.
    """

    bench: Bench
    first: Round
    last: Round
    found: tuple[Found, ...]
    unknown: Found | None
    not_offered: tuple[tuple[str, str], ...]
    beside: tuple[Numbers, ...]
    ends_early: bool = False
    dropped: Mapping[EffectReference, str] = field(default_factory=dict)
    has_unread: bool = False
    rough: tuple[RoughError, ...] = ()

    @property
    def finds_nothing(self) -> bool:
        """Tell whether nothing is missing, with a name or without."""
        return not self.found and self.unknown is None

    def rivals_at_last(self, found: Found, rivals: Sequence[Rival]) -> list[Settled]:
        """Give rivals in the place of what was found: beside the others, in the noise that all of it leaves.

        One that does so only with others is estimated beside these: growth of x alone takes what that of y does.
        What of the rest says the same of them by construction stands back: beside a drift no fixed point is told.
        """
        space = found.at_last.space
        scanner = self.bench.scanner(space, n_draws=0)
        settled = []
        for rival in rivals:
            company = [one.judged for one in found.rivals if one is not rival and one.is_of_company_of(rival)]
            if company:
                named = [one.settled.raw for one in self.found if one is not found and not rival.is_twin_of(one)]
                # As they were scanned, and as that is settled: alone, each may be far from where it is with others.
                beside = [*self.beside, *named, *(scanner.raw_columns(one.shapes, one.trial) for one in company)]
                own = self.bench.space_to_estimate_in(space.noise, beside)
                settled.append(settle(own, self.bench.scanner(own, n_draws=0), rival.judged))
            else:
                settled.append(beside_others(space, scanner, rival.judged, rival.settled))
        return settled

    def let_go(self) -> None:
        """Let go of what is kept to judge more: of many rows it is gigabytes, and is made anew if need be."""
        self.bench.let_go()
        for looked in (self.first, self.last, *(one.looked for one in self.found)):
            looked.scanner.let_go()


def search(
    fitted: Fitted,
    offers: Offers,
    *,
    explained: Numbers | None = None,
    ends_beside_large: Sequence[str] | None = None,
    doubt: Numbers | None = None,
    with_unread: bool = False,
    n_searches: int = 1,
    steps: RoundSteps | None = None,
    threads: int = 0,
) -> Searched:
    """Add what is missing, best first, until chance explains what is left.

    Where a probe beats every name, and two names together, there is something without a name: its columns are set
    aside, and the search goes on for names on other components.

    Parameters
    ----------
    explained : (n, 3) or None
        What an earlier search explained of the residual, as `whitened_space` takes it.
    ends_beside_large
        Whether to end where something is found that lets the error fall far: all but the terms of these ids; None to
        go on in any case.
    doubt : (n, 3, k) or None
        How far a given model may be off (`geoerr.diagnose.own_uncertainty.own_doubt`).
    with_unread
        Let rows take part in which a temperature is unknown, and look for nothing that follows it.
    n_searches
        How many searches there may be, of which this is one: p-values are as many times larger.
    steps
        Told what is looked at next.
    """
    steps = steps or RoundSteps(Steps())
    steps.begin_search()
    candidates, not_offered, functions = offers.to(fitted)
    variables = variables_of(fitted)
    smooth, waves = probes_of(fitted, functions, variables), UnevenWaves(functions, variables)
    aside_rows, candidates, smooth = _taking_part(fitted, candidates, smooth, with_unread=with_unread)
    everything: list[Candidate | Probe] = [*candidates, *smooth]
    names = all_channels([shapes for what in everything for shapes in what.shapes])
    bench = Bench(
        fitted,
        functions,
        names=names,
        explained=explained,
        left_out=aside_rows,
        doubt=doubt,
        n_searches=n_searches,
        threads=threads,
    )
    found: list[Found] = []
    unknown: Found | None = None
    # Columns of what has no name: of its probe, and where it is left of a name what is uneven or bent in that.
    aside: list[Numbers] = []
    # Columns of errors of an axis with more freedom than the fit gave them.
    finer: list[Numbers] = []
    # Those of them that are rough errors, by their place among these.
    rough: dict[int, RoughError] = {}
    first: Round | None = None
    ends_early = False
    dropped: dict[EffectReference, str] = {}
    # Without a name that is no find another look would show nothing new.
    seen: Round | None = None
    while not ends_early:
        added = [*finer, *aside, *(one.settled.raw for one in found)]
        probes = [*smooth, *waves.probes(found)]
        steps.begin_round([str(reference_of(one.judged)) for one in found], len(candidates), len(probes))
        plain = seen or look(bench, bench.space(added), candidates, probes)
        steps.next("what of it a slow drift would hide")
        looked = beside_drift(bench, plain, added)
        looked = replace(looked, probes=without_remainders(found, looked.probes))
        first, seen = first or looked, None
        level = 0.5 * ALPHA * (FURTHER if found or unknown is not None else 1.0)
        best, probe = _claims(looked, level, found, unknown)
        formed = None if best is None else _formed(bench, looked, best, added, steps)
        more = _finer(bench, looked, best, formed, probe, found)
        own = None if more is not None else _rough(bench, looked, formed, added, rough.values(), ends_beside_large)
        rough |= {} if own is None else {len(finer): own[0]}
        more = more if own is None else own[1]
        if more is not None:
            finer.append(more)
            is_told = unknown is not None or any(one.judged is not None for one in rough.values())
            first = first if found or is_told else None
            continue
        uneven = None if probe is None else unevenness(looked, found, best, probe)
        if uneven is not None:
            unknown = _nameless(looked, uneven[0])
            aside = [unknown.settled.raw, uneven[1].raw]
            continue
        if probe is not None and is_impostor(bench, formed, probe, added, candidates, level):
            wrong = misnamed(found, probe)
            if wrong is not None:
                found = [one for one in found if one is not wrong]
                dropped[reference_of(wrong.judged)] = "follows another formula in its own variables"
                looked = look(bench, bench.space([*finer, *(one.settled.raw for one in found)]), [], probes)
                probe = simplest_to_pass(looked.probes, level) or probe
            unknown = _nameless(looked, probe)
            aside = [unknown.settled.raw]
            before, found = found, not_taken_back(bench, found, unknown)
            dropped |= _gone(before, found, "may be a part of what has no name")
            continue
        if formed is None or len(found) >= MOST_EFFECTS:
            break
        best, settled = formed
        why_not = _why_not(bench, found, settled, best, added)
        if why_not is not None:
            dropped[reference_of(best)] = why_not
            candidates = [one for one in candidates if one is not best.what]
            seen = replace(plain, candidates=tuple(one for one in plain.candidates if one.what is not best.what))
            continue
        if unknown is not None and not acts_elsewhere(settled, unknown.judged):
            break
        ends_early = _is_large_and_new(bench, settled, added, ends_beside_large)
        bent = bent_by_its_covariate(looked, best, settled) if unknown is None and not ends_early else None
        if bent is not None:
            unknown = _nameless(looked, bent[0])
            aside = [unknown.settled.raw, bent[1]]
            continue
        steps.next(f"what looks like {reference_of(best)}")
        known = None if ends_early else offers.known
        found.append(_found(bench, looked, best, settled, added, known))
        bench, found, finer, aside = _where_it_is_known(bench, found, finer, aside)
        found, gone = _needed(bench, found, finer, aside, candidates, known, steps)
        dropped |= gone
        taken = {id(one.judged.what) for one in found}
        candidates = [one for one in candidates if id(one) not in taken]
        candidates += once_more(best.what, offers.known, [term.id for term in fitted.terms])
    assert first is not None
    steps.next("each of what was found beside the others")
    beside = [*finer, *aside]
    together = tuple(in_helpful_order(bench, _together(bench, found, finer, aside, looked)))
    dropped |= _gone(found, together, "nothing of it is left beside what was found")
    together, harmful = _that_help(bench, together, finer, aside, looked)
    dropped |= harmful
    together = tuple(by_first_names(together, [term.id for term in fitted.terms], offers.known))
    together = tuple(beside_held(together, offers.held, offers.known, bench.functions))
    named = [one.settled.raw for one in together]
    unknown = _nameless_at_last(bench, unknown, [*finer, *aside[1:], *named], looked)
    unknown = unknown or _largest_of_rough(bench, rough, finer, named, looked)
    dropped |= {one.wave: "no likelier than something else at each place" for one in rough.values()}
    return Searched(
        bench,
        first,
        looked,
        together,
        unknown,
        not_offered,
        tuple(beside),
        ends_early,
        dropped,
        with_unread,
        tuple(rough.values()),
    )


def _taking_part(
    fitted: Fitted, candidates: list[Candidate], probes: list[Probe], *, with_unread: bool
) -> tuple[np.ndarray, list[Candidate], list[Probe]]:
    """Give the rows (n,) that take no part, with what is looked for in the others.

    Rows in which a temperature is unknown take no part; or they do, and nothing that follows it. Nor do those of
    which nobody knows from which side their axis came.
    """
    untold = untold_rows(fitted.sightings)
    if not with_unread:
        return unread_rows(fitted.sightings) | untold, candidates, probes
    unknown = set(unread_temperatures(fitted.sightings))
    followed = [unknown & set(re.findall(r"\w+", one.reference.covariate or "")) for one in candidates]
    return (
        untold,
        [one for one, names in zip(candidates, followed, strict=True) if not names],
        [one for one in probes if not unknown & set(one.depends_on)],
    )


def _gone(before: Sequence[Found], after: Sequence[Found], why: str) -> dict[EffectReference, str]:
    """Give those that were found and are no more, with why."""
    kept = {reference_of(one.judged) for one in after}
    return {name: why for one in before if (name := reference_of(one.judged)) not in kept}


def _formed(
    bench: Bench, looked: Round, best: Judged, added: Sequence[Numbers], steps: RoundSteps
) -> tuple[Judged, Settled] | None:
    steps.next(f"the form of {reference_of(best)}")
    return in_best_form(bench, looked, best, added)


def _found(
    bench: Bench, looked: Round, best: Judged, settled: Settled, added: Sequence[Numbers], known: Catalogue | None
) -> Found:
    """Give what was found with its values, and its rivals from a catalogue; with none where that is None."""
    settled, as_good = at_likeliest_period(looked.space, looked.scanner, settled)
    rivals = () if known is None else tuple(rivals_of(looked, known, best, settled, BesideEach(bench, added)))
    own = in_own_noise(bench, best, settled, added)
    return Found(best, own, rivals, looked, as_good=as_good, compared=settled)


def _needed(
    bench: Bench,
    found: list[Found],
    finer: Sequence[Numbers],
    aside: Sequence[Numbers],
    candidates: Sequence[Candidate],
    known: Catalogue | None,
    steps: RoundSteps,
) -> tuple[list[Found], dict[EffectReference, str]]:
    """Leave out an earlier find that the last makes superfluous, and judge the last anew without it.

    Beside the earlier one only a part of the last was to be seen, and what does as much of that part may do little of
    the whole. Where the search ends with it, which has no catalogue then, the next one judges it.
    """
    # A probe's columns may hold those of a name: it is a later name that makes an earlier one superfluous.
    needed = _without_superfluous(bench, found, [*finer, *aside[1:]])
    gone = _gone(found, needed, "what was found later does it, too")
    if not gone or known is None:
        return needed, gone
    last = found[-1]
    steps.next(f"{reference_of(last.judged)} without what it makes superfluous")
    added = [*finer, *aside, *(one.settled.raw for one in needed[:-1])]
    left = [what for one in found if isinstance(what := one.judged.what, Candidate) and one not in needed]
    looked = beside_drift(bench, look(bench, bench.space(added), [*candidates, *left], []), added)
    best = next((one for one in looked.candidates if one.what is last.judged.what), None)
    formed = None if best is None else in_best_form(bench, looked, best, added)
    if formed is not None:
        needed[-1] = _found(bench, looked, *formed, added, known)
    return needed, gone


def _is_large_and_new(bench: Bench, settled: Settled, added: Sequence[Numbers], known: Sequence[str] | None) -> bool:
    """Tell whether an effect lets the error fall so far that what else there is had better be sought beside it."""
    if known is None or settled.term is None or settled.term.id in known:
        return False
    return is_worth_asking(bench.held_out.um(added), bench.held_out.um([*added, settled.raw]))


def _where_it_is_known(
    bench: Bench, found: list[Found], finer: list[Numbers], aside: list[Numbers]
) -> tuple[Bench, list[Found], list[Numbers], list[Numbers]]:
    """Go on without the rows at which nobody can say what the last find does: they hold it, and nothing tells of it.

    At the first picture of a session nothing shows how long ago an axis turned. What an effect of that did there
    would be named a jump, or warming up.
    """
    term = found[-1].settled.term
    assert term is not None
    lacking = bench.lacks(term)
    if not lacking.any():
        return bench, found, finer, aside
    known = (~lacking[:, None, None]).astype(np.float64)
    kept = [replace(one, settled=replace(one.settled, raw=one.settled.raw * known)) for one in found]
    return bench.without(lacking), kept, [one * known for one in finer], [one * known for one in aside]


def _claims(
    looked: Round, level: float, found: Sequence[Found], unknown: Found | None
) -> tuple[Judged | None, Judged | None]:
    """Give the best name and the best probe that pass; in a first look what is no chance passes at any cost."""
    best = first_to_pass(looked.candidates, level)
    probe = simplest_to_pass(looked.probes, level) if unknown is None else None
    if best is not None or probe is not None or found or unknown is not None:
        return best, probe
    names = (one for one in looked.candidates if one.p_value <= _NO_CHANCE)
    best = next((one for one in names if is_admissible(looked.space, looked.scanner, one)), None)
    return best, next((one for one in looked.probes if one.p_value <= _NO_CHANCE), None)


def _finer(
    bench: Bench,
    looked: Round,
    best: Judged | None,
    formed: tuple[Judged, Settled] | None,
    probe: Judged | None,
    found: Sequence[Found],
) -> Numbers | None:
    """Give the model more knots where they do as well as the best of names and probes.

    A name in the form and at the values that the data ask for, and as it was found: of a wave with a second harmonic
    one harmonic is a part, and one midway between two periods that were tried gains more than at either; so many
    knots follow all of it.
    """
    claims = [] if best is None or formed is None else [(at_its_values(*formed), best)]
    if probe is not None:
        claims.append((probe, probe))
    if not claims:
        return None
    smooth = [one.settled.term for one in found if _is_smooth(one)]
    claim = max(claims, key=lambda one: one[0].evidence)
    return finer_functions(bench, looked, *claim, [term for term in smooth if term is not None])


def _rough(
    bench: Bench,
    looked: Round,
    formed: tuple[Judged, Settled] | None,
    added: Sequence[Numbers],
    before: Iterable[RoughError],
    ends_beside_large: Sequence[str] | None,
) -> tuple[RoughError, Numbers] | None:
    """Give the rough error that is as likely as the best name, if that is a wave, and its columns (n, 3, k).

    Not where it stands beside the model already, and not where the search ends with the wave: knots that followed one
    leave little to say it by, and in the fit beside it, which is searched again, they are fewer.
    """
    if formed is None or any(one.is_of(*formed) for one in before):
        return None
    own = rough_error(bench, looked, *formed)
    if own is None or _is_large_and_new(bench, formed[1], added, ends_beside_large):
        return None
    return own


def _is_smooth(found: Found) -> bool:
    """Tell whether what was found is an error of an axis that the model lacked."""
    return isinstance(found.judged.what, Candidate) and found.judged.what.effect.is_smooth


def _nameless(looked: Round, probe: Judged) -> Found:
    return Found(probe, settle(looked.space, looked.scanner, probe), (), looked)


def _largest_of_rough(
    bench: Bench, rough: Mapping[int, RoughError], finer: Sequence[Numbers], named: Sequence[Numbers], last: Round
) -> Found | None:
    """Give rough errors of few places, which may be a wave, as what has no name: the largest, if anything is left.

    Each stands among the model's functions with more freedom, at the place by which it is given.
    """
    found = []
    for place, one in rough.items():
        if one.judged is not None:
            beside = [*named, *(columns for number, columns in enumerate(finer) if number != place)]
            found.append(_beside(bench, _nameless(last, one.judged), beside, last))
    largest = max(found, key=lambda one: one.at_last.gain, default=None)
    return None if largest is None or largest.at_last.gain <= 0.0 else largest


def _nameless_at_last(bench: Bench, unknown: Found | None, others: Sequence[Numbers], last: Round) -> Found | None:
    """Estimate what has no name, if anything, beside all the rest, in the noise that all of it leaves."""
    return None if unknown is None else _beside(bench, unknown, others, last)


def _beside(bench: Bench, nameless: Found, others: Sequence[Numbers], last: Round) -> Found:
    space = bench.space_to_estimate_in(last.space.noise, others)
    return replace(nameless, beside_others=settle(space, bench.scanner(space, n_draws=0), nameless.judged))


def _why_not(
    bench: Bench, found: Sequence[Found], settled: Settled, best: Judged, added: Sequence[Numbers]
) -> str | None:
    """Say why a name that passes is not found all the same; None where it is."""
    if is_a_remainder(found, settled):
        return "may be what a larger one leaves of itself"
    if not is_one_wave(bench.functions, settled):
        return "not the same wave all along the axis"
    if may_be_smooth(bench, best, settled):
        return "a smooth error of the axis does as much"
    return None if _helps(bench, settled, best, added) else "no better held out"


def _helps(bench: Bench, settled: Settled, best: Judged, added: Sequence[Numbers]) -> bool:
    """Tell whether a name that is only just sure, or gains less than its numbers cost, lowers the held-out error."""
    if best.p_value < _SURE and best.evidence > 0.0:
        return True
    before, after = bench.held_out.um(added), bench.held_out.um([*added, settled.raw])
    return before is None or after is None or after < before


def _together(
    bench: Bench, found: list[Found], finer: list[Numbers], aside: list[Numbers], last: Round
) -> list[Found]:
    """Estimate each effect beside all the others, in the noise that all of them leave.

    One after another, the others as they have become: a jump at a moment that was not quite right leaves another,
    of which nothing is left where the moment is right. Such a remainder goes. Where what has no name could do what a
    name does, it is what the name leaves, and the name is estimated without it.
    """
    settled = [one.settled for one in found]
    result = []
    for place, one in enumerate(found):
        others = [own.raw for number, own in enumerate(settled) if number != place]
        again, space = _again(bench, one, [*finer, *aside, *others], last)
        if aside and again.gain < _SWALLOWED * one.settled.gain:
            again, space = _again(bench, one, [*finer, *others], last)
        settled[place] = again
        if others and again.gain < _REMAINS * one.settled.gain and _evidence(space, again, one) <= 0.0:
            return _together(bench, [other for other in found if other is not one], finer, aside, last)
        result.append(replace(one, beside_others=again))
    return result


def _that_help(
    bench: Bench, together: tuple[Found, ...], finer: list[Numbers], aside: list[Numbers], last: Round
) -> tuple[tuple[Found, ...], dict[EffectReference, str]]:
    """Leave out what raises the held-out error beside the others, and estimate these without it."""
    helpful = without_harmful(bench, together)
    if len(helpful) == len(together):
        return together, {}
    again = in_helpful_order(bench, _together(bench, helpful, finer, aside, last))
    return tuple(again), _gone(together, helpful, "no better held out")


def _again(bench: Bench, one: Found, beside: list[Numbers], last: Round) -> tuple[Settled, Space]:
    space = bench.space_to_estimate_in(last.space.noise, beside)
    return beside_others(space, bench.scanner(space, n_draws=0), one.judged, one.settled), space


def _evidence(space: Space, settled: Settled, found: Found) -> float:
    gain, rank = np.array([settled.gain]), np.array([found.judged.rank])
    return float(evidence_of(space, gain, rank, found.judged.what.n_trials)[0])


def _without_superfluous(bench: Bench, found: list[Found], aside: list[Numbers]) -> list[Found]:
    """Drop an earlier effect that a later one makes superfluous."""
    for place in range(len(found) - 1):
        others = [*aside, *(one.settled.raw for number, one in enumerate(found) if number != place)]
        space = bench.space(others)
        one = found[place]
        scanned = bench.scanner(space).exact(one.settled.shapes)
        is_worth_it = float(evidence_of(space, scanned.gain, scanned.rank, one.judged.what.n_trials)[0]) > 0.0
        # What a drift can swallow is judged with the drift estimated anew, here as where it was found.
        if not is_worth_it and one.judged.noise is not None:
            is_worth_it = is_beside_drift(bench, space, others, one.judged, one.settled)
        if not is_worth_it:
            return [other for number, other in enumerate(found) if number != place]
    return found
