"""The sets of the study: which seed, plan, noise and hidden effect each of them has. Chains are drawn.

A set is found by its part, its cell (a row of a table) and its number within that. The three plans take turns; where
one cannot show an effect the next is tried, then the next seed, and so on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from validation.hidden_effects.cases import development_seed, study_seed
from validation.hidden_effects.changed import CHANGED
from validation.hidden_effects.generate import KINDS, CannotCarryError, Case, Hidden, generate
from validation.hidden_effects.listed import LISTED
from validation.hidden_effects.unlisted import UNLISTED

NULL_NOISES = (
    *("gauss-3", "gauss-10", "gauss-30", "heavy-tails", "outliers", "unequal-depth"),
    *("offsets-3", "offsets-8", "drift-2"),
)
# 10 µm, alone and with offsets of passes and drift.
EFFECT_NOISES = ("gauss-10", "offsets-3", "drift-2", "offsets-3+drift-2")
STRENGTHS_UM = (1.0, 2.0, 4.0, 8.0)
# Three and ten times the noise: what a machine that nobody has corrected shows.
LARGE_STRENGTHS_UM = (30.0, 100.0)
UNLISTED_STRENGTHS_UM = (2.0, 4.0, 8.0)
PAIR_STRENGTH_UM = 4.0
OFF_FORMULA, OFF_STRENGTH_UM = 0.3, 8.0
# The volume is seen from the floor and from the work by turns.
PLAN_ORDER = ("nine-lines", "volume-relative", "mixed", "nine-lines", "volume-floor", "mixed")
PARTS = ("nulls", "single", "pairs", "off-formula", "unlisted", "large", "changed")
# How many sets each cell has by default.
USUAL_NUMBER = {
    "nulls": 200,
    "single": 20,
    "pairs": 200,
    "off-formula": 20,
    "unlisted": 20,
    "large": 20,
    "changed": 20,
}
_SEEDS_OF_A_PART, _SEEDS_OF_A_SET = 100_000, 10


@dataclass(frozen=True)
class Set:
    """One data set of the study.

    Attributes
    ----------
    part, cell, number
        Where it stands; `cell` is a noise or a kind of effect.
    index
        Number within the part: decides the seed.
    noise, hidden, strength_um
        As in `generate`.
    """

    part: str
    cell: str
    number: int
    index: int
    noise: str
    hidden: tuple[Hidden, ...]
    strength_um: float

    @property
    def key(self) -> str:
        """Give its name in a file of results."""
        return f"{self.part}/{self.cell}/{self.strength_um:g}/{self.number}"

    def case(self, n_rows: int, *, is_study: bool) -> Case:
        """Generate it.

        Raises
        ------
        CannotCarryError
            where none of the seeds that belong to the set gives a plan that shows the effect.
        """
        first = PARTS.index(self.part) * _SEEDS_OF_A_PART + self.index * _SEEDS_OF_A_SET
        why = CannotCarryError("no seed was tried")
        for attempt in range(_SEEDS_OF_A_SET):
            number = first + attempt
            seed = study_seed(number) if is_study else development_seed(number)
            plan = PLAN_ORDER[(self.index + attempt) % len(PLAN_ORDER)]
            try:
                return generate(seed, None, plan, self.noise, self.hidden, self.strength_um, n_rows)
            except CannotCarryError as refused:
                why = refused
        raise why


def sets_of(part: str, n_each: int | None = None, kinds: Sequence[str] = ()) -> Iterator[Set]:
    """Give the sets of a part, cells by turns so that a cut run holds some of each.

    Parameters
    ----------
    n_each
        Sets of each cell; None = `USUAL_NUMBER`.
    kinds
        Kinds of effect (noises for `nulls`) to keep; none = all.
    """
    n_each = USUAL_NUMBER[part] if n_each is None else n_each
    usual = USUAL_NUMBER[part]
    for number in range(n_each):
        for place, (cell, hidden, strength_um) in enumerate(_cells(part, number)):
            if kinds and cell not in kinds and not {one.kind for one in hidden} & set(kinds):
                continue
            index = place * max(usual, n_each) + number
            noise = cell if part == "nulls" else EFFECT_NOISES[(number + place) % len(EFFECT_NOISES)]
            yield Set(part, cell, number, index, noise, hidden, strength_um)


def single_set(kind: str, number: int, strength_um: float) -> Set:
    """Give one set of the part `single`: the one of that number and strength of a kind of effect."""
    return next(
        one
        for one in sets_of("single", number + 1, [kind])
        if one.number == number and one.strength_um == strength_um
    )


def _cells(part: str, number: int) -> Iterator[tuple[str, tuple[Hidden, ...], float]]:
    if part == "nulls":
        yield from ((noise, (), 0.0) for noise in NULL_NOISES)
    elif part in ("single", "large"):
        sizes = STRENGTHS_UM if part == "single" else LARGE_STRENGTHS_UM
        yield from ((kind, (Hidden(kind),), size) for kind in LISTED.kinds for size in sizes)
    elif part == "pairs":
        yield "pair", _pair(number), PAIR_STRENGTH_UM
    elif part == "off-formula":
        even = [kind for kind in LISTED.kinds if KINDS[kind].off_axis]
        yield from ((kind, (Hidden(kind, off_formula=OFF_FORMULA),), OFF_STRENGTH_UM) for kind in even)
    elif part == "changed":
        yield from ((kind, (Hidden(kind),), size) for kind in CHANGED.kinds for size in STRENGTHS_UM)
    else:
        yield from ((kind, (Hidden(kind),), size) for kind in UNLISTED.kinds for size in UNLISTED_STRENGTHS_UM)


def _pair(number: int) -> tuple[Hidden, Hidden]:
    """Draw two kinds that are not of one effect."""
    rng = np.random.default_rng(number)
    kinds = [*LISTED.kinds.values()]
    while True:
        first, second = (kinds[int(place)] for place in rng.integers(0, len(kinds), 2))
        if first.effect != second.effect:
            return Hidden(first.name), Hidden(second.name)
