"""Where a program moves in ways that a model was not fitted to: faster, or to and fro over less than it takes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.terms import Term

# What winds up after a reversal is all there but for a twentieth after so many of its lengths.
_WOUND = 3.0
_WOUND_UP = "windup("
_UM_PER_MM = 1e3


def motion_notes(
    model: Model, at: Mapping[str, float], shortest_stroke_mm: Sequence[float], fastest_mm_s: Sequence[float]
) -> tuple[str, ...]:
    """Say what of a program's motion the model was not fitted to, or is not followed in.

    Parameters
    ----------
    model
        What the program was corrected by.
    at
        Conditions that were stated: a speed among them has precedence over the program's.
    shortest_stroke_mm, fastest_mm_s : (3,)
        Of each axis: least travel between two reversals, infinite where there are none, and largest speed.
    """
    strokes, speeds = (dict(zip(AXES, of, strict=True)) for of in (shortest_stroke_mm, fastest_mm_s))
    return (*_too_fast(model, at, speeds), *_too_short(model, strokes))


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


def _too_short(model: Model, strokes: Mapping[str, float]) -> Iterator[str]:
    for term in model.terms:
        axis = term.axis or ""
        length_mm = next((one.value for one in term.inner if one.name == "lambda"), math.inf)
        if _winds_up(term) and strokes.get(axis, math.inf) < _WOUND * length_mm:
            size_um = _UM_PER_MM * max((abs(one.value) for one in term.coefficients), default=0.0)
            yield (
                f"{axis} turns round after {strokes[axis]:.3g} mm, where {term.id} takes {_WOUND * length_mm:.3g} mm "
                f"to build up: each of its strokes is corrected as if a long one came before, and behind a short one "
                f"the correction may be off by up to {size_um:.3g} µm"
            )


def _winds_up(term: Term) -> bool:
    return any(_WOUND_UP in (part.expression or "").replace(" ", "") for part in term.parts)
