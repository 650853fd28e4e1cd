"""Write the example programs: `python -m geoerr.demo.programs.make`.

- `grid.gcode`: a printed test piece after Li et al. 2023, Fig. 15: long horizontal and vertical lines, and
  a circle of radius 100 mm at (212, 270). Millimetres, absolute extrusion, retractions, layer comments.
- `plate.ngc`: a milled plate as CAM and people write it: inches, modal lines without a G word, a relative part,
  N words and comments in parentheses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from geoerr.files import write_text

HERE = Path(__file__).parent

# Cross-section of a printed line (0.45 mm wide, 0.2 mm high) over that of the 1.75 mm filament.
_FILAMENT_PER_MM = 0.45 * 0.2 / (math.pi * (1.75 / 2) ** 2)


def grid_program() -> str:
    """Give the printed grid with its circle, three layers."""
    lines = [
        "; grid: long lines in X and Y, and a circle, for a printer with 400 mm of travel",
        "M140 S90",
        "M104 S240",
        "G28 ; home all axes",
        "M190 S90",
        "M109 S240",
        "G21",
        "G90",
        "M82 ; absolute extrusion",
        "G92 E0",
        "G1 Z5 F600",
        "G0 X60 Y60 F9000",
    ]
    for layer in range(1, 4):
        lines += [f";LAYER:{layer}", "G92 E0", f"G1 Z{0.2 * layer:.2f} F600"]
        extruded = 0.0
        for start, ends in _layer_paths():
            lines.append(f"G0 X{start[0]:.3f} Y{start[1]:.3f} F9000")
            lines.append("G1 F1800")
            at = start
            for end in ends:
                extruded += math.dist(at, end) * _FILAMENT_PER_MM
                lines.append(f"G1 X{end[0]:.3f} Y{end[1]:.3f} E{extruded:.5f}")
                at = end
            lines.append(f"G1 E{extruded - 0.8:.5f} F2400 ; retract")
            lines.append(f"G1 E{extruded:.5f} F2400")
    lines += ["M107", "G91", "G1 Z10 F600 ; lift", "G90", "M104 S0", "M140 S0", "M84"]
    return "\n".join(lines) + "\n"


def plate_program() -> str:
    """Give the milled plate."""
    lines = ["%", "(plate: outline and slots, inches)", "N10 G20 G17 G40 G49 G80 G90", "N20 G54", "N30 S3000 M3"]
    lines += ["N40 G0 Z2.0", "N50 G0 X2.5 Y2.5", "N60 G1 Z0.9 F10.", "N70 X13.5 F20. (outline)"]
    lines += ["N80 Y13.5", "N90 X2.5", "N100 Y2.5", "N110 G0 Z2.0"]
    number = 120
    for slot in range(5):
        lines.append(f"N{number} G0 X{4.0 + 2.0 * slot:.4f} Y4.")
        lines += [f"N{number + 10} G1 Z0.95 F10.", f"N{number + 20} G91 (slot {slot + 1}, relative)"]
        lines += [
            f"N{number + 30} G1 Y8. F20.",
            f"N{number + 40} X0.25",
            f"N{number + 50} Y-8.",
            f"N{number + 60} G90",
        ]
        lines.append(f"N{number + 70} G0 Z2.0")
        number += 80
    return "\n".join([*lines, f"N{number} M5", f"N{number + 10} M30", "%"]) + "\n"


def _layer_paths() -> Iterator[tuple[tuple[float, float], list[tuple[float, float]]]]:
    for index in range(5):
        level = 60.0 + 70.0 * index
        yield (60.0, level), [(340.0, level)]
        yield (level, 60.0), [(level, 340.0)]
    circle = [
        (212.0 + 100.0 * math.cos(angle), 270.0 + 100.0 * math.sin(angle))
        for angle in (math.tau * step / 180 for step in range(181))
    ]
    yield circle[0], circle[1:]


if __name__ == "__main__":
    write_text(HERE / "grid.gcode", grid_program())
    write_text(HERE / "plate.ngc", plate_program())
