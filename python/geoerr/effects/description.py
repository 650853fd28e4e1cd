"""What a catalogue entry says, as data: the effect, its forms, its parts, its parameters, its look-alikes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from geoerr.machine import AXES
from geoerr.terms import REFERENCE_AXES, Plausible, TermSource, UsualSpan

# A part's channel says which channels of the chain it becomes for a given axis (`geoerr.effects.channels`).
PART_CHANNELS = ("along", "across", "across-angle", "angular", "joint", "squareness", "tool", "work", "target", "rig")
# Part of which axis of the candidate: the first or second of a pair, or a fixed one (of squareness, a fixed pair).
PAIRS = ("xy", "xz", "yz")
PART_AXES = ("first", "second", *AXES, *PAIRS)
RIG_DIRECTIONS = (
    *("tx", "ty", "tz", "rx", "ry", "rz", "scale", "depth", "disparity", "ray-x", "ray-y"),
    *("motion-x", "motion-y", "motion-z"),
)
# ISO letters of a joint's displacement; `each` is its three translations, `angle-of-z` the angle that follows the
# tangent of its straightness along z.
JOINT_DIRECTIONS = ("X", "Y", "Z", "A", "B", "C", "each", *(f"angle-of-{axis}" for axis in AXES))
DETECTORS = ("pass-disagrees", "noise-follows")
ALL_AXES = REFERENCE_AXES
#: Ranges that are those of the axis which an effect is of, as they are and with what may lie beyond.
AROUND_AXIS = "around-axis"
OF_THE_AXIS = ("axis", AROUND_AXIS)


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter before it is attached to a candidate.

    Attributes
    ----------
    name, unit
        ASCII symbol; unit of its value.
    plausible
        Values that physics would give, and spans of usual sizes.
    any_size
        Why there are none of either; empty where there are, or where the entry does not say.
    range
        Of an inner parameter: two numbers, `axis`, `x`, `y`, `z` (that axis's range), `around-axis` (that and half as
        much beyond both ends: where what drives it may be held) or `time` (the data's span);
        None for a linear coefficient.
    spacing
        Of trial values over the range.
    sign
        +1 or −1 where physics allows one sign only, else 0.
    what
        What it is, in words; empty where the entry does not say.
    """

    name: str
    unit: str
    plausible: tuple[Plausible | UsualSpan, ...] = ()
    range: tuple[float, float] | str | None = None
    spacing: Literal["linear", "log"] = "linear"
    sign: int = 0
    what: str = ""
    any_size: str = ""


@dataclass(frozen=True)
class PartSpec:
    """One place where an effect acts, before it is attached to an axis.

    Attributes
    ----------
    channel
        One of `PART_CHANNELS`.
    axis
        One of `PART_AXES`; `first` is the candidate's own axis.
    direction
        Direction on `joint`, `tool`, `work`, `target`, `rig`; None where the candidate's axis gives it. On `across`
        and `angular` it keeps one direction, whose coefficients then bear no suffix.
    expression
        Formula as written.
    turns_on_work_side
        Whether the sign turns for an axis that the work side carries (a body's own motion seen from the work).
    linear_in
        For products of two axes, of which (`first`, `second`) it is linear: the part is left out in directions where
        the angles of the axis whose lever grows with that position already hold it.
    """

    channel: str
    axis: str
    direction: str | None
    expression: str
    turns_on_work_side: bool = False
    linear_in: tuple[str, ...] = ()


@dataclass(frozen=True)
class FormSpec:
    """One way to write an effect; forms of one effect are one candidate, the best of them speaks for it.

    Attributes
    ----------
    name
        `""` for the only or usual one.
    covariates
        Columns needed together; `a|b` takes either. `temp` stands for each temperature column, `temp-temp` for each
        difference of two.
    parts
        Places where it acts; empty for smooth effects and detectors.
    only
        The one direction in which it acts; None for all that its channels have.
    """

    name: str
    covariates: tuple[str, ...]
    parts: tuple[PartSpec, ...]
    only: str | None = None


@dataclass(frozen=True)
class Rival:
    """What an effect is mistaken for, and the measurement that separates the two.

    Attributes
    ----------
    effect
        Id of the rival; None where it is none of the catalogue.
    what
        The rival in words, where it has no id.
    separate_by
        What must differ between the two, in a few words.
    plan
        What to do on the machine, in a sentence.
    minutes
        Of machine time, as a rule of thumb; None where it cannot be said.
    """

    effect: str | None
    what: str | None
    separate_by: str
    plan: str | None = None
    minutes: float | None = None


@dataclass(frozen=True)
class Twin:
    """An effect that is the same by construction: what no data can tell apart, and why."""

    effect: str
    why: str


@dataclass(frozen=True)
class Description:
    """The data of one catalogue entry; `geoerr.effects.Effect` is this with its methods.

    Attributes
    ----------
    id, title, family
        Fixed name, words, and the file's stem.
    source
        Where the formula comes from.
    origin
        `built-in` or `user`.
    channel
        As the entry says: of the first part, or of the smooth functions; empty where a detector needs none.
    axes
        Axes or directions that it may be a candidate for; empty = none.
    forms
        At least one.
    coefficients, inner
        Parameters before directions are attached.
    looks_like, cause, remedy
        For a shop floor.
    mistaken_for, twins, contains
        Look-alikes; the same by construction; effects that are special cases of this one.
    is_classic
        Inside the 21-error base: offered only against a smaller one.
    is_smooth
        Classic functions on channels, without an expression.
    detector
        Name of the check that finds it where no expression can; else None.
    offered_as
        Id of the effect whose candidate stands for it, or None.
    only_circular
        Whether it belongs to circular tests only.
    each_session
        Whether its coefficients repeat for each session after the first.
    any_size
        Of an entry without coefficients: why it has no usual size.
    again
        Id of the effect whose formula it has once more: a candidate only beside that one on the same axis.
    """

    id: str
    title: str
    family: str
    source: str
    origin: TermSource
    channel: str
    axes: tuple[str, ...]
    forms: tuple[FormSpec, ...]
    coefficients: tuple[ParameterSpec, ...]
    inner: tuple[ParameterSpec, ...]
    looks_like: str
    cause: str
    remedy: str
    mistaken_for: tuple[Rival, ...] = ()
    twins: tuple[Twin, ...] = ()
    contains: tuple[str, ...] = ()
    is_classic: bool = False
    is_smooth: bool = False
    detector: str | None = None
    offered_as: str | None = None
    only_circular: bool = False
    each_session: bool = False
    any_size: str = ""
    again: str | None = None
