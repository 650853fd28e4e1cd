"""Correct a G-code program for the machine that will run it."""

from __future__ import annotations

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Literal, Protocol, get_args

import numpy as np

from geoerr import _core
from geoerr.arguments import check_choice, check_still, check_threads
from geoerr.compensate.benefit import Benefit, benefit_of, uncertain_tables
from geoerr.compensate.motion_notes import motion_notes
from geoerr.errors import GcodeError, GeoerrError, InputFileError
from geoerr.files import MAKE_ROOM_FOR_COPIES, refusing_full, refusing_unreadable, whole_or_absent
from geoerr.machine import AXES
from geoerr.model import Model
from geoerr.model.arrays import Triple, triple_mm
from geoerr.model.called import check_model
from geoerr.model.conditions import Conditions, constants_of
from geoerr.model.finite import not_finite_notes
from geoerr.model.fit_words import NOT_SETTLED, SETTLE
from geoerr.model.in_model import not_in_model_words
from geoerr.model.program_conditions import (
    Extrapolated,
    extrapolated_conditions,
    program_conditions,
    without_waves_in_time,
)
from geoerr.model.worth import UncertainTerm, well_known
from geoerr.summaries import counted

Firmware = Literal["marlin", "klipper", "reprapfirmware"]
OnUnsupported = Literal["refuse", "pass"]
OutsideMeasured = Literal["refuse", "hold"]

# What is read at a time: with the block that is being written, a few times this is all the memory that is used.
CHUNK_BYTES = 1 << 20

# Commands that may move the machine, by name, in the warning of them.
_MOVERS_SHOWN = 20

# The core counts extruded length in units of 1e-18 mm, so that sums are exact.
_EXTRUSION_UNITS_PER_MM = 10**18


@dataclass(frozen=True)
class CompensationOptions:
    """What the user decides.

    Attributes
    ----------
    work_offset_mm
        From the machine's zero to the program's zero (G54). None takes it for the machine's; where the program is no
        printer's either (no firmware is named, and it heats no bed and has no extruder), nothing is relied on that is
        told in machine coordinates: `G53`, and `home_mm` behind `G28`.
    tolerance_mm
        Largest distance of the actual tool position from the programmed one, at the same share of a move.
    digits
        Digits behind the point of a printed axis word in millimetres; words in inches get one more.
    home_mm
        Where G28 leaves the machine, machine coordinates; None: not known.
    firmware
        Who will run the program; only needed where firmwares read a program differently.
    firmware_corrects
        Errors (ISO names or groups, as in `Model.without`) that the firmware corrects itself.
    still
        Names of macros and codes that neither move the machine nor change its modes; capitals do not matter.
    on_unsupported
        Refuse a program with a line that is not corrected, or pass such lines through untouched with a warning.
    outside_measured
        Refuse positions outside the measured range of the errors, or hold the last measured values of functions of
        an axis, beyond which formulas go on.
    keeps_uncertain
        Correct also what is known so poorly that correcting it adds more uncertainty than it takes error away.
    extrapolates
        Take conditions that lie far outside what the model was fitted to: by more than half of that span's width.

    Raises
    ------
    GeoerrError
        naming what is not as it should be.
    """

    work_offset_mm: Triple | None = None
    tolerance_mm: float = 0.005
    digits: int = 4
    home_mm: Triple | None = None
    firmware: Firmware | None = None
    firmware_corrects: tuple[str, ...] = ()
    still: tuple[str, ...] = ()
    on_unsupported: OnUnsupported = "refuse"
    outside_measured: OutsideMeasured = "refuse"
    keeps_uncertain: bool = False
    extrapolates: bool = False

    def __post_init__(self) -> None:
        """Refuse what would be read as something else, or as nothing."""
        for name in ("work_offset_mm", "home_mm"):
            if getattr(self, name) is not None:
                triple_mm(getattr(self, name), name)
        if self.firmware is not None:
            check_choice("firmware", self.firmware, get_args(Firmware))
        check_choice("on_unsupported", self.on_unsupported, get_args(OnUnsupported))
        check_choice("outside_measured", self.outside_measured, get_args(OutsideMeasured))
        check_still(self.still)
        if not isinstance(self.digits, int) or not 1 <= self.digits <= 9:
            raise GeoerrError(f"digits is {self.digits!r}\nhint: write a whole number from 1 to 9")


@dataclass(frozen=True)
class ProgramWarning:
    """Something the user should know about the program; each kind is reported once.

    Attributes
    ----------
    kind
        A short name, for programs.
    line, text
        Where it was first met (1-based), and what stands there.
    count
        On how many lines.
    explanation
        What it means and what to do.
    """

    kind: str
    line: int
    text: str
    count: int
    explanation: str

    def __str__(self) -> str:
        """Give it as one sentence for a terminal."""
        more = f" (and {self.count - 1} more)" if self.count > 1 else ""
        return f"line {self.line}{more}: {self.text}: {self.explanation}"


@dataclass(frozen=True)
class MayMove:
    """A command that may move the machine: its name, in capitals, and on how many lines it was met."""

    name: str
    count: int

    def __str__(self) -> str:
        """Give it as a part of a sentence."""
        return self.name if self.count == 1 else f"{self.name} ({self.count} times)"


@dataclass(frozen=True)
class CompensationResult:
    """What happened to a program.

    Attributes
    ----------
    lines
        Lines read.
    moves_in, moves_out
        Moves (G0 or G1 with X, Y or Z) read and written.
    moves_corrected
        Moves whose end was corrected, whether or not a digit changed.
    untouched_position_unknown, untouched_unsupported, lines_not_followed
        Moves passed through before the position was known; lines passed through because they are not corrected;
        lines behind a branch or the end of the tape.
    largest_correction_um, largest_correction_line
        Largest distance of a command from the programmed position, and its line (0 where nothing was corrected).
    extrusion_in_mm, extrusion_out_mm
        Net extruded length.
    correction_rms_um, correction_std_um
        Typical correction over the box of the program's moves, and its own standard uncertainty; None where the model
        has no record of a fit, the uncertainty also where the data determine no part of the correction.
    left_out
        Terms of the measuring rig, by id: they explain measurements, and the machine does not have them.
    waves_left_out
        Terms that hum or breathe in time, by id: no program knows how they will stand when it runs.
    uncertain_left_out
        Terms that are not corrected, for on average over the measured volume that would do more harm than good.
    not_in_model
        Errors of the 21 that a fitted model does not have: nothing of them is corrected, nor in `correction_std_um`.
    extrapolated
        Conditions outside what the model was fitted to.
    may_move
        Commands behind which nothing is known of the place, in the order in which they were first met; the first
        hundred.
    warnings
        One for each kind.
    notes
        Sentences about the model and the conditions.
    """

    lines: int
    moves_in: int
    moves_out: int
    moves_corrected: int
    untouched_position_unknown: int
    untouched_unsupported: int
    lines_not_followed: int
    largest_correction_um: float
    largest_correction_line: int
    extrusion_in_mm: float
    extrusion_out_mm: float
    correction_rms_um: float | None
    correction_std_um: float | None
    left_out: tuple[str, ...]
    waves_left_out: tuple[str, ...]
    uncertain_left_out: tuple[UncertainTerm, ...]
    not_in_model: tuple[str, ...]
    extrapolated: tuple[Extrapolated, ...]
    may_move: tuple[MayMove, ...]
    warnings: tuple[ProgramWarning, ...]
    notes: tuple[str, ...]

    @property
    def mostly_untouched(self) -> str | None:
        """What is to be said first of a program of which more than half is as it was; None of others."""
        n_untouched = self.moves_in - self.moves_corrected
        if 2 * n_untouched > self.moves_in:
            verb = "is" if n_untouched == 1 else "are"
            return f"{n_untouched} of {counted(self.moves_in, 'move')} {verb} NOT corrected"
        if 2 * self.lines_not_followed > self.lines:
            return (
                f"{self.lines_not_followed} of {counted(self.lines, 'line')} cannot be followed and are NOT corrected"
            )
        return None

    @property
    def untouched(self) -> str:
        """What passed through as it was, in words; empty where all was corrected that moves."""
        counts = {
            "moves before the position is known": self.untouched_position_unknown,
            "lines that are not corrected": self.untouched_unsupported,
            "lines behind the part that can be followed": self.lines_not_followed,
        }
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count)

    @property
    def why_nothing_corrected(self) -> str | None:
        """Why no move was corrected, as far as that is known; None where one was.

        A program that came out as it went in would be taken for a corrected one.
        """
        if self.moves_corrected:
            return None
        if not self.lines:
            return "the program is empty: nothing was corrected"
        if self.moves_in and self.untouched_position_unknown == self.moves_in:
            passed = f"{counted(self.moves_in, 'move')} passed through untouched"
            return f"the position is nowhere known: nothing was corrected, {passed}"
        if self.untouched:
            return f"nothing was corrected; untouched: {self.untouched}"
        return f"no move was read in {counted(self.lines, 'line')}: nothing was corrected; is it G-code?"

    def to_document(self) -> dict[str, Any]:
        """Give it as plain values, for `--json`."""
        document = {name: list(value) if isinstance(value, tuple) else value for name, value in vars(self).items()}
        document["may_move"] = [vars(command) for command in self.may_move]
        document["warnings"] = [vars(warning) for warning in self.warnings]
        document["uncertain_left_out"] = [vars(term) for term in self.uncertain_left_out]
        document["extrapolated"] = [
            {"name": one.name, "value": one.value, "low": one.low, "high": one.high, "beyond": one.beyond}
            for one in self.extrapolated
        ]
        return document


def compensate_program(
    model: Model,
    source: str | Path,
    target: str | Path,
    options: CompensationOptions | None = None,
    *,
    at: Conditions | None = None,
    model_name: str = "unnamed",
    threads: int = 0,
    on_progress: Callable[[int], None] | None = None,
) -> CompensationResult:
    """Correct the program `source` into `target`, in constant memory; `-` is standard input or output.

    The output appears when it is whole, or not at all. Lines that are no straight moves come out byte for byte, and a
    model without errors gives the file back byte for byte. A program that geoerr has corrected is refused.

    Parameters
    ----------
    model
        The machine and its errors.
    source, target
        Files; they must not be the same.
    options
        None for the defaults.
    at
        Conditions that the model's terms follow, by name; a temperature may be `"reference"`. Direction of approach,
        travel, speed and feed come from the program's moves.
    model_name
        Names the model in the mark that says the program is corrected: the first twelve digits of its file's SHA-256.
    threads
        0 = all cores. Never changes a byte.
    on_progress
        Called with the number of bytes read so far.

    Raises
    ------
    GcodeError
        for a line that cannot be corrected safely, with its number, text and remedy.
    GeoerrError
        for conditions that are needed and not given, by name, or given and not needed, or too far from what the model
        was fitted to; for a model of nothing but the measuring rig.
    InputFileError
        for a file that cannot be read, or an output that would replace the input.

    Notes
    -----
    Li et al. 2023, Eqs. 24 to 27, one solve a move end; a move is split where its path would leave the tolerance.

    Direction, travel and speed are those of the move, held while a command is solved. Where a reversal makes the
    command jump by more than half of the tolerance, the move that follows begins with a piece that takes up the jump
    and extrudes nothing. An axis that rests or creeps in the program keeps its last direction until its correction
    moves it back by more than a part of the tolerance: its play is taken up there in the same way.
    """
    check_model(model, (source, target), "compensate_program(model, source, target)")
    _refuse_same_file(source, target)
    job = _job(model, options or CompensationOptions(), model_name, at, threads)
    with contextlib.ExitStack() as stack:
        chunks = _chunks(_opened(source, stack), on_progress)
        if str(target) == "-":
            # A refused program must not leave half an output in a pipe.
            whole = stack.enter_context(tempfile.TemporaryFile())
            with refusing_full(tempfile.gettempdir(), MAKE_ROOM_FOR_COPIES):
                _rewrite(job, source, chunks, whole, threads)
            whole.seek(0)
            shutil.copyfileobj(whole, sys.stdout.buffer)
            sys.stdout.buffer.flush()
        else:
            _refuse_folder(target)
            temporary = stack.enter_context(whole_or_absent(target))
            with temporary.open("wb") as stream:
                _rewrite(job, source, chunks, stream, threads)
    return _result(job, threads)


class Writable(Protocol):
    """What takes a corrected program, block after block."""

    def write(self, block: bytes, /) -> int:
        """Take a block; give its length."""


def compensate_into(
    model: Model,
    source: str | Path,
    stream: Writable,
    options: CompensationOptions | None = None,
    *,
    at: Conditions | None = None,
    model_name: str = "unnamed",
    threads: int = 0,
) -> CompensationResult:
    """Correct the program `source` into what is open already; everything else as `compensate_program`."""
    job = _job(model, options or CompensationOptions(), model_name, at, threads)
    with contextlib.ExitStack() as stack:
        _rewrite(job, source, _chunks(_opened(source, stack), None), stream, threads)
    return _result(job, threads)


def compensate_bytes(
    model: Model,
    program: bytes,
    options: CompensationOptions | None = None,
    *,
    at: Conditions | None = None,
    model_name: str = "unnamed",
    threads: int = 0,
) -> tuple[bytes, CompensationResult]:
    """Correct a program in memory; everything else as `compensate_program`."""
    job = _job(model, options or CompensationOptions(), model_name, at, threads)
    written: list[bytes] = []
    starts = range(0, len(program), CHUNK_BYTES)
    chunks = (program[start : start + CHUNK_BYTES] for start in starts)
    for block in _blocks(job, "program", chunks, threads):
        written.append(block)
    return b"".join(written), _result(job, threads)


@dataclass(frozen=True, eq=False)
class _Job:
    """A program's rewriter, and what it corrects."""

    rewriter: _core.GcodeRewriter
    corrected: Model
    waves: tuple[str, ...]
    at: dict[str, float]
    uncertain: tuple[UncertainTerm, ...]
    extrapolated: tuple[Extrapolated, ...]
    not_in_model: tuple[str, ...]
    # Terms of which some wind-up is not followed from stroke to stroke.
    long_stroke_terms: tuple[str, ...]


def _job(model: Model, options: CompensationOptions, model_name: str, at: Conditions | None, threads: int) -> _Job:
    check_threads(threads)
    corrected = model.without(options.firmware_corrects)
    if model.rig_terms and model.errors is None and not model.machine_terms:
        ids = ", ".join(term.id for term in model.rig_terms)
        raise GeoerrError(
            f"the model has nothing to compensate: {ids} explain measurements, and the machine does not have them\n"
            "hint: they belong to the cameras; a program needs a model with errors of the machine"
        )
    if model.record is not None and not model.record.has_settled:
        raise GeoerrError(f"{NOT_SETTLED}, and no program is corrected with them\nhint: {SETTLE}")
    waves = tuple(term.id for term in corrected.terms if term.is_wave_in_time)
    corrected = without_waves_in_time(corrected)
    given = program_conditions(corrected, at, extrapolates=options.extrapolates)
    extrapolated = extrapolated_conditions(corrected, at)
    measured = corrected.measured_range_mm
    uncertain: tuple[UncertainTerm, ...] = ()
    if not options.keeps_uncertain:
        corrected, uncertain, rest = well_known(corrected, given, threads=threads)
        given = constants_of(corrected.machine, rest)
    machine = corrected.compiled_at(given)
    rewriter = _core.GcodeRewriter(
        machine,
        work_offset_mm=options.work_offset_mm,
        tolerance_mm=options.tolerance_mm,
        digits=options.digits,
        home_mm=options.home_mm,
        firmware=options.firmware,
        # Where nothing is corrected nothing can be corrected wrongly: the file comes back, with warnings.
        passes_unsupported=options.on_unsupported == "pass" or corrected.is_nominal,
        holds_outside_measured=options.outside_measured == "hold",
        firmware_corrections_named=bool(options.firmware_corrects),
        still=list(options.still),
        range_mm=[model.machine.axes[axis].range_mm for axis in AXES],
        measured_mm=[measured[axis] or (-np.inf, np.inf) for axis in AXES],
        model_name=model_name,
    )
    long_strokes = machine.long_stroke_terms if isinstance(machine, _core.TermMachine) else []
    return _Job(
        rewriter,
        corrected,
        waves,
        given,
        uncertain,
        extrapolated,
        () if model.record is None else model.not_in_model,
        tuple(corrected.all_machine_terms[number].id for number in long_strokes),
    )


def _rewrite(
    job: _Job,
    source: str | Path,
    chunks: Iterable[bytes],
    stream: Writable,
    threads: int,
) -> None:
    """Write the corrected blocks, each while the next one is worked out."""
    with ThreadPoolExecutor(1) as writer:
        writing: Future[int] | None = None
        for block in _blocks(job, source, chunks, threads):
            if writing is not None:
                writing.result()
            writing = writer.submit(stream.write, block)
        if writing is not None:
            writing.result()


def _blocks(job: _Job, source: str | Path, chunks: Iterable[bytes], threads: int) -> Iterator[bytes]:
    """Give the corrected blocks; control comes back to Python after each, so that Ctrl-C works."""
    try:
        for chunk in chunks:
            job.rewriter.push(chunk, False)
            yield from _pulled(job.rewriter, threads)
        job.rewriter.push(b"", True)
        yield from _pulled(job.rewriter, threads)
    except GcodeError as error:
        raise GcodeError(source, error.line, error.problem, remedy=_remedy(job, error.remedy)) from None


def _remedy(job: _Job, remedy: str | None) -> str | None:
    """Name the formulas that have places without a number: what they do there is no matter of tables or tolerance."""
    told = not_finite_notes(job.corrected, job.at)
    if not told:
        return remedy
    return f"{'; '.join(told)}; correct the formula, or take the effect out with `geoerr remove`"


def _pulled(rewriter: _core.GcodeRewriter, threads: int) -> Iterator[bytes]:
    while (block := rewriter.pull(threads)) is not None:
        yield block


def _chunks(stream: IO[bytes], on_progress: Callable[[int], None] | None) -> Iterator[bytes]:
    n_read = 0
    while chunk := stream.read(CHUNK_BYTES):
        n_read += len(chunk)
        yield chunk
        if on_progress is not None:
            on_progress(n_read)


def _opened(source: str | Path, stack: contextlib.ExitStack) -> IO[bytes]:
    if str(source) == "-":
        return sys.stdin.buffer
    with refusing_unreadable(source):
        return stack.enter_context(Path(source).open("rb"))


def _refuse_same_file(source: str | Path, target: str | Path) -> None:
    if "-" in (str(source), str(target)):
        return
    both_there = Path(source).exists() and Path(target).exists()
    if Path(source) == Path(target) or (both_there and Path(source).samefile(target)):
        raise InputFileError(
            target, "is the program that is read", remedy="name another output; an input is never replaced"
        )


def _refuse_folder(target: str | Path) -> None:
    if Path(target).is_dir():
        raise InputFileError(target, "is a folder", remedy="name a file in it")


def _result(job: _Job, threads: int) -> CompensationResult:
    summary = job.rewriter.summary()
    benefit = benefit_of(job.corrected, summary["box_mm"], job.at, threads)
    left_out = tuple(term.id for term in job.corrected.rig_terms)
    return CompensationResult(
        lines=summary["lines"],
        moves_in=summary["moves_in"],
        moves_out=summary["moves_out"],
        moves_corrected=summary["moves_corrected"],
        untouched_position_unknown=summary["untouched_position_unknown"],
        untouched_unsupported=summary["untouched_unsupported"],
        lines_not_followed=summary["lines_not_followed"],
        largest_correction_um=summary["largest_correction_mm"] * 1e3,
        largest_correction_line=summary["largest_correction_line"],
        extrusion_in_mm=summary["extrusion_in"] / _EXTRUSION_UNITS_PER_MM,
        extrusion_out_mm=summary["extrusion_out"] / _EXTRUSION_UNITS_PER_MM,
        correction_rms_um=None if benefit is None else benefit.rms_um,
        correction_std_um=None if benefit is None else benefit.std_um,
        left_out=left_out,
        waves_left_out=job.waves,
        uncertain_left_out=job.uncertain,
        not_in_model=job.not_in_model,
        extrapolated=job.extrapolated,
        may_move=tuple(MayMove(*row) for row in job.rewriter.movers()[0]),
        warnings=_warnings(job),
        notes=_notes(job, benefit, left_out),
    )


def _warnings(job: _Job) -> tuple[ProgramWarning, ...]:
    """Give the warnings; that of commands which may move the machine names them."""
    names, n_others = job.rewriter.movers()
    shown = ", ".join(str(MayMove(*row)) for row in names[:_MOVERS_SHOWN])
    n_more = len(names) - _MOVERS_SHOWN
    more = f" and {n_more}{' or more' if n_others else ''} more" if n_more > 0 else ""
    warnings = (ProgramWarning(*row) for row in job.rewriter.warnings())
    return tuple(
        replace(warning, explanation=f"{warning.explanation}; here {shown}{more}")
        if warning.kind == "may-move"
        else warning
        for warning in warnings
    )


def _notes(job: _Job, benefit: Benefit | None, left_out: tuple[str, ...]) -> tuple[str, ...]:
    notes = []
    if left_out:
        notes.append(f"not compensated, for the cameras have it and not the machine: {', '.join(left_out)}")
    if job.waves:
        notes.append(
            "not compensated, for no program knows how it will stand when it runs (find what goes up and down, and "
            f"stop it): {', '.join(job.waves)}"
        )
    if job.uncertain:
        notes.append(
            "left as it is, for it is known so poorly that correcting it would on average do more harm than good: "
            f"{', '.join(map(str, job.uncertain))}; --keep-uncertain corrects it"
        )
    tables = uncertain_tables(job.corrected.errors)
    if tables:
        notes.append(
            f"smaller than can be told from 0, and corrected all the same: {', '.join(tables)}; tables do not say "
            "what their uncertainties have in common, as a model.json does, of which such errors are left as they are"
        )
    unknown = () if job.corrected.errors is None else job.corrected.errors.not_determined
    if unknown:
        notes.append(
            f"not determined by what was measured, and taken as 0: {', '.join(item.name for item in unknown)}: "
            "nothing of them is corrected"
        )
    notes.extend(not_finite_notes(job.corrected, job.at))
    lacking = (f"{not_in_model_words(job.not_in_model)}: nothing of them is corrected",) if job.not_in_model else ()
    moved = motion_notes(job.corrected, job.at, job.long_stroke_terms, *job.rewriter.extremes())
    return (*notes, *map(str, job.extrapolated), *moved, *(() if benefit is None else benefit.notes), *lacking)
