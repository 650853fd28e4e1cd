"""What messages say to a person at a command line, said to a person at the page."""

from __future__ import annotations

import re
from typing import Final

# What the page asks of a program, as it asks it.
ZERO: Final = "Program's zero in machine coordinates, mm"
HOLD: Final = "beyond the measured range, hold the last values of functions"
PASS: Final = "pass lines through that cannot be corrected"
# Options and verbs that messages name to what a person does on the page instead; the longer before its part.
_SAID: Final = {
    "--on-unsupported pass": f"“{PASS}”",
    "--outside-measured hold": f"“{HOLD}”",
    "--work-offset": f"“{ZERO}”",
    ", or ask for it (--extrapolate)": "",
    "; --keep-uncertain corrects it": "",
    "; --refit fits them": "; “Fit the 21 errors” fits them",
    "--rig rig.json --refit lets it": "rig.json among the data, and “Fit the 21 errors”, let it",
    "--rig rig.json lets it": "rig.json among the data lets it",
    "leave --rig out": "leave the rig out",
    ", as geoerr fit does": ", as “Fit the 21 errors” does",
    "`geoerr remove` takes it out": "“Remove” takes it out",
    " with `geoerr fit`": "",
    "; `geoerr verify workpiece` takes lengths": "",
}
# A remedy of its own: one option for each condition.
_CONDITIONS: Final = re.compile(r"state them, as --at [^\n]*")


def on_the_page(text: str) -> str:
    """Say what the page offers where a message names an option or a verb of the command line."""
    for option, said in _SAID.items():
        text = text.replace(option, said)
    return _CONDITIONS.sub("state them in their fields, above the program", text)
