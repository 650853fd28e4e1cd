"""What a person has chosen to look at: kept on the server, so that it is there again after a reload."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

# Views of the volume, as mrcal's users know them, what the reference says otherwise, and the ball-bar plot, to what a
# person reads.
REGION, DIFFERENCE, CIRCLE = "region", "difference", "circle"
LOOKS = {
    **{"length": "arrows", "magnitude": "size", "direction": "direction"},
    **{REGION: "regions", DIFFERENCE: "vs ★", CIRCLE: "circle"},
}
# Where the volume is looked at from, to what a person reads.
CORNER = "corner"
STANDS = {"above": "above", "front": "the front", "side": "the side", CORNER: "a corner"}
# Powers of two around the exaggeration that draws the largest error as about a tenth of the volume.
LEAST_POWER, LARGEST_POWER = -3, 3


@dataclass
class View:
    """What is shown.

    Attributes
    ----------
    look
        One of `LOOKS`.
    shows_shape
        Whether the volume's grid is drawn as the model bends it.
    stand, turns
        One of `STANDS`, and how often one was asked for: asked for again, it is taken again, however the picture was
        turned meanwhile.
    power
        Exaggeration, as a power of two.
    variable, color_by
        Of the residual's picture; "" where it is for the data to say, and for no colour.
    settled
        The variable that the data said last: another one was chosen by the person, and stays.
    run
        Of the circular tests; "" where it is for the data to say.
    conditions
        Name to text, as typed: for the volume's shape, and for programs.
    """

    look: str = "length"
    shows_shape: bool = True
    stand: str = CORNER
    turns: int = 0
    power: float = 0.0
    variable: str = ""
    settled: str = ""
    color_by: str = ""
    run: str = ""
    conditions: dict[str, str] = field(default_factory=dict)

    @property
    def exaggeration(self) -> float:
        """Times the automatic magnification."""
        return float(2.0**self.power)

    def look_from(self, stand: str) -> None:
        """Look at the volume from one of `STANDS`."""
        self.stand = stand
        self.turns += 1

    def settle(
        self, variables: Sequence[str], by_worth: Sequence[str], looks: Collection[str], runs: Sequence[str]
    ) -> None:
        """Choose anew what the data do not have, or the person has not chosen: what the residual follows most."""
        if self.look not in looks:
            self.look = next(iter(looks), self.look)
        if self.run not in runs:
            self.run = next(iter(runs), "")
        if self.variable not in variables or self.variable == self.settled:
            self.variable = next((name for name in by_worth if name in variables), variables[0] if variables else "")
            self.settled = self.variable
        if self.color_by not in variables:
            self.color_by = ""

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        return asdict(self)

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> View:
        """Read it; what it does not say is as at first."""
        known = {one.name for one in fields(cls)}
        return cls(**{name: value for name, value in document.items() if name in known})
