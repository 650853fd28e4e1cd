"""Markers found and told apart, at half and at full resolution."""

import cv2
import numpy as np
import pytest
from rendering import Lens, as_picture, marker_plate, render, turned

from geoerr.vision import markers
from geoerr.vision.camera import Camera
from geoerr.vision.images import read_grey
from geoerr.vision.marker_fit import MarkerFitError
from geoerr.vision.markers import dictionaries_seen, find_markers, refine_marker
from geoerr.vision.patterns import charuco_layout, marker_bits

LENS = Lens(2319.0, 2321.0, 800.0, 600.0, -0.1, 0.1)
SIZE = (1600, 1200)


def plate(identity, u, v, side_px, dictionary="DICT_4X4_50", roll=10.0):
    depth = LENS.fx * 50.0 / side_px
    ray = np.array([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, 1.0])
    return marker_plate(marker_bits(dictionary, identity), 50.0, turned(10.0, -10.0, roll), depth * ray)


def picture(*plates, seed=0):
    values = render(plates, LENS, SIZE, samples=2, background=120.0, margin_mm=9.0)
    return as_picture(values, np.random.default_rng(seed), 2.0)


def corners_of(shown):
    edge = shown.edges_u[-1]
    return LENS.pixel(shown.points([[0, 0], [edge, 0], [edge, edge], [0, edge]]))


def test_found_with_corners_in_the_marker_s_own_order():
    shown = [plate(3, 400, 300, 120), plate(4, 1100, 800, 90, roll=200.0), plate(5, 1100, 250, 45, roll=-75.0)]
    found = find_markers(picture(*shown), [("DICT_4X4_50", n) for n in (3, 4, 5, 6)])
    assert set(found.corners_px) == {("DICT_4X4_50", n) for n in (3, 4, 5)}
    assert not found.repeated
    for identity, own in zip((3, 4, 5), shown, strict=True):
        # Within a fifth of a module, which the fit needs.
        assert np.abs(found.corners_px["DICT_4X4_50", identity] - corners_of(own)).max() < 3.0


def test_half_resolution_puts_corners_where_full_resolution_does(monkeypatch):
    shown = plate(3, 700, 500, 150)
    image = picture(shown)
    half = find_markers(image, [("DICT_4X4_50", 3)]).corners_px["DICT_4X4_50", 3]
    monkeypatch.setattr(markers, "_HALVE_ABOVE_PX", 10_000)
    full = find_markers(image, [("DICT_4X4_50", 3)]).corners_px["DICT_4X4_50", 3]
    for found in (half, full):
        assert np.abs((found - corners_of(shown)).mean(axis=0)).max() < 1.0


def test_a_marker_too_small_for_half_resolution_is_found(monkeypatch):
    image = picture(plate(3, 400, 300, 120), plate(5, 1100, 250, 22))
    assert ("DICT_4X4_50", 5) in find_markers(image, [("DICT_4X4_50", 3), ("DICT_4X4_50", 5)]).corners_px


def test_small_markers_of_a_large_picture_are_fitted_wherever_they_lie_on_its_pixels():
    """Corners of half the picture are up to three pixels off: as much as half a module of a marker 30 px wide."""
    rng = np.random.default_rng(7)
    places = [(u, v) for u in (300, 600, 900, 1200) for v in (250, 550, 850)]
    shown = [
        plate(identity, u + rng.uniform(), v + rng.uniform(), 30, roll=rng.uniform(-180, 180))
        for identity, (u, v) in enumerate(places)
    ]
    image, lens = picture(*shown), Camera(LENS.matrix, LENS.distortion)
    found = find_markers(image, [("DICT_4X4_50", identity) for identity in range(12)]).corners_px
    for identity, own in enumerate(shown):
        key = ("DICT_4X4_50", identity)
        fit = refine_marker(image, lens, key, found[key])
        straight = LENS.undistorted_pixel(own.points([[0, 0], [50, 0], [50, 50], [0, 50]]))
        assert fit.method == "photometric"
        # Fifty times the uncertainty of such a corner, a fiftieth of what a corner detector's start is off.
        assert np.abs(fit.corners_px - straight).max() < 0.05


def test_corners_that_a_local_detector_does_not_find_stand_in_for_nothing(monkeypatch):
    shown = plate(3, 700, 500, 24)
    image, lens = picture(shown), Camera(LENS.matrix, LENS.distortion)

    def fails(*_):
        raise MarkerFitError("the fit did not converge")

    monkeypatch.setattr(markers, "fit_marker", fails)
    start = corners_of(shown)
    near = refine_marker(image, lens, ("DICT_4X4_50", 3), start + 0.8)
    straight = LENS.undistorted_pixel(shown.points([[0, 0], [50, 0], [50, 50], [0, 50]]))
    stated = np.sqrt(np.diag(near.covariance_px2)).reshape(4, 2)
    assert (np.abs(near.corners_px - straight) < 3.0 * stated).all()
    start[1] += [2.2, -2.2]
    with pytest.raises(MarkerFitError, match="did not converge, and a corner detector does not find"):
        refine_marker(image, lens, ("DICT_4X4_50", 3), start)


def test_an_id_that_is_there_twice_is_told():
    image = picture(plate(3, 400, 300, 120), plate(3, 1100, 800, 100), plate(4, 1100, 250, 100))
    found = find_markers(image, [("DICT_4X4_50", 3), ("DICT_4X4_50", 4)])
    assert found.repeated == {("DICT_4X4_50", 3)}
    assert set(found.corners_px) == {("DICT_4X4_50", 4)}


def test_two_dictionaries_at_once():
    image = picture(plate(3, 400, 300, 120), plate(8, 1100, 800, 120, "DICT_6X6_250"))
    wanted = [("DICT_4X4_50", 3), ("DICT_6X6_250", 8)]
    assert set(find_markers(image, wanted).corners_px) == set(wanted)


def test_other_dictionaries_are_named():
    image = picture(plate(8, 400, 300, 120, "DICT_6X6_250"), plate(9, 1100, 800, 120, "DICT_6X6_250"))
    seen = dictionaries_seen(image)
    assert next(iter(seen)).startswith("DICT_6X6")
    assert next(iter(seen.values())) == [8, 9]


def test_fit_and_fallback(monkeypatch):
    shown = plate(3, 700, 500, 150)
    image, lens = picture(shown), Camera(LENS.matrix, LENS.distortion)
    start = find_markers(image, [("DICT_4X4_50", 3)]).corners_px["DICT_4X4_50", 3]
    fit = refine_marker(image, lens, ("DICT_4X4_50", 3), start)
    straight = LENS.undistorted_pixel(shown.points([[0, 0], [50, 0], [50, 50], [0, 50]]))
    assert fit.method == "photometric"
    assert np.abs(fit.corners_px - straight).max() < 0.03

    def fails(*_):
        raise MarkerFitError("the fit did not converge")

    monkeypatch.setattr(markers, "fit_marker", fails)
    stand_in = refine_marker(image, lens, ("DICT_4X4_50", 3), start)
    assert stand_in.method == "corner"
    assert stand_in.why == "the fit did not converge"
    assert np.abs(stand_in.corners_px - straight).max() < 1.0
    # Never silently: its stated uncertainty is tens of times larger.
    assert np.sqrt(np.diag(stand_in.covariance_px2)).min() == pytest.approx(0.3)


@pytest.mark.real_data
def test_a_photographed_board_is_flatter_with_fitted_corners(real_data):
    """Ten markers of a printed board, 25 px wide, JPEG: nearer to one plane than a local detector's corners."""
    picture = read_grey(real_data / "markers" / "choriginal.jpg")
    stored = cv2.FileStorage(str(real_data / "markers" / "tutorial_camera_params.yml"), cv2.FILE_STORAGE_READ)
    lens = Camera(stored.getNode("camera_matrix").mat(), stored.getNode("distortion_coefficients").mat().ravel()[:5])
    board = charuco_layout((5, 7), 1.0, 0.5, "DICT_6X6_250")
    found = find_markers(picture, [("DICT_6X6_250", int(n)) for n in board.marker_ids]).corners_px
    assert len(found) == 17
    on_board, fitted, local = [], [], []
    for identity, corners_mm in zip(board.marker_ids, board.marker_corners_mm, strict=True):
        key = ("DICT_6X6_250", int(identity))
        try:
            fit = refine_marker(picture, lens, key, found[key])
        except MarkerFitError:
            continue
        if fit.method == "photometric":
            on_board.append(corners_mm)
            fitted.append(fit.corners_px)
            rays = lens.normalised_from_pixel(markers._local_corners(picture, found[key], 8)[0])
            local.append(lens.undistorted_pixel_from_normalised(rays))
    assert len(fitted) >= 8
    errors = []
    for corners in (np.concatenate(fitted), np.concatenate(local)):
        plane = cv2.findHomography(np.concatenate(on_board), corners)[0]
        expected = cv2.perspectiveTransform(np.concatenate(on_board)[None], plane)[0]
        errors.append(np.sqrt(np.mean((expected - corners) ** 2)))
    assert errors[0] < 0.7 * errors[1]
