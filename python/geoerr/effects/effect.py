"""An effect of the catalogue: which candidates it has on a machine, what it needs, and the term that each becomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geoerr.effects.channels import Place, places
from geoerr.effects.covariates import (
    columns_wanting,
    only_temperature,
    temperature_choices,
    temperature_entry,
    temperature_problem,
)
from geoerr.effects.definitions import pair_of, renamed, temperature_text, used_definitions
from geoerr.effects.description import AROUND_AXIS, OF_THE_AXIS, Description, FormSpec, ParameterSpec, PartSpec
from geoerr.errors import InputFileError
from geoerr.machine import AXES, Machine
from geoerr.terms import SESSION_NAME, BasisSpec, EffectReference, Parameter, Part, Term, names_in, session_numbers

# Time over which a jump is searched where the data's own span is not given: a day.
DEFAULT_TIME_RANGE_S = (0.0, 86_400.0)
# From the quickest sensor to a casting.
LAG_RANGE_S = (10.0, 10_800.0)
# Without data to choose by: a smooth function of an axis has this many spans of a cubic spline.
DEFAULT_SPANS = 5
# Bearings stand beyond the travel, by less than so much of it.
_BEYOND = 0.5
_CUBIC = 3


@dataclass(frozen=True)
class Effect(Description):
    """One entry of the catalogue. Attributes: see `Description`."""

    @property
    def is_rig(self) -> bool:
        """Whether it explains the measuring rig: fitted, never compensated."""
        return self.channel == "rig"

    @property
    def follows_temperature(self) -> bool:
        """Whether a candidate names a temperature column, and so has a lagged version."""
        return any(temperature_entry(form) is not None for form in self.forms)

    @property
    def parameter_names(self) -> frozenset[str]:
        """Names of coefficients and inner parameters, directions not yet attached."""
        return frozenset(spec.name for spec in self.coefficients + self.inner)

    @property
    def form_names(self) -> tuple[str, ...]:
        """Names of the ways to write it; the first is the usual one."""
        return tuple(form.name for form in self.forms)

    def wanting(self, columns: Sequence[str], *, n_sessions: int = 1, is_circular: bool = False) -> str | None:
        """Say what the data lack for this effect; None where they have what one of its forms needs.

        Parameters
        ----------
        columns
            Names of the data's columns that hold values.
        n_sessions
            Number of sessions in the data.
        is_circular
            Whether the data are circular tests.
        """
        if self.only_circular and not is_circular:
            return "belongs to circular tests: measure a circle"
        if self.each_session and n_sessions < 2:
            return "needs a second session: repeat what was measured after homing, moving or setting up the machine"
        shared = sorted(set(self.parameter_names).intersection(columns))
        if shared and self.origin == "user":
            return f"its parameter {shared[0]!r} is a column of these data: give one of them another name"
        wanting = [columns_wanting(form, self.parameter_names, columns) for form in self.forms]
        return None if None in wanting else wanting[0]

    def candidates(
        self, machine: Machine, columns: Sequence[str], *, n_sessions: int = 1, is_circular: bool = False
    ) -> list[EffectReference]:
        """Give the candidates that these data can carry, in the order of axes and columns.

        A lagged temperature and the effect's other forms are parameters of a candidate, not candidates.
        An effect that a detector finds or whose candidate is another effect's has none.

        Parameters
        ----------
        machine
            The machine.
        columns, n_sessions, is_circular
            As for `wanting`.
        """
        if self.detector is not None or self.offered_as is not None:
            return []
        if self.wanting(columns, n_sessions=n_sessions, is_circular=is_circular) is not None:
            return []
        covariates: dict[str | None, None] = {}
        for form in self.forms:
            if columns_wanting(form, self.parameter_names, columns) is None:
                # Where physics gives a coefficient its sign, the order of a difference is physics too.
                is_ordered = any(spec.sign for spec in self.coefficients)
                covariates |= dict.fromkeys(temperature_choices(form, columns, is_ordered=is_ordered))
        return [
            EffectReference(self.id, axis, covariate) for axis in self.axes or (None,) for covariate in covariates
        ]

    def at(
        self,
        axis: str | None = None,
        covariate: str | None = None,
        *,
        lagged: bool = False,
        form: str | None = None,
    ) -> PlacedEffect:
        """Give the effect in one place, to be added to a model: `model + backlash.at("x")`.

        Parameters
        ----------
        axis, covariate
            As a reference writes them; what is the only one that the effect is for may be left out.
        lagged, form
            As for `term`.

        Raises
        ------
        InputFileError
            if the effect is not for that axis or covariate, naming those that it is for.
        """
        reference = self.checked_reference(axis, covariate, form)
        return PlacedEffect(self, reference, lagged, form)

    def form(self, name: str | None = None, covariate: str | None = None) -> FormSpec:
        """Give a form by name; without one, the first whose own column `covariate` is, or else the first.

        Raises
        ------
        InputFileError
            if there is no such form.
        """
        if name is None:
            return next((form for form in self.forms if covariate in form.covariates), self.forms[0])
        for form in self.forms:
            if form.name == name:
                return form
        raise InputFileError(
            self.id, f"has no form {name!r}", remedy=f"its forms are {', '.join(map(repr, self.form_names))}"
        )

    def checked_reference(self, axis: str | None, covariate: str | None, form: str | None = None) -> EffectReference:
        """Check axis and covariate of a reference; an axis that is the only one may be left out.

        Raises
        ------
        InputFileError
            if the effect is not for that axis, or lacks or has no temperature.
        """
        reference = EffectReference(self.id, axis, covariate)
        if axis is None and len(self.axes) == 1:
            axis = self.axes[0]
        if axis not in (self.axes or (None,)):
            remedy = f"write {self.id}:AXIS with AXIS one of {', '.join(self.axes)}" if self.axes else "leave it out"
            problem = "needs an axis" if axis is None else f"is not an effect of axis {axis!r}"
            raise InputFileError(str(reference), problem, remedy=remedy)
        chosen = self.form(form, covariate)
        entry = temperature_entry(chosen)
        if entry is None:
            if covariate is not None and covariate not in chosen.covariates:
                raise InputFileError(str(reference), f"does not follow {covariate!r}", remedy="leave the column out")
            # The column is part of the name only where it says which form is meant.
            return EffectReference(self.id, axis, None if covariate in self.forms[0].covariates else covariate)
        covariate = covariate or only_temperature(entry)
        mismatch = temperature_problem(entry, covariate)
        if mismatch is not None:
            example = EffectReference(self.id, axis, "temp_bottom-temp_top" if entry == "temp-temp" else "temp_bed")
            raise InputFileError(str(reference), mismatch, remedy=f"write {example}, with your own column")
        return EffectReference(self.id, axis, covariate)

    def term(
        self,
        axis: str | None,
        covariate: str | None,
        machine: Machine,
        *,
        lagged: bool = False,
        form: str | None = None,
        time_range_s: tuple[float, float] = DEFAULT_TIME_RANGE_S,
        sessions: Sequence[str] = ("0",),
    ) -> Term:
        """Give the term of one candidate, its values unknown.

        Parameters
        ----------
        axis, covariate
            As the reference writes them; None where it has none.
        machine
            For ranges, sides and the reference temperature.
        lagged
            Whether every temperature follows through a first-order lag with an inner parameter `tau`.
        form
            Name of the form; None is the first that fits.
        time_range_s
            Of the data, for the time of a jump.
        sessions
            Their names in order, for effects with one value for each session after the first.

        Raises
        ------
        InputFileError
            if the effect is not for that axis or covariate, or has no formula (a detector, smooth functions).
        """
        if self.detector is not None or self.is_smooth:
            how = "is found by a check of its own" if self.detector else "consists of smooth functions"
            raise InputFileError(self.id, f"{how}, it has no formula", remedy="it cannot be added as one term")
        reference = self.checked_reference(axis, covariate, form)
        chosen = self.form(form, covariate)
        temperature, lag = self._temperature(reference, machine, lagged=lagged)
        parts: list[Part] = []
        suffixes: dict[str, dict[str, str]] = {spec.name: {} for spec in self.coefficients}
        for spec in chosen.parts:
            for place, part in self._parts(spec, chosen.only, reference.axis, machine, temperature, sessions):
                parts.append(part)
                for name in names_in(spec.expression):
                    if name in suffixes:
                        # The first part that mentions it says which way it acts.
                        for suffix, which in self._suffixes(place, spec.channel, sessions).items():
                            suffixes[name].setdefault(suffix, which)
        coefficients = tuple(
            _parameter(spec, machine, reference.axis, time_range_s, suffix, which)
            for spec in self.coefficients
            for suffix, which in suffixes[spec.name].items()
        )
        used = {name for part in chosen.parts for name in names_in(part.expression)}
        inner = tuple(
            _parameter(spec, machine, reference.axis, time_range_s) for spec in self.inner if spec.name in used
        )
        return Term(
            id=str(reference),
            title=self.title,
            kind="effect",
            effect=self.id,
            axis=reference.axis,
            covariate=reference.covariate,
            parts=tuple(parts),
            coefficients=coefficients,
            inner=inner + lag,
            source=self.origin,
        )

    def terms(
        self, axis: str | None, covariate: str | None, machine: Machine, *, basis: BasisSpec | None = None
    ) -> tuple[Term, ...]:
        """Give the term of a candidate, or the classic terms of a smooth effect: one for each of its channels.

        Parameters
        ----------
        axis, covariate, machine
            As for `term`.
        basis
            Functions of a smooth effect; without one, a cubic spline over the axis's range in equal spans.
        """
        if not self.is_smooth:
            return (self.term(axis, covariate, machine),)
        reference = self.checked_reference(axis, covariate)
        moving = reference.axis or ""
        spec = PartSpec(self.channel, "first", None, "")
        functions = basis or _default_basis(moving, machine)
        names = tuple(f"c{number}" for number in range(1, functions.n_functions + 1))
        return tuple(
            Term(
                id=place.channel,
                title=f"{self.title}, {place.channel}",
                kind="classic",
                effect=None,
                axis=moving,
                covariate=None,
                parts=(Part(place.channel, basis=functions),),
                coefficients=tuple(Parameter(name, "rad" if place.channel[1] in "ABC" else "mm") for name in names),
                source=self.origin,
            )
            for place in places(spec, moving, moving, machine)
        )

    def _temperature(
        self, reference: EffectReference, machine: Machine, *, lagged: bool
    ) -> tuple[str | None, tuple[Parameter, ...]]:
        if reference.covariate is None:
            if lagged:
                raise InputFileError(str(reference), "follows no temperature, so it has no lagged version")
            return None, ()
        text = temperature_text(reference.covariate, machine.reference_temperature_degc)
        if not lagged:
            return text, ()
        taken = {spec.name for spec in self.coefficients + self.inner}
        name = "tau" if "tau" not in taken else "tau_T"
        low, high = LAG_RANGE_S
        return f"lag({text}, {name})", (
            Parameter(name, "s", low=low, high=high, spacing="log", what="lag behind the temperature"),
        )

    def _parts(
        self,
        spec: PartSpec,
        only: str | None,
        candidate: str | None,
        machine: Machine,
        temperature: str | None,
        sessions: Sequence[str],
    ) -> list[tuple[Place, Part]]:
        first, second = pair_of(candidate)
        axis = {"first": first, "second": second}.get(spec.axis, spec.axis)
        definitions = used_definitions(
            spec.expression, axis if axis in AXES else None, candidate, machine, temperature
        )
        names = [parameter.name for parameter in self.coefficients]
        found = []
        for place in places(spec, axis, candidate, machine):
            if only is not None and place.suffix != only:
                continue
            for suffix in self._suffixes(place, spec.channel, sessions):
                text = renamed(spec.expression, {name: _suffixed(name, suffix) for name in names})
                if self.each_session:
                    text = f"({text})*({SESSION_NAME} == {suffix.rpartition('_')[2]})"
                found.append((place, Part(place.channel, text, definitions, factor=place.factor)))
        return found

    def _suffixes(self, place: Place, channel: str, sessions: Sequence[str]) -> dict[str, str]:
        """Give what stands behind a coefficient's name, and behind what it is in words."""
        which = place.suffix and f" {'about' if channel == 'angular' else 'along'} {place.suffix}"
        if not self.each_session:
            return {place.suffix: which}
        # Of one session alone the effect is asked for as it would be of the next.
        names = sessions if len(sessions) > 1 else ("0", "1")
        return {
            f"{place.suffix}_{number}".removeprefix("_"): f"{which} in session {_said(number, name)}"
            for number, name in zip(session_numbers(names)[1:], names[1:], strict=True)
        }


@dataclass(frozen=True)
class PlacedEffect:
    """An effect with its axis and its covariate; made by `Effect.at`.

    Attributes
    ----------
    effect
        Of the catalogue, or a user's own.
    reference
        Axis and covariate, checked.
    lagged, form
        As for `Effect.term`.
    """

    effect: Effect
    reference: EffectReference
    lagged: bool = False
    form: str | None = None

    def terms(self, machine: Machine) -> tuple[Term, ...]:
        """Give its terms for a machine, values unknown: one, or those of a smooth effect."""
        axis, covariate = self.reference.axis, self.reference.covariate
        if self.effect.is_smooth:
            return self.effect.terms(axis, covariate, machine)
        return (self.effect.term(axis, covariate, machine, lagged=self.lagged, form=self.form),)


def _default_basis(axis: str, machine: Machine) -> BasisSpec:
    low, high = machine.axes[axis].range_mm
    inside = (low + (high - low) * number / DEFAULT_SPANS for number in range(1, DEFAULT_SPANS))
    return BasisSpec("bspline", axis, knots_mm=(low, *inside, high), degree=_CUBIC)


def _said(number: int, name: str) -> str:
    """Say which session a number stands for."""
    return name if name == str(number) else f"{number} ({name})"


def _suffixed(name: str, suffix: str) -> str:
    return f"{name}_{suffix}" if suffix else name


def _parameter(
    spec: ParameterSpec,
    machine: Machine,
    candidate: str | None,
    time_range_s: tuple[float, float],
    suffix: str = "",
    which: str = "",
) -> Parameter:
    low: float | None = None
    high: float | None = None
    if spec.range == "time":
        low, high = time_range_s
    elif isinstance(spec.range, str):
        axis = pair_of(candidate)[0] if spec.range in OF_THE_AXIS else spec.range
        low, high = machine.axes[axis or ""].range_mm
        if spec.range == AROUND_AXIS:
            beyond = _BEYOND * (high - low)
            low, high = low - beyond, high + beyond
    elif spec.range is not None:
        low, high = spec.range
    return Parameter(
        name=_suffixed(spec.name, suffix),
        unit=spec.unit,
        plausible=spec.plausible,
        low=low,
        high=high,
        spacing=spec.spacing,
        what=spec.what and spec.what + which,
        sign=spec.sign,
    )
