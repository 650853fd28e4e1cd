"""The classic errors as candidates, where a model lacks their channel: angles of a model of twelve components.

A candidate is a low polynomial of the axis's position on each channel that is lacking, the directions of an effect
together; what is added for it is a spline (`Effect.terms`).
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from geoerr.effects import Effect
from geoerr.effects.collection import Catalogue
from geoerr.effects.definitions import number_text
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import SAME_POSITION_MM
from geoerr.machine import AXES
from geoerr.terms import EffectReference, Parameter, Part, Term

# A bow, an S and what tilts them; a constant is the measuring frame's, or an axis's that carries this one.
_DEGREE = 3
_LEGENDRE = ("u", "(1.5*u^2 - 0.5)", "(2.5*u^3 - 1.5*u)")


def lacking_classics(
    fitted: Fitted, known: Catalogue, present: Collection[str] = ()
) -> list[tuple[EffectReference, Effect, Term]]:
    """Give the classic errors of which a model lacks a channel, each as a candidate's term, values unknown.

    Parameters
    ----------
    fitted
        The fit; channels that its terms act on are held.
    known
        Where the smooth effects are.
    present
        Channels that the model has besides those of the fit.
    """
    held = {channel for term in fitted.terms if term.kind == "classic" for channel in term.channels} | set(present)
    found = []
    for effect in known:
        if not effect.is_smooth:
            continue
        for axis in effect.axes:
            reference = EffectReference(effect.id, axis)
            lacking = [term.id for term in effect.terms(axis, None, fitted.machine) if term.id not in held]
            term = _polynomials(fitted, effect, reference, lacking)
            if term is not None:
                found.append((reference, effect, term))
    return found


def _polynomials(fitted: Fitted, effect: Effect, reference: EffectReference, channels: list[str]) -> Term | None:
    """Give polynomials on these channels; None where there are none, or the axis hardly moved."""
    axis = reference.axis or ""
    q_mm = fitted.sightings.commanded_mm[fitted.solved.used, AXES.index(axis)]
    positions = np.unique(np.round(q_mm / SAME_POSITION_MM))
    degree = min(_DEGREE, len(positions) - 1)
    if not channels or degree < 1:
        return None
    low, high = float(q_mm.min()), float(q_mm.max())
    middle, half = number_text(0.5 * (low + high)), number_text(0.5 * (high - low))
    definitions = (("u", f"({axis} - {middle})/{half}"),)
    parts, coefficients = [], []
    for channel in channels:
        own = [f"c{n}_{channel}" for n in range(1, degree + 1)]
        texts = [f"{name}*{function}" for name, function in zip(own, _LEGENDRE, strict=False)]
        parts.append(Part(channel, " + ".join(texts), definitions))
        coefficients += [Parameter(name, "rad" if channel[1] in "ABC" else "mm") for name in own]
    return Term(
        id=str(reference),
        title=effect.title,
        kind="effect",
        effect=effect.id,
        axis=axis,
        covariate=None,
        parts=tuple(parts),
        coefficients=tuple(coefficients),
        source=effect.origin,
    )
