"""Commands of printers that leave the machine where it is and its modes as they are, for checking programs.

Sources: Klipper's manual (G-Codes) for names; those of Marlin, RepRapFirmware, Prusa and Bambu for M codes. What is
not listed may be a user's macro, which does anything. Nothing here is shared with the code that corrects programs.
"""

from __future__ import annotations

import re

_SETTINGS = (
    b"DISPLAY_GROUP DISPLAY_TEXT EXTRUDER_ROTATION_DISTANCE EXTRUDER_STEP_DISTANCE FAN_SPEED FILAMENT_SENSOR"
    b" GCODE_VARIABLE HEATER_TEMPERATURE IDLE_TIMEOUT INPUT_SHAPER LED LED_TEMPLATE PIN PRESSURE_ADVANCE"
    b" PRINT_STATS_INFO RETRACTION SERVO SKEW SMART_EFFECTOR STEPPER_ENABLE TEMPERATURE_FAN_TARGET TMC_CURRENT"
    b" TMC_FIELD VELOCITY_LIMIT Z_THERMAL_ADJUST"
)
_OTHERS = (
    b"ACCELEROMETER_DEBUG_READ ACCELEROMETER_DEBUG_WRITE ACCELEROMETER_MEASURE ACCELEROMETER_QUERY"
    b" ANGLE_CHIP_CALIBRATE ANGLE_DEBUG_READ ANGLE_DEBUG_WRITE BED_MESH_CLEAR BED_MESH_MAP BED_MESH_OFFSET"
    b" BED_MESH_OUTPUT BED_MESH_PROFILE CALC_MEASURED_SKEW CLEAR_PAUSE DISABLE_FILAMENT_WIDTH_LOG"
    b" DISABLE_FILAMENT_WIDTH_SENSOR DUMP_TMC ENABLE_FILAMENT_WIDTH_LOG ENABLE_FILAMENT_WIDTH_SENSOR"
    b" EXCLUDE_OBJECT EXCLUDE_OBJECT_DEFINE EXCLUDE_OBJECT_END EXCLUDE_OBJECT_START GET_CURRENT_SKEW GET_POSITION"
    b" GET_RETRACTION HELP"
    b" INIT_TMC MEASURE_AXES_NOISE PID_CALIBRATE QUERY_ADC QUERY_ENDSTOPS QUERY_FILAMENT_SENSOR QUERY_FILAMENT_WIDTH"
    b" QUERY_PROBE QUERY_RAW_FILAMENT_WIDTH RESET_FILAMENT_WIDTH_SENSOR RESET_SMART_EFFECTOR RESET_VELOCITY_LIMIT"
    b" RESPOND SAVE_VARIABLE SDCARD_RESET_FILE SKEW_PROFILE STATUS SYNC_EXTRUDER_MOTION TEMPERATURE_WAIT TUNING_TOWER"
    b" TURN_OFF_HEATERS UPDATE_DELAYED_GCODE"
)
_NAMES = frozenset((*_OTHERS.split(), *(b"SET_" + name for name in _SETTINGS.split())))
# RepRapFirmware's.
_WORDS = frozenset((b"var", b"global", b"set", b"echo"))


def _codes(*parts: int | tuple[int, int]) -> frozenset[int]:
    """Give numbers, and those of spans with both their ends."""
    spans = ((part, part) if isinstance(part, int) else part for part in parts)
    return frozenset(code for first, last in spans for code in range(first, last + 1))


# M206, M290 and M428 move the zero, M82 and M83 change how E is read, M622 and M623 are branches: read as that.
_CODES = (
    _codes((0, 5), (7, 11), (16, 18), (20, 23), (26, 31), 33, 34, (36, 39), 42, 43, (70, 78), (80, 87), 92, 100)
    | _codes(
        102, (104, 124), (126, 129), 136, (140, 145), 149, 150, 154, 155, (163, 166), (190, 193), (200, 209), 211
    )
    | _codes(
        217, 218, 220, 221, 250, 255, 256, 260, 261, (280, 282), 290, (300, 310), (330, 334), 350, 351, 355, 380, 381
    )
    | _codes(
        400, (403, 409), (412, 418), (420, 423), 425, 428, 430, (450, 453), 486, 493, 494, (500, 505), (510, 512), 540
    )
    | _codes(
        (550, 584),
        (586, 589),
        (591, 593),
        (595, 599),
        603,
        607,
        (622, 625),
        630,
        640,
        (665, 667),
        (669, 671),
        703,
        709,
        710,
    )
    | _codes(
        (750, 756), 851, 852, (860, 869), 871, 876, 899, 900, (905, 919), 928, 929, (950, 960), (973, 975), 981, 982
    )
    | _codes(991, (993, 997), 1002, 1003, 1006, 1007)
)
# Parking and changes of filament, by numbers that no other machine has.
_PAUSES = _codes((600, 602), 701, 702)

_COMMAND = re.compile(rb"\s*(?:/\d?\s*)?(?:[Nn]\s*\d+\s*)?(?:/\d?\s*)?([A-Za-z]\d[\d.]*(?![\d._])|[\w.]*)")


def is_still_name(name: bytes) -> bool:
    """Tell whether a named command leaves the machine and its modes alone, by its manual."""
    return name.upper() in _NAMES or name in _WORDS


def may_code_move(code: float, firmware: str | None, *, is_printers: bool) -> bool:
    """Tell whether an M code may move the machine; makers of machine tools have many of their own, which do not."""
    number = int(code)
    if firmware == "klipper" and number <= 1:
        # Stops are macros to it, which park.
        return True
    return number not in _CODES if is_printers else number in _PAUSES


def command_name(body: bytes) -> bytes:
    """Give the command that a line begins with, in capitals: `START_PRINT`, `M600`, `T1`."""
    found = _COMMAND.match(body)
    return b"" if found is None else found.group(1).upper()
