"""The page of an uncertainty budget: what is uncertain, how much each source matters, and where in the volume."""

from __future__ import annotations

import math
from pathlib import Path

from geoerr.budget import Budget, Contribution, UncertaintyMap
from geoerr.machine import AXES
from geoerr.model.fit_words import NOT_SETTLED
from geoerr.model.in_model import not_in_model_words
from geoerr.report.figures import style, uncertainty_slices
from geoerr.report.page import NOT_DETERMINED, Block, Figure, Section, Table, as_sentence, write_report
from geoerr.report.provenance import Provenance
from geoerr.summaries import capitalised, listed, number_text

_PERCENT = 100.0
# In any unit of the tables less than this is rounding.
_ROUNDING = 1e-9


def write_budget_page(path: str | Path, budget: Budget, volume: UncertaintyMap, provenance: Provenance) -> None:
    """Write the page, whole or not at all.

    Parameters
    ----------
    path
        HTML to write.
    budget
        What the tables are of; the last of its places is the one whose shares are shown.
    volume
        The same over the volume.
    provenance
        For the last section.
    """
    title = f"{budget.model.machine.name}: uncertainty budget"
    unsettled = [] if budget.has_settled else [f"{capitalised(NOT_SETTLED)}."]
    write_report(path, title, [*unsettled, *budget_sentences(budget)], budget_sections(budget, volume), provenance)


def budget_sentences(budget: Budget) -> list[str]:
    """Say how sure the prediction and a compensated part are at the last place."""
    last = len(budget.place_names) - 1
    where = budget.place_names[last]
    if not budget.is_determined[last].all():
        known = [axis for axis, is_known in zip(AXES, budget.is_determined[last], strict=True) if is_known]
        of_them = f"of the error only its part along {listed(known)} is known" if known else "nothing is known"
        whys = []
        if (budget.is_in_model[last] & ~budget.is_determined[last]).any():
            whys.append("the data do not determine the rest")
        if not budget.is_in_model[last].all():
            whys.append(not_in_model_words(budget.model.not_in_model))
        return [f"At the place named {where} {of_them}; {'; '.join(whys)}."]
    lengths = {of: budget.expanded_length_um(of)[last] for of in ("prediction", "part")}
    # What a sentence begins with names it; why it is not counted stands in its section.
    without = [sentence.partition(":")[0] for sentence in budget.not_counted_anywhere]
    absent = budget.model.not_in_model
    told = [not_in_model_words(absent), *without] if absent else without
    return [
        f"At the place named {where} the predicted error is known to {_um(lengths['prediction'])} (95 %).",
        f"There a compensated part stays within {_um(lengths['part'])} (95 %), not counting: {'; '.join(told)}.",
    ]


def budget_sections(budget: Budget, volume: UncertaintyMap) -> list[Section]:
    """Show the combined uncertainty, its sources, the map of the volume, and what is not counted."""
    last = len(budget.place_names) - 1
    sections = [
        Section("How uncertain", (_combined(budget),)),
        Section("Why", (*_sources(budget, last), *_groups(budget, last))),
        Section("Where", (Figure(uncertainty_slices(volume), "Uncertainty over the volume, in slices."),)),
    ]
    if budget.stages:
        sections.append(Section("From the picture to the parameters", (_stages(budget),)))
    sections.append(Section("Not counted", tuple(map(as_sentence, budget.not_counted))))
    return sections


def _combined(budget: Budget) -> Table:
    header = ["place", "x, mm", "y, mm", "z, mm"]
    columns = []
    for of, what in (("prediction", "error"), ("part", "part")):
        header += [f"{what}, U {axis}, µm" for axis in "xyz"] + [f"{what}, length below, µm"]
        wide = budget.expanded_um("prediction" if of == "prediction" else "part")
        length = budget.expanded_length_um("prediction" if of == "prediction" else "part")
        columns.append([[*map(_number, own), _number(whole)] for own, whole in zip(wide, length, strict=True)])
    rows = tuple(
        (name, *(f"{value:g}" for value in place), *columns[0][number], *columns[1][number])
        for number, (name, place) in enumerate(zip(budget.place_names, budget.q_mm.tolist(), strict=True))
    )
    caption = (
        "Expanded uncertainty U at 95 %, and the length that the error stays below: of the predicted error, and of "
        "what is left of it in a compensated part."
    )
    return Table(caption, tuple(header), rows)


def _sources(budget: Budget, place: int) -> list[Block]:
    by_name = {source.name: source for source in budget.sources}
    rows = tuple(
        (
            one.name,
            by_name[one.name].what,
            by_name[one.name].kind,
            _number(by_name[one.name].std),
            by_name[one.name].unit,
            _number(float(one.std_um[place])),
            _share(one, place),
        )
        for one in budget.contributions("part")
    )
    header = ("source", "what", "type", "u", "unit", "of a part's error, µm", "share of variance, %")
    return [Table(f"Sources, and what they contribute at the place named {budget.place_names[place]}.", header, rows)]


def _groups(budget: Budget, place: int) -> list[Block]:
    rows = tuple(
        (one.name, _number(float(one.std_um[place])), _share(one, place)) for one in budget.parameter_groups()
    )
    text = "The same through the parameters: groups that offset each other have negative shares."
    return [Table(text, ("group", "contribution, µm", "share of variance, %"), rows)] if rows else []


def _stages(budget: Budget) -> Table:
    rows = tuple((stage.name, stage.what, _number(stage.std), stage.unit) for stage in budget.stages)
    return Table("Standard uncertainties on the way, medians.", ("stage", "what", "u", "unit"), rows)


def _share(one: Contribution, place: int) -> str:
    share = float(one.share[place])
    return NOT_DETERMINED if math.isnan(share) else number_text(round(_PERCENT * share, 1) + 0.0, 1)


def _number(value: float) -> str:
    if math.isnan(value):
        return NOT_DETERMINED
    return "0" if abs(value) < _ROUNDING else f"{value:.3g}"


def _um(value: float) -> str:
    return NOT_DETERMINED if math.isnan(value) else style.text_um(float(value))
