"""Plates and boards as PDF: rasterised again, found again by OpenCV, at the right scale; and what is refused."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pypdfium2
import pytest
import typer
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from typer.testing import CliRunner

from geoerr.cli import target as target_verb
from geoerr.errors import GeoerrError, InputFileError
from geoerr.vision.patterns import Pattern, opencv_dictionary
from geoerr.vision.printing.artwork import Artwork
from geoerr.vision.printing.outline import black_outlines
from geoerr.vision.printing.paper import PAPER_MM, lay_out, needed_page_mm, parse_paper
from geoerr.vision.printing.pdf import pdf_bytes, write_print
from geoerr.vision.printing.request import read_request
from geoerr.vision.session import read_session

CHARUCO = "charuco:11x8:20:15:DICT_5X5_100"
CHESSBOARD = "chessboard:10x7:25"
PLATE = "aruco:DICT_4X4_50:7:56"
# The contract: 0.1 % of a length, 0.66 px on the 56 mm of a plate. Corners found by cornerSubPix are good to a few
# hundredths of a pixel on boards and to about a quarter at a plate's outer corners, where three quadrants are white.
SCALE_TOLERANCE = 1e-3

SESSION = """
[board]
type = "charuco"
squares = [11, 8]
square_mm = 20.0
marker_mm = 15.0
dictionary = "DICT_5X5_100"
[[targets]]
id = 7
dictionary = "DICT_4X4_50"
size_mm = 56.0
[[targets]]
id = 3
dictionary = "DICT_APRILTAG_36H11"
size_mm = 80
"""

Picture = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Raster:
    """A page in pixels; px_per_mm from the page's own size: renderers stretch it to whole pixels (to 0.03 %)."""

    picture: Picture
    px_per_mm: npt.NDArray[np.float64]


def rasters(pdf: Path | bytes, dpi: float = 300.0) -> list[Raster]:
    pages = []
    with pypdfium2.PdfDocument(pdf) as document:
        for page in document:
            picture = np.array(page.render(scale=dpi / 72.0, grayscale=True).to_numpy()).squeeze()
            size_mm = np.array(page.get_size()) * 25.4 / 72.0
            pages.append(Raster(picture, np.array(picture.shape[::-1]) / size_mm))
    return pages


def text_of(pdf: Path) -> str:
    with pypdfium2.PdfDocument(pdf) as document:
        return " ".join(" ".join(page.get_textpage().get_text_range().split()) for page in document)


def printed(spec: str, folder: Path, page: str | None = None) -> tuple[Raster, Path]:
    path = folder / "print.pdf"
    write_print(path, read_request(spec), None if page is None else parse_paper(page))
    (raster,) = rasters(path)
    return raster, path


def refined(picture: Picture, corners: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    found = cv2.cornerSubPix(picture, corners.reshape(-1, 1, 2).copy(), (9, 9), (-1, -1), criteria)
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)


def affine(at_mm: npt.NDArray[np.float64], at_px: npt.NDArray[np.float64], raster: Raster) -> npt.NDArray[np.float64]:
    """2 × 2 part of the least-squares affine map, mm to mm on the page: the identity for a true print."""
    design = np.column_stack([at_mm, np.ones(len(at_mm))])
    return np.linalg.lstsq(design, at_px / raster.px_per_mm, rcond=None)[0][:2].T


def detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return cv2.aruco.ArucoDetector(opencv_dictionary(dictionary), parameters)


def middles_px(profile: Picture) -> npt.NDArray[np.float64]:
    """Middle of each dark stroke of a profile, by its centre of mass (pixel edges at whole numbers)."""
    dark = 1.0 - profile / 255.0
    inside = np.concatenate(([False], dark > 0.02, [False])).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(inside) == 1), np.flatnonzero(np.diff(inside) == -1)
    centres = np.arange(len(dark)) + 0.5
    return np.array([np.average(centres[a:b], weights=dark[a:b]) for a, b in zip(starts, ends, strict=True)])


# ---- found again, at the right scale


def test_charuco_board_is_found_whole_and_true_to_scale(tmp_path: Path) -> None:
    raster, _ = printed(CHARUCO, tmp_path)
    picture = raster.picture
    board = cv2.aruco.CharucoBoard((11, 8), 20.0, 15.0, opencv_dictionary("DICT_5X5_100"))
    corners, ids, _, marker_ids = cv2.aruco.CharucoDetector(board).detectBoard(picture)
    assert sorted(ids.ravel()) == list(range(70))
    assert sorted(marker_ids.ravel()) == list(range(44))
    at_mm = np.asarray(board.getChessboardCorners(), dtype=np.float64)[ids.ravel(), :2]
    np.testing.assert_allclose(affine(at_mm, refined(picture, corners), raster), np.eye(2), atol=SCALE_TOLERANCE)


def test_chessboard_is_found_and_true_to_scale(tmp_path: Path) -> None:
    raster, _ = printed(CHESSBOARD, tmp_path)
    picture = raster.picture
    found, corners = cv2.findChessboardCorners(picture, (9, 6))
    assert found
    at_mm = 25.0 * np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    scale = affine(at_mm, refined(picture, corners), raster)
    # A chessboard may be counted from either end.
    np.testing.assert_allclose(scale * np.sign(scale[0, 0]), np.eye(2), atol=SCALE_TOLERANCE)


@pytest.mark.parametrize(
    ("dictionary", "id"),
    [
        ("DICT_4X4_50", 7),
        ("DICT_5X5_1000", 999),
        ("DICT_6X6_250", 0),
        ("DICT_7X7_100", 42),
        ("DICT_ARUCO_ORIGINAL", 5),
        ("DICT_APRILTAG_16H5", 29),
        ("DICT_APRILTAG_36H11", 586),
        ("DICT_ARUCO_MIP_36H12", 100),
    ],
)
def test_marker_is_found_upright_and_true_to_scale(tmp_path: Path, dictionary: str, id: int) -> None:
    raster, path = printed(f"aruco:{dictionary}:{id}:56", tmp_path)
    picture = raster.picture
    corners, ids, _ = detector(dictionary).detectMarkers(picture)
    assert ids.ravel().tolist() == [id]
    at_mm = np.array([[0.0, 0.0], [56.0, 0.0], [56.0, 56.0], [0.0, 56.0]])
    np.testing.assert_allclose(affine(at_mm, refined(picture, corners[0]), raster), np.eye(2), atol=SCALE_TOLERANCE)
    assert dictionary in text_of(path)
    assert f"id {id} " in text_of(path)


@pytest.mark.parametrize(("spec", "quiet_mm"), [(CHARUCO, 15.0 / 7.0), (CHESSBOARD, 12.5), (PLATE, 56.0 / 6.0)])
def test_cut_out_at_the_crop_marks_it_is_found_on_black(tmp_path: Path, spec: str, quiet_mm: float) -> None:
    request = read_request(spec)
    (layout,) = write_print(tmp_path / "print.pdf", request)
    (raster,) = rasters(tmp_path / "print.pdf")
    picture, (u_per_mm, v_per_mm) = raster.picture, raster.px_per_mm
    left_mm, bottom_mm, width_mm, height_mm = layout.box_mm
    top_mm = layout.page_mm[1] - bottom_mm - height_mm
    rows = slice(round(top_mm * v_per_mm) + 1, round((top_mm + height_mm) * v_per_mm) - 1)
    columns = slice(round(left_mm * u_per_mm) + 1, round((left_mm + width_mm) * u_per_mm) - 1)
    cut = picture[rows, columns]
    # The quiet zone is white all around, and no wider than said: one pixel further in there is black.
    quiet_px = int(quiet_mm * min(u_per_mm, v_per_mm)) - 2
    assert min(cut[:quiet_px].min(), cut[-quiet_px:].min(), cut[:, :quiet_px].min(), cut[:, -quiet_px:].min()) == 255
    assert cut[quiet_px + 3].min() == 0
    assert cut[:, quiet_px + 3].min() == 0
    small = cv2.resize(np.pad(cut, 200), None, fx=0.3, fy=0.3, interpolation=cv2.INTER_AREA)
    if spec == CHESSBOARD:
        assert cv2.findChessboardCorners(small, (9, 6))[0]
        assert cv2.findChessboardCornersSB(small, (9, 6))[0]
    elif spec == CHARUCO:
        board = cv2.aruco.CharucoBoard((11, 8), 20.0, 15.0, opencv_dictionary("DICT_5X5_100"))
        assert len(cv2.aruco.CharucoDetector(board).detectBoard(small)[1]) == 70
    else:
        assert detector("DICT_4X4_50").detectMarkers(small)[1].ravel().tolist() == [7]


@pytest.mark.parametrize("spec", [CHARUCO, PLATE])
def test_rulers_are_100_mm_with_their_ticks_where_they_belong(tmp_path: Path, spec: str) -> None:
    (layout,) = write_print(tmp_path / "print.pdf", read_request(spec))
    (raster,) = rasters(tmp_path / "print.pdf")
    picture, (u_per_mm, v_per_mm) = raster.picture, raster.px_per_mm
    x_px = layout.ruler_origin_mm[0] * u_per_mm
    y_px = (layout.page_mm[1] - layout.ruler_origin_mm[1]) * v_per_mm
    # One stripe through the millimetre ticks, one through the longer ones only.
    for depth_mm, expected_mm in ((1.0, [*range(10), *range(10, 101, 10)]), (2.6, [*range(0, 101, 10)])):
        below = picture[round(y_px + depth_mm * v_per_mm), round(x_px) - 5 : round(x_px + 100.0 * u_per_mm) + 6]
        across_mm = (middles_px(below) + round(x_px) - 5 - x_px) / u_per_mm
        beside = picture[round(y_px - 100.0 * v_per_mm) - 5 : round(y_px) + 6, round(x_px - depth_mm * u_per_mm)]
        up_mm = (y_px - middles_px(beside)[::-1] - (round(y_px - 100.0 * v_per_mm) - 5)) / v_per_mm
        for places_mm in (across_mm, up_mm):
            assert len(places_mm) == len(expected_mm)
            # The middle of an anti-aliased stroke is good to a tenth of a pixel: its three pixels have a few per
            # cent of grey uncertain each.
            np.testing.assert_allclose(places_mm, expected_mm, atol=0.1 / min(u_per_mm, v_per_mm))
            assert places_mm[-1] - places_mm[0] == pytest.approx(100.0, rel=SCALE_TOLERANCE)


@pytest.mark.parametrize("dpi", [203.0, 300.0, 611.0])
def test_no_seams_inside_the_black(dpi: float) -> None:
    # At odd resolutions neighbouring cells, drawn one by one, would show a grey seam along the pixels they share.
    request = read_request("aruco:DICT_6X6_50:3:41.3")
    layouts = lay_out(request.artworks, request.text, parse_paper("A5"))
    (raster,) = rasters(pdf_bytes(request.artworks, layouts), dpi)
    picture, (u_per_mm, v_per_mm) = raster.picture, raster.px_per_mm
    pattern = request.artworks[0].pattern
    left_mm = layouts[0].box_mm[0] + request.artworks[0].quiet_zone_mm
    top_mm = layouts[0].page_mm[1] - layouts[0].box_mm[1] - layouts[0].box_mm[3] + request.artworks[0].quiet_zone_mm
    centres_u = (np.arange(picture.shape[1]) + 0.5) / u_per_mm - left_mm
    centres_v = (np.arange(picture.shape[0]) + 0.5) / v_per_mm - top_mm
    inside_u, inside_v = (np.flatnonzero((c > 0.2) & (c < 41.1)) for c in (centres_u, centres_v))
    # A pixel must be black if the cells one pixel around it are.
    expected = np.ones((len(inside_v), len(inside_u)), dtype=bool)
    for du in (-1.1, 0.0, 1.1):
        for dv in (-1.1, 0.0, 1.1):
            columns = np.searchsorted(pattern.u_edges_mm, centres_u[inside_u] + du / u_per_mm) - 1
            rows = np.searchsorted(pattern.v_edges_mm, centres_v[inside_v] + dv / v_per_mm) - 1
            expected &= pattern.white[np.ix_(rows, columns)] == 0
    assert expected.any()
    assert picture[np.ix_(inside_v, inside_u)][expected].max() == 0


# ---- outlines


@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 7), st.integers(1, 7)), elements=st.integers(0, 1)))
@settings(max_examples=150)
def test_outlines_enclose_exactly_the_black_cells(white: npt.NDArray[np.uint8]) -> None:
    rows, columns = white.shape
    pattern = Pattern(np.cumsum(np.arange(columns + 1.0)), np.cumsum(np.arange(rows + 1.0)) * 0.5, white)
    outlines = black_outlines(pattern)
    area = 0.0
    crossings = np.zeros((rows, columns), dtype=int)
    middle_u = 0.5 * (pattern.u_edges_mm[1:] + pattern.u_edges_mm[:-1])
    middle_v = 0.5 * (pattern.v_edges_mm[1:] + pattern.v_edges_mm[:-1])
    for outline in outlines:
        after = np.roll(outline, -1, axis=0)
        steps = after - outline
        # Corners only: every edge is along one axis and the next along the other.
        assert ((steps != 0.0).sum(axis=1) == 1).all()
        assert ((steps[:, 0] != 0.0) != (np.roll(steps, -1, axis=0)[:, 0] != 0.0)).all()
        area += 0.5 * float(np.sum(outline[:, 0] * after[:, 1] - after[:, 0] * outline[:, 1]))
        for (u, v0), (u1, v1) in zip(outline, after, strict=True):
            if u == u1:
                hit = (middle_v > min(v0, v1)) & (middle_v < max(v0, v1))
                crossings += hit[:, None] & (middle_u > u)[None, :]
    assert (crossings % 2 == 1).tolist() == (white == 0).tolist()
    cells = np.outer(np.diff(pattern.v_edges_mm), np.diff(pattern.u_edges_mm))
    assert area == pytest.approx(float(cells[white == 0].sum()), abs=1e-9)


# ---- pages


def test_same_bytes_every_time_and_nothing_of_the_day(tmp_path: Path) -> None:
    first, second = tmp_path / "a.pdf", tmp_path / "b.pdf"
    write_print(first, read_request(CHARUCO))
    write_print(second, read_request(CHARUCO))
    assert first.read_bytes() == second.read_bytes()
    (tmp_path / "session.toml").write_text(SESSION)
    write_print(second, read_request(str(tmp_path / "session.toml")))
    assert first.read_bytes() == second.read_bytes()
    assert b"PrintScaling /None" in first.read_bytes()


def test_text_says_what_it_is_and_what_to_do(tmp_path: Path) -> None:
    _, path = printed(CHARUCO, tmp_path)
    text = text_of(path)
    for part in ("11 × 8 squares of 20 mm", "markers of 15 mm", "DICT_5X5_100", "Print at 100 %", "no scaling"):
        assert part in text
    for part in ("both rulers", "square_mm and marker_mm in session.toml", "2.14 mm"):
        assert part in text


@pytest.mark.parametrize(
    ("spec", "page", "paper", "orientation"),
    [
        (PLATE, None, "A4", "portrait"),
        (CHARUCO, None, "A4", "landscape"),
        (CHESSBOARD, None, "A3", "landscape"),
        ("chessboard:10x7:80", None, "A0", "landscape"),
        (PLATE, "letter", "Letter", "portrait"),
        (PLATE, "a5", "A5", "portrait"),
        (CHARUCO, "300x450", "300x450", "portrait"),
    ],
)
def test_page(tmp_path: Path, spec: str, page: str | None, paper: str, orientation: str) -> None:
    (layout,) = write_print(tmp_path / "print.pdf", read_request(spec), None if page is None else parse_paper(page))
    assert (layout.paper, layout.orientation) == (paper, orientation)
    with pypdfium2.PdfDocument(tmp_path / "print.pdf") as document:
        # A page's size is written to six decimals of a point and read in single precision.
        assert document[0].get_size() == pytest.approx([side * 72.0 / 25.4 for side in layout.page_mm], rel=1e-6)


@given(
    columns=st.integers(4, 30),
    rows=st.integers(4, 30),
    square_mm=st.floats(1.0, 60.0).map(lambda size: round(size, 2)),
)
@example(columns=4, rows=4, square_mm=51.84)
@example(columns=4, rows=4, square_mm=25.92)
@settings(max_examples=60)
def test_the_size_that_a_refusal_names_is_just_enough(columns: int, rows: int, square_mm: float) -> None:
    (artwork,) = read_request(f"chessboard:{columns}x{rows}:{square_mm}").artworks
    width_mm, height_mm = needed_page_mm(artwork)
    (layout,) = lay_out((artwork,), "board", parse_paper(f"{width_mm}x{height_mm}"))
    assert_within_page(artwork, layout.box_mm, layout.page_mm)
    with pytest.raises(InputFileError, match="needs"):
        lay_out((artwork,), "board", parse_paper(f"{width_mm - 1}x{height_mm}"))
    with pytest.raises(InputFileError, match="needs"):
        lay_out((artwork,), "board", parse_paper(f"{width_mm}x{height_mm - 1}"))


def assert_within_page(
    artwork: Artwork, box_mm: tuple[float, float, float, float], page_mm: tuple[float, float]
) -> None:
    left, bottom, width, height = box_mm
    assert width == pytest.approx(artwork.pattern.width_mm + 2.0 * artwork.quiet_zone_mm)
    # 6 mm that printers leave out, 5 mm of crop marks.
    assert left >= 11.0 - 1e-9
    assert left + width <= page_mm[0] - 11.0 + 1e-9
    assert bottom >= 11.0 - 1e-9
    assert bottom + height <= page_mm[1] - 11.0 + 1e-9


def test_what_does_not_fit_names_its_size_and_pages_that_do(tmp_path: Path) -> None:
    with pytest.raises(InputFileError) as refusal:
        printed(CHESSBOARD, tmp_path, "A4")
    message = str(refusal.value)
    (artwork,) = read_request(CHESSBOARD).artworks
    width_mm, height_mm = needed_page_mm(artwork)
    assert f"at least {width_mm:g} × {height_mm:g} mm" in message
    assert "A3" in message
    assert "A5" not in message
    assert not (tmp_path / "print.pdf").exists()
    for name in PAPER_MM:
        if name in message.partition("hint:")[2].replace(",", "").split():
            lay_out((artwork,), "board", parse_paper(name))


def test_larger_than_any_page(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no page is that long"):
        printed("chessboard:150x7:55", tmp_path)


# ---- sessions


def test_targets_of_a_session_are_a_page_each(tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text(SESSION)
    layouts = write_print(tmp_path / "print.pdf", read_request(f"{tmp_path}/session.toml#targets"))
    assert [layout.paper for layout in layouts] == ["A4", "A4"]
    first, second = (raster.picture for raster in rasters(tmp_path / "print.pdf", 150.0))
    assert detector("DICT_4X4_50").detectMarkers(first)[1].ravel().tolist() == [7]
    assert detector("DICT_APRILTAG_36H11").detectMarkers(second)[1].ravel().tolist() == [3]
    (only,) = read_request(f"{tmp_path}/session.toml#3").artworks
    assert only.document == {"id": 3, "dictionary": "DICT_APRILTAG_36H11", "size_mm": 80.0}


def test_the_folder_of_a_session_will_do(tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text(SESSION)
    by_folder, by_file, by_part = (
        read_request(text).artworks[0].document
        for text in (f"{tmp_path}#board", f"{tmp_path}/session.toml", f"{tmp_path}/session.toml#board")
    )
    assert by_folder == by_file == by_part == read_request(CHARUCO).artworks[0].document


def test_a_board_of_the_former_layout_is_printed_as_such(tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text(SESSION.replace("[board]", "[board]\nlegacy_pattern = true"))
    raster, _ = printed(str(tmp_path), tmp_path)
    found = {}
    for is_legacy in (False, True):
        board = cv2.aruco.CharucoBoard((11, 8), 20.0, 15.0, opencv_dictionary("DICT_5X5_100"))
        board.setLegacyPattern(is_legacy)
        ids = cv2.aruco.CharucoDetector(board).detectBoard(raster.picture)[1]
        found[is_legacy] = 0 if ids is None else len(ids)
    assert found == {False: 0, True: 70}
    (artwork,) = read_request(str(tmp_path)).artworks
    assert artwork.document["legacy_pattern"] is True
    assert "before OpenCV 4.6" in artwork.description
    (tmp_path / "session.toml").write_text(SESSION.replace("[board]", "[board]\nlegacy_pattern = 1"))
    with pytest.raises(InputFileError, match=r"board\.legacy_pattern: 1 is not true or false"):
        read_request(str(tmp_path))


def test_a_page_for_all_holds_the_largest(tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text(SESSION.replace("size_mm = 80", "size_mm = 200"))
    request = read_request(f"{tmp_path}/session.toml#targets")
    assert [layout.paper for layout in lay_out(request.artworks, request.text)] == ["A3", "A3"]
    with pytest.raises(InputFileError, match=r"(?s)id 3 · 200 mm.*A3"):
        lay_out(request.artworks, request.text, parse_paper("A4"))


# ---- refusals


@pytest.mark.parametrize(
    ("spec", "part", "says"),
    [
        ("charuco:11x8:20:15:DICT_5X5_99", "dictionary", "known are .*DICT_5X5_100"),
        ("aruco:4X4:7:56", "dictionary", "known are .*DICT_4X4_50"),
        ("aruco:DICT_4X4_50:50:56", "id", "no marker 50.*\n.*0 to 49"),
        ("aruco:DICT_4X4_50:-1:56", "id", "no marker -1"),
        ("aruco:DICT_4X4_50:seven:56", "id", "'seven' cannot be read"),
        ("aruco:DICT_4X4_50:7:0", "size_mm", "above 0"),
        ("aruco:DICT_4X4_50:7:nan", "size_mm", "above 0"),
        ("aruco:DICT_4X4_50:7:inf", "size_mm", "up to 5080"),
        ("aruco:DICT_4X4_50:7:1", "size_mm", "printer"),
        ("charuco:11x8:20:20:DICT_5X5_100", "marker_mm", "does not fit into a square of 20 mm\n.*15"),
        ("charuco:11x8:20:19.9:DICT_5X5_100", "marker_mm", "white around a marker"),
        ("charuco:11x8:-20:15:DICT_5X5_100", "square_mm", "above 0"),
        ("charuco:2x8:20:15:DICT_5X5_100", "squares", "3 × 3"),
        ("charuco:21x18:20:15:DICT_5X5_100", "dictionary", "needs 189 markers.*holds 100"),
        ("chessboard:3x4:20", "squares", "4 × 4"),
        ("chessboard:9999x9999:20", "squares", "200"),
        ("chessboard:10:20", "squares", "two whole numbers"),
        ("chessboard:10by7:20", "squares", "chessboard:10x7:25"),
        ("chessboard:10x7:wide", "square_mm", "'wide' cannot be read"),
    ],
)
def test_a_wrong_spec_names_the_part_and_the_remedy(spec: str, part: str, says: str) -> None:
    with pytest.raises(InputFileError, match=f"(?s){says}") as refusal:
        read_request(spec)
    assert refusal.value.column == part
    assert refusal.value.path == spec
    assert refusal.value.remedy


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("chessboard:10x7", "has 1 parts.*squares, square_mm.*\n.*chessboard:10x7:25"),
        (CHARUCO + ":9", "has 5 parts"),
        ("circles:4x11:20", "neither a session nor a spec\n.*charuco:"),
        ("no/such/session.toml", "neither a session nor a spec"),
        ("no/such/session.toml#7", "neither a session nor a spec"),
    ],
)
def test_what_is_no_spec(spec: str, says: str) -> None:
    with pytest.raises(InputFileError, match=f"(?s){says}"):
        read_request(spec)


@pytest.mark.parametrize(
    ("old", "new", "part", "column", "says"),
    [
        ('type = "charuco"', 'type = "circles"', "", "board.type", "charuco, chessboard"),
        ('type = "charuco"', "", "", "board.type", "missing"),
        ("squares = [11, 8]", "squares = [11.0, 8]", "", "board.squares", "whole numbers"),
        ("squares = [11, 8]", "squares = 11", "", "board.squares", "whole numbers"),
        ("marker_mm = 15.0", "", "", "board.marker_mm", "missing"),
        ("square_mm = 20.0", 'square_mm = "20"', "", "board.square_mm", "not a size"),
        ("[board]", "[other]", "", "board", "(?s)no board.*#targets"),
        ("[[targets]]", "[[others]]", "#targets", "targets", "no targets"),
        ("id = 7", "id = 7.5", "#targets", "targets[1].id", "no marker 7.5"),
        ("id = 3", "id = true", "#targets", "targets[2].id", "no marker True"),
        ("size_mm = 80", "size_mm = -80", "#3", "targets[2].size_mm", "above 0"),
        ("size_mm = 80", f"size_mm = 1{400 * '0'}", "#3", "targets[2].size_mm", "not a size"),
        ("id = 3", "id = 4", "#3", "targets", "ids are 7, 4"),
        (
            'id = 3\ndictionary = "DICT_APRILTAG_36H11"',
            'id = 7\ndictionary = "DICT_4X4_50"',
            "#7",
            "targets[2].id",
            "already",
        ),
        ("id = 3", "id = 3", "#nine", None, "#board, #targets"),
    ],
)
def test_a_wrong_session_names_the_key(
    tmp_path: Path, old: str, new: str, part: str, column: str | None, says: str
) -> None:
    path = tmp_path / "session.toml"
    path.write_text(SESSION.replace(old, new))
    with pytest.raises(InputFileError, match=says) as refusal:
        read_request(f"{path}{part}")
    assert refusal.value.column == column
    assert refusal.value.path == str(path)


@pytest.mark.parametrize("page", ["B4", "", "210", "210x", "0x297", "-5x20", "nanx297", "6000x6000", "1x2x3"])
def test_no_such_page(page: str) -> None:
    with pytest.raises(GeoerrError, match=r"(?s)is not a page.*A4"):
        parse_paper(page)


def test_the_session_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "session.toml"
    path.write_text(SESSION)
    with pytest.raises(InputFileError, match="is the input"):
        write_print(path, read_request(str(path)))
    assert path.read_text() == SESSION
    with pytest.raises(InputFileError, match="is a folder"):
        write_print(tmp_path, read_request(str(path)))
    with pytest.raises(InputFileError, match="does not exist"):
        write_print(tmp_path / "no" / "print.pdf", read_request(str(path)))


# ---- the verb


@pytest.fixture(name="app")
def the_verb_alone() -> typer.Typer:
    app = typer.Typer()
    app.callback()(lambda: None)
    target_verb.register(app)
    return app


def test_json_is_one_document(app: typer.Typer, tmp_path: Path) -> None:
    output = tmp_path / "print.pdf"
    result = CliRunner().invoke(app, ["target", CHARUCO, "-o", str(output), "--json"])
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert result.stderr == ""
    (page,) = document["pages"]
    assert (page["page"], page["orientation"], page["pattern_mm"]) == ("A4", "landscape", [220.0, 160.0])
    assert page["session_table"] == read_request(CHARUCO).artworks[0].document
    # Where the document says that the pattern begins, black begins.
    (raster,) = rasters(output)
    picture = raster.picture
    u_px, v_px = np.array(page["pattern_from_upper_left_mm"]) * raster.px_per_mm
    assert picture[round(v_px) + 2, round(u_px) + 2] == 0
    assert picture[round(v_px) - 2, round(u_px) + 2] == 255
    assert picture[round(v_px) + 2, round(u_px) - 2] == 255


def test_people_get_the_table_for_their_session(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["target", PLATE, "-o", str(tmp_path / "print.pdf")])
    assert result.exit_code == 0
    (tmp_path / "session.toml").write_text(result.stdout.partition("\n\n")[2].partition("\n\n")[2])
    again = read_request(f"{tmp_path}/session.toml#7").artworks
    assert again[0].document == read_request(PLATE).artworks[0].document
    # All that `measure` asks of a target is there.
    (plate,) = read_session(tmp_path).targets
    assert (plate.name, plate.size_mm, plate.carrier) == ("DICT_4X4_50:7", 56.0, "tool")
    assert "measure both rulers" in result.stderr


def test_a_spec_that_cannot_be_read_is_wrong_usage_and_a_session_that_cannot_is_refused(
    app: typer.Typer, tmp_path: Path
) -> None:
    output = ["-o", str(tmp_path / "print.pdf")]
    for spec in ("circles:4x11:20", "aruco:DICT_4X4_50:seven:56", "chessboard:10x7"):
        assert CliRunner().invoke(app, ["target", spec, *output]).exit_code == 2
    (tmp_path / "session.toml").write_text("")
    for session in (str(tmp_path), str(tmp_path / "nowhere" / "session.toml")):
        assert isinstance(CliRunner().invoke(app, ["target", session, *output]).exception, InputFileError)


def test_no_file_is_named_for_standard_output(
    app: typer.Typer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["target", PLATE, "-o", "-"])
    assert isinstance(result.exception, InputFileError)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["board.png", "board.svg", "11x8.0"])
def test_a_pdf_is_not_written_under_the_name_of_something_else(app: typer.Typer, tmp_path: Path, name: str) -> None:
    result = CliRunner().invoke(app, ["target", PLATE, "-o", str(tmp_path / name)])
    assert result.exit_code == 2
    assert "name it .pdf" in " ".join(result.stderr.replace("│", " ").split())
    assert not list(tmp_path.iterdir())


def test_ambiguous_chessboard_is_printed_with_a_note(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["target", "chessboard:8x6:20", "-o", str(tmp_path / "print.pdf")])
    assert result.exit_code == 0
    assert "half a turn" in result.stderr
    assert read_request(CHESSBOARD).artworks[0].notes == ()


def test_wrong_page_is_wrong_usage(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["target", PLATE, "-o", str(tmp_path / "print.pdf"), "--page", "B4"])
    assert result.exit_code == 2
    assert not list(tmp_path.iterdir())
