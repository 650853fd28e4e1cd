"""How well a hidden effect's inner parameters can be known: the Cramér–Rao bound, from the generator's own formulas.

Coefficients, base, poses and, where the noise has them, offsets and drift are unknown beside them. White noise is
taken as Gauss of the stated size, outliers as none. A jump's moment has no such bound: a likelihood that jumps is not
differentiable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from validation.hidden_effects.chain import Array
from validation.hidden_effects.generate import Case, Hidden, Scene, acting_of, in_effects
from validation.hidden_effects.visible import Projection

_STEP = 1e-4


def inner_bounds(case: Case) -> dict[str, float]:
    """Give the least standard deviation of every inner parameter of the first hidden effect."""
    effect = case.truth[0]
    if not effect.inner:
        return {}
    log, scene = case.log, Scene(case.log, case.errors.at(case.machine, case.log.q_mm))
    wanted = Hidden(effect.kind, effect.axis, effect.covariate)

    def moved_mm(given: Mapping[str, float]) -> Array:
        acting, _, _ = acting_of(replace(log, given=dict(given)), in_effects(case.seed), wanted)
        return scene.effect_mm(acting.moved.scaled(factor))

    unit, _, _ = acting_of(log, in_effects(case.seed), wanted)
    names = [*effect.inner]
    first = next(iter(unit.linear))
    factor = effect.parameters[first] / unit.linear[first]
    fixed = {**unit.linear, **unit.inner}
    # Alone, a coefficient is in proportion to the whole.
    varied = [*names, *(unit.linear if len(unit.linear) > 1 else ())]
    columns = [] if len(unit.linear) > 1 else [moved_mm(fixed) / fixed[first]]
    for name in varied:
        largest = max(abs(unit.linear[one]) for one in unit.linear)
        step = _STEP * (abs(fixed[name]) if name in names and fixed[name] else largest)
        up, down = (moved_mm({**fixed, name: fixed[name] + sign * step}) for sign in (1.0, -1.0))
        columns.append((up - down) / (2.0 * step))
    noise = case.noise
    projection = Projection(log, with_offsets=bool(noise.pass_offset_um or noise.drift_um))
    derivative = projection(np.stack(columns, axis=2)).reshape(-1, len(columns))
    derivative /= 1e-3 * float(np.sqrt(np.mean(np.square(noise.white_um))))
    size = np.sqrt(np.sum(derivative**2, axis=0))
    # What was not drawn (an image's centre), or does not act by itself (a plate's thickness, a jump's moment between
    # two rows), has no bound.
    acts = size > 0.0
    derivative, size = derivative[:, acts], size[acts]
    covariance = np.linalg.pinv((derivative / size).T @ (derivative / size), rcond=1e-12)
    least = np.sqrt(np.diag(covariance)) / size
    bounds = np.full(len(columns), np.nan)
    bounds[acts] = least
    shift = len(columns) - len(varied)
    return {name: float(bounds[shift + place]) for place, name in enumerate(names) if acts[shift + place]}
