"""What a person can do on the page: each action changes the session, at once or by work in the background."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from geoerr.diagnose import Comparison, Diagnosis, compare, diagnose
from geoerr.diagnose.change import own_terms, remove_terms
from geoerr.diagnose.circles import CircleDiagnosis, diagnose_circles
from geoerr.effects import Effect, catalogue, load_effects
from geoerr.errors import GeoerrError
from geoerr.fit import FitOptions, fit_model
from geoerr.measurements import Measurements, read_measurements
from geoerr.model import Model, load_model
from geoerr.model.document import document_of
from geoerr.workbench.addition import Addition, fittable, seen_after
from geoerr.workbench.ahead import begin_ahead
from geoerr.workbench.calibration import Calibration, calibration_of
from geoerr.workbench.history import Chapter, Step, lineage
from geoerr.workbench.inputs import ONE_OF_A_KIND, InputFile, dropped
from geoerr.workbench.job import Advance
from geoerr.workbench.own_effect import OwnFormula, own_effect
from geoerr.workbench.program import Wish, correct
from geoerr.workbench.session import Looked, Seen, Session, Trial
from geoerr.workbench.side_by_side import SideBySide, if_alike, numbers_told, side_by_side
from geoerr.workbench.told import told_of

# Panels in which a failure is shown.
DATA: Final = "data"
MISSING: Final = "missing"
OWN: Final = "own"
PROGRAM: Final = "program"
REPORT: Final = "report"


def take_files(session: Session, files: Sequence[InputFile]) -> None:
    """Take more files: tables add to the measurements, effects to the catalogue, and another model begins anew."""
    again = tuple(one.name for one in files if one.kind == "model" and _is_of_this_work(session, one))
    files = [one for one in files if one.kind != "model" or one.name not in again]
    if again and not files:
        with session.lock:
            session.given_again, session.replaced = again, ()
            session.problems.pop(DATA, None)
            session.changed()
        return
    together = {one.name: one for one in (*session.files, *files)}
    for kind in ONE_OF_A_KIND:
        newest = next((one for one in reversed(files) if one.kind == kind), None)
        if newest is not None:
            together = {name: one for name, one in together.items() if one.kind != kind or one is newest}
    known = {one.name for one in session.files if one.kind not in ONE_OF_A_KIND}
    read_again(
        session,
        tuple(together.values()),
        is_new_model=any(one.kind == "model" for one in files),
        keeps=False,
        replaced=tuple(one.name for one in files if one.name in known),
        given_again=again,
    )


def take_dropped(session: Session, names: Sequence[str], contents: Sequence[bytes]) -> None:
    """Take files that were dropped on the page."""
    take_files(session, [dropped(session.folder, *one) for one in zip(names, contents, strict=True)])


def put_away(session: Session, name: str) -> None:
    """Do without a file."""
    rest = tuple(one for one in session.files if one.name != name)
    read_again(session, rest, is_new_model=False, keeps=False)


def go_back(session: Session, number: int) -> None:
    """Go on with the work before another machine or model came; what is there now is kept in its place."""
    with session.lock:
        if not 0 <= number < len(session.earlier):
            raise GeoerrError("that work is not kept any more")
        chapter = session.earlier[number]
    read_again(session, chapter.files, is_new_model=False, keeps=True, chapter=chapter)


def read_again(
    session: Session,
    files: tuple[InputFile, ...],
    *,
    is_new_model: bool,
    keeps: bool,
    replaced: tuple[str, ...] = (),
    given_again: tuple[str, ...] = (),
    chapter: Chapter | None = None,
) -> None:
    """Read files and hold the model against them.

    Parameters
    ----------
    session, files
        What to change, and what it has from now on.
    is_new_model
        Whether the model among them begins anew.
    keeps
        Whether the data are those that the models were compared with.
    replaced, given_again
        Names of files that are gone, and of machines and models that the session has already.
    chapter
        Work to go on with; that of the session if None.
    """

    def work(advance: Advance) -> Callable[[], None]:
        effects = tuple(effect for one in files if one.kind == "effects" for effect in load_effects(one.path))
        catalogue().extended(effects, "effects")
        known = chapter or session.chapter
        steps, current, reference = list(known.steps), known.current, known.reference
        models = [one for one in files if one.kind == "model"]
        if models and (is_new_model or not steps):
            model = load_model(models[-1].path)
            steps, current, reference = [Step(_first_name(model, models[-1].name), model, None)], 0, 0
        tables = [one.path for one in files if one.kind == "measurements"]
        ranges_mm = steps[current].model.machine.ranges_mm if steps else None
        measured = read_measurements(tables, ranges_mm=ranges_mm) if tables else None
        calibration = calibration_of(files, measured)
        # Figures belong to the data that they were computed with; the model that is looked at is compared last.
        again = [current]
        if not keeps:
            again = [one for one in numbers_told(steps, current, reference) if one != current] + again
            steps = [replace(step, figures={}, rows="") for step in steps]
        comparison = None
        if steps and measured is not None:
            for done, number in enumerate(again):
                advance(done, len(again))
                comparison = _compared(session, steps[number].model, measured, calibration)
                steps[number] = steps[number].compared(comparison)
        seen = None if comparison is None else Seen.of(comparison)
        beside = side_by_side(steps, current, reference, measured, calibration, session.threads, advance)

        def apply() -> None:
            with session.lock:
                session.earlier = _kept(session, steps, chapter)
                session.files, session.measured, session.own_effects = list(files), measured, effects
                session.tried = tuple(one for one in session.tried if one.id not in {own.id for own in effects})
                session.calibration, session.replaced, session.given_again = calibration, replaced, given_again
                session.steps, session.current, session.reference = steps, current, reference
                session.beside = beside
                session.forget_step()
                session.told = known.told if keeps else None
                session.program = session.before = None
                _look(session, seen)

        return apply

    session.begin("reading the files", DATA, work)


def fit_classic(session: Session, components: str) -> None:
    """Fit the 21 errors, or the 12 without angles, to the measurements; effects that the model has stay in it."""
    model, data = session.model, session.data
    options = FitOptions(components="12" if components == "12" else "21", threads=session.threads)

    def work(advance: Advance) -> Callable[[], None]:
        effects = [term for term in own_terms(model) if term.kind != "classic"]
        fitted = fit_model(
            model.machine,
            *fittable(data),
            effects=effects,
            options=options,
            on_progress=advance,
            **_calibration(session),
        )
        seen = Seen.of(Comparison(fitted.model, "own", fitted.fitted))
        return _step_to(session, f"{components} errors fitted", seen, advance)

    session.begin(f"fitting the {components} errors", DATA, work)


def find_missing(session: Session, *, is_shown: bool = False) -> None:
    """Search for what the model lacks; `is_shown` draws the pictures anew when it is found."""
    model, data, effects, addition = session.model, session.data, session.known_effects, Addition.to(session)

    def work(advance: Advance) -> Callable[[], None]:
        found: Diagnosis | CircleDiagnosis
        asked: dict[str, Any] = {"effects": effects, "progress": advance, "on_step": advance.say}
        asked |= {"threads": session.threads}
        if data.has_circles_only:
            found = diagnose_circles(model, *data.circles, **asked)
        else:
            found = diagnose(model, *data.tables, **asked, **_calibration(session))
        told = told_of(found, effects)
        if isinstance(found, Diagnosis):
            found = found.without_numbers()
        prepared = addition.prepared(found, advance.say)

        def apply() -> None:
            with session.lock:
                session.diagnosis, session.told, session.reports = found, told, {}
                session.prepared = prepared
                session.sight += is_shown
                begin_ahead(session, addition)

        return apply

    session.begin("looking for what is missing", MISSING, work)


def add(session: Session, reference: str) -> None:
    """Add an effect and fit again; what was added ahead is taken as it is."""
    with session.lock:
        prepared = session.prepared_of(reference)
        if prepared is not None:
            session.refuse_while_busy()
            _step_at_once(session, f"adding {reference}", f"+ {reference}", prepared.seen)
            return
    addition, diagnosis, ahead = Addition.to(session), session.diagnosis, session.ahead

    def work(advance: Advance) -> Callable[[], None]:
        begun = None if ahead is None else ahead(reference, advance)
        if begun is not None:
            return _step_to(session, f"+ {reference}", begun.seen, advance)
        change = addition.of(reference, diagnosis, advance, advance.say)
        return _step_to(session, f"+ {reference}", seen_after(change), advance)

    session.begin(f"adding {reference}", MISSING, work)


def remove(session: Session, reference: str) -> None:
    """Take an effect away and fit again."""
    model, data = session.model, session.data

    def work(advance: Advance) -> Callable[[], None]:
        asked: dict[str, Any] = {"progress": advance, "on_step": advance.say, "threads": session.threads}
        change = remove_terms(model, fittable(data), reference, **asked, **_calibration(session))
        return _step_to(session, f"− {reference}", seen_after(change), advance)

    session.begin(f"removing {reference}", DATA, work)


def show(session: Session, number: int) -> None:
    """Look at another model of the history."""
    with session.lock:
        if not 0 <= number < len(session.steps):
            raise GeoerrError("that model is not in the history any more")
        step = session.steps[number]
        if session.measured is None:
            session.current = number
            session.forget_step()
            session.changed(is_kept=True)
            return
        before = session.before
        if before is not None and before.number == number != session.current and not session.is_busy:
            _at_once(
                session,
                f"comparing model {number + 1}",
                session.steps,
                number,
                session.reference,
                lambda beside: _look_back(session, before, beside),
            )
            return
    data = session.data

    def work(advance: Advance) -> Callable[[], None]:
        advance(0, 1)
        comparison = _compared(session, step.model, data, session.calibration)
        seen = Seen.of(comparison)
        steps = [step.compared(comparison) if one is step else one for one in session.steps]
        beside = _side_by_side(session, steps, number, session.reference, advance)
        advance(1, 1)

        def apply() -> None:
            with session.lock:
                session.steps, session.beside = steps, beside
                session.before = session.looked()
                session.current = number
                session.forget_step()
                _look(session, seen)

        return apply

    session.begin(f"comparing model {number + 1}", DATA, work)


def undo(session: Session) -> None:
    """Look again at the model that this one came from."""
    step = session.step
    if step is None or step.parent is None:
        raise GeoerrError("there is nothing to undo: this is the first model")
    show(session, step.parent)


def refer_to(session: Session, number: int) -> None:
    """Compare all models with this one from now on."""
    with session.lock:
        if 0 <= number < len(session.steps):

            def apply(beside: SideBySide) -> None:
                session.reference, session.beside = number, beside

            _at_once(session, f"comparing with model {number + 1}", session.steps, session.current, number, apply)


def try_formula(session: Session, typed: OwnFormula) -> None:
    """See whether an own effect helps, without adding it."""
    with session.lock:
        session.refuse_while_busy()
        # Beside a refusal an earlier trial would pass for that of this formula.
        session.trial = None
    data = session.data
    columns = () if data.points is None else tuple(data.points.frame.columns)
    effect = own_effect(typed, columns, session.folder)
    others = tuple(one for one in session.known_effects if one.id != effect.id)
    addition = replace(Addition.to(session), effects=(*others, effect))

    def work(advance: Advance) -> Callable[[], None]:
        change = addition.of(typed.reference, None, advance, advance.say)
        trial = Trial.of(typed, effect, change, advance.say)

        def apply() -> None:
            with session.lock:
                session.trial = trial

        return apply

    session.begin("trying the formula", OWN, work)


def add_trial(session: Session) -> None:
    """Take the own effect that was tried."""
    with session.lock:
        trial = session.trial
        if trial is None:
            raise GeoerrError("there is nothing to add\nhint: try the formula first")
        name = f"+ {trial.terms[0].id}"
        _step_at_once(session, f"adding {trial.terms[0].id}", name, seen_after(trial.change), trial.effect)


def compensate(session: Session, name: str, content: bytes, wish: Wish) -> None:
    """Correct a program that was dropped on the page."""
    known = Path(name).name or "program.gcode"
    session.dropped = known, content
    step, model = session.step, session.model
    assert step is not None

    def work(_: Advance) -> Callable[[], None]:
        corrected = correct(model, step.name, known, content, wish)

        def apply() -> None:
            with session.lock:
                session.program = corrected

        return apply

    with session.lock:
        session.begin(f"correcting {known}", PROGRAM, work)
        # Beside a refusal an earlier result would pass for that of this program.
        session.program = None


def dismiss(session: Session, place: str) -> None:
    """Take a message away."""
    with session.lock:
        session.problems.pop(place, None)
        session.changed()


def select(session: Session, rows: np.ndarray | None) -> None:
    """Mark rows in all pictures; None marks none."""
    with session.lock:
        session.selected = None if rows is None or not rows.any() else np.asarray(rows, dtype=bool)
        session.n_marks += 1


def _calibration(session: Session) -> dict[str, Any]:
    """Give the calibration's uncertainty as every fit and search takes it."""
    return vars(session.calibration)


def _compared(session: Session, model: Model, data: Measurements, calibration: Calibration) -> Comparison:
    return compare(model, *data.tables, threads=session.threads, **vars(calibration))


def _is_of_this_work(session: Session, file: InputFile) -> bool:
    """Tell whether a file is of the very model that the session's work began with."""
    return bool(session.steps) and document_of(load_model(file.path)) == document_of(session.steps[0].model)


def _kept(session: Session, steps: list[Step], taken: Chapter | None) -> tuple[Chapter, ...]:
    """Give the earlier work, without what is taken, and with that of the session where these steps are of other."""
    rest = tuple(one for one in session.earlier if one is not taken)
    is_other = bool(session.steps) and steps[0].model is not session.steps[0].model
    return (*rest, session.chapter) if is_other else rest


def _first_name(model: Model, file_name: str) -> str:
    return "machine without errors" if model.is_nominal else file_name


def _step_to(session: Session, name: str, seen: Seen | None, advance: Advance) -> Callable[[], None]:
    """Compare the models with the one that was made, and give what takes the step to it."""
    steps, reference = _with_step(session, name, seen)
    beside = _side_by_side(session, steps, len(steps) - 1, reference, advance)
    return lambda: _take_step(session, steps, seen, beside)


def _step_at_once(session: Session, title: str, name: str, seen: Seen | None, *tried: Effect) -> None:
    """Take the step to a model that is there already, with own effects that it brings."""
    steps, reference = _with_step(session, name, seen)

    def apply(beside: SideBySide) -> None:
        ids = {one.id for one in tried}
        session.tried = (*(one for one in session.tried if one.id not in ids), *tried)
        _take_step(session, steps, seen, beside)

    _at_once(session, title, steps, len(steps) - 1, reference, apply)


def _at_once(
    session: Session,
    title: str,
    steps: list[Step],
    current: int,
    reference: int,
    apply: Callable[[SideBySide], None],
) -> None:
    """Do what needs no work but that the models may have to be compared on fewer rows first, in the background."""
    beside = if_alike(steps, current, reference)
    if beside is not None:
        apply(beside)
        session.changed(is_kept=True)
        return

    def work(advance: Advance) -> Callable[[], None]:
        found = _side_by_side(session, steps, current, reference, advance)

        def applied() -> None:
            with session.lock:
                apply(found)

        return applied

    session.begin(title, DATA, work)


def _side_by_side(session: Session, steps: list[Step], current: int, reference: int, advance: Advance) -> SideBySide:
    return side_by_side(steps, current, reference, session.measured, session.calibration, session.threads, advance)


def _with_step(session: Session, name: str, seen: Seen | None) -> tuple[list[Step], int]:
    """Give the steps with one more, and the reference: the first where the other one is on no way to it."""
    assert seen is not None
    step = Step(name, seen.comparison.model, session.current).compared(seen.comparison)
    steps = [*session.steps, step]
    return steps, session.reference if session.reference in lineage(steps, len(steps) - 1) else 0


def _take_step(session: Session, steps: list[Step], seen: Seen | None, beside: SideBySide) -> None:
    with session.lock:
        session.steps, session.beside = steps, beside
        session.before = session.looked()
        session.current = len(session.steps) - 1
        if session.reference not in lineage(session.steps, session.current):
            session.reference = 0
        session.forget_step()
        _look(session, seen)


def _look_back(session: Session, before: Looked, beside: SideBySide) -> None:
    """Look again at the model before this one, as it was, with what was found missing in it."""
    session.before = session.looked()
    session.current, session.beside = before.number, beside
    session.forget_step()
    session.diagnosis, session.told, session.prepared = before.diagnosis, before.told, before.prepared
    _look(session, before.seen)
    begin_ahead(session, Addition.to(session))


def _look(session: Session, seen: Seen | None) -> None:
    """Look at a comparison: what was chosen stays where the new one has it."""
    session.seen = seen
    session.sight += 1
    if seen is None:
        session.selected = session.box = None
        return
    worst_first = sorted(seen.circles, key=lambda run: -run.measured.circular_deviation_mm)
    session.view.settle(tuple(seen.variables), seen.by_worth, seen.looks, [run.name for run in worst_first])
    if session.selected is not None and len(session.selected) != len(seen.comparison.points.sightings):
        session.selected = session.box = None
