"""Write `equations.md`: the first-order error equations of all 24 machines with three linear axes.

    python docs/theory/make_equations.py

A test (`tests/kinematics/test_equations.py`) fails where the page is not what this script makes.
"""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import get_args

from geoerr.equations import Seen, error_equations

PAGE = Path(__file__).with_name("equations.md")

INTRODUCTION = """\
# First-order error equations of every machine

Made by `make_equations.py` from the structural code; do not edit.

`E` is actual minus nominal position of a point, mm. Errors are those of the tool as seen from the work, whichever
side of the base carries the axis:

| symbol | ISO 230-1 | meaning | unit |
| --- | --- | --- | --- |
| `δ_ba` | `EBA`, b and a of X, Y, Z: δ_yx is EYX | translation error along b of axis a, at the carriage origin | mm |
| `ε_ba` | A, B, C for b of x, y, z: ε_zx is ECX | rotation error about b of axis a, right-handed | rad |
| `S_xy`, `S_xz`, `S_yz` | EC0Y, −EB0Z, EA0Z | included angle of the two positive directions − 90° | rad |
| `x`, `y`, `z` | | commanded axis positions | mm |
| `l` | | from the carriage origin to the point on the tool: tool offset and target offset | mm |
| `w` | | the point of the work, from the base origin at x = y = z = 0 | mm |

The exact chain, which fits, predictions and compensation use, has full rotations and unit directions for the axes;
these equations are its derivative where all errors are 0. A code reads from work to tool, `b` is the base: the
letters before it carry the work.

*Tool from the work* is what the part sees. *Tool from the base* and *work from the base* are what a camera on the
floor sees of a target on either body.

## Li's Eq. 8

The printer of Li et al. (2023) is `wZbXYt`: the bed moves along Z, the head along X and Y. The paper's Eq. 8 is its
error model; it is missing in the copy that this was written from, and derived here from Eqs. 6 and 7. Squareness,
which the paper treats apart (§4.3), stands at the end.
"""

TITLES: dict[Seen, str] = {
    "relative": "Tool from the work",
    "tool": "Tool from the base",
    "work": "Work from the base",
}


def chains() -> list[str]:
    """Give the 24 structural codes: 6 orders of the axes, 4 places of the base."""
    orders = ["".join(order) for order in permutations("XYZ")]
    return [f"w{order[:place]}b{order[place:]}t" for order in orders for place in range(4)]


def block(chain: str, seen: Seen) -> str:
    """Give the three equations as a block of mathematics."""
    equations = error_equations(chain, seen, "latex")
    return f"```math\n\\begin{{aligned}}\n{equations}\n\\end{{aligned}}\n```\n"


def section(chain: str) -> str:
    """Give the three views of one machine; a body that stands still has no equations."""
    still = {"tool": chain.endswith("bt"), "work": chain.startswith("wb"), "relative": False}
    parts = [f"## {chain}\n"]
    for seen in get_args(Seen):
        text = "It stands still.\n" if still[seen] else block(chain, seen)
        parts.append(f"{TITLES[seen]}\n\n{text}")
    return "\n".join(parts)


def page() -> str:
    """Give the whole page."""
    return "\n".join([INTRODUCTION, block("wZbXYt", "relative"), *map(section, chains())])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
