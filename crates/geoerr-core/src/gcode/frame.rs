//! Where the machine is and what a program's zero means, kept twice: for the program as it was written and for the
//! program as it is rewritten.
//!
//! `G92 X0` passes untouched, yet at that moment the two machines stand at different places (the second at the
//! corrected one); so each has its own shift.

use super::known::Known;
use super::passage::Passage;

/// Which of x, y, z.
pub type Mask = [bool; 3];

/// All three axes.
pub const ALL: Mask = [true; 3];

/// The words of one straight move and how they are meant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Axis words, mm.
    pub words_mm: Known,
    /// `G90`: words are positions; else increments.
    pub is_absolute: bool,
    /// `G53`: words are machine coordinates.
    pub in_machine_coordinates: bool,
    /// Offset of the active coordinate system from the machine's zero.
    pub system_mm: Known,
}

/// What a line does to a program's zero.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Shift {
    /// Nothing.
    #[default]
    Keep,
    /// `G92`: here is what these words say, in the coordinate system with this offset.
    Set {
        /// The words, mm.
        words_mm: Known,
        /// Offset of the active coordinate system.
        system_mm: Known,
    },
    /// The shift of these axes is 0 again.
    Clear(Mask),
    /// The shift of these axes is no longer known.
    Lose(Mask),
}

/// What a line that is not rewritten does to the machine's place.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Place {
    /// Nothing.
    #[default]
    Keep,
    /// These axes are at the home position, machine coordinates.
    Home(Mask, [f64; 3]),
    /// An untouched move ends where its words say.
    Move(Motion),
}

/// A state that is kept, or taken up again, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Kept {
    /// None is.
    #[default]
    No,
    /// Place and shift are kept under this number.
    Keep(usize),
    /// The shift that was kept holds again.
    TakeUp {
        /// Its number.
        number: usize,
        /// The machine goes where it was then.
        moves: bool,
    },
}

/// What a line that is not rewritten does.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Effects {
    /// These axes are somewhere; happens first: what `G92` says of them tells no shift.
    pub forget: Mask,
    /// To the program's zero; happens before `place`.
    pub shift: Shift,
    /// To the machine's place.
    pub place: Place,
    /// How it gets there, or back where it is: by a whole circle.
    pub passage: Passage,
    /// Happens last.
    pub kept: Kept,
}

/// Places and shifts that were kept, by their numbers.
#[derive(Debug, Default)]
pub struct KeptFrames(Vec<Frame>);

impl KeptFrames {
    /// Keeps a frame, or takes one up again.
    pub fn apply(&mut self, kept: Kept, frame: &mut Frame) {
        match kept {
            Kept::No => {}
            Kept::Keep(number) => {
                if number >= self.0.len() {
                    self.0.resize(number + 1, Frame::default());
                }
                self.0[number] = *frame;
            }
            Kept::TakeUp { number, moves } => {
                let before = self.0.get(number).copied().unwrap_or_default();
                frame.shift_mm = before.shift_mm;
                if moves {
                    frame.position_mm = before.position_mm;
                }
            }
        }
    }
}

/// Place of a machine and shift of a program's zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Machine coordinates.
    pub position_mm: Known,
    /// `G92` shift: machine coordinate = word + coordinate system + shift.
    pub shift_mm: Known,
}

impl Default for Frame {
    fn default() -> Self {
        Self { position_mm: Known::NONE, shift_mm: Known::all([0.0; 3]) }
    }
}

impl Frame {
    /// Machine coordinates where `motion` ends.
    #[inline]
    pub fn end_of(&self, motion: &Motion) -> Known {
        let origin_mm = self.origin_of(motion);
        let (origin_mm, words_mm) = (origin_mm.numbers(), motion.words_mm.numbers());
        Known::all(std::array::from_fn(|axis| {
            let (word_mm, position_mm) = (words_mm[axis], self.position_mm.numbers()[axis]);
            if word_mm.is_nan() { position_mm } else { origin_mm[axis] + word_mm }
        }))
    }

    /// Machine coordinates from which the words of a motion count.
    #[inline]
    pub fn origin_of(&self, motion: &Motion) -> Known {
        if motion.in_machine_coordinates {
            return Known::all([0.0; 3]);
        }
        if !motion.is_absolute {
            return self.position_mm;
        }
        let (system_mm, shift_mm) = (motion.system_mm.numbers(), self.shift_mm.numbers());
        Known::all(std::array::from_fn(|axis| system_mm[axis] + shift_mm[axis]))
    }

    /// Takes over what an untouched line does.
    pub fn apply(&mut self, effects: &Effects) {
        self.set_position(effects.forget, &Known::NONE);
        match effects.shift {
            Shift::Keep => {}
            Shift::Set { words_mm, system_mm } => {
                for axis in (0..3).filter(|&axis| words_mm.mask()[axis]) {
                    let [position, system, word] =
                        [&self.position_mm, &system_mm, &words_mm].map(|known| known.numbers()[axis]);
                    self.shift_mm.set(axis, Some(position - system - word));
                }
            }
            Shift::Clear(mask) => self.set_shift(mask, Some(0.0)),
            Shift::Lose(mask) => self.set_shift(mask, None),
        }
        match effects.place {
            Place::Keep => {}
            Place::Home(mask, at_mm) => self.set_position(mask, &Known::all(at_mm)),
            Place::Move(motion) => self.position_mm = self.end_of(&motion),
        }
    }

    fn set_shift(&mut self, mask: Mask, shift_mm: Option<f64>) {
        for axis in (0..3).filter(|&axis| mask[axis]) {
            self.shift_mm.set(axis, shift_mm);
        }
    }

    /// These axes are there.
    pub fn set_position(&mut self, mask: Mask, position_mm: &Known) {
        for axis in (0..3).filter(|&axis| mask[axis]) {
            self.position_mm.set(axis, position_mm.get(axis));
        }
    }
}

/// The axes of either mask.
pub fn either(a: Mask, b: Mask) -> Mask {
    std::array::from_fn(|axis| a[axis] || b[axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SYSTEM_MM: [Option<f64>; 3] = [Some(10.0), Some(0.0), None];

    fn absolute(words_mm: [Option<f64>; 3]) -> Motion {
        Motion {
            words_mm: words_mm.into(),
            is_absolute: true,
            in_machine_coordinates: false,
            system_mm: SYSTEM_MM.into(),
        }
    }

    #[test]
    fn words_plus_system_plus_shift_is_the_machine() {
        let mut frame = Frame::default();
        let end = frame.end_of(&absolute([Some(1.0), None, Some(3.0)]));
        assert_eq!(end, [Some(11.0), None, None].into(), "y was not named, z has no known zero");
        frame.apply(&Effects {
            place: Place::Move(absolute([Some(1.0), Some(2.0), None])),
            ..Effects::default()
        });
        let set = Shift::Set { words_mm: [Some(0.0), None, Some(0.0)].into(), system_mm: SYSTEM_MM.into() };
        frame.apply(&Effects { shift: set, ..Effects::default() });
        assert_eq!(frame.shift_mm, [Some(1.0), Some(0.0), None].into());
        assert_eq!(frame.end_of(&absolute([Some(5.0), None, None])).get(0), Some(16.0));
        let in_machine = Motion { in_machine_coordinates: true, ..absolute([None, None, Some(-10.0)]) };
        assert_eq!(frame.end_of(&in_machine).get(2), Some(-10.0));
    }

    #[test]
    fn increments_add_to_what_is_known() {
        let mut frame = Frame::default();
        frame.apply(&Effects { place: Place::Home([true, false, false], [5.0; 3]), ..Effects::default() });
        let motion = Motion { is_absolute: false, ..absolute([Some(-1.0), Some(1.0), None]) };
        assert_eq!(frame.end_of(&motion), [Some(4.0), None, None].into());
        frame.apply(&Effects { shift: Shift::Lose(ALL), forget: ALL, ..Effects::default() });
        assert_eq!(frame, Frame { position_mm: Known::NONE, shift_mm: Known::NONE });
    }
}
