//! The stream: bytes in, corrected bytes out, in blocks of lines and in constant memory.

use memchr::memmem;
use rayon::prelude::*;

use super::error::GcodeError;
use super::extrusion::Share;
use super::frame::Effects;
use super::lines::{LineSpan, Lines};
use super::options::{OnUnsupported, Options};
use super::path::{Closeness, Node, PathMap, SplitError, distance, split};
use super::reader::{AXIS_LETTERS, Move, Reader, Step};
use super::report::{Summary, Warning, WarningKind, excerpt};
use super::unsupported::Unsupported;
use super::writer::{SourceLine, Writer};

/// Lines of a block at most.
const BLOCK_LINES: usize = 8_192;

/// Moves and knot crossings of a block at most: what bounds the number of pieces, and so the memory, of a block.
const BLOCK_WORK: usize = 8_192;

/// Moves that one thread takes at a time.
const MOVES_PER_TASK: usize = 64;

/// What begins the comment that says a program is corrected.
const MARK: &str = "corrected by geoerr: model ";

/// Share of the tolerance that is left to what the bound of [`split`] does not cover (terms beyond the quadratic, the
/// turn of a rounding error by the machine): together they are orders below it.
const MARGIN: f64 = 0.02;

/// Remaining error of a solved command, where the tolerance does not ask for less.
const NEWTON_MM: f64 = 1e-7;

/// Rewrites a program, block by block.
///
/// ```
/// # use geoerr_core::gcode::{Options, Rewriter};
/// # use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Table};
/// let mut errors = ErrorTables::default();
/// errors.set(Axis::X, Component::X, Table::new(vec![0.0, 400.0], vec![0.0, 0.4])?); // 1 mm/m too long
/// let machine = MachineModel::new(Chain::parse("wbXYZt")?, errors, [0.0; 3]);
/// let mut options = Options::for_range([(0.0, 400.0); 3]);
/// options.model_name = "3f2a".to_owned();
/// let mut rewriter = Rewriter::new(machine, options)?;
/// rewriter.push(b"G1 X100.1 Y0 Z0\n", true);
/// let mut out = Vec::new();
/// while rewriter.pull(&mut out)? {}
/// let mark = "; corrected by geoerr: model 3f2a, tolerance 0.005 mm, do not correct again\n";
/// assert_eq!(String::from_utf8(out)?, format!("{mark}G1 X100.0000 Y0 Z0\n"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Rewriter<M> {
    map: M,
    options: Options,
    lines: Lines,
    reader: Reader,
    writer: Writer,
    /// Kept from block to block, so that its memory is.
    block: Block,
    /// Where the last corrected move ended.
    last: Option<Node>,
    is_marked: bool,
    usual_ending: Vec<u8>,
    /// What ended the reading; later calls say it again.
    refusal: Option<GcodeError>,
    mark: memmem::Finder<'static>,
}

/// A line of a block.
#[derive(Debug)]
struct Item {
    line: LineSpan,
    number: u64,
    step: ItemStep,
}

#[derive(Debug)]
enum ItemStep {
    Pass(Effects),
    Correct {
        /// Which of the block's moves.
        index: usize,
        /// Whether the program's comments so far are in parentheses.
        comments_in_parentheses: bool,
    },
}

/// Some lines, the moves among them, and what becomes of those.
#[derive(Debug, Default)]
struct Block {
    items: Vec<Item>,
    moves: Vec<Move>,
    /// The end of each move, or the distance that the best command leaves.
    ends: Vec<Result<Node, f64>>,
    /// The nodes of each move.
    paths: Vec<Result<Nodes, SplitError>>,
}

/// The nodes of a move: its end alone, or the ends of its pieces.
#[derive(Debug)]
enum Nodes {
    Whole(Node),
    Pieces(Vec<Node>),
}

impl Nodes {
    fn as_slice(&self) -> &[Node] {
        match self {
            Self::Whole(node) => std::slice::from_ref(node),
            Self::Pieces(nodes) => nodes,
        }
    }
}

impl<M: PathMap> Rewriter<M> {
    /// A rewriter at the begin of a program.
    ///
    /// # Errors
    /// [`GcodeError::Option`].
    pub fn new(map: M, options: Options) -> Result<Self, GcodeError> {
        options.check()?;
        Ok(Self {
            reader: Reader::new(options.clone(), map.is_nominal(), map.needs()),
            map,
            options,
            lines: Lines::default(),
            writer: Writer::default(),
            block: Block::default(),
            last: None,
            is_marked: false,
            usual_ending: b"\n".to_vec(),
            refusal: None,
            mark: memmem::Finder::new(MARK),
        })
    }

    /// Takes more of the program; `is_last` with its end (which may be empty). Push no more than a few megabytes
    /// before pulling everything that can be pulled: this is what is kept in memory.
    pub fn push(&mut self, bytes: &[u8], is_last: bool) {
        self.lines.push(bytes, is_last);
    }

    /// Appends the next block to `out`; false where nothing is left to do until the next push.
    ///
    /// The result does not depend on the number of threads nor on how the program was cut into pushes.
    ///
    /// # Errors
    /// Every [`GcodeError`] but [`GcodeError::Option`]: that of the first line that cannot be done.
    pub fn pull(&mut self, out: &mut Vec<u8>) -> Result<bool, GcodeError> {
        let mut block = std::mem::take(&mut self.block);
        self.read_block(&mut block);
        self.solve_ends(&mut block);
        self.split_moves(&mut block);
        let outcome = self.write_block(&mut block, out);
        self.block = block;
        outcome?;
        match &self.refusal {
            Some(error) => Err(error.clone()),
            None => Ok(!self.block.items.is_empty()),
        }
    }

    /// Counts so far.
    pub fn summary(&self) -> &Summary {
        &self.reader.summary
    }

    /// Warnings so far, in the order of their first lines.
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings = self.reader.warnings.as_slice().to_vec();
        warnings.sort_by_key(|warning| (warning.line, warning.kind.name()));
        warnings
    }

    fn read_block(&mut self, block: &mut Block) {
        block.items.clear();
        block.moves.clear();
        let mut work = 0;
        let mut before_mm = self.last.map(|node| node.ideal_mm);
        while self.refusal.is_none() && block.items.len() < BLOCK_LINES && work < BLOCK_WORK {
            let line = match self.lines.next_line() {
                Ok(Some(line)) => line,
                Ok(None) => break,
                Err(error) => {
                    self.refusal = Some(error);
                    break;
                }
            };
            let body = line.body(self.lines.buffer());
            if self.mark.find(body).is_some() {
                let (line, text) = (self.reader.summary.lines + 1, excerpt(body));
                self.refusal = Some(GcodeError::AlreadyCorrected { line, text });
                break;
            }
            let step = match self.reader.read(body) {
                Ok(Step::Pass(effects)) => ItemStep::Pass(effects),
                Ok(Step::Correct(a_move)) => {
                    work += 1 + before_mm.map_or(0, |begin| self.knots_between(&begin, &a_move.end_mm));
                    before_mm = Some(a_move.end_mm);
                    block.moves.push(a_move);
                    ItemStep::Correct {
                        index: block.moves.len() - 1,
                        comments_in_parentheses: self.reader.has_parenthesis && !self.reader.has_semicolon,
                    }
                }
                Err(error) => {
                    self.refusal = Some(error);
                    break;
                }
            };
            block.items.push(Item { line, number: self.reader.summary.lines, step });
        }
    }

    fn knots_between(&self, a_mm: &[f64; 3], b_mm: &[f64; 3]) -> usize {
        let crossed = |axis: usize| {
            let knots = self.map.knots(axis);
            let place = |at: f64| knots.partition_point(|&knot| knot <= at);
            place(a_mm[axis]).abs_diff(place(b_mm[axis]))
        };
        (0..3).map(crossed).sum()
    }

    fn solve_ends(&self, block: &mut Block) {
        let (map, newton_mm) = (&self.map, self.newton_mm());
        let solve = |a_move: &Move| {
            let command_mm = map.command_for(&a_move.end_mm, &a_move.course.at(1.0), newton_mm)?;
            Ok(Node { share: 1.0, ideal_mm: a_move.end_mm, command_mm })
        };
        block.moves.par_iter().with_min_len(MOVES_PER_TASK).map(solve).collect_into_vec(&mut block.ends);
    }

    fn split_moves(&self, block: &mut Block) {
        let (moves, ends) = (&block.moves, &block.ends);
        let split_one = |index: usize| {
            let a_move = &moves[index];
            let end = ends[index].map_err(SplitError::NotSolved)?;
            let begin = match index.checked_sub(1) {
                Some(before) => ends[before].ok(),
                None => self.last,
            };
            // A move from a place that no corrected move has reached has no straight path to keep.
            let Some(begin) = begin.filter(|_| !a_move.is_first) else { return Ok(Nodes::Whole(end)) };
            let begin = Node { share: 0.0, ..begin };
            let pieces = split(&self.map, &a_move.course, &begin, &end, &self.closeness(a_move.is_inch))?;
            Ok(pieces.map_or(Nodes::Whole(end), Nodes::Pieces))
        };
        let indices = (0..moves.len()).into_par_iter().with_min_len(MOVES_PER_TASK);
        indices.map(split_one).collect_into_vec(&mut block.paths);
    }

    fn newton_mm(&self) -> f64 {
        NEWTON_MM.min(1e-3 * self.options.tolerance_mm)
    }

    fn closeness(&self, is_inch: bool) -> Closeness {
        let half_step_mm = self.options.half_step_mm(is_inch);
        Closeness {
            limit_mm: (1.0 - MARGIN) * self.options.tolerance_mm - 3.0_f64.sqrt() * half_step_mm,
            newton_mm: self.newton_mm(),
            shortest_mm: 20.0 * half_step_mm,
        }
    }

    fn write_block(&mut self, block: &mut Block, out: &mut Vec<u8>) -> Result<(), GcodeError> {
        let mut paths = block.paths.drain(..);
        for item in &block.items {
            match &item.step {
                ItemStep::Pass(effects) => {
                    let buffer = self.lines.buffer();
                    out.extend_from_slice(buffer.get(item.line.start..item.line.next).unwrap_or_default());
                    self.writer.pass(effects);
                }
                ItemStep::Correct { index, comments_in_parentheses } => {
                    if let Some(path) = paths.next()
                        && let Err(error) =
                            self.write_move(item, &block.moves[*index], path, *comments_in_parentheses, out)
                    {
                        self.refusal = Some(error.clone());
                        return Err(error);
                    }
                }
            }
            let ending = item.line.ending(self.lines.buffer());
            if !ending.is_empty() && ending != self.usual_ending {
                self.usual_ending = ending.to_vec();
            }
        }
        Ok(())
    }

    fn write_move(
        &mut self,
        item: &Item,
        a_move: &Move,
        path: Result<Nodes, SplitError>,
        comments_in_parentheses: bool,
        out: &mut Vec<u8>,
    ) -> Result<(), GcodeError> {
        let line = item.number;
        let body = item.line.body(self.lines.buffer());
        let text = || excerpt(body);
        if !self.map.is_nominal() && self.closeness(a_move.is_inch).limit_mm < 0.5 * self.options.tolerance_mm
        {
            let digits = self.options.word_digits(a_move.is_inch);
            let tolerance_mm = self.options.tolerance_mm;
            return Err(GcodeError::TooFewDigits { line, digits, tolerance_mm });
        }
        let mut nodes = path.map_err(|error| match error {
            SplitError::NotSolved(remaining_mm) => GcodeError::NotSolved { line, text: text(), remaining_mm },
            SplitError::NotHeld(deviation_mm) => GcodeError::NotHeld { line, text: text(), deviation_mm },
        })?;
        for node in nodes.as_slice() {
            self.check_command(node, line, body)?;
        }
        if let (Nodes::Pieces(pieces), Share::Unclear) = (&nodes, a_move.share)
            && let Some(&end) = pieces.last()
        {
            if self.options.on_unsupported == OnUnsupported::Refuse {
                let what = Unsupported::ExtruderMode;
                return Err(GcodeError::Unsupported { line, text: text(), what });
            }
            self.reader.warnings.add(WarningKind::NotSplit, line, body);
            nodes = Nodes::Whole(end);
        }
        let begin = out.len();
        let source = SourceLine {
            body,
            ending: item.line.ending(self.lines.buffer()),
            usual_ending: &self.usual_ending,
        };
        let written = self.writer.write(out, source, a_move, nodes.as_slice(), &self.options);
        if written.is_changed && !self.is_marked {
            self.is_marked = true;
            let mark = self.mark_line(comments_in_parentheses, source);
            out.splice(begin..begin, mark);
        }
        self.last = nodes.as_slice().last().copied();
        let summary = &mut self.reader.summary;
        summary.moves_out += nodes.as_slice().len() as u64;
        summary.moves_corrected += 1;
        summary.extrusion_out += written.extrusion;
        for ((low_mm, high_mm), end_mm) in summary.box_mm.iter_mut().zip(a_move.end_mm) {
            (*low_mm, *high_mm) = (low_mm.min(end_mm), high_mm.max(end_mm));
        }
        for node in nodes.as_slice() {
            let correction_mm = distance(&node.command_mm, &node.ideal_mm);
            if correction_mm > summary.largest_correction_mm {
                summary.largest_correction_mm = correction_mm;
                summary.largest_correction_line = line;
            }
        }
        Ok(())
    }

    fn check_command(&self, node: &Node, line: u64, body: &[u8]) -> Result<(), GcodeError> {
        let axes = AXIS_LETTERS.into_iter().zip(self.options.range_mm).zip(node.command_mm);
        for ((axis, (low_mm, high_mm)), position_mm) in axes {
            if !(low_mm - 1e-9..=high_mm + 1e-9).contains(&position_mm) {
                let text = excerpt(body);
                return Err(GcodeError::CommandOutsideRange {
                    line,
                    text,
                    axis,
                    position_mm,
                    low_mm,
                    high_mm,
                });
            }
        }
        Ok(())
    }

    fn mark_line(&self, in_parentheses: bool, source: SourceLine<'_>) -> Vec<u8> {
        let text = format!(
            "{MARK}{}, tolerance {} mm, do not correct again",
            self.options.model_name, self.options.tolerance_mm
        );
        let comment = if in_parentheses { format!("({text})") } else { format!("; {text}") };
        let ending = if source.ending.is_empty() { source.usual_ending } else { source.ending };
        [comment.as_bytes(), ending].concat()
    }
}
