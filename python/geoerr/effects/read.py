"""Reading effects files: the built-in catalogue and a user's own have one form (README.md in this folder)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from geoerr.effects.definitions import RESERVED_NAMES
from geoerr.effects.description import (
    ALL_AXES,
    DETECTORS,
    JOINT_DIRECTIONS,
    OF_THE_AXIS,
    PART_AXES,
    PART_CHANNELS,
    RIG_DIRECTIONS,
    Description,
    FormSpec,
    ParameterSpec,
    PartSpec,
    Rival,
    Twin,
)
from geoerr.effects.entries import Entries, is_finite_number, shortened
from geoerr.errors import InputFileError
from geoerr.files import read_toml
from geoerr.machine import AXES
from geoerr.terms import (
    CONSTANTS,
    FUNCTIONS,
    SIGNS,
    Plausible,
    TermSource,
    UsualSpan,
    is_column,
    is_effect_id,
    is_name,
)

_ID_HINT = 'lower-case words joined by hyphens, for example id = "my-effect"'
_DIRECTIONS: dict[str, tuple[str, ...]] = {
    "across": AXES,
    "angular": AXES,
    "joint": JOINT_DIRECTIONS,
    "tool": AXES,
    "work": AXES,
    "target": AXES,
    "rig": RIG_DIRECTIONS,
}
_PART_KEYS = ("channel", "axis", "direction", "expression", "turns_on_work_side", "linear_in")
_FORM_KEYS = ("name", "covariates", "part", *_PART_KEYS)
EFFECT_KEYS = (
    *("id", "title", "axes", "covariates", "source", "looks_like", "cause", "remedy", "mistaken_for", "twins"),
    *("contains", "classic", "basis", "detector", "offered_as", "only_circular", "each_session", "again"),
    *("one_direction", "part", "form", "coefficients", "inner", "plausible", *_PART_KEYS),
)
# Units that a person may mean, and those that a formula is in.
_OTHER_UNITS = {
    **dict.fromkeys(("µm", "μm", "um", "nm", "m", "cm", "in", "inch"), "mm"),
    **dict.fromkeys(("µrad", "μrad", "urad", "mrad", "deg", "°", "arcsec"), "rad"),
    **dict.fromkeys(("ms", "min", "h"), "s"),
}
# What an entry says for itself that has the formula of another one.
_AGAIN_KEYS = ("id", "title", "again", "source", "looks_like", "cause", "remedy", "mistaken_for")
PARAMETER_KEYS = ("what", "unit", "plausible", "range", "spacing", "sign")
_RANGES = (*OF_THE_AXIS, *AXES, "time")


def read_descriptions(path: str | Path, origin: TermSource) -> tuple[Description, ...]:
    """Read every effect of a file.

    Raises
    ------
    InputFileError
        if the file is missing, is no TOML, holds no effect, or an entry is wrong: names file, effect, key, remedy.
    """
    document = read_toml(path)
    tables = document.get("effect")
    if not isinstance(tables, list) or not tables or not all(isinstance(item, dict) for item in tables):
        raise InputFileError(
            path, "holds no effects", column="effect", remedy="write each effect as a table [[effect]]"
        )
    family = Path(path).stem
    descriptions: list[Description] = []
    for number, table in enumerate(tables, start=1):
        if "again" in table:
            description = _once_more(table, number, path, descriptions)
        else:
            description = _description(table, number, path, family, origin)
        if any(description.id == earlier.id for earlier in descriptions):
            raise InputFileError(
                path, "is described twice", column=f"effect {description.id!r}", remedy="give the second another id"
            )
        descriptions.append(description)
    return tuple(descriptions)


def _description(
    table: dict[str, Any], number: int, path: str | Path, family: str, origin: TermSource
) -> Description:
    name, entries = _named(table, number, path)
    channel = _channel(entries)
    axes = _axes(entries, channel)
    detector = entries.text("detector", choices=DETECTORS) if "detector" in table else None
    is_smooth = "basis" in table
    if is_smooth:
        entries.text("basis", choices=("smooth",))
    return Description(
        id=name,
        title=entries.text("title", name),
        family=family,
        source=entries.text("source", ""),
        origin=origin,
        channel=channel,
        axes=axes,
        forms=_in_one_direction(entries, _forms(entries, has_no_formula=is_smooth or detector is not None)),
        coefficients=_parameters(entries.table("coefficients"), is_inner=False),
        inner=_parameters(entries.table("inner"), is_inner=True),
        looks_like=entries.text("looks_like", ""),
        cause=entries.text("cause", ""),
        remedy=entries.text("remedy", ""),
        mistaken_for=tuple(_rival(item) for item in entries.tables("mistaken_for")),
        twins=tuple(Twin(_other_id(item, "effect"), item.text("why")) for item in entries.tables("twins")),
        contains=entries.texts("contains"),
        is_classic=entries.flag("classic"),
        is_smooth=is_smooth,
        detector=detector,
        offered_as=entries.optional_text("offered_as"),
        only_circular=entries.flag("only_circular"),
        each_session=entries.flag("each_session"),
        any_size=_any_size(entries),
    )


def _named(table: dict[str, Any], number: int, path: str | Path) -> tuple[str, Entries]:
    name = Entries(table, path, f"effect {number}", number).only(EFFECT_KEYS).text("id")
    entries = Entries(table, path, f"effect {shortened(name)}", number)
    if not is_effect_id(name):
        raise entries.refuse("id", f"{shortened(name)} is not an id", _ID_HINT)
    return name, entries


def _once_more(table: dict[str, Any], number: int, path: str | Path, earlier: Sequence[Description]) -> Description:
    """Read an entry that has the formula of an earlier one of its file, in words of its own."""
    name, entries = _named(table, number, path)
    again = entries.text("again")
    first = next((one for one in earlier if one.id == again), None)
    if first is None:
        remedy = "it is for what may be there twice: name an effect that stands before it in the file"
        raise entries.refuse("again", f"{shortened(again)} is no effect above", remedy)
    last = next((one for one in earlier if one.again == again), None)
    if last is not None:
        raise entries.refuse("again", f"{shortened(again)} is there again as {last.id}", f"name {last.id}")
    for key in table:
        if key in EFFECT_KEYS and key not in _AGAIN_KEYS:
            raise entries.refuse(key, "stands beside again", f"leave it out: it is that of {again}")
    return replace(
        first,
        id=name,
        title=entries.text("title", name),
        source=entries.text("source", first.source),
        looks_like=entries.text("looks_like", first.looks_like),
        cause=entries.text("cause", first.cause),
        remedy=entries.text("remedy", first.remedy),
        mistaken_for=tuple(_rival(item) for item in entries.tables("mistaken_for")) or first.mistaken_for,
        twins=(),
        contains=(),
        again=again,
    )


def _axes(entries: Entries, channel: str) -> tuple[str, ...]:
    axes = entries.texts("axes")
    for axis in axes:
        if axis not in ALL_AXES:
            raise entries.refuse("axes", f"{shortened(axis)} is not an axis", f"axes are {', '.join(ALL_AXES)}")
    # A reference writes the directions of the work as work-x, work-y, work-z.
    return tuple(f"work-{axis}" if channel == "work" and axis in AXES else axis for axis in axes)


def _channel(entries: Entries) -> str:
    parts = [*entries.tables("part"), *(part for form in entries.tables("form") for part in form.tables("part"))]
    if "channel" not in entries.content and parts:
        return parts[0].text("channel", choices=PART_CHANNELS)
    if "channel" not in entries.content and "detector" in entries.content:
        return ""
    return entries.text("channel", choices=PART_CHANNELS)


def _forms(entries: Entries, *, has_no_formula: bool) -> tuple[FormSpec, ...]:
    formula_keys = [key for key in ("expression", "part", "form") if key in entries.content]
    if has_no_formula:
        if formula_keys:
            raise entries.refuse(formula_keys[0], "stands beside basis or detector", "keep one of them")
        return (FormSpec("", entries.texts("covariates"), ()),)
    if not formula_keys:
        raise entries.refuse("expression", "is missing", 'write expression = "..." or [[effect.part]] tables')
    if len(formula_keys) > 1:
        raise entries.refuse(formula_keys[1], f"stands beside {formula_keys[0]}", "keep one of them")
    if "form" not in entries.content:
        return (_form(entries, entries, ""),)
    forms = tuple(_form(form, entries, form.text("name")) for form in entries.tables("form"))
    if not forms:
        raise entries.refuse("form", "is empty", "write [[effect.form]] tables with a name each")
    if len({form.name for form in forms}) != len(forms):
        raise entries.refuse("form", "two forms have one name", "name each differently")
    return forms


def _in_one_direction(entries: Entries, forms: tuple[FormSpec, ...]) -> tuple[FormSpec, ...]:
    """Add the forms that turn about one axis of three, where the entry asks for them."""
    if not entries.flag("one_direction"):
        return forms
    if len(forms) > 1 or any(part.channel != "angular" or part.direction is not None for part in forms[0].parts):
        remedy = "it is for one formula on channel angular, without a direction"
        raise entries.refuse("one_direction", "has nothing to choose from", remedy)
    return (*forms, *(replace(forms[0], name=f"{axis} only", only=axis) for axis in AXES))


def _form(form: Entries, effect: Entries, name: str) -> FormSpec:
    if form is not effect:
        form.only(_FORM_KEYS)
    covariates = form.texts("covariates") if "covariates" in form.content else effect.texts("covariates")
    for needed in covariates:
        for choice in needed.split("|"):
            if not all(is_column(column) for column in choice.split("-")) or choice.count("-") > 1:
                remedy = "write column names; temp stands for every temperature column"
                raise form.refuse("covariates", f"{shortened(choice)} is not a column", remedy)
    if "part" in form.content:
        parts = tuple(_part(part.only(_PART_KEYS), effect) for part in form.tables("part"))
        if not parts:
            raise form.refuse("part", "is empty", "write [[effect.part]] tables")
    else:
        parts = (_part(form, effect),)
    return FormSpec(name, covariates, parts)


def _part(part: Entries, effect: Entries) -> PartSpec:
    channel = (part if "channel" in part.content else effect).text("channel", choices=PART_CHANNELS)
    axis = part.text("axis", "first", PART_AXES)
    linear_in = part.texts("linear_in")
    for which in linear_in:
        if which not in ("first", "second"):
            raise part.refuse("linear_in", f"{shortened(which)} is not known", "choose from first, second")
    return PartSpec(
        channel=channel,
        axis=axis,
        direction=_direction(part if "direction" in part.content else effect, channel),
        expression=part.text("expression"),
        turns_on_work_side=(part if "turns_on_work_side" in part.content else effect).flag("turns_on_work_side"),
        linear_in=linear_in,
    )


def _direction(entries: Entries, channel: str) -> str | None:
    if "direction" not in entries.content:
        if channel in ("rig", "joint"):
            choices = ", ".join(_DIRECTIONS[channel])
            raise entries.refuse("direction", f"is missing, a {channel} channel needs it", f"choose one of {choices}")
        return None
    if channel not in _DIRECTIONS:
        raise entries.refuse("direction", f"does not belong to channel {channel!r}", "leave it out, or name the axis")
    direction = entries.text("direction")
    if channel == "joint" and len(direction) == 1:
        direction = direction.upper()
    if direction not in _DIRECTIONS[channel]:
        remedy = f"choose one of {', '.join(_DIRECTIONS[channel])}"
        raise entries.refuse("direction", f"{shortened(direction)} is not known", remedy)
    return direction


def _parameters(tables: Entries, *, is_inner: bool) -> tuple[ParameterSpec, ...]:
    found = []
    for name in tables.content:
        if not is_name(name) or name in FUNCTIONS | CONSTANTS | RESERVED_NAMES:
            remedy = "choose another name of letters, digits and underscores"
            raise tables.refuse(name, "cannot be a parameter's name" + _why_not(name), remedy)
        entries = Entries(tables.table(name).content, tables.path, f"{tables.place}.{name}", tables.effect_number)
        entries.only(PARAMETER_KEYS)
        reason = _any_size(entries) if isinstance(entries.content.get("plausible"), str) else ""
        found.append(
            ParameterSpec(
                name=name,
                unit=_unit(entries),
                plausible=() if reason else tuple(_plausible(item) for item in entries.tables("plausible")),
                range=_range(entries) if is_inner else None,
                spacing="log" if entries.text("spacing", "linear", ("linear", "log")) == "log" else "linear",
                sign=_sign(entries),
                what=entries.text("what", ""),
                any_size=reason,
            )
        )
        _check_log_range(found[-1], entries)
    return tuple(found)


def _unit(entries: Entries) -> str:
    """Read a unit: what a formula gives is in mm or rad, whatever a name beside it says."""
    unit = entries.text("unit", "")
    if unit in _OTHER_UNITS:
        remedy = f"write it in {_OTHER_UNITS[unit]}: formulas are in mm, rad, s and K; reports choose µm and µrad"
        raise entries.refuse("unit", f"{unit!r} is not a unit of formulas", remedy)
    return unit


def _why_not(name: str) -> str:
    return ": the name has a meaning already" if is_name(name) else ""


def _any_size(entries: Entries) -> str:
    """Read why nothing is known of a size, which stands in the place of what would be."""
    reason = entries.text("plausible", "")
    if "plausible" in entries.content and not reason:
        raise entries.refuse("plausible", "is empty", "say why there is no usual size, or leave it out")
    return reason


def _plausible(entries: Entries) -> Plausible | UsualSpan:
    if "low" in entries.content or "high" in entries.content:
        return _usual_span(entries)
    entries.only(("value", "what", "within"))
    value, what, within = entries.number("value"), entries.text("what"), entries.number("within", Plausible.within)
    if not what:
        raise entries.refuse("what", "is empty", "say what the value is of")
    if within < 0.0:
        raise entries.refuse("within", f"{within:g} is below 0", "write the tolerance as a part of the value, 0.05")
    return Plausible(value, what, within)


def _sign(entries: Entries) -> int:
    return SIGNS[entries.text("sign", "any", tuple(SIGNS))]


def _usual_span(entries: Entries) -> UsualSpan:
    entries.only(("low", "high", "what", "source", "sign"))
    if "value" in entries.content:
        raise entries.refuse("value", "stands beside low and high", "keep the value, or the span from low to high")
    low, high, what = entries.number("low"), entries.number("high"), entries.text("what")
    if low < 0.0:
        raise entries.refuse("low", f"{low:g} is below 0", "a span is of sizes: leave the sign out")
    if not low < high:
        raise entries.refuse("high", f"{high:g} is not above low, {low:g}", "write the smaller as low")
    if not what:
        raise entries.refuse("what", "is empty", "say what the span is of")
    return UsualSpan(low, high, what, entries.text("source", ""), _sign(entries))


def _range(entries: Entries) -> tuple[float, float] | str:
    value = entries.content.get("range")
    if isinstance(value, str):
        return entries.text("range", choices=_RANGES)
    good = isinstance(value, list) and len(value) == 2 and all(is_finite_number(item) for item in value)
    if not good or not isinstance(value, list) or not value[0] <= value[1]:
        problem = "is missing" if value is None else f"{shortened(value)} is not a range from low to high"
        raise entries.refuse("range", problem, f"write [low, high] or one of {', '.join(_RANGES)}")
    return float(value[0]), float(value[1])


def _check_log_range(spec: ParameterSpec, entries: Entries) -> None:
    if spec.spacing == "log" and (isinstance(spec.range, str) or (spec.range is not None and spec.range[0] <= 0.0)):
        remedy = 'write [low, high] with low above 0, or spacing = "linear"'
        raise entries.refuse("range", "cannot be spaced by ratios", remedy)


def _rival(entries: Entries) -> Rival:
    entries.only(("effect", "what", "separate_by", "plan", "minutes"))
    effect = _other_id(entries, "effect") if "effect" in entries.content else None
    what = entries.optional_text("what")
    if effect is None and what is None:
        raise entries.refuse("effect", "is missing", "name the rival's id, or say what it is")
    minutes = entries.number("minutes") if "minutes" in entries.content else None
    if minutes is not None and minutes < 0.0:
        raise entries.refuse("minutes", f"{minutes:g} is below 0", "write minutes of machine time")
    return Rival(effect, what, entries.text("separate_by"), entries.optional_text("plan"), minutes)


def _other_id(entries: Entries, key: str) -> str:
    name = entries.text(key)
    if not is_effect_id(name):
        raise entries.refuse(key, f"{shortened(name)} is not an id", _ID_HINT)
    return name
