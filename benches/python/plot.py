"""Cost against size, one panel for each kind of work, as a picture that any browser shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from race import Costs

WIDTH, HEIGHT = 660, 330
LEFT, RIGHT, TOP, BOTTOM = 58, 280, 34, 44
COLOURS = (
    "#0b6e4f",
    "#1f77b4",
    "#7a3e9d",
    "#d1495b",
    "#b36b00",
    "#444444",
    "#008b8b",
    "#a05195",
    "#5f7a1f",
    "#c44e00",
)


def plot(all_costs: Sequence[Costs], path: Path) -> None:
    """Write the panels below each other, two in a row."""
    panels = [_panel(costs, (i % 2) * WIDTH, (i // 2) * HEIGHT) for i, costs in enumerate(all_costs)]
    height = -(-len(panels) // 2) * HEIGHT
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{2 * WIDTH}" height="{height}" font-family="sans-serif" '
        f'font-size="11"><rect width="100%" height="100%" fill="white"/>{"".join(panels)}</svg>\n'
    )


def _panel(costs: Costs, x0: int, y0: int) -> str:
    sizes = [size for each in costs.nanoseconds.values() for size in each]
    values = [value for each in costs.nanoseconds.values() for value in each.values()]
    low_x, high_x = math.log10(min(sizes)), math.log10(max(sizes))
    low_y, high_y = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    right, bottom = x0 + WIDTH - RIGHT, y0 + HEIGHT - BOTTOM

    def across(size: float) -> float:
        return x0 + LEFT + (math.log10(size) - low_x) / max(high_x - low_x, 1e-9) * (right - x0 - LEFT)

    def down(value: float) -> float:
        return bottom - (math.log10(value) - low_y) / (high_y - low_y) * (bottom - y0 - TOP)

    parts = [f'<text x="{x0 + LEFT}" y="{y0 + 20}" font-size="13" font-weight="bold">{escape(costs.title)}</text>']
    for power in range(low_y, high_y + 1):
        y = down(10.0**power)
        parts.append(f'<line x1="{x0 + LEFT}" y1="{y:.1f}" x2="{right}" y2="{y:.1f}" stroke="#ddd"/>')
        parts.append(f'<text x="{x0 + LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{10.0**power:g}</text>')
    for power in range(math.ceil(low_x - 1e-9), math.floor(high_x + 1e-9) + 1):
        x = across(10.0**power)
        parts.append(f'<line x1="{x:.1f}" y1="{y0 + TOP}" x2="{x:.1f}" y2="{bottom}" stroke="#ddd"/>')
        parts.append(
            f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle">10<tspan dy="-4" font-size="8">{power}'
        )
        parts.append("</tspan></text>")
    middle = (x0 + LEFT + right) / 2
    parts.append(f'<text x="{middle}" y="{bottom + 32}" text-anchor="middle">{escape(costs.item)}s</text>')
    parts.append(
        f'<text transform="translate({x0 + 14},{(y0 + TOP + bottom) / 2}) rotate(-90)" text-anchor="middle">'
        f"processor ns a {escape(costs.item)}</text>"
    )
    ends = []
    for number, (name, each) in enumerate(costs.nanoseconds.items()):
        colour = COLOURS[number % len(COLOURS)]
        dash = ' stroke-dasharray="4 3"' if name.startswith("limit") else ""
        width = 2.4 if name.startswith("geoerr") else 1.3
        places = [(across(size), down(value)) for size, value in sorted(each.items())]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}"{dash}/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.4" fill="{colour}"/>' for x, y in places]
        ends.append((places[-1][1], name, colour))
    lowest = y0 + TOP - 6.0
    for y, name, colour in sorted(ends):
        lowest = max(y + 4.0, lowest + 13.0)
        parts.append(f'<text x="{right + 8}" y="{lowest:.1f}" font-size="10" fill="{colour}">{escape(name)}</text>')
    return "".join(parts)
