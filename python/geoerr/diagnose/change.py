"""Adding an effect to a model, or taking one away: refitted, with the errors before and after on the same rows.

The model's own terms are fitted along, with the bases that they have. Rows that lack a covariate of the effect take
no part in either figure. The model file remembers every change (`history`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from geoerr.arguments import check_threads
from geoerr.diagnose.steps import OnStep, Progress, Steps
from geoerr.diagnose.summary import change_html
from geoerr.effects import Effect, catalogue
from geoerr.effects.plausible import has_wrong_sign
from geoerr.errors import GeoerrError, ShapeError
from geoerr.fit import (
    FitOptions,
    FitResult,
    Fitted,
    Way,
    figures_to_remember,
    fit_terms,
    refit,
    result_of,
    sightings_of,
)
from geoerr.fit.additions import additions, held_errors, usual_terms
from geoerr.fit.beside_effects import few_beside
from geoerr.fit.choose_again import choose_again, is_worth_asking
from geoerr.fit.empirical import curve_in, finer_term, is_empirical
from geoerr.fit.inner import has_unknown_inner
from geoerr.fit.other_sessions import refuse_other_sessions
from geoerr.fit.shared_noise import with_shared_noise
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import lacks_some
from geoerr.fit.wavy import may_be_followed
from geoerr.model import HistoryEntry, Model
from geoerr.model.called import check_model, check_tables, kind_of
from geoerr.observations import CircularTest, Lengths, MeasuredTable, Observations
from geoerr.terms import EffectReference, Term, parse_effect_reference

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False)
class Change:
    """An effect added or taken away.

    Attributes
    ----------
    result
        The model after it, with its history, of all rows that it can do with.
    before, after
        The fits without and with the change, on the same rows.
    """

    result: FitResult
    before: Fitted
    after: Fitted

    def sign_notes(self) -> tuple[str, ...]:
        """Say which values of the model have a sign that their effects do not allow, for certain."""
        return tuple(
            f"{term.id}: {one.name} = {one.value:.3g} ± {one.std:.2g} {one.unit} has the sign that its effect "
            "excludes: something else is at work, or the formula has the other sign"
            for term in self.result.model.terms
            for one in term.coefficients
            if has_wrong_sign(one)
        )

    def plot_fall(self) -> go.Figure:
        """Draw how the error fell, up to this change."""
        return self.result.model.plot_fall()

    def _repr_html_(self) -> str:
        """Show the errors before and after, for a notebook."""
        return change_html(self)


def add_effect(
    model: Model,
    *tables: MeasuredTable,
    reference: str | EffectReference,
    effects: Sequence[Effect] = (),
    way: Way | None = None,
    known: Fitted | FitResult | None = None,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    progress: Progress | None = None,
    on_step: OnStep | None = None,
    threads: int = 0,
) -> Change:
    """Add what a reference names, and fit the whole model again.

    Of an effect's forms, lagged and not, the one is taken that explains most of what the model leaves;
    `empirical:x@feed` is a curve without a cause (`geoerr.fit.empirical`), and one that the model has already is made
    finer.

    Parameters
    ----------
    model
        What there is: its terms are fitted along.
    tables
        The measurements.
    reference
        `ID[:AXIS][@COVARIATE]`.
    effects
        A user's own, beside the catalogue's.
    way
        How the effect is written, where that is not for the data to say.
    known
        As for `add_terms`.
    rig_sensitivity, rig_covariance
        The calibration's uncertainty, as for `geoerr.fit_model`: of a model that was fitted with it, it is needed
        again.
    progress
        Called with the steps done and the least number that there will be.
    on_step
        Called with what comes next, in words. What either raises ends the work between two steps.

    Raises
    ------
    InputFileError
        for a reference that names no effect, or one that these data cannot carry.
    GeoerrError
        where the model has the effect already, or a curve of which these data show no more.
    ShapeError
        for what is no model, table, fit or number of threads.
    """
    check_threads(threads)
    check_model(model, tables, "add_effect(model, observations, reference='backlash:x')")
    check_tables(
        tables, "add_effect(model, observations, reference='backlash:x')", Observations, CircularTest, Lengths
    )
    if not isinstance(reference, str | EffectReference):
        raise ShapeError(f"reference: {kind_of(reference)} was given\nhint: write it as ID[:AXIS][@COVARIATE]")
    reference = str(reference)
    known = _checked_known(known, tables)
    names = catalogue().extended(effects, "effects") if effects else catalogue()
    curve = curve_in(own_terms(model), reference) if is_empirical(reference) else None
    if curve is None:
        _refuse_held(model, str(parse_effect_reference(reference)))
    data = _Data(tables, rig_sensitivity, rig_covariance, threads, known, Steps(progress, on_step))
    data.steps.next("the measurements are put together")
    if curve is not None:
        return _made_finer(model, data, curve, known)
    like = () if is_empirical(reference) else usual_terms(*names.resolve(reference), model.machine, data.sightings)
    own = _own_beside(model, data, like, known)

    def fit(more: Sequence[Term]) -> Fitted:
        nonlocal own
        data.steps.next(f"the fit that {reference} is chosen beside")
        if more or own.has_fewer_knots:
            return data.fitted(model, [*own.terms, *more])
        # What the form is chosen beside is what was before, too.
        own = replace(own, fitted=own.fitted or data.fitted(model, own.terms))
        assert own.fitted is not None
        return own.fitted

    held = held_errors("none", own.terms)
    found = additions([reference], names, model.machine, data.sightings, held, fit, way)[0]
    return _added(model, data, own, found.terms, found.reference, found.title)


def _made_finer(model: Model, data: _Data, curve: Term, known: Fitted | None) -> Change:
    """Fit again with more polynomials in a curve that the model has.

    Raises
    ------
    GeoerrError
        where these data have no evidence of more.
    """
    own = own_terms(model)
    data.steps.next("the model as it is")
    fitted = known or data.fitted(model, own)
    finer = finer_term(fitted, curve)
    if finer is None:
        raise GeoerrError(
            f"{curve.id} is in the model already, and these data show no more of it\n"
            "hint: `geoerr remove` takes it out"
        )
    return _added(model, data, _Own(own, fitted), (finer,), curve.id, f"{curve.title}; made finer")


def _checked_known(known: Fitted | FitResult | None, tables: Sequence[MeasuredTable]) -> Fitted | None:
    """Give the fit that is known; refuse one of other measurements: what it says would be taken for theirs.

    Raises
    ------
    ShapeError
        for what is no fit, or one of others.
    """
    fitted = known.fitted if isinstance(known, FitResult) else known
    if fitted is None:
        return None
    if not isinstance(fitted, Fitted):
        raise ShapeError(
            f"known: {kind_of(fitted)} was given\nhint: give the fit of these measurements, or leave it out"
        )
    own = fitted.sightings.measured_mm[fitted.sightings.is_measured]
    given = np.concatenate(
        [
            np.ravel(one.measured_mm) if isinstance(one, Observations) else one.frame["r"].cast(pl.Float64).to_numpy()
            for one in tables
        ]
    )
    # Rows that it could not use are in the tables all the same.
    is_whole = own.size == np.isfinite(given).sum() or bool(fitted.sightings.left_out)
    if not (is_whole and np.isin(own, given).all()):
        raise ShapeError(
            "known: this is a fit of other measurements\nhint: give the fit of these measurements, or leave it out"
        )
    return fitted


def _refuse_held(model: Model, *names: str) -> None:
    held = {term.id for term in own_terms(model)}
    twice = [name for name in names if name in held]
    if twice:
        raise GeoerrError(f"{twice[0]} is in the model already\nhint: `geoerr remove` takes it out")


def add_terms(
    model: Model,
    tables: Sequence[MeasuredTable],
    terms: Sequence[Term],
    reference: str,
    title: str,
    *,
    known: Fitted | None = None,
    searched: Fitted | None = None,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    progress: Progress | None = None,
    on_step: OnStep | None = None,
    threads: int = 0,
) -> Change:
    """Add an effect and fit the whole model again.

    Parameters
    ----------
    model
        What there is: its terms are fitted along.
    tables
        The measurements.
    terms
        The effect's; values that they have are where the fit begins.
    reference, title
        As the history names it.
    known
        The fit of the model as it is to the same measurements, if there is one: it is what was before, where the same
        rows take part.
    searched
        The fit that a diagnosis found the effect beside: its bases are what the data choose beside what is missing.
        Without it they are chosen once more here, which takes two fits.
    rig_sensitivity, rig_covariance, progress, on_step
        As for `add_effect`.

    Raises
    ------
    GeoerrError
        where the model has the effect already.
    """
    _refuse_held(model, *(term.id for term in terms))
    data = _Data(tables, rig_sensitivity, rig_covariance, threads, known, Steps(progress, on_step))
    own = _own_beside(model, data, terms, known) if searched is None else _own_as_searched(model, known, searched)
    return _added(model, data, own, terms, reference, title)


@dataclass(frozen=True, eq=False)
class _Own:
    """A model's own terms as they stand beside an effect, and the fit of the model as it is, where it is known.

    `are_chosen`: their bases are those that the data choose beside it.
    """

    terms: Sequence[Term]
    fitted: Fitted | None
    has_fewer_knots: bool = False
    are_chosen: bool = False


def _own_beside(model: Model, data: _Data, terms: Sequence[Term], fitted: Fitted | None = None) -> _Own:
    """Give a model's own terms, with few knots where many would share with an effect what it explains."""
    own = own_terms(model)
    if not any(may_be_followed(one, term) for one in own for term in terms):
        return _Own(own, fitted)
    if fitted is None:
        data.steps.next("the model as it is")
        fitted = data.fitted(model, own)
    few = few_beside(fitted, terms)
    return _Own([few.get(one.id, one) for one in own], fitted, bool(few))


def _own_as_searched(model: Model, fitted: Fitted | None, searched: Fitted) -> _Own:
    """Give a model's own terms on the bases that a search had beside what it found."""
    by_id = {term.id: term for term in searched.terms}
    return _Own([by_id.get(term.id, term) for term in own_terms(model)], fitted, are_chosen=True)


def _added(model: Model, data: _Data, own: _Own, terms: Sequence[Term], reference: str, title: str) -> Change:
    """Add terms to a model's own, in the place of those that have their ids."""
    names = {term.id for term in terms}
    data.steps.next(f"the fit with {reference}")
    after = data.fitted(model, [*(one for one in own.terms if one.id not in names), *terms])
    if own.fitted is None:
        data.steps.next("the model as it is, on the same rows")
    before = own.fitted or _before(model, own, after)
    if not own.are_chosen and is_worth_asking(before.scale, after.scale):
        data.steps.next(f"the freedom that the rest needs beside {reference}")
        chosen = choose_again(after)
        if chosen is not None:
            # The same rows, joined and placed already.
            after = after.again(chosen)
    if not _are_of_the_same_rows(before, after) or before is own.fitted:
        before = _before(model, own, after)
    return _change(model, data, before, after, "added", reference, title, [term.id for term in terms])


def _before(model: Model, own: _Own, after: Fitted) -> Fitted:
    """Give the fit of the model as it was to the rows of the one with the effect.

    To just these: rows that are far off by the effect alone are gross to a model that lacks it, and count.
    """
    terms = own_terms(model)
    if own.fitted is not None and _is_of(own.fitted, {term.id for term in own.terms}, after):
        return own.fitted
    return replace(after.again(terms, used=after.solved.used), choices=after.choices)


def _is_of(known: Fitted, held: set[str], after: Fitted) -> bool:
    """Tell whether a fit is that of these terms to the rows of another one."""
    return {term.id for term in known.terms} == held and _are_of_the_same_rows(known, after)


def _are_of_the_same_rows(one: Fitted, other: Fitted) -> bool:
    return np.array_equal(one.solved.used, other.solved.used)


def _only_one(effects: Sequence[str], reference: str) -> str:
    """Give the only effect that a reference without its covariate may mean; else the reference."""
    meant = [own for own in effects if own.partition("@")[0] == reference]
    return meant[0] if len(meant) == 1 else reference


def remove_terms(
    model: Model,
    tables: Sequence[MeasuredTable],
    reference: str,
    *,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    progress: Progress | None = None,
    on_step: OnStep | None = None,
    threads: int = 0,
) -> Change:
    """Take an effect away and fit what is left again.

    Parameters
    ----------
    reference
        The effect's, as the model's report writes it: `thermal-expansion:x@temp_bed`.
    rig_sensitivity, rig_covariance, progress, on_step
        As for `add_effect`.

    Raises
    ------
    GeoerrError
        where the model has no such effect, naming those that it has.
    """
    terms = own_terms(model)
    effects = [term.id for term in terms if term.kind != "classic"]
    # As it was asked for: what follows one thing alone need not be told which.
    reference = reference if reference in effects else _only_one(effects, reference)
    if not any(term.id == reference for term in terms):
        raise GeoerrError(
            f"the model has no effect {reference!r}\nhint: it has {', '.join(effects) if effects else 'no effects'}"
        )
    title = next(term.title for term in terms if term.id == reference)
    data = _Data(tables, rig_sensitivity, rig_covariance, threads, steps=Steps(progress, on_step))
    data.steps.next("the model as it is")
    before = data.fitted(model, terms)
    left = [term for term in before.terms if term.id != reference]
    data.steps.next(f"the fit without {reference}")
    after = refit(before, left)
    whole = _with_all_rows(model, data, before, left) if lacks_some(before.sightings) else after
    return _change(model, data, before, after, "removed", reference, title, [reference], whole=whole)


def _with_all_rows(model: Model, data: _Data, before: Fitted, left: Sequence[Term]) -> Fitted:
    """Fit what is left to the rows that lacked what the effect needed, too: the model does without it.

    Bases were chosen without them, and may be too stiff for what they show.
    """
    whole = data.fitted(model, left)
    if len(whole.sightings) == len(before.sightings):
        return whole
    chosen = choose_again(whole, before.sightings)
    return whole if chosen is None else refit(whole, chosen)


def own_terms(model: Model) -> tuple[Term, ...]:
    """Give all terms of a model: of the machine, tables too, and of the rig."""
    return (*model.all_machine_terms, *model.rig_terms)


@dataclass(frozen=True, eq=False)
class _Data:
    """Measurements, joined once, with how the calibration moves the points (n, 3, p) and its covariance (p, p).

    `known` is a fit to them, if there is one: where it needed all of their rows it holds them joined, and placed.
    `steps` is told what comes next.
    """

    tables: Sequence[MeasuredTable]
    rig_sensitivity: Numbers | None
    rig_covariance: Numbers | None
    threads: int
    known: Fitted | None = None
    steps: Steps = field(default_factory=Steps)

    @cached_property
    def sightings(self) -> Sightings:
        return sightings_of(*self.tables) if self._of_all_rows is None else self._of_all_rows.sightings

    @property
    def _of_all_rows(self) -> Fitted | None:
        return None if self.known is None or lacks_some(self.known.sightings) else self.known

    def fitted(self, model: Model, terms: Sequence[Term]) -> Fitted:
        """Fit these terms alone."""
        refuse_other_sessions(model, self.sightings)
        if self._of_all_rows is not None and not any(map(has_unknown_inner, terms)):
            return self._of_all_rows.again(tuple(terms))
        return fit_terms(
            model.machine,
            self.tables,
            effects=terms,
            options=FitOptions(components="none", threads=self.threads),
            rig_sensitivity=self.rig_sensitivity,
            rig_covariance=self.rig_covariance,
            sightings=self.sightings,
        )


def _change(
    model: Model,
    data: _Data,
    before: Fitted,
    after: Fitted,
    action: str,
    reference: str,
    title: str,
    changed: Sequence[str],
    *,
    whole: Fitted | None = None,
) -> Change:
    """Give a change with both fits to the same rows; the model is that of `whole`, where that has more rows."""
    after = with_shared_noise(after)
    held = after if action == "added" else with_shared_noise(before)
    data.steps.next("each pass predicted by the others, before and after")
    entry = HistoryEntry(
        reference=reference,
        title=title,
        figures_before=figures_to_remember(before),
        figures_after=figures_to_remember(after),
        parameters=tuple(p for term in held.terms if term.id in changed for p in (*term.coefficients, *term.inner)),
        action="added" if action == "added" else "removed",
    )
    earlier = () if model.record is None else model.record.history
    result = result_of(after if whole is None else with_shared_noise(whole), (*earlier, entry))
    data.steps.end()
    return Change(result, before, after)
