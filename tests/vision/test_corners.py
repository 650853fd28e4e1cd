"""Corners fitted to pictures that were drawn in another way: by sampling finely, then blurring."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from scipy.stats import norm

from geoerr.vision.corners import fit_corners
from geoerr.vision.normal import normal_distribution

FINE = 9
HALF = 16


def picture_of_corner(
    corner: np.ndarray, along_u: float, along_v: float, blur_px: float, dark: float = 40.0, bright: float = 190.0
) -> np.ndarray:
    """Draw one corner in the middle of a picture: dark where both board coordinates have the same sign."""
    size = 2 * HALF + 1
    place = (np.arange(size * FINE) + 0.5) / FINE - 0.5
    x, y = np.meshgrid(place - corner[0], place - corner[1])
    from_u_edge = np.cos(along_u) * y - np.sin(along_u) * x
    from_v_edge = np.cos(along_v) * y - np.sin(along_v) * x
    # Share of each fine cell with v > 0 (beyond the edge along u) and with u > 0.
    v_share = np.clip(0.5 + FINE * from_u_edge, 0.0, 1.0)
    u_share = np.clip(0.5 - FINE * from_v_edge, 0.0, 1.0)
    dark_share = v_share * u_share + (1.0 - v_share) * (1.0 - u_share)
    fine = gaussian_filter(bright + (dark - bright) * dark_share, blur_px * FINE, mode="nearest")
    return fine.reshape(size, FINE, size, FINE).mean(axis=(1, 3))


def fit_one(picture: np.ndarray, start: np.ndarray, along_u: float, along_v: float, side_px: float = 30.0):
    side_u = side_px * np.array([[np.cos(along_u), np.sin(along_u)]])
    side_v = side_px * np.array([[np.cos(along_v), np.sin(along_v)]])
    return fit_corners(np.rint(picture).clip(0, 255).astype(np.uint8), start[None], side_u, side_v)


@settings(max_examples=20)
@given(
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(-1.5, 1.5),
    st.floats(1.1, 2.0),
    st.floats(0.6, 1.4),
)
def test_a_corner_without_noise_is_found_where_it_is(u: float, v: float, turn: float, opening: float, blur: float):
    corner = HALF + np.array([u, v])
    picture = picture_of_corner(corner, turn, turn + opening, blur)
    fit = fit_one(picture, corner + np.array([0.6, -0.5]), turn + 0.05, turn + opening - 0.05)
    # Rounding can shift an edge along pixel rows by half a grey level over its slope, 150 / (√2π blur) grey per px.
    rounding_px = 0.5 * np.sqrt(2.0 * np.pi) * blur / 150.0 / np.sin(opening)
    assert np.abs(fit.corners_px[0] - corner).max() < rounding_px + 0.001
    assert fit.half_contrast_grey[0] == pytest.approx(75.0, rel=0.03)


def test_scatter_is_what_the_covariance_says():
    rng = np.random.default_rng(3)
    corner = HALF + np.array([0.31, -0.17])
    clean = picture_of_corner(corner, 0.2, 1.65, 0.9)
    found, stated = [], []
    for _ in range(150):
        fit = fit_one(clean + rng.normal(0.0, 2.0, clean.shape), corner + rng.uniform(-0.5, 0.5, 2), 0.2, 1.65)
        found.append(fit.corners_px[0] - corner)
        stated.append(fit.covariance_px2[0])
    seen, said = np.cov(np.array(found).T), np.mean(stated, axis=0)
    # A variance from 150 draws is within 12 % of the true one (1 σ): three of that.
    assert np.trace(seen) == pytest.approx(np.trace(said), rel=0.36)
    assert np.abs(np.mean(found, axis=0)).max() < 3.5 * np.sqrt(said[0, 0] / 150) + 0.001


def test_colours_tell_the_corner_from_its_negative():
    corner = np.array([HALF, HALF], dtype=float)
    negative = picture_of_corner(corner, 0.1, 1.7, 0.8, dark=190.0, bright=40.0)
    assert fit_one(negative, corner, 0.1, 1.7).half_contrast_grey[0] == pytest.approx(-75.0, rel=0.03)


def test_what_is_no_corner_is_nan():
    corner = np.array([HALF, HALF], dtype=float)
    flat = np.full((33, 33), 120.0)
    noise = flat + np.random.default_rng(1).normal(0.0, 3.0, flat.shape)
    edge = np.where(np.arange(33) < HALF, 40.0, 190.0) * np.ones((33, 1))
    for picture in (flat, noise, edge):
        assert np.isnan(fit_one(picture, corner, 0.0, 1.57).corners_px).all()
    good = picture_of_corner(corner, 0.0, 1.57, 0.8)
    assert np.isnan(fit_one(good, corner + 4.0, 0.0, 1.57).corners_px).all()
    # Half outside of the picture, and squares too small to have an inside.
    assert np.isnan(fit_one(good[:, HALF - 1 :], corner - np.array([HALF - 1, 0]), 0.0, 1.57).corners_px).all()
    assert np.isnan(fit_one(good, corner, 0.0, 1.57, side_px=5.0).corners_px).all()


def test_pixels_of_markers_do_not_pull():
    corner = HALF + np.array([0.2, 0.3])
    picture = picture_of_corner(corner, 0.0, 0.5 * np.pi, 0.8)
    u, v = np.meshgrid(np.arange(33) - corner[0], np.arange(33) - corner[1])
    # A marker in the square towards +u −v, six pixels from both edges.
    with_marker = np.where((u > 6.0) & (v < -6.0), 40.0, picture)
    side = np.array([[30.0, 0.0]]), np.array([[0.0, 30.0]])
    fits = [
        fit_corners(np.rint(with_marker).astype(np.uint8), corner[None], *side, gap_of_side=gap).corners_px[0]
        - corner
        for gap in (6.0 / 30.0, np.inf)
    ]
    assert np.abs(fits[0]).max() < 0.005
    assert np.abs(fits[1]).max() > 0.02


def test_a_corner_of_whose_window_markers_leave_a_strip_drops_itself_only():
    """Of a small foreshortened board: what is clear of markers there is one column of pixels."""
    grey = np.full((2 * HALF + 1, 80), 120.0)
    corners = np.array([[HALF + 0.3, HALF], [HALF + 40.3, HALF]])
    own = np.array([HALF + 0.3, HALF])
    for corner in corners:
        left = int(corner[0]) - HALF
        grey[:, left : left + 2 * HALF + 1] = picture_of_corner(own, 0.0, 0.5 * np.pi, 0.8)
    side_u, side_v = np.array([[27.0, 0.0], [40.0, 0.0]]), np.array([[0.0, 22.0], [0.0, 40.0]])
    fit = fit_corners(np.rint(grey).astype(np.uint8), corners, side_u, side_v, gap_of_side=0.109)
    assert np.isnan(fit.corners_px[0]).all()
    assert np.abs(fit.corners_px[1] - corners[1]).max() < 0.01


def test_a_corner_does_not_depend_on_its_neighbours():
    rng = np.random.default_rng(8)
    picture = np.full((40, 40 * 5), 120.0)
    starts = []
    for place in range(5):
        corner = HALF + rng.uniform(-0.5, 0.5, 2)
        picture[:33, 40 * place : 40 * place + 33] = picture_of_corner(corner, 0.1, 1.6, 0.8)
        starts.append(corner + np.array([40 * place + 0.4, -0.4]))
    grey = np.rint(picture + rng.normal(0, 2, picture.shape)).clip(0, 255).astype(np.uint8)
    sides = np.tile([[30.0, 3.0]], (5, 1)), np.tile([[-3.0, 30.0]], (5, 1))
    together = fit_corners(grey, np.array(starts), *sides)
    for place in range(5):
        one = slice(place, place + 1)
        alone = fit_corners(grey, np.array(starts)[one], sides[0][one], sides[1][one])
        assert np.array_equal(alone.corners_px[0], together.corners_px[place])
    assert len(fit_corners(grey, np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2))).corners_px) == 0


def test_normal_distribution():
    z = np.linspace(-9.0, 9.0, 4001)
    below, density = normal_distribution(z)
    assert np.abs(below - norm.cdf(z)).max() < 1e-7
    assert np.allclose(density, norm.pdf(z), rtol=1e-13, atol=0.0)
    assert normal_distribution(z.astype(np.float32))[0].dtype == np.float32
