//! Derivatives, carried forward through the operations by the chain rule.
//!
//! A derivative is more operations in the same graph: it shares every intermediate value with the function and with
//! the other derivatives, and where nothing depends on the parameter nothing is built.

use super::functions::{Binary, Unary};
use super::graph::{Graph, Lag, LagTangent, Node, NodeId, Windup, WindupTangent};

/// By what is derived.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Seed {
    /// An inner parameter: the same for all rows.
    Inner(u32),
    /// A variable of this row, what the rows before left behind held fixed.
    Variable(u32),
}

/// Derivatives of `roots`; `None` where there is no dependence.
pub(super) fn tangents(graph: &mut Graph, roots: &[NodeId], seed: Seed) -> Vec<Option<NodeId>> {
    let is_needed = graph.needed_by(roots.iter().copied());
    let mut of: Vec<Option<NodeId>> = vec![None; graph.len()];
    let ids: Vec<NodeId> = graph.ids().collect();
    for id in ids {
        if is_needed[id.index()] {
            of[id.index()] = Chain { graph, of: &of, seed }.tangent(id);
        }
    }
    roots.iter().map(|root| of[root.index()]).collect()
}

struct Chain<'a> {
    graph: &'a mut Graph,
    of: &'a [Option<NodeId>],
    seed: Seed,
}

impl Chain<'_> {
    fn tangent(&mut self, id: NodeId) -> Option<NodeId> {
        let of = self.of;
        let d = |id: NodeId| of[id.index()];
        match self.graph.node(id) {
            Node::Inner(index) if self.seed == Seed::Inner(index) => Some(self.graph.constant(1.0)),
            Node::Variable(index) if self.seed == Seed::Variable(index) => Some(self.graph.constant(1.0)),
            Node::Constant(_) | Node::Variable(_) | Node::Inner(_) | Node::Unwound(_) => None,
            Node::Unary(operation, a) => {
                let da = d(a)?;
                let slope = self.slope(operation, a, id)?;
                Some(self.graph.multiply(slope, da))
            }
            Node::Binary(operation, a, b) => self.of_two(operation, (a, d(a)), (b, d(b)), id),
            Node::Select([condition, a, b]) => {
                if d(a).is_none() && d(b).is_none() {
                    return None;
                }
                let [da, db] = [d(a), d(b)].map(|tangent| self.or_zero(tangent));
                Some(self.graph.select(condition, da, db))
            }
            Node::Lag(lag @ Lag { u, tau, .. }) => {
                if d(u).is_none() && d(tau).is_none() {
                    return None;
                }
                let [du, dtau] = [d(u), d(tau)].map(|tangent| self.or_zero(tangent));
                let is_own_row = matches!(self.seed, Seed::Variable(_));
                let tangent = LagTangent { lag, y: id, du, dtau, is_own_row };
                Some(self.graph.along_sequence(Node::LagTangent(tangent)))
            }
            Node::Windup(windup @ Windup { s, lambda, .. }) => {
                if d(s).is_none() && d(lambda).is_none() {
                    return None;
                }
                let [ds, dlambda] = [d(s), d(lambda)].map(|tangent| self.or_zero(tangent));
                let is_own_row = matches!(self.seed, Seed::Variable(_));
                let tangent = WindupTangent { windup, ds, dlambda, is_own_row };
                Some(self.graph.along_sequence(Node::WindupTangent(tangent)))
            }
            // Second derivatives are never asked for.
            Node::LagTangent(_) | Node::WindupTangent(_) => None,
        }
    }

    fn or_zero(&mut self, tangent: Option<NodeId>) -> NodeId {
        tangent.unwrap_or_else(|| self.graph.constant(0.0))
    }

    /// Slope of a function at `a`, where its value is `y`; `None` where it is 0 everywhere.
    fn slope(&mut self, operation: Unary, a: NodeId, y: NodeId) -> Option<NodeId> {
        let graph = &mut *self.graph;
        let one = graph.constant(1.0);
        Some(match operation {
            Unary::Negate => graph.constant(-1.0),
            Unary::Sin => graph.unary(Unary::Cos, a),
            Unary::Cos => {
                let sine = graph.unary(Unary::Sin, a);
                graph.negate(sine)
            }
            Unary::Tan => {
                let square = graph.multiply(y, y);
                graph.add(one, square)
            }
            Unary::Asin | Unary::Acos => {
                // (1 − a)(1 + a) and not 1 − a²: exact near ±1.
                let (below, above) = (graph.subtract(one, a), graph.add(one, a));
                let product = graph.multiply(below, above);
                let root = graph.unary(Unary::Sqrt, product);
                let numerator = graph.constant(if operation == Unary::Asin { 1.0 } else { -1.0 });
                graph.divide(numerator, root)
            }
            Unary::Atan => {
                let square = graph.multiply(a, a);
                let sum = graph.add(one, square);
                graph.divide(one, sum)
            }
            Unary::Exp => y,
            Unary::Log => graph.divide(one, a),
            Unary::Sqrt => {
                let half = graph.constant(0.5);
                graph.divide(half, y)
            }
            Unary::Sinh => graph.unary(Unary::Cosh, a),
            Unary::Cosh => graph.unary(Unary::Sinh, a),
            Unary::Tanh => {
                let square = graph.multiply(y, y);
                graph.subtract(one, square)
            }
            Unary::Abs => graph.unary(Unary::Sign, a),
            Unary::Sign | Unary::Step => return None,
        })
    }

    fn of_two(
        &mut self,
        operation: Binary,
        (a, da): (NodeId, Option<NodeId>),
        (b, db): (NodeId, Option<NodeId>),
        y: NodeId,
    ) -> Option<NodeId> {
        if da.is_none() && db.is_none() {
            return None;
        }
        match operation {
            Binary::Add => self.sum(da, db),
            Binary::Subtract => {
                let minus = db.map(|db| self.graph.negate(db));
                self.sum(da, minus)
            }
            Binary::Multiply => {
                let first = da.map(|da| self.graph.multiply(da, b));
                let second = db.map(|db| self.graph.multiply(a, db));
                self.sum(first, second)
            }
            Binary::Divide => {
                let first = da.map(|da| self.graph.divide(da, b));
                let second = db.map(|db| {
                    let part = self.graph.divide(y, b);
                    let part = self.graph.multiply(part, db);
                    self.graph.negate(part)
                });
                self.sum(first, second)
            }
            Binary::Power => self.of_power((a, da), (b, db), y),
            Binary::Atan2 => {
                let (aa, bb) = (self.graph.multiply(a, a), self.graph.multiply(b, b));
                let square = self.graph.add(aa, bb);
                let first = da.map(|da| self.graph.multiply(b, da));
                let second = db.map(|db| {
                    let part = self.graph.multiply(a, db);
                    self.graph.negate(part)
                });
                let sum = self.sum(first, second)?;
                Some(self.graph.divide(sum, square))
            }
            Binary::Min | Binary::Max => {
                let (low, high) = if operation == Binary::Min { (a, b) } else { (b, a) };
                let is_first = self.graph.binary(Binary::Less, low, high);
                let [da, db] = [da, db].map(|tangent| self.or_zero(tangent));
                Some(self.graph.select(is_first, da, db))
            }
            Binary::Less | Binary::LessEqual | Binary::Equal | Binary::NotEqual => None,
            Binary::Decay => {
                let rate = self.graph.divide(y, b);
                let first = da.map(|da| {
                    let part = self.graph.multiply(rate, da);
                    self.graph.negate(part)
                });
                let second = db.map(|db| {
                    let ratio = self.graph.divide(a, b);
                    let part = self.graph.multiply(rate, ratio);
                    self.graph.multiply(part, db)
                });
                self.sum(first, second)
            }
        }
    }

    fn of_power(
        &mut self,
        (a, da): (NodeId, Option<NodeId>),
        (b, db): (NodeId, Option<NodeId>),
        y: NodeId,
    ) -> Option<NodeId> {
        let first = da.map(|da| {
            let one = self.graph.constant(1.0);
            let lower = self.graph.subtract(b, one);
            let power = self.graph.binary(Binary::Power, a, lower);
            let slope = self.graph.multiply(b, power);
            self.graph.multiply(slope, da)
        });
        let second = db.map(|db| {
            // 0^b stays 0 while b grows; its logarithm would say otherwise.
            let zero = self.graph.constant(0.0);
            let is_zero = self.graph.binary(Binary::Equal, a, zero);
            let logarithm = self.graph.unary(Unary::Log, a);
            let slope = self.graph.multiply(y, logarithm);
            let slope = self.graph.select(is_zero, zero, slope);
            self.graph.multiply(slope, db)
        });
        self.sum(first, second)
    }

    fn sum(&mut self, a: Option<NodeId>, b: Option<NodeId>) -> Option<NodeId> {
        match (a, b) {
            (Some(a), Some(b)) => Some(self.graph.add(a, b)),
            (only, None) | (None, only) => only,
        }
    }
}

/// A formula for one position on its own.
pub(super) struct Settled {
    pub(super) graph: Graph,
    pub(super) roots: Vec<NodeId>,
    /// Its wind-ups, in the order of their numbers.
    pub(super) windups: Vec<Windup>,
}

/// The formula for one position on its own: lags have settled, wind-up knows what the stroke before left.
pub(super) fn settled(graph: &Graph, roots: &[NodeId]) -> Settled {
    let mut windups = Vec::new();
    let (new, new_id) = graph.rebuilt(roots.iter().copied(), |new, node| match node {
        Node::Lag(Lag { u, .. }) => u,
        Node::Windup(windup @ Windup { d, s, lambda }) => {
            // −(d/2)(1 − 2(1 − g)e^(−s/λ)), g what the stroke before left unwound.
            let (one, half) = (new.constant(1.0), new.constant(0.5));
            let unwound = new.unwound(windups.len() as u32);
            let (wound, left) = (new.subtract(one, unwound), new.binary(Binary::Decay, s, lambda));
            let ahead = new.multiply(left, wound);
            let rest = new.subtract(ahead, half);
            windups.push(windup);
            new.multiply(d, rest)
        }
        other => construct(new, other),
    });
    Settled { graph: new, roots: roots.iter().map(|root| new_id[root.index()]).collect(), windups }
}

/// A node of another graph in this one, folded.
pub(super) fn construct(graph: &mut Graph, node: Node) -> NodeId {
    match node {
        Node::Constant(bits) => graph.constant(f64::from_bits(bits)),
        Node::Variable(index) => graph.variable(index, false),
        Node::Inner(index) => graph.inner(index),
        Node::Unary(operation, a) => graph.unary(operation, a),
        Node::Binary(operation, a, b) => graph.binary(operation, a, b),
        Node::Select([condition, a, b]) => graph.select(condition, a, b),
        Node::Lag(lag) => graph.lag(lag),
        Node::Windup(windup) => graph.windup(windup),
        other @ (Node::LagTangent(_) | Node::WindupTangent(_) | Node::Unwound(_)) => {
            graph.along_sequence(other)
        }
    }
}
