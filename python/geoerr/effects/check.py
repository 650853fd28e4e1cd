"""Checks of an effect as a whole: its names, its axes and every formula on every axis that it is for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from geoerr.effects.covariates import is_temperature_entry, temperature_entry
from geoerr.effects.definitions import AXIS_NAMES, PAIR_NAMES, RESERVED_NAMES, pair_of
from geoerr.effects.description import OF_THE_AXIS, PAIRS, FormSpec, PartSpec
from geoerr.effects.effect import Effect
from geoerr.effects.formula import check_formula, marked
from geoerr.effects.places import line_of
from geoerr.errors import InputFileError, ShapeError
from geoerr.machine import AXES, Axis, Machine
from geoerr.spelling import meant
from geoerr.terms import EMPIRICAL, names_in

# Formulas are expanded once for reading; ranges and sides do not matter for whether they can be read.
_ANY_MACHINE = Machine("any", "wYbXZt", {axis: Axis((-50.0, 350.0)) for axis in AXES})
_JOINT_CHANNELS = ("along", "across", "across-angle", "angular", "joint")
_BODIES = ("tool", "work", "target")
_SMOOTH_CHANNELS = ("along", "across", "angular")
_FORMULA_HINT = "names, functions and signs that may stand in a formula: README.md of geoerr.effects"


def check_effect(effect: Effect, path: str | Path, number: int) -> None:
    """Refuse an effect that could not become a term on one of its axes.

    Parameters
    ----------
    effect
        As it was read.
    path, number
        Its file, and its place among the effects of the file, from 1.

    Raises
    ------
    InputFileError
        names the file, the effect, the key and the remedy; in a formula the place is marked.
    """
    check = _Check(effect, path, number)
    if effect.id == EMPIRICAL:
        raise check.refuse("id", "names a curve without a cause", "give your effect another id")
    if effect.is_smooth:
        check.smooth()
    if effect.is_smooth or effect.detector is not None:
        return
    for form in effect.forms:
        check.covariates(form)
        for part in form.parts:
            check.joint_axes(part)
            check.body_axes(part)
            check.short_names(part)
            check.temperature(form, part)
            check.slips(form, part)
    check.parameters()
    check.ranges()
    for form in effect.forms:
        check.directions(form)
        for axis in effect.axes or (None,):
            check.expansion(form, axis)


@dataclass(frozen=True)
class _Check:
    """The checks of one effect of one file; each method refuses one kind of mistake."""

    effect: Effect
    path: str | Path

    number: int

    def refuse(self, key: str, problem: str, remedy: str | None = None) -> InputFileError:
        row = line_of(self.path, self.number, key)
        return InputFileError(self.path, problem, row=row, column=f"effect {self.effect.id!r}: {key}", remedy=remedy)

    def smooth(self) -> None:
        if self.effect.channel not in _SMOOTH_CHANNELS:
            remedy = f"choose one of {', '.join(_SMOOTH_CHANNELS)}"
            raise self.refuse("channel", f"smooth functions are not for channel {self.effect.channel!r}", remedy)
        if not self.effect.axes or not set(self.effect.axes) <= set(AXES):
            raise self.refuse("axes", "smooth functions are of one axis", 'write axes = ["x", "y", "z"]')

    def joint_axes(self, part: PartSpec) -> None:
        """Check that a part on a joint has a moving axis, and a direction that fits it."""
        axes = self.effect.axes
        if part.channel not in _JOINT_CHANNELS:
            return
        if part.axis in PAIRS:
            raise self.refuse(
                "axis", f"a part on {part.channel} is of one axis, not {part.axis!r}", 'write axis = "x"'
            )
        if not axes and part.axis not in AXES:
            raise self.refuse("axes", f"a part on {part.channel} needs a moving axis", 'write axes = ["x"]')
        bodies = [axis for axis in axes if axis.startswith("work-")]
        if bodies:
            remedy = 'moving axes are "x", "y", "z"'
            raise self.refuse("axes", f"{bodies[0]!r} is a direction of the work, not a moving axis", remedy)
        if part.direction == "each" and not (axes and all("*" in axis for axis in axes)):
            raise self.refuse("axes", 'direction "each" is for products of axes', 'write axes = ["x*y"]')
        if part.axis == "second" and not all(pair_of(axis)[1] for axis in axes or (None,)):
            raise self.refuse("axis", "a second axis needs pairs", 'write axes = ["xy"]')
        needs_other = part.channel == "across" or (part.direction or "").startswith("angle-of-")
        own = {"first": 0, "second": 1}
        moving = {pair_of(axis)[own[part.axis]] for axis in axes} if part.axis in own else {part.axis}
        if needs_other and part.direction is not None and part.direction[-1] in moving:
            raise self.refuse(
                "direction", f"{part.direction!r} is not across axis {part.direction[-1]}", "name another direction"
            )

    def body_axes(self, part: PartSpec) -> None:
        """Check that a part elsewhere than on a joint has the direction or pair that it needs."""
        axes = self.effect.axes
        if part.channel in _JOINT_CHANNELS:
            return
        if part.axis == "second":
            raise self.refuse("axis", f"a part on {part.channel} has no second axis", "name the axis")
        if part.channel == "squareness" and part.axis not in PAIRS and not (axes and set(axes) <= set(PAIRS)):
            raise self.refuse("axes", "squareness is of two axes", 'write axes = ["xy", "xz", "yz"]')
        if part.channel in _BODIES and part.direction is None:
            allowed = {f"work-{axis}" for axis in AXES} | (set() if part.channel == "work" else set(AXES))
            if not axes or not set(axes) <= allowed:
                remedy = 'write axes = ["x", "y", "z"], or direction = "z"'
                raise self.refuse("axes", f"a displacement of the {part.channel} needs a direction", remedy)

    def covariates(self, form: FormSpec) -> None:
        if sum(map(is_temperature_entry, form.covariates)) > 1:
            remedy = "use T for one, and the other's own name in the formula without listing it"
            raise self.refuse("covariates", "names two temperatures, and T can be one of them only", remedy)
        columns = {name for entry in form.covariates for choice in entry.split("|") for name in choice.split("-")}
        twice = sorted(columns & self.effect.parameter_names)
        if twice:
            problem = f"{twice[0]} is a column and a parameter: in the formula it would be the parameter alone"
            raise self.refuse("covariates", problem, "give the parameter another name")

    def temperature(self, form: FormSpec, part: PartSpec) -> None:
        if "T" in names_in(part.expression) and temperature_entry(form) is None:
            problem = "T stands in the formula, but covariates names no temperature" + marked(part.expression, "T")
            raise self.refuse("expression", problem, 'write covariates = ["temp"]')

    def slips(self, form: FormSpec, part: PartSpec) -> None:
        """Refuse a name that would be taken for a column, and is a short name with a slip: `Tt`, `dx`, `Alpha`."""
        listed = {name for entry in form.covariates for choice in entry.split("|") for name in choice.split("-")}
        for name in names_in(part.expression):
            if name in RESERVED_NAMES | listed | self.effect.parameter_names:
                continue
            word = _short_name_meant(name) or meant(name, [one for one in RESERVED_NAMES if len(one) > 3])
            if word is not None:
                problem = f"unknown name `{name}` (did you mean `{word}`?)" + marked(part.expression, name)
                remedy = f"if the data have a column {name}, list it in covariates"
                raise self.refuse("expression", problem, remedy)

    def short_names(self, part: PartSpec) -> None:
        """Check that `q`, `d`, ... and `q_a`, `q_b`, ... belong to an axis that is there."""
        axes = self.effect.axes
        names = names_in(part.expression)
        own = [name for name in names if name in AXIS_NAMES]
        if own and (part.axis in PAIRS or (not axes and part.axis not in AXES)):
            example = "x, y or z" if own[0] in ("q", "L") else f"{own[0]}_x"
            remedy = f"write {example}, or name the axis (axes, or axis of the part)"
            problem = f"{own[0]} belongs to an axis, and there is none here" + marked(part.expression, own[0])
            raise self.refuse("expression", problem, remedy)
        for name in names:
            which = 0 if name.endswith("_a") else 1
            if name in PAIR_NAMES and not (axes and all(pair_of(axis)[which] for axis in axes)):
                problem = f"{name} belongs to a pair of axes" + marked(part.expression, name)
                raise self.refuse("expression", problem, 'write axes = ["xy"]')
        if "q_cross" in names and not (axes and set(axes) <= {"x", "y"}):
            problem = "q_cross is the other of x and y" + marked(part.expression, "q_cross")
            raise self.refuse("expression", problem, 'write axes = ["x", "y"]')

    def parameters(self) -> None:
        """Check that every part has a coefficient and that every parameter is used."""
        effect = self.effect
        if not effect.coefficients:
            remedy = 'write [effect.coefficients.k] with unit = "..."'
            raise self.refuse("coefficients", "an effect needs a linear coefficient", remedy)
        linear = {spec.name for spec in effect.coefficients}
        both = linear & {spec.name for spec in effect.inner}
        if both:
            raise self.refuse("inner", f"{min(both)} is a coefficient too", "keep one of them")
        used: set[str] = set()
        for part in (part for form in effect.forms for part in form.parts):
            names = set(names_in(part.expression))
            used |= names
            if not names & linear:
                remedy = f"multiply it by one of {', '.join(sorted(linear))}"
                raise self.refuse("expression", "this part has no coefficient" + marked(part.expression), remedy)
        for group, specs in (("coefficients", effect.coefficients), ("inner", effect.inner)):
            for spec in specs:
                if spec.name not in used:
                    remedy = "use it, or take it out; check the spelling"
                    raise self.refuse(
                        f"{group}.{spec.name}", f"stands in no formula{self._slip_of(spec.name)}", remedy
                    )

    def _slip_of(self, parameter: str) -> str:
        """Show the name in a formula that a parameter which stands in none was probably meant by."""
        for part in (part for form in self.effect.forms for part in form.parts):
            for name in names_in(part.expression):
                if name not in RESERVED_NAMES | self.effect.parameter_names and meant(name, [parameter]):
                    return f", but `{name}` does (did you mean `{parameter}`?){marked(part.expression, name)}"
        return ""

    def ranges(self) -> None:
        """Check that the range of the axis has an axis to be the range of."""
        for spec in self.effect.inner:
            if spec.range in OF_THE_AXIS and not self.effect.axes:
                remedy = "write x, y or z, or [low, high]"
                raise self.refuse(
                    f"inner.{spec.name}", "the range of the axis is asked for, and there is none", remedy
                )

    def directions(self, form: FormSpec) -> None:
        """Check that no coefficient is one number for each direction in one part and one number in another."""
        linear = {spec.name for spec in self.effect.coefficients}
        kinds: dict[str, set[bool]] = {}
        for part in form.parts:
            for name in linear.intersection(names_in(part.expression)):
                kinds.setdefault(name, set()).add(_has_directions(part))
        split = sorted(name for name, found in kinds.items() if len(found) > 1)
        if split:
            problem = f"{split[0]} is one number for each direction in one part, and one number in another"
            first = next(part.expression for part in form.parts if split[0] in names_in(part.expression))
            remedy = "give the parts different coefficients, or write direction"
            raise self.refuse("expression", problem + marked(first, split[0]), remedy)

    def expansion(self, form: FormSpec, axis: str | None) -> None:
        """Expand the effect for one axis and have the core read each formula."""
        entry = temperature_entry(form)
        choice = None if entry is None else entry.split("|")[0]
        covariate = "temp_a-temp_b" if choice == "temp-temp" else choice
        try:
            term = self.effect.term(axis, covariate, _ANY_MACHINE, form=form.name)
        except ShapeError as error:
            raise self.refuse(
                "expression", str(error), "make two effects of it, or give the parts other names"
            ) from error
        coefficients = [parameter.name for parameter in term.coefficients]
        inner = [parameter.name for parameter in term.inner]
        for part in term.parts:
            variables = [name for name in part.names if name not in coefficients + inner]
            problem = check_formula(part.expression or "", variables, coefficients, inner, part.definitions)
            if problem is not None:
                raise self.refuse("expression", problem, _FORMULA_HINT)


_DIRECTIONS_OF_TABLES = {f"dir_{axis}": f"d_{axis}" for axis in AXES}


def _short_name_meant(name: str) -> str | None:
    """Give the short name (`T`, `q`, `d_x`, ...) that a name is but for case, an underscore or a doubled letter.

    `dir_x` is what tables call `d_x`.
    """
    if name in _DIRECTIONS_OF_TABLES:
        return _DIRECTIONS_OF_TABLES[name]
    single = name[0] if len(name) == 2 and name[0].lower() == name[1].lower() else name
    folded = single.lower().replace("_", "")
    short = sorted(one for one in RESERVED_NAMES if len(one) <= 3)
    same = [one for one in short if one.lower().replace("_", "") == folded]
    # `T` and `t` are both short names: what is written as it is comes first.
    return next((one for one in same if one == single), same[0] if same else None)


def _has_directions(part: PartSpec) -> bool:
    if part.direction == "each":
        return True
    return part.direction is None and part.channel in ("across", "across-angle", "angular")
