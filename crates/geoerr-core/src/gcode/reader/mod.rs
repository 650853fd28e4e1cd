//! A program line by line: which lines are moves that can be corrected, and what the others do.

mod modes;
mod moves;
mod owned;
mod passed;
mod runs;
mod saved;

use super::codes::{Code, Macro, sets_frame_or_tool};
use super::course::{Course, Extremes, Past};
use super::error::GcodeError;
use super::extrusion::{Extrusion, Firmware, Share};
use super::frame::{ALL, Effects, Frame, Kept, KeptFrames, Mask, Motion, Place, Shift, either};
use super::known::Known;
use super::lexer::{Head, Line, Word};
use super::options::{OnUnsupported, Options, unit_mm};
use super::passage::Passage;
use super::path::PathMap;
use super::plain::PlainMove;
use super::report::{Movers, Summary, WarningKind, Warnings, excerpt};
use super::still::command_name;
use super::unsupported::{After, Unsupported};
use super::words::{MoveText, Words};
use crate::volumetric::MotionNeeds;
use saved::Saved;

/// A position on the edge of a range may be above it by rounding.
const EDGE_MM: f64 = 1e-9;

/// What to do with a line.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Write it as it is: it does nothing.
    Pass,
    /// Write it as it is; few lines do something.
    Do(Box<Effects>),
    /// Correct it: it is the last of the reader's [`moves`](Reader::moves), and ends at its last [target](Reader::targets).
    Correct,
}

impl Step {
    fn pass(effects: Effects) -> Self {
        if effects == Effects::default() { Self::Pass } else { Self::Do(Box::new(effects)) }
    }
}

/// Where a straight move ends: what it is solved by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Where the program wants the machine, machine coordinates.
    pub end_mm: [f64; 3],
    /// Whether the move does not begin where a corrected move ended.
    pub is_first: bool,
    /// Words are inches.
    pub is_inch: bool,
}

/// A straight move whose end is known: what it is written by.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Its words.
    pub motion: Motion,
    /// Who gets the extrusion when it is split.
    pub share: Share,
    /// What it extrudes, `10^-18` of the program's unit.
    pub extrusion: i128,
    /// Where its words stand.
    pub text: MoveText,
}

/// What holds from one line to the next.
#[derive(Debug)]
struct Modes {
    is_inch: bool,
    is_relative: bool,
    /// None before any motion code and after `G80`; the reason where the code is not corrected.
    motion: Option<Result<(), Unsupported>>,
    is_inverse_time: bool,
    /// Axes of the plane of arcs; from the first to the second they turn counter-clockwise.
    plane: [usize; 2],
    /// `G90.1`: I, J and K are places.
    has_absolute_centres: bool,
    /// `G0`, not `G1`.
    is_rapid: bool,
    /// `G95`: feeds are millimetres a turn.
    is_feed_a_turn: bool,
    /// Feed, mm/min.
    feed_mm_min: Option<f64>,
    feed_override: FeedOverride,
    /// Code of `G41` or `G42` while it holds.
    compensation: Option<u32>,
    /// Code of what changes the meaning of axis words.
    transformed: Option<u32>,
    /// Number of the tool length (`H`; None = without number) once `G43` has been met.
    tool_length: Option<Option<u64>>,
    /// Number of the tool's edge (Siemens' `D`) once one has been met, and the tool whose edge it is.
    tool_edge: Option<(u64, Option<u64>)>,
    /// Which code has ended the tool length that the zero has in it: no axis word means what it did.
    lost_length: Option<Unsupported>,
    tool: Option<u64>,
    /// Stands for the tool of the last `T` where the controller computes it.
    computed_tool: Option<u64>,
    /// Tools, edges and lengths so far whose numbers the controller computes.
    n_computed: u64,
    /// The tool that the last `M6` put in; None before any: then `T` changes the tool.
    changed_tool: Option<Option<u64>>,
    has_saved_place: bool,
    /// Axes that `G92` has shifted.
    shifted: Mask,
    /// `G54` to `G59`, and one for those that are not followed.
    systems_mm: [Known; 7],
    system: usize,
    /// Axes of which it is told where the zero of `G54` is; of the others it is taken for the machine's.
    zero_is_told: Mask,
    /// Whether the program is plainly a printer's, whose zero is the machine's: it heats a bed or waits for a nozzle, or
    /// has an extruder.
    is_printers: bool,
}

/// `M220` of printers: what all feeds are multiplied by; None where the program does not tell it.
#[derive(Debug)]
struct FeedOverride {
    factor: Option<f64>,
    /// Kept by `B`, for `R`.
    kept: Option<f64>,
}

impl Default for FeedOverride {
    fn default() -> Self {
        Self { factor: Some(1.0), kept: Some(1.0) }
    }
}

/// Reads a program; knows where the machine is meant to be.
#[derive(Debug)]
pub struct Reader {
    options: Options,
    model_is_nominal: bool,
    needs: MotionNeeds,
    /// Where each axis is in the machine's range and in that which was measured, (low, high).
    inside_mm: [(f64, f64); 3],
    line: Line,
    modes: Modes,
    /// Of the line that is being read.
    asked: Asked,
    extrusion: Extrusion,
    saved: Saved,
    frame: Frame,
    kept: KeptFrames,
    past: Past,
    /// Whether the machine stands where a corrected move ended.
    is_corrected: bool,
    n_percent: u32,
    /// Whether the program has told its number (`O1234`).
    is_numbered: bool,
    is_lost: bool,
    /// Whether a comment with `;` was met.
    has_semicolon: bool,
    /// Whether a comment in parentheses was met.
    has_parenthesis: bool,
    /// What the user should know.
    pub warnings: Warnings,
    /// Commands that may move the machine.
    pub movers: Movers,
    /// Counts.
    pub summary: Summary,
    /// Where the moves to correct end, in the order of their lines.
    pub targets: Vec<Target>,
    /// Those of them that are in no [run](super::usual::Run).
    pub moves: Vec<Move>,
    /// How each move approaches its places; empty where the machine's errors do not depend on it.
    pub courses: Vec<Course>,
}

/// What the codes of one line ask for, collected in one pass.
#[derive(Debug, Default)]
struct Asked {
    owner: Option<(Code, u32)>,
    in_machine_coordinates: bool,
    /// A motion code stands on the line.
    has_motion_code: bool,
    /// A code that takes parameters stands on the line.
    takes_parameters: bool,
    /// `G43` or another code of a tool length on the line.
    length_code: Option<u32>,
    forget: Mask,
    problem: Option<Unsupported>,
}

impl Asked {
    /// Notes a problem; the one that leaves least known counts.
    fn refuse(&mut self, what: Unsupported) {
        if self.problem.is_none_or(|before| before.after() < what.after()) {
            self.problem = Some(what);
        }
    }
}

impl Reader {
    /// A reader at the begin of a program.
    pub fn new(options: Options, map: &impl PathMap) -> Self {
        let mut systems_mm = [Known::NONE; 7];
        systems_mm[0] = Known::all(options.work_offset_mm.unwrap_or_default());
        Self {
            extrusion: Extrusion::new(options.firmware),
            modes: Modes {
                is_inch: false,
                is_relative: false,
                motion: None,
                is_inverse_time: false,
                plane: [0, 1],
                has_absolute_centres: false,
                is_rapid: false,
                is_feed_a_turn: false,
                feed_mm_min: None,
                feed_override: FeedOverride::default(),
                compensation: None,
                transformed: None,
                tool_length: None,
                tool_edge: None,
                lost_length: None,
                tool: None,
                computed_tool: None,
                n_computed: 0,
                changed_tool: None,
                has_saved_place: false,
                shifted: [false; 3],
                systems_mm,
                system: 0,
                zero_is_told: [options.work_offset_mm.is_some(); 3],
                is_printers: options.firmware.is_some(),
            },
            inside_mm: std::array::from_fn(|axis| {
                let ((low_mm, high_mm), (from_mm, to_mm)) =
                    (options.range_mm[axis], options.measured_mm[axis]);
                (low_mm.max(from_mm) - EDGE_MM, high_mm.min(to_mm) + EDGE_MM)
            }),
            options,
            model_is_nominal: map.is_nominal(),
            needs: map.needs(),
            line: Line::default(),
            asked: Asked::default(),
            saved: Saved::default(),
            frame: Frame::default(),
            kept: KeptFrames::default(),
            past: Past::new(map.windups()),
            is_corrected: false,
            n_percent: 0,
            is_numbered: false,
            is_lost: false,
            has_semicolon: false,
            has_parenthesis: false,
            warnings: Warnings::default(),
            movers: Movers::default(),
            summary: Summary::default(),
            targets: Vec::new(),
            moves: Vec::new(),
            courses: Vec::new(),
        }
    }

    /// How the program comments: as its own comments are, or as tapes have them.
    pub fn comments_in_parentheses(&self) -> bool {
        !self.has_semicolon && (self.has_parenthesis || self.n_percent > 0 || self.is_numbered)
    }

    /// Whether what lines do is followed: not behind the program's end, nor once everything is lost.
    fn is_followed(&self) -> bool {
        !self.is_lost && self.n_percent < 2
    }

    /// Reads the next line, without its end.
    ///
    /// # Errors
    /// [`GcodeError::Unsupported`] where the options say so, [`GcodeError::OutsideRange`],
    /// [`GcodeError::OutsideMeasured`].
    pub fn read(&mut self, body: &[u8]) -> Result<Step, GcodeError> {
        self.summary.lines += 1;
        if !self.is_followed() {
            self.summary.lines_not_followed += 1;
            return Ok(Step::Pass);
        }
        let mut line = std::mem::take(&mut self.line);
        line.lex(body);
        if self.options.firmware.is_some() {
            line.read_as_on_printers();
        }
        self.has_semicolon |= line.has_semicolon;
        self.has_parenthesis |= line.has_parenthesis;
        let words = Words::of(&line);
        self.asked = Asked::default();
        let step = match self.classify(&line, &words, body) {
            Ok(step) => Ok(step),
            Err(what) => self.unsupported(what, &line, &words, body),
        };
        self.line = line;
        let step = step?;
        self.take_over(&step, body)?;
        Ok(step)
    }

    /// Reads a line that is a plain move and no more; None where the modes make anything else of it: then it has to be
    /// [`read`](Self::read).
    ///
    /// # Errors
    /// As of [`read`](Self::read).
    pub fn read_plain(&mut self, plain: &PlainMove, body: &[u8]) -> Option<Result<Step, GcodeError>> {
        if !self.is_followed() {
            return None;
        }
        // Messages count from 1, and this line is not counted yet.
        self.summary.lines += 1;
        let Some(step) = self.plain_motion(plain, body) else {
            self.summary.lines -= 1;
            return None;
        };
        Some(self.take_over(&step, body).map(|()| step))
    }

    /// The machine after a line.
    #[inline(always)]
    fn take_over(&mut self, step: &Step, body: &[u8]) -> Result<(), GcodeError> {
        match step {
            Step::Pass => return Ok(()),
            Step::Do(effects) => {
                self.frame.apply(effects);
                self.kept.apply(effects.kept, &mut self.frame);
                let goes_back = matches!(effects.kept, Kept::TakeUp { moves: true, .. });
                if goes_back {
                    self.past.forget(ALL);
                }
                self.past.forget(effects.forget);
                if let Place::Home(mask, _) = effects.place {
                    self.past.forget(mask);
                }
                if effects.place != Place::Keep || effects.forget != [false; 3] || goes_back {
                    self.is_corrected = false;
                }
                if !matches!(effects.place, Place::Move(_)) {
                    return Ok(());
                }
            }
            // Where it ends the machine is already: what has just been written of it would be waited for.
            Step::Correct => self.is_corrected = true,
        }
        if self.is_inside() {
            return Ok(());
        }
        if let Some((axis, position_mm, low_mm, high_mm)) = self.outside(&self.options.range_mm) {
            let (line, text) = (self.summary.lines, excerpt(body));
            return Err(GcodeError::OutsideRange { line, text, axis, position_mm, low_mm, high_mm });
        }
        if matches!(step, Step::Correct)
            && let Some((axis, position_mm, low_mm, high_mm)) = self.outside(&self.options.measured_mm)
        {
            let line = self.summary.lines;
            if !self.options.holds_outside_measured {
                let text = excerpt(body);
                return Err(GcodeError::OutsideMeasured { line, text, axis, position_mm, low_mm, high_mm });
            }
            self.warnings.add(WarningKind::OutsideMeasured, line, body);
        }
        Ok(())
    }

    /// Whether nothing that is known of the place is outside the machine or what was measured of it.
    #[inline]
    fn is_inside(&self) -> bool {
        // All are asked, and what is not known is inside.
        let is_in = |axis: usize| {
            let (at_mm, (low_mm, high_mm)) = (self.frame.position_mm.numbers()[axis], self.inside_mm[axis]);
            !((at_mm < low_mm) | (at_mm > high_mm))
        };
        is_in(0) & is_in(1) & is_in(2)
    }

    /// The first axis whose place is known and outside these ranges: its letter, its place, the range.
    fn outside(&self, ranges_mm: &[(f64, f64); 3]) -> Option<(char, f64, f64, f64)> {
        for axis in 0..3 {
            let (low_mm, high_mm) = ranges_mm[axis];
            if let Some(position_mm) = self.frame.position_mm.get(axis)
                && !(low_mm - EDGE_MM..=high_mm + EDGE_MM).contains(&position_mm)
            {
                return Some((AXIS_LETTERS[axis], position_mm, low_mm, high_mm));
            }
        }
        None
    }

    /// What the motion of the axes came to.
    pub fn extremes(&self) -> Extremes {
        self.past.extremes()
    }

    fn warn(&mut self, kind: WarningKind, body: &[u8]) {
        self.warnings.add(kind, self.summary.lines, body);
        if kind == WarningKind::MayMove {
            self.movers.add(&command_name(body));
        }
    }

    /// What a line does whose command may move the machine, unless the user says that it does not.
    fn may_move(&mut self, body: &[u8]) -> Effects {
        if self.is_still(body) {
            return Effects::default();
        }
        self.warn(WarningKind::MayMove, body);
        Effects { forget: ALL, ..Effects::default() }
    }

    /// Whether the user says that the command of a line neither moves the machine nor changes its modes.
    fn is_still(&self, body: &[u8]) -> bool {
        !self.options.still.is_empty() && self.options.still.contains(&command_name(body))
    }

    fn firmware_corrects(&mut self, body: &[u8]) {
        if !self.options.firmware_corrections_named {
            self.warn(WarningKind::FirmwareCorrects, body);
        }
    }

    fn classify(&mut self, line: &Line, words: &Words, body: &[u8]) -> Result<Step, Unsupported> {
        match line.head {
            Head::Percent => self.n_percent += 1,
            Head::Subprogram if self.is_program_number(body) => self.is_numbered = true,
            Head::Subprogram => return Err(Unsupported::FlowControl),
            // Printers' macros have parameters of any name; other controls read words behind a name as their own.
            Head::Macro(_)
                if self.options.firmware.is_none()
                    && let Some(at) = line.code_behind_name
                    && !self.is_still(body) =>
            {
                return Err(Unsupported::CodeBehindName { column: at + 1 });
            }
            Head::Macro(name) => return self.macro_line(Macro::of(name.of(body)), body),
            Head::Instruction(name) if self.options.firmware.is_none() => {
                let behind = body.get(name.end as usize..).unwrap_or_default();
                return self.macro_line(Macro::of_instruction(name.of(body), behind), body);
            }
            Head::Words => return self.words_line(line, words, body),
            Head::Empty if line.has_parameter => return Err(Unsupported::Expression),
            Head::Empty | Head::Instruction(_) => {}
        }
        Ok(Step::Pass)
    }

    /// Whether a line with an `O` is the name of the program and not a subprogram: a number alone, before any move.
    fn is_program_number(&self, body: &[u8]) -> bool {
        let text = body.trim_ascii();
        let rest = text.strip_prefix(b"O").or_else(|| text.strip_prefix(b"o")).unwrap_or_default();
        let behind = rest.trim_ascii_start();
        let n_digits = behind.iter().take_while(|byte| byte.is_ascii_digit()).count();
        let is_alone = matches!(behind[n_digits..].trim_ascii_start().first(), None | Some(b'(' | b';'));
        !self.is_numbered && self.summary.moves_in == 0 && n_digits > 0 && is_alone
    }

    fn macro_line(&mut self, kind: Macro, body: &[u8]) -> Result<Step, Unsupported> {
        let mut effects = Effects::default();
        match kind {
            Macro::Harmless => {}
            Macro::FlowControl => return Err(Unsupported::FlowControl),
            Macro::Transforms => return Err(Unsupported::OtherMeaning),
            Macro::FirmwareCorrection if owned::switches_off(body) => {}
            Macro::FirmwareCorrection => self.firmware_corrects(body),
            Macro::MovesZero => {
                self.warn(WarningKind::ZeroMoves, body);
                self.saved.n_offsets += 1;
                effects.forget = owned::offset_later(body);
            }
            Macro::SavesState => effects.kept = self.save_named(body),
            Macro::RestoresState => effects = self.restore_named(body)?,
            Macro::OtherExtruder => {
                self.extrusion.lose_position();
                effects = self.may_move(body);
            }
            Macro::MeasuresBed => {
                self.firmware_corrects(body);
                effects.forget = ALL;
            }
            Macro::Unknown => effects = self.may_move(body),
        }
        Ok(Step::pass(effects))
    }

    fn words_line(&mut self, line: &Line, words: &Words, body: &[u8]) -> Result<Step, Unsupported> {
        let Some(first) = line.words.first() else {
            if let Some(text) = line.unreadable.map(|at| &body[at as usize..])
                && text.starts_with(b"$")
                && self.options.firmware.is_none()
                && sets_frame_or_tool(text)
            {
                return Err(Unsupported::OtherMeaning);
            }
            // The number of a block of Heidenhain's plain text: words with another meaning follow.
            return match line.unreadable {
                Some(at) if body[at as usize].is_ascii_digit() => Err(Unsupported::PlainText),
                _ => Ok(Step::pass(self.may_move(body))),
            };
        };
        // A subprogram of Siemens' and Fadal's controls; of a canned cycle the number of repeats.
        if first.letter == b'L' && first.number().is_some() && !self.is_in_cycle() {
            return Err(Unsupported::FlowControl);
        }
        // Text behind M0 or M23 has letters, and seldom numbers.
        let is_code =
            |word: &Word| word.letter == b'G' && (!line.is_text_on_printers || word.number().is_some());
        let has_code = line.words.iter().any(is_code);
        let mut codes = line.words.iter().filter(|word| matches!(word.letter, b'G' | b'M'));
        if self.runs_first_alone() && codes.nth(1).is_some() {
            return Err(Unsupported::SeveralCodes);
        }
        if first.letter == b'M' && !has_code && !first.code10().is_some_and(is_machining_code) {
            if first.code10() == Some(2200) {
                self.override_feed(line);
            }
            return self.owned_by_m(first.code10(), line, words, body);
        }
        if line.has_parameter {
            return Err(Unsupported::Expression);
        }
        if line.is_block_skip && (has_code || words.has_axes()) {
            // A skipped G91 would change everything behind it.
            let only_moves = line.words.iter().all(|word| {
                word.letter != b'G' || word.code10().map(Code::of).is_some_and(|code| code == Code::Straight)
            });
            return Err(if only_moves { Unsupported::BlockSkip } else { Unsupported::BlockSkipOfMode });
        }
        self.tools(line, body);
        for word in &line.words {
            match word.letter {
                b'G' => match word.code10() {
                    Some(code10) => self.code(code10, words, body),
                    None => self.asked.refuse(Unsupported::UnknownCode { code10: u32::MAX }),
                },
                b'M' => self.m_word(word.code10(), words),
                _ => {}
            }
        }
        self.other_controls(line, words, body);
        if self.asked.owner.is_none()
            && let Some(word) = words.feed
        {
            match word.number() {
                Some(feed) => self.modes.take_feed(feed.to_f64()),
                // What the controller computes is not known here.
                None => self.modes.feed_mm_min = None,
            }
        }
        let moves = words.has_motion();
        if let Some((code, code10)) = self.asked.owner {
            if moves && self.is_move_besides(code, words) {
                self.asked.refuse(Unsupported::MoveBesides { code10 });
            }
            if let Some(what) = self.asked.problem {
                return Err(what);
            }
            let forget = self.asked.forget;
            let mut effects = self.owned_by_g(code, code10, line, words, body)?;
            effects.forget = either(effects.forget, forget);
            return Ok(Step::pass(effects));
        }
        let is_whole_circle =
            self.asked.has_motion_code && words.has_arc_words && matches!(self.modes.motion, Some(Err(_)));
        if moves || is_whole_circle {
            self.check_motion(line, words);
        } else if let Some(at) = line.unreadable {
            // A move may stand behind what cannot be read.
            self.asked.refuse(Unsupported::Unreadable { column: at + 1 });
        }
        match self.asked.problem {
            Some(what) => Err(what),
            None if moves => Ok(self.motion(line, words, body)),
            None => Ok(Step::pass(Effects { forget: self.asked.forget, ..Effects::default() })),
        }
    }

    /// Whether a motion code holds that ends elsewhere than its words say.
    fn is_in_cycle(&self) -> bool {
        matches!(self.modes.motion, Some(Err(what)) if what.after() > After::AtItsEnd)
    }

    /// Whether axis words stand beside a code that has none of its own: LinuxCNC and RepRapFirmware move by them. Alone X
    /// is the time of Fanuc's dwell.
    fn is_move_besides(&self, code: Code, words: &Words) -> bool {
        let [_, y, z] = words.axes;
        let is_time = !self.asked.has_motion_code
            && !self.asked.in_machine_coordinates
            && [y, z, words.extruder, words.p].iter().all(Option::is_none);
        code == Code::StorePlace || (code == Code::Dwell && !is_time)
    }

    /// Whether the firmware is one that runs the first code of a line, and takes what follows for its parameters.
    fn runs_first_alone(&self) -> bool {
        matches!(self.options.firmware, Some(Firmware::Klipper | Firmware::Marlin))
    }

    /// Refuses an unsupported line, or says what is known after it has passed through.
    fn unsupported(
        &mut self,
        what: Unsupported,
        line: &Line,
        words: &Words,
        body: &[u8],
    ) -> Result<Step, GcodeError> {
        if self.options.on_unsupported == OnUnsupported::Refuse {
            return Err(GcodeError::Unsupported { line: self.summary.lines, text: excerpt(body), what });
        }
        self.warn(WarningKind::Passed(what), body);
        self.summary.untouched_unsupported += 1;
        let mut effects = Effects { forget: self.asked.forget, ..Effects::default() };
        let after = match self.asked.owner {
            // Whether such a line also does what its other code says is not known.
            Some((Code::Settings | Code::Home | Code::SetShift | Code::OtherShift, _)) => {
                what.after().max(After::ZeroLost)
            }
            Some(_) => what.after().max(After::Somewhere),
            None => what.after(),
        };
        match after {
            After::AtItsEnd => {
                let words_mm = words.axes_mm(unit_mm(self.modes.is_inch));
                let is_lost_in_machine = self.asked.in_machine_coordinates && !self.zero_is_told();
                if let (Ok(_), Some(number)) = (words_mm, words.extruder.and_then(|word| word.number())) {
                    self.extrude(number, body);
                }
                match words_mm {
                    Ok(words_mm) if words.has_axes() => {
                        self.summary.moves_in += 1;
                        self.summary.moves_out += 1;
                        if is_lost_in_machine {
                            effects.forget = either(effects.forget, words_mm.mask());
                            effects = self.go(effects, Passage::Unknown);
                        } else {
                            effects.place = Place::Move(self.motion_of(words_mm));
                            effects = self.go(effects, self.passage(line));
                        }
                    }
                    // A whole circle ends where it begins; behind others only the extruder or another axis has moved.
                    Ok(words_mm) if words.has_arc_words => {
                        effects.place = Place::Move(self.motion_of(words_mm));
                        effects = self.go(effects, self.passage(line));
                    }
                    Ok(_) => {}
                    Err(_) => effects.forget = ALL,
                }
            }
            After::Somewhere => effects.forget = ALL,
            After::ZeroLost => {
                effects.shift = Shift::Lose(ALL);
                effects.forget = ALL;
                self.modes.shifted = ALL;
            }
            After::EverythingLost => {
                self.is_lost = true;
                effects.forget = ALL;
            }
        }
        Ok(Step::pass(effects))
    }
}

/// X, Y, Z.
pub const AXIS_LETTERS: [char; 3] = ['X', 'Y', 'Z'];

/// M codes (times ten) of machining programs, which may share their line with a move.
fn is_machining_code(code10: u32) -> bool {
    matches!(code10, 20 | 30 | 40 | 50 | 60 | 70 | 80 | 90)
}
