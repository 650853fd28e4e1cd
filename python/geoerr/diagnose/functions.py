"""Functions of the rows that candidates are made of: each formula compiled once, each trial of it named once.

Candidates share most of what they are made of (a temperature with a lag moves the tool, the bed and every axis):
what is alike in text and inner values is one function, whichever candidate asked first.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from geoerr import _core
from geoerr.diagnose.columns import Columns
from geoerr.diagnose.gaps import read_columns
from geoerr.diagnose.trials import Trials
from geoerr.fit.fitted import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s
from geoerr.model.compile import core_part
from geoerr.terms import Part, Term, names_in

# Codes below 0 are functions that are numbers (odd) and products of two of them (even); others are slots of formulas.
_SLOTS = 4096
# A definition that is a temperature above another or above a number, with a lag or without. What follows it in many
# ways follows one column of numbers, and what follows a difference is a difference.
_SERIES_TEXT = re.compile(r"\s*(temp_\w+) - (temp_\w+|[0-9.]+)\s*")
_LAGGED = re.compile(r"\s*lag\((.*),\s*([A-Za-z_]\w*)\s*\)\s*")
# What formulas call that column.
_SERIES = "followed_series"
_NO_STARTS = np.zeros(0, dtype=np.int64)
# A formula is proportional to the column if it is at these multiples of it, of either sign for the sake of `abs`.
_MULTIPLES, _PROPORTIONAL = (-1.0, 0.0, 2.0, 3.0), 1e-9


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
    follows
        The column that it follows: of what, and the place of the time constant of its lag (None: no lag), if any.
    """

    channel: str
    factor: float
    expression: int
    coefficients: tuple[int, ...]
    inner: tuple[int, ...]
    follows: tuple[str, int | None] | None


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
        self.names = tuple(names)
        self.n_rows = len(sightings)
        # The last row is the column that some formulas follow, whichever it is at the time.
        self._columns = np.zeros((len(names) + 1, self.n_rows))
        self._columns[:-1] = np.asarray(read_columns(sightings, self.names)).reshape(-1, self.n_rows)
        self._columns_at: dict[bytes, Numbers] = {}
        self._at_rows: dict[tuple[bytes, int, tuple[float, ...], int | None], Numbers] = {}
        self.times = times_s(sightings)
        self.starts = sightings.sequences
        self._compiled: dict[tuple[object, ...], int] = {}
        self._expressions: list[_core.Expression] = []
        self._lags: dict[str, _core.Expression] = {}
        self._series_of: dict[tuple[str, float | None], int] = {}
        self._series = Columns(self.n_rows)
        self._trials = Trials()
        self._proportional: dict[int, bool] = {}
        self._means: dict[tuple[str, int, str], float] = {}
        self._given = Columns(self.n_rows)
        self._products: list[tuple[int, int]] = []

    def copy(self) -> Functions:
        """Give the same functions, to which others can be added that these have not."""
        other = copy(self)
        other._trials, other._series, other._given = self._trials.copy(), self._series.copy(), self._given.copy()
        other._series_of, other._products = dict(self._series_of), list(self._products)
        return other

    def parts(self, term: Term, part: Part) -> list[CompiledPart]:
        """Compile a part of a term: two for what is proportional to a difference of two temperatures."""
        return [self._about_its_mean(one) for one in self._parts(term, part)]

    def center(self, part: CompiledPart, used: np.ndarray) -> None:
        """From now on let a part follow its column less the mean over some rows (n,)."""
        assert part.follows is not None
        followed = self.followed(part)[used]
        self._means[_key_of_mean(part)] = float(followed[np.isfinite(followed)].mean())

    def _about_its_mean(self, part: CompiledPart) -> CompiledPart:
        if part.follows is None or _key_of_mean(part) not in self._means:
            return part
        text, place = part.follows
        return replace(part, follows=(f"{text} - ({self._means[_key_of_mean(part)]!r})", place))

    def followed(self, part: CompiledPart) -> Numbers:
        """Give the column that a part follows, without a lag, (n,)."""
        assert part.follows is not None
        return self._series[self._series_of_text(part.follows[0], None)]

    def carrier(self, part: CompiledPart, inner: Sequence[float]) -> Numbers:
        """Give what multiplies the column that a part is proportional to, (k, n), at values of inner parameters."""
        variables = self._variables(None)
        variables[-1] = 1.0
        return self._of_variables(part.expression, tuple([inner[place] for place in part.inner]), variables, None)

    def _parts(self, term: Term, part: Part) -> list[CompiledPart]:
        whole = self._part(term, part)
        if whole.follows is None:
            return [whole]
        is_proportional = self.is_proportional(whole, term)
        text, place = whole.follows
        match = _SERIES_TEXT.fullmatch(text)
        if match is None or not match[2].startswith("temp_") or not is_proportional:
            return [whole]
        if not all(np.isfinite(self.variables[self.names.index(name)]).all() for name in match.groups()):
            # A lag leaves out rows without a value: for a difference those where either has none.
            return [whole]
        return [
            replace(whole, factor=sign * whole.factor, follows=(f"{name} - 0.0", place))
            for name, sign in zip(match.groups(), (1.0, -1.0), strict=True)
        ]

    def is_proportional(self, part: CompiledPart, term: Term) -> bool:
        """Tell whether a part of a term is proportional to the column that it follows."""
        if part.expression not in self._proportional:
            expression = self.expression(part)
            inner = np.array([term.inner[place].middle for place in part.inner], dtype=np.float64)
            rows = np.unique(np.linspace(0, self.n_rows - 1, 50).round().astype(np.int64))
            variables = self._variables(None, rows)

            def at(value: float) -> Numbers:
                variables[-1] = value
                return expression.coefficient_columns(variables, inner, np.zeros(0, dtype=np.int64), None, 1)

            once = at(1.0)
            self._proportional[part.expression] = (
                not expression.needs_order
                and bool(np.isfinite(once).any())
                and all(
                    np.allclose(at(multiple), multiple * once, rtol=_PROPORTIONAL, atol=0.0, equal_nan=True)
                    for multiple in _MULTIPLES
                )
            )
        return self._proportional[part.expression]

    def _part(self, term: Term, part: Part) -> CompiledPart:
        """Compile a part of a term; one with the same text and definitions is compiled once."""
        follows, definitions = _without_series(term, _definitions_used(part))
        used = {name for text in (part.expression or "", *dict(definitions).values()) for name in names_in(text)}
        coefficients = tuple(place for place, one in enumerate(term.coefficients) if one.name in used)
        inner = tuple(place for place, one in enumerate(term.inner) if one.name in used)
        # Parameters by their places: one wave across and along an axis is one, whatever its amplitudes are called.
        names = {term.coefficients[place].name: f"coefficient_{number}" for number, place in enumerate(coefficients)}
        names |= {term.inner[place].name: f"inner_{number}" for number, place in enumerate(inner)}
        alike = replace(
            part,
            channel="tool-x",
            expression=_renamed(part.expression or "", names),
            definitions=tuple((name, _renamed(text, names)) for name, text in definitions),
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
            expression = core_part(stand_in, alike, (*self.names, _SERIES))[3]
            assert isinstance(expression, _core.Expression)
            self._compiled[key] = len(self._expressions)
            self._expressions.append(expression)
        return CompiledPart(part.channel, part.factor, self._compiled[key], coefficients, inner, follows)

    def expression(self, part: CompiledPart) -> _core.Expression:
        """Give a part's formula."""
        return self._expressions[part.expression]

    def needs_order(self, part: CompiledPart) -> bool:
        """Tell whether a part's formula is a recursion along rows."""
        return self.expression(part).needs_order or (part.follows is not None and part.follows[1] is not None)

    def formula(self, part: CompiledPart, inner: Sequence[float]) -> list[int]:
        """Give the codes of a part's functions, one for each of its coefficients, at values of the inner ones."""
        own = tuple([inner[place] for place in part.inner])
        first = self._trials.number((part.expression, own, self._series_number(part, inner))) * _SLOTS
        return [first + slot for slot in range(len(part.coefficients))]

    def _series_number(self, part: CompiledPart, inner: Sequence[float]) -> int | None:
        """Give the number of the column that a part's formula follows, at its time constant; made once."""
        if part.follows is None:
            return None
        text, place = part.follows
        return self._series_of_text(text, None if place is None else inner[place])

    def _series_of_text(self, text: str, tau_s: float | None) -> int:
        if (text, tau_s) not in self._series_of:
            if text not in self._lags:
                self._lags[text] = _core.Expression(f"c*lag({text}, tau)", list(self.names), ["c"], ["tau"], {})
            # A lag of no time is the column itself.
            own = np.array([0.0 if tau_s is None else tau_s])
            values = self._lags[text].coefficient_columns(self.variables, own, self.starts, self.times, 1)
            self._series_of[text, tau_s] = self._series.append(values[:, 0])
        return self._series_of[text, tau_s]

    def given(self, values: Numbers) -> int:
        """Name a function that is numbers (n,)."""
        self._given.append(values)
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
        own, series = tuple([inner[place] for place in part.inner]), self._series_number(part, inner)
        if rows is None:
            return self._evaluated(part.expression, own, series, None)
        key = (rows.tobytes(), part.expression, own, series)
        if key not in self._at_rows:
            self._at_rows[key] = self._evaluated(part.expression, own, series, rows)
        return self._at_rows[key]

    def _evaluated(
        self, expression: int, inner: tuple[float, ...], series: int | None, rows: np.ndarray | None
    ) -> Numbers:
        return self._of_variables(expression, inner, self._variables(series, rows), rows)

    def _of_variables(
        self, expression: int, inner: tuple[float, ...], variables: Numbers, rows: np.ndarray | None
    ) -> Numbers:
        starts, times = (self.starts, self.times) if rows is None else (_NO_STARTS, None)
        formula = self._expressions[expression]
        values = formula.coefficient_columns(variables, np.array(inner, dtype=np.float64), starts, times, 1).T
        return values if np.isfinite(values.sum()) else np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)

    def _variables(self, series: int | None, rows: np.ndarray | None = None) -> Numbers:
        """Give the columns of all variables, (k + 1, n), the series last; valid until the next call."""
        if rows is None:
            columns = self._columns
        else:
            key = rows.tobytes()
            if key not in self._columns_at:
                self._columns_at[key] = np.ascontiguousarray(self._columns[:, rows])
            columns = self._columns_at[key]
        if series is None:
            columns[-1] = 0.0
        else:
            columns[-1] = self._series[series] if rows is None else self._series[series][rows]
        return columns

    @property
    def variables(self) -> Numbers:
        """Columns of the variables by `names`, (k, n)."""
        return self._columns[:-1]

    def values(self, codes: Sequence[int]) -> Numbers:
        """Give functions by their codes, (k, n)."""
        return np.stack([self._value(int(code)) for code in codes])

    def _value(self, code: int) -> Numbers:
        if code < 0:
            if code % 2:
                return self._given[-code // 2]
            first, second = self._products[-code // 2 - 1]
            return self._given[first] * self._given[second]
        number, inner, series = self._trials[code // _SLOTS]
        expression = self._expressions[number]
        own = np.array(inner, dtype=np.float64)
        values = expression.coefficient_columns(self._variables(series), own, self.starts, self.times, 1)
        return np.nan_to_num(values[:, code % _SLOTS], nan=0.0, posinf=0.0, neginf=0.0)

    def scan(
        self,
        scene: _core.CandidateScene,
        groups: Sequence[tuple[np.ndarray, np.ndarray, Numbers, np.ndarray, int]],
        threads: int,
    ) -> list[tuple[Numbers, np.ndarray, Numbers, Numbers]]:
        """Let the core judge groups: codes (n_trials, k), channels, factors, coefficients, number of those."""
        codes = np.concatenate([np.zeros(0, dtype=np.int64), *(group[0].ravel() for group in groups)])
        own = codes >= 0
        formulas, place = np.unique(codes[own] // _SLOTS, return_inverse=True)
        counts = np.array([len(one.coefficients_used) for one in self._expressions], dtype=np.int64)
        first = np.concatenate([[0], np.cumsum(counts[self._trials.expressions(formulas)])])
        # By its place among the functions: those of formulas, those given, products.
        numbers = np.empty(len(codes), dtype=np.int64)
        numbers[own] = first[place] + codes[own] % _SLOTS
        other = -codes[~own]
        numbers[~own] = first[-1] + np.where(other % 2 == 1, other // 2, len(self._given) + other // 2 - 1)
        ends = np.cumsum([group[0].size for group in groups])
        return scene.scan(
            self._variables(None),
            self.starts,
            self.times,
            [(one, self._proportional.get(number, False)) for number, one in enumerate(self._expressions)],
            self._trials.chosen(formulas),
            self._series.array,
            self._given.array,
            self._products,
            [
                (numbers[end - group[0].size : end].reshape(group[0].shape), *group[1:])
                for end, group in zip(ends, groups, strict=True)
            ],
            threads,
        )


def _key_of_mean(part: CompiledPart) -> tuple[str, int, str]:
    assert part.follows is not None
    return part.channel, part.expression, part.follows[0]


def _without_series(
    term: Term, definitions: Sequence[tuple[str, str]]
) -> tuple[tuple[str, int | None] | None, tuple[tuple[str, str], ...]]:
    """Take the temperature out of a formula's definitions, if there is just one: over what, and its time constant."""
    inner = [one.name for one in term.inner]
    found: dict[str, tuple[str, int | None]] = {}
    for name, text in definitions:
        lagged = _LAGGED.fullmatch(text)
        if lagged is not None and lagged[2] in inner and not {*inner, *dict(definitions)} & set(names_in(lagged[1])):
            found[name] = (lagged[1].strip(), inner.index(lagged[2]))
        elif _SERIES_TEXT.fullmatch(text):
            found[name] = (text.strip(), None)
    if len(found) != 1:
        return None, tuple(definitions)
    name, follows = next(iter(found.items()))
    return follows, tuple((other, _SERIES if other == name else text) for other, text in definitions)


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
