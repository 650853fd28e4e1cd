"""How the moves of two programs differ other than by their path: what they extrude, and how fast they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.verify.program_reader import UNITS_PER_MM, Move

# What a correction changes of a path's length is far less; what is more than this has another reason.
_FEED_CHANGE = 0.01
# What a piece extrudes may differ from its share of its move's by this part of the whole, and by its digits.
_EXTRUSION_SHARE, _EXTRUSION_DIGITS_MM = 0.01, 1e-3


@dataclass
class Tally:
    """What was compared, and how moves differ from their pieces other than by their path."""

    n_compared: int = 0
    n_other_extrusion: int = 0
    other_extrusion_line: int = 0
    n_other_feed: int = 0
    feed_change: float = 0.0
    feed_change_line: int = 0

    def add(self, move: Move, pieces: Sequence[Move], ends: Sequence[float], lines: Sequence[int]) -> None:
        """Count a move; `ends` are the shares of it at which its pieces are meant to end."""
        other = _other_extrusion(move, pieces, ends)
        if other is not None:
            self.n_other_extrusion += 1
            self.other_extrusion_line = self.other_extrusion_line or lines[other]
        changes = [move.feed.change_to(piece.feed) for piece in pieces]
        largest = max(changes)
        self.n_other_feed += largest > _FEED_CHANGE
        if largest > self.feed_change:
            self.feed_change, self.feed_change_line = largest, lines[changes.index(largest)]


def _other_extrusion(move: Move, pieces: Sequence[Move], ends: Sequence[float]) -> int | None:
    """Give the first piece that does not extrude its share of the path, the very first where only the sum is another.

    Digits of words and what places are off are left to it; None where all is as the move has it.
    """
    other = None if sum(piece.extrusion for piece in pieces) == move.extrusion else 0
    if move.start_mm is None or len(pieces) == 1:
        return other
    margin = _EXTRUSION_SHARE * abs(move.extrusion) + _EXTRUSION_DIGITS_MM * UNITS_PER_MM
    shares = np.diff([0.0, *ends[:-1], 1.0]).tolist()
    off = (abs(piece.extrusion - share * move.extrusion) for piece, share in zip(pieces, shares, strict=True))
    return next((number for number, one in enumerate(off) if one > margin), other)
