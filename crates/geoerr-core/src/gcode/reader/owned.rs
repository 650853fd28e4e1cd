//! Lines whose words belong to a code that is no move: zeros, homing, messages.

use super::Reader;
use crate::gcode::codes::Code;
use crate::gcode::decimal::Decimal;
use crate::gcode::extrusion::Firmware;
use crate::gcode::frame::{ALL, Effects, Mask, Place, Shift, either};
use crate::gcode::known::Known;
use crate::gcode::lexer::{Line, Value, Word};
use crate::gcode::options::unit_mm;
use crate::gcode::reader::Step;
use crate::gcode::report::WarningKind;
use crate::gcode::still::{is_pause, is_still_code};
use crate::gcode::unsupported::Unsupported;
use crate::gcode::words::Words;

impl Reader {
    /// A line that belongs to the M code that it begins with.
    pub(super) fn owned_by_m(
        &mut self,
        code10: Option<u32>,
        line: &Line,
        words: &Words,
        body: &[u8],
    ) -> Result<Step, Unsupported> {
        let mut effects = Effects::default();
        let code = code10.map(|code10| code10 / 10);
        let has_places = words.axes.iter().flatten().any(|word| word.value != Value::Missing);
        if let Some(code) = code
            && has_places
            && self.options.firmware.is_none()
            && may_be_of_a_machine_tool(code)
        {
            return Err(Unsupported::AxisWordsOfM { code });
        }
        match code {
            Some(82) => self.extrusion.set_extruder_relative(false),
            Some(83) => self.extrusion.set_extruder_relative(true),
            // A bed is heated, or a nozzle waited for: machine tools have no words of temperatures behind these.
            Some(109 | 140 | 190) if has_temperature(line) => self.modes.is_printers = true,
            // Heidenhain's controls draw the tool back from the contour: `M140 MB50`.
            Some(140) if line.words.iter().any(|word| word.letter == b'B') => effects = self.may_move(body),
            Some(97 | 98 | 99 | 198 | 808) => return Err(Unsupported::FlowControl),
            Some(code @ (70 | 72 | 120 | 121)) => self.saved_by_m(code)?,
            // A branch of a printer: whether its lines run is decided there.
            Some(code @ (622 | 623)) if code10 == Some(10 * code) => {
                self.branched_by_m(code)?;
                effects = self.may_move(body);
            }
            Some(code @ (206 | 290 | 428)) => {
                self.warn(WarningKind::ZeroMoves, body);
                effects.forget = match code {
                    206 => words.axes.map(|word| word.is_some()),
                    428 => ALL,
                    // It moves the axes at once: words mean where they are.
                    _ => effects.forget,
                };
            }
            // Where another nozzle is beside the first.
            Some(218) if words.has_axes() => self.warn(WarningKind::ZeroMoves, body),
            // Of Marlin: off.
            Some(420) if line.words.iter().any(|word| word.letter == b'S' && is_zero(word)) => {}
            Some(420 | 425 | 556 | 852) => self.firmware_corrects(body),
            // Steps a millimetre, and scales: what an axis is too long or too short by.
            Some(92 | 579) if words.has_axes() => self.firmware_corrects(body),
            // Marlin's repeatability test of the probe, other controls' overrides; its parking.
            Some(48 | 125) => effects = self.may_move(body),
            Some(code) if self.may_move_by_m(code) => effects = self.may_move(body),
            _ => {}
        }
        Ok(Step::pass(effects))
    }

    /// Whether no firmware's manual says that an M code leaves the machine where it is. Machine tools have many of their
    /// makers' own, behind which nothing has moved.
    fn may_move_by_m(&self, code: u32) -> bool {
        match self.options.firmware {
            // Stops are macros to it, which park.
            Some(Firmware::Klipper) if code <= 1 => true,
            None if !self.modes.is_printers => is_pause(code),
            _ => !is_still_code(code),
        }
    }

    /// A line whose axis words belong to a G code that is no move.
    pub(super) fn owned_by_g(
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
                if (290..300).contains(&code10) || code10 == 800 {
                    self.firmware_corrects(body);
                } else {
                    self.warn(WarningKind::MayMove, body);
                }
                effects.forget = ALL;
                return Ok(effects);
            }
            Code::Dwell | Code::StorePlace => return Ok(effects),
            Code::OtherShift if self.leaves_zero(code10, line, words) => return Ok(effects),
            Code::OtherShift => return Err(Unsupported::ZeroShift { code10 }),
            _ => {}
        }
        let is_unreadable = line.unreadable.map(|at| Unsupported::Unreadable { column: at + 1 });
        match code {
            Code::Home => {
                is_unreadable.map_or(Ok(()), Err).and_then(|()| self.home(words, &mut effects, body))?
            }
            // A zero whose numbers cannot be read is lost.
            _ if is_unreadable.is_some() => return Err(Unsupported::ZeroShift { code10 }),
            Code::Settings => self.settings(words, &mut effects, body)?,
            _ => self.set_shift(line, words, &mut effects)?,
        }
        Ok(effects)
    }

    /// Whether `G52 X0 Y0 Z0`, `G92.1` or `G92.2` ends a shift where none holds.
    fn leaves_zero(&self, code10: u32, line: &Line, words: &Words) -> bool {
        let ends_it = match code10 {
            // With a motion code NUM's controls move by it, in machine coordinates.
            520 => {
                !self.asked.has_motion_code && words.has_axes() && words.axes.iter().flatten().all(is_zero)
            }
            921 | 922 => !words.has_axes(),
            _ => false,
        };
        ends_it && line.unreadable.is_none() && words.extra_axis.is_none() && self.modes.shifted == [false; 3]
    }

    /// `G10`.
    fn settings(&mut self, words: &Words, effects: &mut Effects, body: &[u8]) -> Result<(), Unsupported> {
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
                    // The system that holds for one controller, for another what is added to all of them: P0 is refused.
                    Some(Some(p @ (10 | 20 | 30 | 40 | 50 | 60))) => p as usize / 10 - 1,
                    // G59.1 to G59.3, whose selection is refused.
                    Some(Some(70 | 80 | 90)) => return Ok(()),
                    _ => return refuse,
                };
                let system_mm = &mut self.modes.systems_mm[system];
                *system_mm = system_mm.updated(&offset_mm);
                if system == 0 {
                    self.tell_zero(offset_mm.mask(), effects, body);
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

    /// Takes over that the program has told where the zero of `G54` is: places that were counted from another one, which
    /// was only thought, are none of the machine's.
    fn tell_zero(&mut self, axes: Mask, effects: &mut Effects, body: &[u8]) {
        let was_told = self.zero_is_told();
        let told = either(self.modes.zero_is_told, axes);
        if !was_told && told != self.modes.zero_is_told {
            effects.forget = ALL;
            self.warn_of_zero(body);
        }
        self.modes.zero_is_told = told;
    }

    /// `G28`.
    fn home(&mut self, words: &Words, effects: &mut Effects, body: &[u8]) -> Result<(), Unsupported> {
        let mask = if words.has_axes() { words.axes.map(|word| word.is_some()) } else { ALL };
        if (0..3).any(|axis| mask[axis] && self.modes.shifted[axis]) {
            if self.options.firmware.is_none() {
                return Err(Unsupported::HomingAfterShift);
            }
            effects.shift = Shift::Clear(mask);
            self.modes.shifted = std::array::from_fn(|axis| self.modes.shifted[axis] && !mask[axis]);
        }
        // A printer that homes one axis moves the others: Klipper's safe_z_home and Marlin's Z_SAFE_HOMING to where Z is
        // probed, both raise Z before X or Y, and RepRapFirmware runs a macro for each axis.
        if mask != ALL && self.modes.is_printers {
            effects.forget = ALL;
            return Ok(());
        }
        // Marlin's `O`: only where it is not at home already.
        match self.options.home_mm.filter(|_| words.odd != Some(b'O')) {
            Some(home_mm) if self.zero_is_told() => effects.place = Place::Home(mask, home_mm),
            home_mm => {
                effects.forget = mask;
                if home_mm.is_some() {
                    // Words that were added behind it would count from another zero than is thought.
                    self.warn(WarningKind::ZeroNotTold, body);
                }
            }
        }
        Ok(())
    }

    /// `G92` alone: by Klipper all that it has is 0 here (`cmd_G92` of its `klippy/extras/gcode_move.py`).
    fn zero_here(&mut self, effects: &mut Effects) -> Result<(), Unsupported> {
        if self.options.firmware != Some(Firmware::Klipper) {
            return Err(Unsupported::BareShift);
        }
        self.extrusion.set_position(Decimal { mantissa: 0, digits: 0, is_cut: false });
        self.modes.shifted = ALL;
        effects.shift = Shift::Set { words_mm: Known::all([0.0; 3]), system_mm: self.system_mm() };
        Ok(())
    }

    /// `G92`.
    fn set_shift(&mut self, line: &Line, words: &Words, effects: &mut Effects) -> Result<(), Unsupported> {
        if line.words.iter().all(|word| matches!(word.letter, b'G' | b'M')) {
            return self.zero_here(effects);
        }
        let unit_mm = unit_mm(self.modes.is_inch);
        let words_mm = words.axes_mm(unit_mm).map_err(|_| Unsupported::ZeroShift { code10: 920 })?;
        if let Some(number) = words.extruder.and_then(|word| word.number()) {
            self.modes.is_printers = true;
            self.extrusion.set_position(number);
        }
        if words.has_axes() {
            self.modes.shifted = either(self.modes.shifted, words_mm.mask());
            effects.shift = Shift::Set { words_mm, system_mm: self.system_mm() };
        }
        Ok(())
    }
}

/// Whether a line ends a correction of Klipper's, or only keeps one under a name, and begins none: `SET_SKEW CLEAR=1`,
/// `BED_MESH_PROFILE SAVE=a`.
pub(super) fn switches_off(body: &[u8]) -> bool {
    let upper = body.to_ascii_uppercase();
    let has = |begin: &[u8]| upper.split(u8::is_ascii_whitespace).any(|word| word.starts_with(begin));
    let is_profile = has(b"BED_MESH_PROFILE") || has(b"SKEW_PROFILE");
    (has(b"SET_SKEW") && has(b"CLEAR=") && !has(b"CLEAR=0")) || (is_profile && !has(b"LOAD="))
}

/// Axes of which `SET_GCODE_OFFSET X=5` moves the zero without moving them: a word that was added behind it would.
pub(super) fn offset_later(body: &[u8]) -> Mask {
    let upper = body.to_ascii_uppercase();
    let has = |begin: &[u8]| upper.split(u8::is_ascii_whitespace).any(|word| word.starts_with(begin));
    let is_moved = has(b"MOVE=") && !has(b"MOVE=0");
    let is_named = |letter: u8| has(&[letter, b'=']) || has(&[&[letter], &b"_ADJUST="[..]].concat());
    [b'X', b'Y', b'Z'].map(|letter| !is_moved && is_named(letter))
}

/// Whether a word has the number 0.
fn is_zero(word: &Word) -> bool {
    word.number().is_some_and(|number| number.to_f64() == 0.0)
}

/// Whether a line has the words of a heater, and no others.
fn has_temperature(line: &Line) -> bool {
    let is_told = |word: &Word| matches!(word.letter, b'S' | b'R') && word.number().is_some();
    let others = line.words.iter().skip(1);
    others.clone().any(is_told)
        && others.clone().all(|word| matches!(word.letter, b'H' | b'P' | b'R' | b'S' | b'T'))
}

/// Whether an M code may stand before a move of a machine tool, whose makers number their own up to 199: those of printers
/// that take axis words have other numbers, but for these.
fn may_be_of_a_machine_tool(code: u32) -> bool {
    code < 200 && !matches!(code, 17 | 18 | 25 | 48 | 84 | 92 | 122 | 125)
}
