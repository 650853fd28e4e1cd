"""Plans small enough to be photographed in a test."""

from __future__ import annotations

import copy
from typing import Any

DOCUMENT: dict[str, Any] = {
    "seed": 4,
    "machine": {"name": "small", "chain": "wZbXYt"},
    "axes": {axis: {"range": [0.0, 100.0]} for axis in "xyz"},
    "rig": {
        "image_size_px": [612, 512],
        "pixel_um": 13.8,
        "middle_mm": [50.0, -600.0, 300.0],
        "look_at_mm": [80.0, 0.0, 0.0],
        "baseline_mm": 200.0,
        "left": {"distortion": [-0.1, 0.1, 0.0003, -0.0002, 0.0]},
        "right": {"distortion": [-0.1, 0.1, -0.0002, 0.0003, 0.0], "turn_mrad": [2.0, -1.0, 3.0]},
    },
    "board": {
        "type": "charuco",
        "squares": [7, 5],
        "square_mm": 40.0,
        "marker_mm": 30.0,
        "dictionary": "DICT_5X5_100",
        "views": 3,
        "depth_mm": [550.0, 800.0],
    },
    "targets": [
        {"id": 3, "size_mm": 60.0, "carrier": "tool", "offset_mm": [0.0, 0.0, 60.0], "roll_deg": 7.0},
        {"id": 8, "size_mm": 60.0, "carrier": "work", "offset_mm": [0.0, 0.0, -60.0], "roll_deg": 12.0},
        {"id": 9, "size_mm": 60.0, "carrier": "base", "offset_mm": [220.0, 0.0, 0.0], "roll_deg": -5.0},
    ],
    "errors": {
        "positioning_um": 300.0,
        "pitch_yaw_urad": 600.0,
        "roll_urad": 300.0,
        "squareness_mrad": {"EC0Y": -5.05, "EB0Z": -1.24, "EA0Z": 3.84},
    },
    "passes": [
        {"axis": "x", "count": 2, "both_directions": True},
        {"axis": "z", "start": 10.0, "stop": 90.0, "step": 40.0, "at": {"y": 100.0}, "line": "up"},
    ],
}


def changed(**changes: Any) -> dict[str, Any]:
    """Give the small plan with some of its tables updated (a dict is merged, anything else replaced)."""
    document = copy.deepcopy(DOCUMENT)
    for name, value in changes.items():
        if isinstance(value, dict) and isinstance(document.get(name), dict):
            document[name] |= value
        else:
            document[name] = value
    return document
