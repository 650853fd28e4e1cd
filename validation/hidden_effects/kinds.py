"""What a kind of hidden effect is: a name, where it can act, and a function that moves the rows of a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from validation.hidden_effects.chain import Array, Displacements
from validation.hidden_effects.log import Log


@dataclass(frozen=True)
class Acting:
    """An effect at some strength.

    Attributes
    ----------
    moved
        What it does to every row.
    linear
        Parameters in proportion to its strength (mm, rad, s, K).
    inner
        Parameters that do not change with it.
    variables
        Columns that it is a function of (`v_x`, `s_x`, `a_y` ... for what follows from the order of rows).
    channels
        Where it acts: `EXX`, `tool-z`, `S_xy`, `rig-scale` ...
    """

    moved: Displacements
    linear: dict[str, float]
    inner: dict[str, float]
    variables: tuple[str, ...]
    channels: tuple[str, ...]


# log, random numbers, axis as a reference writes it, covariate
Physics = Callable[[Log, np.random.Generator, str, str], Acting]


@dataclass(frozen=True)
class Kind:
    """One kind of effect.

    Attributes
    ----------
    effect
        Id in the catalogue; empty where the catalogue has no such effect.
    axes
        What `axis` may be; `("",)` where it has none.
    covariates
        Columns of which it follows one (or a difference `a-b`); `("",)` where none.
    needs
        What the plan must have: `motion`, `cameras`, `load`, `temp_motor` ...
    off_axis
        Whether it can be made uneven along another axis (`off_formula`).
    """

    name: str
    effect: str
    physics: Physics
    axes: tuple[str, ...] = ("",)
    covariates: tuple[str, ...] = ("",)
    needs: tuple[str, ...] = ()
    off_axis: bool = True


@dataclass
class Registry:
    """Kinds by name, in order of definition."""

    kinds: dict[str, Kind] = field(default_factory=dict)

    def kind(self, name: str, effect: str, **options: object) -> Callable[[Physics], Physics]:
        """Register a function as a kind."""

        def register(physics: Physics) -> Physics:
            self.kinds[name] = Kind(name, effect, physics, **options)  # type: ignore[arg-type]
            return physics

        return register


AXES = ("x", "y", "z")
PAIRS = ("xy", "xz", "yz")


def index(axis: str) -> int:
    """Give 0, 1, 2 for x, y, z."""
    return "xyz".index(axis)


def across(axis: int) -> tuple[int, int]:
    """Give the two directions across an axis."""
    first, second = (other for other in range(3) if other != axis)
    return first, second


def joint(axis: int, direction: int, *, is_angle: bool = False) -> str:
    """Name a joint channel."""
    return f"E{'ABC'[direction] if is_angle else 'XYZ'[direction]}{'XYZ'[axis]}"


def either_sign(rng: np.random.Generator) -> float:
    """Give 1 or −1."""
    return float(rng.choice([-1.0, 1.0]))


def direction_of(rng: np.random.Generator, count: int) -> Array:
    """Give a random unit vector of which no component is small."""
    vector = rng.uniform(0.4, 1.0, count) * rng.choice([-1.0, 1.0], count)
    return np.asarray(vector / np.linalg.norm(vector))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a size."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
