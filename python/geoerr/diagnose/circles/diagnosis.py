"""The diagnosis of a circular test: causes ranked by what each is worth, with doubt, ties and what is left over."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from geoerr.diagnose.answer import Answer, Verdict, held_out_um
from geoerr.diagnose.circles.causes import Suspect, suspects_of
from geoerr.diagnose.circles.found import Found, Rival, Searched
from geoerr.diagnose.circles.noise import orthonormal
from geoerr.diagnose.circles.readings import Reading, amplitude_of, readings_of
from geoerr.diagnose.circles.runs import SAME_FEED, UM_PER_MM, Runs, checked, runs_of
from geoerr.diagnose.circles.search import search
from geoerr.diagnose.circles.shares import Shares, shares_of
from geoerr.diagnose.comparison import compare
from geoerr.diagnose.findings import IN_MODEL, Alias, Named, Nameless, Separation, finite
from geoerr.diagnose.own_uncertainty import own_doubt
from geoerr.diagnose.steps import OnStep, Progress, Steps
from geoerr.diagnose.summary import circle_diagnosis_html
from geoerr.diagnose.words import chance_words, um_words
from geoerr.drawing import drawn
from geoerr.effects import Effect, catalogue
from geoerr.effects.collection import Catalogue
from geoerr.fit import places_beyond, refit
from geoerr.model import Model
from geoerr.model.called import check_model, check_tables
from geoerr.observations import CircularTest
from geoerr.summaries import capitalised, counted, listed, p_words, uncapitalised
from geoerr.terms import EffectReference, Parameter, Term

if TYPE_CHECKING:
    import plotly.graph_objects as go

# Suspects that a diagnosis lists beside the first cause.
_LISTED = 8
# A correlation that is worth a word.
_ALIAS = 0.5
_INVISIBLE = "not measurable with these runs: the set-up's free centre and radius do all that it would do"
_NEEDS = {
    "radial-shrink": "needs two feeds in one set-up (same session and line): the radius of each set-up is free",
    "servo-mismatch": _INVISIBLE,
}
# A part below 0 (`shares`): its trace points against the sum of all.
_MAKES_UP = "it makes up for other causes: repaired alone, it leaves the circle worse than it is"
# What a circle cannot do, whatever the runs: a second measurement by the pair of what is to be told apart.
_SENSES = Separation("both senses of a circle", "run the same circle clockwise and counter-clockwise", 5)
_FEEDS = Separation("a second feed", "run the circle in both senses at a quarter of the feed", 10)
_ELSEWHERE = Separation("a second circle", "run a circle of the same radius with its centre moved by half of it", 15)
_POINTS = Separation("more points", "run the circle at a quarter of the feed, so that rows lie closer", 10)
_TURNS_WITH_SENSE = (
    *("backlash", "backlash-position", "reversal-windup", "reversal-spike", "stick-slip", "lateral-play"),
    "servo-mismatch",
)
_FOLLOWS_FEED = ("servo-mismatch", "reversal-spike", "stick-slip", "radial-shrink", "vibration", "change-over")


@dataclass(frozen=True, eq=False)
class Cause(Named):
    """A cause of a circular test's deviation, or a suspect that was looked at.

    `term` has its values where the cause is in the model; a coefficient that the runs cannot see, or that is another
    in every run, is NaN, and not among the `parameters`. `worth_um` is of the trace that it alone would leave, set-up
    removed.

    Attributes
    ----------
    readings
        Its values as a shop floor has them.
    peak_to_peak_um, peak_to_peak_std_um
        Of that trace; the largest of all set-ups. None of a suspect that is not in the model.
    percent
        Its part of the explainable mean square, in per cent; None of a suspect that is not in the model.
    held_out_rmse_after_um
        Held-out error with it, and all found before it, in the model; None where it was not computed.
    amplitude
        Of one whose phase is another in every run: root mean square of all runs; else None.
    """

    readings: tuple[Reading, ...]
    peak_to_peak_um: float | None
    peak_to_peak_std_um: float | None
    percent: float | None
    held_out_rmse_after_um: float | None
    amplitude: Parameter | None = None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Values with standard errors; of a cause in the model those that these runs tell."""
        own = super().parameters
        if self.peak_to_peak_um is None:
            return own
        amplitude = () if self.amplitude is None else (self.amplitude,)
        return (*amplitude, *(one for one in own if math.isfinite(one.value)))

    @property
    def sure(self) -> str:
        """How sure it is, in words."""
        return p_words(self.p_value)

    @property
    def worth_words(self) -> str:
        """What it is worth, and how large its trace is where it has one."""
        rms = f"worth {um_words(self.worth_um)} rms"
        if self.peak_to_peak_um is None:
            return rms
        return f"{rms}, {self.peak_to_peak_um:.1f} ± {self.peak_to_peak_std_um:.1f} µm peak to peak"

    @property
    def caution(self) -> str:
        """What is to be known before it is repaired; empty where nothing is."""
        return _MAKES_UP if self.percent is not None and self.percent < 0.0 else ""

    def words(self) -> str:
        """Say in one sentence what it is, its values, its worth and how sure it is."""
        values = "; ".join(reading.words() for reading in self.readings)
        named = f"{self.effect.title} ({self.reference})" + (f": {values}" if values else "")
        part = "" if self.percent is None else f", {self.percent:.0f} % of the explainable".replace("-", "−")
        more = "".join(f". {capitalised(said)}" for said in (self.caution, IN_MODEL if self.in_model else "") if said)
        return f"{named}. {capitalised(self.worth_words)}{part}; {self.sure}{more}"

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it, and what is a circle's own."""
        return {
            **self.named_document(self.held_out_rmse_after_um),
            "readings": [
                {"what": one.what, "value": one.value, "std": finite(one.std), "unit": one.unit, "says": one.says}
                for one in self.readings
            ],
            "peak_to_peak_um": self.peak_to_peak_um,
            "peak_to_peak_std_um": self.peak_to_peak_std_um,
            "percent": self.percent,
            "words": self.words(),
        }


@dataclass(frozen=True, eq=False)
class CircleUnknown(Nameless):
    """Structure that no cause explains."""

    def words(self) -> str:
        """Say it in a sentence."""
        where = "in the radius" if self.component == "r" else f"along {self.component}"
        on = " and ".join(self.depends_on)
        worth = f"worth {self.worth_um:.2f} µm rms"
        return f"something that no known cause explains acts {where} and depends on {on}, {worth}"


@dataclass(frozen=True)
class RunFigures:
    """One run: name, plane, sense, feed, and figures of ISO 230-4 in µm.

    `circular_deviation_um` is G as it was measured, whatever the model explains of it: largest minus smallest radius
    about the least-squares centre. `explained_um` is the same of the causes' trace, `rest_um` of what they leave.
    """

    name: str
    plane: str
    sense: int
    feed_mm_min: float | None
    n_rows: int
    circular_deviation_um: float
    explained_um: float
    rest_um: float


@dataclass(frozen=True)
class SetUpFigures:
    """How the bar stood in one set-up: centre beside the commanded one, and what was added to the radius, µm."""

    name: str
    centre_um: tuple[float, float, float]
    radius_um: float


@dataclass(frozen=True, eq=False)
class CircleDiagnosis(Answer):
    """What ails a machine, by circular tests alone.

    Attributes
    ----------
    shares
        Mean squares: measured, explained, noise, rest.
    noise_um, wander_um
        Standard deviation of a row's noise, and of its part that wanders along the circle.
    runs, set_ups
        Figures of every run and set-up.
    withdrawn
        Names that looked likely until structure without a name turned out to do better.
    notes
        What had to be taken from elsewhere, and what these runs cannot tell at all.
    searched
        Every number behind it.
    """

    found: tuple[Cause, ...]
    candidates: tuple[Cause, ...]
    unknown: CircleUnknown | None
    shares: Shares
    noise_um: float
    wander_um: float
    runs: tuple[RunFigures, ...]
    set_ups: tuple[SetUpFigures, ...]
    withdrawn: tuple[EffectReference, ...]
    notes: tuple[str, ...]
    searched: Searched

    def plot_causes(self) -> go.Figure:
        """Draw each cause's part of what is more than noise."""
        return drawn("circle_causes", self)

    def _repr_html_(self) -> str:
        """Show the causes and the runs, for a notebook."""
        return circle_diagnosis_html(self)

    @property
    def ranked(self) -> tuple[Cause, ...]:
        """The causes, the worthiest first: by what each does alone; its part is small where another hides it."""
        return tuple(sorted(self.found, key=lambda cause: -cause.worth_um))

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        causes = [f"{uncapitalised(cause.effect.title)} ({cause.reference})" for cause in self.ranked]
        more = "" if self.unknown is None else "; and there is more, which no known cause explains"
        if self.verdict == "missing":
            return f"the circle is off by {listed(causes)}{more}"
        if self.verdict == "ambiguous":
            return f"the circle is off by {listed(causes)}, some of which these runs cannot tell from others{more}"
        if self.unknown is not None:
            return self.unknown.words()
        return f"nothing is wrong that these runs could show: {chance_words(self.p_value)}"

    def tied_with(self, cause: Cause) -> tuple[Alias, ...]:
        """Give what these runs cannot tell from a found cause."""
        place = self.found.index(cause)
        return tuple(
            Alias(rival.suspect.reference, rival.correlation, is_tied=True)
            for rival in self.searched.rivals[place]
            if rival.is_tied
        )

    def not_told_from(self, suspect: Cause) -> tuple[EffectReference, ...]:
        """Give the found causes that these runs cannot tell from a suspect."""
        alike = {cause.reference: {one.reference for one in self.tied_with(cause)} for cause in self.found}
        return tuple(reference for reference, names in alike.items() if suspect.reference in names)

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it, and what is a circle's own under `circle`."""
        shares = self.shares
        return {
            **super().to_document(),
            "sentence": self.sentence,
            "notes": list(self.notes),
            "circle": {
                "ranked": [str(cause.reference) for cause in self.ranked],
                "measured_rms_um": math.sqrt(shares.total),
                "explained_rms_um": math.sqrt(shares.explained),
                "unexplained_rms_um": math.sqrt(shares.rest),
                "unexplained_percent": shares.percent_unexplained,
                "noise_um": self.noise_um,
                "wander_um": self.wander_um,
                "withdrawn": [str(reference) for reference in self.withdrawn],
                "runs": [
                    {
                        "run": run.name,
                        "plane": run.plane.upper(),
                        "dir": run.sense,
                        "feed": run.feed_mm_min,
                        "n": run.n_rows,
                        "circular_deviation_um": run.circular_deviation_um,
                        "explained_um": run.explained_um,
                        "rest_um": run.rest_um,
                    }
                    for run in self.runs
                ],
                "set_ups": [
                    {"set_up": one.name, "centre_um": list(one.centre_um), "radius_um": one.radius_um}
                    for one in self.set_ups
                ],
                "notes": list(self.notes),
            },
        }


def diagnose_circles(
    model: Model,
    *tests: CircularTest,
    effects: Sequence[Effect] = (),
    progress: Progress | None = None,
    on_step: OnStep | None = None,
    threads: int = 0,
) -> CircleDiagnosis:
    """Find what ails a machine from circular tests alone.

    One run or many: both senses, several feeds, several planes, with or without repeats. Rows of one `session` and
    `line` share a set-up, whose centre and radius are free.

    Parameters
    ----------
    model
        A nominal machine, as a rule; what a fitted one explains is taken off.
    tests
        Circular tests.
    effects
        A user's own, beside the causes of a ball bar.
    progress
        Called with the steps done and the least number that there will be.
    on_step
        Called with what comes next, in words. What it or `progress` raises ends the work between two steps.

    Raises
    ------
    GeoerrError
        where there are no tests.
    GeometryError
        where no run can be used, with the reason.

    Notes
    -----
    Causes and shapes: ISO 230-4, and shops' ball-bar software. Verified in tests/diagnose/test_diagnose_circles.py;
    `validation/circles.py` measures names, values and false alarms on runs from a generator of its own.
    """
    check_model(model, tests, "diagnose_circles(model, tests)")
    check_tables(tests, "diagnose_circles(model, tests)", CircularTest)
    usable, problems, notes = checked(tests)
    steps = Steps(progress, on_step)
    steps.next("the model and the circles are compared")
    comparison = compare(model, *usable, threads=threads)
    fitted = comparison.points
    doubt = own_doubt(model, fitted, counts_choice=False) if comparison.is_held else None
    runs = runs_of(fitted, problems, notes, doubt)
    known = catalogue().extended(effects, "effects") if effects else catalogue()
    # Waves of fewer rows than the search sees would come out as others.
    suspects, not_offered = suspects_of(runs.averaged(), known, effects)
    in_model = frozenset(term.id for term in model.terms) if comparison.is_held else frozenset[str]()
    found = _diagnosis(search(runs, suspects, steps), known, not_offered, in_model)
    steps.end()
    return found


def _diagnosis(
    searched: Searched, known: Catalogue, not_offered: list[tuple[str, str]], in_model: frozenset[str]
) -> CircleDiagnosis:
    runs = searched.runs
    unknown_um = None if searched.unknown is None else searched.unknown[2]
    set_up = orthonormal(runs.set_up_columns)
    doubt_um = runs.doubt_um - set_up @ (set_up.T @ runs.doubt_um)
    shares = shares_of(
        runs,
        searched.noise,
        set_up,
        searched.traces,
        searched.rest_um,
        runs.fitted.repeats.floor_um,
        unknown_um,
        float((doubt_um**2).sum()) / len(runs),
    )
    found = _marked((_cause(searched, place, shares, known) for place in range(len(searched.found))), in_model)
    candidates = _marked(_candidates(searched, found, known), in_model)
    verdict: Verdict = "nothing-missing"
    if found:
        is_tied = any(rival.is_tied for rivals in searched.rivals for rival in rivals)
        verdict = "ambiguous" if is_tied else "missing"
    elif searched.unknown is not None:
        verdict = "unknown"
    invisible = [(str(one.reference), _NEEDS.get(one.reference.effect, _INVISIBLE)) for one in searched.invisible]
    noise_um, wander_um = searched.noise.seen_um(set_up)
    return CircleDiagnosis(
        verdict=verdict,
        p_value=searched.p_value,
        fitted=runs.fitted,
        found=found,
        candidates=candidates,
        unknown=_unknown(searched),
        not_offered=(*not_offered, *invisible),
        shares=shares,
        noise_um=noise_um,
        wander_um=wander_um,
        runs=_run_figures(searched),
        set_ups=_set_ups(runs),
        withdrawn=tuple(one.suspect.reference for one in searched.withdrawn),
        notes=(
            *runs.notes,
            *places_beyond(runs.fitted.sightings, runs.fitted.machine),
            *_cannot_tell(runs, searched),
        ),
        searched=searched,
    )


def _marked(causes: Iterable[Cause], in_model: frozenset[str]) -> tuple[Cause, ...]:
    """Mark what a held model has; what is marked already, and all others, are the same as before."""
    return tuple(
        replace(cause, in_model=True) if str(cause.reference) in in_model and not cause.in_model else cause
        for cause in causes
    )


def _cause(searched: Searched, place: int, shares: Shares, known: Catalogue) -> Cause:
    runs, found = searched.runs, searched.found[place]
    term, covariance, by_run = _valued(searched, place)
    trace, whole = searched.whole_traces[:, place], searched.whole
    together = whole.set_up[whole.run]
    peak = max(float(np.ptp(trace[together == number])) for number in np.unique(together))
    tied = [rival for rival in searched.rivals[place] if rival.is_tied]
    against = tied[0].suspect.reference if tied else None
    return Cause(
        reference=found.suspect.reference,
        effect=found.suspect.effect,
        term=term,
        p_value=found.p_value,
        evidence=found.judged.evidence,
        readings=readings_of(term, covariance, runs, by_run),
        worth_um=float(np.sqrt(np.mean(trace**2))),
        peak_to_peak_um=peak,
        peak_to_peak_std_um=peak * _relative_std(searched, place),
        percent=shares.percent(place),
        tied=place > 0 and bool(tied),
        aliases=_aliases(found, searched.rivals[place], runs),
        separate_by=None if against is None else _separation(found.suspect.reference, against, runs, known),
        held_out_rmse_after_um=_after(searched, place),
        amplitude=amplitude_of(term, by_run) if by_run else None,
    )


def _own_places(searched: Searched, place: int) -> tuple[slice, slice]:
    """Give the places of a cause's coefficients and of its inner parameters among the estimates."""
    first = sum(one.columns.shape[1] + len(one.inner) for one in searched.found[:place])
    k = searched.found[place].columns.shape[1]
    return slice(first, first + k), slice(first + k, first + k + len(searched.found[place].inner))


def _valued(searched: Searched, place: int) -> tuple[Term, np.ndarray, list[tuple[float, float]]]:
    """Give a cause's term with its values, their covariance, and of one by run the amplitude of each run."""
    found = searched.found[place]
    own, inner = _own_places(searched, place)
    values, covariance = searched.estimate[own], searched.covariance[own, own]
    std = np.sqrt(np.maximum(np.diag(searched.covariance), 0.0))
    term, k = found.way.term, len(found.way.term.coefficients)
    by_run: list[tuple[float, float]] = []
    if found.judged.group.by_run:
        n_seen = len(found.seen)
        for run in range(searched.runs.n_runs):
            part = slice(n_seen * run, n_seen * (run + 1))
            size = float(np.linalg.norm(values[part]))
            slope = values[part] / max(size, 1e-300)
            by_run.append((size, math.sqrt(max(float(slope @ covariance[part, part] @ slope), 0.0))))
        coefficients, coefficients_std = [math.nan] * k, [math.nan] * k
    else:
        coefficients, coefficients_std = [math.nan] * k, [math.nan] * k
        for index, at in enumerate(found.seen):
            coefficients[at], coefficients_std[at] = float(values[index]), float(std[own][index])
    valued = term.with_values(
        coefficients,
        searched.estimate[inner].tolist(),
        coefficients_std=coefficients_std,
        inner_std=std[inner].tolist(),
    )
    whole = np.zeros((k + len(found.inner),) * 2)
    if not by_run:
        places = [*found.seen, *range(k, k + len(found.inner))]
        both = [*range(own.start, own.stop), *range(inner.start, inner.stop)]
        whole[np.ix_(places, places)] = searched.covariance[np.ix_(both, both)]
    return valued, whole, by_run


def _relative_std(searched: Searched, place: int) -> float:
    """Give the relative standard uncertainty of a trace's size."""
    own, _ = _own_places(searched, place)
    columns = searched.found[place].columns
    trace = searched.traces[:, place]
    size = float(np.linalg.norm(trace))
    if size == 0.0:
        return 0.0
    slope = columns.T @ trace / size**2
    return math.sqrt(max(float(slope @ searched.covariance[own, own] @ slope), 0.0))


def _aliases(found: Found, rivals: Sequence[Rival], runs: Runs) -> tuple[Alias, ...]:
    aliases = [
        Alias(rival.suspect.reference, rival.correlation, rival.is_tied)
        for rival in rivals
        if rival.correlation > _ALIAS
    ]
    reference = found.suspect.reference
    if len(runs.planes) == 1:
        # A difference of two axes: a circle cannot say which of them it is.
        other = {"scale-mismatch": "scale", "servo-mismatch": "lag"}.get(reference.effect)
        if other is not None and reference.axis is not None:
            aliases += [Alias(EffectReference(other, axis), 1.0) for axis in reference.axis]
    return tuple(sorted(aliases, key=lambda alias: -alias.correlation))


def _separation(
    reference: EffectReference, other: EffectReference, runs: Runs, known: Catalogue
) -> Separation | None:
    """Give the measurement that would tell two causes apart: the first of these that the runs do not have."""
    pair = (reference.effect, other.effect)
    one_sense = not all(runs.has_both_senses(plane) for plane in runs.planes)
    if one_sense and sum(effect in _TURNS_WITH_SENSE for effect in pair) == 1:
        return _SENSES
    if len(runs.feeds()) < 2 and sum(effect in _FOLLOWS_FEED for effect in pair) == 1:
        return _FEEDS
    if set(pair) <= {"straightness", "pitch-error"}:
        return _ELSEWHERE
    rival = known.separation(*pair)
    if rival is not None:
        return Separation(rival.separate_by, rival.plan, rival.minutes)
    return _SENSES if one_sense else _FEEDS if len(runs.feeds()) < 2 else _POINTS


def _candidates(searched: Searched, found: tuple[Cause, ...], known: Catalogue) -> tuple[Cause, ...]:
    if found:
        others = [_listed(searched, rival, found, known) for rival in searched.rivals[0][:_LISTED]]
        return (found[0], *others)
    return tuple(
        _suspected(searched.suspects[judged.what], p_value, judged.evidence, 0.0)
        for judged, p_value in searched.first[:_LISTED]
    )


def _listed(searched: Searched, rival: Rival, found: Sequence[Cause], known: Catalogue) -> Cause:
    first, reference = found[0], rival.suspect.reference
    p_values = {judged.what: p_value for judged, p_value in searched.first}
    # Beside a later cause that says the same nothing of it is left: it is worth what it would be in its place.
    in_place_of = [(rival, first)] + [
        (own, cause)
        for cause, rivals in zip(found[1:], searched.rivals[1:], strict=True)
        for own in rivals
        if own.is_tied and own.suspect.reference == reference
    ]
    worth_um = max(_worth_um(own, cause) for own, cause in in_place_of)
    cause = _suspected(rival.suspect, p_values.get(rival.judged.what, 1.0), rival.judged.evidence, worth_um)
    aliases = (Alias(first.reference, rival.correlation, rival.is_tied),) if rival.correlation > _ALIAS else ()
    separate_by = _separation(reference, first.reference, searched.runs, known) if rival.is_tied else None
    return replace(cause, tied=rival.is_tied, aliases=aliases, separate_by=separate_by)


def _worth_um(rival: Rival, first: Cause) -> float:
    """Give what a rival would be worth in the first's place: as much as that, by the root of the gains.

    Both beside the other causes: when the first was found alone, it did a part of what they do.
    """
    own = max(rival.judged.gain + rival.difference, 1e-300)
    return first.worth_um * math.sqrt(min(max(rival.judged.gain, 0.0) / own, 1.0))


def _suspected(suspect: Suspect, p_value: float, evidence: float, worth_um: float) -> Cause:
    return Cause(
        reference=suspect.reference,
        effect=suspect.effect,
        term=suspect.ways[0].term,
        p_value=p_value,
        evidence=evidence,
        readings=(),
        worth_um=worth_um,
        peak_to_peak_um=None,
        peak_to_peak_std_um=None,
        percent=None,
        tied=False,
        aliases=(),
        separate_by=None,
        held_out_rmse_after_um=None,
    )


def _unknown(searched: Searched) -> CircleUnknown | None:
    if searched.unknown is None:
        return None
    probe, p_value, trace = searched.unknown
    return CircleUnknown(probe.depends_on, probe.component, float(np.sqrt(np.mean(trace**2))), p_value)


def _run_figures(searched: Searched) -> tuple[RunFigures, ...]:
    # Of all rows: a spike is highest where it is not known on which side of the reversal a row lies.
    runs = searched.whole
    set_up = orthonormal(runs.set_up_columns)
    signal = runs.signal_um - set_up @ (set_up.T @ runs.signal_um)
    explained = searched.whole_traces.sum(axis=1)
    figures = []
    for number, own in enumerate(runs.slices):
        angle = runs.angle_rad[own]
        circle = orthonormal(np.column_stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)]))

        def deviation(values: np.ndarray, circle: np.ndarray = circle) -> float:
            return float(np.ptp(values - circle @ (circle.T @ values)))

        radius_um = runs.measured_um[own]
        # Seen from beside the centre the square of a circle's radius is a wave exactly, the radius itself is not.
        from_elsewhere = radius_um**2 / (2.0 * float(radius_um.mean()))
        feed = float(runs.feed_mm_min[number])
        figures.append(
            RunFigures(
                runs.names[number],
                runs.plane[number],
                int(runs.sense[number]),
                feed if math.isfinite(feed) else None,
                own.stop - own.start,
                deviation(from_elsewhere),
                deviation(explained[own]),
                deviation(signal[own] - explained[own]),
            )
        )
    return tuple(figures)


def _set_ups(runs: Runs) -> tuple[SetUpFigures, ...]:
    state = runs.fitted.solved.state
    found = []
    for number in dict.fromkeys(runs.set_up.tolist()):
        own = int(np.flatnonzero(runs.set_up == number)[0])
        centre = UM_PER_MM * (np.asarray(state.translations_mm)[number] - runs.centre_mm[own])
        still = "xyz".index(next(axis for axis in "xyz" if axis not in runs.plane[own]))
        centre[still] = 0.0
        x, y, z = (float(value) for value in centre)
        excess = UM_PER_MM * float(np.asarray(state.excess_mm)[number])
        found.append(SetUpFigures(runs.fitted.sightings.sessions[number], (x, y, z), excess))
    return tuple(found)


def _cannot_tell(runs: Runs, searched: Searched) -> list[str]:
    """Say what these runs cannot tell at all, and what would."""
    notes = []
    for plane in runs.planes:
        if not runs.has_both_senses(plane):
            notes.append(
                f"{plane.upper()} was run in one sense only: what turns with the sense (backlash, play, servo) is "
                "told from geometry by its shape alone; run it the other way too"
            )
    if len(runs.feeds()) < 2:
        notes.append("one feed only: what grows with speed is not told from what does not; run a second feed")
    unseen = [set(one.reference.axis or "") for one in searched.invisible if one.reference.effect == "radial-shrink"]
    notes += [
        _radius_not_told(runs, plane) for plane in runs.planes if len(runs.feeds(plane)) > 1 and set(plane) in unseen
    ]
    if runs.n_runs == 1:
        notes.append("a single run: noise that wanders along the circle is not told from smooth structure; repeat it")
    if len(searched.whole) > len(searched.runs):
        notes.append(
            f"{counted(len(searched.whole) - len(searched.runs), 'row')} beside a reversal decided nothing: on which "
            "side of it they lie, or how the circle was entered, the record does not tell"
        )
    if searched.n_gross:
        stand, were = ("row stands", "was") if searched.n_gross == 1 else ("rows stand", "were")
        notes.append(f"{searched.n_gross} {stand} alone far off the others and {were} left out")
    return notes


def _radius_not_told(runs: Runs, plane: str) -> str:
    """Say that each feed has set-ups of its own, and what is seen of the radius all the same."""
    excess_mm = np.asarray(runs.fitted.solved.state.excess_mm)[runs.set_up]
    feeds = runs.feeds(plane)
    own = np.array([one == plane for one in runs.plane])
    slowest, fastest = (own & np.isclose(runs.feed_mm_min, feed, rtol=SAME_FEED) for feed in feeds[[0, -1]])
    change = UM_PER_MM * float(excess_mm[fastest].mean() - excess_mm[slowest].mean())
    change_words = f"{change:+.1f}".replace("-", "−")
    return (
        f"each feed in {plane.upper()} has a set-up of its own (session and line), with a radius of its own: that a "
        f"circle shrinks as it is run faster (radial-shrink) is not told. From {feeds[0]:.5g} to {feeds[-1]:.5g} "
        f"mm/min the radius changes by {change_words} µm; if the bar stood as it was, give these runs one line"
    )


def _after(searched: Searched, place: int) -> float | None:
    """Give the held-out error with this and all causes found before it in the model."""
    terms = []
    for number in range(place + 1):
        found = searched.found[number]
        if found.judged.group.by_run or found.way.term.is_rig:
            # What differs from run to run, and what the bar does, predicts no other run.
            continue
        term = _valued(searched, number)[0]
        inner = tuple(replace(one, low=one.value, high=one.value) for one in term.inner)
        terms.append(replace(term, inner=inner))
    fitted = searched.runs.fitted
    return held_out_um(refit(fitted, [*fitted.terms, *terms]))
