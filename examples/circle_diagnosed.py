"""A ball-bar test diagnosed: which causes make the circle an oval, and what is left of it when they are in the model.

    python examples/circle_diagnosed.py [FOLDER]

Without FOLDER it writes into a temporary one. The machine is a virtual mill with three secrets.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import virtual_machines

import geoerr
from geoerr.diagnose.circles import diagnose_circles

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
virtual_machines.main("circles", folder)
machine = geoerr.read_machine(folder / "machine.toml")
test = geoerr.read_circular_test(folder / "circle.csv")

# A circle knows nothing of 21 errors: it is diagnosed from the machine as it is on paper.
diagnosis = diagnose_circles(geoerr.Model(machine), test)
print(f"verdict: {diagnosis.verdict}; the repeats of the trace scatter by {diagnosis.noise_um:.1f} µm")
for cause in diagnosis.ranked:
    print(f"\n{cause.effect.title} ({cause.reference}): worth {cause.worth_um:.1f} µm rms")
    print(f"    to do: {cause.effect.remedy}")

effects = [str(cause.reference) for cause in diagnosis.ranked]
result = geoerr.fit_model(machine, test, components="none", effects=effects)
geoerr.write_model(folder / "model.json", result.model)
print(f"\n{result.model.report()}")
print("\nwhat was put in: play of 14 µm, 40 µrad off the square, Y 0.4 ms late")
print(f"the model with all of it is {folder / 'model.json'}")
