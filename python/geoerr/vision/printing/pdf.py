"""The pages: PDF of filled shapes in true size, the same bytes every time."""

from __future__ import annotations

import io
from pathlib import Path

from reportlab.pdfgen.canvas import FILL_EVEN_ODD, FILL_NON_ZERO, Canvas

from geoerr.errors import InputFileError
from geoerr.files import whole_or_absent
from geoerr.vision.printing.artwork import Artwork
from geoerr.vision.printing.outline import black_outlines
from geoerr.vision.printing.paper import (
    CROP_MM,
    LINE_MM,
    RULER_MM,
    TEXT_FONT,
    TEXT_POINTS,
    TICK_MM,
    Layout,
    Paper,
    lay_out,
)
from geoerr.vision.printing.request import Request

_POINTS_PER_MM = 72.0 / 25.4
_LINE_WIDTH_MM = 0.15
_LABEL_POINTS = 6.0
# Left, bottom, width, height in mm.
_Bar = tuple[float, float, float, float]


def write_print(path: str | Path, request: Request, paper: Paper | None = None) -> tuple[Layout, ...]:
    """Write what is asked for as PDF, one plate or board a page, whole or not at all.

    Parameters
    ----------
    path
        The PDF; may replace an earlier one, never the session.toml that it comes from.
    request
        What to print, from `read_request`.
    paper
        From `parse_paper`; None = chosen.

    Returns
    -------
    tuple of Layout
        Where everything is, a page each.

    Raises
    ------
    InputFileError
        if something does not fit on the paper, or `path` cannot be written or is the input.
    """
    output = Path(path)
    if output.is_dir():
        raise InputFileError(output, "is a folder, a PDF is to be written", remedy="name a file")
    if request.session_file is not None and output.exists() and output.samefile(request.session_file):
        raise InputFileError(output, "is the input, it is not overwritten", remedy="name another output")
    layouts = lay_out(request.artworks, request.text, paper)
    document = pdf_bytes(request.artworks, layouts)
    with whole_or_absent(output) as temporary:
        temporary.write_bytes(document)
    return layouts


def pdf_bytes(artworks: tuple[Artwork, ...], layouts: tuple[Layout, ...]) -> bytes:
    """Draw the pages; the same artworks and layouts give the same bytes."""
    stream = io.BytesIO()
    # Not compressed: compressed bytes depend on the build of zlib, and a page is a few kilobytes anyway.
    canvas = Canvas(stream, invariant=1, pageCompression=0)
    canvas.setTitle("; ".join(artwork.description for artwork in artworks))
    canvas.setAuthor("geoerr")
    canvas.setCreator("geoerr")
    canvas.setSubject("to be printed at 100 %")
    # Asks the print dialogue to offer "actual size" first, where it would shrink the page to the printer's margins.
    canvas.setViewerPreference("PrintScaling", "None")
    for artwork, layout in zip(artworks, layouts, strict=True):
        canvas.setPageSize(tuple(side * _POINTS_PER_MM for side in layout.page_mm))
        # Grey, not RGB: black is then one ink, without coloured edges where inks are out of register.
        canvas.setFillGray(0)
        _draw_pattern(canvas, artwork, layout)
        _draw_crop_marks(canvas, layout)
        _draw_rulers(canvas, layout)
        _draw_text(canvas, layout)
        canvas.showPage()
    canvas.save()
    return stream.getvalue()


def _draw_pattern(canvas: Canvas, artwork: Artwork, layout: Layout) -> None:
    left_mm, bottom_mm, _, height_mm = layout.box_mm
    margin_mm = artwork.quiet_zone_mm
    path = canvas.beginPath()
    for outline in black_outlines(artwork.pattern):
        x = (left_mm + margin_mm + outline[:, 0]) * _POINTS_PER_MM
        y = (bottom_mm + height_mm - margin_mm - outline[:, 1]) * _POINTS_PER_MM
        path.moveTo(x[0], y[0])
        for corner in range(1, len(outline)):
            path.lineTo(x[corner], y[corner])
        path.close()
    canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_EVEN_ODD)


def _draw_crop_marks(canvas: Canvas, layout: Layout) -> None:
    left_mm, bottom_mm, width_mm, height_mm = layout.box_mm
    near_mm, far_mm = CROP_MM
    right_mm, top_mm = left_mm + width_mm, bottom_mm + height_mm
    marks = []
    for y_mm in (bottom_mm, top_mm):
        marks.append(_horizontal(left_mm - far_mm, left_mm - near_mm, y_mm))
        marks.append(_horizontal(right_mm + near_mm, right_mm + far_mm, y_mm))
    for x_mm in (left_mm, right_mm):
        marks.append(_vertical(x_mm, bottom_mm - far_mm, bottom_mm - near_mm))
        marks.append(_vertical(x_mm, top_mm + near_mm, top_mm + far_mm))
    _fill(canvas, marks)


def _draw_rulers(canvas: Canvas, layout: Layout) -> None:
    x_mm, y_mm = layout.ruler_origin_mm
    bars = [_horizontal(x_mm, x_mm + RULER_MM, y_mm), _vertical(x_mm, y_mm, y_mm + RULER_MM)]
    for at_mm, tick_mm in _ticks_mm():
        bars.append(_vertical(x_mm + at_mm, y_mm - tick_mm, y_mm))
        bars.append(_horizontal(x_mm - tick_mm, x_mm, y_mm + at_mm))
    _fill(canvas, bars)
    canvas.setFont(TEXT_FONT, _LABEL_POINTS)
    away_mm = TICK_MM + 2.4
    for at_mm, label in ((0.0, "0"), (0.5 * RULER_MM, f"{0.5 * RULER_MM:g}"), (RULER_MM, f"{RULER_MM:g} mm")):
        _label(canvas, x_mm + at_mm, y_mm - away_mm, label, turned=False)
        _label(canvas, x_mm - away_mm + 1.6, y_mm + at_mm, label, turned=True)


def _ticks_mm() -> list[tuple[float, float]]:
    """Places and lengths of the ticks: every 10 mm, every 1 mm over the first centimetre."""
    tens = [(float(at), TICK_MM if at % 50 == 0 else 0.75 * TICK_MM) for at in range(0, int(RULER_MM) + 1, 10)]
    ones = [(float(at), 0.55 * TICK_MM if at == 5 else 0.4 * TICK_MM) for at in range(1, 10)]
    return tens + ones


def _draw_text(canvas: Canvas, layout: Layout) -> None:
    x_mm, y_mm = layout.text_at_mm
    canvas.setFont(TEXT_FONT, TEXT_POINTS)
    for number, line in enumerate(layout.lines):
        canvas.drawString(x_mm * _POINTS_PER_MM, (y_mm - number * LINE_MM) * _POINTS_PER_MM, line)


def _label(canvas: Canvas, x_mm: float, y_mm: float, text: str, *, turned: bool) -> None:
    canvas.saveState()
    canvas.translate(x_mm * _POINTS_PER_MM, y_mm * _POINTS_PER_MM)
    if turned:
        canvas.rotate(90.0)
    canvas.drawCentredString(0.0, 0.0, text)
    canvas.restoreState()


def _horizontal(from_mm: float, to_mm: float, y_mm: float) -> _Bar:
    return from_mm, y_mm - 0.5 * _LINE_WIDTH_MM, to_mm - from_mm, _LINE_WIDTH_MM


def _vertical(x_mm: float, from_mm: float, to_mm: float) -> _Bar:
    return x_mm - 0.5 * _LINE_WIDTH_MM, from_mm, _LINE_WIDTH_MM, to_mm - from_mm


def _fill(canvas: Canvas, bars: list[_Bar]) -> None:
    """Fill bars as one shape: programs round thin strokes, and rectangles drawn alone, to whole pixels."""
    path = canvas.beginPath()
    for bar in bars:
        path.rect(*(value * _POINTS_PER_MM for value in bar))
    canvas.drawPath(path, stroke=0, fill=1, fillMode=FILL_NON_ZERO)
