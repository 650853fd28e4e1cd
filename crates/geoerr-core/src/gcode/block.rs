//! Some lines of a program on their way: read, solved, written.

use memchr::memmem;

use super::course::Course;
use super::error::GcodeError;
use super::frame::Effects;
use super::grid::Solved;
use super::lines::{LineSpan, Lines};
use super::options::Options;
use super::path::{Node, PathMap, SplitError};
use super::plain::PlainMove;
use super::reader::{Move, Reader, Step, Target};
use super::report::excerpt;
use super::usual::{Run, UsualMove};

/// Lines of a block at most: few enough that its moves stay in the cache from reading to writing, and so many that
/// threads seldom wait for each other.
const BLOCK_LINES: usize = 6_144;

/// Bytes of a block at most, but for its last line: places in it are counted in 32 bits.
const BLOCK_BYTES: usize = 1 << 22;

/// Moves and knot crossings of a block at most: what bounds the number of pieces, and so the memory, of a block.
const BLOCK_WORK: usize = 24_576;

/// Moves that are solved together.
pub const MOVES_PER_TASK: usize = 64;

/// What begins the comment that says a program is corrected.
pub const MARK: &str = "corrected by geoerr: model ";

/// A line of a block, or a run of lines.
#[derive(Debug)]
pub struct Item {
    start: u32,
    end: u32,
    next: u32,
    /// What becomes of it.
    pub step: ItemStep,
}

/// What becomes of a line, or of a run.
#[derive(Clone, Copy, Debug)]
pub enum ItemStep {
    /// It passes, and does nothing.
    Pass,
    /// It passes, and does what the next of the block's effects says.
    Do,
    /// The next of the block's moves.
    Correct {
        /// Whether the program's comments so far are in parentheses.
        comments_in_parentheses: bool,
    },
    /// The next of the block's runs.
    Run,
}

/// What becomes of a move beside its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// It is commanded by its end.
    Whole,
    /// It is commanded piece by piece: by these of its task's.
    Pieces {
        /// The first of them.
        first: u32,
        /// Behind the last of them.
        behind: u32,
    },
    /// It cannot be commanded.
    Refused(SplitError),
}

/// The end of a move and the way to it.
#[derive(Clone, Copy, Debug)]
pub struct EndOfMove<'a> {
    /// Which of the block's moves.
    pub index: usize,
    /// Where it ends.
    pub target: &'a Target,
    /// The command for it; None where it is refused.
    pub solved: Option<&'a Solved>,
    /// The way to it.
    pub way: Way,
}

/// Some lines, the moves among them, and what becomes of those. Kept and filled again, so that its memory is.
#[derive(Debug, Default)]
pub struct Block {
    text: Vec<u8>,
    /// Number of the first line, from 1.
    pub first_line: u64,
    /// The lines.
    pub items: Vec<Item>,
    /// What passed lines do.
    pub effects: Vec<Effects>,
    /// Where its moves end.
    pub targets: Vec<Target>,
    /// Those of them that are in no run.
    pub moves: Vec<Move>,
    /// Runs of usual moves.
    pub runs: Vec<Run>,
    /// Their moves.
    pub usual: Vec<UsualMove>,
    /// How each of them approaches its places; empty where the machine's errors do not depend on it.
    pub courses: Vec<Course>,
    /// The end of each move; None where it is refused.
    pub ends: Vec<Option<Solved>>,
    /// The way to it.
    pub ways: Vec<Way>,
    /// Pieces of moves that have several: those of each [task](MOVES_PER_TASK), one move's behind another's.
    pub pieces: Vec<Vec<Node>>,
    /// Which moves a correction turns an axis in, increasing.
    pub turns: Vec<usize>,
    /// What ended the reading behind these lines.
    pub refusal: Option<GcodeError>,
}

impl Block {
    /// A line without its end.
    #[inline]
    pub fn body(&self, item: &Item) -> &[u8] {
        self.text.get(item.start as usize..item.end as usize).unwrap_or_default()
    }

    /// The end of a line.
    #[inline]
    pub fn ending(&self, item: &Item) -> &[u8] {
        self.text.get(item.end as usize..item.next as usize).unwrap_or_default()
    }

    /// A line and all behind it.
    #[inline]
    pub fn from(&self, item: &Item) -> &[u8] {
        self.text.get(item.start as usize..).unwrap_or_default()
    }

    /// A usual move and all behind it.
    #[inline]
    pub fn text_of_usual(&self, usual: &UsualMove) -> &[u8] {
        self.text.get(usual.start as usize..).unwrap_or_default()
    }

    /// What passed lines do, each behind so many of its moves.
    pub fn passed(&self) -> impl Iterator<Item = (usize, &Effects)> {
        let (mut effects, mut runs, mut n_moves) = (self.effects.iter(), self.runs.iter(), 0);
        self.items.iter().filter_map(move |item| match item.step {
            ItemStep::Pass => None,
            ItemStep::Do => effects.next().map(|effects| (n_moves, effects)),
            ItemStep::Correct { .. } => {
                n_moves += 1;
                None
            }
            ItemStep::Run => {
                n_moves += runs.next().map_or(0, |run| run.n_moves);
                None
            }
        })
    }

    /// Where its moves end, one after the other.
    pub fn ends_of_moves(&self) -> impl Iterator<Item = EndOfMove<'_>> {
        let ends = self.targets.iter().zip(self.ends.iter().zip(&self.ways)).enumerate();
        ends.map(|(index, (target, (solved, &way)))| EndOfMove {
            index,
            target,
            solved: solved.as_ref(),
            way,
        })
    }

    /// Where one of its moves ends.
    pub fn end_of_move(&self, index: usize) -> EndOfMove<'_> {
        EndOfMove {
            index,
            target: &self.targets[index],
            solved: self.ends[index].as_ref(),
            way: self.ways[index],
        }
    }

    /// The nodes that a move is commanded by.
    ///
    /// # Errors
    /// Why there are none.
    #[inline]
    pub fn nodes_of<'a>(&'a self, end: &EndOfMove<'a>) -> Result<&'a [Node], SplitError> {
        match (end.way, end.solved) {
            (Way::Pieces { first, behind }, _) => {
                let pieces = self.pieces.get(end.index / MOVES_PER_TASK).map_or(&[][..], Vec::as_slice);
                Ok(pieces.get(first as usize..behind as usize).unwrap_or_default())
            }
            (Way::Whole, Some(solved)) => Ok(std::slice::from_ref(&solved.node)),
            (Way::Refused(error), _) => Err(error),
            (Way::Whole, None) => Err(SplitError::NotSolved(f64::NAN)),
        }
    }

    /// A line as it came.
    #[inline]
    pub fn whole_line(&self, item: &Item) -> &[u8] {
        self.text.get(item.start as usize..item.next as usize).unwrap_or_default()
    }
}

/// What a block still has room for.
struct Room {
    lines: usize,
    bytes: usize,
    /// Moves and knot crossings.
    work: usize,
}

impl Room {
    #[inline]
    fn is_left(&self) -> bool {
        self.lines > 0 && self.bytes > 0 && self.work > 0
    }

    /// A line may be longer than there is room for, a move more work: it is the last then.
    #[inline]
    fn take_line(&mut self, n_bytes: usize) {
        self.lines -= 1;
        self.bytes = self.bytes.saturating_sub(n_bytes);
    }

    #[inline]
    fn take_work(&mut self, work: usize) {
        self.work = self.work.saturating_sub(work);
    }
}

/// Reads a program block by block.
#[derive(Debug)]
pub struct BlockReader {
    /// Reads its lines.
    pub reader: Reader,
    plain: PlainMove,
    mark: memmem::Finder<'static>,
    /// Where the last move that will be corrected ends.
    before_mm: Option<[f64; 3]>,
    /// Smallest distance of neighbouring knots, of each axis.
    gap_mm: [f64; 3],
    has_refused: bool,
}

impl BlockReader {
    /// At the begin of a program.
    pub fn new(options: Options, map: &impl PathMap) -> Self {
        let gap_of = |axis: usize| {
            let gaps = map.knots(axis).windows(2).map(|pair| pair[1] - pair[0]);
            gaps.fold(f64::INFINITY, f64::min)
        };
        Self {
            reader: Reader::new(options, map),
            plain: PlainMove::default(),
            mark: memmem::Finder::new(MARK),
            before_mm: None,
            gap_mm: std::array::from_fn(gap_of),
            has_refused: false,
        }
    }

    /// Whether the program has been refused: no line behind is read.
    pub fn has_refused(&self) -> bool {
        self.has_refused
    }

    /// Fills a block; false where there were not enough lines.
    pub fn fill(&mut self, block: &mut Block, lines: &mut Lines, map: &impl PathMap) -> bool {
        block.items.clear();
        block.effects.clear();
        block.runs.clear();
        block.usual.clear();
        self.swap_moves(block);
        self.reader.targets.clear();
        self.reader.moves.clear();
        self.reader.courses.clear();
        block.refusal = None;
        block.first_line = self.reader.summary.lines + 1;
        let base = lines.next_start();
        let mut room = Room { lines: BLOCK_LINES, bytes: BLOCK_BYTES, work: BLOCK_WORK };
        let mut is_full = true;
        while !self.has_refused && room.is_left() {
            self.fill_run(block, lines, base, map, &mut room);
            if !room.is_left() {
                break;
            }
            match self.next_line(lines) {
                Ok(Some((line, step))) => {
                    let step = match step {
                        Step::Pass => ItemStep::Pass,
                        Step::Do(effects) => {
                            block.effects.push(*effects);
                            ItemStep::Do
                        }
                        Step::Correct => {
                            room.take_work(1 + self.crossings(map));
                            let reader = &self.reader;
                            let comments_in_parentheses = reader.comments_in_parentheses();
                            ItemStep::Correct { comments_in_parentheses }
                        }
                    };
                    // A block has a few megabytes.
                    let from_base = |place: usize| (place - base) as u32;
                    let (start, end, next) =
                        (from_base(line.start), from_base(line.end), from_base(line.next));
                    block.items.push(Item { start, end, next, step });
                    room.take_line(line.next - line.start);
                }
                Ok(None) => {
                    is_full = false;
                    break;
                }
                Err(error) => {
                    self.has_refused = true;
                    block.refusal = Some(error);
                }
            }
        }
        self.swap_moves(block);
        block.text.clear();
        block.text.extend_from_slice(lines.buffer().get(base..lines.next_start()).unwrap_or_default());
        is_full && !self.has_refused
    }

    /// Reads usual moves as long as they come one behind another.
    #[inline(always)]
    fn fill_run(
        &mut self,
        block: &mut Block,
        lines: &mut Lines,
        base: usize,
        map: &impl PathMap,
        room: &mut Room,
    ) {
        let Some((mut run, origin_mm)) = self.reader.begin_run() else { return };
        while room.is_left() {
            let start = lines.next_start();
            let rest = lines.buffer().get(start..).unwrap_or_default();
            let Some(mut usual) = UsualMove::read(rest) else { break };
            if !self.reader.take_usual(&mut usual, origin_mm) {
                break;
            }
            usual.start = (start - base) as u32;
            lines.skip_line(start + usize::from(usual.length), start + usual.length_with_end());
            block.usual.push(usual);
            run.n_moves += 1;
            room.take_line(usual.length_with_end());
            room.take_work(1 + self.crossings(map));
        }
        if run.n_moves > 0 {
            block.items.push(Item { start: 0, end: 0, next: 0, step: ItemStep::Run });
            block.runs.push(run);
        }
    }

    /// The reader fills the block's own memory.
    fn swap_moves(&mut self, block: &mut Block) {
        std::mem::swap(&mut self.reader.targets, &mut block.targets);
        std::mem::swap(&mut self.reader.moves, &mut block.moves);
        std::mem::swap(&mut self.reader.courses, &mut block.courses);
    }

    /// The next line; None where it has not ended yet.
    #[inline]
    fn next_line(&mut self, lines: &mut Lines) -> Result<Option<(LineSpan, Step)>, GcodeError> {
        let start = lines.next_start();
        let rest = lines.buffer().get(start..).unwrap_or_default();
        let plain = &mut self.plain;
        if plain.read(rest)
            && let Some(step) = self.reader.read_plain(plain, rest.get(..plain.length).unwrap_or_default())
        {
            let line = lines.skip_line(start + plain.length, start + plain.length_with_end);
            return step.map(|step| Some((line, step)));
        }
        let Some(line) = lines.next_line()? else { return Ok(None) };
        let body = line.body(lines.buffer());
        if self.mark.find(body).is_some() {
            let (line, text) = (self.reader.summary.lines + 1, excerpt(body));
            return Err(GcodeError::AlreadyCorrected { line, text });
        }
        let step = self.reader.read(body)?;
        Ok(Some((line, step)))
    }

    /// Knots on the way to the end of the last move that was read.
    #[inline]
    fn crossings(&mut self, map: &impl PathMap) -> usize {
        let Some(end_mm) = self.reader.targets.last().map(|target| target.end_mm) else { return 0 };
        let Some(begin_mm) = self.before_mm.replace(end_mm) else { return 0 };
        let crossed = |axis: usize| {
            if (end_mm[axis] - begin_mm[axis]).abs() < self.gap_mm[axis] {
                // At most one: less than the move itself costs.
                return 0;
            }
            let knots = map.knots(axis);
            let place = |at: f64| knots.partition_point(|&knot| knot <= at);
            place(begin_mm[axis]).abs_diff(place(end_mm[axis]))
        };
        (0..3).map(crossed).sum()
    }
}
