"""From a seed to a measured machine with something hidden in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from validation.hidden_effects.chain import BASE, CARRIERS, RELATIVE, Array, Displacements, nothing, places_mm
from validation.hidden_effects.changed import CHANGED
from validation.hidden_effects.kinds import Acting, Kind
from validation.hidden_effects.limited import Limits, limited_plan
from validation.hidden_effects.listed import LISTED
from validation.hidden_effects.log import Log, arms_mm, make_log
from validation.hidden_effects.machines import ErrorFunctions, draw_machine
from validation.hidden_effects.noise import NOISES, Noise, draw_noise
from validation.hidden_effects.plans import draw_plan
from validation.hidden_effects.unlisted import UNLISTED
from validation.hidden_effects.visible import Projection, base_columns, rms_um

from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

KINDS: dict[str, Kind] = {**LISTED.kinds, **UNLISTED.kinds, **CHANGED.kinds}
# Where less of an effect than this can be seen, the plan cannot carry it: it would have to be millimetres.
LEAST_VISIBLE_SHARE = 0.01
_STRENGTH_TOLERANCE = 0.002


class CannotCarryError(ValueError):
    """The plan does not show an effect of this kind."""


@dataclass(frozen=True)
class Hidden:
    """What to hide.

    Attributes
    ----------
    kind
        Name of a kind (`KINDS`).
    axis, covariate
        As in its `axes` and `covariates`; None = drawn.
    off_formula
        RMS of a factor 1 + off·g(another axis) that makes the effect uneven: 0.3 = 30 % off its formula.
    """

    kind: str
    axis: str | None = None
    covariate: str | None = None
    off_formula: float = 0.0


@dataclass(frozen=True)
class TrueEffect:
    """One hidden effect as it was.

    Attributes
    ----------
    effect
        Id in the catalogue; None where the catalogue lacks it.
    axis, covariate
        As references write them; None where it has none.
    parameters
        True values (mm, rad, s, K).
    inner
        Which of them do not change with its strength.
    variables, channels
        What it is a function of, and where it acts.
    off_variable, off_formula
        The axis along which it is uneven, and how much.
    visible_rms_um, visible_um
        Length over the three components, and by component in base axes, of what nothing absorbs.
    visible_off_rms_um
        The same length of its unevenness alone, which may be most of what is seen of it; 0 where it is even.
    explainable_rms_um, raw_rms_um
        Length of what base and poses alone do not absorb, and of the whole displacement.
    """

    kind: str
    effect: str | None
    axis: str | None
    covariate: str | None
    parameters: dict[str, float]
    inner: tuple[str, ...]
    variables: tuple[str, ...]
    channels: tuple[str, ...]
    off_variable: str | None
    off_formula: float
    visible_rms_um: float
    visible_um: tuple[float, float, float]
    visible_off_rms_um: float
    explainable_rms_um: float
    raw_rms_um: float


@dataclass(frozen=True)
class Case:
    """One data set and its truth.

    Attributes
    ----------
    observations
        What a user would have.
    machine
        The nominal machine.
    truth
        Hidden effects; none for a null case.
    errors
        The machine's own errors.
    noise
        The kind of noise.
    outlier_rows
        (n,) which rows are outliers.
    displacement_mm
        (n, 3) what the hidden effects do, base axes.
    """

    seed: int
    chain: str
    plan: str
    observations: Observations
    machine: Machine
    truth: tuple[TrueEffect, ...]
    errors: ErrorFunctions
    noise: Noise
    outlier_rows: np.ndarray
    displacement_mm: Array
    log: Log = field(repr=False)


def generate(
    seed: int,
    chain: str | None = None,
    plan: str | Limits = "mixed",
    noise: str | Noise = "gauss-10",
    hidden: Sequence[Hidden | str] = (),
    strength_um: float = 4.0,
    n_rows: int = 10_000,
) -> Case:
    """Make a case; the same arguments give the same bytes.

    Machine, plan and log depend on the seed, `chain`, `plan` and `n_rows` only: the same measurement can be had with
    other noise, and with and without something hidden.

    Parameters
    ----------
    seed
        `cases.development_seed(i)` or `cases.study_seed(i)`.
    chain
        Structural code; None = drawn.
    plan
        One of `plans.PLANS`, or what a measurement lacks.
    noise
        One of `noise.NOISES`, or a noise of one's own.
    hidden
        What to hide: none, one, two ...; a text is a kind.
    strength_um
        Visible RMS of each of them (`visible`).
    n_rows
        About how many rows; `nine-lines` has three thousand at least.

    Raises
    ------
    CannotCarryError
        where the plan lacks what an effect needs, or base, poses, offsets and drift absorb 99 % of it.
    ValueError
        for names that are none.
    """
    whole, in_noise = (np.random.default_rng([seed, stream]) for stream in range(2))
    drawing = in_effects(seed)
    machine, errors = draw_machine(whole, chain)
    if isinstance(plan, Limits):
        log = make_log(whole, machine, limited_plan(whole, machine, plan, n_rows), plan)
    else:
        log = make_log(whole, machine, draw_plan(whole, machine, plan, n_rows))
    scene = Scene(log, errors.at(machine, log.q_mm))
    moved, truth = nothing(log.n_rows), []
    for one in hidden:
        wanted = Hidden(one) if isinstance(one, str) else one
        acting, effect = _scaled(scene, drawing, wanted, strength_um)
        moved = moved + acting
        truth.append(effect)
    noise_kind = NOISES[noise] if isinstance(noise, str) else noise
    noisy = draw_noise(in_noise, noise_kind, log.pass_number, log.session, log.t_s)
    measured = scene.measured_mm(moved) + noisy.total_mm
    observations = observations_from_columns(columns_of(log, measured, noisy.stated_mm), f"case {seed}")
    return Case(
        *(seed, machine.chain, log.plan.name, observations, machine, tuple(truth), errors, noise_kind),
        outlier_rows=noisy.is_outlier,
        displacement_mm=scene.effect_mm(moved),
        log=log,
    )


class Scene:
    """A log with the machine's own errors; projections are made when they are first needed."""

    def __init__(self, log: Log, own: Displacements) -> None:
        self.log, self.own = log, own
        self._arm = arms_mm(log.machine, log.plan)
        self._clean = self.measured_mm(nothing(log.n_rows))
        self._projections: tuple[Projection, Projection] | None = None

    def measured_mm(self, moved: Displacements) -> Array:
        """Measure without noise: exact chain, then the pose of the measuring frame, then the rig's own errors."""
        log = self.log
        place = places_mm(log.machine.chain, log.carrier, log.q_mm, self._arm, self.own + moved)
        gained = (log.camera_from_base @ (place - log.nominal_mm)[:, :, None])[:, :, 0]
        return log.in_camera_mm + gained + moved.rig_mm

    def effect_mm(self, moved: Displacements) -> Array:
        """Give what it changes, base axes."""
        changed = self.measured_mm(moved) - self._clean
        return np.asarray((np.swapaxes(self.log.camera_from_base, 1, 2) @ changed[:, :, None])[:, :, 0])

    def projections(self) -> tuple[Projection, Projection]:
        """Give the projection off everything, and off base and poses alone."""
        if self._projections is None:
            base = base_columns(self.log)
            self._projections = (
                Projection(self.log, with_offsets=True, base=base),
                Projection(self.log, with_offsets=False, base=base),
            )
        return self._projections


def _length(by_component: Array) -> float:
    return float(np.sqrt(np.sum(by_component**2)))


def _lacking(log: Log, kind: Kind) -> str | None:
    moments = log.plan.moments
    has = {
        "motion": bool(moments.is_moving.any()),
        "ramps": bool(moments.acceleration_mm_s2.any()),
        "cameras": log.plan.is_seen_by_cameras,
    }
    return next((need for need in kind.needs if not has.get(need, need in log.columns)), None)


def _drawn(rng: np.random.Generator, wanted: str | None, choices: tuple[str, ...], what: str) -> str:
    drawn = str(rng.choice(choices))
    if wanted is not None and wanted not in choices:
        raise ValueError(f"{wanted!r} is no {what} of this kind: it is one of {', '.join(choices)}")
    return drawn if wanted is None else wanted


def acting_of(log: Log, rng: np.random.Generator, wanted: Hidden) -> tuple[Acting, str, str]:
    """Give an effect of unit size as it is drawn, its axis and its covariate."""
    kind = KINDS[wanted.kind]
    axis = _drawn(rng, wanted.axis, kind.axes, "axis")
    covariate = _drawn(rng, wanted.covariate, kind.covariates, "covariate")
    return kind.physics(log, rng, axis, covariate), axis, covariate


def in_effects(seed: int) -> np.random.Generator:
    """Give the random numbers that draw a case's hidden effects."""
    return np.random.default_rng([seed, 2])


def _scaled(
    scene: Scene, rng: np.random.Generator, wanted: Hidden, strength_um: float
) -> tuple[Displacements, TrueEffect]:
    if wanted.kind not in KINDS:
        raise ValueError(f"{wanted.kind!r} is no kind: it is one of {', '.join(KINDS)}")
    kind, log = KINDS[wanted.kind], scene.log
    lacking = _lacking(log, kind)
    if lacking is not None:
        raise CannotCarryError(f"{kind.name} needs {lacking}, which the plan {log.plan.name} has not")
    acting, axis, covariate = acting_of(log, rng, wanted)
    off_variable, uneven = None, None
    if wanted.off_formula:
        acting, uneven, off_variable = _off(log, rng, acting, kind, wanted.off_formula)
    remaining, explainable = scene.projections()
    factor = 1.0
    for _ in range(6):
        effect_mm = scene.effect_mm(acting.moved.scaled(factor))
        visible = rms_um(remaining(effect_mm))
        raw = _length(rms_um(effect_mm - effect_mm.mean(axis=0)))
        if _length(visible) < LEAST_VISIBLE_SHARE * raw or not raw:
            shown = _length(visible) / raw if raw else 0.0
            raise CannotCarryError(f"{kind.name}:{axis}: the plan {log.plan.name} shows {shown:.1%} of it")
        if abs(_length(visible) / strength_um - 1.0) < _STRENGTH_TOLERANCE:
            break
        factor *= strength_um / _length(visible)
    visible_off = 0.0 if uneven is None else _length(rms_um(remaining(scene.effect_mm(uneven.scaled(factor)))))
    truth = TrueEffect(
        *(kind.name, kind.effect or None, axis or None, covariate or None),
        parameters={**{name: factor * value for name, value in acting.linear.items()}, **acting.inner},
        inner=tuple(acting.inner),
        variables=acting.variables,
        channels=acting.channels,
        off_variable=off_variable,
        off_formula=wanted.off_formula,
        visible_rms_um=_length(visible),
        visible_um=(float(visible[0]), float(visible[1]), float(visible[2])),
        visible_off_rms_um=visible_off,
        explainable_rms_um=_length(rms_um(explainable(effect_mm))),
        raw_rms_um=raw,
    )
    return acting.moved.scaled(factor), truth


def _off(
    log: Log, rng: np.random.Generator, acting: Acting, kind: Kind, share: float
) -> tuple[Acting, Displacements, str]:
    """Make an effect uneven along an axis that its formula does not have; give its unevenness alone, and the axis."""
    if not kind.off_axis:
        raise ValueError(f"{kind.name} cannot be made uneven along another axis")
    free = [a for a in range(3) if "xyz"[a] not in "".join(acting.variables)]
    if not free:
        raise ValueError(f"{kind.name} depends on all three axes: it has no other to be uneven along")
    axis = int(rng.choice(free))
    wave = np.sin(0.5 * np.pi * log.share(axis) * rng.uniform(0.8, 1.6) + rng.uniform(-0.5, 0.5))
    wave -= wave.mean()
    uneven = share * wave / np.sqrt(np.mean(wave**2))
    return replace(acting, moved=acting.moved.times(1.0 + uneven)), acting.moved.times(uneven), "xyz"[axis]


def columns_of(log: Log, measured: Array, stated: Array) -> dict[str, Array | list[str]]:
    """Give the columns that a user has."""
    moments, rows, moment = log.plan.moments, log.plan.rows, log.moment
    passes = [moments.passes[number] for number in log.pass_number]
    columns: dict[str, Array | list[str]] = {
        "session": [str(one.session) for one in passes],
        "line": [one.line for one in passes],
        "repeat": np.array([one.repeat for one in passes]),
        "carrier": [CARRIERS[code] for code in rows.carrier],
        "target": [f"{CARRIERS[code]}-{name}" for code, name in zip(rows.carrier, rows.target, strict=True)],
        "t": log.t_s,
    }
    for a, axis in enumerate("xyz"):
        columns[axis] = log.q_mm[:, a]
        columns[f"dir_{axis}"] = log.moved("direction", a).astype(np.int64)
        # Nobody measures where a static marker is, nor needs it.
        columns[f"t{axis}"] = np.where(rows.carrier == BASE, 0.0, rows.offset_mm[:, a])
        columns[f"m{axis}"] = measured[:, a]
        columns[f"s{axis}"] = stated[:, a]
    columns["feed"] = log.feed_mm_min
    columns["moving"] = moments.is_moving[moment].astype(np.int64)
    columns |= log.columns
    if log.plan.is_seen_by_cameras and not np.any(rows.carrier == RELATIVE):
        columns |= log.pixels()
    return columns
