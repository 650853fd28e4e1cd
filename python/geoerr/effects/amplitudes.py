"""Amplitudes of waves: of `A*sin(u) + B*cos(u)` it is √(A² + B²), and A and B by themselves are where it begins.

Whether a size is usual is a question of the amplitude: A and B of one wave may look like those of different machines.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from geoerr.effects.plausible import MATCH_STD, plausible_what, plausible_words
from geoerr.effects.values import number_with_std, read_in
from geoerr.summaries import number_words
from geoerr.terms import Parameter, Term

_SINE = re.compile(r"(?<![\w.])(sin|cos)\(")
_NAME = re.compile(r"(?<![\w.])[A-Za-z]\w*")


@dataclass(frozen=True, eq=False)
class Amplitude:
    """The amplitude of one wave of a term.

    Attributes
    ----------
    sine, cosine
        Names of its two coefficients.
    size
        √(A² + B²) with its standard error, and what sizes are usual for it; the unit is that of both.
    inner
        The inner parameters of its term, beside which it was found.
    """

    sine: str
    cosine: str
    size: Parameter
    inner: tuple[Parameter, ...] = ()

    @property
    def is_told(self) -> bool:
        """Whether it is told from 0: noise alone has an amplitude of about one standard error, never one below 0."""
        return self.size.value > MATCH_STD * self.size.std

    @property
    def most(self) -> float:
        """What it is at most, where it is not told from 0: by twice the standard error."""
        return self.size.value + MATCH_STD * self.size.std

    def to_document(self) -> dict[str, Any]:
        """Give it as `--json` has it."""
        return {
            "of": [self.sine, self.cosine],
            "value": self.size.value,
            "std": self.size.std,
            "unit": self.size.unit,
            "is_told": self.is_told,
            "plausible": plausible_what(self.size, self.inner) if self.is_told else None,
        }


def amplitude_words(amplitude: Amplitude) -> str:
    """Write a wave's amplitude with its standard error and what it is usual for; a bound where it may be 0."""
    number, usual = amplitude_value_words(amplitude), amplitude_usual_words(amplitude)
    return number if usual is None else f"{number} ({usual})"


def amplitude_value_words(amplitude: Amplitude) -> str:
    """Write a wave's amplitude with its standard error alone; a bound where it may be 0."""
    size = amplitude.size
    unit, factor = read_in(size)
    name = f"amplitude √({amplitude.sine}² + {amplitude.cosine}²)"
    if not amplitude.is_told:
        return f"{name} at most {number_words(amplitude.most * factor)} {unit}: not told from 0"
    return f"{name} = {number_with_std(size.value * factor, size.std * factor)} {unit}".rstrip()


def amplitude_usual_words(amplitude: Amplitude) -> str | None:
    """Say what an amplitude is usual for; None of one that may be 0."""
    return plausible_words(amplitude.size, amplitude.inner) if amplitude.is_told else None


def wave_pairs(term: Term) -> tuple[tuple[str, str], ...]:
    """Give the coefficients that stand before a sine and a cosine of the same argument, and nowhere else."""
    waves: dict[str, set[tuple[str, str]]] = {}
    coefficients = {one.name for one in term.coefficients}
    for part in term.parts:
        for name, function, argument in _factors(part.expression or "", coefficients):
            waves.setdefault(name, set()).add((function, argument))
    uses = {name: _uses(term, name) for name in waves}
    # Once in a part: in the wave.
    single = {name: next(iter(own)) for name, own in waves.items() if len(own) == 1 and max(uses[name]) == 1}
    return tuple(
        (sine, cosine)
        for sine, (function, argument) in single.items()
        for cosine, other in single.items()
        if function == "sin" and other == ("cos", argument) and uses[sine] == uses[cosine]
    )


def amplitudes_of(term: Term, covariance: npt.NDArray[np.float64]) -> tuple[Amplitude, ...]:
    """Give the amplitude of each wave of a term; none where a coefficient is open.

    With a = √(A² + B²) its variance is (A, B) C (A, B)ᵀ / a², C the covariance of both. Where a is within twice the
    largest standard error that C has in any direction it is that one: the phase is not known there.

    Parameters
    ----------
    covariance : (k, k)
        Of the coefficients, in their units.
    """
    names = [one.name for one in term.coefficients]
    found = []
    for sine, cosine in wave_pairs(term):
        own = [names.index(sine), names.index(cosine)]
        first, second = (term.coefficients[place] for place in own)
        if first.unit != second.unit or not all(math.isfinite(one.std) for one in (first, second)):
            continue
        values = np.array([first.value, second.value])
        of_both = covariance[np.ix_(own, own)]
        size = float(np.linalg.norm(values))
        worst = math.sqrt(max(float(np.linalg.eigvalsh(of_both)[-1]), 0.0))
        std = worst
        if size > MATCH_STD * worst:
            std = math.sqrt(max(float(values @ of_both @ values), 0.0)) / size
        found.append(
            Amplitude(sine, cosine, Parameter("amplitude", first.unit, size, std, first.plausible), term.inner)
        )
    return tuple(found)


def amplitudes_by_term(
    terms: Sequence[Term], covariance: npt.NDArray[np.float64]
) -> dict[str, tuple[Amplitude, ...]]:
    """Give the amplitudes of each term of a fit, by its id; of the covariance the coefficients of all come first."""
    found, first = {}, 0
    for term in terms:
        own = slice(first, first + len(term.coefficients))
        found[term.id] = amplitudes_of(term, covariance[own, own])
        first = own.stop
    return found


def parts_of(amplitudes: Sequence[Amplitude]) -> set[str]:
    """Give the names of coefficients whose amplitude is judged, and they are not."""
    return {name for one in amplitudes for name in (one.sine, one.cosine)}


def _factors(expression: str, coefficients: set[str]) -> Iterator[tuple[str, str, str]]:
    """Give coefficient and function of each product with a sine or cosine, and all else that it is made of.

    That is the argument, the other factors, and the bracket that it stands in: of a wave both parts have the same.
    """
    text = re.sub(r"\s", "", expression)
    for match in _SINE.finditer(text):
        end = _closing(text, match.end())
        first, last = _product(text, match.start(), end)
        factors = f"{text[first : match.start()]}~{text[end + 1 : last]}"
        names = [name for name in _NAME.findall(factors) if name in coefficients]
        if len(names) == 1 and not text.startswith("^", end + 1):
            others = re.sub(rf"(?<![\w.]){names[0]}(?!\w)", "1", factors).replace("1*~", "~*1")
            yield names[0], match[1], f"{text[match.end() : end]} {others} {_bracket(text, first)}"


def _product(text: str, first: int, last: int) -> tuple[int, int]:
    """Give where the product begins and ends of which the text from `first` to `last` is a factor."""
    depth = 0
    while first > 0 and (depth or text[first - 1] not in "+-("):
        first -= 1
        depth += {")": 1, "(": -1}.get(text[first], 0)
    last, depth = last + 1, 0
    while last < len(text) and (depth or text[last] not in "+-)"):
        depth += {"(": 1, ")": -1}.get(text[last], 0)
        last += 1
    return first, last


def _bracket(text: str, place: int) -> int:
    """Give the place of the bracket that is open at a place; -1 where none is."""
    depth = 0
    for before in range(place - 1, -1, -1):
        depth += {")": 1, "(": -1}.get(text[before], 0)
        if depth < 0:
            return before
    return -1


def _closing(text: str, start: int) -> int:
    """Give the place of the bracket that closes the one before `start`."""
    depth = 1
    for place in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[place], 0)
        if depth == 0:
            return place
    return len(text)


def _uses(term: Term, name: str) -> list[int]:
    """Give how often a name stands in each part."""
    word = re.compile(rf"(?<![\w.]){re.escape(name)}(?!\w)")
    return [len(word.findall(part.expression or "")) for part in term.parts]
