//! The line of a move written again, and the lines of its further pieces.

use super::draft::Draft;
use super::lexer::Span;
use super::words::MoveText;

/// `E` of a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PieceWord {
    /// As it was written, if there is one.
    Kept,
    /// This many units of the last printed digit.
    New(i64),
    /// No word: nothing is extruded.
    Absent,
}

/// The words of a piece.
#[derive(Clone, Copy, Debug)]
pub struct PieceWords {
    /// X, Y, Z in units of the last printed digit.
    pub steps: [i64; 3],
    /// Which of them are written; of the others the line has what it had, if anything.
    pub is_new: [bool; 3],
    /// Digits behind their points.
    pub digits: u8,
    /// E.
    pub extruder: PieceWord,
    /// Digits behind its point.
    pub extruder_digits: u8,
}

/// Place of E among the words of a line, behind X, Y and Z.
const EXTRUDER: usize = 3;

/// The line itself with new numbers, up to byte `end`; words of axes that it did not give behind the last that it gave.
///
/// `source` begins with the line, and may go on.
#[inline(always)]
pub fn first_piece(draft: &mut Draft, source: &[u8], end: usize, text: &MoveText, words: &PieceWords) {
    let mut line = Rewording { draft, source, text, words, at: 0 };
    if text.is_in_order {
        line.axis(0);
        line.axis(1);
        line.axis(2);
        line.absent_axes();
        line.extruder();
    } else {
        line.in_any_order();
    }
    line.up_to(end);
}

/// A line whose numbers are exchanged one after the other.
struct Rewording<'a> {
    draft: &'a mut Draft,
    source: &'a [u8],
    text: &'a MoveText,
    words: &'a PieceWords,
    /// How far it has been written.
    at: usize,
}

impl Rewording<'_> {
    /// As it is.
    #[inline(always)]
    fn up_to(&mut self, end: usize) {
        self.draft.copy(self.source, self.at, end);
        self.at = end;
    }

    /// Another number behind the letter of a word of the line.
    #[inline(always)]
    fn number(&mut self, span: Span, scaled: i64, digits: u8) {
        self.up_to(span.start as usize + 1);
        self.draft.number(scaled, digits);
        self.at = span.end as usize;
    }

    #[inline(always)]
    fn axis(&mut self, axis: usize) {
        if let (Some(span), true) = (self.text.axes[axis], self.words.is_new[axis]) {
            self.number(span, self.words.steps[axis], self.words.digits);
        }
    }

    /// Axes that the line did not give.
    #[inline(always)]
    fn absent_axes(&mut self) {
        for axis in 0..3 {
            if self.words.is_new[axis] && self.text.axes[axis].is_none() {
                self.up_to(self.text.behind_axes as usize);
                axis_word(self.draft, self.text, self.text.is_spaced, axis, self.words);
            }
        }
    }

    #[inline(always)]
    fn extruder(&mut self) {
        if let (Some(span), PieceWord::New(units)) = (self.text.extruder, self.words.extruder) {
            self.number(span, units, self.words.extruder_digits);
        }
    }

    #[cold]
    fn in_any_order(&mut self) {
        let [x, y, z] = self.text.axes;
        let mut spans = [(0, x), (1, y), (2, z), (EXTRUDER, self.text.extruder)];
        spans.sort_by_key(|(_, span)| span.map_or(0, |span| span.start));
        for (which, span) in spans {
            let Some(span) = span else { continue };
            if which == EXTRUDER {
                self.extruder();
                continue;
            }
            self.axis(which);
            if span.end == self.text.behind_axes {
                self.absent_axes();
            }
        }
    }
}

/// A line for a further piece, without its end: the motion code, the axes that move, and `E`.
pub fn further_piece(draft: &mut Draft, source: &[u8], text: &MoveText, words: &PieceWords) {
    // A line must not begin with a blank.
    let mut is_spaced = false;
    for span in [text.machine, text.motion].into_iter().flatten() {
        if is_spaced {
            draft.push(b' ');
        }
        draft.copy(source, span.start as usize, span.end as usize);
        is_spaced = text.is_spaced;
    }
    for axis in (0..3).filter(|&axis| words.is_new[axis]) {
        axis_word(draft, text, is_spaced, axis, words);
        is_spaced = text.is_spaced;
    }
    let Some(span) = text.extruder.filter(|_| words.extruder != PieceWord::Absent) else { return };
    if text.is_spaced {
        draft.push(b' ');
    }
    if let PieceWord::New(units) = words.extruder {
        draft.copy(source, span.start as usize, span.start as usize + 1);
        draft.number(units, words.extruder_digits);
    } else {
        draft.copy(source, span.start as usize, span.end as usize);
    }
}

#[inline(always)]
fn axis_word(draft: &mut Draft, text: &MoveText, is_spaced: bool, axis: usize, words: &PieceWords) {
    if is_spaced {
        draft.push(b' ');
    }
    let letters = if text.is_lower { b"xyz" } else { b"XYZ" };
    draft.push(letters[axis]);
    draft.number(words.steps[axis], words.digits);
}
