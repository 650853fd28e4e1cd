//! Moves written again with corrected words; knows where the rewritten program puts the machine.

use super::decimal::POWERS_F64;
use super::draft::Draft;
use super::frame::{Effects, Frame, KeptFrames, Motion};
use super::known::Known;
use super::options::{Options, unit_mm};
use super::path::Node;
use super::reader::{Move, Target};
use super::shares::Shares;
use super::usual::{Run, UsualMove};
use super::wording::{PieceWord, PieceWords, first_piece, further_piece};

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
    /// What the written words extrude, `10^-18` of the program's unit.
    pub extrusion: i128,
    /// Nodes that take up less play than is printed, and have no line.
    pub n_idle: u64,
}

/// How axis words are printed in one unit.
#[derive(Clone, Copy, Debug)]
struct Print {
    is_inch: bool,
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
            is_inch,
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
    shares: Shares,
    kept: KeptFrames,
}

impl Writer {
    /// At the begin of a program.
    pub fn new(options: &Options) -> Self {
        Self {
            frame: Frame::default(),
            prints: [false, true].map(|is_inch| Print::new(options, is_inch)),
            must_give_all: false,
            shares: Shares::default(),
            kept: KeptFrames::default(),
        }
    }

    /// Takes over what a line does that is written as it is.
    pub fn pass(&mut self, effects: &Effects) {
        self.frame.apply(effects);
        self.kept.apply(effects.kept, &mut self.frame);
    }

    /// Writes a move that ends at the last of `nodes`, one line for each.
    #[inline]
    pub fn write(
        &mut self,
        draft: &mut Draft,
        line: SourceLine<'_>,
        a_move: &Move,
        target: &Target,
        nodes: &[Node],
    ) -> Written {
        self.must_give_all |= target.is_first;
        let print = self.prints[usize::from(target.is_inch)];
        let mut n_idle = 0;
        let nodes = match nodes {
            [first, others @ ..]
                if first.share == 0.0 && !others.is_empty() && self.is_idle(first, &print) =>
            {
                n_idle = 1;
                others
            }
            _ => nodes,
        };
        self.shares.set(a_move, nodes);
        let [first, further @ ..] = nodes else {
            return Written { is_changed: false, extrusion: a_move.extrusion, n_idle };
        };
        let words = self.words_of_piece(a_move, first, 0, &print);
        let is_whole = further.is_empty();
        let is_changed = !is_whole || words.is_new != [false; 3];
        draft.make_room(line.body.len() + line.ending.len());
        let end = line.body.len() + if is_whole { line.ending.len() } else { 0 };
        first_piece(draft, line.text, end, &a_move.text, &words);
        if !is_whole {
            n_idle += self.write_further(draft, line, a_move, nodes, &print);
        }
        self.must_give_all &= !(is_changed && a_move.motion.is_absolute);
        Written { is_changed, extrusion: self.shares.extrusion, n_idle }
    }

    /// Whether the machine stands at a node already, as far as it is printed.
    fn is_idle(&self, node: &Node, print: &Print) -> bool {
        let at_mm = self.frame.position_mm.numbers();
        (0..3).all(|axis| (at_mm[axis] - node.command_mm[axis]).abs() <= print.near_mm)
    }

    /// Writes a usual move as one line, and tells whether it differs from the one that came in; None where there is more to
    /// it than its numbers, and nothing was written.
    #[inline(always)]
    pub fn write_usual(
        &mut self,
        draft: &mut Draft,
        text: &[u8],
        run: &Run,
        usual: &UsualMove,
        end: &Node,
    ) -> Option<bool> {
        if self.must_give_all {
            return None;
        }
        let print = self.prints[0];
        let words = self.words(&run.motion_of(usual), end, 0, &print);
        draft.make_room(usual.length_with_end());
        first_piece(draft, text, usual.length_with_end(), &usual.text(), &words);
        Some(words.is_new != [false; 3])
    }

    /// Lines of the pieces behind the first, and the ends of all; gives the number of those that take up less play than is
    /// printed.
    fn write_further(
        &mut self,
        draft: &mut Draft,
        line: SourceLine<'_>,
        a_move: &Move,
        nodes: &[Node],
        print: &Print,
    ) -> u64 {
        let mut n_idle = 0;
        let between = if line.ending.is_empty() { line.usual_ending } else { line.ending };
        for (piece, node) in nodes.iter().enumerate().skip(1) {
            if node.share == nodes[piece - 1].share && self.is_idle(node, print) {
                n_idle += 1;
                continue;
            }
            let words = self.words_of_piece(a_move, node, piece, print);
            draft.make_room(line.body.len() + 2 * between.len());
            draft.copy(between, 0, between.len());
            further_piece(draft, line.text, &a_move.text, &words);
        }
        draft.copy(line.ending, 0, line.ending.len());
        n_idle
    }

    /// The words of a piece of a move, and the machine moved to where they say.
    #[inline]
    fn words_of_piece(&mut self, a_move: &Move, node: &Node, piece: usize, print: &Print) -> PieceWords {
        let mut words = self.words(&a_move.motion, node, piece, print);
        (words.extruder, words.extruder_digits) = (self.shares.of_piece(piece), self.shares.digits);
        words
    }

    /// Those of the axes, and the machine moved to where they say.
    #[inline(always)]
    fn words(&mut self, motion: &Motion, node: &Node, piece: usize, print: &Print) -> PieceWords {
        // What is not known is near nothing.
        let near = |a_mm: f64, b_mm: f64| (a_mm - b_mm).abs() <= print.near_mm;
        // An end is known only where the begin of an increment is.
        let origin_mm = self.frame.origin_of(motion).numbers().map(|at| if at.is_nan() { 0.0 } else { at });
        let old_mm = *if piece == 0 { motion.words_mm } else { Known::NONE }.numbers();
        let position_mm = *self.frame.position_mm.numbers();
        let wanted_mm: [f64; 3] = std::array::from_fn(|axis| node.command_mm[axis] - origin_mm[axis]);
        // All numbers are worked out, wanted or not: nothing has to be guessed on the way.
        let steps: [i64; 3] = std::array::from_fn(|axis| {
            let word = if print.is_inch { wanted_mm[axis] / print.unit_mm } else { wanted_mm[axis] };
            rounded(word * print.steps_per_unit)
        });
        let is_kept: [bool; 3] = std::array::from_fn(|axis| near(old_mm[axis], wanted_mm[axis]));
        let is_absent: [bool; 3] = std::array::from_fn(|axis| {
            old_mm[axis].is_nan() & near(position_mm[axis], node.command_mm[axis])
        });
        let mut is_new: [bool; 3] = std::array::from_fn(|axis| !(is_kept[axis] | is_absent[axis]));
        if self.must_give_all && piece == 0 && motion.is_absolute && is_new != [false; 3] {
            is_new = std::array::from_fn(|axis| is_new[axis] | is_absent[axis]);
        }
        self.frame.position_mm = Known::all(std::array::from_fn(|axis| {
            let new_mm = steps[axis] as f64 / print.steps_per_unit * print.unit_mm;
            let word_mm = if is_new[axis] { new_mm } else { old_mm[axis] };
            if word_mm.is_nan() { position_mm[axis] } else { origin_mm[axis] + word_mm }
        }));
        PieceWords { steps, is_new, digits: print.digits, extruder: PieceWord::Kept, extruder_digits: 0 }
    }
}

/// The nearest integer, halves away from zero, as [`f64::round`] has it but without a call.
#[inline]
fn rounded(number: f64) -> i64 {
    // The largest number below a half: with a half, what is just below one would be rounded up.
    const BELOW_HALF: f64 = 0.499_999_999_999_999_94;
    (number + BELOW_HALF.copysign(number)) as i64
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
