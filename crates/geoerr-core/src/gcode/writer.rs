//! Moves written again with corrected words; knows where the rewritten program puts the machine.

use super::decimal::{POWERS_F64, write_fixed};
use super::draft::Draft;
use super::extrusion::Share;
use super::frame::{Effects, Frame};
use super::known::Known;
use super::lexer::Span;
use super::options::{Options, unit_mm};
use super::path::Node;
use super::reader::Move;
use super::words::MoveText;

/// Fewest digits of a shared `E`.
const EXTRUDER_DIGITS: u8 = 5;

/// A line as it comes in.
#[derive(Clone, Copy, Debug)]
pub struct SourceLine<'a> {
    /// Without its end.
    pub body: &'a [u8],
    /// From its begin to where the program's text ends for now.
    pub text: &'a [u8],
    /// Its end.
    pub ending: &'a [u8],
    /// The end to give to lines before a last line that has none.
    pub usual_ending: &'a [u8],
}

/// What was written for a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Written {
    /// Whether it differs from the line that came in.
    pub is_changed: bool,
    /// What the written words extrude, `10^-18` mm.
    pub extrusion: i128,
}

/// How axis words are printed in one unit.
#[derive(Clone, Copy, Debug)]
struct Print {
    digits: u8,
    unit_mm: f64,
    steps_per_unit: f64,
    /// Numbers that differ by less are printed alike, or nearly so.
    near_mm: f64,
}

impl Print {
    fn new(options: &Options, is_inch: bool) -> Self {
        let digits = options.word_digits(is_inch);
        Self {
            digits,
            unit_mm: unit_mm(is_inch),
            steps_per_unit: POWERS_F64[usize::from(digits)],
            // The number of an axis that is where it should be may still differ by rounding: a hair more than half a step.
            near_mm: options.half_step_mm(is_inch) * (1.0 + 1e-6),
        }
    }
}

/// Writes moves; keeps the place of the machine that runs the rewritten program.
#[derive(Debug)]
pub struct Writer {
    frame: Frame,
    /// Words in millimetres, and in inches.
    prints: [Print; 2],
    /// Whether the next changed move must give all three axes, because the controller's own idea of its place is not
    /// relied on.
    must_give_all: bool,
    draft: Draft,
}

/// An axis word of a piece.
#[derive(Clone, Copy, Debug)]
enum AxisWord {
    /// The number as it was written is right.
    Kept,
    /// This many units of the last printed digit.
    New(i64),
    /// No word: the axis stays.
    Absent,
}

impl Writer {
    /// At the begin of a program.
    pub fn new(options: &Options) -> Self {
        Self {
            frame: Frame::default(),
            prints: [false, true].map(|is_inch| Print::new(options, is_inch)),
            must_give_all: false,
            draft: Draft::default(),
        }
    }

    /// Takes over what a line does that is written as it is.
    pub fn pass(&mut self, effects: &Effects) {
        self.frame.apply(effects);
    }

    /// Writes a move that ends at the last of `nodes`, one line for each.
    pub fn write(
        &mut self,
        out: &mut Vec<u8>,
        line: SourceLine<'_>,
        a_move: &Move,
        nodes: &[Node],
    ) -> Written {
        self.must_give_all |= a_move.is_first;
        let print = self.prints[usize::from(a_move.is_inch)];
        let mut is_changed = nodes.len() > 1;
        if let [node] = nodes
            && Draft::fits(line.body.len() + line.ending.len())
            && is_in_order(&a_move.text)
        {
            let words = self.axis_words(a_move, node, true, &print);
            is_changed |= words.iter().any(|word| matches!(word, AxisWord::New(_)));
            self.must_give_all &= !(is_changed && a_move.motion.is_absolute);
            self.draft.clear();
            draft_whole(&mut self.draft, line, &a_move.text, &words, print.digits);
            out.extend_from_slice(self.draft.bytes());
            return Written { is_changed, extrusion: a_move.extrusion };
        }
        let shares = Shares::new(a_move, nodes);
        for (piece, node) in nodes.iter().enumerate() {
            let words = self.axis_words(a_move, node, piece == 0, &print);
            if piece == 0 {
                is_changed |= words.iter().any(|word| matches!(word, AxisWord::New(_)));
                write_first(out, line.body, &a_move.text, &words, &shares, print.digits);
            } else {
                write_further(out, line.body, &a_move.text, &words, &shares, piece, print.digits);
            }
            let is_last = piece + 1 == nodes.len();
            out.extend_from_slice(if is_last || !line.ending.is_empty() {
                line.ending
            } else {
                line.usual_ending
            });
        }
        self.must_give_all &= !(is_changed && a_move.motion.is_absolute);
        Written { is_changed, extrusion: shares.extrusion }
    }

    /// The axis words of a piece, and the machine moved to where they say.
    #[inline]
    fn axis_words(
        &mut self,
        a_move: &Move,
        node: &Node,
        is_first_piece: bool,
        print: &Print,
    ) -> [AxisWord; 3] {
        let motion = &a_move.motion;
        let step_of = |word_mm: f64| {
            let word = if a_move.is_inch { word_mm / print.unit_mm } else { word_mm };
            rounded(word * print.steps_per_unit)
        };
        // What is not known is near nothing.
        let near = |a_mm: f64, b_mm: f64| (a_mm - b_mm).abs() <= print.near_mm;
        // An end is known only where the begin of an increment is.
        let origin_mm = self.frame.origin_of(motion).numbers().map(|at| if at.is_nan() { 0.0 } else { at });
        let old_mm = if is_first_piece { motion.words_mm } else { Known::NONE };
        let position_mm = *self.frame.position_mm.numbers();
        let gives_all = self.must_give_all && is_first_piece && motion.is_absolute;
        let wanted_mm: [f64; 3] = std::array::from_fn(|axis| node.command_mm[axis] - origin_mm[axis]);
        let mut words: [AxisWord; 3] = std::array::from_fn(|axis| {
            let old_mm = old_mm.numbers()[axis];
            if near(old_mm, wanted_mm[axis]) {
                AxisWord::Kept
            } else if old_mm.is_nan() && near(position_mm[axis], node.command_mm[axis]) {
                AxisWord::Absent
            } else {
                AxisWord::New(step_of(wanted_mm[axis]))
            }
        });
        if gives_all && words.iter().any(|word| matches!(word, AxisWord::New(_))) {
            for axis in 0..3 {
                if matches!(words[axis], AxisWord::Absent) {
                    words[axis] = AxisWord::New(step_of(wanted_mm[axis]));
                }
            }
        }
        for axis in 0..3 {
            let word_mm = match words[axis] {
                AxisWord::Absent => continue,
                AxisWord::Kept => motion.words_mm.numbers()[axis],
                AxisWord::New(steps) => steps as f64 / print.steps_per_unit * print.unit_mm,
            };
            self.frame.position_mm.set(axis, Some(origin_mm[axis] + word_mm));
        }
        words
    }
}

/// The nearest integer, halves away from zero, as [`f64::round`] has it but without a call.
#[inline]
fn rounded(number: f64) -> i64 {
    // The largest number below a half: with a half, what is just below one would be rounded up.
    const BELOW_HALF: f64 = 0.499_999_999_999_999_94;
    (number + BELOW_HALF.copysign(number)) as i64
}

/// `E` of the pieces of a move.
#[derive(Debug)]
struct Shares {
    digits: u8,
    /// Words of the pieces, in units of the last digit; empty where the word stays as it is.
    words: Vec<i64>,
    /// Whether the last piece has the word as it was written.
    last_is_kept: bool,
    extrusion: i128,
}

impl Shares {
    /// By length, rounded to the word's digits (at least five); the sum, or the last position, is exact.
    fn new(a_move: &Move, nodes: &[Node]) -> Self {
        let mut shares =
            Self { digits: 0, words: Vec::new(), last_is_kept: false, extrusion: a_move.extrusion };
        let number = match a_move.share {
            Share::Increment(number) | Share::Position(number) if nodes.len() > 1 => number,
            _ => return shares,
        };
        let digits = number.digits.max(EXTRUDER_DIGITS);
        let Some(whole) = number.scaled(digits) else { return shares };
        let per_unit = POWERS_F64[usize::from(digits)];
        let up_to = |share: f64| match a_move.share {
            Share::Position(_) => {
                let from = (number.exact() - a_move.extrusion) as f64 * 1e-18;
                ((from + share * (number.to_f64() - from)) * per_unit).round() as i64
            }
            _ => (share * whole as f64).round() as i64,
        };
        shares.digits = digits;
        shares.words = nodes.iter().map(|node| up_to(node.share)).collect();
        if let Some(last) = shares.words.last_mut() {
            *last = whole;
        }
        if let Share::Position(_) = a_move.share {
            shares.last_is_kept = true;
        } else {
            let mut before = 0;
            for word in &mut shares.words {
                let here = *word;
                *word = here - before;
                before = here;
            }
            let unit = 10_i128.pow(18 - u32::from(digits.min(18)));
            shares.extrusion = shares.words.iter().map(|&word| i128::from(word) * unit).sum();
        }
        shares
    }
}

/// Whether the axis words of a line stand in the order X, Y, Z.
#[inline]
fn is_in_order(text: &MoveText) -> bool {
    let begins = text.axes.map(|span| span.map(|span| span.start));
    let is_behind = |a: Option<u32>, b: Option<u32>| a.zip(b).is_none_or(|(a, b)| a < b);
    is_behind(begins[0], begins[1]) && is_behind(begins[1], begins[2]) && is_behind(begins[0], begins[2])
}

/// The line of a move that stays whole, its axis words in order; its `E` stays.
#[inline]
fn draft_whole(draft: &mut Draft, line: SourceLine<'_>, text: &MoveText, words: &[AxisWord; 3], digits: u8) {
    let mut at = 0;
    for (axis, &word) in words.iter().enumerate() {
        if let (AxisWord::New(steps), Some(span)) = (word, text.axes[axis]) {
            // The letter stays.
            draft.copy(line.text, at, span.start as usize + 1);
            draft.number(steps, digits);
            at = span.end as usize;
        }
    }
    for (axis, &word) in words.iter().enumerate() {
        if let (AxisWord::New(steps), None) = (word, text.axes[axis]) {
            let behind = text.behind_axes as usize;
            draft.copy(line.text, at, behind);
            at = behind;
            if text.is_spaced {
                draft.push(b' ');
            }
            draft.push(axis_letter(text, axis));
            draft.number(steps, digits);
        }
    }
    draft.copy(line.text, at, line.body.len() + line.ending.len());
}

/// The line itself with new numbers; words of axes that it did not give behind the last that it gave.
fn write_first(
    out: &mut Vec<u8>,
    body: &[u8],
    text: &MoveText,
    words: &[AxisWord; 3],
    shares: &Shares,
    digits: u8,
) {
    // Byte ranges to replace, in the order of the line. An insertion is an empty range.
    let mut edits = [(Span { start: 0, end: 0 }, Edit::Number { steps: 0, digits }); 7];
    let mut n_edits = 0;
    let mut is_sorted = true;
    let mut add = |span: Span, edit: Edit| {
        is_sorted &= n_edits == 0 || edits[n_edits - 1].0.start <= span.start;
        edits[n_edits] = (span, edit);
        n_edits += 1;
    };
    for (axis, &word) in words.iter().enumerate() {
        if let (AxisWord::New(steps), Some(span)) = (word, text.axes[axis]) {
            add(span, Edit::Number { steps, digits });
        }
    }
    let behind = Span { start: text.behind_axes, end: text.behind_axes };
    for (axis, &word) in words.iter().enumerate() {
        if let (AxisWord::New(steps), None) = (word, text.axes[axis]) {
            add(behind, Edit::Axis { axis, steps });
        }
    }
    if let (Some(span), Some(&steps)) = (text.extruder, shares.words.first()) {
        add(span, Edit::Number { steps, digits: shares.digits });
    }
    let edits = &mut edits[..n_edits];
    if !is_sorted {
        // Stable: insertions at one place stay in the order X, Y, Z.
        edits.sort_by_key(|(span, _)| span.start);
    }
    let mut at = 0;
    for &(span, edit) in edits.iter() {
        // Up to the number: the letter stays.
        let letter = usize::from(matches!(edit, Edit::Number { .. }));
        out.extend_from_slice(body.get(at..span.start as usize + letter).unwrap_or_default());
        match edit {
            Edit::Number { steps, digits } => write_fixed(out, steps, digits),
            Edit::Axis { axis, steps } => write_axis(out, text, axis, steps, digits),
        }
        at = span.end as usize;
    }
    out.extend_from_slice(body.get(at..).unwrap_or_default());
}

#[derive(Clone, Copy, Debug)]
enum Edit {
    Number { steps: i64, digits: u8 },
    Axis { axis: usize, steps: i64 },
}

/// A line for a further piece: the motion code, the axes that move, and `E`.
fn write_further(
    out: &mut Vec<u8>,
    body: &[u8],
    text: &MoveText,
    words: &[AxisWord; 3],
    shares: &Shares,
    piece: usize,
    digits: u8,
) {
    let begin = out.len();
    for span in [text.machine, text.motion].into_iter().flatten() {
        if text.is_spaced && out.len() > begin {
            out.push(b' ');
        }
        out.extend_from_slice(span.of(body));
    }
    for (axis, word) in words.iter().enumerate() {
        if let AxisWord::New(steps) = word {
            // A line must not begin with a blank.
            let spaced = MoveText { is_spaced: text.is_spaced && out.len() > begin, ..*text };
            write_axis(out, &spaced, axis, *steps, digits);
        }
    }
    if let (Some(span), Some(&steps)) = (text.extruder, shares.words.get(piece)) {
        if text.is_spaced {
            out.push(b' ');
        }
        if shares.last_is_kept && piece + 1 == shares.words.len() {
            out.extend_from_slice(span.of(body));
        } else {
            out.extend(span.of(body).first());
            write_fixed(out, steps, shares.digits);
        }
    }
}

fn write_axis(out: &mut Vec<u8>, text: &MoveText, axis: usize, steps: i64, digits: u8) {
    if text.is_spaced {
        out.push(b' ');
    }
    out.push(axis_letter(text, axis));
    write_fixed(out, steps, digits);
}

#[inline]
fn axis_letter(text: &MoveText, axis: usize) -> u8 {
    let letters = if text.is_lower { b"xyz" } else { b"XYZ" };
    letters[axis]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rounding_is_that_of_the_standard_library(
            number in prop_oneof![-1e7_f64..1e7, -4e15_f64..4e15, (-1_000_000_i64..1_000_000).prop_map(|n| n as f64 + 0.5)],
        ) {
            prop_assert_eq!(rounded(number), number.round() as i64);
        }
    }

    #[test]
    fn halves_are_rounded_away_from_zero() {
        for (number, nearest) in
            [(0.5, 1), (-0.5, -1), (1.5, 2), (-2.5, -3), (0.499_999_999_999_999_94, 0), (-0.0, 0)]
        {
            assert_eq!(rounded(number), nearest, "{number}");
        }
        assert_eq!(rounded(1e300), i64::MAX);
        assert_eq!(rounded(f64::NAN), 0);
    }
}
