"""Take one line of a G-code program apart, for checking programs.

Nothing here is shared with the code that corrects programs: what proves a correction must not inherit its mistakes.
"""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass, replace
from enum import Enum

from geoerr.verify.still_commands import command_name, is_still_name

# `/`, or `/1` to `/9`, before a line's number or behind it.
_BEGIN = re.compile(rb"\s*(/\s*\d?)?\s*(?:[Nn]\s*\d+(?:\.\d*)?\s*(/\s*\d?)?)?\s*")
_COMMENT = re.compile(rb"\([^)]*\)|;.*")
_CHECKSUM = re.compile(rb"\*\d*\s*$")
# `# text`, as Klipper's own files comment; `#1=2` sets a parameter.
_TEXT = re.compile(rb"#(?![\d<#\[])")
# What a controller computes: `[1+[2*#3]]`, `#5`, `#<depth>`. Its number is not known here.
_COMPUTED = rb"[-+]?(?:\[(?:[^\[\]]|\[[^\[\]]*\])*\]|#+(?:\d+|<[^>]*>))"
# `X=150` of Siemens' controls; what they compute, up to a blank or comment outside of brackets; a tool by its name.
# Of a longer name (`FZ=0.1`) the last letter is none by itself.
_ASSIGNED = re.compile(
    rb"(?<![A-Za-z_])([A-FH-LO-Za-fh-lo-z])[ \t]*=[ \t]*"
    rb"(?:([-+]?(?:\d+\.?\d*|\.\d+))(?![\d.]|[ \t]*[-+*/=])"
    rb"|\"([^\"]*)\"|(?:\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)|\[[^\[\]]*\]|[^\s;()\[\]=\"])+)"
)
# Tools that have names get numbers from here on.
_NAMED_TOOLS = 10**9
_WORD = re.compile(rb"([A-Za-z])[ \t]*(?:([-+]?(?:\d+\.?\d*|\.\d+))|%b)?" % _COMPUTED)
_WORDS = re.compile(rb"(?:[ \t]*%b)*[ \t]*" % _WORD.pattern)
# A number of a tool, edge or length at the end of what can be read, and what can be no value there.
_CUT = re.compile(rb"[DdHhTt][ \t]*$")
_UNREADABLE_VALUE = re.compile(rb"[-+.=\[#]|\{[^}]*$")
_NAME = re.compile(rb"[A-Za-z_]{2}\w*|[A-Za-z]\d[\d.]*_\w*")
_PLACEHOLDER = re.compile(rb"\{[a-z][a-z0-9_]*\}")

# M codes whose line is text, not words; and those that have text on printers, and moves on machine tools.
_TEXT_CODES = frozenset((117, 118, 486, 550, 551, 552, 553, 586, 587, 588, 589, 862, 928, 929, 1002))
_TEXT_OF_PRINTERS = frozenset((0, 1, 16, *range(20, 34), 36, 37, 38, 39))
# M codes below this may stand before moves on machine tools, whose makers number their own up to 199, but for those
# by which printers set motors and parking.
_FIRST_OF_PRINTERS = 200
_SETTINGS_OF_PRINTERS = frozenset((17, 18, 25, 48, 84, 92, 122, 125))
# M codes that may share their line with a move (machining programs).
_MACHINING_CODES = frozenset(range(2, 10))
# M codes and names that decide which line comes next.
_BRANCHING_CODES = frozenset((97, 98, 99, 198, 808))
_BRANCHING_NAMES = re.compile(
    rb"if|elif|else|while|break|continue|abort|goto(?:\d*|[bcfs])|then|do\d+|end\d+|for|loop|repeatb?|until|case"
    rb"|(?:ext)?call",
    re.IGNORECASE,
)
# Frames, transformations and curves of Siemens' controls: axis words mean something else from there on.
_TRANSFORMING_NAMES = re.compile(
    rb"A?(?:TRANS|ROTS?|SCALE|MIRROR)|[ABC]SPLINE|CIP|CT|INVCC?W|POLY|V[ZT]OF\w*"
    rb"|CROTS|CYCLE800|MCALL|TRAANG|TRACYL|TRAFOO[FN]|TRANSMIT|TRAORI|TOFRAME|TOROT",
    re.IGNORECASE,
)
# `#CS ON` and others of Beckhoff's (ISG) and Fagor's controls: frames, machine coordinates, calls. Others are text.
_INSTRUCTIONS = re.compile(
    rb"#(?:(?:E?CS|[AMW]CS|AKIMA|[MP]?CALL|PRESET|PSET|RTCP|TLC|TRAFO)(?!\w)"
    rb"|(?:CYL|FACE|KIN|ROTATION|SPLINE)(?!\w)\s*(?:ON|OFF|\[))",
    re.IGNORECASE,
)
# Frames and data of tools, as Siemens' controls have them: `$P_UIFR[1,X,TR]=50`.
_FRAME_OR_TOOL = re.compile(rb"\$(?:P_\w*FR|TC_)", re.IGNORECASE)
# `O1234 (PART)`: the number of a program, or where a subprogram begins.
_PROGRAM_NUMBER = re.compile(rb"[oO]\s*\d+\s*(?:[(;].*)?$")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


class Kind(Enum):
    """What a line is to somebody who follows the machine."""

    STILL = "leaves the machine and its modes alone"
    WORDS = "letters with numbers"
    M_CODE = "belongs to the M code it begins with"
    ANYWHERE = "may move the machine anywhere"
    BRANCH = "decides which line comes next, or what axis words mean"
    TAPE = "begin or end of the tape"
    NUMBER = "the number of a program or subprogram"
    OFFSET = "moves the program's zero along some axes, and not them"
    EXTRUDER = "chooses another extruder, and may move the machine anywhere"
    SAVE = "keeps modes and zeros under a name"
    RESTORE = "takes up again what was kept"


@dataclass(frozen=True, slots=True)
class Statement:
    """A line taken apart.

    Attributes
    ----------
    kind
        What it is.
    codes
        Numbers of its G words, in order.
    m_codes
        Numbers of its M words, in order.
    words
        The other letters (upper case) with their numbers; None where there is no number.
    is_readable
        Whether every byte was read.
    has_placeholder
        Whether a number is a placeholder, `{machine_depth}`, that the slicer did not fill in.
    has_checksum
        Whether it ends with a checksum, which a correction would make wrong.
    is_single
        Whether no letter that matters for a move stands twice.
    calls
        Whether it begins with an L and a number: outside of a cycle the call of a subprogram, `L100 P3`.
    state
        Name of what is kept or taken up again.
    moves_back
        Whether the machine goes where it was when that was kept.
    begins_with_tool
        Whether it begins with a T.
    is_told_still
        Whether the user says that its command neither moves the machine nor changes its modes.
    """

    kind: Kind
    codes: tuple[float, ...] = ()
    m_codes: tuple[float, ...] = ()
    words: dict[bytes, float | None] | None = None
    is_readable: bool = True
    is_single: bool = True
    has_placeholder: bool = False
    has_checksum: bool = False
    calls: bool = False
    state: bytes = b""
    moves_back: bool = False
    begins_with_tool: bool = False
    is_told_still: bool = False


# Klipper's, and how it names what is kept.
_STATE_NAMES = {
    b"ACTIVATE_EXTRUDER": Kind.EXTRUDER,
    b"SAVE_GCODE_STATE": Kind.SAVE,
    b"RESTORE_GCODE_STATE": Kind.RESTORE,
}
# Axes whose zero it moves, and whether it moves them, too.
_OFFSET_AXES = re.compile(rb"(?<=\s)([XYZ])(?:_ADJUST)?=")
_MOVED = re.compile(rb"(?<=\s)MOVE=(\S)", re.IGNORECASE)
_STATE_NAME = re.compile(rb"(?<=\s)NAME=(?:\"([^\"\s]*)\"(?=\s|$)|(\S*))", re.IGNORECASE)

_STILL = Statement(Kind.STILL)
_ANYWHERE = Statement(Kind.ANYWHERE)
_BRANCH = Statement(Kind.BRANCH)
_TAPE = Statement(Kind.TAPE)
_NUMBER = Statement(Kind.NUMBER)


def read_statement(body: bytes, *, is_for_printer: bool = False, still: frozenset[bytes] = frozenset()) -> Statement:
    """Take a line (without its end) apart, as a printer's firmware reads it or as any controller may.

    Parameters
    ----------
    still
        Names of commands, in capitals, of which the user says that they do not move the machine.
    """
    body = body.removeprefix(_BYTE_ORDER_MARK)
    statement = _read(body, is_for_printer=is_for_printer)
    if still and command_name(body) in still:
        return _STILL if statement.kind is Kind.ANYWHERE else replace(statement, is_told_still=True)
    return statement


def _read(body: bytes, *, is_for_printer: bool) -> Statement:
    begin = _BEGIN.match(body)
    is_skipped = begin is not None and (begin.group(1) is not None or begin.group(2) is not None)
    rest = body if begin is None else body[begin.end() :]
    if not is_for_printer and (_INSTRUCTIONS.match(rest) or _FRAME_OR_TOOL.match(rest)):
        return _BRANCH
    if not rest or rest.startswith(b";") or _TEXT.match(rest):
        return _STILL
    if rest.startswith(b"%"):
        return _TAPE
    name = _NAME.match(rest)
    if name is not None:
        return _named(name.group(), rest)
    if rest[:1] in b"oO":
        return _NUMBER if _PROGRAM_NUMBER.match(rest) else _BRANCH
    return _worded(rest, is_skipped, is_for_printer=is_for_printer)


def _named(name: bytes, rest: bytes) -> Statement:
    kind = _STATE_NAMES.get(name.upper())
    if name.upper() == b"SET_GCODE_OFFSET":
        moved = _MOVED.search(rest.upper())
        axes = () if moved is not None and moved.group(1) != b"0" else _OFFSET_AXES.findall(rest.upper())
        return Statement(Kind.OFFSET, words=dict.fromkeys(axes))
    if kind is not None:
        words = re.split(rb"[;#]", rest)[0]
        told, moved = _STATE_NAME.search(words), _MOVED.search(words)
        state = b"default" if told is None else told.group(2) if told.group(1) is None else told.group(1)
        return Statement(kind, state=state, moves_back=moved is not None and moved.group(1) != b"0")
    if _BRANCHING_NAMES.fullmatch(name) or _TRANSFORMING_NAMES.fullmatch(name):
        return _BRANCH
    return _STILL if is_still_name(name) else _ANYWHERE


def _without_assignments(text: bytes) -> bytes:
    """Write words with `=` as others are written: `X150`, `X[0]` for what is computed, numbers for names."""

    def plain(found: re.Match[bytes]) -> bytes:
        letter, number, name = found.groups()
        if name is not None:
            number = b"%d" % (_NAMED_TOOLS + zlib.crc32(name.upper()))
        return b"%b%b" % (letter, b"[0]" if number is None else number)

    return _ASSIGNED.sub(plain, text)


def _without_words(rest: bytes, *, is_for_printer: bool) -> Statement | None:
    """Read an M code that calls something, or behind which text stands; None where words do."""
    first = _WORD.match(rest)
    code = int(float(first.group(2))) if first is not None and first.group(2) else -1
    if code in _BRANCHING_CODES:
        return _BRANCH
    if code in _TEXT_CODES:
        return _STILL
    is_text = is_for_printer and code in _TEXT_OF_PRINTERS
    return Statement(Kind.M_CODE, m_codes=(float(code),), words={}) if is_text else None


def _worded(rest: bytes, is_skipped: bool, *, is_for_printer: bool) -> Statement:
    without_words = _without_words(rest, is_for_printer=is_for_printer) if rest[:1] in b"mM" else None
    if without_words is not None:
        return without_words
    if b"=" in rest and not is_for_printer:
        rest = _without_assignments(rest)
    text, has_checksum = rest, False
    if b";" in rest or b"(" in rest or b"*" in rest:
        commentless = _COMMENT.sub(b" ", rest)
        text = _CHECKSUM.sub(b"", commentless)
        has_checksum = text != commentless
    filled = _PLACEHOLDER.sub(b"", text)
    readable = _WORDS.match(filled)
    # Behind what cannot be read, nothing is believed.
    end = 0 if readable is None else readable.end()
    pairs = _pairs(filled[:end], filled[end:])
    statement = _sorted(pairs, is_readable=end == len(filled))
    if filled != text or has_checksum:
        statement = replace(statement, has_placeholder=filled != text, has_checksum=has_checksum)
    if not pairs:
        return _STILL if statement.is_readable else _ANYWHERE
    is_computed = b"[" in filled or b"#" in filled or filled != text
    if statement.kind is Kind.M_CODE and not is_for_printer and _may_move(statement, is_computed=is_computed):
        return _ANYWHERE
    has_axes = bool({b"X", b"Y", b"Z"} & (statement.words or {}).keys())
    if statement.kind is Kind.WORDS and is_skipped and (statement.codes or has_axes) and not statement.calls:
        # Whether it runs is decided at the machine; a mode that may not hold spoils everything behind it.
        return _ANYWHERE if all(code in (0.0, 1.0) for code in statement.codes) else _BRANCH
    return statement


def _pairs(words: bytes, unreadable: bytes) -> list[tuple[bytes, bytes]]:
    """Give the letters of words with their digits; a tool, edge or length whose value cannot be read is none."""
    pairs = _WORD.findall(words)
    is_cut = _CUT.search(words) is not None and _UNREADABLE_VALUE.match(unreadable) is not None
    return pairs[:-1] if is_cut else pairs


def _may_move(statement: Statement, *, is_computed: bool) -> bool:
    """Tell whether an M code may stand before a move: it has places, and machine tools have codes of its number.

    A place is a number, or may be one where something `is_computed` on the line.
    """
    code, words = statement.m_codes[0], statement.words or {}
    named = [words[letter] for letter in (b"X", b"Y", b"Z") if letter in words]
    has_places = any(number is not None or is_computed for number in named)
    return has_places and code < _FIRST_OF_PRINTERS and code not in _SETTINGS_OF_PRINTERS


def _sorted(pairs: list[tuple[bytes, bytes]], *, is_readable: bool) -> Statement:
    codes: list[float] = []
    m_codes: list[float] = []
    words: dict[bytes, float | None] = {}
    is_single = True
    for letter, digits in pairs:
        upper = letter.upper()
        number = float(digits) if digits else None
        if upper == b"G" and number is not None:
            codes.append(number)
        elif upper == b"M" and number is not None:
            m_codes.append(number)
        else:
            is_single = is_single and not (upper in words and upper in b"XYZEHLP")
            words[upper] = number
    begins_with_m = bool(pairs) and pairs[0][0] in b"mM" and bool(m_codes)
    kind = Kind.WORDS
    if begins_with_m and not codes and m_codes[0] not in _MACHINING_CODES:
        kind = Kind.M_CODE
    calls = bool(pairs) and pairs[0][0] in b"lL" and bool(pairs[0][1])
    begins_with_tool = bool(pairs) and pairs[0][0] in b"tT"
    return Statement(
        kind,
        tuple(codes),
        tuple(m_codes),
        words,
        is_readable,
        is_single,
        calls=calls,
        begins_with_tool=begins_with_tool,
    )
