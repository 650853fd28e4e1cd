"""Right models and data that they have not seen: are they told to lack something; is what one lacks told there.

    python -m validation.given_models [--sets 40] [--hidden 4]

A model of all 21 errors is fitted to the first two sessions of a simulated machine (`validation.hidden_effects`,
seeds of development), and diagnosed with the others, as anybody's model is with new data. With its covariance, as
`geoerr.diagnose.diagnose` counts it, and without, as if the model were exact.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl
from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import CannotCarryError, Case, Hidden, generate
from validation.hidden_effects.tables import rate, table
from validation.hidden_effects.unlisted import UNLISTED

from geoerr.diagnose import Diagnosis, diagnose
from geoerr.fit import FitOptions, fit_model
from geoerr.model import Model
from geoerr.observations import Observations
from geoerr.summaries import listed

RESULTS = Path(__file__).with_name("given_models.md")
FIRST_SEED, N_ROWS, SEEN_SESSIONS, STRENGTH_UM = 997_000, 4_000, 2, 8.0
PLANS, NOISES = ("volume-floor", "volume-relative"), ("gauss-10", "offsets-3", "drift-2", "heavy-tails")
# No plan here may show what is hidden.
MOST_IN_VAIN = 60
KINDS = ("backlash", "thermal-expansion", "periodic", "gantry-racking", "screw-wobble", "angular-thermal")


def cases(n_sets: int, first: int, *hidden: Hidden) -> Iterator[tuple[str, str, Case]]:
    """Give so many machines with their plan and noise; where the plan cannot show what is hidden, another, if any."""
    number, in_vain = first, 0
    while n_sets and in_vain < MOST_IN_VAIN:
        plan, noise = PLANS[number // len(NOISES) % len(PLANS)], NOISES[number % len(NOISES)]
        try:
            seed, strength_um = development_seed(FIRST_SEED + number), STRENGTH_UM if hidden else 0.0
            yield plan, noise, generate(seed, None, plan, noise, hidden, strength_um, N_ROWS)
            n_sets -= 1
        except CannotCarryError:
            in_vain += 1
        number += 1


def sessions(observations: Observations, *, seen: bool) -> Observations:
    """Give the sessions that the model is fitted to, or the others."""
    names = observations.frame["session"].unique(maintain_order=True).to_list()
    part = names[:SEEN_SESSIONS] if seen else names[SEEN_SESSIONS:]
    return replace(observations, frame=observations.frame.filter(pl.col("session").is_in(part)))


def exact(model: Model) -> Model:
    """Give a model as if it were known exactly."""
    assert model.record is not None
    return replace(model, record=replace(model.record, covariance=np.zeros_like(model.record.covariance)))


@dataclass(frozen=True)
class Told:
    """What a diagnosis says: its verdict, and the effects that it names first or as tied with the first."""

    verdict: str
    names: frozenset[str]

    @classmethod
    def by(cls, diagnosis: Diagnosis) -> Told:
        """Keep what it says, and not its numbers."""
        named = (*diagnosis.found[:1], *diagnosis.tied)
        return cls(diagnosis.verdict, frozenset(one.reference.effect for one in named))


def told_of(case: Case) -> tuple[Told, Told]:
    """Diagnose a model of the first sessions with the others: with its covariance, and as if it were exact."""
    model, others = given(case)
    return Told.by(diagnose(model, others, threads=1)), Told.by(diagnose(exact(model), others, threads=1))


def given(case: Case) -> tuple[Model, Observations]:
    """Give a model of the first sessions, and the others."""
    seen, others = (sessions(case.observations, seen=is_seen) for is_seen in (True, False))
    return fit_model(case.machine, seen, options=FitOptions(threads=1)).model, others


def nulls(n_sets: int) -> str:
    """Give how many right models are told to lack something."""
    told = [(plan, noise, *told_of(case)) for plan, noise, case in cases(n_sets, 0)]
    rows = []
    for name in ("all", *PLANS, *NOISES):
        own = [both for plan, noise, *both in told if name in ("all", plan, noise)]
        alarms = (sum(one[way].verdict != "nothing-missing" for one in own) for way in (0, 1))
        rows.append([name, *(rate(count, len(own)) for count in alarms)])
    return table(["nothing is missing", "alarms", "alarms, the model taken for exact"], rows)


def hidden_effects(n_sets: int) -> str:
    """Give how often what the model lacks is named first, or tied with what is."""
    rows = []
    for place, kind in enumerate(KINDS):
        told = [told_of(case) for _, _, case in cases(n_sets, 1_000 * (place + 1), Hidden(kind))]
        named = (sum(kind in both[way].names for both in told) for way in (0, 1))
        unknown = (sum(both[way].verdict == "unknown" for both in told) for way in (0, 1))
        rows.append([kind, *(f"{count}/{n_sets}" for count in (*named, *unknown))])
    head = [f"{STRENGTH_UM:g} µm hidden", "named", "named, exact", "unknown", "unknown, exact"]
    return table(head, rows)


def without_names(n_sets: int) -> str:
    """Give what is told of what no catalogue has, where the model's own data had it, too."""
    rows = []
    for place, kind in enumerate(UNLISTED.kinds):
        first = 1_000 * (len(KINDS) + place + 1)
        told = [Told.by(diagnose(*given(case), threads=1)) for _, _, case in cases(n_sets, first, Hidden(kind))]
        if not told:
            continue
        named = listed(sorted({name for one in told for name in one.names}))
        verdicts = [one.verdict for one in told]
        counts = (verdicts.count("unknown"), sum(bool(one.names) for one in told), verdicts.count("nothing-missing"))
        rows.append([kind, *(f"{count}/{len(told)}" for count in counts), named])
    return table([f"{STRENGTH_UM:g} µm that no catalogue has", "unknown", "named", "silent", "names"], rows)


def asked_for(
    arguments: Sequence[str] | None, description: str | None, n_sets: int, results: Path
) -> argparse.Namespace:
    """Read how many sets there are to be, and where the tables go."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0] if description else None)
    parser.add_argument("--sets", type=int, default=n_sets)
    parser.add_argument("--hidden", type=int, default=4)
    parser.add_argument("-o", type=Path, default=results)
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the tables."""
    asked = asked_for(arguments, __doc__, 40, RESULTS)
    text = "# Models that are given\n\n`python -m validation.given_models`\n\n"
    text += "Models of two sessions, diagnosed with the others: with their covariance, and as if they were exact.\n\n"
    parts = (nulls(asked.sets), hidden_effects(asked.hidden), without_names(asked.hidden // 2))
    asked.o.write_text(text + "\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
