//! Modes that a program saves and takes up again. Those of `SAVE_GCODE_STATE` are taken up as Klipper does
//! (`cmd_RESTORE_GCODE_STATE` of its `klippy/extras/gcode_move.py`). Others are not followed: a line that takes up others
//! than those that hold is refused, and one that takes up the same does nothing.

use std::collections::HashMap;

use super::Reader;
use crate::gcode::extrusion::{Extrusion, Firmware};
use crate::gcode::frame::{ALL, Effects, Kept, Mask};
use crate::gcode::known::Known;
use crate::gcode::unsupported::Unsupported;

/// What of a program's state a controller may save.
#[derive(Clone, Debug)]
pub(super) struct State {
    is_relative: bool,
    is_inch: bool,
    system: usize,
    shift_mm: Known,
    shifted: Mask,
    extrusion: Extrusion,
    feed_mm_min: Option<f64>,
    feed_factor: Option<f64>,
    n_offsets: u64,
}

/// What was saved, by how it is taken up.
#[derive(Debug, Default)]
pub(super) struct Saved {
    /// `M70`, for `M72` (LinuxCNC).
    modal: Option<State>,
    /// `M120`, for `M121` (RepRapFirmware).
    pushed: Vec<State>,
    /// `M622`, for `M623` (Bambu).
    branched: Vec<State>,
    /// `SAVE_GCODE_STATE`, for `RESTORE_GCODE_STATE` (Klipper), by name, with the numbers of their frames.
    named: HashMap<Vec<u8>, (usize, State)>,
    /// How often the firmware's own offset was set.
    pub(super) n_offsets: u64,
}

impl Reader {
    fn state(&self) -> State {
        State {
            is_relative: self.modes.is_relative,
            is_inch: self.modes.is_inch,
            system: self.modes.system,
            shift_mm: self.frame.shift_mm,
            shifted: self.modes.shifted,
            extrusion: self.extrusion.clone(),
            feed_mm_min: self.modes.feed_mm_min,
            feed_factor: self.modes.feed_override.factor,
            n_offsets: self.saved.n_offsets,
        }
    }

    /// Whether units, positions or increments, and the coordinate system are what they were.
    fn reads_as(&self, kept: &State) -> bool {
        self.modes.is_relative == kept.is_relative
            && self.modes.is_inch == kept.is_inch
            && self.modes.system == kept.system
            && self.extrusion.reads_as(&kept.extrusion)
    }

    /// `M70`, `M72`, `M120`, `M121`, which printers' firmwares other than the named ones read otherwise (a message, a
    /// tone, endstops).
    pub(super) fn saved_by_m(&mut self, code: u32) -> Result<(), Unsupported> {
        let firmware = self.options.firmware;
        let saves_modes = match code {
            70 | 72 => firmware.is_none(),
            _ => firmware.is_none_or(|named| named == Firmware::RepRapFirmware),
        };
        if !saves_modes {
            return Ok(());
        }
        let kept = match code {
            70 => {
                self.saved.modal = Some(self.state());
                return Ok(());
            }
            120 => {
                let state = self.state();
                self.saved.pushed.push(state);
                return Ok(());
            }
            72 => self.saved.modal.take(),
            _ => self.saved.pushed.pop(),
        };
        if kept.is_none_or(|kept| self.reads_as(&kept)) { Ok(()) } else { Err(Unsupported::RestoredState) }
    }

    /// `M622` and `M623`, between which lines run or do not: behind them what was read is read as before, or nothing is
    /// known.
    pub(super) fn branched_by_m(&mut self, code: u32) -> Result<(), Unsupported> {
        if code == 622 {
            let state = self.state();
            self.saved.branched.push(state);
            return Ok(());
        }
        let kept = self.saved.branched.pop().ok_or(Unsupported::FlowControl)?;
        if !self.reads_as(&kept) || self.frame.shift_mm != kept.shift_mm {
            return Err(Unsupported::FlowControl);
        }
        self.extrusion.lose_position();
        Ok(())
    }

    /// Keeps a named state; gives the number of its frame.
    pub(super) fn save_named(&mut self, body: &[u8]) -> Kept {
        let (state, next) = (self.state(), self.saved.named.len());
        let kept = self.saved.named.entry(state_name(body)).or_insert((next, state.clone()));
        kept.1 = state;
        Kept::Keep(kept.0)
    }

    /// Takes up a named state; with `MOVE=1` the machine goes where it was, else nothing moves.
    pub(super) fn restore_named(&mut self, body: &[u8]) -> Result<Effects, Unsupported> {
        let Some((number, state)) = self.saved.named.get(&state_name(body)).cloned() else {
            return Err(Unsupported::UnknownState);
        };
        let modes = &mut self.modes;
        // Klipper has neither.
        if modes.is_inch != state.is_inch || modes.system != state.system {
            return Err(Unsupported::RestoredState);
        }
        modes.is_relative = state.is_relative;
        modes.shifted = state.shifted;
        modes.feed_mm_min = state.feed_mm_min;
        modes.feed_override.factor = state.feed_factor;
        self.extrusion.take_up(&state.extrusion);
        let moves = parameter(body, b"MOVE").is_some_and(|told| told != b"0");
        // The firmware's own offset is taken up, too, and it is not followed: words of axes that rest mean other places.
        let has_other_offset = self.saved.n_offsets != state.n_offsets;
        let forget = if has_other_offset { ALL } else { [false; 3] };
        Ok(Effects { forget, kept: Kept::TakeUp { number, moves }, ..Effects::default() })
    }
}

/// Under which name a line keeps a state or takes it up; capitals are others than small letters.
fn state_name(body: &[u8]) -> Vec<u8> {
    parameter(body, b"NAME").unwrap_or(b"default").to_vec()
}

/// Value of `NAME=value` on a macro's line.
fn parameter<'a>(body: &'a [u8], name: &[u8]) -> Option<&'a [u8]> {
    let told = body.split(|byte| matches!(byte, b';' | b'#')).next()?;
    told.split(u8::is_ascii_whitespace).find_map(|word| {
        let at = word.iter().position(|&byte| byte == b'=')?;
        let value = &word[at + 1..];
        let unquoted = value.strip_prefix(b"\"").and_then(|rest| rest.strip_suffix(b"\""));
        word[..at].eq_ignore_ascii_case(name).then(|| unquoted.unwrap_or(value))
    })
}
