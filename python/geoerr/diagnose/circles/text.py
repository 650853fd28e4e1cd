"""A diagnosis as a shop floor reads it: runs, causes ranked by worth, what is left, what to do next."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING

from geoerr.diagnose.findings import Separation

if TYPE_CHECKING:
    from geoerr.diagnose.circles.diagnosis import Cause, CircleDiagnosis

WIDTH = 80
_SENSES = {1: "CCW", -1: "CW"}
_MOST_OTHERS = 4
_MOST_REASONS = 4
# More names than this behind one reason are counted.
_MOST_NAMES = 3


def circle_lines(diagnosis: CircleDiagnosis, *, verbose: bool = False) -> Iterator[str]:
    """Give the diagnosis line by line, at most 80 columns wide.

    Parameters
    ----------
    verbose
        Every reason why something was not looked for, and the nearest suspects.
    """
    yield from _runs(diagnosis)
    yield ""
    yield from _wrapped(_sentence(diagnosis))
    yield from _balance(diagnosis)
    for number, cause in enumerate(diagnosis.ranked, start=1):
        yield ""
        yield from _cause(diagnosis, cause, number)
    if diagnosis.unknown is not None:
        yield ""
        yield from _wrapped(f"unknown: {diagnosis.unknown.words()}")
    yield from _doubts(diagnosis)
    yield from _not_offered(diagnosis, verbose=verbose)


def _sentence(diagnosis: CircleDiagnosis) -> str:
    n = len(diagnosis.found)
    if diagnosis.verdict == "nothing-missing":
        return f"Nothing is missing: what these runs show, chance explains ({_p(diagnosis.p_value)})."
    if diagnosis.verdict == "unknown":
        return "Something is there, and no known cause explains it."
    causes = "one cause" if n == 1 else f"{n} causes"
    tied = ", not all of them told apart from others" if n > 1 else ", not told apart from others"
    return f"Found {causes}{tied if diagnosis.verdict == 'ambiguous' else ''}."


def _p(value: float) -> str:
    return f"p = {value:.2g}" if value >= 1e-9 else "p < 1e-9"


def _runs(diagnosis: CircleDiagnosis) -> Iterator[str]:
    yield f"{'run':<30}{'rows':>7}{'G':>10}{'explained':>12}{'left':>9}   µm"
    for run in diagnosis.runs:
        feed = "" if run.feed_mm_min is None else f"{run.feed_mm_min:.5g} mm/min"
        name = f"{run.plane.upper()} {_SENSES[run.sense]:<4}{feed}"
        figures = f"{run.circular_deviation_um:>10.1f}{run.explained_um:>12.1f}{run.rest_um:>9.1f}"
        yield f"  {name:<28}{run.n_rows:>7}{figures}"
    for one in diagnosis.set_ups:
        centre = ", ".join(f"{value:.1f}" for value in one.centre_um)
        yield from _wrapped(f"set-up {one.name}: ball at ({centre}) µm, bar {one.radius_um:+.1f} µm", "  ")


def _balance(diagnosis: CircleDiagnosis) -> Iterator[str]:
    shares = diagnosis.shares
    measured, noise = shares.total**0.5, diagnosis.noise_um
    text = f"measured {measured:.2f} µm rms, explained {shares.explained**0.5:.2f}, noise {noise:.2f}"
    if diagnosis.wander_um > 0.3 * noise:
        text += f" (of which {diagnosis.wander_um:.2f} wanders along the circle)"
    yield from _wrapped(text)
    if shares.explainable > 0.0:
        left = f"{shares.percent_unexplained:.0f} % of what is no noise is left unexplained"
        yield from _wrapped(f"{left} ({shares.rest**0.5:.2f} µm rms)")


def _cause(diagnosis: CircleDiagnosis, cause: Cause, number: int) -> Iterator[str]:
    percent = f"{cause.percent:.0f} %" if cause.percent is not None else ""
    head = f"{number}. {cause.effect.title} ({cause.reference})"
    peak = f"{cause.peak_to_peak_um:.1f} ± {cause.peak_to_peak_std_um:.1f} µm"
    yield f"{head:<56}{percent:>6}{peak:>18}"
    for reading in cause.readings:
        yield from _wrapped(reading.words(), "     ")
    yield from _wrapped(f"{cause.worth_um:.2f} µm rms, {cause.sure}", "     ")
    yield from _wrapped(f"cause: {cause.effect.cause}", "     ")
    yield from _wrapped(f"to do: {cause.effect.remedy}", "     ")
    tied = diagnosis.tied_with(cause)
    if tied:
        names = ", ".join(f"{alias.reference} ({alias.correlation:.3f})" for alias in tied)
        yield from _wrapped(f"not told apart from: {names}", "     ")
        if cause.separate_by is not None:
            yield from _wrapped(_advice(cause.separate_by), "     ")
    readings = [str(alias.reference) for alias in cause.aliases if alias.reference.effect in ("scale", "lag")]
    if readings and not tied:
        yield from _wrapped(f"a circle cannot say which of the two it is: {' or '.join(readings)}", "     ")


def _advice(separation: Separation) -> str:
    minutes = "" if separation.minutes is None else f" (≈ {separation.minutes:g} min)"
    plan = "" if separation.plan is None else f": {separation.plan}"
    return f"told apart by {separation.text}{plan}{minutes}"


def _doubts(diagnosis: CircleDiagnosis) -> Iterator[str]:
    if diagnosis.withdrawn:
        yield ""
        names = ", ".join(map(str, diagnosis.withdrawn))
        yield from _wrapped(f"taken back, as too small beside the rest or as parts of something unnamed: {names}")
    if diagnosis.notes:
        yield ""
        for note in diagnosis.notes:
            yield from _wrapped(f"note: {note}")


def _not_offered(diagnosis: CircleDiagnosis, *, verbose: bool) -> Iterator[str]:
    reasons: dict[str, list[str]] = {}
    for name, why in diagnosis.not_offered:
        reasons.setdefault(why, []).append(name)
    # What a circle can never show is no news.
    ordered = sorted(reasons.items(), key=lambda item: len(item[1]))
    shown = ordered if verbose else ordered[:_MOST_REASONS]
    yield ""
    yield "not looked for:"
    for why, names in shown:
        some = names if verbose or len(names) <= _MOST_NAMES else [*names[:_MOST_NAMES], "..."]
        yield from _wrapped(f"{', '.join(some)}: {why}", "  ")
    if len(shown) < len(ordered):
        yield f"  and {len(ordered) - len(shown)} more reasons (--verbose)"
    if verbose and len(diagnosis.candidates) > 1:
        yield ""
        yield "nearest suspects:"
        for one in diagnosis.candidates[1 if diagnosis.found else 0 :][:_MOST_OTHERS]:
            yield f"  {one.reference!s:<32}{one.sure:>14}"


def _wrapped(text: str, indent: str = "") -> list[str]:
    # A number stays with its sign, its error and its unit.
    for tied in (" µm", " mm", " ms", " Hz", " ± ", " = ", "≈ ", " %", " rms"):
        text = text.replace(tied, tied.replace(" ", "\u00a0"))
    lines = textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=indent + "  ", break_on_hyphens=False)
    return [line.replace("\u00a0", " ") for line in lines]
