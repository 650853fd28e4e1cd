//! A tape run over rows, a block at a time: one pass through the steps for every 256 rows, no allocation between them.

use std::ops::Range;

use rayon::prelude::*;

use super::functions::{Binary, Unary, select};
use super::memory::{LagRow, Memory, WindupRow, lag, lag_tangent, windup, windup_tangent};
use super::rows::Rows;
use super::tape::{Action, Operand, Step, Tape};

/// Rows done at once: a register of 2 kB, so that those of a usual formula stay in the first-level cache.
const BLOCK: usize = 256;
/// Rows of one unit of parallel work. Fewer than two units are done by the calling thread.
const UNIT: usize = 4096;

/// Runs a tape over a range of rows. `out` holds one column of `range.len()` numbers after another, one for each slot.
///
/// Results do not depend on the number of threads: every row is computed by the same operations in the same order.
pub(super) fn run(
    tape: &Tape,
    rows: &Rows<'_>,
    range: Range<usize>,
    coefficients: &[f64],
    inner: &[f64],
    out: &mut [f64],
) {
    out.fill(0.0);
    if range.is_empty() || tape.n_slots == 0 {
        return;
    }
    let uniforms = tape.uniforms(inner);
    let shared = Shared { tape, rows, uniforms: &uniforms, coefficients };
    let mut columns: Vec<&mut [f64]> = out.chunks_exact_mut(range.len()).collect();
    let mut units = Vec::new();
    let mut first = range.start;
    while first < range.end {
        let end = if tape.has_memory() {
            // Whole sequences only: what they remember cannot be cut.
            let mut end = rows.sequence_end(first);
            while end < range.end && end - first < UNIT {
                end = rows.sequence_end(end);
            }
            end.min(range.end)
        } else {
            (first + UNIT).min(range.end)
        };
        let mut own = Vec::with_capacity(columns.len());
        for column in &mut columns {
            let (mine, rest) = std::mem::take(column).split_at_mut(end - first);
            own.push(mine);
            *column = rest;
        }
        units.push((first..end, own));
        first = end;
    }
    if units.len() < 2 {
        units.into_iter().for_each(|(range, mut out)| shared.unit(range, &mut out));
    } else {
        units.into_par_iter().for_each(|(range, mut out)| shared.unit(range, &mut out));
    }
}

type Register = [f64; BLOCK];

struct Shared<'a> {
    tape: &'a Tape,
    rows: &'a Rows<'a>,
    uniforms: &'a [f64],
    coefficients: &'a [f64],
}

impl Shared<'_> {
    fn unit(&self, range: Range<usize>, out: &mut [&mut [f64]]) {
        let mut registers: Vec<Register> = vec![[0.0; BLOCK]; self.tape.n_registers];
        let mut memories = vec![Memory::Fresh; self.tape.n_memories];
        let has_memory = self.tape.has_memory();
        let mut at = if has_memory { self.rows.sequence_start(range.start) } else { range.start };
        while at < range.end {
            let mut end = (at + BLOCK).min(range.end);
            if has_memory {
                end = end.min(self.rows.sequence_end(at));
                if at == self.rows.sequence_start(at) {
                    memories.fill(Memory::Fresh);
                }
            }
            self.block(at..end, range.start, &mut registers, &mut memories, out);
            at = end;
        }
    }

    /// One block; rows before `first_wanted` only leave their memory behind.
    fn block(
        &self,
        block: Range<usize>,
        first_wanted: usize,
        registers: &mut [Register],
        memories: &mut [Memory],
        out: &mut [&mut [f64]],
    ) {
        let n = block.len();
        for step in &self.tape.steps {
            match *step {
                Step::Do { action, into } => {
                    let (before, rest) = registers.split_at_mut(into);
                    let Some((target, after)) = rest.split_first_mut() else { continue };
                    let lanes = Lanes { shared: self, block: &block, before, after };
                    lanes.act(action, memories, &mut target[..n]);
                }
                Step::Emit { slot, coefficient, value } => {
                    if block.end <= first_wanted {
                        continue;
                    }
                    let skipped = first_wanted.saturating_sub(block.start);
                    let first = block.start + skipped - first_wanted;
                    let target = &mut out[slot][first..first + n - skipped];
                    let lanes = Lanes { shared: self, block: &block, before: registers, after: &[] };
                    let factor = coefficient.map_or(1.0, |index| self.coefficients[index]);
                    match lanes.get(value) {
                        Lane::Rows(values) => {
                            for (sum, value) in target.iter_mut().zip(&values[skipped..]) {
                                *sum += factor * value;
                            }
                        }
                        Lane::One(value) => {
                            let value = factor * value;
                            target.iter_mut().for_each(|sum| *sum += value);
                        }
                    }
                }
            }
        }
    }
}

/// An operand for a block of rows.
#[derive(Clone, Copy)]
enum Lane<'a> {
    Rows(&'a [f64]),
    One(f64),
}

impl Lane<'_> {
    #[inline(always)]
    fn at(self, row: usize) -> f64 {
        match self {
            Self::Rows(values) => values[row],
            Self::One(value) => value,
        }
    }
}

/// Where the operands of a step are: all registers but the one that is written.
struct Lanes<'a> {
    shared: &'a Shared<'a>,
    block: &'a Range<usize>,
    before: &'a [Register],
    after: &'a [Register],
}

impl<'a> Lanes<'a> {
    fn get(&self, operand: Operand) -> Lane<'a> {
        let n = self.block.len();
        match operand {
            Operand::Variable(index) => Lane::Rows(&self.shared.rows.variables[index][self.block.clone()]),
            Operand::Uniform(index) => Lane::One(self.shared.uniforms[index]),
            Operand::Register(index) if index < self.before.len() => Lane::Rows(&self.before[index][..n]),
            Operand::Register(index) => Lane::Rows(&self.after[index - self.before.len() - 1][..n]),
        }
    }

    fn act(&self, action: Action, memories: &mut [Memory], target: &mut [f64]) {
        match action {
            Action::Unary(operation, a) => unary(operation, self.get(a), target),
            Action::Binary(operation, a, b) => binary(operation, self.get(a), self.get(b), target),
            Action::Select([condition, a, b]) => {
                let (condition, a, b) = (self.get(condition), self.get(a), self.get(b));
                for (row, value) in target.iter_mut().enumerate() {
                    *value = select(condition.at(row), a.at(row), b.at(row));
                }
            }
            Action::Lag { u, tau, is_held, memory } => {
                let (u, tau) = (self.get(u), self.get(tau));
                for (row, value) in target.iter_mut().enumerate() {
                    *value = lag(&mut memories[memory], self.lag_row(row, u, tau), is_held);
                }
            }
            Action::LagTangent { u, tau, y, du, dtau, kind, memory } => {
                let (u, tau, y) = (self.get(u), self.get(tau), self.get(y));
                let (du, dtau) = (self.get(du), self.get(dtau));
                for (row, value) in target.iter_mut().enumerate() {
                    let (seen, by) = (self.lag_row(row, u, tau), (du.at(row), dtau.at(row)));
                    let memory = &mut memories[memory];
                    *value = lag_tangent(memory, seen, y.at(row), by, kind.is_held, kind.is_own_row);
                }
            }
            Action::Windup { d, s, lambda, memory } => {
                let (d, s, lambda) = (self.get(d), self.get(s), self.get(lambda));
                for (row, value) in target.iter_mut().enumerate() {
                    let seen = WindupRow { d: d.at(row), s: s.at(row), lambda: lambda.at(row) };
                    *value = windup(&mut memories[memory], seen);
                }
            }
            Action::WindupTangent { d, s, lambda, ds, dlambda, is_own_row, memory } => {
                let (d, s, lambda) = (self.get(d), self.get(s), self.get(lambda));
                let (ds, dlambda) = (self.get(ds), self.get(dlambda));
                for (row, value) in target.iter_mut().enumerate() {
                    let seen = WindupRow { d: d.at(row), s: s.at(row), lambda: lambda.at(row) };
                    let by = (ds.at(row), dlambda.at(row));
                    *value = windup_tangent(&mut memories[memory], seen, by, is_own_row);
                }
            }
        }
    }

    fn lag_row(&self, row: usize, u: Lane<'_>, tau: Lane<'_>) -> LagRow {
        LagRow { t: self.shared.rows.time(self.block.start + row), u: u.at(row), tau: tau.at(row) }
    }
}

fn unary(operation: Unary, a: Lane<'_>, target: &mut [f64]) {
    /// One loop for each operation, so that the choice is made once for a block and not once for a row.
    macro_rules! each {
        ($($name:ident),*) => {
            match operation {
                $(Unary::$name => match a {
                    Lane::Rows(a) => {
                        target.iter_mut().zip(a).for_each(|(value, &a)| *value = Unary::$name.apply(a));
                    }
                    Lane::One(a) => target.fill(Unary::$name.apply(a)),
                }),*
            }
        };
    }
    each!(Negate, Sin, Cos, Tan, Asin, Acos, Atan, Exp, Log, Sqrt, Sinh, Cosh, Tanh, Abs, Sign, Step);
}

fn binary(operation: Binary, a: Lane<'_>, b: Lane<'_>, target: &mut [f64]) {
    macro_rules! each {
        ($($name:ident),*) => {
            match operation {
                $(Binary::$name => zipped(a, b, target, |a, b| Binary::$name.apply(a, b))),*
            }
        };
    }
    each!(Add, Subtract, Multiply, Divide, Power, Atan2, Min, Max, Less, LessEqual, Equal, NotEqual, Decay);
}

#[inline(always)]
fn zipped(a: Lane<'_>, b: Lane<'_>, target: &mut [f64], operation: impl Fn(f64, f64) -> f64) {
    match (a, b) {
        (Lane::Rows(a), Lane::Rows(b)) => {
            for ((value, &a), &b) in target.iter_mut().zip(a).zip(b) {
                *value = operation(a, b);
            }
        }
        (Lane::Rows(a), Lane::One(b)) => {
            target.iter_mut().zip(a).for_each(|(value, &a)| *value = operation(a, b));
        }
        (Lane::One(a), Lane::Rows(b)) => {
            target.iter_mut().zip(b).for_each(|(value, &b)| *value = operation(a, b));
        }
        (Lane::One(a), Lane::One(b)) => target.fill(operation(a, b)),
    }
}
