//! The stream: bytes in, corrected bytes out, in blocks of lines and in constant memory.
//!
//! Three blocks are under way at a time: while one is read, the one before is solved and the one before that is written.
//! So a program keeps several cores busy although its lines have to be read one after the other, and written so.

use super::block::{Block, BlockReader};
use super::block_writer::BlockWriter;
use super::course::Extremes;
use super::error::GcodeError;
use super::lines::Lines;
use super::options::Options;
use super::path::PathMap;
use super::report::{Movers, Summary, Warning};
use super::solver::Solver;

/// A call gives about as many bytes: calls from outside the threads that do the work are not free.
const PULL_BYTES: usize = 1 << 20;

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
    reader: BlockReader,
    solver: Solver,
    writer: BlockWriter,
    /// The one that is read, the one that is solved, the one that is written.
    blocks: [Block; 3],
    /// No block could be filled since the last push.
    has_run_out: bool,
    /// What ended the work; later calls say it again.
    refusal: Option<GcodeError>,
}

impl<M: PathMap + Send> Rewriter<M> {
    /// A rewriter at the begin of a program.
    ///
    /// # Errors
    /// [`GcodeError::Option`].
    pub fn new(map: M, options: Options) -> Result<Self, GcodeError> {
        options.check()?;
        Ok(Self {
            reader: BlockReader::new(options.clone(), &map),
            solver: Solver::new(&map, &options),
            writer: BlockWriter::new(&options),
            map,
            options,
            lines: Lines::default(),
            blocks: Default::default(),
            has_run_out: false,
            refusal: None,
        })
    }

    /// Takes more of the program; `is_last` with its end (which may be empty). Push no more than a few megabytes
    /// before pulling everything that can be pulled: this is what is kept in memory.
    pub fn push(&mut self, bytes: &[u8], is_last: bool) {
        self.lines.push(bytes, is_last);
        self.has_run_out = false;
    }

    /// Appends what comes next to `out`; false where nothing is left to do until the next push. What has not been
    /// pulled by then comes with what is pushed next, at the latest with the end.
    ///
    /// The result does not depend on the number of threads nor on how the program was cut into pushes.
    ///
    /// # Errors
    /// Every [`GcodeError`] but [`GcodeError::Option`]: that of the first line that cannot be done.
    pub fn pull(&mut self, out: &mut Vec<u8>) -> Result<bool, GcodeError> {
        // Among the threads that do the work once, and not for each block.
        rayon::scope(|_| self.pull_here(out))
    }

    fn pull_here(&mut self, out: &mut Vec<u8>) -> Result<bool, GcodeError> {
        let enough = out.len() + PULL_BYTES;
        let mut has_worked = false;
        while out.len() < enough {
            if let Some(error) = &self.refusal {
                return Err(error.clone());
            }
            let ends_here = !self.lines.is_open() || self.reader.has_refused();
            let is_under_way =
                self.blocks[..2].iter().any(|block| !block.items.is_empty() || block.refusal.is_some());
            if self.has_run_out && !(ends_here && is_under_way) {
                break;
            }
            self.step(out);
            has_worked = true;
        }
        Ok(has_worked)
    }

    /// Reads a block, solves the one before and writes the one before that.
    fn step(&mut self, out: &mut Vec<u8>) {
        let Self { map, options, lines, reader, solver, writer, blocks, .. } = self;
        let map = &*map;
        blocks.rotate_right(1);
        let [to_read, to_solve, to_write] = blocks;
        let closeness = *solver.closenesses();
        let (is_full, (outcome, ())) = rayon::join(
            || reader.fill(to_read, lines, map),
            || {
                rayon::join(
                    || writer.write(to_write, &closeness, options, map.is_nominal(), out),
                    || solver.solve(to_solve, map),
                )
            },
        );
        self.has_run_out = !is_full;
        self.refusal = outcome.err();
    }

    /// Counts so far; while the program is under way those of reading are ahead of those of writing.
    pub fn summary(&self) -> Summary {
        self.reader.reader.summary.plus(&self.writer.summary)
    }

    /// What the motion of the axes came to so far, where the model follows any; as of a program of no moves else.
    pub fn extremes(&self) -> Extremes {
        self.reader.reader.extremes()
    }

    /// Commands that may move the machine, so far.
    pub fn movers(&self) -> &Movers {
        &self.reader.reader.movers
    }

    /// Warnings so far, in the order of their first lines.
    pub fn warnings(&self) -> Vec<Warning> {
        let both = [&self.reader.reader.warnings, &self.writer.warnings];
        let mut warnings: Vec<Warning> = both.into_iter().flat_map(|some| some.as_slice()).cloned().collect();
        warnings.sort_by_key(|warning| (warning.line, warning.kind.name()));
        warnings
    }
}
