"""The page of one machine at several temperatures: what differs, one model for all, left-out temperatures."""

from __future__ import annotations

from pathlib import Path

from geoerr.effects.plausible import plausible_words
from geoerr.effects.values import value_words
from geoerr.errors import NotDeterminedError
from geoerr.report.figures import style
from geoerr.report.figures.states import difference_curves, difference_map, state_curves
from geoerr.report.page import Block, Figure, Paragraph, Section, Table, as_sentence, write_report
from geoerr.report.provenance import Provenance
from geoerr.states import Difference, States
from geoerr.summaries import p_text, p_words

_MAP_POINTS = 7


def write_states_page(path: str | Path, states: States, provenance: Provenance) -> None:
    """Write the page, whole or not at all.

    Parameters
    ----------
    path
        HTML to write.
    states
        What is drawn; the difference is that of the hottest and the coldest state.
    provenance
        For the last section.
    """
    difference = states.difference(states.temperatures_degc[0], states.temperatures_degc[-1])
    beyond = [name for name, one in difference.by_name.items() if one.p_value < 0.05]
    summary = [
        f"{difference.second} minus {difference.first}: {p_words(difference.p_value)} that nothing differs.",
        f"Beyond chance: {', '.join(beyond) if beyond else 'no single function'}.",
        *(as_sentence(note).text for note in (*states.notes, *states.model.notes)),
    ]
    sections = [
        Section("The 21 errors at each temperature", (Figure(state_curves(states), "All states."),)),
        Section("What differs", tuple(_difference(difference))),
        Section("One model", (_model(states),)),
    ]
    if states.left_out:
        sections.append(Section("Each temperature predicted from the others", (_left_out(states),)))
    write_report(path, f"{states.machine.name}: hot and cold", summary, sections, provenance)


def _difference(difference: Difference) -> list[Block]:
    blocks: list[Block] = [Figure(difference_curves(difference), "Function by function.")]
    try:
        maps = [
            (difference.volume(_MAP_POINTS), "Difference over the volume", "Where the machine differs."),
            (
                difference.volume(_MAP_POINTS, without_growth=True),
                "What three scale factors would leave",
                "The same with the growth of each axis taken off.",
            ),
        ]
    except NotDeterminedError as error:
        return [*blocks, Paragraph(f"No map: {str(error).splitlines()[0]}.")]
    return [*blocks, *(Figure(difference_map(volume, title), caption) for volume, title, caption in maps)]


def _model(states: States) -> Table:
    rows = [
        (
            term.id,
            value_words(parameter, term.coefficients),
            plausible_words(parameter, beside=term.coefficients) or "",
        )
        for term in states.model.temperature_terms
        for parameter in term.coefficients
    ]
    fit = states.temperature_fit
    caption = f"What follows {states.covariate}; {p_words(fit.misfit.p_value)} that this is all"
    if fit.scale != 1.0:
        caption += f"; uncertainties are multiplied by {fit.scale:.2f}"
    return Table(caption, ("term", "value ± standard uncertainty", "would physics give it"), tuple(rows))


def _left_out(states: States) -> Table:
    rows = tuple(
        (
            f"{one.temperature_degc:g}",
            "extrapolated" if one.is_extrapolation else "interpolated",
            *("" if value is None else style.text_um(value) for value in (one.rms_um, one.rms_by_chance_um)),
            *("" if value is None else style.text_um(value) for value in (one.predicted_rmse_um, one.own_rmse_um)),
            f"{100.0 * one.coverage:.0f} %",
            p_text(one.difference.p_value),
        )
        for one in states.left_out
    )
    header = (
        *("°C", "", "measured minus predicted, volume", "by chance", "points minus predicted", "minus own fit"),
        "tables inside 95 %",
        "p",
    )
    return Table("Root mean squares; terms chosen anew without the state", header, rows)
