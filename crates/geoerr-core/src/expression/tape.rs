//! Operations in the order in which they are done, with the places of their results.

use super::functions::{Binary, Unary, select};
use super::graph::{Graph, Lag, LagTangent, Node, NodeId, Windup, WindupTangent};

/// Where an operand comes from.
#[derive(Clone, Copy, Debug)]
pub(super) enum Operand {
    /// A register: one number for each row of the block.
    Register(usize),
    /// A column of the rows.
    Variable(usize),
    /// One number for all rows.
    Uniform(usize),
}

/// A number that is the same for all rows, from those before it.
#[derive(Clone, Copy, Debug)]
pub(super) enum Uniform {
    Constant(f64),
    Inner(usize),
    Unary(Unary, usize),
    Binary(Binary, usize, usize),
    Select([usize; 3]),
}

/// What is done with a block of rows. What has a memory knows its place among the memories.
#[derive(Clone, Copy, Debug)]
pub(super) enum Action {
    Unary(Unary, Operand),
    Binary(Binary, Operand, Operand),
    Select([Operand; 3]),
    Lag {
        u: Operand,
        tau: Operand,
        is_held: bool,
        memory: usize,
    },
    LagTangent {
        u: Operand,
        tau: Operand,
        y: Operand,
        du: Operand,
        dtau: Operand,
        kind: TangentKind,
        memory: usize,
    },
    Windup {
        d: Operand,
        s: Operand,
        lambda: Operand,
        memory: usize,
    },
    WindupTangent {
        d: Operand,
        s: Operand,
        lambda: Operand,
        ds: Operand,
        dlambda: Operand,
        is_own_row: bool,
        memory: usize,
    },
}

/// What a lag's derivative has to know.
#[derive(Clone, Copy, Debug)]
pub(super) struct TangentKind {
    pub(super) is_held: bool,
    pub(super) is_own_row: bool,
}

/// One step.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    /// Do `action`, result in register `into` (never one of its operands).
    Do { action: Action, into: usize },
    /// Add a value, times a coefficient if one is named, to result `slot`.
    Emit { slot: usize, coefficient: Option<usize>, value: Operand },
}

/// One term of a result: slot, coefficient that multiplies it, and what.
#[derive(Clone, Copy, Debug)]
pub(super) struct Term {
    pub(super) slot: usize,
    pub(super) coefficient: Option<usize>,
    pub(super) node: NodeId,
}

/// A compiled set of results.
#[derive(Clone, Debug)]
pub(super) struct Tape {
    pub(super) uniforms: Vec<Uniform>,
    pub(super) steps: Vec<Step>,
    pub(super) n_registers: usize,
    pub(super) n_memories: usize,
    pub(super) n_slots: usize,
}

impl Tape {
    /// Compiles the sums of `terms` into `n_slots` results.
    pub(super) fn compile(graph: &Graph, n_slots: usize, terms: &[Term]) -> Self {
        let is_needed = graph.needed_by(terms.iter().map(|term| term.node));
        let mut compiler = Compiler::new(graph, &is_needed, terms);
        for id in graph.ids().filter(|id| is_needed[id.index()]) {
            compiler.node(id);
        }
        Self {
            uniforms: compiler.uniforms,
            steps: compiler.steps,
            n_registers: compiler.n_registers,
            n_memories: compiler.n_memories,
            n_slots,
        }
    }

    /// Whether rows depend on the rows before them.
    pub(super) fn has_memory(&self) -> bool {
        self.n_memories > 0
    }

    /// Whether no operation on rows has a corner or a jump.
    pub(super) fn is_smooth(&self) -> bool {
        self.steps.iter().all(|step| match step {
            Step::Do { action: Action::Unary(operation, _), .. } => operation.is_smooth(),
            Step::Do { action: Action::Binary(operation, ..), .. } => operation.is_smooth(),
            Step::Do { .. } => false,
            Step::Emit { .. } => true,
        })
    }

    /// The numbers that are the same for all rows.
    pub(super) fn uniforms(&self, inner: &[f64]) -> Vec<f64> {
        let mut values: Vec<f64> = Vec::with_capacity(self.uniforms.len());
        for uniform in &self.uniforms {
            values.push(uniform.value(&values, inner));
        }
        values
    }
}

impl Uniform {
    fn value(self, before: &[f64], inner: &[f64]) -> f64 {
        match self {
            Self::Constant(value) => value,
            Self::Inner(index) => inner[index],
            Self::Unary(operation, a) => operation.apply(before[a]),
            Self::Binary(operation, a, b) => operation.apply(before[a], before[b]),
            Self::Select([condition, a, b]) => select(before[condition], before[a], before[b]),
        }
    }
}

struct Compiler<'a> {
    graph: &'a Graph,
    /// For each node, how many more times it is an operand or a result.
    uses: Vec<usize>,
    /// For each node, the results that it is part of.
    results: Vec<Vec<Term>>,
    place: Vec<Operand>,
    free: Vec<usize>,
    uniforms: Vec<Uniform>,
    steps: Vec<Step>,
    n_registers: usize,
    n_memories: usize,
}

impl<'a> Compiler<'a> {
    fn new(graph: &'a Graph, is_needed: &[bool], terms: &[Term]) -> Self {
        let mut uses = vec![0; graph.len()];
        for id in graph.ids().filter(|id| is_needed[id.index()]) {
            graph.node(id).operands(|operand| uses[operand.index()] += 1);
        }
        let mut results: Vec<Vec<Term>> = vec![Vec::new(); graph.len()];
        for term in terms {
            results[term.node.index()].push(*term);
        }
        Self {
            graph,
            uses,
            results,
            place: vec![Operand::Uniform(0); graph.len()],
            free: Vec::new(),
            uniforms: Vec::new(),
            steps: Vec::new(),
            n_registers: 0,
            n_memories: 0,
        }
    }

    fn node(&mut self, id: NodeId) {
        let node = self.graph.node(id);
        self.place[id.index()] = match node {
            Node::Variable(index) => Operand::Variable(index as usize),
            _ if !self.graph.varies(id) => self.uniform(node),
            _ => self.varying(node),
        };
        let value = self.place[id.index()];
        for Term { slot, coefficient, .. } in std::mem::take(&mut self.results[id.index()]) {
            self.steps.push(Step::Emit { slot, coefficient, value });
        }
        if self.uses[id.index()] == 0 {
            self.release(value);
        }
    }

    fn uniform(&mut self, node: Node) -> Operand {
        let at = |id: NodeId| match self.place[id.index()] {
            Operand::Uniform(index) => index,
            // What does not vary has no operand that does.
            Operand::Register(_) | Operand::Variable(_) => 0,
        };
        let uniform = match node {
            Node::Constant(bits) => Uniform::Constant(f64::from_bits(bits)),
            Node::Inner(index) => Uniform::Inner(index as usize),
            Node::Unary(operation, a) => Uniform::Unary(operation, at(a)),
            Node::Binary(operation, a, b) => Uniform::Binary(operation, at(a), at(b)),
            Node::Select(operands) => Uniform::Select(operands.map(at)),
            Node::Variable(_)
            | Node::Lag(_)
            | Node::LagTangent(_)
            | Node::Windup(_)
            | Node::WindupTangent(_)
            | Node::Unwound(_) => Uniform::Constant(f64::NAN),
        };
        self.uniforms.push(uniform);
        Operand::Uniform(self.uniforms.len() - 1)
    }

    fn varying(&mut self, node: Node) -> Operand {
        let action = self.action(node);
        // The result's register is taken before the operands' are released: it is never one of them.
        let into = self.free.pop().unwrap_or_else(|| {
            self.n_registers += 1;
            self.n_registers - 1
        });
        self.steps.push(Step::Do { action, into });
        let mut done = Vec::new();
        node.operands(|operand| done.push(operand));
        for operand in done {
            let uses = &mut self.uses[operand.index()];
            *uses -= 1;
            if *uses == 0 {
                self.release(self.place[operand.index()]);
            }
        }
        Operand::Register(into)
    }

    fn release(&mut self, place: Operand) {
        if let Operand::Register(register) = place {
            self.free.push(register);
        }
    }

    fn action(&mut self, node: Node) -> Action {
        let at = |id: NodeId| self.place[id.index()];
        let memory = self.n_memories;
        self.n_memories += usize::from(matches!(
            node,
            Node::Lag(_) | Node::LagTangent(_) | Node::Windup(_) | Node::WindupTangent(_)
        ));
        match node {
            Node::Unary(operation, a) => Action::Unary(operation, at(a)),
            Node::Binary(operation, a, b) => Action::Binary(operation, at(a), at(b)),
            Node::Select(operands) => Action::Select(operands.map(at)),
            Node::Lag(Lag { u, tau, is_held }) => Action::Lag { u: at(u), tau: at(tau), is_held, memory },
            Node::LagTangent(LagTangent { lag: Lag { u, tau, is_held }, y, du, dtau, is_own_row }) => {
                let kind = TangentKind { is_held, is_own_row };
                let (u, tau, y, du, dtau) = (at(u), at(tau), at(y), at(du), at(dtau));
                Action::LagTangent { u, tau, y, du, dtau, kind, memory }
            }
            Node::Windup(Windup { d, s, lambda }) => {
                Action::Windup { d: at(d), s: at(s), lambda: at(lambda), memory }
            }
            Node::WindupTangent(WindupTangent {
                windup: Windup { d, s, lambda },
                ds,
                dlambda,
                is_own_row,
            }) => {
                let (d, s, lambda, ds, dlambda) = (at(d), at(s), at(lambda), at(ds), at(dlambda));
                Action::WindupTangent { d, s, lambda, ds, dlambda, is_own_row, memory }
            }
            // Leaves have places of their own, or are of no row.
            Node::Constant(_) | Node::Variable(_) | Node::Inner(_) | Node::Unwound(_) => {
                Action::Select([Operand::Uniform(0); 3])
            }
        }
    }
}
