"""A diagnosis in words and tables of eighty columns: what to know first, the verdict, its grounds, what to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from geoerr.cli.text_tables import named_row, wrapped
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.findings import IN_MODEL, Finding, Named, Unknown
from geoerr.diagnose.words import chance_words, sure_words, um_words
from geoerr.fit.empirical import Curve
from geoerr.summaries import by_reason, capitalised, counted, listed, p_text

_MEANINGS = {
    "own": "the model was fitted to these data: its own numbers take part",
    "refit": "the model's numbers are fitted to these data, too",
    "held": "the model's numbers stay, as uncertain as they are; measuring frames are fitted",
}
_MOST_OTHERS = 5
_MOST_REASONS = 4
_MOST_POINTS, _MOST_ACROSS = 9, 5
# Of a sorted list of reasons the first are shown with so many effects each.
_MOST_EFFECTS = 3
_NAME_WIDTH = 42


def diagnosis_lines(
    diagnosis: Diagnosis, command: str, options: str, *, fit_first: str | None = None, verbose: bool = False
) -> Iterator[str]:
    """Give everything that the verb prints.

    Parameters
    ----------
    diagnosis
        What is reported.
    command
        How a `geoerr add` of these files begins.
    options
        How it goes on after the effect, from a space: the user's own effect files.
    fit_first
        The command that fits the 21 errors, of a machine that has none yet.
    verbose
        Every candidate in full, and everything that was not offered.
    """
    yield from _data(diagnosis)
    yield ""
    for text in diagnosis.notes:
        yield from wrapped(f"note: {text}")
    if fit_first is not None:
        yield from ("to fit them first:", f"  {fit_first}")
    if diagnosis.notes:
        yield ""
    yield from wrapped(f"{capitalised(diagnosis.sentence)}.")
    yield from _figures(diagnosis)
    drifts_most = diagnosis.between_passes.worth_um > max((one.worth_um for one in diagnosis.found), default=0.0)
    if drifts_most:
        yield from _between_passes(diagnosis)
    for number, finding in enumerate(diagnosis.found, start=1):
        yield ""
        yield from _finding(finding, f"{number}. " if len(diagnosis.found) > 1 else "")
        yield from _tied(diagnosis.tied_with(finding))
    if diagnosis.unknown is not None:
        yield from _unknown(diagnosis.unknown)
    if not drifts_most:
        yield from _between_passes(diagnosis)
    yield from _others(diagnosis, verbose=verbose)
    yield from not_offered_lines(diagnosis.not_offered, verbose=verbose)
    yield from _next(diagnosis, command, options)


def _between_passes(diagnosis: Diagnosis) -> Iterator[str]:
    """Say what does not come back from pass to pass, where that is more than rows scatter."""
    if diagnosis.between_passes.stands_out:
        yield ""
        yield from wrapped(diagnosis.between_passes.words())


def _data(diagnosis: Diagnosis) -> Iterator[str]:
    sightings = diagnosis.fitted.sightings
    machine = diagnosis.fitted.machine
    yield from wrapped(f"{machine.name} ({machine.chain}): {sightings.in_words()}")
    if diagnosis.comparison is not None:
        yield from wrapped(_MEANINGS[diagnosis.comparison.freedom])


def _figures(diagnosis: Diagnosis) -> Iterator[str]:
    held, floor = diagnosis.held_out_rmse_um, diagnosis.noise_floor_um
    noise = diagnosis.fitted.split.noise_um
    texts = [f"held out {um_words(held)}" if held is not None else "held out not computable"]
    if floor is not None:
        texts.append(f"noise floor {um_words(floor)} (what repeats scatter)")
    elif noise is not None:
        texts.append(f"noise {um_words(noise)} as stated")
    yield from wrapped(f"error now: {', '.join(texts)}")
    if diagnosis.found or diagnosis.unknown is not None:
        yield from wrapped(f"that nothing is missing: {chance_words(diagnosis.p_value)}")


def _finding(finding: Finding, number: str) -> Iterator[str]:
    whose = ", of the cameras" if finding.is_rig else ""
    yield from wrapped(f"{number}{finding.reference}{whose}: {finding.effect.title}")
    for text in finding.value_words:
        yield from wrapped(text, "    ")
    yield from wrapped(f"worth {um_words(finding.worth_um)} rms, {finding.where.words()}", "    ")
    if finding.held_out_words is not None:
        yield from wrapped(finding.held_out_words, "    ")
    yield from remedy_lines(finding, "the cameras")
    if finding.left_because is not None:
        yield from wrapped(f"left: {finding.left_because}", "    ")
    yield from alias_lines(finding)


def remedy_lines(named: Named, device: str) -> Iterator[str]:
    """Say how sure an effect is, what causes it and what to do; `device` is what an effect of the rig is of."""
    yield from wrapped(sure_words(named.p_value), "    ")
    # A user's own effect need not say either.
    if named.effect.cause:
        yield from wrapped(f"cause: {named.effect.cause}", "    ")
    if named.effect.remedy:
        yield from wrapped(f"to do: {named.effect.remedy}", "    ")
    if named.in_model:
        yield from wrapped(IN_MODEL, "    ")
    if named.is_rig:
        yield from wrapped(f"an error of {device} is explained, and never compensated in a program", "    ")
    if named.frame_words is not None:
        yield from wrapped(named.frame_words, "    ")


def alias_lines(named: Named) -> Iterator[str]:
    """Name what an effect looks like."""
    if named.aliases:
        names = [f"{alias.reference} ({alias.correlation:.2f})" for alias in named.aliases[:_MOST_OTHERS]]
        yield from wrapped(f"looks like (correlation): {', '.join(names)}", "    ")
    if named.device_words is not None:
        yield from wrapped(named.device_words, "    ")


def _tied(rivals: Sequence[Finding]) -> Iterator[str]:
    if not rivals:
        return
    yield ""
    yield from wrapped("these data cannot tell it from:")
    for rival in rivals:
        yield from wrapped(f"{rival.reference}: {rival.effect.title}{rival.others_words}", "  ")
        yield from wrapped("; ".join(rival.value_words), "    ")
        after = "" if rival.held_out_words is None else f", {rival.held_out_words}"
        yield from wrapped(f"worth {um_words(rival.worth_um)} rms{after}", "    ")
    separations = dict.fromkeys(one.separate_by for one in rivals if one.separate_by is not None)
    for separation in separations:
        would = "" if separation.plan is None else "what would: "
        yield from wrapped(f"{would}{separation.words}", "  ")


def _unknown(unknown: Unknown) -> Iterator[str]:
    yield ""
    yield from wrapped(
        f"unknown: acts along {unknown.component}, depends on {listed(unknown.depends_on)}, "
        f"worth {um_words(unknown.worth_um)} rms"
    )
    yield from wrapped(unknown.where_words, "    ")
    if unknown.shape is not None:
        yield from wrapped(f"shape: it {unknown.shape}", "    ")
    yield from wrapped(sure_words(unknown.p_value), "    ")
    if unknown.held_out_words is not None:
        yield from wrapped(unknown.held_out_words, "    ")
    if unknown.beyond_the_lines_words is not None:
        yield from wrapped(unknown.beyond_the_lines_words, "    ")
    if unknown.is_the_models_own:
        yield from wrapped("one position alone: the model's error functions are too stiff here", "    ")
    if unknown.own_words is not None:
        yield from wrapped(unknown.own_words, "    ")
    if unknown.curve is not None:
        yield from _curve(unknown.curve)
    if unknown.std_words is not None:
        yield from wrapped(unknown.std_words, "    ")


def _curve(curve: Curve) -> Iterator[str]:
    """Give the curve as a table: value ± standard error, µm; of three variables where it is largest."""
    if len(curve.at) == 3:
        along = curve.cut_along
        place = curve.largest_cut
        yield f"    at {curve.variables[along]} = {_plain(curve.at[along][place])}:"
        curve = curve.cut(place)
    most = _MOST_POINTS if len(curve.at) == 1 else _MOST_ACROSS
    places = [_chosen(len(own), most) for own in curve.at]
    if len(places) == 1:
        name = curve.variables[0] if curve.period is None else f"{curve.variables[0]}, one turn"
        yield f"    {name:>14}{curve.component + ', µm':>12}"
        for place in places[0]:
            value, std = curve.value_um[place], curve.std_um[place]
            yield f"    {_plain(curve.at[0][place]):>14}{_signed(value):>12} ± {std:.1f}"
        return
    columns = places[1]
    down, across = curve.variables
    error = float(np.median(curve.std_um))
    yield f"    {curve.component}, µm (± {error:.1f}), over {down} (down) and {across} (across)"
    yield "    " + " " * 9 + "".join(f"{_plain(curve.at[1][column]):>9}" for column in columns)
    for row in places[0]:
        cells = "".join(f"{_signed(curve.value_um[row, column]):>9}" for column in columns)
        yield f"    {_plain(curve.at[0][row]):>9}{cells}"


def _chosen(count: int, most: int) -> list[int]:
    """Give at most so many places of a grid, both ends among them."""
    return [int(place) for place in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


def _others(diagnosis: Diagnosis, *, verbose: bool) -> Iterator[str]:
    named = {finding.reference for finding in (*diagnosis.found, *diagnosis.not_told_apart)}
    others = [finding for finding in diagnosis.candidates if finding.reference not in named]
    if not others:
        return
    yield ""
    title = "looked at and left" if diagnosis.found else "the nearest that was looked at"
    if verbose:
        yield f"{title}:"
        for finding in others:
            yield from _finding(finding, "")
        return
    yield f"{title + ', best first':<{_NAME_WIDTH}}{'worth':>11}{'p':>9}   held out"
    for finding in others[:_MOST_OTHERS]:
        held = finding.held_out_words or ""
        worth, p_value = um_words(finding.worth_um), p_text(finding.p_value, 1)
        figures = f"{worth:>11}{p_value:>9}   {held.removeprefix('held out ')}"
        yield from named_row(str(finding.reference), _NAME_WIDTH - 2, figures, "  ")
    for words in diagnosis.asked_words:
        yield from wrapped(words, "  ")
    reasons = [(str(one.reference), one.left_because) for one in others[:_MOST_OTHERS] if one.left_because]
    for why, names in by_reason(reasons).items():
        yield from wrapped(f"{', '.join(names)}: {why}", "  ")
    if len(others) > _MOST_OTHERS:
        yield f"  and {len(others) - _MOST_OTHERS} more (--verbose)"


def not_offered_lines(not_offered: Sequence[tuple[str, str]], *, verbose: bool) -> Iterator[str]:
    """Give what was not looked for, grouped by the reason."""
    if not not_offered:
        return
    yield ""
    yield f"not looked for ({counted(len(not_offered), 'effect')}):"
    ordered = sorted(by_reason(not_offered).items(), key=lambda item: -len(item[1]))
    for why, names in ordered if verbose else ordered[:_MOST_REASONS]:
        shown = names if verbose or len(names) <= _MOST_EFFECTS else [*names[:_MOST_EFFECTS], "..."]
        yield from wrapped(f"{', '.join(shown)}: {why}", "  ")
    if not verbose and len(ordered) > _MOST_REASONS:
        yield f"  and {counted(len(ordered) - _MOST_REASONS, 'more reason')} (--verbose)"


def _next(diagnosis: Diagnosis, command: str, options: str) -> Iterator[str]:
    found, unknown = diagnosis.found, diagnosis.unknown
    if found and not found[0].in_model:
        title, reference = "to add it and see the error fall:", str(found[0].reference)
    elif unknown is not None and not found and unknown.can_be_added:
        title = f"to add it as an empirical {unknown.form}, without a cause:"
        if unknown.own is not None:
            title = "to make the model's curve finer:"
        reference = f"'{unknown.reference}'"
    else:
        return
    yield ""
    yield title
    # A line to copy is not broken.
    yield f"  {command} {reference}{options} -o model2.json"


def _plain(value: float) -> str:
    return f"{value:.5g}".replace("-", "−")


def _signed(value: float) -> str:
    return f"{value:+.1f}".replace("-", "−")
