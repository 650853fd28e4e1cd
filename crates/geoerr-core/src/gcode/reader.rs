//! A program line by line: which lines are moves that can be corrected, and what the others do.

use super::codes::{Code, Macro};
use super::error::GcodeError;
use super::extrusion::{Extrusion, Share};
use super::frame::{ALL, Effects, Frame, Known, Mask, Motion, Place, Shift, all_known, either};
use super::lexer::{Head, Line, Span};
use super::options::{OnUnsupported, Options, unit_mm};
use super::report::{Summary, WarningKind, Warnings, excerpt};
use super::unsupported::{After, Unsupported};
use super::words::{MoveText, Words};

/// A position on the edge of a range may be above it by rounding.
const EDGE_MM: f64 = 1e-9;

/// What to do with a line.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Write it as it is.
    Pass(Effects),
    /// Correct it.
    Correct(Move),
}

/// A straight move whose end is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Its words.
    pub motion: Motion,
    /// Where the program wants the machine, machine coordinates.
    pub end_mm: [f64; 3],
    /// Whether it does not begin where a corrected move ended.
    pub is_first: bool,
    /// Words are inches.
    pub is_inch: bool,
    /// Who gets the extrusion when it is split.
    pub share: Share,
    /// What it extrudes, `10^-18` mm.
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
    /// Code of `G41` or `G42` while it holds.
    compensation: Option<u32>,
    /// Code of what changes the meaning of axis words.
    transformed: Option<u32>,
    /// Number of the tool length (`H`; None = without number) once `G43` has been met.
    tool_length: Option<Option<u64>>,
    tool: Option<u64>,
    has_saved_place: bool,
    /// Axes that `G92` has shifted.
    shifted: Mask,
    /// `G54` to `G59`, and one for those that are not followed.
    systems_mm: [Known; 7],
    system: usize,
}

/// Reads a program; knows where the machine is meant to be.
#[derive(Debug)]
pub struct Reader {
    options: Options,
    model_is_nominal: bool,
    line: Line,
    modes: Modes,
    /// Of the line that is being read.
    asked: Asked,
    extrusion: Extrusion,
    frame: Frame,
    /// Whether the machine stands where a corrected move ended.
    is_corrected: bool,
    n_percent: u32,
    is_lost: bool,
    /// Whether a comment with `;` was met.
    pub has_semicolon: bool,
    /// Whether a comment in parentheses was met.
    pub has_parenthesis: bool,
    /// What the user should know.
    pub warnings: Warnings,
    /// Counts.
    pub summary: Summary,
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
    pub fn new(options: Options, model_is_nominal: bool) -> Self {
        let mut systems_mm = [[None; 3]; 7];
        systems_mm[0] = options.work_offset_mm.map(Some);
        Self {
            extrusion: Extrusion::new(options.firmware),
            modes: Modes {
                is_inch: false,
                is_relative: false,
                motion: None,
                is_inverse_time: false,
                compensation: None,
                transformed: None,
                tool_length: None,
                tool: None,
                has_saved_place: false,
                shifted: [false; 3],
                systems_mm,
                system: 0,
            },
            options,
            model_is_nominal,
            line: Line::default(),
            asked: Asked::default(),
            frame: Frame::default(),
            is_corrected: false,
            n_percent: 0,
            is_lost: false,
            has_semicolon: false,
            has_parenthesis: false,
            warnings: Warnings::default(),
            summary: Summary::default(),
        }
    }

    /// Reads the next line, without its end.
    ///
    /// # Errors
    /// [`GcodeError::Unsupported`] where the options say so, [`GcodeError::OutsideRange`],
    /// [`GcodeError::OutsideMeasured`].
    pub fn read(&mut self, body: &[u8]) -> Result<Step, GcodeError> {
        self.summary.lines += 1;
        if self.is_lost || self.n_percent >= 2 {
            self.summary.lines_not_followed += 1;
            return Ok(Step::Pass(Effects::default()));
        }
        let mut line = std::mem::take(&mut self.line);
        line.lex(body);
        self.has_semicolon |= line.has_semicolon;
        self.has_parenthesis |= line.has_parenthesis;
        let words = Words::of(&line);
        self.asked = Asked::default();
        let step = match self.classify(&line, &words, body) {
            Ok(step) => Ok(step),
            Err(what) => self.unsupported(what, &words, body),
        };
        self.line = line;
        let step = step?;
        match &step {
            Step::Pass(effects) => {
                self.frame.apply(effects);
                if effects.place != Place::Keep || effects.forget != [false; 3] {
                    self.is_corrected = false;
                }
            }
            Step::Correct(a_move) => {
                self.frame.position_mm = a_move.end_mm.map(Some);
                self.is_corrected = true;
            }
        }
        self.check_range(&step, body)?;
        Ok(step)
    }

    /// The machine's range, for every axis whose place is known.
    fn check_range(&mut self, step: &Step, body: &[u8]) -> Result<(), GcodeError> {
        let moves = match step {
            Step::Pass(effects) => matches!(effects.place, Place::Move(_)),
            Step::Correct(_) => true,
        };
        if !moves {
            return Ok(());
        }
        let line = self.summary.lines;
        for (axis, letter) in AXIS_LETTERS.into_iter().enumerate() {
            let Some(position_mm) = self.frame.position_mm[axis] else { continue };
            let (low_mm, high_mm) = self.options.range_mm[axis];
            if !(low_mm - EDGE_MM..=high_mm + EDGE_MM).contains(&position_mm) {
                let (text, axis) = (excerpt(body), letter);
                return Err(GcodeError::OutsideRange { line, text, axis, position_mm, low_mm, high_mm });
            }
            let (low_mm, high_mm) = self.options.measured_mm[axis];
            if matches!(step, Step::Correct(_))
                && !(low_mm - EDGE_MM..=high_mm + EDGE_MM).contains(&position_mm)
            {
                if !self.options.holds_outside_measured {
                    let (text, axis) = (excerpt(body), letter);
                    return Err(GcodeError::OutsideMeasured {
                        line,
                        text,
                        axis,
                        position_mm,
                        low_mm,
                        high_mm,
                    });
                }
                self.warnings.add(WarningKind::OutsideMeasured, line, body);
                return Ok(());
            }
        }
        Ok(())
    }

    fn warn(&mut self, kind: WarningKind, body: &[u8]) {
        self.warnings.add(kind, self.summary.lines, body);
    }

    fn may_move(&mut self, body: &[u8]) -> Effects {
        self.warn(WarningKind::MayMove, body);
        Effects { forget: ALL, ..Effects::default() }
    }

    fn firmware_corrects(&mut self, body: &[u8]) {
        if !self.options.firmware_corrections_named {
            self.warn(WarningKind::FirmwareCorrects, body);
        }
    }

    fn classify(&mut self, line: &Line, words: &Words, body: &[u8]) -> Result<Step, Unsupported> {
        match line.head {
            Head::Percent => self.n_percent += 1,
            Head::Subprogram => return Err(Unsupported::FlowControl),
            Head::Macro(name) => return self.macro_line(name, body),
            Head::Words => return self.words_line(line, words, body),
            Head::Empty if line.has_parameter => return Err(Unsupported::Expression),
            Head::Empty => {}
        }
        Ok(Step::Pass(Effects::default()))
    }

    fn macro_line(&mut self, name: Span, body: &[u8]) -> Result<Step, Unsupported> {
        let mut effects = Effects::default();
        match Macro::of(name.of(body)) {
            Macro::Harmless => {}
            Macro::FlowControl => return Err(Unsupported::FlowControl),
            Macro::FirmwareCorrection => self.firmware_corrects(body),
            Macro::MovesZero => self.warn(WarningKind::ZeroMoves, body),
            Macro::MeasuresBed => {
                self.firmware_corrects(body);
                effects.forget = ALL;
            }
            Macro::Unknown => effects = self.may_move(body),
        }
        Ok(Step::Pass(effects))
    }

    fn words_line(&mut self, line: &Line, words: &Words, body: &[u8]) -> Result<Step, Unsupported> {
        let has_code = line.words.iter().any(|word| word.letter == b'G');
        let Some(first) = line.words.first() else {
            return Ok(Step::Pass(self.may_move(body)));
        };
        if first.letter == b'M' && !has_code && !first.code10().is_some_and(is_machining_code) {
            return self.owned_by_m(first.code10(), body);
        }
        if line.has_parameter {
            return Err(Unsupported::Expression);
        }
        if line.is_block_skip && (has_code || words.has_axes()) {
            // A skipped G91 would change everything behind it.
            let only_moves = line.words.iter().all(|word| {
                word.letter != b'G' || word.code10().map(Code::of).is_some_and(|code| code == Code::Straight)
            });
            return Err(if only_moves { Unsupported::BlockSkip } else { Unsupported::FlowControl });
        }
        for word in &line.words {
            match word.letter {
                b'G' => match word.code10() {
                    Some(code10) => self.code(code10, words, body),
                    None => self.asked.refuse(Unsupported::UnknownCode { code10: u32::MAX }),
                },
                b'M' => self.m_word(word.code10()),
                b'T' => self.tool(word.number().map(|number| number.to_f64() as u64), body),
                _ => {}
            }
        }
        let moves = words.has_axes() || words.extra_axis.is_some() || words.extruder.is_some();
        if let Some((code, code10)) = self.asked.owner {
            if let Some(what) = self.asked.problem {
                return Err(what);
            }
            let forget = self.asked.forget;
            let mut effects = self.owned_by_g(code, code10, line, words, body)?;
            effects.forget = either(effects.forget, forget);
            return Ok(Step::Pass(effects));
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
            None => Ok(Step::Pass(Effects { forget: self.asked.forget, ..Effects::default() })),
        }
    }

    /// Takes over what a G code says for this line and the following ones.
    fn code(&mut self, code10: u32, words: &Words, body: &[u8]) {
        let (modes, asked) = (&mut self.modes, &mut self.asked);
        let code = match Code::of(code10) {
            // Fanuc's G50 with axis words sets the zero.
            Code::TransformOff if words.has_axes() && code10 == 500 => Code::Unknown,
            code => code,
        };
        match code {
            Code::Straight | Code::OtherMotion(_) | Code::NoMotion => {
                let motion = match code {
                    Code::OtherMotion(what) => Some(Err(what)),
                    Code::NoMotion => None,
                    _ => Some(Ok(())),
                };
                if std::mem::replace(&mut asked.has_motion_code, code != Code::NoMotion)
                    && modes.motion != motion
                {
                    asked.refuse(Unsupported::TwoMotionCodes);
                }
                modes.motion = motion;
                // Cycles and probes are refused on sight: they may move by words of earlier lines.
                if let Code::OtherMotion(what) = code
                    && what.after() > After::AtItsEnd
                {
                    asked.refuse(what);
                }
            }
            Code::Unit { is_inch } => modes.is_inch = is_inch,
            Code::Distance { is_relative } => {
                modes.is_relative = is_relative;
                self.extrusion.set_axes_relative(is_relative);
            }
            Code::MachineCoordinates => asked.in_machine_coordinates = true,
            Code::System(system) => {
                modes.system = system;
                if all_known(&modes.systems_mm[system]).is_none() {
                    asked.refuse(Unsupported::UnknownSystem { code10 });
                }
            }
            Code::FurtherSystem => {
                modes.system = 6;
                asked.refuse(Unsupported::UnknownSystem { code10 });
            }
            Code::CompensationOff => {
                modes.compensation = None;
                asked.takes_parameters = true;
            }
            Code::CompensationOn => {
                modes.compensation = Some(code10);
                asked.takes_parameters = true;
                asked.refuse(Unsupported::CutterCompensation { code10 });
            }
            Code::ToolLength => {
                asked.takes_parameters = true;
                let number = words.h.and_then(|word| word.number()).map(|number| number.to_f64() as u64);
                let old = modes.tool_length.replace(number);
                if old.is_some_and(|old| old != number) {
                    asked.refuse(Unsupported::OtherToolLength { code10 });
                } else if old.is_none() {
                    // What Z word the machine's place has from now on is not known.
                    asked.forget[2] = true;
                    self.warn(WarningKind::ToolLength, body);
                }
            }
            Code::ToolLengthOff => {
                if modes.tool_length.is_some() {
                    asked.refuse(Unsupported::OtherToolLength { code10 });
                }
            }
            Code::ToolPoint => asked.refuse(Unsupported::ToolPoint { code10 }),
            Code::InverseTime => {
                modes.is_inverse_time = true;
                asked.refuse(Unsupported::InverseTime);
            }
            Code::FeedRate => modes.is_inverse_time = false,
            Code::TransformOn => {
                modes.transformed = Some(code10);
                asked.refuse(Unsupported::Transformed { code10 });
            }
            Code::TransformOff => modes.transformed = None,
            Code::SavePlace => modes.has_saved_place = true,
            Code::ExactOrRestore => {
                if modes.has_saved_place {
                    asked.forget = ALL;
                    self.warn(WarningKind::MayMove, body);
                }
            }
            Code::Unknown if words.has_axes() => asked.refuse(Unsupported::UnknownCode { code10 }),
            Code::Unknown => {
                asked.forget = ALL;
                self.warn(WarningKind::MayMove, body);
            }
            Code::Harmless => asked.takes_parameters |= code10 == 640,
            Code::Dwell
            | Code::Settings
            | Code::Home
            | Code::MovesItself
            | Code::StorePlace
            | Code::SetShift
            | Code::OtherShift => {
                if asked.owner.replace((code, code10)).is_some() {
                    asked.refuse(Unsupported::TwoOwners);
                }
            }
        }
    }

    /// An M word among others.
    fn m_word(&mut self, code10: Option<u32>) {
        match code10 {
            Some(60) => self.asked.forget = ALL,
            Some(820) => self.extrusion.set_extruder_relative(false),
            Some(830) => self.extrusion.set_extruder_relative(true),
            Some(980 | 990) => self.asked.refuse(Unsupported::FlowControl),
            _ => {}
        }
    }

    /// A line that belongs to the M code that it begins with.
    fn owned_by_m(&mut self, code10: Option<u32>, body: &[u8]) -> Result<Step, Unsupported> {
        let mut effects = Effects::default();
        match code10.map(|code10| code10 / 10) {
            Some(82) => self.extrusion.set_extruder_relative(false),
            Some(83) => self.extrusion.set_extruder_relative(true),
            Some(98 | 99 | 808) => return Err(Unsupported::FlowControl),
            Some(206 | 290 | 428) => self.warn(WarningKind::ZeroMoves, body),
            Some(420 | 425 | 556 | 852) => self.firmware_corrects(body),
            // Marlin's repeatability test of the probe.
            Some(48) => effects.forget = ALL,
            _ => {}
        }
        Ok(Step::Pass(effects))
    }

    fn tool(&mut self, number: Option<u64>, body: &[u8]) {
        let old = self.modes.tool;
        self.modes.tool = number.or(old);
        if old.is_some() && old != self.modes.tool {
            self.warn(WarningKind::OtherTool, body);
        }
    }

    /// A line whose axis words belong to a G code that is no move.
    fn owned_by_g(
        &mut self,
        code: Code,
        code10: u32,
        line: &Line,
        words: &Words,
        body: &[u8],
    ) -> Result<Effects, Unsupported> {
        let mut effects = Effects::default();
        match code {
            Code::MovesItself => {
                if (290..300).contains(&code10) {
                    self.firmware_corrects(body);
                } else {
                    self.warn(WarningKind::MayMove, body);
                }
                effects.forget = ALL;
                return Ok(effects);
            }
            Code::Dwell | Code::StorePlace => return Ok(effects),
            Code::OtherShift => return Err(Unsupported::ZeroShift { code10 }),
            _ => {}
        }
        let is_unreadable = line.unreadable.map(|at| Unsupported::Unreadable { column: at + 1 });
        match code {
            Code::Home => is_unreadable.map_or(Ok(()), Err).and_then(|()| self.home(words, &mut effects))?,
            // A zero whose numbers cannot be read is lost.
            _ if is_unreadable.is_some() => return Err(Unsupported::ZeroShift { code10 }),
            Code::Settings => self.settings(words, body)?,
            _ => self.set_shift(line, words, &mut effects)?,
        }
        Ok(effects)
    }

    /// `G10`.
    fn settings(&mut self, words: &Words, body: &[u8]) -> Result<(), Unsupported> {
        let refuse = Err(Unsupported::ZeroShift { code10: 100 });
        let kind = words.l.map(|word| word.code10());
        match kind {
            // RepRapFirmware's tool offsets; without axis words a retraction or a temperature.
            None if words.has_axes() => refuse,
            None => Ok(()),
            Some(Some(20)) => {
                if words.has_rotation || self.modes.is_relative {
                    return refuse;
                }
                let Ok(offset_mm) = words.axes_mm(unit_mm(self.modes.is_inch)) else { return refuse };
                let system = match words.p.map(|word| word.code10()) {
                    Some(Some(0)) => self.modes.system,
                    Some(Some(p @ (10 | 20 | 30 | 40 | 50 | 60))) => p as usize / 10 - 1,
                    // G59.1 to G59.3, whose selection is refused.
                    Some(Some(70 | 80 | 90)) => return Ok(()),
                    _ => return refuse,
                };
                let offsets = self.modes.systems_mm[system].iter_mut().zip(offset_mm);
                for (offset, new) in offsets {
                    *offset = new.or(*offset);
                }
                Ok(())
            }
            Some(Some(10 | 100 | 110)) => {
                self.warn(WarningKind::ToolLength, body);
                Ok(())
            }
            Some(_) if words.has_axes() => refuse,
            Some(_) => Ok(()),
        }
    }

    /// `G28`.
    fn home(&mut self, words: &Words, effects: &mut Effects) -> Result<(), Unsupported> {
        let mask = if words.has_axes() { words.axes.map(|word| word.is_some()) } else { ALL };
        if (0..3).any(|axis| mask[axis] && self.modes.shifted[axis]) {
            if self.options.firmware.is_none() {
                return Err(Unsupported::HomingAfterShift);
            }
            effects.shift = Shift::Clear(mask);
            self.modes.shifted = std::array::from_fn(|axis| self.modes.shifted[axis] && !mask[axis]);
        }
        match self.options.home_mm {
            Some(home_mm) => effects.place = Place::Home(mask, home_mm),
            None => effects.forget = mask,
        }
        Ok(())
    }

    /// `G92`.
    fn set_shift(&mut self, line: &Line, words: &Words, effects: &mut Effects) -> Result<(), Unsupported> {
        if line.words.iter().all(|word| matches!(word.letter, b'G' | b'M')) {
            return Err(Unsupported::BareShift);
        }
        let unit_mm = unit_mm(self.modes.is_inch);
        let words_mm = words.axes_mm(unit_mm).map_err(|_| Unsupported::ZeroShift { code10: 920 })?;
        if let Some(number) = words.extruder.and_then(|word| word.number()) {
            self.extrusion.set_position(number);
        }
        if words.has_axes() {
            self.modes.shifted = either(self.modes.shifted, words_mm.map(|word| word.is_some()));
            effects.shift = Shift::Set { words_mm, system_mm: self.system_mm() };
        }
        Ok(())
    }

    fn system_mm(&self) -> Known {
        self.modes.systems_mm[self.modes.system]
    }

    /// Notes every reason for which a line with motion words is no straight move.
    fn check_motion(&mut self, line: &Line, words: &Words) {
        let (modes, asked) = (&self.modes, &mut self.asked);
        match modes.motion {
            Some(Ok(())) => {}
            Some(Err(what)) => asked.refuse(what),
            None => asked.refuse(Unsupported::NoMotionCode),
        }
        if let Some(at) = line.unreadable {
            asked.refuse(Unsupported::Unreadable { column: at + 1 });
        }
        if let Some(letter) = words.extra_axis {
            asked.refuse(Unsupported::ExtraAxis { letter });
        }
        if !words.has_placeholder()
            && let Err(what) = words.axes_mm(1.0)
        {
            asked.refuse(what);
        }
        if !words.has_axes() {
            return;
        }
        if let Some(code10) = modes.transformed {
            asked.refuse(Unsupported::Transformed { code10 });
        }
        if let Some(code10) = modes.compensation {
            asked.refuse(Unsupported::CutterCompensation { code10 });
        }
        if modes.is_inverse_time {
            asked.refuse(Unsupported::InverseTime);
        }
        if asked.in_machine_coordinates && modes.is_relative {
            asked.refuse(Unsupported::MachineIncrement);
        }
        let parameter = words.parameter.filter(|_| !asked.takes_parameters);
        if let Some(letter) = words.odd.or(parameter)
            && modes.motion == Some(Ok(()))
        {
            asked.refuse(Unsupported::OddWord { letter });
        }
        if line.has_checksum && !self.model_is_nominal {
            asked.refuse(Unsupported::Checksum);
        }
    }

    /// A straight move of the axes or the extruder that [`check_motion`](Self::check_motion) has found nothing against.
    fn motion(&mut self, line: &Line, words: &Words, body: &[u8]) -> Step {
        let mut effects = Effects { forget: self.asked.forget, ..Effects::default() };
        let words_mm = match words.axes_mm(unit_mm(self.modes.is_inch)) {
            Ok(words_mm) => words_mm,
            Err(_) => {
                // A placeholder: the firmware may refuse the line, or read what it can of it.
                self.warn(WarningKind::Placeholder, body);
                effects.forget = either(effects.forget, words.axes.map(|word| word.is_some()));
                return Step::Pass(effects);
            }
        };
        let (share, extrusion) = self.extrude(words);
        if !words.has_axes() {
            return Step::Pass(effects);
        }
        let motion = self.motion_of(words_mm);
        self.summary.moves_in += 1;
        let mut before = self.frame;
        before.apply(&effects);
        let Some(end_mm) = all_known(&before.end_of(&motion)) else {
            self.summary.moves_out += 1;
            self.summary.untouched_position_unknown += 1;
            self.warn(WarningKind::PositionUnknown, body);
            effects.place = Place::Move(motion);
            return Step::Pass(effects);
        };
        // Counted again when the move is written.
        self.summary.extrusion_out -= extrusion;
        Step::Correct(Move {
            motion,
            end_mm,
            is_first: !self.is_corrected || effects.forget != [false; 3],
            is_inch: self.modes.is_inch,
            share,
            extrusion,
            text: MoveText::of(line, words, body),
        })
    }

    fn motion_of(&self, words_mm: Known) -> Motion {
        Motion {
            words_mm,
            is_absolute: !self.modes.is_relative,
            in_machine_coordinates: self.asked.in_machine_coordinates,
            system_mm: self.system_mm(),
        }
    }

    /// Moves the extruder by the line's `E`.
    fn extrude(&mut self, words: &Words) -> (Share, i128) {
        let Some(number) = words.extruder.and_then(|word| word.number()) else { return (Share::None, 0) };
        let (share, extrusion) = self.extrusion.advance(number);
        self.summary.extrusion_in += extrusion;
        self.summary.extrusion_out += extrusion;
        (share, extrusion)
    }

    /// Refuses an unsupported line, or says what is known after it has passed through.
    fn unsupported(&mut self, what: Unsupported, words: &Words, body: &[u8]) -> Result<Step, GcodeError> {
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
                if words_mm.is_ok() {
                    self.extrude(words);
                }
                match words_mm {
                    Ok(words_mm) if words.has_axes() => {
                        self.summary.moves_in += 1;
                        self.summary.moves_out += 1;
                        effects.place = Place::Move(self.motion_of(words_mm));
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
        Ok(Step::Pass(effects))
    }
}

/// X, Y, Z.
pub const AXIS_LETTERS: [char; 3] = ['X', 'Y', 'Z'];

/// M codes (times ten) of machining programs, which may share their line with a move.
fn is_machining_code(code10: u32) -> bool {
    matches!(code10, 20 | 30 | 40 | 50 | 60 | 70 | 80 | 90)
}
