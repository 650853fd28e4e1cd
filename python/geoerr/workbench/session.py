"""What the page shows, kept on the server: data, models, what was chosen and found. Every change has a number."""

from __future__ import annotations

import shutil
import tempfile
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geoerr.diagnose import Change, Comparison, Diagnosis
from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.components import is_position
from geoerr.diagnose.trends import variables_of
from geoerr.effects import Effect
from geoerr.errors import GeoerrError
from geoerr.fit.sightings import Numbers
from geoerr.measurements import Measurements
from geoerr.model import Model
from geoerr.terms import Term
from geoerr.workbench.calibration import Calibration
from geoerr.workbench.certainty import chance_of, other_period_words
from geoerr.workbench.circles import CircleRun, circle_runs
from geoerr.workbench.history import Chapter, Step
from geoerr.workbench.inputs import InputFile, as_known
from geoerr.workbench.job import Advance, Job, Work
from geoerr.workbench.own_effect import OwnFormula
from geoerr.workbench.page_words import on_the_page
from geoerr.workbench.program import CorrectedProgram
from geoerr.workbench.side_by_side import SideBySide
from geoerr.workbench.told import Told
from geoerr.workbench.view import CIRCLE, LOOKS, View

Rows = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Trial:
    """An own effect that was tried.

    Attributes
    ----------
    typed, effect, change
        What was typed, the effect, and what adding it does.
    terms
        What it adds to the model, by the reference that it has there: with the column that it follows.
    p_value
        Probability that nothing looks as large.
    other_periods
        Sentences on periods that look the same.
    """

    typed: OwnFormula
    effect: Effect
    change: Change
    terms: tuple[Term, ...]
    p_value: float
    other_periods: tuple[str, ...]

    @classmethod
    def of(
        cls, typed: OwnFormula, effect: Effect, change: Change, on_step: Callable[[str], None] = lambda what: None
    ) -> Trial:
        """Ask how sure it is, and say what of it comes next."""
        known = {term.id for term in change.before.terms}
        terms = tuple(term for term in change.after.terms if term.id not in known)
        on_step("what chance finds")
        p_value = chance_of(change.before, change.after, terms)
        on_step("what looks the same")
        return cls(typed, effect, change, terms, p_value, other_period_words(change.after, terms))


@dataclass(frozen=True, eq=False)
class Seen:
    """A model held against the measurements, with what the pictures need again and again.

    Attributes
    ----------
    variables
        Name to values (n,) of everything that the residual can be drawn over.
    by_worth
        Their names, what the residual follows most first.
    circles
        The runs of circular tests.
    """

    comparison: Comparison
    variables: dict[str, Numbers]
    by_worth: tuple[str, ...]
    circles: tuple[CircleRun, ...]

    @classmethod
    def of(cls, comparison: Comparison) -> Seen | None:
        """Prepare it; None where there are lengths only, which have no place."""
        if comparison.fitted is None:
            return None
        names = dict.fromkeys(trend.variable for trend in comparison.trends)
        return cls(comparison, variables_of(comparison.fitted), tuple(names), circle_runs(comparison))

    @property
    def looks(self) -> dict[str, str]:
        """Views that these measurements have: points have a place in the volume, circular tests their own plot."""
        has_points = bool(is_position(self.comparison.points).any())
        return {name: text for name, text in LOOKS.items() if (bool(self.circles) if name == CIRCLE else has_points)}


@dataclass(frozen=True, eq=False)
class Prepared:
    """A model with what a search found, ahead of its being asked for: `reference`, and what it looks like."""

    reference: str
    seen: Seen


@dataclass(frozen=True)
class Box:
    """A box that was drawn over the residual: over which variable, and axis of the picture to its two ends."""

    variable: str
    ends: Mapping[str, Sequence[float]]


@dataclass(frozen=True, eq=False)
class Looked:
    """A model that was looked at before this one, with what belongs to it: looking at it again takes no time."""

    number: int
    seen: Seen | None
    diagnosis: Diagnosis | CircleDiagnosis | None
    told: Told | None
    prepared: tuple[Prepared, ...]


@dataclass(eq=False)
class Session:
    """One person's work. Change it under `lock`, and say so with `changed`.

    Attributes
    ----------
    folder
        For dropped files; gone with the session, which holds what they hold wherever it is saved.
    saved_in
        File that it is written to after every change of models or data; None where it lives in memory only.
    version, content, sight
        Grow with every change, with every one but that work begins or is stopped, and with every change of what the
        pictures show.
    files, measured, own_effects, calibration
        What was given; the calibration's uncertainty takes part in every fit and search.
    tried
        Own effects that were written on the page, and added.
    replaced
        Names of files that took the place of earlier ones when files were last given.
    given_again
        Names of machines and models that were given again when files were last given: those that the session is of.
    steps, current, reference
        The models, which of them is looked at, and which the others are compared with.
    beside
        How the models compare on the rows that all have of which the page tells.
    earlier
        The work before another machine or model began anew.
    seen, diagnosis, told, prepared, trial, selected, program, dropped
        What belongs to the current model: None until it was asked for. `told` is what the page says of a diagnosis;
        a saved session has it again, without the diagnosis itself. `selected` is (n,). `dropped` is the program as it
        came, name and content, to be corrected again by another model or with other wishes.
    n_marks, box
        How often rows were marked, and the box over the residual, where one chose them.
    ahead
        Waits for the end of what is being added ahead, of a name; None where nothing is.
    before
        The model that was looked at before, of the same data. One only: each holds its measurements anew.
    reports
        Name to the page, of those that were written and still tell what is so.
    problems
        Panel to the message that it shows.
    has_webgl
        Whether the browser draws 3-D pictures, as it says when it loads the page.
    """

    folder: Path = field(init=False)
    saved_in: Path | None = None
    threads: int = 0
    version: int = 0
    content: int = 0
    sight: int = 0
    files: list[InputFile] = field(default_factory=list)
    measured: Measurements | None = None
    replaced: tuple[str, ...] = ()
    given_again: tuple[str, ...] = ()
    own_effects: tuple[Effect, ...] = ()
    tried: tuple[Effect, ...] = ()
    calibration: Calibration = field(default_factory=Calibration)
    steps: list[Step] = field(default_factory=list)
    current: int = 0
    reference: int = 0
    beside: SideBySide = field(default_factory=SideBySide)
    earlier: tuple[Chapter, ...] = ()
    seen: Seen | None = None
    diagnosis: Diagnosis | CircleDiagnosis | None = None
    told: Told | None = None
    prepared: tuple[Prepared, ...] = ()
    ahead: Callable[[str, Advance], Prepared | None] | None = None
    trial: Trial | None = None
    selected: Rows | None = None
    n_marks: int = 0
    box: Box | None = None
    program: CorrectedProgram | None = None
    dropped: tuple[str, bytes] | None = None
    before: Looked | None = None
    reports: dict[str, str] = field(default_factory=dict)
    view: View = field(default_factory=View)
    problems: dict[str, str] = field(default_factory=dict)
    has_webgl: bool = True
    job: Job | None = None
    lock: threading.RLock = field(default_factory=threading.RLock)
    on_saved_change: Callable[[Session], None] = lambda _: None

    def __post_init__(self) -> None:
        """Make the session's own folder, which goes with it: measurements take disk space, and are somebody's."""
        self.folder = Path(tempfile.mkdtemp(prefix="geoerr-workbench-"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)

    @property
    def known_effects(self) -> tuple[Effect, ...]:
        """Own effects: of files, and written on the page, which take the place of those of their names."""
        written = {one.id for one in self.tried}
        return (*(one for one in self.own_effects if one.id not in written), *self.tried)

    @property
    def step(self) -> Step | None:
        """The model that is looked at."""
        return self.steps[self.current] if self.steps else None

    @property
    def chapter(self) -> Chapter:
        """The work as it is, to come back to."""
        return Chapter(tuple(self.files), tuple(self.steps), self.current, self.reference, self.told)

    @property
    def model(self) -> Model:
        """That model itself.

        Raises
        ------
        GeoerrError
            where there is none yet.
        """
        if self.step is None:
            raise GeoerrError("there is no machine yet\nhint: drop a machine.toml or a model.json on the left")
        return self.step.model

    @property
    def data(self) -> Measurements:
        """The measurements.

        Raises
        ------
        GeoerrError
            where there are none yet.
        """
        if self.measured is None:
            raise GeoerrError("there are no measurements yet\nhint: drop a table (.csv, .parquet) on the left")
        return self.measured

    @property
    def has_circles_only(self) -> bool:
        """Whether circular tests alone were given: these are diagnosed as ball-bar software does."""
        return self.measured is not None and self.measured.has_circles_only

    @property
    def is_busy(self) -> bool:
        """Whether work is under way."""
        return self.job is not None

    def changed(self, *, is_kept: bool = False) -> None:
        """Count a change; `is_kept` ones are written to the session's file."""
        with self.lock:
            self.version += 1
            self.content += 1
            if is_kept and self.saved_in is not None:
                try:
                    self.on_saved_change(self)
                except (GeoerrError, OSError) as error:
                    self.problems["data"] = f"the session could not be saved: {error}"

    def show_problem(self, place: str, text: str) -> None:
        """Show a message in a panel; in the page's words, a dropped file by the name that the person knows."""
        self.problems[place] = on_the_page(as_known(text, self.folder))

    def looked(self) -> Looked:
        """Give the model that is looked at, to come back to."""
        return Looked(self.current, self.seen, self.diagnosis, self.told, self.prepared)

    def forget_step(self) -> None:
        """Forget what belongs to the model that was looked at, and what was refused of it or of its data."""
        self.seen = self.diagnosis = self.told = self.trial = None
        self.prepared, self.ahead = (), None
        self.problems.clear()
        self.reports = {}

    def begin(self, title: str, place: str, work: Work) -> None:
        """Begin work in the background.

        Raises
        ------
        GeoerrError
            while other work is under way.
        """
        with self.lock:
            self.refuse_while_busy()
            if self.problems.pop(place, None) is not None:
                self.content += 1
            self.job = Job(title, place, work, self._ended)
            self.version += 1
            self.job.start()

    def prepared_of(self, reference: str) -> Prepared | None:
        """Give the model with what a search listed, where it was made ahead."""
        return next((one for one in self.prepared if one.reference == reference), None)

    def refuse_while_busy(self) -> None:
        """Refuse what has to wait for the end of other work.

        Raises
        ------
        GeoerrError
            while it is under way.
        """
        if self.job is not None:
            raise GeoerrError(f"{self.job.title} is still under way\nhint: wait for it, or stop it")

    def stop(self) -> None:
        """Stop the work: nothing of it is taken."""
        with self.lock:
            job, self.job = self.job, None
            self.version += 1
        if job is not None:
            job.stop()

    def _ended(self, job: Job, problem: str | None) -> None:
        with self.lock:
            if self.job is not job:
                return
            self.job = None
            if problem is not None:
                self.show_problem(job.place, problem)
            self.changed(is_kept=problem is None)
