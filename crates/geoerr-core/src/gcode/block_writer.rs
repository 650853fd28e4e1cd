//! Blocks of solved lines into bytes.

use super::block::{Block, EndOfMove, Item, ItemStep, MARK, Way};
use super::draft::Draft;
use super::error::GcodeError;
use super::extrusion::{Share, in_mm};
use super::options::{OnUnsupported, Options};
use super::path::{Closeness, Node, SplitError};
use super::reader::{AXIS_LETTERS, Move, Target};
use super::report::{Summary, WarningKind, Warnings, excerpt};
use super::unsupported::Unsupported;
use super::usual::{Run, UsualMove};
use super::words::said_for_the_end;
use super::writer::{SourceLine, Writer};

/// A move on its way out.
struct Outgoing<'a> {
    line: u64,
    source: SourceLine<'a>,
    a_move: &'a Move,
    target: &'a Target,
    /// Whether the program's comments so far are in parentheses.
    comments_in_parentheses: bool,
    /// Whether its correction turns an axis in it.
    is_turned: bool,
}

/// Writes a program block by block.
#[derive(Debug)]
pub struct BlockWriter {
    writer: Writer,
    draft: Draft,
    /// Where commands may go, (low, high), by words in millimetres and in inches.
    reach_mm: [[(f64, f64); 3]; 2],
    is_marked: bool,
    usual_ending: Vec<u8>,
    /// Square of the largest correction.
    largest_mm2: f64,
    /// What the user should know of the written moves.
    pub warnings: Warnings,
    /// Counts of the written moves.
    pub summary: Summary,
}

impl BlockWriter {
    /// At the begin of a program.
    pub fn new(options: &Options) -> Self {
        let reach = |is_inch| {
            // What is printed as the end of the range is in it.
            let slack_mm = options.half_step_mm(is_inch);
            options.range_mm.map(|(low_mm, high_mm)| (low_mm - slack_mm, high_mm + slack_mm))
        };
        Self {
            writer: Writer::new(options),
            draft: Draft::default(),
            reach_mm: [reach(false), reach(true)],
            is_marked: false,
            usual_ending: b"\n".to_vec(),
            largest_mm2: 0.0,
            warnings: Warnings::default(),
            summary: Summary::default(),
        }
    }

    /// Appends a block's lines to `out`.
    ///
    /// # Errors
    /// That of the first line that cannot be written, behind those before it; or that which ended the reading.
    pub fn write(
        &mut self,
        block: &mut Block,
        closeness: &[Closeness; 2],
        options: &Options,
        is_nominal: bool,
        out: &mut Vec<u8>,
    ) -> Result<(), GcodeError> {
        self.draft.clear();
        let outcome = self.write_lines(block, closeness, options, is_nominal);
        out.extend_from_slice(self.draft.bytes());
        outcome.and_then(|()| block.refusal.take().map_or(Ok(()), Err))
    }

    #[inline(always)]
    fn write_lines(
        &mut self,
        block: &Block,
        closeness: &[Closeness; 2],
        options: &Options,
        is_nominal: bool,
    ) -> Result<(), GcodeError> {
        let (mut effects, mut moves, mut runs) =
            (block.effects.iter(), block.moves.iter(), block.runs.iter());
        let mut usual_moves = block.usual.iter();
        let mut ends = block.ends_of_moves();
        let mut turns = block.turns.iter().peekable();
        // Words in millimetres, and in inches.
        let has_too_few_digits =
            closeness.map(|closeness| !is_nominal && closeness.limit_mm < 0.5 * options.tolerance_mm);
        let mut line = block.first_line;
        for item in &block.items {
            match item.step {
                ItemStep::Pass => self.pass(block, item),
                ItemStep::Do => {
                    self.pass(block, item);
                    if let Some(effects) = effects.next() {
                        self.writer.pass(effects);
                    }
                }
                ItemStep::Correct { comments_in_parentheses } => {
                    let Some((a_move, end)) = moves.next().zip(ends.next()) else { continue };
                    let body = block.body(item);
                    if has_too_few_digits[usize::from(end.target.is_inch)] {
                        return Err(too_few_digits(line, end.target.is_inch, options));
                    }
                    let nodes = block.nodes_of(&end).map_err(|error| refused(error, line, body))?;
                    let is_turned = turns.next_if(|&&index| index == end.index).is_some();
                    let source = SourceLine {
                        body,
                        text: block.from(item),
                        ending: block.ending(item),
                        usual_ending: &[],
                    };
                    let target = end.target;
                    let outgoing =
                        Outgoing { line, source, a_move, target, comments_in_parentheses, is_turned };
                    self.write_move(&outgoing, nodes, options)?;
                }
                ItemStep::Run => {
                    let Some(run) = runs.next() else { continue };
                    if has_too_few_digits[0] {
                        return Err(too_few_digits(line, false, options));
                    }
                    for (usual, end) in usual_moves.by_ref().take(run.n_moves).zip(ends.by_ref()) {
                        self.write_usual(block, run, usual, &end, line, options)?;
                        line += 1;
                    }
                    self.see_ending(UsualMove::ENDING);
                    continue;
                }
            }
            self.see_ending(block.ending(item));
            line += 1;
        }
        Ok(())
    }

    /// How the program ends its lines.
    #[inline]
    fn see_ending(&mut self, ending: &[u8]) {
        if !ending.is_empty() && !is_same_ending(ending, &self.usual_ending) {
            self.usual_ending = ending.to_vec();
        }
    }

    /// A line as it came.
    fn pass(&mut self, block: &Block, item: &Item) {
        let n_bytes = block.whole_line(item).len();
        self.draft.make_room(n_bytes);
        self.draft.copy(block.from(item), 0, n_bytes);
    }

    /// A usual move: most stay whole, and of those little has to be asked.
    #[inline(always)]
    fn write_usual(
        &mut self,
        block: &Block,
        run: &Run,
        usual: &UsualMove,
        end: &EndOfMove<'_>,
        line: u64,
        options: &Options,
    ) -> Result<(), GcodeError> {
        let (text, begin) = (block.text_of_usual(usual), self.draft.length());
        if let (Way::Whole, Some(solved)) = (end.way, end.solved)
            && is_in_reach(&solved.node, &self.reach_mm[0])
            && let Some(is_changed) = self.writer.write_usual(&mut self.draft, text, run, usual, &solved.node)
        {
            if is_changed && !self.is_marked {
                self.mark(begin, run.comments_in_parentheses, UsualMove::ENDING, options);
            }
            self.count(line, end.target, std::slice::from_ref(&solved.node), usual.extrusion);
            return Ok(());
        }
        let body = text.get(..usize::from(usual.length)).unwrap_or_default();
        let nodes = block.nodes_of(end).map_err(|error| refused(error, line, body))?;
        let source = SourceLine { body, text, ending: UsualMove::ENDING, usual_ending: &[] };
        let (a_move, comments_in_parentheses) = (&run.move_of(usual), run.comments_in_parentheses);
        self.write_move(
            &Outgoing { line, source, a_move, target: end.target, comments_in_parentheses, is_turned: false },
            nodes,
            options,
        )
    }

    #[inline]
    fn write_move(
        &mut self,
        outgoing: &Outgoing<'_>,
        mut nodes: &[Node],
        options: &Options,
    ) -> Result<(), GcodeError> {
        let &Outgoing { line, source: SourceLine { body, .. }, a_move, target, .. } = outgoing;
        let reach_mm = &self.reach_mm[usize::from(target.is_inch)];
        if let Some(node) = nodes.iter().find(|node| !is_in_reach(node, reach_mm)) {
            return Err(out_of_reach(node, reach_mm, options, line, body));
        }
        if let [_, .., end] = nodes
            && let Some(what) = cannot_be_split(a_move, body)
        {
            if options.on_unsupported == OnUnsupported::Refuse {
                return Err(GcodeError::Unsupported { line, text: excerpt(body), what });
            }
            self.warnings.add(WarningKind::NotSplit(what), line, body);
            nodes = std::slice::from_ref(end);
        } else if outgoing.is_turned {
            self.warnings.add(WarningKind::TurnedAtRest, line, body);
        }
        let begin = self.draft.length();
        let source = SourceLine { usual_ending: &self.usual_ending, ..outgoing.source };
        let written = self.writer.write(&mut self.draft, source, a_move, target, nodes);
        if written.is_changed && !self.is_marked {
            let ending = if source.ending.is_empty() { source.usual_ending } else { source.ending }.to_vec();
            self.mark(begin, outgoing.comments_in_parentheses, &ending, options);
        }
        self.count(line, target, nodes, in_mm(written.extrusion, target.is_inch));
        self.summary.moves_out -= written.n_idle;
        Ok(())
    }

    /// Says before the first line that is changed, at this place of the draft, that the program is corrected.
    #[cold]
    fn mark(&mut self, begin: usize, comments_in_parentheses: bool, ending: &[u8], options: &Options) {
        self.is_marked = true;
        self.draft.insert(begin, &mark_line(comments_in_parentheses, ending, options));
    }

    /// A move that has been written as these nodes, and extrudes so much, `10^-18` mm.
    #[inline(always)]
    fn count(&mut self, line: u64, target: &Target, nodes: &[Node], extrusion: i128) {
        let summary = &mut self.summary;
        summary.moves_out += nodes.len() as u64;
        summary.moves_corrected += 1;
        summary.extrusion_out += extrusion;
        for ((low_mm, high_mm), end_mm) in summary.box_mm.iter_mut().zip(target.end_mm) {
            // Few moves go further than all before: that is guessed rightly.
            if end_mm < *low_mm {
                *low_mm = end_mm;
            }
            if end_mm > *high_mm {
                *high_mm = end_mm;
            }
        }
        for node in nodes {
            let correction_mm2 =
                (0..3).map(|axis| (node.command_mm[axis] - node.ideal_mm[axis]).powi(2)).sum::<f64>();
            if correction_mm2 > self.largest_mm2 {
                self.largest_mm2 = correction_mm2;
                // Roots of two squares may be one number: the first line counts.
                if correction_mm2.sqrt() > summary.largest_correction_mm {
                    summary.largest_correction_mm = correction_mm2.sqrt();
                    summary.largest_correction_line = line;
                }
            }
        }
    }
}

#[cold]
fn too_few_digits(line: u64, is_inch: bool, options: &Options) -> GcodeError {
    let (digits, tolerance_mm) = (options.word_digits(is_inch), options.tolerance_mm);
    GcodeError::TooFewDigits { line, digits, tolerance_mm }
}

/// Whether two ends of lines are the same: `\n`, `\r\n` or `\r`.
#[inline]
fn is_same_ending(one: &[u8], other: &[u8]) -> bool {
    (one.len(), one.first()) == (other.len(), other.first())
}

#[cold]
fn refused(error: SplitError, line: u64, body: &[u8]) -> GcodeError {
    let text = excerpt(body);
    match error {
        SplitError::NotSolved(remaining_mm) => GcodeError::NotSolved { line, text, remaining_mm },
        SplitError::NotHeld(deviation_mm) => GcodeError::NotHeld { line, text, deviation_mm },
    }
}

/// Whether a command lies in these ranges.
#[inline]
fn is_in_reach(node: &Node, reach_mm: &[(f64, f64); 3]) -> bool {
    // All three are asked: what is known at once need not be guessed.
    let is_in = |axis: usize| {
        let (at_mm, (low_mm, high_mm)) = (node.command_mm[axis], reach_mm[axis]);
        (low_mm <= at_mm) & (at_mm <= high_mm)
    };
    is_in(0) & is_in(1) & is_in(2)
}

#[cold]
fn out_of_reach(
    node: &Node,
    reach_mm: &[(f64, f64); 3],
    options: &Options,
    line: u64,
    body: &[u8],
) -> GcodeError {
    let is_outside = |&axis: &usize| {
        let (low_mm, high_mm) = reach_mm[axis];
        !(low_mm..=high_mm).contains(&node.command_mm[axis])
    };
    let axis = (0..3).find(is_outside).unwrap_or(0);
    let ((low_mm, high_mm), position_mm) = (options.range_mm[axis], node.command_mm[axis]);
    let (text, axis) = (excerpt(body), AXIS_LETTERS[axis]);
    GcodeError::CommandOutsideRange { line, text, axis, position_mm, low_mm, high_mm }
}

/// Why a move can only be written in one piece.
fn cannot_be_split(a_move: &Move, body: &[u8]) -> Option<Unsupported> {
    match a_move.share {
        Share::Unclear => Some(Unsupported::ExtruderMode),
        Share::Lost => Some(Unsupported::ExtruderLost),
        _ if a_move.text.stops => {
            said_for_the_end(body).map(|(letter, code10)| Unsupported::StopOnMove { letter, code10 })
        }
        _ => None,
    }
}

fn mark_line(in_parentheses: bool, ending: &[u8], options: &Options) -> Vec<u8> {
    let (model, tolerance_mm) = (&options.model_name, options.tolerance_mm);
    let text = format!("{MARK}{model}, tolerance {tolerance_mm} mm, do not correct again");
    let comment = if in_parentheses { format!("({text})") } else { format!("; {text}") };
    [comment.as_bytes(), ending].concat()
}
