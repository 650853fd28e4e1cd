//! Codes that say how the following words and lines are to be read.

use super::{Modes, Reader};
use crate::gcode::codes::Code;
use crate::gcode::extrusion::Firmware;
use crate::gcode::frame::ALL;
use crate::gcode::lexer::{Line, Word};
use crate::gcode::options::unit_mm;
use crate::gcode::report::WarningKind;
use crate::gcode::unsupported::{After, Unsupported};
use crate::gcode::words::Words;

/// Numbers from here on stand for those that a controller computes: no program counts its tools so far, and names have
/// higher ones.
const FIRST_COMPUTED: u64 = 1 << 62;

impl Modes {
    /// The tool that M6 put in, or T named where the program has no M6.
    fn tool_in_use(&self) -> Option<u64> {
        self.changed_tool.unwrap_or(self.named_tool())
    }

    /// The tool of the last T.
    fn named_tool(&self) -> Option<u64> {
        self.computed_tool.or(self.tool)
    }

    /// The tool, edge or length that a word means: one that the controller computes equals no other, not even itself.
    fn number_of(&mut self, word: &Word) -> u64 {
        word.tool().unwrap_or_else(|| {
            self.n_computed += 1;
            FIRST_COMPUTED + self.n_computed
        })
    }

    /// An F word. `F0` leaves a printer's feed as it was; other controllers do not run it.
    pub(super) fn take_feed(&mut self, number: f64) {
        if number > 0.0 {
            self.feed_mm_min = Some(number * unit_mm(self.is_inch));
        }
    }
}

impl Reader {
    /// `M220`, in the order of Marlin: `R` takes what `B` kept, `B` keeps what was, `S` sets percent.
    pub(super) fn override_feed(&mut self, line: &Line) {
        let word = |letter: u8| line.words.iter().find(|word| word.letter == letter);
        let feed = &mut self.modes.feed_override;
        let before = feed.factor;
        if word(b'R').is_some() {
            feed.factor = feed.kept;
        }
        if word(b'B').is_some() {
            feed.kept = before;
        }
        if let Some(percent) = word(b'S') {
            feed.factor = percent.number().map(|percent| 0.01 * percent.to_f64());
        }
    }

    /// Takes over what a G code says for this line and the following ones.
    pub(super) fn code(&mut self, code10: u32, words: &Words, body: &[u8]) {
        let (modes, asked) = (&mut self.modes, &mut self.asked);
        let code = match Code::of(code10) {
            // Fanuc's G50 with axis words sets the zero.
            Code::TransformOff if words.has_axes() && code10 == 500 => Code::Unknown,
            // Haas' controls have a coordinate system of that number, where it does not end G112.
            Code::TransformOff if code10 == 1130 && modes.transformed != Some(1120) => Code::FurtherSystem,
            // Of Prusa's Marlin it measures the bed.
            Code::NoMotion if self.options.firmware == Some(Firmware::Marlin) => Code::MovesItself,
            // The cycles of lathes say which blocks they repeat, those of mills where their holes are.
            Code::OtherMotion(_)
                if matches!(code10, 700 | 710)
                    && words.p.is_none()
                    && words.extra_axis.is_none()
                    && !words.has_arc_words =>
            {
                Code::UnitOrCycle
            }
            code => code,
        };
        match code {
            Code::UnitOrCycle => {
                // That of millimetres, which all of Siemens' programs begin with, says nothing where these hold.
                if (code10 == 700) != modes.is_inch {
                    asked.refuse(Unsupported::UnitOrCycle { code10 });
                }
            }
            // It ends a cycle; the G0 or G1 on its line holds on.
            Code::NoMotion
                if asked.has_motion_code
                    && modes.motion == Some(Ok(()))
                    && !words.has_motion()
                    && !words.has_arc_words => {}
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
                modes.is_rapid = code10 == 0;
                // Cycles and probes are refused on sight: they may move by words of earlier lines.
                if let Code::OtherMotion(what) = code
                    && what.after() > After::AtItsEnd
                {
                    asked.refuse(what);
                }
            }
            Code::Unit { is_inch } => {
                modes.is_inch = is_inch;
                self.extrusion.set_unit(is_inch);
                if is_inch && self.options.firmware == Some(Firmware::Klipper) {
                    asked.refuse(Unsupported::NoInches);
                }
            }
            Code::Distance { is_relative } => {
                modes.is_relative = is_relative;
                self.extrusion.set_axes_relative(is_relative);
            }
            Code::MachineCoordinates => asked.in_machine_coordinates = true,
            Code::System(system) => {
                if modes.systems_mm[system].whole().is_none() {
                    asked.refuse(Unsupported::UnknownSystem { code10 });
                }
                self.select_system(system, body);
            }
            Code::FurtherSystem => self.further_system(code10, body),
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
                asked.length_code = Some(code10);
                modes.lost_length = None;
                // Without H it is that of the tool in use (LinuxCNC).
                let number = match &words.h {
                    Some(word) => Some(modes.number_of(word)),
                    None => modes.tool_in_use(),
                };
                let old = modes.tool_length.replace(number);
                if old.is_some_and(|old| old != number) {
                    asked.refuse(Unsupported::OtherToolLength { code10 });
                } else if old.is_none() {
                    self.first_tool_length(body);
                }
            }
            Code::ToolLengthOff => {
                asked.length_code = Some(code10);
                if modes.tool_length.is_some() {
                    modes.lost_length = Some(Unsupported::OtherToolLength { code10 });
                }
            }
            Code::ToolPoint => {
                asked.length_code = Some(code10);
                asked.refuse(Unsupported::ToolPoint { code10 });
            }
            Code::InverseTime => {
                modes.is_inverse_time = true;
                asked.refuse(Unsupported::InverseTime);
            }
            Code::FeedRate => {
                modes.is_inverse_time = false;
                modes.is_feed_a_turn = code10 == 950;
            }
            Code::TransformOn => {
                modes.transformed = Some(code10);
                asked.refuse(Unsupported::Transformed { code10 });
            }
            Code::TransformOff => modes.transformed = None,
            Code::OtherMeaning => asked.refuse(Unsupported::OtherMeaning),
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
            Code::Plane(axes) => modes.plane = axes,
            Code::ArcCentre { is_absolute } => modes.has_absolute_centres = is_absolute,
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

    /// Notes what words beside a code, or alone, mean to controls that few programs are for.
    pub(super) fn other_controls(&mut self, line: &Line, words: &Words, body: &[u8]) {
        let has =
            |wanted: u32| line.words.iter().any(|word| word.letter == b'G' && word.code10() == Some(wanted));
        let is_unclaimed = self.asked.owner.is_none();
        // Fanuc's and GSK's G54.1 with another number; of G64 P is a tolerance.
        if words.p.is_some() && is_unclaimed && has(540) && !has(640) {
            self.further_system(541, body);
        }
        // Okuma's work zeros.
        if words.h.is_some() && is_unclaimed && has(150) && self.asked.length_code.is_none() {
            self.further_system(150, body);
        }
        if self.options.firmware.is_some() {
            return;
        }
        if self.modes.tool_length.is_some() {
            // Where the program has G43, D is a radius.
            if is_unclaimed && !has(150) && self.asked.length_code.is_none() {
                self.length_by_h(words);
            }
            return;
        }
        self.lose_length_of_another_tool();
        let edge = line.words.iter().rev().find(|word| word.letter == b'D');
        if let Some(edge) = edge
            && is_unclaimed
            && line.words.iter().all(leaves_d_to_the_tool)
        {
            self.asked.takes_parameters |= edge.tool().is_some();
            let number = self.modes.number_of(edge);
            self.tool_edge(number, body);
        } else if edge.is_none() && calls_tool(line) {
            self.tool_edge(1, body);
        }
    }

    /// `H2` alone, which takes another length while `G43` holds, and `H0`, which takes none until the H of `G43` (Fanuc).
    fn length_by_h(&mut self, words: &Words) {
        let Some(word) = &words.h else { return };
        let number = self.modes.number_of(word);
        let what = Unsupported::OtherToolLength { code10: 430 };
        if self.modes.tool_length == Some(Some(number)) {
            // What G49 has ended H alone does not take up again.
            self.modes.lost_length.take_if(|lost| *lost == what);
            return;
        }
        if number == 0 {
            self.modes.lost_length.get_or_insert(what);
        } else {
            self.modes.tool_length = Some(Some(number));
            self.asked.refuse(what);
        }
    }

    /// Another tool than that of the `D` that holds comes with a length of its own, of its first edge where no D is told.
    fn lose_length_of_another_tool(&mut self) {
        if self.modes.tool_edge.is_some_and(|(_, of)| of != self.modes.tool_in_use()) {
            self.modes.lost_length = Some(Unsupported::LengthOfOtherTool);
        }
    }

    /// A coordinate system of which no program says where it is.
    fn further_system(&mut self, code10: u32, body: &[u8]) {
        self.asked.refuse(Unsupported::UnknownSystem { code10 });
        self.select_system(6, body);
    }

    /// Counts from another zero. Places that were counted from one that is told say nothing in one that is only thought,
    /// nor the other way round.
    fn select_system(&mut self, system: usize, body: &[u8]) {
        let was_told = self.zero_is_told();
        self.modes.system = system;
        if self.zero_is_told() != was_told {
            self.asked.forget = ALL;
            self.warn_of_zero(body);
        }
    }

    /// Says that places are forgotten, where there are any.
    pub(super) fn warn_of_zero(&mut self, body: &[u8]) {
        if !self.frame.position_mm.is_none() {
            self.warn(WarningKind::ZeroNotTold, body);
        }
    }

    /// `D2` of Siemens' controls, which takes the length of the tool's second edge.
    fn tool_edge(&mut self, number: u64, body: &[u8]) {
        let tool = self.modes.tool_in_use();
        let modes = &mut self.modes;
        let other = Unsupported::OtherEdge { number: u32::try_from(number).unwrap_or(u32::MAX) };
        match modes.tool_edge {
            None if number == 0 => {}
            None => {
                modes.tool_edge = Some((number, tool));
                self.first_tool_length(body);
            }
            Some(_) if number == 0 => modes.lost_length = Some(other),
            Some(old) if old == (number, tool) => modes.lost_length = None,
            Some((_, of)) => {
                (modes.tool_edge, modes.lost_length) = (Some((number, tool)), None);
                self.asked.refuse(if of == tool { other } else { Unsupported::LengthOfOtherTool });
            }
        }
    }

    fn first_tool_length(&mut self, body: &[u8]) {
        // What Z word the machine's place has from now on is not known.
        self.asked.forget[2] = true;
        self.warn(WarningKind::ToolLength, body);
    }

    /// An M word among others.
    pub(super) fn m_word(&mut self, code10: Option<u32>, words: &Words) {
        match code10 {
            Some(code10 @ (910 | 920)) if words.has_axes() && self.options.firmware.is_none() => {
                self.asked.refuse(Unsupported::MachinePlaceByM { code: code10 / 10 });
            }
            Some(60) => self.asked.forget = ALL,
            Some(820) => self.extrusion.set_extruder_relative(false),
            Some(830) => self.extrusion.set_extruder_relative(true),
            Some(970 | 980 | 990 | 1980) => self.asked.refuse(Unsupported::FlowControl),
            Some(code10 @ (700 | 720 | 1200 | 1210)) => {
                if let Err(what) = self.saved_by_m(code10 / 10) {
                    self.asked.refuse(what);
                }
            }
            _ => {}
        }
    }

    /// Takes over which tool a line names, and whether it is put in: what its other words mean may follow from that.
    pub(super) fn tools(&mut self, line: &Line, body: &[u8]) {
        for word in line.words.iter().filter(|word| word.letter == b'T') {
            let begins_line = line.words.first() == Some(word);
            self.tool(word.tool(), begins_line, body);
            // Printers have no lengths of tools.
            let is_computed = word.tool().is_none() && self.options.firmware.is_none();
            self.modes.computed_tool = is_computed.then(|| self.modes.number_of(word));
        }
        if line.words.iter().any(|word| word.letter == b'M' && word.code10() == Some(60)) {
            self.modes.changed_tool = Some(self.modes.named_tool());
        }
    }

    fn tool(&mut self, number: Option<u64>, begins_line: bool, body: &[u8]) {
        let old = self.modes.tool;
        self.modes.tool = number.or(old);
        if self.moves_by_tool(old, begins_line) && !self.is_still(body) {
            if !self.frame.position_mm.is_none() {
                self.warn(WarningKind::MayMove, body);
            }
            self.asked.forget = ALL;
        }
        // Programs begin with the tool 0, if they name none.
        if old.unwrap_or(0) != self.modes.tool.unwrap_or(0) {
            self.extrusion.lose_position();
        }
        if old.is_some() && old != self.modes.tool {
            self.warn(WarningKind::OtherTool, body);
        }
    }

    /// Whether a T moves a printer. To Klipper every one is a user's macro (docks, hops, offsets), even that of the tool in
    /// use; Marlin and RepRapFirmware park or run macros where another tool is chosen, and of the first nobody says whether
    /// it is another.
    fn moves_by_tool(&self, old: Option<u64>, begins_line: bool) -> bool {
        match self.options.firmware {
            Some(Firmware::Klipper) => begins_line,
            Some(_) => old != self.modes.tool,
            None => begins_line && self.modes.is_printers,
        }
    }
}

/// Whether a D on the line of this word may be a tool's edge: it is none of a code of its own, such as a radius (`G41`), a
/// tolerance (`G64`) or a largest speed (`G96`).
fn leaves_d_to_the_tool(word: &Word) -> bool {
    if word.letter != b'G' {
        return matches!(word.letter, b'D' | b'F' | b'M' | b'S' | b'T' | b'X' | b'Y' | b'Z');
    }
    word.code10().map(Code::of).is_some_and(|code| {
        matches!(
            code,
            Code::Straight
                | Code::NoMotion
                | Code::Unit { .. }
                | Code::UnitOrCycle
                | Code::Distance { .. }
                | Code::MachineCoordinates
                | Code::System(_)
                | Code::FurtherSystem
                | Code::CompensationOff
                | Code::FeedRate
        )
    }) || matches!(word.code10(), Some(170 | 180 | 190))
}

/// Whether a line calls a tool with its length, `T2 G17 S3000` of Heidenhain's controls.
fn calls_tool(line: &Line) -> bool {
    let has_tool = line.words.iter().any(|word| word.letter == b'T');
    let has_speed = line.words.iter().any(|word| word.letter == b'S' && word.number().is_some());
    let is_plane = |word: &Word| word.letter == b'G' && matches!(word.code10(), Some(170 | 180 | 190));
    let is_of_call = |word: &Word| is_plane(word) || matches!(word.letter, b'F' | b'S' | b'T');
    has_tool && has_speed && line.words.iter().any(is_plane) && line.words.iter().all(is_of_call)
}
