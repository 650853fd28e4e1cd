"""Which physical effect is missing: the search's result, with values, worth, doubt and words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

from geoerr.diagnose.comparison import compare
from geoerr.diagnose.probes import Probe
from geoerr.diagnose.search import Found, Judged, Searched, Settled, search, settle
from geoerr.effects import Effect, catalogue
from geoerr.effects.collection import Catalogue
from geoerr.effects.plausible import plausible_match, plausible_words
from geoerr.errors import GeoerrError
from geoerr.fit import Fitted, refit
from geoerr.model import Model
from geoerr.observations import CircularTest, Observations
from geoerr.terms import EffectReference, Parameter, Term

Verdict = Literal["missing", "nothing-missing", "unknown", "ambiguous"]

# Candidates that a diagnosis lists beside the first.
_LISTED = 8
# A correlation that is worth a word.
_ALIAS = 0.5
# Candidates, from the best, whose held-out error is computed by a refit.
_REFITTED = 3
_INVISIBLE = "not measurable with this plan: the model's own freedom does nearly all that it would do"


@dataclass(frozen=True)
class Alias:
    """A candidate that these data can hardly tell from another.

    Attributes
    ----------
    reference
        The other.
    correlation
        Cosine between what the one explains and what the other could.
    """

    reference: EffectReference
    correlation: float


@dataclass(frozen=True)
class Separation:
    """The measurement that would tell two candidates apart."""

    text: str
    plan: str | None
    minutes: float | None


@dataclass(frozen=True, eq=False)
class Finding:
    """A candidate in the diagnosis.

    Attributes
    ----------
    reference, effect
        Which.
    p_value
        Family-wise, over everything that was looked at.
    evidence
        Logarithm of the Bayes factor against the model without it (Schwarz), trial values counted.
    worth_um
        Root mean square of what it explains that the model cannot, components summed as for errors.
    parameters
        Values with standard errors.
    tied
        Whether the data cannot tell it from the first.
    aliases
        What is like it.
    separate_by
        The measurement that would tell it from the first, or from the first one tied with it.
    held_out_rmse_after_um
        Held-out error with it in the model; None where it was not computed.
    """

    reference: EffectReference
    effect: Effect
    p_value: float
    evidence: float
    worth_um: float
    parameters: tuple[Parameter, ...]
    tied: bool
    aliases: tuple[Alias, ...]
    separate_by: Separation | None
    held_out_rmse_after_um: float | None

    def words(self) -> str:
        """Say in one sentence what it is, its values, whether they are plausible, its worth and how sure it is."""
        values = "; ".join(_value_words(parameter) for parameter in self.parameters)
        sure = f"p = {self.p_value:.2g}" if self.p_value >= 1e-12 else "p < 1e-12"
        return f"{self.effect.title} ({self.reference}): {values}. Worth {self.worth_um:.1f} µm, {sure}"

    def to_document(self) -> dict[str, Any]:
        """Give it as FORMATS' `diagnose --json` has it."""
        return {
            "effect": self.reference.effect,
            "axis": self.reference.axis,
            "covariate": self.reference.covariate,
            "p_value": self.p_value,
            "held_out_rmse_after_um": self.held_out_rmse_after_um,
            "worth_um": self.worth_um,
            "parameters": {
                parameter.name: {
                    "value": _finite(parameter.value),
                    "std": _finite(parameter.std),
                    "unit": parameter.unit,
                    "plausible": _plausible(parameter),
                }
                for parameter in self.parameters
            },
            "tied": self.tied,
            "aliases": [
                {
                    "effect": alias.reference.effect,
                    "axis": alias.reference.axis,
                    "covariate": alias.reference.covariate,
                    "correlation": alias.correlation,
                }
                for alias in self.aliases
            ],
            "separate_by": None
            if self.separate_by is None
            else {
                "text": self.separate_by.text,
                "plan": self.separate_by.plan,
                "minutes": self.separate_by.minutes,
            },
        }


@dataclass(frozen=True)
class Unknown:
    """Structure that no candidate explains.

    Attributes
    ----------
    depends_on
        Variables.
    component
        Axis of the base along which it acts.
    worth_um, p_value
        As for a candidate.
    """

    depends_on: tuple[str, ...]
    component: str
    worth_um: float
    p_value: float

    def words(self) -> str:
        """Say it in a sentence."""
        on = " and ".join(self.depends_on)
        worth = f"worth {self.worth_um:.1f} µm"
        return f"something that no known effect explains acts along {self.component} and depends on {on}, {worth}"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is missing in a model, by these measurements.

    Attributes
    ----------
    verdict
        `missing` (named), `nothing-missing`, `unknown` (something is, without a name) or `ambiguous` (named, but not
        alone).
    p_value
        That nothing is missing, for everything that was looked at; before any gate.
    fitted
        The fit that was diagnosed.
    found
        The effects that the search added, in that order.
    candidates
        For the first of them, best first.
    unknown
        Structure without a name, or None.
    not_offered
        What could not be looked for, and why.
    searched
        Every number behind it.
    """

    verdict: Verdict
    p_value: float
    fitted: Fitted
    found: tuple[Finding, ...]
    candidates: tuple[Finding, ...]
    unknown: Unknown | None
    not_offered: tuple[tuple[str, str], ...]
    searched: Searched

    @property
    def noise_floor_um(self) -> float | None:
        """Scatter of repeated rows; None without repeats."""
        return self.fitted.repeats.floor_um

    @cached_property
    def held_out_rmse_um(self) -> float | None:
        """Held-out error of the model as it was."""
        return _held_out_um(self.fitted)

    def to_document(self) -> dict[str, Any]:
        """Give it as FORMATS' `diagnose --json` has it."""
        return {
            "verdict": self.verdict,
            "p_value": self.p_value,
            "noise_floor_um": self.noise_floor_um,
            "held_out_rmse_um": self.held_out_rmse_um,
            "found": [finding.to_document() for finding in self.found],
            "candidates": [finding.to_document() for finding in self.candidates],
            "not_offered": [{"effect": effect, "why": why} for effect, why in self.not_offered],
            "unknown": None
            if self.unknown is None
            else {
                "depends_on": list(self.unknown.depends_on),
                "component": self.unknown.component,
                "worth_um": self.unknown.worth_um,
                "p_value": self.unknown.p_value,
            },
        }


def diagnose(
    subject: Model | Fitted,
    *tables: Observations | CircularTest,
    effects: Sequence[Effect] = (),
    threads: int = 0,
) -> Diagnosis:
    """Find which physical effects a model lacks.

    Parameters
    ----------
    subject
        A model, or a fit. Where a model was fitted to these very measurements its own freedom takes part; else only
        the measuring frames do.
    tables
        Measurements; none where `subject` is a fit.
    effects
        A user's own, beside the catalogue's.

    Raises
    ------
    GeoerrError
        where there are no measurements, or a fit is given some.

    Notes
    -----
    Verified in tests/diagnose: gains and scores against least squares written out, the noise against dense matrices,
    and the search on machines that hide something, and on machines that hide nothing.
    """
    if isinstance(subject, Fitted):
        if tables:
            raise GeoerrError("a fit has its measurements already\nhint: give the fit alone, or its model and tables")
        fitted = subject
    else:
        if not tables:
            raise GeoerrError("a diagnosis needs measurements\nhint: give the tables after the model")
        fitted = compare(subject, *tables, threads=threads).points
    known = catalogue().extended(effects, "effects") if effects else catalogue()
    return _diagnosis(fitted, search(fitted, known, threads=threads), known)


def _diagnosis(fitted: Fitted, searched: Searched, known: Catalogue) -> Diagnosis:
    found = tuple(_found_finding(fitted, searched, place, known) for place in range(len(searched.found)))
    candidates: tuple[Finding, ...]
    if searched.found:
        first = searched.found[0]
        others = tuple(
            _finding(
                known,
                rival.judged,
                rival.settled,
                tied=rival.is_tied or known.are_twins(_reference(first.judged), _reference(rival.judged)),
                aliases=(Alias(_reference(first.judged), rival.correlation),) if rival.correlation > _ALIAS else (),
                against=_reference(first.judged),
                after=_after(fitted, [rival.settled.term]) if place < _REFITTED - 1 else None,
            )
            for place, rival in enumerate(first.rivals[:_LISTED])
        )
        candidates = (_first_finding(fitted, first, known), *others)
    else:
        candidates = tuple(
            _finding(known, judged, settled, tied=False, aliases=(), against=None, after=None)
            for judged in searched.first.candidates[:_LISTED]
            for settled in [settle(searched.first.space, searched.first.scanner, judged)]
        )
    verdict: Verdict = "nothing-missing"
    if found:
        verdict = "ambiguous" if any(one.tied for one in candidates[1:]) else "missing"
    elif searched.unknown is not None:
        verdict = "unknown"
    return Diagnosis(
        verdict,
        searched.first.p_value,
        fitted,
        found,
        candidates,
        None if searched.unknown is None else _unknown(*searched.unknown),
        (*searched.not_offered, *_invisible(searched)),
        searched,
    )


def _found_finding(fitted: Fitted, searched: Searched, place: int, known: Catalogue) -> Finding:
    one = searched.found[place]
    terms = [earlier.settled.term for earlier in searched.found[: place + 1]]
    return _with_rivals(known, one, _after(fitted, terms))


def _first_finding(fitted: Fitted, first: Found, known: Catalogue) -> Finding:
    return _with_rivals(known, first, _after(fitted, [first.settled.term]))


def _with_rivals(known: Catalogue, found: Found, after: float | None) -> Finding:
    aliases = tuple(
        Alias(_reference(rival.judged), rival.correlation) for rival in found.rivals if rival.correlation > _ALIAS
    )
    tied = next((rival for rival in found.rivals if rival.is_tied), None)
    against = None if tied is None else _reference(tied.judged)
    return _finding(known, found.judged, found.settled, tied=False, aliases=aliases, against=against, after=after)


def _finding(
    known: Catalogue,
    judged: Judged,
    settled: Settled,
    *,
    tied: bool,
    aliases: tuple[Alias, ...],
    against: EffectReference | None,
    after: float | None,
) -> Finding:
    reference = _reference(judged)
    assert settled.term is not None
    rival = None if against is None else known.separation(against.effect, reference.effect)
    return Finding(
        reference,
        known[reference.effect],
        min(2.0 * judged.p_value, 1.0),
        judged.evidence,
        settled.visible_um,
        (*settled.term.coefficients, *settled.term.inner),
        tied,
        tuple(sorted(aliases, key=lambda alias: -alias.correlation)),
        None if rival is None else Separation(rival.separate_by, rival.plan, rival.minutes),
        after,
    )


def _unknown(judged: Judged, settled: Settled) -> Unknown:
    assert isinstance(judged.what, Probe)
    return Unknown(judged.what.depends_on, judged.what.component, settled.visible_um, min(2.0 * judged.p_value, 1.0))


def _reference(judged: Judged) -> EffectReference:
    assert not isinstance(judged.what, Probe)
    return judged.what.reference


def _invisible(searched: Searched) -> list[tuple[str, str]]:
    seen = {_reference(one).effect for one in searched.first.candidates}
    names = dict.fromkeys(
        one.effect.id if one.effect.id not in seen else str(one.reference) for one in searched.first.invisible
    )
    return [(name, _INVISIBLE) for name in names]


def _after(fitted: Fitted, terms: Sequence[Term | None]) -> float | None:
    """Give the held-out error with more terms in the model, inner parameters where the search found them."""
    added = [
        replace(term, inner=tuple(replace(one, low=one.value, high=one.value) for one in term.inner))
        for term in terms
        if term is not None
    ]
    return _held_out_um(refit(fitted, [*fitted.terms, *added]))


def _held_out_um(fitted: Fitted) -> float | None:
    figures = fitted.held_out.figures
    return None if figures is None else figures.headline_um


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _plausible(parameter: Parameter) -> str | None:
    match = plausible_match(parameter)
    return None if match is None else match.what


def _value_words(parameter: Parameter) -> str:
    text = f"{parameter.name} = {parameter.value:.4g} ± {parameter.std:.2g} {parameter.unit}".rstrip()
    words = plausible_words(parameter)
    return text if words is None else f"{text} ({words})"
