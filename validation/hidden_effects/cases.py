"""Seeds for development and seeds for the study, which never meet; and a small table to develop with."""

from __future__ import annotations

from dataclasses import dataclass

from validation.hidden_effects.generate import Hidden

# Sets from a million on were looked at while the causes of their failures were mended: they are development now.
_STUDY_BEGINS = 6_000_000


def development_seed(number: int) -> int:
    """Give the seed of development case `number`, below those of the study."""
    if not 0 <= number < _STUDY_BEGINS:
        raise ValueError(f"{number} is not between 0 and {_STUDY_BEGINS - 1}")
    return number


def study_seed(number: int) -> int:
    """Give the seed of study case `number`: not to develop on (README.md tells what was looked at)."""
    if number < 0:
        raise ValueError(f"{number} is negative")
    return _STUDY_BEGINS + number


@dataclass(frozen=True)
class Development:
    """A case to develop with: arguments of `generate`."""

    seed: int
    chain: str
    plan: str
    noise: str
    hidden: tuple[Hidden, ...]
    strength_um: float


DEVELOPMENT = tuple(
    Development(development_seed(number), *row)
    for number, row in enumerate(
        [
            ("wZbXYt", "nine-lines", "gauss-10", (), 0.0),
            ("wbXYZt", "volume-relative", "offsets-3", (), 0.0),
            ("wXYbZt", "mixed", "drift-2", (), 0.0),
            ("wZbXYt", "nine-lines", "gauss-10", (Hidden("backlash", "y"),), 4.0),
            ("wYbXZt", "volume-relative", "offsets-3", (Hidden("thermal-expansion", "x", "temp_bed"),), 4.0),
            ("wXbYZt", "mixed", "drift-2", (Hidden("lag", "z"),), 4.0),
            ("wZYXbt", "volume-floor", "everything", (Hidden("periodic", "x"), Hidden("angular-reversal", "y")), 4.0),
            ("wbZXYt", "mixed", "gauss-10", (Hidden("reversal-windup", "x", off_formula=0.3),), 8.0),
            ("wZbXYt", "mixed", "gauss-10", (Hidden("feed-times-z"),), 8.0),
        ]
    )
)
