"""An effect that no catalogue has, as a formula: a printer whose spool hangs on the gantry.

    python examples/own_effect.py [FOLDER]

The diagnosis finds that something follows the spool's mass and the place along X, and no known name for it. A person
knows what it is: the gantry bends under the spool. Five lines say so, and the model has it.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import virtual_machines

import geoerr
from geoerr.diagnose import diagnose

SAG = """\
[[effect]]
id = "spool-sag"
title = "The gantry bends under the spool"
channel = "joint"
direction = "Z"
axes = ["x"]
covariates = ["spool"]
expression = "-k*spool*q_low*(L - q_low)"
[effect.coefficients.k]
unit = "1/(mm*kg)"
sign = "positive"
"""

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
virtual_machines.main("spool-printer", folder)
machine = geoerr.read_machine(folder / "machine.toml")
observations = geoerr.read_observations(folder / "observations.csv")

model = geoerr.fit_model(machine, observations, components="12").model
print(diagnose(model, observations).sentence)

(folder / "own.toml").write_text(SAG, encoding="utf-8")
own = geoerr.load_effects(folder / "own.toml")
print("\nwith the own effect among the candidates:")
diagnosis = diagnose(model, observations, effects=own)
print(diagnosis.sentence)

change = geoerr.add_effect(model, observations, reference="spool-sag:x", effects=own)
k = change.result.model.parameter("spool-sag:x.k")
print(f"\nk = {1e6 * k.value:.3f} ± {1e6 * k.std:.3f} ×10⁻⁶/(mm kg); 1.1 was put in")
before, after = change.before.held_out.figures.headline_um, change.after.held_out.figures.headline_um
print(f"the held-out error falls from {before:.1f} to {after:.1f} µm")
geoerr.write_model(folder / "model.json", change.result.model)
print(f"the model, formula and all, is {folder / 'model.json'}")
