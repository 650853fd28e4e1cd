//! Why a formula, or the rows given to it, are refused.

use std::fmt;
use std::ops::Range;

use super::lexer::Placed;
use super::{MAX_NESTING, MAX_NODES, MAX_TEXT_BYTES};

/// A formula that is refused, with the place marked.
///
/// Its message is the problem, then the line of the formula and carets under the place.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpressionError {
    /// The text that holds the problem: the formula, or that of a definition that it uses.
    pub text: String,
    /// Name of that definition; `None` for the formula itself.
    pub definition: Option<String>,
    /// The place, in bytes of `text`.
    pub span: Range<usize>,
    /// What is wrong.
    pub problem: Box<Problem>,
}

impl ExpressionError {
    pub(super) fn new(text: &str, definition: Option<&str>, (problem, span): Placed) -> Self {
        let (text, definition) = (text.to_owned(), definition.map(str::to_owned));
        Self { text, definition, span, problem: Box::new(problem) }
    }
}

/// What can be wrong with a formula.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// Nothing but blanks.
    #[error("the formula is empty")]
    Empty,
    /// A text longer than is read.
    #[error("the formula has {found} bytes; at most {MAX_TEXT_BYTES} are read")]
    TooLong {
        /// Bytes of the text.
        found: usize,
    },
    /// Brackets, signs or powers inside one another beyond the limit.
    #[error("nested more than {MAX_NESTING} deep")]
    TooDeep,
    /// More distinct operations, derivatives included, than the limit.
    #[error("more than {MAX_NODES} distinct operations (derivatives included)")]
    TooComplex,
    /// A character that no formula has.
    #[error("{found:?} has no meaning here{}", hint_for(*found))]
    UnexpectedCharacter {
        /// The character.
        found: char,
    },
    /// An operator of another language.
    #[error("`{found}` is not an operator here: {instead}")]
    ForeignOperator {
        /// The operator.
        found: &'static str,
        /// What to write.
        instead: &'static str,
    },
    /// A number beyond the range of double precision.
    #[error("this number is too large")]
    NumberTooLarge,
    /// The text ends too early.
    #[error("the formula ends where {expected} is needed")]
    UnexpectedEnd {
        /// What is needed.
        expected: &'static str,
    },
    /// Something else than what is needed.
    #[error("{expected} is needed here")]
    Expected {
        /// What is needed.
        expected: &'static str,
    },
    /// Two values side by side.
    #[error("an operator is missing here (write `*` to multiply)")]
    MissingOperator,
    /// A bracket that nothing closes.
    #[error("this bracket is not closed")]
    NotClosed,
    /// A bracket that nothing opens.
    #[error("this bracket closes nothing")]
    NotOpened,
    /// `a < b < c`.
    #[error("comparisons cannot be chained: write `(a < b)*(b < c)`")]
    ChainedComparison,
    /// A name that nobody gave.
    #[error("unknown name `{name}`{}; known are {}", did_you_mean(near), list(known))]
    UnknownName {
        /// The name.
        name: String,
        /// Known names that resemble it.
        near: Vec<String>,
        /// All known names.
        known: Vec<String>,
    },
    /// A function that does not exist.
    #[error("unknown function `{name}`{}; known are {}", did_you_mean(near), list(known))]
    UnknownFunction {
        /// The name.
        name: String,
        /// Functions that resemble it.
        near: Vec<String>,
        /// All functions.
        known: Vec<String>,
    },
    /// A value followed by a bracket.
    #[error("`{name}` is a value, not a function: write `{name}*(...)` to multiply")]
    NotAFunction {
        /// The name.
        name: String,
    },
    /// A function without its arguments.
    #[error("`{name}` is a function: write `{name}(...)`")]
    FunctionWithoutArguments {
        /// The function.
        name: &'static str,
    },
    /// A wrong number of arguments.
    #[error("`{name}` takes {needed}, not {found}")]
    Arity {
        /// The function.
        name: &'static str,
        /// What it takes, in words.
        needed: &'static str,
        /// Number of arguments found.
        found: usize,
    },
    /// Coefficients in a place that makes the formula non-linear in them.
    #[error("not linear in the coefficients: {why} (what is not linear belongs to the inner parameters)")]
    NotLinear {
        /// Why.
        why: &'static str,
    },
    /// A part without a coefficient beside parts that have one.
    #[error("this part has no coefficient: with all coefficients 0 the formula would not be 0")]
    NotHomogeneous,
    /// Coefficients were declared and none is used.
    #[error(
        "none of the coefficients {} is used: with all of them 0 the formula would not be 0",
        list(known)
    )]
    NoCoefficient {
        /// The declared coefficients.
        known: Vec<String>,
    },
    /// A definition that needs itself.
    #[error("the definition needs itself: {}", chain.join(" → "))]
    Recursive {
        /// The names on the way round.
        chain: Vec<String>,
    },
    /// Definitions of definitions beyond the limit.
    #[error("definitions of definitions more than {MAX_NESTING} deep")]
    DefinitionsTooDeep,
    /// A name in a definition that stands for two things.
    #[error("`{name}` is both a variable and a parameter: a definition cannot tell them apart")]
    Ambiguous {
        /// The name.
        name: String,
    },
    /// A parameter whose name cannot stand in a formula.
    #[error(
        "parameter name `{}`: names are ASCII letters, digits and `_`, do not begin with a digit and are no function or constant",
        printable(name)
    )]
    ParameterName {
        /// The name.
        name: String,
    },
    /// A parameter whose name is taken.
    #[error("parameter name `{name}` is taken: {by}")]
    ParameterTaken {
        /// The name.
        name: String,
        /// By what.
        by: &'static str,
    },
}

/// Why the rows or parameters given to an expression are refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RowsError {
    /// Not one column for each variable.
    #[error("{found} columns for {needed} variables")]
    VariableCount {
        /// Variables of the expression.
        needed: usize,
        /// Columns given.
        found: usize,
    },
    /// A column of a wrong length.
    #[error("variable `{name}` has {found} values for {n_rows} rows")]
    ColumnLength {
        /// Name of the variable.
        name: String,
        /// Number of rows.
        n_rows: usize,
        /// Values given.
        found: usize,
    },
    /// Times of a wrong length.
    #[error("{found} times for {n_rows} rows")]
    TimeLength {
        /// Number of rows.
        n_rows: usize,
        /// Times given.
        found: usize,
    },
    /// A first row of a sequence that is out of order.
    #[error("start {index} is row {row}: starts begin with 0, rise, and stay below the {n_rows} rows")]
    BadStart {
        /// Index among the starts.
        index: usize,
        /// The row that it names.
        row: usize,
        /// Number of rows.
        n_rows: usize,
    },
    /// A range beyond the rows.
    #[error("rows {start} to {end} of {n_rows}")]
    BadRange {
        /// First row asked for.
        start: usize,
        /// Row after the last.
        end: usize,
        /// Number of rows.
        n_rows: usize,
    },
    /// A wrong number of coefficients.
    #[error("{found} coefficients for {needed}")]
    CoefficientCount {
        /// Coefficients declared.
        needed: usize,
        /// Coefficients given.
        found: usize,
    },
    /// A wrong number of inner parameters.
    #[error("{found} inner parameters for {needed}")]
    InnerCount {
        /// Inner parameters declared.
        needed: usize,
        /// Inner parameters given.
        found: usize,
    },
    /// A result array of a wrong length.
    #[error("room for {found} results where {needed} are needed")]
    OutputLength {
        /// Numbers that the result has.
        needed: usize,
        /// Numbers that there is room for.
        found: usize,
    },
}

impl std::error::Error for ExpressionError {}

impl fmt::Display for ExpressionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(definition) = &self.definition {
            write!(f, "in the definition of `{}`: ", printable(definition))?;
        }
        write!(f, "{}", self.problem)?;
        let (line, first, width) = marked_line(&self.text, &self.span);
        if line.is_empty() {
            return Ok(());
        }
        write!(f, "\n  {line}\n  {}{}", " ".repeat(first), "^".repeat(width))
    }
}

/// Characters of a formula's line that a message shows before and after the place.
const SHOWN_AROUND: usize = 50;

/// The line with the place, made safe for a terminal, and the first column and width of the carets.
fn marked_line(text: &str, span: &Range<usize>) -> (String, usize, usize) {
    let start = floor_boundary(text, span.start);
    let end = floor_boundary(text, span.end.max(start));
    let line_start = text[..start].rfind('\n').map_or(0, |at| at + 1);
    let line_end = text[start..].find('\n').map_or(text.len(), |at| start + at);
    let before: Vec<char> = text[line_start..start].chars().collect();
    let marked: Vec<char> = text[start..end.min(line_end)].chars().collect();
    let after: Vec<char> = text[end.min(line_end)..line_end].chars().collect();

    let mut line = String::new();
    let cut_before = before.len().saturating_sub(SHOWN_AROUND);
    if cut_before > 0 {
        line.push('…');
    }
    line.extend(before[cut_before..].iter().map(|&c| visible(c)));
    let first = line.chars().count();
    let width = marked.len().min(2 * SHOWN_AROUND);
    line.extend(marked[..width].iter().map(|&c| visible(c)));
    if width == marked.len() {
        line.extend(after.iter().take(SHOWN_AROUND).map(|&c| visible(c)));
    }
    if width < marked.len() || after.len() > SHOWN_AROUND {
        line.push('…');
    }
    (line, first, width.max(1))
}

fn floor_boundary(text: &str, mut at: usize) -> usize {
    at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// Blanks stay one column wide, and control characters cannot reach a terminal.
fn visible(c: char) -> char {
    if c == '\t' {
        ' '
    } else if c.is_control() {
        '\u{fffd}'
    } else {
        c
    }
}

fn printable(name: &str) -> String {
    name.chars().take(100).map(visible).collect()
}

fn hint_for(found: char) -> &'static str {
    match found {
        '×' | '·' | '⋅' => ": multiply with `*`",
        '÷' => ": divide with `/`",
        '−' | '–' | '—' => ": minus is `-`",
        'π' => ": write `pi`",
        '²' | '³' => ": raise to a power with `^`",
        '[' | ']' | '{' | '}' => ": brackets are `(` and `)`",
        ';' => ": arguments are separated by `,`",
        c if c.is_alphabetic() => ": names are ASCII letters, digits and `_`",
        _ => "",
    }
}

fn did_you_mean(near: &[String]) -> String {
    if near.is_empty() {
        String::new()
    } else {
        format!(
            " (did you mean {}?)",
            near.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(" or ")
        )
    }
}

/// Names that a message lists before it says how many more there are.
const LISTED: usize = 60;

fn list(names: &[String]) -> String {
    if names.is_empty() {
        return "none".to_owned();
    }
    let shown = names.iter().take(LISTED).map(|name| printable(name)).collect::<Vec<_>>().join(", ");
    match names.len().checked_sub(LISTED) {
        Some(more) if more > 0 => format!("{shown} and {more} more"),
        _ => shown,
    }
}
