"""How sure is it? What is known of a machine, where, and what would have to be better for a part to be better.

python examples/how_sure.py [FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import virtual_machines

import geoerr

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
virtual_machines.main("warm-mill", folder)
machine = geoerr.read_machine(folder / "machine.toml")
observations = geoerr.read_observations(folder / "observations.csv")
effects = ["thermal-expansion:y@temp_bed", "backlash:x"]
model = geoerr.fit_model(machine, observations, components="12", effects=effects).model

found = geoerr.compare(model, observations).to_document()
print(f"passes that were left out are predicted to {found['held_out_rmse_um']:.1f} µm")
print(f"what was measured twice differs by         {found['noise_floor_um']:.1f} µm\n")

conditions = {"temp_bed": 40.0, "d_x": 1.0}
for std in (0.0, 3.0):
    budget = geoerr.uncertainty_budget(
        model, {"far corner": (380.0, 380.0, 200.0)}, at=conditions, at_std={"temp_bed": std} if std else {}
    )
    print(f"-- temperature of the bed known to ± {std:g} K")
    print(geoerr.budget_text(budget))
