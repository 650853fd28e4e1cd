"""One axis and a laser interferometer, no camera: screw, play and wobble from what the beam saw.

    python examples/laser_run.py [FOLDER]

A laser fills one component, along its beam. What it cannot know is listed, not taken for 0.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import virtual_machines

import geoerr

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
virtual_machines.main("laser", folder)
machine = geoerr.read_machine(folder / "machine.toml")
observations = geoerr.read_observations(folder / "laser.csv")

for effects in ([], ["backlash:x", "periodic:x"]):
    result = geoerr.fit_model(machine, observations, components="12", effects=effects)
    comparison = geoerr.compare(result.model, observations).to_document()
    what = " + ".join(["smooth error", *effects])
    print(f"{what:<40}residual {comparison['rmse_um']:5.2f} µm, repeats {comparison['noise_floor_um']:.2f} µm")

print()
for name, scale, unit, true in (
    ("backlash:x.b", 1e3, "µm", "9"),
    ("periodic:x.P", 1.0, "mm", "5"),
    ("periodic:x.A", 1e3, "µm", "3"),
):
    known = result.model.parameter(name)
    print(f"{name:<14}{scale * known.value:8.3f} ± {scale * known.std:.3f} {unit} ({true} was put in)")

print("\nnot determined by one beam along X:")
for item in result.fitted.not_determined:
    print(f"  {item.name}: {item.why}")
geoerr.write_model(folder / "model.json", result.model)
