"""Functions of the rows that candidates are made of: each formula compiled once, each trial of it named once.

Candidates share most of what they are made of (a temperature with a lag moves the tool, the bed and every axis):
what is alike in text and inner values is one function, whichever candidate asked first.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoerr import _core
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s, variable_columns
from geoerr.model.compile import core_part
from geoerr.terms import Part, Term, names_in

# Codes below 0 are functions that are numbers (odd) and products of two of them (even); others are slots of formulas.
_SLOTS = 4096


@dataclass(frozen=True, eq=False)
class CompiledPart:
    """A formula on a channel.

    Attributes
    ----------
    channel, factor
        Where it acts.
    expression
        The number of its formula.
    coefficients, inner
        Places of what it uses among the term's coefficients and inner parameters.
    """

    channel: str
    factor: float
    expression: int
    coefficients: tuple[int, ...]
    inner: tuple[int, ...]


class Functions:
    """The functions of one fit's rows.

    Parameters
    ----------
    fitted
        The fit.
    terms
        All terms that may be asked for: their variables are looked up once.
    """

    def __init__(self, fitted: Fitted, terms: Iterable[Term]) -> None:
        sightings = fitted.sightings
        names: dict[str, None] = {}
        for term in terms:
            parameters = {one.name for one in (*term.coefficients, *term.inner)}
            for part in term.parts:
                names |= dict.fromkeys(name for name in part.names if name not in parameters)
        self.fitted = fitted
        self.names = tuple(names)
        self.n_rows = len(sightings)
        self.variables = np.ascontiguousarray(variable_columns(sightings, self.names)).reshape(-1, self.n_rows)
        self.times = times_s(sightings)
        self.starts = sightings.starts
        self._compiled: dict[tuple[object, ...], int] = {}
        self._expressions: list[_core.Expression] = []
        self._trials: dict[tuple[int, tuple[float, ...]], int] = {}
        self._formulas: list[tuple[int, tuple[float, ...]]] = []
        self._given: list[Numbers] = []
        self._products: list[tuple[int, int]] = []

    def part(self, term: Term, part: Part) -> CompiledPart:
        """Compile a part of a term; one with the same text and definitions is compiled once."""
        used = set(part.names)
        coefficients = tuple(place for place, one in enumerate(term.coefficients) if one.name in used)
        inner = tuple(place for place, one in enumerate(term.inner) if one.name in used)
        # Parameters by their places: one wave across and along an axis is one, whatever its amplitudes are called.
        names = {term.coefficients[place].name: f"coefficient_{number}" for number, place in enumerate(coefficients)}
        names |= {term.inner[place].name: f"inner_{number}" for number, place in enumerate(inner)}
        alike = replace(
            part,
            channel="tool-x",
            expression=_renamed(part.expression or "", names),
            definitions=tuple((name, _renamed(text, names)) for name, text in _definitions_used(part)),
        )
        key = (alike.expression, alike.definitions, len(coefficients), len(inner))
        if key not in self._compiled:
            stand_in = replace(
                term,
                parts=(alike,),
                coefficients=tuple(
                    replace(term.coefficients[p], name=names[term.coefficients[p].name]) for p in coefficients
                ),
                inner=tuple(replace(term.inner[p], name=names[term.inner[p].name]) for p in inner),
            )
            expression = core_part(stand_in, alike, self.names)[3]
            assert isinstance(expression, _core.Expression)
            self._compiled[key] = len(self._expressions)
            self._expressions.append(expression)
        return CompiledPart(part.channel, part.factor, self._compiled[key], coefficients, inner)

    def expression(self, part: CompiledPart) -> _core.Expression:
        """Give a part's formula."""
        return self._expressions[part.expression]

    def formula(self, part: CompiledPart, inner: Sequence[float]) -> list[int]:
        """Give the codes of a part's functions, one for each of its coefficients, at values of the inner ones."""
        key = (part.expression, tuple(inner[place] for place in part.inner))
        if key not in self._trials:
            self._trials[key] = len(self._formulas)
            self._formulas.append(key)
        first = self._trials[key] * _SLOTS
        return [first + slot for slot in range(len(part.coefficients))]

    def given(self, values: Numbers) -> int:
        """Name a function that is numbers (n,)."""
        self._given.append(np.ascontiguousarray(values, dtype=np.float64))
        return -2 * len(self._given) + 1

    def product(self, first: int, second: int) -> int:
        """Name the product of two functions that are numbers."""
        self._products.append((-first // 2, -second // 2))
        return -2 * len(self._products)

    def evaluate(self, part: CompiledPart, inner: Sequence[float], rows: np.ndarray | None = None) -> Numbers:
        """Give the functions of a part (k, n) at values of the term's inner ones; 0 where there is no value.

        Parameters
        ----------
        rows
            Only these, for a formula that is no recursion along rows.
        """
        expression = self._expressions[part.expression]
        variables = self.variables if rows is None else np.ascontiguousarray(self.variables[:, rows])
        starts = self.starts if rows is None else np.zeros(0, dtype=np.int64)
        own = np.array([inner[place] for place in part.inner], dtype=np.float64)
        values = expression.coefficient_columns(variables, own, starts, self.times if rows is None else None, 1).T
        return values if np.isfinite(values.sum()) else np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)

    def values(self, codes: Sequence[int]) -> Numbers:
        """Give functions by their codes, (k, n)."""
        return np.stack([self._value(int(code)) for code in codes])

    def _value(self, code: int) -> Numbers:
        if code < 0:
            if code % 2:
                return self._given[-code // 2]
            first, second = self._products[-code // 2 - 1]
            return self._given[first] * self._given[second]
        number, inner = self._formulas[code // _SLOTS]
        expression = self._expressions[number]
        own = np.array(inner, dtype=np.float64)
        values = expression.coefficient_columns(self.variables, own, self.starts, self.times, 1)
        return np.nan_to_num(values[:, code % _SLOTS], nan=0.0, posinf=0.0, neginf=0.0)

    def scan(
        self,
        scene: _core.CandidateScene,
        groups: Sequence[tuple[np.ndarray, np.ndarray, Numbers, np.ndarray, int]],
        threads: int,
    ) -> list[tuple[Numbers, np.ndarray, Numbers, Numbers]]:
        """Let the core judge groups: codes (n_trials, k), channels, factors, coefficients, number of those."""
        asked = np.unique(np.concatenate([group[0].ravel() for group in groups])) if groups else np.zeros(0, np.int64)
        formulas = np.unique(asked[asked >= 0] // _SLOTS)
        counts = [len(self._expressions[self._formulas[number][0]].coefficients_used) for number in formulas]
        first = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int64)
        n_given = len(self._given)

        def numbered(codes: np.ndarray) -> np.ndarray:
            result = np.empty(codes.shape, dtype=np.int64)
            formula = codes >= 0
            own = codes[formula]
            result[formula] = first[np.searchsorted(formulas, own // _SLOTS)] + own % _SLOTS
            other = -codes[~formula]
            result[~formula] = first[-1] + np.where(other % 2 == 1, other // 2, n_given + other // 2 - 1)
            return np.ascontiguousarray(result)

        given = np.stack(self._given) if self._given else np.zeros((0, self.n_rows))
        return scene.scan(
            self.variables,
            self.starts,
            self.times,
            [(self._expressions[number], list(inner)) for number, inner in (self._formulas[f] for f in formulas)],
            given,
            self._products,
            [(numbered(group[0]), *group[1:]) for group in groups],
            threads,
        )


def _definitions_used(part: Part) -> tuple[tuple[str, str], ...]:
    """Give the definitions that a formula needs, directly or not: parts that differ in others are alike."""
    texts = dict(part.definitions)
    found: dict[str, str] = {}
    waiting = [*names_in(part.expression or "")]
    while waiting:
        name = waiting.pop()
        if name in texts and name not in found:
            found[name] = texts[name]
            waiting += names_in(texts[name])
    return tuple(sorted(found.items()))


def _renamed(expression: str, names: Mapping[str, str]) -> str:
    return re.sub(r"[A-Za-z_]\w*", lambda match: names.get(match[0], match[0]), expression)
