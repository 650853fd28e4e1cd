"""Values of causes as a shop floor has them: micrometres, micrometres a metre, milliseconds, with what they say."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr.diagnose.circles.runs import UM_PER_MM, Runs
from geoerr.effects.plausible import plausible_words
from geoerr.effects.values import BOUND, is_at_an_end
from geoerr.terms import Parameter, Term

_MS_PER_S = 1e3


@dataclass(frozen=True)
class Reading:
    """One value of a cause.

    Attributes
    ----------
    what
        Of what, where a cause has several values; else empty.
    value, std
        In `unit`.
    unit
        As a shop floor writes it.
    says
        What the value's sign means, or where it holds; may be empty.
    """

    what: str
    value: float
    std: float
    unit: str
    says: str = ""

    def words(self) -> str:
        """Write it: value ± standard uncertainty, unit, and what it says; a bound has no uncertainty."""
        digits = (
            0 if self.std >= 10.0 else min(max(1 - math.floor(math.log10(self.std)), 0), 6) if self.std > 0 else 3
        )
        doubt = "" if self.says == BOUND else f" ± {self.std:.{digits}f}"
        text = f"{self.value:+.{digits}f}".replace("-", "−") + f"{doubt} {self.unit}"
        if self.unit in ("mm", "mm/s", "Hz"):
            text = text.removeprefix("+")
        head = f"{self.what} {text}" if self.what else text
        return f"{head} ({self.says})" if self.says else head


def readings_of(
    term: Term, covariance: np.ndarray, runs: Runs, by_run: Sequence[Sequence[float]] = ()
) -> tuple[Reading, ...]:
    """Give a cause's readings.

    Parameters
    ----------
    term
        With its values.
    covariance
        Of its parameters (coefficients, then inner).
    by_run
        Of a cause by run: values and standard uncertainties of its amplitude in each.
    """
    reader = _READERS.get(term.effect or "", _plain)
    if by_run:
        return _vibration(term, by_run)
    return tuple(reader(term, np.asarray(covariance), runs))


def _values(term: Term) -> dict[str, Parameter]:
    return {parameter.name: parameter for parameter in (*term.coefficients, *term.inner) if _is_known(parameter)}


def _is_known(parameter: Parameter) -> bool:
    return math.isfinite(parameter.value) and math.isfinite(parameter.std)


def _plain(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    return [_of(parameter) for parameter in _values(term).values()]


def _of(parameter: Parameter, what: str | None = None, says: str = "") -> Reading:
    factor, unit = _UNITS.get(parameter.unit, (1.0, parameter.unit))
    name = (parameter.what or parameter.name) if what is None else what
    return Reading(name, factor * parameter.value, factor * parameter.std, unit, says)


_UNITS = {"mm": (UM_PER_MM, "µm"), "rad": (1e6, "µm/m"), "1": (1e6, "µm/m"), "s": (_MS_PER_S, "ms")}


def _squareness(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    one = term.coefficients[0]
    angle = "wider" if one.value > 0.0 else "narrower"
    return (
        [_of(one, "", f"the angle between +{term.axis[0]} and +{term.axis[1]} is {angle} than 90°")]
        if term.axis
        else []
    )


def _mismatch(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    one, (a, b) = term.coefficients[0], tuple(term.axis or "xy")
    far, near = (a, b) if one.value > 0.0 else (b, a)
    return [_of(one, "", f"{far} travels farther than {near}")]


def _servo(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    one, (a, b) = term.coefficients[0], tuple(term.axis or "xy")
    late, early = (a, b) if one.value > 0.0 else (b, a)
    return [_of(one, "", f"{late} lags behind {early}")]


def _shrink(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    one = term.coefficients[0]
    fastest = int(np.nanargmax(runs.feed_mm_min))
    speed, radius = float(runs.feed_mm_min[fastest]) / 60.0, float(runs.radius_mm[fastest])
    change = -UM_PER_MM * speed**2 / radius
    says = f"of the radius at {runs.feed_mm_min[fastest]:.5g} mm/min"
    found = [Reading("", change * one.value, abs(change) * one.std, "µm", says)]
    if one.value > 2.0 * one.std:
        # A servo of first order that lags by τ: the radius loses (F τ)²/(2R), so that k = τ²/2.
        tau = math.sqrt(2.0 * one.value)
        found.append(Reading("lag of both axes", _MS_PER_S * tau, _MS_PER_S * one.std / tau, "ms"))
    return found


def _backlash(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    one = term.coefficients[0]
    return [
        _of(one, "", "lost motion" if one.value > 0.0 else "negative: over-compensated, or the scale's side play")
    ]


def _unequal(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    axis = term.axis or "x"
    own = [number for number, plane in enumerate(runs.plane) if axis in plane]
    centre = float(runs.centre_mm[own, "xyz".index(axis)].mean())
    radius = float(runs.radius_mm[own].mean())
    found = []
    for sign in (-1.0, 1.0):
        at = np.array([1.0, _position(term, axis, centre + sign * radius)])
        value = float(at @ [p.value for p in term.coefficients])
        std = math.sqrt(max(float(at @ covariance[:2, :2] @ at), 0.0))
        found.append(
            Reading(f"at {axis} = {centre + sign * radius:.0f} mm", UM_PER_MM * value, UM_PER_MM * std, "µm")
        )
    return found


def _position(term: Term, axis: str, place_mm: float) -> float:
    text = dict(term.parts[0].definitions).get("q", axis)
    low = text.partition("-")[2] or text.partition("+")[2]
    offset = float(low) if low.strip() else 0.0
    return place_mm - offset if "-" in text else place_mm + offset


def _sideways(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    return [
        _of(parameter, f"along {parameter.name[-1]}" if "_" in parameter.name else "")
        for parameter in _values(term).values()
        if parameter.unit == "mm" and parameter in term.coefficients
    ]


def _bow(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    return [_of(parameter, says="over the circle's diameter") for parameter in _values(term).values()]


def _wave(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    names = [parameter.name for parameter in term.coefficients]
    found = []
    for suffix in dict.fromkeys(name[1:] for name in names):
        a, b = (names.index(f"{letter}{suffix}") for letter in "AB")
        reading = _amplitude(term, covariance, a, b)
        if reading is not None:
            direction = suffix.lstrip("2").removeprefix("_")
            what = f"amplitude along {direction}" if direction else "amplitude"
            harmonic = " of the second harmonic" if suffix.startswith("2") else ""
            found.append(Reading(what + harmonic, *reading, "µm"))
    period = next((p for p in term.inner if p.name == "P"), None)
    if period is not None:
        found.append(Reading("pitch", period.value, period.std, "mm", _known(period, term.inner)))
    return found


def _known(parameter: Parameter, inner: Sequence[Parameter]) -> str:
    """Say what physics says of a value that was searched for, and of a bound that it is one."""
    return BOUND if is_at_an_end(parameter) else plausible_words(parameter, inner) or ""


def _amplitude(term: Term, covariance: np.ndarray, a: int, b: int) -> tuple[float, float] | None:
    first, second = term.coefficients[a], term.coefficients[b]
    if not (_is_known(first) and _is_known(second)):
        return None
    size = math.hypot(first.value, second.value)
    slope = np.array([first.value, second.value]) / max(size, 1e-300)
    own = covariance[np.ix_([a, b], [a, b])]
    return UM_PER_MM * size, UM_PER_MM * math.sqrt(max(float(slope @ own @ slope), 0.0))


def amplitude_of(term: Term, by_run: Sequence[Sequence[float]]) -> Parameter:
    """Give the amplitude of a cause by run, root mean square of all runs: sine and cosine are each run's own."""
    values = np.array([one[0] for one in by_run])
    std = np.array([one[1] for one in by_run])
    mean = float(np.sqrt(np.mean(values**2)))
    doubt = float(np.sqrt(np.sum((values * std) ** 2))) / max(len(values) * mean, 1e-300)
    return replace(term.coefficients[0], name="amplitude", what="amplitude", value=mean, std=doubt)


def _vibration(term: Term, by_run: Sequence[Sequence[float]]) -> tuple[Reading, ...]:
    amplitude = amplitude_of(term, by_run)
    frequency = next(p for p in term.inner if p.name == "f")
    return (
        _of(amplitude),
        Reading("frequency", frequency.value, frequency.std, "Hz", _known(frequency, term.inner)),
    )


def _decay(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    height = term.coefficients[0]
    says = "outward" if height.value > 0.0 else "inward"
    found = [_of(height, "height" if term.effect == "reversal-spike" else "", says)]
    inner = term.inner[0]
    bound = BOUND if is_at_an_end(inner) else ""
    if inner.unit == "s":
        found.append(_of(inner, "decay", bound))
    elif inner.unit == "mm":
        found.append(Reading("within", inner.value, inner.std, "mm", bound or "of travel"))
    else:
        found.append(Reading("gone at", inner.value, inner.std, inner.unit, bound))
    return found


def _spiral(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    one = term.coefficients[0]
    factor = 60.0 * UM_PER_MM * float(runs.radius_mm.mean())
    return [Reading("", factor * one.value, factor * one.std, "µm/min", "of the radius")]


def _step(term: Term, covariance: np.ndarray, runs: Runs) -> list[Reading]:
    found = [_of(term.coefficients[0], "")]
    return [*found, *(Reading("at", p.value, p.std, p.unit) for p in term.inner)]


_READERS: dict[str, Callable[[Term, np.ndarray, Runs], list[Reading]]] = {
    "squareness": _squareness,
    "scale-mismatch": _mismatch,
    "servo-mismatch": _servo,
    "radial-shrink": _shrink,
    "backlash": _backlash,
    "backlash-position": _unequal,
    "lateral-play": _sideways,
    "straightness": _bow,
    "pitch-error": _bow,
    "periodic": _wave,
    "screw-wobble": _wave,
    "reversal-spike": _decay,
    "reversal-windup": _decay,
    "stick-slip": _decay,
    "spiral": _spiral,
    "lost-steps": _step,
    "change-over": _step,
}
