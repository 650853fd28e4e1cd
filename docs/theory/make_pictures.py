"""Draws the pictures of the theory: `python docs/theory/make_pictures.py [NAME...]`.

Diagrams are drawn by hand; whatever shows a number has it from geoerr: covariances of points, what a calibration
moves, corrected programs, and what chance finds in a search. A test holds the pictures to what this script makes.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

import geoerr
from geoerr.compensate.program import compensate_bytes
from geoerr.diagnose.offers import Offers
from geoerr.diagnose.search import reference_of, search
from geoerr.effects import catalogue
from geoerr.error_functions import ErrorFunction, ErrorFunctions, Squareness
from geoerr.geometry import triangulate
from geoerr.observations import observations_from_columns
from geoerr.vision.rig import Rig, RightFromLeft
from geoerr.vision.sensitivity import sensitivity_of_points

FOLDER = Path(__file__).parent
BLUE, ORANGE, GREEN, VIOLET, GREY, INK = "#1f5fa8", "#d1660f", "#2a8a4a", "#8a4aa0", "#999", "#333"
# Li's lens: 8 mm before pixels of 3.45 µm; cameras 300 mm apart, both looking the same way.
_FOCAL_PX, _BASELINE_MM = 8.0 / 0.00345, 300.0
_UM = 1e3

Numbers = npt.NDArray[np.float64]
# A place in a picture, px.
Point = Sequence[float] | Numbers


class Drawing:
    """A picture that is being drawn, px; y goes down."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.parts: list[str] = []

    def line(self, points: Sequence[Point], colour: str, width: float = 1.6, dash: str = "") -> None:
        """Draw through points."""
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.parts.append(
            f'<polyline fill="none" stroke="{colour}" stroke-width="{width:g}"{dashed} points="{text}"/>'
        )

    def arrow(self, start: Point, end: Point, colour: str, width: float = 1.6) -> None:
        """Draw an arrow; one too short for a head is a line."""
        a, b = np.array(start, dtype=float), np.array(end, dtype=float)
        self.line([a, b], colour, width)
        length = float(np.hypot(*(b - a)))
        if length < 4.0:
            return
        along = (b - a) / length
        across = np.array([-along[1], along[0]])
        size = min(7.0, 0.5 * length)
        corners = [b, b - size * along + 0.4 * size * across, b - size * along - 0.4 * size * across]
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        self.parts.append(f'<polygon fill="{colour}" points="{text}"/>')

    def dot(self, x: float, y: float, colour: str, radius: float = 3.0) -> None:
        """Draw a filled circle."""
        self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{colour}"/>')

    def box(self, x: float, y: float, width: float, height: float, colour: str, fill: str = "none") -> None:
        """Draw a rectangle from its upper left corner."""
        self.parts.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="3" '
            f'fill="{fill}" stroke="{colour}" stroke-width="1.5"/>'
        )

    def text(self, x: float, y: float, words: str, colour: str = INK, anchor: str = "start") -> None:
        """Write words; `anchor` is start, middle or end."""
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}">{words}</text>')

    def svg(self) -> str:
        """Give the picture."""
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}"'
            f' width="{self.width}" height="{self.height}" font-family="sans-serif" font-size="12">'
        )
        paper = f'<rect width="{self.width}" height="{self.height}" fill="#fff"/>'
        return "\n".join([head, paper, *self.parts, "</svg>"]) + "\n"


def chain() -> str:
    """Draw the carriages of two machines, from the base outwards."""
    drawing = Drawing(640, 256)
    for left, code in ((20, "wbXYZt"), (340, "wZbXYt")):
        work, tool = code[1:-1].split("b")
        drawing.text(left, 22, code, INK)
        drawing.line([(left, 214), (left + 285, 214)], GREY, 3.0)
        drawing.text(left, 232, "base", GREY)
        for side, axes, at, colour in (("work", work[::-1], left + 70, GREEN), ("tool", tool, left + 220, BLUE)):
            bottom = 214.0
            for axis in axes:
                drawing.line([(at, bottom), (at, bottom - 14)], colour)
                drawing.box(at - 45, bottom - 38, 90, 24, colour, "#eef3f8" if side == "tool" else "#eaf5ec")
                sign = "" if side == "tool" else "−"
                low = axis.lower()
                drawing.text(at, bottom - 21, f"{axis}: {sign}{low}, δ, ε", colour, "middle")
                bottom -= 38
            drawing.line([(at, bottom), (at, bottom - 16)], colour)
            drawing.dot(at, bottom - 20, ORANGE, 5.0)
            drawing.text(at, bottom - 32, f"target on the {side}: T_{side}", ORANGE, "middle")
    drawing.text(20, 250, "A camera on the floor sees each side by itself; the part sees the tool from the work", INK)
    return drawing.svg()


def abbe() -> str:
    """Draw what one angle does to targets at three levers; the errors are those of the exact chain."""
    machine = geoerr.Machine.from_chain("wbXYZt", travel_mm=(400.0, 400.0, 400.0))
    angle_rad = 150e-6
    function = ErrorFunction(np.array([0.0, 400.0]), np.array([0.0, angle_rad]))
    model = geoerr.Model(machine, ErrorFunctions(machine, {"EBX": function}, {}, method="drawn"))
    drawing = Drawing(640, 270)
    drawing.line([(30, 240), (600, 240)], GREY, 3.0)
    drawing.text(30, 258, "guideway of X", GREY)
    turn, scale = 0.15, 0.45
    for left, is_turned in ((140.0, False), (380.0, True)):
        c, s = (np.cos(turn), np.sin(turn)) if is_turned else (1.0, 0.0)

        def place(x: float, z: float, left: float = left, c: float = c, s: float = s) -> tuple[float, float]:
            return left + scale * (c * x + s * z), 226 - scale * (-s * x + c * z)

        drawing.line([place(-70, -20), place(70, -20), place(70, 20), place(-70, 20), place(-70, -20)], BLUE)
        drawing.line([place(0, 20), place(0, 400)], BLUE)
        if not is_turned:
            drawing.text(left - 66, 60, "x = 0", INK)
            for z in (100.0, 250.0, 400.0):
                drawing.dot(*place(0, z), BLUE, 4.0)
                drawing.text(place(0, z)[0] + 9, place(0, z)[1] + 4, f"l_z = {z:g} mm", INK)
            continue
        drawing.line([(left, 226), (left, 226 - scale * 400)], GREY, 1.0, "3 3")
        drawing.text(left - 76, 60, "x = 400 mm", INK)
        for z in (100.0, 250.0, 400.0):
            error_um = _UM * model.error_mm([[400.0, 0.0, 0.0]], [[0.0, 0.0, z]])[0]
            drawing.arrow((left, place(0, z)[1]), place(0, z), ORANGE)
            drawing.dot(*place(0, z), BLUE, 4.0)
            drawing.text(place(0, z)[0] + 9, place(0, z)[1] + 4, f"E_x = {error_um[0]:.1f} µm", ORANGE)
    drawing.text(20, 18, f"One angle, ε_yx = {angle_rad * 1e6:g} µrad, and three levers (drawn 1000 times as large)")
    return drawing.svg()


def nine_lines() -> str:
    """Draw Li's nine lines from an oblique view."""
    drawing = Drawing(640, 330)

    def place(x: float, y: float, z: float) -> tuple[float, float]:
        return 160 + 0.52 * x - 0.33 * y, 222 + 0.1 * x + 0.16 * y - 0.45 * z

    off, length = 200.0, 400.0
    # Number, axis, offset of the target on its carrier.
    lines = (
        *((1, 0, (0, 0, 0)), (2, 1, (0, 0, 0)), (3, 2, (0, 0, 0))),
        *((4, 0, (0, 0, off)), (5, 0, (0, off, 0)), (6, 1, (0, 0, off))),
        *((7, 1, (off, 0, 0)), (8, 2, (0, off, 0)), (9, 2, (off, 0, 0))),
    )
    for number, axis, offset in lines:
        start, end = np.array(offset, dtype=float), np.array(offset, dtype=float)
        end[axis] += length
        is_first = number <= 3
        colour = (BLUE, ORANGE, GREEN)[axis]
        drawing.arrow(place(*start), place(*end), colour, 2.4 if is_first else 1.4)
        if not is_first:
            drawing.line([place(0, 0, 0), place(*start)], GREY, 1.0, "3 3")
            drawing.dot(*place(*start), colour)
        label = place(*(start + (end - start) * 0.82))
        shift = ((0, -6), (-14, 0), (6, 4))[axis]
        drawing.text(label[0] + shift[0], label[1] + shift[1], str(number), colour)
    drawing.dot(*place(0, 0, 0), INK, 4.0)
    for words, axis, shift in (("x", 0, (6, 8)), ("y", 1, (-14, 8)), ("z", 2, (-4, -8))):
        at = np.zeros(3)
        at[axis] = length
        x, y = place(*at)
        drawing.text(x + shift[0], y + shift[1], words, INK)
    notes = (
        "1, 2, 3: the first target, along each axis:",
        "positioning (Eq. 17), straightness, squareness",
        "4 to 9: targets at x₀, y₀ or z₀ from it,",
        "on the same carriage: how much further",
        "than the first tells pitch and yaw (Eq. 18),",
        "how far aside tells roll",
    )
    for number, words in enumerate(notes):
        drawing.text(384, 30 + 17 * number, words, INK if number < 2 else "#555")
    return drawing.svg()


def circle() -> str:
    """Draw what a squareness alone makes of a circle, and what Li's Eq. 23 sees of it: nothing."""
    machine = geoerr.Machine.from_chain("wbXYZt", travel_mm=(424.0, 540.0, 400.0))
    squareness_rad, radius_mm, middle_mm = -5.05e-3, 100.0, np.array([212.0, 270.0])
    errors = ErrorFunctions(machine, {}, {"EC0Y": Squareness(squareness_rad)}, method="drawn")
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    direction = np.column_stack([np.cos(turn), np.sin(turn)])
    places = np.column_stack([middle_mm + radius_mm * direction, np.zeros(len(turn))])
    error_mm = geoerr.Model(machine, errors).error_mm(places)[:, :2]
    # About its own centre, as a circular test has it (ISO 230-4).
    radial_mm = (error_mm * direction).sum(axis=1)
    radial_mm -= direction @ np.linalg.lstsq(direction[:-1], radial_mm[:-1], rcond=None)[0]
    drawing = Drawing(640, 270)
    drawn_radius, enlarged, at = 90.0, 60.0, np.array([140.0, 150.0])
    scale = drawn_radius / radius_mm
    flip = np.array([1.0, -1.0])
    drawing.line(list(at + flip * drawn_radius * direction), GREY, 1.4, "4 3")
    actual = direction * (radius_mm + enlarged * radial_mm)[:, None]
    drawing.line(list(at + flip * scale * actual), ORANGE, 2.0)
    drawing.text(20, 22, "A circle of 100 mm on a machine whose axes are out of square, and nothing else")
    deviation_mm = float(np.ptp(radial_mm))
    drawing.text(290, 110, f"S_xy = −{abs(squareness_rad) * 1e3:.2f} mrad: circular deviation", ORANGE)
    drawing.text(290, 127, f"{deviation_mm:.3f} mm = |S|·R (drawn {enlarged:g} times as large)", ORANGE)
    drawing.text(290, 165, "Eq. 23 as it is printed: no squareness, no deviation", "#666")
    return drawing.svg()


def rays() -> str:
    """Draw two cameras from above, and how sure a point is by its distance."""
    drawing = Drawing(640, 300)
    left, right = _projections()
    scale = 0.33

    def place(x: float, z: float) -> tuple[float, float]:
        return 50 + scale * z, 170 - scale * (x - 0.5 * _BASELINE_MM)

    for camera_x, name in ((0.0, "left"), (_BASELINE_MM, "right")):
        x, y = place(camera_x, 0.0)
        drawing.box(x - 26, y - 9, 26, 18, INK, "#eee")
        drawing.text(x - 13, y - 14 if name == "right" else y + 24, name, INK, "middle")
    enlarged, sigma_px = 600.0, 0.05
    points = np.array([[150.0, 0.0, 500.0], [150.0, 0.0, 1000.0], [150.0, 0.0, 1500.0]])
    seen = [_project(matrix, points) for matrix in (left, right)]
    found = triangulate(left, right, *seen, sigma_px=sigma_px)
    turn = np.linspace(0.0, 2.0 * np.pi, 61)
    for point, covariance in zip(points, found.covariance_mm2, strict=True):
        for camera_x in (0.0, _BASELINE_MM):
            drawing.line([place(camera_x, 0.0), place(point[0], point[2])], GREY, 1.0)
        value, vector = np.linalg.eigh(covariance[np.ix_([0, 2], [0, 2])])
        ring = (vector * np.sqrt(value)) @ np.array([np.cos(turn), np.sin(turn)])
        drawing.line([place(point[0] + enlarged * a, point[2] + enlarged * b) for a, b in ring.T], ORANGE, 1.8)
        drawing.dot(*place(point[0], point[2]), BLUE)
        across, depth = _UM * np.sqrt(np.diag(covariance))[[0, 2]]
        x, y = place(point[0], point[2])
        drawing.text(x, 262, f"z = {point[2]:g} mm", INK, "middle")
        drawing.text(x, 278, f"across {across:.1f} µm", INK, "middle")
        drawing.text(x, 294, f"depth {depth:.1f} µm", ORANGE, "middle")
    drawing.text(20, 22, f"Two cameras {_BASELINE_MM:g} mm apart, seen from above; pixels known to {sigma_px:g} px.")
    drawing.text(20, 40, f"Ellipses: one standard uncertainty, {enlarged:g} times enlarged", ORANGE)
    return drawing.svg()


def rig_or_noise() -> str:
    """Draw what the noise of pictures and what an error of the calibration do to a grid of points."""
    drawing = Drawing(640, 300)
    camera = np.array([[_FOCAL_PX, 0.0, 1224.0], [0.0, _FOCAL_PX, 1024.0], [0.0, 0.0, 1.0]])
    apart = RightFromLeft(np.eye(3), np.array([-_BASELINE_MM, 0.0, 0.0]))
    rig = Rig(camera, np.zeros(5), camera, np.zeros(5), apart, (2448, 2048))
    x, z = (one.ravel() for one in np.meshgrid(np.linspace(0.0, 300.0, 6), np.linspace(700.0, 1100.0, 6)))
    points = np.column_stack([x, np.zeros_like(x), z])
    left, right = _projections()
    found = triangulate(left, right, _project(left, points), _project(right, points), sigma_px=0.02)
    rng = np.random.default_rng(3)
    noise = np.array([np.linalg.cholesky(one) @ rng.standard_normal(3) for one in found.covariance_mm2])
    # The right camera turned by 10 µrad about the vertical, its focal length 0.1 px wrong.
    error = np.zeros(len(rig.parameter_names))
    error[list(rig.parameter_names).index("rotation_y_rad")] = 1e-5
    error[list(rig.parameter_names).index("right_fx_px")] = 0.1
    moved = sensitivity_of_points(rig, points) @ error
    enlarged = 900.0
    heads = (
        (20.0, noise, "noise of pictures, 0.02 px: each point", "by itself; repeats make it small", BLUE),
        (340.0, moved, "one error of calibration: all points", "together; repeats do not show it", ORANGE),
    )
    for start, field, words, more, colour in heads:
        drawing.text(start, 22, words, INK)
        drawing.text(start, 38, more, INK)
        for point, step in zip(points, field, strict=True):
            at = (start + 20 + 0.6 * (point[2] - 700.0), 262 - 0.6 * point[0])
            end = (at[0] + 0.6 * enlarged * step[2], at[1] - 0.6 * enlarged * step[0])
            drawing.dot(*at, GREY, 2.0)
            drawing.arrow(at, end, colour, 1.4)
        drawing.text(start, 292, "depth from 700 to 1100 mm →", "#555")
    return drawing.svg()


def noise() -> str:
    """Draw the three kinds of noise that a search counts with: scatter, offsets of passes, a drift."""
    drawing = Drawing(640, 250)
    rng = np.random.default_rng(8)
    n_passes, n_rows = 8, 12
    n = n_passes * n_rows
    steps = rng.standard_normal(n)
    drift = np.zeros(n)
    for k in range(1, n):
        drift[k] = 0.97 * drift[k - 1] + 0.24 * steps[k]
    offset = np.repeat(rng.standard_normal(n_passes), n_rows)
    scatter = 0.5 * rng.standard_normal(n)
    across, middle, up = 590.0 / n, 140.0, 22.0

    def at(values: Numbers, rows: slice) -> list[tuple[float, float]]:
        return [(30 + across * k, middle - up * values[k]) for k in range(rows.start, rows.stop)]

    for k in range(n_passes + 1):
        drawing.line([(30 + across * (k * n_rows - 0.5), 60), (30 + across * (k * n_rows - 0.5), 220)], "#ddd", 1.0)
    drawing.line(at(drift, slice(0, n)), GREEN, 2.0)
    for k in range(n_passes):
        rows = slice(k * n_rows, (k + 1) * n_rows)
        drawing.line(at(drift + offset, rows), ORANGE, 2.0)
        for x, y in at(drift + offset + scatter, rows):
            drawing.dot(x, y, BLUE, 2.0)
    drawing.text(20, 22, "One component of what a fit leaves, in the order of time; upright lines part the passes")
    drawing.text(20, 44, "drift of the session (b, τ)", GREEN)
    drawing.text(210, 44, "and an offset of each pass (a)", ORANGE)
    drawing.text(420, 44, "and scatter of each row (σ)", BLUE)
    drawing.text(20, 242, "time →", "#555")
    return drawing.svg()


def projection() -> str:
    """Draw what a candidate can explain beyond the model, and how alike two candidates are."""
    drawing = Drawing(640, 260)
    origin = np.array([70.0, 196.0])
    drawing.parts.append('<polygon points="20,226 330,226 420,166 110,166" fill="#eef3f8" stroke="#1f5fa8"/>')
    drawing.text(228, 242, "all that the model can do: Q", BLUE)
    candidate, residual = np.array([210.0, -84.0]), np.array([0.0, -140.0])
    foot = np.array([210.0, 6.0])
    drawing.arrow(origin, origin + candidate, ORANGE, 2.0)
    drawing.text(origin[0] + candidate[0] + 8, origin[1] + candidate[1], "a candidate b", ORANGE)
    drawing.line([origin + candidate, origin + foot], GREY, 1.2, "3 3")
    drawing.arrow(origin, origin + foot, GREY, 1.4)
    drawing.text(origin[0] + 96, origin[1] + 18, "the model's part: QQᵀb", "#666")
    drawing.arrow(origin, origin + residual, INK, 2.0)
    drawing.text(origin[0] - 52, origin[1] + residual[1] - 6, "r, which the model leaves", INK)
    drawing.arrow(origin + np.array([3.0, 0.0]), origin + np.array([3.0, -90.0]), GREEN, 2.4)
    drawing.text(origin[0] + 12, origin[1] - 62, "b less its model's part:", GREEN)
    drawing.text(origin[0] + 12, origin[1] - 46, "what it can explain", GREEN)
    base = np.array([460.0, 200.0])
    drawing.text(440, 22, "Off the model, two candidates:", INK)
    drawing.arrow(base, base - np.array([0.0, 150.0]), GREEN, 2.2)
    drawing.text(base[0] - 8, base[1] - 154, "d: what the best explains", GREEN)
    other = np.array([np.sin(0.5), -np.cos(0.5)]) * 150.0
    drawing.arrow(base, base + other, VIOLET, 2.2)
    drawing.text(base[0] + 80, base[1] + other[1] + 2, "another", VIOLET)
    angle = np.linspace(0.0, 0.5, 20)
    drawing.line([base + 52 * np.array([np.sin(a), -np.cos(a)]) for a in angle], GREY, 1.2)
    drawing.text(base[0] + 40, base[1] - 42, "correlation:", INK)
    drawing.text(base[0] + 40, base[1] - 26, f"its cosine, {np.cos(0.5):.2f}", INK)
    return drawing.svg()


def chance() -> str:
    """Draw what chance finds in a search, and what was found: a small play in the noise of measurements."""
    table, machine = _with_play(0.0034)
    fitted = geoerr.compare(geoerr.fit_model(machine, table, components="12").model, table).points
    look = search(fitted, Offers(catalogue())).first
    drawn = np.sort(look.null.largest)[::-1]
    shares = np.arange(1, len(drawn) + 1) / (len(drawn) + 1)
    drawing = Drawing(640, 300)
    high, lowest = 14.0, 1e-5

    def place(surprise: float, share: float) -> tuple[float, float]:
        return 60 + 520 * surprise / high, 60 + 200 * np.log10(share) / np.log10(lowest)

    drawing.line([place(0.0, 1.0), place(0.0, lowest), place(high, lowest)], INK, 1.0)
    for power in range(0, -6, -1):
        x, y = place(0.0, 10.0**power)
        drawing.text(x - 6, y + 4, "1" if power == 0 else f"10{_superscript(power)}", INK, "end")
    for surprise in range(0, 15, 2):
        x, y = place(float(surprise), lowest)
        drawing.text(x, y + 16, str(surprise), INK, "middle")
    drawing.text(580, 292, "largest surprise of a search", INK, "end")
    drawing.text(20, 22, f"Share of {len(drawn)} searches of noise that find as much (dots), their tail (line),")
    drawing.text(20, 38, "and where three candidates of the data lie")
    for found, share in zip(drawn, shares, strict=True):
        drawing.dot(*place(float(found), float(share)), BLUE, 2.2)
    grid = np.linspace(float(drawn[9]), 0.97 * high, 60)
    tail = -np.expm1(-np.exp(-look.null.standardized(grid)))
    drawing.line([place(s, p) for s, p in zip(grid, tail, strict=True) if p > lowest], BLUE, 1.6)
    words_y = np.inf
    for judged in look.candidates[:3]:
        p_value = look.null.p_value(judged.surprise)
        x, y = place(judged.surprise, p_value)
        drawing.line([place(judged.surprise, lowest), (x, y)], ORANGE, 1.4, "4 3")
        drawing.dot(x, y, ORANGE, 4.0)
        # Above those of one that is near.
        words_y = y - 4 if abs(y - 4 - words_y) > 14 else words_y - 14
        drawing.text(x + 9, words_y, f"{reference_of(judged)}: {_share_words(p_value)}", ORANGE)
    return drawing.svg()


def split() -> str:
    """Draw how far off a straight move is: as programmed, with its ends corrected, and cut."""
    model = _bent()
    program = b"G21\nG90\nG0 X10 Y200 Z200\nG1 X390 F1200\n"
    drawing = Drawing(640, 300)
    tolerance_um = 5.0
    curves = []
    for words, tolerance_mm, colour in (("both ends corrected", 10.0, GREEN), ("cut", 1e-3 * tolerance_um, BLUE)):
        written = compensate_bytes(model, program, geoerr.CompensationOptions(tolerance_mm=tolerance_mm))[0]
        ends = _positions(written.decode())
        curves.append((words, colour, ends, *_deviation_um(model, ends)))
    share = np.linspace(0.0, 1.0, 401)
    whole = np.array([10.0, 200.0, 200.0]) + np.outer(share, [380.0, 0.0, 0.0])
    before = _UM * np.linalg.norm(model.error_mm(whole), axis=1)
    most = 1.1 * max(float(before.max()), *(float(one[4].max()) for one in curves))

    def place(x: float, off_um: float) -> tuple[float, float]:
        return 60 + 1.35 * x, 250 - 190 * off_um / most

    drawing.line([place(0, most), place(0, 0), place(400, 0)], INK, 1.0)
    drawing.line([place(0, tolerance_um), place(400, tolerance_um)], GREY, 1.0, "3 3")
    drawing.text(place(400, tolerance_um)[0] + 4, place(400, tolerance_um)[1] + 1, "5 µm", "#666")
    drawing.line([place(x, e) for x, e in zip(whole[:, 0], before, strict=True)], ORANGE)
    for _, colour, ends, at, off_um in curves:
        drawing.line([place(a, b) for a, b in zip(at, off_um, strict=True)], colour)
        for x in ends[1:-1, 0] if colour == BLUE else ():
            drawing.line([place(x, 0.0), (place(x, 0.0)[0], 255)], BLUE, 1.4)
    drawing.text(20, 22, "How far the tool is from where a straight move along X should have it, µm")
    drawing.text(70, 44, f"as programmed: {before.max():.0f}", ORANGE)
    for shift, (words, colour, ends, _, off_um) in zip((200, 400), curves, strict=True):
        pieces = f" into {len(ends) - 1} pieces" if colour == BLUE else ""
        drawing.text(70 + shift, 44, f"{words}{pieces}: {off_um.max():.1f}", colour)
    for x in (0, 100, 200, 300, 400):
        drawing.text(place(x, 0)[0], 272, str(x), INK, "middle")
    drawing.text(600, 290, "x, mm", INK, "end")
    return drawing.svg()


def reversal() -> str:
    """Draw what a correction adds to the command along a way there and back, with play in X."""
    machine = geoerr.Machine.from_chain("wbXYZt", travel_mm=(400.0, 400.0, 400.0))
    play_mm = 0.02
    term = catalogue()["backlash"].term("x", None, machine)
    model = geoerr.Model(machine) + term.with_values([play_mm], [])
    program = b"G21\nG90\nG0 X100 Y100 Z10\nG1 X120 E1 F1200\nG1 X300 E10\nG1 X120 E19\nG1 Y110 E19.5\nG1 X300 E28\n"
    written, _ = compensate_bytes(model, program)
    ends = _positions(written.decode())
    programmed = _programmed(written.decode(), program.decode())
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(programmed, axis=0)).sum(axis=1))])
    drawing = Drawing(640, 250)

    def place(at: float, added_um: float) -> tuple[float, float]:
        return 60 + 0.95 * at, 130 - 5.5 * added_um

    added_um = _UM * (ends[:, 0] - programmed[:, 0])
    drawing.line([place(0, 0), place(float(way[-1]), 0)], GREY, 1.0, "3 3")
    drawing.line([place(0, 14), place(0, -14)], INK, 1.0)
    for value in (-10, 0, 10):
        drawing.text(52, place(0, value)[1] + 4, f"{value:g}".replace("-", "−"), INK, "end")
    drawing.line([place(a, b) for a, b in zip(way, added_um, strict=True)], BLUE, 2.0)
    for number, (a, b) in enumerate(zip(way, added_um, strict=True)):
        drawing.dot(*place(a, b), BLUE, 3.0)
        if number and way[number] == way[number - 1]:
            drawing.line([place(a, added_um[number - 1]), place(a, b)], ORANGE, 3.0)
    drawing.text(
        20, 22, f"Command less programmed x, µm, with {_UM * play_mm:g} µm of play: X goes, comes back, goes again"
    )
    drawing.text(20, 44, "At each reversal a piece of its own takes up the play, and extrudes nothing", ORANGE)
    drawing.text(600, 240, "way along the program, mm →", "#555", "end")
    return drawing.svg()


def _projections() -> tuple[Numbers, Numbers]:
    camera = np.array([[_FOCAL_PX, 0.0, 1224.0], [0.0, _FOCAL_PX, 1024.0], [0.0, 0.0, 1.0]])
    return camera @ np.eye(3, 4), camera @ np.column_stack([np.eye(3), [-_BASELINE_MM, 0.0, 0.0]])


def _project(projection: Numbers, points_mm: Numbers) -> Numbers:
    seen = points_mm @ projection[:, :3].T + projection[:, 3]
    return np.asarray(seen[:, :2] / seen[:, 2:])


def _with_play(play_mm: float) -> tuple[geoerr.Observations, geoerr.Machine]:
    """Give measurements of a machine with play in X and nothing else: 24 passes, each number known to 4 µm."""
    machine = geoerr.Machine.from_chain("wbXYZt", travel_mm=(400.0, 400.0, 400.0))
    rng = np.random.default_rng(4)
    rows = []
    for line in range(24):
        axis, is_back = line // 2 % 3, line % 2
        place = np.tile(rng.uniform(0.0, 400.0, 3), (12, 1))
        place[:, axis] = np.linspace(10.0, 390.0, 12)[:: 1 - 2 * is_back]
        direction = rng.choice([-1.0, 1.0], 3)
        direction[axis] = 1.0 - 2.0 * is_back
        rows += [(line, *q_mm, *direction) for q_mm in place]
    table = np.array(rows)
    q_mm, direction = table[:, 1:4], table[:, 4:7]
    seen = q_mm + 0.004 * rng.normal(size=q_mm.shape)
    seen[:, 0] -= 0.5 * play_mm * direction[:, 0]
    columns: dict[str, npt.NDArray[np.float64] | list[str]] = {
        "line": [f"L{int(line)}" for line in table[:, 0]],
        "t": np.linspace(0.0, 1800.0, len(table)),
    }
    columns |= {"carrier": ["relative"] * len(table)}
    for k, axis_name in enumerate("xyz"):
        columns |= {axis_name: q_mm[:, k], f"dir_{axis_name}": direction[:, k]}
        columns |= {f"m{axis_name}": seen[:, k], f"s{axis_name}": np.full(len(table), 0.004)}
    return observations_from_columns(columns), machine


def _bent() -> geoerr.Model:
    """Give a machine whose X guideway is bent, out of square, and a table of 50 mm."""
    machine = geoerr.Machine.from_chain("wbXYZt", travel_mm=(400.0, 400.0, 400.0))
    position = np.linspace(0.0, 400.0, 9)
    u = position / 400.0
    functions = {
        "EXX": ErrorFunction(position, 0.06 * u - 0.03 * np.sin(6.0 * u)),
        "EYX": ErrorFunction(position, 0.12 * u * (1.0 - u) * (1.0 - 0.6 * u)),
    }
    return geoerr.Model(machine, ErrorFunctions(machine, functions, {}, method="drawn"))


def _positions(program: str) -> Numbers:
    """Give where each move of a corrected program ends, (n, 3); absolute words in mm."""
    at: dict[str, float] = {}
    ends = []
    for line in program.splitlines():
        words = dict(re.findall(r"([XYZ])(-?[\d.]+)", line.partition(";")[0]))
        if words:
            at |= {axis: float(word) for axis, word in words.items()}
            ends.append([at["X"], at.get("Y", 0.0), at.get("Z", 0.0)])
    return np.array(ends)


def _programmed(written: str, program: str) -> Numbers:
    """Give the programmed place of each move of a corrected program; pieces follow the extruder's word."""
    places = _positions(program)
    extruded = _extruded(program)
    there = _extruded(written)
    return np.column_stack([np.interp(there, extruded, places[:, axis]) for axis in range(3)])


def _extruded(program: str) -> Numbers:
    values, last = [], 0.0
    for line in program.splitlines():
        text = line.partition(";")[0]
        word = re.search(r"E(-?[\d.]+)", text)
        last = float(word[1]) if word else last
        if re.search(r"[XYZ]-?\d", text):
            values.append(last)
    return np.array(values)


def _deviation_um(model: geoerr.Model, ends_mm: Numbers) -> tuple[Numbers, Numbers]:
    """Give where along X, and how far the tool is from the place that the move means at the same share, µm."""
    at, off = [], []
    ideal = ends_mm + model.error_mm(ends_mm)
    for k in range(len(ends_mm) - 1):
        share = np.linspace(0.0, 1.0, 41)[:, None]
        command = ends_mm[k] + share * (ends_mm[k + 1] - ends_mm[k])
        meant = ideal[k] + share * (ideal[k + 1] - ideal[k])
        at.append(meant[:, 0])
        off.append(_UM * np.linalg.norm(command + model.error_mm(command) - meant, axis=1))
    return np.concatenate(at), np.concatenate(off)


def _superscript(number: int) -> str:
    return str(number).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _share_words(share: float) -> str:
    return f"{share:.2f}" if share >= 0.01 else f"{share:.4f}"


PICTURES: dict[str, Callable[[], str]] = {
    "chain": chain,
    "abbe": abbe,
    "nine-lines": nine_lines,
    "circle": circle,
    "rays": rays,
    "rig-or-noise": rig_or_noise,
    "noise": noise,
    "projection": projection,
    "chance": chance,
    "split": split,
    "reversal": reversal,
}


if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        (FOLDER / f"{name}.svg").write_text(PICTURES[name](), encoding="utf-8")
