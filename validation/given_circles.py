"""Right models and circles that they have not seen: are they told to lack something; is what they lack named.

    python -m validation.given_circles [--sets 14] [--hidden 4]

A model of all 21 errors is fitted to points of a simulated machine (`validation.hidden_effects`, seeds of
development), with few splines or smooth, or one of a ball bar's causes to circles; then it is held against circles of
the same machine (`circular_tests.py`), in three planes, both senses and two feeds. With its covariance, as
`diagnose_circles` counts it, and without, as if the model were exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from validation.given_models import asked_for, exact
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.chain import RELATIVE, nothing, places_mm
from validation.hidden_effects.generate import Case, generate
from validation.hidden_effects.tables import rate, table

from geoerr.diagnose.change import add_effect
from geoerr.diagnose.circles import CircleDiagnosis, diagnose_circles
from geoerr.fit import FitOptions, fit_model
from geoerr.machine import Machine
from geoerr.model import Model
from geoerr.observations import CircularTest
from validation import circular_tests as made

RESULTS = Path(__file__).with_name("given_circles.md")
FIRST_SEED, N_POINTS, N_ROWS = 998_000, 2_000, 72
PLANS, NOISES = ("volume-floor", "volume-relative"), ("gauss-10", "offsets-3", "drift-2", "heavy-tails")
RUNS = tuple(
    made.Run(plane, sense, feed, line=line)
    for plane, line, feeds in (
        ((0, 1), "XY", (2000.0, 500.0)),
        ((1, 2), "YZ", (1000.0,)),
        ((2, 0), "ZX", (1000.0,)),
    )
    for feed in feeds
    for sense in (1, -1)
)
# Of a radius, µm: what a machine gained after its model was made.
HIDDEN: dict[str, Callable[[float], made.Cause]] = {
    "backlash:x": lambda _: made.backlash(0, 5.0),
    "scale:x": lambda radius: made.scale(0, 8e3 / radius),
    "squareness:xy": lambda radius: made.squareness(0, 1, 8e3 / radius),
}
CAUSES = ("squareness:xy", "squareness:xz", "squareness:yz", "scale:x", "scale:y", "backlash:x", "backlash:y")


def circles_of(
    case: Case, seed: int, hidden: str | None = None, runs: Sequence[made.Run] = RUNS, n_rows: int = N_ROWS
) -> CircularTest:
    """Measure circles of a case's machine, somewhere about the middle of its travel; noise is all of it."""
    rng = np.random.default_rng([seed, 1])
    low, high = np.array([case.machine.axes[axis].range_mm for axis in "xyz"]).T
    radius = float(np.round(0.3 * (high - low).min()))
    moved = 0.5 * (low + high) + rng.uniform(-0.15, 0.15, 3) * (high - low) - made.CENTRE_MM
    causes = [_own_errors(case, moved)] + ([HIDDEN[hidden](radius)] if hidden else [])
    test = made.circular_test(made.Plan("given", tuple(runs), n_rows, radius), causes, made.NOISES["all of it"], rng)
    places = [(pl.col(axis) + moved[place]).round(6) for place, axis in enumerate("xyz")]
    return CircularTest(test.frame.with_columns(places), test.sources)


def _own_errors(case: Case, moved: np.ndarray) -> made.Cause:
    """Give what the machine's 21 errors do to the tool seen from the work, with all circles moved."""

    def displacement(m: made.Motion, _: np.random.Generator) -> np.ndarray:
        q = m.q + moved
        arm, carrier = np.tile(np.asarray(case.machine.tool_offset_mm), (len(q), 1)), np.full(len(q), RELATIVE)
        actual, nominal = (
            places_mm(case.machine.chain, carrier, q, arm, errors)
            for errors in (case.errors.at(case.machine, q), nothing(len(q)))
        )
        return np.asarray(actual - nominal)

    return displacement


def case_of(number: int) -> Case:
    """Give a machine and points of it."""
    plan, noise = PLANS[number // len(NOISES) % len(PLANS)], NOISES[number % len(NOISES)]
    return generate(development_seed(FIRST_SEED + number), None, plan, noise, (), 0.0, N_POINTS)


def few_splines(number: int, hidden: str | None = None) -> tuple[Model, CircularTest]:
    """Fit the 21 errors with few splines (`geoerr fit`) to points, and measure circles."""
    case = case_of(number)
    model = fit_model(case.machine, case.observations, options=FitOptions(threads=1)).model
    return model, circles_of(case, number, hidden)


def smooth(number: int, hidden: str | None = None) -> tuple[Model, CircularTest]:
    """Do the same with functions as smooth as the data say (`geoerr identify`)."""
    case = case_of(number)
    model = fit_model(case.machine, case.observations, options=FitOptions(freedom="smooth", threads=1)).model
    return model, circles_of(case, number, hidden)


def causes_of_a_ball_bar(number: int, hidden: str | None = None) -> tuple[Model, CircularTest]:
    """Fit causes that there are to circles, and measure larger ones; what is hidden there is more of one of them."""
    rng = np.random.default_rng([FIRST_SEED, number])
    angle, scale, play = rng.normal(0.0, 60.0, 3), rng.normal(0.0, 60.0, 2), rng.normal(0.0, 4.0, 2)
    causes = [made.squareness(a, b, size) for (a, b), size in zip(((0, 1), (0, 2), (1, 2)), angle, strict=True)]
    causes += [made.scale(axis, size) for axis, size in enumerate(scale)]
    causes += [made.backlash(axis, size) for axis, size in enumerate(play)]
    noise = made.NOISES["all of it"]
    seen = made.circular_test(made.Plan("seen", RUNS, N_ROWS, 80.0), causes, noise, rng)
    model = Model(Machine.from_chain("wZbXYt", (420.0, 520.0, 300.0)))
    for cause in CAUSES:
        model = add_effect(model, seen, reference=cause, threads=1).result.model
    gained = [HIDDEN[hidden](120.0)] if hidden else []
    return model, made.circular_test(made.Plan("new", RUNS, N_ROWS, 120.0), [*causes, *gained], noise, rng)


MODELS: dict[str, Callable[[int, str | None], tuple[Model, CircularTest]]] = {
    "21 errors of points, few splines": few_splines,
    "21 errors of points, smooth": smooth,
    "causes of a ball bar": causes_of_a_ball_bar,
}


def is_named(diagnosis: CircleDiagnosis, hidden: str) -> bool:
    """Tell whether what is hidden is named, or tied with what is; of one plane a scale is a mismatch."""
    names = {str(one.reference) for one in diagnosis.found}
    names |= {str(alias.reference) for one in diagnosis.found for alias in diagnosis.tied_with(one)}
    return hidden in names or (hidden == "scale:x" and bool(names & {"scale-mismatch:xy", "scale-mismatch:xz"}))


def both_ways(model: Model, circles: CircularTest) -> tuple[CircleDiagnosis, CircleDiagnosis]:
    """Diagnose a model with circles: with its covariance, and as if it were exact."""
    own, without = (diagnose_circles(one, circles, threads=1) for one in (model, exact(model)))
    return own, without


def nulls(n_sets: int) -> str:
    """Give how many right models are told to lack something."""
    rows = []
    for name, make in MODELS.items():
        told = [[one.verdict for one in both_ways(*make(number, None))] for number in range(n_sets)]
        alarms = (sum(both[way] != "nothing-missing" for both in told) for way in (0, 1))
        rows.append([name, *(rate(count, n_sets) for count in alarms)])
    return table(["nothing is missing", "alarms", "alarms, the model taken for exact"], rows)


def gained(n_sets: int) -> str:
    """Give how often what a machine gained is named, or tied with what is."""
    rows = []
    for place, hidden in enumerate(HIDDEN):
        for name, make in MODELS.items():
            made_of = [make(1_000 * (place + 1) + number, hidden) for number in range(n_sets)]
            named = sum(is_named(diagnose_circles(*one, threads=1), hidden) for one in made_of)
            rows.append([hidden, name, f"{named}/{n_sets}"])
    return table(["gained", "model", "named"], rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the tables."""
    asked = asked_for(arguments, __doc__, 14, RESULTS)
    text = "# Models that are held against circular tests\n\n`python -m validation.given_circles`\n\n"
    text += "Circles that the models have not seen: with their covariance, and as if they were exact.\n\n"
    text += nulls(asked.sets) + "\nA play of 5 µm; a scale and a squareness of 8 µm over the radius.\n\n"
    asked.o.write_text(text + gained(asked.hidden), encoding="utf-8")


if __name__ == "__main__":
    main()
