"""Compare formulas: the catalogue's, with what was hidden put in, against the generator's displacement.

    python -m validation.hidden_effects.formulas [--kind KIND]

Hardly any noise; the term of the catalogue has the true inner parameters, its coefficients are fitted with the base.
What is left of 4 µm, and the coefficients by the true ones, tell whether both sides mean the same by a name.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, replace

import numpy as np
from validation.hidden_effects.generate import KINDS, CannotCarryError, Case, generate
from validation.hidden_effects.listed import LISTED
from validation.hidden_effects.noise import Noise
from validation.hidden_effects.record import on_one_clock
from validation.hidden_effects.sets import PLAN_ORDER

from geoerr.effects import catalogue
from geoerr.errors import InputFileError
from geoerr.fit import FitOptions, fit_terms
from geoerr.terms import Term

QUIET = Noise(white_um=(0.02, 0.02, 0.02))
STRENGTH_UM = 4.0
_SEEDS = 6


@dataclass(frozen=True)
class Compared:
    """What the catalogue's formula leaves (µm, length over three components), and coefficients by the true ones."""

    case: Case
    left_um: float
    ratios: dict[str, float]


def compared(kind: str, plan: str, n_rows: int, first_seed: int = 0) -> Compared | None:
    """Compare one kind in one plan; None where the plan does not show it."""
    for seed in range(first_seed, first_seed + _SEEDS):
        try:
            case = generate(seed, None, plan, QUIET, [kind], STRENGTH_UM, n_rows)
        except CannotCarryError:
            continue
        term, true = term_of(case)
        options = FitOptions(threads=1, is_robust=False)
        fitted = fit_terms(case.machine, [case.observations], effects=[term], options=options)
        left = 1e3 * math.sqrt(float(np.sum(fitted.residual_mm**2)) / len(fitted.residual_mm))
        (own,) = (one for one in fitted.terms if one.id == term.id)
        ratios = {one.name: one.value / true[one.name] for one in own.coefficients if true.get(one.name)}
        return Compared(case, left, ratios)
    return None


def term_of(case: Case) -> tuple[Term, dict[str, float]]:
    """Give the catalogue's term with the fewest parameters that has all that was hidden, inner ones held."""
    truth = case.truth[0]
    assert truth.effect is not None
    effect, found = catalogue()[truth.effect], []
    true = {**truth.parameters, **on_one_clock(case, truth)}
    inner = {name: true[name] for name in truth.inner if name != "session"}
    for form in effect.forms:
        for lagged in (False, True):
            options = {"form": form.name, "lagged": lagged, "time_range_s": (0.0, 1e6), "sessions": ("0", "1", "2")}
            try:
                term = effect.term(truth.axis, truth.covariate, case.machine, **options)
            except InputFileError:
                # This form belongs to another covariate.
                continue
            names = {one.name for one in (*term.coefficients, *term.inner)}
            if (set(true) - {"session"}) <= names:
                found.append(term)
    term = min(found, key=lambda one: len(one.coefficients) + len(one.inner))
    term = term.with_values(inner=[inner.get(one.name, one.value) for one in term.inner])
    return replace(term, inner=tuple(replace(one, low=one.value, high=one.value) for one in term.inner)), true


def main() -> None:
    """Compare all kinds in all plans."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", action="append", choices=[*LISTED.kinds])
    given = parser.parse_args()
    print("| effect | plan | left of 4 µm | coefficients by the true ones |\n| --- | --- | --- | --- |")
    for kind in given.kind or LISTED.kinds:
        for plan in dict.fromkeys(PLAN_ORDER):
            found = compared(kind, plan, 1500)
            if found is not None:
                ratios = ", ".join(f"{name} {ratio:.3f}" for name, ratio in found.ratios.items())
                print(f"| {KINDS[kind].name} | {plan} | {found.left_um:.3f} µm | {ratios} |", flush=True)


if __name__ == "__main__":
    main()
