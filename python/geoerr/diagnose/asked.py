"""Asked which physical effects a model or a fit lacks: compared, searched, and told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from geoerr.arguments import check_threads
from geoerr.diagnose.comparison import Comparison, all_terms, compare
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.own_uncertainty import own_doubt
from geoerr.diagnose.steps import OnStep, Progress, Steps
from geoerr.diagnose.told import diagnosis_of
from geoerr.diagnose.whole_search import searched_whole
from geoerr.effects import Effect, catalogue
from geoerr.effects.collection import Catalogue
from geoerr.errors import GeoerrError
from geoerr.fit import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.model import Model
from geoerr.model.called import check_model, check_tables
from geoerr.observations import CircularTest, Lengths, MeasuredTable, Observations
from geoerr.terms import Term


def diagnose(
    subject: Model | Fitted,
    *tables: MeasuredTable,
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
    ShapeError
        for what is no model or fit, no table, or no number of threads.

    Notes
    -----
    Verified in tests/diagnose: gains and scores against least squares written out, the noise against dense matrices,
    and the search on machines that hide something, and on machines that hide nothing.
    """
    check_threads(threads)
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
    check_model(subject, tables, "diagnose(model, observations)")
    check_tables(tables, "diagnose(model, observations)", Observations, CircularTest, Lengths)
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
    fitted, held, doubt = comparison.whole, tuple[Term, ...](), None
    # A model that is held has its terms outside the fit.
    if comparison.is_held:
        held = all_terms(comparison.model)
        doubt = own_doubt(comparison.model, fitted, counts_choice=True)
    whole, searched = searched_whole(fitted, known, held=held, doubt=doubt, steps=steps, threads=threads)
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
