"""Where a program moves in ways that a model was not fitted to, or is not followed in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from geoerr.machine import AXES
from geoerr.model import Model


def motion_notes(
    model: Model,
    at: Mapping[str, float],
    long_stroke_terms: Sequence[str],
    shortest_stroke_mm: Sequence[float],
    fastest_mm_s: Sequence[float],
) -> tuple[str, ...]:
    """Say what of a program's motion the model was not fitted to, or is not followed in.

    Parameters
    ----------
    model
        What the program was corrected by.
    at
        Conditions that were stated: a speed among them has precedence over the program's.
    long_stroke_terms
        Terms of which some wind-up is not followed from stroke to stroke.
    shortest_stroke_mm, fastest_mm_s : (3,)
        Of each axis: least travel between two reversals, infinite where there are none, and largest speed.
    """
    strokes, speeds = (dict(zip(AXES, of, strict=True)) for of in (shortest_stroke_mm, fastest_mm_s))
    return (*_too_fast(model, at, speeds), *_too_short(long_stroke_terms, strokes))


def _too_fast(model: Model, at: Mapping[str, float], speeds: Mapping[str, float]) -> Iterator[str]:
    spans = {} if model.record is None else model.record.covariate_spans
    for axis, speed in speeds.items():
        name = f"v_{axis}"
        if name not in model.conditions or name not in spans or name in at:
            continue
        measured = max(map(abs, spans[name]))
        if speed > measured:
            yield (
                f"{axis} moves at up to {speed:.4g} mm/s, and the model, which follows its speed, was fitted to up "
                f"to {measured:.4g}: there it is extrapolated"
            )


def _too_short(terms: Sequence[str], strokes: Mapping[str, float]) -> Iterator[str]:
    turning = [f"{axis} (after {stroke:.3g} mm)" for axis, stroke in strokes.items() if math.isfinite(stroke)]
    if terms and turning:
        yield (
            f"the wind-up of {', '.join(terms)} is not followed from stroke to stroke, for its length differs from "
            f"place to place, or there are too many: where {' or '.join(turning)} turns round it is corrected as if "
            "a long stroke came before"
        )
