"""A session of any number of frames: twelve pairs of small pictures, named over and over by its frames.csv."""

from __future__ import annotations

import csv
import itertools
import subprocess
import sys
from pathlib import Path

# Seconds from one frame to the next.
_EVERY_S = 4.0
_PLAN = """\
seed = 1

[machine]
chain = "wbXYZt"

[rig]
image_size_px = [612, 512]
pixel_um = 13.8
focal_mm = 8.0
baseline_mm = 300.0
converging = 0.9
blur_px = 0.8
middle_mm = [-454.7, -451.0, 671.5]
look_at_mm = [158.7, 162.4, 242.1]

[[targets]]
id = 0
dictionary = "DICT_4X4_50"
size_mm = 54.0
margin_mm = 6.0
carrier = "tool"
offset_mm = [0.0, 0.0, 0.0]
roll_deg = 6.0

[noise]
grey = 1.5

[board]
type = "charuco"
squares = [9, 7]
square_mm = 44.0
marker_mm = 33.0
dictionary = "DICT_5X5_100"
views = 12
depth_mm = [644, 1329]
"""
_AXIS = """
[axes.{axis}]
range = [0.0, 400.0]

[[passes]]
line = "{line}"
axis = "{axis}"
count = 4
"""


def repeated_session(folder: Path, n_frames: int) -> Path:
    """Make a session of so many frames, with its rig, from pictures of a virtual machine; each round is a pass."""
    plan, session = folder / "plan.toml", folder / "session"
    plan.write_text(_PLAN + "".join(_AXIS.format(axis=axis, line=axis.upper()) for axis in "xyz"))
    for words in (("simulate", plan, "-o", session), ("calibrate", session, "-o", session / "rig.json")):
        subprocess.run([sys.executable, "-m", "geoerr", *map(str, words), "-q"], check=True, capture_output=True)
    with (session / "frames.csv").open(newline="") as file:
        frames = list(csv.DictReader(file))
    with (session / "frames.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, frames[0])
        writer.writeheader()
        for number, frame in enumerate(itertools.islice(itertools.cycle(frames), n_frames)):
            writer.writerow(frame | {"repeat": number // len(frames), "t": _EVERY_S * number})
    return session
