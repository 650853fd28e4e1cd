"""Follow a G-code program, for checking it: where each straight move begins and ends, and what it extrudes.

Nothing here is shared with the code that corrects programs. The rules are the published ones: a position is known
once X, Y and Z have been given since the start, homing, or a line after which the machine may be anywhere.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple, TypeGuard

from geoerr.errors import InputFileError
from geoerr.files import refusing_unreadable
from geoerr.model.arrays import Triple
from geoerr.verify.program_motion import Course, Past
from geoerr.verify.program_passages import Passage, arc_of
from geoerr.verify.program_words import Kind, Statement, read_statement
from geoerr.verify.still_commands import may_code_move

Place = tuple[float | None, float | None, float | None]
Motion = Literal["straight", "ends at its words", "ends somewhere", "none"]
Reading = Literal["clear", "unclear", "lost"]
Pace = Literal["rapid", "a minute", "a turn"]

_LINE_END = re.compile(rb"\r\n|\n|\r")
# The form that nearly all lines of a sliced program have; read without taking the line apart in general.
_NUMBER = rb"([-+]?(?:\d+\.?\d*|\.\d+))"
_PLAIN_MOVE = re.compile(
    rb"G([01])(?: X%b)?(?: Y%b)?(?: Z%b)?(?: E%b)?(?: F(\d+\.?\d*|\.\d+))? ?(?:;.*)?"
    % (_NUMBER, _NUMBER, _NUMBER, _NUMBER)
)
_LETTERS = (b"X", b"Y", b"Z")
_OTHER_AXES = frozenset((b"A", b"B", b"C", b"U", b"V", b"W"))
# Letters that a straight move may have, and those that belong to other codes on its line.
_MOVE_LETTERS = frozenset((*_LETTERS, b"E", b"F", b"S", b"T")) | _OTHER_AXES
_PARAMETERS = frozenset((b"D", b"H", b"L", b"P", b"Q"))
_TAKES_PARAMETERS = frozenset((40.0, 41.0, 41.1, 42.0, 42.1, 43.0, 64.0))
_PATH_LETTERS = frozenset((*_LETTERS, b"E", b"F"))
# What the cycles of lathes (blocks, allowances) and mills (places of holes) have.
_CYCLE_WORDS = frozenset((b"P", b"I", b"J", b"K", b"R")) | _OTHER_AXES
# Stands for all coordinate systems that are not followed.
_FURTHER_SYSTEM = 7
# Numbers from here on stand for those that a controller computes; names of tools have lower ones.
_FIRST_COMPUTED = 1e12
# What is this near to the end of an axis is at it.
_EDGE_MM = 1e-9
_UNKNOWN: Place = (None, None, None)
_ALL = (True, True, True)
# Planes of arcs: from the first axis to the second they turn counter-clockwise.
_PLANES = {17.0: (0, 1), 18.0: (2, 0), 19.0: (1, 2)}
_ARC_SENSES = {2.0: -1.0, 3.0: 1.0}
_CENTRE_WORDS = frozenset((b"I", b"J", b"K", b"R"))
_INCH_MM = 25.4
# Those that read programs differently.
FIRMWARES = ("marlin", "klipper", "reprapfirmware")
# Extruded lengths are counted in whole units of 1e-10 mm, of which 1e-9 mm and 1e-9 inches have so many.
UNITS_PER_MM = 10**10
_NANO_MM_UNITS, _NANO_INCH_UNITS = 10, 254

# G codes that say nothing about where the machine is.
_STILL = frozenset((9.0, 11.0, 22.0, 23.0, 61.1, 64.0, 96.0, 97.0, 98.0, 99.0))
# G codes that set, end, or take up again a shift of the program's zero besides G92.
_SHIFTS = frozenset((52.0, 92.1, 92.2, 92.3))
# G codes that take no D themselves, and the words that may stand beside the D of a tool's edge.
_LEAVING_D = frozenset(
    (0.0, 1.0, 17.0, 18.0, 19.0, 20.0, 21.0, 40.0, 53.0, 70.0, 71.0, 80.0, 90.0, 91.0, 94.0, 95.0, 700.0, 710.0)
)
_BESIDE_D = frozenset((*_LETTERS, b"D", b"F", b"S", b"T"))
# Spindle and coolant off.
_OFF = (5.0, 9.0)
# Of a bed, and of a nozzle that is waited for.
_HEATERS = frozenset(((109.0,), (140.0,), (190.0,)))
# G codes whose words are times or settings.
_OWN_WORDS = frozenset((4.0, 28.1, 30.1))
# A move that a probe ends, and macros: where they go is not in the program.
_UNSEEN = frozenset((31.0, 65.0, 66.0))
# Axis words mean something else until the second code: diameters, polar, scaled, turned; offset by the cutter.
_TRANSFORM = {7.0: 8.0, 16.0: 15.0, 51.0: 50.0, 68.0: 69.0, 41.0: 40.0, 41.1: 40.0, 42.0: 40.0, 42.1: 40.0}
_TRANSFORM |= {12.1: 13.1, 112.0: 113.0, 254.0: 255.0}
# For good: cylinders and poles.
_OTHER_MEANING = frozenset((7.1, 107.0, 110.0, 111.0))
# Inches and millimetres, of Siemens' controls too.
_UNITS = {20.0: _INCH_MM, 21.0: 1.0, 700.0: _INCH_MM, 710.0: 1.0}
_TRANSFORM_ENDS = frozenset(_TRANSFORM.values())


class Feed(NamedTuple):
    """How fast a move is asked to be.

    Attributes
    ----------
    pace
        Whether a mill's controller chooses the speed itself (`G0`), or F is a length a minute or a turn.
    feed_mm
        The F that holds, 0 before any; of a rapid it is what holds for the moves behind it.
    """

    pace: Pace
    feed_mm: float

    @property
    def speed_mm_min(self) -> float:
        """Speed along the path; 0 where it is not told."""
        return self.feed_mm if self.pace == "a minute" else 0.0

    def change_to(self, other: Feed) -> float:
        """Give by what share of this another feed differs; 1 where they cannot be compared, or this is none."""
        if self == other:
            return 0.0
        if self.pace != other.pace or self.feed_mm == 0.0:
            return 1.0
        return abs(other.feed_mm / self.feed_mm - 1.0)


class Move(NamedTuple):
    """A straight move whose end is known.

    Attributes
    ----------
    start_mm
        Where it begins, machine coordinates; None where it does not begin at the end of such a move.
    end_mm
        Where it ends.
    extrusion
        What its E word extrudes, in units of 1e-10 mm; where no firmware is named, as Marlin reads it.
    extrusion_reading
        Whether all firmwares that may run the program read its E word alike, and whether it is known where E stood
        before: of a lost one the word counts, and the next one says what is extruded.
    feed
        How fast it is asked to be.
    course
        Direction, travel and speed; None where they are not followed.
    others
        What else its line says: `S600`, `T3`, `M8`, sorted.
    passed
        How the machine came to where it begins, if not by the move before.
    """

    start_mm: Triple | None
    end_mm: Triple
    extrusion: int
    extrusion_reading: Reading
    feed: Feed
    course: Course | None
    others: tuple[str, ...] = ()
    passed: tuple[Passage, ...] = ()


class Line(NamedTuple):
    """One line: its number (1-based), its bytes without the end, and its move where it has one to be checked."""

    number: int
    body: bytes
    move: Move | None


@dataclass
class _Extruder:
    """The extruder, as each firmware that may run the program reads E; the first of them is told.

    E is an increment for Marlin by the last of G90 G91 M82 M83, for Klipper while M83 or G91 holds, for
    RepRapFirmware while M83 does.
    """

    firmware: str | None
    axes_relative: bool = False
    own_relative: bool = False
    last_relative: bool = False
    nano_units: int = _NANO_MM_UNITS
    total: int = 0
    # Where it stands for each of them, or for all while they read the next word alike.
    positions: list[int] = field(default_factory=lambda: [0])
    relative: list[bool] = field(init=False)
    # Another tool was chosen: a firmware may call its position anything.
    is_lost: bool = False

    def __post_init__(self) -> None:
        self._read()

    def set_axes(self, is_relative: bool) -> None:
        self.axes_relative = self.last_relative = is_relative
        self._read()

    def set_own(self, is_relative: bool) -> None:
        self.own_relative = self.last_relative = is_relative
        self._read()

    def reads_as(self) -> tuple[bool, bool, bool]:
        """Give what says whether E is a position."""
        return self.axes_relative, self.own_relative, self.last_relative

    def set_position(self, word: float) -> None:
        self.is_lost = False
        self._settle([self._units(word)])

    def take_up(self, kept: _Extruder) -> None:
        """Read E as when a state was kept, and count from where it stood then."""
        self.axes_relative, self.own_relative, self.last_relative = kept.reads_as()
        self.is_lost = kept.is_lost
        self._read()
        self._settle(list(kept.positions))

    def move(self, word: float | None) -> tuple[int, Reading]:
        """Give what E extrudes, and whether all read it alike: as a position or an increment, from the same place."""
        if word is None:
            return 0, "clear"
        units = self._units(word)
        if self.is_lost and not self.relative[0]:
            return self._find(units)
        if len(self.positions) == 1:
            increment = units if self.relative[0] else units - self.positions[0]
            self.positions[0] += increment
            self.total += increment
            return increment, "clear"
        return self._move_each(units)

    def _find(self, units: int) -> tuple[int, Reading]:
        """Learn from a position where E stands; what the move extrudes nobody has said."""
        before = self.total
        _, reading = self._move_each(units) if len(self.positions) > 1 else (0, "lost")
        self.total, self.is_lost = before, False
        if reading == "unclear":
            return 0, "unclear"
        self._settle([units])
        return units, "lost"

    def _move_each(self, units: int) -> tuple[int, Reading]:
        readings = [
            (is_relative, units if is_relative else units - position)
            for is_relative, position in zip(self.relative, self.positions, strict=True)
        ]
        self._settle([at + increment for at, (_, increment) in zip(self.positions, readings, strict=True)])
        told = readings[0]
        self.total += told[1]
        return told[1], "clear" if readings.count(told) == len(readings) else "unclear"

    def _units(self, word: float) -> int:
        """Give a length as whole units: exact for the digits that programs have."""
        return round(word * 1e9) * self.nano_units

    def _read(self) -> None:
        readings = {
            "marlin": self.last_relative,
            "klipper": self.axes_relative or self.own_relative,
            "reprapfirmware": self.own_relative,
        }
        self.relative = list(readings.values()) if self.firmware is None else [readings[self.firmware]]
        self._settle(self.positions)

    def _settle(self, positions: list[int]) -> None:
        if len(positions) == 1:
            positions = positions * len(self.relative)
        is_alike = len(set(zip(self.relative, positions, strict=True))) == 1
        self.positions = positions[:1] if is_alike else positions


@dataclass
class _Modes:
    unit_mm: float = 1.0
    is_relative: bool = False
    motion: Motion | None = None
    # Of arcs: 1 counter-clockwise, −1 clockwise; 0 while no code of them holds.
    arc_sense: float = 0.0
    # Indices of the axes of their plane, and whether I J K are a place.
    plane: tuple[int, int] = (0, 1)
    has_absolute_centres: bool = False
    transforms: set[float] = field(default_factory=set)
    is_inverse_time: bool = False
    is_feed_a_turn: bool = False
    is_rapid: bool = False
    feed_mm_min: float = 0.0
    # `M220` of printers; NaN where the program does not tell it.
    feed_override: float = 1.0
    kept_override: float = 1.0
    tool_length: float | None = None
    # Siemens' D, and the tool that it is of: their length counts where the program has no G43.
    tool_edge: tuple[float, float | None] | None = None
    # The tool that T has named, and that which M6 put in: before any M6 a T changes the tool.
    tool: float | None = None
    # Stands for the tool of the last T where the controller computes it; and how much was computed so far.
    computed_tool: float | None = None
    n_computed: int = 0
    changed_tool: float | None = None
    has_changed_tool: bool = False
    # Behind G49 or D0 no word means what it did; what does not move does not matter.
    has_lost_length: bool = False
    # By H0, behind which the H of G43 takes it up again.
    is_lost_by_h: bool = False
    has_saved_place: bool = False
    system: int = 1

    def read_as(self) -> tuple[float, bool, int]:
        """Give what says how words are read."""
        return self.unit_mm, self.is_relative, self.system


class _State(NamedTuple):
    """What Klipper keeps with SAVE_GCODE_STATE."""

    read_as: tuple[float, bool, int]
    shift: Place
    shifted: list[bool]
    extruder: _Extruder
    feed_mm_min: float
    feed_override: float
    n_offsets: int
    place: Place


class ProgramReader:
    """Follows a program line by line.

    Parameters
    ----------
    path
        The program.
    work_offset_mm
        From the machine's zero to the program's zero (G54).
    home_mm
        Where G28 leaves the machine; None: not known.
    firmware
        `marlin`, `klipper` or `reprapfirmware`: how E is read; None: not known, and Marlin's way is told.
    windups
        Axis and length of each wind-up of the machine, as of `Past`; None to follow no motion.
    ranges_mm
        Ends of each axis; None: not known.
    still
        Names of macros and codes that neither move the machine nor change its modes; capitals do not matter.

    Attributes
    ----------
    n_lines, n_moves
        What was read so far.
    n_not_followed, first_not_followed
        Lines that move and are no straight move to a known place, and the first of them (0: none).
    lacks_home
        Whether the program homed, and where that leaves the machine was not told.
    lacks_zero
        Whether the program has machine coordinates, and where its zero is in them was not told.
    """

    def __init__(
        self,
        path: str | Path,
        work_offset_mm: Triple | None = None,
        home_mm: Triple | None = None,
        firmware: str | None = None,
        windups: Sequence[tuple[int, float]] | None = (),
        ranges_mm: Sequence[tuple[float, float]] | None = None,
        still: Sequence[str] = (),
    ) -> None:
        self.path = Path(path)
        self._still = frozenset(name.upper().encode() for name in still)
        self.n_lines = 0
        self.n_moves = 0
        self.n_not_followed = self.first_not_followed = 0
        self.lacks_home = False
        self.lacks_zero = False
        self._home_mm = home_mm
        self._firmware = firmware
        self._extruder = _Extruder(firmware)
        self._modes = _Modes()
        self._place: Place = _UNKNOWN
        self._is_on_path = False
        self._past = None if windups is None else Past(windups)
        # Moves that have passed since the last one whose end is known.
        self._passed: list[Passage] = []
        self._shift: Place = (0.0, 0.0, 0.0)
        self._shifted = [False, False, False]
        self._ranges_mm = ranges_mm
        # Whether the line's word selects a coordinate system that is not followed.
        self._is_elsewhere = False
        # Where a mill's zero is nobody knows by itself; printers count from the machine's.
        self._axes_told = [work_offset_mm is not None] * 3
        self._is_printers = firmware is not None
        self._zero: Place = work_offset_mm or (0.0, 0.0, 0.0)
        self._systems: dict[int, Place] = {1: self._zero}
        self._n_tape_marks = 0
        self._is_numbered = False
        self._is_lost = False
        # What held where a branch of a printer began.
        self._branches: list[tuple[object, ...]] = []
        # What held where it was kept under a name, and how often the firmware's own offset has been set.
        self._kept: dict[bytes, _State] = {}
        self._n_offsets = 0

    @property
    def extrusion(self) -> int:
        """Net extruded length so far, in units of 1e-10 mm."""
        return self._extruder.total

    def __iter__(self) -> Iterator[Line]:
        """Give every line in order.

        Raises
        ------
        InputFileError
            where the file cannot be read.
        """
        with refusing_unreadable(self.path, "program"):
            opened = self.path.open("rb")
        try:
            with opened as stream:
                for raw in stream:
                    for body in _LINE_END.split(raw.removesuffix(b"\n").removesuffix(b"\r")):
                        self.n_lines += 1
                        yield Line(self.n_lines, body, self._follow(body))
        except OSError as error:
            raise InputFileError(self.path, f"cannot be read: {error.strerror}") from error

    def _follow(self, body: bytes) -> Move | None:
        if self._n_tape_marks >= 2:
            return None
        if self._is_lost:
            statement = self._statement(body)
            if any(letter in (statement.words or {}) for letter in _LETTERS):
                self._pass_over()
            return None
        plain = _PLAIN_MOVE.fullmatch(body)
        modes = self._modes
        if plain is not None and not (modes.transforms or modes.is_inverse_time or modes.has_lost_length):
            return self._plain_move(plain)
        return self._take(self._statement(body))

    def _statement(self, body: bytes) -> Statement:
        return read_statement(body, is_for_printer=self._firmware is not None, still=self._still)

    def _take(self, statement: Statement) -> Move | None:
        if self._is_lost_by(statement):
            return None
        statement = _without_unit(statement)
        match statement.kind:
            case Kind.STILL:
                pass
            case Kind.TAPE:
                self._n_tape_marks += 1
            case Kind.BRANCH:
                self._lose_way()
            case Kind.NUMBER:
                self._program_number()
            case Kind.ANYWHERE:
                self._forget()
            case Kind.OFFSET | Kind.EXTRUDER | Kind.SAVE | Kind.RESTORE:
                self._named(statement)
            case Kind.M_CODE:
                self._m_line(statement)
            case Kind.WORDS:
                return self._words(statement)
        return None

    def _named(self, statement: Statement) -> None:
        """Take over a command of Klipper's that changes, keeps, or takes up again how words are read."""
        if statement.kind is Kind.OFFSET:
            self._n_offsets += 1
            self._forget_named(statement.words or {})
        elif statement.kind is Kind.SAVE:
            self._kept[statement.state] = self._state()
        elif statement.kind is Kind.RESTORE:
            self._restore(self._kept.get(statement.state), moves_back=statement.moves_back)
        else:
            self._extruder.is_lost = True
            if not statement.is_told_still:
                self._forget()

    def _state(self) -> _State:
        modes = self._modes
        extruder = replace(self._extruder)
        extruder.positions, extruder.relative = list(self._extruder.positions), list(self._extruder.relative)
        return _State(
            modes.read_as(),
            self._shift,
            list(self._shifted),
            extruder,
            modes.feed_mm_min,
            modes.feed_override,
            self._n_offsets,
            self._place,
        )

    def _restore(self, state: _State | None, *, moves_back: bool) -> None:
        """Take up what was kept, as `cmd_RESTORE_GCODE_STATE` of Klipper's `gcode_move.py` does."""
        modes = self._modes
        if state is None or (modes.unit_mm, modes.system) != (state.read_as[0], state.read_as[2]):
            self._lose()
            return
        modes.is_relative = state.read_as[1]
        modes.feed_mm_min, modes.feed_override = state.feed_mm_min, state.feed_override
        self._extruder.take_up(state.extruder)
        self._shift, self._shifted = state.shift, list(state.shifted)
        self._find_zero()
        if moves_back or state.n_offsets != self._n_offsets:
            # The firmware's own offset, which nobody follows, is taken up too: what rests is elsewhere for words.
            self._forget()
        if moves_back:
            self._place = state.place

    def _m_line(self, statement: Statement) -> None:
        code = statement.m_codes[0]
        if not (statement.is_told_still and code in (48.0, 125.0)):
            self._m_code(code)
        if code == 220.0:
            self._override_feed(statement.words or {})
        # Machine tools have no words of temperatures there.
        self._is_printers |= _heats(statement)
        if statement.m_codes[0] == 140.0 and b"B" in (statement.words or {}) and not _heats(statement):
            # Heidenhain's controls draw the tool back from the contour.
            self._forget()
        if statement.m_codes[0] in (206.0, 428.0):
            # The zero moves, and no axis does.
            self._forget_named(dict.fromkeys(_LETTERS) if statement.m_codes[0] == 428.0 else statement.words or {})
        if not statement.is_told_still and may_code_move(code, self._firmware, is_printers=self._is_printers):
            self._forget()

    def _is_lost_by(self, statement: Statement) -> bool:
        """Lose track by a line that says what nobody knows; tell whether it is one."""
        is_lost = self._ends_here(statement) or _unit_or_cycle_mm(statement) not in (None, self._modes.unit_mm)
        if is_lost:
            self._lose()
        return is_lost

    def _program_number(self) -> None:
        """Take the number of the program; another one begins another program."""
        if self._is_numbered or self.n_moves > 0:
            self._lose()
        self._is_numbered = True

    def _ends_here(self, statement: Statement) -> bool:
        """Tell whether a line is not run as it stands by the firmware that was named, or changes what words mean."""
        if not _OTHER_MEANING.isdisjoint(statement.codes):
            return True
        if statement.calls and self._modes.motion != "ends somewhere":
            return True
        # Klipper and Marlin run the first code alone; Klipper stops at inches.
        is_cut = self._firmware in ("klipper", "marlin") and len(statement.codes) + len(statement.m_codes) > 1
        return is_cut or (self._firmware == "klipper" and not {20.0, 700.0}.isdisjoint(statement.codes))

    def _plain_move(self, plain: re.Match[bytes]) -> Move | None:
        self._modes.motion, self._modes.arc_sense = "straight", 0.0
        digit, x, y, z, e, feed = plain.groups()
        self._modes.is_rapid = digit == b"0"
        self._take_feed(_number(feed))
        extrusion = self._extrude(_number(e))
        if x is None and y is None and z is None:
            return None
        return self._arrive(self._end(_number(x), _number(y), _number(z), self._origin()), extrusion)

    def _words(self, statement: Statement) -> Move | None:
        words = statement.words or {}
        for code in statement.m_codes:
            self._m_code(code)
        codes = _without_idle_end(statement.codes, words)
        self._take_tool(statement, words)
        owners = [code for code in codes if not self._take_mode(code, words)]
        self._is_elsewhere = not owners and _selects_by_word(statement)
        if not owners:
            self._other_controls(statement, words)
        if _motions_disagree(codes) or not statement.is_readable:
            # Which of two motion codes holds, controllers do not agree on; nor what stands behind an odd byte.
            self._forget()
        if not owners:
            self._take_feed(words.get(b"F"))
            if words.get(b"F", 0.0) is None:
                # What the controller computes is not known here.
                self._modes.feed_mm_min = 0.0
        if owners:
            self._owned(owners, statement, words)
        elif statement.is_readable:
            return self._moves(statement, words)
        return None

    def _other_controls(self, statement: Statement, words: dict[bytes, float | None]) -> None:
        """Take over what words beside a code, or alone, mean to controls that few programs are for."""
        if self._is_elsewhere:
            self._select_system(_FURTHER_SYSTEM)
        if self._has_edge(statement, words):
            self._take_edge(self._number_of(words[b"D"]))
        elif self._counts_edges() and _calls_tool(statement, words):
            self._take_edge(1.0)
        if self._firmware is None and not any(
            code in (15.0, 49.0) or 43.0 <= code < 45.0 for code in statement.codes
        ):
            self._take_length(words)

    def _take_length(self, words: dict[bytes, float | None]) -> None:
        """Take another length by H alone while G43 holds; H0 takes none until the H of G43."""
        modes = self._modes
        if b"H" not in words or modes.tool_length is None:
            return
        number = self._number_of(words[b"H"])
        if number == modes.tool_length:
            # What G49 has ended H alone does not take up again.
            modes.has_lost_length &= not modes.is_lost_by_h
            modes.is_lost_by_h = False
        elif number == 0.0:
            modes.is_lost_by_h |= not modes.has_lost_length
            modes.has_lost_length = True
        else:
            modes.tool_length = number
            self._lose_zero()

    def _number_of(self, number: float | None) -> float:
        """Give the tool, edge or length that a word means; what the controller computes equals no other."""
        if number is not None:
            return float(math.floor(max(number, 0.0)))
        self._modes.n_computed += 1
        return _FIRST_COMPUTED + self._modes.n_computed

    def _take_tool(self, statement: Statement, words: dict[bytes, float | None]) -> None:
        """Take over the tool of a line; another one than that of the D that holds has another length."""
        modes, named = self._modes, words.get(b"T")
        if self._moves_by_tool(statement, named) and not statement.is_told_still:
            self._forget()
        if named is not None:
            before, modes.tool = modes.tool, self._number_of(named)
            # Programs begin with the tool 0, if they name none.
            self._extruder.is_lost |= (before or 0.0) != modes.tool
        if b"T" in words:
            # Printers have no lengths of tools.
            is_computed = named is None and self._firmware is None
            modes.computed_tool = self._number_of(None) if is_computed else None
        if 6.0 in statement.m_codes:
            modes.has_changed_tool, modes.changed_tool = True, self._named_tool()
        if self._counts_edges() and modes.tool_edge is not None and modes.tool_edge[1] != self._tool_in_use():
            modes.has_lost_length = True

    def _moves_by_tool(self, statement: Statement, named: float | None) -> bool:
        """Tell whether a T may move a printer: to Klipper each is a macro, to others one that chooses another tool.

        Of the first nobody knows whether it does.
        """
        if self._firmware in ("marlin", "reprapfirmware"):
            return named is not None and self._modes.tool != float(math.floor(max(named, 0.0)))
        return self._is_printers and statement.begins_with_tool

    def _tool_in_use(self) -> float | None:
        return self._modes.changed_tool if self._modes.has_changed_tool else self._named_tool()

    def _named_tool(self) -> float | None:
        return self._modes.tool if self._modes.computed_tool is None else self._modes.computed_tool

    def _counts_edges(self) -> bool:
        """Tell whether a D may be a tool's edge: behind G43 it is a radius, to printers nothing."""
        return self._firmware is None and self._modes.tool_length is None

    def _has_edge(self, statement: Statement, words: dict[bytes, float | None]) -> bool:
        """Tell whether a line has an edge of a tool, which is not the D of a code on it."""
        codes = frozenset(statement.codes)
        is_free = all(code in _LEAVING_D or _selects_system(code) for code in codes) and words.keys() <= _BESIDE_D
        return b"D" in words and is_free and self._counts_edges()

    def _take_edge(self, edge: float) -> None:
        modes, now = self._modes, (edge, self._tool_in_use())
        if modes.tool_edge is None and edge:
            modes.tool_edge = now
            self._forget_height()
        elif modes.tool_edge is not None:
            modes.has_lost_length = not edge
            if edge and now != modes.tool_edge:
                modes.tool_edge = now
                self._lose_zero()

    def _moves(self, statement: Statement, words: dict[bytes, float | None]) -> Move | None:
        if any(letter in words for letter in _LETTERS):
            return self._motion(statement, words)
        if not (words.keys() & (_OTHER_AXES | {b"E"})):
            if self._modes.arc_sense and _CENTRE_WORDS & words.keys() and not {2.0, 3.0}.isdisjoint(statement.codes):
                self._pass_whole_circle(words)
            return None
        is_template = statement.has_placeholder and not _OTHER_AXES & words.keys()
        is_clear = (_has_numbers(words) or is_template) and statement.is_single
        if not is_clear or self._modes.motion is None:
            self._forget()
        elif _has_numbers(words):
            self._extrude(words.get(b"E"))
        return None

    def _extrude(self, word: float | None) -> tuple[int, Reading]:
        self._is_printers |= word is not None
        return self._extruder.move(word)

    def _zero_is_told(self) -> bool:
        """Tell whether it is known where the program's zero is on the machine, or known that nobody knows."""
        return self._modes.system != 1 or self._is_printers or all(self._axes_told)

    def _motion(self, statement: Statement, words: dict[bytes, float | None]) -> Move | None:
        modes = self._modes
        in_machine = 53.0 in statement.codes
        if modes.has_lost_length and not in_machine:
            self._lose_zero()
            self._pass_over()
            return None
        has_numbers = _has_numbers(words)
        takes_parameters = _TAKES_PARAMETERS & set(statement.codes) or (
            self._has_edge(statement, words) and words[b"D"] is not None
        )
        known = _MOVE_LETTERS | (_PARAMETERS if takes_parameters else frozenset())
        is_odd = modes.motion == "straight" and not words.keys() <= known
        is_template = statement.has_placeholder and not has_numbers and not _OTHER_AXES & words.keys()
        if is_template and modes.motion == "straight" and not is_odd and not modes.transforms:
            self._forget_named(words)
            self._pass_over()
            return None
        # Heidenhain's M91 and M92 count from places of the machine's.
        is_placed_by_m = self._firmware is None and not {91.0, 92.0}.isdisjoint(statement.m_codes)
        is_clear = statement.is_single and has_numbers and not (is_odd or is_placed_by_m or modes.transforms)
        if modes.motion in (None, "ends somewhere") or not is_clear or (in_machine and modes.is_relative):
            self._forget()
            self._pass_over()
            return None
        zero_was_told = self._zero_is_told()
        extrusion = self._extrude(words.get(b"E"))
        x, y, z = (words.get(letter) for letter in _LETTERS)
        if in_machine and not zero_was_told:
            # Words that count from another zero tell nothing of these axes.
            self.lacks_zero = True
            if not modes.is_rapid:
                self._pass_over()
            self._leave(words, [letter in words for letter in _LETTERS])
            return None
        end = self._end(x, y, z, (0.0, 0.0, 0.0) if in_machine else self._origin())
        is_correctable = not _OTHER_AXES & words.keys() and not statement.has_checksum
        if modes.motion == "straight" and is_correctable and self._is_placed(statement) and not modes.is_inverse_time:
            at_ends = [self._is_end_of_axis(axis, words.get(letter)) for axis, letter in enumerate(_LETTERS)]
            if in_machine and modes.is_rapid and any(at_ends):
                self._leave(words, at_ends)
                return None
            return self._arrive(end, extrusion, _others(statement, words, is_rapid=modes.is_rapid))
        self.n_moves += 1
        self._pass_over()
        self._go(words, end)
        return None

    def _pass_whole_circle(self, words: dict[bytes, float | None]) -> None:
        """Take over an arc that gives no place: it ends where it begins."""
        self._pass_over()
        if _has_numbers(words):
            self._go(words, self._place)
        else:
            self._forget()

    def _go(self, words: dict[bytes, float | None], end: Place) -> None:
        """Move as a line says that is not corrected, by an arc or straight."""
        modes, arc, is_followed = self._modes, None, _ALL
        if modes.motion != "straight":
            origin = self._zero if modes.has_absolute_centres else None
            arc = arc_of(words, modes.plane, modes.arc_sense, modes.unit_mm, origin) if modes.arc_sense else None
            is_followed = _ALL if arc is not None else (False, False, False)
        self._pass(Passage(self._place, end, is_followed, arc))
        self._place, self._is_on_path = end, False

    def _pass(self, passage: Passage) -> None:
        """Take over what passes as it is."""
        self._passed.append(passage)
        if self._past is not None:
            strokes = passage.strokes(is_whole=passage.is_whole)
            self._past.pass_by(passage.begin_mm, strokes, passage.miss_mm)

    def _pass_over(self) -> None:
        """Count a line of which nobody can say where its move ends, or that it goes there straight."""
        self.n_not_followed += 1
        self.first_not_followed = self.first_not_followed or self.n_lines

    def _is_end_of_axis(self, axis: int, word: float | None) -> bool:
        """Tell whether a machine coordinate is the end of an axis, where a correction has no travel."""
        ends_mm = () if self._ranges_mm is None else self._ranges_mm[axis]
        return word is not None and any(abs(word * self._modes.unit_mm - end_mm) <= _EDGE_MM for end_mm in ends_mm)

    def _leave(self, words: dict[bytes, float | None], left: list[bool]) -> None:
        """Move in machine coordinates as the line says; some axes are not followed any more."""
        self.n_moves += 1
        place = list(self._place)
        for axis, letter in enumerate(_LETTERS):
            word = words.get(letter)
            if left[axis] or word is not None:
                place[axis] = None if left[axis] or word is None else word * self._modes.unit_mm
        end = place[0], place[1], place[2]
        self._pass(Passage(self._place, end, (not left[0], not left[1], not left[2])))
        self._place, self._is_on_path = end, False

    def _take_feed(self, feed: float | None) -> None:
        # Marlin passes F0 over.
        if feed is not None and feed > 0.0:
            self._modes.feed_mm_min = feed * self._modes.unit_mm

    def _override_feed(self, words: dict[bytes, float | None]) -> None:
        modes = self._modes
        now = modes.feed_override
        if b"R" in words:
            modes.feed_override = modes.kept_override
        if b"B" in words:
            modes.kept_override = now
        if b"S" in words:
            percent = words[b"S"]
            modes.feed_override = math.nan if percent is None else percent / 100.0

    def _feed(self) -> Feed:
        modes = self._modes
        # The firmwares of printers take the feed for G0, too.
        is_rapid = modes.is_rapid and self._firmware is None
        return Feed("rapid" if is_rapid else "a turn" if modes.is_feed_a_turn else "a minute", modes.feed_mm_min)

    def _forget_past(self, named: list[bool]) -> None:
        x, y, z = (not name for name in named)
        if not (x or y or z):
            # What was before does not matter any more.
            self._passed.clear()
        self._pass(Passage(self._place, self._place, (x, y, z)))

    def _is_placed(self, statement: Statement) -> bool:
        """Tell whether the coordinate systems that a line selects, if it does, have places that are known."""
        selected = (_system_of(code) for code in statement.codes if _selects_system(code))
        return not self._is_elsewhere and all(_is_known(self._systems.get(system, _UNKNOWN)) for system in selected)

    def _arrive(self, end: Place, extrusion: tuple[int, Reading], others: tuple[str, ...] = ()) -> Move | None:
        """Move on a straight line; give the move where its end is known."""
        self.n_moves += 1
        begin, was_on_path = self._place, self._is_on_path
        self._place = end
        feed = self._feed()
        course = None
        if self._past is not None:
            override = self._modes.feed_override
            course = self._past.straight(begin, end, 0.0 if math.isnan(override) else feed.speed_mm_min * override)
        self._is_on_path = _is_known(end)
        if not _is_known(end):
            self._pass_over()
            self._passed.append(Passage(begin, end, _ALL))
            return None
        start = begin if was_on_path and _is_known(begin) else None
        passed: tuple[Passage, ...] = ()
        if self._passed:
            passed = tuple(self._passed)
            self._passed.clear()
        return Move(start, end, *extrusion, feed, course, others, passed)

    def _origin(self) -> Place:
        """Give the machine coordinates from which axis words count."""
        return self._place if self._modes.is_relative else self._zero

    def _end(self, x: float | None, y: float | None, z: float | None, origin: Place) -> Place:
        unit_mm = self._modes.unit_mm
        here_x, here_y, here_z = self._place
        from_x, from_y, from_z = origin
        return (
            here_x if x is None else None if from_x is None else from_x + x * unit_mm,
            here_y if y is None else None if from_y is None else from_y + y * unit_mm,
            here_z if z is None else None if from_z is None else from_z + z * unit_mm,
        )

    def _select_system(self, system: int) -> None:
        was_told = self._zero_is_told()
        self._modes.system = system
        self._find_zero()
        if self._zero_is_told() != was_told:
            # What is known from a zero that is only thought says nothing in a system that has its place.
            self.lacks_zero |= any(here is not None for here in self._place)
            self._forget()

    def _find_zero(self) -> None:
        """Find the machine coordinates of the program's zero again, after the system or the shift has changed."""
        system = self._systems.get(self._modes.system, _UNKNOWN)
        x, y, z = (
            None if zero is None or shift is None else zero + shift
            for zero, shift in zip(system, self._shift, strict=True)
        )
        self._zero = (x, y, z)

    def _take_mode(self, code: float, words: dict[bytes, float | None]) -> bool:
        """Take over a code that says how to read words; False where the line's words belong to the code."""
        modes = self._modes
        if self._take_motion(code):
            return True
        if code in _UNITS:
            modes.unit_mm = _UNITS[code]
            self._extruder.nano_units = _NANO_INCH_UNITS if modes.unit_mm == _INCH_MM else _NANO_MM_UNITS
        elif code in (90.0, 91.0):
            modes.is_relative = code == 91.0
            self._extruder.set_axes(modes.is_relative)
        elif _selects_system(code):
            self._select_system(_system_of(code))
        elif code in (93.0, 94.0, 95.0):
            modes.is_inverse_time = code == 93.0
            if code != 93.0:
                modes.is_feed_a_turn = code == 95.0
        else:
            return self._take_geometry(code, words)
        return True

    def _take_geometry(self, code: float, words: dict[bytes, float | None]) -> bool:
        """Take over a code that changes what axis words mean, or where the machine is."""
        modes = self._modes
        if code in _TRANSFORM:
            modes.transforms.add(_TRANSFORM[code])
            self._forget()
        elif code == 113.0 and code not in modes.transforms:
            # Haas' controls have a coordinate system of that number, where it does not end G112.
            self._select_system(_FURTHER_SYSTEM)
        elif code in _TRANSFORM_ENDS:
            modes.transforms.discard(code)
        elif code in (43.0, 49.0):
            self._tool_length(code, words)
        elif 43.0 < code < 45.0:
            self._lose_zero()
        elif code == 60.0:
            modes.has_saved_place = True
        elif code == 61.0:
            if modes.has_saved_place:
                self._forget()
        else:
            return code == 53.0 or code in _STILL or self._take_arcs(code)
        return True

    def _take_arcs(self, code: float) -> bool:
        """Take over how the words of arcs are read."""
        modes = self._modes
        modes.plane = _PLANES.get(code, modes.plane)
        if code in (90.1, 91.1):
            modes.has_absolute_centres = code == 90.1
        return code in _PLANES or code in (90.1, 91.1)

    def _take_motion(self, code: float) -> bool:
        motion = _motion_of(code)
        if code == 80.0 and self._firmware == "marlin":
            # Prusa's Marlin measures the bed.
            self._forget()
            return True
        if motion is not None:
            self._modes.motion = None if motion == "none" else motion
            self._modes.arc_sense = _ARC_SENSES.get(code, 0.0)
            self._modes.is_rapid = code == 0.0
        if motion == "ends somewhere":
            self._forget()
        return motion is not None

    def _tool_length(self, code: float, words: dict[bytes, float | None]) -> None:
        modes = self._modes
        if code == 49.0:
            modes.has_lost_length |= modes.tool_length is not None
            modes.is_lost_by_h = False
            return
        # Without H it is that of the tool in use (LinuxCNC).
        of_tool = self._tool_in_use()
        length = -1.0 if of_tool is None else of_tool
        if b"H" in words:
            length = self._number_of(words[b"H"])
        modes.has_lost_length = modes.is_lost_by_h = False
        if modes.tool_length is None:
            self._forget_height()
        elif modes.tool_length != length:
            self._lose_zero()
        modes.tool_length = length

    def _forget_height(self) -> None:
        self._place = (self._place[0], self._place[1], None)
        self._is_on_path = False
        self._forget_past([False, False, True])

    def _owned(self, owners: list[float], statement: Statement, words: dict[bytes, float | None]) -> None:
        code = owners[0]
        if len(owners) > 1 or self._loses_shift(code, statement, words):
            self._lose_zero()
        elif code in (10.0, 92.0):
            sets_zero = code == 92.0 or words.get(b"L") == 2.0
            if not statement.is_readable or (sets_zero and not statement.is_single):
                self._lose_zero()
            elif code == 92.0:
                self._shift_zero(words)
            else:
                self._settings(words)
        elif code == 28.0 and statement.is_readable:
            # With O Marlin stays where it is if it is at home already.
            self._home([letter in words for letter in _LETTERS], is_sure=b"O" not in words)
        elif code == 28.0:
            self._lose_zero()
        elif code not in _SHIFTS and (code not in _OWN_WORDS or _moves_besides(code, statement, words)):
            self._forget()
            if code in _UNSEEN:
                self._pass_over()
        if 93.0 in statement.codes or not self._is_placed(statement):
            self._forget()
        self._find_zero()

    def _loses_shift(self, code: float, statement: Statement, words: dict[bytes, float | None]) -> bool:
        """Tell whether a code leaves a shift that is not followed; to end one where none holds does nothing."""
        moves = code == 52.0 and any(_motion_of(other) not in (None, "none") for other in statement.codes)
        ends = statement.is_readable and _ends_shift(code, words) and not moves
        return code in _SHIFTS and not (ends and not any(self._shifted))

    def _shift_zero(self, words: dict[bytes, float | None]) -> None:
        if not words and self._firmware == "klipper":
            # All that it has is 0 here.
            words = dict.fromkeys((*_LETTERS, b"E"), 0.0)
        if not words or not _has_numbers(words):
            self._lose_zero()
            return
        extruder = words.get(b"E")
        if extruder is not None:
            self._is_printers = True
            self._extruder.set_position(extruder)
        system = self._systems.get(self._modes.system, _UNKNOWN)
        shift = list(self._shift)
        for axis, letter in enumerate(_LETTERS):
            word, here, zero = words.get(letter), self._place[axis], system[axis]
            if letter in words:
                self._shifted[axis] = True
                shift[axis] = None
                if word is not None and here is not None and zero is not None:
                    shift[axis] = here - zero - word * self._modes.unit_mm
        self._shift = (shift[0], shift[1], shift[2])

    def _settings(self, words: dict[bytes, float | None]) -> None:
        kind, system = words.get(b"L"), words.get(b"P")
        has_axes = any(letter in words for letter in _LETTERS)
        is_plain = (
            _has_numbers(words)
            and not self._modes.is_relative
            and b"R" not in words
            and system is not None
            # P0 is the system that holds, or one that is added to all of them.
            and 1.0 <= system <= 9.0
        )
        if kind == 2.0 and is_plain and system is not None:
            number = int(system)
            place = list(self._systems.get(number, _UNKNOWN))
            for axis, letter in enumerate(_LETTERS):
                word = words.get(letter)
                if word is not None:
                    place[axis] = word * self._modes.unit_mm
            if number < 7:
                self._systems[number] = (place[0], place[1], place[2])
            if number == 1:
                self._tell_zero([letter in words for letter in _LETTERS])
        elif kind in (2.0, 20.0) or (has_axes and kind not in (1.0, 10.0, 11.0)):
            self._lose_zero()

    def _tell_zero(self, axes: list[bool]) -> None:
        """Take over where G54 is: what was counted from where it was thought to be is forgotten."""
        was_told, before = self._zero_is_told(), self._axes_told
        self._axes_told = [old or new for old, new in zip(before, axes, strict=True)]
        if not was_told and self._axes_told != before:
            self.lacks_zero |= any(here is not None for here in self._place)
            self._forget()

    def _home(self, named: list[bool], *, is_sure: bool) -> None:
        place, shift = list(self._place), list(self._shift)
        self.lacks_home |= self._home_mm is None
        home_mm = self._home_mm if is_sure and self._zero_is_told() else None
        # Where the machine is tells nothing of words that count from another zero.
        self.lacks_zero |= self._home_mm is not None and not self._zero_is_told()
        # A printer that homes one axis moves the others, too: to where Z is probed, or up.
        is_part = any(named) and not all(named) and self._is_printers
        if is_part:
            home_mm, place = None, [None] * 3
        for axis in range(3):
            if named[axis] or not any(named):
                place[axis] = None if home_mm is None else home_mm[axis]
                if self._firmware is not None:
                    shift[axis] = 0.0
                    self._shifted[axis] = False
        self._place = (place[0], place[1], place[2])
        self._forget_past([name or is_part or not any(named) for name in named])
        self._shift = (shift[0], shift[1], shift[2])
        self._is_on_path = False

    def _m_code(self, code: float) -> None:
        if code in (82.0, 83.0):
            self._extruder.set_own(code == 83.0)
        elif code in (6.0, 48.0, 125.0):
            self._forget()
        elif code in (98.0, 99.0, 198.0):
            self._lose_way()
        elif code in (622.0, 623.0):
            self._branch(begins=code == 622.0)

    def _branch(self, *, begins: bool) -> None:
        """Begin or end lines that may not run: behind them words must be read as before."""
        holds = self._holding()
        self._forget()
        if begins:
            self._branches.append(holds)
        elif not self._branches or self._branches.pop() != holds:
            self._lose()
        else:
            self._extruder.is_lost = True

    def _holding(self) -> tuple[object, ...]:
        return self._modes.read_as(), self._shift, self._extruder.reads_as()

    def _forget_named(self, words: dict[bytes, float | None]) -> None:
        """Forget the axes that a line with a placeholder names: a firmware may read part of it, or refuse it."""
        if words.keys().isdisjoint(_LETTERS):
            return
        place = [None if letter in words else here for letter, here in zip(_LETTERS, self._place, strict=True)]
        self._place = (place[0], place[1], place[2])
        self._is_on_path = False
        self._forget_past([letter in words for letter in _LETTERS])

    def _forget(self) -> None:
        self._place = _UNKNOWN
        self._is_on_path = False
        self._forget_past([True, True, True])

    def _lose(self) -> None:
        """Lose track for good: which line comes next is not known."""
        self._forget()
        self._is_lost = True

    def _lose_way(self) -> None:
        """Lose track at a call or a jump: what is run there may move anywhere."""
        self._lose()
        self._pass_over()

    def _lose_zero(self) -> None:
        self._forget()
        self._shift = self._zero = _UNKNOWN
        self._shifted = [True, True, True]


def _motion_of(code: float) -> Motion | None:
    """Tell what a motion code asks for; None for other codes."""
    if code in (0.0, 1.0):
        return "straight"
    if 2.0 <= code < 4.0 or 5.0 <= code < 5.4 or code == 6.0 or 33.0 <= code < 34.0:
        return "ends at its words"
    if code == 80.0:
        return "none"
    return "ends somewhere" if 38.0 <= code < 39.0 or 70.0 <= code < 90.0 else None


def _selects_system(code: float) -> bool:
    """Tell whether a code selects a coordinate system; those of Siemens' and Haas' controls are never known."""
    is_further = code in (154.0, 500.0) or 505.0 <= code <= 599.0 or 114.0 <= code < 130.0
    return 54.0 <= code < 60.0 or is_further


def _system_of(code: float) -> int:
    """Give the number of a coordinate system: 1 is G54; 7 stands for the others, which are not followed."""
    return int(code) - 53 if code in (54.0, 55.0, 56.0, 57.0, 58.0, 59.0) else _FURTHER_SYSTEM


def _calls_tool(statement: Statement, words: dict[bytes, float | None]) -> bool:
    """Tell whether a line calls a tool with its length, `T2 G17 S3000` of Heidenhain's controls."""
    letters = frozenset((b"F", b"S", b"T"))
    is_plane = bool(statement.codes) and all(code in (17.0, 18.0, 19.0) for code in statement.codes)
    has_both = b"T" in words and words.get(b"S") is not None
    return is_plane and has_both and words.keys() <= letters and not statement.m_codes


def _heats(statement: Statement) -> bool:
    """Tell whether a line heats a bed, or waits for a nozzle, as printers do."""
    words = statement.words or {}
    has_temperature = any(words.get(letter) is not None for letter in (b"S", b"R"))
    others = words.keys() - frozenset((b"H", b"P", b"R", b"S", b"T"))
    return statement.m_codes in _HEATERS and has_temperature and not others


def _selects_by_word(statement: Statement) -> bool:
    """Tell whether a word beside a code selects a further system: `G54 P3` (Fanuc), `G15 H1` (Okuma)."""
    words, codes = statement.words or {}, statement.codes
    by_number = b"P" in words and 54.0 in codes and 64.0 not in codes
    return by_number or (b"H" in words and 15.0 in codes and not any(43.0 <= code < 45.0 for code in codes))


def _unit_or_cycle_mm(statement: Statement) -> float | None:
    """Give the unit of G70 or G71 without words of a cycle, to Siemens' and Heidenhain's controls; else None."""
    units_mm = [unit_mm for code, unit_mm in ((70.0, 25.4), (71.0, 1.0)) if code in statement.codes]
    return units_mm[0] if units_mm and not _CYCLE_WORDS & (statement.words or {}).keys() else None


def _without_unit(statement: Statement) -> Statement:
    """Leave out G70 and G71 where they tell a unit, which holds already."""
    if _unit_or_cycle_mm(statement) is None:
        return statement
    return replace(statement, codes=tuple(code for code in statement.codes if code not in (70.0, 71.0)))


def _moves_besides(code: float, statement: Statement, words: dict[bytes, float | None]) -> bool:
    """Tell whether a dwell or a stored place has words that may move; X alone is the time of Fanuc's dwell."""
    has_motion_code = any(_motion_of(other) not in (None, "none") for other in statement.codes)
    is_time = code == 4.0 and not has_motion_code and 53.0 not in statement.codes
    moving = words.keys() & frozenset((*_LETTERS, b"E", *_OTHER_AXES))
    return bool(moving) and not (is_time and words.keys().isdisjoint((b"Y", b"Z", b"E", b"P")))


def _ends_shift(code: float, words: dict[bytes, float | None]) -> bool:
    """Tell whether a code ends a shift and does nothing else: where none holds, nothing happens."""
    named = words.keys() & frozenset(_LETTERS)
    is_all_zero = code == 52.0 and bool(named) and all(words[letter] == 0.0 for letter in named)
    return not words.keys() & _OTHER_AXES and (is_all_zero or (code in (92.1, 92.2) and not named))


def _without_idle_end(codes: tuple[float, ...], words: dict[bytes, float | None]) -> tuple[float, ...]:
    """Leave out a G80 behind G0 or G1 on a line without motion: it ends a cycle, and they hold on."""
    if words.keys() & (_CYCLE_WORDS | frozenset((*_LETTERS, b"E"))) - {b"P"}:
        return codes
    kept: list[float] = []
    motion = None
    for code in codes:
        if code != 80.0 or motion != "straight":
            kept.append(code)
            motion = _motion_of(code) or motion
    return tuple(kept)


def _others(statement: Statement, words: dict[bytes, float | None], *, is_rapid: bool) -> tuple[str, ...]:
    """Give what a move's line says besides where, how fast, and with how much filament.

    Spindle and coolant that go off in a rapid are told as that: nothing is cut where they may go off early.
    """
    letters = words.keys() - _PATH_LETTERS
    if not letters and not statement.m_codes:
        return ()
    said = (f"{letter.decode()}{words[letter]:.12g}" for letter in letters if words[letter] is not None)
    codes = (f"{'rapid ' if is_rapid and code in _OFF else ''}M{code:g}" for code in statement.m_codes)
    return tuple(sorted((*said, *codes)))


def _motions_disagree(codes: tuple[float, ...]) -> bool:
    """Tell whether two motion codes stand on one line; G80 before another one only ends what held before."""
    motions = [motion for motion in map(_motion_of, codes) if motion is not None]
    while motions and motions[0] == "none":
        del motions[0]
    return len(set(motions)) > 1


def _has_numbers(words: dict[bytes, float | None]) -> bool:
    """Tell whether every word that moves something has its number."""
    return None not in (words[letter] for letter in (*_LETTERS, b"E") if letter in words)


def _is_known(place: Place) -> TypeGuard[Triple]:
    return None not in place


def _number(digits: bytes | None) -> float | None:
    return None if digits is None else float(digits)
