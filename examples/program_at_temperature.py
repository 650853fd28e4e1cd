"""A program for the machine as it is at 40 °C: measured warming, corrected for when it cuts.

python examples/program_at_temperature.py [FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import virtual_machines

import geoerr

PROGRAM = "G21\nG90\nG0 X20 Y60 Z50 F6000\nG1 Y380 F1200\nG1 X380\nG1 Y60\nG1 X20\n"
EFFECTS = ["thermal-expansion:y@temp_bed", "backlash:x"]

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
virtual_machines.main("warm-mill", folder)
machine = geoerr.read_machine(folder / "machine.toml")
observations = geoerr.read_observations(folder / "observations.csv")

model = geoerr.fit_model(machine, observations, components="12", effects=EFFECTS).model
alpha = model.parameter("thermal-expansion:y@temp_bed.alpha")
print(f"Y grows by {1e6 * alpha.value:.2f} ± {1e6 * alpha.std:.2f} ×10⁻⁶/K (steel has 11.5)")
geoerr.write_model(folder / "model.json", model)

program = folder / "frame.gcode"
program.write_text(PROGRAM, encoding="utf-8")
print("\nbed, °C   off before, µm   off after, µm   off after a correction for 20 °C, µm")
for degc in (20.0, 30.0, 40.0):
    at = {"temp_bed": degc}
    corrected = folder / f"frame-{degc:g}.gcode"
    geoerr.compensate_program(model, program, corrected, at=at)
    own = geoerr.compare_paths(model, program, corrected, at=at)
    cold = geoerr.compare_paths(model, program, folder / "frame-20.gcode", at=at)
    print(f"{degc:7g}{own.max_error_um_before:17.1f}{own.max_error_um_after:16.1f}{cold.max_error_um_after:27.1f}")

# A temperature far beyond what was measured is not taken in silence.
try:
    geoerr.compensate_program(model, program, folder / "frame-120.gcode", at={"temp_bed": 120.0})
except geoerr.GeoerrError as refusal:
    print(f"\n120 °C: {refusal}")
