"""Which physical effect is missing: the search's result, with values, worth, doubt and words."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from geoerr.diagnose.advice import advise
from geoerr.diagnose.answer import Answer, Verdict, held_out_um
from geoerr.diagnose.between_passes import BetweenPasses, between_passes
from geoerr.diagnose.comparison import Comparison, all_terms, compare
from geoerr.diagnose.findings import Alias, Finding, HeldOut, Separation, Unknown
from geoerr.diagnose.moments import moments_of
from geoerr.diagnose.notes import is_without_errors, notes_of
from geoerr.diagnose.own_uncertainty import own_doubt
from geoerr.diagnose.probes import Probe, curve_reference
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
from geoerr.diagnose.steps import OnStep, Progress, Steps
from geoerr.diagnose.summary import diagnosis_html
from geoerr.diagnose.where import Where, displacement_um, variables_of_term, where_of
from geoerr.diagnose.whole_search import searched_whole
from geoerr.diagnose.words import chance_words
from geoerr.drawing import drawn
from geoerr.effects import Effect, catalogue
from geoerr.effects.collection import Catalogue
from geoerr.errors import GeoerrError, InputFileError
from geoerr.fit import Fitted
from geoerr.fit import refit as fit_again
from geoerr.fit.empirical import curve_of, empirical_term
from geoerr.fit.sightings import Numbers
from geoerr.model import Model
from geoerr.observations import CircularTest, Observations
from geoerr.summaries import listed
from geoerr.terms import EffectReference, Term

if TYPE_CHECKING:
    import plotly.graph_objects as go

# Candidates that a diagnosis lists beside the first.
_LISTED = 8
# Candidates that a sentence names.
_SPOKEN = 3
# A search that chance seldom equals has found something, also where nothing is worth its numbers.
_NO_CHANCE = 1e-3
# Less than this is left by chance in one search of twenty.
_SELDOM = 0.05
# A correlation that is worth a word.
_ALIAS = 0.5
# The catalogue has one half of the family-wise level, probes the other.
_HALVES = 2.0
_INVISIBLE = "not measurable with this plan: the model's own freedom does nearly all that it would do"


@dataclass(frozen=True, eq=False)
class Diagnosis(Answer):
    """What is missing in a model, by these measurements.

    Attributes
    ----------
    between_passes
        What does not come back from pass to pass, and what rows scatter, beside all that was found.
    as_it_was
        The fit that was given, or that of the model; `fitted` is the one that was searched, which has other bases
        beside a large effect.
    comparison
        The model held against the measurements; None where a fit was diagnosed.
    search
        What `searched` gives; None where it was let go.
    later_tied
        Of each that was found after the first, those that these data cannot tell from it; `tied` has the first's.
    other_way
        What the model that is held leaves has no name, and its numbers were fitted to these data, too: that answer,
        or, where that one has a name and is this, the one of the model as it is. None where one was enough.
    """

    found: tuple[Finding, ...]
    candidates: tuple[Finding, ...]
    unknown: Unknown | None
    between_passes: BetweenPasses
    as_it_was: Fitted
    comparison: Comparison | None = None
    search: Searched | None = None
    later_tied: tuple[tuple[Finding, ...], ...] = ()
    other_way: Diagnosis | None = None

    @property
    def searched(self) -> Searched:
        """Every number behind it.

        Raises
        ------
        GeoerrError
            where they were let go.
        """
        if self.search is None:
            raise GeoerrError(
                "the numbers behind this diagnosis were let go\nhint: diagnose again, and keep what that gives"
            )
        return self.search

    def without_numbers(self) -> Diagnosis:
        """Give what it says alone: the numbers behind it are, of 100,000 points, gigabytes."""
        return replace(self, search=None)

    @cached_property
    def held_out_rmse_um(self) -> float | None:
        """Held-out error of the model as it was."""
        return held_out_um(self.as_it_was)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What one has to know before trusting it: sentences, without a full stop."""
        return notes_of(
            self.as_it_was,
            self.comparison,
            has_found=bool(self.found) or self.unknown is not None,
            blames_cameras=any(one.is_rig for one in (*self.found, *self.tied)),
            other_way=self.other_way,
        )

    @property
    def takes_part(self) -> bool:
        """Whether the model's own numbers were fitted to these data, or only measuring frames were."""
        return self.comparison is None or not self.comparison.is_held

    @property
    def is_without_errors(self) -> bool:
        """Whether points were held against a machine without errors: the 21 are to be fitted first."""
        return is_without_errors(self.as_it_was, self.comparison)

    @property
    def tied(self) -> tuple[Finding, ...]:
        """The first candidate and those that these data cannot tell from it; none where nothing was found."""
        return (self.candidates[0], *(one for one in self.candidates[1:] if one.tied)) if self.found else ()

    def tied_with(self, finding: Finding) -> tuple[Finding, ...]:
        """Give what these data cannot tell from something that was found."""
        place = next(number for number, one in enumerate(self.found) if one.reference == finding.reference)
        return self.tied[1:] if place == 0 else self.later_tied[place - 1]

    @property
    def not_told_apart(self) -> tuple[Finding, ...]:
        """Everything that these data cannot tell from something that was found, each once, and none of the latter."""
        found = {one.reference for one in self.found}
        every = {rival.reference: rival for one in self.found for rival in self.tied_with(one)}
        return tuple(rival for reference, rival in every.items() if reference not in found)

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        more = "" if self.unknown is None else "; and there is more, which no known effect explains"
        if self.verdict == "missing":
            names = listed([one.company_words for one in self.found])
            return f"{'an effect is' if len(self.found) == 1 else 'effects are'} missing: {names}{more}"
        if self.verdict == "ambiguous":
            others = [_either(self._alternatives(one)) for one in self.found[1:]]
            if len(self.tied) > 1:
                also = f"; missing besides: {listed(others)}" if others else ""
                names = listed(self._alternatives(self.found[0]), "or")
                return f"an effect is missing, and these data cannot tell which: {names}{also}{more}"
            names = listed([self.found[0].company_words, *others])
            return f"effects are missing, and these data cannot tell all of them: {names}{more}"
        if self.unknown is not None:
            return self.unknown.sentence
        if self.p_value is not None and self.p_value <= _NO_CHANCE:
            return (
                "nothing can be named, though what is left is more than chance "
                f"({chance_words(self.p_value)}): more passes would show what it is"
            )
        if self.p_value is not None and self.p_value < _SELDOM:
            return (
                "nothing is missing that these data could show for certain, though chance seldom leaves as much "
                f"({chance_words(self.p_value)}): more passes would tell"
            )
        return f"nothing is missing that these data could show: {chance_words(self.p_value)}"

    def _alternatives(self, finding: Finding) -> list[str]:
        """Name what was found and what looks the same, a few of many."""
        told = list(dict.fromkeys(one.company_words for one in (finding, *self.tied_with(finding))))
        return told if len(told) <= _SPOKEN else [*told[:_SPOKEN], f"{len(told) - _SPOKEN} more"]

    def plot_worth(self) -> go.Figure:
        """Draw what each candidate is worth, and the held-out error without it and with it.

        Raises
        ------
        GeoerrError
            where there is no candidate.
        """
        return drawn("diagnosis_bars", self)

    def plot_fall(self) -> go.Figure:
        """Draw how the held-out error would fall if what was found were added, one after the other."""
        return drawn("diagnosis_fall", self)

    def plot_unknown(self) -> go.Figure:
        """Draw what has no name: its curve or surface.

        Raises
        ------
        GeoerrError
            where everything has a name.
        """
        return drawn("unknown_curve", self)

    def _repr_html_(self) -> str:
        """Show the verdict and the candidates, for a notebook."""
        return diagnosis_html(self)

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it, and more."""
        return {
            **super().to_document(),
            "sentence": self.sentence,
            "between_passes": self.between_passes.to_document(),
            "model_takes_part": self.takes_part,
            "other_way": None if self.other_way is None else self.other_way.in_short(),
            "notes": list(self.notes),
        }

    def in_short(self) -> dict[str, Any]:
        """Give the verdict alone, as `diagnose --json` has it of the other way."""
        return {
            "model_takes_part": self.takes_part,
            "verdict": self.verdict,
            "p_value": self.p_value,
            "held_out_rmse_um": self.held_out_rmse_um,
            "sentence": self.sentence,
        }


def diagnose(
    subject: Model | Fitted,
    *tables: Observations | CircularTest,
    effects: Sequence[Effect] = (),
    refit: bool = False,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    progress: Progress | None = None,
    on_step: OnStep | None = None,
    threads: int = 0,
) -> Diagnosis:
    """Find which physical effects a model lacks.

    Parameters
    ----------
    subject
        A model, or a fit. Where a model was fitted to these very measurements its own freedom takes part; else only
        the measuring frames do, and by as much as the model may be off by its covariance it lacks nothing. Where what
        is left so has no name, its freedom takes part, too: what acted on the model's own data already is in its
        numbers, and only the rest of it is seen, which is no known effect's. A name that is found so is the answer.
    tables
        Measurements; none where `subject` is a fit. Circular tests beside points; alone they are for
        `geoerr.diagnose.circles.diagnose_circles`.
    effects
        A user's own, beside the catalogue's.
    refit
        Fit the model's coefficients to data that are not its own, too.
    rig_sensitivity, rig_covariance
        The calibration's uncertainty, as for `compare`; what its unknowns can do is no candidate's. None of a fit,
        which has its own.
    progress
        Called with the steps done and the least number that there will be: what is found makes it grow.
    on_step
        Called with what comes next in words: which round of the search, beside what, and what is tried in it. What it
        raises ends the work.

    Raises
    ------
    GeoerrError
        where there are no measurements, circular tests alone, or a fit is given some.

    Notes
    -----
    Verified in tests/diagnose: gains and scores against least squares written out, the noise against dense matrices,
    and the search on machines that hide something, and on machines that hide nothing.
    """
    steps = Steps(progress, on_step)
    steps.next("the model and the measurements are compared")
    known = catalogue().extended(effects, "effects") if effects else catalogue()
    if isinstance(subject, Fitted):
        if tables:
            raise GeoerrError("a fit has its measurements already\nhint: give the fit alone, or its model and tables")
        whole, searched = searched_whole(subject, known, steps=steps, threads=threads)
        found = diagnosis_of(whole, searched, known, as_it_was=subject, steps=steps)
        steps.end()
        return found
    if not tables:
        raise GeoerrError("a diagnosis needs measurements\nhint: give the tables after the model")
    if all(isinstance(table, CircularTest) for table in tables):
        raise GeoerrError(
            "circular tests alone have causes and noise of their own\n"
            "hint: geoerr.diagnose.circles.diagnose_circles(model, *tests) looks for them"
        )
    compared = partial(
        compare, subject, *tables, rig_sensitivity=rig_sensitivity, rig_covariance=rig_covariance, threads=threads
    )
    found = _of_comparison(compared(refit=refit), known, steps, threads)
    if found.verdict == "unknown" and not found.takes_part and all_terms(subject):
        found = _the_better_way(found, partial(compared, refit=True), known, steps, threads)
    steps.end()
    return found


def _of_comparison(comparison: Comparison, known: Catalogue, steps: Steps, threads: int) -> Diagnosis:
    """Search what a model leaves, as it is held or fitted."""
    fitted, held, doubt = comparison.points, list[str](), None
    # A model that is held has its terms outside the fit.
    if comparison.is_held:
        # Of an effect that it has the machine may have come to have more.
        held = [term.id for term in all_terms(comparison.model) if term.kind == "classic"]
        doubt = own_doubt(comparison.model, fitted, counts_choice=True)
    whole, searched = searched_whole(fitted, known, present=held, doubt=doubt, steps=steps, threads=threads)
    return diagnosis_of(whole, searched, known, comparison, as_it_was=fitted, steps=steps)


def _the_better_way(
    held: Diagnosis, freely: Callable[[], Comparison], known: Catalogue, steps: Steps, threads: int
) -> Diagnosis:
    """Give the answer with the model's numbers fitted, too, where that has a name; else the one that there is.

    Verified by `validation/given_models.py`.
    """
    steps.next("what is left has no name: the model's numbers are fitted to these data, too")
    try:
        fitted = _of_comparison(freely(), known, steps, threads)
    except GeoerrError:
        # Too little was measured for that.
        return held
    if fitted.found:
        return replace(fitted, other_way=held.without_numbers())
    return replace(held, other_way=fitted.without_numbers())


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
        self.held = {term.id for term in held}

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
            Alias(reference_of(rival.judged), rival.correlation, self._is_tied(first, rival))
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
        return replace(finding, alike=self._alike(finding.term))

    def _alike(self, term: Term) -> dict[str, tuple[float, ...]]:
        """Give other values of an inner parameter that say the same at the places that were measured."""
        found = other_periods(self.searched.bench.functions, term, self.fitted.solved.used)
        return {} if found is None else {term.inner[found[0]].name: tuple(found[1])}

    def _rivals(self, first: Found) -> list[Finding]:
        rivals = _listed(first)
        # One that was found itself is worth what it is beside the first, not beside itself; and so is what a later
        # find stands for.
        beside = {reference_of(one.judged): one.at_last for one in self.searched.found}
        beside |= {name: settled for later in self.searched.found[1:] for name, settled in self._stood_for(later)}
        return [
            self._rival(first, rival, beside.get(reference_of(rival.judged), settled), [])
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

    def _rival(self, found: Found, rival: Rival, settled: Settled, earlier: Sequence[Settled]) -> Finding:
        name = reference_of(found.judged)
        is_tied = self._is_tied(name, rival)
        return self._finding(
            rival.judged,
            settled,
            tied=is_tied,
            aliases=(Alias(name, rival.correlation, is_tied),) if rival.correlation > _ALIAS else (),
            against=name,
            held_out=self._held_out(rival.settled, earlier),
            together=rival.together,
            left_because=self._why_left(name, rival),
        )

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
        moved_um = displacement_um(settled.space, settled.displacement)
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
            in_model=str(reference) in self.held,
            together=together,
            left_because=left_because,
        )

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
        earlier = [one.settled.term for one in self.searched.found]
        curve, held_out = None, None
        before = with_terms(self.fitted, earlier)
        # Of what the model has in part the data may leave nothing to draw a curve by.
        with contextlib.suppress(InputFileError):
            term = empirical_term(before, reference)
            after = fit_again(before, [*before.terms, term])
            curve, held_out = curve_of(after, term.id), _on_common_rows(before, after)
        columns = self.fitted.sightings.covariate_columns
        moved_um = displacement_um(settled.space, settled.displacement)
        return Unknown(
            probe.depends_on,
            probe.component,
            settled.visible_um,
            min(_HALVES * judged.p_value, 1.0),
            self._where(moved_um, [name for name in probe.depends_on if name in ("x", "y", "z", *columns)]),
            moved_um,
            reference,
            curve,
            held_out,
        )


def _advised(finding: Finding, separation: Separation | None) -> Finding:
    return finding if separation is None else replace(finding, separate_by=separation)


def _either(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"either {listed(names, 'or')}"


def with_terms(fitted: Fitted, terms: Sequence[Term | None]) -> Fitted:
    """Fit with more terms: everything free, inner parameters starting where the search found them."""
    added = [term for term in terms if term is not None]
    return fit_again(fitted, [*fitted.terms, *added]) if added else fitted


def _on_common_rows(before: Fitted, after: Fitted) -> HeldOut:
    """Compare two fits; rows that lack what the second needs take no part in either figure."""
    if len(after.sightings) < len(before.sightings):
        before = fit_again(after, before.terms)
    return HeldOut(held_out_um(before), held_out_um(after))


def _listed(first: Found) -> list[Rival]:
    """Give the rivals that are listed: the nearest, and all that the data do not tell from the first."""
    return [one for place, one in enumerate(first.rivals) if place < _LISTED or one.is_tied]


def _invisible(searched: Searched) -> list[tuple[str, str]]:
    seen = {reference_of(one).effect for one in searched.first.candidates}
    names = dict.fromkeys(
        one.effect.id if one.effect.id not in seen else str(one.reference) for one in searched.first.invisible
    )
    return [(name, _INVISIBLE) for name in names]
