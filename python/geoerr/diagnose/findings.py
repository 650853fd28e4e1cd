"""What a diagnosis lists: effects with value, worth, doubt and place, and structure without a name."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from geoerr.diagnose.moments import Moment
from geoerr.diagnose.shape import shape_words
from geoerr.diagnose.where import Where
from geoerr.diagnose.words import alike_words, as_good_words, sure_words, um_words
from geoerr.effects import Effect
from geoerr.effects.amplitudes import Amplitude, amplitude_words, parts_of
from geoerr.effects.plausible import plausible_what, plausible_words
from geoerr.effects.values import bounded_value_words, is_open
from geoerr.fit.elsewhere import beyond_the_lines_document, beyond_the_lines_words
from geoerr.fit.empirical import Curve, can_be_finer
from geoerr.fit.sightings import Numbers
from geoerr.machine import AXES
from geoerr.summaries import capitalised, listed, uncapitalised
from geoerr.terms import EffectReference, Parameter, Term

# What is said of an effect that a held model has, with another value.
IN_MODEL = "the model has it with another value, and this is the difference: fit the model to these data"
# What is said of what a curve of the model leaves over its own variables.
_OWN_CURVE = "the model has a curve of this already, and this is what it leaves"
_OWN_WAVE = "the model has a wave of this already, and takes no second one beside it"
# Channels of where the measuring device stands: `rig-tx`, `rig-ry` ...
_POSE = frozenset(f"rig-{way}{axis}" for way in "tr" for axis in AXES)
# More coefficients than this are a curve, not numbers to read.
_MOST_VALUES = 8


@dataclass(frozen=True)
class Alias:
    """A candidate that these data can hardly tell from another.

    Attributes
    ----------
    reference
        The other.
    correlation
        Cosine between what the one explains and what the other could.
    is_tied
        Whether these data cannot tell it from the other at all.
    told_by
        Of an effect of the measuring device, beside one of the machine: the measurement that tells which of the two
        it is.
    """

    reference: EffectReference
    correlation: float
    is_tied: bool = False
    told_by: str | None = None


@dataclass(frozen=True)
class Separation:
    """The measurement that would tell two candidates apart."""

    text: str
    plan: str | None
    minutes: float | None

    @property
    def words(self) -> str:
        """Say what has to differ, how long it takes and what to do."""
        minutes = "" if self.minutes is None else f" (about {self.minutes:.0f} minutes)"
        plan = "" if self.plan is None else f": {self.plan}"
        return f"{self.text}{minutes}{plan}"


@dataclass(frozen=True)
class HeldOut:
    """Held-out error without an effect and with it, µm, on the rows that have what it needs; None: not computable."""

    before_um: float | None
    after_um: float | None


@dataclass(frozen=True, eq=False)
class Named(ABC):
    """An effect by its name: what findings by points and causes of circles have in common.

    Attributes
    ----------
    reference, effect
        Which.
    term
        With the values that it would have: `refit` and `add` start from it.
    p_value
        Family-wise, over everything that was looked at.
    evidence
        Logarithm of the Bayes factor against the model without it (Schwarz), trial values counted.
    worth_um
        Root mean square of what it explains.
    tied
        Whether the data cannot tell it from the first; of what was found later, from one that was not found.
    aliases
        What is like it.
    separate_by
        The measurement that would tell it from what it is tied with.
    in_model
        Whether a model that is held has it already, with another value: `term` is by how much it is another.
    """

    reference: EffectReference
    effect: Effect
    term: Term
    p_value: float
    evidence: float
    worth_um: float
    tied: bool
    aliases: tuple[Alias, ...]
    separate_by: Separation | None
    in_model: bool = field(default=False, kw_only=True)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Values with standard errors: linear, then inner."""
        return (*self.term.coefficients, *self.term.inner)

    @property
    def frame_words(self) -> str | None:
        """Whose axes a shift or a turn of the measuring device is told along; None of everything else."""
        is_pose = any(part.channel in _POSE for part in self.term.parts)
        return "its x, y and z are the axes of the measuring frame, not the machine's" if is_pose else None

    @property
    def is_rig(self) -> bool:
        """Whether it is the measuring device's, and so never compensated."""
        return self.term.is_rig

    @property
    def device_words(self) -> str | None:
        """Say that the measuring device may do what an effect of the machine does, though with more freedom."""
        doubts = [one for one in self.aliases if one.told_by is not None and not one.is_tied]
        if not doubts:
            return None
        names = listed([str(one.reference) for one in doubts])
        told_by = listed(list(dict.fromkeys(one.told_by for one in doubts if one.told_by is not None)))
        return (
            f"a fault of the measuring device ({names}) would look the same; before a program is corrected: {told_by}"
        )

    @abstractmethod
    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it, and more."""

    def named_document(self, held_out_rmse_after_um: float | None) -> dict[str, Any]:
        """Give the keys of `diagnose --json` that both have."""
        separation = self.separate_by
        return {
            **reference_document(self.reference),
            "p_value": self.p_value,
            "held_out_rmse_after_um": held_out_rmse_after_um,
            "worth_um": self.worth_um,
            "parameters": {parameter.name: self._parameter_document(parameter) for parameter in self.parameters},
            "tied": self.tied,
            "aliases": [
                {
                    **reference_document(alias.reference),
                    "correlation": alias.correlation,
                    "tied": alias.is_tied,
                    "told_by": alias.told_by,
                }
                for alias in self.aliases
            ],
            "separate_by": None
            if separation is None
            else {"text": separation.text, "plan": separation.plan, "minutes": separation.minutes},
            "title": self.effect.title,
            "is_rig": self.is_rig,
            "in_model": self.in_model,
            "evidence": finite(self.evidence),
        }

    def _parameter_document(self, parameter: Parameter) -> dict[str, Any]:
        return {
            "value": None if is_open(parameter) else finite(parameter.value),
            "std": finite(parameter.std),
            "unit": parameter.unit,
            # What physics says of a value it does not say of a difference.
            "plausible": None if self.in_model else plausible_what(parameter, self.term.inner),
        }


@dataclass(frozen=True, eq=False)
class Finding(Named):
    """A candidate in the diagnosis of measured points.

    `worth_um` is of what neither the model nor the others that were found can explain, components summed as for
    errors; `separate_by` tells it from the first, or from the first one tied with it.

    Attributes
    ----------
    where
        Where it is largest.
    explained_um : (n, 3)
        What neither the model nor the others that were found can do, in base axes, rows as in the fit.
    held_out
        Error without it and with it in the model; None where it was not computed.
    moments
        Of inner parameters that are a time on the clock of all sessions: name to when that was.
    alike
        Of inner parameters whose other values are the same at the places that were measured: name to those values.
    as_good
        Of inner parameters whose other values explain what was measured as well: name to those values.
    together
        Axes whose effects of this kind do only together what the first does, this one among them; empty where it
        stands for itself.
    left_because
        Why it is not among what was found; None of what is, or is tied with it, and where the search knows no reason.
    amplitudes
        Of its waves: whether such a size is usual is asked of these, not of their parts.
    """

    where: Where
    explained_um: Numbers
    held_out: HeldOut | None
    moments: dict[str, Moment] = field(default_factory=dict)
    alike: dict[str, tuple[float, ...]] = field(default_factory=dict)
    as_good: dict[str, tuple[float, ...]] = field(default_factory=dict)
    together: tuple[str, ...] = ()
    left_because: str | None = None
    amplitudes: tuple[Amplitude, ...] = ()

    @property
    def company_words(self) -> str:
        """Name it, with those that do only together with it what the first does."""
        title = uncapitalised(self.effect.title)
        if not self.together:
            return f"{title} ({self.reference})"
        names = listed([str(replace(self.reference, axis=axis)) for axis in self.together])
        return f"{title} of {listed(self.together)} together ({names})"

    @property
    def others_words(self) -> str:
        """Say with which other axes it does what the first does; nothing where it stands for itself."""
        others = [axis for axis in self.together if axis != self.reference.axis]
        return f", together with that of {listed(others)}" if others else ""

    @property
    def held_out_rmse_after_um(self) -> float | None:
        """Held-out error with it in the model."""
        return None if self.held_out is None else self.held_out.after_um

    @property
    def value_words(self) -> tuple[str, ...]:
        """Each value with its standard error and unit, and whether physics would give it."""
        if len(self.parameters) > _MOST_VALUES:
            return (f"a curve of {len(self.parameters)} numbers",)
        parts = parts_of(self.amplitudes)
        texts = []
        for parameter in self.parameters:
            moment = self.moments.get(parameter.name)
            read = parameter if moment is None else replace(parameter, unit=moment.unit)
            text = bounded_value_words(read, self.parameters)
            words = moment.words() if moment is not None else None
            if moment is None and not self.in_model and parameter.name not in parts:
                # What physics says of a value it does not say of a difference.
                words = plausible_words(parameter, self.term.inner, self.parameters)
            texts.append(text if words is None else f"{text} ({words})")
            if parameter.name in self.alike:
                texts[-1] += f", or {alike_words(self.alike[parameter.name], parameter.unit)}"
            if self.as_good.get(parameter.name):
                texts[-1] += f", or {as_good_words(self.as_good[parameter.name], parameter.unit)}"
        return (*texts, *map(amplitude_words, self.amplitudes))

    @property
    def held_out_words(self) -> str | None:
        """Say how the held-out error would fall; None where it was not computed."""
        return held_out_words(self.held_out)

    def words(self) -> str:
        """Say in one paragraph what it is, its values, whether physics gives such, its worth and where, how sure."""
        texts = [
            f"{self.effect.title} ({self.reference}){self.others_words}: {'; '.join(self.value_words)}",
            f"worth {um_words(self.worth_um)} rms, {self.where.words()}",
            self.held_out_words,
            sure_words(self.p_value),
            "it is the cameras', and never compensated" if self.is_rig else None,
            self.frame_words,
            self.device_words,
            IN_MODEL if self.in_model else None,
        ]
        return ". ".join(capitalised(text) for text in texts if text)

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it, and more."""
        document = self.named_document(self.held_out_rmse_after_um)
        for name, moment in self.moments.items():
            document["parameters"][name] |= moment.to_document()
        for name, values in self.alike.items():
            document["parameters"][name]["alike"] = list(values)
        for name, values in self.as_good.items():
            document["parameters"][name]["as_good"] = list(values)
        for name in parts_of(self.amplitudes):
            document["parameters"][name]["plausible"] = None
        return {
            **document,
            "held_out_rmse_before_um": None if self.held_out is None else self.held_out.before_um,
            "where": self.where.to_document(),
            "words": self.words(),
            "amplitudes": [one.to_document() for one in self.amplitudes],
            "together": list(self.together),
            "left_because": self.left_because,
        }


@dataclass(frozen=True, eq=False)
class Nameless(ABC):
    """Structure that no candidate explains.

    Attributes
    ----------
    depends_on
        Variables.
    component
        Axis of the base along which it acts, or `r` where only a radius tells of it.
    worth_um, p_value
        As for a candidate.
    """

    depends_on: tuple[str, ...]
    component: str
    worth_um: float
    p_value: float

    @abstractmethod
    def words(self) -> str:
        """Say what it is."""

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it."""
        return {
            "depends_on": list(self.depends_on),
            "component": self.component,
            "worth_um": self.worth_um,
            "p_value": self.p_value,
            "words": self.words(),
        }


@dataclass(frozen=True, eq=False)
class Unknown(Nameless):
    """Structure without a name in measured points.

    Attributes
    ----------
    where
        Where it is largest.
    explained_um : (n, 3)
        What it is at each row of the fit, in base axes.
    reference
        What `geoerr add` takes to add it as a curve.
    curve
        That curve, with its standard error; None where the variables that were found do not determine one, as between
        places that are off by something else each. Beside a curve of the same variables that was fitted it is what
        that one lacks.
    held_out
        Error without the curve and with it.
    beyond_the_lines_um
        The same with whole lines left out: where nothing was measured; None where lines were run once each.
    own
        The curve of the same displacement over the same variables that the model has already; None where it has none.
    own_is_held
        Whether that was held as it was, and not fitted to these data, too.
    """

    where: Where
    explained_um: Numbers
    reference: str
    curve: Curve | None
    held_out: HeldOut | None
    beyond_the_lines_um: tuple[float, float] | None = None
    own: Term | None = None
    own_is_held: bool = False

    @property
    def can_be_added(self) -> bool:
        """Whether `geoerr add` takes it: as a curve, or to make finer the one that the model has."""
        is_one_more = self.own is None or (can_be_finer(self.own) and not self.own_is_held)
        return self.curve is not None and is_one_more

    @property
    def own_words(self) -> str | None:
        """Say what it is to a curve that the model has of the same variables, and what can be done."""
        if self.own is None:
            return None
        if self.own_is_held:
            return IN_MODEL
        if self.can_be_added:
            return f"{_OWN_CURVE}: it has to be finer, which adding it once more makes it"
        if self.own.inner:
            return f"{_OWN_WAVE}: find what goes on in that time, and stop it"
        return (
            f"{_OWN_CURVE}: adding it once more would make it no finer; take it out and add it anew, or measure at "
            f"more places over {listed(self.depends_on)}"
        )

    @property
    def shape(self) -> str | None:
        """What the curve looks like, in words."""
        return None if self.curve is None else shape_words(self.curve)

    @property
    def beyond_the_lines_words(self) -> str | None:
        """What the curve does where no line was measured; None where that is not known."""
        if self.beyond_the_lines_um is None:
            return None
        return f"as a {self.form}, {beyond_the_lines_words(self.beyond_the_lines_um)}"

    @property
    def form(self) -> Literal["curve", "wave"]:
        """What it is added as."""
        return "curve" if self.curve is None or self.curve.period is None else "wave"

    @property
    def held_out_words(self) -> str | None:
        """Say how the held-out error would fall with the curve; None where it was not computed."""
        words = held_out_words(self.held_out)
        return None if words is None else f"as a {self.form}: {words}"

    @property
    def where_words(self) -> str:
        """Say where it is largest, beyond what the model can do of it: the curve may be larger elsewhere."""
        return f"what the model cannot do of it: {self.where.words()}"

    @property
    def std_words(self) -> str | None:
        """Say what the uncertainty of the curve is of; None where there is none."""
        if self.curve is None:
            return None
        kind = "one wave" if self.form == "wave" else "a curve of these degrees"
        return f"± is that of {kind}: what another shape would add is not in it"

    @property
    def is_the_models_own(self) -> bool:
        """Whether it is a curve of one position: then the model's error functions are too stiff to follow."""
        return (
            self.curve is not None
            and self.own is None
            and len(self.depends_on) == 1
            and self.depends_on[0] in ("x", "y", "z")
        )

    @property
    def sentence(self) -> str:
        """Say what it is in a sentence."""
        on, worth = listed(self.depends_on), um_words(self.worth_um)
        what = "something that no known effect explains"
        if self.own is not None:
            what += f", nor the model's own {'wave' if self.own.inner else 'curve'} over the same,"
        return f"{what} acts along {self.component} and depends on {on}, worth {worth} rms"

    def words(self) -> str:
        """Say what it is, where it is largest, what it looks like and how sure."""
        texts = [self.sentence, self.where_words, None if self.shape is None else f"shape: it {self.shape}"]
        texts += [sure_words(self.p_value), self.held_out_words, self.beyond_the_lines_words, self.own_words]
        return ". ".join(capitalised(text) for text in texts if text)

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it, and more."""
        return {
            **super().to_document(),
            "reference": self.reference,
            "in_model": self.own is not None,
            "can_be_added": self.can_be_added,
            "shape": self.shape,
            "held_out_rmse_before_um": None if self.held_out is None else self.held_out.before_um,
            "held_out_rmse_after_um": None if self.held_out is None else self.held_out.after_um,
            "held_out_by_line_um": beyond_the_lines_document(self.beyond_the_lines_um),
            "where": self.where.to_document(),
            "curve": None if self.curve is None else self.curve.to_document(),
        }


def held_out_words(held_out: HeldOut | None) -> str | None:
    """Say how a held-out error would fall; None where it was not computed."""
    if held_out is None or held_out.before_um is None or held_out.after_um is None:
        return None
    return f"held out {held_out.before_um:.1f} → {um_words(held_out.after_um)}"


def reference_document(reference: EffectReference) -> dict[str, str | None]:
    """Give `effect`, `axis` and `covariate`."""
    return {"effect": reference.effect, "axis": reference.axis, "covariate": reference.covariate}


def finite(value: float) -> float | None:
    """Give a number, or None where it is none."""
    return value if math.isfinite(value) else None
