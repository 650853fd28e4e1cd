//! The extruder: whether `E` is a position or an increment, which firmwares read differently.
//!
//! | firmware | `E` is an increment |
//! |---|---|
//! | Marlin | after `M83` or `G91`, until `M82` or `G90`: the last one wins |
//! | Klipper | while `M83` or `G91` holds |
//! | RepRapFirmware | while `M83` holds; `G90` and `G91` mean the axes only |
//!
//! Nothing is printed that depends on the reading until a move with `E` has to be split.

use super::decimal::Decimal;

/// The firmware that will run the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// Marlin.
    Marlin,
    /// Klipper.
    Klipper,
    /// RepRapFirmware.
    RepRapFirmware,
}

impl Firmware {
    const ALL: [Self; 3] = [Self::Marlin, Self::Klipper, Self::RepRapFirmware];
}

/// How the pieces of a split move share its `E` word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Share {
    /// The move has no `E` word.
    None,
    /// The word is an increment.
    Increment(Decimal),
    /// The word is a position; the move begins where it extrudes nothing.
    Position(Decimal),
    /// The firmwares that may run the program disagree, or the number has more digits than can be shared.
    Unclear,
    /// The word is a position, and where the move begins is not known.
    Lost,
}

/// Extruder position as one firmware reads the program.
#[derive(Clone, Copy, Debug, Default)]
struct Reading {
    /// In `10^-18` of the program's unit.
    position: i128,
}

/// State of the extruder, as each firmware reads it.
#[derive(Clone, Debug, Default)]
pub struct Extrusion {
    firmware: Option<Firmware>,
    readings: [Reading; 3],
    /// `G91` holds.
    axes_relative: bool,
    /// `M83` holds.
    extruder_relative: bool,
    /// What the last of `G90 G91 M82 M83` said.
    last_relative: bool,
    /// `E` is told in inches.
    is_inch: bool,
    /// Another tool was chosen: what its position is called nobody has said.
    is_lost: bool,
    /// Whether `E` is an increment, where all firmwares read the next one alike.
    agreed: Option<bool>,
}

impl Extrusion {
    /// At position 0, absolute; `firmware` where it is known.
    pub fn new(firmware: Option<Firmware>) -> Self {
        Self { firmware, agreed: Some(false), ..Self::default() }
    }

    /// Whether `E` is an increment, where all firmwares read the next one alike.
    pub fn agreed(&self) -> Option<bool> {
        self.agreed
    }

    /// Whether all firmwares read the next word alike, now that something has changed.
    fn agree(&mut self) {
        let relative = Firmware::ALL.map(|firmware| self.is_relative(firmware));
        let [one, other, third] = self.readings.map(|reading| reading.position);
        let is_alike = !relative.contains(&!relative[0]) && one == other && one == third;
        self.agreed = (is_alike && !self.is_lost).then_some(relative[0]);
    }

    /// `G90` or `G91`.
    pub fn set_axes_relative(&mut self, is_relative: bool) {
        self.axes_relative = is_relative;
        self.last_relative = is_relative;
        self.agree();
    }

    /// `G20` or `G21`: where the extruder stands is told in the other unit from now on.
    pub fn set_unit(&mut self, is_inch: bool) {
        if self.is_inch == is_inch {
            return;
        }
        self.is_inch = is_inch;
        for Reading { position } in &mut self.readings {
            *position = if is_inch { position.saturating_mul(10) / 254 } else { in_mm(*position, true) };
        }
    }

    /// `M82` or `M83`.
    pub fn set_extruder_relative(&mut self, is_relative: bool) {
        self.extruder_relative = is_relative;
        self.last_relative = is_relative;
        self.agree();
    }

    /// Whether `E` is read as in another state.
    pub fn reads_as(&self, other: &Self) -> bool {
        let modes = |of: &Self| (of.axes_relative, of.extruder_relative, of.last_relative);
        modes(self) == modes(other)
    }

    /// Another tool: a controller may call its position anything.
    pub fn lose_position(&mut self) {
        self.is_lost = true;
        self.agree();
    }

    /// Modes and position are what they were when a state was kept: what was extruded since counts from there
    /// (Klipper's `cmd_RESTORE_GCODE_STATE`).
    pub fn take_up(&mut self, kept: &Self) {
        self.axes_relative = kept.axes_relative;
        self.extruder_relative = kept.extruder_relative;
        self.last_relative = kept.last_relative;
        self.readings = kept.readings;
        self.is_lost = kept.is_lost;
        self.agree();
    }

    /// `G92 E..`.
    pub fn set_position(&mut self, word: Decimal) {
        self.is_lost = false;
        for reading in &mut self.readings {
            reading.position = word.exact();
        }
        self.agree();
    }

    /// A move with this `E` word: how its pieces would share it, and what it extrudes (`10^-18` of the program's unit)
    /// as the named firmware, or else Marlin, reads it.
    #[inline]
    pub fn advance(&mut self, word: Decimal) -> (Share, i128) {
        let Some(is_increment) = self.agreed.filter(|_| !word.is_cut) else {
            let advanced = self.advance_each(word);
            self.agree();
            return advanced;
        };
        let (exact, before) = (word.exact(), self.readings[0].position);
        let increment = if is_increment { exact } else { exact.saturating_sub(before) };
        self.readings = [Reading { position: before.saturating_add(increment) }; 3];
        (if is_increment { Share::Increment(word) } else { Share::Position(word) }, increment)
    }

    /// [`advance`](Self::advance) where firmwares may disagree.
    fn advance_each(&mut self, word: Decimal) -> (Share, i128) {
        let shown = self.firmware.unwrap_or(Firmware::Marlin);
        // How each of them would share it, and what it extrudes.
        let mut alike = None;
        let mut shown_increment = 0;
        for firmware in Firmware::ALL {
            let is_relative = self.is_relative(firmware);
            let position = &mut self.readings[firmware as usize].position;
            let increment = if is_relative { word.exact() } else { word.exact().saturating_sub(*position) };
            let this = if word.is_cut {
                Share::Unclear
            } else if is_relative {
                Share::Increment(word)
            } else {
                Share::Position(word)
            };
            *position = position.saturating_add(increment);
            if firmware == shown {
                shown_increment = increment;
            }
            if self.firmware.is_none_or(|named| named == firmware) {
                let is_alike = alike.is_none_or(|others| others == (this, increment));
                alike = Some((if is_alike { this } else { Share::Unclear }, increment));
            }
        }
        let share = alike.map(|(share, _)| share);
        // Of a position that nobody has said the word is the first to tell.
        let shown_is_relative = self.is_relative(shown);
        if self.is_lost && !shown_is_relative {
            self.is_lost = false;
            return (if share == Some(Share::Unclear) { Share::Unclear } else { Share::Lost }, 0);
        }
        (share.unwrap_or(Share::Unclear), shown_increment)
    }

    fn is_relative(&self, firmware: Firmware) -> bool {
        match firmware {
            Firmware::Marlin => self.last_relative,
            Firmware::Klipper => self.axes_relative || self.extruder_relative,
            Firmware::RepRapFirmware => self.extruder_relative,
        }
    }
}

/// An extruded length in millimetres, of one in the program's unit; both in `10^-18`.
#[inline]
pub fn in_mm(length: i128, is_inch: bool) -> i128 {
    if is_inch { length.saturating_mul(254) / 10 } else { length }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(text: &str) -> Decimal {
        Decimal::parse(text.as_bytes()).unwrap().0
    }

    #[test]
    fn readings_agree_in_ordinary_programs() {
        let mut e = Extrusion::new(None);
        assert_eq!(e.advance(number("2.5")).0, Share::Position(number("2.5")));
        e.set_position(number("0"));
        e.set_axes_relative(false);
        e.set_extruder_relative(true);
        assert_eq!(e.advance(number(".06669")), (Share::Increment(number(".06669")), 66_690_000_000_000_000));
    }

    #[test]
    fn g90_after_m83_is_unclear_without_a_firmware() {
        for (firmware, expected) in [
            (None, Share::Unclear),
            (Some(Firmware::Marlin), Share::Position(number("1"))),
            (Some(Firmware::Klipper), Share::Increment(number("1"))),
            (Some(Firmware::RepRapFirmware), Share::Increment(number("1"))),
        ] {
            let mut e = Extrusion::new(firmware);
            e.set_extruder_relative(true);
            e.set_axes_relative(false);
            assert_eq!(e.advance(number("1")).0, expected);
        }
    }

    #[test]
    fn g91_moves_the_extruder_by_increments_except_on_reprapfirmware() {
        for (firmware, relative) in
            [(Firmware::Marlin, true), (Firmware::Klipper, true), (Firmware::RepRapFirmware, false)]
        {
            let mut e = Extrusion::new(Some(firmware));
            e.set_extruder_relative(false);
            e.set_axes_relative(true);
            assert_eq!(matches!(e.advance(number("-2")).0, Share::Increment(_)), relative);
        }
    }

    #[test]
    fn after_another_tool_the_first_position_tells_where_the_next_move_begins() {
        for firmware in [None, Some(Firmware::Klipper)] {
            let mut e = Extrusion::new(firmware);
            e.advance(number("5"));
            e.lose_position();
            assert_eq!(e.advance(number("1")), (Share::Lost, 0));
            assert_eq!(e.advance(number("3")), (Share::Position(number("3")), 2 * 10_i128.pow(18)));
            e.lose_position();
            e.set_position(number("0"));
            assert_eq!(e.advance(number("2")).0, Share::Position(number("2")));
        }
        let mut e = Extrusion::new(None);
        e.set_extruder_relative(true);
        e.lose_position();
        assert_eq!(e.advance(number("2")).0, Share::Increment(number("2")));
    }

    #[test]
    fn positions_that_differ_by_reading_are_unclear() {
        let mut e = Extrusion::new(None);
        e.advance(number("5"));
        e.set_axes_relative(true);
        e.advance(number("-2"));
        e.set_axes_relative(false);
        assert_eq!(e.advance(number("6")).0, Share::Unclear, "3 mm so far, or -2");
        e.set_position(number("0"));
        assert_eq!(e.advance(number("6")).0, Share::Position(number("6")));
    }
}
