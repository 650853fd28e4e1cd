//! Usual moves: lines such as `G1 X1.5 Y2.5 E0.5`, of which most programs of slicers consist, and runs of them.
//!
//! What all moves of a run share is told once. Of each there is where its numbers stand and what they are, and no more: a
//! [`Move`] is larger than the line that it comes from.

use super::decimal::Decimal;
use super::eight::number;
use super::extrusion::Share;
use super::frame::Motion;
use super::known::Known;
use super::lexer::Span;
use super::reader::Move;
use super::words::MoveText;

/// A line `G1 X1.5 Y2.5 E0.5` or `G1 X1.5 Y2.5`, one blank before each word, that ends with a line feed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UsualMove {
    /// Numbers of X and Y, in the program's unit.
    pub words: [f64; 2],
    /// That of E.
    pub extruder: Option<Decimal>,
    /// What it extrudes, `10^-18` of the program's unit.
    pub extrusion: i128,
    /// Where its line begins in its block.
    pub start: u32,
    /// Behind the number of X.
    behind_x: u8,
    /// Behind that of Y.
    behind_y: u8,
    /// Length of the line without its end.
    pub length: u8,
}

impl UsualMove {
    /// What ends its line.
    pub const ENDING: &[u8] = b"\n";

    /// The line that `text` begins with; None where it is any other, or does not end well within `text`.
    ///
    /// No word is looked for that does not come next, and nothing has to be told of their order.
    #[inline(always)]
    pub fn read(text: &[u8]) -> Option<Self> {
        if text.first_chunk()? != b"G1 X" {
            return None;
        }
        let (x, behind_x) = number(text, 4)?;
        if text.get(behind_x..behind_x + 2)? != b" Y" {
            return None;
        }
        let (y, behind_y) = number(text, behind_x + 2)?;
        let (mut extruder, mut length) = (None, behind_y);
        if text.get(behind_y..behind_y + 2)? == b" E" {
            let (e, behind_e) = number(text, behind_y + 2)?;
            (extruder, length) = (Some(e), behind_e);
        }
        // Three numbers have at most sixteen bytes each.
        let [behind_x, behind_y, length] = [behind_x, behind_y, length].map(|place| place as u8);
        let words = [x.to_f64(), y.to_f64()];
        (*text.get(usize::from(length))? == b'\n').then_some(Self {
            words,
            extruder,
            extrusion: 0,
            start: 0,
            behind_x,
            behind_y,
            length,
        })
    }

    /// Length of the line with its end.
    #[inline]
    pub fn length_with_end(&self) -> usize {
        usize::from(self.length) + 1
    }

    /// Numbers of X, Y and Z.
    #[inline]
    pub fn axes(&self) -> Known {
        let [x, y] = self.words;
        Known::all([x, y, f64::NAN])
    }

    /// Where the words stand.
    #[inline(always)]
    pub fn text(&self) -> MoveText {
        let [behind_x, behind_y, length] = [self.behind_x, self.behind_y, self.length].map(u32::from);
        MoveText {
            axes: [
                Some(Span { start: 3, end: behind_x }),
                Some(Span { start: behind_x + 1, end: behind_y }),
                None,
            ],
            extruder: self.extruder.map(|_| Span { start: behind_y + 1, end: length }),
            motion: Some(Span { start: 0, end: 2 }),
            behind_axes: behind_y,
            is_in_order: true,
            is_spaced: true,
            ..MoveText::default()
        }
    }
}

/// Usual moves one behind another, each of which begins where another ended: what they share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    /// How many there are.
    pub n_moves: usize,
    /// Offset of the active coordinate system from the machine's zero.
    pub system_mm: Known,
    /// Whether E is an increment.
    pub is_increment: bool,
    /// Whether the program's comments so far are in parentheses.
    pub comments_in_parentheses: bool,
}

impl Run {
    /// The words of one of its moves, and how they are meant: millimetres.
    #[inline(always)]
    pub fn motion_of(&self, usual: &UsualMove) -> Motion {
        let (words_mm, system_mm) = (usual.axes(), self.system_mm);
        Motion { words_mm, is_absolute: true, in_machine_coordinates: false, system_mm }
    }

    /// One of its moves with all that is known of any.
    pub fn move_of(&self, usual: &UsualMove) -> Move {
        let share = match usual.extruder {
            None => Share::None,
            Some(number) if self.is_increment => Share::Increment(number),
            Some(number) => Share::Position(number),
        };
        Move { motion: self.motion_of(usual), share, extrusion: usual.extrusion, text: usual.text() }
    }
}
