"""What follows temperatures that hardly change is judged about their mean, where the model has the rest.

Why, and where: `geoerr.fit.steady`. Here for all candidates of a search at once, of which many have one formula.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeAlias

import numpy as np

from geoerr import _core
from geoerr.diagnose.functions import CompiledPart, Functions
from geoerr.diagnose.space import Channels, freedom_of
from geoerr.fit.fitted import Fitted
from geoerr.fit.owned import are_owned
from geoerr.fit.sightings import Numbers
from geoerr.fit.steady import ends_and_middle, is_steady
from geoerr.terms import Parameter, Term

# A channel, and the number of a formula.
_Key: TypeAlias = tuple[str, int]
# Columns that are held against the model at a time.
_TOGETHER = 64


def judge_about_means(fitted: Fitted, functions: Functions, terms: Iterable[Term]) -> None:
    """Let what follows a steady temperature be judged about its mean, where a fit owns what it is multiplied with."""
    used = fitted.solved.used
    following: dict[_Key, list[CompiledPart]] = {}
    carriers: dict[_Key, dict[tuple[float, ...], Numbers]] = {}
    for term, parts in _of_steady(functions, terms, used):
        first = parts[0]
        key = first.channel, first.expression
        following.setdefault(key, []).extend(parts)
        columns = carriers.setdefault(key, {})
        for inner in _some_values(term.inner, first):
            # Whatever temperature it follows: many terms have one formula.
            values = tuple(inner[place] for place in first.inner)
            if values not in columns:
                columns[values] = functions.carrier(first, inner)
    if not carriers:
        return
    owned = _are_owned(fitted, {key: np.concatenate([*columns.values()]) for key, columns in carriers.items()})
    for key, own in following.items():
        if owned[key]:
            for one in own:
                functions.center(one, used)


def _of_steady(
    functions: Functions, terms: Iterable[Term], used: np.ndarray
) -> Iterator[tuple[Term, list[CompiledPart]]]:
    """Give every part of a term that is proportional to a steady temperature, compiled, with its term."""
    for term in terms:
        if term.covariate is None:
            continue
        for part in term.parts:
            parts = functions.parts(term, part)
            if parts[0].follows is None or not functions.is_proportional(parts[0], term):
                continue
            if _is_steady(_followed(functions, parts)[used]):
                yield term, parts


def _followed(functions: Functions, parts: Sequence[CompiledPart]) -> Numbers:
    """Give what a part follows, (n,): of two that are one difference of temperatures the difference."""
    columns = [np.sign(one.factor * parts[0].factor) * functions.followed(one) for one in parts]
    return np.asarray(np.sum(columns, axis=0))


def _is_steady(values: Numbers) -> bool:
    known = values[np.isfinite(values)]
    return bool(len(known)) and bool(is_steady(known.var(), (known**2).mean()))


def _some_values(inner: Sequence[Parameter], part: CompiledPart) -> Iterable[list[float]]:
    """Give all inner parameters of a term at ends and middles of those that a part has."""
    choices = [ends_and_middle(one) if place in part.inner else [one.middle] for place, one in enumerate(inner)]
    return map(list, itertools.product(*choices))


def _are_owned(fitted: Fitted, columns: dict[_Key, Numbers]) -> dict[_Key, bool]:
    """Tell of columns (k, n) by their channel whether the model leaves less of each than it does of anything."""
    rows = (fitted.sightings.is_measured & fitted.solved.used[:, None]).astype(np.float64)
    channels = Channels(fitted, rows, threads=fitted.threads)
    channels.need([channel for channel, _ in columns])
    basis = freedom_of(fitted, fitted.solved.used, threads=fitted.threads).reshape(rows.size, -1)
    owned = dict.fromkeys(columns, True)
    listed = [(key, column) for key, own in columns.items() for column in own]
    for start in range(0, len(listed), _TOGETHER):
        some = listed[start : start + _TOGETHER]
        moved = np.stack([(channels[key[0]] * column[:, None]).ravel() for key, column in some], axis=1)
        inside = _core.products_of_columns(basis, moved, fitted.threads)
        squares = np.einsum("nk,nk->k", moved, moved)
        for (key, _), is_owned in zip(some, are_owned(squares, inside), strict=True):
            owned[key] = owned[key] and bool(is_owned)
    return owned
