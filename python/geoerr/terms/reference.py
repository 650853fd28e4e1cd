"""Names of effects in their places: `ID[:AXIS][@COVARIATE]`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from geoerr.errors import InputFileError
from geoerr.machine import AXES
from geoerr.terms.names import EMPIRICAL, MOST_OF_A_CURVE, is_column, is_effect_id

_PAIRS = ("xy", "xz", "yz")
REFERENCE_AXES: tuple[str, ...] = (
    *AXES,
    *_PAIRS,
    *(f"{moved}*{other}" for moved in AXES for other in AXES if moved != other),
    *(f"work-{axis}" for axis in AXES),
)
_REFERENCE_HINT = "write ID[:AXIS][@COVARIATE], for example thermal-expansion:x@temp_bed"


@dataclass(frozen=True)
class EffectReference:
    """A candidate's name in parts: `effect`, `axis` and `covariate` of `ID[:AXIS][@COVARIATE]`."""

    effect: str
    axis: str | None = None
    covariate: str | None = None

    def __str__(self) -> str:
        """Write it as `ID[:AXIS][@COVARIATE]`."""
        axis = "" if self.axis is None else f":{self.axis}"
        return f"{self.effect}{axis}" + ("" if self.covariate is None else f"@{self.covariate}")

    @property
    def covariate_columns(self) -> tuple[str, ...]:
        """Columns of the covariate: none, one, or the two of a difference or of a curve."""
        return () if self.covariate is None else tuple(re.split("[-*]", self.covariate))


def parse_effect_reference(text: str) -> EffectReference:
    """Read `ID[:AXIS][@COVARIATE]`.

    AXIS is `x y z`, a pair `xy xz yz`, `x*y` (a joint of x as a function of y too), or for a displacement of the
    tool or the work its direction (`z` = tool, `work-z` = work). COVARIATE is a column or a difference of two,
    `temp_a-temp_b`; of an `empirical` curve one to three variables, `feed*z`.

    Raises
    ------
    InputFileError
        if the text is not such a name.
    """
    head, at, covariate = text.partition("@")
    effect, colon, axis = head.partition(":")
    if not is_effect_id(effect):
        raise InputFileError(text, f"{effect!r} is not the id of an effect", remedy=_REFERENCE_HINT)
    if colon and axis not in REFERENCE_AXES:
        raise InputFileError(text, f"{axis!r} is not an axis", remedy=f"axes are {', '.join(REFERENCE_AXES)}")
    is_curve = effect == EMPIRICAL
    columns, most = covariate.split("*" if is_curve else "-"), MOST_OF_A_CURVE if is_curve else 2
    if at and not (len(columns) <= most and all(map(is_column, columns)) and len(set(columns)) == len(columns)):
        several = "two or three different ones" if is_curve else "the difference of two columns"
        raise InputFileError(
            text,
            f"{covariate!r} is neither a column nor {several}",
            remedy=f"write the column's name, or names as {'feed*z' if is_curve else 'temp_a-temp_b'}",
        )
    return EffectReference(effect, axis if colon else None, covariate if at else None)
