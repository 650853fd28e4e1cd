"""Paper: named sizes, and where on a page everything goes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from reportlab.lib.utils import simpleSplit

from geoerr.errors import GeoerrError, InputFileError
from geoerr.vision.printing.artwork import Artwork, in_mm

# Upright, width × height in mm (ISO 216, ANSI/ASME Y14.1), small to large.
PAPER_MM: dict[str, tuple[float, float]] = {
    "A6": (105.0, 148.0),
    "A5": (148.0, 210.0),
    "A4": (210.0, 297.0),
    "Letter": (215.9, 279.4),
    "Legal": (215.9, 355.6),
    "Tabloid": (279.4, 431.8),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}
# Tried in this order where no page is asked for.
_CHOSEN_BY_ITSELF = ("A4", "A3", "A2", "A1", "A0")
# 200 inches: what programs that read PDF are bound to understand (ISO 32000-1, annex C).
_LONGEST_PAGE_MM = 5080.0

RULER_MM = 100.0
TICK_MM = 4.0
TEXT_FONT, TEXT_POINTS = "Helvetica", 8.0
LINE_MM = 3.6
# Home printers leave about 4 to 5 mm at the edges unprinted.
_MARGIN_MM = 6.0
# Ticks and numbers on the outer side of a ruler.
RULER_BAND_MM = 8.0
# Crop marks stand outside the quiet zone, from 1 to 5 mm.
CROP_MM = (1.0, 5.0)
# Between the text, the rulers and the crop marks.
_GAP_MM = 1.5
# Half of what is written at the end of a ruler reaches beyond it.
_RULER_END_MM = 3.5
_POINTS_PER_MM = 72.0 / 25.4


@dataclass(frozen=True)
class Paper:
    """A paper: `name`, and the ways to hold it, `sizes_mm` (width, height) in the order to try them."""

    name: str
    sizes_mm: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Layout:
    """Where everything is on a page; mm from its lower left corner, upwards.

    Attributes
    ----------
    paper
        Its name: `A4`, or `120x180` for one of no name.
    page_mm
        Width and height of the page.
    box_mm
        Left, bottom, width, height of the pattern with its quiet zone.
    ruler_origin_mm
        Where both rulers have their zero.
    lines
        The text, broken into lines.
    text_at_mm
        Left end of the base line of the first line.
    """

    paper: str
    page_mm: tuple[float, float]
    box_mm: tuple[float, float, float, float]
    ruler_origin_mm: tuple[float, float]
    lines: tuple[str, ...]
    text_at_mm: tuple[float, float]

    @property
    def orientation(self) -> str:
        """`portrait` or `landscape`."""
        return "landscape" if self.page_mm[0] > self.page_mm[1] else "portrait"


def parse_paper(text: str) -> Paper:
    """Understand `A4`, `Letter`, `tabloid`, or `WxH` in mm (as it is held).

    Raises
    ------
    GeoerrError
        for anything else.
    """
    for name in PAPER_MM:
        if text.lower() == name.lower():
            return _named(name)
    try:
        width_mm, height_mm = (float(side) for side in text.lower().split("x"))
    except ValueError:
        width_mm = height_mm = math.nan
    if not (0.0 < width_mm <= _LONGEST_PAGE_MM and 0.0 < height_mm <= _LONGEST_PAGE_MM):
        raise GeoerrError(
            f"{text!r} is not a page\nhint: known are {', '.join(PAPER_MM)}, or WIDTHxHEIGHT in mm such as 320x450,"
            f" up to {_LONGEST_PAGE_MM:g} mm"
        )
    return Paper(f"{width_mm:g}x{height_mm:g}", ((width_mm, height_mm),))


def lay_out(artworks: tuple[Artwork, ...], source: str, paper: Paper | None = None) -> tuple[Layout, ...]:
    """Put each artwork on a page of its own, all on the same paper.

    Parameters
    ----------
    artworks
        What to print.
    source
        Names it in a refusal.
    paper
        The paper to take, upright or on its side as it fits; None = the smallest of A4 to A0 that holds all of them.

    Raises
    ------
    InputFileError
        if something does not fit: says the size that it needs and the papers that would do.
    """
    papers = (paper,) if paper is not None else tuple(_named(name) for name in _CHOSEN_BY_ITSELF)
    for candidate in papers:
        layouts = [_on_paper(artwork, candidate) for artwork in artworks]
        if all(layout is not None for layout in layouts):
            return tuple(layout for layout in layouts if layout is not None)
    largest = papers[-1]
    misfit = next(artwork for artwork in artworks if _on_paper(artwork, largest) is None)
    width_mm, height_mm = needed_page_mm(misfit)
    would_do = [name for name in PAPER_MM if all(_on_paper(artwork, _named(name)) for artwork in artworks)]
    own = f"--page {width_mm:g}x{height_mm:g}"
    if max(width_mm, height_mm) > _LONGEST_PAGE_MM:
        own = "smaller sizes: no page is that long"
    raise InputFileError(
        source,
        f"{misfit.description!r} is {in_mm(misfit.pattern.width_mm)} × {in_mm(misfit.pattern.height_mm)} and needs,"
        f" with quiet zone, crop marks, rulers and text, a page of at least {width_mm:g} × {height_mm:g} mm;"
        f" {largest.name} is {' × '.join(f'{side:g}' for side in largest.sizes_mm[0])} mm",
        column="page",
        remedy=f"take --page {', '.join(would_do)}, or {own}" if would_do else f"take {own}",
    )


def needed_page_mm(artwork: Artwork) -> tuple[float, float]:
    """Give width and height (whole mm) of the smallest page, of the artwork's own least width, that holds it."""
    width_mm = _whole_mm(
        max(
            2.0 * _MARGIN_MM + RULER_BAND_MM + _GAP_MM + 2.0 * CROP_MM[1] + _box_size_mm(artwork)[0],
            2.0 * _MARGIN_MM + RULER_BAND_MM + RULER_MM + _RULER_END_MM,
        )
    )
    height_mm = _whole_mm(
        max(
            _ruler_floor_mm(artwork, width_mm) + _GAP_MM + 2.0 * CROP_MM[1] + _box_size_mm(artwork)[1] + _MARGIN_MM,
            _ruler_floor_mm(artwork, width_mm) + RULER_MM + _RULER_END_MM + _MARGIN_MM,
        )
    )
    return width_mm, height_mm


def _whole_mm(size_mm: float) -> float:
    """Round up; a sum of tenths that is whole but for its rounding is whole."""
    return float(math.ceil(round(size_mm, 9)))


def _named(name: str) -> Paper:
    width_mm, height_mm = PAPER_MM[name]
    return Paper(name, ((width_mm, height_mm), (height_mm, width_mm)))


def _on_paper(artwork: Artwork, paper: Paper) -> Layout | None:
    for page_mm in paper.sizes_mm:
        layout = _on_page(artwork, paper.name, page_mm)
        if layout is not None:
            return layout
    return None


def _on_page(artwork: Artwork, name: str, page_mm: tuple[float, float]) -> Layout | None:
    box_mm = _box_size_mm(artwork)
    origin_mm = (_MARGIN_MM + RULER_BAND_MM, _ruler_floor_mm(artwork, page_mm[0]))
    corner_mm = []
    for side in range(2):
        far_mm = page_mm[side] - _MARGIN_MM
        low_mm, high_mm = origin_mm[side] + _GAP_MM + CROP_MM[1], far_mm - CROP_MM[1] - box_mm[side]
        # A hair of tolerance, so that a page of exactly the needed size holds it whatever the round-off.
        if high_mm < low_mm - 1e-9 or origin_mm[side] + RULER_MM + _RULER_END_MM > far_mm + 1e-9:
            return None
        corner_mm.append(max(low_mm, min(high_mm, 0.5 * (page_mm[side] - box_mm[side]))))
    lines = _lines(artwork, page_mm[0])
    return Layout(
        paper=name,
        page_mm=page_mm,
        box_mm=(corner_mm[0], corner_mm[1], *box_mm),
        ruler_origin_mm=origin_mm,
        lines=lines,
        text_at_mm=(_MARGIN_MM, _MARGIN_MM + LINE_MM * (len(lines) - 1) + 1.0),
    )


def _box_size_mm(artwork: Artwork) -> tuple[float, float]:
    margins_mm = 2.0 * artwork.quiet_zone_mm
    return artwork.pattern.width_mm + margins_mm, artwork.pattern.height_mm + margins_mm


def _ruler_floor_mm(artwork: Artwork, page_width_mm: float) -> float:
    """Height of the horizontal ruler's line above the lower edge of the page."""
    return _MARGIN_MM + LINE_MM * len(_lines(artwork, page_width_mm)) + _GAP_MM + RULER_BAND_MM


def _lines(artwork: Artwork, page_width_mm: float) -> tuple[str, ...]:
    width_points = (page_width_mm - 2.0 * _MARGIN_MM) * _POINTS_PER_MM
    keys = " and ".join(artwork.size_keys)
    texts = (
        artwork.description,
        f"Print at 100 %, no scaling. Measure both rulers: each must be {RULER_MM:g} mm. If both have one other"
        f" length, enter the true {keys} in session.toml; if they differ, the print is distorted: print again.",
        "Glue the sheet to something flat and stiff, then cut at the crop marks: the white quiet zone of"
        f" {in_mm(artwork.quiet_zone_mm)} belongs to it.",
    )
    return tuple(line for text in texts for line in simpleSplit(text, TEXT_FONT, TEXT_POINTS, width_points))
