"""Options about a program that `compensate`, `farm` and `verify path` share, and what those two correct with."""

from __future__ import annotations

import math
from collections.abc import Collection
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from geoerr.cli.options import note

if TYPE_CHECKING:
    from geoerr.compensate.program import CompensationOptions
    from geoerr.model.arrays import Triple


class FirmwareName(StrEnum):
    """Firmwares that read programs differently."""

    MARLIN = "marlin"
    KLIPPER = "klipper"
    REPRAPFIRMWARE = "reprapfirmware"


class UnsupportedChoice(StrEnum):
    """What to do with a line that is not corrected."""

    REFUSE = "refuse"
    PASS = "pass"


class OutsideMeasuredChoice(StrEnum):
    """What to do outside the measured range."""

    REFUSE = "refuse"
    HOLD = "hold"


def positive(value: float | None) -> float | None:
    """Refuse a length that is none, as wrong usage; an option that is not given stays None."""
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"{value:g} is no length above 0")
    return value


At = Annotated[
    list[str] | None,
    typer.Option("--at", metavar="NAME=VALUE", help="Condition that MODEL depends on; `reference` is a value."),
]
WorkOffset = Annotated[
    str | None,
    typer.Option("--work-offset", metavar="X,Y,Z", help="From the machine's zero to the program's zero (G54), mm."),
]
Tolerance = Annotated[
    float,
    typer.Option("--tolerance", callback=positive, help="Largest distance of the tool from the programmed path, mm."),
]
OnUnsupported = Annotated[
    UnsupportedChoice,
    typer.Option("--on-unsupported", help="A line that is not corrected: refuse the program, or pass the line."),
]
Home = Annotated[
    str | None,
    typer.Option(
        "--home",
        metavar="X,Y,Z",
        help="Where G28 leaves the machine, machine coordinates, mm; of a mill beside --work-offset.",
    ),
]
Firmware = Annotated[
    FirmwareName | None,
    typer.Option("--firmware", help="Who runs the program; needed only where firmwares read it differently."),
]
FirmwareCorrects = Annotated[
    str | None,
    typer.Option(
        "--firmware-corrects",
        metavar="LIST",
        help="Errors that the firmware corrects itself, not to be corrected twice: names (EC0Y) and groups"
        " (squareness, straightness, positioning, angular, pitch-yaw, roll, bed-mesh), with commas.",
    ),
]
Still = Annotated[
    str | None,
    typer.Option(
        "--still",
        metavar="NAME,NAME",
        help="Macros and codes that neither move the machine nor change its modes, such as _ON_LAYER_CHANGE, M600.",
    ),
]
KeepUncertain = Annotated[
    bool,
    typer.Option(
        "--keep-uncertain", help="Correct also what is known so poorly that correcting it does more harm than good."
    ),
]
OutsideMeasured = Annotated[
    OutsideMeasuredChoice,
    typer.Option(
        "--outside-measured",
        help="Beyond the measured range: refuse, or hold the last value of each function of an axis; formulas go on.",
    ),
]
Digits = Annotated[
    int, typer.Option("--digits", min=1, max=9, help="Digits of a printed axis word in mm; inches get one more.")
]
Extrapolate = Annotated[
    bool, typer.Option("--extrapolate", help="Take conditions far outside what MODEL was fitted to.")
]


def compensation_options(
    *,
    work_offset: str | None,
    tolerance: float,
    on_unsupported: UnsupportedChoice,
    outside_measured: OutsideMeasuredChoice,
    digits: int,
    home: str | None,
    firmware: FirmwareName | None,
    firmware_corrects: str | None,
    still: str | None,
    keep_uncertain: bool,
    extrapolate: bool,
) -> CompensationOptions:
    """Give what programs are corrected with, of the options by their names."""
    from geoerr.compensate.program import CompensationOptions

    return CompensationOptions(
        work_offset_mm=told_triple(work_offset, "--work-offset"),
        tolerance_mm=tolerance,
        digits=digits,
        home_mm=told_triple(home, "--home"),
        firmware=None if firmware is None else firmware.value,
        firmware_corrects=names(firmware_corrects),
        still=names(still),
        on_unsupported=on_unsupported.value,
        outside_measured=outside_measured.value,
        keeps_uncertain=keep_uncertain,
        extrapolates=extrapolate,
    )


def triple(text: str, option: str) -> Triple:
    """Read X,Y,Z in mm; anything else is wrong usage."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise typer.BadParameter(f"{text!r} is not X,Y,Z in millimetres", param_hint=option)
    return x, y, z


def told_triple(text: str | None, option: str) -> Triple | None:
    """Read X,Y,Z in mm as `triple` does; None where the option was not given."""
    return None if text is None else triple(text, option)


def names(text: str | None) -> tuple[str, ...]:
    """Split a list at its commas."""
    return tuple(part.strip() for part in text.split(",") if part.strip()) if text else ()


def conditions(given: list[str] | None) -> dict[str, float | str]:
    """Read NAME=VALUE, VALUE a number or `reference`; anything else, and a name stated twice, is wrong usage."""
    read: dict[str, float | str] = {}
    for text in given or []:
        name, separator, value = text.partition("=")
        try:
            number: float | str = value if value == "reference" else float(value)
        except ValueError:
            number = math.nan
        if not name or not separator or (isinstance(number, float) and not math.isfinite(number)):
            raise typer.BadParameter(f"{text!r} is not NAME=VALUE, VALUE a number or reference", param_hint="--at")
        if name in read:
            raise typer.BadParameter(f"{name} is stated twice: {read[name]} and {number}", param_hint="--at")
        read[name] = number
    return read


def followed_conditions(given: list[str] | None, follows: Collection[str], quiet: bool) -> dict[str, float | str]:
    """Read conditions; what a model does not follow is left out, with a note: one command line serves all models."""
    read = conditions(given)
    for name in read:
        if name not in follows:
            note(f"note: the model does not depend on {name}: --at {name} changes nothing", quiet)
    return {name: value for name, value in read.items() if name in follows}
