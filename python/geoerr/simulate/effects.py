"""Hidden effects: what a plan may put into the virtual machine besides its 21 errors.

Ids, symbols and formulas are those of the catalogue of physical effects; they are written out here once more, apart
from the catalogue and its expressions, so that diagnosis is tested against something it does not share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoerr.machine import AXES, Machine
from geoerr.simulate.entries import Entries
from geoerr.simulate.machine import Disturbance, no_disturbance
from geoerr.simulate.moments import Moments
from geoerr.simulate.rotations import Array


@dataclass(frozen=True)
class HiddenEffect:
    """One hidden effect.

    Attributes
    ----------
    effect
        Id of the catalogue.
    axis
        `x y z`: the moving axis, or the direction of a tool effect; `work-x` ...: the direction of a work effect;
        None where the effect has no axis.
    covariate
        Name of a column, or a difference `temp_a-temp_b`; None where the effect needs none.
    parameters
        ASCII symbol to value, in mm, rad, s, K.
    """

    effect: str
    axis: str | None
    covariate: str | None
    parameters: dict[str, float]


@dataclass(frozen=True)
class _Setting:
    """What an effect is computed from."""

    hidden: HiddenEffect
    moments: Moments
    machine: Machine

    def __getitem__(self, parameter: str) -> float:
        return self.hidden.parameters[parameter]

    @property
    def index(self) -> int:
        """Give the index of the axis or direction."""
        return AXES.index((self.hidden.axis or "").removeprefix("work-"))

    @property
    def q_mm(self) -> Array:
        return self.moments.q_mm[:, self.index]

    @property
    def direction(self) -> Array:
        return self.moments.direction[:, self.index].astype(np.float64)

    @property
    def temperature_k(self) -> Array:
        """Give the column minus the reference temperature, or the difference of two columns."""
        first, _, second = (self.hidden.covariate or "").partition("-")
        subtract = self.moments.covariates[second] if second else self.machine.reference_temperature_degc
        return np.asarray(self.moments.covariates[first] - subtract)


@dataclass(frozen=True)
class _Effect:
    """One entry of the list: where it acts, what it needs, and what it adds to a disturbance."""

    channel: str
    defaults: dict[str, float | None]
    add: Callable[[_Setting, Disturbance], None]
    covariate: bool = False


def _along(displacement_mm: Callable[[_Setting], Array]) -> Callable[[_Setting, Disturbance], None]:
    def add(setting: _Setting, disturbance: Disturbance) -> None:
        disturbance.delta_mm[:, setting.index, setting.index] += displacement_mm(setting)

    return add


def _body(displacement_mm: Callable[[_Setting], Array]) -> Callable[[_Setting, Disturbance], None]:
    def add(setting: _Setting, disturbance: Disturbance) -> None:
        on_work = (setting.hidden.axis or "").startswith("work-")
        body = disturbance.work_mm if on_work else disturbance.tool_mm
        body[:, setting.index] += displacement_mm(setting)

    return add


def _across(setting: _Setting, disturbance: Disturbance) -> None:
    for index, name in enumerate(AXES):
        if index != setting.index:
            disturbance.delta_mm[:, setting.index, index] += 0.5 * setting[f"l_{name}"] * setting.direction


def _angular(setting: _Setting, disturbance: Disturbance) -> None:
    for index, name in enumerate(AXES):
        disturbance.epsilon_rad[:, setting.index, index] += setting[f"c_{name}"] * setting.direction


def _rig(setting: _Setting, disturbance: Disturbance) -> None:
    for index, name in enumerate(AXES):
        disturbance.rig_mm[:, index] += setting[f"k_{name}"] * setting.moments.t_s
        disturbance.rig_rad[:, index] += setting[f"c_{name}"] * setting.moments.t_s


def _periodic_mm(setting: _Setting) -> Array:
    angle = 2.0 * np.pi * setting.q_mm / setting["P"]
    return np.asarray(setting["A"] * np.sin(angle) + setting["B"] * np.cos(angle))


_EFFECTS: dict[str, _Effect] = {
    "scale": _Effect("along", {"k": None}, _along(lambda s: s["k"] * s.q_mm)),
    "backlash": _Effect("along", {"b": None}, _along(lambda s: -0.5 * s["b"] * s.direction)),
    "backlash-position": _Effect(
        "along", {"b0": 0.0, "b1": None}, _along(lambda s: -0.5 * s.direction * (s["b0"] + s["b1"] * s.q_mm))
    ),
    "lateral-play": _Effect("along", {"l_x": 0.0, "l_y": 0.0, "l_z": 0.0}, _across),
    "angular-reversal": _Effect("along", {"c_x": 0.0, "c_y": 0.0, "c_z": 0.0}, _angular),
    "periodic": _Effect("along", {"A": 0.0, "B": 0.0, "P": None}, _along(_periodic_mm)),
    "thermal-expansion": _Effect(
        "along",
        {"alpha": None, "q_fixed": 0.0},
        _along(lambda s: s["alpha"] * s.temperature_k * (s.q_mm - s["q_fixed"])),
        covariate=True,
    ),
    "thermal-drift": _Effect("body", {"k": None}, _body(lambda s: s["k"] * s.temperature_k), covariate=True),
    "warm-up": _Effect(
        "body", {"A": None, "tau": None}, _body(lambda s: s["A"] * -np.expm1(-s.moments.t_s / s["tau"]))
    ),
    # k in mm/s along the base axes, c in rad/s about them through the left camera's centre.
    "camera-drift": _Effect("rig", {f"{kind}_{axis}": 0.0 for kind in "kc" for axis in AXES}, _rig),
}
_AXES_OF_CHANNEL: dict[str, tuple[str, ...]] = {
    "along": AXES,
    "body": (*AXES, *(f"work-{axis}" for axis in AXES)),
    "rig": (),
}
AVAILABLE_EFFECTS = tuple(_EFFECTS)
_HIDDEN_KEYS = ("effect", "axis", "covariate", "parameters")


def read_hidden(entry: Entries, covariates: tuple[str, ...]) -> HiddenEffect:
    """Check one `[[hidden]]` table.

    Parameters
    ----------
    covariates
        Columns that the plan gives.
    """
    entry.only(_HIDDEN_KEYS)
    name = entry.text("effect")
    if name not in _EFFECTS:
        raise entry.refuse("effect", f"{name!r} cannot be simulated", f"available are {', '.join(AVAILABLE_EFFECTS)}")
    effect = _EFFECTS[name]
    allowed = _AXES_OF_CHANNEL[effect.channel]
    axis = entry.text("axis", None, allowed) if allowed else None
    covariate = _covariate(entry, covariates) if effect.covariate else None
    given = entry.table("parameters")
    for key in given.content:
        if key not in effect.defaults:
            raise given.refuse(key, f"{name} has no parameter {key!r}", f"it has {', '.join(effect.defaults)}")
    parameters = {key: given.number(key, default) for key, default in effect.defaults.items()}
    for key in ("P", "tau"):
        if parameters.get(key, 1.0) <= 0.0:
            raise given.refuse(key, f"{parameters[key]:g} is not above 0")
    return HiddenEffect(name, axis, covariate, parameters)


def _covariate(entry: Entries, covariates: tuple[str, ...]) -> str:
    text = entry.text("covariate")
    missing = [name for name in text.split("-") if name not in covariates]
    if missing or text.count("-") > 1:
        known = ", ".join(covariates) if covariates else "none"
        raise entry.refuse(
            "covariate",
            f"{text!r} names no column of the plan",
            f"add [covariates.{missing[0] if missing else text}]; the plan has {known}",
        )
    return text


def disturbance_of(hidden: tuple[HiddenEffect, ...], moments: Moments, machine: Machine) -> Disturbance:
    """Add up what the hidden effects do at each moment."""
    total = no_disturbance(len(moments))
    for item in hidden:
        _EFFECTS[item.effect].add(_Setting(item, moments, machine), total)
    return total
