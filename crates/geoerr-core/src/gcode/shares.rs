//! The extrusion of a move shared by its pieces.

use super::decimal::POWERS_F64;
use super::extrusion::Share;
use super::path::Node;
use super::reader::Move;
use super::wording::PieceWord;

/// Fewest digits of a shared `E`.
const EXTRUDER_DIGITS: u8 = 5;

/// `E` of the pieces of a move. Kept and filled again, so that its memory is.
#[derive(Debug, Default)]
pub struct Shares {
    /// Digits behind the point of the words.
    pub digits: u8,
    /// Words of the pieces, in units of the last digit; empty where the word stays as it is.
    words: Vec<i64>,
    /// Whether the last piece has the word as it was written.
    last_is_kept: bool,
    /// What the words extrude, `10^-18` of the program's unit.
    pub extrusion: i128,
}

impl Shares {
    /// By length, rounded to the word's digits (at least five); the sum, or the last position, is exact.
    #[inline]
    pub fn set(&mut self, a_move: &Move, nodes: &[Node]) {
        self.words.clear();
        self.extrusion = a_move.extrusion;
        if nodes.len() > 1 {
            self.divide(a_move, nodes);
        }
    }

    fn divide(&mut self, a_move: &Move, nodes: &[Node]) {
        let (number, is_position) = match a_move.share {
            Share::Increment(number) => (number, false),
            Share::Position(number) => (number, true),
            _ => return,
        };
        let digits = number.digits.max(EXTRUDER_DIGITS);
        let Some(whole) = number.scaled(digits) else { return };
        let per_unit = POWERS_F64[usize::from(digits)];
        let from = (number.exact() - a_move.extrusion) as f64 * 1e-18;
        let up_to = |share: f64| {
            let units = if is_position {
                (from + share * (number.to_f64() - from)) * per_unit
            } else {
                share * whole as f64
            };
            units.round() as i64
        };
        (self.digits, self.last_is_kept) = (digits, is_position);
        self.words.extend(nodes.iter().map(|node| up_to(node.share)));
        if let Some(last) = self.words.last_mut() {
            *last = whole;
        }
        if !is_position {
            let mut before = 0;
            for word in &mut self.words {
                let here = *word;
                *word = here - before;
                before = here;
            }
            let unit = 10_i128.pow(18 - u32::from(digits.min(18)));
            self.extrusion = self.words.iter().map(|&word| i128::from(word) * unit).sum();
        }
    }

    /// The word of a piece.
    #[inline]
    pub fn of_piece(&self, piece: usize) -> PieceWord {
        match self.words.get(piece) {
            Some(_) if self.last_is_kept && piece + 1 == self.words.len() => PieceWord::Kept,
            Some(&word) => PieceWord::New(word),
            // What cannot be shared is extruded by the first piece.
            None if piece == 0 => PieceWord::Kept,
            None => PieceWord::Absent,
        }
    }
}
