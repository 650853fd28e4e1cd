//! Modes that a program saves and takes up again. They are not followed: a line that takes up others than those that
//! hold is refused, and one that takes up the same does nothing.

use std::collections::HashMap;

use super::Reader;
use crate::gcode::extrusion::{Extrusion, Firmware};
use crate::gcode::frame::Effects;
use crate::gcode::known::Known;
use crate::gcode::unsupported::Unsupported;

/// What of a program's state a controller may save.
#[derive(Clone, Debug)]
pub(super) struct State {
    is_relative: bool,
    is_inch: bool,
    system: usize,
    shift_mm: Known,
    extrusion: Extrusion,
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
    /// `SAVE_GCODE_STATE`, for `RESTORE_GCODE_STATE` (Klipper), by name.
    named: HashMap<Vec<u8>, State>,
}

impl Reader {
    fn state(&self) -> State {
        State {
            is_relative: self.modes.is_relative,
            is_inch: self.modes.is_inch,
            system: self.modes.system,
            shift_mm: self.frame.shift_mm,
            extrusion: self.extrusion.clone(),
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

    pub(super) fn save_named(&mut self, body: &[u8]) {
        let state = self.state();
        self.saved.named.insert(parameter(body, b"NAME"), state);
    }

    /// Takes up a named state; with `MOVE` the machine goes where it was.
    pub(super) fn restore_named(&mut self, body: &[u8]) -> Result<Effects, Unsupported> {
        let Some(kept) = self.saved.named.get(&parameter(body, b"NAME")).cloned() else {
            return Err(Unsupported::RestoredState);
        };
        if !self.reads_as(&kept) || self.frame.shift_mm != kept.shift_mm {
            return Err(Unsupported::RestoredState);
        }
        self.extrusion.take_position_of(&kept.extrusion);
        Ok(self.may_move(body))
    }
}

/// Value of `NAME=value` on a macro's line, in upper case; `DEFAULT` where it is absent.
fn parameter(body: &[u8], name: &[u8]) -> Vec<u8> {
    let upper = body.to_ascii_uppercase();
    upper
        .split(|byte| byte.is_ascii_whitespace())
        .find_map(|word| word.strip_prefix(name)?.strip_prefix(b"="))
        .map_or_else(|| b"DEFAULT".to_vec(), <[u8]>::to_vec)
}
