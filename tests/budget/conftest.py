"""The virtual machine of the nine-line tests and the scenes of the fit serve here too."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / room) for room in ("identify", "fit", "model")]
