"""Writes docs/catalogue.md from the catalogue's own data: `python docs/make_catalogue.py`.

A test fails when the page is older than the data.
"""

from __future__ import annotations

from pathlib import Path

from geoerr.effects import Catalogue, Effect, FormSpec, ParameterSpec, catalogue
from geoerr.terms import Plausible, UsualSpan

PAGE = Path(__file__).with_name("catalogue.md")

_FAMILIES = {
    "classic": "Classic geometric errors",
    "reversal": "Direction of approach",
    "drive": "Drive",
    "dynamic": "Motion",
    "thermal": "Temperature and time",
    "structure": "Structure",
    "setup": "Set-up of the machine",
    "rig": "Measuring rig (explained, never compensated)",
    "circle": "Circular tests",
}
_HEAD = """# The catalogue of physical effects

Made by `python docs/make_catalogue.py` from `python/geoerr/effects/*.toml`; do not edit it here.

`q` is the coordinate of the candidate's axis, `d` its direction of approach, `s` the travel and `t_rev` the time
since its last reversal, `v` and `a` its speed and acceleration, `L` its length (then `q` counts from the low end,
as `q_low` always does), `t` the time in a session, `clock` the time with all sessions laid end to end,
`T` a temperature minus the reference or a difference of two temperatures. Lengths are in mm, angles in rad, times
in s. A coefficient *across* an axis or of its *angles* exists once for each direction, with `_x`, `_y` or `_z`
behind its name. Reports, terminal and workbench show a coefficient in the words before its letter here.
Values that physics would give it are in brackets; sizes that are usual for it, whatever its sign, have a line of
their own, with who says so or why there are none.
What each of them looks like: [the gallery](gallery.md). How to write effects of your own:
[My effect is not in the catalogue](guides/own_effect.md) and `python/geoerr/effects/README.md`.
"""


def make_page(effects: Catalogue) -> str:
    """Write the page."""
    blocks = [_HEAD, _overview(effects)]
    for family, heading in _FAMILIES.items():
        blocks.append(f"## {heading}\n")
        blocks += [_entry(effect, effects) for effect in effects if effect.family == family]
    return "\n".join(blocks)


def _overview(effects: Catalogue) -> str:
    rows = ["| id | acts on | for | looks like |", "| --- | --- | --- | --- |"]
    for effect in effects:
        rows.append(
            f"| [`{effect.id}`](#{effect.id}) | {_channels(effect)} | {_axes(effect)} | {_cell(effect.looks_like)} |"
        )
    return "\n".join(rows) + "\n"


def _entry(effect: Effect, effects: Catalogue) -> str:
    lines = [f"### {effect.id}", "", f"**{effect.title}.** {_sentence(effect.looks_like)}", ""]
    lines.append(f"- **Cause:** {effect.cause}")
    lines.append(f"- **What to do:** {effect.remedy}")
    lines += [
        f"- **Formula**{_form_words(form)}: {_formula(form)}" for form in effect.forms if form.parts and not form.only
    ]
    if effect.is_smooth:
        lines.append(f"- **Formula:** smooth functions of the position, {effect.channel} the axis")
    if effect.detector is not None:
        lines.append(f"- **Found by:** the check `{effect.detector}`; no formula can hold it")
    if effect.coefficients:
        lines.append(f"- **Coefficients:** {'; '.join(map(_parameter, effect.coefficients))}")
    if effect.inner:
        lines.append(f"- **Inner parameters:** {'; '.join(map(_parameter, effect.inner))}")
    needs = [needed for form in effect.forms[:1] for needed in form.covariates]
    if needs:
        lines.append(f"- **Needs:** {', '.join(f'`{_cell(needed)}`' for needed in needs)}")
    lines += _usual_sizes(effect)
    lines += [f"- **{note}**" for note in _notes(effect)]
    for twin in effects.twins(effect.id):
        lines.append(f"- **The same by construction as** {_link(twin.effect)}: {twin.why}")
    for rival in effects.rivals(effect.id):
        name = _link(rival.effect) if rival.effect is not None else rival.what
        minutes = "" if not rival.minutes else f" (about {rival.minutes:g} min)"
        plan = "" if rival.plan is None else f": {rival.plan}"
        lines.append(f"- **Mistaken for** {name}; what separates them: {rival.separate_by}{plan}{minutes}")
    lines.append(f"- **Source:** {effect.source}")
    return "\n".join(lines) + "\n"


def _notes(effect: Effect) -> list[str]:
    notes = []
    if effect.is_classic:
        notes.append("Part of the 21 errors: offered only against a smaller base")
    if effect.is_rig:
        notes.append("Belongs to the measuring rig: never compensated")
    if effect.contains:
        notes.append(f"Contains {', '.join(effect.contains)}: offered as what it adds")
    if effect.offered_as is not None:
        notes.append(f"Offered as {effect.offered_as}; named so where the value fits")
    if any(form.only for form in effect.forms):
        notes.append("Tried about each axis alone as well, with one coefficient")
    if effect.follows_temperature:
        notes.append("Each temperature may also be followed through a first-order lag")
    return notes


def _channels(effect: Effect) -> str:
    parts = {(part.channel, part.direction) for form in effect.forms for part in form.parts}
    if not parts:
        return effect.channel or "–"
    words = []
    for channel in sorted({channel for channel, _ in parts}):
        directions = sorted({direction for name, direction in parts if name == channel and direction})
        words.append(" ".join([channel, *directions]) if len(directions) == 1 else channel)
    return ", ".join(words)


def _axes(effect: Effect) -> str:
    return " ".join(f"`{axis}`" for axis in effect.axes) or "–"


def _form_words(form: FormSpec) -> str:
    return f" ({form.name})" if form.name else ""


def _formula(form: FormSpec) -> str:
    texts = dict.fromkeys(f"`{part.expression}`" for part in form.parts)
    return ", ".join(texts)


def _parameter(spec: ParameterSpec) -> str:
    text = f"{spec.what} `{spec.name}`".lstrip() + (f" [{spec.unit}]" if spec.unit not in ("", "1") else "")
    if isinstance(spec.range, tuple):
        low, high = spec.range
        text += f" = {low:g}, not searched" if low == high else f", {low:g} to {high:g}"
    elif spec.range is not None:
        words = {
            "axis": "over the axis's range",
            "around-axis": "over the axis's range and half as much beyond it",
            "time": "over the time of the data",
        }
        text += f", {words.get(spec.range, f'over the range of {spec.range}')}"
    if spec.sign:
        text += f", {'positive' if spec.sign > 0 else 'negative'}"
    values = [f"{item.value:g}: {item.what}" for item in spec.plausible if isinstance(item, Plausible)]
    return f"{text} ({', '.join(values)})" if values else text


def _usual_sizes(effect: Effect) -> list[str]:
    """Say what is usual for each parameter and by whom, or why nothing is; alike ones together."""
    named: dict[str, list[str]] = {effect.any_size: []} if effect.any_size else {}
    for spec in (*effect.coefficients, *effect.inner):
        spans = [_span(item, spec.unit) for item in spec.plausible if isinstance(item, UsualSpan)]
        if spans or spec.any_size:
            named.setdefault("; ".join(spans) or spec.any_size, []).append(f" `{spec.name}`")
    return [f"- **Usual size**{','.join(names)}: {words}" for words, names in named.items()]


def _span(span: UsualSpan, unit: str) -> str:
    size = f"{span.low:g} to {span.high:g}" if span.low > 0.0 else f"up to {span.high:g}"
    words = f"{span.what} has {size}" + ("" if unit in ("", "1") else f" {unit}")
    return f"{words} ({span.source})" if span.source else words


def _link(name: str | None) -> str:
    return f"[`{name}`](#{name})"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _cell(text: str) -> str:
    return text.replace("|", " or ")


if __name__ == "__main__":
    PAGE.write_text(make_page(catalogue()), encoding="utf-8")
