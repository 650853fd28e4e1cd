"""The diagnosis of circular tests in words and tables that fit eighty columns: ranked as ball-bar software ranks."""

from __future__ import annotations

from collections.abc import Iterator

from geoerr.cli.diagnose_text import alias_lines, not_offered_lines, remedy_lines
from geoerr.cli.text_tables import named_row, wrapped
from geoerr.diagnose.circles import Cause, CircleDiagnosis
from geoerr.diagnose.words import chance_words, um_words
from geoerr.summaries import capitalised, counted, listed, p_text

_MOST_OTHERS = 5
_NAME_WIDTH = 34


def circle_diagnosis_lines(
    diagnosis: CircleDiagnosis, command: str, options: str, *, verbose: bool = False
) -> Iterator[str]:
    """Give everything that the verb prints; parameters as for `diagnosis_lines`."""
    machine = diagnosis.fitted.machine
    yield from wrapped(f"{machine.name} ({machine.chain}): {counted(len(diagnosis.runs), 'circular run')}")
    yield ""
    sentence = diagnosis.sentence
    yield from wrapped(f"{capitalised(sentence)}.")
    shares = diagnosis.shares
    yield from wrapped(
        f"of the trace {um_words(shares.total**0.5)} rms: causes {um_words(shares.explained**0.5)}, "
        f"unexplained {um_words(shares.rest**0.5)} ({shares.percent_unexplained:.0f} % of what is more than noise), "
        f"noise {um_words(diagnosis.noise_um)}"
    )
    if diagnosis.found or diagnosis.unknown is not None:
        yield from wrapped(f"that nothing is missing: {chance_words(diagnosis.p_value)}")
    for number, cause in enumerate(diagnosis.ranked, start=1):
        yield ""
        yield from _cause(cause, f"{number}. ")
    if diagnosis.unknown is not None:
        yield ""
        yield from wrapped(f"unknown: {diagnosis.unknown.words()}")
    yield from _others(diagnosis, verbose=verbose)
    yield from _runs(diagnosis)
    for text in diagnosis.notes:
        yield from wrapped(f"note: {text}")
    yield from not_offered_lines(diagnosis.not_offered, verbose=verbose)
    if diagnosis.ranked and not diagnosis.ranked[0].in_model:
        yield ""
        yield "to add the first and see the error fall:"
        yield f"  {command} {diagnosis.ranked[0].reference}{options} -o model2.json"


def _cause(cause: Cause, number: str) -> Iterator[str]:
    share = "" if cause.percent is None else f", {cause.percent:.0f} %".replace("-", "−")
    yield from wrapped(f"{number}{cause.reference}{share}: {cause.effect.title}")
    for reading in cause.readings:
        yield from wrapped(reading.words(), "    ")
    yield from wrapped(cause.worth_words, "    ")
    if cause.caution:
        yield from wrapped(cause.caution, "    ")
    yield from remedy_lines(cause, "the measuring device")
    yield from alias_lines(cause)
    if cause.separate_by is not None:
        yield from wrapped(f"these runs cannot tell it apart; what would: {cause.separate_by.words}", "    ")


def _others(diagnosis: CircleDiagnosis, *, verbose: bool) -> Iterator[str]:
    named = {cause.reference for cause in diagnosis.found}
    others = [cause for cause in diagnosis.candidates if cause.reference not in named]
    if not others:
        return
    yield ""
    yield f"{'looked at and left, best first':<{_NAME_WIDTH}}{'worth':>11}{'p':>9}"
    shown = others if verbose else others[:_MOST_OTHERS]
    for cause in shown:
        name, worth = str(cause.reference), um_words(cause.worth_um)
        yield from named_row(name, _NAME_WIDTH - 2, f"{worth:>11}{p_text(cause.p_value, 1):>9}", "  ")
    for cause in shown:
        alike = [str(reference) for reference in diagnosis.not_told_from(cause)]
        if alike:
            yield from wrapped(f"{cause.reference}: not told from {listed(alike)}", "  ")
    if not verbose and len(others) > _MOST_OTHERS:
        yield f"  and {len(others) - _MOST_OTHERS} more (--verbose)"


def _runs(diagnosis: CircleDiagnosis) -> Iterator[str]:
    yield ""
    yield f"{'run':<24}{'plane':>6}{'sense':>7}{'feed':>8}{'rows':>7}{'G, µm':>9}{'causes':>8}{'rest':>8}"
    for run in diagnosis.runs:
        feed = "–" if run.feed_mm_min is None else f"{run.feed_mm_min:g}"
        name = run.name if len(run.name) <= 23 else f"{run.name[:22]}…"
        sense = "+1" if run.sense > 0 else "−1"
        yield (
            f"{name:<24}{run.plane.upper():>6}{sense:>7}{feed:>8}{run.n_rows:>7}"
            f"{run.circular_deviation_um:>9.1f}{run.explained_um:>8.1f}{run.rest_um:>8.1f}"
        )
