//! Formulas: parsed once, evaluated over blocks of rows, with derivatives; nothing in them can do harm.
//!
//! A formula is a function of variables (columns of the data), linear coefficients and inner parameters. It is linear
//! and homogeneous in the coefficients, `f = Σ_j θ_j g_j(variables; φ)`, and refused at the place where it is not.
//!
//! # The language
//! | what | meaning |
//! |---|---|
//! | `+ - * /` | as usual, from the left |
//! | `^` | power, from the right, before a sign: `-2^2` = −4, `2^3^2` = 512, `2^-1` = 0.5 |
//! | `< <= > >= == !=` | 1 where it holds, 0 where not; weaker than `+`; not chained |
//! | `sin cos tan asin acos atan sinh cosh tanh exp log sqrt abs` | angles in rad, `log` to base e |
//! | `atan2(y, x)`, `min(a, b, ...)`, `max(a, b, ...)` | |
//! | `sign(u)` | −1, 0, 1 |
//! | `step(u)` | 0 for u < 0, 1 for u ≥ 0 |
//! | `where(condition, a, b)` | a where the condition is not 0, else b |
//! | `lag(u, tau)` | what follows u with a first-order lag, along a sequence of rows |
//! | `windup(lambda)` | reversal error that fills with travel, for b = 1; follows `d` and `s` |
//! | `pi`, `2.5e-3` | numbers |
//!
//! A variable that is NaN (unknown) makes the result NaN, whatever it is multiplied with or compared to; only the branch
//! of a `where` that is not taken may be unknown. Inside `lag()` the names `v_x v_y v_z` mean `mean_v_x ...`, the mean
//! speed since the previous row. The head of `memory.rs` says how `lag` and `windup` go from row to row.
//!
//! # Names
//! [`Definitions`] are texts that stand for names and are inlined (`q` = `x`, `T` = `temp_bed - 20`). In the formula a
//! name is a parameter, else a definition, else a variable; in a definition it is a variable, else a definition, else a
//! parameter.
//!
//! # Derivatives
//! By the coefficients: the columns `g_j`. By the inner parameters, through `lag`'s time constant and `windup`'s length
//! and along the whole sequence. By x, y and z of the row itself, what earlier rows left behind held fixed. All are exact
//! (chain rule, forward), and share every intermediate value. Where a function has a corner (`abs`, `min`, `max`) the
//! derivative is that of one side, where it jumps (`sign`, `step`, comparisons) it is 0.
//!
//! # Safety
//! A text is at most 4,096 bytes, nests at most 64 deep, and makes at most 65,536 distinct operations with all its
//! derivatives. Neither parsing nor evaluation recurses deeper than that nesting; definitions are lowered once and shared.
//!
//! # Why not a crate
//! Microseconds for 10,000 rows on one thread of a busy two-core machine, as `cargo bench -p geoerr-bench --bench
//! expression` prints them (thermal expansion, a sine and a cosine of position, a reversal that decays with travel):
//!
//! | | expansion | periodic | reversal |
//! |---|---|---|---|
//! | value: this module | 21 | 265 | 195 |
//! | written out in Rust | 21 | 133 | 131 |
//! | exmex 0.21 | 339 | 1376 | 958 |
//! | fasteval 0.2 | 714 | 1570 | 1878 |
//! | by the inner parameter: this module | 34 | 342 | 225 |
//! | exmex 0.21 | 407 | 2198 | 1769 |
//!
//! Both evaluate one row at a time; fasteval has no derivatives; neither has sequences, definitions, linearity in the
//! coefficients, or refusals that mark the place. evalexpr is AGPL.
//!
//! # Verified
//! `tests/expression/`: an independent tree walk, finite differences for every function, analytic lags, random bytes
//! and random tokens. `tests/expression/` of the Python package: NumPy and SciPy.

mod block;
mod derive;
mod error;
mod functions;
mod graph;
mod lexer;
mod lower;
mod memory;
mod names;
mod point;
mod rows;
mod syntax;
mod tape;

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use error::{ExpressionError, Problem, RowsError};
pub(crate) use functions::decay;
pub use rows::Rows;

use derive::{Seed, Settled, settled, tangents};
use graph::{Graph, Node, NodeId, Windup};
use lower::{Form, lower};
use point::{PointTape, PointTerm};
use tape::{Tape, Term};

/// Longest text that is read, in bytes.
pub const MAX_TEXT_BYTES: usize = 4096;
/// Deepest nesting of brackets, signs and powers, and of definitions.
pub const MAX_NESTING: usize = 64;
/// Most distinct operations of a formula with all its derivatives.
pub const MAX_NODES: usize = 65_536;

/// The names that a formula may use besides its definitions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Symbols {
    /// Columns of the data. Names that cannot stand in a formula are harmless: nothing can mention them.
    pub variables: Vec<String>,
    /// Linear coefficients.
    pub coefficients: Vec<String>,
    /// Inner parameters.
    pub inner: Vec<String>,
}

/// Names that stand for texts over the variables.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Definitions {
    texts: BTreeMap<String, String>,
}

impl Definitions {
    fn get<'a>(&'a self, name: &str) -> Option<(&'a str, &'a str)> {
        self.texts.get_key_value(name).map(|(name, text)| (name.as_str(), text.as_str()))
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        self.texts.keys().map(String::as_str)
    }
}

impl<N: Into<String>, T: Into<String>> FromIterator<(N, T)> for Definitions {
    fn from_iter<I: IntoIterator<Item = (N, T)>>(pairs: I) -> Self {
        Self { texts: pairs.into_iter().map(|(name, text)| (name.into(), text.into())).collect() }
    }
}

/// A formula, ready to be evaluated. Immutable: any number of threads may use it; a clone shares it.
///
/// # Examples
/// ```
/// use geoerr_core::expression::{Definitions, Expression, Rows, Symbols};
/// let names = |names: &[&str]| names.iter().map(|name| name.to_string()).collect::<Vec<_>>();
/// let symbols = Symbols {
///     variables: names(&["x", "temp"]),
///     coefficients: names(&["alpha"]),
///     inner: names(&["q_fixed"]),
/// };
/// let definitions = Definitions::from_iter([("q", "x"), ("T", "temp - 20")]);
/// let growth = Expression::parse("alpha*T*(q - q_fixed)", &symbols, &definitions)?;
///
/// let (x, temp) = ([0.0, 100.0], [30.0, 30.0]);
/// let rows = Rows { variables: &[&x, &temp], n_rows: 2, starts: &[], t: None };
/// let mut mm = [0.0; 2];
/// growth.evaluate(&rows, 0..2, &[1e-5], &[50.0], &mut mm)?;
/// assert!((mm[1] - 1e-5 * 10.0 * 50.0).abs() < 1e-18);
///
/// let refused = Expression::parse("alpha*T*(qq - q_fixed)", &symbols, &definitions).unwrap_err();
/// assert_eq!(&refused.text[refused.span], "qq");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "Source", into = "Source")]
pub struct Expression {
    shared: Arc<Compiled>,
}

/// What a formula is parsed from: all that is kept of one that is stored.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Source {
    text: String,
    symbols: Symbols,
    definitions: Definitions,
}

impl TryFrom<Source> for Expression {
    type Error = ExpressionError;

    fn try_from(source: Source) -> Result<Self, ExpressionError> {
        Self::parse(&source.text, &source.symbols, &source.definitions)
    }
}

impl From<Expression> for Source {
    fn from(expression: Expression) -> Self {
        expression.shared.source.clone()
    }
}

#[derive(Debug)]
struct Compiled {
    source: Source,
    variables_used: Vec<usize>,
    coefficients_used: Vec<usize>,
    columns: Tape,
    value: Tape,
    by_inner: Tape,
    by_position: Tape,
    point: PointTape,
    windups: Vec<CompiledWindup>,
}

/// A wind-up of a formula.
#[derive(Debug)]
struct CompiledWindup {
    direction: Option<usize>,
    travel: Option<usize>,
    /// None where it differs from row to row.
    length: Option<PointTape>,
}

/// What a wind-up of a formula follows, for whoever knows the strokes before a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowedWindup {
    /// Index of the variable that is its direction; none where that is a formula.
    pub direction: Option<usize>,
    /// Index of the variable that is its travel since the reversal, likewise.
    pub travel: Option<usize>,
    /// Its length; none where that differs from position to position.
    pub length_mm: Option<f64>,
}

impl Expression {
    /// Whether two are one formula.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared) || self.shared.source == other.shared.source
    }

    /// Parses a formula.
    ///
    /// Where coefficients are declared, at least one must be used, unless the formula is 0; without any, a formula is a
    /// plain function of variables and inner parameters.
    ///
    /// # Errors
    /// [`ExpressionError`] marks the place of anything that is not understood.
    pub fn parse(text: &str, symbols: &Symbols, definitions: &Definitions) -> Result<Self, ExpressionError> {
        let lowered = lower(text, symbols, definitions)?;
        let mut graph = lowered.graph;
        let parts: Vec<PointTerm> = match lowered.form {
            Form::Free(node) => vec![(None, node)],
            Form::Linear(parts) => {
                parts.into_iter().map(|(index, node)| (Some(index as usize), node)).collect()
            }
        };
        let roots: Vec<NodeId> = parts.iter().map(|&(_, node)| node).collect();
        let is_needed = graph.needed_by(roots.iter().copied());
        let mut variables_used: Vec<usize> = (graph.ids().filter(|id| is_needed[id.index()]))
            .filter_map(|id| match graph.node(id) {
                Node::Variable(index) => Some(index as usize),
                _ => None,
            })
            .collect();
        variables_used.sort_unstable();
        let position = ["x", "y", "z"]
            .map(|name| symbols.variables.iter().position(|variable| variable == name).map(|at| at as u32));

        let Settled { graph: mut single, roots: single_roots, windups } = settled(&graph, &roots);
        let by_inner =
            derived(&mut graph, &parts, (0..symbols.inner.len()).map(|m| Seed::Inner(m as u32)).map(Some));
        let by_position = derived(&mut graph, &parts, position.map(|at| at.map(Seed::Variable)));
        let single_parts: Vec<PointTerm> =
            parts.iter().zip(&single_roots).map(|(part, &node)| (part.0, node)).collect();
        // The place on the work that the tool stands over moves with it.
        let gradient = [["x", "bed_x"], ["y", "bed_y"], ["z", "z"]].map(|[name, place]| {
            let mut names = vec![name, place];
            names.dedup();
            let at = |name| symbols.variables.iter().position(|variable| variable == name);
            let seeds: Vec<Option<Seed>> =
                names.into_iter().map(|name| at(name).map(|at| Seed::Variable(at as u32))).collect();
            derived(&mut single, &single_parts, seeds)
                .into_iter()
                .map(|term| (term.coefficient, term.node))
                .collect::<Vec<PointTerm>>()
        });
        if graph.is_overfull() || single.is_overfull() {
            return Err(ExpressionError::new(text, None, (Problem::TooComplex, 0..text.len())));
        }
        let value: Vec<Term> =
            parts.iter().map(|&(coefficient, node)| Term { slot: 0, coefficient, node }).collect();
        let columns: Vec<Term> = (parts.iter())
            .filter_map(|&(index, node)| index.map(|slot| Term { slot, coefficient: None, node }))
            .collect();
        let compiled = Compiled {
            source: Source {
                text: text.to_owned(),
                symbols: symbols.clone(),
                definitions: definitions.clone(),
            },
            variables_used,
            coefficients_used: parts.iter().filter_map(|part| part.0).collect(),
            columns: Tape::compile(&graph, symbols.coefficients.len(), &columns),
            value: Tape::compile(&graph, 1, &value),
            by_inner: Tape::compile(&graph, symbols.inner.len(), &by_inner),
            by_position: Tape::compile(&graph, 3, &by_position),
            point: PointTape::compile(&single, &single_parts, &gradient),
            windups: windups.iter().map(|windup| CompiledWindup::new(&single, windup)).collect(),
        };
        Ok(Self { shared: Arc::new(compiled) })
    }

    /// The formula as it was written.
    pub fn text(&self) -> &str {
        &self.shared.source.text
    }

    /// The names that it was parsed with.
    pub fn symbols(&self) -> &Symbols {
        &self.shared.source.symbols
    }

    /// Names of the coefficients, used or not: the order of the columns.
    pub fn coefficients(&self) -> &[String] {
        &self.shared.source.symbols.coefficients
    }

    /// Names of the inner parameters, used or not.
    pub fn inner(&self) -> &[String] {
        &self.shared.source.symbols.inner
    }

    /// Names of the variables that the formula needs, in the order of the symbols; inside `lag()` the mean speeds.
    pub fn variables_used(&self) -> impl Iterator<Item = &str> {
        self.shared.variables_used.iter().map(|&index| self.shared.source.symbols.variables[index].as_str())
    }

    /// Indices of the variables that the formula needs, rising.
    pub fn variable_indices(&self) -> &[usize] {
        &self.shared.variables_used
    }

    /// Indices of the coefficients that the formula uses, rising; the columns of the others are 0.
    pub fn coefficients_used(&self) -> &[usize] {
        &self.shared.coefficients_used
    }

    /// Whether a row's value depends on the rows before it (`lag`, `windup`).
    pub fn needs_order(&self) -> bool {
        self.shared.value.has_memory()
    }

    /// Whether no operation on rows has a corner or a jump (`abs`, `step`, `min`, comparisons …).
    pub fn is_smooth(&self) -> bool {
        self.shared.columns.is_smooth()
    }

    /// `∂f/∂θ_j` for the rows of a range, column after column: `out` has `n_coefficients · range.len()` numbers.
    ///
    /// Where rows depend on those before them, a range that begins within a sequence costs the rows from its start.
    ///
    /// # Errors
    /// [`RowsError`] for lengths that do not fit.
    pub fn coefficient_columns(
        &self,
        rows: &Rows<'_>,
        range: Range<usize>,
        inner: &[f64],
        out: &mut [f64],
    ) -> Result<(), RowsError> {
        self.run(&self.shared.columns, rows, range, None, inner, out)
    }

    /// The value for the rows of a range.
    ///
    /// # Errors
    /// [`RowsError`] for lengths that do not fit.
    pub fn evaluate(
        &self,
        rows: &Rows<'_>,
        range: Range<usize>,
        coefficients: &[f64],
        inner: &[f64],
        out: &mut [f64],
    ) -> Result<(), RowsError> {
        self.run(&self.shared.value, rows, range, Some(coefficients), inner, out)
    }

    /// `∂f/∂φ_m` for the rows of a range, column after column: `out` has `n_inner · range.len()` numbers.
    ///
    /// # Errors
    /// [`RowsError`] for lengths that do not fit.
    pub fn inner_derivatives(
        &self,
        rows: &Rows<'_>,
        range: Range<usize>,
        coefficients: &[f64],
        inner: &[f64],
        out: &mut [f64],
    ) -> Result<(), RowsError> {
        self.run(&self.shared.by_inner, rows, range, Some(coefficients), inner, out)
    }

    /// `∂f/∂x, ∂f/∂y, ∂f/∂z` by the row's own position, column after column: `out` has `3 · range.len()` numbers.
    ///
    /// # Errors
    /// [`RowsError`] for lengths that do not fit.
    pub fn variable_derivatives(
        &self,
        rows: &Rows<'_>,
        range: Range<usize>,
        coefficients: &[f64],
        inner: &[f64],
        out: &mut [f64],
    ) -> Result<(), RowsError> {
        self.run(&self.shared.by_position, rows, range, Some(coefficients), inner, out)
    }

    /// The formula's wind-ups, in the order of their numbers.
    ///
    /// # Errors
    /// [`RowsError`] for inner parameters that do not fit.
    pub fn windups(&self, inner: &[f64]) -> Result<Vec<FollowedWindup>, RowsError> {
        self.check_parameters(None, inner)?;
        let of = |windup: &CompiledWindup| FollowedWindup {
            direction: windup.direction,
            travel: windup.travel,
            length_mm: windup.length.as_ref().map(|length| length.evaluate(&[], &[], inner, |_| 0.0).0),
        };
        Ok(self.shared.windups.iter().map(of).collect())
    }

    /// Value and gradient by x, y, z at one point (one number for each variable of the symbols), history settled:
    /// `lag(u, tau)` is u, `windup` follows a long stroke; `bed_x` and `bed_y` move with x and y.
    ///
    /// # Errors
    /// [`RowsError`] for lengths that do not fit.
    pub fn evaluate_at(
        &self,
        point: &[f64],
        coefficients: &[f64],
        inner: &[f64],
    ) -> Result<(f64, [f64; 3]), RowsError> {
        self.evaluate_behind(point, coefficients, inner, |_| 0.0)
    }

    /// The same behind strokes that need not be long: `unwound` tells, for the number of each of the
    /// [`windups`](Self::windups), what the stroke before the last reversal left unwound, as a share of the lost motion
    /// (0 behind a long one, 1 where there was no reversal).
    ///
    /// Wind-up is `−(d/2)(1 − 2(1 − g)e^(−s/λ))` with that share g: `w_rev = d/2 − g·d` in the recursion of rows.
    ///
    /// # Errors
    /// [`RowsError`] for lengths that do not fit.
    pub fn evaluate_behind(
        &self,
        point: &[f64],
        coefficients: &[f64],
        inner: &[f64],
        unwound: impl Fn(usize) -> f64,
    ) -> Result<(f64, [f64; 3]), RowsError> {
        let needed = self.shared.source.symbols.variables.len();
        if point.len() != needed {
            return Err(RowsError::VariableCount { needed, found: point.len() });
        }
        self.check_parameters(Some(coefficients), inner)?;
        Ok(self.shared.point.evaluate(point, coefficients, inner, unwound))
    }

    fn check_parameters(&self, coefficients: Option<&[f64]>, inner: &[f64]) -> Result<(), RowsError> {
        let needed = self.shared.source.symbols.coefficients.len();
        if let Some(coefficients) = coefficients
            && coefficients.len() != needed
        {
            return Err(RowsError::CoefficientCount { needed, found: coefficients.len() });
        }
        let needed = self.shared.source.symbols.inner.len();
        if inner.len() != needed {
            return Err(RowsError::InnerCount { needed, found: inner.len() });
        }
        Ok(())
    }

    fn run(
        &self,
        tape: &Tape,
        rows: &Rows<'_>,
        range: Range<usize>,
        coefficients: Option<&[f64]>,
        inner: &[f64],
        out: &mut [f64],
    ) -> Result<(), RowsError> {
        rows.check(&self.shared.source.symbols.variables, &self.shared.variables_used, &range)?;
        self.check_parameters(coefficients, inner)?;
        let needed = tape.n_slots * range.len();
        if out.len() != needed {
            return Err(RowsError::OutputLength { needed, found: out.len() });
        }
        block::run(tape, rows, range, coefficients.unwrap_or_default(), inner, out);
        Ok(())
    }
}

impl CompiledWindup {
    fn new(graph: &Graph, windup: &Windup) -> Self {
        let variable = |id: NodeId| match graph.node(id) {
            Node::Variable(index) => Some(index as usize),
            _ => None,
        };
        let nowhere = [const { Vec::new() }; 3];
        let length = (!graph.varies(windup.lambda))
            .then(|| PointTape::compile(graph, &[(None, windup.lambda)], &nowhere));
        Self { direction: variable(windup.d), travel: variable(windup.s), length }
    }
}

/// Derivatives of a sum of parts by each seed, as terms of one slot a seed.
fn derived(
    graph: &mut Graph,
    parts: &[PointTerm],
    seeds: impl IntoIterator<Item = Option<Seed>>,
) -> Vec<Term> {
    let roots: Vec<NodeId> = parts.iter().map(|&(_, node)| node).collect();
    let is_needed = graph.needed_by(roots.iter().copied());
    let used: HashSet<Seed> = (graph.ids().filter(|id| is_needed[id.index()]))
        .filter_map(|id| match graph.node(id) {
            Node::Inner(index) => Some(Seed::Inner(index)),
            Node::Variable(index) => Some(Seed::Variable(index)),
            _ => None,
        })
        .collect();
    let mut terms = Vec::new();
    for (slot, seed) in seeds.into_iter().enumerate() {
        let Some(seed) = seed.filter(|seed| used.contains(seed)) else { continue };
        let of_roots = tangents(graph, &roots, seed);
        for (&(coefficient, _), tangent) in parts.iter().zip(of_roots) {
            terms.extend(tangent.map(|node| Term { slot, coefficient, node }));
        }
    }
    terms
}
