"""Where an effect is worth most: the line, the place, the end of an axis, the conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geoerr.diagnose.moments import span_words
from geoerr.diagnose.space import Space
from geoerr.fit.lengths import is_told, of_whole_lengths
from geoerr.fit.sightings import Numbers, Sightings
from geoerr.fit.variables import variable_columns
from geoerr.machine import AXES
from geoerr.summaries import number_words
from geoerr.terms import CLOCK_NAME, RAW_VARIABLES, Term, is_motion

UM_PER_MM = 1e3
_PARTS = ("low", "middle", "high")
# An effect that is so much larger in one third of a variable than in the least of them is named with that third.
_LARGER = 1.6
_MOST_SPANS = 2
_TIMES = ("t", CLOCK_NAME)
# A line is named where its share of the effect is so much more than the mean.
_STANDS_OUT = 1.2


@dataclass(frozen=True)
class Span:
    """The third of a variable's range (`low`, `middle`, `high`) in which an effect is largest, and its ends."""

    variable: str
    part: str
    low: float
    high: float
    rms_um: float
    # Of a span of the clock of all sessions: when it begins and ends on the sessions' own, in words.
    when: str | None = None


@dataclass(frozen=True)
class Where:
    """Where an effect is largest, of the rows that were measured.

    Attributes
    ----------
    line, line_um
        The line on which it is worth most, and its root mean square there; None where it is much the same on all.
    largest_um, at_mm
        Its largest value on any row, and the commanded position there.
    spans
        Thirds of the variables that it depends on in which it is largest, the clearest first.
    """

    line: str | None
    line_um: float | None
    largest_um: float
    at_mm: tuple[float, float, float]
    spans: tuple[Span, ...]

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        return {
            "line": self.line,
            "line_um": self.line_um,
            "largest_um": self.largest_um,
            **dict(zip(AXES, self.at_mm, strict=True)),
            "spans": [
                {"variable": s.variable, "part": s.part, "low": s.low, "high": s.high, "rms_um": s.rms_um}
                for s in self.spans
            ],
        }

    def words(self) -> str:
        """Say it: `most on line X (21.0 µm), at the high end of y; largest 31 µm at (200, 395, 30) mm`."""
        texts = [] if self.line is None else [f"most on line {self.line} ({self.line_um:.1f} µm)"]
        texts += [_span_words(span) for span in self.spans]
        at = ", ".join(map(number_words, self.at_mm))
        most = f"largest {self.largest_um:.1f} µm, at ({at}) mm"
        return f"{', '.join(texts)}; {most}" if texts else f"much the same everywhere; {most}"


def displacement_um(space: Space, displacement: Numbers) -> Numbers:
    """Bring a whitened displacement (n, 3) to µm in base axes; 0 where nothing was measured."""
    return unwhitened_um(space, space.noise.unwhiten(displacement))


def unwhitened_um(space: Space, stated: Numbers) -> Numbers:
    """Bring a displacement (n, 3) in units of the stated uncertainties to µm in base axes; 0 where unmeasured."""
    fitted, um = space.fitted, _in_the_frame_um(space, stated)
    return np.asarray(fitted.problem.in_base_axes(fitted.solved.state, np.ascontiguousarray(um)))


def rms_um(space: Space, stated: Numbers) -> float:
    """Give the root mean square of such a displacement in µm, components summed as for errors."""
    counts = np.maximum((space.rows * is_told(space.fitted.sightings)).sum(axis=0), 1.0)
    return float(np.sqrt(((_in_the_frame_um(space, stated) ** 2).sum(axis=0) / counts).sum()))


def _in_the_frame_um(space: Space, stated: Numbers) -> Numbers:
    sightings = space.fitted.sightings
    mm = np.einsum("nij,nj->ni", sightings.unwhitening, stated)
    return of_whole_lengths(sightings, np.asarray(UM_PER_MM * mm * space.rows))


def where_of(sightings: Sightings, moved_um: Numbers, is_used: np.ndarray, variables: Sequence[str]) -> Where:
    """Find where a displacement (n, 3) is largest.

    Parameters
    ----------
    is_used : (n,)
        Rows that take part.
    variables
        What the effect depends on: thirds of these are looked at.
    """
    is_used = is_used & is_told(sightings).any(axis=1)
    size = np.where(is_used, np.linalg.norm(moved_um, axis=1), 0.0)
    row = int(np.argmax(size))
    line, line_um = _line(sightings, size, is_used)
    at = sightings.commanded_mm[row]
    spans = [span for name in variables for span in _span(sightings, size, is_used, name)]
    ordered = sorted(spans, key=lambda found: -found[0])[:_MOST_SPANS]
    return Where(
        line, line_um, float(size[row]), (float(at[0]), float(at[1]), float(at[2])), tuple(one for _, one in ordered)
    )


def variables_of_term(term: Term, columns: Sequence[str]) -> tuple[str, ...]:
    """Give what a term depends on and a place can be told by: positions, time and conditions that are columns."""
    named = [name for name in term.variables if name in AXES or name in _TIMES or name not in RAW_VARIABLES]
    named += [part.basis.axis for part in term.parts if part.basis is not None]
    if any(is_motion(name, "v", "mean_v", "a") for name in term.variables) and "feed" in columns:
        named.append("feed")
    return tuple(
        dict.fromkeys(
            name for name in named if name in columns or name in AXES or (name == CLOCK_NAME and "t" in columns)
        )
    )


def _line(sightings: Sightings, size: Numbers, is_used: np.ndarray) -> tuple[str | None, float | None]:
    if "line" not in sightings.table.columns:
        return None, None
    names, number = np.unique(np.array(sightings.texts("line")), return_inverse=True)
    count = np.bincount(number[is_used], minlength=len(names))
    squares = np.bincount(number, size**2, minlength=len(names)) / np.maximum(count, 1)
    best = int(np.argmax(squares))
    mean = float((size[is_used] ** 2).mean())
    if len(names) < 2 or squares[best] < _STANDS_OUT**2 * mean or not names[best]:
        return None, None
    return str(names[best]), float(np.sqrt(squares[best]))


def _span(sightings: Sightings, size: Numbers, is_used: np.ndarray, name: str) -> list[tuple[float, Span]]:
    """Give the third in which the effect is largest and how far it stands out; nothing where it does not."""
    values = variable_columns(sightings, [name])[0]
    known = np.isfinite(values) & is_used
    if known.sum() < len(_PARTS) or np.ptp(values[known]) == 0.0:
        return []
    low, high = float(values[known].min()), float(values[known].max())
    third = np.minimum((3.0 * (values[known] - low) / (high - low)).astype(np.int64), 2)
    squares, counts = np.bincount(third, size[known] ** 2, minlength=3), np.bincount(third, minlength=3)
    held = counts > 0
    rms = np.sqrt(squares / np.maximum(counts, 1))
    best = int(np.argmax(rms))
    least = float(rms[held].min())
    if held.sum() < 2 or rms[best] == 0.0 or rms[best] < _LARGER * least:
        return []
    own = values[known][third == best]
    rows = np.flatnonzero(known)[third == best]
    when = span_words(int(rows[0]), int(rows[-1]), sightings) if name == CLOCK_NAME else None
    span = Span(name, _PARTS[best], float(own.min()), float(own.max()), float(rms[best]), when)
    return [(float(rms[best]) / max(least, 1e-3 * float(rms[best])), span)]


def _span_words(span: Span) -> str:
    if span.variable in AXES:
        return (
            f"in the middle of {span.variable}"
            if span.part == "middle"
            else f"at the {span.part} end of {span.variable}"
        )
    ends = [number_words(span.low), number_words(span.high)]
    values = " to ".join(dict.fromkeys(ends))
    if span.variable in _TIMES:
        when = {"low": "at the beginning", "middle": "midway in time", "high": "at the end"}[span.part]
        return f"{when} ({span.when or f't {values}'})"
    return f"where {span.variable} is {'middling' if span.part == 'middle' else span.part} ({values})"
