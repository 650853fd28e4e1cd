"""What `geoerr identify` prints: the 21 errors, what was fitted, what is not determined."""

from __future__ import annotations

from collections.abc import Sequence

from geoerr.cli.fit_text import (
    error_rows,
    figure_rows,
    freedom_of,
    not_determined_rows,
    quality_in_words,
    scale_sentence,
)
from geoerr.cli.options import note, note_left_out, note_set_aside
from geoerr.cli.text_tables import wrapped
from geoerr.error_functions import ALL_NAMES, LI_NAMES
from geoerr.fit import figures_document
from geoerr.identify import NineLineResult, TangentVerdict
from geoerr.identify.joint import JointResult
from geoerr.summaries import counted, p_words
from geoerr.tables import RowProblem

_UM_PER_MM = 1e3


def identification_lines(result: NineLineResult | JointResult) -> list[str]:
    """Give everything that the verb prints."""
    errors = result.errors
    freedom = freedom_of(result.result.fitted) if isinstance(result, JointResult) else {}
    lines = wrapped(
        f"{errors.machine.name} ({errors.machine.chain}): {len(errors.functions)} of 18 error functions and "
        f"{len(errors.squareness)} of 3 squarenesses, method {errors.method}"
    )
    lines += [
        "",
        *error_rows(errors, ALL_NAMES, freedom, "fitted as" if freedom else "over"),
        "",
        *(_fit_in_words(result) if isinstance(result, JointResult) else _lines_in_words(result)),
    ]
    if result.tangent:
        lines += [
            "",
            "direct against integrated straightness",
            "(the same where a carriage follows its guideway's tangent):",
        ]
        lines += [_verdict(verdict) for verdict in result.tangent]
    if errors.not_determined:
        lines += ["", "not determined (unknown, not zero):", *not_determined_rows(errors.not_determined)]
    return lines


def _fit_in_words(result: JointResult) -> list[str]:
    """Say what was fitted, how far it is off, and what that means."""
    fitted = result.result.fitted
    sightings = fitted.sightings
    lines = wrapped(
        f"{sightings.in_words()} and {counted(len(sightings.sessions), 'session')}; "
        f"{fitted.problem.n_columns} unknowns, of which {fitted.solved.solution.rank} are determined"
    )
    lines += ["", *figure_rows({"": figures_document(fitted)}), ""]
    for sentence in quality_in_words(fitted):
        lines += wrapped(sentence)
    scales = scale_sentence(result.result.model.mean_scales())
    return lines + ([] if scales is None else wrapped(scales))


def _lines_in_words(result: NineLineResult) -> list[str]:
    """Name the lines that were found, by axis, and their redundancy."""
    sentences: list[str] = []
    scatter = {one.axis: one for one in result.scatter}
    for axis in dict.fromkeys(line.axis for line in result.lines):
        members = [line for line in result.lines if line.axis == axis]
        numbers = ", ".join(str(line.number) for line in members if line.number is not None)
        further = sum(line.number is None for line in members)
        text = f"{axis.upper()}: line{'s' if ',' in numbers else ''} {numbers}"
        text += f" and {further} more" if further else ""
        text += (
            f"; {sum(line.n_points for line in members)} points in {sum(line.n_passes for line in members)} passes"
        )
        one = scatter[axis]
        if one.rms_mm is not None:
            text += f"; residual {one.rms_mm * _UM_PER_MM:.1f} µm rms"
        if one.chi_squared_per_dof is not None:
            text += f", χ²/ν = {one.chi_squared_per_dof:.2f} (ν = {one.dof})"
        sentences += wrapped(text)
    return sentences


def _verdict(verdict: TangentVerdict) -> str:
    head = f"  {verdict.name:<5}{LI_NAMES[verdict.name]:<6}{verdict.rms_mm * _UM_PER_MM:>8.1f} µm rms"
    if verdict.p_value is None:
        return f"{head}   cannot be judged without uncertainties"
    answer = "follows, as far as can be told" if verdict.follows else "does not follow"
    return f"{head}   {p_words(verdict.p_value):<12} {answer}"


def print_notes(result: NineLineResult | JointResult, set_aside: Sequence[RowProblem], quiet: bool) -> None:
    """Say on standard error what took no part."""
    note_set_aside(set_aside, quiet)
    left_out = result.left_out if isinstance(result, NineLineResult) else result.result.fitted.sightings.left_out
    note_left_out(left_out, quiet)
    for sentence in result.errors.notes:
        note(f"note: {sentence}", quiet)
