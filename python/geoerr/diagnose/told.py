"""From what a search has found to what is said of it: values, worth, doubt, rivals and advice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.advice import advise
from geoerr.diagnose.answer import Verdict, held_out_um, with_terms
from geoerr.diagnose.between_passes import between_passes
from geoerr.diagnose.comparison import Comparison, all_terms
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.findings import Alias, Finding, HeldOut, Separation, Unknown
from geoerr.diagnose.moments import moments_of
from geoerr.diagnose.probes import Probe, curve_reference, curve_term, own_curve
from geoerr.diagnose.scan import estimate
from geoerr.diagnose.search import (
    Found,
    Judged,
    Rival,
    Searched,
    Settled,
    channel_of,
    other_periods,
    reference_of,
    settle,
    why_left,
)
from geoerr.diagnose.steps import Steps
from geoerr.diagnose.where import Where, displacement_um, variables_of_term, where_of
from geoerr.effects.amplitudes import Amplitude, amplitudes_of, wave_pairs
from geoerr.effects.collection import Catalogue
from geoerr.fit import Fitted
from geoerr.fit import refit as fit_again
from geoerr.fit.elsewhere import beyond_the_lines_um
from geoerr.fit.empirical import curve_of
from geoerr.fit.periods import place_of_period
from geoerr.fit.sightings import Numbers
from geoerr.terms import EffectReference, Term

# Candidates that a diagnosis lists beside the first.
_LISTED = 8
# A correlation that is worth a word.
_ALIAS = 0.5
# And the same from here on, for what is to be done about it.
_SAME = 0.95
# The catalogue has one half of the family-wise level, probes the other.
_HALVES = 2.0
# Fits whose held-out errors differ by less are one as far as a rival's is concerned.
_AS_BEFORE = 1.05
_INVISIBLE = "not measurable with this plan: the model's own freedom does nearly all that it would do"


def diagnosis_of(
    fitted: Fitted,
    searched: Searched,
    known: Catalogue,
    comparison: Comparison | None = None,
    *,
    as_it_was: Fitted | None = None,
    steps: Steps | None = None,
) -> Diagnosis:
    """Say what a search has found; `known` is the catalogue that it was made with."""
    return _Summary(fitted, searched, known, comparison, as_it_was or fitted, steps or Steps()).diagnosis()


class _Summary:
    """From what the search found to what is said of it."""

    def __init__(
        self,
        fitted: Fitted,
        searched: Searched,
        known: Catalogue,
        comparison: Comparison | None,
        as_it_was: Fitted,
        steps: Steps,
    ) -> None:
        self.fitted, self.searched, self.known, self.comparison = fitted, searched, known, comparison
        self.as_it_was, self.steps = as_it_was, steps
        held = all_terms(comparison.model) if comparison is not None and comparison.is_held else ()
        self.held, self.held_terms = {term.id for term in held}, held
        self.held_channels = {part.channel for term in held if term.kind == "classic" for part in term.parts}

    def diagnosis(self) -> Diagnosis:
        searched = self.searched
        self.steps.next("values, worth and certainty of what was found")
        rivals = [rival.settled for one in searched.found[:1] for rival in _listed(one)]
        searched.bench.held_out.prepare([one.raw for one in (*(one.settled for one in searched.found), *rivals)])
        found = tuple(self._found(place) for place in range(len(searched.found)))
        later_tied = tuple(self._later_rivals(place) for place in range(1, len(searched.found)))
        if searched.found:
            candidates = (found[0], *self._rivals(searched.found[0]))
        else:
            first = searched.first
            candidates = tuple(
                self._finding(
                    judged, settle(first.space, first.scanner, judged), left_because=why_left(searched, judged)
                )
                for judged in first.candidates[:_LISTED]
            )
        unknown = None if searched.unknown is None else self._unknown(searched.unknown)
        verdict: Verdict = "nothing-missing"
        if found:
            is_tied = any(one.tied for one in (*candidates[1:], *found[1:]))
            verdict = "ambiguous" if is_tied else "missing"
        elif unknown is not None:
            verdict = "unknown"
        diagnosis = Diagnosis(
            verdict,
            searched.first.p_value,
            self.fitted,
            found,
            candidates,
            unknown,
            (*searched.not_offered, *_invisible(searched)),
            between_passes(searched.last.space),
            self.as_it_was,
            self.comparison,
            searched,
            later_tied,
            has_unread=searched.has_unread,
            rough=tuple(one.words() for one in searched.rough if one.judged is not None),
            asked_for=searched.first.asked_for,
        )
        if verdict == "ambiguous":
            diagnosis = self._with_advice(diagnosis)
        searched.let_go()
        return diagnosis

    def _with_advice(self, diagnosis: Diagnosis) -> Diagnosis:
        """Say with everything tied which one measurement tells all of it apart, for this machine and these data."""
        self.steps.next("which measurement would tell apart what looks the same")
        advised = [advise(diagnosis, known=self.known, place=place) for place in range(len(diagnosis.found))]
        tied = {finding.reference for finding in diagnosis.tied}
        candidates = tuple(
            _advised(one, advised[0]) if one.reference in tied else one for one in diagnosis.candidates
        )
        later = [_advised(one, own) for one, own in zip(diagnosis.found[1:], advised[1:], strict=True)]
        later_tied = tuple(
            tuple(_advised(one, own) for one in rivals)
            for rivals, own in zip(diagnosis.later_tied, advised[1:], strict=True)
        )
        return replace(diagnosis, candidates=candidates, found=(candidates[0], *later), later_tied=later_tied)

    def _found(self, place: int) -> Finding:
        one = self.searched.found[place]
        first = reference_of(one.judged)
        aliases = tuple(
            Alias(
                reference_of(rival.judged),
                rival.correlation,
                self._is_tied(first, rival),
                self._told_by(first, rival),
            )
            for rival in one.rivals
            if rival.correlation > _ALIAS
        )
        tied = next((rival for rival in one.rivals if self._is_tied(first, rival)), None)
        against = None if tied is None else reference_of(tied.judged)
        held_out = self._held_out(one.settled, [other.settled for other in self.searched.found[:place]])
        finding = self._finding(
            one.judged,
            one.at_last,
            tied=place > 0 and tied is not None,
            aliases=aliases,
            against=against,
            held_out=held_out,
        )
        return replace(finding, alike=self._alike(finding.term), as_good=_as_good(one))

    def _alike(self, term: Term) -> dict[str, tuple[float, ...]]:
        """Give other values of an inner parameter that say the same at the places that were measured."""
        found = other_periods(self.searched.bench.functions, term, self.fitted.solved.used)
        return {} if found is None else {term.inner[found[0]].name: tuple(found[1])}

    def _rivals(self, first: Found) -> list[Finding]:
        rivals = _listed(first)
        # One that was found itself is worth what it is beside the first, not beside itself; and so is what a later
        # find stands for, where it is not told with others.
        beside = {reference_of(one.judged): one.at_last for one in self.searched.found}
        beside |= {name: settled for later in self.searched.found[1:] for name, settled in self._stood_for(later)}
        return [
            self._rival(
                first, rival, settled if rival.together else beside.get(reference_of(rival.judged), settled), []
            )
            for rival, settled in zip(rivals, self.searched.rivals_at_last(first, rivals), strict=True)
        ]

    def _later_rivals(self, place: int) -> tuple[Finding, ...]:
        """Give what these data cannot tell from what was found after the first."""
        own, earlier = self.searched.found[place], [one.settled for one in self.searched.found[:place]]
        rivals = [one for one in own.rivals if self._is_tied(reference_of(own.judged), one)]
        return tuple(
            self._rival(own, rival, settled, earlier)
            for rival, settled in zip(rivals, self.searched.rivals_at_last(own, rivals), strict=True)
        )

    def _told_by(self, first: EffectReference, rival: Rival) -> str | None:
        """Give what tells an effect of the device from one of the machine that is the same here."""
        other = reference_of(rival.judged).effect
        if rival.correlation < _SAME or self.known[first.effect].is_rig or not self.known[other].is_rig:
            return None
        separation = self.known.separation(first.effect, other)
        return None if separation is None else separation.plan or separation.separate_by

    def _rival(self, found: Found, rival: Rival, settled: Settled, earlier: Sequence[Settled]) -> Finding:
        name = reference_of(found.judged)
        is_tied = self._is_tied(name, rival)
        return self._finding(
            rival.judged,
            settled,
            tied=is_tied,
            aliases=(Alias(name, rival.correlation, is_tied),) if rival.correlation > _ALIAS else (),
            against=name,
            held_out=self._held_out(rival.settled, earlier) if is_tied or self._predicts_as_before else None,
            together=rival.together,
            left_because=self._why_left(name, rival),
        )

    @property
    def _predicts_as_before(self) -> bool:
        """Tell whether the fit that was searched predicts no worse than the one that was asked about.

        With few knots, where many follow a wave, it does: what does not explain the wave is far off for that reason.
        What is tied with the wave explains it.
        """
        before, base = held_out_um(self.as_it_was), self.searched.bench.held_out.um([])
        return before is None or base is None or base < _AS_BEFORE * before

    def _stood_for(self, found: Found) -> list[tuple[EffectReference, Settled]]:
        """Give what says the same as something that was found, in its place."""
        name = reference_of(found.judged)
        rivals = [one for one in found.rivals if self._is_tied(name, one) or self._contains(name, one)]
        settled = self.searched.rivals_at_last(found, rivals)
        return [(reference_of(one.judged), own) for one, own in zip(rivals, settled, strict=True)]

    def _is_tied(self, first: EffectReference, rival: Rival) -> bool:
        """Tell whether the data cannot tell them apart.

        One that contains the first as a special case is no rival: the first says the same in fewer numbers.
        """
        return rival.is_tied and not self._contains(first, rival)

    def _contains(self, first: EffectReference, rival: Rival) -> bool:
        other = reference_of(rival.judged)
        return rival.contains or (first.effect in self.known[other.effect].contains and first.axis == other.axis)

    def _why_left(self, first: EffectReference, rival: Rival) -> str | None:
        """Say why a rival is not named beside what it is a rival of."""
        name = reference_of(rival.judged)
        if self._is_tied(first, rival) or name in {reference_of(one.judged) for one in self.searched.found}:
            return None
        if self._contains(first, rival):
            return f"says what {first} says, with more freedom"
        for later in self.searched.found:
            own = next((one for one in later.rivals if reference_of(one.judged) == name), None)
            found = reference_of(later.judged)
            if own is not None and found != first and self._is_tied(found, own):
                return f"looks the same as {found}"
            if own is not None and found != first and self._contains(found, own):
                return f"says what {found} says, with more freedom"
        return why_left(self.searched, rival.judged)

    def _finding(
        self,
        judged: Judged,
        settled: Settled,
        *,
        tied: bool = False,
        aliases: tuple[Alias, ...] = (),
        against: EffectReference | None = None,
        held_out: HeldOut | None = None,
        together: tuple[str, ...] = (),
        left_because: str | None = None,
    ) -> Finding:
        reference = reference_of(judged)
        assert settled.term is not None
        rival = None if against is None else self.known.separation(against.effect, reference.effect)
        variables = variables_of_term(settled.term, self.fitted.sightings.covariate_columns)
        moved_um = displacement_um(settled.space, settled.moved)
        return Finding(
            reference=reference,
            effect=self.known[reference.effect],
            term=settled.term,
            p_value=min(_HALVES * judged.p_value, 1.0),
            evidence=judged.evidence,
            worth_um=settled.visible_um,
            tied=tied,
            # By name where only rounding tells them apart, which is another on another processor.
            aliases=tuple(sorted(aliases, key=lambda alias: (-round(alias.correlation, 2), str(alias.reference)))),
            separate_by=None if rival is None else Separation(rival.separate_by, rival.plan, rival.minutes),
            where=self._where(moved_um, variables),
            explained_um=moved_um,
            held_out=held_out,
            moments=moments_of(settled.term, self.fitted.sightings),
            in_model=self._is_in_model(reference, settled.term),
            together=together,
            left_because=left_because,
            amplitudes=_amplitudes(settled),
        )

    def _is_in_model(self, reference: EffectReference, term: Term) -> bool:
        """Tell whether a model that is held has the effect, or the error of its axes that it is."""
        is_own = (
            self.known[reference.effect].is_classic and {part.channel for part in term.parts} <= self.held_channels
        )
        return is_own or str(reference) in self.held

    def _held_out(self, settled: Settled, earlier: Sequence[Settled]) -> HeldOut:
        """Give the held-out error with the earlier ones in the model, and with this one too."""
        columns = [one.raw for one in earlier]
        after = self.searched.bench.held_out
        before = after.um(columns) if columns else held_out_um(self.as_it_was)
        return HeldOut(before, after.um([*columns, settled.raw]))

    def _where(self, moved_um: Numbers, variables: Sequence[str]) -> Where:
        return where_of(self.fitted.sightings, moved_um, self.fitted.solved.used, variables)

    def _unknown(self, found: Found) -> Unknown:
        judged, settled = found.judged, found.at_last
        assert isinstance(judged.what, Probe)
        probe = judged.what
        reference = curve_reference(probe, channel_of(judged))
        own = own_curve((*self.held_terms, *self.fitted.terms), probe, channel_of(judged))
        earlier = [one.settled.term for one in self.searched.found]
        curve, held_out, beyond_um = None, None, None
        before = with_terms(self.fitted, earlier)
        term = curve_term(before, probe, channel_of(judged))
        if term is not None:
            after = fit_again(before, [*before.terms, term])
            before = _on_rows_of(after, before)
            curve, held_out = curve_of(after, term.id), HeldOut(held_out_um(before), held_out_um(after))
            beyond_um = beyond_the_lines_um(before, after)
        columns = self.fitted.sightings.covariate_columns
        moved_um = displacement_um(settled.space, settled.moved)
        return Unknown(
            probe.depends_on,
            probe.component,
            settled.visible_um,
            min(_HALVES * judged.p_value, 1.0),
            self._where(moved_um, [name for name in probe.depends_on if name in ("x", "y", "z", *columns)]),
            moved_um,
            reference if own is None else own.id,
            curve,
            held_out,
            beyond_um,
            own=own,
            own_is_held=own is not None and own.id in self.held,
        )


def _amplitudes(settled: Settled) -> tuple[Amplitude, ...]:
    """Give the amplitudes of a find's waves: correlations of its coefficients, and their standard errors as told."""
    term = settled.term
    if term is None or not wave_pairs(term):
        return ()
    _, root, _ = estimate(settled.space, settled.raw)
    of_coefficients = root[: len(term.coefficients)]
    size = np.linalg.norm(of_coefficients, axis=1)
    told = np.array([one.std for one in term.coefficients])
    scaled = of_coefficients * np.divide(told, size, out=np.zeros_like(size), where=size > 0.0)[:, None]
    return amplitudes_of(term, scaled @ scaled.T)


def _advised(finding: Finding, separation: Separation | None) -> Finding:
    return finding if separation is None else replace(finding, separate_by=separation)


def _on_rows_of(after: Fitted, before: Fitted) -> Fitted:
    """Give the fit before another one without the rows that lack what that needs: both are compared."""
    return fit_again(after, before.terms) if len(after.sightings) < len(before.sightings) else before


def _listed(first: Found) -> list[Rival]:
    """Give the rivals that are listed: the nearest, and all that the data do not tell from the first."""
    return [one for place, one in enumerate(first.rivals) if place < _LISTED or one.is_tied]


def _invisible(searched: Searched) -> list[tuple[str, str]]:
    seen = {reference_of(one).effect for one in searched.first.candidates}
    names = dict.fromkeys(
        one.effect.id if one.effect.id not in seen else str(one.reference) for one in searched.first.invisible
    )
    return [(name, _INVISIBLE) for name in names]


def _as_good(found: Found) -> dict[str, tuple[float, ...]]:
    """Give other values of a wave's period that explain as much, by its name."""
    term = found.settled.term
    place = None if term is None or not found.as_good else place_of_period(term)
    return {} if term is None or place is None else {term.inner[place].name: found.as_good}
