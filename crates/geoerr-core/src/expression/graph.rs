//! What is to be computed, each thing once: operations share their operands, constants are folded.

use std::collections::HashMap;

use super::MAX_NODES;
use super::functions::{Binary, Unary, select};

/// An operation in its graph. Operands have smaller ids than what uses them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct NodeId(u32);

impl NodeId {
    pub(super) fn index(self) -> usize {
        self.0 as usize
    }
}

/// One operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Node {
    /// A number, by its bits.
    Constant(u64),
    Variable(u32),
    Inner(u32),
    Unary(Unary, NodeId),
    Binary(Binary, NodeId, NodeId),
    Select([NodeId; 3]),
    Lag(Lag),
    LagTangent(LagTangent),
    Windup(Windup),
    WindupTangent(WindupTangent),
    /// Of a formula for one position: what the stroke before left unwound, by the number of the wind-up.
    Unwound(u32),
}

/// First-order lag of `u` with the time constant `tau`, along a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Lag {
    pub(super) u: NodeId,
    pub(super) tau: NodeId,
    /// `u` is a mean since the previous row, so constant over the step; else a straight line between rows.
    pub(super) is_held: bool,
}

/// Derivative of a lag whose value is `y`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct LagTangent {
    pub(super) lag: Lag,
    pub(super) y: NodeId,
    pub(super) du: NodeId,
    pub(super) dtau: NodeId,
    /// By something of this row alone: what the rows before left behind has no derivative.
    pub(super) is_own_row: bool,
}

/// The recursion of `reversal-windup` for b = 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Windup {
    pub(super) d: NodeId,
    pub(super) s: NodeId,
    pub(super) lambda: NodeId,
}

/// Derivative of a wind-up (`d` jumps, and has none).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct WindupTangent {
    pub(super) windup: Windup,
    pub(super) ds: NodeId,
    pub(super) dlambda: NodeId,
    pub(super) is_own_row: bool,
}

impl Node {
    /// Calls `visit` for every operand.
    pub(super) fn operands(&self, mut visit: impl FnMut(NodeId)) {
        match *self {
            Self::Constant(_) | Self::Variable(_) | Self::Inner(_) | Self::Unwound(_) => {}
            Self::Unary(_, a) => visit(a),
            Self::Binary(_, a, b) => [a, b].into_iter().for_each(visit),
            Self::Select(operands) => operands.into_iter().for_each(visit),
            Self::Lag(Lag { u, tau, .. }) => [u, tau].into_iter().for_each(visit),
            Self::LagTangent(LagTangent { lag, y, du, dtau, .. }) => {
                [lag.u, lag.tau, y, du, dtau].into_iter().for_each(visit);
            }
            Self::Windup(Windup { d, s, lambda }) => [d, s, lambda].into_iter().for_each(visit),
            Self::WindupTangent(WindupTangent { windup: Windup { d, s, lambda }, ds, dlambda, .. }) => {
                [d, s, lambda, ds, dlambda].into_iter().for_each(visit);
            }
        }
    }
}

/// What the value of a node depends on.
#[derive(Clone, Copy, Debug, Default)]
struct Traits {
    /// On the row.
    varies: bool,
    /// On a mean speed since the previous row.
    has_mean_speed: bool,
}

/// All operations of a formula.
#[derive(Clone, Debug, Default)]
pub(super) struct Graph {
    nodes: Vec<Node>,
    traits: Vec<Traits>,
    known: HashMap<Node, NodeId>,
    is_overfull: bool,
}

impl Graph {
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether more operations were asked for than the limit; what was built since is meaningless.
    pub(super) fn is_overfull(&self) -> bool {
        self.is_overfull
    }

    pub(super) fn node(&self, id: NodeId) -> Node {
        self.nodes[id.index()]
    }

    pub(super) fn ids(&self) -> impl Iterator<Item = NodeId> + use<> {
        (0..self.nodes.len() as u32).map(NodeId)
    }

    /// Whether the value differs from row to row.
    pub(super) fn varies(&self, id: NodeId) -> bool {
        self.traits[id.index()].varies
    }

    /// Whether the value is, or comes from, a mean speed since the previous row.
    pub(super) fn has_mean_speed(&self, id: NodeId) -> bool {
        self.traits[id.index()].has_mean_speed
    }

    /// The number, where the node is one.
    pub(super) fn as_constant(&self, id: NodeId) -> Option<f64> {
        match self.node(id) {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// For each node, whether one of `roots` needs it.
    pub(super) fn needed_by(&self, roots: impl IntoIterator<Item = NodeId>) -> Vec<bool> {
        let mut is_needed = vec![false; self.len()];
        for root in roots {
            is_needed[root.index()] = true;
        }
        for index in (0..self.len()).rev() {
            if is_needed[index] {
                self.nodes[index].operands(|operand| is_needed[operand.index()] = true);
            }
        }
        is_needed
    }

    fn push_with(&mut self, node: Node, own: Traits) -> NodeId {
        if let Some(&id) = self.known.get(&node) {
            return id;
        }
        if self.nodes.len() >= MAX_NODES {
            self.is_overfull = true;
            return NodeId(0);
        }
        let mut traits = own;
        // What follows a mean speed has a value of its own at every row.
        let is_followed = matches!(node, Node::Lag(_) | Node::Windup(_));
        node.operands(|operand| {
            let of = self.traits[operand.index()];
            traits.varies |= of.varies;
            traits.has_mean_speed |= of.has_mean_speed && !is_followed;
        });
        let id = NodeId(self.nodes.len() as u32);
        self.nodes.push(node);
        self.traits.push(traits);
        self.known.insert(node, id);
        id
    }

    fn push(&mut self, node: Node) -> NodeId {
        self.push_with(node, Traits::default())
    }

    pub(super) fn constant(&mut self, value: f64) -> NodeId {
        // One bit pattern for the many NaNs.
        let bits = if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
        self.push(Node::Constant(bits))
    }

    pub(super) fn variable(&mut self, index: u32, is_mean_speed: bool) -> NodeId {
        self.push_with(Node::Variable(index), Traits { varies: true, has_mean_speed: is_mean_speed })
    }

    pub(super) fn inner(&mut self, index: u32) -> NodeId {
        self.push(Node::Inner(index))
    }

    pub(super) fn unary(&mut self, operation: Unary, a: NodeId) -> NodeId {
        if let Some(value) = self.as_constant(a) {
            return self.constant(operation.apply(value));
        }
        match (operation, self.node(a)) {
            (Unary::Negate, Node::Unary(Unary::Negate, inside)) => inside,
            _ => self.push(Node::Unary(operation, a)),
        }
    }

    /// An operation on two nodes. Nothing is folded that would make an unknown value known (`0*T` stays) or turn the sign
    /// of a zero (`0 - T` stays: `atan2` tells −0 from 0).
    pub(super) fn binary(&mut self, operation: Binary, a: NodeId, b: NodeId) -> NodeId {
        let constants = (self.as_constant(a), self.as_constant(b));
        if let (Some(a), Some(b)) = constants {
            return self.constant(operation.apply(a, b));
        }
        match (operation, constants) {
            (Binary::Multiply, (Some(1.0), _)) => return b,
            (Binary::Subtract, (_, Some(0.0)))
            | (Binary::Multiply | Binary::Divide | Binary::Power, (_, Some(1.0))) => return a,
            (Binary::Multiply, (Some(-1.0), _)) => return self.unary(Unary::Negate, b),
            (Binary::Multiply | Binary::Divide, (_, Some(-1.0))) => return self.unary(Unary::Negate, a),
            (Binary::Power, (_, Some(0.5))) => return self.unary(Unary::Sqrt, a),
            (Binary::Power, (_, Some(exponent))) if is_small_whole(exponent) => {
                return self.whole_power(a, exponent);
            }
            _ => {}
        }
        let (a, b) = if operation.is_commutative() && b < a { (b, a) } else { (a, b) };
        self.push(Node::Binary(operation, a, b))
    }

    /// Powers −8 to 8 (not 0) as products: x^2 is x·x.
    fn whole_power(&mut self, a: NodeId, exponent: f64) -> NodeId {
        let mut left = exponent.abs() as u32;
        let mut square = a;
        let mut product = None;
        while left > 0 {
            if left % 2 == 1 {
                product = Some(product.map_or(square, |product| self.multiply(product, square)));
            }
            left /= 2;
            if left > 0 {
                square = self.multiply(square, square);
            }
        }
        let product = product.unwrap_or(a);
        if exponent < 0.0 {
            let one = self.constant(1.0);
            self.binary(Binary::Divide, one, product)
        } else {
            product
        }
    }

    pub(super) fn add(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Add, a, b)
    }

    pub(super) fn subtract(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Subtract, a, b)
    }

    pub(super) fn multiply(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Multiply, a, b)
    }

    pub(super) fn divide(&mut self, a: NodeId, b: NodeId) -> NodeId {
        self.binary(Binary::Divide, a, b)
    }

    pub(super) fn negate(&mut self, a: NodeId) -> NodeId {
        self.unary(Unary::Negate, a)
    }

    pub(super) fn select(&mut self, condition: NodeId, a: NodeId, b: NodeId) -> NodeId {
        match self.as_constant(condition) {
            Some(value) if value.is_nan() => self.constant(f64::NAN),
            Some(value) => {
                if select(value, 1.0, 0.0) == 1.0 {
                    a
                } else {
                    b
                }
            }
            None => self.push(Node::Select([condition, a, b])),
        }
    }

    pub(super) fn lag(&mut self, lag: Lag) -> NodeId {
        self.along_sequence(Node::Lag(lag))
    }

    pub(super) fn windup(&mut self, windup: Windup) -> NodeId {
        self.along_sequence(Node::Windup(windup))
    }

    pub(super) fn unwound(&mut self, number: u32) -> NodeId {
        self.along_sequence(Node::Unwound(number))
    }

    /// What has a memory varies from row to row even where its operands do not.
    pub(super) fn along_sequence(&mut self, node: Node) -> NodeId {
        self.push_with(node, Traits { varies: true, has_mean_speed: false })
    }

    /// Builds this graph anew in another, node by node, with `replace` in the place of the constructors.
    ///
    /// `replace` gets every node with its operands already those of the new graph.
    pub(super) fn rebuilt(
        &self,
        roots: impl IntoIterator<Item = NodeId>,
        mut replace: impl FnMut(&mut Self, Node) -> NodeId,
    ) -> (Self, Vec<NodeId>) {
        let is_needed = self.needed_by(roots);
        let mut new = Self::default();
        let mut new_id = vec![NodeId(0); self.len()];
        for (index, node) in self.nodes.iter().enumerate() {
            if is_needed[index] {
                let at = |id: NodeId| new_id[id.index()];
                let moved = match *node {
                    Node::Unary(operation, a) => Node::Unary(operation, at(a)),
                    Node::Binary(operation, a, b) => Node::Binary(operation, at(a), at(b)),
                    Node::Select(operands) => Node::Select(operands.map(at)),
                    Node::Lag(Lag { u, tau, is_held }) => Node::Lag(Lag { u: at(u), tau: at(tau), is_held }),
                    Node::Windup(Windup { d, s, lambda }) => {
                        Node::Windup(Windup { d: at(d), s: at(s), lambda: at(lambda) })
                    }
                    // Derivatives are built last and never moved.
                    leaf @ (Node::Constant(_)
                    | Node::Variable(_)
                    | Node::Inner(_)
                    | Node::LagTangent(_)
                    | Node::WindupTangent(_)
                    | Node::Unwound(_)) => leaf,
                };
                new_id[index] = replace(&mut new, moved);
            }
        }
        (new, new_id)
    }
}

fn is_small_whole(exponent: f64) -> bool {
    exponent.fract() == 0.0 && (1.0..=8.0).contains(&exponent.abs())
}
