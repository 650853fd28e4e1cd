"""One set of the study, measured: a fit, a diagnosis, and beside them the truth, as one line of JSON."""

from __future__ import annotations

import time
import traceback
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
from validation.hidden_effects.bound import inner_bounds
from validation.hidden_effects.generate import CannotCarryError, Case, TrueEffect
from validation.hidden_effects.sets import Set

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.fit import FitOptions, Fitted, fit_terms
from geoerr.observations import MEASURED, Observations
from geoerr.terms import EffectReference

# Everything as a user has it: 21 components, their freedom chosen by the data.
OPTIONS = FitOptions(threads=1)


def record(one: Set, n_rows: int, *, is_study: bool) -> dict[str, Any]:
    """Generate, fit and diagnose a set.

    Returns
    -------
    dict
        `failed` holds what was raised, if anything was; a plan that cannot carry the effect is `not-carried`.
    """
    line: dict[str, Any] = {"key": one.key, "part": one.part, "cell": one.cell, "number": one.number}
    line |= {"strength_um": one.strength_um, "noise": one.noise, "is_study": is_study, "failed": None}
    try:
        case = one.case(n_rows, is_study=is_study)
    except CannotCarryError as why:
        return line | {"failed": "not-carried", "why": str(why)}
    line |= {"seed": case.seed, "chain": case.chain, "plan": case.plan, "n": len(case.observations)}
    line["truth"] = [truth_of(case, place) for place in range(len(case.truth))]
    try:
        start = time.perf_counter(), time.process_time()
        fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
        middle = time.perf_counter(), time.process_time()
        diagnosis = diagnose(fitted, threads=1)
        end = time.perf_counter(), time.process_time()
        # On the clock, and of one processor: the two are the same on a machine that does nothing else.
        for key, place in (("seconds", 0), ("cpu_seconds", 1)):
            line[key] = {"fit": middle[place] - start[place], "diagnose": end[place] - middle[place]}
        line |= answer_of(diagnosis)
        if case.truth:
            line["oracle_um"] = _held_out_um(fit_terms(case.machine, [without_hidden(case)], options=OPTIONS))
    except Exception as failure:
        # A set that cannot be diagnosed is a result of the study, not its end.
        line["failed"] = f"{type(failure).__name__}: {failure}"
        line["traceback"] = traceback.format_exc()
    return line


def truth_of(case: Case, place: int) -> dict[str, Any]:
    """Give what was hidden, as a line has it."""
    effect = case.truth[place]
    bounds = inner_bounds(case) if place == 0 and effect.effect is not None else {}
    # A candidate is named by its temperature; a column that its formula names is no choice.
    covariate = effect.covariate if (effect.covariate or "").startswith("temp") else None
    name = None if effect.effect is None else str(EffectReference(effect.effect, effect.axis, covariate))
    return {
        "kind": effect.kind,
        "name": name,
        "parameters": {**effect.parameters, **on_one_clock(case, effect)},
        "inner": list(effect.inner),
        "bounds": bounds,
        "variables": list(effect.variables),
        "off_variable": effect.off_variable,
        "visible_um": effect.visible_rms_um,
        "visible_off_um": effect.visible_off_rms_um,
        "raw_um": effect.raw_rms_um,
        "ranges": {axis: list(case.machine.axes[axis].range_mm) for axis in "xyz"},
    }


def on_one_clock(case: Case, effect: TrueEffect) -> dict[str, float]:
    """Give the moment of a jump with sessions laid end to end, as the catalogue counts it."""
    if "session" not in effect.parameters:
        return {}
    log, before = case.log, 0.0
    for session in range(int(effect.parameters["session"]) + 1):
        own = log.t_s[log.session == session]
        shift = before - own.min() if session else 0.0
        before = shift + own.max()
    return {"t0": shift + effect.parameters["t0"]}


def answer_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """Give what was found, as a line has it."""
    document = diagnosis.to_document()
    unknown = document["unknown"]
    return {
        "verdict": document["verdict"],
        "p": document["p_value"],
        "p_of_candidates": _p_of_candidates(diagnosis),
        "found": [_finding(one) for one in document["found"]],
        "candidates": [_finding(one) for one in document["candidates"]],
        "unknown": unknown,
        "before_um": document["held_out_rmse_um"],
        "floor_um": document["noise_floor_um"],
    }


def kept(line: dict[str, Any]) -> dict[str, Any]:
    """Give what the tables read of a set: thousands of lines lie beside them."""
    if line["failed"]:
        return line
    unknown = line["unknown"]
    return line | {
        "candidates": [{"name": one["name"], "tied": one["tied"]} for one in line["candidates"]],
        "unknown": None if unknown is None else {name: unknown[name] for name in ("component", "depends_on")},
    }


def _p_of_candidates(diagnosis: Diagnosis) -> float:
    """Give the probability that chance finds as much among the candidates alone, without the probes."""
    first = diagnosis.searched.first
    return first.null.p_value(max((one.surprise for one in first.candidates), default=-np.inf))


def _finding(one: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": _name(one),
        "p": one["p_value"],
        "worth_um": one["worth_um"],
        "after_um": one["held_out_rmse_after_um"],
        "tied": one["tied"],
        "like": [[_name(alias), alias["correlation"]] for alias in one["aliases"]],
        "parameters": {name: [value["value"], value["std"]] for name, value in one["parameters"].items()},
        "separate_by": one["separate_by"],
    }


def _name(one: dict[str, Any]) -> str:
    return str(EffectReference(one["effect"], one["axis"], one["covariate"]))


def _held_out_um(fitted: Fitted) -> float | None:
    figures = fitted.held_out.figures
    return None if figures is None else figures.headline_um


def without_hidden(case: Case) -> Observations:
    """Give the measurements without what was hidden: what an oracle that knows it would fit."""
    log = case.log
    moved = (log.camera_from_base @ case.displacement_mm[:, :, None])[:, :, 0]
    left = case.observations.measured_mm - moved
    columns = [pl.Series(name, left[:, axis]) for axis, name in enumerate(MEASURED)]
    return replace(case.observations, frame=case.observations.frame.with_columns(columns))


def finite(values: Any, digits: int = 17) -> Any:
    """Give the same with so many digits of each number, and what is no number as null: JSON has no other."""
    if isinstance(values, dict):
        return {key: finite(value, digits) for key, value in values.items()}
    if isinstance(values, (list, tuple)):
        return [finite(value, digits) for value in values]
    if isinstance(values, (float, np.floating)):
        return float(f"{values:.{digits}g}") if np.isfinite(values) else None
    return values
