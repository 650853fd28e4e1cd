"""`geoerr target`: plates and boards to print, true to scale."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geoerr.cli.options import JsonFlag, QuietFlag, Threads, check_output, examples, files_given, note, print_json
from geoerr.errors import GeoerrError, InputFileError

if TYPE_CHECKING:
    from geoerr.vision.printing.artwork import Artwork
    from geoerr.vision.printing.paper import Layout, Paper
    from geoerr.vision.printing.request import Request

# A name without a suffix is a pipe or a device.
_SUFFIXES = ("", ".pdf")

_EXAMPLES = (
    "geoerr target charuco:11x8:20:15:DICT_5X5_100 -o board.pdf",
    "geoerr target SESSION/session.toml#targets -o plates.pdf --page A3",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("target", epilog=examples(*_EXAMPLES))(target)


def target(
    what: Annotated[
        str,
        typer.Argument(
            metavar="PLATE_OR_BOARD",
            help="session.toml (its board), session.toml#7 (target 7), session.toml#targets (all, one a page);"
            " or charuco:11x8:20:15:DICT_5X5_100, chessboard:10x7:25, aruco:DICT_4X4_50:7:56"
            " (squares, square and marker in mm, dictionary, id).",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The PDF to write.")],
    page: Annotated[
        str | None,
        typer.Option("--page", help="A0 to A6, Letter, Legal, Tabloid, or WIDTHxHEIGHT in mm; else chosen."),
    ] = None,
    as_json: JsonFlag = False,
    quiet: QuietFlag = False,
    threads: Threads = 0,
) -> None:
    """Plates and boards to print, true to scale, with rulers to check the print by."""
    from geoerr.report.provenance import provenance_of_command
    from geoerr.vision.printing.pdf import write_print

    paper = None if page is None else _paper(page)
    request = _request(what)
    check_output(output, files_given(request.session_file))
    if output.suffix.lower() not in _SUFFIXES:
        raise typer.BadParameter(f"{output} would hold a PDF: name it .pdf", param_hint="--output")
    layouts = write_print(output, request, paper)
    notes = [sentence for artwork in request.artworks for sentence in artwork.notes]
    if as_json:
        print_json(
            {
                "output": str(output),
                "pages": [_page_document(request, *pair) for pair in zip(request.artworks, layouts, strict=True)],
                "notes": notes,
                "provenance": provenance_of_command([request.session_file]).to_document(),
            }
        )
        return
    for number, (artwork, layout) in enumerate(zip(request.artworks, layouts, strict=True), start=1):
        typer.echo(f"page {number}, {layout.paper} {layout.orientation}: {artwork.description}")
    if request.session_file is None:
        typer.echo("\nits table for session.toml:\n")
        typer.echo(_as_toml(request.artworks[0].is_board, _session_table(request, request.artworks[0])))
    for sentence in notes:
        note(f"note: {sentence}", quiet)
    note(f"written: {output}; print it at 100 % and measure both rulers", quiet)


def _paper(text: str) -> Paper:
    from geoerr.vision.printing.paper import parse_paper

    try:
        return parse_paper(text)
    except GeoerrError as error:
        raise typer.BadParameter(str(error), param_hint="--page") from error


def _request(what: str) -> Request:
    """Understand what is asked for; a spec that cannot be read is wrong usage, a session that cannot is refused."""
    from geoerr.vision.printing.request import read_request

    try:
        return read_request(what)
    except InputFileError as error:
        if ":" in what and error.path == what and not Path(what).exists():
            raise typer.BadParameter(str(error), param_hint="PLATE_OR_BOARD") from error
        raise


def _session_table(request: Request, artwork: Artwork) -> dict[str, Any]:
    """Give a table that session.toml takes as it is: of a plate from a spec, with a place that is to be changed."""
    if request.session_file is not None or artwork.is_board:
        return artwork.document
    return {**artwork.document, "carrier": "tool", "offset_mm": [0.0, 0.0, 0.0]}


def _as_toml(is_board: bool, table: dict[str, Any]) -> str:
    # Numbers, plain texts and lists of them are written alike in JSON and TOML.
    lines = [f"{key} = {json.dumps(value)}" for key, value in table.items()]
    return "\n".join(["[board]" if is_board else "[[targets]]", *lines])


def _page_document(request: Request, artwork: Artwork, layout: Layout) -> dict[str, Any]:
    left_mm, bottom_mm, _, height_mm = layout.box_mm
    margin_mm = artwork.quiet_zone_mm
    return {
        "description": artwork.description,
        "session_table": _session_table(request, artwork),
        "page": layout.paper,
        "orientation": layout.orientation,
        "page_mm": list(layout.page_mm),
        "pattern_mm": [artwork.pattern.width_mm, artwork.pattern.height_mm],
        "pattern_from_upper_left_mm": [
            round(left_mm + margin_mm, 6),
            round(layout.page_mm[1] - bottom_mm - height_mm + margin_mm, 6),
        ],
        "quiet_zone_mm": margin_mm,
    }
