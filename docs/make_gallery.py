"""Draws what each effect of the catalogue looks like: `python docs/make_gallery.py`.

Writes `gallery.md` and a small picture for each effect that moves the machine. The curves are the model's own
predictions with that effect alone, along a stroke there and back, over time, or round a circle: shapes, not
sizes, for every picture is scaled to fill its frame.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import geoerr
from geoerr.effects import Effect, catalogue
from geoerr.error_functions import ErrorFunction, ErrorFunctions
from geoerr.terms import Parameter, Term

PAGE = Path(__file__).with_name("gallery.md")
PICTURES = Path(__file__).with_name("gallery")
MACHINE = geoerr.Machine.from_chain("wbXYZt", travel_mm=(400.0, 400.0, 400.0))
# Where a target has a lever, angles show.
LEVER_MM = (40.0, 90.0, 150.0)
COLUMNS = ("temp", "temp_a", "temp_nozzle", "t", "moving", "feed", "force", "duty", "load", "session")
# Drawn round a circle or over time; all others along the axis.
ON_CIRCLE = (
    "squareness",
    "servo-mismatch",
    "radial-shrink",
    "acceleration",
    "scale-mismatch",
    "change-over",
    "vibration",
)
OVER_TIME = ("warm-up", "lost-steps", "screw-heating", "thermal-drift", "nozzle-growth")
# The smooth ones have no formula: a curve that could be one.
SMOOTH = {"pitch-error": "EXX", "straightness": "EYX", "angular": "ECX"}
# Inner parameters that show: mm, s, Hz.
INNER = {"P": 50.0, "lambda": 15.0, "f": 1.2, "q_fixed": 100.0, "t0": 1500.0, "v_s": 2.0, "h": 10.0}
# Size of a picture's error, and of the coefficients by which it is found: small, so that all is in proportion.
_SIZE_MM, _TRIAL = 0.01, 1e-6
_UNSEEN_MM = 1e-12
_WIDTH, _HEIGHT, _EDGE = 260, 150, 14
_COLOURS = ("#1f5fa8", "#d1660f", "#2a8a4a", "#8a4aa0")
_N = 90
_SLOW, _FAST = 10.0, 60.0


@dataclass(frozen=True)
class Curve:
    """One line of a picture: where, and how far off."""

    label: str
    q_mm: np.ndarray
    at: dict[str, Any]
    abscissa: np.ndarray


def main() -> None:
    """Draw all pictures, and the page that shows them."""
    PICTURES.mkdir(exist_ok=True)
    cells = []
    for effect in catalogue():
        picture = draw(effect)
        if picture is not None:
            (PICTURES / f"{effect.id}.svg").write_text(picture, encoding="utf-8")
            cells.append((effect.id, effect.title))
    PAGE.write_text(page(cells), encoding="utf-8")


def page(cells: list[tuple[str, str]]) -> str:
    """Give the page: three pictures a row, each leading to its entry in the catalogue."""
    lines = [
        "# What each effect looks like",
        "",
        "Made by `python docs/make_gallery.py` from the catalogue; do not edit it here. Each picture is the",
        "model's own prediction with one effect alone, scaled to its frame: the shape, not the size. The names lead",
        "to cause, remedy, formula and look-alikes. Effects of the measuring rig move no part of the machine and are",
        "not drawn; the [catalogue](catalogue.md) has them all.",
        "",
        "| | | |",
        "| --- | --- | --- |",
    ]
    shown = [f"![{title}](gallery/{name}.svg)<br>[{title}](catalogue.md#{name})" for name, title in cells]
    for start in range(0, len(shown), 3):
        row = shown[start : start + 3]
        lines.append(f"| {' | '.join(row + [''] * (3 - len(row)))} |")
    return "\n".join(lines) + "\n"


def draw(effect: Effect) -> str | None:
    """Give the picture of an effect; None where nothing of the machine moves."""
    if effect.is_rig or effect.detector is not None:
        return None
    if effect.id in SMOOTH:
        model = _smooth(SMOOTH[effect.id])
    else:
        references = effect.candidates(MACHINE, COLUMNS, n_sessions=2, is_circular=True)
        if not references:
            return None
        # A bed is drawn from its middle outwards, a temperature rather than a difference of two.
        reference = min(references, key=lambda one: "-" in (one.covariate or ""))
        term = effect.term(reference.axis, reference.covariate, MACHINE, sessions=("0", "1"))
        model = _with_size(effect, term)
    curves = list(_curves(effect, model))
    errors = [_error_mm(model, curve) for curve in curves]
    if effect.id in ON_CIRCLE:
        return _circle(curves, errors)
    component = int(np.argmax(np.ptp(np.concatenate(errors), axis=0)))
    over = "time" if effect.id in OVER_TIME else "y" if any(len(axis) == 2 for axis in effect.axes) else "x"
    return _lines(curves, [error[:, component] for error in errors], over, "xyz"[component])


def _smooth(name: str) -> geoerr.Model:
    position = np.linspace(0.0, 400.0, 41)
    u = position / 400.0
    value = 1e-2 * (np.sin(5.0 * u) + 0.4 * np.sin(13.0 * u)) / (150.0 if name[1] in "ABC" else 1.0)
    errors = ErrorFunctions(MACHINE, {name: ErrorFunction(position, value)}, {}, method="drawn")
    return geoerr.Model(MACHINE, errors)


def _with_size(effect: Effect, term: Term) -> geoerr.Model:
    """Give the machine with the effect alone, its coefficients so large that each shows."""
    inner = tuple(dataclasses.replace(one, value=_inner(one, effect)) for one in term.inner)
    n = len(term.coefficients)
    sizes = []
    for index in range(n):
        alone = [_TRIAL if k == index else 0.0 for k in range(n)]
        model = geoerr.Model(MACHINE) + _valued(term, inner, alone)
        largest = np.ptp(np.concatenate([_error_mm(model, one) for one in _curves(effect, model)]), axis=0).max()
        sizes.append(max(float(largest) / _TRIAL, 1e-24))
    # The first shows most, so that a picture has one idea.
    values = [_SIZE_MM / size / (1.0 + index) for index, size in enumerate(sizes)]
    return geoerr.Model(MACHINE) + _valued(term, inner, values)


def _valued(term: Term, inner: tuple[Parameter, ...], values: list[float]) -> Term:
    pairs = zip(term.coefficients, values, strict=True)
    return dataclasses.replace(
        term, coefficients=tuple(dataclasses.replace(one, value=value) for one, value in pairs), inner=inner
    )


def _inner(parameter: Parameter, effect: Effect) -> float:
    if parameter.name == "tau":
        return 900.0 if effect.id in OVER_TIME else 0.6
    if parameter.name in INNER:
        return INNER[parameter.name]
    return 0.5 * ((parameter.low or 0.0) + (parameter.high or 0.0))


def _error_mm(model: geoerr.Model, curve: Curve) -> np.ndarray:
    at = {name: value for name, value in curve.at.items() if name in model.conditions}
    error = np.asarray(model.error_mm(curve.q_mm, at=at))
    # What is nothing at the tool point is an angle.
    return error if np.abs(error).max() > _UNSEEN_MM else np.asarray(model.error_mm(curve.q_mm, LEVER_MM, at=at))


def _curves(effect: Effect, model: geoerr.Model) -> Iterator[Curve]:
    needs = model.conditions
    if effect.id in ON_CIRCLE:
        yield from (_round("anticlockwise", 1.0, _FAST), _round("clockwise", -1.0, _FAST))
    elif effect.id in OVER_TIME:
        yield _course(effect)
    elif any(name.startswith("temp") for name in needs):
        second = any(len(axis) == 2 for axis in effect.axes)
        yield from (_stroke(f"{degc:g} °C", 1.0, _SLOW, temp=degc, is_second=second) for degc in (20.0, 50.0, 80.0))
    elif any(name.startswith("v_") for name in needs):
        yield from (_stroke("there slow", 1.0, 1.0), _stroke("back slow", -1.0, 1.0))
        yield from (_stroke("there fast", 1.0, _FAST), _stroke("back fast", -1.0, _FAST))
    elif "force" in needs:
        yield from (_stroke("unloaded", 1.0, _SLOW), _stroke("loaded", 1.0, _SLOW, force=50.0))
    elif "session" in needs:
        second = any(len(axis) == 2 for axis in effect.axes)
        for number, label in enumerate(("first session", "later session")):
            yield _stroke(label, 1.0, _SLOW, session=float(number), is_second=second)
    elif any(name.startswith(("d_", "s_", "t_rev")) for name in needs):
        yield from (_stroke("there", 1.0, _SLOW), _stroke("back", -1.0, _SLOW))
    elif any("*" in axis for axis in effect.axes):
        yield from (_stroke(f"y = {y:g}", 1.0, _SLOW, y_mm=y) for y in (0.0, 200.0, 400.0))
    else:
        yield _stroke("there and back", 1.0, _SLOW)


def _stroke(
    label: str,
    sense: float,
    speed: float,
    *,
    temp: float = 20.0,
    y_mm: float = 0.0,
    is_second: bool = False,
    **more: float,
) -> Curve:
    """Give a stroke along x, or along y for what acts along the second axis of a pair."""
    u = np.linspace(0.0, 1.0, _N)
    x = 400.0 * (u if sense > 0 else 1.0 - u)
    other, height = np.full(_N, y_mm), np.zeros(_N)
    q_mm = np.column_stack([other, x, height] if is_second else [x, other, height])
    at: dict[str, Any] = {"t": 400.0 * u / speed, "clock": 400.0 * u / speed, "temp": temp, "temp_a": 20.0}
    at |= {"temp_nozzle": temp, "force": 0.0, "session": 0.0, "feed": 60.0 * speed}
    for axis in "xyz":
        at |= {f"d_{axis}": sense, f"s_{axis}": 400.0 * u, f"t_rev_{axis}": 400.0 * u / speed}
        at |= {f"v_{axis}": sense * speed, f"mean_v_{axis}": sense * speed, f"a_{axis}": 0.0}
    return Curve(label, q_mm, at | more, x)


def _course(effect: Effect) -> Curve:
    """Give an hour at one place: heated for 40 minutes, worked hard for 40, then left alone."""
    t = np.linspace(0.0, 3600.0, 2 * _N)
    warming = 1.0 - np.exp(-np.minimum(t, 2400.0) / 500.0)
    temp = 20.0 + 60.0 * warming * np.exp(-np.maximum(t - 2400.0, 0.0) / 500.0)
    at: dict[str, Any] = {"t": t, "clock": t, "temp": temp, "temp_nozzle": temp}
    for axis in "xyz":
        # Conditions are those of a settled machine: what follows with a lag is given as it has followed.
        at |= {f"v_{axis}": 0.0, f"mean_v_{axis}": _FAST * (temp - 20.0) / 60.0, f"d_{axis}": 1.0}
    return Curve(effect.id, np.tile([300.0, 200.0, 200.0], (len(t), 1)), at, t)


def _round(label: str, sense: float, speed: float) -> Curve:
    angle = sense * (np.linspace(0.0, 2.0 * np.pi, 2 * _N + 1) + 1e-3)
    cos, sin = np.cos(angle), np.sin(angle)
    q_mm = np.column_stack([200.0 + 100.0 * cos, 200.0 + 100.0 * sin, np.full(len(angle), 200.0)])
    t = abs(angle) * 100.0 / speed
    at: dict[str, Any] = {"t": t, "clock": t, "v_x": -sense * speed * sin, "v_y": sense * speed * cos}
    at |= {"a_x": -(speed**2) / 100.0 * cos, "a_y": -(speed**2) / 100.0 * sin}
    at |= {"d_x": np.sign(at["v_x"]), "d_y": np.sign(at["v_y"])}
    return Curve(label, q_mm, at, angle)


def _lines(curves: list[Curve], values: list[np.ndarray], over: str, component: str) -> str:
    low, high = (function([function(value) for value in values]) for function in (min, max))
    low, high = min(low, 0.0), max(high, 0.0)
    left, right = min(c.abscissa.min() for c in curves), max(c.abscissa.max() for c in curves)
    across, up = (_WIDTH - 2 * _EDGE) / (right - left), (_HEIGHT - 3 * _EDGE) / max(high - low, 1e-12)

    def place(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _EDGE + across * (x - left), _HEIGHT - _EDGE - up * (y - low)

    zero = place(np.array([left, right]), np.zeros(2))
    parts = [_polyline(*zero, "#999", dashed=True)]
    parts += [
        _polyline(*place(c.abscissa, v), colour) for c, v, colour in zip(curves, values, _COLOURS, strict=False)
    ]
    parts += _legend([c.label for c in curves] if len(curves) > 1 else [])
    parts.append(_text(_WIDTH - _EDGE, _HEIGHT - 3, f"over {over}", "#555", end=True))
    parts.append(_text(_EDGE, _HEIGHT - 3, f"off along {component}", "#555"))
    return _svg(parts)


def _circle(curves: list[Curve], errors: list[np.ndarray]) -> str:
    radial = []
    for curve, error in zip(curves, errors, strict=True):
        direction = np.column_stack([np.cos(curve.abscissa), np.sin(curve.abscissa)])
        value = (error[:, :2] * direction).sum(axis=1)
        # A circle is looked at from its own centre.
        radial.append(value - direction @ np.linalg.lstsq(direction, value, rcond=None)[0])
    size = max(max(abs(one)) for one in radial)
    centre, radius, shown = (_WIDTH / 2, (_HEIGHT + 8) / 2), 0.33 * _HEIGHT, 0.11 * _HEIGHT / size
    whole = np.linspace(0.0, 2.0 * np.pi, 61)
    parts = [_ring(centre, whole, np.full(61, radius), "#999", dashed=True)]
    for curve, value, colour in zip(curves, radial, _COLOURS, strict=False):
        parts.append(_ring(centre, curve.abscissa, radius + shown * value, colour))
    return _svg(parts + _legend([curve.label for curve in curves]))


def _ring(
    centre: tuple[float, float], angle: np.ndarray, radius: np.ndarray, colour: str, *, dashed: bool = False
) -> str:
    x, y = centre[0] + radius * np.cos(angle), centre[1] - radius * np.sin(angle)
    return _polyline(x, y, colour, dashed=dashed)


def _polyline(x: np.ndarray, y: np.ndarray, colour: str, *, dashed: bool = False) -> str:
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    look = 'stroke-width="1" stroke-dasharray="3 3"' if dashed else 'stroke-width="1.8"'
    return f'<polyline fill="none" stroke="{colour}" {look} points="{points}"/>'


def _legend(labels: list[str]) -> list[str]:
    places = np.linspace(_EDGE, _WIDTH - _EDGE, len(labels) + 1)
    return [_text(x, 12, label, colour) for x, label, colour in zip(places, labels, _COLOURS, strict=False)]


def _text(x: float, y: float, words: str, colour: str, *, end: bool = False) -> str:
    anchor = ' text-anchor="end"' if end else ""
    return f'<text x="{x:.0f}" y="{y:.0f}" fill="{colour}"{anchor}>{words}</text>'


def _svg(parts: list[str]) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}"'
        f' width="{_WIDTH}" height="{_HEIGHT}" font-family="sans-serif" font-size="10">'
    )
    return "\n".join([head, f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#fff"/>', *parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    main()
