"""Which physical effect is missing: what a diagnosis has found, its sentence and its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from geoerr.diagnose.answer import Answer, held_out_um
from geoerr.diagnose.between_passes import BetweenPasses
from geoerr.diagnose.comparison import Comparison
from geoerr.diagnose.findings import Finding, Unknown
from geoerr.diagnose.notes import is_without_errors, notes_of
from geoerr.diagnose.search import AskedFor, Searched, reference_of
from geoerr.diagnose.summary import diagnosis_html
from geoerr.diagnose.words import chance_words
from geoerr.drawing import drawn
from geoerr.errors import GeoerrError
from geoerr.fit import Fitted
from geoerr.fit.begun_warm import begun_warm
from geoerr.fit.sightings import Numbers
from geoerr.summaries import listed

if TYPE_CHECKING:
    import plotly.graph_objects as go

# Candidates that a sentence names.
_SPOKEN = 3
# A search that chance seldom equals has found something, also where nothing is worth its numbers.
_NO_CHANCE = 1e-3
# Less than this is left by chance in one search of twenty.
_SELDOM = 0.05


@dataclass(frozen=True, eq=False)
class Diagnosis(Answer):
    """What is missing in a model, by these measurements.

    Attributes
    ----------
    between_passes
        What does not come back from pass to pass, and what rows scatter, beside all that was found.
    as_it_was
        The fit that was given, or that of the model; `fitted` is the one that was searched, which has other bases
        beside a large effect.
    comparison
        The model held against the measurements; None where a fit was diagnosed.
    search
        What `searched` gives; None where it was let go.
    later_tied
        Of each that was found after the first, those that these data cannot tell from it; `tied` has the first's.
    other_way
        What the model that is held leaves has no name, and its numbers were fitted to these data, too: that answer,
        or, where that one has a name and is this, the one of the model as it is. None where one was enough.
    has_unread
        Whether nothing is missing where every temperature is known, and this is of all rows, without what follows a
        temperature that is unknown in some.
    rough
        Why a wave was not named where few places tell it: a sentence each.
    asked_for
        What was asked for by itself, beside the search: the play of axes that were measured both ways, where offsets
        of passes are strong.
    """

    found: tuple[Finding, ...]
    candidates: tuple[Finding, ...]
    unknown: Unknown | None
    between_passes: BetweenPasses
    as_it_was: Fitted
    comparison: Comparison | None = None
    search: Searched | None = None
    later_tied: tuple[tuple[Finding, ...], ...] = ()
    other_way: Diagnosis | None = None
    has_unread: bool = False
    rough: tuple[str, ...] = ()
    asked_for: tuple[AskedFor, ...] = ()

    @property
    def searched(self) -> Searched:
        """Every number behind it.

        Raises
        ------
        GeoerrError
            where they were let go.
        """
        if self.search is None:
            raise GeoerrError(
                "the numbers behind this diagnosis were let go\nhint: diagnose again, and keep what that gives"
            )
        return self.search

    def without_numbers(self) -> Diagnosis:
        """Give what it says alone: the numbers behind it are, of 100,000 points, gigabytes."""
        return replace(self, search=None)

    @cached_property
    def held_out_rmse_um(self) -> float | None:
        """Held-out error of the model as it was."""
        return held_out_um(self.as_it_was)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What one has to know before trusting it: sentences, without a full stop."""
        notes = notes_of(
            self.as_it_was,
            self.comparison,
            has_found=bool(self.found) or self.unknown is not None,
            blames_cameras=any(one.is_rig for one in (*self.found, *self.tied)),
            other_way=self.other_way,
            has_unread=self.has_unread,
            rough=self.rough,
        )
        return (*notes, *begun_warm(self.as_it_was, [one.term for one in self.found]))

    @property
    def takes_part(self) -> bool:
        """Whether the model's own numbers were fitted to these data, or only measuring frames were."""
        return self.comparison is None or not self.comparison.is_held

    @property
    def is_without_errors(self) -> bool:
        """Whether points were held against a machine without errors: the 21 are to be fitted first."""
        return is_without_errors(self.as_it_was, self.comparison)

    @property
    def tied(self) -> tuple[Finding, ...]:
        """The first candidate and those that these data cannot tell from it; none where nothing was found."""
        return (self.candidates[0], *(one for one in self.candidates[1:] if one.tied)) if self.found else ()

    def tied_with(self, finding: Finding) -> tuple[Finding, ...]:
        """Give what these data cannot tell from something that was found."""
        place = next(number for number, one in enumerate(self.found) if one.reference == finding.reference)
        return self.tied[1:] if place == 0 else self.later_tied[place - 1]

    @property
    def not_told_apart(self) -> tuple[Finding, ...]:
        """Everything that these data cannot tell from something that was found, each once, and none of the latter."""
        found = {one.reference for one in self.found}
        every = {rival.reference: rival for one in self.found for rival in self.tied_with(one)}
        return tuple(rival for reference, rival in every.items() if reference not in found)

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        more = "" if self.unknown is None else "; and there is more, which no known effect explains"
        if self.verdict == "missing":
            names = listed([one.company_words for one in self.found])
            return f"{'an effect is' if len(self.found) == 1 else 'effects are'} missing: {names}{more}"
        if self.verdict == "ambiguous":
            others = [_either(self._alternatives(one)) for one in self.found[1:]]
            if len(self.tied) > 1:
                also = f"; missing besides: {listed(others)}" if others else ""
                names = listed(self._alternatives(self.found[0]), "or")
                return f"an effect is missing, and these data cannot tell which: {names}{also}{more}"
            names = listed([self.found[0].company_words, *others])
            return f"effects are missing, and these data cannot tell all of them: {names}{more}"
        if self.unknown is not None:
            return self.unknown.sentence
        noise = f"; {self.between_passes.short_words}" if self.between_passes.stands_out else ""
        if self.p_value is not None and self.p_value <= _NO_CHANCE:
            return (
                "nothing can be named, though what is left is more than chance "
                f"({chance_words(self.p_value)}): more passes would show what it is{noise}"
            )
        if self.p_value is not None and self.p_value < _SELDOM:
            return (
                "nothing is missing that these data could show for certain, though chance seldom leaves as much "
                f"({chance_words(self.p_value)}): more passes would tell{noise}"
            )
        return f"nothing is missing that these data could show: {chance_words(self.p_value)}{noise}"

    @property
    def asked_words(self) -> tuple[str, ...]:
        """What was asked for by itself, is not told and has more than nothing: each with its own probability."""
        told = {one.reference for one in (*self.found, *self.not_told_apart)}
        return tuple(one.words() for one in self.asked_for if one.p_value < 1.0 and one.reference not in told)

    def compared(self, reference: str, other: str) -> tuple[Numbers, tuple[Numbers, ...]]:
        """Give what was found, and what another candidate could make of it: their cosine is the correlation told.

        Parameters
        ----------
        reference, other
            What was found, and one of what came next to it: `backlash:x`.

        Returns
        -------
        tuple
            What the first explains, (3 n,), off the model and in the metric of the noise of the look that found it;
            and columns (3 n, k), orthonormal off the model, of what the other can do: where it was scanned, and at
            its best values. The larger share is told. Of one that does so only with others it is what all of them
            do.

        Raises
        ------
        GeoerrError
            where the one was not found, the other is none of what came next to it, or the numbers were let go.
        """
        found = {str(reference_of(one.judged)): one for one in self.searched.found}
        if reference not in found:
            hint = listed(list(found), "or") or "nothing was"
            raise GeoerrError(f"{reference} was not found\nhint: {hint}")
        rivals = {str(reference_of(one.judged)): one for one in found[reference].rivals}
        if other not in rivals:
            hint = listed(list(rivals), "or") or "none"
            raise GeoerrError(f"{other} is none of what came next to {reference}\nhint: one of {hint}")
        return found[reference].compared_with(rivals[other])

    def _alternatives(self, finding: Finding) -> list[str]:
        """Name what was found and what looks the same, a few of many."""
        told = list(dict.fromkeys(one.company_words for one in (finding, *self.tied_with(finding))))
        return told if len(told) <= _SPOKEN else [*told[:_SPOKEN], f"{len(told) - _SPOKEN} more"]

    def plot_worth(self) -> go.Figure:
        """Draw what each candidate is worth, and the held-out error without it and with it.

        Raises
        ------
        GeoerrError
            where there is no candidate.
        """
        return drawn("diagnosis_bars", self)

    def plot_fall(self) -> go.Figure:
        """Draw how the held-out error would fall if what was found were added, one after the other."""
        return drawn("diagnosis_fall", self)

    def plot_unknown(self) -> go.Figure:
        """Draw what has no name: its curve or surface.

        Raises
        ------
        GeoerrError
            where everything has a name.
        """
        return drawn("unknown_curve", self)

    def _repr_html_(self) -> str:
        """Show the verdict and the candidates, for a notebook."""
        return diagnosis_html(self)

    def to_document(self) -> dict[str, Any]:
        """Give it as `diagnose --json` has it, and more."""
        return {
            **super().to_document(),
            "sentence": self.sentence,
            "asked_for": [one.to_document() for one in self.asked_for],
            "between_passes": self.between_passes.to_document(),
            "model_takes_part": self.takes_part,
            "other_way": None if self.other_way is None else self.other_way.in_short(),
            "notes": list(self.notes),
        }

    def in_short(self) -> dict[str, Any]:
        """Give the verdict alone, as `diagnose --json` has it of the other way."""
        return {
            "model_takes_part": self.takes_part,
            "verdict": self.verdict,
            "p_value": self.p_value,
            "held_out_rmse_um": self.held_out_rmse_um,
            "sentence": self.sentence,
        }


def _either(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"either {listed(names, 'or')}"
