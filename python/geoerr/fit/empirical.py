"""Curves without a cause: a smooth dependence on one variable, two or three, for what no known effect explains.

`empirical:x@feed` displaces the tool along x by a low polynomial of the feed, `empirical:z@x*y` by polynomials of x
and y and their products; `work-x` displaces the work. A curve says what happens, not why: it holds for what was
measured (beyond the range of its variables it keeps its end value) and for nothing else.

| symbol | code | what |
|---|---|---|
| P_i | `_legendre` | Legendre's polynomials of u, the variable brought to −1 ... 1 over its range |

How many polynomials there are is chosen by Schwarz's evidence: all up to some degree of each variable, and more
beside those as long as that has evidence, too. Those that the model does already are left out, one by one from the
lowest degree, so that no coefficient is open. Over the time `t` a wave may have more of it (`empirical_wave`).

Of a model that has the curve already the polynomials that have evidence beside it make it finer (`finer_term`).
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from geoerr import _core
from geoerr.effects.definitions import number_text
from geoerr.errors import GeoerrError, InputFileError
from geoerr.fit.empirical_wave import TIME, EmpiricalWave, turn_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.seen import Seen
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import variable_columns
from geoerr.machine import AXES
from geoerr.model.compile import core_part
from geoerr.summaries import listed
from geoerr.terms import (
    EMPIRICAL,
    RAW_VARIABLES,
    EffectReference,
    Parameter,
    Part,
    Term,
    parse_effect_reference,
)

T = TypeVar("T")

# Highest degree of each variable, by their number.
_MOST_DEGREES = {1: 8, 2: 8, 3: 3}
# A polynomial of which the model and the lower ones leave a smaller share (of its sum of squares) is theirs.
_OWNED = 0.01
# Values nearer than this share of the span are one.
_ALIKE = 1e-9
# Points along each variable, by their number.
_POINTS = {1: 41, 2: 17, 3: 9}
_UM_PER_MM = 1e3


def is_empirical(reference: str) -> bool:
    """Tell whether a reference names a curve and no effect."""
    return reference.partition(":")[0].partition("@")[0] == EMPIRICAL


def empirical_term(fitted: Fitted, reference: str | EffectReference) -> Term:
    """Design a curve for what a fit leaves; its values are unknown.

    Parameters
    ----------
    fitted
        The fit of the model without it.
    reference
        `empirical:COMPONENT@VARIABLE`, of two or three variables with `*` between them; a variable is a position
        (`x`), a direction (`d_x`), travel (`s_x`), speed (`v_x`), the time `t` or a column of the data.

    Raises
    ------
    InputFileError
        for another reference, a variable that the data do not have or that never changes, or a curve of which the
        model leaves nothing.
    """
    parsed = parse_effect_reference(reference) if isinstance(reference, str) else reference
    channel, variables = _channel(parsed), _variables(parsed, fitted)
    seen = Seen(fitted, channel)
    design = _Design.of(seen, variables)
    degrees, evidence = design.best()
    if not degrees and not design.size.any():
        body = "work" if channel.startswith("work") else "tool"
        other = f"work-{channel[-1]}" if body == "tool" else channel[-1]
        raise InputFileError(
            str(parsed),
            f"nothing in these data shows where the {body} is",
            remedy=f"write {EMPIRICAL}:{other}@{parsed.covariate}, which they can show",
        )
    if not degrees:
        raise InputFileError(
            str(parsed),
            "the model does that already, as far as these data can tell",
            remedy="name a variable that the model does not have, or another component",
        )
    wave = EmpiricalWave.of(seen) if parsed.covariate == TIME else None
    if wave is not None and wave.evidence > evidence:
        return wave.term(parsed, channel, f"Empirical wave: {_along(channel)} over time, cause unknown")
    return _term(parsed, channel, variables, degrees)


def curve_in(terms: Sequence[Term], reference: str | EffectReference) -> Term | None:
    """Give the curve of the same displacement over the same variables, in whatever order, that terms have already."""
    parsed = parse_effect_reference(reference) if isinstance(reference, str) else reference
    channel, names = _channel(parsed), sorted(_names(parsed))
    return next(
        (
            term
            for term in terms
            if term.kind == "empirical"
            and term.channels == (channel,)
            and sorted((term.covariate or "").split("*")) == names
        ),
        None,
    )


def can_be_finer(term: Term) -> bool:
    """Tell whether polynomials can be put into a curve: not into a wave, nor one that was written in another way."""
    return not term.inner and len(_degrees_of(term)) == len(term.coefficients)


def finer_part(fitted: Fitted, own: Term) -> Term | None:
    """Give what a curve of a fit lacks as a term of another id; None where these data have no evidence of more.

    Beside what cannot be made finer it is a curve of its own.

    Raises
    ------
    InputFileError
        as `empirical_term`.
    """
    beside = f"{own.id}:finer"
    if not can_be_finer(own):
        return replace(empirical_term(fitted, own.id), id=beside)
    parsed = parse_effect_reference(own.id)
    channel, variables = _channel(parsed), _variables(parsed, fitted)
    degrees, evidence = _Design.of(Seen(fitted, channel), variables).best()
    if not degrees or evidence <= 0.0:
        return None
    return replace(_term(parsed, channel, variables, degrees), id=beside)


def finer_term(fitted: Fitted, own: Term) -> Term | None:
    """Give a curve of a fit with the polynomials that it lacks, values unknown.

    None where these data have no evidence of more, or it cannot be made finer.
    """
    part = finer_part(fitted, own) if can_be_finer(own) else None
    if part is None:
        return None
    parsed = parse_effect_reference(own.id)
    degrees = sorted({*_degrees_of(own), *_degrees_of(part)}, key=_from_the_lowest)
    return _term(parsed, _channel(parsed), _variables(parsed, fitted), degrees)


def _term(
    parsed: EffectReference, channel: str, variables: Sequence[_Variable], degrees: Sequence[tuple[int, ...]]
) -> Term:
    """Write a curve of these polynomials."""
    letter = _free_letter("c", [one.name for one in variables])
    coefficients = [Parameter(letter + "_".join(map(str, degree)), "mm") for degree in degrees]
    products = [
        "*".join([one.name, *(v.name_of(n) for n, v in zip(degree, variables, strict=True) if n)])
        for one, degree in zip(coefficients, degrees, strict=True)
    ]
    definitions = tuple(
        definition
        for one, own in zip(variables, zip(*degrees, strict=True), strict=True)
        for definition in one.definitions(sorted({*own}))
    )
    return Term(
        id=str(parsed),
        title=f"Empirical curve: {_along(channel)} over {listed([one.name for one in variables])}, cause unknown",
        kind="empirical",
        effect=None,
        axis=parsed.axis,
        covariate=parsed.covariate,
        parts=(Part(channel, " + ".join(products), definitions),),
        coefficients=tuple(coefficients),
        source="user",
    )


def _along(channel: str) -> str:
    return f"the {'work' if channel.startswith('work') else 'tool'} along {channel[-1]}"


def _degrees_of(term: Term) -> list[tuple[int, ...]]:
    """Read the degrees of a curve's polynomials from the names of their coefficients: `c1_3` is of degrees 1 and 3.

    None of what was written in another way.
    """
    named = [re.fullmatch(r"c_*(\d+(?:_\d+)*)", parameter.name) for parameter in term.coefficients]
    return [tuple(map(int, one.group(1).split("_"))) for one in named if one is not None]


@dataclass(frozen=True, eq=False)
class Curve:
    """An empirical term's values over its variables, for tables and pictures.

    Attributes
    ----------
    component
        `x`, `y` or `z` of the base axes.
    variables
        Names of one, two or three.
    at
        Values of each variable, rising.
    value_um, std_um
        Displacement and its standard error; (m,) over one variable, (m, k) over two, (m, k, l) over three.
    period
        Of a wave in time, of which `at` is one turn; None of a curve.
    """

    component: str
    variables: tuple[str, ...]
    at: tuple[Numbers, ...]
    value_um: Numbers
    std_um: Numbers
    period: Parameter | None = None

    @property
    def cut_along(self) -> int:
        """Place of the variable at values of which three are drawn over two: the first that is no position, or z."""
        return next((place for place, name in enumerate(self.variables) if name not in AXES), len(self.variables) - 1)

    @property
    def largest_cut(self) -> int:
        """Place along `cut_along` at which the surface over the others swings most."""
        others = tuple(place for place in range(len(self.at)) if place != self.cut_along)
        return int(np.argmax(np.ptp(self.value_um, axis=others)))

    def cut(self, place: int) -> Curve:
        """Give the curve over the other variables at one value of that which `cut_along` names."""
        along = self.cut_along

        def others(values: tuple[T, ...]) -> tuple[T, ...]:
            return values[:along] + values[along + 1 :]

        value_um, std_um = (np.take(values, place, axis=along) for values in (self.value_um, self.std_um))
        return Curve(self.component, others(self.variables), others(self.at), value_um, std_um)

    def to_document(self) -> dict[str, object]:
        """Give plain values."""
        period = self.period
        return {
            "component": self.component,
            "variables": list(self.variables),
            "at": [own.tolist() for own in self.at],
            "value_um": self.value_um.tolist(),
            "std_um": self.std_um.tolist(),
            "period": None if period is None else {"value": period.value, "std": period.std, "unit": period.unit},
        }


def curve_of(fitted: Fitted, term_id: str) -> Curve:
    """Give the curve of an empirical term of a fit, with its standard error.

    Raises
    ------
    GeoerrError
        where the fit has no such term, or one that is no curve.
    """
    place = next((n for n, term in enumerate(fitted.terms) if term.id == term_id), None)
    if place is None or fitted.terms[place].kind != "empirical":
        raise GeoerrError(f"{term_id} is no empirical curve of this fit")
    term, own = fitted.terms[place], fitted.compiled.coefficient_slices[place]
    names = (term.covariate or "").split("*")
    period = term.inner[0] if term.inner else None
    if term.inner:
        along, functions = turn_of(term, _POINTS[1])
        at: tuple[Numbers, ...] = (along,)
    else:
        known = variable_columns(fitted.sightings, names)
        at = tuple(_spread_out(values[np.isfinite(values)], len(names)) for values in known)
        grid = np.stack([one.ravel() for one in np.meshgrid(*at, indexing="ij")])
        _, _, _, formula, _, _ = core_part(term, term.parts[0], names)
        assert isinstance(formula, _core.Expression)
        functions = formula.coefficient_columns(grid, np.zeros(0), np.zeros(1, dtype=np.int64), None, 1)
    theta = np.array([parameter.value for parameter in term.coefficients])
    variance = np.einsum("ni,ij,nj->n", functions, fitted.covariance[own, own], functions)
    shape = tuple(len(values) for values in at)
    return Curve(
        term.parts[0].channel[-1],
        tuple(names),
        at,
        (_UM_PER_MM * functions @ theta).reshape(shape),
        (_UM_PER_MM * np.sqrt(np.maximum(variance, 0.0))).reshape(shape),
        period,
    )


@dataclass(frozen=True)
class _Variable:
    """A variable and its range: u = (variable − middle)/half, held between −1 and 1."""

    name: str
    symbol: str
    middle: float
    half: float
    n_values: int

    @classmethod
    def over(cls, name: str, symbol: str, values: Numbers) -> _Variable:
        low, high = float(values.min()), float(values.max())
        apart = np.diff(np.unique(values)) > _ALIKE * (high - low)
        return cls(name, symbol, 0.5 * (low + high), 0.5 * (high - low), int(apart.sum()) + 1)

    def name_of(self, degree: int) -> str:
        """Give the name of the polynomial of a degree in formulas."""
        return self.symbol if degree == 1 else f"{self.symbol}_{degree}"

    def definitions(self, degrees: Sequence[int]) -> list[tuple[str, str]]:
        """Write the variable and its polynomials, in a formula's definitions."""
        unit = f"min(max(({self.name} - {number_text(self.middle)})/{number_text(self.half)}, -1), 1)"
        return [(self.symbol, unit), *((self.name_of(n), _legendre(n, self.symbol)) for n in degrees if n > 1)]

    def unit(self, values: Numbers) -> Numbers:
        return np.asarray(np.clip((values - self.middle) / self.half, -1.0, 1.0))


def _channel(reference: EffectReference) -> str:
    if reference.effect != EMPIRICAL or reference.covariate is None:
        raise InputFileError(str(reference), "names no curve", remedy=f"write {EMPIRICAL}:x@feed")
    directions_of = {axis: f"tool-{axis}" for axis in AXES} | {f"work-{axis}": f"work-{axis}" for axis in AXES}
    if reference.axis not in directions_of:
        raise InputFileError(
            str(reference), "does not say along which axis it acts", remedy=f"write {EMPIRICAL}:x@feed, or work-x"
        )
    return directions_of[reference.axis]


def _names(reference: EffectReference) -> list[str]:
    assert reference.covariate is not None
    return reference.covariate.split("*")


def _variables(reference: EffectReference, fitted: Fitted) -> list[_Variable]:
    sightings = fitted.sightings
    names = _names(reference)
    letter = _free_letter("u", names)
    found = []
    for number, name in enumerate(names):
        if name not in RAW_VARIABLES and name not in sightings.free_columns:
            raise InputFileError(
                str(reference),
                _why_no_variable(sightings, name),
                remedy=f"such columns are {', '.join(sightings.free_columns) or 'not there'}; "
                "positions are x, directions d_x, travel s_x, speeds v_x",
            )
        values = variable_columns(sightings, [name])[0]
        values = values[np.isfinite(values) & fitted.solved.used]
        if not values.size or np.ptp(values) <= _ALIKE * max(float(np.abs(values).max()), 1e-300):
            raise InputFileError(
                str(reference), f"{name} never changes in these data", remedy="name another variable"
            )
        found.append(_Variable.over(name, f"{letter}_{number + 1}", values))
    return found


def _why_no_variable(sightings: Sightings, name: str) -> str:
    if name in sightings.covariate_columns:
        return f"{name} says where a row stands, which no curve can follow"
    if name in sightings.table.columns:
        return f"the column {name} holds no numbers"
    return f"the data have no column {name}"


def _free_letter(letter: str, names: Sequence[str]) -> str:
    """Give a beginning of names of our own, with which none of the data's begins."""
    while any(name.startswith(letter) for name in names):
        letter += "_"
    return letter


class _Design:
    """The polynomials at the rows of the data, off the model."""

    def __init__(self, seen: Seen, variables: Sequence[_Variable], values: Numbers) -> None:
        self.variables, self.seen = variables, seen
        self.most = _MOST_DEGREES[len(variables)]
        known = np.isfinite(values).all(axis=0) & seen.used
        unit_values = [
            np.where(known, one.unit(np.nan_to_num(own)), 0.0) for one, own in zip(variables, values, strict=True)
        ]
        self.degrees = self._all_degrees()
        functions = np.stack([_rowwise(unit_values, degree) for degree in self.degrees]) * known
        self.size, self.gram, self.along = seen.off(functions)

    @classmethod
    def of(cls, seen: Seen, variables: Sequence[_Variable]) -> _Design:
        values = variable_columns(seen.fitted.sightings, [one.name for one in variables])
        return cls(seen, variables, np.asarray(values))

    def _all_degrees(self) -> list[tuple[int, ...]]:
        """Give all degrees, the lowest first: of several variables products before what fewer of them do."""
        tops = [min(self.most, one.n_values - 1) for one in self.variables]
        every = itertools.product(*(range(top + 1) for top in tops))
        return sorted(filter(any, every), key=_from_the_lowest)

    def best(self) -> tuple[list[tuple[int, ...]], float]:
        """Give the degrees of the design with the most evidence, and that; none where the model owns them all.

        All up to some degree of each variable, and beside them all up to others, as long as that has more: what goes
        far along one variable and little along the other would cost too many where every product is bought at once.
        """
        found: list[int] = []
        most = -math.inf
        while True:
            best = max(self._designs_beside(found), key=lambda one: one[0], default=(most, found))
            if not best[0] > most:
                return [self.degrees[place] for place in sorted(found)], most
            most, found = best

    def _designs_beside(self, kept: Sequence[int]) -> Iterator[tuple[float, list[int]]]:
        """Give places in `degrees` with their evidence: those that are kept, and all up to some degrees beside."""
        for tops in itertools.product(range(1, self.most + 1), repeat=len(self.variables)):
            inside = [all(n <= top for n, top in zip(degree, tops, strict=True)) for degree in self.degrees]
            own = self._determined(kept, [place for place in range(len(inside)) if inside[place]])
            if own:
                yield self.seen.evidence(self.gram[np.ix_(own, own)], self.along[own]), own

    def _determined(self, kept: Sequence[int], places: Sequence[int]) -> list[int]:
        """Give those of which something is left when the model and those before have taken theirs."""
        own = list(kept)
        for place in places:
            if place in own:
                continue
            left = self.gram[place, place]
            if own:
                cross = self.gram[own, place]
                left -= cross @ np.linalg.solve(self.gram[np.ix_(own, own)], cross)
            if self.size[place] > 0.0 and left > _OWNED * self.size[place] ** 2:
                own.append(place)
        return own


def _from_the_lowest(degree: tuple[int, ...]) -> tuple[int, int, tuple[int, ...]]:
    return (max(degree), degree.count(0), degree)


def _legendre(degree: int, symbol: str) -> str:
    """Write Legendre's polynomial."""
    powers = np.polynomial.legendre.leg2poly(np.eye(degree + 1)[degree])
    texts = []
    for power, factor in reversed(list(enumerate(powers.tolist()))):
        if factor == 0.0:
            continue
        name = "" if power == 0 else symbol if power == 1 else f"{symbol}^{power}"
        size = f"{abs(factor)!r}"
        text = size if not name else name if abs(factor) == 1.0 else f"{size}*{name}"
        texts.append(f"{'-' if factor < 0 else '+'} {text}")
    joined = " ".join(texts).removeprefix("+ ")
    return joined if len(texts) == 1 else f"({joined})"


def _rowwise(units: Sequence[Numbers], degree: tuple[int, ...]) -> Numbers:
    result = np.ones(len(units[0]))
    for values, n in zip(units, degree, strict=True):
        result = result * np.polynomial.legendre.legval(values, np.eye(n + 1)[n])
    return result


def _spread_out(values: Numbers, n_variables: int) -> Numbers:
    """Give the values themselves where they are few, else an even spread over their range."""
    most = _POINTS[n_variables]
    levels = np.unique(values)
    return levels if len(levels) <= most else np.linspace(levels[0], levels[-1], most)
