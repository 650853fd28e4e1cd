//! Syntax to operations: names looked up, definitions inlined, coefficients split off.
//!
//! Every part of a formula is either free of coefficients or a sum of coefficients times something free of them. A
//! definition is lowered once for each of its two surroundings (inside `lag()` or not) and then shared, however often
//! and however deeply it is used, so that no text can grow exponentially.

use std::collections::HashMap;
use std::ops::Range;

use super::error::{ExpressionError, Problem};
use super::functions::{Binary, Unary, function};
use super::graph::{Graph, Lag, NodeId, Windup};
use super::lexer::Placed;
use super::names::{is_name, near};
use super::syntax::{Kind, Syntax, parse};
use super::{Definitions, MAX_NESTING, Symbols};

/// A part of a formula.
#[derive(Clone, Debug)]
pub(super) enum Form {
    /// Without coefficients.
    Free(NodeId),
    /// Σ coefficient · node, by rising coefficient.
    Linear(Vec<(u32, NodeId)>),
}

/// A formula as operations.
pub(super) struct Lowered {
    pub(super) graph: Graph,
    pub(super) form: Form,
}

/// Parses a formula and lowers it.
pub(super) fn lower(
    text: &str,
    symbols: &Symbols,
    definitions: &Definitions,
) -> Result<Lowered, ExpressionError> {
    check_parameters(symbols, definitions)?;
    let mut lowering = Lowering {
        symbols,
        definitions,
        variables: by_name(&symbols.variables),
        coefficients: by_name(&symbols.coefficients),
        inner: by_name(&symbols.inner),
        graph: Graph::default(),
        done: HashMap::new(),
        active: Vec::new(),
    };
    let form = lowering.text(text, None, false)?;
    if let Form::Free(node) = form
        && !symbols.coefficients.is_empty()
        && lowering.graph.as_constant(node) != Some(0.0)
    {
        let problem = Problem::NoCoefficient { known: symbols.coefficients.clone() };
        return Err(ExpressionError::new(text, None, (problem, 0..text.len())));
    }
    Ok(Lowered { graph: lowering.graph, form })
}

fn by_name(names: &[String]) -> HashMap<&str, u32> {
    // The first of several columns of one name, as tables have it.
    let mut index_of = HashMap::new();
    for (name, index) in names.iter().zip(0..) {
        index_of.entry(name.as_str()).or_insert(index);
    }
    index_of
}

fn check_parameters(symbols: &Symbols, definitions: &Definitions) -> Result<(), ExpressionError> {
    let refused = |name: &String, problem| Err(ExpressionError::new(name, None, (problem, 0..name.len())));
    let mut seen = HashMap::new();
    for name in symbols.coefficients.iter().chain(&symbols.inner) {
        if !is_name(name) || function(name).is_some() || name == "pi" {
            return refused(name, Problem::ParameterName { name: name.clone() });
        }
        let by = if seen.insert(name, ()).is_some() {
            "another parameter has it"
        } else if definitions.get(name).is_some() {
            "a definition has it"
        } else {
            continue;
        };
        return refused(name, Problem::ParameterTaken { name: name.clone(), by });
    }
    Ok(())
}

/// The raw variables that mean something else inside `lag()`, and what.
const MEAN_SPEEDS: [(&str, &str); 3] = [("v_x", "mean_v_x"), ("v_y", "mean_v_y"), ("v_z", "mean_v_z")];

struct Lowering<'a> {
    symbols: &'a Symbols,
    definitions: &'a Definitions,
    variables: HashMap<&'a str, u32>,
    coefficients: HashMap<&'a str, u32>,
    inner: HashMap<&'a str, u32>,
    graph: Graph,
    /// Definitions that are lowered, outside and inside `lag()`.
    done: HashMap<(&'a str, bool), Form>,
    /// Definitions on the way to the text that is being lowered.
    active: Vec<&'a str>,
}

impl<'a> Lowering<'a> {
    /// Lowers the formula, or the text of one definition.
    fn text(
        &mut self,
        text: &str,
        definition: Option<&'a str>,
        in_lag: bool,
    ) -> Result<Form, ExpressionError> {
        let refused = |placed: Placed| ExpressionError::new(text, definition, placed);
        let tree = parse(text).map_err(refused)?;
        let mut forms: Vec<Form> = Vec::with_capacity(tree.len());
        for syntax in &tree {
            let form = match syntax.kind {
                // Not through `map_err`: a problem inside another definition marks that definition's text.
                Kind::Name { start, end, in_lag: here } => {
                    let name = &text[start..end];
                    self.name(name, definition.is_some(), in_lag || here, &(start..end), &refused)?
                }
                Kind::Windup(lambda) => {
                    let lambda = match &forms[lambda] {
                        Form::Free(node) => *node,
                        Form::Linear(_) => {
                            let why = "a length with a coefficient";
                            return Err(refused((Problem::NotLinear { why }, tree[lambda].span.clone())));
                        }
                    };
                    self.windup(lambda, definition.is_some(), &syntax.span, &refused)?
                }
                kind => self.operation(kind, &tree, &forms, &syntax.span).map_err(refused)?,
            };
            if self.graph.is_overfull() {
                return Err(refused((Problem::TooComplex, syntax.span.clone())));
            }
            forms.push(form);
        }
        forms.pop().ok_or_else(|| refused((Problem::Empty, 0..text.len())))
    }

    /// What a name stands for.
    ///
    /// In the formula: parameters, then definitions, then variables, so that no column of the data can take an effect's
    /// own name. In a definition, which is about the data: variables, then definitions, then parameters.
    fn name(
        &mut self,
        name: &str,
        in_definition: bool,
        in_lag: bool,
        span: &Range<usize>,
        refused: &impl Fn(Placed) -> ExpressionError,
    ) -> Result<Form, ExpressionError> {
        let at = |problem| refused((problem, span.clone()));
        let parameter = self.parameter(name);
        let raw = self.variables.contains_key(name);
        if !in_definition {
            if let Some(form) = parameter {
                return Ok(form);
            }
        } else if raw && parameter.is_some() {
            return Err(at(Problem::Ambiguous { name: name.to_owned() }));
        }
        // In its own definition a name is the variable: `t = t`, `x = x - 5`.
        let definition = self.definitions.get(name);
        if let Some((defined, text)) = definition
            && (!in_definition || !raw)
        {
            return self.definition(defined, text, in_lag, &at);
        }
        if let Some(node) = self.raw_variable(name, in_lag, &at)? {
            return Ok(Form::Free(node));
        }
        if let Some(form) = parameter {
            return Ok(form);
        }
        if let Some(signature) = function(name) {
            return Err(at(Problem::FunctionWithoutArguments { name: signature.name }));
        }
        Err(at(self.unknown(name)))
    }

    fn parameter(&mut self, name: &str) -> Option<Form> {
        if let Some(&index) = self.coefficients.get(name) {
            let one = self.graph.constant(1.0);
            return Some(Form::Linear(vec![(index, one)]));
        }
        self.inner.get(name).map(|&index| Form::Free(self.graph.inner(index)))
    }

    fn definition(
        &mut self,
        name: &'a str,
        text: &'a str,
        in_lag: bool,
        at: &impl Fn(Problem) -> ExpressionError,
    ) -> Result<Form, ExpressionError> {
        if let Some(form) = self.done.get(&(name, in_lag)) {
            return Ok(form.clone());
        }
        if let Some(first) = self.active.iter().position(|&active| active == name) {
            let around = self.active[first..].iter().chain([&name]);
            return Err(at(Problem::Recursive { chain: around.map(|&name| name.to_owned()).collect() }));
        }
        if self.active.len() >= MAX_NESTING {
            return Err(at(Problem::DefinitionsTooDeep));
        }
        self.active.push(name);
        let form = self.text(text, Some(name), in_lag)?;
        self.active.pop();
        self.done.insert((name, in_lag), form.clone());
        Ok(form)
    }

    fn raw_variable(
        &mut self,
        name: &str,
        in_lag: bool,
        at: &impl Fn(Problem) -> ExpressionError,
    ) -> Result<Option<NodeId>, ExpressionError> {
        let mean = MEAN_SPEEDS.iter().find(|&&(speed, mean)| name == mean || in_lag && name == speed);
        let wanted = mean.map_or(name, |&(_, mean)| mean);
        match self.variables.get(wanted) {
            Some(&index) => Ok(Some(self.graph.variable(index, mean.is_some()))),
            // `v_x` inside lag() is known, but what it means there was not given.
            None if wanted != name && self.variables.contains_key(name) => Err(at(self.unknown(wanted))),
            None => Ok(None),
        }
    }

    fn unknown(&self, name: &str) -> Problem {
        let symbols = self.symbols;
        let mut known: Vec<String> = (symbols.coefficients.iter().chain(&symbols.inner))
            .map(String::as_str)
            .chain(self.definitions.names())
            .chain(symbols.variables.iter().map(String::as_str).filter(|name| is_name(name)))
            .chain(["pi"])
            .map(str::to_owned)
            .collect();
        known.sort();
        known.dedup();
        Problem::UnknownName { name: name.to_owned(), near: near(name, &known), known }
    }

    /// Lowers everything but a name; `forms` has the operands.
    fn operation(
        &mut self,
        kind: Kind,
        tree: &[Syntax],
        forms: &[Form],
        whole: &Range<usize>,
    ) -> Result<Form, Placed> {
        let free = |id: usize, why: &'static str| match &forms[id] {
            Form::Free(node) => Ok(*node),
            Form::Linear(_) => Err((Problem::NotLinear { why }, tree[id].span.clone())),
        };
        Ok(match kind {
            Kind::Number(value) => Form::Free(self.graph.constant(value)),
            // These two look names up, which `text` does.
            Kind::Name { .. } | Kind::Windup(_) => {
                return Err((Problem::Expected { expected: "an operation" }, whole.clone()));
            }
            Kind::Unary(Unary::Negate, a) => self.each(&forms[a], |graph, node| graph.negate(node)),
            Kind::Unary(operation, a) => {
                let a = free(a, "a function of a coefficient")?;
                Form::Free(self.graph.unary(operation, a))
            }
            Kind::Binary(operation @ (Binary::Add | Binary::Subtract), a, b) => {
                self.sum(operation, [&forms[a], &forms[b]], [&tree[a].span, &tree[b].span])?
            }
            Kind::Binary(Binary::Multiply, a, b) => match (&forms[a], &forms[b]) {
                (Form::Linear(_), Form::Linear(_)) => {
                    let why = "a product of coefficients";
                    return Err((Problem::NotLinear { why }, whole.clone()));
                }
                (Form::Free(a), b) => self.each(b, |graph, node| graph.multiply(*a, node)),
                (a, Form::Free(b)) => self.each(a, |graph, node| graph.multiply(node, *b)),
            },
            Kind::Binary(Binary::Divide, a, b) => {
                let b = free(b, "a division by a coefficient")?;
                self.each(&forms[a], |graph, node| graph.divide(node, b))
            }
            Kind::Binary(operation, a, b) => {
                let why = match operation {
                    Binary::Power => "a power of a coefficient",
                    Binary::Less | Binary::LessEqual | Binary::Equal | Binary::NotEqual => {
                        "a comparison of a coefficient"
                    }
                    _ => "a function of a coefficient",
                };
                let (a, b) = (free(a, why)?, free(b, why)?);
                Form::Free(self.graph.binary(operation, a, b))
            }
            Kind::Where([condition, a, b]) => {
                let condition = free(condition, "a condition on a coefficient")?;
                self.choice(condition, [&forms[a], &forms[b]], [&tree[a].span, &tree[b].span])?
            }
            Kind::Lag(u, tau) => {
                let tau = free(tau, "a time constant with a coefficient")?;
                // A lag is linear in what it follows.
                self.each(&forms[u], |graph, u| {
                    let is_held = graph.has_mean_speed(u);
                    graph.lag(Lag { u, tau, is_held })
                })
            }
        })
    }

    /// Applies a linear operation to the form, or to what each coefficient is multiplied with.
    fn each(&mut self, form: &Form, mut operation: impl FnMut(&mut Graph, NodeId) -> NodeId) -> Form {
        match form {
            Form::Free(node) => Form::Free(operation(&mut self.graph, *node)),
            Form::Linear(parts) => Form::Linear(
                parts.iter().map(|&(index, node)| (index, operation(&mut self.graph, node))).collect(),
            ),
        }
    }

    fn sum(
        &mut self,
        operation: Binary,
        [a, b]: [&Form; 2],
        spans: [&Range<usize>; 2],
    ) -> Result<Form, Placed> {
        let (a, b) = match (a, b) {
            (Form::Free(a), Form::Free(b)) => {
                return Ok(Form::Free(self.graph.binary(operation, *a, *b)));
            }
            _ => (self.parts(a, spans[0])?, self.parts(b, spans[1])?),
        };
        Ok(Form::Linear(joined(a, b, |a, b| match (a, b) {
            (Some(a), Some(b)) => self.graph.binary(operation, a, b),
            (Some(a), None) => a,
            (None, Some(b)) if operation == Binary::Subtract => self.graph.negate(b),
            (None, Some(b)) => b,
            (None, None) => self.graph.constant(0.0),
        })))
    }

    fn choice(
        &mut self,
        condition: NodeId,
        [a, b]: [&Form; 2],
        spans: [&Range<usize>; 2],
    ) -> Result<Form, Placed> {
        let (a, b) = match (a, b) {
            (Form::Free(a), Form::Free(b)) => {
                return Ok(Form::Free(self.graph.select(condition, *a, *b)));
            }
            _ => (self.parts(a, spans[0])?, self.parts(b, spans[1])?),
        };
        let zero = self.graph.constant(0.0);
        Ok(Form::Linear(joined(a, b, |a, b| {
            self.graph.select(condition, a.unwrap_or(zero), b.unwrap_or(zero))
        })))
    }

    /// The parts of a form that stands beside one with coefficients: it must have them too, or be 0.
    fn parts<'f>(&self, form: &'f Form, span: &Range<usize>) -> Result<&'f [(u32, NodeId)], Placed> {
        match form {
            Form::Linear(parts) => Ok(parts),
            Form::Free(node) if self.graph.as_constant(*node) == Some(0.0) => Ok(&[]),
            Form::Free(_) => Err((Problem::NotHomogeneous, span.clone())),
        }
    }

    /// `windup` follows the direction and the travel that the text knows as `d` and `s`.
    fn windup(
        &mut self,
        lambda: NodeId,
        in_definition: bool,
        span: &Range<usize>,
        refused: &impl Fn(Placed) -> ExpressionError,
    ) -> Result<Form, ExpressionError> {
        let mut followed = |name| match self.name(name, in_definition, false, span, refused)? {
            Form::Free(node) => Ok(node),
            Form::Linear(_) => {
                Err(refused((Problem::NotLinear { why: "`d` or `s` has a coefficient" }, span.clone())))
            }
        };
        let (d, s) = (followed("d")?, followed("s")?);
        Ok(Form::Free(self.graph.windup(Windup { d, s, lambda })))
    }
}

/// Two sorted lists of parts as one.
fn joined(
    a: &[(u32, NodeId)],
    b: &[(u32, NodeId)],
    mut join: impl FnMut(Option<NodeId>, Option<NodeId>) -> NodeId,
) -> Vec<(u32, NodeId)> {
    let mut all = Vec::with_capacity(a.len() + b.len());
    let (mut a, mut b) = (a.iter().peekable(), b.iter().peekable());
    loop {
        let index = match (a.peek(), b.peek()) {
            (Some(a), Some(b)) => a.0.min(b.0),
            (Some(only), None) | (None, Some(only)) => only.0,
            (None, None) => return all,
        };
        let next = (a.next_if(|part| part.0 == index), b.next_if(|part| part.0 == index));
        all.push((index, join(next.0.map(|part| part.1), next.1.map(|part| part.1))));
    }
}
